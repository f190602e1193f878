"""Functions that draw workspaces and particle paths on the axes of a chart."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.steering import ConvexWorkspace, Region, SteeringEpisode
from shoal.views.drawing.charts import BLUE, INK, ORANGE, PURPLE, bare_axes
from shoal.views.steering.move_numbers import MoveNumbers

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PARTICLES = (BLUE, ORANGE, PURPLE, "#009e73", "#b8860b")
_ROUND = 240
_BENT = 160  # maximum number of moves with numbers


def colour_of(particle: int) -> str:
    """Return the colour of the particle with a given index, counted from 0; after five particles, the colours repeat."""
    return PARTICLES[particle % len(PARTICLES)]


def draw_workspace(axes: Axes, workspace: ConvexWorkspace | Region) -> None:
    """Draw the walls and the free area of a plane workspace."""
    for k, ring in enumerate(outlines_of(workspace)):
        hole = k > 0
        axes.fill(*ring.T, facecolor="#d6d9de" if hole else "#f7f8fa", edgecolor=INK, lw=1.6, zorder=0.5 if hole else 0)
    bare_axes(axes)


def outlines_of(workspace: ConvexWorkspace | Region) -> list[NDArray[np.float64]]:
    """Return the outline of a plane workspace and the outlines of its obstacles; each float64, shape (n, 2)."""
    if isinstance(workspace, Region):
        return list(workspace.rings)
    if workspace.round:
        angles = np.linspace(0, 2 * np.pi, _ROUND, endpoint=False)
        return [workspace.center + workspace.radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)]
    return [workspace.vertices]


def draw_trajectories(axes: Axes, episode: SteeringEpisode, at: Callable[[ArrayLike], NDArray[np.float64]] = np.asarray) -> None:
    """Draw the path of each particle, with a square at its start, a circle at its goal, and the number of each move at its end.

    The function ``at`` converts points of the workspace to the coordinates of the axes.
    """
    from matplotlib.patches import Polygon

    size = episode.problem.place.size
    for particle in range(episode.problem.n_particles):
        way, colour = episode.states[:, particle], colour_of(particle)
        for here, there in pairwise(way):
            if np.linalg.norm(there - here) > 1e-4 * size:
                arrow_between(axes, at(here), at(there), colour, width=1.5)
        axes.plot(*at(way[0]), "s", color=colour, ms=8, zorder=4, label=f"particle {particle + 1}")
        axes.plot(*at(episode.goal[particle]), "o", mfc="white", mec=colour, mew=2, ms=9, zorder=4)
    ways = [at(episode.states[:, particle]) for particle in range(episode.problem.n_particles)]
    walls = [line.get_xydata() for line in axes.lines] + [patch.get_xy() for patch in axes.patches if isinstance(patch, Polygon)]
    numbers = MoveNumbers(axes, [*ways, *walls], at([*episode.states[0], *episode.goal]))
    for particle, way in enumerate(ways):
        for place, moves in _ends(way, size):
            numbers.write(place, moves, colour_of(particle))
    legend_below(axes)


def arrow_between(
    axes: Axes, here: NDArray[np.float64], there: NDArray[np.float64], colour: str, *, width: float = 1.6, order: float = 3
) -> None:
    """Draw an arrow from the point ``here`` to the point ``there``, each of shape (2,)."""
    style = {"arrowstyle": "-|>", "color": colour, "lw": width, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", xy=tuple(there), xytext=tuple(here), zorder=order, arrowprops=style)


def legend_below(axes: Axes, *, off: float = 0.06) -> None:
    """Place the legend of the chart below the axes."""
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -off), ncols=3, frameon=False, labelcolor=INK, handletextpad=0.3)


def _ends(way: NDArray[np.float64], size: float) -> list[tuple[NDArray[np.float64], list[str]]]:
    """Return the points of a particle's path at which moves end, each with the numbers of these moves.

    The list omits moves that do not displace the particle. Nearly equal end points share one entry. If the path has more than
    `_BENT` moves, the list is empty.
    """
    labelled: list[tuple[NDArray[np.float64], list[str]]] = []
    if len(way) - 1 > _BENT:
        return labelled
    for number in range(1, len(way)):
        if np.linalg.norm(way[number] - way[number - 1]) <= 1e-4 * size:
            continue
        near = next((entry for entry in labelled if np.linalg.norm(entry[0] - way[number]) < 0.03 * size), None)
        if near is None:
            labelled.append((way[number], [str(number)]))
        else:
            near[1].append(str(number))
    return labelled
