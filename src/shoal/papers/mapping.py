"""Paper M: "Mapping and coverage with a particle swarm controlled by uniform inputs" (2017), figures 7 to 11."""

from __future__ import annotations

from typing import Any

import numpy as np

from shoal.lab.statistics import Row, summarise
from shoal.lab.storage.store import Store
from shoal.lab.sweeps.sweep import Sweep, digest_of
from shoal.papers.recipe import (
    NO_DATA,
    Outcome,
    Recipe,
    Settings,
    Table,
    counts_of,
    curve_of,
    ends,
    near,
    published_curve,
    table_of,
)
from shoal.swarm import SwarmProblem
from shoal.swarm.maps.open import open_map
from shoal.swarm.run import run
from shoal.views.drawing.curves import Curve, Labels, frontier_curves, mean_curves

MAPS = {
    "line:5000": ("linear 1x5000", "closest-frontier-linear-1x5000.csv"),
    "rectangle:50x100": ("rectangle 50x100", "closest-frontier-rectangle-50x100.csv"),
    "htree:5000": ("H-tree, 5000 cells", "closest-frontier-htree-5000.csv"),
}
POLICIES = ("random-moves", "elect-particle", "closest-frontier")
PLACEMENTS = ("flood-fill", "region-fill", "uniform")
TASKS = {"mapping": "mapping", "coverage": "coverage", "subset-coverage": "subset coverage, 10 % of the cells"}
WITHIN = 0.15  # of the published mean, at every published n
OTHER_MAP = "the picture of the paper's complex map is not published; this is another one of its kind"


def _free_cells(name: str) -> int:
    """Return the number of free cells of a map."""
    return open_map(name).n_free


def _slug(name: str) -> str:
    """Return a map's name as part of the name of a sweep."""
    plain = "".join(c if c.isascii() and c.isalnum() else "-" for c in name)[:30]
    return f"{plain}-{digest_of(name)[:6]}"


def _on_complex(name: str, settings: Settings, **axes: Any) -> Sweep:
    """Return a sweep on the complex map over numbers of particles, all axes but these paired."""
    chosen = settings.complex
    return Sweep(
        name=f"{name}.{_slug(chosen)}", problem={"kind": "swarm", "map": chosen},
        axes=axes | {"particles": counts_of(_free_cells(chosen))},
        trials=settings.of(100, 20), seed=settings.seed, paired=tuple(axes),
    )  # fmt: skip


def _capital(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}"


def _note_of(settings: Settings) -> str:
    """Return what is to be said of the map."""
    return f"map {settings.complex}: {OTHER_MAP}" if settings.map is None else f"map {settings.map}, not the paper's"


# Fig. 7: four maps, and one dimension


def _fig7_sweeps(settings: Settings) -> list[Sweep]:
    trials = settings.of(100, 40)
    problem = {"kind": "swarm"}
    published = Sweep(
        name="m-fig7.published-maps", problem=problem, axes={"map": [*MAPS], "particles": counts_of(5000)}, trials=trials,
        seed=settings.seed,
    )  # fmt: skip
    chosen = settings.complex
    other = Sweep(
        name=f"m-fig7.{_slug(chosen)}", problem=problem | {"map": chosen}, axes={"particles": counts_of(_free_cells(chosen))},
        trials=settings.of(100, 20), seed=settings.seed,
    )  # fmt: skip
    line = {"kind": "line", "cells": 5000, "placements": 20}
    one = Sweep(name="m-fig7.one-dimension", problem=line, axes={"particles": counts_of(5000)}, trials=trials, seed=settings.seed)
    return [published, other, one]


def _fig7(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    maps, other, one = (
        summarise(store, sweep.name, measure) for sweep, measure in zip(sweeps, ("moves", "moves", "coverage"), strict=True)
    )
    curves = [curve_of(label, maps, "particles", published=published_curve(file), map=name) for name, (label, file) in MAPS.items()]
    known = published_curve("complex.csv", points=True, task="mapping", policy="closest-frontier")
    curves.insert(0, curve_of(f"complex: {settings.complex}", other, "particles", published=None if settings.map else known))
    line_file = published_curve("line-full-coverage-m5000.csv")
    curves.append(curve_of("one dimension, 5000 cells", one, "particles", published=line_file))
    compared, worst = _side_by_side(maps)
    beside = _one_dimension(one)
    excess = [row[3] - row[1] for row in beside.rows if row[0] < 5000]
    sentence = (
        f"On the three maps whose curves are published, our means are within {100 * worst:.1f} % of them at every n "
        f"({len(compared.rows)} numbers of particles; the aim is {100 * WITHIN:.0f} %); the tie rule of closest-frontier is not "
        "fully published, and the H-tree's curve is of ten trials a point. One dimension: the published curve lies "
        f"{min(excess):.1f} to {max(excess):.1f} moves above ours, as it takes gaps as differences of positions. "
        f"{_capital(_note_of(settings))}."
    )
    labels = Labels("Mapping by closest-frontier", "particles", "mean moves", note=_note_of(settings))
    shown = (compared, beside, table_of("complex map", other, shown=False), table_of("published maps", maps, shown=False))
    return Outcome(mean_curves(curves, labels), sentence, shown, worst <= WITHIN)


def _side_by_side(maps: list[Row]) -> tuple[Table, float]:
    """Return our means beside the published ones by n, and the largest relative difference."""
    columns, rows, worst = ["n"], {n: [n] for n in counts_of(5000)}, 0.0
    table: dict[int, list[Any]] = dict(rows)
    for name, (label, file) in MAPS.items():
        columns += [f"{label}: ours", "95 % ±", "published", "difference, %"]
        published = published_curve(file)
        ours = {row.values["particles"]: row.estimate for row in maps if row.values["map"] == name}
        for n, mean in zip(published.x.astype(int).tolist(), published.mean.tolist(), strict=True):
            found = ours[n]
            assert found is not None  # the sweep is complete
            off = found.mean / mean - 1
            half = (found.high - found.low) / 2 if found.count > 1 else 0.0
            table[n] += [round(found.mean, 1), round(half, 1), mean, f"{100 * off:+.1f}"]
            worst = max(worst, abs(off))
    return Table("closest-frontier, mean moves", columns, [*table.values()]), worst


def _one_dimension(rows: list[Row]) -> Table:
    published = published_curve("line-full-coverage-m5000.csv")
    ours = {row.values["particles"]: row.estimate for row in rows}
    lines: list[list[Any]] = []
    for n, mean in zip(published.x.astype(int).tolist(), published.mean.tolist(), strict=True):
        found = ours[n]
        assert found is not None  # the sweep is complete
        lines.append([n, round(found.mean, 2), round((found.high - found.low) / 2 if found.count > 1 else 0.0, 2), mean])
    return Table("one dimension, full coverage", ["n", "ours", "95 % ±", "published"], lines)


# Figs. 8 to 11: the complex map


def _fig8_sweeps(settings: Settings) -> list[Sweep]:
    chosen = settings.complex
    particles = max(1, _free_cells(chosen) // 5)
    return [
        Sweep(
            name=f"m-fig8.{_slug(chosen)}",
            problem={"kind": "swarm", "map": chosen, "particles": particles},
            axes={"policy": [*POLICIES]},
            trials=settings.of(100, 20),
            seed=settings.seed,
            paired=("policy",),
        )
    ]


def _fig8(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    sweep = sweeps[0]
    workspace, particles = open_map(settings.complex), sweep.problem["particles"]
    seeds: dict[str, list[int]] = {}
    for policy, trial, seed, *_ in store.rows(sweep.name):
        if trial < 20:
            seeds.setdefault(policy, []).append(seed)
    groups, lines = {}, []
    for policy in POLICIES:  # a row's seed plays its episode again
        episodes = [run(SwarmProblem(workspace, policy=policy, particles=particles), seed=seed) for seed in seeds[policy]]
        groups[policy] = [np.concatenate([[e.first_frontier], e.trace.frontier]) for e in episodes]
        lines += [[policy, k, *_thinned(curve)] for k, curve in enumerate(groups[policy])]
    rows = summarise(store, sweep.name, "moves")
    printed = {"random-moves": 1683, "elect-particle": 578, "closest-frontier": 215}
    table = Table(
        "moves until no frontier is left", ["policy", "ours", "95 % interval", "printed"],
        [
            [
                row.values["policy"], round(row.estimate.mean, 1), "{:.1f} to {:.1f}".format(*ends(row.estimate)),
                printed[row.values["policy"]],
            ]
            for row in rows
            if row.estimate
        ],
    )  # fmt: skip
    means = {row.values["policy"]: row.estimate.mean for row in rows if row.estimate}
    sentence = (
        f"Random moves need {means['random-moves'] / means['closest-frontier']:.1f} and elect-particle "
        f"{means['elect-particle'] / means['closest-frontier']:.1f} times the moves of closest-frontier; printed are "
        f"{1683 / 215:.1f} and {578 / 215:.1f} (the text says ten and two). {_capital(_note_of(settings))}; "
        f"{NO_DATA} but the three means."
    )
    data = Table("frontier cells by move, every k-th", ["policy", "trial", "every", "frontier cells"], lines, shown=False)
    figure = frontier_curves(groups, title=f"{particles} particles on {settings.complex}", note=f"{_note_of(settings)}; {NO_DATA}")
    return Outcome(figure, sentence, (table, data), means["closest-frontier"] < means["elect-particle"] < means["random-moves"])


def _thinned(curve: Any, most: int = 200) -> tuple[int, str]:
    every = max(1, len(curve) // most)
    return every, " ".join(map(str, curve[::every].tolist()))


def _compared(curves: list[Curve], settings: Settings) -> Table:
    """Return our means where something is published, beside it."""
    rows = []
    for curve in curves:
        known = curve.published
        if known is None:
            continue
        for n, mean in zip(known.x.tolist(), known.mean.tolist(), strict=True):
            if curve.x.min() <= n <= curve.x.max():
                ours, low, high = (near(curve.x, values, n) for values in (curve.mean, curve.low, curve.high))
                off = f"{100 * (ours / mean - 1):+.0f}"
                rows.append([curve.label, int(n), round(ours, 1), f"{low:.1f} to {high:.1f}", mean, off])
    return Table("ours and published", ["", "n", "ours", "95 % interval", "published", "difference, %"], rows)


def _off(table: Table) -> str:
    off = [abs(float(row[-1])) for row in table.rows]
    if not off:
        return "not compared with the published points"
    return f"ours differ from the published points by {min(off):.0f} to {max(off):.0f} %"


def _fig9(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    rows = summarise(store, sweeps[0].name, "moves")
    known = {name: published_curve("complex.csv", points=True, task="mapping", policy=name) for name in POLICIES}
    curves = [curve_of(name, rows, "particles", published=None if settings.map else known[name], policy=name) for name in POLICIES]
    table = _compared(curves, settings)
    random, elect, closest = curves
    crossing = [int(n) for n, a, b in zip(random.x, random.mean, elect.mean, strict=True) if a < b]
    sentence = (
        f"Closest-frontier is best at {100 * np.mean((closest.mean <= elect.mean) & (closest.mean <= random.mean)):.0f} % of the "
        f"numbers of particles; random moves beat elect-particle from {min(crossing) if crossing else 'no'} particles on, as "
        f"printed for large numbers. {_capital(_off(table))}: {_note_of(settings)}."
    )
    labels = Labels("Mapping by three policies", "particles", "mean moves", "published, another map", _note_of(settings))
    return Outcome(mean_curves(curves, labels), sentence, (table, table_of("all points", rows, shown=False)), len(crossing) > 0)


def _fig10(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    rows = summarise(store, sweeps[0].name, "moves")
    curves = []
    for task, label in TASKS.items():
        known = published_curve("complex.csv", points=True, task=task, policy="closest-frontier")
        curves.append(curve_of(label, rows, "particles", published=None if settings.map or not len(known.x) else known, task=task))
    table = _compared(curves, settings)
    mapping, covering, subset = (curve.mean for curve in curves)
    easier = float(np.mean((subset <= covering) & (covering <= mapping)))
    sentence = (
        f"Subset coverage is no harder than coverage, and coverage no harder than mapping, at {100 * easier:.0f} % of the numbers "
        f"of particles, as printed. {_capital(_off(table))}: {_note_of(settings)}. With a particle in every cell "
        f"coverage takes {covering[-1]:.0f} moves; the published curve says 1."
    )
    labels = Labels("Mapping, coverage, subset coverage", "particles", "mean moves", "published, another map", _note_of(settings))
    shown = [_positive(curve) for curve in curves]
    return Outcome(mean_curves(shown, labels), sentence, (table, table_of("all points", rows, shown=False)), easier > 0.9)


def _positive(curve: Curve) -> Curve:
    """Return a curve without what a logarithmic axis cannot show."""
    kept = curve.mean > 0
    return Curve(
        curve.label, curve.x[kept], curve.mean[kept], np.maximum(curve.low[kept], 0.05), curve.high[kept], curve.published
    )  # fmt: skip


def _fig11(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    rows = summarise(store, sweeps[0].name, "moves")
    known = published_curve("complex.csv", points=True, task="mapping", policy="closest-frontier")
    curves = [
        curve_of(name, rows, "particles", published=None if settings.map or name != "uniform" else known, placement=name)
        for name in PLACEMENTS
    ]
    flood, region, uniform = (curve.mean for curve in curves)
    below = slice(0, len(flood) - 1)  # with a particle in every cell all are the same
    apart = np.abs(flood[below] / region[below] - 1)
    sentence = (
        f"Uniform placement needs {np.median(uniform[below] / flood[below]):.2f} of the moves of flood fill (median over the "
        f"numbers of particles). Flood fill and region fill differ by {100 * np.median(apart):.0f} % (median); in print they "
        f"overlap. {_capital(_note_of(settings))}; {NO_DATA} but the points of the uniform placement."
    )
    table = _compared(curves, settings)
    labels = Labels(
        "Mapping from three placements",
        "particles",
        "mean moves",
        "published, another map",
        f"{_note_of(settings)}; for the other two {NO_DATA}",
    )
    holds = bool((uniform[below] <= flood[below]).mean() > 0.9)
    return Outcome(mean_curves(curves, labels), sentence, (table, table_of("all points", rows, shown=False)), holds)


RECIPES = (
    Recipe("m-fig7", "paper M, Fig. 7", "Mapping four maps by closest-frontier", _fig7_sweeps, _fig7, True, "D, Fig. 5"),
    Recipe("m-fig8", "paper M, Fig. 8", "Frontier cells by move", _fig8_sweeps, _fig8, True, "D, Fig. 9"),
    Recipe(
        "m-fig9", "paper M, Fig. 9", "Three policies", lambda s: [_on_complex("m-fig9", s, policy=[*POLICIES])], _fig9, True,
        "D, Fig. 6",
    ),
    Recipe(
        "m-fig10", "paper M, Fig. 10", "Mapping, coverage and subset coverage",
        lambda s: [_on_complex("m-fig10", s, task=[*TASKS])], _fig10, True, "D, Fig. 7",
    ),
    Recipe(
        "m-fig11", "paper M, Fig. 11", "Three placements", lambda s: [_on_complex("m-fig11", s, placement=[*PLACEMENTS])], _fig11,
        True, "D, Fig. 8",
    ),
)  # fmt: skip
