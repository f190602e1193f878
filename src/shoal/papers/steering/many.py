"""Paper W, section VIII: more than two particles, by plans in corners and by the law of clipped
distances.
"""

from __future__ import annotations

from math import inf
from typing import Any

import numpy as np
from numpy.random import Generator

from shoal.lab.store import Store
from shoal.lab.sweep import Sweep
from shoal.papers.claims import claim
from shoal.papers.recipe import (
    Outcome,
    Recipe,
    Settings,
    Table,
    function_sweep,
    measuring,
    trials_of,
    trials_table,
)
from shoal.steering import ContactWorld, ConvexWorkspace, polygon, regular_polygon
from shoal.steering.planners.rearrangement import (
    corner_room,
    is_reachable_without_friction,
    rearrange,
)
from shoal.steering.workspaces.convex import Points
from shoal.views.drawing.charts import BLUE, INK, MUTED, padded_figure, plain_axes, set_title
from shoal.views.steering.figures import colour_of, draw_workspace

ROOM = 1e-3  # the least that `rearrange` accepts
WORKSPACES = {
    "square": polygon([(0, 0), (1, 0), (1, 1), (0, 1)]),
    "parallelogram": polygon([(0, 0), (1, 0.2), (1.3, 0.9), (0.3, 0.7)]),
    "triangle": regular_polygon(3),
    "pentagon": regular_polygon(5),
    "hexagon": regular_polygon(6),
}
CASES = (
    ("square", 2),
    ("square", 3),
    ("square", 4),
    ("square", 6),
    ("parallelogram", 3),
    ("triangle", 3),
    ("pentagon", 3),
    ("hexagon", 3),
)
START = ((0.3, 0.2), (0.45, 0.35), (0.2, 0.5))
GOAL = ((0.4, 0.55), (0.25, 0.3), (0.6, 0.4))


def random_positions(rng: Generator, workspace: ConvexWorkspace, count: int) -> Points:
    """Return independent uniform positions at least .5 % of the size off the walls, shape
    (count, 2).
    """
    low, high = workspace.bounds
    points: list[Points] = []
    while len(points) < count:
        point = rng.uniform(low, high)
        if float(workspace.depth(point[None])[0]) >= 0.005 * workspace.size:
            points.append(point)
    return np.array(points)


@measuring("fits", "moves", "error")
def rearrangement(*, seed: int, case: int) -> dict[str, float]:
    """Return whether a random start and goal fit into corners, and if so the moves of the plan and
    how far from the goals it ends, in sizes of the workspace.
    """
    name, count = CASES[case]
    workspace, rng = WORKSPACES[name], np.random.default_rng(seed)
    start, goal = (random_positions(rng, workspace, count) for _ in range(2))
    if min(corner_room(workspace, start), corner_room(workspace, goal)) < ROOM:
        return {"fits": 0, "moves": 0, "error": 0.0}
    moves = rearrange(workspace, start, goal)
    missed = ContactWorld(workspace).play(start, moves)[-1] - goal
    return {
        "fits": 1,
        "moves": len(moves),
        "error": float(np.abs(missed).max()) / workspace.size,
    }


@measuring("merged", "clipped", "grown", "goal")
def limits(*, seed: int) -> dict[str, float]:
    """Return what 40 random moves in a square do: how far two particles that were at the same place
    are apart, whether without friction the end is one of the law, by how much a distance along a
    side has grown, and whether a random goal would be one of the law.
    """
    rng, square = np.random.default_rng(seed), WORKSPACES["square"]
    start = random_positions(rng, square, 3)
    moves = rng.normal(scale=0.4, size=(40, 2))
    together = np.array([start[0], start[0], start[1]])
    held = ContactWorld(square).play(together, moves)[-1]
    slid = ContactWorld(square, friction=0.0).play(start, moves)
    apart = np.abs(slid[:, :, None] - slid[:, None])  # (moves + 1, 3, 3, 2)
    return {
        "merged": float(np.abs(held[0] - held[1]).max()),
        "clipped": all(is_reachable_without_friction(start, state) for state in slid),
        "grown": float(np.diff(apart, axis=0).max()),
        "goal": is_reachable_without_friction(start, random_positions(rng, square, 3)),
    }


def _sweeps(settings: Settings) -> list[Sweep]:
    cases = [*range(len(CASES))]
    return [
        function_sweep("w-many", rearrangement, {"case": cases}, settings.of(200, 10), settings),
        function_sweep("w-many-limits", limits, {}, settings.of(500, 30), settings),
    ]


def _many(store: Store, sweeps: list[Sweep], _settings: Settings) -> Outcome:
    trials, random = (trials_of(store, sweep) for sweep in sweeps)
    own = {name_count: [t for t in trials if t["case"] == k] for k, name_count in enumerate(CASES)}
    planned = [t for t in trials if t["fits"]]
    share = {case: float(np.mean([t["fits"] for t in found])) for case, found in own.items()}
    full = [case for case in CASES if case[0] in {"square", "parallelogram"}]
    claims = (
        claim(
            "parallelograms, 2 to 6 particles: share of random problems with a plan",
            "could be extended",
            sum(t["fits"] for case in full for t in own[case]) / sum(len(own[c]) for c in full),
            within=(1, 1),
            why="any pairwise different positions can be reached (theorem 1)",
        ),
        claim(
            "all plans: largest distance to a goal, in sizes",
            "0",
            max(t["error"] for t in planned),
            within=(0, 1e-7),
            why="by simulation; only contacts are found to a tolerance",
        ),
        claim(
            "triangle, pentagon and hexagon, 3 particles: least share with a guarantee",
            "not said",
            min(share[case] for case in CASES if case not in full),
            unlike="theorem 2 is only sufficient; the paper has no statement",
        ),
        claim(
            "particles at the same place: largest distance after 40 random moves",
            "0: they never separate",
            max(t["merged"] for t in random),
            within=(0, 0),
            why="the counter-example: such goals cannot be reached",
        ),
        claim(
            "without friction: share of paths with all states of the form clip(x, a, b) + c",
            "not said",
            float(np.mean([t["clipped"] for t in random])),
            within=(1, 1),
            why="theorem 3",
        ),
        claim(
            "without friction: largest growth of a distance along a side, in sides",
            "0 at most",
            max(t["grown"] for t in random),
            within=(-inf, 1e-9),
            why="theorem 3, up to rounding",
        ),
        claim(
            "without friction: share of random goals of three particles that can be reached",
            "not said",
            float(np.mean([t["goal"] for t in random])),
            unlike="the paper names small friction as future work",
        ),
    )
    rows = [
        [
            *case,
            round(share[case], 3),
            *_spread([t["moves"] for t in own[case] if t["fits"]]),
        ]
        for case in CASES
    ]
    tables = (
        Table("plans", ["workspace", "particles", "share", "least", "median", "most"], rows),
        trials_table(trials, ["case", "fits", "moves", "error"]),
    )
    sentence = (
        "With walls that hold, any number of particles at different places can be rearranged at"
        " will in a parallelogram, and near a corner of any convex polygon: the particle that"
        " touches a wall first is shifted along it, and two walls are enough to do so with each"
        " particle in turn. What is not proven is which configurations can be reached in other"
        " polygons that fit into no corner, and on disks. The plans show that a way exists, not a"
        " short one."
    )
    return Outcome(_drawn(rows), claims, sentence, tables)


def _spread(moves: list[int]) -> tuple[int, int, int] | tuple[str, str, str]:
    return (min(moves), int(np.median(moves)), max(moves)) if moves else ("", "", "")


def _drawn(rows: list[list[Any]]) -> Any:
    """Draw one plan of three particles, and the moves of the plans of all cases."""
    from matplotlib.ticker import FixedLocator, NullFormatter, StrMethodFormatter

    figure = padded_figure(9.6, 4.2)
    axes, chart = figure.subplots(1, 2, width_ratios=[1, 1.25])
    square = WORKSPACES["square"]
    moves = rearrange(square, START, GOAL)
    states = ContactWorld(square).play(START, moves)
    draw_workspace(axes, square)
    for particle in range(3):
        colour = colour_of(particle)
        axes.plot(*states[:, particle].T, color=colour, lw=0.9, alpha=0.7)
        axes.plot(*states[0, particle], "o", color=colour, ms=9)
        axes.plot(*states[-1, particle], "s", color=colour, ms=9, mec=INK)
    axes.set_axis_off()
    set_title(axes, f"three particles, {len(moves)} moves")
    for place, (*_, share, least, median, most) in enumerate(rows[::-1]):
        if least != "":
            chart.plot([least, most], [place, place], color=BLUE, lw=2)
            chart.plot(median, place, "o", color=BLUE, ms=7)
        chart.annotate(
            f"{100 * share:.0f} %",
            (1.02, place),
            xycoords=("axes fraction", "data"),
            va="center",
            color=MUTED,
        )
    chart.set_xscale("log")
    chart.xaxis.set_major_locator(FixedLocator([20, 50, 100, 200, 500, 1000, 2000, 5000]))
    chart.xaxis.set_major_formatter(StrMethodFormatter("{x:.0f}"))
    chart.xaxis.set_minor_formatter(NullFormatter())
    chart.set_yticks(range(len(rows)), [f"{row[0]}, {row[1]}" for row in rows[::-1]])
    chart.set_xlabel("moves of the plan: least, median, most")
    plain_axes(chart)
    set_title(chart, "workspace, particles, and share with a plan")
    return figure


RECIPES = (
    Recipe(
        "w-many",
        "paper W, section VIII",
        "More than two particles",
        _sweeps,
        _many,
    ),
)
