"""Paper W, figures 2, 3, 10 and 13: plans in a square, a Δ space, contacts in a tube, and how the
reachable sets change during a plan.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.geometry import unit_vectors
from shoal.lab.store import Store
from shoal.lab.sweep import Sweep
from shoal.papers.claims import claim
from shoal.papers.recipe import NO_DATA, Outcome, Recipe, Settings, Table
from shoal.papers.steering.constructions import FIVE, draw_difference_space, draw_pair
from shoal.steering import (
    ContactWorld,
    ConvexWorkspace,
    SteeringEpisode,
    SteeringProblem,
    cylinder,
    disk,
    polygon,
    reached_in_two_moves,
    regular_polygon,
)
from shoal.steering.run import run
from shoal.steering.workspaces.convex import Points, hull
from shoal.views.drawing.charts import INK, MUTED, padded_figure, set_title
from shoal.views.steering.figures import PARTICLES, draw_space, draw_trajectories, draw_workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CASES: tuple[tuple[Any, Any], ...] = (
    (((0.2, 0.2), (0.5, 0.4)), ((0.4, 0.5), (0.7, 0.7))),
    (((0.3, 0.7), (0.6, 0.5)), ((0.5, 0.6), (0.7, 0.4))),
    (((0.3, 0.4), (0.7, 0.6)), ((0.6, 0.4), (0.4, 0.7))),
    (((0.2, 0.5), (0.5, 0.5)), ((0.8, 0.2), (0.3, 0.8))),
    (((0.1, 0.1), (0.9, 0.9)), ((0.9, 0.9), (0.1, 0.1))),
    (((0.02, 0.02), (0.98, 0.98)), ((0.98, 0.98), (0.02, 0.02))),
)
"""Starts and goals in the unit square. The paper does not print its six cases; these are ours."""
FOUR = polygon([(0, 0), (1, 0.1), (0.8, 0.9), (0.15, 0.7)])
FRAMES: tuple[tuple[str, ConvexWorkspace, Any, Any], ...] = (
    ("polygon", FIVE, ((0.3, 0.65), (0.6, 0.35)), ((0.45, 0.8), (0.4, 0.3))),
    ("disk", disk(), ((-0.2, 0.1), (0.15, 0.0)), ((0.0, 0.2), (0.1, -0.2))),
)


def _two_d(workspace: Any, start: ArrayLike, goal: ArrayLike) -> SteeringEpisode:
    return run(SteeringProblem(workspace, start, goal, planner="greedy"))


# Fig. 2


def _moves(episode: SteeringEpisode) -> int:
    """Return the number of moves longer than the millionth by which plans press into a wall: where
    a particle already touches the wall, the first move of algorithm 1's pair is not longer.
    """
    return int(np.sum(np.linalg.norm(episode.inputs, axis=1) > 1e-5))


def _fig2(_store: Store, _sweeps: list[Sweep], _settings: Settings) -> Outcome:
    episodes = sorted((_two_d("square", start, goal) for start, goal in CASES), key=_moves)
    moves = [_moves(episode) for episode in episodes]
    bound = sqrt(2) + 2
    claims = (
        claim(
            "plans of algorithm 1 that reach their goals, of 6",
            "6",
            sum(bool(e) for e in episodes),
            within=(6, 6),
        ),
        claim(
            "most moves",
            "5 at most",
            max(moves),
            within=(-inf, 5),
            why="moves of a millionth do not count",
        ),
        claim(
            "longest plan",
            f"{bound:.3f}: (√2+2)L",
            max(e.length for e in episodes),
            within=(-inf, bound),
            why="w-swap has problems that refute it; these six do not",
        ),
    )
    figure = padded_figure(9.6, 6.6)
    for axes, episode, letter in zip(figure.subplots(2, 3).flat, episodes, "abcdef", strict=True):
        draw_workspace(axes, episode.problem.place)
        for particle in (0, 1):
            ends = np.array([episode.states[0, particle], episode.goal[particle]])
            axes.plot(*ends.T, "--", color=PARTICLES[particle], lw=1.2)
        draw_trajectories(axes, episode)
        axes.set_axis_off()
        set_title(axes, f"({letter}) moves: {_moves(episode)}, length {episode.length:.2f}")
    rows = [
        [letter, _moves(e), round(e.length, 4), str(e.status)]
        for letter, e in zip("abcdef", episodes, strict=True)
    ]
    return Outcome(
        figure,
        claims,
        "The six configurations are not printed; these are our own, in the order of their moves.",
        (Table("plans", ["", "moves", "length", "status"], rows),),
        f"dashed: the ways of particles with inputs of their own; {NO_DATA}",
    )


# Fig. 3


def _translated_hull(vertices: Points) -> Points:
    """Return the hull of copies of a polygon, each with another vertex at the origin."""
    return hull((vertices[None] - vertices[:, None]).reshape(-1, 2))


def _random_polygon(rng: np.random.Generator, sides: int) -> ConvexWorkspace:
    angles = np.sort(rng.uniform(0, 2 * np.pi, sides))
    # on an ellipse every corner is convex
    return polygon(np.column_stack([np.cos(angles), 0.6 * np.sin(angles)]))


def _fig3(_store: Store, _sweeps: list[Sweep], settings: Settings) -> Outcome:
    rng = np.random.default_rng(settings.seed)
    around, rows, errors = unit_vectors(np.linspace(0, 2 * np.pi, 360)).T, [], []
    for sides in (3, 4, 5, 6, 7, 8):
        counts = []
        for _ in range(settings.of(50, 8)):
            place = _random_polygon(rng, sides)
            space = place.differences.vertices
            counts.append(len(_translated_hull(place.vertices)))
            # how far the polygon reaches in a direction, and back
            heights = place.vertices @ around
            widths = heights.max(axis=0) - heights.min(axis=0)
            errors.append(float(np.max(np.abs((space @ around).max(axis=0) - widths))))
        regular = len(regular_polygon(sides).differences.vertices)
        rows.append([sides, min(counts), max(counts), regular])
    claims = (
        claim(
            "corners of the Δ space by 2n, random polygons of n = 3 to 8 sides, least",
            "1: 2n sides",
            min(row[1] / (2 * row[0]) for row in rows),
            within=(1, 1),
        ),
        claim(
            "the same, most",
            "1: 2n sides",
            max(row[2] / (2 * row[0]) for row in rows),
            within=(1, 1),
        ),
        claim(
            "regular polygons of 4, 6 and 8 sides: corners by n",
            "1: half the sides align",
            max(row[3] / row[0] for row in rows if row[0] % 2 == 0),
            within=(1, 1),
        ),
        claim(
            "reach of the Δ space in 360 directions less the width of the workspace, most",
            "0: all differences",
            max(errors),
            within=(0, 1e-9),
            why="two particles differ by the width of the workspace at most",
        ),
    )
    figure = padded_figure(9.6, 3.6)
    left, middle, right = figure.subplots(1, 3)
    start = np.array([(0.35, 0.45), (0.6, 0.4)])
    draw_pair(left, FOUR, start, "workspace")
    for k, vertex in enumerate(FOUR.vertices):
        copy = np.vstack([FOUR.vertices, FOUR.vertices[:1]]) - vertex
        middle.plot(*copy.T, color=MUTED, lw=1.1, alpha=0.5 + 0.1 * k)
    outline = _translated_hull(FOUR.vertices)
    middle.plot(*np.vstack([outline, outline[:1]]).T, "--", color=INK, lw=1.6)
    middle.plot(0, 0, "o", color=INK, ms=4)
    middle.set_aspect("equal")
    middle.set_axis_off()
    set_title(middle, "four copies and their hull")
    draw_difference_space(right, FOUR, start, "Δ space, reached in two moves")
    return Outcome(
        figure,
        claims,
        "A polygon with parallel sides has fewer than 2n, as the paper says of regular ones.",
        (
            Table(
                "corners of the Δ space",
                ["sides n", "least", "most", "regular polygon"],
                rows,
            ),
        ),
        "the paper's polygon is not printed; this one is ours",
    )


# Fig. 10


def _tube_moves(rng: np.random.Generator, count: int) -> tuple[int, int, float]:
    """Play pairs of moves in a tube: a first move to its wall, and a second move that presses the
    touching particle against it.

    Return how many pairs were played, how many ended with a Δ whose part across the tube is not
    reachable in two moves on the disk, and the largest change of Δ along the tube by its height.
    """
    tube, start = cylinder(0.5, 1.0), np.array([(-0.2, 0.0, 0.5), (0.2, 0.0, 0.5)])
    world, flat = ContactWorld(tube), disk(0.5)
    played = outside = 0
    tallest = 0.0
    while played < count:
        toucher, angle = int(rng.integers(2)), rng.uniform(0, 2 * np.pi)
        contact = np.array([0.5 * np.cos(angle), 0.5 * np.sin(angle), rng.uniform(0.05, 0.95)])
        after = start + contact - start[toucher]
        goal = np.append(rng.uniform(-0.5, 0.5, 2), rng.uniform(0.02, 0.98))
        move = goal - after[1 - toucher]
        if (
            not tube.contains(after[1 - toucher])
            or not tube.contains(goal)
            or not world.are_held(after, move)[toucher]
        ):
            continue
        end = world.play(start, [contact - start[toucher], move])[-1]
        before, now = start[1] - start[0], end[1] - end[0]
        played += 1
        outside += reached_in_two_moves(flat, before[:2], now[:2]) is None
        tallest = max(tallest, abs(float(now[2] - before[2])))
    return played, outside, tallest


def _fig10(_store: Store, _sweeps: list[Sweep], settings: Settings) -> Outcome:
    rng = np.random.default_rng(settings.seed)
    played, outside, tallest = _tube_moves(rng, settings.of(2000, 200))
    start = [(-0.2, 0.0, 0.3), (0.2, 0.1, 0.4)]
    goal = [(0.1, -0.1, 0.8), (0.25, 0.2, 0.2)]
    episode = run(SteeringProblem(cylinder(0.5, 1.0), start, goal))
    claims = (
        claim(
            f"pairs of moves whose Δ across the tube is not in the 2-D set, of {played}",
            "0: a prism over the 2-D set",
            outside,
            within=(0, 0),
            why="one refutes it",
        ),
        claim(
            "largest change of Δ along the tube, by its height",
            "any",
            tallest,
            within=(0.7, 1),
            why="random moves come near the whole height",
        ),
        claim(
            "a plan in a cylinder reaches goals at other heights",
            "1: yes",
            int(bool(episode)),
            within=(1, 1),
        ),
    )
    figure = padded_figure(5.4, 5.0)
    axes = figure.add_subplot()
    draw_space(axes, episode)
    set_title(axes, f"{episode.moves} moves, length {episode.length:.2f}")
    table = Table(
        "plan",
        ["move", "x", "y", "z"],
        [[k + 1, *np.round(move, 4).tolist()] for k, move in enumerate(episode.inputs)],
    )
    sentence = "The prism ends where the tube ends, as the other particle stays inside."
    return Outcome(figure, claims, sentence, (table,), f"positions are ours; {NO_DATA}")


# Fig. 13


def _changes(episode: SteeringEpisode) -> NDArray[np.float64]:
    """Return by how much each move changes Δ; float64, shape (moves,)."""
    deltas = episode.states[:, 1] - episode.states[:, 0]
    return np.asarray(np.linalg.norm(np.diff(deltas, axis=0), axis=1))


def _fig13(_store: Store, _sweeps: list[Sweep], _settings: Settings) -> Outcome:
    episodes = [(name, place, _two_d(place, start, goal)) for name, place, start, goal in FRAMES]
    claims = []
    for name, _, episode in episodes:
        changes = _changes(episode)
        delta_goal = episode.goal[1] - episode.goal[0]
        ended = episode.states[-2, 1] - episode.states[-2, 0]
        claims += [
            claim(f"{name}: moves", "3", episode.moves, within=(3, 3)),
            claim(
                f"{name}: change of Δ by moves 1 and 3, most",
                "0: translations",
                float(changes[[0, -1]].max()),
                within=(0, 1e-5),
                why="the plan presses a millionth into the wall",
            ),
            claim(
                f"{name}: distance of Δ from that of the goals after move 2",
                "0",
                float(np.linalg.norm(ended - delta_goal)),
                within=(0, 1e-6),
            ),
        ]
    figure = padded_figure(11.6, 10.0)
    grid = figure.subplots(4, 4)
    for pair, (_, place, episode) in zip((grid[:2], grid[2:]), episodes, strict=True):
        moments = [
            ("start", episode.states[0]),
            ("after move 1", episode.states[1]),
            ("within move 2", (episode.states[1] + episode.states[2]) / 2),
            ("after move 2", episode.states[2]),
        ]
        for column, (title, state) in enumerate(moments):
            _draw_frame(pair[0, column], place, episode, state, title)
            draw_difference_space(pair[1, column], place, state, "")
            pair[1, column].plot(
                *(episode.goal[1] - episode.goal[0]), "o", mfc="none", mec=INK, ms=9
            )
    rows = [
        [name, k + 1, *np.round(move, 4).tolist(), round(float(change), 6)]
        for name, _, episode in episodes
        for k, (move, change) in enumerate(zip(episode.inputs, _changes(episode), strict=True))
    ]
    return Outcome(
        figure,
        tuple(claims),
        "Squares: Δ; circles: Δ of the goals. Move 3 is a translation like move 1.",
        (Table("moves", ["workspace", "move", "x", "y", "change of Δ"], rows),),
        f"starts and goals are ours; {NO_DATA}",
    )


def _draw_frame(
    axes: Axes, place: ConvexWorkspace, episode: SteeringEpisode, state: Points, title: str
) -> None:
    draw_pair(axes, place, state, title)
    for goal, colour in zip(episode.goal, PARTICLES, strict=False):
        axes.plot(*goal, "o", mfc="none", mec=colour, ms=9)


RECIPES = (
    Recipe(
        "w-fig2", "paper W, Fig. 2", "Six plans of algorithm 1 in a square", lambda _: [], _fig2
    ),
    Recipe("w-fig3", "paper W, Fig. 3", "The Δ space of a polygon", lambda _: [], _fig3),
    Recipe("w-fig10", "paper W, Fig. 10", "Contacts with the wall of a tube", lambda _: [], _fig10),
    Recipe("w-fig13", "paper W, Fig. 13", "Reachable sets during a plan", lambda _: [], _fig13),
)
