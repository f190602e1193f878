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
