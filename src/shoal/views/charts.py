"""How charts look: the frame, the title and the colours that all of them share."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, MUTED, GRID = "#22262c", "#6b7280", "#e5e7eb"
# Told apart with every common colour blindness (Okabe and Ito), dark enough for thin lines.
BLUE, ORANGE, GREEN, PURPLE, SKY = "#0072b2", "#d55e00", "#009e73", "#aa4499", "#62c4f7"


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of that size in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=150, layout="constrained", facecolor="white")


def set_title(axes: Axes, text: str) -> None:
    """Write a title as it is: the name of a file may hold a "$", which is no formula."""
    axes.set_title(text, fontsize=11, color=INK, loc="left", fontweight="bold", parse_math=False)


def plain_axes(axes: Axes) -> None:
    """Leave of the frame what is needed: two sides, a pale grid behind the data."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=MUTED, labelcolor=INK)
    axes.grid(color=GRID, lw=0.6)
    axes.set_axisbelow(True)
