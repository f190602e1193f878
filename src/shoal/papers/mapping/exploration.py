"""Papers M and D: the adversary of a corridor, SmartDFS, the reduction of Hamiltonian paths, the
worst case of a line, and the largest gap by its asymptotic law.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import combinations
from math import log, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np

from shoal.lab.store import Store
from shoal.lab.sweep import Sweep
from shoal.papers.claims import claim
from shoal.papers.recipe import Outcome, Recipe, Settings, Table
from shoal.swarm import GridWorkspace, SwarmProblem
from shoal.swarm.adversary import play_adversary
from shoal.swarm.run import run
from shoal.swarm.theory.bounds import optimum
from shoal.swarm.theory.exploration import (
    STEPS,
    Cell,
    coverage_instance,
    least_corridor_ratio,
    smart_dfs,
)
from shoal.swarm.theory.one_dimension import Line
from shoal.views.drawing.charts import (
    BLUE,
    GRID,
    INK,
    MUTED,
    ORANGE,
    padded_figure,
    plain_axes,
    set_title,
)
from shoal.views.drawing.curves import Curve, Labels, mean_curves

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Region = frozenset[Cell]
POLICIES = ("closest-frontier", "depth-first", "elect-particle", "random-moves")
BESIDE = tuple(STEPS.values())
NO_FIGURE = "the paper has no figure of it"


def polyominoes(most: int) -> Iterator[Region]:
    """Yield all connected regions of at most ``most`` cells up to translation, smallest first."""
    level = {frozenset({(0, 0)})}
    for size in range(1, most + 1):
        yield from sorted(level, key=sorted)
        if size < most:
            level = {
                _to_origin(region | {neighbour})
                for region in level
                for cell in region
                for neighbour in _beside(cell)
                if neighbour not in region
            }


def _to_origin(region: Region) -> Region:
    top, left = (min(values) for values in zip(*region, strict=True))
    return frozenset((row - top, column - left) for row, column in region)


def _beside(cell: Cell) -> list[Cell]:
    return [(cell[0] + row, cell[1] + column) for row, column in BESIDE]


def has_holes(region: Region) -> bool:
    """Return whether walls lie inside a region: cells outside that have no way around it."""
    from scipy.ndimage import label

    free = np.pad(coverage_instance(region, min(region)).free, 1)
    return int(label(~free, structure=np.ones((3, 3)))[1]) > 1


def path_lengths(region: Region, start: Cell) -> tuple[int, int | None]:
    """Return the moves of a shortest closed tour from a start through all cells of a small region,
    and those of a shortest open path if it visits no cell twice, else None.
    """
    cells = sorted(region)
    number = {cell: k for k, cell in enumerate(cells)}
    beside = [
        [number[neighbour] for neighbour in _beside(cell) if neighbour in number] for cell in cells
    ]
    all_cells, first = (1 << len(cells)) - 1, number[start]
    states, reached, moves = {(first, 1 << first)}, {(first, 1 << first)}, 0
    hamiltonian = None
    while (first, all_cells) not in reached:
        if hamiltonian is None and moves < len(cells) and any(v == all_cells for _, v in states):
            hamiltonian = moves
        moves += 1
        states = {
            (neighbour, visited | 1 << neighbour)
            for at, visited in states
            for neighbour in beside[at]
        } - reached
        reached |= states
    return moves, 0 if all_cells == 1 else hamiltonian


# The adversary of a corridor


def _adversary(_store: Store, _sweeps: list[Sweep], settings: Settings) -> Outcome:
    sizes_played = [5, 10, 20, 40] + [80, 160] * (not settings.quick)
    played = [(policy, n, settings.seed) for policy in POLICIES[:-1] for n in sizes_played]
    played += [(POLICIES[-1], 10, settings.seed + k) for k in range(settings.of(10, 3))]
    trials: list[dict[str, Any]] = []
    for policy, cells, seed in played:
        game = play_adversary(policy, cells, seed=seed)
        trials.append(
            {
                "policy": policy,
                "cells": cells,
                "left": game.left,
                "right": game.right,
                "moves": game.moves,
                "least": game.least,
                "ratio": game.ratio,
            }
        )
    largest = sizes_played[-1]
    sizes = np.array([1, 2, 3, 5, 8, 12, 18] + [26, 40] * (not settings.quick))
    least = np.array([float(least_corridor_ratio(int(n))) for n in sizes])
    claims = [
        claim(
            f"{policy}: ratio in the corridor that the adversary chooses, {cells} cells a side",
            "2 or more",
            min(t["ratio"] for t in trials if t["policy"] == policy and t["cells"] == cells),
            within=(2 - 3 / (cells + 2), np.inf),
            why="2 but for the moves that touch the ends",
        )
        for policy in POLICIES
        for cells in [max(t["cells"] for t in trials if t["policy"] == policy)]
    ]
    claims.append(
        claim(
            f"least ratio that any policy can guarantee, up to {sizes[-1]} cells a side",
            "2 in the limit",
            float(least[-1]),
            within=(2 - 3 / (float(sizes[-1]) + 2), 2),
            why="found by trying all turning points; below 2 by the moves that touch the ends",
        )
    )
    curves = [Curve("best of all policies", sizes.astype(float), least, least, least)]
    alike: dict[tuple[float, ...], list[str]] = {}
    for policy in POLICIES[:-1]:
        alike.setdefault(tuple(t["ratio"] for t in trials if t["policy"] == policy), []).append(
            policy
        )
    x = np.array(sizes_played, dtype=np.float64)
    for ratios, policies in alike.items():
        y = np.array(ratios)
        curves.append(Curve(", ".join(policies), x, y, y, y))
    flat = np.full(2, 2.0)
    curves.append(Curve("limit", np.array([1.0, largest]), flat, flat, flat))
    columns = ["policy", "cells", "left", "right", "moves", "least", "ratio"]
    rows = [[t[name] for name in columns[:-1]] + [round(t["ratio"], 4)] for t in trials]
    labels = Labels(
        "The adversary of a corridor",
        "most cells on each side of the start",
        "moves by those of one who knows",
        note=f"one particle; only moves along the corridor count; {NO_FIGURE}",
    )
    sentence = (
        "In the paper the explorer sees the ends; here it touches them, so that an end may lie"
        f" directly beside the start. With {largest} cells a side the three deterministic policies"
        " go to one side only, and the adversary needs no zig-zag against them."
    )
    return Outcome(
        mean_curves(curves, labels, log_x=True, log_y=False),
        tuple(claims),
        sentence,
        (Table("games", columns, rows),),
    )


# SmartDFS


def _smart(_store: Store, _sweeps: list[Sweep], settings: Settings) -> Outcome:
    most = 7 if settings.quick else 9
    ratios, excess, plain, start_count = [], [], [], 0
    worst: tuple[float, Region, Cell] = (0.0, frozenset({(0, 0)}), (0, 0))
    for region in polyominoes(most):
        if len(region) < 2 or has_holes(region):
            continue
        free = coverage_instance(region, min(region)).free
        shortest, _ = path_lengths(region, min(region))  # a closed tour has no first cell
        edges = sum(neighbour not in region for cell in region for neighbour in _beside(cell))
        for start in sorted(region):
            if all(neighbour in region for neighbour in _beside(start)):
                continue  # SmartDFS starts beside a wall
            moves = len(smart_dfs(free, start)) - 1
            start_count += 1
            ratios.append(moves / shortest)
            excess.append(moves - (len(region) + edges / 2 - 3))
            plain.append((2 * len(region) - 2) / shortest)
            if ratios[-1] >= worst[0]:
                worst = ratios[-1], region, start
    # corridors of width 3 and even length, from a corner: a shortest tour has 3 moves a column
    lengths = np.array([2, 4, 8, 16, 32, 64] + [128, 256] * (not settings.quick))
    corridor = np.array([len(smart_dfs(np.ones((3, n)), (2, n - 1))) - 1 for n in lengths])
    claims = (
        claim(
            f"SmartDFS: largest ratio, all {start_count} starts in regions of up to {most} cells",
            "4/3 at most",
            max(ratios),
            within=(1, 4 / 3),
            why="against the shortest closed tour",
        ),
        claim(
            "corridors of width 3: moves less 4/3 of a shortest tour, largest distance from -2",
            "0: the ratio is reached in the limit",
            float(np.abs(corridor - 4 * lengths + 2).max()),
            within=(0, 0),
            why=f"the ratio is {corridor[-1] / (3 * lengths[-1]):.3f} at {lengths[-1]} columns",
        ),
        claim(
            "moves less C + E/2 - 3, most",
            "0 at most",
            max(excess),
            within=(-np.inf, 0),
            why="the bound of Icking et al. from which 4/3 follows",
        ),
        claim(
            "plain depth-first search: largest ratio",
            "2 at most",
            max(plain),
            within=(1, 2),
            why="each edge of its tree is walked twice",
        ),
    )
    figure = padded_figure(12.0, 3.8)
    axes, chart, family = figure.subplots(1, 3)
    _draw_region(axes, worst[1], smart_dfs(coverage_instance(worst[1], worst[2]).free, worst[2]))
    set_title(axes, f"the worst: {worst[0]:.3f}")
    bins = np.linspace(1, 2, 21)
    chart.hist([ratios, plain], bins=bins, color=[BLUE, ORANGE], label=["SmartDFS", "depth-first"])
    chart.axvline(4 / 3, color=INK, lw=1.2, ls="--", label="4/3")
    chart.set(xlabel="moves by those of a shortest tour", ylabel="starts", yscale="log")
    chart.legend(frameon=False, fontsize=9)
    set_title(chart, f"regions of 2 to {most} cells without holes")
    family.plot(lengths, corridor / (3 * lengths), "-o", color=BLUE)
    family.axhline(4 / 3, color=INK, lw=1.2, ls="--")
    family.set(xscale="log", xlabel="columns", ylabel="ratio of SmartDFS")
    set_title(family, "corridors of width 3")
    plain_axes(chart)
    plain_axes(family)
    values, counts = np.unique(np.round(ratios, 4), return_counts=True)
    table = Table(
        "ratios of SmartDFS",
        ["ratio", "starts"],
        [[float(v), int(c)] for v, c in zip(values, counts, strict=True)],
    )
    sentence = (
        "The paper cites 4/3 and states 7/6 as the best possible ratio, which is out of date: the"
        " known bounds are 13/11 and 5/4 (errata). All starts are beside a wall, as SmartDFS needs."
    )
    return Outcome(figure, claims, sentence, (table,), NO_FIGURE)


def _draw_region(axes: Axes, region: Region, path: list[Cell]) -> None:
    """Draw the cells of a region and a tour, whose later parts lie a little aside."""
    for row, column in region:
        axes.fill(
            [column - 0.5, column + 0.5, column + 0.5, column - 0.5],
            [row - 0.5, row - 0.5, row + 0.5, row + 0.5],
            facecolor="white",
            edgecolor=GRID,
        )
    aside = 0.24 * np.linspace(-1, 1, len(path))
    polyline = np.array(path, dtype=np.float64)[:, ::-1] + aside[:, None]
    axes.plot(*polyline.T, "-o", color=BLUE, lw=1.6, ms=3)
    axes.plot(*polyline[0], "s", color=ORANGE, ms=8)
    axes.set_aspect("equal")
    axes.invert_yaxis()
    axes.set_axis_off()


# Hamiltonian paths


def _hamiltonian_path(region: Region, path: list[Cell]) -> list[Cell] | None:
    """Return a path that goes on from ``path`` through all other cells once, or None."""
    if len(path) == len(region):
        return path
    following = (
        neighbour
        for neighbour in _beside(path[-1])
        if neighbour in region and neighbour not in path
    )
    longer = (_hamiltonian_path(region, [*path, neighbour]) for neighbour in following)
    return next((candidate for candidate in longer if candidate), None)


def _hardness(_store: Store, _sweeps: list[Sweep], settings: Settings) -> Outcome:
    most = 5 if settings.quick else 7
    rows = []
    examples: dict[bool, tuple[int, Region, Cell]] = {}
    agreements = answers = 0
    for region in polyominoes(most):
        for start in sorted(region):
            instance = coverage_instance(region, start)
            fewest = optimum(GridWorkspace(instance.free), [instance.start]).moves
            _, hamiltonian = path_lengths(region, start)
            answers += 1
            agreements += (fewest == instance.moves) == (hamiltonian is not None)
            rows.append((len(region), hamiltonian is not None))
            yes, longest = hamiltonian is not None, max(instance.free.shape)
            if len(region) == most and (yes not in examples or longest < examples[yes][0]):
                examples[yes] = longest, region, start
    claims = (
        claim(
            f"instances of up to {most} cells with equal answers, of {answers}",
            "all",
            agreements / answers,
            within=(1, 1),
            why="m - 1 moves cover m cells if and only if a Hamiltonian path exists",
        ),
        claim(
            "share of instances with a Hamiltonian path",
            "not said",
            sum(yes for _, yes in rows) / answers,
            unlike="the paper only names the reduction",
        ),
    )
    figure = padded_figure(7.0, 3.2)
    for axes, (yes, (_, region, start)) in zip(
        figure.subplots(1, 2), sorted(examples.items()), strict=True
    ):
        _draw_region(axes, region, _hamiltonian_path(region, [start]) or [start])
        set_title(axes, "a Hamiltonian path" if yes else "no Hamiltonian path")
        axes.annotate(
            f"{len(region) - 1} moves {'' if yes else 'do not '}cover it",
            (0.5, -0.12),
            xycoords="axes fraction",
            ha="center",
            color=MUTED,
        )
    table = Table(
        "instances",
        ["cells", "starts", "with a Hamiltonian path"],
        [
            [n, sum(m == n for m, _ in rows), sum(m == n and yes for m, yes in rows)]
            for n in range(1, most + 1)
        ],
    )
    sentence = (
        "The reduction is of coverage with one particle: the fewest moves by Shoal's exact search,"
        " Hamiltonian paths by an own search. It makes mapping NP-hard only if walls need not be"
        " touched; otherwise every instance takes moves for its walls, too."
    )
    return Outcome(figure, claims, sentence, (table,), NO_FIGURE)


# The worst case of a line


_ALL = 7  # cells of the longest line of which all placements are played


def _line_moves(cells: int, places: Iterable[int]) -> int:
    start = tuple((0, place) for place in places)
    ground = np.ones((1, cells), dtype=np.bool_)
    return run(SwarmProblem(ground, start=start, policy="closest-frontier")).moves


def _worst_line(_store: Store, _sweeps: list[Sweep], settings: Settings) -> Outcome:
    corner = {
        (n, k): _line_moves(n, range(n - k, n))
        for n in [*range(2, _ALL + 1), 20, 60] + [200] * (not settings.quick)
        for k in (range(1, n + 1) if n <= _ALL else sorted({1, 2, n // 4, n // 2, n - 1, n}))
    }
    most = {
        (n, k): max(_line_moves(n, place) for place in combinations(range(n), k))
        for n, k in corner
        if n <= _ALL
    }
    bound = {(n, k): 4 * (n - k + 1) for n, k in corner}
    ratios = [moves / bound[case] for case, moves in corner.items()]
    claims = (
        claim("moves from the right end by 4(n - k + 1), least", "1", min(ratios), within=(1, 1)),
        claim("the same, most", "1", max(ratios), within=(1, 1)),
        claim(
            f"most moves of all placements by 4(n - k + 1), up to {_ALL} cells",
            "1: the worst case",
            max(moves / bound[case] for case, moves in most.items()),
            within=(1, 1),
        ),
    )
    curves = []
    for cells in sorted({n for n, _ in corner})[-3:]:
        own = [(k, moves) for (n, k), moves in corner.items() if n == cells]
        x, y = np.array(own, dtype=np.float64).T
        curves.append(Curve(f"n = {cells}", x, y, y, y))
    rows = [[n, k, m, most.get((n, k), ""), bound[n, k]] for (n, k), m in corner.items()]
    labels = Labels(
        "Mapping a line from its right end",
        "particles k",
        "moves of closest-frontier",
        note="the default tie rule; paper D states 4(n - k + 1) and has no figure of it",
    )
    return Outcome(
        mean_curves(curves, labels, log_y=False),
        claims,
        f"Of lines with up to {_ALL} cells every placement is played; none is worse.",
        (Table("moves", ["n", "k", "from the right end", "most", "4(n - k + 1)"], rows),),
    )


# The largest gap


def _largest_gap(_store: Store, _sweeps: list[Sweep], settings: Settings) -> Outcome:
    sizes = [100, 200, 400, 800, 1600] + [3200, 6400] * (not settings.quick)
    lines = [(n, [Line(m, n) for m in sizes]) for n in (10, 30)]
    laws = {}
    for n, of in lines:
        exact = np.array([float(line.largest_gap.exact) for line in of])
        mean = np.array([(line.cells - n) / (n + 1) for line in of])
        root = np.array([sqrt(gap * log(n + 1)) for gap in mean])
        law = np.array([line.largest_gap_law for line in of])
        laws[n] = exact, mean, root, law
    claims = []
    for n, (exact, mean, root, law) in laws.items():
        factor = (exact - mean) / root
        claims.append(
            claim(
                f"n = {n}: factor of the printed root at m = {sizes[-1]} by that at m = 400",
                "bounded: Θ",
                float(factor[-1] / factor[sizes.index(400)]),
                within=(0.5, 1.5),
                why=f"a constant factor stays; the root of m gives {sqrt(sizes[-1] / 400):.2g}",
            )
        )
        claims.append(
            claim(
                f"n = {n}: harmonic law by the exact mean at m = {sizes[-1]}",
                "not printed",
                float(law[-1] / exact[-1]),
                unlike="the papers do not have the law (m - n) H / (n + 1), H = 1 + ... + 1/(n + 1)",
            )
        )
    rows = [
        [
            n,
            m,
            *(round(float(values[k]), 3) for values in (exact, law, mean + root)),
            round(float((exact[k] - mean[k]) / root[k]), 3),
        ]
        for n, (exact, mean, root, law) in laws.items()
        for k, m in enumerate(sizes)
    ]
    columns = ["n", "m", "exact", "harmonic law", "printed, factor 1", "factor that would fit"]
    exact, mean, root, law = laws[10]
    x = np.array(sizes, dtype=np.float64)
    curves = [
        Curve("exact", x, exact, exact, exact),
        Curve("printed, factor 1", x, mean + root, mean + root, mean + root),
        Curve("harmonic law", x, law, law, law),
        Curve(
            "printed, fitted at 100 cells", x, *([mean + root * (exact - mean)[0] / root[0]] * 3)
        ),
    ]
    labels = Labels(
        "Mean largest gap of 10 particles",
        "cells m",
        "empty cells",
        note=NO_FIGURE,
    )
    sentence = (
        "The printed bound is that of balls thrown into bins one by one, each bin as likely at each"
        " throw. Gaps between particles are not such bins: all compositions of the empty cells are"
        " equally likely, and the largest is the mean gap times a harmonic number."
    )
    return Outcome(
        mean_curves(curves, labels, log_x=True),
        tuple(claims),
        sentence,
        (Table("mean largest gap", columns, rows),),
    )


RECIPES = (
    Recipe(
        "m-adversary",
        "paper M, section III.B.1",
        "No policy is better than twice the optimum",
        lambda _: [],
        _adversary,
        also="D, section III.B.1",
    ),
    Recipe(
        "m-smartdfs",
        "paper M, section III.B.1",
        "SmartDFS in regions without holes",
        lambda _: [],
        _smart,
        also="D, section III.B.1",
    ),
    Recipe(
        "m-hardness",
        "paper M, section III.B.1",
        "Hamiltonian paths as coverage problems",
        lambda _: [],
        _hardness,
        also="D, section III.B.1",
    ),
    Recipe(
        "m-largest-gap",
        "paper M, section III.A.2",
        "The largest gap and its asymptotic law",
        lambda _: [],
        _largest_gap,
        also="D, section III.A.2",
    ),
    Recipe(
        "d-worst-line",
        "paper D, section III.B.2",
        "The worst case of closest-frontier on a line",
        lambda _: [],
        _worst_line,
    ),
)
