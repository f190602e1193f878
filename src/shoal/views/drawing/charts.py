"""The common style of all charts: frame, title and colours."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from math import cos, floor, inf, log10, radians, sin
from typing import TYPE_CHECKING, Any

from shoal.core.checks import check_kind, check_number
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.files import atomic, check_suffix

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage


FIGURES = (".png", ".svg", ".pdf")
"""Suffixes of the files of figures."""

INK, MUTED, GRID = "#22262c", "#6b7280", "#e5e7eb"
# These colours (Okabe and Ito) differ for all common kinds of colour blindness and are dark enough
# for thin lines.
BLUE, ORANGE, GREEN, PURPLE, SKY = "#0072b2", "#d55e00", "#009e73", "#aa4499", "#62c4f7"


PRINT_DPI = 300.0  # pixels an inch, what journals ask of pictures
_TEXT = 8.0  # points: the size of most text in a figure
_MM = 25.4  # millimetres an inch
_WORDS = 0.9, 0.6  # inches of a figure's height for text: with a heading, and in print without it
_CUT = 0.02  # inches beyond the figure that are only the soft edge of a sign
_PAGE = 9.3  # inches: height of a page of a journal, for a figure of usual width
_ROUNDS = 4  # of layouts until a height fits
_FLAT = 0.7  # height of a panel of which more than two lie one below another
_NARROW = 127.0  # millimetres: in print, narrower figures have their panels one below another


@dataclass(frozen=True)
class _Print:
    """What a journal asks of a figure: its width in millimetres, and the size of its text in
    points.
    """

    width: float
    font_size: float


_print: ContextVar[_Print | None] = ContextVar("print", default=None)


@contextmanager
def printed(width: float | None, font_size: float | None) -> Iterator[None]:
    """Draw the figures of a ``with`` block for print.

    Such figures have no headings, which are parts of captions.

    Parameters
    ----------
    width : float or None
        Width of the figures in millimetres. With None, figures have the size for a screen.
    font_size : float or None
        Size of the text in points, or None for 8. Only figures for print have another size.

    Raises
    ------
    InvalidInputError
        If a number is out of its range, or ``font_size`` is given without ``width``.
    """
    if width is None:
        if font_size is not None:
            raise InvalidInputError("font size: expected a width beside it, got none")
        yield
        return
    settings = _Print(
        check_number(width, what="width", least=30.0, most=1000.0),
        _TEXT
        if font_size is None
        else check_number(font_size, what="font size", least=4.0, most=20.0),
    )
    from matplotlib import rc_context

    token = _print.set(settings)
    try:
        with rc_context({"font.size": settings.font_size}):
            yield
    finally:
        _print.reset(token)


@contextmanager
def check_layout(kind: str) -> Iterator[list[Figure]]:
    """Draw a figure of a ``with`` block, and refuse it if it is for print and what it shows has no
    room in it.

    Raises
    ------
    InvalidInputError
        If text would be cut off or cover other text, or leaves no room for the axes.
    """
    figures: list[Figure] = []
    settings = _print.get()
    if settings is None:
        yield figures
        return
    with warnings.catch_warnings():
        # a layout that cannot be made is no warning but an error
        warnings.filterwarnings("error", "constrained_layout not applied")
        warnings.filterwarnings("ignore", "Glyph")
        try:
            yield figures
            for figure in figures:
                fit_height(figure)
                figure.draw_without_rendering()
            fits = all(_fits(figure) for figure in figures)
        except UserWarning:
            fits = False
    if not fits:
        raise InvalidInputError(
            f"figure {kind}: expected a width with room for the text, got"
            f" {settings.width:g} mm for text of {settings.font_size:g} pt"
        )


def _fits(figure: Figure) -> bool:
    """Return whether all texts of a drawn figure lie inside it, and those beside its axes cover no
    other text.
    """
    from matplotlib.text import Text
    from matplotlib.transforms import Bbox

    unseen = {  # of ticks beyond the ends of an axis, and of axes without any
        label
        for axes in figure.axes
        for axis in (axes.xaxis, axes.yaxis)
        for tick in axis.get_major_ticks()
        for label in (tick.label1, tick.label2)
        if not axes.axison
        or not min(axis.get_view_interval()) <= tick.get_loc() <= max(axis.get_view_interval())
    }
    panels = [axes.get_window_extent() for axes in figure.axes]
    boxes = [
        text.get_window_extent()
        for text in figure.findobj(Text)
        if text.get_visible() and text.get_text().strip() and text not in unseen
    ]
    least, frame = _CUT * figure.dpi, figure.bbox
    if any(
        min(box.x0, box.y0) < -least or box.x1 > frame.x1 + least or box.y1 > frame.y1 + least
        for box in boxes
    ):
        return False
    beside = [box for box in boxes if not any(panel.overlaps(box) for panel in panels)]
    shared = (Bbox.intersection(box, other) for k, box in enumerate(beside) for other in beside[:k])
    return not any(box is not None and min(box.width, box.height) > least for box in shared)


def text_size(size: float = _TEXT) -> float:
    """Return the size of a text, in points, that has the given size in figures for a screen."""
    settings = _print.get()
    return size if settings is None else size * settings.font_size / _TEXT


def figure_width(width: float) -> float:
    """Return the width in inches of a figure that is ``width`` inches wide on a screen."""
    settings = _print.get()
    return width if settings is None else settings.width / _MM


def new_figure(width: float, height: float, *, rows: bool = False) -> Figure:
    """Return an empty figure of ``width`` × ``height`` inches, which notebooks can display.

    A figure for print has the width that was asked for, and a height in proportion; if ``rows``, as
    for a table, its height is in proportion to the size of its text.
    """
    from shoal.views.drawing.encoding import (
        NotebookFigure,  # needs matplotlib, which is slow to import
    )

    settings = _print.get()
    if settings is not None:
        print_width = settings.width / _MM
        text, left = _WORDS
        scale = settings.font_size / _TEXT
        height = height * scale if rows else (height - text) * print_width / width + left * scale
        width = print_width
    return NotebookFigure(figsize=(width, height), dpi=150, layout="constrained", facecolor="white")


def new_panels(
    width: float,
    height: float,
    count: int,
    *,
    rows: int = 1,
    ratios: Sequence[float] | None = None,
) -> tuple[Figure, list[Axes]]:
    """Return a figure and the axes of ``count`` panels in ``rows`` rows, with widths in the
    proportion ``ratios``. In a narrow figure for print, the panels lie one below another.
    """
    settings = _print.get()
    columns = count // rows
    if settings is None or settings.width >= _NARROW or count == 1:
        figure = new_figure(width, height)
        return figure, list(
            figure.subplots(rows, columns, squeeze=False, width_ratios=ratios).ravel()
        )
    flat = 1.0 if count == 2 else _FLAT
    figure = new_figure(width / columns, flat * columns * height)
    return figure, list(figure.subplots(count, 1, squeeze=False)[:, 0])


def padded_figure(width: float, height: float) -> Figure:
    """Return an empty figure whose titles keep a distance from the border of the figure."""
    figure = new_figure(width, height)
    engine = figure.get_layout_engine()
    assert engine is not None
    engine.set(h_pad=0.08, w_pad=0.06)  # type: ignore[call-arg]  # of the constrained layout
    return figure


def set_title(axes: Axes, text: str, *, in_print: str | None = None) -> None:
    """Set the title of the axes as literal text, so that a "$" in a file name does not start a
    formula.

    The title ``in_print`` of a figure for print is another one if the text is a heading, which says
    what the whole figure shows.
    """
    size = _TEXT + 3.0
    if _print.get() is not None:
        text, size = text if in_print is None else in_print, text_size()
    axes.set_title(text, fontsize=size, color=INK, loc="left", fontweight="bold", parse_math=False)


def set_facts(axes: Axes, text: str, *, pad: float | None = None) -> None:
    """Write a line of facts between a figure's heading and its axes. A figure for print has none,
    because captions state facts.
    """
    if _print.get() is None:
        axes.set_title(text, fontsize=9, color=MUTED, loc="left", parse_math=False, pad=pad)


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
    axes.tick_params(colors=MUTED, labelcolor=MUTED, labelsize=text_size())
    for spine in axes.spines.values():
        spine.set_visible(False)


def fit_height(figure: Figure) -> None:
    """Give a figure for print the height that it needs in its width.

    Axes whose scales are tied, as those of maps, take all of the width, and no empty stripe is left
    above or below them. The figure must have a layout that is not settled yet.
    """
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    engine = figure.get_layout_engine()
    if _print.get() is None or not isinstance(engine, ConstrainedLayoutEngine):
        return
    maps = [axes for axes in figure.axes if axes.get_aspect() != "auto"]
    least = -inf if len(maps) == len(figure.axes) else 0.0  # charts take what maps would
    most = max(_PAGE, 1.4 * figure.get_figwidth())
    for _ in range(_ROUNDS):
        figure.draw_without_rendering()
        spare: dict[int, float] = {}  # in each row, beside its tallest axes
        for axes in maps:
            available, occupied = (
                axes.get_position(original=original).transformed(axes.figure.transSubfigure)
                for original in (True, False)
            )
            beside = available.height - occupied.height
            if beside < 1.0:  # too low: what its width would need
                beside = max(least, (1.0 - available.width / occupied.width) * occupied.height)
            spare[round(available.y0)] = min(spare.get(round(available.y0), inf), beside)
        needed = figure.get_figheight() - sum(spare.values()) / figure.dpi
        figure.set_figheight(min(needed, most))


def settle_layout(figure: Figure, *, rounds: int = 1) -> None:
    """Fix the positions of a figure's axes, so that what is drawn next can depend on them.

    A further round is needed if what has a place beside the axes moves with them.
    """
    fit_height(figure)
    engine = figure.get_layout_engine()
    assert engine is not None
    for _ in range(rounds):
        engine.execute(figure)
        for axes in figure.axes:
            axes.apply_aspect()
    figure.set_layout_engine("none")


def save_figure(figure: Figure, path: str | os.PathLike[str], *, dpi: float | None = None) -> None:
    """Write a figure as PNG, SVG or PDF. A failed write leaves no partial file.

    The text in an SVG or PDF file is text, which other programs can edit and search. Equal figures
    give equal files.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    path : path
        The output file, whose suffix determines the format.
    dpi : float, optional
        Pixels an inch of a PNG file, and of the pictures in an SVG or PDF file; by default, 150.

    Raises
    ------
    InvalidInputError
        If the suffix of the output file is not supported.
    OutputError
        If writing the output file fails.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    check_kind(figure, Figure, what="figure")
    target = check_suffix(path, *FIGURES)
    resolution = (
        figure.dpi if dpi is None else check_number(dpi, what="dpi", least=20.0, most=2400.0)
    )
    undated = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(target.suffix.lower())
    with (
        atomic(target) as temporary,
        warnings.catch_warnings(),
        rc_context({"svg.fonttype": "none", "svg.hashsalt": "shoal", "pdf.fonttype": 42}),
    ):
        # characters that the font lacks are drawn as boxes
        warnings.filterwarnings("ignore", "Glyph")
        figure.savefig(temporary, dpi=resolution, metadata=undated)


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


def add_colour_scale(axes: Axes, image: AxesImage, words: str, *, extend: str = "neither") -> None:
    """Add a scale of the colours of an image beside its axes. ``extend="max"`` says by an arrow
    that larger values have the last colour.
    """
    bar = axes.figure.colorbar(image, ax=axes, shrink=0.7, pad=0.02, extend=extend)
    bar.outline.set_visible(False)
    bar.ax.tick_params(colors=MUTED, labelsize=text_size())
    bar.set_label(words, color=MUTED, fontsize=text_size(9))


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
        "fontsize": text_size(),
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


def set_heading(figure: Figure, text: str, **look: Any) -> None:
    """Write a heading above a whole figure, from its left edge. A figure for print has none."""
    if _print.get() is None:
        figure.suptitle(text, **{"fontsize": 11, "color": INK, "x": 0.01, "ha": "left"} | look)


def draw_heading(figure: Figure, axes: Axes, words: str) -> None:
    """Write the heading ``words`` above a whole figure, beginning at the left edge of the axes. A
    figure for print has no heading.
    """
    if _print.get() is not None:
        return
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


def fit_columns(
    labels: Sequence[str],
    most: int,
    *,
    width: float,
    size: float | None = None,
    spacing: float = 2.0,
) -> int:
    """Return the largest number of columns, up to ``most``, with which a legend is at most
    ``width`` inches wide.

    Parameters
    ----------
    labels : sequence of str
    most : int
    width : float
    size : float, optional
        Size of the text in points; by default, that of `text_size`.
    spacing : float
        Distance of the columns, as a multiple of the size of the text.
    """
    import numpy as np
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    size = text_size() if size is None else size
    handle, font = (
        2.8 * size,
        FontProperties(size=size),
    )  # a handle with its distance from the label
    measures = (text_to_path.get_text_width_height_descent(label, font, False) for label in labels)
    lengths = [handle + width for width, _, _ in measures]
    for columns in range(min(most, len(labels)), 1, -1):
        rows = -(-len(labels) // columns)
        if -(-len(labels) // rows) < columns:
            continue  # as many rows with fewer columns, which are more even
        # shared out as by Matplotlib: the first columns have one entry more
        widths = [float(column.max()) for column in np.array_split(lengths, columns)]
        if sum(widths) + (len(widths) - 1) * spacing * size <= 72.0 * width:
            return columns
    return 1


def add_legend(figure: Figure, handles: Sequence[Any], most: int, *, spacing: float = 1.4) -> None:
    """Write a legend below a figure, in at most ``most`` columns."""
    by_length = sorted(handles, key=lambda handle: -len(handle.get_label()))
    columns, _, handles = max(
        (
            (
                fit_columns(
                    [handle.get_label() for handle in order],
                    most,
                    width=figure.get_figwidth(),
                    spacing=spacing,
                ),
                order is handles,
                order,
            )
            for order in (handles, by_length)
        ),
        key=lambda entry: entry[:2],
    )
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=columns,
        frameon=False,
        fontsize=text_size(),
        labelcolor=INK,
        handletextpad=0.5,
        columnspacing=spacing,
    )
