"""Paper M: moves and scans in two dimensions, which the paper leaves open."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from math import inf, log

import numpy as np
from numpy.typing import NDArray

from shoal.lab.store import Store
from shoal.lab.sweep import Sweep
from shoal.papers.claims import claim, exponent
from shoal.papers.recipe import Outcome, Recipe, Settings, Table
from shoal.swarm import SwarmProblem
from shoal.swarm.run import run
from shoal.swarm.theory.combs import (
    comb_map,
    comb_start,
    confirming_commands,
    least_comb_moves,
    least_comb_scans,
)
from shoal.swarm.theory.exploration import STEPS, Cell
from shoal.views.drawing.curves import Curve, Labels, mean_curves

KNOWING = 3  # scans of one who knows the comb


def _ends(free: NDArray[np.bool_], start: Cell, commands: tuple[str, str]) -> tuple[Cell, Cell]:
    """Return where a particle is after both parts of the commands."""
    padded, places = np.pad(free, 1), []
    row, column = start[0] + 1, start[1] + 1
    for half in commands:
        for letter in half:
            down, right = STEPS[letter]
            if padded[row + down, column + right]:
                row, column = row + down, column + right
        places.append((row, column))
    return places[0], places[1]


def confirmed_share(places: int) -> float:
    """Return for how many of all pairs of different combs the commands that confirm the first end
    elsewhere in the second.
    """
    combs = [*product((False, True), repeat=places)]
    maps, start = [comb_map(teeth) for teeth in combs], comb_start(places)
    distinct = pairs = 0
    for k, teeth in enumerate(combs):
        commands = confirming_commands(teeth)
        ends = [_ends(free, start, commands) for free in maps]
        distinct += sum(end != ends[k] for j, end in enumerate(ends) if j != k)
        pairs += len(combs) - 1
    return distinct / pairs


def _curve(label: str, x: Sequence[float], y: Sequence[float]) -> Curve:
    exact = np.array(y, dtype=np.float64)
    return Curve(label, np.array(x, dtype=np.float64), exact, exact, exact)


def _bicriterion(_store: Store, _sweeps: list[Sweep], settings: Settings) -> Outcome:
    most = 5 if settings.quick else 8
    sizes = [1, 3, 10, 30, 100, 300] + [1000, 3000, 10000] * (not settings.quick)
    cells = [4 * k + 3 for k in sizes]
    swarms = {n: [max(1.0, (least_comb_scans(k, n) + 1) / KNOWING) for k in sizes] for n in (1, 3)}
    rng = np.random.default_rng(settings.seed)
    played = []
    for k in (size for size in sizes if 10 <= size <= 1000):
        free = comb_map((rng.random(k) < 0.5).tolist())
        for every in ("adaptive", "doubling"):
            problem = SwarmProblem(
                free, start=(comb_start(k),), policy="closest-frontier", scan_every=every
            )
            episode = run(problem, seed=settings.seed)
            played.append((k, every, episode.moves, episode.scans))
    games = [(k, s) for k in (1, 2) for s in (1, 2)] + [(3, 3)] + [(3, 2)] * (not settings.quick)
    fewest = {(k, s): least_comb_moves(k, s) for k, s in games}
    claims = (
        claim(
            f"pairs of combs of up to {most} places that {KNOWING} scans tell apart, if one is"
            " expected",
            "2 scans, in one dimension",
            min(confirmed_share(k) for k in range(1, most + 1)),
            within=(1, 1),
            why="so that the best possible number of scans does not grow with the map",
        ),
        claim(
            f"exponent of the least ratio of scans by cells, {cells[-4]} to {cells[-1]} cells",
            "left open in two dimensions",
            exponent(cells[-4:], swarms[1][-4:]),
            unlike="proven here: m / log m at least, and m at most; 0 in one dimension",
        ),
        claim(
            "scans of closest-frontier by the least of any policy, smallest",
            "1 at least",
            min((scans - 1) / least_comb_scans(k) for k, _, _, scans in played),
            within=(1, inf),
            why="the bound holds for every policy",
        ),
        claim(
            "2 places: fewest moves of any policy with 1 scan by those with 2 scans",
            "not said",
            fewest[2, 1] / fewest[2, 2],
            unlike="the paper has no such game; the search over all policies is exact",
        ),
    )
    curves = [
        _curve(f"lower bound for any policy, {n} particle{'s' * (n > 1)}", cells, values)
        for n, values in swarms.items()
    ]
    law = [log(m) / log(log(m)) for m in cells[1:]]
    curves.append(_curve("log D / log log D: one dimension", cells[1:], law))
    for every in ("adaptive", "doubling"):
        own = [(4 * k + 3, scans / KNOWING) for k, kind, _, scans in played if kind == every]
        at, ratio = zip(*own, strict=True)
        curves.append(_curve(f"closest-frontier, {every} scans", at, ratio))
    labels = Labels(
        "Scans to map a comb",
        "cells",
        "scans by those of one who knows",
        note="no policy is below its lower bound, with any number of moves",
    )
    tables = (
        Table(
            "least ratio of scans",
            ["places", "cells", "1 particle", "3 particles"],
            [
                [k, m, *(round(values[i], 3) for values in swarms.values())]
                for i, (k, m) in enumerate(zip(sizes, cells, strict=True))
            ],
        ),
        Table("closest-frontier", ["places", "scans after", "moves", "scans"], played),
        Table(
            "fewest moves of any policy",
            ["places", "scans after the start", "moves"],
            [[k, s, moves] for (k, s), moves in fewest.items()],
        ),
    )
    sentence = (
        "The paper leaves the analysis of two dimensions open. A comb of k places for teeth needs"
        " k / log2(cells) scans or more, as each scan shows only in which cell the particle is;"
        f" one who knows the comb confirms it with {KNOWING} scans and 7 k + 2 moves at most. No"
        " schedule therefore keeps both ratios below a constant times m / log m, while scans after"
        " every move keep them within a constant times m. What remains open is the factor log m."
    )
    return Outcome(mean_curves(curves, labels, log_x=True), claims, sentence, tables)


RECIPES = (
    Recipe(
        "m-bicriterion",
        "paper M, section V",
        "Moves and scans in two dimensions",
        lambda _: [],
        _bicriterion,
        also="M, section III.A.3",
    ),
)
