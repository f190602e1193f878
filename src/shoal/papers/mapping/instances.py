"""Paper M: figure 1, the map instances of figures 3 and 4, and theorem 3.

The instances of figures 3 and 4 are maps on which the policy closest-frontier performs badly.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.lab.statistics import summarise
from shoal.lab.store import Store
from shoal.lab.sweep import Sweep
from shoal.papers.claims import claim, exponent, ratio
from shoal.papers.recipe import (
    NO_DATA,
    Outcome,
    Recipe,
    Settings,
    Table,
    function_sweep,
    measuring,
    table_of,
    trials_of,
)
from shoal.swarm import SwarmEpisode, SwarmProblem
from shoal.swarm.maps.files import open_map
from shoal.swarm.run import run
from shoal.views.drawing.curves import Curve, Labels, Published, draw_curves, mean_curves
from shoal.views.swarm.figures import map_panels

Cells = tuple[tuple[int, int], ...]
GROUND = "vessels:500"
PRINTED = {4: 2394, 300: 82}  # numbers of moves in Fig. 1, by particles
STEPS = ((1, 0), (-1, 0), (0, 1), (0, -1))


def square_below(n: int) -> tuple[NDArray[np.bool_], Cells]:
    """Return the map of figure 3 of paper M, and start cells of particles that fill its corridor.

    The map consists of a square of n by n cells and a corridor of n cells above the right end of
    the square.
    """
    free = np.zeros((2 * n, n), dtype=np.bool_)
    free[n:], free[:, -1] = True, True
    return free, tuple((row, n - 1) for row in range(n))


def two_arms(k: int) -> tuple[NDArray[np.bool_], Cells]:
    """Return the map of figure 4 of paper M (two corridors of k cells from one corner), and the
    start cells of two particles.

    One particle starts in the corner, and one particle starts at the end of a corridor.
    """
    free = np.zeros((k + 1, k + 1), dtype=np.bool_)
    free[0], free[:, 0] = True, True
    return free, ((0, 0), (0, k))


def _moves(ground: NDArray[np.bool_], start: Cells, policy: str, task: str) -> int:
    return run(SwarmProblem(ground, start=start, policy=policy, task=task)).moves


@measuring("greedy", "together")
def square_moves(*, seed: int, n: int) -> dict[str, int]:
    """Return how many moves the policy closest-frontier and a fixed plan need to explore the map of
    figure 3.

    The fixed plan drives all particles into the square at once.
    """
    ground, start = square_below(n)
    together = f"lru{'d' * n}r{'udl' * n}"
    return {
        "greedy": _moves(ground, start, "closest-frontier", "mapping"),
        "together": _moves(ground, start, f"manual:{together}", "mapping"),
    }


@measuring("greedy", "depth_first", "greedy_mapping", "depth_first_mapping")
def arm_moves(*, seed: int, k: int) -> dict[str, int]:
    """Return the numbers of moves that two policies need on the map of figure 4, for coverage and
    for mapping.

    The two policies are closest-frontier with both particles, and depth-first search with particle
    2 alone.
    """
    ground, start = two_arms(k)
    return {
        f"{name}{suffix}": _moves(ground, cells, policy, task)
        for task, suffix in (("coverage", ""), ("mapping", "_mapping"))
        for name, policy, cells in (
            ("greedy", "closest-frontier", start),
            ("depth_first", "depth-first", start[1:]),
        )
    }


@measuring("searches", "cells_looked_at", "free_cells", "moves")
def search_work(*, seed: int, map: str) -> dict[str, int]:  # noqa: A002 - a field of the problem
    """Return how many breadth-first searches, expanded cells and moves the policy closest-frontier
    needs with one particle.
    """
    free = np.pad(open_map(map).free, 1)
    cell: tuple[int, ...] = tuple(np.random.default_rng(seed).choice(np.argwhere(free)).tolist())
    explored: dict[tuple[int, ...], bool] = {cell: True}
    searches = expanded = moves = 0
    while True:
        before: dict[tuple[int, ...], tuple[int, ...]] = {cell: cell}
        queue, pair = deque([cell]), None
        while queue and pair is None:
            current = queue.popleft()
            expanded += 1
            for step in STEPS:
                neighbour = (current[0] + step[0], current[1] + step[1])
                if neighbour not in explored:
                    pair = current, neighbour
                    break
                if explored[neighbour] and neighbour not in before:
                    before[neighbour] = current
                    queue.append(neighbour)
        if pair is None:
            return {
                "searches": searches,
                "cells_looked_at": expanded,
                "free_cells": int(free.sum()),
                "moves": moves,
            }
        searches += 1
        current, neighbour = pair
        explored[neighbour] = bool(free[neighbour])
        back, moves = current, moves + 1
        while before[back] != back:
            back, moves = before[back], moves + 1
        cell = neighbour if explored[neighbour] else current


# Fig. 1


def _fig1_sweeps(settings: Settings) -> list[Sweep]:
    problem = {"kind": "swarm", "map": GROUND, "policy": "closest-frontier"}
    return [
        Sweep(
            name="m-fig1",
            problem=problem,
            axes={"particles": [*PRINTED]},
            trials=settings.of(100, 20),
            seed=settings.seed,
        )
    ]


def _fig1(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    rows = summarise(store, sweeps[0].name, "moves")
    few, many = (row.estimate for row in rows)
    assert few is not None  # the sweep is complete
    assert many is not None  # as above
    unlike = "its map of 500 free cells, its start and its policy are not published"
    claims = [
        claim(f"moves with {n} particles", str(printed), value, unlike=unlike)
        for (n, printed), value in zip(PRINTED.items(), (few, many), strict=True)
    ]
    claims.append(
        claim(
            "moves with 4 particles by those with 300",
            "29: many are faster",
            ratio(few, many),
            within=(10, 87),
            why="29 up to a factor of 3",
        )
    )
    seeds = {trial["particles"]: trial["seed"] for trial in reversed(trials_of(store, sweeps[0]))}
    episodes = [
        run(SwarmProblem(GROUND, policy="closest-frontier", particles=n), seed=seed)
        for n, seed in sorted(seeds.items())
    ]
    panels = [
        (episode, moves) for episode in episodes for moves in (0, episode.moves // 4, episode.moves)
    ]
    return Outcome(
        map_panels(panels, columns=3),
        tuple(claims),
        f"Drawn is the first of the trials on {GROUND}, another map.",
        (table_of("moves", rows),),
        NO_DATA,
    )


# Figs. 3 and 4


def _measures_by(
    store: Store, sweep: Sweep, axis: str
) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]], Table]:
    """Return, for a sweep without random numbers, the values of ``axis``, the values of each
    measure, and a table of all values.
    """
    trials = trials_of(store, sweep)
    columns = [axis, *sweep.measures]
    table = np.array([[trial[name] for name in columns] for trial in trials], dtype=np.float64)
    values = dict(zip(sweep.measures, table[:, 1:].T, strict=True))
    return (
        table[:, 0],
        values,
        Table("moves", [name.replace("_", " ") for name in columns], table.astype(int).tolist()),
    )


def _fig3_sweeps(settings: Settings) -> list[Sweep]:
    return [
        function_sweep(
            "m-fig3",
            square_moves,
            {"n": [4, 8, 16, 32, 64] + [128, 256] * (not settings.quick)},
            1,
            settings,
        )
    ]


def _fig3(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    n, results, table = _measures_by(store, sweeps[0], "n")
    # the last n is twice the previous one
    powers = {name: float(np.log2(values[-1] / values[-2])) for name, values in results.items()}
    claims = (
        claim(
            "closest-frontier: exponent of n, from the last doubling",
            "2",
            powers["greedy"],
            within=(1.8, 2.2),
            why="Ω(n²)",
        ),
        claim(
            "all particles at once: exponent of n",
            "1",
            powers["together"],
            within=(0.8, 1.2),
            why="O(n)",
        ),
        claim(
            "closest-frontier: least moves by n²",
            "Ω(n²)",
            float(np.min(results["greedy"] / n**2)),
            within=(1, np.inf),
            why="n² is the number of cells that one particle visits",
        ),
    )
    ground, start = square_below(12)
    episode = run(SwarmProblem(ground, start=start, policy="closest-frontier"))
    return _with_map(
        episode,
        [0, 20, 60, 120],
        n,
        {"closest-frontier": results["greedy"], "all particles at once": results["together"]},
        Labels(
            "The instance of Fig. 3",
            "side n",
            "moves",
            note="the paper draws the instance, and states Ω(n²) and O(n)",
        ),
        claims,
        "The corridor and ties are ours, as the paper only draws the idea. The lead particle goes"
        " left before the others come.",
        table,
    )


def _fig4_sweeps(settings: Settings) -> list[Sweep]:
    return [
        function_sweep(
            "m-fig4",
            arm_moves,
            {"k": [5, 10, 20, 50, 100, 200] + [400, 800] * (not settings.quick)},
            1,
            settings,
        )
    ]


def _fig4(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    k, results, table = _measures_by(store, sweeps[0], "k")
    shares = [
        results[f"greedy{suffix}"] / results[f"depth_first{suffix}"] for suffix in ("", "_mapping")
    ]
    claims = (
        claim(
            f"moves to visit all cells, by those of depth-first search, k = {k[-1]:g}",
            "1.5",
            float(shares[0][-1]),
        ),
        claim(
            "the same if walls are to be found, too",
            "1.5",
            float(shares[1][-1]),
            unlike="it is open whether the paper counts walls",
        ),
    )
    ground, start = two_arms(24)
    episode = run(SwarmProblem(ground, start=start, policy="closest-frontier", task="coverage"))
    return _with_map(
        episode,
        [0, 23, 47, 58],
        k,
        {"visit all cells": shares[0], "find all walls, too": shares[1]},
        Labels(
            "The instance of Fig. 4",
            "cells of an arm, k",
            "moves by those of depth-first",
            note="the paper draws the instance, and states 1.5",
        ),
        claims,
        "Particle 1 first goes to particle 2 and back; particle 2 alone goes through both arms."
        " Walls are found faster by two.",
        table,
        level=1.5,
    )


def _with_map(
    episode: SwarmEpisode,
    moments: Sequence[int],
    x: NDArray[np.float64],
    curves: dict[str, NDArray[np.float64]],
    labels: Labels,
    claims: tuple[Any, ...],
    sentence: str,
    table: Table,
    *,
    level: float | None = None,
) -> Outcome:
    """Return the outcome for a map instance. The figure shows pictures of a small instance above a
    chart of the moves.
    """
    printed = None if level is None else Published(x, np.full(len(x), level))
    lines = [
        Curve(name, x, values, values, values, None if k else printed)
        for k, (name, values) in enumerate(curves.items())
    ]
    figure = map_panels(
        [(episode, moves) for moves in moments],
        columns=len(moments),
        chart=lambda axes: draw_curves(axes, lines, labels, log_x=True, log_y=level is None),
    )
    return Outcome(figure, claims, sentence, (table,), labels.note)


# Theorem 3

KINDS = {
    "line": "line:{}",
    "rectangle": "rectangle:{}x{}",
    "H-tree": "htree:{}",
    "vessels": "vessels:{}",
}


def _theorem3_sweeps(settings: Settings) -> list[Sweep]:
    sides = [10, 14, 20, 28, 40] + [56, 80] * (not settings.quick)
    maps = [f"line:{side**2}" for side in sides] + [f"rectangle:{side}x{side}" for side in sides]
    maps += [f"{kind}:{side**2}" for kind in ("htree", "vessels") for side in sides]
    return [function_sweep("m-theorem3", search_work, {"map": maps}, settings.of(10, 3), settings)]


def _theorem3(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    records: dict[str, list[tuple[int, int, int]]] = {}
    for trial in trials_of(store, sweeps[0]):
        kind = trial["map"].partition(":")[0]
        records.setdefault(kind, []).append(
            (trial["free_cells"], trial["cells_looked_at"], trial["searches"])
        )
    claims, curves = [], []
    for kind, trials in records.items():
        m, expanded, _ = np.array(trials, dtype=np.float64).T
        claims.append(
            claim(
                f"{kind}: exponent of m in the cells looked at",
                "2 at most",
                exponent(m, expanded),
                within=(0, 2),
                why="O(m²)",
            )
        )
        sizes = np.unique(m)
        of_size = [expanded[m == size] for size in sizes]
        mean = np.array([values.mean() for values in of_size])
        curves.append(
            Curve(
                kind,
                sizes,
                mean,
                np.array([v.min() for v in of_size]),
                np.array([v.max() for v in of_size]),
            )
        )
    every = np.array([trial for trials in records.values() for trial in trials], dtype=np.float64)
    claims.append(
        claim(
            "searches by m, most",
            "1 at most",
            float(np.max(every[:, 2] / every[:, 0])),
            within=(0, 1),
            why="the proof has m searches at most; each wall cell takes one, too",
        )
    )
    curves.append(Curve("m²", sizes, sizes**2, sizes**2, sizes**2))
    rows = [[kind, *map(int, trial)] for kind, trials in records.items() for trial in trials]
    table = Table("trials", ["map", "m", "cells looked at", "searches"], rows, shown=False)
    labels = Labels(
        "Work of closest-frontier, one particle",
        "free cells m",
        "cells looked at by all searches",
        note="the paper has no figure of it",
        band="least to most of the trials",
    )
    return Outcome(
        mean_curves(curves, labels, log_x=True),
        tuple(claims),
        "Counted by a plain breadth-first search, which looks at each cell once. The order holds"
        " with up to 3 m + 1 searches, too.",
        (table,),
    )


RECIPES = (
    Recipe(
        "m-fig1", "paper M, Fig. 1", "Mapping with 4 and with 300 particles", _fig1_sweeps, _fig1
    ),
    Recipe("m-fig3", "paper M, Fig. 3", "An instance of Ω(n²) moves", _fig3_sweeps, _fig3),
    Recipe(
        "m-fig4",
        "paper M, Fig. 4",
        "An instance worse than depth-first search",
        _fig4_sweeps,
        _fig4,
    ),
    Recipe(
        "m-theorem3",
        "paper M, theorem 3",
        "The work of closest-frontier",
        _theorem3_sweeps,
        _theorem3,
    ),
)
