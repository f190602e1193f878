"""Tours through layers: the closed tours of neighbouring layers are cut open and joined by two climbs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shoal.search.tours.tour import Tour

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]
_CUTS = 2000  # steps of a layer's tour at which it may be cut: of more, these are tried, evenly spaced
_ENOUGH = 64  # steps between two turns: with so many only these are tried
_NEAR = 8  # steps of the next layer's tour that are tried with each
TIE = 0.01  # cells: what a turn counts for between cuts that are else as good


def joined(
    tours: Sequence[Tour], points: Sequence[Floats] | None = None, *, floors: Sequence[int] | None = None, turn: float = TIE
) -> Tour:
    """Return one tour through the cells of all layers: from each layer it climbs to the next and comes back beside.

    A step of a layer's tour and one of the tour above are taken out and two climbs laid in where that makes the whole least longer.
    So no cell is passed twice, and tours over alike layers become longer by two climbs a layer, less the two steps.

    Parameters
    ----------
    tours : sequence of Tour
        In a plane each, from the lowest layer to the highest.
    points : sequence of ndarray of float64, each of shape (N, 3), optional
        Where a robot stands in each cell of each tour; (row, col, layer) if not given.
    floors : sequence of int, optional
        Which layer each tour is in; 0, 1, 2, ... if not given.
    turn : float
        What a turn costs, in the unit of the points: at a turn a tour is cut rather than in a straight stretch.

    Returns
    -------
    Tour
        Of cells (layer, row, col); closed if all are.

    Notes
    -----
    For layers that spanning-tree coverage fills it is a Hamiltonian cycle of the grid in 3 dimensions, as in Y. Gabriely and
    E. Rimon, "Spanning-tree based coverage of continuous areas by a mobile robot", 2001, for the plane.

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
    """Return a way round with another one taken in; cells from ``low`` on are those of the layer below."""
    from scipy.spatial import KDTree

    ends = np.roll(way, -1)
    below = np.flatnonzero((way >= low) & (ends >= low))
    below = below if len(below) else np.flatnonzero(way >= low)  # a layer of one cell
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
    """Return those of some steps at both of whose ends the way turns, if there are enough to choose from; else all."""
    sharp = steps[(bent > 0) & (bent == bent.max())]
    return sharp if len(sharp) >= _ENOUGH else steps


def _bends(points: Floats) -> Floats:
    """Return at which points of a way round it changes its direction: 0 or 1; float64, shape (N,)."""
    steps = np.roll(points, -1, axis=0) - points
    before = np.roll(steps, 1, axis=0)
    cross = steps[:, 0] * before[:, 1] - steps[:, 1] * before[:, 0]
    return np.asarray((np.abs(cross) > 1e-9 * (steps**2).sum(axis=1)).astype(np.float64))
