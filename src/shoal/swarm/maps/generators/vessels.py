"""Maps of blood vessels: a grown vessel network, drawn on a grid with an exact number of free cells."""

from __future__ import annotations

import numpy as np

from shoal.swarm.maps.generators.components import Mask, crop
from shoal.swarm.maps.generators.venation import Indices, Points, VesselNetwork, grow_network, subtrees

AREA_PER_CELL = 1.65  # area of the organ per free cell, before the network is scaled
TIP_WIDTH = 1.5  # width at the end of a twig, in cells
TRUNK_WIDTH = 4.8  # width of the trunk at 5000 free cells, in cells
THIN = 1.7  # narrower segments are drawn as a line of single cells
SAMPLES = 9  # points drawn per segment, which is one or two cells long
SPECK = 2  # largest hole that is filled, in cells: such holes appear where two vessels touch


def draw_vessels(count: int, *, seed: int = 0) -> Mask:
    """Return a map of a blood vessel network with exactly ``count`` free cells.

    The network has one or two inlets, vessels that narrow at each fork, closed loops and dead ends.

    Parameters
    ----------
    count : int
        Number of free cells.
    seed : int
        Seed of the random numbers. Equal sizes and equal seeds give equal maps.

    Returns
    -------
    ndarray, bool, shape (H, W)
        True at free cells. The free cells are 4-connected, and the map has no border rows or columns of obstacles.
    """
    rng = np.random.default_rng([seed, count])
    network = grow_network(AREA_PER_CELL * count, rng)
    return crop(_trim(_fit(network, count), count, rng))


def _fit(network: VesselNetwork, count: int) -> Mask:
    """Return a map of the vessel network at the scale that gives ``count`` free cells or slightly more."""
    start, end, width = _pieces(network, TRUNK_WIDTH * (count / 5000) ** (1 / 6))
    scale, best, best_excess = 1.0, None, count
    for attempt in range(40):
        free = _fill_specks(_draw(start * scale, end * scale, width))
        excess = int(np.count_nonzero(free)) - count
        if excess >= 0 and (best is None or excess < best_excess):
            best, best_excess = free, excess
        if best is not None and (best_excess <= max(2, count // 300) or attempt > 10):
            break
        # Aim slightly high, because removing free cells is easier than adding them.
        scale *= ((count + max(1.0, count / 600)) / (count + excess)) ** 0.8
    assert best is not None, "a larger scale gives more free cells"
    return best


def _pieces(network: VesselNetwork, trunk_width: float) -> tuple[Points, Points, Points]:
    """Return the start points (n, 2), end points (n, 2) and widths in cells (n,) of the n straight segments of the vessels.

    The width of a segment is a power of the total length of the vessels that the segment supplies. The exponent of the power is
    such that the widest segment has the width ``trunk_width``, and the ends of twigs have the width ``TIP_WIDTH``.
    """
    points, parents = network.points, network.parents
    size = subtrees(parents)[1]
    power = np.log(trunk_width / TIP_WIDTH) / np.log(max(size.max(), 2))
    grown = np.flatnonzero(parents != np.arange(len(parents)))
    curves = network.joints
    start = np.concatenate([points[parents[grown]], *(curve[:-1] for curve in curves)])
    end = np.concatenate([points[grown], *(curve[1:] for curve in curves)])
    width = np.full(len(start), TIP_WIDTH)
    width[: len(grown)] *= size[grown] ** power
    return start, end, width


def _draw(start: Points, end: Points, width: Points) -> Mask:
    """Return the cells that the vessel segments cover. The cells of each segment are 4-connected."""
    share = np.linspace(0, 1, SAMPLES)[None, :, None]
    at = start[:, None] + share * (end - start)[:, None]
    margin = int(np.ceil(width.max() / 2)) + 1
    at -= np.floor(at.min(axis=(0, 1))) - margin
    cell = np.floor(at).astype(np.int64)
    free = np.zeros((cell.max(axis=(0, 1)) + margin + 1)[::-1], dtype=np.bool_)
    free[cell[..., 1], cell[..., 0]] = True
    free[cell[:, 1:, 1], cell[:, :-1, 0]] = True  # the corner cell of each diagonal step
    wide = width >= THIN
    radius = np.repeat(width[wide] / 2, SAMPLES)
    _paint_discs(free, at[wide].reshape(-1, 2), cell[wide].reshape(-1, 2), radius)
    return free


def _paint_discs(free: Mask, centre: Points, cell: Indices, radius: Points) -> None:
    """Mark as free all cells whose centre lies within ``radius`` of a disc's centre."""
    reach = int(np.ceil(radius.max(initial=0)))
    for right in range(-reach, reach + 1):
        for down in range(-reach, reach + 1):
            offset = cell + (right, down) + 0.5 - centre
            inside = cell[offset[:, 0] ** 2 + offset[:, 1] ** 2 <= radius**2]
            free[inside[:, 1] + down, inside[:, 0] + right] = True


def _fill_specks(free: Mask) -> Mask:
    """Return a copy of the map without the smallest holes."""
    from shoal.jit.kernels.connected import connected_parts  # needs Numba, which is slow to import

    holes = connected_parts(~free, corners=True)[0]
    area = np.bincount(holes.ravel())
    return np.asarray(free | ((area <= SPECK) & (area > 0))[holes] & (holes > 0))


def _trim(free: Mask, count: int, rng: np.random.Generator) -> Mask:
    """Reduce the map to ``count`` free cells: shorten dead ends, one cell after another."""
    free = np.pad(free, 1)
    excess = int(np.count_nonzero(free)) - count
    while excess > 0:
        ends = _dead_ends(free)
        if not len(ends):
            return _nearest_cells(free, count)
        gone = rng.permutation(ends)[:excess]
        for row, column in gone:  # one at a time, because the neighbour of a dead end may be a dead end itself
            if _free_neighbours(free, row, column) == 1:
                free[row, column] = False
                excess -= 1
    return free


def _dead_ends(free: Mask) -> Indices:
    """Return the free cells with exactly one free neighbour, shape (k, 2). All border cells of the map must be obstacles."""
    neighbours = np.zeros(free.shape, dtype=np.int64)
    neighbours[1:-1, 1:-1] = free[:-2, 1:-1].astype(np.int64) + free[2:, 1:-1] + free[1:-1, :-2] + free[1:-1, 2:]
    return np.argwhere(free & (neighbours == 1))


def _free_neighbours(free: Mask, row: int, column: int) -> int:
    sides = free[row - 1, column], free[row + 1, column], free[row, column - 1], free[row, column + 1]
    return sum(map(int, sides))


def _nearest_cells(free: Mask, count: int) -> Mask:
    """Return the ``count`` free cells with the shortest paths to the first free cell of the map."""
    from shoal.swarm.kernels.search.breadth_first import nearest_cells  # needs Numba, which is slow to import

    kept = np.zeros_like(free)
    offsets = np.array([-1, -free.shape[1], 1, free.shape[1]])
    kept.ravel()[nearest_cells(free.ravel(), offsets, int(np.argmax(free)), count)] = True
    return kept
