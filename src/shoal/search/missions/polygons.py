"""Polygons with few corners that contain given polygons: the rings of a geofence, of which autopilots store only some corners."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Sequence
from math import inf
from typing import Any

import numpy as np

from shoal.search.regions.outline_checks import Points

_MANY = 300  # corners above which a polygon is first simplified roughly
_FINEST, _STEPS = 0.01, 28  # metres: first tolerance of the rough simplification, and number of increases, each by a factor of √2
_HAIR = 1e-3  # metres: a grown corner may touch what it has to leave free
_TINY = 1e-6  # metres
_NEIGHBOURS = 6  # polygons with which a polygon may be merged


Clear = tuple[Any, float] | None
"""A Shapely geometry that a polygon must not touch, and the distance in metres that the polygon keeps from it; None for nothing."""


def enclosing_polygons(
    shapes: Sequence[Any], most: int, *, clear: Sequence[Clear] = (), merge: Callable[[list[Any]], bool] | None = None
) -> list[Any]:
    """Return polygons that contain the given polygons, and have at most ``most`` corners in total, if this is possible.

    The function removes one corner after another: it cuts off a corner that points inwards, or extends the two neighbours of a side
    until they meet. It always takes the removal that adds the smallest area.

    Parameters
    ----------
    shapes : sequence of Shapely Polygon
        Polygons without holes, in metres.
    most : int
    clear : sequence of (Shapely geometry, float) or None
        For each polygon, what the polygon must not come near to while it grows, and the distance in metres.
    merge : callable, optional
        Function that returns whether given polygons may be used. With this function, the convex hull of two neighbouring polygons
        may replace both, as a last resort. In this case, all entries of ``clear`` must be equal.

    Examples
    --------
    >>> import shapely
    >>> circle = shapely.Point(0, 0).buffer(10)
    >>> (square,) = enclosing_polygons([circle], 4)
    >>> len(square.exterior.coords) - 1, bool(square.covers(circle)), bool(square.area < 1.5 * circle.area)
    (4, True, True)
    """
    import shapely

    free: list[Clear] = list(clear) if len(clear) else [None] * len(shapes)
    shapely.prepare([one[0] for one in free if one is not None])
    rings = [_Ring(_widened(_rough(shape, one)), one) for shape, one in zip(shapes, free, strict=True)]
    while sum(len(ring.points) for ring in rings) > most:
        best = min(rings, key=lambda ring: ring.least, default=None)
        if best is not None and best.least < inf:
            best.reduce()
        elif merge is None or not _merged(rings, merge):
            break
    return [ring.shape for ring in rings]


def _widened(shape: Any) -> Any:
    """Return a polygon that is wider than a given one by more than its rounding errors, with the same number of corners."""
    wider = shape.buffer(_TINY, join_style="mitre", mitre_limit=10.0)
    return wider if wider.geom_type == "Polygon" and corners_of([wider]) <= corners_of([shape]) and wider.covers(shape) else shape


def corners_of(shapes: Sequence[Any]) -> int:
    """Return the number of corners of polygons without holes."""
    return sum(len(shape.exterior.coords) - 1 for shape in shapes)


def _near(shape: Any, clear: Clear) -> bool:
    """Return whether a shape is too near to what it has to keep clear of, or touches it."""
    import shapely

    return clear is not None and bool(shapely.dwithin(clear[0], shape, max(clear[1] - _HAIR, 0.0)))


def _rough(shape: Any, clear: Clear) -> Any:
    """Return a polygon of at most a few hundred corners that contains a given polygon, or the given polygon."""
    if corners_of([shape]) <= _MANY:
        return shape
    best = shape
    for step in range(_STEPS):
        tolerance = _FINEST * 2.0 ** (step / 2)
        wider = shape.buffer(tolerance, join_style="mitre", mitre_limit=2.0).simplify(0.9 * tolerance)
        if wider.geom_type != "Polygon" or not wider.covers(shape) or _near(wider, clear):
            continue
        wider = type(shape)(wider.exterior)
        best = min(best, wider, key=lambda one: len(one.exterior.coords))
        if corners_of([best]) <= _MANY:
            break
    return best


class _Ring:
    """A polygon that loses its corners one after another."""

    def __init__(self, shape: Any, clear: Clear) -> None:
        import shapely

        self.clear = clear
        self._take(shapely.get_coordinates(shapely.orient_polygons(shape).exterior)[:-1])

    def _take(self, points: Points) -> None:
        import shapely

        self.points, self.shape = points, shapely.Polygon(points)
        self._removals = sorted(self._all_removals(), key=lambda one: one[0])
        self._settle()

    @property
    def least(self) -> float:
        """Area in square metres that the cheapest removal of a corner adds; infinity if no corner can be removed."""
        return self._removals[0][0] if self._removals else inf

    def reduce(self) -> None:
        """Remove a corner."""
        self._take(self._without(*self._removals[0][1:3]))

    def _settle(self) -> None:
        """Drop removals until the cheapest one is possible."""
        while self._removals and not self._possible(*self._removals[0][1:]):
            self._removals.pop(0)

    def _all_removals(self) -> Iterator[tuple[float, int, Points | None, Points]]:
        """Yield the added area of each removal, its corner, the new corner or None, and the triangle that it adds."""
        points = self.points
        count = len(points)
        if count <= 3:
            return
        if count == 4:  # sides of a parallelogram never meet: a triangle at one of its corners
            yield from self._triangles()
        before, after, next_after = (np.roll(points, -shift, axis=0) for shift in (-1, 1, 2))
        turns = _cross(points - before, after - points)  # above 0 at a corner that points outwards
        for k in np.flatnonzero(turns <= 0).tolist():
            yield float(-turns[k]) / 2, k, None, np.array([before[k], points[k], after[k]])
        one, other = points - before, after - next_after  # the neighbours of each side, extended beyond it
        across = _cross(one, other)
        with np.errstate(divide="ignore", invalid="ignore"):
            far = _cross(after - points, other) / across
            back = _cross(after - points, one) / across
        outwards = (turns > 0) & (np.roll(turns, -1) > 0) & (far > 0) & (back > 0) & np.isfinite(far) & np.isfinite(back)
        for k in np.flatnonzero(outwards).tolist():
            meeting = points[k] + far[k] * one[k]
            triangle = np.array([points[k], meeting, after[k]])
            yield abs(float(_cross(triangle[1] - triangle[0], triangle[2] - triangle[0]))) / 2, k, meeting, triangle

    def _triangles(self) -> Iterator[tuple[float, int, Points | None, Points]]:
        """Yield the triangles that have two sides of a quadrilateral, and a third side through its opposite corner."""
        for corner in range(4):
            here, after, opposite, before = np.roll(self.points, -corner, axis=0)
            one, other, far = after - here, before - here, opposite - here
            area = float(_cross(one, other))
            if area <= 0:
                continue
            # In the basis of the two sides, the third side is the line of all points with the coordinate sum of the corner.
            total = float(_cross(far, other) + _cross(one, far)) / area
            ring = np.array([here, here + total * one, here + total * other])
            yield area * total**2 / 2 - float(self.shape.area), -1, ring, ring

    def _without(self, corner: int, meeting: Points | None) -> Points:
        """Return the ring without a corner, with a new corner in place of a corner and the next one, or another ring."""
        if corner < 0:
            return np.asarray(meeting)
        points = self.points.copy()
        if meeting is None:
            return np.delete(points, corner, axis=0)
        points[corner] = meeting
        return np.delete(points, (corner + 1) % len(points), axis=0)

    def _possible(self, corner: int, meeting: Points | None, triangle: Points) -> bool:
        import shapely

        added = shapely.Polygon(triangle)
        if added.area > 0 and _near(added.buffer(-_HAIR), self.clear):
            return False
        left = shapely.Polygon(self._without(corner, meeting))
        return bool(left.is_valid and left.area > 0 and left.buffer(_HAIR).covers(self.shape))


def _cross(one: Points, other: Points) -> Any:
    return one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]


def _merged(rings: list[_Ring], accept: Callable[[list[Any]], bool]) -> bool:
    """Replace the two rings whose convex hull adds the least area by this hull; return whether a pair could be merged."""
    import shapely

    if len(rings) < 2:
        return False
    shapes = np.array([ring.shape for ring in rings], dtype=object)
    middles = shapely.get_coordinates(shapely.centroid(shapes))
    found: list[tuple[float, int, int]] = []
    for k in range(len(rings)):
        away = np.hypot(*(middles - middles[k]).T)
        for other in np.argsort(away)[1 : 1 + _NEIGHBOURS].tolist():
            hull = shapely.union(shapes[k], shapes[other]).convex_hull
            heapq.heappush(found, (hull.area - shapes[k].area - shapes[other].area, k, other))
    while found:
        _, one, other = heapq.heappop(found)
        hull = shapely.union(shapes[one], shapes[other]).convex_hull
        clear = rings[one].clear  # all polygons that may be merged keep clear of the same things
        others = [shape for k, shape in enumerate(shapes) if k not in (one, other)]
        if not _near(hull.buffer(-_HAIR), clear) and accept([hull, *others]):
            for index in sorted((one, other), reverse=True):
                del rings[index]
            rings.append(_Ring(hull, clear))
            return True
    return False
