"""The progress of robots along a tour in a given time, for a bisection over the makespan.

A pass goes once around the tour from the first robot on. It gives each robot as many cells as it can search in the time.
``borders`` receives the first cell of each robot.
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
        Cumulative cost of searching the cells before each one, over four rounds.
    points : ndarray of float64, shape (N, d)
        Viewpoint of each cell in cell sides.
    """

    ahead: NDArray[np.float64]
    points: NDArray[np.float64]


class Team(NamedTuple):
    """Robots in the order of their starts.

    Parameters
    ----------
    starts : ndarray of int64, shape (m,)
        Tour indices of the start cells, increasing.
    rates : ndarray of float64, shape (m,)
        Speed of each robot.
    places : ndarray of float64, shape (m, d)
        Position of each robot in the units of `TourArrays.points`.
    gains : ndarray of float64, shape (m,)
        Search rate of each robot relative to a robot of equal speed with a footprint of one cell.
    far : ndarray of float64, shape (m, N) or (0, 0)
        Distance from each start to each cell; empty if paths are straight.
    """

    starts: NDArray[np.int64]
    rates: NDArray[np.float64]
    places: NDArray[np.float64]
    gains: NDArray[np.float64]
    far: NDArray[np.float64]


@kernel
def furthest(ahead, first, budget):
    """Return the largest number b, at least first, such that the budget suffices for searching the cells first .. b - 1."""
    if budget < 1.0:
        return first
    return max(np.searchsorted(ahead, ahead[first + 1] + budget - 1.0 + 1e-9, side="right") - 1, first + 1)


@kernel
def between(ahead, one, other):
    """Return the cost of moving along the tour from one cell number to another, in either direction."""
    return abs(ahead[other] - ahead[one])


@kernel
def shift_pass(tour, team, time, first, borders):
    """One pass in which each robot moves along the tour, in either direction, to its first cell and then searches forwards."""
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
    """Return the straight distance from one of several positions to a cell."""
    total = 0.0
    for k in range(points.shape[1]):
        gap = places[robot, k] - points[cell, k]
        total += gap * gap
    return np.sqrt(total)


@kernel
def away(tour, team, robot, cell):
    """Return the distance from a robot's start to a cell."""
    if team.far.shape[0] > 0:
        return team.far[robot, cell]
    return flown(tour.points, team.places, robot, cell)


@kernel
def back(tour, team, robot, one, other):
    """Return how much more than a step to a neighbour it costs to return from a cell to another one, which is beside the start."""
    if team.far.shape[0] > 0:
        return max(team.far[robot, one] - 1.0, 0.0)
    return max(flown(tour.points, tour.points, one, other) - 1.0, 0.0)


@kernel
def both_ways(tour, team, robot, at, low, budget):
    """Return how far a robot gets that also searches back from its start ``at`` to ``low``; less than ``at`` if it cannot."""
    n, ahead, gain = tour.points.shape[0], tour.ahead, team.gains[robot]
    budget = budget * gain
    behind = ahead[at] - ahead[low]
    first = furthest(ahead, at, budget)  # the end if the robot searches the cells ahead first
    while first > at + 1:
        if ahead[first] - ahead[at + 1] + 1.0 + gain * back(tour, team, robot, (first - 1) % n, (at - 1) % n) + behind <= budget:
            break
        first -= 1
    if first <= at + 1 or behind == 0:
        first = at + 1 if behind + 1.0 <= budget else at - 1
    rest = budget - (behind + 1.0) - gain * back(tour, team, robot, low % n, (at + 1) % n)  # for the cells behind first
    return max(first, furthest(ahead, at, rest + 1.0)) if rest >= 0 else first


@kernel
def two_way_pass(tour, team, time, first, borders):
    """One pass in which each robot searches the cells behind it and ahead of it, in the order in which it gets further."""
    m, n = team.starts.shape[0], tour.points.shape[0]
    here = first
    for i in range(m):
        borders[i] = here
        at, budget = team.starts[i] + n, time * team.rates[i]
        if here >= at:  # the previous robot has searched as far as this one's start, or further
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
    """Return whether a pass with any of the tried first borders succeeds in the time. ``borders`` then contains the result."""
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
    """One pass in which each robot goes to the beginning of its cells. Robot ``turn`` gets the cells from ``first`` on."""
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
    """Write the completion time if the tour is cut into arcs of equal times and each robot goes straight to its arc.

    There is one row for each of ``firsts``, the beginning of the first arc, and one column per turn, the robot that gets this arc.
    The robots keep their order around the tour.
    """
    # Unpacked for the inner loop: passing the tuple counts references, which would take longer than all the rest.
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
                if turn == 0 or not alike:  # otherwise all turns have the same arcs
                    cells[i] = np.searchsorted(ahead, level + 1e-9, side="right") - 1
                way = flown(points, places, robot, cells[i] % n) if straight else far[robot, cells[i] % n]
                worst = max(worst, way / rates[robot] + whole / power)
                if worst > 1.5 * best and turn > 0:  # a bisection could not make this turn the best
                    worst = np.inf
                    break
                level += whole * powers[robot] / power
            latest[row, turn] = worst
            best = min(best, worst)
