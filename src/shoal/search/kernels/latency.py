"""Local search for the order in which robots search blocks of a tour, so that likely cells come
early.

Let w be the probability of a cell and t the time at which a robot has searched it. The sum of w t
over all cells is the weighted latency of the robots' routes: the expected time until a single target
is found. The problem with one robot is the minimum latency problem, or travelling repairman problem,
which is hard; the moves of this search are those of its literature.

A sequence of cells that a robot searches has a duration T from its first cell to its last, a weight
W and a latency C, counted from the time at which its first cell is searched. For two sequences one
after the other, with a step of length l between them:

    T = T1 + l + T2, W = W1 + W2, C = C1 + C2 + W2 (T1 + l)

In the reverse order, a sequence has the latency W T - C. Each change of routes therefore takes a
few operations, whatever the lengths of the sequences that it moves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel, kernel

_LEAST = 1e-9  # of the present latency: smaller gains may be rounding errors
_OVERTIME = 5.0  # what a cell beyond the limit of a route counts, in cells of latency
_NEARER = 4  # of the blocks near each block, those that are tried after a kick
_FOLLOWING = 20  # blocks that a kick moves at most with a block that comes to follow another
STEP = 1.0  # cells: no step takes less time, because costs and lengths count as at least 1


class Blocks(NamedTuple):
    """Blocks of consecutive cells of a tour, which robots search whole, forwards or backwards.

    Parameters
    ----------
    ends : ndarray of int64, shape (2 B,)
        Tour indices of the first and the last cell of each block: at 2 b and 2 b + 1.
    times : ndarray of float64, shape (B,)
        Time in cells from the search of the first cell until the search of the last cell.
    weights : ndarray of float64, shape (B,)
        Probability of each block.
    latencies : ndarray of float64, shape (B,)
        Sum over the cells of a block of the probability times the time since the first cell.
    near : ndarray of int64, shape (B, k)
        Blocks near each block, or -1.
    likely : ndarray of int64, shape (B,)
        Blocks in the order of their probability over the least time that they take, the largest
        first.
    points : ndarray of float64, shape (N, 3)
        Viewpoint of each cell, in cell sides.
    costs : ndarray of float64, shape (N,)
        Time in cells of the step to each cell from the cell before it on the tour, with its search.
    cells : ndarray of int64, shape (N, 3)
        Layer, row and column of each cell.
    free : ndarray of int64, shape (layers, rows + 1, columns + 1)
        Number of cells above and left of each corner of the grid.
    leaving : float
        Cost in cells of leaving the tour, beyond the way to the next block.
    """

    ends: NDArray[np.int64]
    times: NDArray[np.float64]
    weights: NDArray[np.float64]
    latencies: NDArray[np.float64]
    near: NDArray[np.int64]
    likely: NDArray[np.int64]
    points: NDArray[np.float64]
    costs: NDArray[np.float64]
    cells: NDArray[np.int64]
    free: NDArray[np.int64]
    leaving: float


class Routes(NamedTuple):
    """The routes of m robots, as blocks in the order of the search, and sums along them.

    Parameters
    ----------
    order : ndarray of int64, shape (m, B + 1)
        For each place of a route, 2 b if the robot searches block b forwards, or 2 b + 1 backwards.
    counts : ndarray of int64, shape (m,)
        Number of blocks of each route.
    rates : ndarray of float64, shape (m,)
        Speed of each robot.
    first : ndarray of float64, shape (m, N)
        Time in cells until each robot has searched each cell if it begins there.
    limits : ndarray of float64, shape (m,)
        Longest time of each route in cells.
    route, place : ndarray of int64, shape (B,)
        The robot that searches each block, and the place of the block on its route.
    begins, finishes : ndarray of float64, shape (m, B + 1)
        When the first and the last cell of the block at each place is searched, in cells.
    weights, latencies : ndarray of float64, shape (m, B + 2)
        Sums of the weights and latencies of the blocks before each place.
    steps : ndarray of float64, shape (B,)
        Time in cells from the block before each block.
    awake : ndarray of bool, shape (B,)
        Blocks around which something changed.
    waiting : ndarray of int64, shape (B + 2,)
        A ring of the awake blocks, in the order in which they are tried; at the end, the place of
        the first of them and their number.
    since : ndarray of int64, shape (m,)
        First place of each route at which it differs from the best routes so far.
    moved : ndarray of int64, shape (2 B + 2,)
        Working memory.
    """

    order: NDArray[np.int64]
    counts: NDArray[np.int64]
    rates: NDArray[np.float64]
    first: NDArray[np.float64]
    limits: NDArray[np.float64]
    route: NDArray[np.int64]
    place: NDArray[np.int64]
    begins: NDArray[np.float64]
    finishes: NDArray[np.float64]
    weights: NDArray[np.float64]
    latencies: NDArray[np.float64]
    steps: NDArray[np.float64]
    awake: NDArray[np.bool_]
    waiting: NDArray[np.int64]
    since: NDArray[np.int64]
    moved: NDArray[np.int64]


@in_place_kernel
def _count(free, rows, columns):
    """Return the number of cells in a rectangle of a layer, whose last row and column count."""
    (top, bottom), (left, right) = rows, columns
    above, below = free[top], free[bottom + 1]
    return below[right + 1] - above[right + 1] - below[left] + above[left]


@in_place_kernel
def _is_open(blocks, one, other):
    """Return whether the straight line between two cells of one layer passes only over cells."""
    cells = blocks.cells
    up, row, column = cells[one, 0], cells[one, 1], cells[one, 2]
    if up != cells[other, 0]:
        return True
    down, right = cells[other, 1] - row, cells[other, 2] - column
    rows = min(row, row + down), max(row, row + down)
    columns = min(column, column + right), max(column, column + right)
    free = blocks.free[up]
    if _count(free, rows, columns) == (1 + abs(down)) * (1 + abs(right)):
        return True
    steps = 2 * max(abs(down), abs(right))
    for k in range(1, steps):
        y = row + int(np.floor(down * k / steps + 0.5))
        x = column + int(np.floor(right * k / steps + 0.5))
        if not _count(free, (y, y), (x, x)):
            return False
    return True


@in_place_kernel
def _square_of_distance(blocks, one, other):
    """Return the square of the straight distance of two cells, in cell sides."""
    east = blocks.points[one, 0] - blocks.points[other, 0]
    north = blocks.points[one, 1] - blocks.points[other, 1]
    up = blocks.points[one, 2] - blocks.points[other, 2]
    return east * east + north * north + up * up


@in_place_kernel
def step_time(blocks, one, other):
    """Return the time in cells from the search of one cell to the search of another.

    Where something lies between them, the way counts as longer than any that the search should
    choose.
    """
    n = blocks.costs.shape[0]
    apart = other - one
    if apart == 1 or apart == 1 - n:
        return blocks.costs[other]
    if apart == -1 or apart == n - 1:
        return blocks.costs[one]
    square = _square_of_distance(blocks, one, other)
    if square <= 1.0:
        return 1.0 + blocks.leaving
    way = np.sqrt(square)
    if square > 2.25 and not _is_open(blocks, one, other):
        way = 3.0 * way + np.sqrt(n)
    return way + blocks.leaving


@in_place_kernel
def _begin(blocks, item):
    """Return the cell that a robot searches first in a block."""
    return blocks.ends[item]


@in_place_kernel
def _end(blocks, item):
    """Return the cell that a robot searches last in a block."""
    return blocks.ends[item ^ 1]


@in_place_kernel
def _between(blocks, one, other):
    """Return the time from the last cell of one block to the first cell of the next."""
    return step_time(blocks, _end(blocks, one), _begin(blocks, other))


@in_place_kernel
def _arrival(blocks, routes, r, i, item):
    """Return when robot r has searched the first cell of a block that comes after i others."""
    if i == 0:
        return routes.first[r, _begin(blocks, item)]
    return routes.finishes[r, i - 1] + _between(blocks, routes.order[r, i - 1], item)


@in_place_kernel
def _sum_up(blocks, routes, r, since, until):
    """Compute the sums along a route from a place on. After the place ``until``, each block follows
    the same block as before.
    """
    routes.since[r] = min(routes.since[r], since)
    count, order = routes.counts[r], routes.order[r]
    for i in range(since, min(until + 1, count)):
        before = _end(blocks, order[i - 1]) if i else -1
        first = _begin(blocks, order[i])
        routes.steps[order[i] >> 1] = (
            step_time(blocks, before, first) if i else routes.first[r, first]
        )
    begins, finishes = routes.begins[r], routes.finishes[r]
    weights, latencies = routes.weights[r], routes.latencies[r]
    finish = finishes[since - 1] if since else 0.0
    sum_of_weights, sum_of_latencies = weights[since], latencies[since]
    for i in range(since, count):
        item = order[i]
        block = item >> 1
        begin = finish + routes.steps[block]
        finish = begin + blocks.times[block]
        weight, latency = blocks.weights[block], blocks.latencies[block]
        if item & 1:
            latency = weight * blocks.times[block] - latency
        sum_of_weights += weight
        sum_of_latencies += latency + weight * begin
        begins[i], finishes[i] = begin, finish
        weights[i + 1], latencies[i + 1] = sum_of_weights, sum_of_latencies
        routes.route[block], routes.place[block] = r, i


@in_place_kernel
def _sum_up_between(blocks, routes, r, since, until):
    """Compute the sums along a route whose blocks at the places ``since`` to ``until`` came into
    another order. What follows is only later or earlier.
    """
    count = routes.counts[r]
    if until + 1 >= count:
        _sum_up(blocks, routes, r, since, until)
        return
    begins, finishes = routes.begins[r], routes.finishes[r]
    weights, latencies = routes.weights[r], routes.latencies[r]
    begin, latency, weight = begins[until], latencies[until], weights[until]
    routes.counts[r] = until + 1
    _sum_up(blocks, routes, r, since, until)
    routes.counts[r] = count
    later = begins[until] - begin
    more = latencies[until] - latency - weight * later
    for i in range(until + 1, count):
        begins[i] += later
        finishes[i] += later
        latencies[i + 1] += more + weights[i + 1] * later


@in_place_kernel
def _stretch(routes, r, i, j):
    """Return the duration, the weight and the latency of the blocks at the places i to j."""
    begin = routes.begins[r, i]
    weight = routes.weights[r, j + 1] - routes.weights[r, i]
    latency = routes.latencies[r, j + 1] - routes.latencies[r, i] - weight * begin
    return routes.finishes[r, j] - begin, weight, latency


@in_place_kernel
def _last(routes, r):
    """Return when a robot has searched all its blocks."""
    return routes.finishes[r, routes.counts[r] - 1] if routes.counts[r] else 0.0


@in_place_kernel
def _is_in_time(routes, r, later):
    """Return whether a route keeps its limit if it ends later by a time, or at least ends no
    later.
    """
    return later <= 1e-9 or _last(routes, r) + later <= routes.limits[r]


@in_place_kernel
def _overtime(routes, r):
    """Return what the time of a route beyond its limit counts as a latency."""
    return _OVERTIME * max(_last(routes, r) - routes.limits[r], 0.0)


@in_place_kernel
def _gain_in_time(routes, r, gain, later):
    """Return the gain of a change after which a route ends later by a time, with what the change
    takes from its overtime, or a negative number if the route becomes too long.

    Greedy routes may be too long at first, and become as long as allowed in this way.
    """
    if not _is_in_time(routes, r, later):
        return -1.0
    return gain + min(_overtime(routes, r), _OVERTIME * max(-later, 0.0))


@in_place_kernel
def _gain_of_turning(blocks, routes, r, i, j, begin):
    """Return by how much the latency falls if a robot searches the blocks at the places i to j in
    reverse order, with the first of them at the time ``begin``, or a negative number if its route
    becomes too long.
    """
    order, count = routes.order, routes.counts[r]
    duration, weight, latency = _stretch(routes, r, i, j)
    later = begin - routes.begins[r, i]
    change = weight * later + (weight * duration - latency) - latency
    if j + 1 < count:
        rest = routes.weights[r, count] - routes.weights[r, j + 1]
        later -= routes.begins[r, j + 1] - routes.finishes[r, j]
        if change + rest * (later + STEP) >= _overtime(routes, r) * routes.rates[r]:
            return -1.0
        later += _between(blocks, order[r, i] ^ 1, order[r, j + 1])
        change += rest * later
    return _gain_in_time(routes, r, -change / routes.rates[r], later)


@in_place_kernel
def _turn(routes, r, i, j):
    while i < j:
        routes.order[r, i], routes.order[r, j] = routes.order[r, j] ^ 1, routes.order[r, i] ^ 1
        i, j = i + 1, j - 1
    if i == j:
        routes.order[r, i] ^= 1


@in_place_kernel
def _gain_of_shifting(blocks, routes, r, i, low, high, turned, step):
    """Return by how much the latency falls if a robot searches the blocks at the places low to high
    after the one at place i, with a step of length ``step`` between them, or a negative number if
    its route becomes too long.

    Most changes gain nothing even if all new steps but one take the least time. Their times are not
    computed.
    """
    order, count = routes.order, routes.counts[r]
    duration, weight, latency = _stretch(routes, r, low, high)
    tail = order[r, high]
    before = latency + weight * routes.begins[r, low]
    if turned:
        tail, latency = order[r, low] ^ 1, weight * duration - latency
    if low > i:
        begin = routes.finishes[r, i] + step
        change = latency + weight * begin - before
        end, last, rest = begin + duration, tail, high + 1
        behind = routes.weights[r, count] - routes.weights[r, rest]
        if low > i + 1:
            skipped, moved, _ = _stretch(routes, r, i + 1, low - 1)
            earliest = end + STEP
            least = change + moved * (earliest - routes.begins[r, i + 1])
            if rest < count:
                least += behind * (earliest + skipped + STEP - routes.begins[r, rest])
            if least >= _overtime(routes, r) * routes.rates[r]:
                return -1.0
            begin = end + _between(blocks, tail, order[r, i + 1])
            change += moved * (begin - routes.begins[r, i + 1])
            end, last = begin + skipped, order[r, low - 1]
    else:
        rest = i + 1
        behind = routes.weights[r, count] - routes.weights[r, rest]
        skipped, moved, _ = _stretch(routes, r, high + 1, i)
        earliest = (routes.finishes[r, low - 1] if low else 0.0) + STEP
        arrival = earliest + skipped + step
        least = latency + weight * arrival - before
        least += moved * (earliest - routes.begins[r, high + 1])
        if rest < count:
            least += behind * (arrival + duration + STEP - routes.begins[r, rest])
        if least >= _overtime(routes, r) * routes.rates[r]:
            return -1.0
        begin = _arrival(blocks, routes, r, low, order[r, high + 1])
        change = moved * (begin - routes.begins[r, high + 1])
        begin += skipped + step
        change += latency + weight * begin - before
        end, last = begin + duration, tail
    if rest < count:
        later = end + _between(blocks, last, order[r, rest]) - routes.begins[r, rest]
        change += behind * later
    else:
        later = end - _last(routes, r)
    return _gain_in_time(routes, r, -change / routes.rates[r], later)


@in_place_kernel
def _shift(routes, r, i, low, high, turned):
    """Move the blocks at the places low to high behind the one at place i of the same route."""
    order, moved, count = routes.order[r], routes.moved, high - low + 1
    for k in range(count):
        moved[k] = order[high - k] ^ 1 if turned else order[low + k]
    if low > i:
        begin = i + 1
        for k in range(low - 1, i, -1):
            order[k + count] = order[k]
    else:
        begin = i + 1 - count
        for k in range(high + 1, i + 1):
            order[k - count] = order[k]
    for k in range(count):
        order[begin + k] = moved[k]


@in_place_kernel
def _take_out(routes, r, low, high, turned):
    """Copy the blocks at the places low to high to the working memory, and close the gap."""
    count = high - low + 1
    for k in range(count):
        routes.moved[k] = routes.order[r, high - k] ^ 1 if turned else routes.order[r, low + k]
    for k in range(high + 1, routes.counts[r]):
        routes.order[r, k - count] = routes.order[r, k]
    routes.counts[r] -= count
    return count


@in_place_kernel
def _put_in(routes, r, i, count):
    """Insert the first blocks of the working memory at place i."""
    for k in range(routes.counts[r] - 1, i - 1, -1):
        routes.order[r, k + count] = routes.order[r, k]
    for k in range(count):
        routes.order[r, i + k] = routes.moved[k]
    routes.counts[r] += count


@in_place_kernel
def _gain_of_giving(blocks, routes, r, i, s, low, high, turned, step):
    """Return by how much the latency falls if robot r searches the blocks at the places low to high
    of robot s after its own at place i, with a step of length ``step`` between them, or a negative
    number if a route becomes too long.
    """
    order = routes.order
    count, other = routes.counts[r], routes.counts[s]
    duration, weight, latency = _stretch(routes, s, low, high)
    less = latency + weight * routes.begins[s, low]
    tail = order[s, high]
    if turned:
        tail, latency = order[s, low] ^ 1, weight * duration - latency
    begin = routes.finishes[r, i] + step
    more = latency + weight * begin
    end = begin + duration
    behind = routes.weights[r, count] - routes.weights[r, i + 1]
    freed = routes.weights[s, other] - routes.weights[s, high + 1]
    # even if the steps that close both routes take the least time
    least = more
    if i + 1 < count:
        least += behind * (end + STEP - routes.begins[r, i + 1])
    most = less
    if high + 1 < other:
        earliest = (routes.finishes[s, low - 1] if low else 0.0) + STEP
        most -= freed * (earliest - routes.begins[s, high + 1])
    if most / routes.rates[s] + _overtime(routes, s) <= least / routes.rates[r]:
        return -1.0
    if i + 1 < count:
        later = end + _between(blocks, tail, order[r, i + 1]) - routes.begins[r, i + 1]
        more += behind * later
    else:
        later = end - _last(routes, r)
    if not _is_in_time(routes, r, later):
        return -1.0
    if high + 1 < other:
        later = _arrival(blocks, routes, s, low, order[s, high + 1]) - routes.begins[s, high + 1]
        less -= freed * later
    else:
        later = (routes.finishes[s, low - 1] if low else 0.0) - _last(routes, s)
    return _gain_in_time(routes, s, less / routes.rates[s] - more / routes.rates[r], later)


@in_place_kernel
def _gain_of_exchanging(blocks, routes, r, i, s, j, step):
    """Return by how much the latency falls if robot r continues after place i with the blocks of
    robot s from place j on, after a step of length ``step``, and robot s with those of robot r, or
    a negative number if a route becomes too long.
    """
    order = routes.order
    count, other = routes.counts[r], routes.counts[s]
    duration, weight, latency = _stretch(routes, s, j, other - 1)
    begin = routes.finishes[r, i] + step
    mine = begin + duration - _last(routes, r)
    theirs = (routes.finishes[s, j - 1] if j else 0.0) - _last(routes, s)
    if not _is_in_time(routes, r, mine):
        return -1.0
    gain = (latency + weight * routes.begins[s, j]) / routes.rates[s]
    gain -= (latency + weight * begin) / routes.rates[r]
    if i + 1 < count:
        duration, weight, latency = _stretch(routes, r, i + 1, count - 1)
        begin = _arrival(blocks, routes, s, j, order[r, i + 1])
        theirs = begin + duration - _last(routes, s)
        if not _is_in_time(routes, s, theirs):
            return -1.0
        gain += (latency + weight * routes.begins[r, i + 1]) / routes.rates[r]
        gain -= (latency + weight * begin) / routes.rates[s]
    return _gain_in_time(routes, s, _gain_in_time(routes, r, gain, mine), theirs)


@in_place_kernel
def _exchange(routes, r, i, s, j):
    order = routes.order
    mine, theirs = routes.counts[r] - i - 1, routes.counts[s] - j
    for k in range(mine):
        routes.moved[k] = order[r, i + 1 + k]
    for k in range(theirs):
        order[r, i + 1 + k] = order[s, j + k]
    for k in range(mine):
        order[s, j + k] = routes.moved[k]
    routes.counts[r] = i + 1 + theirs
    routes.counts[s] = j + mine


@in_place_kernel
def _wake(routes, r, i):
    """Let the blocks around a place of a route be tried again, after those that wait already: a
    block that several changes wake is tried once.
    """
    size = routes.awake.shape[0]
    for k in range(max(i - 1, 0), min(i + 2, routes.counts[r])):
        block = routes.order[r, k] >> 1
        if not routes.awake[block]:
            routes.awake[block] = True
            place = routes.waiting[-2] + routes.waiting[-1]
            routes.waiting[place if place < size else place - size] = block
            routes.waiting[-1] += 1


@in_place_kernel
def _wake_all(routes):
    """Let all blocks be tried."""
    count = routes.awake.shape[0]
    routes.awake[:] = True
    for block in range(count):
        routes.waiting[block] = block
    routes.waiting[-2] = 0
    routes.waiting[-1] = count


@in_place_kernel
def _give(blocks, routes, r, i, s, low, high, turned):
    """Move the blocks from ``low`` to ``high`` of route ``s`` behind place ``i`` of route ``r``."""
    count = _take_out(routes, s, low, high, turned)
    _put_in(routes, r, i + 1, count)
    _sum_up(blocks, routes, r, i + 1, i + 1 + count)
    _sum_up(blocks, routes, s, low, low)
    _wake(routes, r, i)
    _wake(routes, r, i + count)
    _wake(routes, s, low)


@in_place_kernel
def _improve_beside(blocks, routes, a, b, longest, least):
    """Let block b follow block a, by the first change that lowers the latency by more than
    ``least``. Return whether there was one.
    """
    r, i, s, j = routes.route[a], routes.place[a], routes.route[b], routes.place[b]
    turns = blocks.ends[2 * b] != blocks.ends[2 * b + 1]  # a block of one cell has no direction
    if r == s and j == i + 1 and not turns:
        return False
    last, item = routes.order[r, i], routes.order[s, j]
    step = _between(blocks, last, item)
    back = _between(blocks, last, item ^ 1) if turns else step
    if r == s:
        if j > i:
            low, high, begin = i + 1, j, routes.finishes[r, i] + back
        else:
            low, high, begin = j + 1, i, routes.finishes[r, j] + _between(blocks, item, last ^ 1)
        if low <= high and _gain_of_turning(blocks, routes, r, low, high, begin) > least:
            _turn(routes, r, low, high)
            _sum_up_between(blocks, routes, r, low, high + 1)
            _wake(routes, r, low)
            _wake(routes, r, high)
            return True
    elif _gain_of_exchanging(blocks, routes, r, i, s, j, step) > least:
        _exchange(routes, r, i, s, j)
        _sum_up(blocks, routes, r, i + 1, i + 1)
        _sum_up(blocks, routes, s, j, j)
        _wake(routes, r, i)
        _wake(routes, s, j)
        return True
    for count in range(1, longest + 1):
        for turned in range(2 if turns or count > 1 else 1):
            way = back if turned else step
            low = j - count + 1 if turned else j
            high = low + count - 1
            if low < 0 or high >= routes.counts[s]:
                continue
            if r != s:
                if _gain_of_giving(blocks, routes, r, i, s, low, high, turned, way) > least:
                    _give(blocks, routes, r, i, s, low, high, turned)
                    return True
            elif not (low <= i <= high or (low == i + 1 and not turned)):
                if _gain_of_shifting(blocks, routes, r, i, low, high, turned, way) > least:
                    begin = i + 1 if low > i else i + 1 - count
                    _shift(routes, r, i, low, high, turned)
                    _sum_up_between(blocks, routes, r, min(i + 1, low), max(i, high) + 1)
                    _wake(routes, r, begin)
                    _wake(routes, r, begin + count)
                    _wake(routes, r, low if low < i else high + 1)
                    return True
    return False


@in_place_kernel
def _descend(blocks, routes, longest, least, near):
    """Make changes until none lowers the latency in which one of the first ``near`` blocks near an
    awake block comes to follow it.
    """
    while routes.waiting[-1]:
        a = routes.waiting[routes.waiting[-2]]
        routes.waiting[-1] -= 1
        routes.waiting[-2] += 1
        if routes.waiting[-2] == routes.awake.shape[0]:
            routes.waiting[-2] = 0
        changed = True
        while changed:
            changed = False
            for k in range(near):
                b = blocks.near[a, k]
                if b >= 0 and _improve_beside(blocks, routes, a, b, longest, least):
                    changed = True
                    break
        routes.awake[a] = False


@in_place_kernel
def _latency(routes):
    """Return the weighted latency of all routes."""
    total = 0.0
    for r in range(routes.counts.shape[0]):
        total += routes.latencies[r, routes.counts[r]] / routes.rates[r]
    return total


@in_place_kernel
def _draw(state, below):
    """Return a pseudo-random number from 0 to below - 1 (a linear congruential generator)."""
    state[0] = state[0] * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)
    return np.int64((state[0] >> np.uint64(33)) % np.uint64(below))


@in_place_kernel
def _kick(blocks, routes, state, widest):
    """Let a block follow one that is near it, whatever that costs, more often where it is likely.
    Return whether the routes changed.

    On the same route, what lies between both, at most ``widest`` blocks, is turned round or comes
    after the block and some that follow it. From another route, the block comes with some that
    follow it.
    """
    size = blocks.likely.shape[0]
    a = blocks.likely[min(_draw(state, size), _draw(state, size))]
    b = blocks.near[a, _draw(state, blocks.near.shape[1])]
    if b < 0:
        return False
    r, i, s, j = routes.route[a], routes.place[a], routes.route[b], routes.place[b]
    most = min(_FOLLOWING, routes.counts[s] - j)
    if r != s:
        _give(blocks, routes, r, i, s, j, j + _draw(state, most), 0)
        return True
    if abs(j - i) == 1 or abs(j - i) > widest:
        return False
    if j < i:
        _turn(routes, r, j + 1, i)
        _sum_up_between(blocks, routes, r, j + 1, i + 1)
        _wake(routes, r, j + 1)
        _wake(routes, r, i)
        return True
    last = j + _draw(state, most)
    _shift(routes, r, i, j, last, 0)
    _sum_up_between(blocks, routes, r, i + 1, last + 1)
    _wake(routes, r, i)
    _wake(routes, r, last - j + i + 2)
    _wake(routes, r, last + 1)
    return True


@in_place_kernel
def _ends_in_time(routes, ends):
    """Return whether all routes end by given times."""
    for r in range(routes.counts.shape[0]):
        if _last(routes, r) > ends[r] + 1e-9:
            return False
    return True


@in_place_kernel
def _go_on_greedily(blocks, routes):
    """Make new routes: whenever a robot is ready, it goes on to the block with the largest
    probability over the time that the block takes with the way to it. If leaving the tour costs
    nothing, the probability is divided by the cube of the way, too, and no robot goes elsewhere as
    long as a block is left near its last one: routes that rather stay near leave no small gaps,
    which would be far away later.

    No block has more than its probability over the least time that it takes: what cannot be better
    than the best so far is not tried.
    """
    routes.counts[:] = 0
    routes.awake[:] = True  # those that no robot has yet
    left = blocks.likely.shape[0]
    for k in range(left):
        routes.moved[k] = blocks.likely[k]
    while left:
        r = 0
        for other in range(1, routes.counts.shape[0]):
            if _last(routes, other) / routes.rates[other] < _last(routes, r) / routes.rates[r]:
                r = other
        i, ready = routes.counts[r], _last(routes, r)
        chosen, most = -1, -1.0
        if i:
            before = routes.order[r, i - 1] >> 1
            for k in range(blocks.near.shape[1]):
                block = blocks.near[before, k]
                if block >= 0 and routes.awake[block]:
                    chosen, most = _more_likely(blocks, routes, r, ready, block, chosen, most)
        stays = blocks.leaving <= 0 and chosen >= 0
        for k in range(0 if stays else left):
            block = routes.moved[k]
            if not routes.awake[block]:
                continue
            if blocks.weights[block] <= most * (blocks.times[block] + STEP):
                break
            chosen, most = _more_likely(blocks, routes, r, ready, block, chosen, most)
        routes.order[r, i] = chosen
        routes.counts[r] += 1
        _sum_up(blocks, routes, r, i, i)
        routes.awake[chosen >> 1] = False
        for k in range(left):
            if routes.moved[k] == chosen >> 1:
                for later in range(k, left - 1):
                    routes.moved[later] = routes.moved[later + 1]
                break
        left -= 1
    routes.awake[:] = True


@in_place_kernel
def _more_likely(blocks, routes, r, ready, block, chosen, most):
    """Return the better of a block, in either direction, and of what was ``chosen`` for the next
    place of a route, with the number by which they are compared.
    """
    i = routes.counts[r]
    for item in range(2 * block, 2 * block + 2):
        way = _arrival(blocks, routes, r, i, item) - ready
        near = 1.0 if blocks.leaving > 0 else way
        rate = blocks.weights[block] / ((way + blocks.times[block]) * near * near * near)
        if rate > most or (rate == most and item < chosen):
            chosen, most = item, rate
    return chosen, most


@in_place_kernel
def _copy(source, target, since):
    """Copy each route from its place in ``since`` on: before it, both are the same already."""
    for r in range(source.counts.shape[0]):
        count = source.counts[r]
        target.counts[r] = count
        for i in range(since[r], count):
            item = source.order[r, i]
            block = item >> 1
            target.order[r, i] = item
            target.begins[r, i] = source.begins[r, i]
            target.finishes[r, i] = source.finishes[r, i]
            target.weights[r, i + 1] = source.weights[r, i + 1]
            target.latencies[r, i + 1] = source.latencies[r, i + 1]
            target.steps[block] = source.steps[block]
            target.route[block], target.place[block] = r, i
        since[r] = source.order.shape[1]


@kernel
def improve(blocks, routes, longest, kicks, widest):
    """Change routes so that their weighted latency falls, and return it.

    The changes: to turn a stretch round, to move up to ``longest`` blocks elsewhere on their route
    or to another robot, and to exchange the rest of two routes. In each, a block comes to follow
    one that is near it. The search begins from greedy routes, or from the given ones if these have
    the smaller latency. Then some block comes to follow another across up to ``widest`` blocks,
    whatever that costs, and what follows is taken back unless it ends below: an iterated local
    search of so many ``kicks``. Routes that are too long become shorter even where that adds to the
    latency; if they stay too long, they are discarded for the given ones.
    """
    m = routes.counts.shape[0]
    for r in range(m):
        _sum_up(blocks, routes, r, 0, routes.counts[r])
    best = _latency(routes)
    least = _LEAST * best
    kept = Routes(
        routes.order.copy(),
        routes.counts.copy(),
        routes.rates,
        routes.first,
        routes.limits,
        routes.route,
        routes.place,
        routes.begins.copy(),
        routes.finishes.copy(),
        routes.weights.copy(),
        routes.latencies.copy(),
        routes.steps.copy(),
        routes.awake,
        routes.waiting,
        routes.since,
        routes.moved,
    )
    ends = np.zeros(m)
    for r in range(m):
        ends[r] = max(routes.limits[r], _last(routes, r))
    state = np.full(1, 1, dtype=np.uint64)
    fewer = max(longest - 1, 1)  # after a kick
    near = blocks.near.shape[1]
    _go_on_greedily(blocks, routes)
    if _latency(routes) >= best:
        _copy(kept, routes, routes.since)
    _wake_all(routes)
    _descend(blocks, routes, longest, least, near)
    found = _latency(routes)
    if not (found < best and _ends_in_time(routes, ends)):
        _copy(kept, routes, routes.since)
        _wake_all(routes)
        _descend(blocks, routes, longest, least, near)
        found = _latency(routes)
    best = found
    _copy(routes, kept, routes.since)
    for _ in range(kicks):
        if not _kick(blocks, routes, state, widest):
            continue
        _descend(blocks, routes, fewer, least, min(_NEARER, near))
        found = _latency(routes)
        if found < best - least and _ends_in_time(routes, ends):
            best = found
            _copy(routes, kept, routes.since)
        else:
            _copy(kept, routes, routes.since)
    return best
