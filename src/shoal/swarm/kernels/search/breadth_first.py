"""The cells nearest to a start cell, in the order of their path lengths."""

from __future__ import annotations

import numpy as np

from shoal.jit import kernel


@kernel
def nearest_cells(free, offsets, start, count):
    """Return the flat indices of the ``count`` free cells nearest to ``start``, in the order of their path length from ``start``.

    The result is shorter if fewer than ``count`` free cells are connected to ``start``. The breadth-first search visits neighbours
    in the order of ``offsets``. No cell at the border of the grid may be free.
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
