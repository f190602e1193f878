"""What robots do with a plan: what it says if all goes well, what a simulation makes of it, or what processes report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from shoal.errors import InvalidInputError
from shoal.search.bits import bits_of
from shoal.search.episode import RobotLog
from shoal.search.faults import Crash
from shoal.search.planning import SearchPlan
from shoal.search.scenario import Scenario
from shoal.search.sharing import parts_of
from shoal.search.world import World

if TYPE_CHECKING:
    from shoal.search.live import LiveEvent

_HELLO, _BEAT = 0.3, 0.05  # seconds that live robots listen, and between their beacons, at the least
_STATES = {kind: kind for kind in ("listening", "searching", "waiting", "complete")} | {
    "killed": "dead",
    "stopped": "dead",
    "failed": "dead",
}
_HORIZON = 60.0  # times the way of one robot alone


@dataclass(frozen=True)
class Played:
    """What came of a search; see the same names of `SearchEpisode`."""

    robots: tuple[RobotLog, ...]
    covered_at: float
    declared: dict[int, float]
    sent: int
    lost: int
    takeovers: int


def as_planned(plan: SearchPlan) -> Played:
    """Return what robots do if all goes well; nothing is simulated."""
    logs, course = [], plan.course
    covered_at = 0.0
    for robot in range(len(plan.allocation.sweeps)):
        cells = plan.stops(robot)
        times = np.zeros(0)
        if len(cells):
            steps = np.array([1.0 + course.way(here, cell) for here, cell in pairwise(cells.tolist())])
            first = plan.route(robot, cells[:1]).length / plan.grid.size + 1.0
            times = np.cumsum(np.concatenate([[first], steps])) / plan.rates[robot]
        ends = float(times[-1]) if len(times) else 0.0
        covered_at = max(covered_at, ends)
        logs.append(RobotLog(cells, times, ((0.0, "searching"), (ends, "complete")), ()))
    return Played(tuple(logs), covered_at, {}, 0, 0, 0)


def simulated(plan: SearchPlan, scenario: Scenario) -> Played:
    """Return what the simulation of a scenario comes to."""
    outcome = World(scenario).run(until=_HORIZON * plan.course.whole * scenario.brief.fold + 1000.0)
    logs = tuple(
        RobotLog(
            cells=np.array([cell for _, cell in vehicle.visits], dtype=np.int64),
            times=np.array([moment for moment, _ in vehicle.visits]),
            states=tuple(vehicle.states),
            found=tuple(sorted((cell, tuple(_witnesses(bits))) for cell, bits in vehicle.robot.found.items())),
            detours=tuple(vehicle.detours) if any(vehicle.detours) else (),
            obstructed=tuple(vehicle.obstructed),
        )
        for vehicle in outcome.vehicles.values()
    )
    return Played(logs, outcome.covered_at, outcome.declared, outcome.sent, outcome.lost, outcome.takeovers)


def _witnesses(bits: int) -> list[int]:
    return [number for number in range(bits.bit_length()) if bits >> number & 1]


def lived(scenario: Scenario, *, live: float, loss: float) -> tuple[Scenario, Played]:
    """Let processes search, ``live`` cells a second; return the scenario with the times that they need, and what they reported.

    Raises
    ------
    InvalidInputError
        For faults but crashes.
    """
    from shoal.search.live import run_live

    kill = [fault for fault in scenario.faults if isinstance(fault, Crash)]
    if len(kill) < len(scenario.faults):
        raise InvalidInputError("live: expected no fault but crashes")
    brief = replace(scenario.brief, hello=max(scenario.brief.hello, _HELLO * live), beat=max(scenario.brief.beat, _BEAT * live))
    scenario = replace(scenario, brief=brief)
    outcome = run_live(
        brief,
        scenario.starts,
        rates=scenario.rates,
        loss=loss,
        kill=kill,
        targets=scenario.targets,
        obstacles=scenario.obstacles,
        widths=scenario.widths,
        speed=live,
        seed=scenario.seed,
    )
    logs = [_log_of(number, outcome.events) for number in range(1, len(scenario.starts) + 1)]
    left, covered_at = scenario.goal, inf
    for event in outcome.events:
        if event.kind == "searched" and event.cell is not None and left:
            left &= ~bits_of((event.cell, *event.around))
            covered_at = inf if left else event.time
    return scenario, Played(tuple(logs), covered_at, outcome.declared, outcome.heard, outcome.lost, takeovers_of(scenario, logs))


def _log_of(number: int, events: Sequence[LiveEvent]) -> RobotLog:
    """Return what a robot has reported."""
    own = [event for event in events if event.robot == number]
    searched = [event for event in own if event.kind == "searched" and event.cell is not None]
    detours = tuple(event.through for event in searched)
    found = {event.cell for event in searched if event.found and event.cell is not None}
    found |= {cell for event in searched for cell in event.beside}
    return RobotLog(
        cells=np.array([event.cell for event in searched], dtype=np.int64),
        times=np.array([event.time for event in searched]),
        states=tuple((event.time, _STATES[event.kind]) for event in own if event.kind in _STATES),
        found=tuple((cell, (number,)) for cell in sorted(found)),
        detours=detours if any(detours) else (),
        obstructed=tuple((event.time, event.cell) for event in own if event.kind == "obstructed" and event.cell is not None),
    )


def takeovers_of(scenario: Scenario, logs: list[RobotLog]) -> int:
    """Count how often a robot began with the part of one that had died."""
    brief = scenario.brief
    numbers = range(1, len(logs) + 1)
    robots = tuple(zip(numbers, scenario.starts, scenario.rates, scenario.widths, strict=True))
    parts = parts_of(brief.course, brief.method, robots)
    deaths = [next((time for time, state in log.states if state == "dead"), inf) for log in logs]
    count = 0
    for number, log in zip(numbers, logs, strict=True):
        whose = [next(part.robot for part in parts if part.bits >> cell & 1) for cell in log.cells.tolist()]
        for before, other, time in zip([number, *whose], whose, log.times.tolist(), strict=False):
            count += other not in (before, number) and deaths[other - 1] < time
    return count
