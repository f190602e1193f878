"""Deconfliction: the missions of all robots of a plan, with altitude layers and staggered starts
that keep the vehicles apart.

The missions of a plan get a fence and rally points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from heapq import heappop, heappush
from typing import Any

import numpy as np

from shoal.core.errors import InvalidInputError
from shoal.missions.approach import common_path, constant_speed, mission_trajectory
from shoal.missions.fence import CORNERS, fence_of
from shoal.missions.mission import Autopilot, Mission, split_missions
from shoal.missions.rules import ELSEWHERE
from shoal.search.flight.dubins import LINK, Airspace
from shoal.search.flight.flight import Altitudes, Flight
from shoal.search.flight.separation import Separation, stagger_starts
from shoal.search.flight.timing import Trajectory
from shoal.search.flight.vehicle import Vehicle
from shoal.search.planning.plan import SearchPlan
from shoal.search.regions.margin import grow
from shoal.search.regions.outline import Points, text_of
from shoal.search.regions.projection import ROUNDED

RobotMissions = tuple[Mission, ...]  # of one robot, sortie by sortie

_ROUNDS = 6  # number of times that the time of loitering is lengthened by half
_LONGEST_TURNS = 1.25  # relative to their stated time: turns with which separation holds, from none
_ENDINGS = {"multirotor": "land", "fixed-wing": "loiter", "rover": "return"}


def plan_missions(
    plan: SearchPlan,
    *,
    separation: Separation | None = None,
    rally: Points | None = None,
    airspace: float | None = None,
    ending: str | None = None,
    fenced: bool = True,
    autopilot: Autopilot = "px4",
    cap: int | None = None,
    altitudes: Altitudes | None = None,
) -> tuple[Mission, ...]:
    """Return the missions of all robots of a plan, for a search without faults.

    The first sortie of a robot has a start time, which is at least the robot's delay in the plan.
    Each later sortie begins as soon as its vehicle is back and recharged, and can keep the
    separation from all other vehicles.

    Parameters
    ----------
    plan : SearchPlan
    separation : Separation, optional
        Separation that vehicles in flight keep, even if each vehicle is late by up to
        ``separation.delay``. By default, vehicles keep no separation. Rovers keep their separation
        by delays alone, without altitude layers.
    rally : ndarray of float64, shape (k, 2), optional
        Rally points in metres. Missions with rally points end with a landing, a loiter or, for
        rovers, a hold, because a return may lead to the nearest rally point.
    airspace : float, optional
        Distance in metres by which turns of fixed wings may leave the allowed area, which is the
        region without its margin and its no-go zones. By default, turns may leave the allowed area
        by any distance.
    ending : "return", "land" or "loiter", optional
        Ending of missions. By default, if a separation is given, multirotors land, and fixed wings
        without a landing point loiter, or land at home if a robot flies several sorties, because a
        vehicle is recharged between them. If no separation is given, `Flight` chooses the
        default. On a return, vehicles might not keep the separation, because the autopilot chooses
        the altitude of the return.
    fenced : bool
        Whether the fence has at most as many corners as the autopilot stores. False for files
        without a fence.
    autopilot, cap
        As in `split_missions`.
    altitudes : Altitudes, optional
        What the altitudes of missions mean. By default, heights above home.
    """
    chosen = True
    if (
        ending is None
        and separation is not None
        and (plan.landing is None or plan.vehicle.kind == "multirotor")
    ):
        ending, chosen = _ENDINGS[plan.vehicle.kind], False
    if rally is not None and not len(rally):
        raise InvalidInputError("rally: expected one point or more, got none")
    if rally is not None:
        if ending == "return" and chosen:
            raise InvalidInputError(
                "ending: expected land or loiter with rally points, because a return may lead to the"
                " nearest rally point, got return"
            )
        if ending in (None, "return") and plan.landing is None:
            ending, chosen = {**_ENDINGS, "rover": "land"}[plan.vehicle.kind], False
    region = plan.grid.region
    if airspace is None and not region.barriers:
        where = plan.airspace  # its curves are known already
    else:
        where = Airspace(
            grow(region.barred, region.margin),
            None if airspace is None else region.free.buffer(airspace),
            region.free,
            # exclusion polygons contain the zones: where these leave no room, there is none
            dead_ends={key: dict(ends) for key, ends in plan.airspace.dead_ends.items()},
        )

    def sorties(robot: int, layer: int) -> RobotMissions:
        vehicle = plan.vehicle
        if layer and separation is not None:
            vehicle = vehicle.replaced(altitude=vehicle.height + layer * separation.vertical)
        flight = _flight(plan, robot, vehicle, ending, where)
        if altitudes is not None:
            flight = replace(flight, altitudes=altitudes)
        return _split_route(plan, robot, flight, autopilot=autopilot, cap=cap)

    robots = range(len(plan.places))
    by_robot = [sorties(robot, 0) for robot in robots]
    circling = next((own for own in by_robot if len(own) > 1 and own[0].loiter is not None), None)
    if circling is not None and chosen:
        raise InvalidInputError(
            "ending: expected sorties that land, because a vehicle is recharged between them"
            f" (robot {circling[0].robot} flies {len(circling)}), got vehicles that loiter: give"
            " landing points with --land, or the ending land"
        )
    if circling is not None:
        ending = "land"
        by_robot = [sorties(robot, 0) for robot in robots]
    if separation is not None:
        by_robot = _Schedule(plan, separation, sorties).keep_apart(by_robot)
    else:
        by_robot = [
            _start_in_turn(missions, plan, float(delay))
            for missions, delay in zip(by_robot, plan.delays, strict=True)
        ]
    return _add_fence(
        [mission for missions in by_robot for mission in missions],
        plan,
        np.zeros((0, 2)) if rally is None else rally,
        altitudes or Altitudes(),
        fenced=fenced,
    )


def _flight(
    plan: SearchPlan, robot: int, vehicle: Vehicle, ending: str | None, airspace: Airspace
) -> Flight:
    """Return how a robot of a plan flies its missions."""
    landing = None if plan.landing is None else plan.landing[robot]
    if landing is None and ending not in (None, "return"):
        landing = plan.places[robot]
    if landing is not None and ending == "loiter" and plan.vehicle.radius:
        landing = _loiter_place(plan, landing, airspace.blocked)
    return Flight(
        vehicle,
        plan.places[robot],
        plan.grid.region.frame,
        landing,
        ending,  # type: ignore[arg-type]  # None: by the landing
        airspace=airspace,
        rate=float(plan.rates[robot]),
        link=float(plan.footprints[robot]) * LINK,
    )


def _split_route(plan: SearchPlan, robot: int, flight: Flight, **limits: Any) -> RobotMissions:
    """Return the missions of one robot. A robot without cells has no missions."""
    stops = plan.stops(robot)
    if not len(stops):
        return ()
    out, path = plan.flown_route(robot, stops)
    if path.shape[1] == 3:
        path = path + np.array([0.0, 0.0, flight.vehicle.height - plan.vehicle.height])
    return split_missions(path, flight, robot=robot + 1, find_path=plan.leg, out=out, **limits)


def _loiter_place(plan: SearchPlan, place: Points, blocked: Any) -> Points:
    """Return the place nearest to a landing point at which a fixed wing has room for its last
    circles.
    """
    import shapely

    radius = Flight(plan.vehicle, place).radius
    obstacles = blocked.buffer(radius + ROUNDED)
    if not shapely.intersects_xy(obstacles, *place):
        return place
    allowed = (
        shapely.box(*shapely.union_all([plan.grid.region.outline, obstacles]).bounds)
        .buffer(radius)
        .difference(obstacles)
    )
    if allowed.is_empty:
        raise InvalidInputError(
            f"ending: expected room for circles of {radius:.4g} m around {text_of(place)} m, got"
            " none"
        )
    return np.asarray(
        shapely.get_coordinates(shapely.shortest_line(allowed, shapely.points(place)))[0]
    )


def _start_in_turn(missions: RobotMissions, plan: SearchPlan, start: float) -> RobotMissions:
    """Return the missions of one robot with their start times: each sortie begins when its vehicle
    is back, after the climb of a return, and recharged.
    """
    timed = []
    for mission in missions:
        timed.append(replace(mission, start=start))
        start += mission.battery_seconds(plan.vehicle) + plan.vehicle.recharge_seconds
    return tuple(timed)


def _keep_layer(flights: Sequence[Trajectory], layer: int) -> Sequence[Trajectory]:
    return flights  # its layer is fixed


class _Schedule:
    """An object that finds altitude layers and start times for which all sorties of a plan keep
    their separation.
    """

    def __init__(
        self, plan: SearchPlan, separation: Separation, sorties: Callable[[int, int], RobotMissions]
    ) -> None:
        self.plan, self.separation, self.sorties = plan, separation, sorties
        self.stay = 0.0

    def keep_apart(self, by_robot: list[RobotMissions]) -> list[RobotMissions]:
        """Return the missions with altitude layers, start times and takeover altitudes.

        While a vehicle searches cells of a failed robot, it flies at its takeover altitude.
        """
        self.stay = 2 * max(
            (
                self._flights(by_robot, robot, 0, 0.0)[0].duration
                for robot, sorties in enumerate(by_robot)
                if sorties
            ),
            default=0.0,
        )
        longest = self.stay
        # Two vehicles that loiter may each wait for the end of the other one's circles. If every
        # vehicle has its own layer, and the vehicles start from the highest layer down, none has to
        # climb through the circles of another one.
        for stacked in (False, True):
            self.stay = longest
            for _ in range(_ROUNDS):
                scheduled, last = self._try(by_robot, stacked=stacked)
                if (
                    not any(sorties and sorties[-1].loiter is not None for sorties in by_robot)
                    or last <= self.stay
                ):
                    return scheduled
                # vehicles that stay in the air must be separated from all later flights
                self.stay = 1.5 * last
        raise InvalidInputError(
            "separation: expected missions whose vehicles keep apart, got vehicles that loiter in"
            " the way of later starts; use the ending land, launch points farther apart, or"
            " vehicles with enough endurance for a single sortie each"
        )

    def _try(
        self, by_robot: list[RobotMissions], *, stacked: bool = False
    ) -> tuple[list[RobotMissions], float]:
        """Return the missions with layers and start times, and the time at which all vehicles are
        back or begin to loiter.

        Vehicles that loiter stay in the air for ``self.stay`` seconds. If ``stacked`` is true, each
        vehicle has its own layer, and the vehicles start from the highest layer down.
        """
        plan, robots = self.plan, range(len(by_robot))
        layers: Sequence[int] = [0] * len(by_robot)
        # from between the layers of a volume, no part of it is seen
        layered = plan.vehicle.kind != "rover" and not plan.grid.region.height
        if layered and stacked:
            durations = [
                self._flights(by_robot, robot, 0, 0.0)[0].duration if by_robot[robot] else 0.0
                for robot in robots
            ]
            layers = np.argsort(np.argsort(durations, kind="stable")).tolist()
        elif layered:
            first_flights = [partial(self._flights_in_layer, by_robot, robot) for robot in robots]
            layers = stagger_starts(first_flights, self.separation, earliest=plan.delays)[
                0
            ].tolist()
        by_robot = [
            self.sorties(robot, layer) if layer else by_robot[robot]
            for robot, layer in zip(robots, layers, strict=True)
        ]
        flights = [
            [self._flights(by_robot, robot, number, 0.0) for number in range(len(by_robot[robot]))]
            for robot in robots
        ]
        starts = self._first_starts(flights, layers, stacked=stacked)
        ready = [
            (self._ready_at(flights[robot][0], by_robot[robot][0], starts[robot, 0]), robot, 1)
            for robot in robots
            if len(by_robot[robot]) > 1
        ]
        while ready:
            since, robot, number = heappop(ready)
            others = [
                (flights[other_robot][other], at)
                for (other_robot, other), at in starts.items()
                if other_robot != robot
            ]
            _, (start,) = stagger_starts(
                [partial(_keep_layer, flights[robot][number])],
                self.separation,
                [0],
                np.array([since]),
                others,
            )
            starts[robot, number] = float(start)
            if number + 1 < len(by_robot[robot]):
                again = self._ready_at(
                    flights[robot][number], by_robot[robot][number], float(start)
                )
                heappush(ready, (again, robot, number + 1))
        # The time for which a vehicle stays in the air is part of its last flight.
        ends = [
            start
            + max(flight.duration for flight in flights[robot][number])
            - self._stay(by_robot, robot, number)
            for (robot, number), start in starts.items()
        ]
        last = max(ends, default=0.0) + self.separation.delay
        return [
            self._set_starts(other_robot, robot, starts, layers)
            for robot, other_robot in enumerate(by_robot)
        ], last

    def _first_starts(
        self,
        flights: Sequence[Sequence[Sequence[Trajectory]]],
        layers: Sequence[int],
        *,
        stacked: bool,
    ) -> dict[tuple[int, int], float]:
        """Return the start time of each robot's first sortie."""
        earliest = self.plan.delays
        if not stacked:
            delays = stagger_starts(
                [partial(_keep_layer, sorties[0] if sorties else ()) for sorties in flights],
                self.separation,
                layers,
                earliest,
            )[1]
            return {
                (robot, 0): float(delays[robot]) for robot, sorties in enumerate(flights) if sorties
            }
        starts: dict[tuple[int, int], float] = {}
        for robot in np.argsort(layers, kind="stable")[::-1].tolist():
            if flights[robot]:
                others = [(flights[other][0], at) for (other, _), at in starts.items()]
                since = np.array([max([float(earliest[robot]), *starts.values()])])
                _, (start,) = stagger_starts(
                    [partial(_keep_layer, flights[robot][0])], self.separation, [0], since, others
                )
                starts[robot, 0] = float(start)
        return starts

    def _flights_in_layer(
        self, by_robot: Sequence[RobotMissions], robot: int, layer: int
    ) -> Sequence[Trajectory]:
        """Return the trajectories of a robot's first sortie in a given altitude layer."""
        return self._flights(by_robot, robot, 0, layer * self.separation.vertical)

    def _set_starts(
        self,
        sorties: RobotMissions,
        robot: int,
        starts: dict[tuple[int, int], float],
        layers: Sequence[int],
    ) -> RobotMissions:
        """Return the missions of a robot with its start times and its takeover altitude."""
        changes: dict[str, Any] = {}
        if self.plan.vehicle.kind != "rover":
            altitude = (
                max(self.plan.altitudes) + (max(layers) + 1 + robot) * self.separation.vertical
            )
            home_elevation = (
                float(sorties[0].elevation or 0.0)
                if sorties and sorties[0].altitude_frame == "sea"
                else 0.0
            )
            changes = {"takeover": altitude + home_elevation}
        return tuple(
            replace(mission, start=starts[robot, number], **changes)
            for number, mission in enumerate(sorties)
        )

    def _ready_at(self, flights: Sequence[Trajectory], mission: Mission, start: float) -> float:
        """Return the time at which a vehicle can start again after a mission, even if the mission is
        late.
        """
        vehicle = self.plan.vehicle
        duration = max(flight.duration for flight in flights[:2])
        climb = mission.battery_seconds(vehicle) - mission.duration(vehicle)  # of a return
        return start + duration + climb + self.separation.delay + vehicle.recharge_seconds

    def _stay(self, by_robot: Sequence[RobotMissions], robot: int, number: int) -> float:
        """Return how long a vehicle stays in the air after a mission, in seconds. A vehicle that
        lands does not stay.
        """
        return (
            self.stay
            if number + 1 == len(by_robot[robot]) and by_robot[robot][number].loiter is not None
            else 0.0
        )

    def _flights(
        self, by_robot: Sequence[RobotMissions], robot: int, number: int, up: float
    ) -> Sequence[Trajectory]:
        """Return the trajectories of a mission: with the vehicle's speeds and turns, at a constant
        speed, and with the longest turns.
        """
        if number >= len(by_robot[robot]):
            return ()
        mission, plan = by_robot[robot][number], self.plan
        path = common_path(mission, plan.grid.region.frame)
        path[1 : len(path) - 1, 2] += up
        stay = self._stay(by_robot, robot, number)

        def flown(vehicle: Vehicle, rate: float) -> Trajectory:
            trajectory = mission_trajectory(mission, path, vehicle, rate, stay)
            return replace(trajectory, turns=(0.0, 1.0))

        vehicle, rate = plan.vehicle, float(plan.rates[robot])
        as_flown = flown(vehicle, rate), flown(constant_speed(mission), 1.0)
        if not vehicle.turn_seconds:
            return as_flown
        # the time that a vehicle loses at gentle bends is not in proportion to that of a turn
        slow = vehicle.replaced(turn_time=_LONGEST_TURNS * vehicle.turn_seconds)
        return *as_flown, flown(slow, rate)


def _add_fence(
    missions: Sequence[Mission],
    plan: SearchPlan,
    rally: Points,
    altitudes: Altitudes,
    *,
    fenced: bool,
) -> tuple[Mission, ...]:
    """Return missions with the fence and the rally points of a plan.

    A rally point is as high as the highest waypoint of its mission. With altitudes above ground, it
    is also as far above its own ground as the mission.
    """
    region = plan.grid.region
    if not missions:
        return ()
    paths = [mission.path_in(region.frame)[:, :2] for mission in missions]
    paths += [circle for mission in missions if len(circle := mission.circle_in(region.frame))]
    most = CORNERS[missions[0].autopilot] if fenced else None
    fence = fence_of(region, [*paths, *(point[None] for point in rally)], most=most)
    area = fence.area(region.frame)
    import shapely

    for point in rally[~shapely.intersects_xy(area, *rally.T)]:
        raise InvalidInputError(
            f"rally: expected points outside of no-go zones, got {text_of(point)} m"
        )
    far = shapely.distance(region.free, shapely.points(rally)) > ELSEWHERE
    for point in rally[far]:
        raise InvalidInputError(
            f"rally: expected points within {ELSEWHERE / 1000:g} km of the region, got"
            f" {text_of(point)} m"
        )
    placed = rally if region.frame is None else region.frame.to_degrees(rally)

    def raised(mission: Mission) -> tuple[tuple[float, ...], ...]:
        ups = np.full(len(rally), mission.heights_above_home.max())
        if altitudes.terrain is not None and len(rally) and mission.kind != "rover":
            home = mission.path_in(region.frame)[:1, :2]
            ground = altitudes.terrain.at(np.vstack([home, rally]), region.frame)
            hills = ground[1:] - ground[0]
            if altitudes.frame == "ground":
                ups = np.maximum(ups, hills + mission.altitude)
            for point in rally[hills >= ups]:
                raise InvalidInputError(
                    "rally: expected points whose ground is below the vehicles, got"
                    f" {text_of(point)} m, which is not"
                )
        return tuple(
            (x, y, round(up, 2)) for (x, y), up in zip(placed.tolist(), ups.tolist(), strict=True)
        )

    return tuple(replace(mission, fence=fence, rally=raised(mission)) for mission in missions)
