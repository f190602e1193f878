"""Paths in a region: shortest paths around corners, straightened paths, and their lengths."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_array
from shoal.core.errors import InvalidInputError
from shoal.core.geometry import cross
from shoal.search.kernels.borders import places_around, places_within
from shoal.search.regions.outline import Points
from shoal.search.regions.region import SearchRegion

_STRAIGHT = 1e-12  # sine of the largest angle that does not count as a turn


# number of points of a path among which `pull_string` looks for the farthest visible point
_LOOK_AHEAD = 64


def inside(region: SearchRegion, starts: Points, ends: Points) -> NDArray[np.bool_]:
    """Return, for each straight segment, whether it stays inside the region apart from rounding
    errors; bool, shape (n,).

    Parameters
    ----------
    region : SearchRegion
    starts, ends : ndarray of float64, shape (n, 2)
        Start and end of each segment in metres. Each start must lie inside the region.
    """
    return ~region.border.is_met(starts, ends)


class VisibilityGraph:
    """The corners of a region at which shortest paths can bend.

    Shortest paths bend only at corners where the inner angle of the region is above 180 degrees.
    The path search prefers a path that bends only at corners of `SearchRegion.bends` to a shorter
    path around other corners.

    Parameters
    ----------
    region : SearchRegion

    Attributes
    ----------
    corners : ndarray of float64, shape (n, 2)
        Positions of the corners in metres. The corners of `SearchRegion.bends` come first.
    """

    def __init__(self, region: SearchRegion) -> None:
        self._region = region
        few, every = (_inward_corners(shape) for shape in (region.bends, region.free))
        few = few[:, region.contains(few[0])] if few.size else few
        self._few = len(few[0])
        self.corners, before, after = np.concatenate([few, every], axis=1)
        self._sides = np.hstack(
            [
                side / np.maximum(np.hypot(*side.T), np.finfo(float).tiny)[:, None]
                for side in (before - self.corners, after - self.corners)
            ]
        )
        low = self.corners.min(axis=0) if len(self.corners) else np.zeros(2)
        wide = np.maximum((self.corners - low).max(axis=0, initial=0.0), 1e-9)
        # about two corners in each bin; at most as many bins as corners, whatever their places
        bins = max(1.0, len(self.corners) / 2)
        size = max(float(np.sqrt(wide.prod() / bins)), float(wide.max()) / bins)
        shape = (int(wide[1] / size) + 1, int(wide[0] / size) + 1)
        col, row = ((self.corners - low) / size).astype(np.int64).T
        number = row * shape[1] + col
        order = np.argsort(number, kind="stable")
        first = np.searchsorted(number[order], np.arange(shape[0] * shape[1] + 1))
        self._bins = self.corners, order, first, shape, low, size

    def within(self, low: Points, high: Points, most: int | None = None) -> NDArray[np.int64]:
        """Return the indices of the corners inside the box with the corners ``low`` and ``high``,
        in increasing order, or some ``most`` of them if there are more; int64, shape (k,).
        """
        count = len(self.corners)
        indices = np.empty(count if most is None else min(most, count), dtype=np.int64)
        return np.sort(indices[: places_within(*self._bins, low, high, indices)])

    def around(self, points: Points, distance: float) -> NDArray[np.int64]:
        """Return the indices of the corners that are at most ``distance`` metres away from one of
        the points, in increasing order; int64, shape (k,).
        """
        near = np.zeros(len(self.corners), dtype=np.bool_)
        places_around(*self._bins, np.ascontiguousarray(points), float(distance), near)
        return np.flatnonzero(near)

    def shortest(
        self,
        start: Points,
        end: Points,
        candidates: NDArray[np.int64],
        *,
        rough: bool = False,
        most: float = np.inf,
    ) -> Points | None:
        """Return the shortest path that bends only at given corners, or None if no path exists;
        float64, shape (k, 2).

        Parameters
        ----------
        start, end : ndarray of float64, shape (2,)
            Start and end of the path in metres, which must lie inside the region.
        candidates : ndarray of int64, shape (c,)
            Indices of the corners at which the path may bend, in increasing order.
        rough : bool
            Whether a path that bends only at corners of `SearchRegion.bends` is enough, if the
            region has such a shape. That no such path exists is known sooner.
        most : float
            Length in metres above which a path is of no use.
        """
        few = candidates[candidates < self._few]
        path = self._shortest(start, end, few, most)
        if path is not None or (rough and self._few):
            return path
        return self._shortest(start, end, candidates, most)

    def _shortest(
        self, start: Points, end: Points, candidates: NDArray[np.int64], most: float
    ) -> Points | None:
        """Find the shortest path that bends only at candidate corners, if it is not longer than
        ``most``. If no such path exists, return None.
        """
        # a path to a corner and on to the end is at least so long
        places = self.corners[candidates]
        if most < np.inf:
            near = np.hypot(*(places - start).T) + np.hypot(*(places - end).T) <= most
            candidates, places = candidates[near], places[near]
        if not len(candidates):
            return None
        bends = self._region.border.path_around(
            places, self._sides[candidates], np.stack([start, end]), most
        )
        return None if bends is None else np.vstack([start, places[bends], end])


def visibility_graph(region: SearchRegion) -> VisibilityGraph:
    """Return the visibility graph of a region, which all plans for the region share."""
    if "graph" not in region.for_paths:
        region.for_paths["graph"] = VisibilityGraph(region)
    graph: VisibilityGraph = region.for_paths["graph"]
    return graph


def _inward_corners(area: Any) -> Points:
    """Return the corners of a polygon at which shortest paths can bend; float64, shape (3, n, 2).

    The result holds three arrays: the corners, the vertex before each corner on the border, and the
    vertex after each corner.
    """
    import shapely

    corner_arrays: list[Any] = [np.zeros((3, 0, 2))]
    for polygon in shapely.get_parts(area) if area is not None else ():
        oriented = shapely.orient_polygons(polygon)
        for ring in (oriented.exterior, *oriented.interiors):
            corners = shapely.get_coordinates(ring)[:-1]
            before, after = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
            come, go = corners - before, after - corners
            inward = cross(come, go) < -_STRAIGHT * np.hypot(*come.T) * np.hypot(*go.T)
            corner_arrays.append(np.stack([corners[inward], before[inward], after[inward]]))
    return np.asarray(np.concatenate(corner_arrays, axis=1))


def pull_string(region: SearchRegion, path: Points) -> Points:
    """Return a shortened path with fewer bends, which has some of the points of the path ``path``.

    From each of its points, the new path leads straight to the last visible point among the next 64
    points of the path ``path``.
    """
    return np.asarray(path[region.border.pull(path, _LOOK_AHEAD)])


def merge_collinear(points: Points) -> Points:
    """Remove repeated points from a path, and points on the straight line between the previous and
    the next point.

    The function keeps points at which the path turns back.

    Examples
    --------
    >>> merge_collinear(np.array([(0, 0), (1, 0), (1, 0), (2, 0), (1, 0), (1, 1.0)])).tolist()
    [[0.0, 0.0], [2.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
    """
    path = check_array(points, expected="points: expected the points of a path")
    path = path.astype(np.float64, copy=False)
    if path.ndim != 2:
        raise InvalidInputError(
            f"points: expected the points of a path, got an array of shape {path.shape}"
        )
    if len(path) < 2:
        return path
    path = path[np.concatenate([[True], np.any(np.diff(path, axis=0) != 0, axis=1)])]
    steps = np.diff(path, axis=0)
    before, after = steps[:-1], steps[1:]
    scale = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    # in the plane, because paths bend around vertical walls
    upright = np.zeros((len(before), 3 - path.shape[1]))
    turn = np.linalg.norm(
        np.cross(np.hstack([before, upright]), np.hstack([after, upright])), axis=1
    )
    straight = (turn <= 1e-9 * scale) & (np.sum(before * after, axis=1) > 0)
    return np.asarray(
        path[np.concatenate([[True], ~straight, np.ones(min(1, len(steps)), dtype=np.bool_)])]
    )


def length_of(path: Points) -> float:
    """Return the length of a path in metres."""
    return float(leg_lengths(path).sum())


def leg_lengths(path: Points) -> NDArray[np.float64]:
    """Return the length of each leg of a path in metres, in two or three dimensions; float64, shape
    (k - 1,).
    """
    steps = np.diff(path, axis=0).T
    level = np.hypot(steps[0], steps[1])
    return np.asarray(level if len(steps) == 2 else np.hypot(level, steps[2]))
