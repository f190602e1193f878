"""Viewpoints: the points from which a robot sees a whole piece of a cell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.search.cells.clipping import (
    SPECK,
    Clipped,
    Lattice,
)
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
    known: Sequence[Points | None] = (),
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
    known : sequence of (ndarray of float64, shape (k, 2)) or None
        Viewpoints found by `viewpoints_on_rows`, for pieces that do not contain the centre of their
        cell.
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
    places = [
        centers[k : k + 1] if easy else known[k] if known else None
        for k, easy in enumerate(from_center.tolist())
    ]
    speck = SPECK * size * size
    hard = [k for k, place in enumerate(places) if place is None]
    if free is None and hard:
        for k, place in zip(
            hard, _single(pieces[hard], centers[hard], footprint / 2, speck), strict=True
        ):
            places[k] = place
    found = [
        _viewpoints(pieces[k], free, centers[k], footprint, speck) if place is None else place
        for k, place in enumerate(places)
    ]
    counts = [len(points) for points in found]
    points = np.concatenate(found) if found else np.zeros((0, 2))
    return points, np.repeat(np.arange(len(found)), counts)


def _single(pieces: Any, centers: Points, half: float, speck: float) -> list[Points | None]:
    """Return, for each piece, the viewpoint in the piece that sees the whole piece and is nearest
    to the centre, or None.
    """
    import shapely

    low, high = np.split(shapely.bounds(pieces), 2, axis=1)
    hair = 2 * _HAIR * half
    least, most = (
        np.minimum(high - half, low + half) - hair,
        np.maximum(high - half, low + half) + hair,
    )
    among = shapely.intersection(pieces, shapely.box(*least.T, *most.T))
    lines = shapely.shortest_line(among, shapely.points(centers))
    there = np.flatnonzero(~shapely.is_missing(lines) & (high - low <= 2 * half + hair).all(axis=1))
    points = shapely.get_coordinates(lines[there])[::2]
    left = shapely.area(
        shapely.difference(pieces[there], shapely.box(*(points - half).T, *(points + half).T))
    )
    found: list[Points | None] = [None] * len(pieces)
    for k, place in zip(there[left <= speck].tolist(), points[left <= speck], strict=True):
        found[k] = place[None]
    return found


def _viewpoints(piece: Any, free: Any, center: Points, footprint: float, speck: float) -> Points:
    """Return points from which, together, a whole piece is visible.

    The points lie inside the piece. If robots may only be in ``free``, the points lie in ``free``,
    inside or beside the piece.
    """
    half = footprint / 2
    if free is None:
        return _within(piece, piece, center, half, speck)[0]
    area = _around(free, piece, half)
    places, left = _within(piece, area, center, half, speck, most=_MOST)
    if left.area <= speck:
        return places
    # A robot sees the rest while it follows the border of the free area. From single points on a
    # slanted border, it would not.
    return np.concatenate([places, *_lines(_around(free.boundary, left, half))])


def _lines(shape: Any) -> list[Points]:
    """Return the points of each line of a Shapely geometry, line by line."""
    import shapely

    lines = [
        part
        for part in shapely.get_parts(shapely.line_merge(shape))
        if part.geom_type == "LineString"
    ]
    return [shapely.get_coordinates(line) for line in lines]


def _around(shape: Any, piece: Any, half: float) -> Any:
    """Return the points of a shape from which a robot's footprint overlaps a piece, as a Shapely
    geometry.
    """
    import shapely

    low, high = np.reshape(piece.bounds, (2, 2))
    return shapely.intersection(shape, shapely.box(*(low - half), *(high + half)))


def _square(place: Points, half: float) -> Any:
    import shapely

    return shapely.box(*(place - half), *(place + half))


def _within(
    piece: Any, area: Any, center: Points, half: float, speck: float, most: float = np.inf
) -> tuple[Points, Any]:
    """Return at most ``most`` viewpoints in ``area`` for a piece, and the part of the piece that no
    viewpoint sees.
    """
    import shapely

    chosen: list[Points] = []
    left, near = piece, center
    while left.area > speck and len(chosen) < most:
        place = _from_one(area, left, near, half)
        if place is None:
            # A point of the remaining part sees at least its own surroundings, so the loop ends.
            part = max(shapely.get_parts(left), key=lambda shape: float(shape.area))
            low, high = np.reshape(left.bounds, (2, 2))
            place = _nearest(part if chosen else piece, near if not chosen else (low + high) / 2)
            place = place if area is piece else _nearest(area, place)
        chosen.append(place)
        left = left.difference(_square(place, half))
        near = place
    return np.array(chosen).reshape(-1, 2), left


def _from_one(area: Any, left: Any, near: Points, half: float) -> Points | None:
    """Return, among all points of ``area`` that see the whole part ``left`` of a piece, the point
    nearest to ``near``.

    If no point sees the whole part ``left``, the result is None.
    """
    import shapely

    low, high = np.reshape(left.bounds, (2, 2))
    least, most, hair = high - half, low + half, 2 * _HAIR * half
    if (least > most + hair).any():
        return None
    among = area.intersection(
        shapely.box(*(np.minimum(least, most) - hair), *(np.maximum(least, most) + hair))
    )
    return None if among.is_empty else _nearest(among, near)


def _nearest(shape: Any, point: Points) -> Points:
    import shapely

    line = shapely.shortest_line(shape, shapely.points(point))
    return np.asarray(shapely.get_coordinates(line)[0])


def viewpoints_on_rows(
    clipped: Clipped,
    lattice: Lattice,
    own: NDArray[np.int64],
    *,
    footprint: float,
    free: Any = None,
) -> Any:
    """Return, for each piece, a point from which the whole piece is visible, on the centre line of
    its row of cells.

    The viewpoint of a piece may lie in the previous or the next cell of the row. Of several
    possible points, the function chooses the point farthest towards the neighbouring cell that
    contains more of the region. If both neighbouring cells contain equally large areas of the
    region, the function chooses the point nearest to the centre of the piece's cell.

    Parameters
    ----------
    clipped : Clipped
    lattice : Lattice
    own : ndarray of int64, shape (H, W)
        Number of each cell's own piece, as in `CellGrid`.
    footprint : float
        Side of the footprint in metres.
    free : Shapely geometry, optional
        The area in which robots may be. By default, robots may be in the whole region.

    Returns
    -------
    list of (ndarray of float64, shape (1, 2)) or None
        One viewpoint for each piece, in the lattice's frame. A piece gets None if no point of the
        centre line sees the whole piece.
    """
    import shapely

    bounds, half = shapely.bounds(clipped.pieces).reshape(-1, 4), footprint / 2
    least, most = bounds[:, 2] - half, bounds[:, 0] + half
    asked = np.flatnonzero(most >= least)
    found: list[Points | None] = [None] * len(clipped.pieces)
    if not len(asked):
        return found
    least, most = least[asked], np.maximum(most[asked], least[asked] + _HAIR)
    x, y = lattice.centers(clipped.rows[asked], clipped.cols[asked]).T
    surroundings = np.stack(
        [clipped.pieces[asked], *(_beside(clipped, lattice, own, asked, step) for step in (-1, 1))],
        axis=1,
    )
    parts, of = shapely.get_parts(shapely.union_all(surroundings, axis=1), return_index=True)
    order = np.lexsort(
        (shapely.distance(parts, shapely.point_on_surface(clipped.pieces[asked])[of]), of)
    )
    area = parts[order[np.searchsorted(of[order], np.arange(len(asked)))]]
    ends = np.stack([np.stack([least, y], axis=1), np.stack([most, y], axis=1)], axis=1)
    lines = shapely.intersection(area, shapely.linestrings(ends))
    lines = lines if free is None else shapely.intersection(lines, free)
    places, of = shapely.get_coordinates(lines, return_index=True)
    begins = np.searchsorted(of, np.arange(len(asked) + 1))
    before, after = np.nan_to_num(shapely.area(surroundings[:, 1:])).T
    for k, number in enumerate(asked.tolist()):
        among = places[begins[k] : begins[k + 1], 0]
        if len(among):
            best = among[np.argmin(np.abs(among - x[k]))]
            best = (
                among.min()
                if before[k] > after[k]
                else among.max()
                if after[k] > before[k]
                else best
            )
            found[number] = np.array([[best, y[k]]])
    return found


def _beside(
    clipped: Clipped,
    lattice: Lattice,
    own: NDArray[np.int64],
    numbers: NDArray[np.int64],
    step: int,
) -> Any:
    """Return, for each given piece, the own piece of the cell ``step`` columns away, or None;
    Shapely geometries, shape (n,).
    """
    rows, cols = clipped.rows[numbers], clipped.cols[numbers] + step
    there = np.flatnonzero((cols >= 0) & (cols < lattice.shape[1]))
    there = there[own[rows[there], cols[there]] >= 0]
    whole = clipped.whole[rows[there], cols[there]]
    full, cut = there[whole], there[~whole]
    surroundings = np.full(len(numbers), None, dtype=object)
    surroundings[full] = lattice.boxes(rows[full], cols[full])
    surroundings[cut] = clipped.pieces[own[rows[cut], cols[cut]]]
    return surroundings
