"""Errata of the search along a closed curve: paper H."""

from __future__ import annotations

import numpy as np

from .checking import Check, into

CHECKS: list[Check] = []
erratum = into(CHECKS)


@erratum(
    "paper H, section Efficiency",
    "T_E falls as the reciprocal of the number of robots",
    "as H_m/m, that is ln m / m; below 20 % with 20 robots holds",
    "10,000 random starts of 10, 20 and 50 robots in 1024 cells",
)
def _reciprocal() -> tuple[str, bool]:
    from shoal.search.allocation.expected_time import expected_time, stay_share

    drawn = {m: expected_time(1024, m) for m in (10, 20, 50)}
    found = {m: one.mean for m, one in drawn.items()}
    fits = all(abs(mean / stay_share(m) - 1) < 0.02 for m, mean in found.items())
    words = ", ".join(
        f"{m} robots: {100 * mean:.1f} ± {100 * drawn[m].error:.1f} % (m T_E = {m * mean:.2f})" for m, mean in found.items()
    )
    return words, fits and found[20] < 0.2 and 50 * found[50] > 1.3 * 10 * found[10]


@erratum(
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


@erratum(
    "paper H, section Further Research",
    "the Hilbert curve has a long path between its ends when closed",
    "confirmed; Moore's curve has none",
    "closing edges of both on 32 by 32 cells",
)
def _closing() -> tuple[str, bool]:
    from shoal.search import make_tour

    ends = [float(make_tour(name, (32, 32)).metrics().closing_edge) for name in ("hilbert", "moore")]
    return f"Hilbert {ends[0]:g} cells, Moore {ends[1]:g}", ends[0] == 31 and ends[1] == 1
