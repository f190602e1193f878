"""Viewpoints: where a vehicle stands so that its footprint covers a piece of a cell, without leaving the piece."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.search.cells.clipping import SPECK
from shoal.search.regions.outline_checks import Points

_HAIR = 1e-9  # of a footprint


def viewpoints_of(pieces: Any, centers: Points, *, footprint: float, size: float) -> tuple[Points, NDArray[np.int64]]:
    """Return places in pieces of cells from which their whole area is seen.

    A piece that holds the centre of its cell is seen from there. Another is seen from its point nearest to the centre among those
    that see all of it; where there is none, from several.

    Parameters
    ----------
    pieces : ndarray of Shapely polygons, shape (n,)
        Each within a square of side ``size``.
    centers : ndarray of float64, shape (n, 2)
        Of the cells.
    footprint, size : float
        Sides of the footprint and of a cell, metres; size <= footprint.

    Returns
    -------
    points : ndarray of float64, shape (k, 2)
    index : ndarray of int64, shape (k,)
        The piece of each point, ascending.
    """
    import shapely

    from_center = shapely.intersects_xy(pieces, centers[:, 0], centers[:, 1])
    found = [
        centers[k : k + 1] if easy else _viewpoints(pieces[k], centers[k], footprint, SPECK * size * size)
        for k, easy in enumerate(from_center.tolist())
    ]
    counts = [len(points) for points in found]
    points = np.concatenate(found) if found else np.zeros((0, 2))
    return points, np.repeat(np.arange(len(found)), counts)


def _viewpoints(piece: Any, center: Points, footprint: float, speck: float) -> Points:
    import shapely

    chosen: list[Points] = []
    left, near = piece, center
    while left.area > speck:
        place = _from_one(piece, left, near, footprint)
        if place is None:
            # From a point of what is left, at least that point's surroundings are seen: this ends.
            part = max(shapely.get_parts(left), key=lambda shape: float(shape.area))
            low, high = np.reshape(left.bounds, (2, 2))
            place = _nearest(part if chosen else piece, near if not chosen else (low + high) / 2)
        chosen.append(place)
        half = footprint / 2
        left = left.difference(shapely.box(place[0] - half, place[1] - half, place[0] + half, place[1] + half))
        near = place
    return np.array(chosen)


def _from_one(piece: Any, left: Any, near: Points, footprint: float) -> Points | None:
    """Return the point of a piece nearest to ``near`` that sees all of what is left, if there is one."""
    import shapely

    low, high = np.reshape(left.bounds, (2, 2))
    least, most = high - footprint / 2, low + footprint / 2
    if (least > most + _HAIR * footprint).any():
        return None
    hair = _HAIR * footprint
    among = piece.intersection(shapely.box(*(np.minimum(least, most) - hair), *(np.maximum(least, most) + hair)))
    return None if among.is_empty else _nearest(among, near)


def _nearest(shape: Any, point: Points) -> Points:
    import shapely

    line = shapely.shortest_line(shape, shapely.points(point))
    return np.asarray(shapely.get_coordinates(line)[0])
