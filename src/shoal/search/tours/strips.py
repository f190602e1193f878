"""Strips: the division of cells into few straight strips, along rows and columns, and the detours of
links between them.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

MOST_CELLS = 30_000
"""Maximum number of cells that are divided; in larger regions, all strips are rows."""

STRIP = 2000
"""Cost of a strip: costs of strips and preferences of cells are whole numbers."""

_MOST_SEARCHED = 300_000  # cells times ends of strips: larger regions take all links as straight
_DENT = 0.75  # cells: dents of a border that are less deep are those of cells
_AROUND = 0.05  # cells by which a link around a corner is longer at least
_ROWS = 2  # preference for rows where nothing else decides
_BORDER = 800  # preference for the direction of the nearest border, in an arm of two cells


def straight_strips(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return few strips that contain all True cells of a mask; int64, shape (S, 2, 2): first and
    last cell of each strip as (row, column).

    A strip is a sequence of neighbouring cells in a row or in a column. Let x_c be 1 if the strip
    of the cell c runs along its row, and 0 otherwise. Strips have as many cells as steps plus one,
    so their number is

        sum_c 1 - sum_(a, b) x_a x_b - sum_(a, d) (1 - x_a) (1 - x_d)

    over all neighbours (a, b) in a row and (a, d) in a column. The products enter with a minus, so
    a minimum cut finds the best x (Ramesh, Imeson, Fidan and Smith, "Optimal partitioning of
    non-convex environments for minimum turn coverage planning", RA-L 7, 2022, solve the same
    problem as a linear program). The cut minimizes the number minus what `preferences` of the cells
    in rows add up to.

    Examples
    --------
    >>> shape = np.array([[True, True, True], [True, False, False], [True, False, False]])
    >>> straight_strips(shape).tolist()
    [[[0, 0], [0, 2]], [[1, 0], [2, 0]]]
    """
    along = mask if np.count_nonzero(mask) > MOST_CELLS else along_rows(mask)
    across = np.ascontiguousarray((mask & ~along).T)
    return np.concatenate([runs_in(along), runs_in(across)[..., ::-1]])


def cells_of_strip(strip: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return all cells of a strip that is given by its first and last cell; int64, shape (k, 2)."""
    step = strip[1] - strip[0]
    return np.asarray(strip[0] + np.arange(np.abs(step).max() + 1)[:, None] * np.sign(step))


def along_rows(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the cells whose strips run along their rows; bool, of the shape of the mask."""
    from shoal.search.kernels.cuts import source_side

    number = np.full(mask.shape, -1)
    count = np.count_nonzero(mask)
    number[mask] = np.arange(count)
    beside, below = mask[:, 1:] & mask[:, :-1], mask[1:] & mask[:-1]
    rows = np.stack([number[:, :-1][beside], number[:, 1:][beside]])
    columns = np.stack([number[:-1][below], number[1:][below]])
    # x_a x_b = (x_a + x_b - |x_a - x_b|) / 2: each step in a row rewards both of its cells for
    # being in a row, and each step between cells of different strips costs half a strip.
    gain = (
        STRIP
        // 2
        * (
            np.bincount(rows.ravel(), minlength=count)
            - np.bincount(columns.ravel(), minlength=count)
        )
    )
    gain += preferences(mask)[mask]
    first, second = np.concatenate([rows, columns], axis=1)
    begins, ends = np.concatenate([first, second]), np.concatenate([second, first])
    order = np.argsort(begins, kind="stable")
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    inside = source_side(
        np.searchsorted(begins[order], np.arange(count + 1)),
        ends[order],
        place[(order + len(first)) % max(1, len(order))],
        np.full(len(order), STRIP // 2),
        np.maximum(gain, 0),
        np.maximum(-gain, 0),
    )
    along = np.zeros(mask.shape, dtype=np.bool_)
    along[mask] = inside
    return along


def preferences(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return by how much each cell prefers a row to a column, in units of which a strip costs
    `STRIP`.

    Cells prefer the direction of the nearest border. Where two arms of a region meet, the strips of
    one then end beside those of the other along a diagonal, as at a mitred corner, and a tour turns
    there once for each strip in place of twice. In a wider arm, where more cells lie between the
    borders, each of them counts less.

    Examples
    --------
    >>> preferences(np.ones((3, 5), dtype=bool)).tolist()
    [[2, 402, 402, 402, 2], [-398, 2, 402, 2, -398], [2, 402, 402, 402, 2]]
    """
    vertical, horizontal = _to_border(mask), _to_border(mask.T).T
    half_width = int(np.minimum(vertical, horizontal).max(initial=1))
    return np.asarray(_ROWS + _BORDER // half_width * np.sign(horizontal - vertical))


def _to_border(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the number of steps along its column from each True cell to the nearest other cell, up
    or down.
    """
    rows = np.arange(len(mask))[:, None]
    above = np.maximum.accumulate(np.where(mask, -1, rows), axis=0)
    below = np.minimum.accumulate(np.where(mask, len(mask), rows)[::-1], axis=0)[::-1]
    return np.asarray(np.minimum(rows - above, below - rows))


def runs_in(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return first and last cell of all runs of a mask in reading order; int64, shape (R, 2, 2)."""
    padded = np.zeros((len(mask), mask.shape[1] + 2), dtype=np.bool_)
    padded[:, 1:-1] = mask
    before, after = padded[:, :-1], padded[:, 1:]
    row, first = np.nonzero(after & ~before)
    last = np.nonzero(before & ~after)[1] - 1
    return np.stack([row, first, row, last], axis=1).reshape(-1, 2, 2)


def detours_of(region: NDArray[np.bool_]) -> Detours:
    """Return the detours in a region of cells. All tours of one region share them."""
    return _known_detours(region.shape, np.packbits(region).tobytes())


@lru_cache(maxsize=2)
def _known_detours(shape: tuple[int, int], packed: bytes) -> Detours:
    bits = np.unpackbits(np.frombuffer(packed, dtype=np.uint8), count=shape[0] * shape[1])
    return Detours(bits.reshape(shape).astype(np.bool_))


class Detours:
    """What links between cells cost more in a region than along a straight line.

    Parameters
    ----------
    region : ndarray of bool, shape (rows, columns)
        Mask of the cells of a region.

    Examples
    --------
    >>> region = np.ones((6, 5), dtype=bool)
    >>> region[1:, 1:4] = False
    >>> ends = np.array([[[5, 0], [1, 0]], [[5, 4], [1, 4]]])
    >>> Detours(region).between(ends, 1.0)[0].round(1).tolist()
    [0.0, 0.0, 9.8, 4.2]
    """

    def __init__(self, region: NDArray[np.bool_]) -> None:
        import shapely

        self._region, self._count = region, int(np.count_nonzero(region))
        hull = shapely.convex_hull(shapely.multipoints(np.argwhere(region)))
        self._straight = not shapely.contains_xy(hull.buffer(-_DENT), *np.nonzero(~region)).any()
        self._edges: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]] | None = None
        self._from_node: dict[int, NDArray[np.float64]] = {}

    def between(self, ends: NDArray[np.generic], turn: float) -> NDArray[np.float64]:
        """Return what links between the ends of strips, of shape (S, 2, 2), cost more, with one turn
        of cost ``turn`` at a corner; float64, shape (2 S, 2 S), in cells.
        """
        cells, place = np.unique(ends.reshape(-1, 2).astype(np.int64), axis=0, return_inverse=True)
        if self._straight or self._count * len(cells) > _MOST_SEARCHED:
            return np.zeros((len(place), len(place)))
        distances = self._distances(cells)
        offsets = np.abs(cells[:, None] - cells)
        # steps from cell to cell take longer than a straight line in the open, too
        in_the_open = offsets.max(axis=2) + (2**0.5 - 1) * offsets.min(axis=2)
        ratio = np.where(np.isfinite(distances), distances, in_the_open)
        ratio /= np.maximum(in_the_open, 1.0)
        detours = np.hypot(*np.moveaxis(offsets, -1, 0)) * (ratio - 1.0)
        costs = np.where(detours > _AROUND, detours + turn, 0.0)
        return np.ascontiguousarray(costs[place][:, place])

    def _distances(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the lengths of the shortest paths between cells by steps to neighbouring cells."""
        from shoal.search.kernels.graphs import distances_from

        number = np.full(self._region.shape, -1)
        number[self._region] = np.arange(self._count)
        if self._edges is None:
            self._edges = _steps_between(number)
        nodes = number[tuple(cells.T)]
        for node in set(nodes.tolist()) - self._from_node.keys():
            self._from_node[node] = distances_from(*self._edges, node)
        return np.array([self._from_node[node][nodes] for node in nodes.tolist()])


def _steps_between(
    number: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Return the steps from each cell to its up to 8 neighbours, as a graph in compressed rows. The
    array ``number`` has the number of each cell, or -1.
    """
    padded = np.pad(number, 1, constant_values=-1)
    rows, cols = np.nonzero(padded >= 0)
    around = [(down, right) for down in (-1, 0, 1) for right in (-1, 0, 1) if down or right]
    ends = np.stack([padded[rows + down, cols + right] for down, right in around], axis=1)
    lengths = np.broadcast_to([np.hypot(*step) for step in around], ends.shape)
    there = ends >= 0
    first = np.concatenate([[0], np.cumsum(there.sum(axis=1))])
    return first, ends[there], lengths[there]
