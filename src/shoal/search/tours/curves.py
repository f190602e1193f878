"""Tours along Hilbert curves and Peano's curve, of squares, rectangles and boxes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.core.geometry import partial_sums
from shoal.search.tours.tour import (
    MAX_ORDER,
    TOURS,
    Tour,
    TourByOrder,
    hilbert_encode,
    moore_encode,
)


@TOURS.register("hilbert")
class HilbertTour(TourByOrder):
    """The Hilbert curve through the smallest square that contains all cells and whose side is a
    power of 2.

    The lower left corner of the square is the lower left corner of the cells' bounding box. In 3
    dimensions, the square is a cube.

    As in paper H, the tour is closed: it continues from its last cell to its first cell. In a full
    square, the step from the last cell to the first cell is one cell side shorter than a side of
    the square. If the cells do not fill the square, the tour keeps the order of the curve, and some
    steps cross positions without a cell.
    """

    name = "hilbert"
    dimensions: tuple[int, ...] = (2, 3)
    encode = staticmethod(hilbert_encode)

    def _in_order(self, region: NDArray[np.bool_]) -> NDArray[np.int64]:
        order = (max(region.shape) - 1).bit_length()
        if order > MAX_ORDER[region.ndim]:
            longest = 2 ** MAX_ORDER[region.ndim]
            raise InvalidInputError(
                f"tour {self.name}: expected at most {longest} cells along each side, got shape"
                f" {region.shape}"
            )
        cells = np.argwhere(region)
        of_square = cells.copy()
        # rows count from the top, but the curve begins at the bottom
        of_square[:, -2] += 2**order - region.shape[-2]
        return cells[np.argsort(self.encode(of_square, order=order))]


@TOURS.register("open-hilbert")
class OpenHilbertTour(HilbertTour):
    """The Hilbert curve as an open path, for comparisons with closed tours: it has no way back from
    its end to its start.
    """

    name = "open-hilbert"
    closed = False


@TOURS.register("moore")
class MooreTour(HilbertTour):
    """The Moore curve through the smallest square that contains all cells and whose side is a power
    of 2.

    The Moore curve consists of four Hilbert curves, closed by one step.
    """

    name = "moore"
    dimensions: tuple[int, ...] = (2,)
    encode = staticmethod(moore_encode)


@TOURS.register("hilbert-ii")
class HilbertIITour(TourByOrder):
    """The curve Hilbert II (Peano's curve) through the smallest square that contains all cells and
    whose side is a power of 3.

    The curve consists of S-shaped pieces of 3 x 3 cells. It has fewer turns than the Hilbert curve,
    but runs from the lower left corner of the square to the upper right corner, so that the edge
    that closes the tour is a diagonal of the square.
    """

    name = "hilbert-ii"

    def _in_order(self, region: NDArray[np.bool_]) -> NDArray[np.int64]:
        order = 0
        while 3**order < max(region.shape):
            order += 1
        cells = np.argwhere(region)
        # rows count from the top, but the curve begins at the bottom
        of_square = np.column_stack([region.shape[0] - 1 - cells[:, 0], cells[:, 1]])
        return cells[np.argsort(_hilbert_ii_encode(of_square, order))]


def _hilbert_ii_encode(cells: NDArray[np.int64], order: int) -> NDArray[np.int64]:
    """Return the index of each cell (row from the bottom, column) on the curve Hilbert II; int64,
    shape (N,).

    A square consists of 3 x 3 smaller squares, which the curve visits column by column, up and down
    in turn. In an odd column the rows of a smaller square are mirrored, and in an odd row its
    columns.
    """
    index = np.zeros(len(cells), dtype=np.int64)
    mirrored = np.zeros(cells.shape, dtype=np.bool_)
    for k in range(order - 1, -1, -1):
        digits = cells // 3**k % 3
        digits = np.where(mirrored, 2 - digits, digits)
        row, column = digits.T
        index = 9 * index + 3 * column + np.where(column % 2 == 1, 2 - row, row)
        mirrored ^= digits[:, ::-1] % 2 == 1
    return index


@TOURS.register("hilbert-rectangle")
class HilbertRectangleTour(TourByOrder):
    """Two generalized Hilbert curves side by side through the smallest box around the True cells,
    closed by one step.

    In a rectangle of at least 2 x 2 cells, all steps lead to neighbouring cells, except for one
    diagonal step if both sides are odd. In a three-dimensional box with odd sides, some steps are
    diagonals of a square. In a single row of cells, the step from the last cell back to the first
    is as long as the row.
    """

    name = "hilbert-rectangle"
    dimensions: tuple[int, ...] = (2, 3)

    def _in_order(self, region: NDArray[np.bool_]) -> NDArray[np.int64]:
        cells = closed_path(region.shape)
        return cells if region.all() else cells[region[tuple(cells.T)]]


def closed_path(shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Return the cells of a full box in the order of its closed generalized Hilbert curve; int64,
    shape (N, dimensions).

    The curve runs out through one half of the box, and back through the other half. The way out and
    the way back lead along the longest even side of the box, or along its longest side if all sides
    are odd.
    """
    from shoal.search.kernels.hilbert import walk_box

    sides = (*reversed(shape), 1)[:3]  # x, y, z
    cells = np.empty((int(np.prod(sides)), 3), dtype=np.int64)
    along = max(range(3), key=lambda axis: (sides[axis] > 1, sides[axis] % 2 == 0, sides[axis]))
    across, deep = sorted(
        (axis for axis in range(3) if axis != along), key=lambda axis: -sides[axis]
    )
    axes = np.array([along, across, deep])
    start, lower = [0, 0, 0], sides[across] // 2
    if sides[deep] > 1 and lower > 2 and lower % 2 == 1:
        lower += 1  # in 3-D, a path along even sides needs no diagonals
    if lower == 0:
        walk_box((0, 0, 0), axes, np.array([sides[along], 1, 1]), cells, 0)
    else:
        start[across] = lower - 1
        at = walk_box(
            (start[0], start[1], start[2]),
            axes,
            np.array([sides[along], -lower, sides[deep]]),
            cells,
            0,
        )
        start[along], start[across] = sides[along] - 1, lower
        walk_box(
            (start[0], start[1], start[2]),
            axes,
            np.array([-sides[along], sides[across] - lower, sides[deep]]),
            cells,
            at,
        )
    cells[:, 1] = sides[1] - 1 - cells[:, 1]  # y counts from the bottom, rows from the top
    return np.ascontiguousarray(cells[:, len(shape) - 1 :: -1])


Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]
_CUTS = 2000  # maximum number of candidate steps for cutting a layer's tour, evenly spaced
# if at least this many steps have the most turns at their ends, no other steps are tried
_ENOUGH = 64
_NEAR = 8  # number of steps of the next layer's tour that are tried with each candidate step
TIE = 0.01  # cells: cost of a turn, which decides between otherwise equal cuts


def join_layers(
    tours: Sequence[Tour],
    points: Sequence[Floats] | None = None,
    *,
    layers: Sequence[int] | None = None,
    turn: float = TIE,
) -> Tour:
    """Join the tours of several layers to one tour, which climbs from layer to layer and descends
    beside each climb.

    A climb and a descent replace one step of a layer's tour and one step of the next layer's tour.
    The function chooses the two replaced steps so that the joined tour gets as short as possible.
    If all layers are equal, each layer above the lowest adds one climb and one descent, and saves
    two steps.

    Parameters
    ----------
    tours : sequence of Tour
        One plane tour for each layer, from the lowest layer to the highest.
    points : sequence of ndarray of float64, each of shape (N, 3), optional
        Viewpoint of each cell of each tour. By default, the viewpoint of a cell is (row, column,
        layer).
    layers : sequence of int, optional
        Layer number of each tour. By default, the tours get the numbers 0, 1, 2, ...
    turn : float
        Cost of a turn, in the unit of the viewpoints. If a turn costs more than 0, the function
        cuts tours at turns where possible.

    Returns
    -------
    Tour
        Tour of cells (layer, row, column). The joined tour is closed if all given tours are closed.

    Notes
    -----
    If the layers are equal and their tours step only to neighbouring cells, the result is a
    Hamiltonian cycle of all cells. Gabriely and Rimon describe the case of a single layer:
    "Spanning-tree based coverage of continuous areas by a mobile robot", 2001.

    Examples
    --------
    >>> from shoal.search.tours import make_tour
    >>> tour = join_layers([make_tour("spanning-tree", (4, 6))] * 3)
    >>> len(tour), tour.metrics().length, bool((tour.steps == 1).all())
    (72, 72.0, True)
    """
    layers = range(len(tours)) if layers is None else layers
    cells = [
        np.column_stack([np.full(len(tour), layer), tour.cells])
        for layer, tour in zip(layers, tours, strict=True)
    ]
    points = (
        [np.roll(layer_cells, -1, axis=1).astype(np.float64) for layer_cells in cells]
        if points is None
        else points
    )
    offsets = partial_sums([len(tour) for tour in tours])
    places, bent = (
        np.concatenate(points),
        np.concatenate([_bends(layer_points) for layer_points in points]),
    )
    order = np.arange(offsets[1])
    for layer in range(1, len(tours)):
        order = _insert_cycle(
            order,
            np.arange(offsets[layer], offsets[layer + 1]),
            int(offsets[layer - 1]),
            places,
            turn * bent,
        )
    shape = (layers[-1] + 1, *np.max([tour.shape for tour in tours], axis=0).tolist())
    return Tour(
        np.concatenate(cells)[order],
        shape,
        closed=all(tour.closed for tour in tours),
        name=tours[0].name,
    )


def _insert_cycle(path: Numbers, new: Numbers, low: int, places: Floats, bent: Floats) -> Numbers:
    """Return the closed path ``path`` of all lower layers, extended by the closed path ``new`` of
    the next layer.

    In ``path``, the numbers of the cells in the highest layer begin with ``low``.
    """
    from scipy.spatial import KDTree

    ends = np.roll(path, -1)
    below = np.flatnonzero((path >= low) & (ends >= low))
    below = below if len(below) else np.flatnonzero(path >= low)  # a layer with one cell
    below = _at_turns(below, bent[path[below]] + bent[ends[below]])
    below = below[
        np.unique(np.linspace(0, len(below) - 1, min(len(below), _CUTS)).astype(np.int64))
    ]
    above = _at_turns(np.arange(len(new)), bent[new] + bent[np.roll(new, -1)])
    first, second, third, fourth = path[below], ends[below], new[above], np.roll(new, -1)[above]
    tree = KDTree((places[third] + places[fourth])[:, :2] / 2)
    near = tree.query((places[first] + places[second])[:, :2] / 2, k=min(_NEAR, len(above)))[
        1
    ].reshape(len(below), -1)

    def away(source: Numbers, target: Numbers) -> Floats:
        return np.asarray(np.linalg.norm(places[source] - places[target], axis=-1))

    a, b, c, d = first[:, None], second[:, None], third[near], fourth[near]
    saved = away(a, b) + away(c, d) + bent[a] + bent[b] + bent[c] + bent[d]
    costs = np.stack([away(a, c) + away(b, d), away(a, d) + away(b, c)]) - saved
    crossed, row, column = np.unravel_index(int(np.argmin(costs)), costs.shape)
    begin = int(above[near[row, column]])
    whole = np.roll(new, -begin - 1) if crossed else np.roll(new[::-1], begin + 1)
    at = int(below[row]) + 1
    return np.concatenate([path[:at], whole, path[at:]])


def _at_turns(steps: Numbers, bent: Floats) -> Numbers:
    """Return the steps with the most turns at their ends, or all steps if too few steps have turns
    at their ends.
    """
    sharp = steps[(bent > 0) & (bent == bent.max())]
    return sharp if len(sharp) >= _ENOUGH else steps


def _bends(points: Floats) -> Floats:
    """Return, for each point of a closed path, 1 if the direction changes at this point, or else 0;
    float64, shape (N,).
    """
    steps = np.roll(points, -1, axis=0) - points
    before = np.roll(steps, 1, axis=0)
    cross = steps[:, 0] * before[:, 1] - steps[:, 1] * before[:, 0]
    return np.asarray((np.abs(cross) > 1e-9 * (steps**2).sum(axis=1)).astype(np.float64))
