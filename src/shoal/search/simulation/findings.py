"""Findings of all robots, merged into one map with a confidence for each cell."""

from __future__ import annotations

from math import exp, log

from shoal.core.dataclass import dataclass
from shoal.search.simulation.scenario import Scenario

_PRIOR = 0.01  # prior fraction of cells that contain a target
_LEAST, _MOST = 1e-3, 1 - 1e-3  # maximum reliability of a sensor, because robots can lie


@dataclass(frozen=True, slots=True)
class Finding:
    """A cell in which some robot has found something.

    Parameters
    ----------
    cell : int
        Tour index of the cell.
    found_by, missed_by : tuple of int
        The robots that found something in the cell, and the robots that searched it and found nothing.
    confidence : float
        Probability that the cell contains a target. The probability follows from the sensors' detection rate and false-alarm rate,
        and from a prior probability of 0.01.
    """

    cell: int
    found_by: tuple[int, ...]
    missed_by: tuple[int, ...]
    confidence: float


def merge_findings(scenario: Scenario, reports: dict[int, set[int]], searched: dict[int, int]) -> tuple[Finding, ...]:
    """Merge the robots' reports into one finding per cell.

    Parameters
    ----------
    scenario : Scenario
        The scenario with the sensors' rates.
    reports : dict of int to set of int
        For each cell, the robots that found something in the cell.
    searched : dict of int to int
        For each robot, the cells that it reports as searched, as a bitset.
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
