"""Monte Carlo simulation on a line: random placements, whose numbers of moves are computed in compiled code."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import field, fields

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_integer
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.swarm.theory.one_dimension.exact import Line

_DRAWS, _CELLS = 2**21, 2**28  # random numbers drawn, and cells scanned, per block; part of the definition of a seed
MAX_TRIALS = 100_000_000  # placements of 28 bytes each
MAX_DRAWS = 10_000_000  # maximum number of random numbers for one placement

Values = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class LineSample:
    """Random placements and their numbers of moves. Every array is an int32 array of shape (trials,).

    Parameters
    ----------
    line : Line
    first : ndarray
        p_1, the position of the first particle: the number of moves to the left that find the wall.
    last : ndarray
        m + 1 - p_n: the number of moves to the right in which the last particle finds the right wall.
    largest_gap : ndarray
        Number of empty cells in the largest of all n + 1 gaps.
    spread : ndarray
        p_n - p_1.
    boundary : ndarray
        Number of moves until both ends are found.
    coverage : ndarray
        Number of moves until every cell was visited and both ends are found.
    printed_coverage : ndarray
        The value of the papers' formula for the coverage.
    """

    line: Line
    first: Values = field(repr=False)
    last: Values = field(repr=False)
    largest_gap: Values = field(repr=False)
    spread: Values = field(repr=False)
    boundary: Values = field(repr=False)
    coverage: Values = field(repr=False)
    printed_coverage: Values = field(repr=False)

    @property
    def trials(self) -> int:
        """Number of placements."""
        return len(self.first)

    def standard_error(self, column: str) -> float:
        """Return the standard error of a column's mean, or 0 for a single trial."""
        values = getattr(self, column)
        return float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else 0.0


def sample(
    line: Line,
    trials: int = 1_000_000,
    *,
    seed: int = 0,
    workers: int | None = None,
    on_trials: Callable[[int], None] | None = None,
) -> LineSample:
    """Draw equally likely placements, and compute their numbers of moves.

    Parameters
    ----------
    line : Line
    trials : int
        Number of placements, at least 1.
    seed : int
        The same seed gives the same sample for any number of workers.
    workers : int, optional
        Number of threads. The default is one per processor.
    on_trials : callable, optional
        Function that is called with the number of finished trials.

    Returns
    -------
    LineSample

    Raises
    ------
    InvalidInputError
        If an argument is out of range, or the line is too long to draw placements.

    Notes
    -----
    Placements are drawn by Floyd's algorithm (Bentley and Floyd, "A sample of brilliance", 1987). If fewer cells are empty than
    occupied, the empty cells are drawn.

    Examples
    --------
    >>> found = sample(Line(20, 20), trials=3)
    >>> found.boundary.tolist(), found.coverage.tolist(), found.largest_gap.tolist()
    ([2, 2, 2], [2, 2, 2], [0, 0, 0])
    """
    trials = check_integer(trials, what="trials", least=1, most=MAX_TRIALS)
    seed = check_integer(seed, what="seed", least=0)
    workers = None if workers is None else check_integer(workers, what="workers", least=1)
    few = min(line.particles, line.cells - line.particles)
    for name, value, most in (("cells", line.cells, 2**31 - 1), ("particles, or empty cells", few, MAX_DRAWS)):
        if value > most:
            raise InvalidInputError(f"line: expected at most {most} {name} for Monte Carlo, got {value}")
    from shoal.swarm.kernels.theory import line_samples as kernels

    size = max(1, min(_DRAWS // max(1, few), _CELLS // line.cells))
    starts = range(0, trials, size)
    table = np.empty((trials, kernels.COLUMNS), dtype=np.int32)
    limits = np.arange(line.cells - few + 1, line.cells + 1)

    def measure(index: int) -> int:
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))
        part = table[starts[index] : starts[index] + size]
        draws = rng.integers(0, limits, size=(len(part), few), dtype=np.uint32)
        words = np.zeros(-(-line.cells // 64), dtype=np.uint64)
        kernels.trials(draws, line.cells, words, few != line.particles, part)
        return len(part)

    done = 0
    with ThreadPoolExecutor(workers or os.cpu_count()) as threads:
        try:
            for count in threads.map(measure, range(len(starts))):
                done += count
                if on_trials is not None:
                    on_trials(done)
        except BaseException:
            threads.shutdown(wait=False, cancel_futures=True)
            raise
    return LineSample(line, *(table[:, i] for i in range(len(fields(LineSample)) - 1)))
