"""Paper M, one dimension: figures 5 and 6."""

from __future__ import annotations

from typing import Any

import numpy as np

from shoal.lab.statistics import summarise
from shoal.lab.storage.store import Store
from shoal.lab.sweeps.sweep import Sweep
from shoal.papers.recipe import NO_DATA, Outcome, Recipe, Settings, Table
from shoal.swarm.theory.one_dimension import Line, sample
from shoal.views.swarm.theory import gap_distributions, move_distributions

PLACED = 1_000_000  # of the paper's Monte Carlo


def _line_sweep(name: str, particles: int, settings: Settings) -> Sweep:
    trials = settings.of(100, 20)
    problem = {"kind": "line", "cells": 1000, "particles": particles, "placements": PLACED // 100}
    return Sweep(name=name, problem=problem, trials=trials, seed=settings.seed)


def _against(store: Store, sweep: Sweep, wanted: dict[str, tuple[float, float | None]]) -> tuple[Table, bool]:
    """Return our means beside exact and printed ones, and whether each exact one is within five standard errors of ours."""
    rows: list[list[Any]] = []
    fits = True
    for measure, (exact, printed) in wanted.items():
        (row,) = summarise(store, sweep.name, measure)
        found = row.estimate
        assert found is not None  # the sweep is complete
        fits &= abs(found.mean - exact) <= 5 * found.std / found.count**0.5 + 1e-9 if found.count > 1 else True
        low, high = (found.low, found.high) if found.count > 1 else (found.mean, found.mean)
        rows.append(
            [measure, round(found.mean, 3), f"{low:.3f} to {high:.3f}", round(exact, 3), "none" if printed is None else printed]
        )
    return Table("means", ["", "ours", "95 % interval", "exact", "printed"], rows), fits


def _sampled(line: Line, settings: Settings) -> Any:
    return sample(line, PLACED // (5 if settings.quick else 1), seed=settings.seed)


def _fig5(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    line = Line(1000, 10)
    drawn = _sampled(line, settings)
    first = float(line.first_distribution.mean)
    largest, spread = float(line.largest_gap_distribution.mean), float(line.spread_distribution.mean)
    table, fits = _against(
        store,
        sweeps[0],
        {"first": (first, 90.94), "last": (first, 90.98), "largest_gap": (largest, 273.9), "spread": (spread, None)},
    )
    counted = []
    for name in ("first", "last", "largest_gap", "spread"):
        values, times = np.unique(getattr(drawn, name), return_counts=True)
        counted += [[name, int(value), int(count)] for value, count in zip(values, times, strict=True)]
    sentence = (
        f"First and last particle: {first:.2f} exact, 90.94 and 90.98 printed, which is the paper's Monte Carlo. The largest gap "
        f"is {largest:.1f} exact; the printed 273.9 fits gaps taken as differences of positions, one too many between particles."
    )
    histogram = Table("placements by value", ["quantity", "value", "placements"], counted, shown=False)
    return Outcome(gap_distributions(line, drawn), sentence, (table, histogram), fits, f"{NO_DATA} but means in the text")


def _fig6(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    line = Line(1000, 100)
    drawn = _sampled(line, settings)
    exact = {name: float(getattr(line, name).exact) for name in ("boundary", "coverage")}
    table, fits = _against(
        store,
        sweeps[0],
        {
            "boundary": (exact["boundary"], 29.8),
            "coverage": (exact["coverage"], 60.7),
            "printed_coverage": (float(line.coverage.printed), None),
        },
    )
    counted = []
    for name in ("boundary", "coverage"):
        values, times = np.unique(getattr(drawn, name), return_counts=True)
        counted += [[name, int(value), int(count)] for value, count in zip(values, times, strict=True)]
    published = float(line.published_coverage)
    sentence = (
        f"Both ends: {exact['boundary']:.2f} exact, 29.8 printed, so the data are of n = 100 (the caption's n = 10 gives "
        f"{float(Line(1000, 10).boundary.exact):.0f}). Full coverage: {exact['coverage']:.2f} exact, "
        f"{float(line.coverage.printed):.2f} by the printed formula, which overcounts; with gaps as differences of positions it "
        f"gives {published:.2f}, the printed 60.7."
    )
    histogram = Table("placements by moves", ["quantity", "moves", "placements"], counted, shown=False)
    return Outcome(move_distributions(line, drawn), sentence, (table, histogram), fits, f"{NO_DATA} but means in the text")


RECIPES = (
    Recipe(
        "m-fig5", "paper M, Fig. 5", "Gaps of random placements on a line", lambda s: [_line_sweep("m-fig5", 10, s)], _fig5,
        also="D, Fig. 3",
    ),
    Recipe("m-fig6", "paper M, Fig. 6", "Moves on a line", lambda s: [_line_sweep("m-fig6", 100, s)], _fig6, also="D, Fig. 4"),
)  # fmt: skip
