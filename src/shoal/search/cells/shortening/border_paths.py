"""Border paths: shorter paths along the border, on which a vehicle sees cells while it moves.

A vehicle sees a complete cell from one viewpoint, or piece by piece on its way from viewpoint to viewpoint. On a slanted border, a
path that sees the cells piece by piece is shorter and has fewer turns. The viewpoints of a cell that is seen piece by piece are the
points at which the vehicle starts looking, turns, and stops looking. A row can also end earlier where a path along the border sees
a part of the row's last cell.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.search.cells.clipping import SPECK
from shoal.search.cells.grid import CellGrid
from shoal.search.cells.viewpoints import own_piece
from shoal.search.cells.visibility_graph import inside
from shoal.search.regions.outline_checks import Points

Flags = NDArray[np.bool_]
Numbers = NDArray[np.int64]

_STEPS = (1.0, 0.5, 0.25, 0.1, 0.05, -0.05, -0.1, -0.25, -0.5, -1.0)  # in footprints: distances by which points of a path move
_SPACING = 0.2  # in footprints: distance of the points of a border that are compared with a path
_SEEN = 0.03  # minimum share of a cell that other cells' paths must see, so that its row may end earlier
_TRIMMED = (1.0, 0.75, 0.5, 0.25)  # shares of the first and the last leg that are cut off if the vehicle need not look there


def along_border(grid: CellGrid, cells: Numbers, turn: float) -> CellGrid:
    """Return the grid with other viewpoints, so that the path along a closed tour is shorter.

    A vehicle that searches a cell of the new grid sees the area that its footprint sweeps between the cell's own viewpoints. These
    areas of all cells together cover the whole region. The path lies inside the region, and no wall separates the path from the
    area that it sees.

    Parameters
    ----------
    grid : CellGrid
    cells : ndarray of int64, shape (N, 2)
        All cells in the order of the tour.
    turn : float
        Cost of a turn in cells.
    """
    import shapely

    course = _Course(grid, cells, turn)
    for chain in course.chains(course.cut & course.single):
        course.shorten(chain, shapely.union_all([course.piece(k) for k in chain]))
    left = course.rests()
    free = np.zeros(len(cells), dtype=np.bool_)
    free[list(left)] = True
    for chain in course.chains(free):
        course.shorten(chain, shapely.union_all([left[k] for k in chain]))
    return course.grid_with_viewpoints()


class _Course:
    """The path along a closed tour in the lattice's frame, as the list of the viewpoints of each cell."""

    def __init__(self, grid: CellGrid, cells: Numbers, turn: float) -> None:
        starts, index = grid.viewpoint_starts, grid.ordinals(cells)
        points = grid.lattice.from_region(grid.viewpoints)
        self._grid, self._cells, self._index, self._turn = grid, cells, index, turn * grid.size
        self.views: list[Points] = [points[starts[k] : starts[k + 1]] for k in index.tolist()]
        self.cut: Flags = ~grid.clipped.whole[tuple(cells.T)]
        self.single: Flags = np.diff(starts)[index] == 1
        self.swept: list[Any] = []

    def piece(self, k: int) -> Any:
        """Return the own piece of the cell with tour index k."""
        return own_piece(self._grid.clipped, self._grid.lattice, self._grid.own, tuple(self._cells[k].tolist()))

    def chains(self, free: Flags) -> list[list[int]]:
        """Return the runs of consecutive cells for which ``free`` is true, as tour indices. At least one value must be false."""
        fixed = np.flatnonzero(~free)
        n = len(free)
        found = []
        for one, other in zip(fixed.tolist(), np.roll(fixed, -1).tolist(), strict=True):
            chain = [(one + 1 + k) % n for k in range((other - one - 1) % n)]
            if chain:
                found.append(chain)
        return found

    def rests(self) -> dict[int, Any]:
        """Return, for each whole cell of which the shortened paths see a part, the rest of the cell."""
        import shapely

        whole = np.flatnonzero(~self.cut & self.single)
        squares = self._grid.lattice.boxes(*self._cells[whole].T)
        swept = np.array(self.swept, dtype=object)
        near, sweeps = shapely.STRtree(swept).query(squares, predicate="intersects")
        begins = np.flatnonzero(np.diff(near, prepend=-1))
        seen = np.array([shapely.union_all(part) for part in np.split(swept[sweeps], begins[1:])], dtype=object)
        rests = shapely.difference(squares[near[begins]], seen)
        few = shapely.area(rests) < (1 - _SEEN) * self._grid.size**2
        return dict(zip(whole[near[begins]][few].tolist(), rests[few], strict=True))

    def shorten(self, chain: list[int], wanted: Any) -> None:
        """Choose the viewpoints of a chain of cells on a shorter path that still sweeps the area ``wanted``."""
        before = np.concatenate([self.views[k % len(self.views)] for k in (chain[0] - 2, chain[0] - 1)])[-2:]
        after = np.concatenate([self.views[k % len(self.views)] for k in (chain[-1] + 1, chain[-1] + 2)])[:2]
        path = _without_straight_points(np.concatenate([before, *(self.views[k] for k in chain), after]))
        look = _Look(self._grid, wanted, path)
        if look.allows(path):
            better = look.shortened(path, self._turn)
            if better is not path:
                for k, views in zip(chain, _divided(look.trimmed(better[1:-1]), len(chain)), strict=True):
                    self.views[k] = views
        self.swept += [area for k in chain for area in look.seen(self.views[k])]

    def grid_with_viewpoints(self) -> CellGrid:
        """Return the grid with the viewpoints of the path."""
        order = np.argsort(self._index)
        views = [self.views[k] for k in order.tolist()]
        starts = np.concatenate([[0], np.cumsum([len(view) for view in views])])
        kept = self._grid.viewpoints[self._grid.viewpoint_starts[:-1]]
        points = self._grid.lattice.to_region(np.concatenate(views))
        same = np.diff(starts) == 1
        unmoved = same & (np.diff(self._grid.viewpoint_starts) == 1) & (np.abs(points[starts[:-1]] - kept).max(axis=1) < 1e-9)
        points[starts[:-1][unmoved]] = kept[unmoved]
        return replace(self._grid, viewpoints=points, viewpoint_starts=starts)


class _Look:
    """An area that the footprint must sweep on a part of the tour, with methods that find a shorter path for this purpose."""

    def __init__(self, grid: CellGrid, wanted: Any, path: Points) -> None:
        import shapely

        self._grid, self._half, self._wanted = grid, grid.footprint / 2, wanted
        rim = 2 * grid.footprint
        self._room = shapely.clip_by_rect(grid.area, *(path.min(axis=0) - rim), *(path.max(axis=0) + rim))
        outline = shapely.segmentize(shapely.boundary(wanted), _SPACING * grid.footprint)
        points = shapely.get_coordinates(outline)
        self._boxes = np.hstack([points - self._half, points + self._half])

    def allows(self, path: Points) -> bool:
        """Return whether a path stays in the region and sees the wanted area between its fixed points."""
        legs = self._grid.lattice.to_region(path[1:-1])
        return bool(inside(self._grid.region, legs[:-1], legs[1:]).all()) and self._sees(path[1:-1])

    def seen(self, way: Points) -> Any:
        """Return the area that the footprint sweeps on each leg of a path, without areas behind walls; shape (k,)."""
        import shapely

        corners = self._half * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
        legs = np.stack([way[:-1], way[1:]] if len(way) > 1 else [way, way], axis=1)
        squares = shapely.convex_hull(shapely.multipoints((legs[:, :, None] + corners).reshape(len(legs), -1, 2)))
        seen = shapely.intersection(squares, self._room)
        for k in np.flatnonzero(shapely.get_num_geometries(seen) > 1).tolist():  # a wall divides the footprint
            parts = shapely.get_parts(seen[k])
            seen[k] = shapely.union_all(parts[shapely.intersects(parts, shapely.linestrings(legs[k]))])
        return seen

    def _sees(self, way: Points) -> bool:
        import shapely

        left = self._wanted.difference(shapely.union_all(self.seen(way)))
        return bool(left.area <= SPECK * self._grid.size**2)

    def shortened(self, path: Points, turn: float) -> Points:
        """Return a path that no single change makes cheaper. If no change helps, return the given path itself."""
        from shoal.search.kernels.shortening.path_changes import changed_paths

        steps = np.array(_STEPS) * self._grid.footprint
        room = len(path) * (3 + 3 * len(steps))
        paths, counts, costs = np.empty((room, *path.shape)), np.empty(room, dtype=np.int64), np.empty(room)
        while True:
            found = changed_paths(np.ascontiguousarray(path), self._boxes, turn, steps, paths, counts, costs)
            for k in np.argsort(costs[:found], kind="stable").tolist():
                if self.allows(paths[k, : counts[k]]):
                    path = paths[k, : counts[k]].copy()
                    break
            else:
                return path

    def trimmed(self, way: Points) -> Points:
        """Cut off the beginning and the end of a path, as far as the vehicle need not look there."""
        for _ in range(2):
            for share in _TRIMMED:
                later = np.concatenate([way[:1] + share * (way[1:2] - way[:1]), way[1:]])
                later = later[1:] if share == 1.0 and len(later) > 2 else later
                if self._sees(later):
                    way = later
                    break
            way = way[::-1]
        return way


def _without_straight_points(path: Points) -> Points:
    """Return a path without repeated points and without points on straight lines, except the two points at each end."""
    kept = [path[0], path[1]]
    for point, later in pairwise(path[2:-1]):
        before, after = point - kept[-1], later - point
        across = abs(before[0] * after[1] - before[1] * after[0])
        if not before.any() or (before @ after > 0 and across <= 1e-6 * np.hypot(*before) * np.hypot(*after)):
            continue
        kept.append(point)
    return np.concatenate([kept, path[-2:]])


def _divided(way: Points, count: int) -> list[Points]:
    """Divide a path into ``count`` parts of equal length, one for each cell. Each part begins where the previous part ends."""
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
