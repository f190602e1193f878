"""Border paths: shorter paths along the border, on which a vehicle sees cells while it moves.

A vehicle sees a complete cell from one viewpoint, or piece by piece on its way from viewpoint to
viewpoint. On a slanted border, a path that sees the cells piece by piece is shorter and has fewer
turns. The viewpoints of a cell that is seen piece by piece are the points at which the vehicle
starts looking, turns, and stops looking. A row can also end earlier where a path along the border
sees a part of the row's last cell.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.search.cells.grid import SPECK, CellGrid
from shoal.search.cells.visibility_graph import inside
from shoal.search.regions.outline import Points

Flags = NDArray[np.bool_]
Numbers = NDArray[np.int64]

_STEPS = (
    1.0,
    0.5,
    0.25,
    0.1,
    0.05,
    -0.05,
    -0.1,
    -0.25,
    -0.5,
    -1.0,
)  # in footprints: distances by which points of a path move
_SPACING = 0.2  # in footprints: distance of the points of a border that are compared with a path
# minimum share of a cell that other cells' paths must see, so that its row may end earlier
_SEEN = 0.03
_CHANGES = 20  # number of changes of one path that together may lose the smallest area that counts
_TRIMMED = (
    1.0,
    0.75,
    0.5,
    0.25,
)  # shares of the first and the last leg that are cut off if the vehicle need not look there


def along_border(grid: CellGrid, cells: Numbers, turn: float) -> CellGrid:
    """Return the grid with other viewpoints, so that the path along a closed tour is shorter.

    A vehicle that searches a cell of the new grid sees the area that its footprint sweeps between
    the cell's own viewpoints. These areas of all cells together cover the whole region. The path
    lies inside the region, and no wall separates the path from the area that it sees.

    Parameters
    ----------
    grid : CellGrid
    cells : ndarray of int64, shape (N, 2)
        All cells in the order of the tour.
    turn : float
        Cost of a turn in cells.
    """
    course = _Course(grid, cells, turn)
    for chain in course.chains(course.cut & course.single):
        course.shorten(chain)
    for chain in course.chains(course.free()):
        course.shorten(chain)
    return course.grid_with_viewpoints()


class _Course:
    """The path along a closed tour in the lattice's frame, as the list of the viewpoints of each
    cell.
    """

    def __init__(self, grid: CellGrid, cells: Numbers, turn: float) -> None:
        starts, index = grid.viewpoint_starts, grid.ordinals(cells)
        points = grid.lattice.from_region(grid.viewpoints)
        self._grid, self._cells, self._index, self._turn = grid, cells, index, turn * grid.size
        self.views: list[Points] = [points[starts[k] : starts[k + 1]] for k in index.tolist()]
        self.cut: Flags = ~grid.clipped.whole[tuple(cells.T)]
        self.single: Flags = np.diff(starts)[index] == 1
        self._look = _Look(grid)
        # The path between several viewpoints of one cell may lead around a wall, so only the
        # viewpoints themselves count here.
        seen = self._look.seen(np.repeat(np.concatenate(self.views)[:, None], 2, axis=1))
        self._seen = np.split(seen, np.cumsum([len(way) for way in self.views])[:-1])
        self._index_seen()

    def _index_seen(self) -> None:
        """Index all seen areas by place, for queries of the cells that see a part of an area."""
        import shapely

        self._owner = np.repeat(np.arange(len(self._cells)), [len(seen) for seen in self._seen])
        self._tree = shapely.STRtree(np.concatenate(self._seen))

    def chains(self, free: Flags) -> list[list[int]]:
        """Return the runs of consecutive cells for which ``free`` is true, as tour indices. At
        least one value must be false.
        """
        fixed = np.flatnonzero(~free)
        n = len(free)
        found = []
        for one, other in zip(fixed.tolist(), np.roll(fixed, -1).tolist(), strict=True):
            chain = [(one + 1 + k) % n for k in range((other - one - 1) % n)]
            if chain:
                found.append(chain)
        return found

    def free(self) -> Flags:
        """Return which cells' viewpoints may move: cells at the border, and cells of which vehicles
        at the border see a part.
        """
        import shapely

        self._index_seen()
        whole = np.flatnonzero(~self.cut & self.single)
        squares = self._grid.lattice.boxes(*self._cells[whole].T)
        near, legs = self._tree.query(squares, predicate="intersects")
        of_border = self.cut[self._owner[legs]]
        near, legs = near[of_border], legs[of_border]
        begins = np.flatnonzero(np.diff(near, prepend=-1))
        groups = np.split(self._tree.geometries[legs], begins[1:]) if len(begins) else []
        seen = np.array([shapely.union_all(group) for group in groups], dtype=object)
        parts = shapely.area(shapely.intersection(squares[near[begins]], seen))
        found = self.cut & self.single
        found[whole[near[begins]][parts > _SEEN * self._grid.size**2]] = True
        return found

    def _wanted(self, chain: list[int]) -> Any:
        """Return the area that only the given cells see."""
        import shapely

        mine = shapely.union_all(np.concatenate([self._seen[k] for k in chain]))
        others = np.setdiff1d(self._owner[self._tree.query(mine)], chain)
        return mine.difference(
            shapely.union_all([seen for k in others.tolist() for seen in self._seen[k]])
        )

    def shorten(self, chain: list[int]) -> None:
        """Choose the viewpoints of a chain of cells on a shorter path that still sweeps the area
        that no other cell sees.
        """
        before = np.concatenate(
            [self.views[k % len(self.views)] for k in (chain[0] - 2, chain[0] - 1)]
        )[-2:]
        after = np.concatenate(
            [self.views[k % len(self.views)] for k in (chain[-1] + 1, chain[-1] + 2)]
        )[:2]
        path = _without_straight_points(
            np.concatenate([before, *(self.views[k] for k in chain), after])
        )
        if len(path) == 4:
            return  # straight
        search = _Search(self._look, self._wanted(chain), path)
        better = search.shortened(self._turn)
        if better is path:
            return
        for k, views in zip(chain, _divided(search.trimmed(better[1:-1]), len(chain)), strict=True):
            self.views[k], self._seen[k] = views, self._look.seen(_legs(views))

    def grid_with_viewpoints(self) -> CellGrid:
        """Return the grid with the viewpoints of the path."""
        order = np.argsort(self._index)
        views = [self.views[k] for k in order.tolist()]
        starts = np.concatenate([[0], np.cumsum([len(view) for view in views])])
        kept = self._grid.viewpoints[self._grid.viewpoint_starts[:-1]]
        points = self._grid.lattice.to_region(np.concatenate(views))
        same = np.diff(starts) == 1
        unmoved = (
            same
            & (np.diff(self._grid.viewpoint_starts) == 1)
            & (np.abs(points[starts[:-1]] - kept).max(axis=1) < 1e-9)
        )
        points[starts[:-1][unmoved]] = kept[unmoved]
        return replace(self._grid, viewpoints=points, viewpoint_starts=starts)


class _Look:
    """What a vehicle sees in the region while it moves."""

    def __init__(self, grid: CellGrid) -> None:
        self.grid, self.half = grid, grid.footprint / 2

    def seen(self, legs: Points) -> Any:
        """Return the area that the footprint sweeps on each leg (k, 2, 2), without areas behind
        walls; shape (k,).
        """
        import shapely

        area = self.grid.area
        shapely.prepare(area)
        corners = self.half * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
        seen = shapely.convex_hull(
            shapely.multipoints((legs[:, :, None] + corners).reshape(len(legs), -1, 2))
        )
        cut = np.flatnonzero(~shapely.contains_properly(area, seen))
        boxes = shapely.bounds(seen[cut]) + self.half * np.array([-1, -1, 1, 1])
        rooms = np.array([shapely.clip_by_rect(area, *box) for box in boxes.tolist()], dtype=object)
        seen[cut] = shapely.intersection(seen[cut], rooms)
        for k in cut[
            shapely.get_num_geometries(seen[cut]) > 1
        ].tolist():  # a wall divides the footprint
            parts = shapely.get_parts(seen[k])
            seen[k] = shapely.union_all(
                parts[shapely.intersects(parts, shapely.linestrings(legs[k]))]
            )
        return seen


class _Search:
    """The search for a shorter path that still sweeps a wanted area."""

    def __init__(self, look: _Look, wanted: Any, path: Points) -> None:
        import shapely

        self._look, self._wanted, self._path = look, wanted, path
        self._most = SPECK * look.grid.size**2
        outline = shapely.segmentize(shapely.boundary(wanted), _SPACING * look.grid.footprint)
        points = shapely.get_coordinates(outline)
        self._boxes = np.hstack([points - look.half, points + look.half])

    def _begins(self) -> bool:
        """Return whether the first path stays in the region and sees the wanted area between its
        fixed points.
        """
        self._seen = self._look.seen(_legs(self._path[1:-1]))
        return self._stays(self._path[1:-1]) and self._sees(self._seen)

    def _stays(self, way: Points) -> bool:
        legs = self._look.grid.lattice.to_region(way)
        return bool(inside(self._look.grid.region, legs[:-1], legs[1:]).all())

    def _sees(self, seen: Any) -> bool:
        import shapely

        return bool(self._wanted.difference(shapely.union_all(seen)).area <= self._most)

    def _seen_after(self, path: Points, changed: Points) -> Any:
        """Return the areas seen on the legs of a changed path, or None if the path leaves the
        region or sees too little.

        Only the changed legs are looked at, and what the other legs do not see of the area that the
        replaced legs saw.
        """
        import shapely

        one, other = path[1:-1], changed[1:-1]
        most = min(len(one), len(other))
        first = _first_change(one[:most], other[:most])
        last = min(_first_change(one[::-1][:most], other[::-1][:most]), most - first)
        begin, end = max(first - 1, 0), len(one) - last
        way = other[begin : len(other) - last + 1]
        if not self._stays(way):
            return None
        kept, new = (self._seen[:begin], self._seen[end:]), self._look.seen(_legs(way))
        lost = (
            shapely.union_all(self._seen[begin:end])
            .intersection(self._wanted)
            .difference(shapely.union_all(new))
        )
        rest = np.concatenate(kept)
        lost = lost.difference(shapely.union_all(rest[shapely.intersects(rest, lost)]))
        return (
            np.concatenate([kept[0], new, kept[1]]) if lost.area <= self._most / _CHANGES else None
        )

    def shortened(self, turn: float) -> Points:
        """Return a path that no single change makes cheaper. If no change helps, return the given
        path itself.
        """
        from shoal.search.kernels.shortening.path_changes import changed_paths

        path, steps = self._path, np.array(_STEPS) * self._look.grid.footprint
        room = len(path) * (3 + 3 * len(steps))
        paths, counts, costs = (
            np.empty((room, *path.shape)),
            np.empty(room, dtype=np.int64),
            np.empty(room),
        )
        while True:
            found = changed_paths(
                np.ascontiguousarray(path), self._boxes, turn, steps, paths, counts, costs
            )
            if path is self._path and (not found or not self._begins()):
                return path
            for k in np.argsort(costs[:found], kind="stable").tolist():
                seen = self._seen_after(path, paths[k, : counts[k]])
                if seen is not None:
                    path, self._seen = paths[k, : counts[k]].copy(), seen
                    break
            else:
                return path

    def trimmed(self, way: Points) -> Points:
        """Cut off the beginning and the end of a path, as far as the vehicle need not
        look there.
        """
        for _ in range(2):
            for share in _TRIMMED:
                later = np.concatenate([way[:1] + share * (way[1:2] - way[:1]), way[1:]])
                later = later[1:] if share == 1.0 and len(later) > 2 else later
                if self._sees(self._look.seen(_legs(later))):
                    way = later
                    break
            way = way[::-1]
        return way


def _legs(way: Points) -> Points:
    """Return the legs of a path as pairs of points; shape (k, 2, 2). The only leg of a single point
    has no length.
    """
    return np.stack([way[:-1], way[1:]] if len(way) > 1 else [way, way], axis=1)


def _first_change(one: Points, other: Points) -> int:
    """Return the number of equal points with which two paths of equal length begin."""
    return int(np.argmax(np.append((one != other).any(axis=1), True)))


def _without_straight_points(path: Points) -> Points:
    """Return a path without repeated points and without points on straight lines, except the two
    points at each end.
    """
    kept = [path[0], path[1]]
    for point, later in pairwise(path[2:-1]):
        before, after = point - kept[-1], later - point
        across = abs(before[0] * after[1] - before[1] * after[0])
        if not before.any() or (
            before @ after > 0 and across <= 1e-6 * np.hypot(*before) * np.hypot(*after)
        ):
            continue
        kept.append(point)
    return np.concatenate([kept, path[-2:]])


def _divided(way: Points, count: int) -> list[Points]:
    """Divide a path into ``count`` parts of equal length, one for each cell. Each part begins where
    the previous part ends.
    """
    far = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
    if far[-1] == 0:
        return [way[:1]] * count
    at = np.linspace(0.0, far[-1], count + 1)
    ends = np.stack([np.interp(at, far, way[:, axis]) for axis in range(2)], axis=1)
    hair = 1e-9 * max(far[-1], 1.0)
    parts = []
    for k in range(count):
        between = way[(far > at[k] + hair) & (far < at[k + 1] - hair)]
        parts.append(np.concatenate([ends[k : k + 1], between, ends[k + 1 : k + 2]]))
    return parts
