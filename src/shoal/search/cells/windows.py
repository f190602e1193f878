"""Windows of cut cells: viewpoints on few straight lines along a tour."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.geometry import partial_sums
from shoal.search.cells.clipping import rotated_shape
from shoal.search.cells.grid import CellGrid
from shoal.search.cells.visibility_graph import inside
from shoal.search.regions.boxes import clipped_to
from shoal.search.regions.outline import Points

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
    windows, tried = _choices(grid)
    if not windows:
        return grid
    starts, lattice, n = grid.viewpoint_starts, grid.lattice, len(cells)
    moved = grid.viewpoints.copy()
    entered, left = grid.viewpoints[starts[index]], grid.viewpoints[starts[index + 1] - 1]
    free = np.flatnonzero(np.isin(index, np.array(list(windows))))
    for chain in _chains(free, n):
        ends = (chain[0] - 2) % n, (chain[0] - 1) % n, (chain[-1] + 1) % n, (chain[-1] + 2) % n
        fixed = lattice.from_region(
            np.stack([left[ends[0]], left[ends[1]], entered[ends[2]], entered[ends[3]]])
        )
        numbers = index[chain].tolist()
        crossed, stages = [windows[k] for k in numbers], [tried[k] for k in numbers]
        known = lattice.from_region(entered[chain])
        moved[starts[index[chain]]] = lattice.to_region(
            _way(grid, fixed, crossed, stages, known, turn * grid.size)
        )
    return replace(grid, viewpoints=moved)


def _choices(grid: CellGrid) -> tuple[dict[int, Any], dict[int, Points]]:
    """Return the window of each cell that has a choice of viewpoints, and the points of the window
    that a path may use, by the index of the cell. All tours through the grid share them.
    """
    known = vars(grid)
    if "choices" not in known:
        windows = _windows(grid)
        free = np.array(list(windows), dtype=np.int64)
        shapes = np.array(list(windows.values()), dtype=object)
        entered = grid.lattice.from_region(grid.viewpoints[grid.viewpoint_starts[free]])
        middles = grid.lattice.centers(*grid.cells[free].T)
        places = _places(shapes, entered, middles, grid.footprint) if windows else []
        known["choices"] = windows, dict(zip(free.tolist(), places, strict=True))
    choices: tuple[dict[int, Any], dict[int, Points]] = known["choices"]
    return choices


def _windows(grid: CellGrid) -> dict[int, Any]:
    """Return the window of each cell that has a choice of viewpoints, as a mapping from the index
    of the cell to Shapely polygon.

    A window contains all points from which the whole piece of a cell is visible.
    """
    import shapely

    clipped, own, half = grid.clipped, grid.own, grid.footprint / 2
    rows, cols = grid.cells.T
    free = np.flatnonzero(~clipped.whole[rows, cols] & (np.diff(grid.viewpoint_starts) == 1))
    if not len(free):
        return {}
    pieces = clipped.pieces[own[rows[free], cols[free]]]
    bounds = shapely.bounds(pieces)
    hair = _HAIR * grid.footprint
    boxes = shapely.box(*(bounds[:, 2:] - half - hair).T, *(bounds[:, :2] + half + hair).T)
    surroundings = _around(grid, rows[free], cols[free])
    parts, of = shapely.get_parts(shapely.union_all(surroundings, axis=1), return_index=True)
    away = shapely.distance(parts, shapely.point_on_surface(pieces)[of])
    order = np.lexsort((away, of))
    around = parts[order[np.searchsorted(of[order], np.arange(len(free)))]]
    shapes = shapely.intersection(around, boxes)
    if grid.region.restricted:
        some = ~shapely.is_empty(shapes)
        free, shapes = free[some], shapes[some]
        low, high = np.split(shapely.bounds(shapes), 2, axis=1)
        near = clipped_to(rotated_shape(grid.region.free, -grid.angle), low, high)
        shapes = shapely.intersection(shapes, near)
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
    surroundings = np.full((len(rows), 9), None, dtype=object)
    for k in range(9):
        row, col = rows + k // 3 - 1, cols + k % 3 - 1
        there = (row >= 0) & (row < grid.shape[0]) & (col >= 0) & (col < grid.shape[1])
        row, col = np.where(there, row, 0), np.where(there, col, 0)
        whole = there & clipped.whole[row, col]
        part = there & ~whole & (own[row, col] >= 0)
        surroundings[whole, k] = grid.lattice.boxes(row[whole], col[whole])
        surroundings[part, k] = clipped.pieces[own[row[part], col[part]]]
    return surroundings


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

    from shoal.search.kernels.windows import fewest_links

    stages = [fixed[:1], fixed[1:2], *places, fixed[2:3], fixed[3:]]
    points, starts = (
        np.concatenate(stages),
        partial_sums([len(stage) for stage in stages]),
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
