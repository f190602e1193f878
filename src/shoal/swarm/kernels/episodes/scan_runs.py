"""How many equal commands to send before the next scan."""

from __future__ import annotations

from typing import NamedTuple

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.prediction.expected_gain import ExpectedGain, best_length, gains_of_runs
from shoal.swarm.kernels.prediction.lookahead import Lookahead, explore, write_plan
from shoal.swarm.kernels.search.frontier_search import nearest

EQUAL, DOUBLING, HYPER, ADAPTIVE, GIVEN = 0, 1, 2, 3, 4
_LAST_DOUBLING, _LAST_HYPER = 40, 12  # runs longer than any map are long enough


class Scanning(NamedTuple):
    """When to scan."""

    kind: int  # EQUAL, DOUBLING, HYPER, ADAPTIVE, or GIVEN: as the log says
    step: int  # of EQUAL


class ScanPlanner(NamedTuple):
    """What an adaptive policy knows and works in.

    Kernels take it as an argument that is None for all others: what only it needs, as much as all the rest, is not compiled then.
    """

    gain: ExpectedGain
    lookahead: Lookahead


@in_place_kernel
def interval(kind, step, streak):
    """Return the length of a run after ``streak`` others in the same direction: scans lie at k, 2k, ..., 1, 2, 4, ... or i^i."""
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
    """Return how many equal commands a plan has from ``at`` on."""
    end = at + 1
    while end < length and plan[end] == plan[at]:
        end += 1
    return end - at


@in_place_kernel
def decide_adaptive(field, rule, mapping, search, scan_planner):
    """Plan a walk through known cells and a last run; return (length of the plan, steps of its last run, 0 if not yet known).

    The run, or the walk and one more command, that is expected to classify most cells for its cost; the path to the nearest
    frontier cell if that is better. A coverage has nothing to learn: the path alone, and no scan.
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
    if rate * (scan + 2 * move) < 1:  # else no path is better: a straight one has been looked at
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
    """Return the steps of the last stretch of an adaptive plan: further than planned if that classifies more for its cost."""
    steps = stretch(plan, at, length)
    if mapping:
        gains_of_runs(field, scan_planner.gain, plan[at])
        steps = best_length(scan_planner.gain, plan[at], steps)[0]
    return steps
