"""Figures of tours."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.geometry import segments_of
from shoal.search import Tour
from shoal.views.drawing.charts import (
    INK,
    add_colour_scale,
    add_legend,
    marker,
    new_figure,
    set_heading,
    set_title,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure


_BRIGHTEST = 0.93
"""Upper limit of the colour map viridis, whose last yellow is too pale for a thin line on white."""
_TOUR_LINES = 40_000
"""Maximum number of cells for drawing lines.

Larger tours are drawn as a picture of visiting times, because lines would merge into areas.
"""
_GROUND, _OUTSIDE_TOUR = "#ffffff", "#e3e6ea"


def tour_figure(tour: Tour) -> Figure:
    """Return a figure of a tour, coloured from dark at the first cell to bright at the last cell.

    A ring marks the first cell of the tour, and a square marks the last cell. Grid positions
    without a cell are grey. The closing edge (from the last cell to the first) is dashed, and steps
    across gaps are thin lines. For a tour of more than 40,000 cells, the figure is a picture in
    which the colour of a cell shows its position in the tour. A 3-D tour appears in perspective,
    seen from above.
    """
    metrics = tour.metrics()
    sides = " × ".join(str(side) for side in reversed(tour.shape))
    turns = f"{metrics.turns_per_cell:.2f} turns a cell, length {metrics.length:.7g}"
    title = f"{tour.name}, {sides}: {turns}"
    if len(tour.shape) == 3:
        figure = new_figure(6.4, 5.5)
        _draw_space(figure.add_subplot(projection="3d"), tour)
        set_heading(figure, title, x=0.03, fontweight="bold")
        _draw_legend(figure)
        return figure
    height, width = tour.shape
    inches = float(np.clip(6.4 * height / width, 1.2, 8.6))
    figure = new_figure(6.4 if inches < 8.6 else max(4.2, 8.6 * width / height), inches + 0.55)
    axes = figure.add_subplot()
    if len(tour) > _TOUR_LINES:
        _draw_picture(axes, tour)
    else:
        _draw_lines(axes, tour, 72 * min(6.0 / width, inches / height))
    axes.set_axis_off()
    if len(tour) <= _TOUR_LINES:
        _draw_legend(figure)
    set_title(axes, title if figure.get_figwidth() > 6 else f"{tour.name}, {sides}", in_print="")
    return figure


def _draw_legend(figure: Figure) -> None:
    ends = [
        marker(shape, label, mfc="white", mec=INK, mew=1.3, ms=6)
        for shape, label in (("o", "first cell"), ("s", "last cell"))
    ]
    add_legend(figure, ends, 2)


def _course() -> Colormap:
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    return ListedColormap(colormaps["viridis"](np.linspace(0, _BRIGHTEST, 256))).with_extremes(
        bad=_OUTSIDE_TOUR
    )


def _draw_lines(axes: Axes, tour: Tour, points: float) -> None:
    """Draw the path of a tour as lines; ``points`` is the side of a cell in points (1/72 inch)."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import ListedColormap

    height, width = tour.shape
    ground = ListedColormap([_OUTSIDE_TOUR, _GROUND])
    axes.imshow(tour.position >= 0, cmap=ground, vmin=0, vmax=1, interpolation="nearest", zorder=0)
    axes.plot(
        [-0.5, width - 0.5, width - 0.5, -0.5, -0.5],
        [-0.5, -0.5, height - 0.5, height - 0.5, -0.5],
        color=_OUTSIDE_TOUR,
        lw=1,
        zorder=1,
    )
    path = tour.cells[:, ::-1].astype(float)
    pieces, thin = _pieces(tour, path)
    thick = float(np.clip(0.22 * points, 0.6, 3.2))
    lines = LineCollection(
        list(pieces),
        cmap=_course(),
        array=np.arange(len(pieces)),
        linewidths=np.where(thin, 0.4 * thick, thick),
        capstyle="round",
        zorder=2,
    )
    axes.add_collection(lines)
    size = float(np.clip(0.55 * points, 4, 11))
    if tour.closed and len(tour) > 2:
        axes.plot(
            *path[[-1, 0]].T, "--", color=INK, lw=max(0.9, 0.5 * thick), dashes=(2.2, 1.6), zorder=3
        )
    axes.plot(*path[-1], "s", mfc="white", mec=INK, mew=1.3, ms=0.8 * size, zorder=4)
    axes.plot(*path[0], "o", mfc="white", mec=INK, mew=1.6, ms=size, zorder=4)
    axes.set_xlim(-0.8, width - 0.2)
    axes.set_ylim(height - 0.2, -0.8)


def _pieces(tour: Tour, path: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the steps from the first to the last cell of a tour, shape (N - 1, 2, dimensions), and
    a mask of steps across gaps.
    """
    return segments_of(path), tour.steps[: len(path) - 1] > 1.5


def _draw_picture(axes: Axes, tour: Tour) -> None:
    visited = np.ma.masked_less(tour.position, 0)
    interpolation = "nearest" if max(tour.shape) < 900 else "antialiased"
    image = axes.imshow(visited, cmap=_course(), interpolation=interpolation)
    add_colour_scale(axes, image, "visited as number")


def _draw_space(axes: Any, tour: Tour) -> None:
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    layers, height, width = tour.shape
    path = tour.cells[:, ::-1].astype(float)
    path[:, 1] = height - 1 - path[:, 1]
    pieces, thin = _pieces(tour, path)
    thick = float(np.clip(28 / max(tour.shape), 0.3, 3.0))
    if len(pieces):  # matplotlib refuses an empty list of lines in 3-D
        axes.add_collection3d(
            Line3DCollection(
                list(pieces),
                cmap=_course(),
                array=np.arange(len(pieces)),
                linewidths=np.where(thin, 0.4 * thick, thick),
                capstyle="round",
            )
        )
    if tour.closed and len(tour) > 2:
        axes.plot(*path[[-1, 0]].T, "--", color=INK, lw=1.2)
    axes.plot(*path[-1], "s", mfc="white", mec=INK, mew=1.2, ms=6)
    axes.plot(*path[0], "o", mfc="white", mec=INK, mew=1.5, ms=7)
    axes.set(xlim=(-0.5, width - 0.5), ylim=(-0.5, height - 0.5), zlim=(-0.5, layers - 0.5))
    axes.set_box_aspect((width, height, layers), zoom=1.15)
    axes.view_init(elev=24, azim=-62)
    axes.set_axis_off()
