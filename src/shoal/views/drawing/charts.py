"""The common style of all charts: frame, title and colours."""

from __future__ import annotations

import os
import warnings
from typing import TYPE_CHECKING

from shoal.core.files import atomic, check_suffix

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, MUTED, GRID = "#22262c", "#6b7280", "#e5e7eb"
# These colours (Okabe and Ito) differ for all common kinds of colour blindness and are dark enough for thin lines.
BLUE, ORANGE, GREEN, PURPLE, SKY = "#0072b2", "#d55e00", "#009e73", "#aa4499", "#62c4f7"


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of ``width`` × ``height`` inches, which notebooks can display."""
    from shoal.views.drawing.notebook_figure import NotebookFigure  # needs matplotlib, which is slow to import

    return NotebookFigure(figsize=(width, height), dpi=150, layout="constrained", facecolor="white")


def padded_figure(width: float, height: float) -> Figure:
    """Return an empty figure whose titles keep a distance from the border of the figure."""
    figure = new_figure(width, height)
    engine = figure.get_layout_engine()
    assert engine is not None
    engine.set(h_pad=0.08, w_pad=0.06)  # type: ignore[call-arg]  # of the constrained layout
    return figure


def set_title(axes: Axes, text: str) -> None:
    """Set the title of the axes as literal text, so that a "$" in a file name does not start a formula."""
    axes.set_title(text, fontsize=11, color=INK, loc="left", fontweight="bold", parse_math=False)


def plain_axes(axes: Axes) -> None:
    """Reduce the frame of the axes to the left and the lower side, and draw a pale grid behind the data."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=MUTED, labelcolor=INK)
    axes.grid(color=GRID, lw=0.6)
    axes.set_axisbelow(True)


def bare_axes(axes: Axes) -> None:
    """Remove the frame of the axes but keep small tick labels, and give both axes the same scale."""
    axes.set_aspect("equal")
    axes.margins(0.04)
    axes.tick_params(colors=MUTED, labelcolor=MUTED, labelsize=8)
    for spine in axes.spines.values():
        spine.set_visible(False)


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a figure as PNG, SVG or PDF. A failed write leaves no partial file.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    path : path
        The output file, whose suffix determines the format.

    Raises
    ------
    InvalidInputError
        If the suffix of the output file is not supported.
    OutputError
        If writing the output file fails.
    """
    target = check_suffix(path, ".png", ".svg", ".pdf")
    with atomic(target) as temporary, warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # characters that the font lacks are drawn as boxes
        figure.savefig(temporary)
