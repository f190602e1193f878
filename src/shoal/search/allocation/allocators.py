"""Allocators: rules that assign arcs of a tour to robots. An allocator returns a list of arcs for each robot of a `Team`."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from shoal.core.registry import Registry
from shoal.search.allocation.arcs import Arc, work_time
from shoal.search.allocation.tour_cost import Floats, TourCost
from shoal.search.kernels import shares
from shoal.search.kernels.shares import Team

Indices = NDArray[np.int64]
_HALVINGS = 40
_STRIDES = 96  # maximum number of first borders that are tried
_TRIALS = 8_000  # maximum number of trials: a cut of the tour into equal arcs, and a rotation of the robots
_CANDIDATES = 12  # number of trials whose borders are improved


Allocator = Callable[[TourCost, Team], list[list[Arc]]]
ALLOCATORS: Registry[Allocator] = Registry("allocation", functions=True)


@ALLOCATORS.register("stay")
def stay(tour_cost: TourCost, team: Team) -> list[list[Arc]]:
    """Assign to each robot the cells from its own start to the cell before the next robot's start."""
    gaps = np.diff(np.append(team.starts, team.starts[0] + len(tour_cost)))
    return [[Arc(int(first), int(count))] for first, count in zip(team.starts, gaps, strict=True)]


@ALLOCATORS.register("common-shift")
def common_shift(tour_cost: TourCost, team: Team) -> list[list[Arc]]:
    """Let each robot move at most a distance D along the tour, and then search at most G cells.

    The limits D and G are equal for all robots. The allocator minimizes D + G, and ignores that robots may differ in speed.
    """
    starts = team.starts
    n, m = len(tour_cost), len(starts)
    at = tour_cost.ahead[np.concatenate([starts, starts + n])]
    ways = np.array([(at[k : k + m] - at[:m]).max() for k in range(1, m)])  # the largest sum of k consecutive gaps
    share = tour_cost.whole / m
    counts = np.arange(1, m)

    def gap(shift: float) -> float:
        return max(share, float(((ways - 2 * shift) / counts).max())) if m > 1 else tour_cost.whole

    low, high = 0.0, tour_cost.whole
    for _ in range(100):  # D + G is convex in D
        one, other = low + (high - low) / 3, high - (high - low) / 3
        low, high = (low, other) if one + gap(one) <= other + gap(other) else (one, high)
    shift, span = low, gap(low)
    # The farthest borders that the limits allow: s + D, and G after the previous border.
    rounds = np.concatenate([at[:m] - tour_cost.whole, at]) + shift
    fronts = np.minimum.accumulate(rounds - span * np.arange(3 * m)) + span * np.arange(3 * m)
    borders = np.searchsorted(tour_cost.ahead, fronts[m : 2 * m] + tour_cost.whole + 1e-6, side="right") - 1
    return _arcs_between(np.append(borders, borders[0] + n))


@ALLOCATORS.register("individual-shift")
def individual_shift(tour_cost: TourCost, team: Team) -> list[list[Arc]]:
    """Let each robot move along the tour before it searches, by a distance chosen for this robot.

    The allocator minimizes the time until the last robot finishes.
    """
    return _arcs_between(_bisected(False, tour_cost, team))


@ALLOCATORS.register("two-way")
def two_way(tour_cost: TourCost, team: Team) -> list[list[Arc]]:
    """Let each robot search cells behind its start and cells ahead of its start, in whichever order is cheaper."""
    n = len(tour_cost)
    borders = _bisected(True, tour_cost, team)
    found = []
    for start, low, high in zip(team.starts + n, borders[:-1], borders[1:], strict=True):
        if not low <= start < high:
            found.append([Arc(int(low % n), int(high - low))])
            continue
        back = [Arc(int(start % n), int(start - low + 1), -1), Arc(int((start + 1) % n), int(high - start - 1))]
        forth = [Arc(int(start % n), int(high - start)), Arc(int((start - 1) % n), int(start - low), -1)]
        place = tour_cost.points[start % n]
        found.append(min(back, forth, key=lambda work: work_time(tour_cost, [one for one in work if one.count], place)))
    return found


@ALLOCATORS.register("hop")
def hop(tour_cost: TourCost, team: Team) -> list[list[Arc]]:
    """Let each robot move straight to an arc of the tour, and search this arc.

    A robot that is far from its arc gets a shorter arc. Along the tour, the robots' arcs have the same order as the robots' starts.
    """
    n, m = len(tour_cost), len(team.starts)
    rows = min(4 * _STRIDES, max(8, _TRIALS // m))
    firsts = np.unique(np.linspace(0, min(n, int(2 * n / m)) - 1, rows).astype(np.int64)) if m > 1 else team.starts
    latest = np.empty((len(firsts), m))
    shares.hop_costs(tour_cost.arrays, team, firsts, latest)
    best, borders, chosen = np.inf, np.arange(m + 1), 0
    for number in np.argsort(latest, axis=None, kind="stable")[:_CANDIDATES]:
        row, turn = np.unravel_index(int(number), latest.shape)
        low, high = n / float(_powers(team).sum()), float(min(latest[row, turn], best)) + 1.0
        trial = np.empty(m + 1, dtype=np.int64)
        while best == np.inf:  # with fewer cells than robots, an equal arc is shorter than a cell
            if shares.hop_pass(tour_cost.arrays, team, high, firsts[row], turn, trial):
                best, borders, chosen = high, np.minimum(trial, firsts[row] + n), int(turn)
            high *= 2
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            done = shares.hop_pass(tour_cost.arrays, team, middle, firsts[row], turn, trial)
            if done and middle < best:
                best, borders, chosen = middle, np.minimum(trial, firsts[row] + n), int(turn)
            low, high = (low, middle) if done else (middle, high)
            if high - low < 1e-3:
                break
    arcs = _arcs_between(borders)
    return [arcs[(robot - chosen) % m] for robot in range(m)]


def _arcs_between(borders: Indices) -> list[list[Arc]]:
    n = int(borders[-1] - borders[0])
    return [[Arc(int(low % n), int(high - low))] for low, high in pairwise(borders)]


def _powers(team: Team) -> Floats:
    """Return the search rate of each robot: its speed times the gain from its footprint width."""
    return team.rates * team.gains


def _passed(two_ways: bool, tour_cost: TourCost, team: Team, time: float, borders: Indices) -> bool:
    reach = min(len(tour_cost), int(time * _powers(team)[0]) + 1)
    return bool(shares.best_start(two_ways, tour_cost.arrays, team, time, max(1, reach // _STRIDES), borders))


def _bisected(two_ways: bool, tour_cost: TourCost, team: Team) -> Indices:
    """Return the first cell of each robot's part, followed by the end of the last part; int64, shape (m + 1,).

    The parts minimize the time until the last robot finishes, which the function finds by bisection. The numbers of cells continue
    beyond N - 1 after each round of the tour.
    """
    n, starts = len(tour_cost), team.starts
    best = np.append(starts, starts[0] + n) + n  # the borders that the allocator ``stay`` chooses
    gaps = np.diff(tour_cost.ahead[best]) / _powers(team)
    low, high = n / float(_powers(team).sum()), float(gaps.max())
    trial = np.empty(len(starts) + 1, dtype=np.int64)
    for _ in range(_HALVINGS):
        if high - low < 1e-3:
            break
        middle = (low + high) / 2
        if _passed(two_ways, tour_cost, team, middle, trial):
            best, high = np.minimum(trial, trial[0] + n), middle
        else:
            low = middle
    return best
