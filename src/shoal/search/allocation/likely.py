"""The order in which robots search their arcs if some cells are more likely than others to hold what
is sought.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from shoal.core.geometry import partial_sums
from shoal.search.allocation.costs import Floats, TourCost
from shoal.search.kernels import latency
from shoal.search.kernels.latency import Blocks, Routes
from shoal.search.kernels.shares import Team

_BLOCKS = 2_000  # number of blocks into which a tour is divided at most
_NEAR = 8  # blocks from each end of a block, to which a robot may go on
_LONGEST = 3  # blocks that are moved at once
_KICKS = 2_000  # at most
_KICKS_PER_BLOCK = 2  # at most
_WIDEST = 50  # blocks that a kick turns round or passes over
# of the mean probability: cells where nothing is expected are searched on short ways, too
_UNLIKELY = 1e-3

Runs = list[tuple[int, int, int]]
"""Runs of consecutive cells of the tour in the order of the search: for each, its first cell, its
number of cells and its direction along the tour, 1 or -1."""


def likely_first(
    tour_cost: TourCost, team: Team, work: Sequence[Runs], limits: Floats
) -> list[Runs]:
    """Return runs of cells for each robot in an order that lowers the expected time until a target
    is found.

    Parameters
    ----------
    tour_cost : TourCost
        The tour with its `odds`.
    team : Team
    work : sequence of runs
        The runs of each robot in some order, together all cells.
    limits : ndarray of float64, shape (m,)
        Longest time of each robot, in cells. A robot that needs longer with ``work`` does not
        become slower.

    Notes
    -----
    A local search (`shoal.search.kernels.latency`) from the given order: it is deterministic, so
    that robots that know of the same robots agree without messages. Tours of more than 2000 cells
    are divided into blocks, which robots search whole.
    """
    assert tour_cost.odds is not None
    n, m = len(tour_cost), len(work)
    pieces = [_cut(runs, -(-n // _BLOCKS), n) for runs in work]
    flat = np.concatenate(pieces)
    blocks = _blocks(tour_cost, flat)
    count, counts = len(flat), np.array([len(own) for own in pieces])
    order = np.zeros((m, count + 1), dtype=np.int64)
    for robot, begin in enumerate(partial_sums(counts)[:-1].tolist()):
        order[robot, : counts[robot]] = 2 * np.arange(begin, begin + counts[robot])
    far = (
        team.far
        if len(team.far)
        else np.linalg.norm(tour_cost.points[None] - team.places[:, None], axis=2)
    )
    rows = (m, count + 2)
    routes = Routes(
        order,
        counts,
        team.rates * team.gains,
        np.ascontiguousarray(far + 1.0),
        limits * team.gains,
        np.zeros(count, dtype=np.int64),
        np.zeros(count, dtype=np.int64),
        np.zeros(rows),
        np.zeros(rows),
        np.zeros(rows),
        np.zeros(rows),
        np.zeros(count),
        np.ones(count, dtype=np.bool_),
        np.zeros(count + 2, dtype=np.int64),
        np.zeros(m, dtype=np.int64),
        np.zeros(2 * count + 2, dtype=np.int64),
    )
    kicks = min(_KICKS, _KICKS_PER_BLOCK * count) if tour_cost.thorough else 0
    latency.improve(blocks, routes, _LONGEST, kicks, _WIDEST)
    found = []
    for robot in range(m):
        items = order[robot, : counts[robot]]
        first, cells, along = flat[items // 2].T
        turned = items % 2 > 0
        first = np.where(turned, (first + along * (cells - 1)) % n, first)
        along = np.where(turned, -along, along)
        columns = (column.tolist() for column in (first, cells, along))
        found.append(_joined(zip(*columns, strict=True), n))
    return found


def _cut(runs: Runs, size: int, n: int) -> NDArray[np.int64]:
    """Return the blocks of at most ``size`` cells into which runs are divided, as rows of an
    array.
    """
    first, count, along = np.reshape(runs, (-1, 3)).astype(np.int64).T
    blocks = -(-count // size)
    run = np.repeat(np.arange(len(blocks)), blocks)
    low = size * (np.arange(len(run)) - partial_sums(blocks)[run])
    return np.column_stack(
        [
            (first[run] + along[run] * low) % n,
            np.minimum(size, count[run] - low),
            along[run],
        ]
    )


def _joined(runs: Iterable[tuple[int, int, int]], n: int) -> Runs:
    """Return runs in which those are joined that continue one another along the tour. A run of one
    cell has no direction.
    """
    found: Runs = []
    for first, count, step in runs:
        if found:
            begin, length, way = found[-1]
            ways = (1, -1) if length == 1 and count == 1 else (way if length > 1 else step,)
            for along in ways:
                fits = (length == 1 or way == along) and (count == 1 or step == along)
                if fits and (begin + along * length) % n == first:
                    found[-1] = (begin, length + count, along)
                    break
            else:
                found.append((first, count, step))
        else:
            found.append((first, count, step))
    return found


def _blocks(tour_cost: TourCost, runs: NDArray[np.int64]) -> Blocks:
    assert tour_cost.odds is not None
    n, costs = len(tour_cost), tour_cost.costs
    odds = tour_cost.odds + _UNLIKELY / n
    first, count, along = runs.T
    ends = np.stack([first, (first + along * (count - 1)) % n], axis=1)
    borders = partial_sums(count)[:-1]
    block = np.repeat(np.arange(len(runs)), count)
    within = np.arange(len(block)) - borders[block]
    numbers = (first[block] + along[block] * within) % n
    steps = np.where(along[block] > 0, costs[numbers], costs[(numbers + 1) % n])
    since = np.cumsum(np.where(within > 0, steps, 0.0))
    since -= since[borders][block]
    weights = np.bincount(block, odds[numbers]).astype(np.float64)
    latencies = np.bincount(block, odds[numbers] * since).astype(np.float64)
    times = since[borders + count - 1]
    points = tour_cost.points
    position = tour_cost.tour.position
    free = position >= 0
    cells = tour_cost.tour.cells.astype(np.int64)
    if cells.shape[1] == 2:
        cells, free = np.column_stack([np.zeros(n, dtype=np.int64), cells]), free[None]
    # what lies between the cells of a layer lies between those that robots search again, too
    for layer in range(1, len(free)):
        for other in range(layer):
            if not (free[layer] & ~free[other]).any():
                cells[cells[:, 0] == layer, 0] = other
                break
    return Blocks(
        ends.ravel(),
        times,
        weights,
        latencies,
        _neighbours(points[ends]),
        np.argsort(-weights / (times + latency.STEP), kind="stable"),
        np.pad(points, ((0, 0), (0, 3 - points.shape[1]))),
        costs,
        np.ascontiguousarray(cells),
        np.pad(free.cumsum(axis=1).cumsum(axis=2), ((0, 0), (1, 0), (1, 0))),
        tour_cost.turn_cost + tour_cost.break_cost,
    )


def _neighbours(ends: Floats) -> NDArray[np.int64]:
    """Return the blocks nearest to either end of each block, the nearest first, or -1; int64,
    shape (B, k).
    """
    from scipy.spatial import cKDTree

    if (ends[:, 0] == ends[:, 1]).all():  # blocks of one cell
        ends = ends[:, :1]
    count, sides, dimensions = ends.shape
    near = min(sides * (_NEAR + 1), sides * count)
    _, found = cKDTree(ends.reshape(-1, dimensions)).query(ends, near)
    both = (
        np.asarray(found).reshape(count, sides, -1).transpose(0, 2, 1).reshape(count, -1) // sides
    )
    again = both == np.arange(count)[:, None]
    if sides > 1:  # each other block once, where it comes first
        order = np.argsort(both, axis=1, kind="stable")
        ordered = np.take_along_axis(both, order, axis=1)
        twice = np.zeros(both.shape, dtype=np.bool_)
        np.put_along_axis(twice, order[:, 1:], ordered[:, 1:] == ordered[:, :-1], axis=1)
        again |= twice
    first = np.argsort(again, axis=1, kind="stable")[:, :_NEAR]
    rows = np.take_along_axis(np.where(again, -1, both), first, axis=1)
    return np.pad(rows, ((0, 0), (0, _NEAR - rows.shape[1])), constant_values=-1)
