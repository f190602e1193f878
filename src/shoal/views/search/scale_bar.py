"""The scale bar of a map, and the arrow to the north."""

from __future__ import annotations

from math import floor, log10
from typing import TYPE_CHECKING

from shoal.views.drawing.charts import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def bar_length(most: float) -> float:
    """Return the longest of 1, 2 and 5 times a power of ten that is not longer than ``most``.

    Examples
    --------
    >>> bar_length(430.0), bar_length(0.15), bar_length(1000.0)
    (200.0, 0.1, 1000.0)
    """
    unit = 10.0 ** floor(log10(most) + 1e-9)
    return max(unit * step for step in (1, 2, 5) if unit * step <= most * (1 + 1e-9))


def draw_scale_bar(figure: Figure, axes: Axes, *, north: bool) -> None:
    """Draw a scale bar under the right end of a map in metres, and an arrow to the north where up is north."""
    from matplotlib.transforms import blended_transform_factory

    left, right = axes.get_xlim()
    length = bar_length(0.2 * (right - left))
    below = blended_transform_factory(axes.transData, figure.transFigure)
    low = axes.get_position().y0 - 0.36 / figure.get_figheight()
    axes.plot([right - length, right], [low, low], color=INK, lw=2.2, solid_capstyle="butt", transform=below, clip_on=False)
    words = ("\N{UPWARDS ARROW} N    " if north else "") + (f"{length / 1000:g} km" if length >= 1000 else f"{length:g} m")
    axes.annotate(
        words, (right - length, low), xycoords=below, xytext=(-5, 0), textcoords="offset points", ha="right", va="center",
        fontsize=8, color=INK, annotation_clip=False,
    )  # fmt: skip
