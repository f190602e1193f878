"""Deconfliction: missions of all robots of a plan, separated by altitude layers and staggered starts; fence and rally points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.allocation.plan import SearchPlan
from shoal.search.flight.separation import nearest_approach
from shoal.search.flight.staggering import Separation, staggered
from shoal.search.flight.timing import Floats, Trajectory, trajectory
from shoal.search.flight.turning import LINK
from shoal.search.flight.vehicle import Vehicle
from shoal.search.missions.fence import CORNERS, fence_of
from shoal.search.missions.mission import Mission, missions_of
from shoal.search.regions.outline_checks import Points, text_of
from shoal.search.regions.projection import LocalFrame

Sorties = tuple[Mission, ...]


def plan_missions(
    plan: SearchPlan, *, separation: Separation | None = None, rally: Points | None = None, **options: Any
) -> tuple[Mission, ...]:
    """Return the missions of all robots of a plan, assuming that no fault occurs.

    The first sorties of all robots begin at the same time, apart from their delays. The delays are at least those of the plan. The
    second sorties begin when all robots have landed, and so on.

    Parameters
    ----------
    plan : SearchPlan
    separation : Separation, optional
        Separation that vehicles in flight keep, even if each is late. The default is no separation. Rovers have no layers, only
        delays.
    rally : ndarray of float64, shape (k, 2), optional
        Rally points in metres.
    options
        Options of `missions_of` that the plan does not determine.

    Raises
    ------
    InvalidInputError
    """

    def sorties(robot: int, layer: int) -> Sorties:
        vehicle = plan.vehicle
        if layer and separation is not None:
            vehicle = vehicle.replaced(altitude=vehicle.height + layer * separation.vertical)
        return _sorties(plan, robot, vehicle, explicit=separation is not None, options=options)

    robots = range(len(plan.places))
    made = [sorties(robot, 0) for robot in robots]
    made = [(replace(one[0], delay=float(delay)), *one[1:]) if one else () for one, delay in zip(made, plan.delays, strict=True)]
    if separation is not None:
        made = _separated(made, sorties, plan, separation)
    return _fenced([mission for one in made for mission in one], plan, np.zeros((0, 2)) if rally is None else rally)


def _sorties(plan: SearchPlan, robot: int, vehicle: Vehicle, *, explicit: bool, options: dict[str, Any]) -> Sorties:
    """Return the missions of one robot; empty for a robot in reserve.

    With ``explicit``, the missions of a multirotor end with a landing command, because an autopilot chooses its own altitude for a
    return command.
    """
    stops = plan.stops(robot)
    if not len(stops):
        return ()
    landing = plan.places[robot] if explicit and vehicle.kind == "multirotor" else None
    way = plan.route(robot, stops).points
    if way.shape[1] == 3:
        way = way[int(len(way) > 1 and np.array_equal(way[0, :2], way[1, :2])) :]  # above home it climbs to its first cell anyway
        way = way + np.array([0.0, 0.0, vehicle.height - plan.vehicle.height])
    return missions_of(
        way,
        plan.grid.region.frame,
        robot=robot + 1,
        home=plan.places[robot],
        vehicle=vehicle,
        rate=float(plan.rates[robot]),
        link=float(plan.footprints[robot]) * LINK,
        blocked=plan.grid.region.no_go,
        ways=plan.leg,
        landing=landing if plan.landing is None else plan.landing[robot],
        **options,
    )


def _separated(
    made: list[Sorties], sorties: Callable[[int, int], Sorties], plan: SearchPlan, separation: Separation
) -> list[Sorties]:
    """Return the missions of all robots with layers and delays."""
    frame, robots = plan.grid.region.frame, range(len(made))

    def flights(robot: int, sortie: int, found: Sequence[Sorties], raised: bool) -> Callable[[int], Sequence[Trajectory]]:
        def flown(layer: int) -> Sequence[Trajectory]:
            if sortie >= len(found[robot]):
                return ()
            up = layer * separation.vertical if raised else 0.0
            return _reckoned(found[robot][sortie], frame, plan.vehicle, float(plan.rates[robot]), up)

        return flown

    layers: Sequence[int] = [0] * len(made)
    if plan.vehicle.kind != "rover" and not plan.grid.region.height:  # from between the layers of a volume, no part of it is seen
        first = [flights(robot, 0, made, True) for robot in robots]
        layers = staggered(first, separation, earliest=plan.delays)[0].tolist()
    made = [sorties(robot, layer) if layer else made[robot] for robot, layer in zip(robots, layers, strict=True)]
    delays = [
        staggered([flights(robot, sortie, made, False) for robot in robots], separation, layers, None if sortie else plan.delays)[
            1
        ].tolist()
        for sortie in range(max(map(len, made), default=0))
    ]
    return [tuple(replace(mission, delay=delays[number][robot]) for number, mission in enumerate(made[robot])) for robot in robots]


def _reckoned(mission: Mission, frame: LocalFrame | None, vehicle: Vehicle, rate: float, up: float) -> Sequence[Trajectory]:
    """Return two trajectories of a mission: with the vehicle's own dynamics, and at the constant speed in its file."""
    way = _common_way(mission, frame)
    way[1:-1, 2] += up
    return trajectory(way, vehicle, rate=rate), trajectory(way, constant_speed(mission))


def _common_way(mission: Mission, frame: LocalFrame | None) -> Floats:
    """Return the path of a mission with heights above a common reference, as far as the heights of the homes are known."""
    way = mission.way_in(frame)
    way[:, 2] += mission.elevation or 0.0
    return way


def constant_speed(mission: Mission) -> Vehicle:
    """Return the vehicle that moves at the mission's speed everywhere, including climbs, and turns in no time."""
    return Vehicle(
        preset="ideal", cruise_speed=mission.speed, climb_speed=min(mission.speed, 50), sink_speed=min(mission.speed, 50)
    )


def _fenced(missions: Sequence[Mission], plan: SearchPlan, rally: Points) -> tuple[Mission, ...]:
    """Return missions with their fence and rally points."""
    region = plan.grid.region
    if not missions:
        return ()
    ways = [mission.way_in(region.frame)[:, :2] for mission in missions]
    fence = fence_of(region, [*ways, *(point[None] for point in rally)], most=CORNERS[missions[0].autopilot])
    area = fence.area(region.frame)
    import shapely

    for point in rally[~shapely.intersects_xy(area, *rally.T)]:
        raise InvalidInputError(f"rally: expected points outside of no-go zones, got {text_of(point)} m")
    placed = rally if region.frame is None else region.frame.to_degrees(rally)
    points = tuple((x, y) for x, y in placed.tolist())
    return tuple(replace(mission, fence=fence, rally=points) for mission in missions)


@dataclass(frozen=True, eq=False)
class MissionApproach:
    """The nearest approach of any two vehicles.

    Parameters
    ----------
    robots : tuple of int
        Their numbers.
    sortie : int
    horizontal, vertical : float
        Horizontal and vertical distance of the vehicles in metres.
    time : float
        Time in seconds after the start of these sorties, if the first vehicle has no delay.
    place : ndarray of float64, shape (3,)
        Position of the first vehicle at that time: metres east, north and up.
    """

    robots: tuple[int, int]
    sortie: int
    horizontal: float
    vertical: float
    time: float
    place: Floats

    def report(self, frame: LocalFrame | None = None) -> dict[str, Any]:
        """Return the approach for JSON. With a frame, the position is also given in degrees."""
        told = {
            "robots": list(self.robots), "sortie": self.sortie, "horizontal_m": self.horizontal, "vertical_m": self.vertical,
            "time_s": self.time, "x": float(self.place[0]), "y": float(self.place[1]), "up_m": float(self.place[2]),
        }  # fmt: skip
        if frame is None:
            return told
        return told | dict(zip(("longitude", "latitude"), frame.to_degrees(self.place[None, :2])[0].tolist(), strict=True))


def missions_approach(
    missions: Sequence[Mission], separation: Separation, frame: LocalFrame | None, *, vehicle: Vehicle | None = None
) -> MissionApproach | None:
    """Return the nearest approach of two vehicles that follow missions, each late by up to the separation's delay.

    Parameters
    ----------
    missions : sequence of Mission
        The missions. Missions of the same sortie begin at the same time, apart from their delays.
    separation : Separation
        The separation. Moments with a larger difference in height than its vertical part do not count.
    frame : LocalFrame or None
        Local frame in whose metres distances are measured.
    vehicle : Vehicle, optional
        Vehicle whose climbing and turning times are used. By default all motion has the speed in the file.

    Returns
    -------
    MissionApproach or None
        None if all vehicles always keep the vertical separation.
    """
    flown: dict[tuple[int, int], tuple[Mission, Trajectory]] = {}
    for mission in missions:
        kept = constant_speed(mission) if vehicle is None else vehicle
        rate = 1.0 if vehicle is None else mission.speed / vehicle.cruise
        flown[mission.sortie, mission.robot] = mission, trajectory(_common_way(mission, frame), kept, rate=rate)
    best: MissionApproach | None = None
    for (sortie, one), (other_sortie, other) in combinations(sorted(flown), 2):
        if sortie != other_sortie:
            continue
        (mine, there), (theirs, here) = flown[sortie, one], flown[sortie, other]
        later = theirs.delay - mine.delay
        found = nearest_approach(there, here, vertical=separation.vertical, later=later, tolerance=separation.delay)
        if found is not None and (best is None or found.horizontal < best.horizontal):
            time = mine.delay + found.times[0]
            best = MissionApproach((one, other), sortie, found.horizontal, found.vertical, time, found.places[0])
    return best
