"""H-trees: bars that fork at right angles, each pair of levels half as long as the pair before.

The map of the paper has 5000 free cells. The smallest regular tree with at least as many has 5953, with bars of half-lengths
32, 32, 16, 16, 8, 8, 4, 4, 2, 2; cutting the branches of one corner, deepest first, reproduces the published means of the
closest-frontier policy within 5 %. A tree with one more level, of half-length 1, misses them by 25 to 35 %.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.errors import InvalidInputError
from shoal.swarm.generators.sizes import MAX_CELLS

Indices = NDArray[np.int64]


def draw_htree(count: int) -> NDArray[np.bool_]:
    """Return an H-tree with exactly ``count`` free cells: a tree, no loops, corridors one cell wide.

    It is the smallest regular tree with enough cells; the branches of the lower left corner are cut off, deepest first,
    until ``count`` cells remain.

    Parameters
    ----------
    count : int
        Number of free cells, at least 1.

    Returns
    -------
    ndarray, bool, shape (H, W)
        True where free; 125×125 for 5000 cells.

    Raises
    ------
    InvalidInputError
        If the picture would have more than ``MAX_CELLS`` cells.

    Source: paper M, Fig. 7 (map "H-tree").
    """
    halves = half_lengths(count)
    width, height = 1 + 2 * sum(halves[::2]), 1 + 2 * sum(halves[1::2])
    if width * height > MAX_CELLS:
        raise InvalidInputError(
            f"expected an H-tree whose picture has at most {MAX_CELLS} cells, got {count} free cells in {height}x{width}"
        )
    return draw_bars(halves, count)


def half_lengths(count: int) -> tuple[int, ...]:
    """Return the half-lengths of the bars, level by level, of the smallest tree with ``count`` cells or more.

    >>> half_lengths(5000)
    (32, 32, 16, 16, 8, 8, 4, 4, 2, 2)
    """
    levels = 0
    while tree_size(_regular(levels)) < count:
        levels += 1
    return _regular(levels)


def tree_size(halves: tuple[int, ...]) -> int:
    """Return the number of cells of the whole tree: level k has 2^(k+1) half bars."""
    return 1 + sum(half << (level + 1) for level, half in enumerate(halves))


def draw_bars(halves: tuple[int, ...], count: int) -> NDArray[np.bool_]:
    """Return the tree with these half-lengths, cut down to ``count`` cells.

    Parameters
    ----------
    halves : tuple of int
        Half-length of the bars of each level; even levels are horizontal, odd ones vertical.
    count : int
        Cells to keep, from 1 to ``tree_size(halves)``.

    Returns
    -------
    ndarray, bool, shape (H, W)
        True where free, no empty rim.
    """
    row, column, level = _arms(halves)
    length = np.array(halves, dtype=np.int64)[level]
    # What is cut from each arm: all arms in turn, until enough cells are gone.
    before = np.cumsum(length) - length
    kept = length - np.clip(tree_size(halves) - count - before, 0, length)
    arm = np.repeat(np.arange(len(kept)), kept)
    along = 1 + np.arange(len(arm)) - np.repeat(np.cumsum(kept) - kept, kept)
    rows = np.append(row[0][arm] + along * row[1][arm], 0)
    columns = np.append(column[0][arm] + along * column[1][arm], 0)
    rows, columns = rows - rows.min(), columns - columns.min()
    free = np.zeros((rows.max() + 1, columns.max() + 1), dtype=np.bool_)
    free[rows, columns] = True
    return free


def _regular(levels: int) -> tuple[int, ...]:
    """Return halving half-lengths, two levels each, that end with 2."""
    return tuple(2 ** ((levels - level + 1) // 2) for level in range(levels))


def _arms(halves: tuple[int, ...]) -> tuple[tuple[Indices, Indices], tuple[Indices, Indices], Indices]:
    """Return all half bars in the order in which they are cut: (row, its step), (column, its step), level.

    An arm starts next to ``(row, column)``. Arms beyond an arm come before it, and of the two arms at a fork the one that
    leads left or down comes with all that is beyond it first: so the lower left corner goes first, branch by branch.
    """
    depth = len(halves)
    levels, last_leaf, starts, steps = [], [], [], []
    centre = np.zeros((1, 2), dtype=np.int64)
    for level, half in enumerate(halves):
        step = np.array([[0, -1], [0, 1]] if level % 2 == 0 else [[1, 0], [-1, 0]])
        start, direction = np.repeat(centre, 2, axis=0), np.tile(step, (len(centre), 1))
        centre = start + half * direction
        levels.append(np.full(len(centre), level))
        last_leaf.append(np.arange(1, len(centre) + 1) << (depth - 1 - level))
        starts.append(start)
        steps.append(direction)
    if not halves:
        nothing = np.zeros(0, dtype=np.int64)
        return (nothing, nothing), (nothing, nothing), nothing
    level = np.concatenate(levels)
    order = np.lexsort((-level, np.concatenate(last_leaf)))
    start, direction = np.concatenate(starts)[order], np.concatenate(steps)[order]
    return (start[:, 0], direction[:, 0]), (start[:, 1], direction[:, 1]), level[order]
