"""Errata of papers M and D about one dimension: section III.A and figures 5 and 6."""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations
from math import comb

import numpy as np

from shoal.papers.recipe import published_curve

from .checking import Check, into

CHECKS: list[Check] = []
erratum = into(CHECKS)


def _placements(cells: int, particles: int) -> list[tuple[int, ...]]:
    return [*combinations(range(1, cells + 1), particles)]


def _played(cells: int, start: tuple[int, ...]) -> tuple[int, int]:
    """Simulate particles that start in given cells of a row, and return two numbers of moves.

    The particles move to the left end, and then to the right. The first number is the number of
    moves until the particles have found both ends. The second number is the number of moves until
    the particles have also visited all cells.
    """
    particles, visited = list(start), {*start}
    moves, boundary = 0, 0
    for step in (-1, 1):
        while True:
            moves += 1
            wall = 1 if step < 0 else cells
            stuck: set[int] = set()
            moved = []
            for place in sorted(particles, reverse=step > 0):
                blocked = place == wall or place + step in stuck
                if blocked:
                    stuck.add(place)
                moved.append(place if blocked else place + step)
            touched = wall in stuck
            particles = moved
            visited |= {*moved}
            if touched and (step < 0 or len(visited) == cells):
                boundary = boundary or (moves if step > 0 else 0)
                break
            if touched and step > 0:
                boundary = boundary or moves
    return boundary, moves


@erratum(
    "paper D, eq. 2",
    "the mean number of moves with which n particles find both ends of a row of m cells is"
    " 3(1+m)/(1+n)",
    "the mean number of moves with which n particles find both ends of a row of m cells is"
    " 3(1+m)/(1+n) - (m-n+1)/C(m,n), as in paper M, equation 2. C(m,n) is the binomial coefficient",
    "a program simulates all placements of n = 3 particles in a row of m = 9 cells, particle by"
    " particle",
)
def _boundary() -> tuple[str, bool]:
    from shoal.swarm.theory.one_dimension import Line

    m, n = 9, 3
    counted = Fraction(sum(_played(m, p)[0] for p in _placements(m, n)), comb(m, n))
    exact, printed = Line(m, n).boundary.exact, Fraction(3 * (1 + m), 1 + n)
    return (
        (
            f"the mean number of moves to find both ends is {float(counted):.5f} in the simulation,"
            f" {float(exact):.5f} by the exact formula, and {float(printed):.5f} by the formula of"
            " paper D"
        ),
        counted == exact != printed,
    )


@erratum(
    "papers M, D, section III.A.2",
    "visiting all m cells of a row takes 2p + m - p' + 1 + max(g - (p + m - p'), 0) moves, where p"
    " and p' are the positions of the first and the last particle and g is the largest gap",
    "visiting all m cells of a row takes p moves to the left, where p is the position of the first"
    " particle. After the moves to the left, visiting all cells takes the larger of two numbers of"
    " moves to the right: the moves to the right end, and the moves that close all gaps between"
    " particles. If closing all gaps takes more moves than reaching the right end, the printed"
    " formula counts too many moves",
    "a program simulates all placements of n = 3 particles in a row of m = 12 cells, particle by"
    " particle",
)
def _coverage() -> tuple[str, bool]:
    from shoal.swarm.theory.one_dimension import Line

    m, n = 12, 3
    counted = Fraction(sum(_played(m, p)[1] for p in _placements(m, n)), comb(m, n))
    mean = Line(m, n).coverage
    return (
        (
            f"the mean number of moves to visit all cells is {float(counted):.4f} in the"
            f" simulation, {float(mean.exact):.4f} by the exact formula, and"
            f" {float(mean.printed):.4f} by the printed formula"
        ),
        counted == mean.exact < mean.printed,
    )


@erratum(
    "paper M, Fig. 6 and the data of Fig. 7",
    "full coverage of a row of m = 1000 cells by n = 100 particles takes 60.7 moves on average",
    "full coverage of 1000 cells by 100 particles takes 58.74 moves on average. The published data"
    " count a gap as the difference of two positions, so each gap is one cell too large",
    "a program compares the exact mean number of moves with the published curve for rows of m ="
    " 5000 cells",
)
def _published_coverage() -> tuple[str, bool]:
    from shoal.swarm.theory.one_dimension import Line

    line, curve = Line(1000, 100), published_curve("line-full-coverage-m5000.csv")
    assert curve.std is not None  # the file has standard deviations
    there = {
        int(n): (float(mean), float(std))
        for n, mean, std in zip(curve.x, curve.mean, curve.std, strict=True)
    }
    # 2000 trials for each point of the curve
    mean, error = there[1000][0], there[1000][1] / 2000**0.5
    other = Line(5000, 1000)
    exact, theirs = float(other.coverage.exact), float(other.published_coverage)
    found = (
        "for m = 1000 cells and n = 100 particles, the exact mean is"
        f" {float(line.coverage.exact):.2f} moves, and the mean with gaps as differences of"
        f" positions is {float(line.published_coverage):.2f} moves. "
    )
    found += (
        f"For m = 5000 cells and n = 1000 particles, the exact mean is {exact:.2f} moves, the mean"
        f" with gaps as differences of positions is {theirs:.2f} moves, and the published mean is"
        f" {mean} ± {error:.2f} moves"
    )
    return (
        found,
        abs(float(line.published_coverage) - 60.7) < 0.1
        and abs(theirs - mean) < 3 * error < mean - exact,
    )


@erratum(
    "paper M, section III.A.3",
    "a search for a wall at distance D, with scans after 1, 2, 4, ... moves, makes at most log2 D"
    " scans",
    "a search with scans after 1, 2, 4, ... moves makes at most log2 D + 3 scans, including the"
    " scan at the start. If D is a power of 2, a search with scans after 1, 2, 4, ... moves makes"
    " exactly log2 D + 3 scans, because finding a wall at distance D takes D + 1 moves",
    "a program simulates the search with scans after 1, 2, 4, ... moves for all distances D from 1"
    " to 4096. The program simulates a second search, which makes 1, 2, 4, ... moves between its"
    " scans",
)
def _doubling() -> tuple[str, bool]:
    def scans(distance: int, *, between: bool) -> int:
        done, position, interval = 1, 0, 1
        while position <= distance:
            position = position + interval if between else interval
            done, interval = done + 1, 2 * interval
        return done

    over = {
        way: max(scans(d, between=way) - np.log2(d) for d in range(1, 4097))
        for way in (False, True)
    }
    powers = {scans(2**k, between=False) - k for k in range(1, 13)}
    found = (
        f"with scans after 1, 2, 4, ... moves, a search makes at most log2 D + {over[False]:g}"
        " scans; "
    )
    found += (
        f"with 1, 2, 4, ... moves between scans, a search makes at most log2 D + {over[True]:g}"
        " scans"
    )
    return found, over[False] == 3 and powers == {3}


@erratum(
    "papers M, D, section III.A.2",
    "n particles in a row of m cells have C(m-n, n+1) configurations of the gaps, where C is the"
    " binomial coefficient",
    "n particles in a row of m cells have C(m, n) configurations of the gaps",
    "a program lists the gaps of all placements of n = 3 particles in a row of m = 8 cells",
)
def _configurations() -> tuple[str, bool]:
    m, n = 8, 3
    gaps = {tuple(np.diff([0, *p, m + 1]).tolist()) for p in _placements(m, n)}
    return (
        (
            f"the list contains {len(gaps)} configurations, as C(8, 3) = {comb(m, n)}; the printed"
            f" C(5, 4) is {comb(m - n, n + 1)}"
        ),
        len(gaps) == comb(m, n) != comb(m - n, n + 1),
    )


@erratum(
    "papers M, D, section III.A.2",
    "the largest gap of n particles in a row of m cells is g + Θ(√(g log(n + 1))), where"
    " g = (m - n) / (n + 1) is the mean gap, if m > n log n",
    "no constant factor of the root holds for all m: the mean of the largest gap tends to"
    " g (1 + 1/2 + ... + 1/(n + 1)) as m grows, so that the factor that fits grows with √m. The"
    " printed bound is that of balls thrown into bins one by one, but all ways to distribute the"
    " empty cells over the gaps are equally likely",
    "a program sums the exact distribution of the largest gap of n = 10 particles in rows of 100 to"
    " 25600 cells",
)
def _largest_gap_law() -> tuple[str, bool]:
    n = 10
    harmonic = sum(1 / k for k in range(1, n + 2))
    factors, ratios = [], []
    for m in (100, 1600, 25600):
        # the mean of a number is the sum of its chances to be above 0, 1, 2, ...
        within = sum(
            sum(
                (-1) ** j * comb(n + 1, j) * comb(m - j * (gap + 1), n)
                for j in range(min(n + 1, (m - n) // (gap + 1)) + 1)
            )
            for gap in range(m - n)
        )
        largest = float(m - n - Fraction(within, comb(m, n)))
        mean = (m - n) / (n + 1)
        factors.append((largest - mean) / (mean * np.log(n + 1)) ** 0.5)
        ratios.append(largest / (mean * harmonic))
    found = (
        "in rows of 100, 1600 and 25600 cells, the factor of the root that fits is"
        f" {factors[0]:.2f}, {factors[1]:.2f} and {factors[2]:.2f}, and the mean of the largest gap"
        f" is {ratios[0]:.4f}, {ratios[1]:.4f} and {ratios[2]:.4f} times g (1 + 1/2 + ... + 1/11)"
    )
    return found, factors[2] > 3 * factors[1] > 9 * factors[0] and abs(ratios[2] - 1) < 1e-3


@erratum(
    "paper M, Fig. 5",
    "the mean largest gap of 10 particles in a row of 1000 cells is 273.9 cells (Monte Carlo)",
    "the mean largest gap of 10 particles in a row of 1000 cells is 272.80 cells, by a closed"
    " formula",
    "a program computes the exact distribution of the largest of all 11 gaps. The program compares"
    " the exact mean of the largest gap with the mean over 100,000 random placements",
)
def _largest_gap() -> tuple[str, bool]:
    from shoal.swarm.theory.one_dimension import Line, sample

    line = Line(1000, 10)
    exact, drawn = float(line.largest_gap_distribution.mean), sample(line, 100_000, workers=1)
    error = drawn.standard_error("largest_gap")
    mean = float(drawn.largest_gap.mean())
    return (
        (
            f"the exact mean largest gap is {exact:.2f} cells, and the mean over the random"
            f" placements is {mean:.2f} ± {error:.2f} cells"
        ),
        abs(mean - exact) < 4.5 * error and abs(exact - 272.80) < 0.005,
    )


@erratum(
    "paper M, Fig. 6",
    "the caption of figure 6 states that the figure shows n = 10 particles",
    "the data of figure 6 belong to n = 100 particles",
    "a program computes the mean number of moves to find both ends of a row of 1000 cells (paper M,"
    " equation 2), for 10 and for 100 particles",
)
def _caption() -> tuple[str, bool]:
    from shoal.swarm.theory.one_dimension import Line

    ten, hundred = (float(Line(1000, n).boundary.exact) for n in (10, 100))
    return (
        (
            f"equation 2 of paper M gives {ten:.1f} moves for n = 10 and {hundred:.1f} moves for n"
            " = 100; figure 6 shows 29.8 moves"
        ),
        abs(hundred - 29.8) < 0.1 < abs(ten - 29.8),
    )
