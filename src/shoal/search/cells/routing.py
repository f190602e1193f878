"""Routing: short paths inside a region, through portals between its cells, and across gaps between
its parts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_bool, check_kind
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.geometry import partial_sums
from shoal.search.cells.bends import with_fewer_bends
from shoal.search.cells.graphs import Graph
from shoal.search.cells.grid import CellGrid, cells_of
from shoal.search.cells.visibility_graph import (
    VisibilityGraph,
    inside,
    leg_lengths,
    length_of,
    merge_collinear,
    pull_string,
    visibility_graph,
)
from shoal.search.regions.margin import grow, grow_coarsely, without_margin
from shoal.search.regions.outline import Points, check_plane_points, text_of
from shoal.search.regions.region import SearchRegion, polygons_in


class PortalGraph:
    """The pieces of a grid's cells, connected by portals.

    Parameters
    ----------
    grid : CellGrid
    """

    def __init__(self, grid: CellGrid) -> None:
        self.grid = grid
        self._n = len(grid.clipped.pieces)

    def through(self, start: Points, end: Points) -> Points | None:
        """Return the start, the portal midpoints and the end of a path through the fewest pieces;
        float64, shape (k, 2).

        If rounding errors have closed a portal so that no path exists, the result is None.
        """
        first, last = self._piece(start), self._piece(end)
        predecessors = self._graph.predecessors(first, last)
        path = [last]
        while path[-1] != first:
            if predecessors[path[-1]] < 0:
                return None
            path.append(int(predecessors[path[-1]]))
        return np.vstack([start, self._gates(np.array(path[::-1])), end])

    @cached_property
    def _numbers(self) -> NDArray[np.int64]:
        """Number of the piece or whole cell of each node, numbered as in `Portals`, in increasing
        order.
        """
        return np.concatenate(
            [np.arange(self._n), self._n + np.flatnonzero(self.grid.clipped.whole)]
        )

    @cached_property
    def _graph(self) -> Graph:
        whole = self.grid.clipped.whole
        flat = self._n + np.arange(whole.size).reshape(whole.shape)
        right, down = whole[:, :-1] & whole[:, 1:], whole[:-1] & whole[1:]
        pairs = np.concatenate(
            [
                self.grid.portals.pairs,
                np.stack([flat[:, :-1][right], flat[:, 1:][right]], axis=1),
                np.stack([flat[:-1][down], flat[1:][down]], axis=1),
            ]
        )
        first, second = np.searchsorted(self._numbers, pairs).T
        return Graph.from_edges(first, second, np.ones(len(pairs)), len(self._numbers))

    def _pairs(self, nodes: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return one number for each pair of nodes, whatever their order; int64, shape (k,)."""
        return np.asarray(nodes.min(axis=1) * len(self._numbers) + nodes.max(axis=1))

    @cached_property
    def _widest(self) -> tuple[NDArray[np.int64], Points]:
        """The pairs of nodes that portals connect, in increasing order, and the midpoint of the
        widest portal of each pair in metres.
        """
        portals = self.grid.portals
        pairs = self._pairs(np.searchsorted(self._numbers, portals.pairs))
        order = np.lexsort((-portals.widths, pairs))
        unique_pairs, first = np.unique(pairs[order], return_index=True)
        return unique_pairs, portals.middles[order[first]]

    def _gates(self, path: NDArray[np.int64]) -> Points:
        """Return a point between each two consecutive nodes of a path, in metres; float64, shape
        (k - 1, 2).
        """
        lattice, (unique_pairs, middles) = self.grid.lattice, self._widest
        rows, cols = np.divmod(self._numbers[path] - self._n, self.grid.shape[1])
        centers = lattice.centers(rows, cols)
        gates = lattice.to_region((centers[:-1] + centers[1:]) / 2)  # between two whole cells
        pairs = self._pairs(np.stack([path[:-1], path[1:]], axis=1))
        at = np.searchsorted(unique_pairs, pairs)
        portal = at < len(unique_pairs)
        portal[portal] = unique_pairs[at[portal]] == pairs[portal]
        gates[portal] = middles[at[portal]]
        return np.asarray(gates)

    def _piece(self, point: Points) -> int:
        """Return the node whose piece or whole cell is nearest to a point."""
        import shapely

        clipped, lattice = self.grid.clipped, self.grid.lattice
        place = lattice.from_region(point)
        row, col = (int(index[0]) for index in lattice.cells_at(place[None]))
        # pieces are sorted by row and column
        low = np.searchsorted(clipped.rows, row - 1)
        high = np.searchsorted(clipped.rows, row + 1, side="right")
        near = low + np.flatnonzero(np.abs(clipped.cols[low:high] - col) <= 1)
        r, c = np.clip([row, col], 0, np.array(lattice.shape) - 1)
        if clipped.whole[r, c]:
            return int(np.searchsorted(self._numbers, self._n + r * lattice.shape[1] + c))
        numbers = near if len(near) else np.arange(self._n)
        return int(
            numbers[np.argmin(shapely.distance(clipped.pieces[numbers], shapely.points(place)))]
        )


PathFinder = Callable[[Points, Points], Points]

# how far paths may lead around the region and the launch points, relative to the longer side of
# their bounds
_SURROUNDINGS = 1.0


class Transits:
    """The shortest paths between points inside a region and points outside it.

    All paths keep the region's margin from no-go zones and holes. A path may cross a hole that
    contains a launch or landing point.

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
    >>> Transits(ring, [(-60.0, 0.0)]).path((-60.0, 0.0), (-45.0, 0.0)).tolist()
    [[-60.0, 0.0], [-45.0, 0.0]]
    """

    def __init__(
        self, region: SearchRegion, points: ArrayLike, landing: ArrayLike | None = None
    ) -> None:
        import shapely

        launches = check_plane_points(points, what="launch points")
        landings = (
            np.zeros((0, 2))
            if landing is None
            else check_plane_points(landing, what="landing points")
        )
        places = np.vstack([launches, landings])
        endpoints = shapely.multipoints(places)
        # No path to a place or to a part of the region inside a hole avoids the hole.
        crossed = [
            hole.intersects(endpoints) or hole.intersection(region.outline).area > 0
            for hole in region.holes
        ]
        barred = shapely.union_all(
            [
                region.barred,
                *(hole for hole, open_ in zip(region.holes, crossed, strict=True) if not open_),
            ]
        )
        low, high = np.array(region.outline.union(endpoints).bounds).reshape(2, 2)
        distance = _SURROUNDINGS * float((high - low).max()) + 2 * region.margin
        around = shapely.box(*(low - distance), *(high + distance))
        space = polygons_in(
            shapely.union_all(
                [
                    around.difference(grow(barred, region.margin, pointed=region.pointed)),
                    region.free,
                ]
            )
        )
        bends = polygons_in(around.difference(grow_coarsely(barred, region.margin)))
        self._space = replace(region, area=space, free=space, outline=space, bends=bends)
        for number in np.flatnonzero(~self._space.contains(places)).tolist():
            name, place = "launch" if number < len(launches) else "land", places[number]
            raise InvalidInputError(
                f"{name}: expected places outside of no-go zones and holes{region.margin_text}, got"
                f" {text_of(place)} m"
            )

    @cached_property
    def _corners(self) -> VisibilityGraph:
        return VisibilityGraph(self._space)

    def path(self, start: ArrayLike, end: ArrayLike) -> Points:
        """Return the shortest path from one point to another, in metres; float64, shape (k, 2), k
        >= 2.

        Raises
        ------
        InvalidInputError
            If no-go zones or holes block all paths.
        """
        ends = np.stack([np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)])
        if inside(self._space, ends[:1], ends[1:])[0]:
            return ends
        path = self._corners.shortest(ends[0], ends[1], np.arange(len(self._corners.corners)))
        if path is None:
            places = f"{text_of(ends[0])} m to {text_of(ends[1])} m"
            raise InvalidInputError(
                f"launch: expected a path from {places} around no-go zones, got none"
            )
        return path


class LaunchDistances:
    """Distances from launch points outside a region to the cells of the region, in cell sides.

    Parameters
    ----------
    find_path : callable
        Function that returns the path from a launch point to a point of the region, such as
        `Transits.path`.
    launches : mapping of int to ndarray of float64, shape (2,)
        For the number of each robot that starts outside the region (counted from 1), the robot's
        launch point in metres.
    stops : ndarray of float64, shape (N, 2) or (N, 3)
        Viewpoint of each cell in metres, in the order of the tour. The third coordinate is the
        altitude, scaled so that a climb is as long as a horizontal path of the same duration. The
        class assumes that all launch points have the altitude of the lowest viewpoint.
    size : float
        Side of a cell in metres.
    """

    def __init__(
        self, find_path: PathFinder, launches: Mapping[int, Points], stops: Points, size: float
    ) -> None:
        self._find_path, self._launches, self._stops, self._size = find_path, launches, stops, size
        self._cache: dict[tuple[float, ...], float] = {}

    def __contains__(self, number: int) -> bool:
        return number in self._launches

    def length(self, number: int, cell: int) -> float:
        """Return the length, in cell sides, of the path and the climb from a robot's launch point
        to a cell.
        """
        launch = self._launches[number]
        key = (*launch.tolist(), cell)
        if key not in self._cache:
            stop = self._stops[cell]
            up = float((stop[2:] - self._stops[:, 2:].min(axis=0)).sum())
            self._cache[key] = (length_of(self._find_path(launch, stop[:2])) + up) / self._size
        return self._cache[key]


# distance from a leg, in cells, within which corners are considered
_FIRST_WIDTH, _WIDTH_FACTOR, _MOST_WIDTH = 1.0, 4.0, 16.0
_MOST_CORNERS = 1000
_HAIR = 1e-9  # relative to a cell: rounding error
_BEND = 0.85  # cells: length that a path may gain for each bend that it saves


@dataclass(frozen=True, eq=False)
class Route:
    """A path through several stops.

    Parameters
    ----------
    points : ndarray of float64, shape (k, 2) or (k, 3)
        Points of the path in metres east and north, with altitudes if the search has several
        layers. The path is straight between two consecutive points.
    stops : ndarray of int64, shape (n,)
        Index of each stop in ``points``.
    transit : ndarray of bool, shape (k - 1,)
        Whether each leg leads outside the region, from one of its parts to another part.
    """

    points: Points
    stops: NDArray[np.int64]
    transit: NDArray[np.bool_]

    @property
    def length(self) -> float:
        """Length of the path in metres."""
        return length_of(self.points)

    def long_legs(self, size: float) -> NDArray[np.bool_]:
        """Return, for each leg, whether it leads outside the region or belongs to a long path;
        bool, shape (k - 1,).

        A path between two stops is long if it is longer than 1.6 times ``size``, the side of a cell
        in metres.
        """
        between = np.searchsorted(self.stops, np.arange(1, len(self.points)), side="left")
        far = partial_sums(leg_lengths(self.points))
        stops = np.diff(far[self.stops], prepend=0.0)
        return np.asarray(stops[between] > 1.6 * size) | self.transit

    def waypoints(self) -> Points:
        """Return both ends of the path and all points at which the path bends, in metres; float64,
        shape (m, 2) or (m, 3).
        """
        return merge_collinear(self.points)


class RegionPaths:
    """Short paths inside the region of a `CellGrid`.

    Because of rounding errors, a path may leave the region by up to
    `shoal.search.regions.region.TOUCH` metres.

    Parameters
    ----------
    grid : CellGrid
    transit : bool
        Whether a path may lead from one part of the region to another part, around no-go zones and
        holes. Only flying vehicles can leave the region between its parts.

    Examples
    --------
    >>> from shoal.search import cells_of, open_region
    >>> grid = cells_of(open_region("ring:50x40"), 10)
    >>> way = RegionPaths(grid).leg((45.0, 0.0), (-45.0, 0.0))
    >>> bool(grid.region.contains(way).all()), round(float(np.hypot(*np.diff(way, axis=0).T).sum()), 1)
    (True, 138.8)
    """

    def __init__(self, grid: CellGrid, *, transit: bool = False) -> None:
        self.grid = check_kind(grid, CellGrid, what="grid")
        self.transit = check_bool(transit, what="transit")
        # Plans compare routes that have most of their legs in common, and the plan that is chosen
        # has the legs of its tour. So all paths between the same pieces share what they have found.
        self._cache: dict[tuple[bytes, bytes], tuple[Points, bool]] = (
            vars(grid.clipped).setdefault("paths", {}).setdefault(transit, {})
        )

    def leg(self, start: ArrayLike, end: ArrayLike) -> Points:
        """Return a short path from one point to another, in metres; float64, shape (k, 2), k >= 2.

        If the straight line between the points stays inside the region, the path is this line. If
        the straight line leaves the region, the path is the shortest path around nearby corners, or
        a little longer with fewer bends if it would have more than two; see `with_fewer_bends`.
        With more than 1000 nearby corners, the path is a shortened path from cell to cell, and
        rarely much longer than the shortest path.

        Raises
        ------
        InvalidInputError
            If a point is outside the region, or if the points are in different parts of the region
            and ``transit`` is false.
        """
        return self.legs([np.asarray(start), np.asarray(end)]).points

    def legs(self, stops: ArrayLike) -> Route:
        """Return the path from stop to stop, through all given stops.

        Parameters
        ----------
        stops : array_like of float, shape (n, 2)
            Stops in metres, in the order of the path.

        Raises
        ------
        InvalidInputError
            If a stop is outside the region, or if consecutive stops are in different parts of the
            region and ``transit`` is false.
        """
        points = self.grid.region.check_inside(stops, what="stops")
        return self._join_stops(points, np.zeros(max(0, len(points) - 1), dtype=np.bool_))

    def route(self, cells: ArrayLike) -> Route:
        """Return the path through all viewpoints of the given cells, one cell after another.

        Parameters
        ----------
        cells : array_like of int, shape (n, 2)
            Row and column of each cell, in the order of the path.

        Raises
        ------
        InvalidInputError
            If a cell contains no part of the region, or if consecutive cells are in different parts
            of the region and ``transit`` is false.
        """
        grid = self.grid
        index = grid.ordinals(np.asarray(cells).reshape(-1, 2))
        counts = grid.viewpoint_starts[index + 1] - grid.viewpoint_starts[index]
        begins = np.cumsum(counts) - counts
        within = np.arange(int(counts.sum())) - np.repeat(begins, counts)
        visit = within + np.repeat(grid.viewpoint_starts[index], counts)
        # A leg between the centres of neighbouring whole cells stays inside the region, unless the
        # margin is wide.
        array = grid.cells[index]
        plain = self._centered[index]
        close = np.abs(np.diff(array, axis=0)).sum(axis=1) <= 1
        straight = np.zeros(max(0, len(visit) - 1), dtype=np.bool_)
        straight[begins[1:] - 1] = (
            plain[:-1]
            & plain[1:]
            & close
            & (grid.region.margin <= grid.size / 2)
            & (not grid.region.barriers)
        )
        return self._join_stops(grid.viewpoints[visit], straight)

    @cached_property
    def _centered(self) -> NDArray[np.bool_]:
        """For each cell of `CellGrid.cells`, whether it lies entirely inside the region and its
        only viewpoint is its centre.
        """
        grid = self.grid
        away = np.abs(
            grid.waypoints() - grid.lattice.to_region(grid.lattice.centers(*grid.cells.T))
        ).max(axis=1)
        single = np.diff(grid.viewpoint_starts) == 1
        return np.asarray(
            grid.clipped.whole[tuple(grid.cells.T)] & single & (away < _HAIR * grid.size)
        )

    def _join_stops(self, stops: Points, straight: NDArray[np.bool_]) -> Route:
        """Return the path through the stops. The array ``straight`` tells for each leg whether it
        is known to be straight.
        """
        good = straight.copy()
        unknown = np.flatnonzero(~straight)
        good[unknown] = inside(self.grid.region, stops[unknown], stops[unknown + 1])
        paths = {int(k): self._path(stops[k], stops[k + 1]) for k in np.flatnonzero(~good)}
        between = np.zeros(len(stops), dtype=np.int64)
        for k, (path, _) in paths.items():
            between[k + 1] = len(path) - 2
        places = np.arange(len(stops)) + np.cumsum(between)
        points = np.empty((len(stops) + int(between.sum()), 2))
        transit = np.zeros(max(0, len(points) - 1), dtype=np.bool_)
        points[places] = stops
        for k, (path, outside) in paths.items():
            points[places[k] + 1 : places[k + 1]] = path[1:-1]
            transit[places[k] : places[k + 1]] = outside
        return Route(points, places, transit)

    def _path(self, start: Points, end: Points) -> tuple[Points, bool]:
        """Return a path between two points whose straight connection leaves the region, and whether
        it is a transit.

        The path stays inside the region, unless the points lie in different parts of the region.
        """
        key = start.tobytes(), end.tobytes()
        if key not in self._cache:
            self._cache[key] = self._find_path(start, end)
        return self._cache[key]

    def _find_path(self, start: Points, end: Points) -> tuple[Points, bool]:
        """Find the path that `_path` returns."""
        if self._part(start) != self._part(end):
            if not self.transit:
                raise InvalidInputError(
                    "path: expected two places in one part of the region"
                    f" {self.grid.region.name!r}, got {text_of(start)} and {text_of(end)} in"
                    " different parts; use --transit if vehicles may leave the region"
                )
            return self._transits.path(start, end), True
        near = self._near(start, end)
        path = self._far(start, end) if near is None else near
        return with_fewer_bends(self.grid.region, path, _BEND * self.grid.size), False

    @cached_property
    def _transits(self) -> Transits:
        return Transits(self.grid.region, np.zeros((0, 2)))

    def _near(self, start: Points, end: Points) -> Points | None:
        """Return the shortest path around the corners near the straight line from ``start`` to
        ``end``.

        If too many corners are near the straight line, the result is the best path found so far, or
        None.
        """
        best: Points | None = None
        straight, most = float(np.hypot(*(end - start))), _MOST_WIDTH * self.grid.size
        width = _FIRST_WIDTH * self.grid.size
        while True:
            candidates = self._corners.within(
                np.minimum(start, end) - width, np.maximum(start, end) + width, _MOST_CORNERS + 1
            )
            if len(candidates) > _MOST_CORNERS:
                return best
            # where that fails, `_far` finds the cells through which a path leads
            path = self._corners.shortest(start, end, candidates, rough=True)
            best = best if path is None else path
            # A path around more distant corners would have to go there and come back.
            needed = np.inf if path is None else (length_of(path) - straight) / 2
            if needed <= width or width >= most:
                return best
            width = min(_WIDTH_FACTOR * width if path is None else needed, most)

    @cached_property
    def _corners(self) -> VisibilityGraph:
        return visibility_graph(self.grid.region)

    def _part(self, point: Points) -> int:
        import shapely

        parts = self.grid.region.parts
        return (
            int(np.argmin(shapely.distance(np.array(parts, dtype=object), shapely.points(point))))
            if len(parts) > 1
            else 0
        )

    def _far(self, start: Points, end: Points) -> Points:
        """Return a shortened path through portals, or the shortest path around corners if rounding
        errors have closed a portal.
        """
        region = self.grid.region
        stops = self._portal_graph.through(start, end)
        if stops is None:
            return self._by_corners(start, end, np.arange(len(self._corners.corners)))
        path = pull_string(region, self._within_pieces(stops))
        candidates = self._corners_beside(path)
        if len(candidates) <= _MOST_CORNERS:
            tight = self._corners.shortest(start, end, candidates, most=length_of(path))
            if tight is not None and length_of(tight) < length_of(path):
                return tight
        return path

    def _within_pieces(self, stops: Points) -> Points:
        """Return the path through the midpoints of portals. Between two portals, the path stays in
        one piece of a cell.
        """
        straight = inside(self.grid.region, stops[:-1], stops[1:])
        legs = [stops[:1]]
        for k, free in enumerate(straight.tolist()):
            leg = stops[k : k + 2]
            if not free:
                # the whole cell, whatever its angle: no corner of a square is farther away
                middle, side = leg.mean(axis=0), 1.01 * 2**0.5 * self.grid.size
                leg = self._by_corners(
                    leg[0], leg[1], self._corners.within(middle - side, middle + side)
                )
            legs.append(leg[1:])
        return np.concatenate(legs)

    def _by_corners(self, start: Points, end: Points, candidates: NDArray[np.int64]) -> Points:
        path = self._corners.shortest(start, end, candidates)
        if path is None:
            raise InvalidInputError(
                f"path: expected a passage from {text_of(start)} to {text_of(end)}, got a passage"
                " narrower than the rounding error"
            )
        return path

    def _corners_beside(self, path: Points) -> NDArray[np.int64]:
        """Return the corners that are at most one cell side away from a bend of the path."""
        return self._corners.around(path[1:-1], self.grid.size)

    @cached_property
    def _portal_graph(self) -> PortalGraph:
        region, size = self.grid.region, self.grid.size
        if not region.restricted:
            return PortalGraph(self.grid)
        cache = region.for_paths  # all grids of the region with cells of this size share it
        if ("portals", size) not in cache:
            free = without_margin(replace(region, outline=region.free, looks=()))
            cache["portals", size] = PortalGraph(cells_of(free, size))
        graph: PortalGraph = cache["portals", size]
        return graph
