"""Metrics of tours in compiled code: lengths of steps, turns, and how far apart neighbours lie."""

from __future__ import annotations

from shoal.jit import kernel


@kernel
def squared_steps(cells, squares):
    """Write to ``squares`` the squared length of the step from each cell to the next one. The last
    step leads to the first cell.
    """
    n = len(cells)
    for k in range(n):
        after = k + 1 if k + 1 < n else 0
        squares[k] = squared_distance(cells, k, after)


@kernel
def squared_distance(cells, a, b):
    z, y, x = cells[b, 0] - cells[a, 0], cells[b, 1] - cells[a, 1], cells[b, 2] - cells[a, 2]
    return z * z + y * y + x * x


@kernel
def count_turns(cells, closed):
    """Return the number of cells at which the tour changes its direction.

    The first and the last cell count only in a closed tour.
    """
    n, turns = len(cells), 0
    if n < 3:
        return 2 if closed and n == 2 else 0
    for k in range(0 if closed else 1, n if closed else n - 1):
        before, after = k - 1 if k > 0 else n - 1, k + 1 if k + 1 < n else 0
        z, y, x = (
            cells[k, 0] - cells[before, 0],
            cells[k, 1] - cells[before, 1],
            cells[k, 2] - cells[before, 2],
        )
        w, v, u = (
            cells[after, 0] - cells[k, 0],
            cells[after, 1] - cells[k, 1],
            cells[after, 2] - cells[k, 2],
        )
        straight = (
            y * u == x * v and z * u == x * w and z * v == y * w and z * w + y * v + x * u > 0
        )
        turns += not straight
    return turns


@kernel
def neighbour_gaps(position, closed, n):
    """Return (sum, pairs) of the distances along the tour between neighbouring cells.

    ``pairs`` is the number of pairs of neighbouring cells, and ``sum`` is the sum of their
    distances along the tour. The array ``position`` has the shape (L, H, W).
    """
    total, pairs = 0, 0
    layers, rows, cols = position.shape
    for z in range(layers):
        for y in range(rows):
            for x in range(cols):
                index = position[z, y, x]
                if index < 0:
                    continue
                for axis in range(3):
                    w, v, u = z + (axis == 0), y + (axis == 1), x + (axis == 2)
                    if w == layers or v == rows or u == cols or position[w, v, u] < 0:
                        continue
                    gap = abs(position[w, v, u] - index)
                    total += min(gap, n - gap) if closed else gap
                    pairs += 1
    return total, pairs


@kernel
def dilation(cells, closed):
    """Return the largest ratio of the squared straight distance of two cells to their distance
    along the tour.

    The kernel tests only pairs of cells at the distances 1, 2, 3, 4, 6, 8, 12, ... along the tour.
    """
    n = len(cells)
    reach = n // 2 if closed else n - 1
    worst, apart, power = 0.0, 1, 1
    while apart <= reach:
        farthest = 0
        for k in range(n if closed else n - apart):
            other = k + apart
            farthest = max(farthest, squared_distance(cells, k, other - n if other >= n else other))
        worst = max(worst, farthest / apart)
        if apart == power and power > 1:
            apart = power + power // 2
        else:
            power *= 2
            apart = power
    return worst


@kernel
def fill_position(cells, position):
    """Write each cell's number on the tour to ``position``. Return the number of the first repeated
    cell, or -1 if none repeats.
    """
    for k in range(len(cells)):
        z, y, x = cells[k, 0], cells[k, 1], cells[k, 2]
        if position[z, y, x] >= 0:
            return k
        position[z, y, x] = k
    return -1
