"""Exchanging: changes of the order of cells that make a closed tour shorter, where each turn counts
as some extra length.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shoal.search.cells.grid import CellGrid
from shoal.search.cells.visibility_graph import length_of
from shoal.search.flight.timing import turns_of
from shoal.search.tours import Tour

MOST = 30_000
"""Maximum number of cells for exchanges. The computing time grows with the square of the number of
cells.
"""


def exchanged(grid: CellGrid, tour: Tour, turn: float) -> tuple[Tour, float]:
    """Return a tour shortened by exchanges of its links and moves of its cells, and its estimated
    cost in cells.

    After the exchanges, the links between distant rows, and the link from the last cell to the
    first, lead along the ends of the rows. Therefore a robot searches cells even on these links.

    Parameters
    ----------
    grid : CellGrid
    tour : Tour
        A closed tour of all cells.
    turn : float
        Cost of a turn in cells.
    """
    from shoal.search.kernels.shortening.cell_exchanges import shorten

    cells, order = tour.cells, np.arange(len(tour.cells))
    viewpoints = grid.viewpoints[grid.viewpoint_starts[grid.ordinals(cells)]] / grid.size
    shorten(viewpoints, cells, beside_on_tour(grid, cells), order, turn)
    way = viewpoints[np.concatenate([order, order[:2]])]
    return replace(tour, cells=cells[order]), length_of(way[:-1]) + turn * int(turns_of(way).sum())


def beside_on_tour(grid: CellGrid, cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the tour indices of the 3 x 3 cells around each cell, row by row; -1 if a vehicle
    cannot move there directly.
    """
    number = np.full(np.add(grid.shape, 2), -1)
    number[tuple(cells.T + 1)] = np.arange(len(cells))
    south, east = np.zeros((2, *number.shape), dtype=np.bool_)
    south[1:-2, 1:-1], east[1:-1, 1:-2] = grid.doors_south, grid.doors_east
    doors = {
        (1, 0): south,
        (-1, 0): np.roll(south, 1, axis=0),
        (0, 1): east,
        (0, -1): np.roll(east, 1, axis=1),
    }
    found = np.full((*number.shape, 9), -1)
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            if down and right:  # diagonally, past one of the two cells beside the step
                rows, cols = doors[down, 0], doors[0, right]
                free = (rows & np.roll(cols, -down, axis=0)) | (
                    cols & np.roll(rows, -right, axis=1)
                )
            else:
                free = doors.get((down, right), number >= 0)
            found[free, 4 + 3 * down + right] = np.roll(number, (-down, -right), axis=(0, 1))[free]
    return np.asarray(found[tuple(cells.T + 1)])
