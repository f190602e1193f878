"""Paper W, section VIII: more than two particles, by plans at two walls and by the law of clipped
distances.
"""

from __future__ import annotations

from math import inf
from typing import Any

import numpy as np
from numpy.random import Generator

from shoal.core.errors import InvalidInputError
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
    is_reachable_without_friction,
    rearrange,
    room_to_rearrange,
)
from shoal.steering.workspaces.convex import Points
from shoal.views.drawing.charts import BLUE, INK, MUTED, padded_figure, plain_axes, set_title
from shoal.views.steering.figures import colour_of, draw_workspace

WORKSPACES = {
    "square": polygon([(0, 0), (1, 0), (1, 1), (0, 1)]),
    "parallelogram": polygon([(0, 0), (1, 0.2), (1.3, 0.9), (0.3, 0.7)]),
    "triangle": regular_polygon(3),
    "pentagon": regular_polygon(5),
    "hexagon": regular_polygon(6),
    "octagon": regular_polygon(8),
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
    ("hexagon", 5),
    ("octagon", 3),
)
CORNERS = ("triangle", "square", "pentagon", "hexagon")
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


def _plan_case(workspace: ConvexWorkspace, start: Points, goal: Points) -> dict[str, float]:
    """Return whether a plan is found, its moves, and how far from the goals it ends, in sizes."""
    try:
        moves = rearrange(workspace, start, goal)
    except InvalidInputError:
        return {"planned": 0, "moves": 0, "error": 0.0}
    missed = ContactWorld(workspace).play(start, moves)[-1] - goal
    return {
        "planned": 1,
        "moves": len(moves),
        "error": float(np.abs(missed).max()) / workspace.size,
    }


@measuring("room", "planned", "moves", "error")
def rearrangement(*, seed: int, case: int) -> dict[str, float]:
    """Return whether a random start and goal have room at two walls, and what is planned."""
    name, count = CASES[case]
    workspace, rng = WORKSPACES[name], np.random.default_rng(seed)
    start, goal = (random_positions(rng, workspace, count) for _ in range(2))
    room = min(room_to_rearrange(workspace, points) for points in (start, goal)) > 0
    return {"room": room, **_plan_case(workspace, start, goal)}


@measuring("planned", "moves", "error")
def near_corners(*, seed: int, sides: int, near: float) -> dict[str, float]:
    """Return what is planned if each corner is the goal of one particle, up to a share ``near`` of
    its distance from the middle.
    """
    workspace, rng = WORKSPACES[CORNERS[sides - 3]], np.random.default_rng(seed)
    middle = workspace.vertices.mean(axis=0)
    shares = 1 - near * rng.uniform(0.9, 1.1, (sides, 1))
    goal = middle + shares * (workspace.vertices - middle)
    return _plan_case(workspace, random_positions(rng, workspace, sides), goal)


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
    stuck = ContactWorld(square).play(together, moves)[-1]
    slid = ContactWorld(square, friction=0.0).play(start, moves)
    apart = np.abs(slid[:, :, None] - slid[:, None])  # (moves + 1, 3, 3, 2)
    return {
        "merged": float(np.abs(stuck[0] - stuck[1]).max()),
        "clipped": all(is_reachable_without_friction(start, state) for state in slid),
        "grown": float(np.diff(apart, axis=0).max()),
        "goal": is_reachable_without_friction(start, random_positions(rng, square, 3)),
    }


def _sweeps(settings: Settings) -> list[Sweep]:
    trials = settings.of(200, 10)
    corners = {"sides": [3, 4, 5, 6], "near": [0.3, 0.1, 0.03]}
    return [
        function_sweep("w-many", rearrangement, {"case": [*range(len(CASES))]}, trials, settings),
        function_sweep("w-many-limits", limits, {}, settings.of(500, 30), settings),
        function_sweep("w-many-corners", near_corners, corners, settings.of(10, 2), settings),
    ]


def _many(store: Store, sweeps: list[Sweep], _settings: Settings) -> Outcome:
    trials, random, corners = (trials_of(store, sweep) for sweep in sweeps)
    own = {case: [t for t in trials if t["case"] == k] for k, case in enumerate(CASES)}
    planned = [t for t in trials + corners if t["planned"]]
    share = {case: float(np.mean([t["planned"] for t in group])) for case, group in own.items()}
    full = [case for case in CASES if case[0] in {"square", "parallelogram"}]
    claims = (
        claim(
            "parallelograms, 2 to 6 particles: share of random problems with a plan",
            "could be extended",
            min(share[case] for case in full),
            within=(1, 1),
            why="any pairwise different positions can be reached (theorem 1)",
        ),
        claim(
            "random problems with room at two walls in other polygons: share with a plan",
            "could be extended",
            float(np.mean([t["planned"] for t in trials if t["room"]])),
            within=(1, 1),
            why="theorem 2",
        ),
        claim(
            "other polygons, 3 to 5 particles: least share of random problems with a plan",
            "could be extended",
            min(share[case] for case in CASES if case not in full),
            unlike="a plan proves that a goal can be reached; that all can is not proven",
        ),
        claim(
            "all plans: largest distance to a goal, in sizes",
            "0",
            max(t["error"] for t in planned),
            within=(0, 1e-7),
            why="by simulation; only contacts are found to a tolerance",
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
            round(float(np.mean([t["room"] for t in own[case]])), 3),
            round(share[case], 3),
            *_spread(own[case]),
        ]
        for case in CASES
    ]
    ends: dict[tuple[int, float], list[dict[str, Any]]] = {}
    for t in corners:
        ends.setdefault((t["sides"], t["near"]), []).append(t)
    columns = ["workspace", "particles", "with room", "with a plan", "least", "median", "most"]
    tables = (
        Table("plans", columns, rows),
        Table(
            "goals near all corners",
            ["sides and particles", "distance from the corners", "with a plan", *columns[4:]],
            [
                [sides, near, float(np.mean([t["planned"] for t in group])), *_spread(group)]
                for (sides, near), group in ends.items()
            ],
        ),
        trials_table(trials, ["case", "room", "planned", "moves", "error"]),
    )
    sentence = (
        "With walls that hold, any number of particles at different places can be rearranged at"
        " will in a parallelogram, and wherever they have room at two walls of a convex polygon: the"
        " particle that touches a wall first is shifted along it, and two walls are enough to do so"
        " with each particle in turn. Others are first drawn together, which succeeds for random"
        " positions, but takes ever more moves, or fails, if each corner is the goal of a particle."
        " Open are such goals, and disks. The plans show that a way exists, not a short one."
    )
    return Outcome(_draw_chart(rows), claims, sentence, tables)


def _spread(trials: list[dict[str, Any]]) -> tuple[int, int, int] | tuple[str, str, str]:
    moves = [t["moves"] for t in trials if t["planned"]]
    return (min(moves), int(np.median(moves)), max(moves)) if moves else ("", "", "")


def _draw_chart(rows: list[list[Any]]) -> Any:
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
