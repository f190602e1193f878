"""Cells in the order of their path length from one of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import kernel
from shoal.swarm.kernels.dynamics.bits import has, put
from shoal.swarm.kernels.search.frontier_search import ahead


class Flood(NamedTuple):
    """A flood in progress: the free cells, those reached, and the queue of both coordinates."""

    free: NDArray[np.uint64]
    reached: NDArray[np.uint64]
    queue: NDArray[np.int32]  # (n, 2): row, column
    layers: int
    rows: int
    width: int


@kernel
def flood(state, row, column):
    """Fill ``reached`` breadth-first from one cell until the queue is full; return how many cells were reached."""
    queue, size = state.queue, 1
    queue[0, 0], queue[0, 1] = row, column
    put(state.reached, state.width, row, column)
    directions = 4 if state.layers == 1 else 6
    for at in range(queue.shape[0]):
        if at == size:
            break
        for command in range(directions):
            r, c = ahead(queue[at, 0], queue[at, 1], command, state.rows)
            if size < queue.shape[0] and has(state.free, state.width, r, c) and not has(state.reached, state.width, r, c):
                put(state.reached, state.width, r, c)
                queue[size, 0], queue[size, 1] = r, c
                size += 1
    return size


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
