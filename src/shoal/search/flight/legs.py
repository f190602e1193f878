"""The legs of paths: straight ones merged, short ones lengthened, climbs apart from level legs."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from shoal.search.regions.outline import Points

Floats = NDArray[np.float64]


def separate_climbs(way: Floats, ups: Floats) -> tuple[Floats, Floats]:
    """Return the points and altitudes of a path in which each leg is either horizontal or vertical.

    On each given leg, the vehicle first climbs, then flies horizontally, and then descends.

    Examples
    --------
    >>> way, ups = separate_climbs(np.array([(0.0, 0.0), (9.0, 0.0), (9.0, 9.0)]), np.array([30.0, 50.0, 30.0]))
    >>> np.column_stack([way, ups]).tolist()
    [[0.0, 0.0, 30.0], [0.0, 0.0, 50.0], [9.0, 0.0, 50.0], [9.0, 9.0, 50.0], [9.0, 9.0, 30.0]]
    """
    change, moves = np.diff(ups), np.diff(way, axis=0).any(axis=1)
    rises, sinks = np.flatnonzero((change > 0) & moves), np.flatnonzero((change < 0) & moves) + 1
    at = np.concatenate([rises + 1, sinks])
    kept = np.insert(way, at, np.concatenate([way[rises], way[sinks]]), axis=0)
    return kept, np.insert(ups, at, np.concatenate([ups[rises + 1], ups[sinks - 1]]))


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
    way = points[np.concatenate([[True], np.any(np.diff(points, axis=0) != 0, axis=1)])]
    kept = [0]
    cone = _Cone(way[0, :2], tolerance)
    for index, (x, y) in enumerate(way[1:, :2].tolist(), start=1):
        if not cone.takes(x, y):
            kept.append(index - 1)
            cone = _Cone(way[index - 1, :2], tolerance)
            cone.takes(x, y)
    if kept[-1] != len(way) - 1:
        kept.append(len(way) - 1)
    return np.asarray(way[kept])


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
    >>> lengthen_short_legs(around, 1.0, lambda way: True).tolist()
    [[0.0, 0.0], [10.0, 0.0], [10.0, 9.0]]
    """
    way = points[:, :2].tolist()
    ups = points[:, 2].tolist() if points.shape[1] == 3 else [0.0] * len(way)
    refused: set[tuple[float, ...]] = set()
    k = 0
    while k + 1 < len(way) > 2:  # the leg from k to k + 1
        here, then = way[k], way[k + 1]
        length = math.dist(here, then)
        key = (*here, *then)
        first, last = k == 0, k + 2 >= len(way)
        if not 0 < length < least or len({*ups[max(k - 1, 0) : k + 3]}) > 1 or key in refused:
            k += 1
            continue
        if first:
            options = [[here], [here, _beyond(here, then, least)]]
        elif last:
            options = [[then], [_beyond(then, here, least), then]]
        else:
            options = [[met] for met in _meeting(way[k - 1], here, then, way[k + 2], least)] + [
                [then],
                [here],
            ]
        for instead in options:
            if allowed(np.array([*way[max(k - 1, 0) : k], *instead, *way[k + 2 : k + 3]])):
                way[k : k + 2], ups[k : k + 2] = instead, [ups[k]] * len(instead)
                k = max(k - 1, 0)
                break
        else:
            refused.add(key)
    made = np.array(way)
    return np.column_stack([made, ups]) if points.shape[1] == 3 else made


def _beyond(here: list[float], then: list[float], least: float) -> list[float]:
    """Return the point just beyond the length ``least`` on the leg from ``here``
    through ``then``.
    """
    share = (1 + 1e-6) * least / math.dist(here, then)
    return [here[0] + share * (then[0] - here[0]), here[1] + share * (then[1] - here[1])]


def _meeting(
    before: list[float], here: list[float], then: list[float], after: list[float], least: float
) -> list[list[float]]:
    """Return the point where the leg to ``here`` and the leg from ``then`` meet if they are
    extended, if it is near to both.
    """
    ax, ay, bx, by = (
        here[0] - before[0],
        here[1] - before[1],
        after[0] - then[0],
        after[1] - then[1],
    )
    cross = ax * by - ay * bx
    if abs(cross) <= 1e-9 * math.hypot(ax, ay) * math.hypot(bx, by):
        return []
    far = ((then[0] - here[0]) * by - (then[1] - here[1]) * bx) / cross
    back = ((then[0] - here[0]) * ay - (then[1] - here[1]) * ax) / cross
    met = [here[0] + far * ax, here[1] + far * ay]
    return (
        [met]
        if far > 0 > back and math.dist(met, here) <= least and math.dist(met, then) <= least
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
