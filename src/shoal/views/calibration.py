"""The picture of a calibration: the grid over the picture of the camera, and the pulses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shoal.views.drawing.charts import (
    BLUE,
    GRID,
    INK,
    ORANGE,
    new_figure,
    plain_axes,
    set_title,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from shoal.rigs.calibration import BenchCalibration

Points = NDArray[np.float64]
MOST_LINES = 60  # lines of the grid, of which more would hide the picture


def calibration_figure(
    calibration: BenchCalibration,
    *,
    points: Points,
    picture: NDArray[Any] | None = None,
) -> Figure:
    """Draw the grid over the picture of the camera, and the motion that each stated pulse causes.

    Parameters
    ----------
    calibration : BenchCalibration
    points : ndarray of float64, shape (n, 2)
        Particles in pixels (x, y).
    picture : ndarray, optional
        Picture of the camera. Without it, the particles alone are drawn.
    """
    figure = new_figure(9.0, 4.6)
    left, right = figure.subplots(1, 2, width_ratios=[1.5, 1])
    if picture is not None:
        shown = picture[..., ::-1] if picture.ndim == 3 else picture
        left.imshow(shown, cmap="gray")
    rows, columns = calibration.shape
    step = max(1, -(-max(rows, columns) // MOST_LINES))
    style: dict[str, Any] = {"color": BLUE, "lw": 0.5, "alpha": 0.7}
    for row in np.arange(0, rows + 1, step) - 0.5:
        edge = np.linspace(-0.5, columns - 0.5, 9)
        left.plot(*calibration.to_pixels(np.column_stack([np.full(9, row), edge])).T, **style)
    for column in np.arange(0, columns + 1, step) - 0.5:
        edge = np.linspace(-0.5, rows - 0.5, 9)
        left.plot(*calibration.to_pixels(np.column_stack([edge, np.full(9, column)])).T, **style)
    left.plot(*points.T, "o", ms=4, mfc="none", color=ORANGE)
    corner = calibration.to_pixels([[0.0, 0.0]])[0]
    label: dict[str, Any] = {"fontsize": 8, "ha": "center", "va": "center"}
    box = {"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.8}
    left.annotate("0, 0", corner, color=INK, bbox=box, **label)
    left.set_aspect("equal")
    if picture is None:
        left.invert_yaxis()
    plain_axes(left)
    left.grid(visible=False)
    left.set_xlabel("pixels", color=INK)
    set_title(left, f"{rows} × {columns} cells, {calibration.pixels_per_cell:.1f} pixels each")
    most = 1.0
    for letter in "lurd":
        wanted = calibration.responses.displacement(*calibration.pulse(letter))
        right.plot([0, wanted[0]], [0, wanted[1]], color=GRID, lw=7, solid_capstyle="round")
        gain = calibration.gain(letter)
        if gain is None:
            continue
        motion = np.array(getattr(calibration.responses, letter))
        motion = motion / np.linalg.norm(motion) * gain
        most = max(most, gain)
        right.annotate("", motion, (0, 0), arrowprops={"arrowstyle": "-|>", "color": ORANGE})
        heading = calibration.responses.heading(letter)
        along = motion / np.linalg.norm(motion)
        # the text stands beyond arrow and bar; to the sides it is wider than high
        away = along * (max(gain, float(np.linalg.norm(wanted))) + 0.25 + 0.1 * abs(along[0]))
        text = f"{letter}: {gain:.2f}\n{heading:+.1f}°"
        right.annotate(text, away, color=INK, **label)
    right.set(xlim=(-most - 0.7, most + 0.7), ylim=(-most - 0.7, most + 0.7), aspect="equal")
    plain_axes(right)
    right.set_xlabel("cells", color=INK)
    set_title(right, "Pulses: before (arrow), after (bar)")
    return figure
