"""Graphs whose edges lead both ways."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass

Numbers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Graph:
    """A graph in compressed rows. Its searches are compiled, because the import of SciPy's takes
    longer than most plans.

    Parameters
    ----------
    first : ndarray of int64, shape (n + 1,)
        Number of the first edge of each node, and the number of all edges.
    ends : ndarray of int64, shape (e,)
        The node to which each edge leads; the edges of a node are in increasing order.
    lengths : ndarray of float64, shape (e,)
        Length of each edge, above 0.
    """

    first: Numbers
    ends: Numbers
    lengths: NDArray[np.float64]

    @classmethod
    def from_edges(
        cls, sources: Numbers, targets: Numbers, lengths: NDArray[np.float64], n: int
    ) -> Graph:
        """Return the graph of ``n`` nodes in which edges connect ``sources`` and ``targets``,
        all of shape (k,).

        Examples
        --------
        >>> graph = Graph.from_edges(np.array([0, 1]), np.array([1, 2]), np.array([1.5, 2.0]), 4)
        >>> graph.distances(2).tolist(), graph.predecessors(2).tolist(), graph.components().tolist()
        ([3.5, 2.0, 0.0, inf], [1, 2, -1, -1], [0, 0, 0, 1])
        """
        begins, ends = np.concatenate([sources, targets]), np.concatenate([targets, sources])
        order = np.lexsort((ends, begins))
        first = np.searchsorted(begins[order], np.arange(n + 1))
        return cls(first, ends[order].astype(np.int64), np.concatenate([lengths, lengths])[order])

    def distances(self, node: int) -> NDArray[np.float64]:
        """Return the distances from a node to all nodes, or infinity; float64, shape (n,)."""
        from shoal.search.kernels.graphs import distances_from

        return np.asarray(distances_from(self.first, self.ends, self.lengths, int(node)))

    def path(self, away: NDArray[np.float64], node: int) -> Numbers:
        """Return the nodes of the shortest path to a node from that with the distances ``away``,
        with both; int64, shape (k,). If there is no path, the result is empty.

        Of several shortest paths it is the one that, seen from its end, comes from the node with
        the lowest number.
        """
        from shoal.search.kernels.graphs import path_to

        return np.asarray(path_to(self.first, self.ends, self.lengths, away, int(node)))

    def predecessors(self, node: int, last: int = -1) -> Numbers:
        """Return the node before each node on a path of the fewest edges from a node, or -1; int64,
        shape (n,). If the node ``last`` is given, only the nodes before it are sure to have one.
        """
        from shoal.search.kernels.graphs import breadth_first_predecessors

        return np.asarray(breadth_first_predecessors(self.first, self.ends, int(node), int(last)))

    def components(self) -> Numbers:
        """Return the number of each node's connected part; int64, shape (n,)."""
        from shoal.search.kernels.graphs import connected_components

        return np.asarray(connected_components(self.first, self.ends))
