"""Small random workspaces with particles, for which an optimum can be found."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from shoal.swarm import GridWorkspace


def small_cases(count: int, seed: int) -> Iterator[tuple[GridWorkspace, np.ndarray]]:
    """Yield workspaces of at most 4 x 5 cells, each with the cells where one to four particles
    start.
    """
    rng = np.random.default_rng(seed)
    while count:
        free = rng.random((rng.integers(1, 5), rng.integers(2, 6))) < 0.8
        if not free.any():
            continue
        workspace = GridWorkspace(free).largest_component()
        n = int(rng.integers(1, min(4, workspace.n_free) + 1))
        yield workspace, workspace.cells[rng.choice(workspace.n_free, size=n, replace=False)]
        count -= 1


def connected_cases(
    count: int, cells: int, seed: int
) -> Iterator[tuple[GridWorkspace, np.ndarray]]:
    """Yield connected workspaces of so many free cells, each with the cells where one to four
    particles start. Most are full of dead ends; some have open rooms.
    """
    rng = np.random.default_rng(seed)
    for _ in range(count):
        chance = rng.choice([0.0, 0.5, 1.0])  # with which a cell with two neighbours is left out
        free = {(0, 0)}
        while len(free) < cells:
            row, column = sorted(free)[rng.integers(len(free))]
            around = [(row, column + 1), (row + 1, column), (row, column - 1), (row - 1, column)]
            row, column = around[rng.integers(4)]
            beside = {(row, column + 1), (row + 1, column), (row, column - 1), (row - 1, column)}
            if rng.random() >= chance or len(free & beside) < 2:
                free.add((row, column))
        at = np.array(sorted(free))
        mask = np.zeros(np.ptp(at, axis=0) + 1, dtype=np.bool_)
        mask[tuple((at - at.min(axis=0)).T)] = True
        workspace = GridWorkspace(mask)
        n = int(rng.integers(1, min(4, cells) + 1))
        yield workspace, workspace.cells[rng.choice(cells, size=n, replace=False)]
