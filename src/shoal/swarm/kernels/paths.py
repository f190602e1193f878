"""Free cells in the order of their path from one of them."""

from __future__ import annotations

import numpy as np

from shoal.swarm.kernels.compiling import kernel


@kernel
def path_lengths(free, shape, start):
    """Return the free cells connected to ``start``, flat indices in breadth-first order; no cell of the rim may be free."""
    reached = np.zeros(free.shape[0], dtype=np.bool_)
    queue = np.empty(free.shape[0], dtype=np.int64)
    queue[0], reached[start], size, at = start, True, 1, 0
    steps = np.array([1, shape[2], shape[1] * shape[2]])
    while at < size:
        for step in steps:
            for neighbour in (queue[at] - step, queue[at] + step):
                if free[neighbour] and not reached[neighbour]:
                    reached[neighbour] = True
                    queue[size] = neighbour
                    size += 1
        at += 1
    return queue[:size].copy()
