"""The common style of all charts: frame, title and colours."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from math import cos, floor, log10, radians, sin
from typing import TYPE_CHECKING, Any

from shoal.core.files import atomic, check_suffix

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


FIGURES = (".png", ".svg", ".pdf")
"""Suffixes of the files of figures."""

INK, MUTED, GRID = "#22262c", "#6b7280", "#e5e7eb"
# These colours (Okabe and Ito) differ for all common kinds of colour blindness and are dark enough
# for thin lines.
BLUE, ORANGE, GREEN, PURPLE, SKY = "#0072b2", "#d55e00", "#009e73", "#aa4499", "#62c4f7"


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of ``width`` × ``height`` inches, which notebooks can display."""
    from shoal.views.drawing.encoding import (
        NotebookFigure,  # needs matplotlib, which is slow to import
    )

    return NotebookFigure(figsize=(width, height), dpi=150, layout="constrained", facecolor="white")


def padded_figure(width: float, height: float) -> Figure:
    """Return an empty figure whose titles keep a distance from the border of the figure."""
    figure = new_figure(width, height)
    engine = figure.get_layout_engine()
    assert engine is not None
    engine.set(h_pad=0.08, w_pad=0.06)  # type: ignore[call-arg]  # of the constrained layout
    return figure


def set_title(axes: Axes, text: str) -> None:
    """Set the title of the axes as literal text, so that a "$" in a file name does not start a
    formula.
    """
    axes.set_title(text, fontsize=11, color=INK, loc="left", fontweight="bold", parse_math=False)


def plain_axes(axes: Axes) -> None:
    """Reduce the frame of the axes to the left and the lower side, and draw a pale grid behind the
    data.
    """
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=MUTED, labelcolor=INK)
    axes.grid(color=GRID, lw=0.6)
    axes.set_axisbelow(True)


def bare_axes(axes: Axes) -> None:
    """Remove the frame of the axes but keep small tick labels, and give both axes the
    same scale.
    """
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
    target = check_suffix(path, *FIGURES)
    with atomic(target) as temporary, warnings.catch_warnings():
        # characters that the font lacks are drawn as boxes
        warnings.filterwarnings("ignore", "Glyph")
        figure.savefig(temporary)


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
    figure: Figure,
    axes: Axes,
    *,
    unit: str = "m",
    size: float = 1.0,
    north: float | None = None,
    above: float | None = None,
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
        Direction of north in the drawing, in degrees clockwise from up. If ``north`` is None, the
        function draws no north arrow.
    above : float, optional
        If given, the bar lies above the map, and ``above`` is the x coordinate of the bar's right
        end. By default, the bar lies below the map, at the map's right end.
    """
    from matplotlib.text import OffsetFrom
    from matplotlib.transforms import blended_transform_factory

    left, right = axes.get_xlim()
    length = bar_length(0.2 * (right - left) * size)
    right = right if above is None else above
    place = blended_transform_factory(
        axes.transData, axes.transAxes if above is not None else figure.transFigure
    )
    low = 1.025 if above is not None else axes.get_position().y0 - 0.36 / figure.get_figheight()
    axes.plot(
        [right - length / size, right],
        [low, low],
        color=INK,
        lw=2.2,
        solid_capstyle="butt",
        transform=place,
        clip_on=False,
    )
    label = f"{length / 1000:g} km" if unit == "m" and length >= 1000 else f"{length:g} {unit}"
    style: dict[str, Any] = {
        "ha": "right",
        "va": "center",
        "fontsize": 8,
        "color": INK,
        "annotation_clip": False,
    }
    words = label if north is None else f"N    {label}"
    end = axes.annotate(
        words,
        (right - length / size, low),
        xycoords=place,
        xytext=(-5, 0),
        textcoords="offset points",
        **style,
    )
    if north is not None:
        lean = _ARROW * sin(radians(north)), _ARROW * cos(radians(north))
        middle = OffsetFrom(end, (0.0, 0.5), unit="points")
        axes.annotate(
            "",
            (lean[0] - 9, lean[1]),
            xycoords=middle,
            xytext=(-lean[0] - 9, -lean[1]),
            textcoords=middle,
            annotation_clip=False,
            arrowprops={
                "arrowstyle": "-|>",
                "color": INK,
                "lw": 1.1,
                "shrinkA": 0,
                "shrinkB": 0,
                "mutation_scale": 7,
            },
        )


def draw_heading(figure: Figure, axes: Axes, words: str) -> None:
    """Write the heading ``words`` above a whole figure, beginning at the left edge of the axes."""
    from matplotlib.transforms import blended_transform_factory

    edge = blended_transform_factory(axes.transAxes, figure.transFigure)
    figure.suptitle(
        words,
        fontsize=11,
        color=INK,
        x=0.0,
        ha="left",
        fontweight="bold",
        parse_math=False,
        transform=edge,
    )


def marker(shape: str, label: str, **look: Any) -> Any:
    """Return a marker for a legend; ``look`` holds arguments of a `matplotlib.lines.Line2D`."""
    from matplotlib.lines import Line2D

    return Line2D([], [], ls="", marker=shape, label=label, **look)


def dashes(label: str, **look: Any) -> Any:
    """Return a dashed line for a legend."""
    from matplotlib.lines import Line2D

    usual: dict[str, Any] = {"color": MUTED, "lw": 1.0, "ls": (0, (3, 2))}
    return Line2D([], [], label=label, **usual | look)


def add_legend(figure: Figure, handles: Sequence[Any], ncols: int, *, spacing: float = 1.4) -> None:
    """Write a legend below a figure."""
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=ncols,
        frameon=False,
        fontsize=8,
        labelcolor=INK,
        handletextpad=0.5,
        columnspacing=spacing,
    )
