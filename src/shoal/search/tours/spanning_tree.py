"""Spanning-tree coverage: a closed tour around a spanning tree of 2 x 2 blocks, for any region with obstacles and holes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.search.tours.base import TOURS
from shoal.search.tours.codec import hilbert_encode
from shoal.search.tours.masks import components, smallest_part
from shoal.search.tours.tour import Tour


@TOURS.register("spanning-tree")
class SpanningTreeTour:
    """A tour around a spanning tree of the full 2 x 2 blocks, extended by the cells outside full blocks.

    The method follows Gabriely and Rimon, "Spanning-tree based coverage of continuous areas by a mobile robot", Annals of
    Mathematics and Artificial Intelligence 31, 2001. In a region of full blocks, all steps of the tour lead to neighbouring cells.
    Of the four alignments of blocks, the tour uses the alignment with the largest number of full blocks. The spanning tree consists
    of straight corridors and a spine that connects them, because a tree of this shape gives few turns.

    The tour takes in cells outside full blocks in two stages. In the first stage, the tour takes in, without a detour, pairs of
    cells beside its edges, and full blocks that are not aligned with the other blocks. In the second stage, the tour connects
    cycles of cells that are still separate, where a single cell counts as a cycle. To connect two cycles, the tour replaces one
    edge of each cycle by two steps from cycle to cycle. One step between two connected cycles leads to a neighbouring cell, and the
    other step may be longer: a diagonal to a single cell, or the way back from a narrow dead end.

    Parameters
    ----------
    along_rows : bool, optional
        Whether the corridors run along the rows of cells, and not across them. By default, the corridors run in the direction in
        which more blocks are neighbours.
    """

    name = "spanning-tree"
    dimensions: tuple[int, ...] = (2,)

    along_rows: bool | None = None  # the default for subclasses whose initializer does not set it

    def __init__(self, along_rows: bool | None = None) -> None:
        self.along_rows = along_rows

    def make(self, mask: NDArray[np.bool_]) -> Tour:
        """Return the tour through all True cells of the mask."""
        from shoal.search.kernels import attaching, cycles

        low, region = smallest_part(mask)
        # From the bottom up, like the curves: rows are reversed here and reversed again below.
        region = np.ascontiguousarray(region[::-1])
        links = np.repeat(np.arange(region.size), 2).reshape(-1, 2)
        parent = np.arange(region.size)
        full, origin = _full_blocks(region)
        along_rows = self.along_rows
        if along_rows is None:
            along_rows = bool(np.count_nonzero(full[:, 1:] & full[:, :-1]) >= np.count_nonzero(full[1:] & full[:-1]))
        cycles.tree_of_blocks(full, origin, region.shape[1], along_rows, links, parent)
        cycles.grow_everywhere(region, links, parent)
        attaching.attach(region, links, parent)
        members, starts = _by_component(region)
        order = np.empty(len(members), dtype=np.int64)
        cycles.chains(links, region.shape[1], members, starts, order)
        rows, cols = np.divmod(order, region.shape[1])
        cells = np.stack([len(region) - 1 - rows, cols], axis=1) + low
        return Tour(cells, mask.shape, closed=True, name=self.name)


def _full_blocks(region: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], int]:
    """Return the full 2 x 2 blocks for the best of four alignments, and the flat index of the first block's first cell."""
    square = region[:-1, :-1] & region[1:, :-1] & region[:-1, 1:] & region[1:, 1:]
    row, col = max(
        ((row, col) for row in (0, 1) for col in (0, 1)), key=lambda at: np.count_nonzero(square[at[0] :: 2, at[1] :: 2])
    )
    return np.ascontiguousarray(square[row::2, col::2]), row * region.shape[1] + col


def _by_component(region: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the flat indices of all True cells, sorted by component, and the positions at which components begin and end.

    The components are sorted along a Hilbert curve through their first cells.
    """
    labels = components(region).ravel()
    order = max(1, int(max(region.shape) - 1).bit_length())
    _, first = np.unique(labels, return_index=True)
    first = first[-int(labels.max()) :]  # without the label 0
    rows, cols = np.divmod(first, region.shape[1])
    indices = hilbert_encode(np.stack([2**order - 1 - rows, cols], axis=1), order=order)
    rank = np.empty(len(first) + 1, dtype=np.int64)
    rank[1:][np.argsort(indices)] = np.arange(len(first))
    members = np.flatnonzero(labels)
    of_member = rank[labels[members]]
    return members[np.argsort(of_member, kind="stable")], np.concatenate([[0], np.cumsum(np.bincount(of_member))])
