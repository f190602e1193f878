"""The figure of a sweep: means with confidence intervals over its first numeric axis, or one row for each point of the sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.views.drawing.charts import new_figure, plain_axes, set_title
from shoal.views.drawing.curves import COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ASIDE = 0.007
"""Horizontal distance between the intervals of two lines at the same axis value, as a fraction of the length of the axis."""


@dataclass(frozen=True)
class PointMean:
    """The mean of a measure at one point of a sweep, that is, for one combination of axis values.

    Parameters
    ----------
    values : dict
        Value of each sweep axis at the point, by the name of the axis.
    mean : float
    low, high : float
        Lower and upper end of the mean's confidence interval, or NaN if the point has a single trial.
    """

    values: Mapping[str, Any]
    mean: float
    low: float
    high: float


def means_figure(means: Sequence[PointMean], *, title: str, measure: str) -> Figure:
    """Return a figure of the means at all points of a sweep.

    The first sweep axis with several numbers becomes the x axis, and each combination of values of the other axes becomes a line.
    If no axis has several numbers, each point of the sweep becomes a row.

    Raises
    ------
    InvalidInputError
        If ``means`` is empty.
    """
    if not means:
        raise InvalidInputError("means: expected at least one mean, got none")
    axis = _axis_of_numbers([mean.values for mean in means])
    lines: dict[str, list[PointMean]] = {}
    for mean in means:
        lines.setdefault(_words(mean.values, axis), []).append(mean)
    figure = new_figure(7.4, 4.8 if axis else 1.6 + 0.4 * len(means))
    axes = figure.add_subplot()
    places = sorted({mean.values[axis] for mean in means}) if axis else []
    for number, (label, line) in enumerate(lines.items()):
        at = np.array([one.values[axis] for one in line] if axis else [number])
        middle = np.array([one.mean for one in line])
        ends = np.array([[one.low, one.high] if isfinite(one.low) else [one.mean, one.mean] for one in line]).T
        errors = np.abs(ends - middle)
        colour = COLOURS[number % len(COLOURS)] if axis else COLOURS[0]
        if axis:
            beside = _beside(at, places, number - (len(lines) - 1) / 2)
            axes.errorbar(beside, middle, yerr=errors, marker="o", ms=4, lw=1.6, capsize=3, color=colour, label=label)
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
    """Return axis values moved to the side by a number of steps, so that intervals of two lines do not hide each other."""
    if _is_logarithmic(places):
        return at * (places[-1] / places[0]) ** (ASIDE * steps)
    return at + (places[-1] - places[0]) * ASIDE * steps


def _label(measure: str) -> str:
    return f"mean {measure}, with 95 % confidence intervals"


def _axis_of_numbers(points: Sequence[Mapping[str, Any]]) -> str | None:
    """Return the name of the first numeric sweep axis with several values, or None if no such axis exists."""
    for name in points[0]:
        found = {point[name] for point in points if isinstance(point[name], int | float) and not isinstance(point[name], bool)}
        if len(found) > 1 and all(isinstance(point[name], int | float) for point in points):
            return name
    return None


def _words(values: Mapping[str, Any], without: str | None) -> str:
    kept = {name: value for name, value in values.items() if name != without}
    return ", ".join(str(value) if isinstance(value, str) else f"{name} {value}" for name, value in kept.items()) or "all"
