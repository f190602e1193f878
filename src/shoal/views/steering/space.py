"""The figure of a plan in space: prism or cylinder as a camera sees it, with shadows on the floor."""

from __future__ import annotations

from itertools import pairwise
from math import pi
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.steering import ConvexWorkspace, SteeringEpisode
from shoal.views.drawing.charts import INK, bare_axes
from shoal.views.steering.axes import colour_of, number_ends
from shoal.views.steering.camera import Frame3D, camera_for, flattened

if TYPE_CHECKING:
    from matplotlib.axes import Axes

AZIMUTH = -pi / 3  # of the eye: x to the right and away, y to the left and away
_SHADOW, _FLOOR, _FAINT = "#8a919c", "#f4f6f8", "#b9c0c9"


def draw_space(axes: Axes, episode: SteeringEpisode) -> None:
    """Draw a plan in space: ways and ends as in the plane, below them shadows, and a line down from each start and goal."""
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
        colour, way, goal = colour_of(particle), states[:, particle], episode.goal[particle]
        axes.plot(*at(flattened(way)).T, color=_SHADOW, lw=1.2, alpha=0.6, zorder=1)
        for end in (way[0], goal):
            axes.plot(*at([flattened(end), end]).T, color=colour, lw=1, ls=(0, (2, 2)), alpha=0.7, zorder=1.5)
            axes.plot(*at(flattened(end)), ".", color=_SHADOW, ms=6, zorder=1.5)
        for here, there in pairwise(way):
            if np.linalg.norm(there - here) > 1e-4 * workspace.size:
                arrow = {"arrowstyle": "-|>", "color": colour, "lw": 1.5, "shrinkA": 0, "shrinkB": 0}
                axes.annotate("", xy=tuple(at(there)), xytext=tuple(at(here)), zorder=3, arrowprops=arrow)
        axes.plot(*at(way[0]), "s", color=colour, ms=8, zorder=4, label=f"particle {particle + 1}")
        axes.plot(*at(goal), "o", mfc="white", mec=colour, mew=2, ms=9, zorder=4)
        number_ends(axes, at(way), colour, workspace.size)
    for edge in front:
        axes.plot(*at(edge).T, color=INK, lw=1.3, alpha=0.8, zorder=3.5)
    bare_axes(axes)
    axes.set_xticks([])
    axes.set_yticks([])
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.01), ncols=3, frameon=False, labelcolor=INK, handletextpad=0.3)
