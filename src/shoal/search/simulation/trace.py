"""The trace of a search: what each robot did in a plan, in a simulation or in a live search."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import fields
from itertools import pairwise
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_integer, check_number, check_text, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.cells.grid import CellGrid
from shoal.search.cells.layers import layers_of
from shoal.search.cells.routing import Route
from shoal.search.planning.plan import SearchPlan
from shoal.search.problem.network import Liar
from shoal.search.protocol.state import Brief, step_cost
from shoal.search.regions.coverage import AreaCoverage, coverage_check
from shoal.search.simulation.scenario import Scenario
from shoal.search.tours.masks import bits_to_array, members

_HORIZON = 60.0  # time limit of a simulation, divided by the time of one robot alone
_PLAIN = 20_000  # size of the largest search that needs no compiled code
_PRIOR = 0.01  # prior fraction of cells that contain a target
# limits of a sensor's rates: no sensor counts as fully reliable, because robots can lie
_LEAST_RATE, _MOST_RATE = 1e-3, 1 - 1e-3


@dataclass(frozen=True, eq=False)
class RobotLog:
    """The log of one robot: its cells, its paths, its findings, and the times of its statuses.

    Parameters
    ----------
    cells : ndarray of int64, shape (k,)
        Tour indices of the cells in which the robot stopped to search. A robot with a footprint
        wider than one cell also searches the cells around each stop.
    times : ndarray of float64, shape (k,)
        Time at which the robot searched each cell, in units of the time in which a robot of speed 1
        searches one cell.
    states : tuple of (float, str)
        Pairs of a time and the status that began at this time: "listening", "searching", "waiting",
        "complete", "paused" or "dead".
    found : tuple of (int, tuple of int)
        Findings that the robot knew at the end: pairs of a cell and the robots that found something
        in this cell.
    detours : tuple of tuple of int
        The cells that the robot passed on its way to each stop. If robots do not move from cell to
        cell, ``detours`` is empty.
    obstructed : tuple of (float, int)
        Pairs of a time and a cell: at this time, the robot discovered an obstacle in this cell.
    """

    cells: NDArray[np.int64]
    times: NDArray[np.float64]
    states: tuple[tuple[float, str], ...]
    found: tuple[tuple[int, tuple[int, ...]], ...]
    detours: tuple[tuple[int, ...], ...] = ()
    obstructed: tuple[tuple[float, int], ...] = ()

    @property
    def status(self) -> str:
        """The final status of the robot."""
        return self.states[-1][1] if self.states else "listening"


@dataclass(frozen=True, eq=False)
class SearchTrace:
    """The trace of a search: the events of each robot.

    Parameters
    ----------
    robots : tuple of RobotLog
    covered_at : float
        Time at which the required number of robots had searched each reachable cell, or infinity if
        too few robots searched a cell. The unit of time is the time in which a robot of speed 1
        searches one cell.
    declared : dict of int to float
        Time at which each robot declared completion, by the number of the robot (from 1).
    sent, lost : int
        Number of sent messages and number of lost messages. A message to several receivers counts
        once for each receiver.
    takeovers : int
        Number of times that a robot began to search the part of another robot that it presumed
        dead.
    dropped : int
        Number of messages that robots dropped in a live search, because the sender was no robot of
        the search or values were impossible.
    """

    robots: tuple[RobotLog, ...]
    covered_at: float
    declared: dict[int, float]
    sent: int
    lost: int
    takeovers: int
    dropped: int = 0

    def difference(self, other: SearchTrace) -> str:
        """Return one sentence about the first difference from another trace. For equal traces,
        return an empty text.
        """
        for number, (own, theirs) in enumerate(
            zip(self.robots, other.robots, strict=True), start=1
        ):
            same = np.array_equal(own.cells, theirs.cells) and np.allclose(
                own.times, theirs.times, rtol=0, atol=1e-9
            )
            if not same or (own.states, own.detours, own.obstructed) != (
                theirs.states,
                theirs.detours,
                theirs.obstructed,
            ):
                return f"planned and simulated again, robot {number} does not act as in the episode"
        for name in ("covered_at", "declared", "sent", "lost"):
            if getattr(self, name) != getattr(other, name):
                return (
                    f"planned and simulated again, {name} is {getattr(other, name)}, but"
                    f" {getattr(self, name)} in the episode"
                )
        return ""

    def to_dict(self) -> dict[str, Any]:
        """Return the trace as a mapping that can be written as JSON."""
        return vars(self) | {
            "robots": [
                vars(log) | {"cells": log.cells.tolist(), "times": log.times.tolist()}
                for log in self.robots
            ],
            "covered_at": None if self.covered_at == inf else self.covered_at,
        }

    @classmethod
    def from_dict(cls, data: Any, *, robots: int, cells: int) -> SearchTrace:
        """Return the trace that a mapping from `to_dict` describes. The mapping must fit the
        numbers of robots and cells.
        """
        names = {"robots", "covered_at", "declared", "sent", "lost", "takeovers", "dropped"}
        if not isinstance(data, dict) or set(data) != names or not isinstance(data["robots"], list):
            raise InvalidInputError(
                f"trace: expected {', '.join(sorted(names))}, got {shortened(data)}"
            )
        logs = tuple(
            _log_from(log, f"robots: {number}", cells)
            for number, log in enumerate(data["robots"], start=1)
        )
        if len(logs) != robots:
            raise InvalidInputError(f"robots: expected {robots} robots, got {len(logs)}")
        declared = {
            int(number): check_number(moment, what="declared")
            for number, moment in dict(data["declared"]).items()
        }
        if not set(declared) <= set(range(1, robots + 1)):
            raise InvalidInputError(
                f"declared: expected robots from 1 to {robots}, got {shortened(sorted(declared))}"
            )
        covered_at = (
            inf
            if data["covered_at"] is None
            else check_number(data["covered_at"], what="covered_at")
        )
        counts = [
            check_integer(data[name], what=name, least=0)
            for name in ("sent", "lost", "takeovers", "dropped")
        ]
        return cls(logs, covered_at, declared, *counts)


def _log_from(data: Any, what: str, n: int) -> RobotLog:
    """Return the log of one robot from its entry in the mapping of `SearchTrace.to_dict`."""
    names = {field.name for field in fields(RobotLog)}
    if (
        not isinstance(data, dict)
        or set(data) != names
        or not all(isinstance(value, list) for value in data.values())
    ):
        raise InvalidInputError(
            f"{what}: expected lists {', '.join(sorted(names))}, got {shortened(data)}"
        )

    def cell(value: Any) -> int:
        return check_integer(value, what=f"{what}: cell", least=0, most=n - 1)

    def moment(value: Any) -> float:
        return check_number(value, what=f"{what}: time")

    cells, times = (
        [cell(number) for number in data["cells"]],
        [moment(number) for number in data["times"]],
    )
    if len(cells) != len(times):
        raise InvalidInputError(
            f"{what}: expected a time for each cell, got {len(cells)} cells and {len(times)} times"
        )
    try:
        return RobotLog(
            np.array(cells, dtype=np.int64),
            np.array(times, dtype=np.float64),
            tuple(
                (moment(time), check_text(state, what=f"{what}: state"))
                for time, state in data["states"]
            ),
            tuple(
                (cell(number), tuple(check_integer(robot, what=what) for robot in robots))
                for number, robots in data["found"]
            ),
            tuple(tuple(cell(index) for index in passed) for passed in data["detours"]),
            tuple((moment(time), cell(index)) for time, index in data["obstructed"]),
        )
    except InvalidInputError:
        raise
    except (TypeError, ValueError) as error:
        raise InvalidInputError(
            f"{what}: expected times with states or cells, got something else: {error}"
        ) from None


def planned_trace(plan: SearchPlan, brief: Brief) -> SearchTrace:
    """Compute, without a simulation, the trace of robots that follow a plan without faults and go
    home to recharge.

    Raises
    ------
    InvalidInputError
        If a full battery of a robot does not suffice to go to a cell, search it and return home.
    """
    logs, tour_cost = [], plan.tour_cost
    covered_at = 0.0
    for robot in range(len(plan.allocation.arcs)):
        cells = plan.stops(robot)
        times = np.zeros(0)
        if len(cells):
            steps = np.array(
                [
                    1.0 + tour_cost.move_cost(source, cell)
                    for source, cell in pairwise(cells.tolist())
                ]
            )
            route = plan.route(robot, cells[:1])
            first = (
                float(plan.leg_lengths(route.points[: route.stops[1] + 1]).sum()) / plan.grid.size
                + 1.0
            )
            lasting = np.concatenate([[first], steps]) / plan.rates[robot]
            if brief.energy < inf:
                lasting = _with_recharging(plan, brief, robot, cells, lasting)
            times = plan.delays[robot] / plan.cell_seconds + np.cumsum(lasting)
        ends = float(times[-1]) if len(times) else 0.0
        covered_at = max(covered_at, ends)
        logs.append(RobotLog(cells, times, ((0.0, "searching"), (ends, "complete")), ()))
    return SearchTrace(tuple(logs), covered_at, {}, 0, 0, 0)


def _with_recharging(
    plan: SearchPlan,
    brief: Brief,
    robot: int,
    cells: NDArray[np.int64],
    lasting: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the time that a robot needs for each of its cells, with the times for recharging at
    home; float64, shape (k,).

    The robot goes home to recharge whenever `head_for` would send it home. The array ``lasting``
    holds the times without recharging.
    """
    tour_cost, rate, start = plan.tour_cost, float(plan.rates[robot]), int(plan.starts[robot])
    completion, energy = lasting.copy(), brief.energy
    away = [
        length + brief.from_launch(robot + 1, start, cell)
        for cell, length in zip(cells.tolist(), tour_cost.lengths_from(start, cells), strict=True)
    ]
    for k, cell in enumerate(cells.tolist()):
        cost = lasting[k] * rate
        if cost + away[k] > energy and k:
            cost = step_cost(tour_cost, start, cell, True) + brief.from_launch(
                robot + 1, start, cell
            )
            completion[k], energy = (away[k - 1] + cost) / rate + brief.recharge, brief.energy
        if cost + away[k] > energy:
            raise InvalidInputError(
                f"endurance: expected energy for a cell that is {away[k]:.4g} cells from the home"
                f" of robot {robot + 1}, got {brief.energy:.4g} cells"
            )
        energy -= cost
    return completion


def simulated_trace(plan: SearchPlan, scenario: Scenario) -> SearchTrace:
    """Simulate a scenario, and return the trace of the search."""
    late = max(scenario.brief.delays, default=0.0)
    until = late + _HORIZON * plan.tour_cost.whole * scenario.brief.multiplicity + 1000.0
    if scenario.size > _PLAIN:
        # most searches that are planned are not simulated, or small
        from shoal.search.simulation.compiled import can_compile

        if can_compile(scenario):
            return _compiled_trace(scenario, until)
    from shoal.search.simulation.world import SearchWorld

    world = SearchWorld(scenario).run(until=until)
    logs = tuple(
        RobotLog(
            cells=np.array([cell for _, cell in vehicle.visits], dtype=np.int64),
            times=np.array([moment for moment, _ in vehicle.visits]),
            states=tuple(vehicle.states),
            found=tuple(
                sorted((cell, tuple(members(bits))) for cell, bits in vehicle.robot.found.items())
            ),
            detours=tuple(vehicle.detours) if any(vehicle.detours) else (),
            obstructed=tuple(vehicle.obstructed),
        )
        for vehicle in world.vehicles.values()
    )
    covered_at = float(search_times(scenario, logs).max())
    return SearchTrace(
        logs, covered_at, world.declared, world.air.sent, world.air.lost, world.takeovers
    )


def _compiled_trace(scenario: Scenario, until: float) -> SearchTrace:
    """Simulate a scenario in compiled code, and return the trace of the search."""
    from shoal.search.simulation.compiled import CompiledSearches

    searches = CompiledSearches([scenario])
    searches.run(0, until)
    outcome = searches.outcome(0)
    logs = tuple(
        RobotLog(
            cells,
            times,
            states,
            tuple(sorted((cell, tuple(members(bits))) for cell, bits in outcome.found[i].items())),
            outcome.detours[i] if outcome.detours and any(outcome.detours[i]) else (),
            outcome.obstructed[i],
        )
        for i, (cells, times, states) in enumerate(
            zip(outcome.cells, outcome.times, outcome.states, strict=True)
        )
    )
    covered_at = float(search_times(scenario, logs).max())
    counts = outcome.sent, outcome.lost, outcome.takeovers
    return SearchTrace(logs, covered_at, outcome.declared, *counts)


def search_times(scenario: Scenario, logs: Sequence[RobotLog]) -> NDArray[np.float64]:
    """Return the time at which the required number of robots had searched each reachable cell;
    float64, shape (n,).

    The required number of robots is the multiplicity, or less if fewer robots can reach the cell.
    Liars count as robots that search, but at least one robot must be honest. A cell that too few
    robots searched gets an infinite time.
    """
    tour_cost, count = scenario.brief.tour_cost, scenario.brief.multiplicity
    liars = {fault.robot for fault in scenario.faults if isinstance(fault, Liar)}
    # the earliest times of each cell, by different robots
    best = np.full((count, len(tour_cost)), inf)
    truly = np.full(len(tour_cost), inf)
    able = np.zeros(len(tour_cost), dtype=np.int64)
    for number, log in enumerate(logs, start=1):
        able += bits_to_array(scenario.reach(number), len(able)) if count > 1 else 1
        mine = _first_times(scenario, number, log)
        truly = truly if number in liars else np.minimum(truly, mine)
        for place in range(count):
            best[place], mine = np.minimum(best[place], mine), np.maximum(best[place], mine)
    last = np.minimum(able, count) - 1
    detection = np.maximum(best[last, np.arange(len(last))], truly)
    return np.asarray(detection[bits_to_array(scenario.goal, len(last))])


def _first_times(scenario: Scenario, number: int, log: RobotLog) -> NDArray[np.float64]:
    """Return the time at which a robot first searched each cell, or infinity; float64, shape (n,)."""
    tour_cost = scenario.brief.tour_cost
    times = np.full(len(tour_cost), inf)
    if scenario.widths[number - 1] == 1:
        np.minimum.at(times, log.cells, log.times)
        return times
    for cell, moment in zip(log.cells.tolist(), log.times.tolist(), strict=True):
        visible = tour_cost.visible_cells(cell, scenario.widths[number - 1])
        times[visible] = np.minimum(times[visible], moment)
    return times


def least_honest_searches(
    scenario: Scenario, logs: Sequence[RobotLog], liars: Collection[int]
) -> int:
    """Return the number of robots that truly searched a reachable cell, at the cell with the
    fewest of them.
    """
    honest = [
        np.isfinite(_first_times(scenario, number, log))
        for number, log in enumerate(logs, start=1)
        if number not in liars
    ]
    searches = np.sum(honest, axis=0, dtype=np.int64, initial=0)
    goal = bits_to_array(scenario.goal, len(scenario.brief.tour_cost))
    return int(np.broadcast_to(searches, goal.shape)[goal].min(initial=len(logs)))


def coverages(
    plan: SearchPlan, trace: SearchTrace, routes: Sequence[Route], robots: Sequence[int]
) -> tuple[AreaCoverage, ...]:
    """Return, for each layer from the lowest to the highest, the coverage by the robots with the
    numbers ``robots`` (from 0). A layer of second looks at some cells of another counts with it.
    """
    layers, coverages = layers_of(plan.grid), []
    sides = plan.footprints / layers[0].footprint
    for number, layer in enumerate(layers):
        if layer.whole is not None:
            continue
        same = [number, *(up for up, other in enumerate(layers) if other.whole is layer)]
        paths = [
            (path, sides[robot] * layer.footprint)
            for robot in robots
            for path in _paths(plan, trace, routes, robot, same)
        ]
        footprints = [side for _, side in paths] or layer.footprint
        coverages.append(
            coverage_check(
                layer.region,
                [path for path, _ in paths],
                footprints,
                angle=layer.angle,
                image=plan.image,
            )
        )
    return tuple(coverages)


def _paths(
    plan: SearchPlan,
    trace: SearchTrace,
    routes: Sequence[Route],
    robot: int,
    layers: Sequence[int],
) -> list[NDArray[np.float64]]:
    """Return a robot's paths inside layers, without its path from a launch point outside the
    region and without climbs.
    """
    route, log = routes[robot], trace.robots[robot]
    if isinstance(plan.grid, CellGrid):
        inside = len(route.stops) < 2 or plan.grid.region.contains(route.points[:1])[0]
        return [route.points if inside else route.points[route.stops[1] :]]
    spans, layer_of_stop = cell_spans(plan, route, log), plan.tour.cells[log.cells, 0]
    borders = [0, *(np.flatnonzero(np.diff(layer_of_stop)) + 1).tolist(), len(layer_of_stop)]
    return [
        route.points[spans[begin, 0] : spans[end - 1, 1] + 1, :2]
        for begin, end in pairwise(borders)
        if layer_of_stop[begin] in layers
    ]


def cell_spans(plan: SearchPlan, route: Route, log: RobotLog) -> NDArray[np.int64]:
    """Return, for each cell of a robot's log, the indices of the cell's first and last point on the
    route; int64, shape (k, 2).

    If a robot passes other cells on its way to a cell, the first point of the cell lies in the
    first of the passed cells.
    """
    index = plan.grid.ordinals(plan.tour.cells[log.cells])
    counts = plan.grid.viewpoint_starts[index + 1] - plan.grid.viewpoint_starts[index]
    if any(log.detours):
        counts = counts + np.array([len(passed) for passed in log.detours], dtype=np.int64)
    last = np.cumsum(counts)
    return np.asarray(route.stops[np.stack([last - counts + 1, last], axis=1)])


@dataclass(frozen=True, slots=True)
class Finding:
    """A cell in which at least one robot has found something.

    Parameters
    ----------
    cell : int
        Tour index of the cell.
    found_by, missed_by : tuple of int
        Numbers of the robots that found something in the cell, and of the robots that searched the
        cell and found nothing.
    confidence : float
        Probability that the cell contains a target. The confidence follows from the sensors'
        detection rate and false-alarm rate, and from a prior probability of 0.01.
    """

    cell: int
    found_by: tuple[int, ...]
    missed_by: tuple[int, ...]
    confidence: float


def merge_findings(
    scenario: Scenario, reports: dict[int, set[int]], searched: dict[int, int]
) -> tuple[Finding, ...]:
    """Merge the reports of all robots to one finding for each cell in which a robot found
    something.

    Parameters
    ----------
    scenario : Scenario
        The scenario, which gives the detection rate and the false-alarm rate of the sensors.
    reports : dict of int to set of int
        Numbers of the robots that found something in a cell, by the tour index of the cell.
    searched : dict of int to int
        Bitset of the cells that each robot reports as searched, by the number of the robot.
    """
    hit = min(max(scenario.detection, _LEAST_RATE), _MOST_RATE)
    alarm = min(max(scenario.false_alarm, _LEAST_RATE), _MOST_RATE)
    findings = []
    for cell, witnesses in sorted(reports.items()):
        missed = tuple(
            sorted(
                robot
                for robot, bits in searched.items()
                if bits >> cell & 1 and robot not in witnesses
            )
        )
        odds = (
            math.log(_PRIOR / (1 - _PRIOR))
            + len(witnesses) * math.log(hit / alarm)
            + len(missed) * math.log((1 - hit) / (1 - alarm))
        )
        findings.append(Finding(cell, tuple(sorted(witnesses)), missed, _chance(odds)))
    return tuple(findings)


def _chance(odds: float) -> float:
    return 1 / (1 + math.exp(-odds)) if odds > -700 else 0.0
