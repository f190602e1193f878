"""Paper W, figures 5 to 7: construction of the set of position differences that two moves reach on
a square, polygon and disk.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from typing import TYPE_CHECKING, Any

import numpy as np
from shapely import Polygon

from shoal.core.geometry import unit_vectors
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
    trials_table,
)
from shoal.steering import (
    ContactWorld,
    ConvexWorkspace,
    disk,
    open_workspace,
    polygon,
    reached_in_two_moves,
)
from shoal.steering.delta_space import two_move_pieces
from shoal.steering.workspaces.convex import Points
from shoal.views.drawing.charts import GREEN, INK, MUTED, ORANGE, padded_figure, set_title
from shoal.views.steering.figures import PARTICLES, arrow_between, draw_workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FIVE = polygon([(0, 0), (1, 0), (1.15, 0.6), (0.5, 1.05), (-0.1, 0.55)])
STARTS: dict[str, tuple[ConvexWorkspace, Points]] = {
    # it is convex
    "square": (open_workspace("square"), np.array([(0.35, 0.6), (0.6, 0.3)])),  # type: ignore[dict-item]
    "five sides": (FIVE, np.array([(0.3, 0.65), (0.6, 0.35)])),
    "disk": (disk(), np.array([(-0.2, 0.0), (0.2, 0.0)])),
}
PER_TRIAL = 60


def first_contact(
    workspace: ConvexWorkspace, state: Points, toucher: int, rng: np.random.Generator
) -> tuple[Points, Points]:
    """Return a random wall point that a particle can touch in the first move, and both particles'
    positions at this contact.
    """
    while True:
        if workspace.round:
            angle = rng.uniform(0, 2 * pi)
            contact = workspace.center + workspace.radius * unit_vectors(angle)
        else:
            side, share = rng.integers(len(workspace.vertices)), rng.uniform()
            contact = (1 - share) * workspace.vertices[side] + share * workspace.vertices[
                (side + 1) % len(workspace.vertices)
            ]
        after = state + contact - state[toucher]
        if workspace.contains(after[1 - toucher]):
            return contact, after


@measuring("played", "outside", "widest")
def two_move_outcomes(*, seed: int, workspace: str) -> dict[str, float]:
    """Simulate random pairs of moves: a first move to a wall, and a second move along the wall or
    into the wall.

    The function returns the number of simulated pairs of moves (``played``), and how many of the
    pairs end outside the computed set of position differences (``outside``).

    The result ``widest`` is the largest angle, in radians, between a contact direction and the
    initial direction from particle 2 to particle 1. A contact direction points from the centre of
    the workspace to a contact of particle 1.
    """
    rng, (place, start) = np.random.default_rng(seed), STARTS[workspace]
    world, before = ContactWorld(place), start[1] - start[0]
    played = outside = 0
    widest = 0.0
    low, high = place.bounds
    while played < PER_TRIAL:
        toucher = int(rng.integers(2))
        contact, after = first_contact(place, start, toucher, rng)
        goal = rng.uniform(low, high)
        move = goal - after[1 - toucher]
        if not place.contains(goal) or not world.are_held(after, move)[toucher]:
            continue
        end = world.play(start, [contact - start[toucher], move])[-1]
        played += 1
        outside += reached_in_two_moves(place, before, end[1] - end[0]) is None
        if toucher == 0:
            turn = np.angle(
                np.exp(
                    1j * (np.arctan2(*(contact - place.center)[::-1]) - np.arctan2(*-before[::-1]))
                )
            )
            widest = max(widest, abs(float(turn)))
    return {"played": played, "outside": outside, "widest": widest}


def _sweeps(name: str, workspace: str) -> Callable[[Settings], list[Sweep]]:
    return lambda settings: [
        function_sweep(
            name, two_move_outcomes, {"workspace": [workspace]}, settings.of(50, 5), settings
        )
    ]


def _pair_claims(store: Store, sweep: Sweep) -> tuple[Claim, float, Table]:
    """Return the claim that no random pair of moves leaves the computed set, the largest angle
    ``widest``, and all trials.
    """
    trials = trials_of(store, sweep)
    played, outside = (sum(trial[name] for trial in trials) for name in ("played", "outside"))
    outside_claim = claim(
        f"share of {played:g} random pairs of moves that end outside of the set",
        "0",
        outside / played,
        within=(0, 0),
        why="the set is that of all pairs; one outside refutes it",
    )
    return (
        outside_claim,
        max(trial["widest"] for trial in trials),
        trials_table(trials, ["trial", "played", "outside"]),
    )


def _pieces(place: ConvexWorkspace, start: Points) -> list[Polygon]:
    return [Polygon(corners) for corners in two_move_pieces(place, start[1] - start[0])]


def _distinct(polygons: list[Polygon]) -> list[Polygon]:
    distinct: list[Polygon] = []
    for shape in polygons:
        if all(shape.symmetric_difference(earlier).area > 1e-9 for earlier in distinct):
            distinct.append(shape)
    return distinct


def draw_pair(axes: Axes, place: ConvexWorkspace, start: Points, title: str) -> None:
    """Draw a workspace and the positions of both particles."""
    draw_workspace(axes, place)
    axes.set_axis_off()
    for point, colour in zip(start, PARTICLES, strict=False):
        axes.plot(*point, "s", color=colour, ms=7, zorder=5)
    set_title(axes, title)


def _draw_crossing(
    axes: Axes, place: ConvexWorkspace, start: Points, wall: int, title: str
) -> None:
    """Draw the possible contacts of particle 2 with a wall, and for one contact the possible
    positions of particle 1.
    """
    draw_pair(axes, place, start, title)
    normal, corner = place.normals[wall], place.vertices[wall]
    along = place.vertices[(wall + 1) % len(place.vertices)] - corner
    shares = np.linspace(0, 1, 201)
    points = corner + shares[:, None] * along
    section = points[place.contains(points + start[0] - start[1])]
    depth = float(normal @ (start[0] - start[1]))
    heights = place.vertices @ normal - float(normal @ corner)
    slab = Polygon(place.vertices).intersection(_below(place, corner, normal, depth))
    axes.fill(*slab.exterior.xy, color="#c9ced6", alpha=0.75, lw=0, zorder=1)
    axes.plot(*section[[0, -1]].T, color=GREEN, lw=5, solid_capstyle="butt", zorder=4)
    contact = section[len(section) // 2]
    for particle in (0, 1):
        arrow_between(
            axes,
            start[particle],
            start[particle] + contact - start[1],
            PARTICLES[particle],
            order=4,
        )
    assert heights.max() >= depth  # the other particle is inside


def _below(place: ConvexWorkspace, corner: Points, normal: Points, depth: float) -> Polygon:
    """Return a strip of the depth ``depth`` along a wall, as a polygon."""
    along, size = np.array([normal[1], -normal[0]]), 4 * place.size
    return Polygon(
        [
            corner - size * along,
            corner + size * along,
            corner + size * along + depth * normal,
            corner - size * along + depth * normal,
        ]
    )


def draw_difference_space(axes: Axes, place: ConvexWorkspace, start: Points, title: str) -> None:
    """Draw the position differences that two moves reach: one pale area for each pair of a wall and
    a touching particle.
    """
    draw_workspace(axes, place.differences)
    axes.set_axis_off()
    for corners in two_move_pieces(place, start[1] - start[0]):
        axes.fill(
            *corners.T,
            facecolor="#9ecae1" if place.round else "#4292c6",
            alpha=1 if place.round else 0.25,
            lw=0,
            zorder=1,
        )
        if not place.round:
            axes.fill(*corners.T, facecolor="none", edgecolor="#2171b5", lw=0.8, zorder=2)
    axes.plot(*(start[1] - start[0]), "s", color=INK, ms=7, zorder=4)
    set_title(axes, title)


def _fig5(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    place, start = STARTS["square"]
    played, _, table = _pair_claims(store, sweeps[0])
    pieces = _pieces(place, start)
    claims = (
        claim(
            "sets of two moves, one for each wall and toucher that can be used", "4", len(pieces)
        ),
        claim(
            "different ones in the Δ configuration space",
            "2: those of opposite walls are equivalent",
            len(_distinct(pieces)),
            within=(2, 2),
        ),
        played,
    )
    figure = padded_figure(10.2, 3.6)
    left, middle, right = figure.subplots(1, 3)
    _draw_crossing(left, place, start, 0, "particle 2 touches below")
    _draw_crossing(middle, place, start, 1, "particle 2 touches at the right")
    draw_difference_space(right, place, start, "all sets of two moves")
    return Outcome(
        figure,
        claims,
        "Green: where the toucher can be; grey: where the other can go then.",
        (table,),
        NO_DATA,
    )


def _fig6(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    place, start = STARTS["five sides"]
    played, _, table = _pair_claims(store, sweeps[0])
    pieces = _pieces(place, start)
    claims = (
        claim(
            "sets of two moves of five sides",
            "5",
            len(pieces),
            why="a side that no particle can reach first has none",
        ),
        played,
    )
    figure = padded_figure(10.2, 3.8)
    left, middle, right = figure.subplots(1, 3)
    draw_pair(left, place, start, "start")
    for k, corner in enumerate(place.vertices):
        outward = corner - place.vertices.mean(axis=0)
        left.text(
            *(corner + 0.09 * outward / np.hypot(*outward)),
            f"p{k + 1}",
            ha="center",
            va="center",
            color=MUTED,
        )
    _draw_crossing(middle, place, start, 0, "particle 2 touches p1 p2")
    draw_difference_space(right, place, start, "union over all sides")
    sentence = (
        "The steps are those of the corrected algorithm 2; that as printed shares at most two"
        " thirds with this set (errata)."
    )
    return Outcome(figure, claims, sentence, (table,), NO_DATA)


def _fig7(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    place, start = STARTS["disk"]
    played, widest, table = _pair_claims(store, sweeps[0])
    before, r = start[1] - start[0], place.radius
    half = pi / 2 - float(np.arcsin(np.hypot(*before) / (2 * r)))
    angles = (pi - half, pi - half / 4)
    gammas = [float(np.arccos(1 + before[0] * np.cos(angle) / r)) for angle in angles]
    claims = (
        claim(
            "widest contact from the line of the particles, radians",
            f"{half:.3f}",
            widest,
            within=(0.9 * half, half + 1e-9),
            why="equation 2 is the bound, and random contacts come near to it",
        ),
        claim(
            "half of the chord at a contact, by γ",
            "0.5: ψ ± γ/2",
            1.0,
            within=(0.5, 0.5),
            why="γ of equation 3 is the half angle: cos γ = 1 - d/r",
        ),
        played,
    )
    figure = padded_figure(10.4, 3.8)
    left, middle, right = figure.subplots(1, 3)
    draw_pair(left, place, start, "first contacts")
    for turn, colour in zip((pi, 0.0), PARTICLES, strict=False):
        arc = np.linspace(turn - half, turn + half, 90)
        left.plot(
            r * np.cos(arc), r * np.sin(arc), color=colour, lw=5, solid_capstyle="butt", zorder=4
        )
    draw_pair(middle, place, start, "where particle 2 can go")
    draw_difference_space(right, place, start, "set of two moves")
    for angle, gamma, colour in zip(angles, gammas, (ORANGE, GREEN), strict=True):
        chord = angle + np.linspace(-gamma, gamma, 60)
        points = r * unit_vectors(chord)
        contact = r * unit_vectors(angle)
        middle.fill(*points.T, color=colour, alpha=0.3, lw=0, zorder=1)
        middle.plot(*contact, "o", color=colour, ms=7, zorder=5)
        right.fill(*(points - contact).T, color=colour, alpha=0.45, lw=0, zorder=3)
    sentence = (
        "Circles are contacts of particle 1; the piece of the disk that particle 2 can reach from"
        " each has its colour."
    )
    return Outcome(figure, claims, sentence, (table,), NO_DATA)


RECIPES: tuple[Any, ...] = (
    Recipe(
        "w-fig5",
        "paper W, Fig. 5",
        "What two moves reach in a square",
        _sweeps("w-fig5", "square"),
        _fig5,
    ),
    Recipe(
        "w-fig6",
        "paper W, Fig. 6",
        "What two moves reach in a polygon",
        _sweeps("w-fig6", "five sides"),
        _fig6,
    ),
    Recipe(
        "w-fig7",
        "paper W, Fig. 7",
        "What two moves reach on a disk",
        _sweeps("w-fig7", "disk"),
        _fig7,
    ),
)
