"""Exact expectations and distributions on a line, as fractions."""

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

_COUNTED = 1000  # particles, or empty cells, from which on C(m, n) has thousands of digits


@dataclass(frozen=True)
class Mean:
    """An expected value: exact, and as a paper's formula gives it.

    Parameters
    ----------
    exact : Fraction
    printed : Fraction
        What the papers' formula gives, or counts.
    """

    exact: Fraction
    printed: Fraction

    @property
    def difference(self) -> Fraction:
        """Printed less exact."""
        return self.printed - self.exact

    def __float__(self) -> float:
        return float(self.exact)


@dataclass(frozen=True)
class Distribution:
    """How often each value occurs among all equally likely placements.

    Parameters
    ----------
    first : int
        The smallest value listed.
    counts : tuple of int
        Placements with the values first, first + 1, ...; exact.
    """

    first: int
    counts: tuple[int, ...]

    @property
    def total(self) -> int:
        """Number of placements."""
        return sum(self.counts)

    @property
    def mean(self) -> Fraction:
        """Expected value, exact."""
        return Fraction(sum((self.first + i) * count for i, count in enumerate(self.counts)), self.total)

    @property
    def values(self) -> NDArray[np.int64]:
        """The values; int64."""
        return np.arange(self.first, self.first + len(self.counts))

    @property
    def probabilities(self) -> NDArray[np.float64]:
        """Probability of each of `values`; float64."""
        total = self.total
        return np.array([count / total for count in self.counts])  # Python divides integers of any size correctly rounded


@dataclass(frozen=True)
class Line:
    """n particles in m cells in a row, all placements equally likely; commands go left first, then right.

    Parameters
    ----------
    cells : int
        m, 1 or more.
    particles : int
        n, 1 to m.

    Raises
    ------
    InvalidInputError
        For other numbers.

    Notes
    -----
    Source: paper M, section III.A. There are C(m, n) placements, not C(m-n, n+1) as printed.

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
        object.__setattr__(self, "cells", check_integer(self.cells, what="cells", least=1))
        object.__setattr__(self, "particles", check_integer(self.particles, what="particles", least=1, most=self.cells))

    @property
    def placements(self) -> int:
        """How many there are: C(m, n)."""
        return comb(self.cells, self.particles)

    @property
    def boundary(self) -> Mean:
        """Moves until both ends are found.

        Exact: 3(1+m)/(1+n) - (m-n+1)/C(m,n), paper M, eq. 2. Printed: paper D, eq. 2, without the last term, the clumps.
        """
        m, n = self.cells, self.particles
        printed = Fraction(3 * (1 + m), 1 + n)
        return Mean(printed - Fraction(m - n + 1, self.placements), printed)

    @property
    def boundary_float(self) -> float:
        """The exact mean of `boundary` as a float, for lines of any length: the clumps of large swarms are below its last digit."""
        m, n = self.cells, self.particles
        clumps = Fraction(m - n + 1, comb(m, n)) if min(n, m - n) <= _COUNTED else 0
        return float(Fraction(3 * (1 + m), 1 + n) - clumps)

    @cached_property
    def coverage(self) -> Mean:
        """Moves until every cell has been visited and both ends are found; printed: the papers' formula.

        The work grows with m sqrt(m), in integers of up to m bits: a millisecond for m = 100, up to half a minute for m = 10,000.
        """
        return Mean(
            Fraction(counting.coverage_total(self.cells, self.particles), self.placements),
            Fraction(counting.printed_coverage_total(self.cells, self.particles), self.placements),
        )

    @cached_property
    def published_coverage(self) -> Fraction:
        """What the published curve of full coverage shows: the papers' formula with a gap counted as difference of positions.

        That is one cell too many a second time. Source: paper M, Fig. 7 (its 1-D curve); where particles fill all cells the
        curve has 2 moves, as is right.
        """
        if self.particles == self.cells:
            return Fraction(2)
        return Fraction(counting.printed_coverage_total(self.cells, self.particles, extra=1), self.placements)

    @cached_property
    def largest_gap(self) -> Mean:
        """Empty cells in the largest of all n + 1 gaps; printed: one more, as the papers take differences of positions."""
        exact = self.largest_gap_distribution.mean
        return Mean(exact, exact + 1)

    @cached_property
    def largest_gap_distribution(self) -> Distribution:
        """Of the largest of all n + 1 gaps, in empty cells.

        P(largest <= g) = sum over j of (-1)^j C(n+1, j) C(m - j(g+1), n) / C(m, n).
        """
        up_to = counting.placements_by_largest_gap(self.cells, self.particles)
        return Distribution(0, (up_to[0], *(more - fewer for fewer, more in pairwise(up_to))))

    @property
    def first_distribution(self) -> Distribution:
        """Of p_1, the position of the first particle: the moves left that find the wall. That of m + 1 - p_n is the same."""
        m, n = self.cells, self.particles
        return Distribution(1, tuple(comb(m - k, n - 1) for k in range(1, m - n + 2)))

    @property
    def spread_distribution(self) -> Distribution:
        """Of p_n - p_1."""
        m, n = self.cells, self.particles
        if n == 1:
            return Distribution(0, (m,))
        return Distribution(n - 1, tuple((m - d) * comb(d - 1, n - 2) for d in range(n - 1, m)))

    @property
    def boundary_distribution(self) -> Distribution:
        """Of the moves until both ends are found."""
        m, n = self.cells, self.particles
        free = m - n
        if n == 1:
            return Distribution(m + 1, (1,) * m)
        # 3 + 2a + b moves with a cells before the first particle and b after the last; the others lie in the m - 2 - a - b between.
        counts = [0] * (2 * free + 2)
        for moves in range(2 * free + 1):
            most = min(moves // 2, free)
            counts[moves + 1] = comb(m - 1 - moves + most, n - 1) - (comb(m - 2 - moves, n - 1) if moves <= m - 2 else 0)
        for a in range(free + 1):  # a clump takes one move less
            counts[a + free + 1] -= 1
            counts[a + free] += 1
        low = next(i for i, count in enumerate(counts) if count)
        high = max(i for i, count in enumerate(counts) if count)
        return Distribution(2 + low, tuple(counts[low : high + 1]))
