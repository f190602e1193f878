"""Monte Carlo simulation on a line: draw random placements of particles, and count the moves that a task takes from each."""

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

_DRAWS, _CELLS = 2**21, 2**28  # maximum random numbers and cells per block of placements; both affect the samples
MAX_TRIALS = 100_000_000  # placements of 28 bytes each
MAX_DRAWS = 10_000_000  # maximum number of random numbers for one placement

Values = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class LineSample:
    """Random placements of n particles on a line of m cells, with their numbers of moves. All arrays are int32, of shape (trials,).

    Parameters
    ----------
    line : Line
    first : ndarray
        Position of the first particle. A first particle at position p finds the left end of the line after p moves to the left.
    last : ndarray
        Number of moves to the right after which the last particle finds the right end of the line.
    largest_gap : ndarray
        Number of empty cells in the largest of all n + 1 gaps, end gaps included.
    spread : ndarray
        Position of the last particle minus the position of the first particle, in cells.
    boundary : ndarray
        Number of moves until the particles have found both ends of the line.
    coverage : ndarray
        Number of moves until the particles have visited every cell and found both ends of the line.
    printed_coverage : ndarray
        Number of moves for full coverage according to the formula printed in the papers.
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
        """Number of random placements in the sample."""
        return len(self.first)

    def standard_error(self, column: str) -> float:
        """Return the standard error of the mean of one array, such as ``boundary``. For a single trial, return 0."""
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
    """Draw equally likely placements of particles on a line, and compute how many moves the task takes from each placement.

    Parameters
    ----------
    line : Line
    trials : int
        Number of placements to draw, at least 1.
    seed : int
        Seed of the random numbers. For any number of worker threads, equal seeds give equal samples.
    workers : int, optional
        Number of worker threads. The default is one thread per processor.
    on_trials : callable, optional
        Function that `sample` calls during the computation, with the number of finished trials.

    Returns
    -------
    LineSample

    Raises
    ------
    InvalidInputError
        Raised if an argument is out of range, or if the line is too long for random placements.

    Notes
    -----
    Floyd's algorithm draws the placements (Bentley and Floyd, "A sample of brilliance", 1987). If the line has fewer empty cells
    than particles, the algorithm draws the empty cells.

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
