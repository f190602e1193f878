"""Figures of steering: the workspace and the Δ configuration space (all position differences) side
by side, both with the moves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from math import pi
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_integer
from shoal.core.errors import InvalidInputError
from shoal.core.geometry import unit_vectors
from shoal.steering import ConvexWorkspace, DiskReach, PolygonReach, Region, SteeringEpisode
from shoal.steering.delta_space import two_move_pieces
from shoal.views.drawing.charts import (
    BLUE,
    GRID,
    INK,
    MUTED,
    ORANGE,
    PURPLE,
    bare_axes,
    fit_columns,
    new_panels,
    plain_axes,
    set_title,
    text_size,
)
from shoal.views.steering.trajectories import Frame3D, camera_for, project_to_floor

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from shoal.steering.driving import SteeringDrive


_APART = (5.0, 8.0, 12.0, 16.0)  # points between an end point and the box of its number
_MARK = 6.0  # points, the radius of the marks of starts and goals
_ENOUGH = 3.5  # points of free space around a number
_ANGLES = np.pi / 4 + np.arange(16) * np.pi / 8  # to the upper right first
_MOST = 3  # numbers at one end point


class MoveNumbers:
    """A writer that puts the numbers of moves at free places on the axes of a chart.

    Parameters
    ----------
    axes : Axes
        The axes, on which everything else is already drawn.
    lines : list of ndarray of float64, shape (n, 2)
        The paths and walls that no number may cover, in the coordinates of the axes.
    marks : ndarray of float64, shape (n, 2)
        The starts and goals.
    """

    def __init__(
        self, axes: Axes, lines: list[NDArray[np.float64]], marks: NDArray[np.float64]
    ) -> None:
        self._axes = axes
        self._scale = _points_per_unit(axes)
        rings = (marks[:, None] * self._scale + _MARK * _WAYS).reshape(-1, 2)
        self._taken = np.concatenate([*(_dense(line * self._scale) for line in lines), rings])

    def write(self, place: NDArray[np.float64], numbers: list[str], colour: str) -> None:
        """Write the numbers of the moves that end at ``place`` beside this point, at the offset
        where the text covers the least.
        """
        text = ", ".join(numbers[:_MOST]) + ("…" if len(numbers) > _MOST else "")
        half = text_size() * np.array([0.3 * len(text), 0.4])
        offsets = [
            apart * direction + half * direction / np.abs(direction).max()
            for apart in _APART
            for direction in _WAYS
        ]
        free = [min(self._space(place * self._scale + offset, half), _ENOUGH) for offset in offsets]
        best = offsets[int(np.argmax(free))]
        self._taken = np.concatenate([self._taken, place * self._scale + best + half * _CORNERS])
        self._axes.annotate(
            text,
            (float(place[0]), float(place[1])),
            xytext=(float(best[0]), float(best[1])),
            textcoords="offset points",
            ha="center",
            va="center_baseline",
            color=colour,
            fontsize=text_size(),
            zorder=5,
        )

    def _space(self, middle: NDArray[np.float64], half: NDArray[np.float64]) -> float:
        """Return the distance between a box and the nearest drawn object, in points; negative if
        the box covers an object.
        """
        apart = np.abs(self._taken - middle) - half
        inside = apart.max(axis=1)
        outside = np.hypot(*np.maximum(apart, 0.0).T)
        return float(np.where(inside < 0, inside, outside).min())


_WAYS = unit_vectors(_ANGLES)
_CORNERS = np.array([(x, y) for x in (-1.0, 0.0, 1.0) for y in (-1.0, 0.0, 1.0)])


def _points_per_unit(axes: Axes) -> float:
    """Return the length of one unit of the axes in points (1/72 inch), for axes with the same scale
    in both directions.
    """
    box, dpi = axes.get_window_extent(), axes.figure.dpi
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    return float(min(box.width / (right - left), box.height / (high - low)) * 72.0 / dpi)


def _dense(line: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points on a line, at most two units from each point to the next point; float64, shape
    (n, 2).
    """
    points = [line[-1:]]
    for begin, end in pairwise(line):
        count = int(np.ceil(np.hypot(*(end - begin)) / 2.0)) + 1
        points.append(begin + np.linspace(0.0, 1.0, count)[:, None] * (end - begin))
    return np.concatenate(points)


PARTICLES = (BLUE, ORANGE, PURPLE, "#009e73", "#b8860b")
_ROUND = 240
_BENT = 160  # maximum number of moves with numbers


def colour_of(particle: int) -> str:
    """Return the colour of the particle with a given index, counted from 0; after five particles,
    the colours repeat.
    """
    return PARTICLES[particle % len(PARTICLES)]


def draw_workspace(axes: Axes, workspace: ConvexWorkspace | Region) -> None:
    """Draw the walls and the free area of a plane workspace."""
    for k, ring in enumerate(outlines_of(workspace)):
        hole = k > 0
        axes.fill(
            *ring.T,
            facecolor="#d6d9de" if hole else "#f7f8fa",
            edgecolor=INK,
            lw=1.6,
            zorder=0.5 if hole else 0,
        )
    bare_axes(axes)
    axes.margins(0.08)  # the numbers of moves that end at walls


def outlines_of(workspace: ConvexWorkspace | Region) -> list[NDArray[np.float64]]:
    """Return the outline of a plane workspace and the outlines of its obstacles; each float64,
    shape (n, 2).
    """
    if isinstance(workspace, Region):
        return list(workspace.rings)
    if workspace.round:
        angles = np.linspace(0, 2 * np.pi, _ROUND, endpoint=False)
        return [workspace.center + workspace.radius * unit_vectors(angles)]
    return [workspace.vertices]


def draw_trajectories(
    axes: Axes,
    episode: SteeringEpisode,
    at: Callable[[ArrayLike], NDArray[np.float64]] = np.asarray,
) -> None:
    """Draw the path of each particle, with a square at its start, a circle at its goal, and the
    number of each move at its end.

    The function ``at`` converts points of the workspace to the coordinates of the axes.
    """
    from matplotlib.patches import Polygon

    size = episode.problem.place.size
    for particle in range(episode.problem.n_particles):
        path, colour = episode.states[:, particle], colour_of(particle)
        for begin, end in pairwise(path):
            if np.linalg.norm(end - begin) > 1e-4 * size:
                arrow_between(axes, at(begin), at(end), colour, width=1.5)
        axes.plot(*at(path[0]), "s", color=colour, ms=8, zorder=4, label=f"particle {particle + 1}")
        axes.plot(*at(episode.goal[particle]), "o", mfc="white", mec=colour, mew=2, ms=9, zorder=4)
    axes.plot([], [], "o", mfc="white", mec=MUTED, mew=2, ms=9, label="goal")
    paths = [at(episode.states[:, particle]) for particle in range(episode.problem.n_particles)]
    walls = [line.get_xydata() for line in axes.lines] + [
        patch.get_xy() for patch in axes.patches if isinstance(patch, Polygon)
    ]
    numbers = MoveNumbers(axes, [*paths, *walls], at([*episode.states[0], *episode.goal]))
    for particle, path in enumerate(paths):
        for place, moves in _ends(path, size):
            numbers.write(place, moves, colour_of(particle))
    legend_below(axes)


def arrow_between(
    axes: Axes,
    tail: NDArray[np.float64],
    tip: NDArray[np.float64],
    colour: str,
    *,
    width: float = 1.6,
    order: float = 3,
) -> None:
    """Draw an arrow from the point ``tail`` to the point ``tip``, each of shape (2,)."""
    style = {"arrowstyle": "-|>", "color": colour, "lw": width, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", xy=tuple(tip), xytext=tuple(tail), zorder=order, arrowprops=style)


def legend_below(axes: Axes, *, off: float = 0.06) -> None:
    """Place the legend of the chart below the axes."""
    from matplotlib.figure import Figure

    figure, grid, size = axes.get_figure(), axes.get_gridspec(), text_size()
    assert isinstance(figure, Figure)
    width = figure.get_figwidth() / (1 if grid is None else grid.ncols)
    labels = [str(label) for label in axes.get_legend_handles_labels()[1]]
    axes.legend(
        loc="upper center",
        bbox_to_anchor=(0.5, -off),
        ncols=fit_columns(labels, 3, width=width, size=size),
        frameon=False,
        fontsize=size,
        labelcolor=INK,
        handletextpad=0.3,
    )


def _ends(path: NDArray[np.float64], size: float) -> list[tuple[NDArray[np.float64], list[str]]]:
    """Return the points of a particle's path at which moves end, each with the numbers of these
    moves.

    The list omits moves that do not displace the particle. Nearly equal end points share one entry.
    If the path has more than `_BENT` moves, the list is empty.
    """
    labelled: list[tuple[NDArray[np.float64], list[str]]] = []
    if len(path) - 1 > _BENT:
        return labelled
    for number in range(1, len(path)):
        if np.linalg.norm(path[number] - path[number - 1]) <= 1e-4 * size:
            continue
        near = next(
            (entry for entry in labelled if np.linalg.norm(entry[0] - path[number]) < 0.03 * size),
            None,
        )
        if near is None:
            labelled.append((path[number], [str(number)]))
        else:
            near[1].append(str(number))
    return labelled


AZIMUTH = -pi / 3  # direction of the camera: x to the right and away, y to the left and away
_SHADOW, _FLOOR, _FAINT = "#8a919c", "#f4f6f8", "#b9c0c9"


def draw_space(axes: Axes, episode: SteeringEpisode) -> None:
    """Draw a 3-D plan: paths with starts and goals, their shadows on the floor, and a vertical line
    below each start and goal.
    """
    workspace, states = episode.problem.place, episode.states
    assert isinstance(workspace, ConvexWorkspace)
    camera = camera_for(workspace, states, azimuth=AZIMUTH)

    def at(points: ArrayLike) -> NDArray[np.float64]:
        return camera.project(points)[..., :2]

    frame = Frame3D.of(workspace)
    behind, front = frame.edges(camera.eye)
    axes.fill(*at(frame.floor).T, facecolor=_FLOOR, lw=0, zorder=0)
    for edge in behind:
        axes.plot(*at(edge).T, color=_FAINT, lw=1, zorder=0.5)
    for particle in range(episode.problem.n_particles):
        path, goal = states[:, particle], episode.goal[particle]
        axes.plot(*at(project_to_floor(path)).T, color=_SHADOW, lw=1.2, alpha=0.6, zorder=1)
        for end in (path[0], goal):
            axes.plot(
                *at([project_to_floor(end), end]).T,
                color=colour_of(particle),
                lw=1,
                ls=(0, (2, 2)),
                alpha=0.7,
                zorder=1.5,
            )
            axes.plot(*at(project_to_floor(end)), ".", color=_SHADOW, ms=6, zorder=1.5)
    draw_trajectories(axes, episode, at)
    for edge in front:
        axes.plot(*at(edge).T, color=INK, lw=1.3, alpha=0.8, zorder=3.5)
    bare_axes(axes)
    axes.set_xticks([])
    axes.set_yticks([])
    legend_below(axes, off=0.01)


REACH_COLOURS = (
    "#08306b",
    "#2171b5",
    "#4292c6",
    "#6baed6",
    "#9ecae1",
    "#c6dbef",
    "#deebf7",
    "#eef5fc",
)


def plan_figure(episode: SteeringEpisode, *, moves: int | None = None) -> Figure:
    """Return a figure of a plan: the workspace with the particles' paths, and the path of the
    position difference Δ.

    The number of each move stands at the end point of the move. With infinite friction, a shaded
    area shows the position differences that two moves can reach from the start. The figure shows a
    3-D plan in perspective, with the shadows of the paths on the floor. Beside a 3-D plan, a chart
    shows the heights of the particles after each move.

    Parameters
    ----------
    episode : SteeringEpisode
    moves : int, optional
        Number of moves of the plan that the figure shows; by default, all.

    Raises
    ------
    InvalidInputError
        If the plan has fewer than ``moves`` moves.
    """
    problem = episode.problem
    plan = episode
    if moves is not None:
        count = check_integer(moves, what="moves", least=0, most=episode.moves)
        episode = replace(
            episode, inputs=episode.inputs[:count], states=episode.states[: count + 1]
        )
    plane = problem.place.dimensions == 2
    pair = problem.n_particles == 2 and not isinstance(problem.place, Region)
    two = pair or not plane
    figure, grid = new_panels(10.4 if two else 6.2, 5.6, 1 + two)
    if plane:
        draw_workspace(grid[0], problem.place)
        draw_trajectories(grid[0], episode)
    else:
        draw_space(grid[0], episode)
    failure = "" if plan else f"{plan.status}: "
    shown_moves = "" if moves is None else f"{episode.moves} of "
    set_title(
        grid[0],
        f"{failure}{plan.planner}, {shown_moves}{plan.moves} moves, length {episode.length:.4g}",
        in_print="Workspace" if two else "",
    )
    if not plane:
        _draw_heights(grid[1], episode)
    elif pair:
        _draw_delta(grid[1], episode)
    return figure


def drive_figure(drive: SteeringDrive) -> Figure:
    """Return a figure of a drive: where looks have shown the particles, and how far they were from
    their goals after each move.
    """
    from matplotlib.ticker import FormatStrFormatter, LogLocator, MaxNLocator, NullLocator

    figure, (plan, errors) = new_panels(10.4, 5.6, 2)
    draw_workspace(plan, drive.problem.place)
    for particle in range(drive.seen.shape[1]):
        path, colour = drive.seen[:, particle], colour_of(particle)
        plan.plot(*path.T, "-", color=colour, lw=1.2, alpha=0.6, zorder=2)
        plan.plot(*path.T, ".", color=colour, ms=6, zorder=3)
        plan.plot(*path[0], "s", color=colour, ms=8, zorder=4, label=f"particle {particle + 1}")
        goal = drive.goal[particle]
        plan.plot(*goal, "o", mfc="none", mec=colour, mew=2, ms=10, zorder=4)
        away = np.linalg.norm(path - goal, axis=1)
        errors.semilogy(np.arange(len(away)), np.maximum(away, 1e-9), ".-", color=colour)
    legend_below(plan)
    errors.axhline(drive.problem.tolerance, color=INK, lw=1, ls="--", label="tolerance")
    plain_axes(errors)
    errors.xaxis.set_major_locator(MaxNLocator(integer=True))
    errors.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    errors.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    errors.yaxis.set_minor_locator(NullLocator())
    errors.set_xlabel("moves", color=INK)
    errors.set_ylabel("observed distance from the goal", color=INK)
    errors.legend(frameon=False)
    set_title(plan, f"{drive.status} after {drive.moves} moves")
    set_title(errors, "Distance from the goals")
    return figure


def _draw_delta(axes: Axes, episode: SteeringEpisode) -> None:
    """Draw the Δ configuration space, the position differences that two moves can reach, and the
    path of the difference Δ.
    """
    workspace = episode.problem.place
    assert isinstance(workspace, ConvexWorkspace)
    draw_workspace(axes, workspace.differences)
    deltas = episode.states[:, 1] - episode.states[:, 0]
    ideal = (
        not episode.problem.noisy
        and not episode.problem.particle_radius
        and np.isinf(episode.problem.friction)
    )
    if ideal:  # otherwise the set has another shape
        for corners in two_move_pieces(workspace, deltas[0]):
            axes.fill(
                *corners.T,
                color="#9ecae1",
                alpha=0.9 if not workspace.round else 1.0,
                lw=0,
                zorder=1,
            )
        axes.fill([], [], color="#9ecae1", label="reached in two moves")
    axes.plot(*deltas.T, "-", color=INK, lw=1.4, zorder=3)
    axes.plot(*deltas.T, ".", color=INK, ms=6, zorder=3)
    axes.plot(*deltas[0], "s", color=INK, ms=8, zorder=4, label="Δ at the start")
    axes.plot(
        *(episode.goal[1] - episode.goal[0]),
        "o",
        mfc="white",
        mec=INK,
        mew=2,
        ms=9,
        zorder=4,
        label="Δ at the goal",
    )
    legend_below(axes)
    set_title(axes, "Δ configuration space")


def _draw_heights(axes: Axes, episode: SteeringEpisode) -> None:
    for particle in range(episode.problem.n_particles):
        heights, colour = episode.states[:, particle, 2], colour_of(particle)
        axes.plot(
            range(len(heights)),
            heights,
            "o-",
            color=colour,
            lw=1.5,
            ms=4,
            label=f"particle {particle + 1}",
        )
        axes.plot(
            len(heights) - 1, episode.goal[particle, 2], "o", mfc="none", mec=colour, ms=11, mew=1.5
        )
    axes.set_ylim(-0.03 * episode.problem.place.height, 1.03 * episode.problem.place.height)
    from matplotlib.ticker import MaxNLocator

    axes.set_xlabel("move", color=INK)
    axes.set_ylabel("height", color=INK)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color=GRID, lw=0.6)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    set_title(axes, "Heights")


def reach_figure(sets: Sequence[DiskReach | PolygonReach], *, points: Any = None) -> Figure:
    """Return a figure of the sets of position differences that 2, 4, ... moves can reach.

    If ``points`` is given, the left side of the figure shows the workspace with the start points.

    Parameters
    ----------
    sets : sequence of DiskReach or PolygonReach
        One or more sets of position differences, from `disk_reach` or `polygon_reach`.
    points : array_like of float, shape (2, 2), optional
        Start points of the two particles.
    """
    if not sets:
        raise InvalidInputError("reach figure: expected at least one set, got none")
    two = points is not None
    figure, grid = new_panels(11.8 if two else 7.8, 5.2, 1 + two)
    axes = grid[-1]
    if points is not None:
        workspace = sets[0].workspace
        draw_workspace(grid[0], workspace)
        for point, colour, name in zip(
            np.asarray(points), PARTICLES, ("particle 1", "particle 2"), strict=False
        ):
            grid[0].plot(*point, "s", color=colour, ms=8, label=name)
        grid[0].legend(
            loc="upper center", bbox_to_anchor=(0.5, -0.06), ncols=2, frameon=False, labelcolor=INK
        )
        set_title(grid[0], "Workspace")
    space = sets[0].workspace.differences
    outline = outlines_of(space)[0]
    low, high = outline.min(axis=0), outline.max(axis=0)
    for order, (reach, colour) in enumerate(zip(sets, REACH_COLOURS, strict=False)):
        label = f"{reach.moves} moves: {100 * reach.fraction():.2f} %"
        # Each set contains the sets of fewer moves.
        axes.fill(*reach.outline.T, color=colour, lw=0, zorder=1 - 0.01 * order, label=label)
    axes.fill(*outline.T, facecolor="none", edgecolor=INK, lw=1.6, zorder=2)
    before = sets[0].before
    axes.plot(*before, "s", color=ORANGE, ms=7, zorder=4, label="Δ at the start")
    bare_axes(axes)
    edge = 0.03 * (high - low).max()  # otherwise the picture would be cut at the outer line
    axes.set(xlim=(low[0] - edge, high[0] + edge), ylim=(low[1] - edge, high[1] + edge))
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, labelcolor=INK)
    set_title(axes, "Reached in the Δ configuration space")
    return figure


FIGURES = {"plan": plan_figure}
