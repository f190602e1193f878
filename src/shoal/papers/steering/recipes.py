"""Paper W: two particles, one input, non-slip walls; figures 4, 8, 9 and 14 to 16."""

from __future__ import annotations

from math import pi
from typing import Any

import numpy as np

from shoal.lab.storage.store import Store
from shoal.lab.sweeps.sweep import Sweep
from shoal.papers.recipe import NO_DATA, Outcome, Recipe, Settings, Table
from shoal.papers.steering.antipodes import swap_antipodes
from shoal.papers.steering.figures import (
    EXAMPLES,
    PRINTED_FRACTIONS,
    PRINTED_LAW,
    antipode_errors,
    disk_sets,
    fraction_curves,
    goal_maps,
    reachable_sets,
)
from shoal.papers.steering.goals import DISK_GOALS, DISK_START, SQUARE_CASES, goal_data, goal_sweep, goal_table, goals
from shoal.papers.steering.reachable_fraction import DiskFractions, disk_fractions, largest_two_move_fraction, polygon_fractions
from shoal.steering import regular_polygon
from shoal.steering.delta_space.disk_reach import disk_reach

MOVES = (2, 4, 6, 8)
SIDES = (3, 4, 5, 6, 7, 8)
START = (0.13, 0.06)
CYCLES = (2, 4, 6, 8, 10, 12, 14)


def filling_of(*, seed: int, sides: int) -> dict[str, Any]:
    """Return which share of all differences moves reach on a regular polygon from a random difference at the start."""
    rng = np.random.default_rng(seed)
    angle, length = rng.uniform(0, 2 * pi), rng.uniform(0.1, 0.8)
    filling = polygon_fractions(regular_polygon(sides), (length * np.cos(angle), length * np.sin(angle)), moves=MOVES[-1])
    shares = [float(share) for share in filling.fractions]
    shares += [shares[-1]] * (len(MOVES) - len(shares))
    return {f"share_{moves}": share for moves, share in zip(MOVES, shares, strict=True)} | {"moves_to_fill": filling.moves}


filling_of.measures = (*(f"share_{moves}" for moves in MOVES), "moves_to_fill")  # type: ignore[attr-defined]  # what a sweep reads


def disk_share(*, seed: int, distance: float) -> dict[str, float]:
    """Return which share of all differences moves reach on a disk; nothing is random."""
    return {f"share_{m}": float(share) for m, share in zip(CYCLES, disk_fractions([distance]).fractions[0], strict=True)}


disk_share.measures = tuple(f"share_{moves}" for moves in CYCLES)  # type: ignore[attr-defined]  # what a sweep reads


def antipodes(*, seed: int, toucher: str, cycles: int) -> dict[str, float]:
    """Return how near a plan of so many cycles comes to goals at antipodes, and its length; nothing is random."""
    swap = swap_antipodes(toucher=toucher, cycles=cycles)  # type: ignore[arg-type]  # refused there if it is no toucher
    return {"length": float(swap.lengths[-1]), "error": float(swap.errors[-1])}


antipodes.measures = ("length", "error")  # type: ignore[attr-defined]  # what a sweep reads


def _function(name: str, function: str, axes: dict[str, Any], trials: int, settings: Settings) -> Sweep:
    problem = {"kind": "function", "function": f"shoal.papers.steering.recipes:{function}"}
    return Sweep(name=name, problem=problem, axes=axes, trials=trials, seed=settings.seed)


def _fig4_sweeps(settings: Settings) -> list[Sweep]:
    return [_function("w-fig4", "filling_of", {"sides": [*SIDES]}, settings.of(50, 4), settings)]


def _fig4(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    fillings = [polygon_fractions(regular_polygon(n), START, moves=8) for n in SIDES]
    claimed = {3: 4, 4: 6, 5: 6, 6: 6, 7: 6, 8: 6}
    found: dict[int, list[Any]] = {n: [] for n in SIDES}
    for sides, *_, moves in store.rows(sweeps[0].name):
        found[sides].append(moves)
    rows, enough = [], {}
    for sides in SIDES:
        most = [8 if moves is None else moves for moves in found[sides]]
        enough[sides] = float(np.mean([moves is not None and moves <= claimed[sides] for moves in found[sides]]))
        least = min(most)
        unfilled = sum(moves is None for moves in found[sides])
        rows.append([sides, claimed[sides], f"{100 * enough[sides]:.0f}", least, max(most), unfilled, len(most)])
    wrong = [n for n in SIDES if enough[n] < 1]
    sentence = (
        f"From {len(found[SIDES[0]])} random starts each the printed number of moves fills the space always for "
        f"{', '.join(str(n) for n in SIDES if n not in wrong) or 'no'} sides, and not always for "
        f"{', '.join(map(str, wrong)) or 'none'}: four moves of a triangle leave a corner out, and seven and eight sides may need "
        f"eight. {NO_DATA.capitalize()}; the printed numbers of moves are those of section IV.D."
    )
    columns = ["sides", "moves, printed", "starts filled by them, %", "least", "most", "not filled in 8", "starts"]
    outlines = [
        [n, reach.moves, round(float(x), 5), round(float(y), 5)]
        for n, filling in zip(SIDES, fillings, strict=True)
        for reach, outline in zip(filling.sets, filling.outlines, strict=True)
        for x, y in outline[::16]
    ]
    data = Table("outlines, every 16th corner", ["sides", "moves", "x", "y"], outlines, shown=False)
    return Outcome(
        reachable_sets(fillings), sentence, (Table("moves that fill", columns, rows), data), enough[5] == enough[6] == 1, NO_DATA
    )


def _distances(settings: Settings) -> list[float]:
    steps = 33 if settings.quick else 65
    curve = (1 - np.cos(pi * np.arange(1, steps) / (steps - 1))) / 2
    return sorted({0.001, 0.1, 0.3, 0.81, *(float(f"{d:.9g}") for d in curve)})


def _fig8_sweeps(settings: Settings) -> list[Sweep]:
    return [_function(f"w-fig8.{len(_distances(settings))}", "disk_share", {"distance": _distances(settings)}, 1, settings)]


def _fig8(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    table = np.array([[row[0], *row[3:]] for row in store.rows(sweeps[0].name)])
    data = DiskFractions(table[:, 0], np.array(CYCLES), table[:, 1:])
    rows, worst = [], 0.0
    for distance, printed in PRINTED_FRACTIONS.items():
        ours = dict(zip(CYCLES, table[np.argmin(np.abs(table[:, 0] - distance)), 1:].tolist(), strict=True))
        for moves, share in printed.items():
            off = 100 * (ours[moves] - share)
            rows.append([distance, moves, f"{100 * ours[moves]:.2f}", f"{100 * share:.3g}", f"{off:+.2f}"])
            worst = max(worst, abs(off))
    at, most = largest_two_move_fraction()
    sentence = (
        f"All printed shares are met within {worst:.1f} percentage points (they are printed with two digits). Two moves reach "
        f"most, {100 * most:.1f} %, from {at:.3f} diameters; printed are 37.3 % at about 0.81."
    )
    columns = ["distance", "moves", "ours, %", "printed, %", "difference"]
    every = Table("all shares", ["distance", *(f"{m} moves" for m in CYCLES)], np.round(table, 6).tolist(), shown=False)
    return Outcome(
        fraction_curves(data),
        sentence,
        (Table("shares reached", columns, rows), every),
        worst <= 1.0,
        f"{NO_DATA} but the numbers in the text, circles",
    )


def _fig9_sweeps(settings: Settings) -> list[Sweep]:
    return [_function("w-fig9", "disk_share", {"distance": [*EXAMPLES]}, 1, settings)]


def _fig9(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    rows = [[row[0], *(f"{100 * share:.1f}" for share in row[3:])] for row in store.rows(sweeps[0].name)]
    outlines = [
        [distance, reach.moves, round(float(x), 5), round(float(y), 5)]
        for distance in EXAMPLES
        for reach in disk_reach(distance, moves=CYCLES[-1])
        for x, y in reach.outline[::8]
    ]
    shares = [float(row[-1]) for row in rows]
    sentence = (
        f"After fourteen moves {shares[0]} and {shares[1]} % of all differences are reached from {EXAMPLES[0]} and {EXAMPLES[1]} "
        f"diameters. The sets are drawn from the corrected formulas; {NO_DATA}."
    )
    shown = Table("reached, %", ["distance", *(f"{m} moves" for m in CYCLES)], rows)
    data = Table("outlines, every 8th corner", ["distance", "moves", "x", "y"], outlines, shown=False)
    return Outcome(disk_sets(), sentence, (shown, data), note=NO_DATA)


def _fig14_sweeps(settings: Settings) -> list[Sweep]:
    return [goals(f"w-fig14.{k}", "disk", DISK_START, goal, 2, settings) for k, goal in enumerate(DISK_GOALS)]


def _fig14(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    made = [goal_sweep(store, sweep) for sweep in sweeps]
    names = [f"goal of particle 1 at {goal}" for goal in DISK_GOALS]
    middle = made[0].moves
    alike = float(np.nanmean(middle == middle.T))
    sentence = (
        f"With the blue goal in the middle {100 * alike:.0f} % of the goals have as many moves as their mirror images, as printed; "
        f"off the middle the symmetry is gone. All {sum(int(np.isfinite(s.moves).sum()) for s in made)} goals have a plan. "
        f"{NO_DATA.capitalize()}."
    )
    figure = goal_maps([[(sweep, "moves"), (sweep, "length")] for sweep in made])
    shown = (goal_table(names, made), goal_data(names, made))
    return Outcome(figure, sentence, shown, not any(sweep.unsolved for sweep in made), NO_DATA)


def _fig15_sweeps(settings: Settings) -> list[Sweep]:
    axes = {"toucher": ["second", "nearer"], "cycles": [*range(1, 61)]}
    return [_function("w-fig15", "antipodes", axes, 1, settings)]


def _fig15(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    second, nearer, across = swap_antipodes(toucher="second"), swap_antipodes(), swap_antipodes(turn=pi / 2)
    coefficient, exponent = second.law()
    stored = {who: np.array([row[4:] for row in store.rows(sweeps[0].name) if row[0] == who]) for who in ("second", "nearer")}
    same = all(np.allclose(stored[swap.toucher][:, 1], swap.errors) for swap in (second, nearer))
    rows = [
        ["particle 2 always touches", f"{coefficient:.2f} / length^{exponent:.2f}", f"{PRINTED_LAW[0]} / length^{PRINTED_LAW[1]}",
         f"{second.length_to(0.01):.2f}", f"{(PRINTED_LAW[0] / 0.01) ** (1 / 3):.2f}"],
        ["the nearer particle touches", "", "", f"{nearer.length_to(0.01):.2f}", ""],
        ["the nearer, Δ across at the start", "", "", f"{across.length_to(0.01):.2f}", ""],
    ]  # fmt: skip
    sentence = (
        f"With particle 2 always touching, the error falls as {coefficient:.3g} / length^{exponent:.2g}, close to the printed 8.66 "
        "/ length³. That is a property of that choice: if the nearer particle touches, 0.01 is reached at length "
        f"{nearer.length_to(0.01):.1f} instead of {second.length_to(0.01):.1f}, and at {across.length_to(0.01):.1f} from a Δ "
        "across."
    )
    table = Table(
        "law and length to an error of 0.01", ["", "our law", "printed law", "length to 0.01", "by the printed law"], rows
    )
    points = [
        [who, k + 1, round(float(a), 6), float(f"{b:.6g}")] for who, found in stored.items() for k, (a, b) in enumerate(found)
    ]
    data = Table("error by length", ["toucher", "cycles", "length", "error"], points, shown=False)
    figure = antipode_errors(second, nearer, (across, "the nearer touches, Δ at the start across"))
    return Outcome(figure, sentence, (table, data), same and abs(exponent - 3) < 0.2, f"{NO_DATA} but the law of its fit")


def _fig16_sweeps(settings: Settings) -> list[Sweep]:
    return [
        goals(f"w-fig16.{k}{'-either' * either}", "square", start, goal, 1, settings, either=either)
        for either in (False, True)
        for k, (start, goal) in enumerate(SQUARE_CASES)
    ]


def _fig16(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    made = [goal_sweep(store, sweep) for sweep in sweeps]
    alone, either = made[: len(SQUARE_CASES)], made[len(SQUARE_CASES) :]
    rows, worse = [], False
    for k, (one, other, printed) in enumerate(zip(alone, either, (33, 60, 30), strict=True)):
        longest = [float(np.nanmax(sweep.lengths)) for sweep in (one, other)]
        saved = 100 * (1 - longest[1] / longest[0])
        worse |= bool(np.nanmax(other.lengths - one.lengths) > 1e-9)
        rows.append([k + 1, f"{longest[0]:.3f}", f"{longest[1]:.3f}", f"{saved:.0f}", printed, int(np.nanmax(one.moves))])
    sentence = (
        f"Interchangeable particles shorten the longest plan by {', '.join(str(row[3]) for row in rows)} %; printed are 33, 60 and "
        f"30 %. The paper does not print its three cases; these are ours, so the numbers need not agree. {NO_DATA.capitalize()}."
    )
    names = [f"case {k + 1}{', interchangeable' * flag}" for flag in (0, 1) for k in range(len(SQUARE_CASES))]
    figure = goal_maps([[(s, "length") for s in alone], [(s, "moves") for s in alone], [(s, "length") for s in either]])
    columns = ["case", "longest", "interchangeable", "less, %", "printed less, %", "most moves"]
    return Outcome(figure, sentence, (Table("longest plans", columns, rows), goal_data(names, made)), not worse, NO_DATA)


RECIPES = (
    Recipe("w-fig4", "paper W, Fig. 4", "What moves reach in polygons", _fig4_sweeps, _fig4),
    Recipe("w-fig8", "paper W, Fig. 8", "What moves reach on a disk, by the distance at the start", _fig8_sweeps, _fig8),
    Recipe("w-fig9", "paper W, Fig. 9", "What moves reach on a disk, from two starts", _fig9_sweeps, _fig9),
    Recipe("w-fig14", "paper W, Fig. 14", "Moves and length of plans on a disk", _fig14_sweeps, _fig14),
    Recipe("w-fig15", "paper W, Fig. 15", "Goals at antipodes", _fig15_sweeps, _fig15),
    Recipe("w-fig16", "paper W, Fig. 16", "Length and moves of plans in a square", _fig16_sweeps, _fig16),
)
