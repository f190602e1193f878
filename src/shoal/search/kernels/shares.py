"""How far robots get along a tour in a given time: what bisection over the makespan asks for.

A pass goes once round the tour from the first robot on and gives each robot as many cells as it can search in the time; ``borders``
gets where each one's cells begin.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import kernel


class TourArrays(NamedTuple):
    """A tour with its costs.

    Parameters
    ----------
    ahead : ndarray of float64, shape (4 N + 1,)
        What it costs to search the cells before each one, four times round.
    points : ndarray of float64, shape (N, d)
        Where a robot stands in each cell, in sides of a cell.
    """

    ahead: NDArray[np.float64]
    points: NDArray[np.float64]


class Team(NamedTuple):
    """Robots in the order of their starts.

    Parameters
    ----------
    starts : ndarray of int64, shape (m,)
        Numbers of cells on the tour, rising.
    rates : ndarray of float64, shape (m,)
        How fast each moves.
    places : ndarray of float64, shape (m, d)
        Where each is, as `TourArrays.points`.
    gains : ndarray of float64, shape (m,)
        How many times as fast each searches as one that sees a cell and moves like it.
    far : ndarray of float64, shape (m, N) or (0, 0)
        How far it is from each start to each cell; empty where ways are straight.
    """

    starts: NDArray[np.int64]
    rates: NDArray[np.float64]
    places: NDArray[np.float64]
    gains: NDArray[np.float64]
    far: NDArray[np.float64]


@kernel
def furthest(ahead, first, budget):
    """Return the largest number b, first or more, such that the cells first .. b - 1 can be searched for the budget."""
    if budget < 1.0:
        return first
    return max(np.searchsorted(ahead, ahead[first + 1] + budget - 1.0 + 1e-9, side="right") - 1, first + 1)


@kernel
def between(ahead, one, other):
    """Return what it costs to go from one number to another, either way round as they come."""
    return abs(ahead[other] - ahead[one])


@kernel
def shift_pass(tour, team, time, first, borders):
    """One pass in which each robot goes along the tour to the beginning of its cells, either way, and searches them forwards."""
    m, n, ahead = team.starts.shape[0], tour.points.shape[0], tour.ahead
    here = first
    for i in range(m):
        borders[i] = here
        at = team.starts[i] + n
        here = furthest(ahead, here, (time * team.rates[i] - between(ahead, at, here)) * team.gains[i])
        if here >= first + n:
            borders[i + 1 :] = first + n
            return True
    borders[m] = here
    return False


@kernel
def flown(points, places, robot, cell):
    """Return the straight distance from one of some places to a cell."""
    total = 0.0
    for k in range(points.shape[1]):
        gap = places[robot, k] - points[cell, k]
        total += gap * gap
    return np.sqrt(total)


@kernel
def away(tour, team, robot, cell):
    """Return how far it is from a robot's start to a cell."""
    if team.far.shape[0] > 0:
        return team.far[robot, cell]
    return flown(tour.points, team.places, robot, cell)


@kernel
def back(tour, team, robot, one, other):
    """Return what it costs, beyond a step to a neighbour, to come from a cell back to another one, which is beside the start."""
    if team.far.shape[0] > 0:
        return max(team.far[robot, one] - 1.0, 0.0)
    return max(flown(tour.points, tour.points, one, other) - 1.0, 0.0)


@kernel
def both_ways(tour, team, robot, at, low, budget):
    """Return how far a robot gets that searches from its start ``at`` back to ``low``, too; less than ``at`` if it cannot."""
    n, ahead, gain = tour.points.shape[0], tour.ahead, team.gains[robot]
    budget = budget * gain
    behind = ahead[at] - ahead[low]
    first = furthest(ahead, at, budget)  # if it comes back for what lies behind
    while first > at + 1:
        if ahead[first] - ahead[at + 1] + 1.0 + gain * back(tour, team, robot, (first - 1) % n, (at - 1) % n) + behind <= budget:
            break
        first -= 1
    if first <= at + 1 or behind == 0:
        first = at + 1 if behind + 1.0 <= budget else at - 1
    rest = budget - (behind + 1.0) - gain * back(tour, team, robot, low % n, (at + 1) % n)  # if it goes back first
    return max(first, furthest(ahead, at, rest + 1.0)) if rest >= 0 else first


@kernel
def two_way_pass(tour, team, time, first, borders):
    """One pass in which each robot searches what lies behind and what lies ahead of it, the shorter part first and coming back."""
    m, n = team.starts.shape[0], tour.points.shape[0]
    here = first
    for i in range(m):
        borders[i] = here
        at, budget = team.starts[i] + n, time * team.rates[i]
        if here >= at:  # the one before has searched as far as this one's start, or further
            leg = team.far[i, here % n] if team.far.shape[0] > 0 else flown(tour.points, tour.points, at % n, here % n)
            here = furthest(tour.ahead, here, (budget - leg) * team.gains[i])
        else:
            here = both_ways(tour, team, i, at, here, budget)
            if here < at:
                return False
        if here >= first + n:
            borders[i + 1 :] = first + n
            return True
    borders[m] = here
    return False


@kernel
def best_start(two_ways, tour, team, time, stride, borders):
    """Return whether a pass from some first border succeeds in the time; ``borders`` then says how."""
    reach, n, ahead, start = 0, tour.points.shape[0], tour.ahead, team.starts[0]
    while reach < n and ahead[start + n] - ahead[start + n - reach] <= time * team.rates[0] * team.gains[0]:
        reach += 1
    low, high = -reach, (0 if two_ways else reach)
    offset = 0
    while offset <= max(high, -low):
        for sign in (1, -1):
            place = sign * offset
            if (offset == 0 and sign < 0) or place < low or place > high:
                continue
            first = start + n + place
            if first < 0 or first + n >= ahead.shape[0] - 1:
                continue
            done = two_way_pass(tour, team, time, first, borders) if two_ways else shift_pass(tour, team, time, first, borders)
            if done:
                return True
        offset += stride
    return False


@kernel
def hop_pass(tour, team, time, first, turn, borders):
    """One pass in which each robot goes to the beginning of its cells; robot ``turn`` takes those from ``first`` on."""
    m, n = team.places.shape[0], tour.points.shape[0]
    here = first
    for i in range(m):
        borders[i] = here
        robot = (i + turn) % m
        if here < first + n:
            budget = time * team.rates[robot] - away(tour, team, robot, here % n)
            here = furthest(tour.ahead, here, budget * team.gains[robot])
    borders[m] = here
    return here >= first + n


@kernel
def hop_costs(tour, team, firsts, latest):
    """Write when all is searched if the tour is cut into arcs of equal times and each robot goes straight to its arc.

    One row for each of ``firsts``, where the first arc begins, one column a turn: which robot takes it. The order is kept.
    """
    # Unpacked for the inner loop: a tuple that is passed on there counts its references, which takes longer than all the rest.
    ahead, points, places, rates, far = tour.ahead, tour.points, team.places, team.rates, team.far
    m, n = places.shape[0], points.shape[0]
    powers = rates * team.gains
    whole, power, straight = ahead[n], powers.sum(), far.shape[0] == 0
    best = np.inf
    alike = powers.max() == powers.min()
    cells = np.zeros(m, dtype=np.int64)
    for row in range(firsts.shape[0]):
        for turn in range(m):
            worst, level = 0.0, ahead[firsts[row]]
            for i in range(m):
                robot = (i + turn) % m
                if turn == 0 or not alike:  # else all turns have the same arcs
                    cells[i] = np.searchsorted(ahead, level + 1e-9, side="right") - 1
                way = flown(points, places, robot, cells[i] % n) if straight else far[robot, cells[i] % n]
                worst = max(worst, way / rates[robot] + whole / power)
                if worst > 1.5 * best and turn > 0:  # bisection will not make that the best
                    worst = np.inf
                    break
                level += whole * powers[robot] / power
            latest[row, turn] = worst
            best = min(best, worst)
