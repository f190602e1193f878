"""Paper W (two particles, one shared input, walls without slip): recipes of figures 4, 8, 9 and 14
to 16.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import inf, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.lab.store import Store
from shoal.lab.sweep import Sweep
from shoal.papers.claims import Claim, claim
from shoal.papers.recipe import (
    NO_DATA,
    Outcome,
    Recipe,
    Settings,
    Table,
    function_sweep,
    measuring,
    trials_of,
)
from shoal.papers.steering.figures import (
    EXAMPLES,
    PRINTED_FRACTIONS,
    PRINTED_LAW,
    DiskFractions,
    antipode_errors,
    border_point,
    disk_fractions,
    disk_sets,
    fraction_curves,
    goal_maps,
    largest_two_move_fraction,
    polygon_fractions,
    reachable_sets,
    swap_antipodes,
)
from shoal.papers.steering.shortest_paths import (
    DISK_GOALS,
    DISK_START,
    SQUARE_CASES,
    goal_data,
    goal_sweep,
    goal_table,
    goals,
)
from shoal.steering import ConvexWorkspace, regular_polygon
from shoal.steering.delta_space import disk_reach
from shoal.steering.workspaces.convex import Points

MOVES = (2, 4, 6, 8)
SIDES = (3, 4, 5, 6, 7, 8)
START = (0.13, 0.06)
CYCLES = (2, 4, 6, 8, 10, 12, 14)


def random_difference(rng: np.random.Generator, workspace: ConvexWorkspace) -> Points:
    """Return a random position difference of two points in a workspace; float64, shape (2,).

    The direction of the difference is uniform. The length is a random fraction (2 to 100 %) of the
    largest possible length in the same direction. The logarithm of the random fraction is uniform,
    so that short lengths occur often.
    """
    angle, share = rng.uniform(0, 2 * pi), float(0.999 * 0.02 ** rng.uniform())
    border: Points = border_point(workspace.differences, (np.cos(angle), np.sin(angle)))
    return share * border


@measuring(*(f"share_{moves}" for moves in MOVES), "moves_to_fill")
def filling_of(*, seed: int, sides: int) -> dict[str, Any]:
    """Return, for each number of moves, the fraction of all position differences that two particles
    can reach in a regular polygon.

    The particles start with a random position difference.
    """
    workspace = regular_polygon(sides)
    start = random_difference(np.random.default_rng(seed), workspace)
    filling = polygon_fractions(workspace, start, moves=MOVES[-1])
    shares = [float(share) for share in filling.fractions]
    shares += [shares[-1]] * (len(MOVES) - len(shares))
    return {f"share_{moves}": share for moves, share in zip(MOVES, shares, strict=True)} | {
        "moves_to_fill": filling.moves
    }


@measuring(*(f"share_{moves}" for moves in CYCLES))
def disk_share(*, seed: int, distance: float) -> dict[str, float]:
    """Return, for each number of moves, the fraction of all position differences that two particles
    can reach in a disk.

    The seed has no effect.
    """
    return {
        f"share_{m}": float(share)
        for m, share in zip(CYCLES, disk_fractions([distance]).fractions[0], strict=True)
    }


@measuring("length", "error")
def antipodes(*, seed: int, toucher: str, cycles: int) -> dict[str, float]:
    """Return the length of a plan with ``cycles`` cycles towards antipodal goals, and the final
    distance from the goals.

    The parameter ``seed`` has no effect, because the computation uses no random numbers.
    """
    # refused there if it is no toucher
    swap = swap_antipodes(toucher=toucher, cycles=cycles)  # type: ignore[arg-type]
    return {"length": float(swap.lengths[-1]), "error": float(swap.errors[-1])}


def _shares(table: list[dict[str, Any]], distance: float) -> list[Claim]:
    """Return the claims for the fractions that paper W prints, in percent, for one initial
    distance.
    """
    (entry,) = (row for row in table if row["distance"] == distance)
    claims = []
    for moves, text in PRINTED_FRACTIONS[distance].items():
        step = 10.0 ** -len(text.partition(".")[2])
        claims.append(
            claim(
                f"% reached in {moves} moves from {distance:g} diameters",
                text,
                100 * entry[f"share_{moves}"],
                within=(float(text) - step / 2, float(text) + step),
                why="rounded or cut off; the paper's method underestimates",
            )
        )
    return claims


def _outlines(sets: Iterable[tuple[float, int, NDArray[np.float64]]], first: str) -> Table:
    """Return a table with the corners of the outlines of several sets.

    Each element of ``sets`` is (number of sides or initial distance, number of moves, outline).
    """
    rows = [
        [of, moves, round(float(x), 5), round(float(y), 5)]
        for of, moves, outline in sets
        for x, y in outline[::8]
    ]
    return Table("outlines, every 8th corner", [first, "moves", "x", "y"], rows, shown=False)


def _fig4_sweeps(settings: Settings) -> list[Sweep]:
    return [
        function_sweep(
            "w-fig4.starts", filling_of, {"sides": [*SIDES]}, settings.of(50, 4), settings
        )
    ]


def _fig4(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    fillings = {n: polygon_fractions(regular_polygon(n), START, moves=MOVES[-1]) for n in SIDES}
    # the drawn start is one of them
    counts: dict[int, list[int]] = {n: [filling.moves or 10] for n, filling in fillings.items()}
    for trial in trials_of(store, sweeps[0]):
        counts[trial["sides"]].append(trial["moves_to_fill"] or 10)

    def filled_share(sides: int, moves: int, *, source: str = "") -> Claim:
        share = float(np.mean([needed <= moves for needed in counts[sides]]))
        text = (
            f"{sides} sides{source}: share of {len(counts[sides])} starts from which {moves} moves"
            " fill the space"
        )
        return claim(text, "all", share, within=(1, 1), why="one start refutes it")

    claims = (
        filled_share(3, 4),
        filled_share(4, 4, source=', "at most five moves" with the last translation'),
        *(filled_share(n, 6) for n in SIDES[1:]),
    )
    rows = [[n, *(sum(m == moves for m in counts[n]) for moves in (*MOVES, 10))] for n in SIDES]
    sentence = (
        "Starts are the one drawn and random ones, short differences as often as long. From the one"
        " drawn "
        + ", ".join(f"{100 * fillings[n].fractions[2]:.1f} % of {n} sides" for n in (7, 8))
        + " are filled by six moves."
    )
    shown = Table(
        "starts by the moves that fill the space",
        ["sides", *(f"{m} moves" for m in MOVES), "more"],
        rows,
    )
    sets = (
        (n, reach.moves, reach.outline) for n, filling in fillings.items() for reach in filling.sets
    )
    return Outcome(
        reachable_sets([*fillings.values()]),
        claims,
        sentence,
        (shown, _outlines(sets, "sides")),
        NO_DATA,
    )


def _distances(settings: Settings) -> list[float]:
    steps = 33 if settings.quick else 65
    curve = (1 - np.cos(pi * np.arange(1, steps) / (steps - 1))) / 2
    return sorted({0.001, 0.1, 0.3, 0.81, *(float(f"{d:.9g}") for d in curve)})


def _fig8_sweeps(settings: Settings) -> list[Sweep]:
    distances = _distances(settings)
    return [
        function_sweep(f"w-fig8.{len(distances)}", disk_share, {"distance": distances}, 1, settings)
    ]


def _fig8(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    trials = trials_of(store, sweeps[0])
    table = np.array(
        [[trial["distance"], *(trial[f"share_{m}"] for m in CYCLES)] for trial in trials]
    )
    at, most = largest_two_move_fraction()
    claims = [
        *(share_claim for distance in (0.1, 0.001) for share_claim in _shares(trials, distance)),
        claim(
            "most that two moves reach",
            "0.373",
            most,
            within=(0.3725, 0.374),
            why="rounded or cut off",
        ),
        claim(
            "distance from which they do",
            "0.81",
            at,
            within=(0.805, 0.82),
            why="rounded or cut off",
        ),
    ]
    every = Table(
        "all shares",
        ["distance", *(f"{m} moves" for m in CYCLES)],
        np.round(table, 6).tolist(),
        shown=False,
    )
    figure = fraction_curves(DiskFractions(table[:, 0], np.array(CYCLES), table[:, 1:]))
    return Outcome(
        figure, tuple(claims), "", (every,), f"{NO_DATA} but the numbers in the text, circles"
    )


def _fig9_sweeps(settings: Settings) -> list[Sweep]:
    return [function_sweep("w-fig9", disk_share, {"distance": [*EXAMPLES]}, 1, settings)]


def _fig9(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    trials = trials_of(store, sweeps[0])
    rows = [
        [trial["distance"], *(f"{100 * trial[f'share_{m}']:.1f}" for m in CYCLES)]
        for trial in trials
    ]
    last = 100 * trials[1]["share_14"]
    claims = (
        *_shares(trials, EXAMPLES[0]),
        claim(
            f"% reached in 14 moves from {EXAMPLES[1]} diameters",
            "drawn only",
            last,
            unlike="no number is printed of this start",
        ),
    )
    shown = Table("reached, %", ["distance", *(f"{m} moves" for m in CYCLES)], rows)
    sets = (
        (d, reach.moves, reach.outline)
        for d in EXAMPLES
        for reach in disk_reach(d, moves=CYCLES[-1])
    )
    return Outcome(
        disk_sets(),
        claims,
        "The sets are drawn from the corrected formulas.",
        (shown, _outlines(sets, "distance")),
        NO_DATA,
    )


def _fig14_sweeps(settings: Settings) -> list[Sweep]:
    return [
        goals(f"w-fig14.{k}", "disk", DISK_START, goal, 2, settings)
        for k, goal in enumerate(DISK_GOALS)
    ]


def _alike(values: NDArray[np.float64]) -> float:
    """Return the fraction of goals in the workspace whose cost equals the cost of their mirror
    image.

    The mirror line passes through the starts of both particles.
    """
    inside = np.isfinite(values)
    return float(np.mean(np.isclose(values, values.T, rtol=0, atol=1e-6)[inside & inside.T]))


def _fig14(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    maps = [goal_sweep(store, sweep) for sweep in sweeps]
    names = [f"goal of particle 1 at {goal}" for goal in DISK_GOALS]
    goals_inside = sum(int(np.isfinite(sweep.moves).sum()) for sweep in maps)
    claims = (
        claim(
            "goal in the middle: share of goals with the moves of their mirror images",
            "symmetric",
            _alike(maps[0].moves),
            within=(1, 1),
        ),
        claim(
            "goal in the middle: share with the same length",
            "symmetric",
            _alike(maps[0].lengths),
            within=(1, 1),
        ),
        claim(
            "goal off the middle: share with the same length",
            "not symmetric",
            _alike(maps[1].lengths),
            within=(0, 0.99),
        ),
        claim("goals without a plan", "0", sum(sweep.unsolved for sweep in maps), within=(0, 0)),
    )
    figure = goal_maps([[(sweep, "moves"), (sweep, "length")] for sweep in maps])
    sentence = (
        f"Of {goals_inside} goals inside. Plans are those of algorithm 1 with the corrected sets."
        " Of an arc of contacts that serve equally ours takes the first one, not that of the"
        " mirror image, so lengths are not symmetric though moves are."
    )
    return Outcome(
        figure, claims, sentence, (goal_table(names, maps), goal_data(names, maps)), NO_DATA
    )


def _fig15_sweeps(settings: Settings) -> list[Sweep]:
    axes = {"toucher": ["second", "nearer"], "cycles": [*range(1, 61)]}
    return [function_sweep("w-fig15", antipodes, axes, 1, settings)]


def _fig15(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    second = swap_antipodes(toucher="second")
    nearer = swap_antipodes()
    across = swap_antipodes(turn=pi / 2)
    (coefficient, exponent), (factor, power) = second.law(), PRINTED_LAW
    by_law = (factor / 0.01) ** (1 / power)
    claims = (
        claim(
            "particle 2 always touches: exponent of the law",
            f"{power}",
            exponent,
            within=(2.5, 3.5),
            why="3 when rounded",
        ),
        claim(
            "its factor",
            f"{factor}",
            coefficient,
            unlike="it depends on the start, which is not printed",
        ),
        claim(
            "share of cycles in which the error falls",
            "approached asymptotically",
            float(np.mean(np.diff(nearer.errors) < 0)),
            within=(1, 1),
        ),
        claim(
            "length to an error of 0.01, the nearer particle touching",
            f"{by_law:.1f}",
            nearer.length_to(0.01),
            within=(0.85 * by_law, inf),
            why="the paper plots the smallest achievable error, so nothing is to be much shorter",
        ),
    )
    rows = [
        [name, f"{swap.length_to(0.01):.2f}"]
        for name, swap in (
            ("particle 2 always touches", second),
            ("the nearer touches", nearer),
            ("the nearer, Δ across", across),
        )
    ]
    sentence = (
        "The law is a property of letting particle 2 always touch: with the nearer particle 0.01"
        " takes half the length."
    )
    points = [
        [
            trial["toucher"],
            trial["cycles"],
            round(trial["length"], 6),
            float(f"{trial['error']:.6g}"),
        ]
        for trial in trials_of(store, sweeps[0])
    ]
    data = Table("error by length", ["toucher", "cycles", "length", "error"], points, shown=False)
    figure = antipode_errors(second, nearer, (across, "the nearer touches, Δ at the start across"))
    shown = Table("length to an error of 0.01", ["", "diameters"], rows)
    return Outcome(figure, claims, sentence, (shown, data), f"{NO_DATA} but the law of its fit")


def _fig16_sweeps(settings: Settings) -> list[Sweep]:
    return [
        goals(f"w-fig16.{k}{'-either' * either}", "square", start, goal, 1, settings, either=either)
        for either in (False, True)
        for k, (start, goal) in enumerate(SQUARE_CASES)
    ]


def _fig16(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    maps = [goal_sweep(store, sweep) for sweep in sweeps]
    alone, either = maps[: len(SQUARE_CASES)], maps[len(SQUARE_CASES) :]
    rows, claims, saved = [], [], []
    for k, (fixed, interchangeable, printed) in enumerate(
        zip(alone, either, (33, 60, 30), strict=True), start=1
    ):
        longest = [float(np.nanmax(sweep.lengths)) for sweep in (fixed, interchangeable)]
        less = 100 * (1 - longest[1] / longest[0])
        rows.append([k, f"{longest[0]:.3f}", f"{longest[1]:.3f}", int(np.nanmax(fixed.moves))])
        claims.append(
            claim(
                f"case {k}: % by which the longest plan gets shorter",
                printed,
                less,
                unlike="the cases are not printed; these are ours",
            )
        )
        saved.append((fixed.lengths - interchangeable.lengths)[np.isfinite(fixed.lengths)])
    gain = np.concatenate(saved)
    claims += [
        claim(
            "interchangeable particles: share of goals with a shorter plan",
            "often",
            float(np.mean(gain > 1e-9)),
            within=(0.1, 1),
        ),
        claim(
            "share of goals with a longer plan",
            "none: the shorter of two is taken",
            float(np.mean(gain < -1e-9)),
            within=(0, 0),
        ),
    ]
    names = [
        f"case {k + 1}{', interchangeable' * flag}"
        for flag in (0, 1)
        for k in range(len(SQUARE_CASES))
    ]
    figure = goal_maps(
        [
            [(s, "length") for s in alone],
            [(s, "moves") for s in alone],
            [(s, "length") for s in either],
        ]
    )
    shown = Table("longest plans", ["case", "longest", "interchangeable", "most moves"], rows)
    return Outcome(figure, tuple(claims), "", (shown, goal_data(names, maps)), NO_DATA)


RECIPES = (
    Recipe("w-fig4", "paper W, Fig. 4", "What moves reach in polygons", _fig4_sweeps, _fig4),
    Recipe(
        "w-fig8",
        "paper W, Fig. 8",
        "What moves reach on a disk, by the distance at the start",
        _fig8_sweeps,
        _fig8,
    ),
    Recipe(
        "w-fig9",
        "paper W, Fig. 9",
        "What moves reach on a disk, from two starts",
        _fig9_sweeps,
        _fig9,
    ),
    Recipe(
        "w-fig14", "paper W, Fig. 14", "Moves and length of plans on a disk", _fig14_sweeps, _fig14
    ),
    Recipe("w-fig15", "paper W, Fig. 15", "Goals at antipodes", _fig15_sweeps, _fig15),
    Recipe(
        "w-fig16",
        "paper W, Fig. 16",
        "Length and moves of plans in a square",
        _fig16_sweeps,
        _fig16,
    ),
)
