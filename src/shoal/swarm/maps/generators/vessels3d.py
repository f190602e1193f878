"""Vessel trees in 3-D.

The generator splits a volume repeatedly, and a branch leads to each half. The radii of the branches
follow Murray's law.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.swarm.kernels.search import nearest_cells
from shoal.swarm.maps.generators.vessels import Points
from shoal.swarm.maps.reading import Mask
from shoal.swarm.maps.resampling import crop

CELLS_A_TIP = 60  # free cells per tip, before the tree is scaled
TIP_RADIUS = 0.8  # cells
REACH = 0.4  # a branch forks after this fraction of the distance to the centre of its tips
UNEVEN = (0.3, 0.7)  # fraction of the tips that the first of two branches supplies
ORGAN = (0.8, 1.2, 1.0)  # half-axes of the ellipsoid: layers, rows, columns
# fraction of excess cells allowed in the drawing; the ends of twigs are cut to remove them
EXCESS = 0.02
LOOPS = 0.12  # fraction of the tips that are joined to another tip


def draw_vessel_tree(count: int, *, seed: int = 0) -> Mask:
    """Return a 3-D map of a vessel tree with exactly ``count`` free cells. `draw_vessel_net`
    explains the method.

    Returns
    -------
    ndarray, bool, shape (D, H, W)
        True at free cells. The free cells are 6-connected, and the map has no border layers of
        obstacles.
    """
    return _draw_vessels(count, np.random.default_rng([seed, count]), loops=0.0)


def draw_vessel_net(count: int, *, seed: int = 0) -> Mask:
    """Return a 3-D map of a vessel network with loops: a vessel tree with some twigs joined to
    twigs of other branches.

    The generator distributes the tips of the network in an ellipsoid. The first branch grows from
    the inlet towards the centre of all tips. A plane along each branch divides the tips beyond the
    branch into two groups, and a new branch leads to each group. The division of the tips continues
    until each group is a single tip. The cube of a branch's radius is proportional to the number of
    tips that the branch leads to. The radius r0 of a branch and the radii r1 and r2 of its
    daughters follow Murray's law, r0³ = r1³ + r2³.

    Parameters
    ----------
    count : int
        Number of free cells.
    seed : int
        Seed of the random numbers. Equal sizes and equal seeds give equal maps.

    Returns
    -------
    ndarray, bool, shape (D, H, W)

    Notes
    -----
    Sources: Murray, The physiological principle of minimum work, 1926; Tawhai, Pullan and Hunter,
    Generation of an anatomically based three-dimensional model of the conducting airways, 2000
    (splitting by planes).
    """
    return _draw_vessels(count, np.random.default_rng([seed, count, 1]), loops=LOOPS)


def _draw_vessels(count: int, rng: np.random.Generator, *, loops: float) -> Mask:
    tips = max(2, count // CELLS_A_TIP)
    start, end, tip_counts = grow_tree(_spread(tips, rng), rng)
    if loops:
        bridges = _bridges(end[tip_counts == 1], max(1, round(loops * tips)))
        start, end = np.concatenate([start, bridges[0]]), np.concatenate([end, bridges[1]])
        tip_counts = np.concatenate([tip_counts, np.ones(len(bridges[0]), dtype=np.int64)])
    return _trim(_fit_to_count(start, end, murray_radius(tip_counts), count), count)


def murray_radius(fed: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the radius of each branch in cells. ``fed`` is the number of tips that each branch
    leads to.
    """
    return TIP_RADIUS * np.cbrt(fed.astype(np.float64))


def _spread(tips: int, rng: np.random.Generator) -> Points:
    """Return random points in an ellipsoid as an array of shape (tips, 3) with the columns layer,
    row and column.
    """
    points: Points = np.zeros((0, 3))
    while len(points) < tips:
        cube = rng.uniform(-1, 1, (2 * tips + 8, 3))
        points = np.concatenate([points, cube[(cube**2).sum(axis=1) <= 1]])
    return np.asarray(points[:tips] * ORGAN)


def grow_tree(tips: Points, rng: np.random.Generator) -> tuple[Points, Points, NDArray[np.int64]]:
    """Return the start and the end of each branch, shape (n, 3), and the number of tips that each
    branch leads to, shape (n,).

    The trunk comes first.
    """
    starts, ends, tip_counts = [], [], []
    inlet = np.array([0.0, 1.1 * ORGAN[1], 0.0])  # below
    waiting = [(inlet, tips)]
    while waiting:
        start, supplied = waiting.pop()
        middle = supplied.mean(axis=0)
        end = supplied[0] if len(supplied) == 1 else start + REACH * (middle - start)
        starts.append(start)
        ends.append(end)
        tip_counts.append(len(supplied))
        if len(supplied) > 1:
            first = _first_half(supplied, end - start, rng)
            waiting += [(end, supplied[~first]), (end, supplied[first])]
    return np.array(starts), np.array(ends), np.array(tip_counts, dtype=np.int64)


def _first_half(points: Points, along: Points, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Divide the points into two groups with at least one point each. Return the mask of the points
    in the first group.

    The plane between the groups contains the branch ``along`` and crosses the direction in which
    the points spread most.
    """
    offset = points - points.mean(axis=0)
    length = float(np.linalg.norm(along))
    if length > 0:
        offset = offset - np.outer(offset @ along, along) / length**2
    widest = np.linalg.eigh(offset.T @ offset)[1][:, -1]
    # fix the sign, which differs between libraries
    widest = widest * (1 if widest[np.argmax(np.abs(widest))] > 0 else -1)
    place = offset @ widest
    size = int(np.clip(round(float(rng.uniform(*UNEVEN)) * len(points)), 1, len(points) - 1))
    first = np.zeros(len(points), dtype=np.bool_)
    first[np.argsort(place, kind="stable")[:size]] = True
    return first


def _bridges(tips: Points, count: int) -> tuple[Points, Points]:
    """Return the start points and the end points of up to ``count`` twigs that join two tips of a
    tree.

    The joined tips are close in space but far apart in the tree. ``tips`` lists the tips in the
    order of growth.
    """
    from scipy.spatial import cKDTree

    near = cKDTree(tips).query(tips, k=min(8, len(tips)))
    candidates: list[tuple[float, int, int]] = []
    for tip, (distances, neighbours) in enumerate(zip(*near, strict=True)):
        for distance, neighbour in zip(distances.tolist(), neighbours.tolist(), strict=True):
            if abs(neighbour - tip) > 0.1 * len(tips) and tip < neighbour:
                candidates.append((distance, tip, neighbour))
                break
    candidates.sort()
    if not candidates:
        candidates = [(0.0, 0, len(tips) - 1)]
    pairs = np.array([(tip, neighbour) for _, tip, neighbour in candidates[:count]])
    return tips[pairs[:, 0]], tips[pairs[:, 1]]


def _fit_to_count(start: Points, end: Points, radius: NDArray[np.float64], count: int) -> Mask:
    """Return a map of the vessel tree at the scale that gives ``count`` free cells or slightly
    more.
    """
    scale, low, high, best = 2.0 * float(np.cbrt(count)), 0.0, np.inf, None
    for attempt in range(30):
        free = _draw_branches(start * scale, end * scale, radius)
        excess = int(np.count_nonzero(free)) - count
        if excess >= 0:
            best, high = free, scale
            if excess <= EXCESS * count or attempt > 12:
                break
        else:
            low = scale
        # the volume of thin tubes is proportional to their length
        aimed = scale * (count * (1 + EXCESS / 2) / (count + excess)) ** 0.9
        scale = aimed if low < aimed < high else (low + high) / 2 if high < np.inf else 1.3 * low
    assert best is not None, "a larger scale gives more free cells"
    return best


def _draw_branches(start: Points, end: Points, radius: NDArray[np.float64]) -> Mask:
    """Return the cells that the branches cover. The cells of each branch are 6-connected."""
    steps = np.maximum(1, np.ceil(2 * np.linalg.norm(end - start, axis=1)).astype(np.int64))
    branch = np.repeat(np.arange(len(start)), steps + 1)
    first = np.repeat(np.cumsum(steps + 1) - steps - 1, steps + 1)
    share = ((np.arange(len(branch)) - first) / steps[branch])[:, None]
    at = start[branch] + share * (end - start)[branch]
    margin = int(np.ceil(radius.max())) + 1
    at -= np.floor(at.min(axis=0)) - margin
    cell = np.floor(at).astype(np.int64)
    free = np.zeros(cell.max(axis=0) + margin + 1, dtype=np.bool_)
    free[tuple(cell.T)] = True
    same = branch[1:] == branch[:-1]
    start_cell, end_cell = cell[:-1][same], cell[1:][same]
    free[end_cell[:, 0], start_cell[:, 1], start_cell[:, 2]] = (
        True  # the corner cells of a diagonal step
    )
    free[end_cell[:, 0], end_cell[:, 1], start_cell[:, 2]] = True
    _paint_balls(free, at, cell, radius[branch])
    return free


def _paint_balls(
    free: Mask, centre: Points, cell: NDArray[np.int64], radius: NDArray[np.float64]
) -> None:
    """Mark as free all cells whose centre lies within ``radius`` of a ball's centre.

    To save time, the function leaves out some of the densely placed balls of thick branches.
    """
    for reach in range(1, int(np.ceil(radius.max())) + 1):
        thick = np.flatnonzero((np.ceil(radius) == reach) & (radius > 0.6))
        thick = thick[:: max(1, reach // 2)]
        around = np.arange(-reach, reach + 1)
        for offset in np.stack(np.meshgrid(around, around, around, indexing="ij"), axis=-1).reshape(
            -1, 3
        ):
            place = cell[thick] + offset
            inside = ((place + 0.5 - centre[thick]) ** 2).sum(axis=1) <= radius[thick] ** 2
            free[tuple(place[inside].T)] = True


def _trim(free: Mask, count: int) -> Mask:
    """Return a map of the ``count`` free cells with the shortest paths to the inlet, without border
    layers of obstacles.
    """
    padded = np.pad(free, 1)
    lowest = int(np.flatnonzero(padded.any(axis=(0, 2)))[-1])
    inlet = (layer_column := np.argwhere(padded[:, lowest])[0])[0], lowest, layer_column[1]
    row, layer = padded.shape[2], padded.shape[1] * padded.shape[2]
    offsets = np.array([-1, 1, -row, row, -layer, layer])
    trimmed = np.zeros_like(padded)
    trimmed.ravel()[
        nearest_cells(
            padded.ravel(), offsets, int(np.ravel_multi_index(tuple(inlet), padded.shape)), count
        )
    ] = True
    return crop(trimmed)
