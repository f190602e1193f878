"""What robots do with a plan: what it says if all goes well, what a simulation makes of it, or what processes report."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shoal.search.allocation.plan import SearchPlan
from shoal.search.simulation.scenario import Scenario
from shoal.search.simulation.world import World

if TYPE_CHECKING:
    pass

_HELLO, _BEAT = 0.3, 0.05  # seconds that live robots listen, and between their beacons, at the least
_STATES = {kind: kind for kind in ("listening", "searching", "waiting", "complete")} | {
    "killed": "dead",
    "stopped": "dead",
    "failed": "dead",
}
_HORIZON = 60.0  # times the way of one robot alone


@dataclass(frozen=True, eq=False)
class RobotLog:
    """What one robot did.

    Parameters
    ----------
    cells : ndarray of int64, shape (k,)
        The cells in which it stopped to search them, and with a wider footprint those around, as numbers on the tour.
    times : ndarray of float64, shape (k,)
        When it had searched each, in the time of a cell.
    states : tuple of (float, str)
        When it began to be "listening", "searching", "waiting", "complete", "paused" or "dead".
    found : tuple of (int, tuple of int)
        What it knew at the end: cells, and the robots that have found something there.
    detours : tuple of tuple of int
        Cells that it passed on the way to each that it searched, where robots go from cell to cell; else empty.
    obstructed : tuple of (float, int)
        When it came upon which obstacle.
    """

    cells: NDArray[np.int64]
    times: NDArray[np.float64]
    states: tuple[tuple[float, str], ...]
    found: tuple[tuple[int, tuple[int, ...]], ...]
    detours: tuple[tuple[int, ...], ...] = ()
    obstructed: tuple[tuple[float, int], ...] = ()

    @property
    def status(self) -> str:
        """What it was at the end."""
        return self.states[-1][1] if self.states else "listening"


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
