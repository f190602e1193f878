"""The boustrophedon tour: back and forth along rows of cells, in an order that keeps the ways between rows short."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.search.tours.base import TOURS, TourByOrder

MOST_RUNS = 1500
"""Maximum number of runs whose order Shoal improves.

A tour with more runs keeps the order of the boustrophedon decomposition.
"""


DISTURBANCES = 300
"""Default number of random exchanges of runs."""


@TOURS.register("boustrophedon")
class BoustrophedonTour(TourByOrder):
    """A tour that crosses each run without interruption, with about two turns for each run.

    A run is a sequence of consecutive cells in one row. The runs first get the order of Choset's boustrophedon decomposition
    ("Coverage of known spaces: the boustrophedon cellular decomposition", Autonomous Robots 9, 2000). Two kinds of exchanges
    shorten the connections between runs. A 2-opt exchange replaces two connections by two new connections. An Or-opt exchange moves
    up to three runs to another place on the tour. The step from the last run back to the first run also counts as a connection.

    Parameters
    ----------
    disturbances : int
        Number of random exchanges of runs. After each random exchange, the order of the runs is improved again.
    """

    name = "boustrophedon"

    def __init__(self, disturbances: int = DISTURBANCES) -> None:
        self.disturbances = disturbances

    def _in_order(self, region: NDArray[np.bool_]) -> NDArray[np.int64]:
        return _cells_in_order(np.ascontiguousarray(region), self.disturbances)


def _cells_in_order(region: NDArray[np.bool_], disturbances: int) -> NDArray[np.int64]:
    from shoal.search.kernels import lanes, run_order

    cells = np.empty((np.count_nonzero(region), 2), dtype=np.int64)
    lanes.sweep_all(region, cells)
    runs = lanes.runs_of(region)
    if len(runs) > MOST_RUNS:
        return cells
    number = np.full(region.shape, -1)
    number[tuple(cells[np.lexsort(cells.T[::-1])].T)] = np.repeat(np.arange(len(runs)), runs[:, 2] - runs[:, 1])
    of_cell = number[tuple(cells.T)]
    begins = np.flatnonzero(np.diff(of_cell, prepend=-1))
    order = of_cell[begins]
    backwards = np.empty(len(runs), dtype=np.int64)
    backwards[order] = cells[begins, 1] != runs[order, 1]
    ends = np.stack([runs[:, [0, 1]], runs[:, [0, 2]] - [0, 1]], axis=1).astype(np.float64)
    run_order.shorten(ends, order, backwards, disturbances)
    rows = [
        np.arange(begin, end)[:: -1 if back else 1] for (_, begin, end), back in zip(runs[order], backwards[order], strict=True)
    ]
    return np.stack([np.repeat(runs[order, 0], [len(row) for row in rows]), np.concatenate(rows)], axis=1)
