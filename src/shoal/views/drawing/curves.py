"""Curves: means with intervals of several runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.views.drawing.charts import (
    BLUE,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    PURPLE,
    SKY,
    new_figure,
    plain_axes,
    set_title,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY, MUTED)
Numbers = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Published:
    """A curve, or single points, that a paper has published.

    Parameters
    ----------
    x, mean : ndarray of float64, shape (n,)
    std : ndarray of float64, shape (n,), optional
        Published standard deviations, with NaN at points where the paper gives no standard
        deviation.
    points : bool
        Whether the paper gives only single points. A chart shows single points as circles instead
        of a curve.
    """

    x: Numbers
    mean: Numbers
    std: Numbers | None = None
    points: bool = False


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve of means with a band.

    Parameters
    ----------
    label : str
    x, mean, low, high : ndarray of float64, shape (n,)
        Positions on the x axis, means, and the lower and upper ends of a band, by default of 95 %
        intervals of the means.
    published : Published, optional
    """

    label: str
    x: Numbers
    mean: Numbers
    low: Numbers
    high: Numbers
    published: Published | None = None


@dataclass(frozen=True)
class Labels:
    """Title, axis labels, legend texts and note of a chart."""

    title: str
    x: str
    y: str
    published: str = "published"
    note: str = ""
    band: str = "95 % interval of the mean"


def mean_curves(
    curves: Sequence[Curve], labels: Labels, *, log_x: bool = False, log_y: bool = True
) -> Figure:
    """Return a figure of means with confidence bands. Published curves are grey, with a band of ±
    one standard deviation.

    Raises
    ------
    InvalidInputError
        If ``curves`` is empty.
    """
    if not curves:
        raise InvalidInputError("curves: expected at least one curve, got none")
    figure = new_figure(7.4, 4.8)
    draw_curves(figure.add_subplot(), curves, labels, log_x=log_x, log_y=log_y)
    add_note(figure, labels.note)
    return figure


def draw_curves(
    axes: Axes, curves: Sequence[Curve], labels: Labels, *, log_x: bool = False, log_y: bool = True
) -> None:
    """Draw means with confidence bands on given axes, as in `mean_curves`."""
    from matplotlib.ticker import LogLocator

    for curve, colour in zip(curves, COLOURS * len(curves), strict=False):
        _behind(axes, curve.published, colour)
        axes.fill_between(curve.x, curve.low, curve.high, color=colour, alpha=0.25, lw=0, zorder=3)
        axes.plot(curve.x, curve.mean, color=colour, lw=1.6, zorder=4)
    axes.set(
        xlabel=labels.x,
        ylabel=labels.y,
        xscale="log" if log_x else "linear",
        yscale="log" if log_y else "linear",
    )
    if log_x:
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter("")
    if log_y:
        axes.yaxis.set_major_formatter("{x:g}")
    _key(axes, curves, labels)
    set_title(axes, labels.title)
    plain_axes(axes)


def add_note(figure: Figure, note: str) -> None:
    """Write a note below a figure, or above the figure if the legend is below the figure."""
    note = fill(note, width=int(17 * figure.get_figwidth()))
    if note and figure.legends:
        figure.suptitle(note, fontsize=8, color=MUTED, x=0.01, ha="left")
    elif note:
        figure.supxlabel(note, fontsize=8, color=MUTED, x=0.01, ha="left")


def _behind(axes: Axes, published: Published | None, colour: str) -> None:
    """Draw a published curve behind the curves that Shoal has computed."""
    if published is None:
        return
    if published.points:
        errors = None if published.std is None else np.nan_to_num(published.std)
        axes.errorbar(
            published.x,
            published.mean,
            yerr=_above_zero(published.mean, errors),
            fmt="o",
            ms=6,
            mfc="white",
            mec=colour,
            mew=1.4,
            ecolor=colour,
            elinewidth=0.9,
            capsize=2.5,
            alpha=0.9,
            zorder=5,
        )
        return
    if published.std is not None:
        below = np.maximum(published.mean - published.std, published.mean / 5)
        axes.fill_between(
            published.x,
            below,
            published.mean + published.std,
            color=MUTED,
            alpha=0.16,
            lw=0,
            zorder=1,
        )
    axes.plot(
        published.x, published.mean, color=MUTED, lw=5, alpha=0.5, zorder=2, solid_capstyle="round"
    )


def _above_zero(mean: Numbers, errors: Numbers | None) -> Numbers | None:
    """Return the lower and upper errors of ``mean``. The lower errors are limited to 80 % of
    ``mean``, for a logarithmic axis.
    """
    return None if errors is None else np.stack([np.minimum(errors, 0.8 * mean), errors])


def _key(axes: Axes, curves: Sequence[Curve], labels: Labels) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[object] = [
        Line2D([], [], color=colour, lw=2.4, label=curve.label)
        for curve, colour in zip(curves, COLOURS * 9, strict=False)
    ]
    banded = [
        colour
        for curve, colour in zip(curves, COLOURS * 9, strict=False)
        if np.nanmax(curve.high - curve.low, initial=0) > 0
    ]
    if banded:
        handles.append(Patch(facecolor=banded[0], alpha=0.25, label=labels.band))
    lines = [
        curve.published
        for curve in curves
        if curve.published is not None and not curve.published.points
    ]
    if lines:
        handles.append(Line2D([], [], color=MUTED, lw=5, alpha=0.5, label=labels.published))
        if any(line.std is not None for line in lines):
            handles.append(Patch(facecolor=MUTED, alpha=0.16, label="± one standard deviation"))
    if any(curve.published is not None and curve.published.points for curve in curves):
        handles.append(
            Line2D(
                [],
                [],
                ls="",
                marker="o",
                mfc="white",
                mec=INK,
                mew=1.4,
                ms=6,
                label=labels.published if not lines else "published points",
            )
        )
    axes.legend(handles=handles, frameon=False, fontsize=9, labelcolor=INK)


def frontier_curves(
    groups: Mapping[str, Sequence[NDArray[np.int32]]],
    *,
    title: str,
    note: str = "",
    printed: Mapping[str, float] | None = None,
) -> Figure:
    """Return a figure of the number of frontier cells over the moves, with a thin line for each
    trial and a thick median line.

    Source: figure 8 of paper M.

    Parameters
    ----------
    groups : mapping from name to arrays of int32, shape (moves + 1,)
        For each named group of trials, the number of frontier cells before the first move and after
        each move of each trial.
    title, note : str
    printed : mapping from name to float, optional
        For some groups, the mean number of moves that a paper prints. The figure marks this number.

    Raises
    ------
    InvalidInputError
        If a group contains no trial.
    """
    if not groups or not all(len(curves) for curves in groups.values()):
        raise InvalidInputError("frontier curves: expected at least one trial per group, got none")
    figure = new_figure(7.4, 4.4)
    axes = figure.add_subplot()
    for (name, curves), colour in zip(groups.items(), COLOURS, strict=False):
        for curve in curves:
            axes.plot(
                np.arange(1, len(curve) + 1),
                np.maximum(curve, 0.5),
                color=colour,
                lw=0.5,
                alpha=0.25,
            )
        if printed and name in printed:
            axes.axvline(
                printed[name] + 1,
                color=colour,
                lw=1.2,
                ls=":",
                label=f"{name}, printed mean: {printed[name]:g} moves",
            )
        median = median_of(curves)
        alive = median > 0
        axes.plot(
            np.arange(1, len(median) + 1)[alive],
            median[alive],
            color=colour,
            lw=2.2,
            label=f"{name}, median of {len(curves)}",
        )
    axes.set(
        xlabel="moves + 1", ylabel="frontier cells", xscale="log", yscale="log", ylim=(0.8, None)
    )
    axes.legend(frameon=False, fontsize=9, labelcolor=INK)
    set_title(axes, title)
    plain_axes(axes)
    add_note(figure, note)
    return figure


def median_of(curves: Sequence[NDArray[np.integer[Any]]]) -> Numbers:
    """Return the median of several curves at each position, as float64. Zeros extend short curves
    to the greatest length.
    """
    table = np.zeros((len(curves), max(len(curve) for curve in curves)))
    for row, curve in zip(table, curves, strict=True):
        row[: len(curve)] = curve
    return np.asarray(np.median(table, axis=0))


ASIDE = 0.007
"""Horizontal distance between the intervals of two lines at the same axis value, as a fraction of
the length of the axis.
"""


def means_figure(means: Sequence[Any], *, title: str, measure: str) -> Figure:
    """Return a figure of the means at all points of a sweep.

    The first sweep axis with several numbers becomes the x axis, and each combination of values of
    the other axes becomes a line. If no axis has several numbers, each point of the sweep becomes a
    row.

    Parameters
    ----------
    means : sequence
        One object for each point, with ``values`` (the value of each axis by name) and ``estimate``
        (``mean``, ``low`` and ``high``; NaN without an interval).
    title, measure : str

    Raises
    ------
    InvalidInputError
        If ``means`` is empty.
    """
    if not means:
        raise InvalidInputError("means: expected at least one mean, got none")
    axis = _axis_of_numbers([mean.values for mean in means])
    lines: dict[str, list[Any]] = {}
    for mean in means:
        lines.setdefault(_words(mean.values, axis), []).append(mean)
    figure = new_figure(7.4, 4.8 if axis else 1.6 + 0.4 * len(means))
    axes = figure.add_subplot()
    places = sorted({mean.values[axis] for mean in means}) if axis else []
    for number, (label, line) in enumerate(lines.items()):
        at = np.array([mean.values[axis] for mean in line] if axis else [number])
        middle = np.array([mean.estimate.mean for mean in line])
        ends = np.array([[mean.estimate.low, mean.estimate.high] for mean in line]).T
        errors = np.nan_to_num(np.abs(ends - middle))
        colour = COLOURS[number % len(COLOURS)] if axis else COLOURS[0]
        if axis:
            beside = _beside(at, places, number - (len(lines) - 1) / 2)
            axes.errorbar(
                beside,
                middle,
                yerr=errors,
                marker="o",
                ms=4,
                lw=1.6,
                capsize=3,
                color=colour,
                label=label,
            )
        else:
            axes.errorbar(middle, at, xerr=errors, marker="o", ms=7, lw=2.4, color=colour)
    if axis:
        if _is_logarithmic(places):
            axes.set_xscale("log")
        if len(places) <= 12:
            axes.set_xticks(places, [f"{place:g}" for place in places])
            axes.minorticks_off()
        axes.set(xlabel=axis, ylabel=_label(measure))
        if len(lines) > 1:
            axes.legend(frameon=False)
    else:
        axes.set_yticks(range(len(lines)), list(lines), parse_math=False)
        axes.set(xlabel=_label(measure), ylim=(len(lines) - 0.5, -0.5))
    set_title(axes, title)
    plain_axes(axes)
    return figure


def _is_logarithmic(places: Sequence[float]) -> bool:
    return places[0] > 0 and places[-1] >= 10 * places[0]


def _beside(at: Any, places: Sequence[float], steps: float) -> Any:
    """Return axis values moved to the side by a number of steps, so that intervals of two lines do
    not hide each other.
    """
    if _is_logarithmic(places):
        return at * (places[-1] / places[0]) ** (ASIDE * steps)
    return at + (places[-1] - places[0]) * ASIDE * steps


def _label(measure: str) -> str:
    return f"mean {measure}, with 95 % confidence intervals"


def _axis_of_numbers(points: Sequence[Mapping[str, Any]]) -> str | None:
    """Return the name of the first numeric sweep axis with several values, or None if no such axis
    exists.
    """
    for name in points[0]:
        values = {
            point[name]
            for point in points
            if isinstance(point[name], int | float) and not isinstance(point[name], bool)
        }
        if len(values) > 1 and all(isinstance(point[name], int | float) for point in points):
            return name
    return None


def _words(values: Mapping[str, Any], without: str | None) -> str:
    others = {name: value for name, value in values.items() if name != without}
    return (
        ", ".join(
            str(value) if isinstance(value, str) else f"{name} {value}"
            for name, value in others.items()
        )
        or "all"
    )
