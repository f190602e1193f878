"""Errata of paper H about the search along a closed curve."""

from __future__ import annotations

import numpy as np

from .checking import Check, into

CHECKS: list[Check] = []
erratum = into(CHECKS)


@erratum(
    "paper H, section Efficiency",
    "the expected search time T_E is proportional to the reciprocal of the number of robots",
    "for m robots, the expected search time T_E is proportional to H_m/m, where H_m = 1 + 1/2 + ..."
    " + 1/m. For many robots, H_m/m is about ln m / m. For 20 robots, paper H prints a search time"
    " below 20 % of the time of one robot, which is correct",
    "a program computes the expected search time T_E for 1024 cells over 10,000 random starts of"
    " 10, 20 and 50 robots",
)
def _reciprocal() -> tuple[str, bool]:
    from shoal.search.allocation.costs import expected_time, stay_share

    drawn = {m: expected_time(1024, m) for m in (10, 20, 50)}
    found = {m: one.mean for m, one in drawn.items()}
    fits = all(abs(mean / stay_share(m) - 1) < 0.02 for m, mean in found.items())
    words = ", ".join(
        f"{100 * mean:.1f} ± {100 * drawn[m].error:.1f} % for {m} robots (m T_E = {m * mean:.2f})"
        for m, mean in found.items()
    )
    words = f"as a share of the search time of one robot, T_E is {words}"
    return words, fits and found[20] < 0.2 and 50 * found[50] > 1.3 * 10 * found[10]


@erratum(
    "paper H, section Space-Filling Curves",
    "the number of subregions of a space-filling curve of order D is (2D)² = 2^(2D)",
    "the number of subregions of a space-filling curve of order D is (2^D)² = 2^(2D)",
    "a program counts the cells of the Hilbert curve of order 3, and computes the index of the"
    " printed location [3, 5] on this curve",
)
def _subregions() -> tuple[str, bool]:
    from shoal.search import hilbert_decode, hilbert_encode

    cells = hilbert_decode(np.arange(64), order=3)
    index = int(hilbert_encode([[2, 3]], order=3)[0])
    count = len({tuple(cell) for cell in cells.tolist()})
    return (
        (
            f"the Hilbert curve of order 3 has {count} cells, while (2·3)² = 36; the location [3,"
            f" 5] has the index {index}, as printed"
        ),
        count == 64 and index == 28,
    )


@erratum(
    "paper H, section Further Research",
    "a closed Hilbert curve has a long path between the two ends of the curve",
    "the printed statement about the Hilbert curve is correct. Moore's curve has no long path"
    " between its ends",
    "a program measures the edges that close Hilbert's curve and Moore's curve on 32 by 32 cells",
)
def _closing() -> tuple[str, bool]:
    from shoal.search import make_tour

    ends = [
        float(make_tour(name, (32, 32)).metrics().closing_edge) for name in ("hilbert", "moore")
    ]
    return (
        (
            f"the closing edge is {ends[0]:g} cells long for Hilbert's curve and {ends[1]:g} cell"
            " long for Moore's curve"
        ),
        ends[0] == 31 and ends[1] == 1,
    )
