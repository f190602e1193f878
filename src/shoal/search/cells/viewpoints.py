"""Viewpoints: the points from which a robot sees a whole piece of a cell."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.search.cells.clipping import SPECK
from shoal.search.regions.boxes import clip_to_boxes
from shoal.search.regions.outline import Points

_HAIR = 1e-9  # relative to a footprint
# maximum number of viewpoints of a piece before the vehicle follows the border of the free area
# instead
_MOST = 3


def viewpoints_of(
    pieces: Any,
    centers: Points,
    *,
    footprint: float,
    size: float,
    free: Any = None,
) -> tuple[Points, NDArray[np.int64]]:
    """Return, for each piece, one or several viewpoints from which the whole piece is visible.

    If a piece contains the centre of its cell, this centre is the viewpoint of the piece. For any
    other piece, the viewpoint is a point from which the whole piece is visible, as near to the
    centre as possible. If no point sees the whole piece, the piece gets several viewpoints.

    Parameters
    ----------
    pieces : ndarray of Shapely polygons, shape (n,)
        The pieces in the lattice's frame, each inside a square of side ``size``.
    centers : ndarray of float64, shape (n, 2)
        Centre of each piece's cell in the lattice's frame.
    footprint, size : float
        Side of the footprint and side of a cell in metres. The cell must not be larger than the
        footprint.
    free : Shapely geometry, optional
        The area where robots may be. If ``free`` is given, all viewpoints lie in ``free``, inside
        or beside their piece.

    Returns
    -------
    points : ndarray of float64, shape (k, 2)
        The viewpoints in the lattice's frame.
    index : ndarray of int64, shape (k,)
        Number of the piece that belongs to each viewpoint, in increasing order.
    """
    import shapely

    from_center = shapely.intersects_xy(pieces, centers[:, 0], centers[:, 1])
    if free is not None:
        shapely.prepare(free)
        from_center &= shapely.intersects_xy(free, centers[:, 0], centers[:, 1])
    speck = SPECK * size * size
    viewpoints = [centers[k : k + 1] for k in range(len(centers))]
    hard = np.flatnonzero(~from_center)
    half, hard_pieces, middles = footprint / 2, pieces[hard], centers[hard]
    if free is None:
        places, _ = _within(hard_pieces, hard_pieces, middles, half, speck)
    else:
        places = _beside(hard_pieces, free, middles, half, speck)
    for k, points in zip(hard.tolist(), places, strict=True):
        viewpoints[k] = points
    counts = [len(points) for points in viewpoints]
    every = np.concatenate(viewpoints) if viewpoints else np.zeros((0, 2))
    return every, np.repeat(np.arange(len(viewpoints)), counts)


def _beside(pieces: Any, free: Any, centers: Points, half: float, speck: float) -> list[Points]:
    """Return, for each piece, points of ``free``, inside or beside the piece, from which together
    the whole piece is visible.
    """
    import shapely

    areas = _around(free, pieces, half)
    # a footprint that turns with its robot may see less of a corner than one at the lattice's angle
    beyond = np.flatnonzero(shapely.is_empty(areas))
    areas[beyond] = [shapely.points(_nearest(free, centers[k])) for k in beyond]
    viewpoints, remainders = _within(pieces, areas, centers, half, speck, most=_MOST)
    for k in beyond.tolist():
        viewpoints[k] = viewpoints[k][:1]
    # A robot sees the rest while it follows the border of the free area. From single points on a
    # slanted border, it would not.
    unseen = np.flatnonzero(shapely.area(remainders) > speck)
    if len(unseen):
        borders = _around(free.boundary, remainders[unseen], half)
        for k, border in zip(unseen.tolist(), borders, strict=True):
            viewpoints[k] = np.concatenate([viewpoints[k], *_lines(border)])
    return viewpoints


def _lines(shape: Any) -> list[Points]:
    """Return the points of each line of a Shapely geometry, line by line."""
    import shapely

    lines = [
        part
        for part in shapely.get_parts(shapely.line_merge(shape))
        if part.geom_type == "LineString"
    ]
    return [shapely.get_coordinates(line) for line in lines]


def _around(shape: Any, pieces: Any, half: float) -> Any:
    """Return, for each piece, the points of a shape from which a robot's footprint overlaps the
    piece; Shapely geometries, shape (n,).
    """
    import shapely

    low, high = np.split(shapely.bounds(pieces), 2, axis=1)
    return clip_to_boxes(shape, low - half, high + half)


def _within(
    pieces: Any, areas: Any, centers: Points, half: float, speck: float, most: float = np.inf
) -> tuple[list[Points], Any]:
    """Return, for each piece, at most ``most`` viewpoints in its area, and the part of the piece
    that no viewpoint sees.
    """
    import shapely

    chosen: list[list[Points]] = [[] for _ in pieces]
    remainders, near = pieces.copy(), centers.copy()
    unseen, rounds = np.flatnonzero(shapely.area(remainders) > speck), 0
    while len(unseen) and rounds < most:
        places = _common_viewpoints(areas[unseen], remainders[unseen], near[unseen], half)
        for k, place in zip(unseen.tolist(), places, strict=True):
            if np.isnan(place[0]):
                place[:] = _in_part(pieces[k], areas[k], remainders[k], near[k], begun=rounds > 0)
            chosen[k].append(place)
        near[unseen] = places
        squares = shapely.box(*(places - half).T, *(places + half).T)
        remainders[unseen] = difference(remainders[unseen], squares)
        unseen, rounds = unseen[shapely.area(remainders[unseen]) > speck], rounds + 1
    return [np.array(places).reshape(-1, 2) for places in chosen], remainders


def difference(shapes: Any, others: Any) -> Any:
    """Return shapes without other shapes, also where rounding left shapes that cross themselves."""
    import shapely

    try:
        return shapely.difference(shapes, others)
    except shapely.errors.GEOSException:
        return shapely.difference(shapely.make_valid(shapes), others)


def _common_viewpoints(areas: Any, remainders: Any, near: Points, half: float) -> Points:
    """Return, for each area, among all its points that see the whole part of ``remainders`` of a
    piece, the point nearest to ``near``; float64, shape (n, 2).

    If no point sees the whole part, the result is not a number.
    """
    import shapely

    low, high = np.split(shapely.bounds(remainders), 2, axis=1)
    least, most, hair = high - half, low + half, 2 * _HAIR * half
    nearest = np.full((len(remainders), 2), np.nan)
    some = np.flatnonzero((least <= most + hair).all(axis=1))
    corners = np.minimum(least, most)[some] - hair, np.maximum(least, most)[some] + hair
    among = shapely.intersection(areas[some], shapely.box(*corners[0].T, *corners[1].T))
    nonempty = ~shapely.is_empty(among)
    lines = shapely.shortest_line(among[nonempty], shapely.points(near[some[nonempty]]))
    nearest[some[nonempty]] = shapely.get_coordinates(lines)[::2]
    return nearest


def _in_part(piece: Any, area: Any, remainder: Any, near: Points, *, begun: bool) -> Points:
    """Return a point in ``area`` from which a robot sees a part of what it did not see.

    A point of the remaining part sees at least its own surroundings.
    """
    import shapely

    part = max(shapely.get_parts(remainder), key=lambda shape: float(shape.area))
    low, high = np.reshape(remainder.bounds, (2, 2))
    place = _nearest(part, (low + high) / 2) if begun else _nearest(piece, near)
    return place if area is piece else _nearest(area, place)


def _nearest(shape: Any, point: Points) -> Points:
    import shapely

    line = shapely.shortest_line(shape, shapely.points(point))
    return np.asarray(shapely.get_coordinates(line)[0])
