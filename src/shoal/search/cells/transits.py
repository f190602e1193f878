"""Transits: paths outside the region, between launch points and the region or between its parts, around no-go zones."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from shoal.core.errors import InvalidInputError
from shoal.search.cells.visibility_graph import VisibilityGraph, inside, length_of
from shoal.search.regions.margin import coarse, grown
from shoal.search.regions.outline_checks import Points, check_plane_points, text_of
from shoal.search.regions.region import SearchRegion, polygons_in

Ways = Callable[[Points, Points], Points]

_ROOM = 1.0  # how far paths may lead around the region and the launch points, relative to the longer side of their bounds


class Transits:
    """The shortest paths between points inside a region and points outside it.

    All paths keep the region's margin from no-go zones and holes. A path may cross a hole that contains a launch or landing point.

    Parameters
    ----------
    region : SearchRegion
    points : array_like of float, shape (n, 2)
        Launch points in metres, where vehicles also land without ``landing``.
    landing : array_like of float, shape (m, 2), optional
        Landing points in metres.

    Raises
    ------
    InvalidInputError
        If a point lies in a no-go zone, or is closer to a no-go zone than the margin.

    Examples
    --------
    >>> from shoal.search import open_region
    >>> ring = open_region("ring:50x40")
    >>> Transits(ring, [(-60.0, 0.0)]).way((-60.0, 0.0), (-45.0, 0.0)).tolist()
    [[-60.0, 0.0], [-45.0, 0.0]]
    """

    def __init__(self, region: SearchRegion, points: ArrayLike, landing: ArrayLike | None = None) -> None:
        import shapely

        launches = check_plane_points(points, what="launch points")
        landings = np.zeros((0, 2)) if landing is None else check_plane_points(landing, what="landing points")
        places = np.vstack([launches, landings])
        holes = [shapely.Polygon(hole) for part in shapely.get_parts(region.outline) for hole in part.interiors]
        there = shapely.multipoints(places)
        # No path to a place or to a part of the region inside a hole avoids the hole.
        crossed = [hole.intersects(there) or hole.intersection(region.outline).area > 0 for hole in holes]
        barred = shapely.union_all([region.barred, *(hole for hole, open_ in zip(holes, crossed, strict=True) if not open_)])
        low, high = np.array(region.outline.union(there).bounds).reshape(2, 2)
        room = _ROOM * float((high - low).max()) + 2 * region.margin
        around = shapely.box(*(low - room), *(high + room))
        space = polygons_in(
            shapely.union_all([around.difference(grown(barred, region.margin, pointed=region.pointed)), region.free])
        )
        bends = polygons_in(around.difference(coarse(barred, region.margin)))
        self._space = replace(region, area=space, free=space, outline=space, bends=bends)
        for number in np.flatnonzero(~self._space.contains(places)).tolist():
            name, place = "launch" if number < len(launches) else "land", places[number]
            raise InvalidInputError(
                f"{name}: expected places outside of no-go zones and holes{region.margin_text}, got {text_of(place)} m"
            )

    @cached_property
    def _corners(self) -> VisibilityGraph:
        return VisibilityGraph(self._space)

    def way(self, start: ArrayLike, end: ArrayLike) -> Points:
        """Return the shortest path from one point to another, in metres; float64, shape (k, 2), k >= 2.

        Raises
        ------
        InvalidInputError
            If no-go zones or holes block all paths.
        """
        ends = np.stack([np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)])
        if inside(self._space, ends[:1], ends[1:])[0]:
            return ends
        found = self._corners.shortest(ends[0], ends[1], np.arange(len(self._corners.corners)))
        if found is None:
            places = f"{text_of(ends[0])} m to {text_of(ends[1])} m"
            raise InvalidInputError(f"launch: expected a path from {places} around no-go zones, got none")
        return found


class WaysOut:
    """Distances from launch points outside a region to the cells of the region, in cell sides.

    Parameters
    ----------
    way : callable
        Function that returns the path from a launch point to a point of the region, such as `Transits.way`.
    launches : mapping of int to ndarray of float64, shape (2,)
        For the number of each robot that starts outside the region (counted from 1), the robot's launch point in metres.
    stops : ndarray of float64, shape (N, 2) or (N, 3)
        Viewpoint of each cell in metres, in the order of the tour. The third coordinate is the altitude, scaled so that a climb is
        as long as a horizontal path of the same duration. The class assumes that all launch points have the altitude of the lowest
        viewpoint.
    size : float
        Side of a cell in metres.
    """

    def __init__(self, way: Ways, launches: Mapping[int, Points], stops: Points, size: float) -> None:
        self._way, self._launches, self._stops, self._size = way, launches, stops, size
        self._known: dict[tuple[float, ...], float] = {}

    def __contains__(self, number: int) -> bool:
        return number in self._launches

    def length(self, number: int, cell: int) -> float:
        """Return the length, in cell sides, of the path and the climb from a robot's launch point to a cell."""
        launch = self._launches[number]
        key = (*launch.tolist(), cell)
        if key not in self._known:
            stop = self._stops[cell]
            up = float((stop[2:] - self._stops[:, 2:].min(axis=0)).sum())
            self._known[key] = (length_of(self._way(launch, stop[:2])) + up) / self._size
        return self._known[key]
