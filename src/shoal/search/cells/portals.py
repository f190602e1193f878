"""Portals: sections of grid lines through which a vehicle passes from a piece of one cell to a piece of the next cell."""

from __future__ import annotations

from collections import defaultdict
from itertools import product

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.search.cells.clipping import Clipped, Lattice
from shoal.search.regions.outline_checks import Points

_ON_LINE = 1e-8  # relative to a cell: distance from a grid line that rounding may cause


@dataclass(frozen=True, eq=False)
class Portals:
    """All portals between two pieces of cells, and all portals between a piece and a whole cell.

    A whole cell lies entirely inside the region. The region's border divides all cells on the border into pieces.

    The number of a piece is its index in `Clipped.pieces`. The number of a whole cell is its flat index in the grid plus
    ``len(Clipped.pieces)``.

    Parameters
    ----------
    pairs : ndarray of int64, shape (g, 2)
        The numbers of the two pieces or whole cells that each portal connects.
    middles : ndarray of float64, shape (g, 2)
        Midpoint of each portal in metres.
    widths : ndarray of float64, shape (g,)
        Width of each portal in metres.
    """

    pairs: NDArray[np.int64]
    middles: Points
    widths: NDArray[np.float64]


def portals_of(clipped: Clipped, lattice: Lattice) -> Portals:
    """Return all portals between two pieces of a clipped region, and all portals between a piece and a whole cell."""
    found = [portal for axis in (0, 1) for portal in _matched(_stretches(clipped, lattice, axis), clipped, lattice, axis)]
    pairs = np.array([portal[:2] for portal in found], dtype=np.int64).reshape(-1, 2)
    middles = lattice.to_region(np.array([portal[2:4] for portal in found]).reshape(-1, 2))
    return Portals(pairs, middles, np.array([portal[4] for portal in found]))


# row and column of the cell after the line; before (0) or after (1); piece; from, to
Stretch = tuple[int, int, int, int, float, float]


def _segments(clipped: Clipped) -> tuple[Points, Points, NDArray[np.int64]]:
    """Return the sides of all pieces as three arrays: start points, end points, and indices of the pieces."""
    import shapely

    rings, ring_piece = shapely.get_rings(clipped.pieces, return_index=True)
    points, ring = shapely.get_coordinates(rings, return_index=True)
    same = ring[1:] == ring[:-1]
    return points[:-1][same], points[1:][same], ring_piece[ring[:-1][same]]


def _stretches(clipped: Clipped, lattice: Lattice, axis: int) -> list[Stretch]:
    """Return the sides of pieces that lie on grid lines. Axis 0 means vertical lines, and axis 1 means horizontal lines."""
    start, end, piece = _segments(clipped)
    found: list[Stretch] = []
    for shift in (0, 1):
        if axis == 0:
            line = lattice.left + (clipped.cols[piece] + shift) * lattice.size
        else:
            line = lattice.top - (clipped.rows[piece] + shift) * lattice.size
        on = np.maximum(np.abs(start[:, axis] - line), np.abs(end[:, axis] - line)) <= _ON_LINE * lattice.size
        along, of = 1 - axis, piece[on]
        low, high = np.minimum(start[on, along], end[on, along]), np.maximum(start[on, along], end[on, along])
        rows, cols = clipped.rows[of] + shift * axis, clipped.cols[of] + shift * along
        columns = (rows, cols, np.full(len(of), 1 - shift), of, low, high)
        found += zip(*(column.tolist() for column in columns), strict=True)
    return found


def _matched(stretches: list[Stretch], clipped: Clipped, lattice: Lattice, axis: int) -> list[tuple[int, int, float, float, float]]:
    """Return a portal for each section of a grid line that two pieces, one on each side of the line, have in common."""
    width = lattice.shape[1]
    lines: dict[tuple[int, int], tuple[list[Stretch], list[Stretch]]] = defaultdict(lambda: ([], []))
    for stretch in stretches:
        lines[stretch[:2]][stretch[2]].append(stretch)
    found = []
    for (row, col), (before, after) in lines.items():
        for (r, c), side in (((row - axis, col - 1 + axis), before), ((row, col), after)):
            if 0 <= r < lattice.shape[0] and 0 <= c < width and clipped.whole[r, c]:
                side.append((row, col, 0, len(clipped.pieces) + r * width + c, -np.inf, np.inf))
        across = lattice.left + col * lattice.size if axis == 0 else lattice.top - row * lattice.size
        for one, other in product(before, after):
            low, high = max(one[4], other[4]), min(one[5], other[5])
            if high - low > _ON_LINE * lattice.size:
                middle = (low + high) / 2
                found.append((one[3], other[3], *((across, middle) if axis == 0 else (middle, across)), high - low))
    return found
