"""Exact counting of particle placements on a line, with integers only.

A placement of n particles on m cells has n + 1 gaps, with m - n empty cells in total. Let a be the first gap, t the sum of the
first and the last gap, and g(1), ..., g(n-1) the inner gaps. Let M = max(t + 2, g(1), ..., g(n-1)), with the first inner gap
above 0 reduced by one cell. Full coverage takes a + 1 + M moves, or a + M moves if all inner gaps are 0. The function
`positions.coverage_moves` explains these numbers of moves.

M is at most g if t <= g - 2, the first inner gap above 0 is at most g + 1, and all other inner gaps are at most g. The first and
the last gap can divide their t empty cells in t + 1 ways. Generating functions turn the number of placements with M <= g into sums
of binomial coefficients. Let G = (1 - x^(g+1)) / (1 - x) be the generating function of one inner gap of at most g cells. Let T be
the sum of (t+1) x^t for t <= g - 2, which is the generating function of the first and the last gap together. Then the number of
placements with M <= g is the coefficient of x^(m-n) in T G^(n-1) + T x^(g+1) (1 + G + ... + G^(n-2)).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import accumulate
from math import comb


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
    """Return the list of signed binomial coefficients (-1)^j C(n, j), for j from 0 to min(n, ``at_most``)."""
    return [(-1) ** j * comb(n, j) for j in range(min(n, at_most) + 1)]


def placements_by_largest_gap(cells: int, particles: int) -> list[int]:
    """Return, for each g from 0 to cells - particles, how many placements have at most g cells in each gap, end gaps included."""
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
    # The result is the sum of a + 1 over all placements, plus the sum of M over all placements. The sum of M is the sum, over all g
    # from 0 on, of the number of placements with M > g.
    total = comb(cells + 1, particles + 1) + 2 * placements
    total += sum(placements - within(g) for g in range(2, empty + 2))
    return total - (empty + 1)  # each placement without empty cells in the inner gaps needs one move less


class CoverageCounts:
    """Counts the placements whose maximum M is at most g, for g >= 2. The module's docstring defines M."""

    def __init__(self, cells: int, particles: int) -> None:
        n = particles
        self.empty = cells - n
        self.signs = signed_binomials(n - 1, self.empty)
        self.with_ends = choose_all(cells, n)[n:]  # coefficients of 1 / (1-x)^(n+1)
        self.one_free = choose_all(cells, n - 1)[n - 1 :]  # of 1 / (1-x)^n
        self.inner = choose_all(cells, n - 2)[n - 2 :]  # of 1 / (1-x)^(n-1)

    def __call__(self, g: int) -> int:
        """Return the number of placements whose maximum M is at most g. The module's docstring defines M."""
        return self._all_below(g) + self._first_above(g)

    def printed(self, g: int, extra: int) -> int:
        """Return the number of placements for which the maximum in the formula of `printed_coverage_total` is at most g."""
        if g < extra:
            return 0
        return _truncated(lambda total: self._bounded(self.with_ends, total, g - extra + 1), self.empty, g - 1)

    def _bounded(self, series: list[int], total: int, step: int) -> int:
        """Return the coefficient of x^total in (1 - x^step)^(n-1) times the power series with the coefficients ``series``."""
        if total < 0:
            return 0
        return sum(sign * series[total - j * step] for j, sign in zip(range(total // step + 1), self.signs, strict=False))

    def _all_below(self, g: int) -> int:
        return _truncated(lambda total: self._bounded(self.with_ends, total, g + 1), self.empty, g - 2)

    def _first_above(self, g: int) -> int:
        """Return the coefficient of x^(m-n) in T x^(g+1) (1 + G + ... + G^(n-2)), with T and G from the module's docstring.

        The factor 1 + G + ... + G^(n-2) equals (G^(n-1) - 1) / (G - 1), where G - 1 = x (1 - x^g) / (1 - x). Dividing by 1 - x^g
        means summing every g-th coefficient of G^(n-1).
        """
        if self.empty < g:
            return 0
        return self._bounded(self.one_free, self.empty - g, g + 1) - 1 - g * self._every(g)

    def _every(self, g: int) -> int:
        """Return the sum of the coefficients of x^i in G^(n-1), for all positive i among m-n-2g+1, m-n-3g+1, ..."""
        top = self.empty - 2 * g + 1
        if top <= 0:
            return 0
        whole = 1 if top % g == 0 else 0  # i = 0 is excluded; its coefficient is 1
        return sum(sign * part for sign, part in zip(self.signs, self._sums(top, g), strict=False)) - whole

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
    """Return the sum, over all placements, of the papers' formula for the number of moves of full coverage.

    The papers' formula is a + 2 + max(t + 1, largest inner gap + ``extra``), where a is the first gap, and t is the sum of the
    first and the last gap. The maximum in the papers' formula is at most g if t <= g - 1 and all inner gaps are at most g -
    ``extra``.
    """
    empty, placements = cells - particles, comb(cells, particles)
    total = comb(cells + 1, particles + 1) + placements
    if particles == 1:
        return total + placements * max(empty + 1, extra)
    counts = CoverageCounts(cells, particles)
    return total + sum(placements - counts.printed(g, extra) for g in range(empty + 1 + extra))


def _truncated(coefficient: Callable[[int], int], total: int, most: int) -> int:
    """Return the coefficient of x^total in the product of a power series F and the sum of (t+1) x^t for t from 0 to ``most``.

    ``coefficient(k)`` is the coefficient of x^k in F / (1-x)^2.
    """
    if most < 0:
        return 0
    return coefficient(total) - (most + 2) * coefficient(total - most - 1) + (most + 1) * coefficient(total - most - 2)
