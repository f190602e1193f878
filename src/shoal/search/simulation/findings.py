"""What was found: one map for all robots, with how sure it is."""

from __future__ import annotations

from math import exp, log

from shoal.core.dataclass import dataclass
from shoal.search.simulation.scenario import Scenario

_PRIOR = 0.01  # share of cells that hold something, before anybody has looked
_LEAST, _MOST = 1e-3, 1 - 1e-3  # no sensor is taken to be surer than that: robots can lie


@dataclass(frozen=True, slots=True)
class Finding:
    """A cell in which some robot has found something.

    Parameters
    ----------
    cell : int
        Its number on the tour.
    found_by, missed_by : tuple of int
        The robots that have found something there, and those that have searched the cell and have not.
    confidence : float
        Probability that something is there, given what sensors are said to detect and to mistake, and that one cell in a hundred
        holds something.
    """

    cell: int
    found_by: tuple[int, ...]
    missed_by: tuple[int, ...]
    confidence: float


def merge_findings(scenario: Scenario, reports: dict[int, set[int]], searched: dict[int, int]) -> tuple[Finding, ...]:
    """Merge what robots have reported, one entry a cell.

    Parameters
    ----------
    scenario : Scenario
        For the sensors.
    reports : dict of int to set of int
        By cell, the robots that have found something there.
    searched : dict of int to int
        By robot, the cells that it says it has searched, as bits.
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
