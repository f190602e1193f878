"""The visibility graph of a region: shortest paths around corners, and straightened paths."""

from __future__ import annotations

import heapq
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.search.cells.grid import CellGrid, rotated_shape
from shoal.search.regions.outline import Points
from shoal.search.regions.region import SearchRegion

_STRAIGHT = 1e-12  # sine of the largest angle that does not count as a turn
_ALONG = 1e-9  # sine of the largest angle between collinear lines
_AT_ONCE = 100_000  # number of segments tested in one call
_LOOK_AHEAD = (
    64  # number of points of a path among which `pulled` looks for the farthest visible point
)
_START = -1  # stands for the start of a path, in place of a corner's index
_AT_FIRST = 16  # number of corners tested for a start point at once


def inside(region: SearchRegion, starts: Points, ends: Points) -> NDArray[np.bool_]:
    """Return, for each straight segment, whether it stays inside the region apart from rounding
    errors; bool, shape (n,).

    Parameters
    ----------
    region : SearchRegion
    starts, ends : ndarray of float64, shape (n, 2)
        Start and end of each segment in metres. Each start must lie inside the region.
    """
    import shapely

    found = np.empty(len(starts), dtype=np.bool_)
    for low in range(0, len(starts), _AT_ONCE):
        part = slice(low, low + _AT_ONCE)
        lines = shapely.linestrings(np.stack([starts[part], ends[part]], axis=1))
        found[part] = ~shapely.intersects(region.border, lines)
    return found


class VisibilityGraph:
    """The corners of a region at which shortest paths can bend, and the pairs of corners that see
    each other.

    Shortest paths bend only at corners where the inner angle of the region is above 180 degrees.
    The path search prefers a path that bends only at corners of `SearchRegion.bends` to a shorter
    path around other corners. When a path search first reaches a corner, the search computes and
    caches the corners that are visible from this corner.

    Parameters
    ----------
    region : SearchRegion

    Attributes
    ----------
    corners : ndarray of float64, shape (n, 2)
        Positions of the corners in metres. The corners of `SearchRegion.bends` come first.
    """

    def __init__(self, region: SearchRegion) -> None:
        from scipy.spatial import KDTree

        self._region = region
        few, every = (_inward_corners(shape) for shape in (region.bends, region.free))
        few = few[:, region.contains(few[0])] if few.size else few
        self._few = len(few[0])
        self.corners, before, after = np.concatenate([few, every], axis=1)
        sides = before - self.corners, after - self.corners
        self._sides = [
            side / np.maximum(np.hypot(*side.T), np.finfo(float).tiny)[:, None] for side in sides
        ]
        self._tree = KDTree(self.corners)
        self._seen_from: dict[int, tuple[float, NDArray[np.int64], NDArray[np.float64]]] = {}

    def within(self, low: Points, high: Points) -> NDArray[np.int64]:
        """Return the indices of the corners inside the box with the corners ``low`` and ``high``;
        int64, shape (k,).
        """
        return np.flatnonzero(((self.corners >= low) & (self.corners <= high)).all(axis=1))

    def shortest(self, start: Points, end: Points, candidates: NDArray[np.int64]) -> Points | None:
        """Return the shortest path that bends only at given corners, or None if no path exists;
        float64, shape (k, 2).

        Parameters
        ----------
        start, end : ndarray of float64, shape (2,)
            Start and end of the path in metres, which must lie inside the region.
        candidates : ndarray of int64, shape (c,)
            Indices of the corners at which the path may bend.
        """
        few = candidates[candidates < self._few]
        found = self._shortest(start, end, few) if len(few) else None
        return self._shortest(start, end, candidates) if found is None else found

    def _shortest(self, start: Points, end: Points, candidates: NDArray[np.int64]) -> Points | None:
        """Find the shortest path that bends only at candidate corners, with the algorithm A*. If no
        path exists, return None.

        To find the corners visible from the start, the function tests one group of corners after
        another. The first group contains the most promising corners, and each group is larger than
        the previous group.
        """
        allowed = np.zeros(len(self.corners), dtype=np.bool_)
        allowed[candidates] = True
        wide = (
            float(np.hypot(*np.ptp(self.corners[candidates], axis=0))) if len(candidates) else 0.0
        )
        to_end = np.hypot(*(self.corners - end).T)
        length = np.full(len(self.corners), np.inf)
        came = np.full(len(self.corners), _START)
        queue: list[tuple[float, int]] = []
        first = candidates[self._touched(candidates, self.corners[candidates] - start)]
        away = np.hypot(*(self.corners[first] - start).T)
        order = np.argsort(away + to_end[first], kind="stable")
        first, away = first[order], away[order]
        asked, step = 0, _AT_FIRST
        if len(first):
            queue.append((float(away[0] + to_end[first[0]]), _START))
        while queue:
            _, node = heapq.heappop(queue)
            if node == _START:
                others, lengths = first[asked : asked + step], away[asked : asked + step]
                seen = inside(
                    self._region, np.broadcast_to(start, (len(others), 2)), self.corners[others]
                )
                others, lengths = others[seen], lengths[seen]
                asked, step = asked + step, 2 * step
                if asked < len(first):
                    heapq.heappush(queue, (float(away[asked] + to_end[first[asked]]), _START))
            elif not allowed[node]:
                continue
            else:
                allowed[node] = False  # done
                if self._ends(
                    node, end
                ):  # no other path can be shorter, because the queue gives the most promising node first
                    return np.vstack([start, self.corners[_chain(came, node)], end])
                others, lengths = self._neighbours(node, wide)
                lengths = length[node] + lengths
            better = allowed[others] & (lengths < length[others])
            others, lengths = others[better], lengths[better]
            length[others], came[others] = lengths, node
            for entry in zip((lengths + to_end[others]).tolist(), others.tolist(), strict=True):
                heapq.heappush(queue, entry)
        return None

    def _ends(self, corner: int, end: Points) -> bool:
        """Return whether a shortest path could lead straight from a corner to the point ``end``."""
        place = self.corners[[corner]]
        return bool(
            self._touched(np.array([corner]), end - place)[0]
            and inside(self._region, place, end[None])[0]
        )

    def _neighbours(
        self, corner: int, wide: float
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the corners to which a shortest path could continue from a corner, and their
        distances in metres.

        The result contains all possible corners up to the distance ``wide``, and may contain
        farther corners.
        """
        known, others, away = self._seen_from.get(corner, (-1.0, None, None))
        if others is None or away is None or known < wide:
            place = self.corners[corner]
            around = np.array(self._tree.query_ball_point(place, 2 * wide), dtype=np.int64)
            around = np.sort(around[around != corner])
            directions = self.corners[around] - place
            likely = self._touched(
                np.broadcast_to(corner, len(around)), directions
            ) & self._touched(around, directions)
            others = around[likely]
            others = others[
                inside(self._region, np.broadcast_to(place, (len(others), 2)), self.corners[others])
            ]
            away = np.hypot(*(self.corners[others] - place).T)
            self._seen_from[corner] = 2 * wide, others, away
        return others, away

    def _touched(self, corners: NDArray[np.int64], directions: Points) -> NDArray[np.bool_]:
        """Return, for each corner and a line through it, whether the border near the corner lies on
        one side of the line.

        A shortest path can pass a corner only if the border near the corner lies on one side of the
        path.
        """
        sines = [
            directions[:, 0] * side[corners, 1] - directions[:, 1] * side[corners, 0]
            for side in self._sides
        ]
        rounding = _ALONG * np.hypot(*directions.T)
        return np.asarray((np.minimum(*sines) >= -rounding) | (np.maximum(*sines) <= rounding))


def _chain(came: NDArray[np.int64], node: int) -> list[int]:
    way = [node]
    while came[way[-1]] != _START:
        way.append(int(came[way[-1]]))
    return way[::-1]


def _inward_corners(area: Any) -> Points:
    """Return the corners of a polygon at which shortest paths can bend; float64, shape (3, n, 2).

    The result holds three arrays: the corners, the vertex before each corner on the border, and the
    vertex after each corner.
    """
    import shapely

    found: list[Any] = [np.zeros((3, 0, 2))]
    for polygon in shapely.get_parts(area) if area is not None else ():
        turned = shapely.orient_polygons(polygon)
        for ring in (turned.exterior, *turned.interiors):
            corners = shapely.get_coordinates(ring)[:-1]
            before, after = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
            come, go = corners - before, after - corners
            inward = come[:, 0] * go[:, 1] - come[:, 1] * go[:, 0] < -_STRAIGHT * np.hypot(
                *come.T
            ) * np.hypot(*go.T)
            found.append(np.stack([corners[inward], before[inward], after[inward]]))
    return np.asarray(np.concatenate(found, axis=1))


def pulled(region: SearchRegion, way: Points) -> Points:
    """Return a shortened path with fewer bends, which has some of the points of the path ``way``.

    From each of its points, the new path leads straight to the last visible point among the next 64
    points of the path ``way``.
    """
    kept = [0]
    while kept[-1] < len(way) - 1:
        here = kept[-1]
        ahead = np.arange(here + 1, min(here + 1 + _LOOK_AHEAD, len(way)))
        seen = inside(region, np.broadcast_to(way[here], (len(ahead), 2)), way[ahead])
        seen[0] = True  # this leg already exists
        kept.append(int(ahead[np.flatnonzero(seen)[-1]]))
    return np.asarray(way[kept])


def merge_collinear(points: Points) -> Points:
    """Remove repeated points from a path, and points on the straight line between the previous and
    the next point.

    The function keeps points at which the path turns back.

    Examples
    --------
    >>> merge_collinear(np.array([(0, 0), (1, 0), (1, 0), (2, 0), (1, 0), (1, 1.0)])).tolist()
    [[0.0, 0.0], [2.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
    """
    way = np.asarray(points, dtype=np.float64)
    if len(way) < 2:
        return way
    way = way[np.concatenate([[True], np.any(np.diff(way, axis=0) != 0, axis=1)])]
    steps = np.diff(way, axis=0)
    before, after = steps[:-1], steps[1:]
    scale = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    upright = np.zeros(
        (len(before), 3 - way.shape[1])
    )  # in the plane, because paths bend around vertical walls
    turn = np.linalg.norm(
        np.cross(np.hstack([before, upright]), np.hstack([after, upright])), axis=1
    )
    straight = (turn <= 1e-9 * scale) & (np.sum(before * after, axis=1) > 0)
    return np.asarray(
        way[np.concatenate([[True], ~straight, np.ones(min(1, len(steps)), dtype=np.bool_)])]
    )


def length_of(way: Points) -> float:
    """Return the length of a path in metres."""
    return float(leg_lengths(way).sum())


def leg_lengths(way: Points) -> NDArray[np.float64]:
    """Return the length of each leg of a path in metres, in two or three dimensions; float64, shape
    (k - 1,).
    """
    steps = np.diff(way, axis=0).T
    level = np.hypot(steps[0], steps[1])
    return np.asarray(level if len(steps) == 2 else np.hypot(level, steps[2]))


Numbers = NDArray[np.int64]

_HAIR = 1e-9  # relative to a footprint: rounding error
_COARSE = 0.02  # relative to a footprint: corners of a window at a smaller distance are merged
_REACH = 24  # maximum number of windows that one link crosses
_ROUNDS = 12


def along_tour(grid: CellGrid, cells: Numbers, turn: float) -> CellGrid:
    """Return a grid with new viewpoints, chosen so that the path along a closed tour is short and
    has few bends.

    Every cell is completely visible from its new viewpoint. Each new viewpoint lies in the region,
    and no wall separates the viewpoint from the piece of its cell.

    Parameters
    ----------
    grid : CellGrid
    cells : ndarray of int64, shape (N, 2)
        Row and column of all cells, in the order of the tour.
    turn : float
        Cost of a turn in cells.
    """
    index = grid.ordinals(cells)
    windows = _windows(grid, cells, index)
    if not windows:
        return grid
    starts, lattice, n = grid.viewpoint_starts, grid.lattice, len(cells)
    moved = grid.viewpoints.copy()
    entered, left = grid.viewpoints[starts[index]], grid.viewpoints[starts[index + 1] - 1]
    free = np.array(sorted(windows))
    shapes, middles = (
        np.array([windows[k] for k in free.tolist()], dtype=object),
        lattice.centers(*cells[free].T),
    )
    places = _places(shapes, lattice.from_region(entered[free]), middles, grid.footprint)
    tried = dict(zip(free.tolist(), places, strict=True))
    for chain in _chains(free, n):
        ends = (chain[0] - 2) % n, (chain[0] - 1) % n, (chain[-1] + 1) % n, (chain[-1] + 2) % n
        fixed = lattice.from_region(
            np.stack([left[ends[0]], left[ends[1]], entered[ends[2]], entered[ends[3]]])
        )
        crossed, stages = [windows[k] for k in chain.tolist()], [tried[k] for k in chain.tolist()]
        known = lattice.from_region(entered[chain])
        moved[starts[index[chain]]] = lattice.to_region(
            _way(grid, fixed, crossed, stages, known, turn * grid.size)
        )
    return replace(grid, viewpoints=moved)


def _windows(grid: CellGrid, cells: Numbers, index: Numbers) -> dict[int, Any]:
    """Return the window of each cell that has a choice of viewpoints, as a mapping from tour index
    to Shapely polygon.

    A window contains all points from which the whole piece of a cell is visible.
    """
    import shapely

    clipped, own, half = grid.clipped, grid.own, grid.footprint / 2
    rows, cols = cells.T
    free = np.flatnonzero(~clipped.whole[rows, cols] & (np.diff(grid.viewpoint_starts)[index] == 1))
    if not len(free):
        return {}
    pieces = clipped.pieces[own[rows[free], cols[free]]]
    bounds = shapely.bounds(pieces)
    hair = _HAIR * grid.footprint
    boxes = shapely.box(*(bounds[:, 2:] - half - hair).T, *(bounds[:, :2] + half + hair).T)
    rooms = _around(grid, rows[free], cols[free])
    parts, of = shapely.get_parts(shapely.union_all(rooms, axis=1), return_index=True)
    away = shapely.distance(parts, shapely.point_on_surface(pieces)[of])
    order = np.lexsort((away, of))
    room = parts[order[np.searchsorted(of[order], np.arange(len(free)))]]
    shapes = shapely.intersection(room, boxes)
    if grid.region.restricted:
        shapes = shapely.intersection(shapes, rotated_shape(grid.region.free, -grid.angle))
    return {
        k: shape
        for k, shape in zip(free.tolist(), shapes, strict=True)
        if shape.geom_type == "Polygon" and not shape.is_empty
    }


def _around(grid: CellGrid, rows: Numbers, cols: Numbers) -> Any:
    """Return, for each cell, its own piece and the own pieces of its 8 neighbours; Shapely
    geometries or None, shape (n, 9).
    """
    clipped, own = grid.clipped, grid.own
    rooms = np.full((len(rows), 9), None, dtype=object)
    for k in range(9):
        row, col = rows + k // 3 - 1, cols + k % 3 - 1
        there = (row >= 0) & (row < grid.shape[0]) & (col >= 0) & (col < grid.shape[1])
        row, col = np.where(there, row, 0), np.where(there, col, 0)
        whole = there & clipped.whole[row, col]
        part = there & ~whole & (own[row, col] >= 0)
        rooms[whole, k] = grid.lattice.boxes(row[whole], col[whole])
        rooms[part, k] = clipped.pieces[own[row[part], col[part]]]
    return rooms


def _chains(free: Numbers, n: int) -> list[Numbers]:
    """Return the runs of consecutive cells of a closed tour that have a choice of viewpoints, as
    arrays of tour indices.
    """
    chains = np.split(free, np.flatnonzero(np.diff(free) > 1) + 1)
    if len(chains) > 1 and chains[0][0] == 0 and chains[-1][-1] == n - 1:
        chains[0] = np.concatenate([chains.pop(), chains[0]])
    return chains


def _places(windows: Any, known: Points, middles: Points, footprint: float) -> list[Points]:
    """Return the points of each window that a path may use; float64, each of shape (k, 2).

    The points of a window are its known viewpoint, its corners, and the ends of lines across the
    window.
    """
    import shapely

    left, low, right, high = (side[:, None] for side in shapely.bounds(windows).T)
    shares = np.linspace(0.0, 1.0, 5)
    rows = np.hstack([low + shares * (high - low), middles[:, 1:]])
    cols = np.hstack([left + shares * (right - left), middles[:, :1]])
    ends = [
        np.stack(
            [np.stack([left - 1 + 0 * rows, rows], -1), np.stack([right + 1 + 0 * rows, rows], -1)],
            axis=2,
        )
    ]
    ends += [
        np.stack(
            [np.stack([cols, low - 1 + 0 * cols], -1), np.stack([cols, high + 1 + 0 * cols], -1)],
            axis=2,
        )
    ]
    lines = shapely.linestrings(np.concatenate(ends, axis=1))
    cut, of_cut = shapely.get_coordinates(
        shapely.intersection(windows[:, None], lines).ravel(), return_index=True
    )
    corners, of_corner = shapely.get_coordinates(
        shapely.simplify(windows, _COARSE * footprint), return_index=True
    )
    found = np.concatenate([known, corners, cut])
    owner = np.concatenate([np.arange(len(windows)), of_corner, of_cut // lines.shape[1]])
    kept = np.unique(
        np.column_stack([owner, np.round(found / (_COARSE * footprint / 4))]),
        axis=0,
        return_index=True,
    )[1]
    return np.split(found[kept], np.searchsorted(owner[kept], np.arange(1, len(windows))))


def _way(
    grid: CellGrid,
    fixed: Points,
    shapes: list[Any],
    places: list[Points],
    known: Points,
    turn: float,
) -> Points:
    """Return one point in each window, so that the path through the fixed points ``fixed`` and all
    windows has few bends.

    If the function finds no path through all windows, it returns the points ``known``.
    """
    import shapely

    from shoal.search.kernels.lanes import fewest_links

    stages = [fixed[:1], fixed[1:2], *places, fixed[2:3], fixed[3:]]
    points, starts = (
        np.concatenate(stages),
        np.concatenate([[0], np.cumsum([len(stage) for stage in stages])]),
    )
    boxes = np.array([(*stage.min(axis=0), *stage.max(axis=0)) for stage in stages])
    boxes[2:-2] = shapely.bounds(np.array(shapes, dtype=object))
    stage_of = np.repeat(np.arange(len(stages)), np.diff(starts))
    region, to_region = grid.region, grid.lattice.to_region
    banned, before = np.zeros(0, dtype=np.int64), np.empty(len(points), dtype=np.int64)
    for _ in range(_ROUNDS):
        fewest_links(points, starts, boxes, turn, _REACH, banned, before)
        links = [len(points) - 1]
        while links[-1] > 0:
            links.append(int(before[links[-1]]))
        if links[-1] < 0:
            return known
        way = points[links[::-1]]
        nodes = np.array(links[::-1])
        # The links between the two fixed points at each end are given.
        asked = np.flatnonzero((stage_of[nodes[1:]] > 1) & (stage_of[nodes[:-1]] < len(stages) - 2))
        good = inside(region, to_region(way[asked]), to_region(way[asked + 1]))
        if good.all():
            break
        banned = np.union1d(banned, nodes[asked[~good]] * len(points) + nodes[asked[~good] + 1])
    return _crossed(way, stage_of[nodes], shapes, known)


def _crossed(way: Points, stage_of: Numbers, shapes: list[Any], known: Points) -> Points:
    """Return one point of each window: on the path where the path crosses the window, or else
    nearest to the path.
    """
    import shapely

    found = known.copy()
    for k, shape in enumerate(shapes):
        link = int(np.searchsorted(stage_of, k + 2))
        if stage_of[link] == k + 2:
            found[k] = way[link]
            continue
        cut = shapely.intersection(shapely.linestrings(way[link - 1 : link + 1]), shape)
        if cut.is_empty:
            found[k] = shapely.get_coordinates(
                shapely.shortest_line(shape, shapely.linestrings(way[link - 1 : link + 1]))
            )[0]
            continue
        # Backwards from the last point, so that the path never turns back.
        ends = shapely.get_coordinates(cut)
        step = way[link] - way[link - 1]
        begun = found[k - 1] if k and stage_of[link - 1] < k + 1 else way[link - 1]
        far = (ends - way[link - 1]) @ step
        found[k] = (
            begun
            if far.min() <= (begun - way[link - 1]) @ step <= far.max()
            else ends[np.argmin(far)]
        )
    return found
