"""Paper M: "Mapping and coverage with a particle swarm controlled by uniform inputs" (2017),
figures 7 to 11.
"""

from __future__ import annotations

from math import inf
from typing import Any

import numpy as np

from shoal.lab.statistics import Estimate, Row, summarise
from shoal.lab.store import Store
from shoal.lab.sweep import Sweep, digest_of
from shoal.papers.claims import Claim, claim, curve_claim, mean_ratio, order_claim, ratio
from shoal.papers.recipe import (
    NO_DATA,
    Outcome,
    Recipe,
    Settings,
    Table,
    capital,
    compared,
    counts_of,
    curve_of,
    near,
    published_curve,
    table_of,
    trials_of,
)
from shoal.swarm import SwarmProblem
from shoal.swarm.maps.files import open_map
from shoal.swarm.run import run
from shoal.views.drawing.curves import Curve, Labels, Published, frontier_curves, mean_curves

MAPS = {
    "line:5000": ("linear 1x5000", "closest-frontier-linear-1x5000.csv"),
    "rectangle:50x100": ("rectangle 50x100", "closest-frontier-rectangle-50x100.csv"),
    "htree:5000": ("H-tree, 5000 cells", "closest-frontier-htree-5000.csv"),
}
LINE_FILE, POINTS = "line-full-coverage-m5000.csv", "complex.csv"
SUBSET_FILE = "closest-frontier-subset-coverage-complex.csv"
# printed in the caption of Fig. 8
MEANS = {
    "random-moves": 1683,
    "elect-particle": 578,
    "closest-frontier": 215,
}
POLICIES = tuple(MEANS)
GREEDY: dict[str, Any] = {"kind": "swarm", "policy": "closest-frontier"}
PLACEMENTS = ("flood-fill", "region-fill", "uniform")
TASKS = {
    "mapping": "mapping",
    "coverage": "coverage",
    "subset-coverage": "subset coverage, 10 % of the cells",
}
FIFTH = "subset coverage, 20 % of the cells"
WITHIN = 0.15  # relative to the published mean
TIES = (
    "the tie rule of closest-frontier is not fully published, and others move its means by up to"
    " 30 %"
)
OTHER_MAP = (
    "the picture of the paper's complex map is not published; this is another one of its kind"
)


def _slug(name: str) -> str:
    """Return the name of a map, changed so that it is valid as a part of a sweep's name."""
    plain = "".join(c if c.isascii() and c.isalnum() else "-" for c in name)[:30]
    return f"{plain}-{digest_of(name)[:6]}"


def _on_complex(
    name: str, settings: Settings, fixed: dict[str, Any] | None = None, **axes: Any
) -> Sweep:
    """Return a sweep over numbers of particles on the map that paper M calls complex.

    All other axes of the sweep are paired: along these axes, the k-th trials have equal seeds.
    """
    map_name = settings.complex
    problem = {**GREEDY, "map": map_name, **(fixed or {})}
    axes = axes | {"particles": counts_of(open_map(map_name).n_free)}
    trials, paired = settings.of(100, 20), tuple(axis for axis in axes if axis != "particles")
    return Sweep(
        name=f"{name}.{_slug(map_name)}",
        problem=problem,
        axes=axes,
        trials=trials,
        seed=settings.seed,
        paired=paired,
    )


def _note_of(settings: Settings) -> str:
    """Return a remark about the map that replaces the unpublished complex map of paper M."""
    return (
        f"map {settings.complex}: {OTHER_MAP}"
        if settings.map is None
        else f"map {settings.map}, given by the user"
    )


def _unlike(settings: Settings) -> str:
    """Return why numbers for the complex map are not comparable. For a map of the same size as
    paper M's map, the text is empty.
    """
    workspace = open_map(settings.complex)
    alike = sorted(workspace.shape) == [112, 132] and workspace.n_free == 5000
    return (
        ""
        if alike
        else "another map: the paper's has 5000 free cells in 132 by 112 and is not published"
    )


def _complex_claims(
    label: str, rows: list[Row], reference: Published, settings: Settings
) -> list[Claim]:
    """Return the claims for numbers that paper M prints for its complex map.

    If a printed number lies between two simulated numbers of particles, the function interpolates
    Shoal's values.
    """
    curve, unlike = curve_of(label, rows, "particles"), _unlike(settings)
    claims = []
    for n, mean in zip(reference.x.tolist(), reference.mean.tolist(), strict=True):
        if curve.x.min() <= n <= curve.x.max():
            ours, low, high = (
                near(curve.x, values, n) for values in (curve.mean, curve.low, curve.high)
            )
            allowed = ((1 - WITHIN) * mean, (1 + WITHIN) * mean)
            claims.append(
                claim(
                    f"{label}, mean moves, n = {n:g}",
                    f"{mean:g}",
                    (ours, low, high),
                    within=allowed,
                    why=TIES,
                    unlike=unlike,
                )
            )
    return claims


def _estimates(rows: list[Row], **values: Any) -> dict[int, Estimate]:
    """Return the estimates of all rows with the given axis values, by number of particles."""
    selection = [
        row for row in rows if all(row.values[name] == value for name, value in values.items())
    ]
    return {
        row.values.get("particles", 0): row.estimate
        for row in selection
        if row.estimate is not None
    }


# Fig. 7: four maps, and one dimension


def _fig7_sweeps(settings: Settings) -> list[Sweep]:
    trials = settings.of(100, 40)
    axes = {"map": [*MAPS], "particles": counts_of(5000)}
    published = Sweep(
        name="m-fig7.published-maps", problem=GREEDY, axes=axes, trials=trials, seed=settings.seed
    )
    line = {"kind": "line", "cells": 5000, "placements": 20}
    line_sweep = Sweep(
        name="m-fig7.one-dimension",
        problem=line,
        axes={"particles": counts_of(5000)},
        trials=trials,
        seed=settings.seed,
    )
    return [published, _on_complex("m-fig7", settings), line_sweep]


def _fig7(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    maps, complex_rows, line_rows = (
        summarise(store, sweep.name, measure)
        for sweep, measure in zip(sweeps, ("moves", "moves", "coverage"), strict=True)
    )
    reference = published_curve(POINTS, points=True, task="mapping", policy="closest-frontier")
    curves = [
        curve_of(f"complex: {settings.complex}", complex_rows, "particles", published=reference)
    ]
    curves += [
        curve_of(label, maps, "particles", published=published_curve(file), map=name)
        for name, (label, file) in MAPS.items()
    ]
    curves.append(
        curve_of(
            "one dimension, 5000 cells",
            line_rows,
            "particles",
            published=published_curve(LINE_FILE),
        )
    )
    claims = [
        curve_claim(
            label,
            [row for row in maps if row.values["map"] == name],
            published_curve(file),
            trials=10 if "H-tree" in label else 100,
            margin=WITHIN,
            why=TIES,
        )
        for name, (label, file) in MAPS.items()
    ]
    claims.append(
        curve_claim(
            "one dimension, full coverage",
            line_rows,
            published_curve(LINE_FILE),
            trials=2000,
            margin=0.01,
            why="nothing is left open",
        )
    )
    claims += _complex_claims("complex", complex_rows, reference, settings)
    sentence = (
        "The published curve of one dimension lies above ours, as it takes gaps as differences of"
        " positions; the curve of the H-tree is of ten trials a point. Complex:"
        f" {_note_of(settings)}."
    )
    labels = Labels(
        "Mapping by closest-frontier", "particles", "mean moves", note=_note_of(settings)
    )
    tables = (
        compared(curves),
        table_of("complex map", complex_rows, shown=False),
        table_of("published maps", maps, shown=False),
    )
    return Outcome(mean_curves(curves, labels), tuple(claims), sentence, tables)


# Figs. 8 to 11: the complex map


def _fig8_sweeps(settings: Settings) -> list[Sweep]:
    map_name = settings.complex
    particles = max(1, open_map(map_name).n_free // 5)
    return [
        Sweep(
            name=f"m-fig8.{_slug(map_name)}",
            problem=GREEDY | {"map": map_name, "particles": particles},
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
    for trial in trials_of(store, sweep):
        if trial["trial"] < 20:
            seeds.setdefault(trial["policy"], []).append(trial["seed"])
    groups, lines = {}, []
    for policy in POLICIES:  # a row's seed replays its episode
        episodes = [
            run(SwarmProblem(workspace, policy=policy, particles=particles), seed=seed)
            for seed in seeds[policy]
        ]
        groups[policy] = [np.concatenate([[e.first_frontier], e.trace.frontier]) for e in episodes]
        lines += [[policy, k, *_thin(curve)] for k, curve in enumerate(groups[policy])]
    rows = summarise(store, sweep.name, "moves")
    random, elect, closest = (_estimates(rows, policy=policy)[0] for policy in POLICIES)
    unlike = _unlike(settings)
    claims = [
        claim(
            f"mean moves of {name}",
            printed,
            mean,
            within=((1 - WITHIN) * printed, (1 + WITHIN) * printed),
            why=TIES,
            unlike=unlike,
        )
        for (name, printed), mean in zip(MEANS.items(), (random, elect, closest), strict=True)
    ]
    claims += [
        claim(
            "elect-particle by closest-frontier",
            "on average twice",
            ratio(elect, closest),
            within=(1.5, 2.5),
            unlike=unlike,
        ),
        claim(
            "random moves by closest-frontier",
            "ten times",
            ratio(random, closest),
            within=(9, 11),
            unlike=unlike,
        ),
        claim("elect-particle by closest-frontier", "more", ratio(elect, closest), within=(1, inf)),
        claim("random moves by elect-particle", "more", ratio(random, elect), within=(1, inf)),
    ]
    sentence = (
        "The text's two and ten times do not fit its own means, of which the ratios are"
        f" {578 / 215:.1f} and {1683 / 215:.1f}. {capital(_note_of(settings))}."
    )
    data = Table(
        "frontier cells by move, every k-th",
        ["policy", "trial", "every", "frontier cells"],
        lines,
        shown=False,
    )
    figure = frontier_curves(
        groups,
        title=f"{particles} particles on {settings.complex}",
        printed=MEANS,
        note=f"{_note_of(settings)}; {NO_DATA} but the three means",
    )
    return Outcome(
        figure, tuple(claims), sentence, (table_of("moves until no frontier is left", rows), data)
    )


def _thin(curve: Any, most: int = 200) -> tuple[int, str]:
    every = max(1, len(curve) // most)
    return every, " ".join(map(str, curve[::every].tolist()))


def _fig9(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    rows = summarise(store, sweeps[0].name, "moves")
    references = {
        name: published_curve(POINTS, points=True, task="mapping", policy=name) for name in POLICIES
    }
    curves = [
        curve_of(name, rows, "particles", published=references[name], policy=name)
        for name in POLICIES
    ]
    random, elect, closest = (_estimates(rows, policy=policy) for policy in POLICIES)
    # with a particle in every cell, all tasks are equal
    most = [n for n in random if 0.8 * max(random) <= n < max(random)]
    claims = [
        order_claim(
            "closest-frontier needs fewer than elect-particle", "both are beaten", closest, elect
        ),
        order_claim(
            "closest-frontier needs fewer than random moves", "both are beaten", closest, random
        ),
        order_claim(
            "random moves need fewer than elect-particle, n from 80 % of the cells",
            "slightly better for large n",
            *({n: means[n] for n in most} for means in (random, elect)),
        ),
    ]
    for name in POLICIES:
        claims += _complex_claims(
            name, [row for row in rows if row.values["policy"] == name], references[name], settings
        )
    labels = Labels(
        "Mapping by three policies", "particles", "mean moves", "published", _note_of(settings)
    )
    tables = (compared(curves), table_of("all points", rows, shown=False))
    return Outcome(
        mean_curves(curves, labels), tuple(claims), f"{capital(_note_of(settings))}.", tables
    )


def _fig10(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    own, more = (summarise(store, sweep.name, "moves") for sweep in sweeps)
    for row in more:
        row.values["task"] = FIFTH
    rows = own + more
    references = {
        task: published_curve(POINTS, points=True, task=task, policy="closest-frontier")
        for task in TASKS
    }
    references["subset-coverage"] = published_curve(SUBSET_FILE)
    curves = [
        curve_of(label, rows, "particles", published=references.get(task), task=task)
        for task, label in (TASKS | {FIFTH: FIFTH}).items()
    ]
    mapping, covering, subset = (_estimates(rows, task=task) for task in TASKS)
    claims = [
        order_claim("subset coverage needs fewer moves than coverage", "easier", subset, covering),
        order_claim("coverage needs fewer moves than mapping", "easier", covering, mapping),
    ]
    if max(covering) == open_map(settings.complex).n_free:
        claims.append(
            claim("coverage with a particle in every cell", "1", covering[max(covering)].mean)
        )
    at = np.isin(references["subset-coverage"].x, references["coverage"].x)
    plotted_subset = Published(
        references["subset-coverage"].x[at], references["subset-coverage"].mean[at]
    )
    for task, label, points in (
        ("mapping", "mapping", references["mapping"]),
        ("coverage", "coverage", references["coverage"]),
        ("subset-coverage", "a tenth of the cells, as in the text", plotted_subset),
        (FIFTH, "a fifth of the cells", plotted_subset),
    ):
        claims += _complex_claims(
            label, [row for row in rows if row.values["task"] == task], points, settings
        )
    sentence = (
        "The published curve of subset coverage lies above that of a tenth of the cells; see the"
        f" errata. {capital(_note_of(settings))}."
    )
    labels = Labels(
        "Mapping, coverage and subset coverage",
        "particles",
        "mean moves",
        "published, subset coverage",
        f"{_note_of(settings)}; means of 0 are left out",
    )
    figure = mean_curves([_positive(curve) for curve in curves], labels)
    return Outcome(
        figure,
        tuple(claims),
        sentence,
        (compared(curves), table_of("all points", rows, shown=False)),
    )


def _positive(curve: Curve) -> Curve:
    """Return a curve without the means that a logarithmic axis cannot show."""
    positive = curve.mean > 0
    return Curve(
        curve.label,
        curve.x[positive],
        curve.mean[positive],
        np.maximum(curve.low[positive], 0.05),
        curve.high[positive],
        curve.published,
    )


def _fig11(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    rows = summarise(store, sweeps[0].name, "moves")
    reference = published_curve(POINTS, points=True, task="mapping", policy="closest-frontier")
    curves = [
        curve_of(
            name.replace("-", " "),
            rows,
            "particles",
            published=reference if name == "uniform" else None,
            placement=name,
        )
        for name in PLACEMENTS
    ]
    flood, region, uniform = (_estimates(rows, placement=name) for name in PLACEMENTS)
    # with a particle in every cell, all tasks are equal
    counts = [n for n in flood if n < max(flood)]
    claims = [
        order_claim(
            "uniform placement needs fewer moves than flood fill", "many fewer", uniform, flood
        ),
        claim(
            "flood fill by region fill, mean of the ratios over n",
            "overlap",
            mean_ratio(flood, region, counts),
            within=(0.85, 1.15),
            why="curves within 15 % of each other overlap in the paper's drawing",
        ),
        *_complex_claims(
            "uniform",
            [row for row in rows if row.values["placement"] == "uniform"],
            reference,
            settings,
        ),
    ]
    labels = Labels(
        "Mapping from three placements",
        "particles",
        "mean moves",
        "published, uniform",
        f"{_note_of(settings)}; no data are published for flood fill and region fill",
    )
    tables = (compared(curves), table_of("all points", rows, shown=False))
    return Outcome(
        mean_curves(curves, labels), tuple(claims), f"{capital(_note_of(settings))}.", tables
    )


def _fig10_sweeps(settings: Settings) -> list[Sweep]:
    fifth = {"task": "coverage", "subset": 0.2}
    return [
        _on_complex("m-fig10", settings, task=[*TASKS]),
        _on_complex("m-fig10.fifth", settings, fifth),
    ]


RECIPES = tuple(
    Recipe(
        f"m-fig{number}",
        f"paper M, Fig. {number}",
        title,
        sweeps,
        view,
        on_map=True,
        also=f"D, Fig. {also}",
    )
    for number, title, sweeps, view, also in (
        (7, "Mapping four maps by closest-frontier", _fig7_sweeps, _fig7, 5),
        (8, "Frontier cells by move", _fig8_sweeps, _fig8, 9),
        (9, "Three policies", lambda s: [_on_complex("m-fig9", s, policy=[*POLICIES])], _fig9, 6),
        (10, "Mapping, coverage and subset coverage", _fig10_sweeps, _fig10, 7),
        (
            11,
            "Three placements",
            lambda s: [_on_complex("m-fig11", s, placement=[*PLACEMENTS])],
            _fig11,
            8,
        ),
    )
)
