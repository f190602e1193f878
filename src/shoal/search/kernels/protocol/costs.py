"""Costs of paths and of searches, and sets of cells along a closed tour.

Counterparts: `shoal.search.allocation.costs`, `shoal.search.allocation.allocate.Arc` and
`shoal.search.tours.masks`.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel
from shoal.search.kernels.protocol.bits import ALL, ONE, ZERO, highest, holds, lowest, popcount
from shoal.search.kernels.protocol.steps import OPEN, length_around, stepwise_path
from shoal.search.kernels.protocol.worlds import A_LAUNCH, A_LENGTH, NOTHING

_MIX = np.uint64(0x9E3779B97F4A7C15)
_SHIFT = np.uint64(40)


@in_place_kernel
def add(bits, cell):
    """Add a cell to a bitset."""
    bits[cell >> 6] |= ONE << np.uint64(cell & 63)


@in_place_kernel
def remove(bits, cell):
    """Remove a cell from a bitset."""
    bits[cell >> 6] &= ~(ONE << np.uint64(cell & 63))


@in_place_kernel
def is_empty(bits):
    """Return whether a bitset contains no cell."""
    for k in range(bits.shape[0]):
        if bits[k] != ZERO:
            return False
    return True


@in_place_kernel
def next_in_line(bits, low, high):
    """Return the first cell of a bitset from ``low`` to ``high`` - 1, or -1."""
    if low >= high:
        return -1
    k = low >> 6
    word = bits[k] & (ALL << np.uint64(low & 63))
    last = (high - 1) >> 6
    while word == ZERO:
        k += 1
        if k > last:
            return -1
        word = bits[k]
    cell = (k << 6) + lowest(word)
    return cell if cell < high else -1


@in_place_kernel
def last_in_line(bits, low, high):
    """Return the last cell of a bitset from ``low`` to ``high`` - 1, or -1."""
    if low >= high:
        return -1
    k = (high - 1) >> 6
    word = bits[k] & (ALL >> np.uint64(63 - ((high - 1) & 63)))
    first = low >> 6
    while word == ZERO:
        k -= 1
        if k < first:
            return -1
        word = bits[k]
    cell = (k << 6) + highest(word)
    return cell if cell >= low else -1


@in_place_kernel
def end_of_run(bits, cell, high):
    """Return the end of the run of cells of a bitset that begins with ``cell``, at most ``high``."""
    k = cell >> 6
    word = ~bits[k] & (ALL << np.uint64(cell & 63))
    last = (high - 1) >> 6
    while word == ZERO:
        k += 1
        if k > last:
            return high
        word = ~bits[k]
    return min((k << 6) + lowest(word), high)


@in_place_kernel
def begin_of_run(bits, cell, low):
    """Return the first cell of the run of cells of a bitset that ends with ``cell``, at least
    ``low``.
    """
    k = cell >> 6
    word = ~bits[k] & (ALL >> np.uint64(63 - (cell & 63)))
    first = low >> 6
    while word == ZERO:
        k -= 1
        if k < first:
            return low
        word = ~bits[k]
    return max((k << 6) + highest(word) + 1, low)


@in_place_kernel
def ahead_of(bits, first, offset, count, n):
    """Return how far ahead of the cell ``first``, at least ``offset`` and less than ``count``, the
    next cell of a bitset is on a closed tour of n cells; -1 if there is none.
    """
    low = first + offset
    if low < n:
        cell = next_in_line(bits, low, min(first + count, n))
        if cell >= 0:
            return cell - first
        low = n
    cell = next_in_line(bits, low - n, first + count - n)
    return cell + n - first if cell >= 0 else -1


@in_place_kernel
def length_of_run(bits, first, offset, count, n):
    """Return how many cells of a bitset follow one another, beginning ``offset`` cells ahead of the
    cell ``first``, at most ``count`` - ``offset``.
    """
    low = first + offset
    if low < n:
        end = end_of_run(bits, low, min(first + count, n))
        if end < n or end == first + count:
            return end - low
        return (
            n
            - low
            + (
                end_of_run(bits, 0, first + count - n)
                if first + count > n and holds(bits, 0)
                else 0
            )
        )
    return end_of_run(bits, low - n, first + count - n) - (low - n)


@in_place_kernel
def behind_of(bits, first, offset, count, n):
    """Return how far behind the cell ``first``, at least ``offset`` and less than ``count``, the
    next cell of a bitset is; -1 if there is none.
    """
    high = first - offset
    if high >= 0:
        cell = last_in_line(bits, max(first - count + 1, 0), high + 1)
        if cell >= 0:
            return first - cell
        high = -1
    cell = last_in_line(bits, first - count + 1 + n, high + n + 1)
    return first - cell + n if cell >= 0 else -1


@in_place_kernel
def length_back(bits, first, offset, count, n):
    """Return how many cells of a bitset follow one another backwards, as `length_of_run` does
    forwards.
    """
    high = first - offset
    if high >= 0:
        begin = begin_of_run(bits, high, max(first - count + 1, 0))
        if begin > 0 or first - count + 1 >= 0:
            return high - begin + 1
        if not holds(bits, n - 1):
            return high + 1
        return high + 1 + n - begin_of_run(bits, n - 1, first - count + 1 + n)
    return high + n - begin_of_run(bits, high + n, first - count + 1 + n) + 1


@in_place_kernel
def next_stretch(bits, first, offset, count, step, n):
    """Return how far along an arc the next stretch of cells of a bitset begins, or -1, and its
    number of cells.
    """
    if step > 0:
        at = ahead_of(bits, first, offset, count, n)
        return at, (length_of_run(bits, first, at, count, n) if at >= 0 else 0)
    at = behind_of(bits, first, offset, count, n)
    return at, (length_back(bits, first, at, count, n) if at >= 0 else 0)


@in_place_kernel
def remove_arc(bits, first, count, step, n):
    """Remove the cells of an arc from a bitset."""
    low = (first if step > 0 else first - count + 1) % n
    high = low + min(count, n)
    remove_line(bits, low, min(high, n))
    if high > n:
        remove_line(bits, 0, high - n)


@in_place_kernel
def remove_line(bits, low, high):
    """Remove the cells from ``low`` to ``high`` - 1 from a bitset."""
    if low >= high:
        return
    first, last = low >> 6, (high - 1) >> 6
    begin = ALL << np.uint64(low & 63)
    end = ALL >> np.uint64(63 - ((high - 1) & 63))
    if first == last:
        bits[first] &= ~(begin & end)
        return
    bits[first] &= ~begin
    for k in range(first + 1, last):
        bits[k] = ZERO
    bits[last] &= ~end


@in_place_kernel
def arc_holds(first, count, step, cell, n):
    """Return whether an arc contains a cell."""
    return (cell - first) * step % n < count


# Costs


@in_place_kernel
def between(tour, source, target):
    """Return the straight distance between two cells, in cell sides."""
    total = 0.0
    for k in range(tour.points.shape[1]):
        away = tour.points[source, k] - tour.points[target, k]
        total += away * away
    return np.sqrt(total)


@in_place_kernel
def look_up(tour, control, key, kind, first, second):
    """Return the length of a path from the table. If the table lacks it, the world asks for it, and
    the result has no meaning.
    """
    size = tour.keys.shape[0]
    at = np.int64((np.uint64(key) * _MIX) >> _SHIFT) & (size - 1)
    while tour.keys[at] != key:
        if tour.keys[at] < 0:
            if control.need == NOTHING:
                control.need, control.need_one, control.need_other = kind, first, second
            return 0.0
        at = (at + 1) & (size - 1)
    return tour.lengths[at]


@in_place_kernel
def length(tour, control, source, cell):
    """Return the length of the path between two cells, in cell sides."""
    if tour.stepwise:
        return length_around(tour, source, cell, OPEN)
    if tour.straight:
        return between(tour, source, cell)
    low, high = min(source, cell), max(source, cell)
    return look_up(tour, control, low * tour.cells + high, A_LENGTH, low, high)


@in_place_kernel
def from_launch(tour, control, robot, start, cell):
    """Return the distance to a cell from a robot's launch point, minus the distance from its start
    cell.
    """
    if not tour.launched:
        return 0.0
    if tour.stepwise:
        cell = start
    key = (tour.cells + robot) * tour.cells + cell
    away = look_up(tour, control, key, A_LAUNCH, robot, cell)
    if away < 0:
        return 0.0
    return away if tour.stepwise else away - length(tour, control, start, cell)


@in_place_kernel
def move_cost(tour, control, source, cell, fresh, closed):
    """Return the cost of moving from a cell to a cell around a set of closed cells; see
    `TourCost.move_cost`.
    """
    if source == cell:
        return 0.0
    n, free = tour.cells, 0.0 if fresh else 1.0
    if tour.stepwise:
        return stepwise_path(tour, source, cell, free, closed)[0]
    ahead, behind = (cell - source) % n, (source - cell) % n
    onwards = tour.ahead[source + ahead + 1] - tour.ahead[source + 1] - free
    if ahead == 1:
        return onwards
    along_tour = min(onwards, tour.ahead[cell + behind + 1] - tour.ahead[cell + 1] - free)
    if along_tour <= max(between(tour, source, cell) - free, 0.0) + tour.turn_cost:
        return along_tour
    return min(along_tour, max(length(tour, control, source, cell) - free, 0.0) + tour.turn_cost)


@in_place_kernel
def search_cost(tour, first, count, step):
    """Return the cost of searching consecutive cells of the tour; see `TourCost.search_cost`."""
    if count <= 0:
        return 0.0
    low = (first if step > 0 else first - count + 1) % tour.cells
    return 1.0 + tour.ahead[low + count] - tour.ahead[low + 1]


@in_place_kernel
def cost_of_all(tour, control, remaining, position, fresh, closed):
    """Return the cost of searching all cells of a bitset in tour order; see
    `shoal.search.allocation.allocate.cost_of_all`.
    """
    total, n, begin, offset = 0.0, tour.cells, position, 0
    while offset < n:
        at = ahead_of(remaining, begin, offset, n, n)
        if at < 0:
            break
        count = length_of_run(remaining, begin, at, n, n)
        first = (begin + at) % n
        total += move_cost(tour, control, position, first, fresh, closed)
        total += search_cost(tour, first, count, 1)
        position, fresh = (first + count - 1) % n, 0
        offset = at + count
    return total


@in_place_kernel
def cost_alone(tour, control, rules, partitions, place, remaining, position, fresh, closed):
    """Return the cost of searching all cells of ``remaining`` alone, first those of the robot's own
    arcs, and empty ``remaining``; see `shoal.search.protocol.robot._cost_alone`.

    The tuple ``place`` tells who works: the division, the index of the own part, the number of the
    robot, its start, and whether it is at its launch point.
    """
    division, own, number, start, at_launch = place
    n, cost, away = tour.cells, 0.0, at_launch != 0 and fresh != 0
    parts = partitions.starts[division + 1] - partitions.starts[division]
    for ahead in range(min(rules.multiplicity, parts)):
        part = partitions.starts[division] + (own + ahead) % parts
        for arc in range(partitions.arcs[part], partitions.arcs[part + 1]):
            first, size, step = (
                partitions.first[arc],
                partitions.sizes[arc],
                partitions.step[arc],
            )
            offset = 0
            while offset < size:
                at, count = next_stretch(remaining, first, offset, size, step, n)
                if at < 0:
                    break
                cell = (first + step * at) % n
                if away:
                    cost = from_launch(tour, control, number, start, cell)
                    away = False
                cost += move_cost(tour, control, position, cell, fresh, closed) + search_cost(
                    tour, cell, count, step
                )
                position, fresh = (cell + step * (count - 1)) % n, 0
                offset = at + count
            remove_arc(remaining, first, size, step, n)
    if away:
        at = ahead_of(remaining, position, 0, n, n)
        if at >= 0:
            cost = from_launch(tour, control, number, start, (position + at) % n)
    return cost + cost_of_all(tour, control, remaining, position, fresh, closed)


@in_place_kernel
def count_cells(bits):
    """Return the number of cells in a bitset."""
    total = 0
    for k in range(bits.shape[0]):
        total += popcount(bits[k])
    return total
