"""Shortest paths whose steps lead from a cell to a neighbouring cell, around closed cells.

Counterparts: `shoal.search.cells.distances.CellDistances`, and the ways of `TourCost` along steps.
Sets of closed cells are kept with a number each, and with the connected parts that they leave; the
distances from a cell around such a set are a row, kept until there is no room for another one.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel
from shoal.search.kernels.protocol.bits import ONE, ZERO, holds

SETS, ROWS, VERSION, HEAP = range(4)  # counters of a table of paths
OPEN = 0  # number of the empty set
_FACTOR = np.uint64(0x9E3779B97F4A7C15)
_SHIFT = np.uint64(29)


@in_place_kernel
def number_of_set(tour, bits):
    """Return the number of a set of closed cells. The numbers before are void if the set is new and
    there is no room for it; then the version of the table changes.
    """
    code = ZERO
    for k in range(bits.shape[0]):
        code = (code ^ bits[k]) * _FACTOR
        code ^= code >> _SHIFT
    for k in range(tour.counters[SETS]):
        if tour.codes[k] == code:
            same = True
            for word in range(bits.shape[0]):
                same = same and tour.sets[k, word] == bits[word]
            if same:
                return k
    if tour.counters[SETS] == tour.sets.shape[0]:
        tour.counters[SETS] = 1
        tour.counters[VERSION] += 1
        forget_rows(tour)
    k = tour.counters[SETS]
    tour.counters[SETS] += 1
    tour.codes[k] = code
    for word in range(bits.shape[0]):
        tour.sets[k, word] = bits[word]
    label_components(tour, bits, tour.labels[k])
    return k


@in_place_kernel
def forget_rows(tour):
    """Forget all distances."""
    tour.counters[ROWS] = 0
    tour.row_keys[:] = -1


@in_place_kernel
def is_usable(tour, edge, cell, closed, source):
    """Return whether a step is possible around closed cells. The cell ``source`` counts as open."""
    other, beside_cell, beside = tour.ends[edge], tour.beside[edge, 0], tour.beside[edge, 1]
    if (holds(closed, cell) and cell != source) or (holds(closed, other) and other != source):
        return False
    return beside_cell < 0 or (
        (beside_cell == source or not holds(closed, beside_cell))
        and (beside == source or not holds(closed, beside))
    )


@in_place_kernel
def label_components(tour, closed, labels):
    """Write the number of each cell's connected part. A closed cell is a part of its own."""
    labels[:] = -1
    part, stack = 0, tour.nodes
    for first in range(labels.shape[0]):
        if labels[first] >= 0:
            continue
        labels[first] = part
        stack[0], size = first, 1
        while size:
            size -= 1
            cell = stack[size]
            for edge in range(tour.edges[cell], tour.edges[cell + 1]):
                other = tour.ends[edge]
                if labels[other] < 0 and is_usable(tour, edge, cell, closed, -1):
                    labels[other] = part
                    stack[size] = other
                    size += 1
        part += 1


@in_place_kernel
def write_distances(tour, source, closed, row):
    """Write the distance from a cell to each cell, around closed cells; infinity if there is no
    path.
    """
    row[:] = np.inf
    row[source] = 0.0
    keys, nodes, size = tour.heap, tour.nodes, 1
    keys[0], nodes[0] = 0.0, source
    while size:
        away, cell = keys[0], nodes[0]
        size -= 1
        sink(keys, nodes, size, keys[size], nodes[size])
        if away > row[cell]:
            continue
        for edge in range(tour.edges[cell], tour.edges[cell + 1]):
            other = tour.ends[edge]
            length = away + tour.weights[edge]
            if length < row[other] and is_usable(tour, edge, cell, closed, source):
                row[other] = length
                at = size
                size += 1
                while at > 0 and keys[(at - 1) >> 1] > length:
                    keys[at], nodes[at] = keys[(at - 1) >> 1], nodes[(at - 1) >> 1]
                    at = (at - 1) >> 1
                keys[at], nodes[at] = length, other


@in_place_kernel
def sink(keys, nodes, size, key, node):
    """Put an entry in place of the first of a heap."""
    at = 0
    while True:
        child = 2 * at + 1
        if child >= size:
            break
        if child + 1 < size and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[at], nodes[at] = keys[child], nodes[child]
        at = child
    keys[at], nodes[at] = key, node


@in_place_kernel
def row_of(tour, source, closed):
    """Return the number of the row of distances from a cell around a set of closed cells."""
    key, size = closed * tour.cells + source, tour.row_keys.shape[0]
    at = np.int64((np.uint64(key) * _FACTOR) >> _SHIFT) & (size - 1)
    while tour.row_keys[at] != key:
        if tour.row_keys[at] < 0:
            if tour.counters[ROWS] == tour.rows.shape[0]:
                forget_rows(tour)
                at = np.int64((np.uint64(key) * _FACTOR) >> _SHIFT) & (size - 1)
            row = tour.counters[ROWS]
            tour.counters[ROWS] += 1
            tour.row_keys[at], tour.row_numbers[at] = key, row
            write_distances(tour, source, tour.sets[closed], tour.rows[row])
            return row
        at = (at + 1) & (size - 1)
    return np.int64(tour.row_numbers[at])


@in_place_kernel
def length_around(tour, source, cell, closed):
    """Return the length of the shortest path around a set of closed cells."""
    return tour.rows[row_of(tour, source, closed), cell]


@in_place_kernel
def follows(tour, source, target, step, closed):
    """Return whether the path between two consecutive cells of the tour keeps its length despite
    closed cells.
    """
    longest = tour.steps[source if step > 0 else target] + 1e-9
    for edge in range(tour.edges[source], tour.edges[source + 1]):
        if tour.ends[edge] == target:
            if tour.weights[edge] <= longest and is_usable(
                tour, edge, source, tour.sets[closed], source
            ):
                return True
    return length_around(tour, source, target, closed) <= longest


@in_place_kernel
def stepwise_path(tour, source, cell, free, closed):
    """Return the cost of the cheapest path between two cells, and how it follows the tour: forwards
    (1), backwards (-1), or not at all (0); see `TourCost._stepwise_path`.
    """
    n = tour.cells
    direct = max(length_around(tour, source, cell, closed) - free, 0.0) + tour.turn_cost
    if direct == np.inf:
        return np.inf, 0
    ahead, behind = (cell - source) % n, (source - cell) % n
    onwards = tour.ahead[source + ahead + 1] - tour.ahead[source + 1] - free
    backwards = tour.ahead[cell + behind + 1] - tour.ahead[cell + 1] - free
    forwards = onwards < backwards or (onwards == backwards and ahead < behind)
    if onwards == backwards and ahead == behind:
        forwards = False  # -1 comes before 1
    for turn in range(2):
        step = 1 if forwards == (turn == 0) else -1
        cost, count = (onwards, ahead) if step > 0 else (backwards, behind)
        if cost > direct:
            break
        good = True
        for k in range(count):
            from_cell = (source + step * k) % n
            if not follows(tour, from_cell, (from_cell + step) % n, step, closed):
                good = False
                break
        if good:
            return cost, step
    return direct, 0


@in_place_kernel
def write_path(tour, source, cell, closed, row, out, count):
    """Append the cells of the shortest path between two cells to ``out``, which holds ``count``
    cells, and return the new number of cells: more than ``out`` can hold if it is too short.

    Of several shortest paths it is the one that comes from the cell with the lowest number, seen
    from its end. ``row`` has the distances from the cell ``source``.
    """
    if row[cell] == np.inf:
        return count
    length, at = 0, cell
    while at != source:
        if count + length < out.shape[0]:
            out[count + length] = at
        length += 1
        at = cell_before(tour, source, at, closed, row)
    last = count + length
    if last <= out.shape[0]:
        for k in range(length >> 1):
            out[count + k], out[last - 1 - k] = out[last - 1 - k], out[count + k]
    return last


@in_place_kernel
def cell_before(tour, source, cell, closed, row):
    """Return the cell before a cell on the path from the cell ``source``."""
    best = tour.cells
    for edge in range(tour.edges[cell], tour.edges[cell + 1]):
        other = tour.ends[edge]
        if (
            other < best
            and row[other] + tour.weights[edge] == row[cell]
            and is_usable(tour, edge, cell, closed, source)
        ):
            best = other
    return best


@in_place_kernel
def write_move_path(tour, position, cell, free, closed, out):
    """Write the cells of the path whose cost `stepwise_path` returns, and return their number."""
    if position == cell:
        return 0
    n = tour.cells
    step, count = stepwise_path(tour, position, cell, free, closed)[1], 0
    while position != cell:
        target = cell if step == 0 else (position + step) % n
        row = row_of(tour, position, closed)
        count = write_path(tour, position, target, tour.sets[closed], tour.rows[row], out, count)
        position = target
    return count


@in_place_kernel
def edge_between(tour, source, target):
    """Return the step from a cell to a neighbouring cell."""
    for edge in range(tour.edges[source], tour.edges[source + 1]):
        if tour.ends[edge] == target:
            return edge
    return -1


@in_place_kernel
def length_through(tour, position, path, count):
    """Return the length of a path from a cell through so many cells."""
    total = 0.0
    for k in range(count):
        total += length_around(tour, position, path[k], OPEN)
        position = path[k]
    return total


@in_place_kernel
def add_crossed(tour, position, path, count, passed):
    """Add the cells that must be open for a path to a bitset."""
    for k in range(count):
        edge = edge_between(tour, position, path[k])
        position = path[k]
        passed[position >> 6] |= ONE << np.uint64(position & 63)
        for side in range(2):
            cell = tour.beside[edge, side]
            if cell >= 0:
                passed[cell >> 6] |= ONE << np.uint64(cell & 63)


@in_place_kernel
def obstacle_on(tour, position, path, count, blocked):
    """Return the first obstacle on a path from a cell, or -1, and the number of cells before it."""
    for k in range(count):
        if holds(blocked, path[k]):
            return path[k], k
        edge = edge_between(tour, position, path[k])
        for side in range(2):
            cell = tour.beside[edge, side]
            if cell >= 0 and holds(blocked, cell):
                return cell, k
        position = path[k]
    return np.int64(-1), count
