"""The division of a route into missions that fit the memory of the autopilot and the battery of the vehicle.

The division removes unnecessary waypoints.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_choice, check_integer, check_number, check_points
from shoal.core.errors import InvalidInputError
from shoal.search.cells.routing import leg_lengths
from shoal.search.flight.flight import ENDINGS, TERRAIN_ERROR, Flight
from shoal.search.flight.merging import merged
from shoal.search.flight.terrain import Terrain
from shoal.search.flight.turning import NEAR
from shoal.search.flight.vehicle import Vehicle, vehicle_of
from shoal.search.missions.mission import EXTRA, OVERHEAD, SAME_LEVEL, Autopilot, Mission
from shoal.search.problem.mission_options import CAPS
from shoal.search.regions.outline_checks import Points, check_plane_points, text_of
from shoal.search.regions.projection import LocalFrame

Ways = Callable[[Points, Points], ArrayLike]

_FLAT = 2e-4  # relative to the time: difference between north in the plane and north on Earth
_ROUNDING = 0.1  # seconds reserved for the rounding of coordinates in files
_FINE = 0.01  # metres: accuracy of cutting a leg at the battery's limit
_SHORTEST = 0.1  # metres: minimum progress of a sortie


def missions_of(
    route: ArrayLike,
    frame: LocalFrame | None,
    *,
    robot: int = 1,
    home: ArrayLike | None = None,
    vehicle: Vehicle | str = "multirotor",
    autopilot: Autopilot = "px4",
    rate: float = 1.0,
    altitude_frame: str = "home",
    terrain: Terrain | None = None,
    terrain_error: float = TERRAIN_ERROR,
    cap: int | None = None,
    tolerance: float = 0.001,
    link: float = 0.0,
    blocked: Any = None,
    area: Any = None,
    ways: Ways | None = None,
    landing: ArrayLike | None = None,
    ending: str | None = None,
    out: int = 0,
) -> tuple[Mission, ...]:
    """Divide a robot's route into missions, one for each sortie.

    Each sortie begins at home, and continues the route at the point at which the previous sortie left the route. Each sortie ends
    before the battery falls below the reserve. The duration of a sortie includes climb, turns and descent, and depends on the wind.
    A sortie may leave the route at any point of a leg.

    Parameters
    ----------
    route : array_like of float, shape (k, 2) or (k, 3)
        Route in metres, with altitudes in the third column. A route without a third column has the vehicle's altitude. An empty
        route gives no missions.
    frame : LocalFrame or None
        Local frame of the route. Without a frame, missions are in metres.
    robot : int
        Number of the robot. The first robot has the number 1.
    home : array_like of float, shape (2,), optional
        Home of the robot in metres. By default, home is the first point of the route.
    vehicle : Vehicle or str
        A vehicle, or a text that `vehicle_of` understands.
    autopilot : "px4" or "ardupilot"
    rate : float
        Speed of the robot divided by the vehicle's cruise speed.
    altitude_frame, terrain, terrain_error, link, blocked, area
        Parameters of `Flight`. With the altitude frame "ground", additional waypoints keep the error of the height above ground
        below ``terrain_error``.
    cap : int, optional
        Maximum number of mission items that the autopilot stores, including home, take-off, speed and return. The default is 2000
        items for PX4 and 700 items for ArduPilot.
    tolerance : float
        Maximum distance in metres between an omitted point of the route and the straight leg that replaces it. With the tolerance
        0, the function omits a point only if it lies exactly on a leg.
    ways : callable, optional
        Function ``ways(start, end)`` that computes the path between home and a point of the route, such as
        `shoal.search.RegionPaths.leg`. A path is an array of points, shape (n, 2), including both ends. The bends of the path
        become waypoints. By default, the path between home and the route is straight.
    landing : array_like of float, shape (2,), optional
        Landing point of the last sortie in metres. By default, the last sortie ends at home.
    ending : "return", "land" or "loiter", optional
        Ending of each sortie. By default, a sortie ends with a landing if ``landing`` is given, and with a return otherwise.
        Instead of landing, a rover stops and holds.
    out : int
        Number of points at the beginning of the route that belong to the way out from home. The search begins at the next point.

    Raises
    ------
    InvalidInputError
        If an argument is out of range, or if the battery is too small for a point of the route.

    Examples
    --------
    >>> lanes = [(0, 0), (30, 0), (60, 0), (60, 10), (0, 10)]
    >>> [mission.waypoints.tolist() for mission in missions_of(lanes, None)]
    [[[0.0, 0.0], [60.0, 0.0], [60.0, 10.0], [0.0, 10.0]]]
    >>> two = missions_of(lanes, None, vehicle="ideal,endurance=2.25,reserve=0")  # 135 s at 1 m/s
    >>> [round(mission.length) for mission in two]
    [135, 31]
    """
    kept = vehicle_of(vehicle)
    check_choice(autopilot, what="autopilot", choices=CAPS)
    levels = np.ndim(route) == 2 and np.shape(route)[1] == 3
    points = check_points(route, what=f"route of robot {robot}", dimensions=3 if levels else 2)
    if len(points) == 0:
        return ()
    base = points[0, :2] if home is None else check_plane_points([home], what="home")[0]
    end = None if landing is None else check_plane_points([landing], what="landing")[0]
    how = ("return" if end is None else "land") if ending is None else check_choice(ending, what="ending", choices=ENDINGS)
    if how == "return" and end is not None:
        raise InvalidInputError("ending: expected land or loiter with a landing point, because a return leads home, got return")
    flight = Flight(kept, base, frame, altitude_frame, terrain, terrain_error, rate, link, blocked, end, area, how)
    told = _told(kept)
    beside = OVERHEAD[kept.kind] + sum(count for name, count in EXTRA.items() if told[name] is not None)
    most = CAPS[autopilot] if cap is None else cap
    room = check_integer(most, what="cap", least=2 + beside) - beside  # at least two waypoints
    check_number(tolerance, what="tolerance", least=0)
    check_integer(out, what="out", least=0, most=len(points) - 1)
    led, way = merged(points[: out + 1], tolerance)[:-1], merged(points[out:], tolerance)
    splitter = _Splitter(np.vstack([led, way]), flight, room, ways, robot, len(led))
    parts = splitter.parts()
    placed = (lambda array: array) if frame is None else frame.to_degrees
    x, y = placed(base[None])[0].tolist()
    last = (x, y) if end is None else tuple(placed(end[None])[0].tolist())
    ends = [None] * len(parts) if how == "return" else [(x, y)] * (len(parts) - 1) + [last]
    loiter = None if how != "loiter" else round(flight.radius, 3)
    speed = kept.cruise * flight.rate
    return tuple(
        Mission(
            placed(part[:, :2]), (x, y), robot, number, kept.kind, autopilot,  # type: ignore[arg-type]  # both were checked
            speed=speed, geographic=frame is not None, altitude_frame=altitude_frame,
            heights=part[:, 2] if np.ptp(part[:, 2]) else None, elevation=flight.elevation, landing=ends[number - 1],
            loiter=loiter, waypoints_out=before, waypoints_home=after,
            **told | {"altitude": kept.height} | _levels(part, flight, several=levels),
        )
        for number, (part, before, after) in enumerate(parts, start=1)
    )  # fmt: skip


def _levels(waypoints: NDArray[np.float64], flight: Flight, *, several: bool) -> dict[str, Any]:
    """Return the altitudes that a mission stores besides its heights above home.

    If the route has several altitudes, the result contains the first waypoint's altitude. If altitudes above ground differ, the
    result contains the altitude above ground of every waypoint.
    """
    ups = waypoints[:, 2] + (float(flight.elevation or 0.0) if flight.altitude_frame != "home" else 0.0)
    told: dict[str, Any] = {"altitude": float(ups[0])} if several else {}
    if flight.altitude_frame == "ground" and flight.terrain is not None:
        ups = np.round(ups - flight.terrain.at(waypoints[:, :2], flight.frame), 6)
        usual, same = (ups[0], SAME_LEVEL) if several else (flight.vehicle.height, flight.terrain_error)
        told |= {"altitude": float(usual)} | ({"altitudes": ups} if np.abs(ups - usual).max() > same else {})
    return told


def _told(vehicle: Vehicle) -> dict[str, Any]:
    """Return the settings of a vehicle that a mission stores, except for the speed."""
    flies = vehicle.kind != "rover"
    pitch = vehicle.gimbal_pitch if vehicle.image_size is None or vehicle.gimbal_pitch is not None else -90.0
    return {
        "trigger_distance": vehicle.trigger_distance,
        "gimbal_pitch": pitch if flies else None,
        "yaw": vehicle.yaw if vehicle.kind == "multirotor" else None,
        "acceptance_radius": vehicle.acceptance_radius,
    }


class _Splitter:
    """An object that divides a path into sorties that are as long as the battery and the autopilot's memory allow.

    To check battery and memory, the splitter computes each sortie exactly as the mission file will contain it.
    """

    def __init__(self, way: Points, flight: Flight, room: int, ways: Ways | None, robot: int, out: int) -> None:
        self.way, self.flight, self.room, self.ways, self.robot = way, flight, room, ways, robot
        self.home, self.limit = flight.home, (1 - _FLAT) * flight.vehicle.usable_seconds - _ROUNDING
        self.returning = replace(flight, landing=None)
        self.at = np.concatenate([[0.0], np.cumsum(leg_lengths(way))])
        self.searching_from = float(self.at[out])

    def parts(self) -> list[tuple[NDArray[np.float64], int, int]]:
        """Return the waypoints of each sortie, with the columns of `Flight.waypoints`.

        Besides the waypoints, each element of the list contains the number of waypoints on the way out, and the number on the way
        home.
        """
        begin, end = 0.0, float(self.at[-1])
        found: list[tuple[NDArray[np.float64], int, int]] = []
        while True:
            until = self._latest(begin)
            waypoints = self._sortie(begin, until)
            found.append((waypoints, *self._beside(waypoints, begin, until)))
            if until >= end:
                return found
            begin = until

    def _latest(self, begin: float) -> float:
        """Return the largest distance along the path at which a sortie that joins the path at ``begin`` can leave the path."""
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
        until, far = begin if low < 0 else float(ahead[low]), float(ahead[min(low + 1, len(ahead) - 1)])
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
        """Return the waypoints of a sortie: from home to a section of the path, along this section, and back home."""
        flight = self._flight(until)
        out, back = self._way_to(self.home, begin)[::-1], self._way_to(flight.end, until)
        return flight.waypoints(np.vstack([out[1:-1], self._between(begin, until), back[1:-1]]))

    def _beside(self, waypoints: NDArray[np.float64], begin: float, until: float) -> tuple[int, int]:
        """Return the number of waypoints before and after the section of the path that a sortie searches.

        A fixed wing may pass an end of the section between two waypoints. In this case, the whole leg belongs to the search.
        """
        way = waypoints[:, :2]
        first, last = (self._point(at)[:2] for at in (max(begin, min(self.searching_from, until)), until))
        before = min(_passing(way, first), len(way) - 1)
        return before, min(_passing(way[::-1], last), len(way) - 1 - before)

    def _flight(self, until: float) -> Flight:
        """Return the flight of a sortie. The last sortie ends at the robot's landing point, and all other sorties end at home."""
        return self.flight if until >= float(self.at[-1]) else self.returning

    def _point(self, at: float) -> Points:
        """Return the point at the distance ``at`` along the path."""
        return np.array([np.interp(at, self.at, column) for column in self.way.T])

    def _way_to(self, end: Points, at: float) -> Points:
        """Return the path from a point of the route to home or to the landing point, including both ends."""
        point = self._point(at)
        way = np.array([point[:2], end])
        if self.ways is not None and not np.array_equal(*way):
            found = check_plane_points(self.ways(point[:2], end), what="way home")
            way = found if len(found) >= 2 else way
        return np.column_stack([way, np.tile(point[2:], (len(way), 1))])  # the whole path has the altitude of the point

    def _between(self, begin: float, until: float) -> Points:
        """Return the points of the path between two distances along the path, with both ends."""
        inner = self.way[(self.at > begin) & (self.at < until)]
        ends = [self._point(begin)] if until == begin else [self._point(begin), self._point(until)]
        return np.vstack([ends[:1], inner, ends[1:]]) if len(ends) == 2 else np.array(ends)

    def _refuse(self, begin: float) -> None:
        """Raise an error that explains why a sortie that begins at the distance ``begin`` makes no progress."""
        shortest = self._sortie(begin, begin)
        if self.flight.flown(shortest).duration <= self.limit and len(shortest) + 1 > self.room:
            raise InvalidInputError(
                f"cap: expected room for more waypoints of robot {self.robot}, got {self.room}: the paths from home to "
                f"{text_of(self._point(begin))} and back have {len(shortest)} waypoints"
            )
        away = np.hypot(*(self.way[:, :2] - self.home).T)
        farthest = self.way[int(np.argmax(away))]  # the next obstacle to progress
        needed = self.flight.flown(self.flight.waypoints(farthest[None])).duration
        because = f"{text_of(farthest)} is {away.max():.6g} m from home"
        if needed <= self.limit:  # the paths from home and back are longer than straight paths
            until = min(begin + _SHORTEST, float(self.at[-1]))
            needed = self._flight(until).flown(self._sortie(begin, until)).duration
            because = f"the paths from home to {text_of(self._point(begin))} and back take as long"
        raise InvalidInputError(
            f"endurance: expected sorties of more than {needed / 60:.4g} min for robot {self.robot}, because {because}, got "
            f"{self.limit / 60:.4g} min without the reserve"
        )


def _passing(way: Points, point: Points) -> int:
    """Return the number of waypoints before a path first passes a point; 0 if the path does not pass the point."""
    legs = np.diff(way, axis=0)
    far = np.clip(((point - way[:-1]) * legs).sum(axis=1) / np.maximum((legs**2).sum(axis=1), 1e-12), 0.0, 1.0)
    near = np.flatnonzero(np.hypot(*(way[:-1] + far[:, None] * legs - point).T) < NEAR)
    if not len(near) or np.hypot(*(way[0] - point)) < NEAR:  # a vertical leg has both its ends at one place
        return 0
    return int(near[0]) + int(np.hypot(*(way[near[0] + 1] - point)) < NEAR)
