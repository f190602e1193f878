"""The legs of paths: straight ones merged, short ones lengthened, climbs apart from level legs."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from shoal.search.regions.outline import Points

Floats = NDArray[np.float64]


def separate_climbs(path: Floats, ups: Floats) -> tuple[Floats, Floats]:
    """Return the points and altitudes of a path in which each leg is either horizontal or vertical.

    On each given leg, the vehicle first climbs, then flies horizontally, and then descends.

    Examples
    --------
    >>> path, ups = separate_climbs(np.array([(0.0, 0.0), (9.0, 0.0), (9.0, 9.0)]), np.array([30.0, 50.0, 30.0]))
    >>> np.column_stack([path, ups]).tolist()
    [[0.0, 0.0, 30.0], [0.0, 0.0, 50.0], [9.0, 0.0, 50.0], [9.0, 9.0, 50.0], [9.0, 9.0, 30.0]]
    """
    change, moves = np.diff(ups), np.diff(path, axis=0).any(axis=1)
    rises, sinks = np.flatnonzero((change > 0) & moves), np.flatnonzero((change < 0) & moves) + 1
    at = np.concatenate([rises + 1, sinks])
    points = np.insert(path, at, np.concatenate([path[rises], path[sinks]]), axis=0)
    return points, np.insert(ups, at, np.concatenate([ups[rises + 1], ups[sinks - 1]]))


def complete_path(
    home: Floats,
    waypoints: Floats,
    landing: Floats | None = None,
    *,
    climb: float | None = None,
    glides: bool = False,
) -> Floats:
    """Return a complete path: up from the ground at home, along the waypoints, and down at home or
    at the landing point.

    The vehicle climbs vertically to the height ``climb``, and then flies straight to the first
    waypoint. By default, ``climb`` is the height of the first waypoint. If ``glides`` is true, the
    vehicle descends during the last leg. Otherwise, the vehicle descends vertically at the end of
    the path.

    Examples
    --------
    >>> complete_path(np.zeros(2), np.array([(40.0, 0.0, 30.0)])).tolist()
    [[0.0, 0.0, 0.0], [0.0, 0.0, 30.0], [40.0, 0.0, 30.0], [0.0, 0.0, 30.0], [0.0, 0.0, 0.0]]
    """
    end = home if landing is None else landing
    over = np.zeros((0, 3)) if glides else np.array([[*end, waypoints[-1, 2]]])
    return np.vstack(
        [
            [*home, 0.0],
            [*home, waypoints[0, 2] if climb is None else climb],
            waypoints,
            over,
            [*end, 0.0],
        ]
    )


def merge_straight_legs(points: Points, tolerance: float) -> Points:
    """Remove the points of a path that lie on straight legs between other points, in one pass over
    the points.

    At each kept point, the algorithm starts a cone of directions. A straight leg in a direction of
    the cone passes all points since the kept point within the tolerance. The leg may end at the
    next point if this point lies inside the cone, and is not nearer to the kept point than the
    points in between. Because of the second condition, the function keeps points at which the path
    turns back. The algorithm comes from Reumann and Witkam, 1974. The exact form of the cone comes
    from Williams, "An efficient algorithm for the piecewise linear approximation of planar curves",
    1978.

    Parameters
    ----------
    points : ndarray of float64, shape (k, 2) or (k, 3)
        Path in metres. The function keeps points at which the altitude changes.
    tolerance : float
        Maximum distance in metres between a removed point and the leg that replaces it.

    Returns
    -------
    ndarray of float64, shape (m, 2) or (m, 3)
        The kept points of the path, including both ends.

    Examples
    --------
    >>> merge_straight_legs(np.array([(0, 0), (1, 0.0005), (2, 0), (2, 0), (1, 0), (1, 1.0)]), 0.001).tolist()
    [[0.0, 0.0], [2.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
    """
    if len(points) < 2:
        return points
    if points.shape[1] == 3 and np.ptp(points[:, 2]):
        borders = [0, *(np.flatnonzero(np.diff(points[:, 2])) + 1).tolist(), len(points)]
        return np.concatenate(
            [merge_straight_legs(points[begin:end], tolerance) for begin, end in pairwise(borders)]
        )
    path = points[np.concatenate([[True], np.any(np.diff(points, axis=0) != 0, axis=1)])]
    indices = [0]
    cone = _Cone(path[0, :2], tolerance)
    for index, (x, y) in enumerate(path[1:, :2].tolist(), start=1):
        if not cone.takes(x, y):
            indices.append(index - 1)
            cone = _Cone(path[index - 1, :2], tolerance)
            cone.takes(x, y)
    if indices[-1] != len(path) - 1:
        indices.append(len(path) - 1)
    return np.asarray(path[indices])


def lengthen_short_legs(points: Points, least: float, allowed: Callable[[Points], bool]) -> Points:
    """Return a path without legs shorter than an acceptance radius, as far as its surroundings
    allow.

    A vehicle counts a waypoint as reached at the acceptance radius, so it would skip the end of a
    shorter leg. On a curve, a short leg is replaced by the point where the legs before and after it
    meet, so the new path leads outside the curve, not across it. Elsewhere, the path omits one end
    of a short leg. Beside an end of the path, where the path around an obstacle has no room for
    this, the short leg becomes longer.

    Parameters
    ----------
    points : ndarray of float64, shape (k, 2) or (k, 3)
        Path in metres. Points at which the altitude changes, and both ends, stay.
    least : float
        Smallest length of a leg in metres.
    allowed : callable
        Function that tells whether a vehicle may follow a path, shape (m, 2).

    Examples
    --------
    >>> around = np.array([(0.0, 0.0), (9.5, 0.0), (10.0, 0.5), (10.0, 9.0)])
    >>> lengthen_short_legs(around, 1.0, lambda path: True).tolist()
    [[0.0, 0.0], [10.0, 0.0], [10.0, 9.0]]
    """
    path = points[:, :2].tolist()
    ups = points[:, 2].tolist() if points.shape[1] == 3 else [0.0] * len(path)
    refused: set[tuple[float, ...]] = set()
    k = 0
    while k + 1 < len(path) > 2:  # the leg from k to k + 1
        begin, end = path[k], path[k + 1]
        length = math.dist(begin, end)
        if k and not length and ups[k] == ups[k + 1]:  # where the path turned back at a short leg
            del path[k], ups[k]
            k -= 1
            continue
        key = (*begin, *end)
        first, last = k == 0, k + 2 >= len(path)
        if not 0 < length < least or len({*ups[max(k - 1, 0) : k + 3]}) > 1 or key in refused:
            k += 1
            continue
        if first:
            options = [[begin], [begin, _beyond(begin, end, least)]]
        elif last:
            options = [[end], [_beyond(end, begin, least), end]]
        else:
            options = [[met] for met in _meeting(path[k - 1], begin, end, path[k + 2], least)] + [
                [end],
                [begin],
            ]
        for instead in options:
            if allowed(np.array([*path[max(k - 1, 0) : k], *instead, *path[k + 2 : k + 3]])):
                path[k : k + 2], ups[k : k + 2] = instead, [ups[k]] * len(instead)
                k = max(k - 1, 0)
                break
        else:
            refused.add(key)
    result = np.array(path)
    return np.column_stack([result, ups]) if points.shape[1] == 3 else result


def _beyond(begin: list[float], end: list[float], least: float) -> list[float]:
    """Return the point just beyond the length ``least`` on the leg from ``begin``
    through ``end``.
    """
    share = (1 + 1e-6) * least / math.dist(begin, end)
    return [begin[0] + share * (end[0] - begin[0]), begin[1] + share * (end[1] - begin[1])]


def _meeting(
    before: list[float], begin: list[float], end: list[float], after: list[float], least: float
) -> list[list[float]]:
    """Return the point where the leg to ``begin`` and the leg from ``end`` meet if they are
    extended, if it is near to both.
    """
    ax, ay, bx, by = (
        begin[0] - before[0],
        begin[1] - before[1],
        after[0] - end[0],
        after[1] - end[1],
    )
    cross = ax * by - ay * bx
    if abs(cross) <= 1e-9 * math.hypot(ax, ay) * math.hypot(bx, by):
        return []
    far = ((end[0] - begin[0]) * by - (end[1] - begin[1]) * bx) / cross
    back = ((end[0] - begin[0]) * ay - (end[1] - begin[1]) * ax) / cross
    met = [begin[0] + far * ax, begin[1] + far * ay]
    return (
        [met]
        if far > 0 > back and math.dist(met, begin) <= least and math.dist(met, end) <= least
        else []
    )


class _Cone:
    """The directions from an apex in which a straight leg passes all added points within the
    tolerance.
    """

    def __init__(self, apex: Points, tolerance: float) -> None:
        self.x, self.y = apex.tolist()
        self.tolerance = tolerance
        self.far = 0.0
        self.along: tuple[float, float] | None = None
        self.low, self.high = -math.pi, math.pi

    def takes(self, x: float, y: float) -> bool:
        """Return whether a leg from the apex may end at a point. If so, narrow the cone to
        directions that pass this point.
        """
        east, north = x - self.x, y - self.y
        distance = math.hypot(east, north)
        if distance < self.far:
            return False
        if self.along is None:
            self.along = (east, north)
        angle = math.atan2(
            self.along[0] * north - self.along[1] * east,
            self.along[0] * east + self.along[1] * north,
        )
        if not self.low <= angle <= self.high:
            return False
        self.far = distance
        width = math.asin(self.tolerance / distance) if distance > self.tolerance else math.pi
        self.low, self.high = max(self.low, angle - width), min(self.high, angle + width)
        return True
