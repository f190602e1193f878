"""Merging of legs: the removal of points that lie on a straight leg of a path."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from shoal.search.regions.outline_checks import Points


def merged(points: Points, tolerance: float) -> Points:
    """Remove the points of a path that lie on straight legs between other points, in one pass over the points.

    At each kept point, the algorithm starts a cone of directions. A straight leg in a direction of the cone passes all points since
    the kept point within the tolerance. The leg may end at the next point if this point lies inside the cone, and is not nearer to
    the kept point than the points in between. Because of the second condition, the function keeps points at which the path turns
    back. The algorithm comes from Reumann and Witkam, 1974. The exact form of the cone comes from Williams, "An efficient algorithm
    for the piecewise linear approximation of planar curves", 1978.

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
    >>> merged(np.array([(0, 0), (1, 0.0005), (2, 0), (2, 0), (1, 0), (1, 1.0)]), 0.001).tolist()
    [[0.0, 0.0], [2.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
    """
    if len(points) < 2:
        return points
    if points.shape[1] == 3 and np.ptp(points[:, 2]):
        borders = [0, *(np.flatnonzero(np.diff(points[:, 2])) + 1).tolist(), len(points)]
        return np.concatenate([merged(points[begin:end], tolerance) for begin, end in pairwise(borders)])
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


class _Cone:
    """The directions from an apex in which a straight leg passes all added points within the tolerance."""

    def __init__(self, apex: Points, tolerance: float) -> None:
        self.x, self.y = apex.tolist()
        self.tolerance = tolerance
        self.far = 0.0
        self.along: tuple[float, float] | None = None
        self.low, self.high = -math.pi, math.pi

    def takes(self, x: float, y: float) -> bool:
        """Return whether a leg from the apex may end at a point. If so, narrow the cone to directions that pass this point."""
        east, north = x - self.x, y - self.y
        distance = math.hypot(east, north)
        if distance < self.far:
            return False
        if self.along is None:
            self.along = (east, north)
        angle = math.atan2(self.along[0] * north - self.along[1] * east, self.along[0] * east + self.along[1] * north)
        if not self.low <= angle <= self.high:
            return False
        self.far = distance
        width = math.asin(self.tolerance / distance) if distance > self.tolerance else math.pi
        self.low, self.high = max(self.low, angle - width), min(self.high, angle + width)
        return True
