"""The number of each move in a chart, written beside the end point of the move, if possible clear of paths, walls and marks."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIZE = 8.0  # points, the size of the text
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

    def __init__(self, axes: Axes, lines: list[NDArray[np.float64]], marks: NDArray[np.float64]) -> None:
        self._axes = axes
        self._scale = _points_per_unit(axes)
        rings = (marks[:, None] * self._scale + _MARK * _WAYS).reshape(-1, 2)
        self._taken = np.concatenate([*(_dense(line * self._scale) for line in lines), rings])

    def write(self, place: NDArray[np.float64], numbers: list[str], colour: str) -> None:
        """Write the numbers of the moves that end at ``place`` beside this point, at the offset where the text covers the least."""
        text = ", ".join(numbers[:_MOST]) + ("…" if len(numbers) > _MOST else "")
        half = SIZE * np.array([0.3 * len(text), 0.4])
        offsets = [apart * way + half * way / np.abs(way).max() for apart in _APART for way in _WAYS]
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
            fontsize=SIZE,
            zorder=5,
        )

    def _space(self, middle: NDArray[np.float64], half: NDArray[np.float64]) -> float:
        """Return the distance between a box and the nearest drawn object, in points; negative if the box covers an object."""
        apart = np.abs(self._taken - middle) - half
        inside = apart.max(axis=1)
        outside = np.hypot(*np.maximum(apart, 0.0).T)
        return float(np.where(inside < 0, inside, outside).min())


_WAYS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)
_CORNERS = np.array([(x, y) for x in (-1.0, 0.0, 1.0) for y in (-1.0, 0.0, 1.0)])


def _points_per_unit(axes: Axes) -> float:
    """Return the length of one unit of the axes in points (1/72 inch), for axes with the same scale in both directions."""
    box, dpi = axes.get_window_extent(), axes.figure.dpi
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    return float(min(box.width / (right - left), box.height / (high - low)) * 72.0 / dpi)


def _dense(line: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points on a line, at most two units from each point to the next point; float64, shape (n, 2)."""
    parts = [line[-1:]]
    for here, there in pairwise(line):
        count = int(np.ceil(np.hypot(*(there - here)) / 2.0)) + 1
        parts.append(here + np.linspace(0.0, 1.0, count)[:, None] * (there - here))
    return np.concatenate(parts)
