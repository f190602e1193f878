"""Sorties: the division of a path into flights that fit the battery of the vehicle and the memory
of its autopilot.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from math import inf

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.errors import InvalidInputError
from shoal.core.geometry import partial_sums
from shoal.search.flight.dubins import NEAR
from shoal.search.flight.flight import Flight
from shoal.search.flight.imaging import image_waypoints
from shoal.search.flight.timing import Trajectory, return_seconds
from shoal.search.regions.outline import Points, check_plane_points, text_of

PathFinder = Callable[[Points, Points], ArrayLike]

_FLAT = 2e-4  # relative to the time: difference between north in the plane and north on Earth
_ROUNDING = 0.1  # seconds reserved for the rounding of coordinates in files
_FINE = 0.01  # metres: accuracy of cutting a leg at the battery's limit
_GUESSES = 12  # of the vertex and of the place on a leg where a sortie ends
_SHORTEST = 0.1  # metres: minimum progress of a sortie
_MOST = 300  # sorties of a vehicle: about 100 hours in the air with a battery for 20 minutes
_LOWER = 1.0  # metres by which a fixed wing may begin a search lower than planned
_HOPE = 2.0  # relative to the previous sortie: the longest rest that is tried at once


class Sorties:
    """An object that divides a path into sorties that are as long as the battery and the
    autopilot's memory allow.

    To check battery and memory, the object computes each sortie exactly as the mission file will
    contain it. Plans take the times of their flights from here, so that a plan and its missions
    agree.

    Parameters
    ----------
    path : ndarray of float64, shape (k, 2) or (k, 3)
        Path in metres, with altitudes in the third column.
    flight : Flight
    most_waypoints : int
        Maximum number of waypoints in a sortie, together with the images of a camera at waypoints.
    find_path : callable or None
        Function that computes the path between home and a point of the route; see
        `shoal.missions.split_missions`.
    robot : int
        Number of the robot for error messages.
    out : int
        Number of points at the beginning of the path that belong to the way out from home.
    """

    def __init__(
        self,
        path: Points,
        flight: Flight,
        most_waypoints: int,
        find_path: PathFinder | None,
        robot: int,
        out: int,
    ) -> None:
        self.path, self.flight, self.find_path, self.robot = path, flight, find_path, robot
        self.most_waypoints = most_waypoints
        self.home, self.limit = flight.home, (1 - _FLAT) * flight.vehicle.usable_seconds - _ROUNDING
        self.returning = replace(flight, landing=None)
        self.at = partial_sums(np.linalg.norm(np.diff(path, axis=0), axis=1))
        self.searching_from = float(self.at[out])
        # what was tried is flown, too: most paths are one sortie, tried once
        self._tried: dict[tuple[float, float], NDArray[np.float64]] = {}
        self._flown: dict[tuple[float, float], Trajectory] = {}
        self._home: dict[tuple[bytes, float], Points] = {}  # paths home, from each tried point

    def trajectories(self) -> list[Trajectory]:
        """Return the trajectory of each sortie, from take-off to landing.

        Raises
        ------
        InvalidInputError
            If the battery or the memory is too small for a point of the path, if the path takes
            far more than 300 sorties, or if the vehicle has no room for a turn.
        """
        return [self._trajectory(begin, until) for begin, until in self._sections]

    def returns(self) -> list[float]:
        """Return the seconds by which the vehicle is back later than the trajectory of each sortie
        tells, because its return begins with a climb.
        """
        return [self._return_seconds(self._sortie(begin, until)) for begin, until in self._sections]

    def searching(self) -> list[tuple[Trajectory, float, float]]:
        """Return the trajectory of each sortie, and when its search begins and ends."""
        searches = []
        for begin, until in self._sections:
            flown, waypoints = self._trajectory(begin, until), self._sortie(begin, until)
            out, back = self._count_beside(waypoints, begin, until)
            places = waypoints[[out, len(waypoints) - 1 - back], :2]
            away = np.hypot(*(flown.points[:, None, :2] - places).transpose(2, 0, 1))
            first = int(np.argmax(away[:, 0] < NEAR))
            last = len(away) - 1 - int(np.argmax(away[::-1, 1] < NEAR))
            searches.append((flown, float(flown.times[first]), float(flown.times[last])))
        return searches

    def parts(self) -> list[tuple[NDArray[np.float64], int, int]]:
        """Return the waypoints of each sortie, with the columns of `Flight.waypoints`.

        Besides the waypoints, each element of the list contains the number of waypoints on the way
        out, and the number on the way home.
        """
        return [
            (waypoints, *self._count_beside(waypoints, begin, until))
            for begin, until in self._sections
            for waypoints in (self._sortie(begin, until),)
        ]

    @property
    def _range(self) -> float:
        """Metres that the vehicle flies straight on one battery without wind."""
        return self.flight.vehicle.cruise * self.flight.rate * self.limit

    @cached_property
    def _sections(self) -> list[tuple[float, float]]:
        """Return the distances along the path at which each sortie joins and leaves the path."""
        end, each = float(self.at[-1]), self._range
        if end > _MOST * each > 0:
            raise InvalidInputError(
                f"endurance: expected a path of at most {_MOST} sorties for robot {self.robot}, got"
                f" a path of {end / 1000:.4g} km, which takes {end / each:.0f} sorties or more of"
                f" {self.limit / 60:.4g} min without the reserve"
            )
        departures = [(0.0, self._latest(0.0))]
        while departures[-1][1] < end:
            before, begin = departures[-1]
            # the whole rest is as slow to compute as it is long
            departures.append(
                (begin, self._latest(begin, hope=end - begin < _HOPE * (begin - before)))
            )
        return departures

    def _latest(self, begin: float, *, hope: bool = True) -> float:
        """Return the largest distance along the path at which a sortie that joins the path at
        ``begin`` can leave the path.

        If ``hope`` is true, the end of the path is tried first.
        """
        end = float(self.at[-1])
        if hope and self._fits(begin, end):
            return end
        if not self._fits(begin, begin):
            self._refuse(begin)
        marks = np.concatenate([[begin], self.at[self.at > begin]])
        low, high = 0, len(marks) - 1  # a vertex where it can leave, and one where it cannot
        if not hope:
            high = min(max(1, int(np.searchsorted(marks, begin + self._range))), high)
            while self._fits(begin, float(marks[high])):  # with the wind, perhaps
                if high == len(marks) - 1:
                    return end
                low, high = high, min(2 * high, len(marks) - 1)
        vertices = self._bracket(begin, float(marks[low]), float(marks[high]), marks)
        low, high = np.searchsorted(marks, vertices).tolist()
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if self._fits(begin, float(marks[middle])) else (low, middle)
        until, far = float(marks[low]), float(marks[high])
        known = self._bracket(begin, until, far)
        while far - until > _FINE:
            half = (until + far) / 2
            if known[0] < half < known[1]:
                known = (half, known[1]) if self._fits(begin, half) else (known[0], half)
            until, far = (half, far) if half <= known[0] else (until, half)
        if until <= begin or (low == 0 and until - begin < _SHORTEST):
            self._refuse(begin)
        return until

    def _bracket(
        self, begin: float, low: float, high: float, places: NDArray[np.float64] | None = None
    ) -> tuple[float, float]:
        """Return two distances, or two of the sorted ``places``, between ``low``, where a sortie
        can leave the path, and ``high``, where it cannot: the first can be left, the second cannot.

        They are found by false position with the weights of the Illinois algorithm, because sorties
        use the battery and the memory almost in proportion to their length.
        """
        ends, last = [low, high], -1
        over = [self._share(begin, at) - 1.0 for at in ends]
        for _ in range(_GUESSES):
            if ends[1] - ends[0] <= _FINE or over[0] >= 0 or over[1] <= 0:
                break
            guess = ends[0] + over[0] / (over[0] - over[1]) * (ends[1] - ends[0])
            if places is not None:
                first, after = np.searchsorted(places, ends).tolist()
                if after - first < 2:
                    break
                near = int(np.searchsorted(places, guess))
                guess = float(places[min(max(near, first + 1), after - 1)])
            share = self._share(begin, guess)
            side = int(share > 1.0)
            ends[side], over[side] = guess, share - 1.0
            if side == last:
                over[1 - side] /= 2
            last = side
        return ends[0], ends[1]

    def _fits(self, begin: float, until: float) -> bool:
        return self._share(begin, until) <= 1.0

    def _share(self, begin: float, until: float) -> float:
        """Return what a sortie needs of the memory or of the battery, whichever is more, relative
        to what there is. If the memory is too small, the battery is not asked.
        """
        items = self._n_items(self._sortie(begin, until)) / self.most_waypoints
        if items > 1.0:
            return items
        if self.limit <= 0:
            return inf
        return max(self._battery_seconds(begin, until) / self.limit, items)

    def _battery_seconds(self, begin: float, until: float) -> float:
        """Return the time for which a sortie needs the battery, with the climb of a return."""
        flown = self._trajectory(begin, until)
        return flown.duration + self._return_seconds(self._sortie(begin, until))

    def _return_seconds(self, waypoints: NDArray[np.float64]) -> float:
        if self.flight.ending != "return":
            return 0.0
        return return_seconds(self.flight.vehicle, float(waypoints[-1, 2]))

    def _n_items(self, waypoints: NDArray[np.float64]) -> int:
        """Return the largest number of mission items of waypoints and of images there."""
        vehicle = self.flight.vehicle
        if vehicle.trigger_distance is None:
            return len(waypoints)
        images = image_waypoints(waypoints, vehicle.trigger_distance, vehicle.kind)
        return len(waypoints) + 2 * len(images)  # two at sharp turns

    def _trajectory(self, begin: float, until: float) -> Trajectory:
        """Return the trajectory of a sortie, from take-off to landing."""
        key = begin, until
        if key not in self._flown:
            self._flown[key] = self._flight(until).trajectory(self._sortie(begin, until))
        return self._flown[key]

    def _sortie(self, begin: float, until: float) -> NDArray[np.float64]:
        """Return the waypoints of a sortie: from home to a section of the path, along this section,
        and back home.
        """
        key = begin, until
        if key not in self._tried:
            self._tried[key] = self._waypoints(begin, until)
        return self._tried[key]

    def _waypoints(self, begin: float, until: float) -> NDArray[np.float64]:
        flight = self._flight(until)
        out, back = self._path_to(self.home, begin)[::-1], self._path_to(flight.end, until)
        out, between, back = map(
            flight.lengthen_short_legs, (out, self._between(begin, until), back)
        )
        return flight.waypoints(np.vstack([out[1:-1], between, back[1:-1]]))

    def _count_beside(
        self, waypoints: NDArray[np.float64], begin: float, until: float
    ) -> tuple[int, int]:
        """Return the number of waypoints before and after the section of the path that a sortie
        searches.

        A fixed wing may pass an end of the section between two waypoints. In this case, the whole
        leg belongs to the search.
        """
        first, last = (
            self._point(at) for at in (max(begin, min(self.searching_from, until)), until)
        )
        before = min(self._count_before(waypoints, first), len(waypoints) - 1)
        after = self._count_before(waypoints[::-1], last)
        return before, min(after, len(waypoints) - 1 - before)

    def _count_before(self, waypoints: NDArray[np.float64], point: Points) -> int:
        """Return the number of waypoints before a path first passes a point; 0 if the path does not
        pass the point.

        Wings that climb in circles may pass the point before they are at its height: these passes
        do not count.
        """
        path, place = waypoints[:, :2], point[:2]
        least = self.flight.height_at(point) - _LOWER if self.flight.vehicle.radius else -inf
        legs, heights = np.diff(path, axis=0), waypoints[:, 2]
        far = np.clip(
            ((place - path[:-1]) * legs).sum(axis=1) / np.maximum((legs**2).sum(axis=1), 1e-12),
            0.0,
            1.0,
        )
        near = np.flatnonzero(
            (np.hypot(*(path[:-1] + far[:, None] * legs - place).T) < NEAR)
            & (heights[:-1] + far * np.diff(heights) >= least)
        )
        # a vertical leg has both its ends at one place
        if not len(near) or (np.hypot(*(path[0] - place)) < NEAR and heights[0] >= least):
            return 0
        return int(near[0]) + int(np.hypot(*(path[near[0] + 1] - place)) < NEAR)

    def _flight(self, until: float) -> Flight:
        """Return the flight of a sortie. The last sortie ends at the robot's landing point, and all
        other sorties end at home.
        """
        return self.flight if until >= float(self.at[-1]) else self.returning

    def _point(self, at: float) -> Points:
        """Return the point at the distance ``at`` along the path."""
        return np.array([np.interp(at, self.at, column) for column in self.path.T])

    def _path_to(self, end: Points, at: float) -> Points:
        """Return the path from a point of the route to home or to the landing point, including both
        ends.
        """
        key = end.tobytes(), at
        if key in self._home:
            return self._home[key]
        point = self._point(at)
        points = np.array([point[:2], end])
        if self.find_path is not None and not np.array_equal(*points):
            path = check_plane_points(self.find_path(point[:2], end), what="path home")
            points = path if len(path) >= 2 else points
        # the whole path has the altitude of the point
        self._home[key] = np.column_stack([points, np.tile(point[2:], (len(points), 1))])
        return self._home[key]

    def _between(self, begin: float, until: float) -> Points:
        """Return the points of the path between two distances along the path, with both ends."""
        inner = self.path[(self.at > begin) & (self.at < until)]
        ends = [self._point(begin)] if until == begin else [self._point(begin), self._point(until)]
        return np.vstack([ends[:1], inner, ends[1:]]) if len(ends) == 2 else np.array(ends)

    def _refuse(self, begin: float) -> None:
        """Raise an error that explains why a sortie that begins at the distance ``begin`` makes no
        progress.
        """
        shortest = self._sortie(begin, begin)
        if (
            self.flight.trajectory(shortest).duration + self._return_seconds(shortest) <= self.limit
            and self._n_items(shortest) + 1 > self.most_waypoints
        ):
            raise InvalidInputError(
                f"cap: expected room for more waypoints of robot {self.robot}, got {self.most_waypoints}: the"
                f" paths from home to {text_of(self._point(begin))} and back have {len(shortest)}"
                " waypoints"
            )
        away = np.hypot(*(self.path[:, :2] - self.home).T)
        farthest = self.path[int(np.argmax(away))]  # the next obstacle to progress
        there = self.flight.waypoints(farthest[None])
        needed = self.flight.trajectory(there).duration + self._return_seconds(there)
        because = f"{text_of(farthest)} is {away.max():.6g} m from home"
        if needed <= self.limit:  # the paths from home and back are longer than straight paths
            until = min(begin + _SHORTEST, float(self.at[-1]))
            needed = self._battery_seconds(begin, until)
            because = f"the paths from home to {text_of(self._point(begin))} and back take as long"
        raise InvalidInputError(
            f"endurance: expected sorties of more than {needed / 60:.4g} min for robot"
            f" {self.robot}, because {because}, got {self.limit / 60:.4g} min without the reserve"
        )
