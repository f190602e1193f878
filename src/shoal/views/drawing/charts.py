"""How charts look: the frame, the title and the colours that all of them share."""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from shoal.core.errors import InvalidInputError
from shoal.core.files import atomic

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, MUTED, GRID = "#22262c", "#6b7280", "#e5e7eb"
# Told apart with every common colour blindness (Okabe and Ito), dark enough for thin lines.
BLUE, ORANGE, GREEN, PURPLE, SKY = "#0072b2", "#d55e00", "#009e73", "#aa4499", "#62c4f7"


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of that size in inches; notebooks show it."""
    from shoal.views.drawing.notebook_figure import NotebookFigure  # needs matplotlib, which takes long to import

    return NotebookFigure(figsize=(width, height), dpi=150, layout="constrained", facecolor="white")


def padded_figure(width: float, height: float) -> Figure:
    """Return a figure whose titles keep off the border."""
    figure = new_figure(width, height)
    engine = figure.get_layout_engine()
    assert engine is not None
    engine.set(h_pad=0.08, w_pad=0.06)  # type: ignore[call-arg]  # of the constrained layout
    return figure


def set_title(axes: Axes, text: str) -> None:
    """Write a title as it is: the name of a file may hold a "$", which is no formula."""
    axes.set_title(text, fontsize=11, color=INK, loc="left", fontweight="bold", parse_math=False)


def plain_axes(axes: Axes) -> None:
    """Leave of the frame what is needed: two sides, a pale grid behind the data."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=MUTED, labelcolor=INK)
    axes.grid(color=GRID, lw=0.6)
    axes.set_axisbelow(True)


def bare_axes(axes: Axes) -> None:
    """Leave of the frame only small numbers; one unit is as long to the right as it is up."""
    axes.set_aspect("equal")
    axes.margins(0.04)
    axes.tick_params(colors=MUTED, labelcolor=MUTED, labelsize=8)
    for spine in axes.spines.values():
        spine.set_visible(False)


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a figure as PNG, SVG or PDF, whole or not at all.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    path : path
        The suffix says the format.

    Raises
    ------
    InvalidInputError
        For another suffix.
    OutputError
        If it cannot be written.
    """
    target = Path(path)
    if target.suffix not in {".png", ".svg", ".pdf"}:
        raise InvalidInputError(f"{target}: expected the suffix .png, .svg or .pdf, got {target.suffix!r}")
    with atomic(target) as temporary, warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # a name in letters that the font has not is drawn as boxes
        figure.savefig(temporary)
