"""How far robots get along a tour in a given time: what bisection over the makespan asks for.

Robots lie round the tour at ``starts``, rising numbers of cells below n. ``ahead`` holds what it costs to search the cells before
each one, four times round; ``rates`` are what each robot can pay in a unit of time, ``gains`` how many times as much it searches
for that as one that sees a cell; ways cost all the same. ``far`` holds how far it is from each robot's start to each cell; without
rows, ways are straight. A pass goes once round the tour from the first robot on and gives each robot as many cells as it can search
in the time; ``borders`` gets where each one's cells begin.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import kernel


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
def shift_pass(ahead, starts, rates, gains, n, time, first, borders):
    """One pass in which each robot goes along the tour to the beginning of its cells, either way, and searches them forwards."""
    m = starts.shape[0]
    here = first
    for i in range(m):
        borders[i] = here
        at = starts[i] + n
        here = furthest(ahead, here, (time * rates[i] - between(ahead, at, here)) * gains[i])
        if here >= first + n:
            borders[i + 1 :] = first + n
            return True
    borders[m] = here
    return False


@kernel
def flown(points, places, robot, cell):
    total = 0.0
    for k in range(points.shape[1]):
        gap = places[robot, k] - points[cell, k]
        total += gap * gap
    return np.sqrt(total)


@kernel
def away(points, places, far, robot, cell):
    """Return how far it is from a robot's start to a cell."""
    if far.shape[0] > 0:
        return far[robot, cell]
    return flown(points, places, robot, cell)


@kernel
def back(points, far, robot, one, other):
    """Return what it costs, beyond a step to a neighbour, to come from a cell back to another one, which is beside the start."""
    if far.shape[0] > 0:
        return max(far[robot, one] - 1.0, 0.0)
    return max(flown(points, points, one, other) - 1.0, 0.0)


@kernel
def both_ways(ahead, points, far, robot, at, low, budget, gain):
    """Return how far a robot gets that searches from its start ``at`` back to ``low``, too; less than ``at`` if it cannot."""
    n = points.shape[0]
    budget = budget * gain
    behind = ahead[at] - ahead[low]
    first = furthest(ahead, at, budget)  # if it comes back for what lies behind
    while first > at + 1:
        if ahead[first] - ahead[at + 1] + 1.0 + gain * back(points, far, robot, (first - 1) % n, (at - 1) % n) + behind <= budget:
            break
        first -= 1
    if first <= at + 1 or behind == 0:
        first = at + 1 if behind + 1.0 <= budget else at - 1
    rest = budget - (behind + 1.0) - gain * back(points, far, robot, low % n, (at + 1) % n)  # if it goes back first
    return max(first, furthest(ahead, at, rest + 1.0)) if rest >= 0 else first


@kernel
def two_way_pass(ahead, points, far, starts, rates, gains, n, time, first, borders):
    """One pass in which each robot searches what lies behind and what lies ahead of it, the shorter part first and coming back."""
    m = starts.shape[0]
    here = first
    for i in range(m):
        borders[i] = here
        at, budget = starts[i] + n, time * rates[i]
        if here >= at:  # the one before has searched as far as this one's start, or further
            leg = far[i, here % n] if far.shape[0] > 0 else flown(points, points, at % n, here % n)
            here = furthest(ahead, here, (budget - leg) * gains[i])
        else:
            here = both_ways(ahead, points, far, i, at, here, budget, gains[i])
            if here < at:
                return False
        if here >= first + n:
            borders[i + 1 :] = first + n
            return True
    borders[m] = here
    return False


@kernel
def best_start(kind, ahead, points, far, starts, rates, gains, n, time, stride, borders):
    """Return whether a pass from some first border succeeds in the time; ``borders`` then says how."""
    reach = 0
    while reach < n and ahead[starts[0] + n] - ahead[starts[0] + n - reach] <= time * rates[0] * gains[0]:
        reach += 1
    low, high = -reach, (reach if kind == 0 else 0)
    offset = 0
    while offset <= max(high, -low):
        for sign in (1, -1):
            place = sign * offset
            if (offset == 0 and sign < 0) or place < low or place > high:
                continue
            first = starts[0] + n + place
            if first < 0 or first + n >= ahead.shape[0] - 1:
                continue
            done = (
                shift_pass(ahead, starts, rates, gains, n, time, first, borders)
                if kind == 0
                else two_way_pass(ahead, points, far, starts, rates, gains, n, time, first, borders)
            )
            if done:
                return True
        offset += stride
    return False


@kernel
def hop_pass(ahead, points, places, far, rates, gains, time, first, turn, borders):
    """One pass in which each robot goes to the beginning of its cells; robot ``turn`` takes those from ``first`` on."""
    m, n = places.shape[0], points.shape[0]
    here = first
    for i in range(m):
        borders[i] = here
        robot = (i + turn) % m
        if here < first + n:
            budget = time * rates[robot] - away(points, places, far, robot, here % n)
            here = furthest(ahead, here, budget * gains[robot])
    borders[m] = here
    return here >= first + n


@kernel
def hop_costs(ahead, points, places, far, rates, gains, firsts, latest):
    """Write when all is searched if the tour is cut into arcs of equal times and each robot goes straight to its arc.

    One row for each of ``firsts``, where the first arc begins, one column a turn: which robot takes it. The order is kept.
    """
    m, n = places.shape[0], points.shape[0]
    powers = rates * gains
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
