"""Scan rules: the number of equal commands before the next scan."""

from __future__ import annotations

from typing import NamedTuple

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.planning.adaptive_scans import (
    ExpectedGain,
    Lookahead,
    best_length,
    explore,
    gains_of_runs,
    write_plan,
)
from shoal.swarm.kernels.search.frontier_search import nearest

EQUAL, DOUBLING, HYPER, ADAPTIVE, GIVEN = 0, 1, 2, 3, 4
_LAST_DOUBLING, _LAST_HYPER = 40, 12  # number of runs after which the next run is longer than any map is wide


class Scanning(NamedTuple):
    """The scan rule of an episode."""

    kind: int  # EQUAL, DOUBLING, HYPER, ADAPTIVE, or GIVEN (the scans of a stored episode)
    step: int  # for EQUAL: number of commands between two scans


class ScanPlanner(NamedTuple):
    """Knowledge and working memory of an adaptive policy.

    Policies that are not adaptive pass None instead of a ``ScanPlanner``. With None, Numba does not compile the kernels of the
    adaptive policy, which are as large as all other kernels of an episode together.
    """

    gain: ExpectedGain
    lookahead: Lookahead


@in_place_kernel
def interval(kind, step, streak):
    """Return the number of commands in a run that follows ``streak`` runs in the same direction.

    In one direction, the rule EQUAL with the step k scans after k, 2k, 3k, ... commands. The rule DOUBLING scans after 1, 2, 4, 8,
    ... commands. The rule HYPER scans after 1, 4, 27, ..., i^i commands.
    """
    if kind == EQUAL:
        return step
    if streak == 0:
        return 1
    if kind == DOUBLING:
        return 1 << (min(streak, _LAST_DOUBLING) - 1)
    i = min(streak, _LAST_HYPER)
    return (i + 1) ** (i + 1) - i**i


@in_place_kernel
def stretch(plan, at, length):
    """Return how many consecutive commands of a plan, beginning at index ``at``, are equal to the command at index ``at``."""
    end = at + 1
    while end < length and plan[end] == plan[at]:
        end += 1
    return end - at


@in_place_kernel
def decide_adaptive(field, rule, mapping, search, scan_planner):
    """Plan a path through known cells and a last run of equal commands into unknown cells.

    Return the length of the plan and the number of commands in its last run. The number of commands in the last run is 0 if the
    length of the last run is not yet known.

    A candidate is a run of equal commands, or a path followed by one more command. The plan is the candidate with the highest
    expected number of classified cells per cost. If the path to the nearest frontier cell classifies more cells per cost than every
    candidate, the plan is the path to the nearest frontier cell. In coverage, no cell is unknown, so the plan is always the path to
    the nearest frontier cell.
    """
    if not mapping:
        return nearest(field, search, field.occupied), 0
    gain, plan = scan_planner.gain, search.plan
    scan, move = gain.prices.scan, gain.prices.move
    command, steps, rate = -1, 0, 0.0
    for direction in range(gain.gains.shape[0]):
        gains_of_runs(field, gain, direction)
        length, reached = best_length(gain, direction, 1)
        if reached > rate:
            command, steps, rate = direction, length, reached
    length = 0
    if rate * (scan + 2 * move) < 1:  # for a higher rate, the path to the nearest frontier cell cannot be better
        length = nearest(field, search, field.occupied)
        if length == 0:
            return 0, 0
        if rate * (scan + length * move) < 1:
            command, rate = -1, 1 / (scan + length * move)
    found = explore(field, rule, scan_planner.lookahead, gain.prices, rate)
    if found > rate:
        return write_plan(scan_planner.lookahead, plan), 0
    if command >= 0:
        plan[0] = command
        return 1, steps
    return length, 0


@in_place_kernel
def last_run(field, mapping, plan, at, length, scan_planner):
    """Return the number of commands in the last run of an adaptive plan.

    The last run becomes longer than planned if more commands classify more cells per cost.
    """
    steps = stretch(plan, at, length)
    if mapping:
        gains_of_runs(field, scan_planner.gain, plan[at])
        steps = best_length(scan_planner.gain, plan[at], steps)[0]
    return steps
