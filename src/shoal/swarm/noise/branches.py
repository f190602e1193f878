"""The cells behind each cell of a map: the cells that particles reach only through it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.swarm.grid.board import Board


def cells_behind(free: Board, roots: Board) -> NDArray[np.int64]:
    """Return for each free cell the number of free cells that become unreachable from ``roots`` if the cell is a wall.

    Of a root, the function returns 0.

    Parameters
    ----------
    free : Board
    roots : Board
        The cells from which particles start. A part of the map without a root gets one of its cells as root.

    Returns
    -------
    ndarray of int64, shape (n,)
        In the order of ``free.cells``.

    Notes
    -----
    Source: Hopcroft and Tarjan (1973), Efficient algorithms for graph manipulation: a depth-first search, in which the subtree of a
    child belongs behind its parent if no edge leads from it to a cell found before the parent.

    Examples
    --------
    >>> free = Board.of_mask(np.array([[1, 1, 1, 1], [1, 1, 0, 0]], dtype=bool))
    >>> cells_behind(free, Board.of_cells(free.layout, [(1, 0)])).tolist()
    [0, 2, 1, 0, 0, 0]
    """
    index = np.full(free.layout.window, -1, dtype=np.int64)
    mask = free.mask
    index[mask] = np.arange(len(free))
    beside = [np.roll(index, way, axis)[mask] for axis in range(index.ndim) for way in (-1, 1)]
    neighbours = np.stack(beside, axis=1).tolist()  # a board never reaches around its rim: both sides would have to be free
    starts = [i for i in index[(roots & free).mask].tolist() if i >= 0]
    count = len(neighbours)
    found, low, size, behind = [0] * count, [0] * count, [1] * count, [0] * count
    outside = set(starts)
    time = 1  # all roots are found at time 1, as if one cell outside the map joined them
    for first in [*starts, *range(count)]:
        if found[first]:
            continue
        time += 1
        found[first] = time
        low[first] = 1 if first in outside else time
        stack = [(first, -1, iter(neighbours[first]))]
        while stack:
            cell, parent, rest = stack[-1]
            for other in rest:
                if other < 0 or other == parent:
                    continue
                if found[other]:
                    low[cell] = min(low[cell], found[other])
                    continue
                time += 1
                found[other] = time
                low[other] = 1 if other in outside else time
                stack.append((other, cell, iter(neighbours[other])))
                break
            else:
                stack.pop()
                if stack:
                    before = stack[-1][0]
                    size[before] += size[cell]
                    low[before] = min(low[before], low[cell])
                    if low[cell] >= found[before]:
                        behind[before] += size[cell]
    sizes = np.array(behind, dtype=np.int64)
    sizes[starts] = 0
    return sizes
