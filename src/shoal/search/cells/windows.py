"""Windows of cut cells: viewpoints on few straight lines along a tour."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.geometry import partial_sums
from shoal.search.cells.clipping import rotate_shape
from shoal.search.cells.grid import CellGrid
from shoal.search.cells.visibility_graph import inside
from shoal.search.regions.boxes import clip_to_boxes
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
    windows, candidates = _choices(grid)
    if not windows:
        return grid
    starts, lattice, n = grid.viewpoint_starts, grid.lattice, len(cells)
    moved = grid.viewpoints.copy()
    entered, exits = grid.viewpoints[starts[index]], grid.viewpoints[starts[index + 1] - 1]
    chains = _chains(np.flatnonzero(np.isin(index, np.array(list(windows)))), n)
    first, last = (np.array([chain[end] for chain in chains]) for end in (0, -1))
    fixed = lattice.from_region(
        np.stack(
            [
                exits[(first - 2) % n],
                exits[(first - 1) % n],
                entered[(last + 1) % n],
                entered[(last + 2) % n],
            ],
            axis=1,
        )
    )
    along = np.concatenate(chains)
    numbers = index[along].tolist()
    crossed = np.array([windows[k] for k in numbers], dtype=object)
    lengths = np.array([len(chain) for chain in chains])
    places = [candidates[k] for k in numbers]
    entries = lattice.from_region(entered[along])
    moved[starts[index[along]]] = lattice.to_region(
        _choose_points(grid, fixed, lengths, crossed, places, entries, turn * grid.size)
    )
    return replace(grid, viewpoints=moved)


def _choices(grid: CellGrid) -> tuple[dict[int, Any], dict[int, Points]]:
    """Return the window of each cell that has a choice of viewpoints, and the points of the window
    that a path may use, by the index of the cell. All tours through the grid share them.
    """
    cache = vars(grid)
    if "choices" not in cache:
        windows = _windows(grid)
        free = np.array(list(windows), dtype=np.int64)
        shapes = np.array(list(windows.values()), dtype=object)
        entered = grid.lattice.from_region(grid.viewpoints[grid.viewpoint_starts[free]])
        middles = grid.lattice.centers(*grid.cells[free].T)
        places = _places(shapes, entered, middles, grid.footprint) if windows else []
        cache["choices"] = windows, dict(zip(free.tolist(), places, strict=True))
    choices: tuple[dict[int, Any], dict[int, Points]] = cache["choices"]
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
    # what of the piece and its surroundings is connected; only the piece if no box leaves its cell
    around = pieces.copy()
    leaving = np.flatnonzero(
        ~shapely.contains_properly(grid.lattice.boxes(rows[free], cols[free]), boxes)
    )
    surroundings = _around(grid, rows[free[leaving]], cols[free[leaving]])
    parts, of = shapely.get_parts(shapely.union_all(surroundings, axis=1), return_index=True)
    away = shapely.distance(parts, shapely.point_on_surface(pieces[leaving])[of])
    order = np.lexsort((away, of))
    around[leaving] = parts[order[np.searchsorted(of[order], np.arange(len(leaving)))]]
    shapes = shapely.intersection(around, boxes)
    if grid.region.restricted:
        some = ~shapely.is_empty(shapes)
        free, shapes = free[some], shapes[some]
        low, high = np.split(shapely.bounds(shapes), 2, axis=1)
        near = clip_to_boxes(rotate_shape(grid.region.free, -grid.angle), low, high)
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
        in_grid = (row >= 0) & (row < grid.shape[0]) & (col >= 0) & (col < grid.shape[1])
        row, col = np.where(in_grid, row, 0), np.where(in_grid, col, 0)
        whole = in_grid & clipped.whole[row, col]
        part = in_grid & ~whole & (own[row, col] >= 0)
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


def _places(windows: Any, entries: Points, middles: Points, footprint: float) -> list[Points]:
    """Return the points of each window that a path may use; float64, each of shape (k, 2).

    The points of a window are its present viewpoint, its corners, and the ends of lines across the
    window.
    """
    import shapely

    step = _COARSE * footprint / 4
    # Points of one square of this step count as one. Many windows are in one square with their
    # present viewpoint: those of cells whose piece is as wide as the footprint are only points.
    bounds, hair = shapely.bounds(windows), _HAIR * footprint
    squares = np.round(np.stack([bounds[:, :2] - hair, entries, bounds[:, 2:] + hair]) / step)
    wide = np.flatnonzero((squares != squares[0]).any(axis=(0, 2)))
    shapes = windows[wide]
    left, low, right, high = (side[:, None] for side in bounds[wide].T)
    shares = np.linspace(0.0, 1.0, 5)
    rows = np.hstack([low + shares * (high - low), middles[wide, 1:]])
    cols = np.hstack([left + shares * (right - left), middles[wide, :1]])
    cut, of_cut = _crossings(shapes, np.stack([cols, rows]))
    corners, of_corner = shapely.get_coordinates(
        shapely.simplify(shapes, _COARSE * footprint), return_index=True
    )
    candidates = np.concatenate([entries, corners, cut])
    owner = np.concatenate([np.arange(len(windows)), wide[of_corner], wide[of_cut]])
    distinct = np.unique(
        np.column_stack([owner, np.round(candidates / step)]),
        axis=0,
        return_index=True,
    )[1]
    return np.split(
        candidates[distinct], np.searchsorted(owner[distinct], np.arange(1, len(windows)))
    )


def _crossings(shapes: Any, values: NDArray[np.float64]) -> tuple[Points, Numbers]:
    """Return the points in which the borders of polygons cross lines along the axes, and the polygon
    of each.

    The argument ``values``, of shape (2, n, k), gives the x coordinates of k upright lines for each
    polygon, and the y coordinates of k level lines.
    """
    import shapely

    rings, polygon = shapely.get_rings(shapes, return_index=True)
    points, ring = shapely.get_coordinates(rings, return_index=True)
    edges = np.flatnonzero(ring[1:] == ring[:-1])
    begins, ends, owner = points[edges], points[edges + 1], polygon[ring[edges]]
    found, owners = [], []
    for axis in range(2):
        at = values[axis, owner]
        low, high = begins[:, axis, None], ends[:, axis, None]
        edge, line = np.nonzero((low != high) & ((at - low) * (at - high) <= 0))
        share = ((at - low)[edge, line] / (high - low)[edge, 0])[:, None]
        crossed = begins[edge] + share * (ends[edge] - begins[edge])
        crossed[:, axis] = at[edge, line]
        found.append(crossed)
        owners.append(owner[edge])
    return np.concatenate(found), np.concatenate(owners)


def _choose_points(
    grid: CellGrid,
    fixed: Points,
    lengths: Numbers,
    shapes: Any,
    places: list[Points],
    entries: Points,
    turn: float,
) -> Points:
    """Return one point in each window, so that the path through the fixed points and all windows of
    each chain has few bends; float64, shape (n, 2).

    Parameters
    ----------
    grid : CellGrid
    fixed : ndarray of float64, shape (c, 4, 2)
        The two points before each chain, and the two points behind it.
    lengths : ndarray of int64, shape (c,)
        Number of windows of each chain.
    shapes : ndarray of Shapely polygons, shape (n,)
        The windows of all chains, one chain after another.
    places : list of ndarray of float64, each of shape (k, 2)
        Points of each window that a path may use.
    entries : ndarray of float64, shape (n, 2)
        The points of a chain without a path through all of its windows.
    turn : float
        Cost of a turn in metres.
    """
    import shapely

    from shoal.search.kernels.windows import fewest_links

    chains = partial_sums(lengths + 4)
    chain_of = np.repeat(np.arange(len(lengths)), lengths + 4)
    stage = np.arange(chains[-1]) - chains[chain_of]
    inner = (stage >= 2) & (stage < lengths[chain_of] + 2)
    stages: list[Points] = [*fixed.reshape(-1, 1, 2)]
    order = np.empty(len(inner), dtype=np.int64)
    order[~inner] = np.arange(len(stages))
    order[inner] = len(stages) + np.arange(len(places))
    stages += places
    stages = [stages[k] for k in order.tolist()]
    points, starts = (
        np.concatenate(stages),
        partial_sums([len(stage_points) for stage_points in stages]),
    )
    boxes = np.empty((len(stages), 4))
    boxes[inner] = shapely.bounds(shapes)
    boxes[~inner] = np.tile(fixed.reshape(-1, 2), 2)
    stage_of = np.repeat(stage, np.diff(starts))
    far = np.repeat(lengths[chain_of] + 2, np.diff(starts))
    region, to_region = grid.region, grid.lattice.to_region
    unsolved, banned = np.arange(len(lengths)), np.zeros(0, dtype=np.int64)
    nodes, counts = np.empty(len(stages), dtype=np.int64), np.zeros(len(lengths), dtype=np.int64)
    for _ in range(_ROUNDS):
        fewest_links(points, starts, boxes, chains, unsolved, turn, _REACH, banned, nodes, counts)
        on_path = stage < counts[chain_of]
        on_path &= np.isin(chain_of, unsolved)
        of, path = chain_of[on_path], nodes[on_path]
        begins, ends = path[:-1], path[1:]
        # the links between the two fixed points at each end are given
        links = np.flatnonzero(
            (of[1:] == of[:-1]) & (stage_of[ends] > 1) & (stage_of[begins] < far[begins])
        )
        begins, ends = begins[links], ends[links]
        blocked = ~inside(region, to_region(points[begins]), to_region(points[ends]))
        if not blocked.any():
            break
        unsolved = np.unique(of[links[blocked]])
        banned = np.union1d(banned, begins[blocked] * len(points) + ends[blocked])
    chosen, at = entries.copy(), partial_sums(lengths)
    # most paths bend in each of their few windows
    bent = counts == lengths + 4
    chosen[np.repeat(bent, lengths)] = points[nodes[inner & bent[chain_of]]]
    partial = (counts > 0) & ~bent
    on_path = (stage < counts[chain_of]) & partial[chain_of]
    path, of = nodes[on_path], np.repeat(np.arange(len(lengths)), lengths)
    some = np.flatnonzero(partial[of])
    number = some - at[of[some]] + 2
    if len(some):
        chosen[some] = _path_crossings(
            points[path], stage_of[path], chain_of[on_path], shapes[some], number, of[some]
        )
    return chosen


def _path_crossings(
    path: Points, stages: Numbers, chain_of_path: Numbers, shapes: Any, number: Numbers, of: Numbers
) -> Points:
    """Return one point of each window: on the path where the path crosses the window, or else
    nearest to the path; float64, shape (n, 2).

    Parameters
    ----------
    path : ndarray of float64, shape (k, 2)
        The points of all paths, one after another.
    stages, chain_of_path : ndarray of int64, shape (k,)
        The number of each point's window in its chain, increasing along a path, and the chain.
    shapes : ndarray of Shapely polygons, shape (n,)
        The windows of all chains.
    number, of : ndarray of int64, shape (n,)
        The number of each window in its chain, and the chain.
    """
    import shapely

    span = int(number.max()) + 3
    links = np.searchsorted(chain_of_path * span + stages, of * span + number)
    hit = (stages[links] == number) & (chain_of_path[links] == of)
    crossings = path[links]
    missed = np.flatnonzero(~hit)
    ahead = links[missed]
    lines = shapely.linestrings(np.stack([path[ahead - 1], path[ahead]], axis=1))
    cuts = shapely.intersection(lines, shapes[missed])
    for k, link, line, cut in zip(missed.tolist(), ahead.tolist(), lines, cuts, strict=True):
        if cut.is_empty:
            crossings[k] = shapely.get_coordinates(shapely.shortest_line(shapes[k], line))[0]
            continue
        # Backwards from the last point, so that the path never turns back.
        ends = shapely.get_coordinates(cut)
        step = path[link] - path[link - 1]
        begun = (
            crossings[k - 1]
            if number[k] > 2 and stages[link - 1] < number[k] - 1
            else path[link - 1]
        )
        far = (ends - path[link - 1]) @ step
        crossings[k] = (
            begun
            if far.min() <= (begun - path[link - 1]) @ step <= far.max()
            else ends[np.argmin(far)]
        )
    return crossings
