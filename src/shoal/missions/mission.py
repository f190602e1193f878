"""A mission: the waypoints of one vehicle, made from its route and split at its battery's limit."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import (
    check_array,
    check_choice,
    check_integer,
    check_kind,
    check_number,
    check_points,
)
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.geometry import step_lengths, unit_vectors
from shoal.missions.fence import Fence
from shoal.search.flight.dubins import Airspace
from shoal.search.flight.flight import FRAMES, Altitudes, Flight
from shoal.search.flight.imaging import CameraItem, planned_items
from shoal.search.flight.legs import complete_path, merge_straight_legs
from shoal.search.flight.sorties import PathFinder, Sorties
from shoal.search.flight.timing import return_seconds, trajectory
from shoal.search.flight.vehicle import Vehicle
from shoal.search.regions.outline import Points, check_plane_points, text_of
from shoal.search.regions.projection import LocalFrame

__all__ = ["CAPS", "Airspace", "Altitudes", "Flight", "Mission", "split_missions"]

Kind = Literal["multirotor", "fixed-wing", "rover"]
Autopilot = Literal["px4", "ardupilot"]

CAPS: dict[str, int] = {"px4": 2000, "ardupilot": 700}
"""Maximum number of mission items that each autopilot stores, including home."""

FASTEST = 100.0  # m/s: a mission's speed
SAME_LEVEL = 1e-3  # metres: altitudes with a smaller difference are equal
_RING = 37  # points of a circle
_DEGREE = 111_195.0  # of a degree of latitude, about
KINDS = ("multirotor", "fixed-wing", "rover")
# items besides waypoints: home, take-off, speed, return
OVERHEAD: dict[str, int] = {"multirotor": 4, "fixed-wing": 4, "rover": 3}
EXTRA = {"gimbal_pitch": 1}  # items of a camera besides those for its images


@dataclass(frozen=True, eq=False)
class Mission:
    """One sortie of one robot: from home along the waypoints and back home.

    Parameters
    ----------
    waypoints : ndarray of float64, shape (k, 2), k >= 1
        Waypoints as (longitude, latitude) in degrees (WGS84), or as (x, y) in metres if
        ``geographic`` is false.
    home : tuple of float
        Start point of the vehicle, in the unit of the waypoints. Without a ``landing`` point, the
        vehicle also lands there.
    robot : int
        Number of the robot. The first robot has the number 1.
    sortie : int
        Number of the robot's sortie. The first sortie of each robot has the number 1.
    kind : "multirotor", "fixed-wing" or "rover"
    autopilot : "px4" or "ardupilot"
    altitude : float
        Altitude in metres above the surface that ``altitude_frame`` names, or 0 for a rover.
    speed : float
        Speed of the vehicle in m/s: airspeed for a fixed wing, ground speed for a multirotor or a
        rover.
    geographic : bool
        Whether coordinates are in degrees. If false, coordinates are in metres.
    altitude_frame : "home", "sea" or "ground"
        Reference surface of altitudes.
    heights : ndarray of float64, shape (k,), optional
        Heights of the waypoints above home in metres. By default, all waypoints have the altitude
        of the mission. A mission with altitudes above ground needs heights above home for its path.
    altitudes : ndarray of float64, shape (k,), optional
        Altitudes of the waypoints in metres above ground, if these altitudes differ.
    elevation : float, optional
        Height of home above sea level in metres, if known.
    trigger_distance : float, optional
        Distance between two images in metres. The camera also takes images where the search begins
        and ends, and at its bends.
    gimbal_pitch : float, optional
        Pitch of the gimbal in degrees. At -90 degrees, the camera points down.
    yaw : float, optional
        Heading of the vehicle in degrees clockwise from north. By default, the vehicle faces its
        direction of motion.
    acceptance_radius : float, optional
        Acceptance radius of waypoints in metres. By default, the setting of the autopilot applies.
    landing : tuple of float, optional
        Position at which the mission ends, in the unit of the waypoints. A fixed wing glides to its
        landing position. By default, the autopilot returns the vehicle to its home.
    loiter : float, optional
        Radius in metres of the circles that the vehicle flies at the end of the mission, instead of
        landing. With the radius 0, the vehicle hovers.
    start : float, optional
        Time in seconds from the start of the search to the start of the sortie. The vehicle waits
        for its start on the ground and disarmed, because an autopilot disarms a vehicle that is
        armed and does not take off. By default, a first sortie has the start 0, and any other
        sortie begins when all earlier sorties have ended.
    take_off : float, optional
        Altitude in metres above the surface that ``altitude_frame`` names, to which a multirotor
        climbs vertically after take-off. By default, a multirotor climbs to the altitude of the
        first waypoint. A fixed wing climbs on its way to the first waypoint.
    takeover : float, optional
        Altitude in metres above the surface that ``altitude_frame`` names, at which the vehicle
        searches cells of a failed robot.
    fence : Fence, optional
    rally : tuple of tuple of float
        Rally points for emergency landings: two coordinates in the unit of the waypoints, and the
        height above home in metres. By default, the height is that of the highest waypoint, because
        a vehicle comes from anywhere on its path.
    speeds : ndarray of float64, shape (k + 1,), optional
        Speed in m/s on the leg to each waypoint and on the leg to the end, if these speeds differ.
    waypoints_out, waypoints_home : int, optional
        Number of waypoints on the way out, before the first waypoint of the search, and number of
        waypoints on the way home, after the last waypoint of the search. On both ways, the camera
        takes no images. By default, both numbers are unknown.

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
    fence: Fence | None = None
    rally: tuple[tuple[float, ...], ...] = ()
    altitudes: NDArray[np.float64] | None = None
    loiter: float | None = None
    start: float | None = None
    takeover: float | None = None
    take_off: float | None = None
    speeds: NDArray[np.float64] | None = None
    waypoints_out: int | None = None
    waypoints_home: int | None = None

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
        if self.loiter is not None:
            check_number(self.loiter, what="mission: loiter", least=0)
            object.__setattr__(self, "landing", self.end)
        if self.start is not None:
            check_number(self.start, what="mission: start", least=0)
        if self.geographic:
            _check_degrees(np.vstack([home, self.end, points]))
        for name, least in (
            ("robot", 1),
            ("sortie", 1),
            ("waypoints_out", 0),
            ("waypoints_home", 0),
        ):
            number = getattr(self, name)
            if number is not None or least == 1:  # the numbers of waypoints may be unknown
                number = check_integer(number, what=f"mission: {name}", least=least)
                object.__setattr__(self, name, number)
        if self.searched.start >= self.searched.stop:
            raise InvalidInputError(
                "mission: expected a waypoint between the way out and the way home, got"
                f" {self.waypoints_out} and {self.waypoints_home} of {len(points)} waypoints"
            )
        check_choice(self.kind, what="kind", choices=KINDS)
        check_choice(self.autopilot, what="autopilot", choices=CAPS)
        check_choice(self.altitude_frame, what="altitude_frame", choices=FRAMES)
        _check_motion(
            self.kind,
            self.altitude,
            self.speed,
            level=self.heights is None and self.altitude_frame != "sea",
        )
        for name, count, above in (
            ("heights", len(points), -inf),
            ("altitudes", len(points), -inf),
            ("speeds", len(points) + 1, 0.0),
        ):
            if getattr(self, name) is not None:
                values = check_array(
                    getattr(self, name), expected=f"mission: {name}: expected numbers"
                ).astype(np.float64)
                if values.shape != (count,) or not np.isfinite(values).all():
                    raise InvalidInputError(
                        f"mission: {name}: expected {count} finite numbers, got shape"
                        f" {values.shape}"
                    )
                if values.min() <= above:
                    raise InvalidInputError(
                        f"mission: {name}: expected numbers above {above:g}, got {values.min():g}"
                    )
                values.flags.writeable = False
                object.__setattr__(self, name, values)
        if any(len(point) < 3 for point in self.rally):
            up = float(self.heights_above_home.max())
            object.__setattr__(self, "rally", tuple((*point, up)[:3] for point in self.rally))
        if not np.isfinite(self.rally).all():
            raise InvalidInputError("mission: rally: expected finite numbers, got others")

    @property
    def name(self) -> str:
        """Name of the mission's file without suffix, such as ``robot-01``, or ``robot-01-2`` for a
        robot's second sortie.
        """
        return f"robot-{self.robot:02d}" + (f"-{self.sortie}" if self.sortie > 1 else "")

    @property
    def n_items(self) -> int:
        """Number of mission items that an autopilot stores: home, take-off, speed, camera items,
        waypoints and return.
        """
        extra = sum(n for name, n in EXTRA.items() if getattr(self, name) is not None)
        extra += 0 if self.speeds is None else int(np.count_nonzero(np.diff(self.speeds)))
        extra += len(self.camera_items)
        return len(self.waypoints) + OVERHEAD[self.kind] + extra

    @property
    def searched(self) -> slice:
        """Slice of all waypoints except the first ``waypoints_out`` and the last ``waypoints_home``
        waypoints (None means 0).
        """
        return slice(self.waypoints_out or 0, len(self.waypoints) - (self.waypoints_home or 0))

    @property
    def camera_items(self) -> list[CameraItem]:
        """The commands with which the camera takes images; none without a trigger distance."""
        if self.trigger_distance is None:
            return []
        points = self.waypoints[self.searched]
        if self.geographic:
            try:
                points = LocalFrame(*points[0].tolist()).to_metres(points)
            except InvalidInputError:  # on another continent, as diagnostics say
                points = points * _DEGREE
        return planned_items(points, self.searched.start, self.trigger_distance, self.kind)

    @property
    def end(self) -> tuple[float, float]:
        """End point of the mission, in the unit of its waypoints."""
        return self.home if self.landing is None else self.landing

    @property
    def glides(self) -> bool:
        """Whether the vehicle is a fixed wing that descends to its landing point along the last
        leg.
        """
        return self.kind == "fixed-wing" and self.landing is not None and self.loiter is None

    @property
    def vertical_climb(self) -> float | None:
        """Height in metres above home to which the vehicle climbs vertically, or None for the
        height of the first waypoint.
        """
        if self.kind == "fixed-wing":
            return 0.0
        return None if self.take_off is None else self.take_off - self._base

    @property
    def _base(self) -> float:
        """Altitude of home in metres above the surface that ``altitude_frame`` names."""
        return self.elevation or 0.0 if self.altitude_frame == "sea" else 0.0

    @property
    def length(self) -> float:
        """Horizontal length in metres of the path from home through all waypoints to the end.

        For coordinates in degrees, the length is measured on the WGS84 ellipsoid.
        """
        path = np.vstack([self.home, self.waypoints, self.end])
        if not self.geographic:
            return float(step_lengths(path).sum())
        from pyproj import Geod

        return float(Geod(ellps="WGS84").line_length(path[:, 0], path[:, 1]))

    @property
    def heights_above_home(self) -> NDArray[np.float64]:
        """Heights of the waypoints above home in metres; float64, shape (k,).

        Raises
        ------
        InvalidInputError
            If heights above home are unknown, because the mission comes from a file with altitudes
            above ground.
        """
        if self.heights is not None:
            return self.heights
        if self.altitude_frame == "ground":
            raise InvalidInputError(
                f"{self.name}: expected a height above home or sea level, got {self.altitude:g} m"
                " above ground"
            )
        return np.full(len(self.waypoints), self.altitude - self._base)

    @property
    def levels(self) -> NDArray[np.float64]:
        """Altitudes of the waypoints in metres above the surface that ``altitude_frame`` names;
        float64, shape (k,).
        """
        if self.altitudes is not None:
            return self.altitudes
        if self.heights is None or self.altitude_frame == "ground":
            return np.full(len(self.waypoints), self.altitude)
        return self.heights + self._base

    def duration(self, vehicle: Vehicle) -> float:
        """Return the time in seconds from take-off to landing, including turns, climbs, descents
        and the effect of the wind.

        Raises
        ------
        InvalidInputError
            If a waypoint is too far from home.
        """
        path = self.path_in(LocalFrame(*self.home) if self.geographic else None)
        return trajectory(path, vehicle, rate=self.rates(vehicle)).duration

    def battery_seconds(self, vehicle: Vehicle) -> float:
        """Return the time in seconds for which the battery must last: the duration and, if the
        mission ends with a return, its climb to the height at which the autopilot returns.

        Raises
        ------
        InvalidInputError
            If a waypoint is too far from home.
        """
        duration = self.duration(vehicle)
        if self.landing is not None or self.kind == "rover":
            return duration
        above_ground = self.altitude_frame == "ground" and self.heights is None
        ups = self.levels if above_ground else self.heights_above_home  # as in `path_in`
        return duration + return_seconds(vehicle, float(ups[-1]))

    def rates(self, vehicle: Vehicle) -> float | NDArray[np.float64]:
        """Return the speed of the mission divided by the vehicle's cruise speed: one number, or one
        for each leg of `path_in`.
        """
        if self.speeds is None:
            return self.speed / vehicle.cruise
        ends = self.speeds[-1:] if self.glides else self.speeds[[-1, -1]]
        return np.concatenate([self.speeds[:1], self.speeds[:-1], ends]) / vehicle.cruise

    def flight_report(self, vehicle: Vehicle) -> dict[str, Any]:
        """Return the duration and the usable fraction of the mission, for a given vehicle, as a
        mapping for JSON.
        """
        usable = vehicle.usable_seconds
        return {
            "mission": self.name,
            "duration_s": self.duration(vehicle),
            "usable_fraction": None if usable == inf else self.battery_seconds(vehicle) / usable,
        }

    def circle_in(self, frame: LocalFrame | None) -> Points:
        """Return the circle in which the vehicle loiters at the end, in metres of a local frame;
        float64, shape (k, 2).

        For a mission without loitering, the result has no points.
        """
        return circle_around(self.end, self.loiter, frame)

    def path_in(self, frame: LocalFrame | None) -> NDArray[np.float64]:
        """Return the vehicle's path from take-off to landing, in metres of a local frame; float64,
        shape (n, 3).

        The third column holds heights above home. If they are unknown, because a file has only
        altitudes above ground, it holds these. For a mission in metres, ``frame`` is None.
        """
        points = np.vstack([self.home, self.end, self.waypoints])
        points = points if frame is None else frame.to_metres(points)
        above_ground = self.altitude_frame == "ground" and self.heights is None
        ups = self.levels if above_ground else self.heights_above_home
        over = np.column_stack([points[2:], ups])
        return complete_path(
            points[0], over, points[1], climb=self.vertical_climb, glides=self.glides
        )


def circle_around(
    place: tuple[float, float], radius: float | None, frame: LocalFrame | None
) -> Points:
    """Return a circle around a position as a closed ring in metres; float64, shape (k, 2).

    Without a radius, the ring has no points.
    """
    angles = np.linspace(0.0, 2 * np.pi, _RING if radius else 0)
    middle = np.array([place]) if frame is None else frame.to_metres(np.array([place]))
    return np.asarray(middle + (radius or 0.0) * unit_vectors(angles))


def _check_motion(kind: str, altitude: float, speed: float, *, level: bool) -> None:
    """Check an altitude and a speed. Only a flight at one height above home or above ground must be
    above 0 there.
    """
    check_number(speed, what="speed", above=0)
    if kind == "rover" and altitude != 0:
        raise InvalidInputError(f"altitude: expected 0 m for a rover, got {altitude!r}")
    if kind != "rover":
        check_number(altitude, what=f"altitude of a {kind}", above=0 if level else -inf)


def _check_degrees(points: Points) -> None:
    wrong = (np.abs(points[:, 0]) > 180) | (np.abs(points[:, 1]) > 90)
    if wrong.any():
        raise InvalidInputError(
            "mission: expected a longitude within ±180 and then a latitude within ±90, "
            f"got {text_of(points[int(np.argmax(wrong))])}"
        )


def split_missions(
    route: ArrayLike,
    flight: Flight,
    *,
    robot: int = 1,
    autopilot: Autopilot = "px4",
    cap: int | None = None,
    tolerance: float = 0.001,
    find_path: PathFinder | None = None,
    out: int = 0,
) -> tuple[Mission, ...]:
    """Divide a robot's route into missions, one for each sortie.

    Each sortie begins at home, and continues the route at the point at which the previous sortie
    left the route. Each sortie ends before the battery falls below the reserve. The duration of a
    sortie includes climb, turns and descent, and depends on the wind. A sortie may leave the route
    at any point of a leg.

    Parameters
    ----------
    route : array_like of float, shape (k, 2) or (k, 3)
        Route in metres, with altitudes in the third column. A route without a third column has the
        vehicle's altitude. An empty route gives no missions.
    flight : Flight
        The vehicle and how it flies. The last sortie ends at the landing point, the others at home.
        Without a frame, missions are in metres.
    robot : int
        Number of the robot. The first robot has the number 1.
    autopilot : "px4" or "ardupilot"
    cap : int, optional
        Maximum number of mission items that the autopilot stores, including home, take-off, speed
        and return. The default is 2000 items for PX4 and 700 items for ArduPilot.
    tolerance : float
        Maximum distance in metres between an omitted point of the route and the straight leg that
        replaces it. With the tolerance 0, the function omits a point only if it lies exactly on a
        leg.
    find_path : callable, optional
        Function ``find_path(start, end)`` that computes the path between home and a point of the
        route, such as `shoal.search.RegionPaths.leg`. A path is an array of points, shape (n, 2),
        including both ends. The bends of the path become waypoints. By default, the path between
        home and the route is straight.
    out : int
        Number of points at the beginning of the route that belong to the way out from home. The
        search begins at the next point.

    Raises
    ------
    InvalidInputError
        If an argument is out of range, or if the battery is too small for a point of the route.

    Examples
    --------
    >>> lanes = [(0, 0), (30, 0), (60, 0), (60, 10), (0, 10)]
    >>> [mission.waypoints.tolist() for mission in split_missions(lanes, Flight())]
    [[[0.0, 0.0], [60.0, 0.0], [60.0, 10.0], [0.0, 10.0]]]
    >>> two = split_missions(lanes, Flight("ideal,endurance=2.25,reserve=0"))  # 135 s at 1 m/s
    >>> [round(mission.length) for mission in two]
    [135, 31]
    """
    check_choice(autopilot, what="autopilot", choices=CAPS)
    shape = check_array(route, expected=f"route of robot {robot}: expected points").shape
    with_altitudes = len(shape) == 2 and shape[1] == 3
    points = check_points(
        route, what=f"route of robot {robot}", dimensions=3 if with_altitudes else 2
    )
    if len(points) == 0:
        return ()
    if check_kind(flight, Flight, what="flight").home is None:
        flight = replace(flight, home=points[0, :2])
    vehicle, frame = flight.vehicle, flight.frame
    settings = _mission_settings(vehicle)
    beside = OVERHEAD[vehicle.kind] + sum(
        count for name, count in EXTRA.items() if settings[name] is not None
    )
    most = CAPS[autopilot] if cap is None else cap
    # at least two waypoints
    most_waypoints = check_integer(most, what="cap", least=2 + beside) - beside
    check_number(tolerance, what="tolerance", least=0)
    check_integer(out, what="out", least=0, most=len(points) - 1)
    path_out, path = (
        merge_straight_legs(points[: out + 1], tolerance)[:-1],
        merge_straight_legs(points[out:], tolerance),
    )
    parts = Sorties(
        np.vstack([path_out, path]), flight, most_waypoints, find_path, robot, len(path_out)
    ).parts()

    def to_frame(array: Points) -> Points:
        return array if frame is None else frame.to_degrees(array)

    home, last = (tuple(place) for place in to_frame(np.stack([flight.home, flight.end])).tolist())
    ends = [None] * len(parts) if flight.ending == "return" else [home] * (len(parts) - 1) + [last]
    return tuple(
        Mission(
            to_frame(part[:, :2]),
            home,
            robot,
            number,
            vehicle.kind,  # type: ignore[arg-type]  # checked, as is the autopilot
            autopilot,
            speed=vehicle.cruise * flight.rate,
            geographic=frame is not None,
            altitude_frame=flight.altitudes.frame,
            heights=part[:, 2] if np.ptp(part[:, 2]) else None,
            elevation=flight.elevation,
            landing=ends[number - 1],
            loiter=None if flight.ending != "loiter" else round(flight.radius, 3),
            waypoints_out=before,
            waypoints_home=after,
            **settings
            | {"altitude": vehicle.height}
            | _levels(part, flight, several=with_altitudes),
        )
        for number, (part, before, after) in enumerate(parts, start=1)
    )


def _levels(waypoints: NDArray[np.float64], flight: Flight, *, several: bool) -> dict[str, Any]:
    """Return the altitudes that a mission stores besides its heights above home.

    If the route has several altitudes, the result contains the first waypoint's altitude. If
    altitudes above ground differ, the result contains the altitude above ground of every waypoint.
    """
    frame, terrain = flight.altitudes.frame, flight.altitudes.terrain
    ups = waypoints[:, 2] + (0.0 if frame == "home" else float(flight.elevation or 0.0))
    levels: dict[str, Any] = {"altitude": float(ups[0])} if several else {}
    if frame == "ground" and terrain is not None:
        ups = np.round(ups - terrain.at(waypoints[:, :2], flight.frame), 6)
        # a camera needs each altitude exactly, to see what is planned
        exact = several or flight.vehicle.image_size is not None
        usual = ups[0] if several else flight.vehicle.height
        same = SAME_LEVEL if exact else flight.altitudes.error
        levels["altitude"] = float(usual)
        if np.abs(ups - usual).max() > same:
            levels["altitudes"] = ups
    return levels


def _mission_settings(vehicle: Vehicle) -> dict[str, Any]:
    """Return the settings of a vehicle that a mission stores, except for the speed."""
    flies = vehicle.kind != "rover"
    pitch = (
        vehicle.gimbal_pitch
        if vehicle.image_size is None or vehicle.gimbal_pitch is not None
        else -90.0
    )
    return {
        "trigger_distance": vehicle.trigger_distance,
        "gimbal_pitch": pitch if flies else None,
        "yaw": vehicle.yaw if vehicle.kind == "multirotor" else None,
        "acceptance_radius": vehicle.acceptance_radius,
    }
