"""Paper H: strips, spirals and random walks, to which the paper compares its search method, and the
curve Hilbert II.
"""

from __future__ import annotations

from math import inf

import numpy as np
from numpy.typing import NDArray

from shoal.core.geometry import partial_sums
from shoal.lab.statistics import summarise
from shoal.lab.store import Store
from shoal.lab.sweep import Sweep
from shoal.papers.claims import claim, ratio
from shoal.papers.recipe import (
    Outcome,
    Recipe,
    Settings,
    Table,
    curve_of,
    function_sweep,
    measuring,
    table_of,
    trials_of,
)
from shoal.search import make_tour
from shoal.views.drawing.charts import BLUE, INK, ORANGE, padded_figure, set_title
from shoal.views.drawing.curves import Labels, mean_curves

SIDE = 32  # cells per side; a robot needs a unit of time for a cell
ROBOTS = (1, 2, 5, 10, 20, 50)
WAYS = ("curve", "strips", "spiral", "random walk")
STEPS = np.array([(0, 1), (1, 0), (0, -1), (-1, 0)])


def curve_time(starts: NDArray[np.int64]) -> float:
    """Return the time that robots need to search all cells along a closed curve, in units of the
    time for one cell.

    The time is the largest distance along the curve from one robot to the next robot.
    """
    at = np.sort(np.unique(make_tour("moore", (SIDE, SIDE)).position[tuple(starts.T)]))
    return float(np.max(np.diff(at, append=at[0] + SIDE**2)))


def strip_time(starts: NDArray[np.int64]) -> float:
    """Return the time that robots need to move to the left ends of equal strips and to search the
    strips (paper H, figure 1).

    The unit is the time for one cell. The robots get their strips in the order of their start rows.
    A robot searches a strip of several rows back and forth. If the number of rows is not a multiple
    of the number of strips, some strips are one row wider than the others.
    """
    ends = np.linspace(0, SIDE, len(starts) + 1).round().astype(int)
    robots = starts[np.argsort(starts[:, 0], kind="stable")]
    times = [
        row_0 + column
        for row_0, column in zip(np.abs(robots[:, 0] - ends[:-1]), robots[:, 1], strict=True)
    ]
    return float(
        max(
            time + (high - low) * SIDE - 1
            for time, low, high in zip(times, ends, ends[1:], strict=False)
            if high > low
        )
    )


def spiral_time(starts: NDArray[np.int64]) -> float:
    """Return the time until robots that spiral outwards from their starts have searched all cells.

    The unit is the time for one cell. Each robot moves on its own square spiral, independently of
    the other robots. Where its spiral leaves the region, a robot moves along the border.
    """
    first = np.full((SIDE, SIDE), np.inf)
    legs = np.repeat(np.arange(1, 2 * SIDE + 1), 2)
    offsets = np.concatenate(
        [[(0, 0)], np.cumsum(np.repeat(STEPS[np.arange(len(legs)) % 4], legs, axis=0), axis=0)]
    )
    for start in starts:
        cells = start + offsets
        cells = cells[((cells >= 0) & (cells < SIDE)).all(axis=1)]
        when = partial_sums(np.abs(np.diff(cells, axis=0)).sum(axis=1))
        np.minimum.at(first, tuple(cells.T), when)
    return float(first.max())


def walk_time(starts: NDArray[np.int64], rng: np.random.Generator) -> float:
    """Return the time, in steps, until robots on random walks have searched all cells.

    A step out of the region leaves a robot in place.

    The function simulates an unbounded walk and folds it at the border. In each coordinate, the
    folding makes i and 2 n - 1 - i the same cell of a region with n cells on each side. The folded
    walk has the same distribution as a walk that stays in place at the border.
    """
    first, begun, ahead = np.full(SIDE**2, np.inf), 0, starts.copy()
    while not np.isfinite(first).all():
        walks = ahead[:, None] + np.cumsum(STEPS[rng.integers(4, size=(len(starts), 4096))], axis=1)
        folded = walks % (2 * SIDE)
        cells = np.minimum(folded, 2 * SIDE - 1 - folded) @ (SIDE, 1)
        for row in cells:
            seen, when = np.unique(row, return_index=True)
            first[seen] = np.minimum(first[seen], begun + when + 1)
        begun, ahead = begun + cells.shape[1], walks[:, -1]
    return float(first.max())


@measuring("time", "share")
def search_time(*, seed: int, way: str, robots: int) -> dict[str, float]:
    """Return the time that robots from random start cells need to search all cells.

    The result ``time`` is in units of the time for one cell, and ``share`` is in percent of the
    time that one robot needs along a closed curve.
    """
    rng = np.random.default_rng(seed)
    starts = rng.integers(SIDE, size=(robots, 2))
    if way == "random walk":
        time = walk_time(starts, rng)
    else:
        time = {"curve": curve_time, "strips": strip_time, "spiral": spiral_time}[way](starts)
    return {"time": time, "share": 100 * time / SIDE**2}


def _sweeps(settings: Settings) -> list[Sweep]:
    return [
        function_sweep(
            "h-baselines",
            search_time,
            {"way": [*WAYS], "robots": [*ROBOTS]},
            settings.of(200, 20),
            settings,
        )
    ]


def _baselines(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    rows, trials = summarise(store, sweeps[0].name, "share"), trials_of(store, sweeps[0])
    curve, strips, spiral, walk = (
        next(
            row.estimate
            for row in rows
            if row.values == {"way": way, "robots": 20} and row.estimate
        )
        for way in WAYS
    )
    alone = {
        way: np.array(
            [trial["share"] for trial in trials if trial["way"] == way and trial["robots"] == 1]
        )
        for way in WAYS
    }
    pairs = np.array(
        [trial["share"] for trial in trials if trial["way"] == "spiral" and trial["robots"] == 2]
    )
    # the bound is 5 %
    slowest = float(alone["spiral"].max())
    of_bound = (strips.mean / 5, strips.low / 5, strips.high / 5)
    claims = (
        claim(
            "strips: time of 20 robots by 1/m",
            "1, and the way there",
            of_bound,
            within=(1, 2),
            why="no longer than the search",
        ),
        claim(
            "spirals: slowest two robots by the fastest one",
            "not necessarily faster",
            float(pairs.max() / alone["spiral"].min()),
            within=(1, inf),
            why="some two are no faster than some one",
        ),
        claim(
            "spiral of one robot: slowest, % of the cells",
            "finite time",
            slowest,
            within=(0, 400),
            why="a spiral over four times the region holds it from any start",
        ),
        claim(
            "random walk of one robot: fastest, % of the cells",
            "even worse, no finite time",
            float(alone["random walk"].min()),
            within=(slowest, inf),
            why="slower than the slowest spiral",
        ),
        claim(
            "random walk by spiral, 20 robots", "even worse", ratio(walk, spiral), within=(1, inf)
        ),
        claim(
            "spiral by the curve, 20 robots",
            "the curve is faster",
            ratio(spiral, curve),
            within=(1, inf),
        ),
    )
    sentence = (
        f"20 robots take {strips.mean:.0f} % by strips and {curve.mean:.0f} % by the curve from"
        " random starts: the way to strips costs less time than arcs of unequal length. What"
        " strips lack is robustness: a dead robot's strip stays unsearched."
    )
    note = (
        f"{SIDE} by {SIDE} cells; curve: Moore's, robots stay where they are. The paper prints no"
        " numbers of these ways"
    )
    labels = Labels(
        "Ways to search a square from random starts",
        "robots m",
        "time to search all, % of the cells",
        note=note,
    )
    curves = [curve_of(way, rows, "robots", way=way) for way in WAYS]
    return Outcome(
        mean_curves(curves, labels, log_x=True),
        claims,
        sentence,
        (table_of("time as % of the cells", rows),),
    )


def _curves(_store: Store, _sweeps: list[Sweep], settings: Settings) -> Outcome:
    powers, orders = ((5, 6), (3, 4)) if settings.quick else ((5, 6, 7, 8), (3, 4, 5))
    tours = {
        name: [make_tour(name.lower(), (2**k, 2**k)) for k in (3, *powers)]
        for name in ("Hilbert", "Moore", "Comb")
    }
    tours["Hilbert II"] = [make_tour("hilbert-ii", (3**k, 3**k)) for k in (2, *orders)]
    metrics = {name: [tour.metrics() for tour in found] for name, found in tours.items()}
    last = {name: found[-1] for name, found in metrics.items()}
    edges = {name: last[name].closing_edge / tours[name][-1].shape[0] for name in tours}
    fewer = last["Hilbert II"].turns_per_cell / last["Hilbert"].turns_per_cell
    claims = (
        claim("turns a cell: Hilbert II by Hilbert", "fewer: a candidate", fewer, within=(0, 1)),
        claim(
            "Hilbert: closing edge, sides",
            "a long straight path",
            edges["Hilbert"],
            within=(0.9, 1.1),
            why="about a side",
        ),
        claim(
            "Moore: closing edge, cells",
            "1: others have adjacent ends",
            last["Moore"].closing_edge,
            within=(1, 1),
        ),
        claim(
            "Hilbert II: closing edge, sides",
            "not said",
            edges["Hilbert II"],
            unlike="the paper says nothing of its ends",
        ),
    )
    figure = padded_figure(10.4, 3.2)
    for axes, (name, (tour, *_)) in zip(figure.subplots(1, 4), tours.items(), strict=True):
        way = tour.cells[:, ::-1]
        axes.plot(*way.T, "-", color=BLUE, lw=2.0, solid_joinstyle="round")
        axes.plot(*way[[-1, 0]].T, "--", color=ORANGE, lw=1.3)
        axes.plot(*way[0], "o", mfc="white", mec=INK, ms=6)
        axes.set_aspect("equal")
        axes.set_axis_off()
        set_title(axes, f"{name}: {metrics[name][0].turns_per_cell:.2f} turns a cell")
    rows = [
        [name, tour.shape[0], round(one.turns_per_cell, 4), round(one.closing_edge, 2)]
        for name, found in tours.items()
        for tour, one in zip(found, metrics[name], strict=True)
    ]
    sentence = (
        "Hilbert II has fewer turns, but its ends lie at opposite corners, so that it has the"
        " longest closing edge. The claims are of the largest curves, the figure of the drawn ones."
    )
    table = Table("curves", ["curve", "cells a side", "turns a cell", "closing edge"], rows)
    return Outcome(
        figure,
        claims,
        sentence,
        (table,),
        "dashed: the closing edge; the paper names Hilbert II and draws none",
    )


RECIPES = (
    Recipe(
        "h-baselines",
        "paper H, section Geographic Search",
        "Strips, spirals and random walks",
        _sweeps,
        _baselines,
    ),
    Recipe(
        "h-curves",
        "paper H, section Further Research",
        "Hilbert II and other curves",
        lambda _: [],
        _curves,
    ),
)
