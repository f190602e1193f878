"""The graph whose nodes are the pieces of cells, and whose edges are the portals between pieces."""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.search.cells.grid import CellGrid
from shoal.search.regions.outline_checks import Points


class PortalGraph:
    """The pieces of a grid's cells, connected by portals.

    Parameters
    ----------
    grid : CellGrid
    """

    def __init__(self, grid: CellGrid) -> None:
        self.grid = grid
        self._n = len(grid.clipped.pieces)

    def through(self, start: Points, end: Points) -> Points | None:
        """Return the start, the portal midpoints and the end of a path through the fewest pieces; float64, shape (k, 2).

        If rounding errors have closed a portal so that no path exists, the result is None.
        """
        from scipy.sparse.csgraph import breadth_first_order

        first, last = self._piece(start), self._piece(end)
        _, came = breadth_first_order(self._graph, first, directed=False)
        way = [last]
        while way[-1] != first:
            if came[way[-1]] < 0:
                return None
            way.append(int(came[way[-1]]))
        way.reverse()
        return np.vstack([start, *(self._gate(*pair) for pair in pairwise(way)), end])

    @cached_property
    def _numbers(self) -> NDArray[np.int64]:
        """Number of the piece or whole cell of each node, as in `shoal.search.cells.portals.Portals`, in increasing order."""
        return np.concatenate([np.arange(self._n), self._n + np.flatnonzero(self.grid.clipped.whole)])

    @cached_property
    def _graph(self) -> Any:
        from scipy.sparse import coo_array

        whole = self.grid.clipped.whole
        flat = self._n + np.arange(whole.size).reshape(whole.shape)
        right, down = whole[:, :-1] & whole[:, 1:], whole[:-1] & whole[1:]
        pairs = np.concatenate(
            [
                self.grid.portals.pairs,
                np.stack([flat[:, :-1][right], flat[:, 1:][right]], axis=1),
                np.stack([flat[:-1][down], flat[1:][down]], axis=1),
            ]
        )
        ends = np.searchsorted(self._numbers, pairs)
        return coo_array((np.ones(len(ends)), tuple(ends.T)), shape=(len(self._numbers),) * 2).tocsr()

    @cached_property
    def _gates(self) -> dict[tuple[int, int], Points]:
        """Midpoint of the widest portal between each pair of connected nodes, in metres."""
        portals = self.grid.portals
        order = np.argsort(portals.widths, kind="stable")  # widest last
        nodes = np.sort(np.searchsorted(self._numbers, portals.pairs[order]), axis=1)
        return {(one, other): portals.middles[k] for (one, other), k in zip(nodes.tolist(), order.tolist(), strict=True)}

    def _gate(self, one: int, other: int) -> Points:
        known = self._gates.get((min(one, other), max(one, other)))
        if known is not None:
            return known
        rows, cols = np.divmod(self._numbers[[one, other]] - self._n, self.grid.shape[1])
        return self.grid.lattice.to_region(self.grid.lattice.centers(rows, cols).mean(axis=0))

    def _piece(self, point: Points) -> int:
        """Return the node whose piece or whole cell is nearest to a point."""
        import shapely

        clipped, lattice = self.grid.clipped, self.grid.lattice
        there = lattice.from_region(point)
        col, row = (there - [lattice.left, lattice.top]) * [1, -1] / lattice.size
        near = np.flatnonzero((np.abs(clipped.rows + 0.5 - row) <= 1.5) & (np.abs(clipped.cols + 0.5 - col) <= 1.5))
        r, c = np.clip([int(row), int(col)], 0, np.array(lattice.shape) - 1)
        if clipped.whole[r, c]:
            return int(np.searchsorted(self._numbers, self._n + r * lattice.shape[1] + c))
        numbers = near if len(near) else np.arange(self._n)
        return int(numbers[np.argmin(shapely.distance(clipped.pieces[numbers], shapely.points(there)))])
