"""The comb tour: straight lanes back and forth, with one column reserved for the way back.

The comb tour has few turns, and the way from its last cell to its first cell is one step long.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.search.tours.base import TOURS, TourByOrder
from shoal.search.tours.masks import component_after_component


@TOURS.register("comb")
class CombTour(TourByOrder):
    """Straight lanes back and forth, with one column (or one row) beside the lanes that leads back to the start.

    In a rectangle of at least 2 x 2 cells, all steps lead to neighbouring cells, except for one diagonal step if both sides are
    odd. If both sides of the rectangle are odd, the tour zigzags through the last two lanes. In a single row of cells, the step
    from the last cell back to the first is as long as the row.

    On a shape that is not a rectangle, the tour is the shortest of three tours: the comb of the bounding rectangle without the
    cells outside the shape, a sweep back and forth along rows, and a sweep back and forth along columns.

    Parameters
    ----------
    along_rows : bool, optional
        Whether the lanes run along the rows of cells, and not along the columns. By default, the tour maker chooses the direction.
    """

    name = "comb"

    along_rows: bool | None = None  # the default for subclasses whose initializer does not set it

    def __init__(self, along_rows: bool | None = None) -> None:
        self.along_rows = along_rows

    def _in_order(self, region: NDArray[np.bool_]) -> NDArray[np.int64]:
        rows, cols = region.shape
        cells = closed_lanes(rows, cols, self.along_rows)
        if region.all():
            return cells
        sweeps = _sweeps(region)
        ways = [cells[region[tuple(cells.T)]], *(sweeps if self.along_rows is None else sweeps[1 - self.along_rows :][:1])]
        return min((component_after_component(way, region) for way in ways), key=_length)


def closed_lanes(rows: int, cols: int, along_rows: bool | None = None) -> NDArray[np.int64]:
    """Return the cells of a full rectangle in the order of the comb tour; int64, shape (rows * cols, 2).

    By default, the lanes run in the direction that gives an even number of lanes. If the numbers of rows and columns are both even
    or both odd, the lanes run along the longer side.
    """
    if along_rows is None:
        along_rows = min(rows, cols) == 1 or not (cols < rows if rows % 2 == cols % 2 else rows % 2 == 1)
    grid = np.arange(rows * cols).reshape(rows, cols)[::-1]  # from the bottom up
    if not along_rows and min(rows, cols) > 1:
        grid = grid.T
    count, width = grid.shape
    if min(count, width) == 1:
        order = grid.ravel()
    else:
        straight = count if count % 2 == 0 else count - 2
        lanes = grid[:straight, 1:].copy()
        lanes[1::2] = lanes[1::2, ::-1]
        across = grid[straight:, :0:-1].T.copy()  # for an odd number of lanes: the last two lanes, column by column
        across[1::2] = across[1::2, ::-1]
        order = np.concatenate([grid[0, :1], lanes.ravel(), across.ravel(), grid[:0:-1, 0]])
    return np.stack(np.divmod(order, cols), axis=1)


def _sweeps(region: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """Return two orders of the cells: a sweep along rows from the bottom up, and a sweep along columns from left to right."""
    from shoal.search.kernels.lanes import sweep_all

    upward, across = np.empty((2, np.count_nonzero(region), 2), dtype=np.int64)
    sweep_all(np.ascontiguousarray(region[::-1]), upward)
    upward[:, 0] = len(region) - 1 - upward[:, 0]
    sweep_all(np.ascontiguousarray(region.T), across)
    return [upward, np.ascontiguousarray(across[:, ::-1])]


def _length(cells: NDArray[np.int64]) -> float:
    return float(np.sqrt(((cells - np.roll(cells, -1, axis=0)) ** 2).sum(axis=1)).sum())
