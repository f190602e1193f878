"""Figures of steering: the workspace and the Δ configuration space (all position differences) side by side, both with the moves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from shoal.core.errors import InvalidInputError
from shoal.steering import ConvexWorkspace, DiskReach, PolygonReach, Region, SteeringEpisode
from shoal.steering.delta_space.two_moves import two_move_pieces
from shoal.views.drawing.charts import GRID, INK, ORANGE, bare_axes, new_figure, set_title
from shoal.views.steering.axes import PARTICLES, colour_of, draw_trajectories, draw_workspace, legend_below, outlines_of
from shoal.views.steering.space import draw_space

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

REACH_COLOURS = ("#08306b", "#2171b5", "#4292c6", "#6baed6", "#9ecae1", "#c6dbef", "#deebf7", "#eef5fc")


def plan_figure(episode: SteeringEpisode) -> Figure:
    """Return a figure of a plan: the workspace with the particles' paths, and the path of the position difference Δ.

    The number of each move stands at the end point of the move. With infinite friction, a shaded area shows the position
    differences that two moves can reach from the start. The figure shows a 3-D plan in perspective, with the shadows of the
    paths on the floor. Beside a 3-D plan, a chart shows the heights of the particles after each move.
    """
    problem = episode.problem
    plane = problem.place.dimensions == 2
    pair = problem.n_particles == 2 and not isinstance(problem.place, Region)
    figure = new_figure(10.4 if pair or not plane else 6.2, 5.6)
    grid = figure.subplots(1, 2 if pair or not plane else 1, squeeze=False)[0]
    if plane:
        draw_workspace(grid[0], problem.place)
        draw_trajectories(grid[0], episode)
    else:
        draw_space(grid[0], episode)
    missed = "" if episode else f"{episode.status}: "
    set_title(grid[0], f"{missed}{episode.planner}, {episode.moves} moves, length {episode.length:.4g}")
    if not plane:
        _draw_heights(grid[1], episode)
    elif pair:
        _draw_delta(grid[1], episode)
    return figure


def _draw_delta(axes: Axes, episode: SteeringEpisode) -> None:
    """Draw the Δ configuration space, the position differences that two moves can reach, and the path of the difference Δ."""
    workspace = episode.problem.place
    assert isinstance(workspace, ConvexWorkspace)
    draw_workspace(axes, workspace.differences)
    deltas = episode.states[:, 1] - episode.states[:, 0]
    ideal = not episode.problem.noisy and not episode.problem.particle_radius and np.isinf(episode.problem.friction)
    if ideal:  # otherwise the set has another shape
        for piece in two_move_pieces(workspace, deltas[0]):
            axes.fill(*piece.T, color="#9ecae1", alpha=0.9 if not workspace.round else 1.0, lw=0, zorder=1)
        axes.fill([], [], color="#9ecae1", label="reached in two moves")
    axes.plot(*deltas.T, "-", color=INK, lw=1.4, zorder=3)
    axes.plot(*deltas.T, ".", color=INK, ms=6, zorder=3)
    axes.plot(*deltas[0], "s", color=INK, ms=8, zorder=4, label="Δ at the start")
    axes.plot(*(episode.goal[1] - episode.goal[0]), "o", mfc="white", mec=INK, mew=2, ms=9, zorder=4, label="Δ at the goal")
    legend_below(axes)
    set_title(axes, "Δ configuration space")


def _draw_heights(axes: Axes, episode: SteeringEpisode) -> None:
    for particle in range(episode.problem.n_particles):
        heights, colour = episode.states[:, particle, 2], colour_of(particle)
        axes.plot(range(len(heights)), heights, "o-", color=colour, lw=1.5, ms=4, label=f"particle {particle + 1}")
        axes.plot(len(heights) - 1, episode.goal[particle, 2], "o", mfc="none", mec=colour, ms=11, mew=1.5)
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
    figure = new_figure(11.8 if points is not None else 7.8, 5.2)
    grid = figure.subplots(1, 2 if points is not None else 1, squeeze=False)[0]
    axes = grid[-1]
    samples = 500
    if points is not None:
        workspace = sets[0].workspace
        draw_workspace(grid[0], workspace)
        for point, colour, name in zip(np.asarray(points), PARTICLES, ("particle 1", "particle 2"), strict=False):
            grid[0].plot(*point, "s", color=colour, ms=8, label=name)
        grid[0].legend(loc="upper center", bbox_to_anchor=(0.5, -0.06), ncols=2, frameon=False, labelcolor=INK)
        set_title(grid[0], "Workspace")
    space = sets[0].workspace.differences
    outline = outlines_of(space)[0]
    low, high = outline.min(axis=0), outline.max(axis=0)
    steps = (np.arange(samples) + 0.5) / samples
    across, up = np.meshgrid(low[0] + steps * (high[0] - low[0]), low[1] + steps * (high[1] - low[1]))
    grid_points = np.stack([across, up], axis=-1)
    inside = space.contains(grid_points)
    picture = np.ones((samples, samples, 4))
    picture[..., 3] = 0
    from matplotlib.colors import to_rgba

    found = np.zeros((samples, samples), dtype=np.bool_)
    for reach, colour in zip(sets, REACH_COLOURS, strict=False):
        new = inside & ~found
        new[new] = reach.contains(grid_points[new])
        picture[new] = to_rgba(colour)
        found |= new
        axes.fill([], [], color=colour, label=f"{reach.moves} moves: {100 * reach.fraction():.2f} %")
    axes.imshow(picture, origin="lower", extent=(low[0], high[0], low[1], high[1]), interpolation="bilinear", zorder=1)
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
