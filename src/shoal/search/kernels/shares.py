"""Shares of a tour in compiled code: cuts that balance the times of robots."""

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
        For each cell of four rounds of the tour, the cost of searching all cells before the cell.
    points : ndarray of float64, shape (N, d)
        Viewpoint of each cell, in units of the cell side.
    """

    ahead: NDArray[np.float64]
    points: NDArray[np.float64]


class Team(NamedTuple):
    """Robots in the order of their start cells on the tour.

    Parameters
    ----------
    starts : ndarray of int64, shape (m,)
        Tour indices of the start cells, in increasing order.
    rates : ndarray of float64, shape (m,)
        Speed of each robot.
    places : ndarray of float64, shape (m, d)
        Position of each robot, in the units of `TourArrays.points`.
    gains : ndarray of float64, shape (m,)
        Search rate of each robot, divided by the search rate of an equally fast robot with a
        footprint of one cell.
    far : ndarray of float64, shape (m, N) or (0, 0)
        Distance from the start of each robot to each cell. If paths are straight, the array is
        empty.
    """

    starts: NDArray[np.int64]
    rates: NDArray[np.float64]
    places: NDArray[np.float64]
    gains: NDArray[np.float64]
    far: NDArray[np.float64]


@kernel
def furthest(ahead, first, budget):
    """Return the largest number b >= ``first`` for which ``budget`` is enough to search the cells
    from ``first`` to b - 1.
    """
    if budget < 1.0:
        return first
    return max(
        np.searchsorted(ahead, ahead[first + 1] + budget - 1.0 + 1e-9, side="right") - 1, first + 1
    )


@kernel
def between(ahead, source, target):
    """Return the cost of the path along the tour from one cell number to another cell number, in
    either direction.
    """
    return abs(ahead[target] - ahead[source])


@kernel
def shift_pass(tour, team, time, first, borders):
    """Make a pass in which each robot moves along the tour to its first cell, in either direction,
    and then searches forwards.

    Return whether the robots search all cells of the tour in the given time.
    """
    m, n, ahead = team.starts.shape[0], tour.points.shape[0], tour.ahead
    begin = first
    for i in range(m):
        borders[i] = begin
        at = team.starts[i] + n
        begin = furthest(
            ahead, begin, (time * team.rates[i] - between(ahead, at, begin)) * team.gains[i]
        )
        if begin >= first + n:
            borders[i + 1 :] = first + n
            return True
    borders[m] = begin
    return False


@kernel
def straight_distance(points, places, robot, cell):
    """Return the straight distance from the position of a robot to the viewpoint of a cell."""
    total = 0.0
    for k in range(points.shape[1]):
        gap = places[robot, k] - points[cell, k]
        total += gap * gap
    return np.sqrt(total)


@kernel
def away(tour, team, robot, cell):
    """Return the distance from the start of a robot to a cell."""
    if team.far.shape[0] > 0:
        return team.far[robot, cell]
    return straight_distance(tour.points, team.places, robot, cell)


@kernel
def back(tour, team, robot, source, target):
    """Return the additional cost of a path from the cell ``source`` to the cell ``target``,
    compared with a step to a neighbouring cell.

    The cell ``target`` must be beside the start of the robot.
    """
    if team.far.shape[0] > 0:
        return max(team.far[robot, source] - 1.0, 0.0)
    return max(straight_distance(tour.points, tour.points, source, target) - 1.0, 0.0)


@kernel
def both_ways(tour, team, robot, at, low, budget):
    """Return the first cell ahead that a robot does not reach if it also searches backwards from
    its start ``at`` to ``low``.

    The result is less than ``at`` if the robot cannot search the cells from ``low`` to ``at``
    within its budget.
    """
    n, ahead, gain = tour.points.shape[0], tour.ahead, team.gains[robot]
    budget = budget * gain
    behind = ahead[at] - ahead[low]
    # the end of the robot's part if the robot searches the cells ahead first
    first = furthest(ahead, at, budget)
    while first > at + 1:
        if (
            ahead[first]
            - ahead[at + 1]
            + 1.0
            + gain * back(tour, team, robot, (first - 1) % n, (at - 1) % n)
            + behind
            <= budget
        ):
            break
        first -= 1
    if first <= at + 1 or behind == 0:
        first = at + 1 if behind + 1.0 <= budget else at - 1
    # if the robot first searches behind
    budget_left = budget - (behind + 1.0) - gain * back(tour, team, robot, low % n, (at + 1) % n)
    return max(first, furthest(ahead, at, budget_left + 1.0)) if budget_left >= 0 else first


@kernel
def two_way_pass(tour, team, time, first, borders):
    """Make a pass in which each robot searches cells behind and ahead of its start, in the order in
    which the robot gets further.

    Return whether the robots search all cells of the tour in the given time.
    """
    m, n = team.starts.shape[0], tour.points.shape[0]
    begin = first
    for i in range(m):
        borders[i] = begin
        at, budget = team.starts[i] + n, time * team.rates[i]
        if begin >= at:  # the part of the previous robot reaches the start of robot i, or further
            leg = (
                team.far[i, begin % n]
                if team.far.shape[0] > 0
                else straight_distance(tour.points, tour.points, at % n, begin % n)
            )
            begin = furthest(tour.ahead, begin, (budget - leg) * team.gains[i])
        else:
            begin = both_ways(tour, team, i, at, begin, budget)
            if begin < at:
                return False
        if begin >= first + n:
            borders[i + 1 :] = first + n
            return True
    borders[m] = begin
    return False


@kernel
def best_start(two_ways, tour, team, time, stride, borders):
    """Make passes with different first borders until a pass succeeds in the given time. Return
    whether a pass has succeeded.

    A pass succeeds if the robots search all cells of the tour. After a success, ``borders``
    contains the first cell of each robot.
    """
    reach, n, ahead, start = 0, tour.points.shape[0], tour.ahead, team.starts[0]
    while (
        reach < n
        and ahead[start + n] - ahead[start + n - reach] <= time * team.rates[0] * team.gains[0]
    ):
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
            feasible = (
                two_way_pass(tour, team, time, first, borders)
                if two_ways
                else shift_pass(tour, team, time, first, borders)
            )
            if feasible:
                return True
        offset += stride
    return False


@kernel
def hop_pass(tour, team, time, first, turn, borders):
    """Make a pass in which each robot goes to the first of its cells and searches forwards. Return
    whether the pass succeeds.

    The cells of robot ``turn`` begin with the cell ``first``. The pass succeeds if the robots
    search all cells of the tour in the given time.
    """
    m, n = team.places.shape[0], tour.points.shape[0]
    begin = first
    for i in range(m):
        borders[i] = begin
        robot = (i + turn) % m
        if begin < first + n:
            budget = time * team.rates[robot] - away(tour, team, robot, begin % n)
            begin = furthest(tour.ahead, begin, budget * team.gains[robot])
    borders[m] = begin
    return begin >= first + n


@kernel
def hop_costs(tour, team, firsts, latest):
    """Write to ``latest`` the completion time of each cut of the tour into arcs of equal search
    times, one arc for each robot.

    Each robot first takes the shortest path to the beginning of its arc. The first arc of row k
    begins at cell ``firsts[k]``. In column j, robot j gets the first arc, and the other robots
    follow in their order around the tour. An entry may be infinite if a cut takes more than 1.5
    times as long as the best cut before it.
    """
    # The inner loop uses local names: passing the tuple would count references, which takes longer
    # than the rest of the loop.
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
                if turn == 0 or not alike:  # for equal robots, all turns have equal arcs
                    cells[i] = np.searchsorted(ahead, level + 1e-9, side="right") - 1
                travel = (
                    straight_distance(points, places, robot, cells[i] % n)
                    if straight
                    else far[robot, cells[i] % n]
                )
                worst = max(worst, travel / rates[robot] + whole / power)
                # a bisection could not make this turn the best turn
                if worst > 1.5 * best and turn > 0:
                    worst = np.inf
                    break
                level += whole * powers[robot] / power
            latest[row, turn] = worst
            best = min(best, worst)
