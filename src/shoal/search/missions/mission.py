"""Missions: the waypoints of one vehicle for one sortie, and their creation from a route."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_choice, check_integer, check_number, check_points
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.flight.flight import FRAMES, TERRAIN_ERROR, Flight, whole_way
from shoal.search.flight.terrain import Terrain
from shoal.search.flight.vehicle import Vehicle, vehicle_of
from shoal.search.missions.fence import Fence
from shoal.search.missions.merging import merged
from shoal.search.missions.splitting import Ways, sorties
from shoal.search.problem.mission_options import CAPS
from shoal.search.regions.outline_checks import Points, check_plane_points, text_of
from shoal.search.regions.projection import LocalFrame

Kind = Literal["multirotor", "fixed-wing", "rover"]
Autopilot = Literal["px4", "ardupilot"]

SAME_LEVEL = 1e-3  # metres: altitudes with a smaller difference are equal
KINDS = ("multirotor", "fixed-wing", "rover")
OVERHEAD: dict[str, int] = {"multirotor": 4, "fixed-wing": 4, "rover": 3}  # items besides waypoints: home, take-off, speed, return
_EXTRA = {"gimbal_pitch": 1, "trigger_distance": 2}  # additional items for a camera


@dataclass(frozen=True, eq=False)
class Mission:
    """One sortie of one robot: from home along the waypoints and home again.

    Parameters
    ----------
    waypoints : ndarray of float64, shape (k, 2), k >= 1
        (longitude, latitude) in degrees, WGS84; (x, y) in metres if not ``geographic``.
    home : tuple of float
        Start and landing point of the vehicle in the same units.
    robot : int
        Number of the robot, from 1.
    sortie : int
        Number of the sortie of this robot, from 1.
    kind : "multirotor", "fixed-wing" or "rover"
    autopilot : "px4" or "ardupilot"
    altitude : float
        Altitude in metres above the reference ``altitude_frame``; 0 for a rover.
    speed : float
        Speed in m/s: airspeed for a fixed wing, otherwise ground speed.
    geographic : bool
        Whether coordinates are in degrees.
    altitude_frame : "home", "sea" or "ground"
        Reference of the altitude.
    heights : ndarray of float64, shape (k,), optional
        Heights of the waypoints above home in metres. The default is the altitude. Required for altitudes above ground.
    altitudes : ndarray of float64, shape (k,), optional
        Altitudes of the waypoints in metres above ground, if they differ.
    elevation : float, optional
        Height of home above sea level in metres, if known.
    trigger_distance : float, optional
        Distance between images in metres.
    gimbal_pitch : float, optional
        Pitch of the gimbal in degrees; -90 points down.
    yaw : float, optional
        Heading in degrees clockwise from north. By default the vehicle faces its direction of motion.
    acceptance_radius : float, optional
        Acceptance radius in metres. The default is the autopilot's setting.
    landing : tuple of float, optional
        Landing point in the same units. By default the autopilot's own return procedure is used.
    delay : float
        Waiting time before the start in seconds.
    fence : Fence, optional
    rally : tuple of tuple of float
        Rally points for emergency landings in the same units.

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
    autopilot: Autopilot = "px4"
    altitude: float = 30.0
    speed: float = 5.0
    geographic: bool = True
    altitude_frame: str = "home"
    heights: NDArray[np.float64] | None = None
    elevation: float | None = None
    trigger_distance: float | None = None
    gimbal_pitch: float | None = None
    yaw: float | None = None
    acceptance_radius: float | None = None
    landing: tuple[float, float] | None = None
    delay: float = 0.0
    fence: Fence | None = None
    rally: tuple[tuple[float, float], ...] = ()
    altitudes: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        points = check_plane_points(self.waypoints, what="mission waypoints").copy()
        if len(points) == 0:
            raise InvalidInputError("mission: expected waypoints, got none")
        points.flags.writeable = False
        home = check_plane_points([self.home], what="mission home")[0]
        object.__setattr__(self, "waypoints", points)
        object.__setattr__(self, "home", (float(home[0]), float(home[1])))
        if self.landing is not None:
            landing = check_plane_points([self.landing], what="mission landing")[0]
            object.__setattr__(self, "landing", (float(landing[0]), float(landing[1])))
        check_number(self.delay, what="mission: delay", least=0)
        if self.geographic:
            _check_degrees(np.vstack([home, self.end, points]))
        for name in ("robot", "sortie"):
            object.__setattr__(self, name, check_integer(getattr(self, name), what=f"mission: {name}", least=1))
        check_choice(self.kind, what="kind", choices=KINDS)
        check_choice(self.autopilot, what="autopilot", choices=CAPS)
        check_choice(self.altitude_frame, what="altitude_frame", choices=FRAMES)
        _check_motion(self.kind, self.altitude, self.speed)
        for name in ("heights", "altitudes"):
            if getattr(self, name) is not None:
                values = np.array(getattr(self, name), dtype=np.float64)
                if values.shape != (len(points),) or not np.isfinite(values).all():
                    raise InvalidInputError(f"mission: {name}: expected {len(points)} finite numbers, got shape {values.shape}")
                values.flags.writeable = False
                object.__setattr__(self, name, values)

    @property
    def name(self) -> str:
        """File name without suffix: ``robot-01``, or ``robot-01-2`` for the second sortie and so on."""
        return f"robot-{self.robot:02d}" + (f"-{self.sortie}" if self.sortie > 1 else "")

    @property
    def n_items(self) -> int:
        """Number of mission items in an autopilot: home, take-off (if it flies), speed, camera items, waypoints, return."""
        extra = sum(n for name, n in _EXTRA.items() if getattr(self, name) is not None)
        return len(self.waypoints) + OVERHEAD[self.kind] + extra + (self.delay > 0)

    @property
    def end(self) -> tuple[float, float]:
        """End point of the mission in the units of its waypoints."""
        return self.home if self.landing is None else self.landing

    @property
    def length(self) -> float:
        """Length in metres along the ground from home through all waypoints to the end, on the ellipsoid if geographic."""
        way = np.vstack([self.home, self.waypoints, self.end])
        if not self.geographic:
            return float(np.hypot(*np.diff(way, axis=0).T).sum())
        from pyproj import Geod

        return float(Geod(ellps="WGS84").line_length(way[:, 0], way[:, 1]))

    @property
    def heights_above_home(self) -> NDArray[np.float64]:
        """Heights of the waypoints above home in metres; float64, shape (k,).

        Raises
        ------
        InvalidInputError
            If the heights are unknown: the mission came from a file with altitudes above ground only.
        """
        if self.heights is not None:
            return self.heights
        if self.altitude_frame == "ground":
            raise InvalidInputError(
                f"{self.name}: expected heights above home or sea level, got none but {self.altitude:g} m above ground"
            )
        base = self.elevation or 0.0 if self.altitude_frame == "sea" else 0.0
        return np.full(len(self.waypoints), self.altitude - base)

    @property
    def levels(self) -> NDArray[np.float64]:
        """Altitudes of the waypoints in metres above the reference ``altitude_frame``; float64, shape (k,)."""
        if self.altitudes is not None:
            return self.altitudes
        if self.heights is None or self.altitude_frame == "ground":
            return np.full(len(self.waypoints), self.altitude)
        return self.heights + (self.elevation or 0.0 if self.altitude_frame == "sea" else 0.0)

    @property
    def way(self) -> NDArray[np.float64]:
        """Path in metres east, north and up from home: from the ground along all waypoints to the ground; float64, shape (n, 3)."""
        way = self.way_in(LocalFrame(*self.home) if self.geographic else None)
        return np.asarray(way - [*way[0, :2], 0.0])

    def way_in(self, frame: LocalFrame | None) -> NDArray[np.float64]:
        """Return `way` in the metres of a frame, or in its own metres. Heights are above home."""
        points = np.vstack([self.home, self.end, self.waypoints])
        points = points if frame is None else frame.to_metres(points)
        return whole_way(points[0], np.column_stack([points[2:], self.heights_above_home]), points[1])


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
    ways: Ways | None = None,
    landing: ArrayLike | None = None,
) -> tuple[Mission, ...]:
    """Return the missions of a robot's route, one for each sortie.

    Each sortie begins at home and continues where the previous one ended. It returns home before the battery falls below the
    reserve. The estimate includes climb, paths from and to home, turns, wind and descent. A leg may be cut anywhere.

    Parameters
    ----------
    route : array_like of float, shape (k, 2) or (k, 3)
        Route in metres. The third column holds altitudes; the default is the vehicle's altitude. An empty route gives no missions.
    frame : LocalFrame or None
        Local frame of the metres. With None, missions are in metres.
    robot : int
        Number of the robot, from 1.
    home : array_like of float, shape (2,), optional
        Home in metres. The default is the first point of the route.
    vehicle : Vehicle or str
        A vehicle or its description for `vehicle_of`.
    autopilot : "px4" or "ardupilot"
    rate : float
        Speed of the robot relative to the vehicle's speed.
    altitude_frame, terrain, terrain_error, link, blocked
        Options of `Flight`. Over terrain, waypoints are added to keep the height above ground within the error.
    cap : int, optional
        Maximum number of mission items that the autopilot stores, including home, take-off, speed and return. The default is 2000
        for PX4 and 700 for ArduPilot.
    tolerance : float
        Distance in metres from a straight leg up to which points are omitted. 0 omits only points exactly on the leg.
    ways : callable, optional
        Function ``ways(start, end)`` for the path between home and a point of the route, such as `shoal.search.RegionPaths.leg`. It
        returns shape (n, 2) with both ends, and its bends become waypoints. The default is a straight path.
    landing : array_like of float, shape (2,), optional
        Landing point of the last sortie in metres. By default the autopilot's own return procedure is used.

    Raises
    ------
    InvalidInputError
        If an option is out of range, or the battery does not suffice for a point of the route.

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
    flight = Flight(kept, base, frame, altitude_frame, terrain, terrain_error, rate, link, blocked, end)
    told = _told(kept)
    beside = OVERHEAD[kept.kind] + sum(count for name, count in _EXTRA.items() if told[name] is not None)
    most = CAPS[autopilot] if cap is None else cap
    room = check_integer(most, what="cap", least=2 + beside) - beside  # at least two waypoints
    way = merged(points, check_number(tolerance, what="tolerance", least=0))
    parts = sorties(way, flight, room=room, ways=ways, robot=robot)
    placed = (lambda array: array) if frame is None else frame.to_degrees
    x, y = placed(base[None])[0].tolist()
    ends = [None if end is None else (x, y)] * (len(parts) - 1) + [None if end is None else tuple(placed(end[None])[0].tolist())]
    speed = kept.cruise * flight.rate
    return tuple(
        Mission(
            placed(part[:, :2]), (x, y), robot, number, kept.kind, autopilot,  # type: ignore[arg-type]  # both were checked
            speed=speed, geographic=frame is not None, altitude_frame=altitude_frame,
            heights=part[:, 2] if np.ptp(part[:, 2]) else None, elevation=flight.elevation, landing=ends[number - 1],
            **told | {"altitude": kept.height} | (_levels(part, flight) if levels else {}),
        )
        for number, part in enumerate(parts, start=1)
    )  # fmt: skip


def _levels(waypoints: NDArray[np.float64], flight: Flight) -> dict[str, Any]:
    """Return the altitude of a sortie's first waypoint and, if altitudes above ground differ, the altitudes of all waypoints."""
    ups = waypoints[:, 2] + (float(flight.elevation or 0.0) if flight.altitude_frame != "home" else 0.0)
    if flight.altitude_frame == "ground" and flight.terrain is not None:
        ups = np.round(ups - flight.terrain.at(waypoints[:, :2], flight.frame), 6)
    varied = flight.altitude_frame == "ground" and float(np.ptp(ups)) > SAME_LEVEL
    return {"altitude": float(ups[0])} | ({"altitudes": ups} if varied else {})


def _told(vehicle: Vehicle) -> dict[str, Any]:
    """Return the vehicle's settings that a mission stores besides its speed."""
    flies = vehicle.kind != "rover"
    pitch = vehicle.gimbal_pitch if vehicle.image_size is None or vehicle.gimbal_pitch is not None else -90.0
    return {
        "trigger_distance": vehicle.trigger_distance,
        "gimbal_pitch": pitch if flies else None,
        "yaw": vehicle.yaw if vehicle.kind == "multirotor" else None,
        "acceptance_radius": vehicle.acceptance_radius,
    }


def _check_motion(kind: str, altitude: float, speed: float) -> None:
    check_number(speed, what="speed", above=0)
    if kind == "rover" and altitude != 0:
        raise InvalidInputError(f"altitude: expected 0 m for a rover, got {altitude!r}")
    if kind != "rover":
        check_number(altitude, what=f"altitude of a {kind}", above=0)


def _check_degrees(points: Points) -> None:
    wrong = (np.abs(points[:, 0]) > 180) | (np.abs(points[:, 1]) > 90)
    if wrong.any():
        raise InvalidInputError(
            "mission: expected a longitude within ±180 and then a latitude within ±90, "
            f"got {text_of(points[int(np.argmax(wrong))])}"
        )
