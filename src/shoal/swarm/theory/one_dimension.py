"""Theory in one dimension: n particles on a line of m cells obey one shared command.

The particles move to the left until they find the left end of the line, and then to the right.

The package contains exact values, Monte Carlo estimates, and the formulas printed in paper M,
section III.A, with errata.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import field, fields
from fractions import Fraction
from functools import cached_property
from itertools import accumulate, pairwise
from math import comb

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_function, check_integer
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.version import count_processors

__all__ = [
    "Distribution",
    "Line",
    "LineSample",
    "Mean",
    "boundary_moves",
    "coverage_moves",
    "sample",
]


def check_positions(positions: ArrayLike, cells: int) -> NDArray[np.int64]:
    """Return the positions of n particles on a line as an int64 array of shape (..., n).

    Raises
    ------
    InvalidInputError
        Raised if the positions are not strictly increasing whole numbers from 1 to ``cells``.
    """
    values = np.asarray(positions)
    if values.ndim < 1 or values.shape[-1] < 1 or not np.issubdtype(values.dtype, np.integer):
        raise InvalidInputError(
            f"positions: expected whole numbers, at least one per line, got {values.dtype} of shape"
            f" {values.shape}"
        )
    array = values.astype(np.int64)
    if array.size and not 1 <= int(array.min()) <= int(array.max()) <= cells:
        raise InvalidInputError(
            f"positions: expected 1 to {cells}, got {array.min()} to {array.max()}"
        )
    if (np.diff(array, axis=-1) <= 0).any():
        where = np.argwhere(np.diff(array, axis=-1) <= 0)[0]
        pair = array[(*where[:-1], slice(where[-1], where[-1] + 2))]
        raise InvalidInputError(
            f"positions: expected each larger than the one before, got {pair[0]} and then {pair[1]}"
        )
    return array


def boundary_moves(positions: ArrayLike, *, cells: int) -> NDArray[np.int64]:
    """Return the number of moves until the particles have found both ends of the line. The
    particles first move to the left.

    For particles at sorted positions p_1 to p_n, the number of moves is ``2 p_1 + cells - p_n +
    1``. If the particles have no gaps between them, the number of moves is one less, because no
    particle moves in the last move to the left.

    Parameters
    ----------
    positions : array_like of int, shape (..., n)
        Positions of the n particles, from 1 to ``cells``, in increasing order along the last axis.
    cells : int

    Returns
    -------
    ndarray of int64, shape (...)

    Raises
    ------
    InvalidInputError
        Raised if the positions are not strictly increasing whole numbers from 1 to ``cells``.

    Notes
    -----
    Source: paper M, section III.A.2. The last term of equation 2 in paper M accounts for particles
    without gaps between them.

    Examples
    --------
    >>> boundary_moves([[3, 5], [3, 4]], cells=6).tolist()
    [8, 8]
    """
    p = check_positions(positions, cells)
    first, last = p[..., 0], p[..., -1]
    return np.asarray(2 * first + cells - last + 1 - (last - first == p.shape[-1] - 1))


def coverage_moves(positions: ArrayLike, *, cells: int) -> NDArray[np.int64]:
    """Return the number of moves until the particles, moving first to the left, have visited every
    cell and found both ends.

    The number of moves to the left equals the position p_1 of the first particle. Particle number i
    at the position p_i moves ``min(p_1, p_i - i)`` cells to the left. On the way to the right, the
    last particle needs one move more than the number of cells to its right. Each particle except
    the last needs one move to the right for each cell of the gap to the next particle. The total
    number of moves is p_1 plus the largest number of moves that a particle needs to the right.

    Parameters
    ----------
    positions : array_like of int, shape (..., n)
        Positions of the n particles, from 1 to ``cells``, in increasing order along the last axis.
    cells : int

    Returns
    -------
    ndarray of int64, shape (...)

    Raises
    ------
    InvalidInputError
        Raised if the positions are not strictly increasing whole numbers from 1 to ``cells``.

    Notes
    -----
    The formula for full coverage corrects paper M, section III.A.2. Paper M ignores that the moves
    to the left have already reduced one gap.

    Examples
    --------
    >>> coverage_moves([2, 9], cells=10).tolist()
    7
    """
    p = check_positions(positions, cells)
    left = np.minimum(p[..., :1], p - np.arange(1, p.shape[-1] + 1))
    most = cells - (p[..., -1] - left[..., -1]) + 1
    if p.shape[-1] > 1:
        most = np.maximum(most, (np.diff(p) - 1 - np.diff(left)).max(axis=-1))
    return np.asarray(p[..., 0] + most)


def choose_all(upto: int, k: int) -> list[int]:
    """Return the list of binomial coefficients C(0, k), ..., C(upto, k).

    Examples
    --------
    >>> choose_all(5, 2)
    [0, 0, 1, 3, 6, 10]
    """
    if k < 0:
        return [0] * (upto + 1)
    row = [0] * min(k, upto + 1)
    value = 1
    for i in range(k, upto + 1):
        row.append(value)
        value = value * (i + 1) // (i + 1 - k)
    return row


def signed_binomials(n: int, at_most: int) -> list[int]:
    """Return the list of signed binomial coefficients (-1)^j C(n, j), for j from 0 to min(n,
    ``at_most``).
    """
    return [(-1) ** j * comb(n, j) for j in range(min(n, at_most) + 1)]


def placements_by_largest_gap(cells: int, particles: int) -> list[int]:
    """Return, for each g from 0 to cells - particles, how many placements have at most g cells in
    each gap, end gaps included.
    """
    placements, signs = choose_all(cells, particles), signed_binomials(particles + 1, cells)
    counts = []
    for g in range(cells - particles + 1):
        terms = min(particles + 1, cells // (g + 1))
        counts.append(sum(signs[j] * placements[cells - j * (g + 1)] for j in range(terms + 1)))
    return counts


def coverage_total(cells: int, particles: int) -> int:
    """Return the sum, over all placements, of the number of moves of full coverage."""
    if particles == 1:
        return cells * (3 * cells + 1) // 2
    empty = cells - particles
    placements = comb(cells, particles)
    within = CoverageCounts(cells, particles)
    # The result is the sum of a + 1 over all placements, plus the sum of M over all placements. The
    # sum of M is the sum, over all g from 0 on, of the number of placements with M > g.
    total = comb(cells + 1, particles + 1) + 2 * placements
    total += sum(placements - within(g) for g in range(2, empty + 2))
    # each placement without empty cells in the inner gaps needs one move less
    return total - (empty + 1)


class CoverageCounts:
    """Counts the placements whose maximum M is at most g, for g >= 2. The module's docstring
    defines M.
    """

    def __init__(self, cells: int, particles: int) -> None:
        n = particles
        self.empty = cells - n
        self.signs = signed_binomials(n - 1, self.empty)
        self.with_ends = choose_all(cells, n)[n:]  # coefficients of 1 / (1-x)^(n+1)
        self.one_free = choose_all(cells, n - 1)[n - 1 :]  # of 1 / (1-x)^n
        self.inner = choose_all(cells, n - 2)[n - 2 :]  # of 1 / (1-x)^(n-1)

    def __call__(self, g: int) -> int:
        """Return the number of placements whose maximum M is at most g. The module's docstring
        defines M.
        """
        return self._all_below(g) + self._first_above(g)

    def printed(self, g: int, extra: int) -> int:
        """Return the number of placements for which the maximum in the formula of
        `printed_coverage_total` is at most g.
        """
        if g < extra:
            return 0
        return _truncate(
            lambda total: self._bounded(self.with_ends, total, g - extra + 1), self.empty, g - 1
        )

    def _bounded(self, series: list[int], total: int, step: int) -> int:
        """Return the coefficient of x^total in (1 - x^step)^(n-1) times the power series with the
        coefficients ``series``.
        """
        if total < 0:
            return 0
        return sum(
            sign * series[total - j * step]
            for j, sign in zip(range(total // step + 1), self.signs, strict=False)
        )

    def _all_below(self, g: int) -> int:
        return _truncate(
            lambda total: self._bounded(self.with_ends, total, g + 1), self.empty, g - 2
        )

    def _first_above(self, g: int) -> int:
        """Return the coefficient of x^(m-n) in T x^(g+1) (1 + G + ... + G^(n-2)), with T and G from
        the module's docstring.

        The factor 1 + G + ... + G^(n-2) equals (G^(n-1) - 1) / (G - 1), where G - 1 = x (1 - x^g) /
        (1 - x). Dividing by 1 - x^g means summing every g-th coefficient of G^(n-1).
        """
        if self.empty < g:
            return 0
        return self._bounded(self.one_free, self.empty - g, g + 1) - 1 - g * self._every(g)

    def _every(self, g: int) -> int:
        """Return the sum of the coefficients of x^i in G^(n-1), for all positive i among m-n-2g+1,
        m-n-3g+1, ...
        """
        top = self.empty - 2 * g + 1
        if top <= 0:
            return 0
        constant = 1 if top % g == 0 else 0  # i = 0 is excluded; its coefficient is 1
        return (
            sum(sign * term for sign, term in zip(self.signs, self._sums(top, g), strict=False))
            - constant
        )

    def _sums(self, top: int, g: int) -> Iterator[int]:
        """Yield the sum of every g-th coefficient of 1 / (1-x)^(n-1), downwards from x^top.

        Then yield the sums downwards from x^(top - (g+1)), from x^(top - 2(g+1)), and so on.
        """
        starts = range(top, -1, -(g + 1))
        if g * g > top:
            yield from (sum(self.inner[start::-g]) for start in starts)
            return
        sums = self.inner[: top + 1]
        for residue in range(g):
            sums[residue::g] = accumulate(sums[residue::g])
        yield from (sums[start] for start in starts)


def printed_coverage_total(cells: int, particles: int, *, extra: int = 0) -> int:
    """Return the sum, over all placements, of the papers' formula for the number of moves of full
    coverage.

    The papers' formula is a + 2 + max(t + 1, largest inner gap + ``extra``), where a is the first
    gap, and t is the sum of the first and the last gap. The maximum in the papers' formula is at
    most g if t <= g - 1 and all inner gaps are at most g - ``extra``.
    """
    empty, placements = cells - particles, comb(cells, particles)
    total = comb(cells + 1, particles + 1) + placements
    if particles == 1:
        return total + placements * max(empty + 1, extra)
    counts = CoverageCounts(cells, particles)
    return total + sum(placements - counts.printed(g, extra) for g in range(empty + 1 + extra))


def _truncate(coefficient: Callable[[int], int], total: int, most: int) -> int:
    """Return the coefficient of x^total in the product of a power series F and the sum of (t+1) x^t
    for t from 0 to ``most``.

    ``coefficient(k)`` is the coefficient of x^k in F / (1-x)^2.
    """
    if most < 0:
        return 0
    return (
        coefficient(total)
        - (most + 2) * coefficient(total - most - 1)
        + (most + 1) * coefficient(total - most - 2)
    )


MAX_CELLS = 2**53  # floats represent all whole numbers up to this number exactly

# above this number of particles and of empty cells, the term with C(m, n) is smaller than rounding
# errors
_COUNTED = 1000


@dataclass(frozen=True)
class Mean:
    """An expected value in two versions: the exact value, and the value of the formula printed in a
    paper.

    Parameters
    ----------
    exact : Fraction
    printed : Fraction
        Value of the formula printed in a paper.
    """

    exact: Fraction
    printed: Fraction

    @property
    def difference(self) -> Fraction:
        """The value of the printed formula minus the exact value."""
        return self.printed - self.exact

    def __float__(self) -> float:
        return float(self.exact)


@dataclass(frozen=True)
class Distribution:
    """Number of placements for each value of a quantity, over all equally likely placements.

    Parameters
    ----------
    first : int
        The smallest value of the quantity.
    counts : tuple of int
        Number of placements with each value of the quantity, for the values first, first + 1, first
        + 2, and so on.
    """

    first: int
    counts: tuple[int, ...]

    @property
    def total(self) -> int:
        """Number of all placements."""
        return sum(self.counts)

    @property
    def mean(self) -> Fraction:
        """Exact expected value of the quantity."""
        return Fraction(
            sum((self.first + i) * count for i, count in enumerate(self.counts)), self.total
        )

    @property
    def values(self) -> NDArray[np.int64]:
        """All values of the quantity, in increasing order (int64)."""
        return np.arange(self.first, self.first + len(self.counts))

    @property
    def probabilities(self) -> NDArray[np.float64]:
        """Probability of each value in `values` (float64)."""
        total = self.total
        # Python rounds the quotient of integers of any size correctly
        return np.array([count / total for count in self.counts])


@dataclass(frozen=True)
class Line:
    """n particles on a line of m cells, with all placements equally likely.

    The particles move to the left until they find the left end of the line, and then to the right.

    Parameters
    ----------
    cells : int
        Number m of cells on the line, from 1 to `MAX_CELLS`.
    particles : int
        Number n of particles, from 1 to the number of cells.

    Raises
    ------
    InvalidInputError
        Raised if the number of cells or particles is out of range.

    Notes
    -----
    Source: paper M, section III.A. The number of placements of n particles on m cells is the
    binomial coefficient C(m, n). For the number of placements, paper M wrongly prints C(m-n, n+1).

    Examples
    --------
    >>> line = Line(1000, 100)
    >>> float(line.boundary.exact), round(float(line.coverage.exact), 2)
    (29.73267326732673, 58.74)
    >>> Line(1, 1).boundary.exact
    Fraction(2, 1)
    """

    cells: int
    particles: int

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "cells", check_integer(self.cells, what="cells", least=1, most=MAX_CELLS)
        )
        object.__setattr__(
            self,
            "particles",
            check_integer(self.particles, what="particles", least=1, most=self.cells),
        )

    @property
    def placements(self) -> int:
        """Number of placements of n particles on m cells: the binomial coefficient C(m, n)."""
        return comb(self.cells, self.particles)

    @property
    def boundary(self) -> Mean:
        """Expected number of moves until the particles have found both ends of the line.

        For n particles on m cells, the exact expected value is 3(1+m)/(1+n) - (m-n+1)/C(m,n), as in
        equation 2 of paper M. The printed value comes from equation 2 of paper D, which omits the
        term (m-n+1)/C(m,n).
        """
        m, n = self.cells, self.particles
        printed = Fraction(3 * (1 + m), 1 + n)
        return Mean(printed - Fraction(m - n + 1, self.placements), printed)

    @property
    def boundary_float(self) -> float:
        """The exact expected value in `boundary` as a float, for lines of any length.

        If n and m - n both exceed 1000, the term (m-n+1)/C(m,n) is smaller than rounding errors,
        and the computation omits it.
        """
        m, n = self.cells, self.particles
        clumps = Fraction(m - n + 1, comb(m, n)) if min(n, m - n) <= _COUNTED else 0
        return float(Fraction(3 * (1 + m), 1 + n) - clumps)

    @cached_property
    def coverage(self) -> Mean:
        """Expected number of moves until the particles have visited every cell and found both ends
        of the line.

        The printed value comes from the papers' formula for full coverage. For a line of m cells,
        the computation needs about m sqrt(m) operations on integers of up to m bits. The
        computation takes a millisecond for 100 cells, and up to half a minute for 10,000 cells.
        """
        return Mean(
            Fraction(coverage_total(self.cells, self.particles), self.placements),
            Fraction(printed_coverage_total(self.cells, self.particles), self.placements),
        )

    @cached_property
    def published_coverage(self) -> Fraction:
        """Expected number of moves for full coverage, according to the published curve.

        The published curve has two errors. The first error is the error of the printed formula. The
        second error is that inner gaps are one cell too long, because the papers measure a gap as a
        difference of positions. If particles fill all cells at the start, the curve gives 2 moves,
        which is correct. Source: paper M, figure 7, 1-D curve.
        """
        if self.particles == self.cells:
            return Fraction(2)
        return Fraction(
            printed_coverage_total(self.cells, self.particles, extra=1), self.placements
        )

    @cached_property
    def largest_gap(self) -> Mean:
        """Expected number of empty cells in the largest of all n + 1 gaps, end gaps included.

        The printed value is one cell larger than the exact value, because the papers measure a gap
        as a difference of positions.
        """
        exact = self.largest_gap_distribution.mean
        return Mean(exact, exact + 1)

    @property
    def largest_gap_law(self) -> float:
        """Asymptotic mean of the largest gap, in empty cells: the mean gap times a harmonic number,
        (m - n) / (n + 1) · (1 + 1/2 + ... + 1/(n + 1)).

        All ways to distribute the empty cells over the gaps are equally likely. As m grows, the
        gaps become those of uniform points on a segment, whose largest has this mean.
        """
        from scipy.special import digamma

        mean = (self.cells - self.particles) / (self.particles + 1)
        # 1 + 1/2 + ... + 1/k is digamma(k + 1) + gamma, also for millions of particles
        return mean * float(digamma(self.particles + 2) + np.euler_gamma)

    @property
    def printed_largest_gap_law(self) -> float:
        """Asymptotic mean of the largest gap by the papers, with the factor 1 of the root: g + sqrt(g
        log(n + 1)) with the mean gap g = (m - n) / (n + 1).

        The papers take it from balls that are thrown into bins one by one. No factor of the root
        fits the gaps of particles for all m.
        """
        mean = (self.cells - self.particles) / (self.particles + 1)
        return float(mean + np.sqrt(mean * np.log(self.particles + 1)))

    @cached_property
    def largest_gap_distribution(self) -> Distribution:
        """Distribution of the number of empty cells in the largest of all n + 1 gaps, end gaps
        included.

        For n particles on m cells, P(largest gap <= g) = sum over j of (-1)^j C(n+1, j) C(m -
        j(g+1), n) / C(m, n).
        """
        up_to = placements_by_largest_gap(self.cells, self.particles)
        return Distribution(0, (up_to[0], *(more - fewer for fewer, more in pairwise(up_to))))

    @property
    def first_distribution(self) -> Distribution:
        """Distribution of the position of the first particle.

        The position of the first particle is also the number of moves to the left until the
        particle finds the left end of the line. By symmetry, the number of moves to the right until
        the last particle finds the right end has the same distribution.
        """
        m, n = self.cells, self.particles
        return Distribution(1, tuple(comb(m - k, n - 1) for k in range(1, m - n + 2)))

    @property
    def spread_distribution(self) -> Distribution:
        """Distribution of the position of the last particle minus the position of the first
        particle.
        """
        m, n = self.cells, self.particles
        if n == 1:
            return Distribution(0, (m,))
        return Distribution(n - 1, tuple((m - d) * comb(d - 1, n - 2) for d in range(n - 1, m)))

    @property
    def boundary_distribution(self) -> Distribution:
        """Distribution of the number of moves until the particles have found both ends
        of the line.
        """
        m, n = self.cells, self.particles
        free = m - n
        if n == 1:
            return Distribution(m + 1, (1,) * m)
        # The number of moves is 3 + 2a + b, with a cells before the first particle and b cells
        # after the last particle. The other n - 2 particles lie in the m - 2 - a - b cells between
        # these two particles.
        counts = [0] * (2 * free + 2)
        for moves in range(2 * free + 1):
            most = min(moves // 2, free)
            counts[moves + 1] = comb(m - 1 - moves + most, n - 1) - (
                comb(m - 2 - moves, n - 1) if moves <= m - 2 else 0
            )
        # a placement without gaps between the particles needs one move less
        for a in range(free + 1):
            counts[a + free + 1] -= 1
            counts[a + free] += 1
        low = next(i for i, count in enumerate(counts) if count)
        high = max(i for i, count in enumerate(counts) if count)
        return Distribution(2 + low, tuple(counts[low : high + 1]))


# maximum random numbers and cells per block of placements; both affect the samples
_DRAWS, _CELLS = 2**21, 2**28
MAX_TRIALS = 100_000_000  # placements of 28 bytes each
MAX_DRAWS = 10_000_000  # maximum number of random numbers for one placement

Values = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class LineSample:
    """Random placements of n particles on a line of m cells, with their numbers of moves. All
    arrays are int32, of shape (trials,).

    Parameters
    ----------
    line : Line
    first : ndarray
        Position of the first particle. A first particle at position p finds the left end of the
        line after p moves to the left.
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
        """Return the standard error of the mean of one array, such as ``boundary``. For a single
        trial, return 0.
        """
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
    """Draw equally likely placements of particles on a line, and compute how many moves the task
    takes from each placement.

    Parameters
    ----------
    line : Line
    trials : int
        Number of placements to draw, at least 1.
    seed : int
        Seed of the random numbers. For any number of worker threads, equal seeds give equal
        samples.
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
    Floyd's algorithm draws the placements (Bentley and Floyd, "A sample of brilliance", 1987). If
    the line has fewer empty cells than particles, the algorithm draws the empty cells.

    Examples
    --------
    >>> found = sample(Line(20, 20), trials=3)
    >>> found.boundary.tolist(), found.coverage.tolist(), found.largest_gap.tolist()
    ([2, 2, 2], [2, 2, 2], [0, 0, 0])
    """
    check_function(on_trials, what="on_trials")
    trials = check_integer(trials, what="trials", least=1, most=MAX_TRIALS)
    seed = check_integer(seed, what="seed", least=0)
    workers = None if workers is None else check_integer(workers, what="workers", least=1)
    few = min(line.particles, line.cells - line.particles)
    for name, value, most in (
        ("cells", line.cells, 2**31 - 1),
        ("particles, or empty cells", few, MAX_DRAWS),
    ):
        if value > most:
            raise InvalidInputError(
                f"line: expected at most {most} {name} for Monte Carlo, got {value}"
            )
    from shoal.swarm.kernels import theory as kernels

    size = max(1, min(_DRAWS // max(1, few), _CELLS // line.cells))
    starts = range(0, trials, size)
    table = np.empty((trials, kernels.COLUMNS), dtype=np.int32)
    limits = np.arange(line.cells - few + 1, line.cells + 1)

    def measure(index: int) -> int:
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))
        rows = table[starts[index] : starts[index] + size]
        draws = rng.integers(0, limits, size=(len(rows), few), dtype=np.uint32)
        words = np.zeros(-(-line.cells // 64), dtype=np.uint64)
        kernels.trials(draws, line.cells, words, few != line.particles, rows)
        return len(rows)

    completed = 0
    with ThreadPoolExecutor(workers or count_processors()) as threads:
        try:
            for count in threads.map(measure, range(len(starts))):
                completed += count
                if on_trials is not None:
                    on_trials(completed)
        except BaseException:
            threads.shutdown(wait=False, cancel_futures=True)
            raise
    return LineSample(line, *(table[:, i] for i in range(len(fields(LineSample)) - 1)))
