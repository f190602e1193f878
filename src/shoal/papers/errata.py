"""What the papers print and what holds: each erratum with the check that shows it, run when the page of results is written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations
from math import comb, pi

import numpy as np

from shoal.papers.recipe import published_curve


@dataclass(frozen=True)
class Finding:
    """An erratum, checked.

    Parameters
    ----------
    source : str
        Paper and place.
    printed, holds : str
    check : str
        How it was checked.
    found : str
        The numbers of the check.
    shown : bool
        Whether the check shows it.
    """

    source: str
    printed: str
    holds: str
    check: str
    found: str
    shown: bool


_CHECKS: list[Callable[[], Finding]] = []


def _erratum(
    source: str, printed: str, holds: str, check: str
) -> Callable[[Callable[[], tuple[str, bool]]], Callable[[], Finding]]:
    """Return a decorator for a function that gives the numbers of a check and whether they show the erratum."""

    def register(function: Callable[[], tuple[str, bool]]) -> Callable[[], Finding]:
        def checked() -> Finding:
            found, shown = function()
            return Finding(source, printed, holds, check, found, shown)

        _CHECKS.append(checked)
        return checked

    return register


def check_all() -> list[Finding]:
    """Run the checks of all errata."""
    return [check() for check in _CHECKS]


def _placements(cells: int, particles: int) -> list[tuple[int, ...]]:
    return [*combinations(range(1, cells + 1), particles)]


def _played(cells: int, start: tuple[int, ...]) -> tuple[int, int]:
    """Return moves until both ends are found, and until every cell has been visited, too; by moving particles one by one."""
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


@_erratum(
    "paper D, eq. 2",
    "mean moves to both ends 3(1+m)/(1+n)",
    "the same less (m-n+1)/C(m,n), as in paper M, eq. 2",
    "all placements of n = 3 in m = 9 cells, played particle by particle",
)
def _boundary() -> tuple[str, bool]:
    from shoal.swarm.line import Line

    m, n = 9, 3
    counted = Fraction(sum(_played(m, p)[0] for p in _placements(m, n)), comb(m, n))
    exact, printed = Line(m, n).boundary.exact, Fraction(3 * (1 + m), 1 + n)
    return f"{float(counted):.5f} played, {float(exact):.5f} exact, {float(printed):.5f} by paper D", counted == exact != printed


@_erratum(
    "papers M, D, section III.A.2",
    "full coverage takes 2p + m - p' + 1 + max(g - (p + m - p'), 0) moves",
    "p + max(R, need): where the largest gap decides the formula counts too much",
    "all placements of n = 3 in m = 12 cells, played particle by particle",
)
def _coverage() -> tuple[str, bool]:
    from shoal.swarm.line import Line

    m, n = 12, 3
    counted = Fraction(sum(_played(m, p)[1] for p in _placements(m, n)), comb(m, n))
    mean = Line(m, n).coverage
    return (
        f"{float(counted):.4f} played, {float(mean.exact):.4f} exact, {float(mean.printed):.4f} printed",
        counted == mean.exact < mean.printed,
    )


@_erratum(
    "paper M, Fig. 6 and the data of Fig. 7",
    "full coverage of m = 1000, n = 100 takes 60.7 moves",
    "58.74; the data take gaps as differences of positions, one too many again",
    "exact counts, and the published curve at m = 5000",
)
def _published_coverage() -> tuple[str, bool]:
    from shoal.swarm.line import Line

    line, curve = Line(1000, 100), published_curve("line-full-coverage-m5000.csv")
    assert curve.std is not None  # the file has them
    there = {int(n): (float(mean), float(std)) for n, mean, std in zip(curve.x, curve.mean, curve.std, strict=True)}
    mean, error = there[1000][0], there[1000][1] / 2000**0.5  # 2000 trials a point
    other = Line(5000, 1000)
    exact, theirs = float(other.coverage.exact), float(other.published_coverage)
    found = f"m = 1000: {float(line.coverage.exact):.2f} exact, {float(line.published_coverage):.2f} with gaps as differences; "
    found += f"m = 5000, n = 1000: {exact:.2f} exact, {theirs:.2f} with gaps as differences, {mean} ± {error:.2f} published"
    return found, abs(float(line.published_coverage) - 60.7) < 0.1 and abs(theirs - mean) < 3 * error < mean - exact


@_erratum(
    "papers M, D, section III.A.2",
    "there are C(m-n, n+1) configurations of the gaps",
    "C(m, n)",
    "gaps of all placements of 3 in 8 cells, listed",
)
def _configurations() -> tuple[str, bool]:
    m, n = 8, 3
    gaps = {tuple(np.diff([0, *p, m + 1]).tolist()) for p in _placements(m, n)}
    return f"{len(gaps)} listed, C(8, 3) = {comb(m, n)}, C(5, 4) = {comb(m - n, n + 1)}", len(gaps) == comb(m, n) != comb(
        m - n, n + 1
    )


@_erratum(
    "paper M, Fig. 5",
    "the mean largest gap of 10 in 1000 cells is 273.9 (Monte Carlo)",
    "272.80, by a closed form",
    "exact distribution of the largest of all 11 gaps, against 100,000 random placements",
)
def _largest_gap() -> tuple[str, bool]:
    from shoal.swarm.line import Line, sample

    line = Line(1000, 10)
    exact, drawn = float(line.largest_gap_distribution.mean), sample(line, 100_000, workers=1)
    error = drawn.standard_error("largest_gap")
    mean = float(drawn.largest_gap.mean())
    return f"{exact:.2f} exact, {mean:.2f} ± {error:.2f} drawn", abs(mean - exact) < 4.5 * error and abs(exact - 272.80) < 0.005


@_erratum(
    "paper M, Fig. 6",
    "its caption says n = 10",
    "its data are of n = 100",
    "eq. 2 for both",
)
def _caption() -> tuple[str, bool]:
    from shoal.swarm.line import Line

    ten, hundred = (float(Line(1000, n).boundary.exact) for n in (10, 100))
    return f"n = 10: {ten:.1f}, n = 100: {hundred:.1f}; printed 29.8", abs(hundred - 29.8) < 0.1 < abs(ten - 29.8)


@_erratum(
    "paper M, data of Fig. 10",
    "coverage with a particle in every cell takes 1 move",
    "0: nothing is left to cover; mapping takes 4",
    "an episode of each on a rectangle of 9 by 7",
)
def _full() -> tuple[str, bool]:
    from shoal.swarm import run
    from shoal.swarm.maps import open_map

    workspace = open_map("rectangle:9x7")
    cover, mapped = (run(workspace, task=task, particles=workspace.n_free).moves for task in ("coverage", "mapping"))
    return f"coverage {cover}, mapping {mapped} moves", (cover, mapped) == (0, 4)


@_erratum(
    "paper M, algorithm 2",
    "the elected particle goes to its nearest frontier cell",
    "the particle that blocks it must take over; without that the literal algorithm can go round for ever (not played here)",
    "20 episodes of elect-particle, with the handover, on a maze with a queue in every corridor",
)
def _handover() -> tuple[str, bool]:
    from shoal.swarm import run
    from shoal.swarm.maps import open_map

    workspace = open_map("maze:21x15")
    ended = [run(workspace, policy="elect-particle", particles=workspace.n_free // 2, seed=k).status for k in range(20)]
    return f"{ended.count('complete')} of 20 end", ended.count("complete") == 20


@_erratum(
    "paper W, section IV.E, eq. 3",
    "the chord runs over ψ ± γ/2",
    "ψ ± γ: γ is the half angle",
    "the end of a chord on the circle lies at ψ ± γ",
)
def _half_angle() -> tuple[str, bool]:
    r, depth = 0.5, 0.2  # the chord at that distance below the contact
    gamma = float(np.arccos((r - depth) / r))
    off = [abs(r * np.cos(angle) - (r - depth)) for angle in (gamma, gamma / 2)]
    return f"off the chord by {off[0]:.1e} at γ, by {off[1]:.3f} at γ/2", off[0] < 1e-12 < off[1]


@_erratum(
    "paper W, section IV.E, eq. 7",
    "‖Δg - C‖² ≥ r² and (Δg - C)·e ≤ r cos γ",
    "both inequalities the other way round",
    "2000 two-move outcomes from random contacts, played by the contact world",
)
def _inequalities() -> tuple[str, bool]:
    from shoal.steering import ContactWorld, disk

    world, rng, r = ContactWorld(disk()), np.random.default_rng(1), 0.5
    corrected, reversed_, count = 0, 0, 0
    while count < 2000:
        angle, other = rng.uniform(0, 2 * pi), rng.uniform(-r, r, 2)
        e = np.array([np.cos(angle), np.sin(angle)])
        if np.linalg.norm(other) > 0.98 * r:
            continue
        depth = float((r * e - other) @ e)  # of particle 2 below the wall that holds particle 1
        push = rng.uniform(-1, 1, 2)
        if push @ e < 0:
            continue  # such a move would take particle 1 off the wall
        state = world.step(np.stack([r * e, other]), push)
        delta, centre = state[1] - state[0], -r * e
        inside = float((delta - centre) @ (delta - centre)) <= r * r + 1e-9
        above = float((delta - centre) @ e) >= (r - depth) - 1e-9  # r cos γ, γ the half angle of the chord at that depth
        corrected += inside and above
        reversed_ += not inside and not above
        count += 1
    return f"corrected: {corrected} of {count} hold; as printed: {reversed_}", corrected == count and reversed_ == 0


@_erratum(
    "paper W, section IV.F",
    "two moves on a disk reach at most 0.373, from about 0.81 diameters",
    "0.377, from about 0.8175",
    "maximum of the exact share over the distance",
)
def _most() -> tuple[str, bool]:
    from shoal.steering.filling import largest_two_move_fraction

    at, most = largest_two_move_fraction()
    return f"{most:.4f} at {at:.4f}", most > 0.3765 and abs(at - 0.8175) < 0.01


@_erratum(
    "paper W, section IV.D",
    "four moves fill a triangle, six an octagon",
    "six a triangle; seven and eight sides may need eight",
    "exact sets from one start each",
)
def _polygons() -> tuple[str, bool]:
    from shoal.steering import regular_polygon
    from shoal.steering.filling import polygon_filling

    triangle = polygon_filling(regular_polygon(3), (0.43, 0.36))
    octagon = polygon_filling(regular_polygon(8), (0.13, 0.06))
    found = f"triangle: {100 * float(triangle.fractions[1]):.1f} % after 4, whole after {triangle.moves}; octagon: "
    return f"{found}{100 * float(octagon.fractions[2]):.2f} % after 6, whole after {octagon.moves}", (
        triangle.moves,
        octagon.moves,
    ) == (6, 8)


@_erratum(
    "paper W, section IV.C",
    "a square needs at most five moves by algorithm 1",
    "four canonical moves miss a corner of the area |Δx Δy|",
    "exact set after four moves from Δ = (0.27, 0.11)",
)
def _square() -> tuple[str, bool]:
    from shoal.steering import open_workspace
    from shoal.steering.filling import polygon_filling

    workspace = open_workspace("square")
    left = 4 * (1 - float(polygon_filling(workspace, (0.27, 0.11), moves=4).fractions[1]))  # type: ignore[arg-type]  # a polygon
    return f"area missed {left:.4f}, |Δx Δy| = {0.27 * 0.11:.4f}", abs(left - 0.27 * 0.11) < 0.003


@_erratum(
    "paper W, Fig. 15",
    "the error falls as 8.66 / length³",
    "only if particle 2 always touches; with the nearer one 0.01 takes half the length",
    "both, cycle after cycle",
)
def _law() -> tuple[str, bool]:
    from shoal.steering.sweeps import swap_antipodes

    second, nearer = (swap_antipodes(toucher=who).length_to(0.01) for who in ("second", "nearer"))
    return f"0.01 at length {second:.1f} and {nearer:.1f}; by the law {(8.66 / 0.01) ** (1 / 3):.1f}", nearer < 0.6 * second


@_erratum(
    "paper H, section Efficiency",
    "T_E falls as the reciprocal of the number of robots",
    "as H_m/m, that is ln m / m; below 20 % with 20 robots holds",
    "10,000 random starts of 10, 20 and 50 robots in 1024 cells",
)
def _reciprocal() -> tuple[str, bool]:
    from shoal.search.expectation import expected_time, stay_share

    found = {m: expected_time(1024, m).mean for m in (10, 20, 50)}
    fits = all(abs(mean / stay_share(m) - 1) < 0.02 for m, mean in found.items())
    words = ", ".join(f"{m} robots: {100 * mean:.1f} % (m T_E = {m * mean:.2f})" for m, mean in found.items())
    return words, fits and found[20] < 0.2 and 50 * found[50] > 1.3 * 10 * found[10]


@_erratum(
    "paper H, section Space-Filling Curves",
    "number of subregions = (2D)² = 2^(2D)",
    "(2^D)² = 2^(2D)",
    "cells of the curve of order 3, and location [3, 5] as printed",
)
def _subregions() -> tuple[str, bool]:
    from shoal.search import hilbert_decode, hilbert_encode

    cells = hilbert_decode(np.arange(64), order=3)
    index = int(hilbert_encode([[2, 3]], order=3)[0])
    count = len({tuple(cell) for cell in cells.tolist()})
    return f"{count} cells, (2·3)² = 36; [3, 5] has the index {index}, as printed", count == 64 and index == 28


@_erratum(
    "paper H, section Further Research",
    "the Hilbert curve has a long path between its ends when closed",
    "confirmed; Moore's curve has none",
    "closing edges of both on 32 by 32 cells",
)
def _closing() -> tuple[str, bool]:
    from shoal.search import make_tour

    ends = [float(make_tour(name, (32, 32)).metrics().closing_edge) for name in ("hilbert", "moore")]
    return f"Hilbert {ends[0]:g} cells, Moore {ends[1]:g}", ends[0] == 31 and ends[1] == 1
