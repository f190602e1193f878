"""A closed generalized Hilbert curve for any rectangle or box: out through one half and back through the other half."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.search.tours.base import TOURS, TourByOrder


@TOURS.register("hilbert-rectangle")
class HilbertRectangleTour(TourByOrder):
    """Two generalized Hilbert curves side by side through the smallest box around the True cells, closed by one step.

    In a rectangle of at least 2 x 2 cells, all steps lead to neighbouring cells, except for one diagonal step if both sides are
    odd. In a three-dimensional box with odd sides, some steps are diagonals of a square. In a single row of cells, the step from
    the last cell back to the first is as long as the row.
    """

    name = "hilbert-rectangle"
    dimensions: tuple[int, ...] = (2, 3)

    def _in_order(self, region: NDArray[np.bool_]) -> NDArray[np.int64]:
        cells = closed_path(region.shape)
        return cells if region.all() else cells[region[tuple(cells.T)]]


def closed_path(shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Return the cells of a full box in the order of its closed generalized Hilbert curve; int64, shape (N, dimensions).

    The curve runs out through one half of the box, and back through the other half. The way out and the way back lead along the
    longest even side of the box, or along its longest side if all sides are odd.
    """
    from shoal.search.kernels.rectangle import walk_box

    sides = (*reversed(shape), 1)[:3]  # x, y, z
    cells = np.empty((int(np.prod(sides)), 3), dtype=np.int64)
    along = max(range(3), key=lambda axis: (sides[axis] > 1, sides[axis] % 2 == 0, sides[axis]))
    across, deep = sorted((axis for axis in range(3) if axis != along), key=lambda axis: -sides[axis])
    axes = np.array([along, across, deep])
    start, lower = [0, 0, 0], sides[across] // 2
    if sides[deep] > 1 and lower > 2 and lower % 2 == 1:
        lower += 1  # in 3-D, a path along even sides needs no diagonals
    if lower == 0:
        walk_box((0, 0, 0), axes, np.array([sides[along], 1, 1]), cells, 0)
    else:
        start[across] = lower - 1
        at = walk_box((start[0], start[1], start[2]), axes, np.array([sides[along], -lower, sides[deep]]), cells, 0)
        start[along], start[across] = sides[along] - 1, lower
        walk_box((start[0], start[1], start[2]), axes, np.array([-sides[along], sides[across] - lower, sides[deep]]), cells, at)
    cells[:, 1] = sides[1] - 1 - cells[:, 1]  # y counts from the bottom, rows from the top
    return np.ascontiguousarray(cells[:, len(shape) - 1 :: -1])
