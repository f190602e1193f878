"""Division of a route into sorties that fit the autopilot's memory and the battery."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.errors import InvalidInputError
from shoal.search.cells.routing import leg_lengths
from shoal.search.flight.flight import Flight
from shoal.search.regions.outline_checks import Points, check_plane_points, text_of

Ways = Callable[[Points, Points], ArrayLike]

_FLAT = 2e-4  # relative to the time: difference between north in the plane and north on Earth
_ROUNDING = 0.1  # seconds reserved for the rounding of coordinates in files
_FINE = 0.01  # metres: accuracy of cutting a leg at the battery's limit
_SHORTEST = 0.1  # metres: minimum progress of a sortie


def sorties(way: Points, flight: Flight, *, room: int, ways: Ways | None = None, robot: int = 1) -> list[NDArray[np.float64]]:
    """Return the waypoints of each sortie along a path, in the form of `Flight.waypoints`.

    Each sortie is computed exactly as it will be written, to check that memory and battery suffice.

    Parameters
    ----------
    way : ndarray of float64, shape (k, 2) or (k, 3), k >= 1
        Path in metres. The third column holds altitudes.
    flight : Flight
    room : int
        Maximum number of waypoints of a sortie.
    ways : callable, optional
        Paths between home and points. The default is straight.
    robot : int
        For messages.

    Raises
    ------
    InvalidInputError
        If battery or memory do not allow any progress.
    """
    return _Splitter(way, flight, room, ways, robot).parts()


class _Splitter:
    """Cuts a path as late as battery and memory allow."""

    def __init__(self, way: Points, flight: Flight, room: int, ways: Ways | None, robot: int) -> None:
        self.way, self.flight, self.room, self.ways, self.robot = way, flight, room, ways, robot
        self.home, self.limit = flight.home, (1 - _FLAT) * flight.vehicle.usable_seconds - _ROUNDING
        self.returning = replace(flight, landing=None)
        self.at = np.concatenate([[0.0], np.cumsum(leg_lengths(way))])

    def parts(self) -> list[NDArray[np.float64]]:
        begin, end = 0.0, float(self.at[-1])
        found: list[NDArray[np.float64]] = []
        while True:
            until = self._latest(begin)
            found.append(self._sortie(begin, until))
            if until >= end:
                return found
            begin = until

    def _latest(self, begin: float) -> float:
        """Return how far along the path a sortie that starts at ``begin`` can go."""
        end = float(self.at[-1])
        if self._fits(begin, end):
            return end
        if not self._fits(begin, begin):
            self._refuse(begin)
        ahead = self.at[self.at > begin]
        low, step = -1, 1  # the last vertex known to be possible; none yet
        while low + step < len(ahead) and self._fits(begin, float(ahead[low + step])):
            low, step = low + step, 2 * step
        high = min(low + step, len(ahead))
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if self._fits(begin, float(ahead[middle])) else (low, middle)
        near, far = begin if low < 0 else float(ahead[low]), float(ahead[min(low + 1, len(ahead) - 1)])
        until = near
        while far - until > _FINE:  # inside a leg, only the battery is a finer limit than waypoints
            half = (until + far) / 2
            until, far = (half, far) if self._fits(begin, half) else (until, half)
        if until <= begin or (low < 0 and until - begin < _SHORTEST):
            self._refuse(begin)
        return until

    def _fits(self, begin: float, until: float) -> bool:
        waypoints = self._sortie(begin, until)
        return len(waypoints) <= self.room and self._flight(until).flown(waypoints).duration <= self.limit

    def _sortie(self, begin: float, until: float) -> NDArray[np.float64]:
        """Return the waypoints from home along a section of the path and home."""
        flight = self._flight(until)
        out, back = self._way_to(self.home, begin)[::-1], self._way_to(flight.end, until)
        return flight.waypoints(np.vstack([out[1:-1], self._between(begin, until), back[1:-1]]))

    def _flight(self, until: float) -> Flight:
        """Return the flight of a sortie. Only the last sortie ends at the robot's landing point; the others end at home."""
        return self.flight if until >= float(self.at[-1]) else self.returning

    def _point(self, at: float) -> Points:
        """Return the point at a distance along the path."""
        leg = int(np.clip(np.searchsorted(self.at, at, side="right") - 1, 0, max(0, len(self.way) - 2)))
        if len(self.way) == 1 or at == self.at[leg]:
            return np.asarray(self.way[leg])
        if at == self.at[leg + 1]:
            return np.asarray(self.way[leg + 1])
        share = (at - self.at[leg]) / (self.at[leg + 1] - self.at[leg])
        return np.asarray(self.way[leg] + share * (self.way[leg + 1] - self.way[leg]))

    def _way_to(self, end: Points, at: float) -> Points:
        """Return the path from a point of the route to home or to the landing point, including both ends."""
        point = self._point(at)
        way = np.array([point[:2], end])
        if self.ways is not None and not np.array_equal(*way):
            found = check_plane_points(self.ways(point[:2], end), what="way home")
            way = found if len(found) >= 2 else way
        return np.column_stack([way, np.tile(point[2:], (len(way), 1))])  # the whole path has the altitude of the point

    def _between(self, begin: float, until: float) -> Points:
        """Return the waypoints between two distances along the path."""
        inner = self.way[(self.at > begin) & (self.at < until)]
        ends = [self._point(begin)] if until == begin else [self._point(begin), self._point(until)]
        return np.vstack([ends[:1], inner, ends[1:]]) if len(ends) == 2 else np.array(ends)

    def _refuse(self, begin: float) -> None:
        """Raise an error that explains why a sortie makes no progress beyond a point."""
        shortest = self._sortie(begin, begin)
        if self.flight.flown(shortest).duration <= self.limit and len(shortest) + 1 > self.room:
            raise InvalidInputError(
                f"cap: expected room for more waypoints of robot {self.robot}, got {self.room}: the ways from home to "
                f"{text_of(self._point(begin))} and back have {len(shortest)}"
            )
        away = np.hypot(*(self.way[:, :2] - self.home).T)
        farthest = self.way[int(np.argmax(away))]  # the next obstacle to progress
        needed = self.flight.flown(self.flight.waypoints(farthest[None])).duration
        raise InvalidInputError(
            f"endurance: expected sorties of more than {needed / 60:.4g} min for robot {self.robot}, for {text_of(farthest)} is "
            f"{away.max():.6g} m from home, got {self.limit / 60:.4g} min, the reserve left"
        )
