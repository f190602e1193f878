"""The division of a route into missions that fit the memory of the autopilot and the battery of the vehicle.

The division removes unnecessary waypoints.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_choice, check_integer, check_number, check_points
from shoal.core.errors import InvalidInputError
from shoal.search.flight.flight import ENDINGS, TERRAIN_ERROR, Flight
from shoal.search.flight.merging import merged
from shoal.search.flight.sorties import Sorties, Ways
from shoal.search.flight.terrain import Terrain
from shoal.search.flight.vehicle import Vehicle, vehicle_of
from shoal.search.missions.mission import EXTRA, OVERHEAD, SAME_LEVEL, Autopilot, Mission
from shoal.search.problem.mission_options import CAPS
from shoal.search.regions.outline_checks import check_plane_points
from shoal.search.regions.projection import LocalFrame


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
    free: Any = None,
    ways: Ways | None = None,
    landing: ArrayLike | None = None,
    ending: str | None = None,
    out: int = 0,
    curves: dict[Any, Any] | None = None,
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
    altitude_frame, terrain, terrain_error, link, blocked, area, free, curves
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
    flight = Flight(kept, base, frame, altitude_frame, terrain, terrain_error, rate, link, blocked, end, area, how, free, curves)
    told = _told(kept)
    beside = OVERHEAD[kept.kind] + sum(count for name, count in EXTRA.items() if told[name] is not None)
    most = CAPS[autopilot] if cap is None else cap
    room = check_integer(most, what="cap", least=2 + beside) - beside  # at least two waypoints
    check_number(tolerance, what="tolerance", least=0)
    check_integer(out, what="out", least=0, most=len(points) - 1)
    led, way = merged(points[: out + 1], tolerance)[:-1], merged(points[out:], tolerance)
    sorties = Sorties(np.vstack([led, way]), flight, room, ways, robot, len(led))
    parts = sorties.parts()
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
