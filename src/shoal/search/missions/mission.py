"""What one vehicle is to drive or fly in one go, and how a route becomes such missions."""

from __future__ import annotations

from math import inf
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from shoal.checks import check_choice, check_integer, check_number
from shoal.dataclass import dataclass
from shoal.errors import InvalidInputError
from shoal.search.missions.merging import merged
from shoal.search.missions.splitting import Ways, sorties
from shoal.search.regions.outline_checks import Points, check_plane_points, text_of
from shoal.search.regions.projection import LocalFrame

Kind = Literal["multirotor", "rover"]
Vehicle = Literal["px4", "ardupilot"]

CAPS: dict[str, int] = {"px4": 2000, "ardupilot": 700}  # items that an autopilot stores, home included
ALTITUDES: dict[str, float] = {"multirotor": 30.0, "rover": 0.0}
SPEEDS: dict[str, float] = {"multirotor": 5.0, "rover": 1.0}
OVERHEAD: dict[str, int] = {"multirotor": 4, "rover": 3}  # items beside waypoints: home, take-off, speed, return


@dataclass(frozen=True, eq=False)
class Mission:
    """One sortie of one robot: from home along the waypoints and home again.

    Parameters
    ----------
    waypoints : ndarray of float64, shape (k, 2), k >= 1
        (longitude, latitude) in degrees, WGS84; (x, y) in metres if not ``geographic``.
    home : tuple of float
        Where the vehicle starts and ends, in the same units.
    robot : int
        Its number, from 1.
    sortie : int
        Which of its sorties this is, from 1.
    kind : "multirotor" or "rover"
    vehicle : "px4" or "ardupilot"
        The autopilot.
    altitude : float
        Metres above home; 0 for a rover.
    speed : float
        Metres a second.
    geographic : bool
        Whether coordinates are degrees.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> mission = Mission([(8.5, 47.4), (8.501, 47.4)], (8.5, 47.4), robot=3)
    >>> mission.name, round(mission.length), mission.n_items
    ('robot-03', 151, 6)
    """

    waypoints: Points
    home: tuple[float, float]
    robot: int = 1
    sortie: int = 1
    kind: Kind = "multirotor"
    vehicle: Vehicle = "px4"
    altitude: float = 30.0
    speed: float = 5.0
    geographic: bool = True

    def __post_init__(self) -> None:
        points = check_plane_points(self.waypoints, what="mission waypoints").copy()
        if len(points) == 0:
            raise InvalidInputError("mission: expected waypoints, got none")
        points.flags.writeable = False
        home = check_plane_points([self.home], what="mission home")[0]
        object.__setattr__(self, "waypoints", points)
        object.__setattr__(self, "home", (float(home[0]), float(home[1])))
        if self.geographic:
            _check_degrees(np.vstack([home, points]))
        for name in ("robot", "sortie"):
            object.__setattr__(self, name, check_integer(getattr(self, name), what=f"mission: {name}", least=1))
        _check_vehicle(self.kind, self.vehicle)
        _check_motion(self.kind, self.altitude, self.speed)

    @property
    def name(self) -> str:
        """What its files are called, without their suffix: ``robot-01``; from the second sortie on ``robot-01-2``."""
        return f"robot-{self.robot:02d}" + (f"-{self.sortie}" if self.sortie > 1 else "")

    @property
    def n_items(self) -> int:
        """Mission items in an autopilot: home, take-off (if it flies), speed, waypoints, return."""
        return len(self.waypoints) + OVERHEAD[self.kind]

    @property
    def length(self) -> float:
        """Metres along the ground from home through all waypoints and home again; on the ellipsoid if geographic."""
        way = np.vstack([self.home, self.waypoints, self.home])
        if not self.geographic:
            return float(np.hypot(*np.diff(way, axis=0).T).sum())
        from pyproj import Geod

        return float(Geod(ellps="WGS84").line_length(way[:, 0], way[:, 1]))

    @property
    def seconds(self) -> float:
        """Its length at its speed; climb, descent and turns are not in it."""
        return self.length / self.speed


def missions_of(
    route: ArrayLike,
    frame: LocalFrame | None,
    *,
    robot: int = 1,
    home: ArrayLike | None = None,
    kind: Kind = "multirotor",
    vehicle: Vehicle = "px4",
    altitude: float | None = None,
    speed: float | None = None,
    cap: int | None = None,
    max_length: float | None = None,
    max_seconds: float | None = None,
    tolerance: float = 0.001,
    ways: Ways | None = None,
) -> tuple[Mission, ...]:
    """Return the missions that take a robot along a route, one a sortie.

    Each begins at home, goes on where the one before ended, and returns home.

    Parameters
    ----------
    route : array_like of float, shape (k, 2)
        Metres. A route of no points gives no missions.
    frame : LocalFrame or None
        Where on Earth the metres are; None leaves metres.
    robot : int
        Its number, from 1.
    home : array_like of float, shape (2,), optional
        Metres; the first point of the route if not given.
    kind, vehicle : str
        See `Mission`.
    altitude : float, optional
        Metres above home; 30 for a multirotor, 0 for a rover if not given.
    speed : float, optional
        Metres a second; 5 for a multirotor, 1 for a rover if not given.
    cap : int, optional
        Mission items that the vehicle stores, home, take-off, speed and return included; 2000 for PX4, 700 for ArduPilot if not
        given.
    max_length, max_seconds : float, optional
        What the battery allows for a sortie, the ways from home and back included, at its speed; climb, descent and turns are not
        counted. A leg may be cut anywhere.
    tolerance : float
        Metres: points no farther than this from a straight leg are left out of it. 0 leaves out only what lies exactly on it.
    ways : callable, optional
        ``ways(start, end)`` returns the way between home and a point of the route, shape (n, 2), both included, such as
        `shoal.search.RegionPaths.leg`; its bends become waypoints. Straight if not given.

    Raises
    ------
    InvalidInputError
        If an option is out of range, or a point of the route is too far from home for the battery.

    Examples
    --------
    >>> lanes = [(0, 0), (30, 0), (60, 0), (60, 10), (0, 10)]
    >>> [mission.waypoints.tolist() for mission in missions_of(lanes, None)]
    [[[0.0, 0.0], [60.0, 0.0], [60.0, 10.0], [0.0, 10.0]]]
    >>> [round(mission.length) for mission in missions_of(lanes, None, max_length=135)]
    [135, 30]
    """
    _check_vehicle(kind, vehicle)
    points = check_plane_points(route, what=f"route of robot {robot}")
    if len(points) == 0:
        return ()
    altitude = ALTITUDES[kind] if altitude is None else altitude
    speed = SPEEDS[kind] if speed is None else speed
    _check_motion(kind, altitude, speed)
    least = 2 + OVERHEAD[kind]  # of which two are waypoints
    room = check_integer(CAPS[vehicle] if cap is None else cap, what="cap", least=least) - OVERHEAD[kind]
    base = points[0] if home is None else check_plane_points([home], what="home")[0]
    limit = _limit(max_length, max_seconds, float(speed))
    way = merged(points, check_number(tolerance, what="tolerance", least=0))
    parts = sorties(way, base, room=room, limit=limit, ways=ways, robot=robot)
    placed = (lambda array: array) if frame is None else frame.to_degrees
    x, y = placed(base[None])[0].tolist()
    return tuple(
        Mission(placed(part), (x, y), robot, number, kind, vehicle, float(altitude), float(speed), geographic=frame is not None)
        for number, part in enumerate(parts, start=1)
    )


def _limit(max_length: float | None, max_seconds: float | None, speed: float) -> float:
    length = inf if max_length is None else check_number(max_length, what="max_length", above=0, finite=False)
    seconds = inf if max_seconds is None else check_number(max_seconds, what="max_seconds", above=0, finite=False)
    return min(length, seconds * speed)


def _check_vehicle(kind: str, vehicle: str) -> None:
    check_choice(kind, what="kind", choices=ALTITUDES)
    check_choice(vehicle, what="vehicle", choices=CAPS)


def _check_motion(kind: str, altitude: float, speed: float) -> None:
    check_number(speed, what="speed", above=0)
    if kind == "rover" and altitude != 0:
        raise InvalidInputError(f"altitude: expected 0 m for a rover, got {altitude!r}")
    if kind == "multirotor":
        check_number(altitude, what="altitude of a multirotor", above=0)


def _check_degrees(points: Points) -> None:
    wrong = (np.abs(points[:, 0]) > 180) | (np.abs(points[:, 1]) > 90)
    if wrong.any():
        raise InvalidInputError(
            "mission: expected a longitude within ±180 and then a latitude within ±90, "
            f"got {text_of(points[int(np.argmax(wrong))])}"
        )
