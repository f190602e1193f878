"""Paper M, theory in one dimension: figures 5 and 6, and theorem 1."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, log
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.lab.statistics import summarise
from shoal.lab.store import Store
from shoal.lab.sweep import Sweep
from shoal.papers.claims import Claim, claim
from shoal.papers.recipe import NO_DATA, Outcome, Recipe, Settings, Table, ends
from shoal.swarm.theory.one_dimension import Line, LineSample, sample
from shoal.swarm.theory.scan_schedules import (
    Hyperexponential,
    Powers,
    least_simultaneous_ratio,
    worst_of_both,
)
from shoal.views.swarm.theory import gap_distributions, move_distributions, simultaneous_ratios

PLACED = 1_000_000  # number of trials of the paper's Monte Carlo
DECADES = (1, 2, 3, 4, 6, 8, 10, 12, 16, 20, 30, 40, 50, 60, 70, 80, 90, 100)


def _line_sweep(name: str, particles: int, settings: Settings) -> list[Sweep]:
    problem = {"kind": "line", "cells": 1000, "particles": particles, "placements": PLACED // 100}
    return [Sweep(name=name, problem=problem, trials=settings.of(100, 20), seed=settings.seed)]


def _draw_sample(line: Line, settings: Settings) -> LineSample:
    return sample(line, PLACED // (5 if settings.quick else 1), seed=settings.seed)


def _against(quantity: str, printed: float, exact: float, sample: Any, *, digits: int) -> Claim:
    """Return the claim that an exact mean equals the mean of the paper's Monte Carlo simulation."""
    error = 0.5 * 10.0**-digits + 1.96 * float(np.std(sample)) / PLACED**0.5
    return claim(
        quantity,
        f"{printed:g}",
        exact,
        within=(printed - error, printed + error),
        why="rounding and errors of a million trials",
    )


def _tables(
    store: Store, sweep: Sweep, exact: dict[str, float], sample: LineSample, *, of: str
) -> tuple[Table, Table]:
    """Return a table of Shoal's sampled means beside the exact means, and a table of the number of
    samples for each value.
    """
    means, counts = [], []
    for name, value in exact.items():
        (row,) = summarise(store, sweep.name, name)
        assert row.estimate is not None  # the sweep is complete
        means.append(
            [
                name.replace("_", " "),
                round(row.estimate.mean, 3),
                "{:.3f} to {:.3f}".format(*ends(row.estimate)),
                round(value, 3),
            ]
        )
        values, times = np.unique(getattr(sample, name), return_counts=True)
        counts += [
            [name, int(value), int(count)] for value, count in zip(values, times, strict=True)
        ]
    return (
        Table("means of the sweep", ["", "drawn", "95 % interval", "exact"], means),
        Table(f"placements by {of}", ["quantity", of, "placements"], counts, shown=False),
    )


def _fig5(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    line = Line(1000, 10)
    sample = _draw_sample(line, settings)
    first, largest = float(line.first_distribution.mean), float(line.largest_gap_distribution.mean)
    claims = (
        _against("mean gap before the first particle", 90.94, first, sample.first, digits=2),
        _against("mean gap after the last particle", 90.98, first, sample.last, digits=2),
        _against("mean largest gap", 273.9, largest, sample.largest_gap, digits=1),
    )
    sentence = (
        f"The largest gap is {largest:.1f} empty cells; as a difference of positions, one too many"
        f" between particles, it is {largest + 1:.1f}, which the printed number fits."
    )
    exact = {
        "first": first,
        "last": first,
        "largest_gap": largest,
        "spread": float(line.spread_distribution.mean),
    }
    tables = _tables(store, sweeps[0], exact, sample, of="value")
    return Outcome(
        gap_distributions(line, sample),
        claims,
        sentence,
        tables,
        f"{NO_DATA} but means in the text",
    )


def _fig6(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    line = Line(1000, 100)
    sample = _draw_sample(line, settings)
    boundary = float(line.boundary.exact)
    full = float(line.coverage.exact)
    printed = float(line.coverage.printed)
    claims = (
        _against("mean moves to both ends, n = 100", 29.8, boundary, sample.boundary, digits=1),
        _against(
            "the same for n = 10, as the caption has it",
            29.8,
            float(Line(1000, 10).boundary.exact),
            sample.boundary,
            digits=1,
        ),
        _against("mean moves of full coverage, n = 100", 60.7, full, sample.coverage, digits=1),
        claim(
            "full coverage by both ends",
            "about twice",
            full / boundary,
            within=(1.5, 2.5),
            why="2 when rounded",
        ),
    )
    sentence = (
        f"The data are of n = 100. The printed formula for full coverage gives {printed:.2f}, as it"
        " overcounts, and with gaps as differences of positions"
        f" {float(line.published_coverage):.2f}, which the printed number fits."
    )
    exact = {"boundary": boundary, "coverage": full, "printed_coverage": printed}
    tables = _tables(store, sweeps[0], exact, sample, of="moves")
    figure = move_distributions(line, sample, printed=(29.8, 60.7))
    return Outcome(figure, claims, sentence, tables, f"{NO_DATA} but means in the text")


def simultaneous(decades: Sequence[int]) -> NDArray[np.float64]:
    """Return three ratios for each distance D = 10^k with k in ``decades``; float64, shape (3,
    number of decades).

    The move ratio of a scan schedule is its number of moves divided by the smallest possible number
    of moves. The scan ratio is its number of scans divided by the smallest possible number of
    scans. The first returned ratio is max(move ratio, scan ratio) of the schedule i^i, in the worst
    case of all distances of the wall up to D. The second returned ratio is the smallest possible
    value of this maximum over all schedules. The third returned ratio is log D / log log D.
    """
    powers = [10**k for k in decades]
    ours = [float(worst_of_both(Hyperexponential(), distance)) for distance in powers]
    best = [float(least_simultaneous_ratio(distance).ratio) for distance in powers]
    return np.array([ours, best, [k * log(10) / log(k * log(10)) for k in decades]])


def _theorem1(_store: Store, _sweeps: list[Sweep], settings: Settings) -> Outcome:
    decades = [k for k in DECADES if k <= (40 if settings.quick else 100)]
    ours, best, growth = simultaneous(decades)
    ten, last = decades.index(10), f"10^{decades[-1]}"
    doubled = [Powers(2).cost(distance) for distance in range(1, 2**12)]
    claims = (
        claim(
            f"ratio of i^i by log D / log log D, at {last} against 10^10",
            "bounded",
            (ours / growth)[-1] / (ours / growth)[ten],
            within=(0, 1),
            why="a factor that grows would refute O(log D / log log D)",
        ),
        claim(
            f"least ratio of any schedule by log D / log log D, least up to {last}",
            "no better order",
            float(np.min(best / growth)),
            within=(0.5, inf),
            why="it falls towards ½; a quotient that tends to 0 would refute it",
        ),
        claim(
            f"ratio of i^i by the least of any schedule, most up to {last}",
            "best up to a factor",
            float(np.max(ours / best)),
            within=(1, 5.44),
            why="e of equation 4 by ½",
        ),
        claim(
            "doubling: moves less 2D + 2, most for D up to 4095",
            "0 at most",
            max(c.moves - 2 * c.distance - 2 for c in doubled),
            within=(-inf, 0),
        ),
        claim(
            "doubling: scans less log2 D, most for D up to 4095",
            "0 at most",
            max(c.scans - log(c.distance, 2) for c in doubled),
            within=(-inf, 0),
        ),
    )
    rows = [
        [f"10^{k}", *(round(float(value), 3) for value in (a, b, a / b, a / g, b / g))]
        for k, a, b, g in zip(decades, ours, best, growth, strict=True)
    ]
    columns = [
        "D",
        "i^i",
        "least of any schedule",
        "quotient",
        "i^i by log D / log log D",
        "least by log D / log log D",
    ]
    sentence = (
        "The larger of both ratios, moves to D + 1 and scans to 2, in the worst case up to D, from"
        " exact integers. That doubling takes up to 3 scans more than printed, that at the start"
        " among them, changes no order."
    )
    table = Table("larger of both ratios", columns, rows)
    return Outcome(
        simultaneous_ratios(decades, ours, best, growth),
        claims,
        sentence,
        (table,),
        "the paper has no figure of it",
    )


RECIPES = (
    Recipe(
        "m-fig5",
        "paper M, Fig. 5",
        "Gaps of random placements on a line",
        lambda s: _line_sweep("m-fig5", 10, s),
        _fig5,
        also="D, Fig. 3",
    ),
    Recipe(
        "m-fig6",
        "paper M, Fig. 6",
        "Moves on a line",
        lambda s: _line_sweep("m-fig6", 100, s),
        _fig6,
        also="D, Fig. 4",
    ),
    Recipe(
        "m-theorem1",
        "paper M, theorem 1",
        "Scans and moves of the schedule i^i",
        lambda _: [],
        _theorem1,
    ),
)
