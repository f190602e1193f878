"""Cells in order of their path length from a start cell."""

from __future__ import annotations

import numpy as np

from shoal.jit import kernel


@kernel
def nearest_cells(free, offsets, start, count):
    """Return up to ``count`` free cells connected to ``start``, nearest first, as flat indices in breadth-first order.

    Neighbours are visited in the order of ``offsets``. No cell of the rim may be free.
    """
    reached = np.zeros(free.shape[0], dtype=np.bool_)
    queue = np.empty(count, dtype=np.int64)
    queue[0], reached[start], size, at = start, True, 1, 0
    while at < size:
        for offset in offsets:
            neighbour = queue[at] + offset
            if size < count and free[neighbour] and not reached[neighbour]:
                reached[neighbour] = True
                queue[size] = neighbour
                size += 1
        at += 1
    return queue[:size].copy()
