"""Conversion of the reports of live robots to the trace of a search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf
from typing import get_args

import numpy as np

from shoal.search.allocation.partition import partition
from shoal.search.protocol.messages import Status
from shoal.search.simulation.live.outcome import LiveEvent
from shoal.search.simulation.live.supervisor import run_live
from shoal.search.simulation.scenario import Scenario
from shoal.search.simulation.trace import RobotLog, SearchTrace, searched_at

_HELLO, _BEAT = 0.3, 0.05  # seconds: minimum listening time of live robots, and minimum interval of their beacons
_STATES = {status: status for status in get_args(Status)} | dict.fromkeys(("killed", "stopped", "failed"), "dead")


def live_trace(scenario: Scenario, *, live: float, key: bytes = b"") -> tuple[Scenario, SearchTrace]:
    """Run a live search, in which a robot of speed 1 searches ``live`` cells per second.

    Live robots listen for at least 0.3 s, and send beacons at least 0.05 s apart. The first result is the scenario with these
    times. The second result is the trace of the search.

    Raises
    ------
    InvalidInputError
        If the scenario contains faults other than crashes and slow robots.
    """
    brief = replace(scenario.brief, hello=max(scenario.brief.hello, _HELLO * live), beat=max(scenario.brief.beat, _BEAT * live))
    scenario = replace(scenario, brief=brief)
    outcome = run_live(scenario, speed=live, key=key)
    logs = [_log_of(number, outcome.events) for number in range(1, len(scenario.starts) + 1)]
    covered_at = float(searched_at(scenario, logs).max())
    return scenario, SearchTrace(
        tuple(logs), covered_at, outcome.declared, outcome.heard, outcome.lost, takeovers_of(scenario, logs), outcome.dropped
    )


def _log_of(number: int, events: Sequence[LiveEvent]) -> RobotLog:
    """Return the log of the robot with a given number, made from its reports."""
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
    """Return the number of times that a robot began to search the part of a dead robot."""
    brief = scenario.brief
    numbers = range(1, len(logs) + 1)
    robots = tuple(zip(numbers, scenario.starts, scenario.rates, scenario.widths, strict=True))
    parts = partition(brief.tour_cost, brief.allocator, robots)
    deaths = [next((time for time, state in log.states if state == "dead"), inf) for log in logs]
    count = 0
    for number, log in zip(numbers, logs, strict=True):
        whose = [next(part.robot for part in parts if part.bits >> cell & 1) for cell in log.cells.tolist()]
        for before, other, time in zip([number, *whose], whose, log.times.tolist(), strict=False):
            count += other not in (before, number) and deaths[other - 1] < time
    return count
