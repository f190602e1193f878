"""Tours along rows: boustrophedon, comb and spanning tree."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.core.geometry import partial_sums
from shoal.search.tours.masks import component_after_component, components, smallest_part
from shoal.search.tours.strips import Detours, cells_of_strip, detours_of, straight_strips
from shoal.search.tours.tour import TOURS, Tour, TourByOrder, hilbert_encode

MOST_RUNS = 1500
"""Maximum number of runs whose order Shoal improves.

A tour with more runs keeps the order of the boustrophedon decomposition.
"""


DISTURBANCES = 300
"""Default number of random exchanges of runs. After each of them, the order is improved again."""


@TOURS.register("boustrophedon")
class BoustrophedonTour(TourByOrder):
    """A tour that crosses each run without interruption, with about two turns for each run.

    A run is a sequence of consecutive cells in one row. The runs first get the order of Choset's
    boustrophedon decomposition ("Coverage of known spaces: the boustrophedon cellular
    decomposition", Autonomous Robots 9, 2000). Two kinds of exchanges shorten the connections
    between runs. A 2-opt exchange replaces two connections by two new connections. An Or-opt
    exchange moves up to three runs to another place on the tour. The step from the last run back to
    the first run also counts as a connection.

    Parameters
    ----------
    turn : float
        Cost of a change of direction between two runs, in cells.
    disturbances : int
        Number of random exchanges of runs, after each of which the order is improved again.
    """

    name = "boustrophedon"

    # the defaults for subclasses whose initializer does not set them
    turn: float = 0.0
    disturbances: int = DISTURBANCES

    def __init__(self, turn: float = 0.0, disturbances: int = DISTURBANCES) -> None:
        self.turn, self.disturbances = float(turn), disturbances

    def _in_order(self, region: NDArray[np.bool_]) -> NDArray[np.int64]:
        from shoal.search.kernels.runs import runs_of, shorten, sweep_all

        region = np.ascontiguousarray(region)
        cells = np.empty((np.count_nonzero(region), 2), dtype=np.int64)
        sweep_all(region, cells)
        runs = runs_of(region)
        if len(runs) > MOST_RUNS:
            return cells
        number = np.full(region.shape, -1)
        number[tuple(cells[np.lexsort(cells.T[::-1])].T)] = np.repeat(
            np.arange(len(runs)), runs[:, 2] - runs[:, 1]
        )
        of_cell = number[tuple(cells.T)]
        begins = np.flatnonzero(np.diff(of_cell, prepend=-1))
        order = of_cell[begins]
        backwards = np.empty(len(runs), dtype=np.int64)
        backwards[order] = cells[begins, 1] != runs[order, 1]
        ends = np.stack([runs[:, [0, 1]], runs[:, [0, 2]] - [0, 1]], axis=1).astype(np.float64)
        detours = detours_of(region).between(ends, self.turn)
        shorten(ends, detours, order, backwards, self.turn, self.disturbances)
        rows = [
            np.arange(begin, end)[:: -1 if back else 1]
            for (_, begin, end), back in zip(runs[order], backwards[order], strict=True)
        ]
        return np.stack(
            [np.repeat(runs[order, 0], [len(row) for row in rows]), np.concatenate(rows)], axis=1
        )


@TOURS.register("strips")
class StripsTour(TourByOrder):
    """A tour along few straight strips of cells, in rows and in columns, with at most about two
    turns for each strip; see `straight_strips`.

    Where a region has arms in two directions, rows run along one arm and columns along the other,
    and meet at a mitred corner.
    The strips are joined as the rows of `BoustrophedonTour` are.

    Parameters
    ----------
    turn : float
        Cost of a change of direction between two strips, in cells.
    disturbances : int
        Number of random exchanges of strips, after each of which the order is improved again.
    """

    name = "strips"

    # the defaults for subclasses whose initializer does not set them
    turn: float = 1.0
    disturbances: int = DISTURBANCES

    def __init__(self, turn: float = 1.0, disturbances: int = DISTURBANCES) -> None:
        self.turn, self.disturbances = float(turn), disturbances

    def _in_order(self, region: NDArray[np.bool_]) -> NDArray[np.int64]:
        strips = [cells_of_strip(strip) for strip in straight_strips(region)]
        return np.concatenate(join_strips(strips, detours_of(region), self.turn, self.disturbances))


def join_strips(
    strips: list[NDArray[np.int64]], detours: Detours, turn: float, disturbances: int
) -> list[NDArray[np.int64]]:
    """Return strips in an order, and each in a direction, with short links and few turns.

    Parameters
    ----------
    strips : list of ndarray of int64, each of shape (k, 2)
        The cells of each strip in the order of a path.
    detours : Detours
        What links cost more in the region of all cells than along straight lines.
    turn, disturbances
        Parameters of `StripsTour`.
    """
    from shoal.search.kernels.runs import nearest_next, shorten

    ends = np.array([strip[[0, -1]] for strip in strips])
    order, backwards = np.empty((2, len(strips)), dtype=np.int64)
    nearest_next(ends, order, backwards)
    if len(strips) <= MOST_RUNS:
        extra = detours.between(ends, turn)
        shorten(ends.astype(np.float64), extra, order, backwards, turn, disturbances)
    return [strips[k][:: -1 if backwards[k] else 1] for k in order.tolist()]


@TOURS.register("comb")
class CombTour(TourByOrder):
    """Straight lanes back and forth, with one column (or one row) beside the lanes that leads back
    to the start.

    In a rectangle of at least 2 x 2 cells, all steps lead to neighbouring cells, except for one
    diagonal step if both sides are odd. If both sides of the rectangle are odd, the tour zigzags
    through the last two lanes. In a single row of cells, the step from the last cell back to the
    first is as long as the row.

    On a shape that is not a rectangle, the tour is the shortest of three tours: the comb of the
    bounding rectangle without the cells outside the shape, a sweep back and forth along rows, and a
    sweep back and forth along columns.

    Parameters
    ----------
    along_rows : bool, optional
        Whether the lanes run along the rows of cells, and not along the columns. By default, the
        tour maker chooses the direction.
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
        orders = [
            cells[region[tuple(cells.T)]],
            *(sweeps if self.along_rows is None else sweeps[1 - self.along_rows :][:1]),
        ]
        return min((component_after_component(order, region) for order in orders), key=_length)


def closed_lanes(rows: int, cols: int, along_rows: bool | None = None) -> NDArray[np.int64]:
    """Return the cells of a full rectangle in the order of the comb tour; int64, shape (rows *
    cols, 2).

    By default, the lanes run in the direction that gives an even number of lanes. If the numbers of
    rows and columns are both even or both odd, the lanes run along the longer side.
    """
    if along_rows is None:
        along_rows = min(rows, cols) == 1 or not (
            cols < rows if rows % 2 == cols % 2 else rows % 2 == 1
        )
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
        across = grid[
            straight:, :0:-1
        ].T.copy()  # for an odd number of lanes: the last two lanes, column by column
        across[1::2] = across[1::2, ::-1]
        order = np.concatenate([grid[0, :1], lanes.ravel(), across.ravel(), grid[:0:-1, 0]])
    return np.stack(np.divmod(order, cols), axis=1)


def _sweeps(region: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """Return two orders of the cells: a sweep along rows from the bottom up, and a sweep along
    columns from left to right.
    """
    from shoal.search.kernels.runs import sweep_all

    upward, across = np.empty((2, np.count_nonzero(region), 2), dtype=np.int64)
    sweep_all(np.ascontiguousarray(region[::-1]), upward)
    upward[:, 0] = len(region) - 1 - upward[:, 0]
    sweep_all(np.ascontiguousarray(region.T), across)
    return [upward, np.ascontiguousarray(across[:, ::-1])]


def _length(cells: NDArray[np.int64]) -> float:
    return float(np.sqrt(((cells - np.roll(cells, -1, axis=0)) ** 2).sum(axis=1)).sum())


@TOURS.register("spanning-tree")
class SpanningTreeTour:
    """A tour around a spanning tree of the full 2 x 2 blocks, extended by the cells outside full
    blocks.

    The method follows Gabriely and Rimon, "Spanning-tree based coverage of continuous areas by a
    mobile robot", Annals of Mathematics and Artificial Intelligence 31, 2001. In a region of full
    blocks, all steps of the tour lead to neighbouring cells. Of the four alignments of blocks, the
    tour uses the alignment with the largest number of full blocks. The spanning tree consists of
    straight corridors and a spine that connects them, because a tree of this shape gives few turns.

    The tour takes in cells outside full blocks in two stages. In the first stage, the tour takes
    in, without a detour, pairs of cells beside its edges, and full blocks that are not aligned with
    the other blocks. In the second stage, the tour connects cycles of cells that are still
    separate, where a single cell counts as a cycle. To connect two cycles, the tour replaces one
    edge of each cycle by two steps from cycle to cycle. One step between two connected cycles leads
    to a neighbouring cell, and the other step may be longer: a diagonal to a single cell, or the
    way back from a narrow dead end.

    Parameters
    ----------
    along_rows : bool, optional
        Whether the corridors run along the rows of cells, and not across them. By default, the
        corridors run in the direction in which more blocks are neighbours.
    """

    name = "spanning-tree"
    dimensions: tuple[int, ...] = (2,)

    along_rows: bool | None = None  # the default for subclasses whose initializer does not set it

    def __init__(self, along_rows: bool | None = None) -> None:
        self.along_rows = along_rows

    def make(self, mask: NDArray[np.bool_]) -> Tour:
        """Return the tour through all True cells of the mask."""
        from shoal.search.kernels import cycles

        low, region = smallest_part(mask)
        # From the bottom up, like the curves: rows are reversed here and reversed again below. A
        # copy, as a single row would stay read-only, for which the kernels would be compiled again.
        region = region[::-1].copy()
        links = np.repeat(np.arange(region.size), 2).reshape(-1, 2)
        parent = np.arange(region.size)
        full, origin = _full_blocks(region)
        along_rows = self.along_rows
        if along_rows is None:
            along_rows = bool(
                np.count_nonzero(full[:, 1:] & full[:, :-1])
                >= np.count_nonzero(full[1:] & full[:-1])
            )
        cycles.tree_of_blocks(full, origin, region.shape[1], along_rows, links, parent)
        cycles.grow_everywhere(region, links, parent)
        cycles.attach(region, links, parent)
        members, starts = _by_component(region)
        order = np.empty(len(members), dtype=np.int64)
        cycles.chains(links, region.shape[1], members, starts, order)
        rows, cols = np.divmod(order, region.shape[1])
        cells = np.stack([len(region) - 1 - rows, cols], axis=1) + low
        return Tour(cells, mask.shape, closed=True, name=self.name)


def _full_blocks(region: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], int]:
    """Return the full 2 x 2 blocks for the best of four alignments, and the flat index of the first
    block's first cell.
    """
    square = region[:-1, :-1] & region[1:, :-1] & region[:-1, 1:] & region[1:, 1:]
    row, col = max(
        ((row, col) for row in (0, 1) for col in (0, 1)),
        key=lambda at: np.count_nonzero(square[at[0] :: 2, at[1] :: 2]),
    )
    return np.ascontiguousarray(square[row::2, col::2]), row * region.shape[1] + col


def _by_component(region: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the flat indices of all True cells, sorted by component, and the positions at which
    components begin and end.

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
    return members[np.argsort(of_member, kind="stable")], partial_sums(np.bincount(of_member))
