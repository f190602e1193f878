"""Exact expected values and distributions, as fractions, for particles on a line."""

from __future__ import annotations

from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from math import comb

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_integer
from shoal.core.dataclass import dataclass
from shoal.swarm.theory.one_dimension import counting

MAX_CELLS = 2**53  # floats represent all whole numbers up to this number exactly

_COUNTED = 1000  # above this number of particles and of empty cells, the term with C(m, n) is smaller than rounding errors


@dataclass(frozen=True)
class Mean:
    """An expected value in two versions: the exact value, and the value of the formula printed in a paper.

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
        Number of placements with each value of the quantity, for the values first, first + 1, first + 2, and so on.
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
        return Fraction(sum((self.first + i) * count for i, count in enumerate(self.counts)), self.total)

    @property
    def values(self) -> NDArray[np.int64]:
        """All values of the quantity, in increasing order (int64)."""
        return np.arange(self.first, self.first + len(self.counts))

    @property
    def probabilities(self) -> NDArray[np.float64]:
        """Probability of each value in `values` (float64)."""
        total = self.total
        return np.array([count / total for count in self.counts])  # Python rounds the quotient of integers of any size correctly


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
    Source: paper M, section III.A. The number of placements of n particles on m cells is the binomial coefficient C(m, n). For the
    number of placements, paper M wrongly prints C(m-n, n+1).

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
        object.__setattr__(self, "cells", check_integer(self.cells, what="cells", least=1, most=MAX_CELLS))
        object.__setattr__(self, "particles", check_integer(self.particles, what="particles", least=1, most=self.cells))

    @property
    def placements(self) -> int:
        """Number of placements of n particles on m cells: the binomial coefficient C(m, n)."""
        return comb(self.cells, self.particles)

    @property
    def boundary(self) -> Mean:
        """Expected number of moves until the particles have found both ends of the line.

        For n particles on m cells, the exact expected value is 3(1+m)/(1+n) - (m-n+1)/C(m,n), as in equation 2 of paper M. The
        printed value comes from equation 2 of paper D, which omits the term (m-n+1)/C(m,n).
        """
        m, n = self.cells, self.particles
        printed = Fraction(3 * (1 + m), 1 + n)
        return Mean(printed - Fraction(m - n + 1, self.placements), printed)

    @property
    def boundary_float(self) -> float:
        """The exact expected value in `boundary` as a float, for lines of any length.

        If n and m - n both exceed 1000, the term (m-n+1)/C(m,n) is smaller than rounding errors, and the computation omits it.
        """
        m, n = self.cells, self.particles
        clumps = Fraction(m - n + 1, comb(m, n)) if min(n, m - n) <= _COUNTED else 0
        return float(Fraction(3 * (1 + m), 1 + n) - clumps)

    @cached_property
    def coverage(self) -> Mean:
        """Expected number of moves until the particles have visited every cell and found both ends of the line.

        The printed value comes from the papers' formula for full coverage. For a line of m cells, the computation needs about m
        sqrt(m) operations on integers of up to m bits. The computation takes a millisecond for 100 cells, and up to half a minute
        for 10,000 cells.
        """
        return Mean(
            Fraction(counting.coverage_total(self.cells, self.particles), self.placements),
            Fraction(counting.printed_coverage_total(self.cells, self.particles), self.placements),
        )

    @cached_property
    def published_coverage(self) -> Fraction:
        """Expected number of moves for full coverage, according to the published curve.

        The published curve has two errors. The first error is the error of the printed formula. The second error is that inner gaps
        are one cell too long, because the papers measure a gap as a difference of positions. If particles fill all cells at the
        start, the curve gives 2 moves, which is correct. Source: paper M, figure 7, 1-D curve.
        """
        if self.particles == self.cells:
            return Fraction(2)
        return Fraction(counting.printed_coverage_total(self.cells, self.particles, extra=1), self.placements)

    @cached_property
    def largest_gap(self) -> Mean:
        """Expected number of empty cells in the largest of all n + 1 gaps, end gaps included.

        The printed value is one cell larger than the exact value, because the papers measure a gap as a difference of positions.
        """
        exact = self.largest_gap_distribution.mean
        return Mean(exact, exact + 1)

    @cached_property
    def largest_gap_distribution(self) -> Distribution:
        """Distribution of the number of empty cells in the largest of all n + 1 gaps, end gaps included.

        For n particles on m cells, P(largest gap <= g) = sum over j of (-1)^j C(n+1, j) C(m - j(g+1), n) / C(m, n).
        """
        up_to = counting.placements_by_largest_gap(self.cells, self.particles)
        return Distribution(0, (up_to[0], *(more - fewer for fewer, more in pairwise(up_to))))

    @property
    def first_distribution(self) -> Distribution:
        """Distribution of the position of the first particle.

        The position of the first particle is also the number of moves to the left until the particle finds the left end of the
        line. By symmetry, the number of moves to the right until the last particle finds the right end has the same distribution.
        """
        m, n = self.cells, self.particles
        return Distribution(1, tuple(comb(m - k, n - 1) for k in range(1, m - n + 2)))

    @property
    def spread_distribution(self) -> Distribution:
        """Distribution of the position of the last particle minus the position of the first particle."""
        m, n = self.cells, self.particles
        if n == 1:
            return Distribution(0, (m,))
        return Distribution(n - 1, tuple((m - d) * comb(d - 1, n - 2) for d in range(n - 1, m)))

    @property
    def boundary_distribution(self) -> Distribution:
        """Distribution of the number of moves until the particles have found both ends of the line."""
        m, n = self.cells, self.particles
        free = m - n
        if n == 1:
            return Distribution(m + 1, (1,) * m)
        # The number of moves is 3 + 2a + b, with a cells before the first particle and b cells after the last particle. The other
        # n - 2 particles lie in the m - 2 - a - b cells between these two particles.
        counts = [0] * (2 * free + 2)
        for moves in range(2 * free + 1):
            most = min(moves // 2, free)
            counts[moves + 1] = comb(m - 1 - moves + most, n - 1) - (comb(m - 2 - moves, n - 1) if moves <= m - 2 else 0)
        for a in range(free + 1):  # a placement without gaps between the particles needs one move less
            counts[a + free + 1] -= 1
            counts[a + free] += 1
        low = next(i for i, count in enumerate(counts) if count)
        high = max(i for i, count in enumerate(counts) if count)
        return Distribution(2 + low, tuple(counts[low : high + 1]))
