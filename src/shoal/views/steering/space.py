"""The figure of a 3-D plan: a prism or a cylinder in perspective, with the shadows of the paths on the floor."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.steering import ConvexWorkspace, SteeringEpisode
from shoal.views.drawing.charts import INK, bare_axes
from shoal.views.steering.axes import colour_of, draw_trajectories, legend_below
from shoal.views.steering.camera import Frame3D, camera_for, flattened

if TYPE_CHECKING:
    from matplotlib.axes import Axes

AZIMUTH = -pi / 3  # direction of the camera: x to the right and away, y to the left and away
_SHADOW, _FLOOR, _FAINT = "#8a919c", "#f4f6f8", "#b9c0c9"


def draw_space(axes: Axes, episode: SteeringEpisode) -> None:
    """Draw a 3-D plan: paths with starts and goals, their shadows on the floor, and a vertical line below each start and goal."""
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
        way, goal = states[:, particle], episode.goal[particle]
        axes.plot(*at(flattened(way)).T, color=_SHADOW, lw=1.2, alpha=0.6, zorder=1)
        for end in (way[0], goal):
            axes.plot(*at([flattened(end), end]).T, color=colour_of(particle), lw=1, ls=(0, (2, 2)), alpha=0.7, zorder=1.5)
            axes.plot(*at(flattened(end)), ".", color=_SHADOW, ms=6, zorder=1.5)
    draw_trajectories(axes, episode, at)
    for edge in front:
        axes.plot(*at(edge).T, color=INK, lw=1.3, alpha=0.8, zorder=3.5)
    bare_axes(axes)
    axes.set_xticks([])
    axes.set_yticks([])
    legend_below(axes, off=0.01)
