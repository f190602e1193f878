"""Cells in the order of their path length from one of them, and connected parts."""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel, kernel


@kernel
def nearest_cells(free, offsets, start, count):
    """Return up to ``count`` free cells connected to ``start``, nearest first; flat indices in breadth-first order.

    Neighbours are visited in the order of ``offsets``; no cell of the rim may be free.
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


@in_place_kernel
def label_parts(free, offsets, labels, stack):
    """Label the connected parts of the free cells from 1 on, in the order of their first cells; return how many there are.

    ``labels`` is 0 everywhere, ``stack`` has room for all free cells, no cell of the rim may be free.
    """
    parts = 0
    for first in range(free.shape[0]):
        if not free[first] or labels[first] != 0:
            continue
        parts += 1
        labels[first], stack[0], size = parts, first, 1
        while size > 0:
            size -= 1
            cell = stack[size]
            for offset in offsets:
                neighbour = cell + offset
                if free[neighbour] and labels[neighbour] == 0:
                    labels[neighbour] = parts
                    stack[size] = neighbour
                    size += 1
    return parts
