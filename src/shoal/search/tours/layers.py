"""Tours through several layers: the closed tours of two neighbouring layers are cut, and connected by a climb and a descent."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shoal.search.tours.tour import Tour

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]
_CUTS = 2000  # maximum number of candidate steps for cutting a layer's tour, evenly spaced
_ENOUGH = 64  # if at least this many steps have the most turns at their ends, no other steps are tried
_NEAR = 8  # number of steps of the next layer's tour that are tried with each candidate step
TIE = 0.01  # cells: cost of a turn, which decides between otherwise equal cuts


def joined(
    tours: Sequence[Tour], points: Sequence[Floats] | None = None, *, floors: Sequence[int] | None = None, turn: float = TIE
) -> Tour:
    """Join the tours of several layers to one tour, which climbs from layer to layer and descends beside each climb.

    A climb and a descent replace one step of a layer's tour and one step of the next layer's tour. The function chooses the two
    replaced steps so that the joined tour gets as short as possible. If all layers are equal, each layer above the lowest adds one
    climb and one descent, and saves two steps.

    Parameters
    ----------
    tours : sequence of Tour
        One plane tour for each layer, from the lowest layer to the highest.
    points : sequence of ndarray of float64, each of shape (N, 3), optional
        Viewpoint of each cell of each tour. By default, the viewpoint of a cell is (row, column, layer).
    floors : sequence of int, optional
        Layer number of each tour. By default, the tours get the numbers 0, 1, 2, ...
    turn : float
        Cost of a turn, in the unit of the viewpoints. If a turn costs more than 0, the function cuts tours at turns where possible.

    Returns
    -------
    Tour
        Tour of cells (layer, row, column). The joined tour is closed if all given tours are closed.

    Notes
    -----
    If the layers are equal and their tours step only to neighbouring cells, the result is a Hamiltonian cycle of all cells.
    Gabriely and Rimon describe the case of a single layer: "Spanning-tree based coverage of continuous areas by a mobile robot",
    2001.

    Examples
    --------
    >>> from shoal.search.tours import make_tour
    >>> floors = joined([make_tour("spanning-tree", (4, 6))] * 3)
    >>> len(floors), floors.metrics().length, bool((floors.steps == 1).all())
    (72, 72.0, True)
    """
    floors = range(len(tours)) if floors is None else floors
    cells = [np.column_stack([np.full(len(tour), floor), tour.cells]) for floor, tour in zip(floors, tours, strict=True)]
    points = [np.roll(one, -1, axis=1).astype(np.float64) for one in cells] if points is None else points
    offsets = np.concatenate([[0], np.cumsum([len(tour) for tour in tours])])
    places, bent = np.concatenate(points), np.concatenate([_bends(one) for one in points])
    way = np.arange(offsets[1])
    for layer in range(1, len(tours)):
        way = _taken_in(way, np.arange(offsets[layer], offsets[layer + 1]), int(offsets[layer - 1]), places, turn * bent)
    shape = (floors[-1] + 1, *np.max([tour.shape for tour in tours], axis=0).tolist())
    return Tour(np.concatenate(cells)[way], shape, closed=all(tour.closed for tour in tours), name=tours[0].name)


def _taken_in(way: Numbers, new: Numbers, low: int, places: Floats, bent: Floats) -> Numbers:
    """Return the closed path ``way`` of all lower layers, extended by the closed path ``new`` of the next layer.

    In ``way``, the numbers of the cells in the highest layer begin with ``low``.
    """
    from scipy.spatial import KDTree

    ends = np.roll(way, -1)
    below = np.flatnonzero((way >= low) & (ends >= low))
    below = below if len(below) else np.flatnonzero(way >= low)  # a layer with one cell
    below = _at_turns(below, bent[way[below]] + bent[ends[below]])
    below = below[np.unique(np.linspace(0, len(below) - 1, min(len(below), _CUTS)).astype(np.int64))]
    above = _at_turns(np.arange(len(new)), bent[new] + bent[np.roll(new, -1)])
    one, other, three, four = way[below], ends[below], new[above], np.roll(new, -1)[above]
    tree = KDTree((places[three] + places[four])[:, :2] / 2)
    near = tree.query((places[one] + places[other])[:, :2] / 2, k=min(_NEAR, len(above)))[1].reshape(len(below), -1)

    def away(here: Numbers, there: Numbers) -> Floats:
        return np.asarray(np.linalg.norm(places[here] - places[there], axis=-1))

    a, b, c, d = one[:, None], other[:, None], three[near], four[near]
    saved = away(a, b) + away(c, d) + bent[a] + bent[b] + bent[c] + bent[d]
    costs = np.stack([away(a, c) + away(b, d), away(a, d) + away(b, c)]) - saved
    crossed, row, column = np.unravel_index(int(np.argmin(costs)), costs.shape)
    begin = int(above[near[row, column]])
    whole = np.roll(new, -begin - 1) if crossed else np.roll(new[::-1], begin + 1)
    at = int(below[row]) + 1
    return np.concatenate([way[:at], whole, way[at:]])


def _at_turns(steps: Numbers, bent: Floats) -> Numbers:
    """Return the steps with the most turns at their ends, or all steps if too few steps have turns at their ends."""
    sharp = steps[(bent > 0) & (bent == bent.max())]
    return sharp if len(sharp) >= _ENOUGH else steps


def _bends(points: Floats) -> Floats:
    """Return, for each point of a closed path, 1 if the direction changes at this point, or else 0; float64, shape (N,)."""
    steps = np.roll(points, -1, axis=0) - points
    before = np.roll(steps, 1, axis=0)
    cross = steps[:, 0] * before[:, 1] - steps[:, 1] * before[:, 0]
    return np.asarray((np.abs(cross) > 1e-9 * (steps**2).sum(axis=1)).astype(np.float64))
