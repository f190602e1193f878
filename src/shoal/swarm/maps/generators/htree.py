"""H-tree maps: bars that fork at right angles. After every two levels of forks, the bars become half as long.

The H-tree map of paper M has 5000 free cells. The smallest regular tree with at least 5000 cells has 5953 cells. The bars of the
tree with 5953 cells have half-lengths of 32, 32, 16, 16, 8, 8, 4, 4, 2 and 2 cells. The generator removes one branch after another
from the tree of 5953 cells, beginning at one corner, until 5000 cells remain. On the H-tree map of 5000 cells, the mean number of
moves of the closest-frontier policy differs from the published mean by at most 10 %. A tree with one more level of bars, whose
half-length is 1 cell, has loops because its bars touch. On a map cut from a tree with loops, the mean number of moves is up to 38 %
lower than the published mean.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.swarm.maps.reading import MAX_CELLS

LEFT_RIGHT = np.array([[0, -1], [0, 1]])
DOWN_UP = np.array([[1, 0], [-1, 0]])


def draw_htree(count: int) -> NDArray[np.bool_]:
    """Return a map of an H-tree with exactly ``count`` free cells. The H-tree has no loops, and its corridors are one cell wide.

    The generator draws the smallest regular tree with at least ``count`` cells, and removes cells until ``count`` cells remain. The
    removal begins at the tips of the branches in the lower left corner.

    Parameters
    ----------
    count : int
        Number of free cells, at least 1.

    Returns
    -------
    ndarray, bool, shape (H, W)
        True at free cells. A map of 5000 free cells has the shape (125, 125).

    Raises
    ------
    InvalidInputError
        Raised if the map would have more than ``MAX_CELLS`` free and obstacle cells.

    Source: paper M, figure 7 (map "H-tree").
    """
    halves = half_lengths(count)
    width, height = 1 + 2 * sum(halves[::2]), 1 + 2 * sum(halves[1::2])
    if width * height > MAX_CELLS:
        raise InvalidInputError(
            f"expected an H-tree in a picture of at most {MAX_CELLS} cells, got {count} free cells, which need {height}x{width}"
        )
    return draw_bars(halves, count)


def half_lengths(count: int) -> tuple[int, ...]:
    """Return the half-lengths, in cells, of the bars at each level of the smallest H-tree with at least ``count`` cells.

    >>> half_lengths(5000)
    (32, 32, 16, 16, 8, 8, 4, 4, 2, 2)
    """
    levels = 0
    while tree_size(_regular(levels)) < count:
        levels += 1
    return _regular(levels)


def tree_size(halves: tuple[int, ...]) -> int:
    """Return the number of cells of the H-tree with the given half-lengths. Level k, counted from 0, has 2^(k+1) half bars."""
    return 1 + sum(half << (level + 1) for level, half in enumerate(halves))


def draw_bars(halves: tuple[int, ...], count: int) -> NDArray[np.bool_]:
    """Return a map of the H-tree whose bars have the given half-lengths, cut down to ``count`` cells.

    Parameters
    ----------
    halves : tuple of int
        Half-length of the bars at each level of the tree, in cells. Bars at even levels are horizontal, and bars at odd levels are
        vertical.
    count : int
        Number of cells to keep, from 1 to ``tree_size(halves)``.

    Returns
    -------
    ndarray, bool, shape (H, W)
        True at free cells. The map has no border rows or columns of obstacles.
    """
    cells = np.zeros((1, 2), dtype=np.int64)
    if halves:
        arms = _arms(halves)
        # Cut one arm after the other, from its tip, until enough cells are removed.
        cut = tree_size(halves) - count - (np.cumsum(arms.length) - arms.length)
        kept = arms.length - np.clip(cut, 0, arms.length)
        arm = np.repeat(np.arange(len(kept)), kept)
        along = 1 + np.arange(len(arm)) - np.repeat(np.cumsum(kept) - kept, kept)
        cells = np.concatenate([cells, arms.start[arm] + along[:, None] * arms.step[arm]])
        cells -= cells.min(axis=0)
    free = np.zeros(cells.max(axis=0) + 1, dtype=np.bool_)
    free[cells[:, 0], cells[:, 1]] = True
    return free


class _Arms(NamedTuple):
    """Arms (half bars) of an H-tree. Each arm has the cells ``start + step``, ..., ``start + length * step``."""

    start: NDArray[np.int64]  # (arms, 2), row and column
    step: NDArray[np.int64]  # (arms, 2)
    length: NDArray[np.int64]  # (arms,)


def _regular(levels: int) -> tuple[int, ...]:
    """Return the half-length of the bars at each level of a regular H-tree, in cells.

    The half-length is 2 cells at the last two levels, 4 cells at the two levels before them, and so on.
    """
    return tuple(2 ** ((levels - level + 1) // 2) for level in range(levels))


def _arms(halves: tuple[int, ...]) -> _Arms:
    """Return all arms of an H-tree in the order in which the generator removes them.

    Each arm comes after all arms that grow from it. At each fork, the left or lower arm, with all arms that grow from it, comes
    before the opposite arm. In this order, the generator removes one branch after another, beginning in the lower left corner.
    """
    starts, steps, lengths, levels, last_leaves = [], [], [], [], []
    tips = np.zeros((1, 2), dtype=np.int64)
    for level, half in enumerate(halves):
        start = np.repeat(tips, 2, axis=0)
        step = np.tile(DOWN_UP if level % 2 else LEFT_RIGHT, (len(tips), 1))
        tips = start + half * step
        starts.append(start)
        steps.append(step)
        lengths.append(np.full(len(tips), half))
        levels.append(np.full(len(tips), level))
        # Number the tips of the whole tree from the corner. Each arm is cut together with the last tip that it leads to.
        last_leaves.append(np.arange(1, len(tips) + 1) << (len(halves) - 1 - level))
    order = np.lexsort((-np.concatenate(levels), np.concatenate(last_leaves)))
    return _Arms(np.concatenate(starts)[order], np.concatenate(steps)[order], np.concatenate(lengths)[order])
