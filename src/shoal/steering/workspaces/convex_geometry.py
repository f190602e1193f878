"""Functions for convex polygons: checks of outlines, counter-clockwise order, simplification, convex hulls and clipping."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_points
from shoal.core.errors import InvalidInputError

Points = NDArray[np.float64]

_FLAT = 1e-9  # relative to the size: a thinner outline has no interior
_STRAIGHT = 1e-12  # relative to the squared size: a corner with a smaller turn is dropped


def convex_outline(vertices: ArrayLike) -> Points:
    """Return the corners of a convex polygon in counter-clockwise order; float64, shape (n, 2).

    The order of ``vertices`` may be clockwise or counter-clockwise. The last vertex may repeat the first vertex. The result leaves
    out repeated vertices and vertices in the middle of a straight side.

    Raises
    ------
    InvalidInputError
        If the outline is flat, crosses itself or is not convex. The error message gives the number of the wrong vertex, counted
        from 1.

    Examples
    --------
    >>> convex_outline([(0, 0), (0, 1), (1, 1), (1, 0.5), (1, 0)]).tolist()
    [[1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]]
    """
    from shapely import LinearRing

    given = check_points(vertices, what="polygon", dimensions=2)
    places = np.arange(len(given))
    kept = np.any(given != np.roll(given, 1, axis=0), axis=1) if len(given) > 1 else np.ones(len(given), dtype=np.bool_)
    corners, places = given[kept], places[kept]
    if len(corners) < 3:
        raise InvalidInputError(f"polygon: expected 3 different vertices or more, got {len(corners)}")
    size = float(np.ptp(corners, axis=0).max())
    area = signed_area(corners)
    ring = LinearRing(corners)
    if abs(area) <= _FLAT * size * size and _thickness(corners) <= _FLAT * size:
        raise InvalidInputError(f"polygon: expected an outline with an interior, got a flat one, {len(given)} vertices on a line")
    if not ring.is_simple:
        where = _crossing(corners)
        raise InvalidInputError(f"polygon: expected an outline that does not cross itself, got one that does{where}")
    if area < 0:
        corners, places = corners[::-1], places[::-1]
    turns = _turns(corners)
    straight = np.abs(turns) <= _STRAIGHT * size * size
    corners, places, turns = corners[~straight], places[~straight], turns[~straight]
    if (turns < 0).any():
        worst = int(np.argmax(turns < 0))
        corner = tuple(corners[worst].tolist())
        raise InvalidInputError(
            "polygon: expected a convex outline (a region takes any outline), "
            f"got one that bends inward at vertex {places[worst] + 1}, {corner}"
        )
    return np.ascontiguousarray(corners)


def hull(points: Points) -> Points:
    """Return the corners of the convex hull of ``points``; float64, shape (n, 2).

    If all points lie on one line, the result consists of the two end points.
    """
    from shapely import MultiPoint

    whole = MultiPoint(points).convex_hull
    return np.asarray(whole.exterior.coords)[:-1] if whole.geom_type == "Polygon" else np.asarray(whole.coords)


def clipped(corners: Points, normal: Points, most: float) -> Points:
    """Return the corners of the part of a convex polygon in which ``normal @ point <= most``."""
    kept = []
    depths = corners @ normal - most
    for point, following, depth, next_depth in zip(corners, np.roll(corners, -1, axis=0), depths, np.roll(depths, -1), strict=True):
        if depth <= 0:
            kept.append(point)
        if (depth < 0 < next_depth) or (next_depth < 0 < depth):
            kept.append(point + depth / (depth - next_depth) * (following - point))
    return np.array(kept).reshape(-1, 2)


def signed_area(corners: Points) -> float:
    """Return the area of the polygon with the given corners, negative if the corners are in clockwise order."""
    x, y = corners.T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _thickness(corners: Points) -> float:
    """Return the largest distance of a corner from the straight line that fits all corners best."""
    centred = corners - corners.mean(axis=0)
    return float(np.abs(centred @ np.linalg.svd(centred, full_matrices=False)[2][1]).max())


def _turns(corners: Points) -> NDArray[np.float64]:
    before, after = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
    return np.asarray(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])


def _crossing(corners: Points) -> str:
    from shapely import Polygon
    from shapely.validation import explain_validity

    said = explain_validity(Polygon(corners))
    return f" at ({said.partition('[')[2].rstrip(']').replace(' ', ', ')})" if "[" in said else ""
