"""Random placements on a line: the kernel against plain NumPy in the same run, and paper M's Fig. 5
as a whole.
"""

from __future__ import annotations

import numpy as np

from benchmarks.timing import best_seconds, row
from shoal.swarm.theory.one_dimension import Line, coverage_moves, sample

TRIALS = 1_000_000
_PLAIN = 20_000


def plain(cells: int, particles: int, trials: int) -> float:
    """Return the mean of full coverage by sorting random keys."""
    rng = np.random.default_rng(0)
    keys = rng.random((trials, cells))
    positions = np.sort(np.argpartition(keys, particles, axis=1)[:, :particles], axis=1) + 1
    return float(coverage_moves(positions, cells=cells).mean())


def bench_line() -> None:
    """Print the time of a million placements of Figs. 5 and 6, and how much faster than plain NumPy
    one is.
    """
    for particles in (10, 100):
        line = Line(1000, particles)
        sample(line, 10)
        fast = best_seconds(lambda line=line: sample(line, TRIALS), repeat=3)
        slow = best_seconds(lambda n=particles: plain(1000, n, _PLAIN), repeat=1) * TRIALS / _PLAIN
        figure = f"{fast:.2f} s, {slow / fast:.0f} times"
        row(
            f"1,000,000 placements of {particles} in 1000 cells",
            figure,
            "under 5 s on 2 cores",
            fast < 5,
        )
