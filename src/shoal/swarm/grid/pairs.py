"""A map as gathering sees it: which cells commands lead to, and how many commands two particles need
until they meet.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.swarm.grid.board import Board, offsets_of
from shoal.swarm.kernels import gathering as kernels

MOST_CELLS = 6000
"""Most free cells of a map for whose pairs of cells a table is computed. The table has 144 MB then,
and its computation takes as much again.
"""


def moves_of(
    free: NDArray[np.bool_],
    offsets: NDArray[np.int64],
    cells: NDArray[np.int64],
    n: int,
    rule: str,
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the number of the cell ahead of each of ``cells`` for each command, -1 if it is not
    among ``cells``, and whether a particle may stay although the cell ahead is free.

    Both have shape (commands, cells). Walls have no cell ahead.
    """
    index = np.full(free.size, -1, dtype=np.int64)
    index[cells] = np.arange(cells.size)
    ahead = np.full((offsets.size, cells.size), -1, dtype=np.int64)
    may_stay = np.zeros((offsets.size, cells.size), dtype=np.bool_)
    inner = free[cells]
    for command, offset in enumerate(offsets.tolist()):
        ahead[command, inner] = index[cells[inner] + offset]
        capacity, neighbours = np.zeros(cells.size, dtype=np.int64), cells[inner] + offset
        while free[neighbours].any():
            capacity[inner] += free[neighbours]
            neighbours = np.where(free[neighbours], neighbours + offset, neighbours)
        may_stay[command] = capacity < (1 if rule == "merge" else n)
    return ahead, may_stay


@dataclass(frozen=True, eq=False)
class PairGrid:
    """A map as the kernels of gathering see it.

    Attributes
    ----------
    cells : ndarray of int64, shape (m,)
        The place of each free cell in the flat map with its rim, in increasing order.
    ahead : ndarray of int64, shape (commands, m)
        The number of the cell ahead of each cell, or -1.
    goal : ndarray of bool, shape (m,) or (0,)
        The cells of the region, or empty without a region.
    fewest : ndarray of int32, shape (m * m,) or (0,)
        The fewest commands for each pair of cells, or empty for a large map.
    near : ndarray of int64, shape (m,)
        The length of the shortest path from each cell to the region. Without a region, 0 if there is
        a table of pairs, and else the path to a cell that is far from others.
    """

    cells: NDArray[np.int64]
    ahead: NDArray[np.int64]
    goal: NDArray[np.bool_]
    fewest: NDArray[np.int32]
    near: NDArray[np.int64]

    def swarm(self, occupied: Board) -> NDArray[np.int64]:
        """Return the numbers of the cells that hold particles."""
        return np.searchsorted(self.cells, np.flatnonzero(occupied.mask))


@lru_cache(maxsize=2)
def pair_grid(
    free: Board, region: Board | None, rule: str, particles: int, *, pairs: bool
) -> PairGrid:
    """Return a map in the form of the kernels.

    Parameters
    ----------
    free : Board
    region : Board or None
    rule : str
    particles : int
        Number of particles. Under the rule merge, it makes no difference.
    pairs : bool
        Whether to compute the table of pairs, which takes time and memory that grow with the square
        of the number of free cells.
    """
    mask = free.mask.ravel()
    cells = np.flatnonzero(mask)
    ahead, may_stay = moves_of(mask, offsets_of(free.layout.window), cells, particles, rule)
    goal = np.zeros(0, dtype=np.bool_) if region is None else region.mask.ravel()[cells]
    fewest = fewest_to_meet(ahead, may_stay, goal, rule) if pairs else np.zeros(0, dtype=np.int32)
    near, queue = np.zeros(cells.size, dtype=np.int64), np.zeros(cells.size, dtype=np.int64)
    aims = np.flatnonzero(goal)
    if region is None and cells.size:
        aims = np.array([kernels.measure_paths_from(ahead, 0, -1, near, queue)])
    queue[: aims.size] = aims
    kernels.measure_paths(ahead, aims.size, -1, near, queue)
    if region is None and pairs:
        near[:] = 0  # any cell will do
    return PairGrid(cells, ahead, goal, fewest, near)


def fewest_to_meet(
    ahead: NDArray[np.int64], may_stay: NDArray[np.bool_], goal: NDArray[np.bool_], rule: str
) -> NDArray[np.int32]:
    """Return the smallest number of commands that bring two particles together, for each pair of m
    cells (int32, shape (m * m,)): into goal cells, or without goal cells into one cell. The
    number is -1 for pairs that no commands bring together.

    ``ahead`` and ``may_stay`` are those of `shoal.swarm.theory.command_bounds.moves_of`.
    """
    m = ahead.shape[1]
    fewest = np.full(m * m, -1, dtype=np.int32)
    kernels.meet_pairs(
        ahead,
        may_stay,
        rule == "tilt",
        goal,
        fewest,
        np.zeros(m * m, dtype=np.int32),
        np.zeros((2, m + 1), dtype=np.int64),
    )
    return fewest
