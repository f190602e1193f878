"""Findings of all robots, merged to one finding with a confidence for each cell."""

from __future__ import annotations

from math import exp, log

from shoal.core.dataclass import dataclass
from shoal.search.simulation.scenario import Scenario

_PRIOR = 0.01  # prior fraction of cells that contain a target
_LEAST, _MOST = 1e-3, 1 - 1e-3  # limits of a sensor's rates: no sensor counts as fully reliable, because robots can lie


@dataclass(frozen=True, slots=True)
class Finding:
    """A cell in which at least one robot has found something.

    Parameters
    ----------
    cell : int
        Tour index of the cell.
    found_by, missed_by : tuple of int
        Numbers of the robots that found something in the cell, and of the robots that searched the cell and found nothing.
    confidence : float
        Probability that the cell contains a target. The confidence follows from the sensors' detection rate and false-alarm rate,
        and from a prior probability of 0.01.
    """

    cell: int
    found_by: tuple[int, ...]
    missed_by: tuple[int, ...]
    confidence: float


def merge_findings(scenario: Scenario, reports: dict[int, set[int]], searched: dict[int, int]) -> tuple[Finding, ...]:
    """Merge the reports of all robots to one finding for each cell in which a robot found something.

    Parameters
    ----------
    scenario : Scenario
        The scenario, which gives the detection rate and the false-alarm rate of the sensors.
    reports : dict of int to set of int
        Numbers of the robots that found something in a cell, by the tour index of the cell.
    searched : dict of int to int
        Bitset of the cells that each robot reports as searched, by the number of the robot.
    """
    hit = min(max(scenario.detection, _LEAST), _MOST)
    alarm = min(max(scenario.false_alarm, _LEAST), _MOST)
    found = []
    for cell, witnesses in sorted(reports.items()):
        missed = tuple(sorted(robot for robot, bits in searched.items() if bits >> cell & 1 and robot not in witnesses))
        odds = log(_PRIOR / (1 - _PRIOR)) + len(witnesses) * log(hit / alarm) + len(missed) * log((1 - hit) / (1 - alarm))
        found.append(Finding(cell, tuple(sorted(witnesses)), missed, _chance(odds)))
    return tuple(found)


def _chance(odds: float) -> float:
    return 1 / (1 + exp(-odds)) if odds > -700 else 0.0
