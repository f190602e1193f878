"""The scale bar and the north arrow of a map."""

from __future__ import annotations

from math import cos, floor, log10, radians, sin
from typing import TYPE_CHECKING, Any

from shoal.views.drawing.charts import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_ARROW = 6.0  # points: half the length of the north arrow


def bar_length(most: float) -> float:
    """Return the largest number up to ``most`` that is 1, 2 or 5 times a power of 10.

    Examples
    --------
    >>> bar_length(430.0), bar_length(0.15), bar_length(1000.0)
    (200.0, 0.1, 1000.0)
    """
    unit = 10.0 ** floor(log10(most) + 1e-9)
    return max(unit * step for step in (1, 2, 5) if unit * step <= most * (1 + 1e-9))


def draw_scale_bar(
    figure: Figure, axes: Axes, *, unit: str = "m", size: float = 1.0, north: float | None = None, above: float | None = None
) -> None:
    """Draw a scale bar near the right end of a map, and optionally a north arrow.

    Parameters
    ----------
    figure, axes : Figure, Axes
    unit : str
        Unit of length for the label of the bar, such as "m" or "mm".
    size : float
        Length that one unit of the x axis represents, in the unit ``unit``.
    north : float, optional
        Direction of north in the drawing, in degrees clockwise from up. If ``north`` is None, the function draws no north arrow.
    above : float, optional
        If given, the bar lies above the map, and ``above`` is the x coordinate of the bar's right end. By default, the bar lies
        below the map, at the map's right end.
    """
    from matplotlib.text import OffsetFrom
    from matplotlib.transforms import blended_transform_factory

    left, right = axes.get_xlim()
    length = bar_length(0.2 * (right - left) * size)
    right = right if above is None else above
    place = blended_transform_factory(axes.transData, axes.transAxes if above is not None else figure.transFigure)
    low = 1.025 if above is not None else axes.get_position().y0 - 0.36 / figure.get_figheight()
    axes.plot([right - length / size, right], [low, low], color=INK, lw=2.2, solid_capstyle="butt", transform=place, clip_on=False)
    told = f"{length / 1000:g} km" if unit == "m" and length >= 1000 else f"{length:g} {unit}"
    style: dict[str, Any] = {"ha": "right", "va": "center", "fontsize": 8, "color": INK, "annotation_clip": False}
    words = told if north is None else f"N    {told}"
    end = axes.annotate(words, (right - length / size, low), xycoords=place, xytext=(-5, 0), textcoords="offset points", **style)
    if north is not None:
        lean = _ARROW * sin(radians(north)), _ARROW * cos(radians(north))
        middle = OffsetFrom(end, (0.0, 0.5), unit="points")
        axes.annotate(
            "", (lean[0] - 9, lean[1]), xycoords=middle, xytext=(-lean[0] - 9, -lean[1]), textcoords=middle, annotation_clip=False,
            arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.1, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 7},
        )  # fmt: skip
