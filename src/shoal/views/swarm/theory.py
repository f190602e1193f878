"""Figures of the one-dimensional theory: the costs of random placements of particles, and the costs
of scan schedules.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from itertools import islice, takewhile
from math import log10
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.swarm.theory.one_dimension import Distribution, Line, LineSample
from shoal.swarm.theory.scan_schedules import Hyperexponential, Powers, ScanSchedule
from shoal.views.drawing.charts import (
    BLUE,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    PURPLE,
    SKY,
    add_legend,
    new_figure,
    new_panels,
    plain_axes,
    set_heading,
    set_title,
    text_size,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BARS = 60
_TEETH = 40  # maximum number of scans before and after each of which a chart has a point
_POINTS = 400  # maximum number of scans at each of which a chart has a point


def gap_distributions(line: Line, sample: LineSample | None = None) -> Figure:
    """Return a figure of the distributions of first gap, last gap, largest gap and spread, as in
    figure 5 of paper M.

    The first gap lies between the left end of the line and the first particle, and the last gap
    between the last particle and the right end. The spread is the distance from the first to the
    last particle. Lines show the exact distributions. Bars show the Monte Carlo sample, if a sample
    is given.
    """
    figure, grid = new_panels(7.6, 5.2, 4, rows=2)
    first = line.first_distribution
    panels = (
        ("to the first particle", "first", first),
        ("to the last particle", "last", first),
        ("largest gap", "largest_gap", line.largest_gap_distribution),
        ("spread", "spread", line.spread_distribution),
    )
    for axes, (name, column, exact) in zip(grid, panels, strict=True):
        values = None if sample is None else getattr(sample, column)
        _density(axes, exact, values)
        axes.set(xlabel="cells", ylim=(0, None))
        set_title(axes, name)
    set_heading(figure, _heading(line, sample))
    return figure


def _heading(line: Line, sample: LineSample | None) -> str:
    trials = "" if sample is None else f"; bars: {sample.trials:,} random placements"
    return f"{line.particles} particles in {line.cells} cells{trials}"


def _density(axes: Axes, exact: Distribution, values: NDArray[np.int32] | None) -> None:
    """Draw an exact distribution as a line and its mean as a vertical line, in front of the bars of
    a sample.
    """
    probabilities = exact.probabilities
    support = np.flatnonzero(probabilities > probabilities.max() / 1000)
    low, high = int(exact.values[support[0]]), int(exact.values[support[-1]])
    if values is not None:
        _bars(axes, values, low, high, SKY, "Monte Carlo")
    axes.plot(exact.values[support], probabilities[support], color=BLUE, lw=1.8, label="exact")
    mean = float(exact.mean)
    axes.axvline(mean, color=ORANGE, lw=1.2, label=f"mean {mean:.2f}")
    axes.legend(frameon=False, fontsize=text_size())
    axes.set_ylabel("share of placements")
    axes.ticklabel_format(axis="y", style="plain")
    axes.locator_params(axis="y", nbins=4)
    plain_axes(axes)


def _bars(
    axes: Axes, values: NDArray[np.int32], low: int, high: int, colour: str, label: str
) -> None:
    """Draw a histogram whose bars are a whole number of cells wide."""
    width = max(1, (high - low + 1) // _BARS)
    edges = np.arange(low, high + width + 1, width)
    heights = np.histogram(values, bins=edges)[0] / (len(values) * width)
    axes.bar(
        edges[:-1] - 0.5,
        heights,
        width=width,
        align="edge",
        color=colour,
        alpha=0.55,
        lw=0,
        label=label,
    )


def move_distributions(line: Line, sample: LineSample, *, printed: Sequence[float] = ()) -> Figure:
    """Return a figure of two distributions: the numbers of moves to find both ends, and to cover
    all cells (paper M, figure 6).

    Parameters
    ----------
    line : Line
    sample : LineSample
    printed : sequence of float
        Means that a paper prints and that the figure marks, in moves.
    """
    figure = new_figure(6.8, 3.6)
    axes = figure.add_subplot()
    high = int(max(np.quantile(sample.coverage, 0.999), np.quantile(sample.boundary, 0.999)))
    for values, mean, colour, name in (
        (sample.boundary, line.boundary.exact, BLUE, "both ends found"),
        (sample.coverage, line.coverage.exact, GREEN, "all cells visited"),
    ):
        _bars(axes, values, int(values.min()), high, colour, f"{name}: mean {float(mean):.2f}")
        axes.axvline(float(mean), color=colour, lw=1.4)
    axes.axvline(
        float(line.coverage.printed),
        color=ORANGE,
        lw=1.4,
        ls="--",
        label=f"printed formula: {float(line.coverage.printed):.2f}",
    )
    for k, marked in enumerate(printed):
        axes.axvline(
            marked,
            color=INK,
            lw=1.2,
            ls=":",
            label="" if k else f"printed means: {', '.join(f'{m:g}' for m in printed)}",
        )
    axes.set(xlabel="moves", ylabel="share of placements")
    axes.legend(frameon=False, fontsize=text_size(9))
    set_title(
        axes,
        f"{line.particles} particles in {line.cells} cells, {sample.trials:,} placements",
        in_print="",
    )
    plain_axes(axes)
    return figure


def simultaneous_ratios(
    decades: Sequence[int], ours: ArrayLike, best: ArrayLike, growth: ArrayLike
) -> Figure:
    """Return a figure for theorem 1 of paper M: max(move ratio, scan ratio), drawn against the
    largest distance 10^k of the wall.

    The move ratio is the number of moves divided by the smallest possible number of moves. The scan
    ratio is the number of scans divided by the smallest possible number of scans.

    Parameters
    ----------
    decades : sequence of int
        Exponents k of the largest distances 10^k.
    ours, best, growth : array_like of float, shape (k,)
        ``ours`` is max(move ratio, scan ratio) of the schedule i^i in the worst case. ``best`` is
        the smallest possible value of this maximum over all schedules. ``growth`` is log D / log
        log D for the largest distance D.
    """
    figure, (left, right) = new_panels(7.6, 3.8, 2)
    mine, least, by = (np.asarray(values, dtype=np.float64) for values in (ours, best, growth))
    for axes, name, curves in (
        (
            left,
            "larger of both ratios, worst case",
            ((mine, ORANGE, "i^i"), (least, BLUE, "least of any schedule")),
        ),
        (
            right,
            "by log D / log log D",
            ((mine / by, ORANGE, "i^i"), (least / by, BLUE, "least of any schedule")),
        ),
    ):
        for values, colour, label in curves:
            axes.plot(decades, values, "o-", color=colour, ms=3, lw=1.5, label=label)
        axes.set(xlabel="largest distance D, power of ten", ylim=(0, None))
        set_title(axes, name)
        plain_axes(axes)
    left.legend(frameon=False, fontsize=text_size(9))
    return figure


def schedule_ratios(schedules: Sequence[ScanSchedule], *, max_distance: int) -> Figure:
    """Return a figure of the move ratios and the scan ratios of scan schedules, drawn against the
    distance of the wall.

    The move ratio is the number of moves divided by the smallest possible number of moves. The scan
    ratio is the number of scans divided by the smallest possible number of scans.
    """
    from matplotlib.ticker import MaxNLocator

    figure, (left, right) = new_panels(7.6, 4.2, 2)
    colours = (BLUE, ORANGE, GREEN, PURPLE, MUTED, SKY)
    for schedule, colour in zip(schedules, colours, strict=False):
        costs = [schedule.cost(distance) for distance in chart_distances(schedule, max_distance)]
        # quotients of exact integers, which may be too large for a float
        at = [log10(cost.distance + 1) for cost in costs]
        left.plot(
            at,
            [_float(cost.move_ratio) for cost in costs],
            color=colour,
            lw=1.3,
            label=schedule.name,
        )
        right.plot(
            at,
            [_float(cost.scan_ratio) for cost in costs],
            color=colour,
            lw=1.3,
            label=schedule.name,
        )
    for axes, name in ((left, "moves"), (right, "scans")):
        axes.set(xlabel="distance of the wall + 1", ylabel=f"{name} / optimum", yscale="log")
        axes.set(xlim=(0, max(0.3, log10(max_distance + 1))), ylim=(0.9, None))
        axes.xaxis.set_major_locator(MaxNLocator(5, integer=True))
        axes.xaxis.set_major_formatter(lambda x, _: f"$10^{{{x:g}}}$")
        set_title(axes, name)
        plain_axes(axes)
    highest = max(
        (
            float(s.cost(max_distance).scan_ratio)
            for s in schedules
            if isinstance(s, Powers | Hyperexponential)
        ),
        default=5,
    )
    right.set_ylim(0.9, 2 * highest)  # the range of one scan per move would hide the other curves
    add_legend(figure, right.get_legend_handles_labels()[0], len(schedules))
    return figure


def _float(ratio: Fraction) -> float:
    """Return a ratio as a float, at most 1e100."""
    return float(min(ratio, Fraction(10**100)))


def chart_distances(schedule: ScanSchedule, max_distance: int) -> list[int]:
    """Return the distances, in cells, at which a chart shows the ratios of a scan schedule.

    For a schedule of up to 40 scans, the result contains the distances just before and just after
    each scan. For 41 to 400 scans, the result contains one distance for each scan, so that the line
    of the chart connects the peaks of the ratios. For more than 400 scans, the result contains ten
    distances in each decade.
    """
    scans = [
        *islice(
            takewhile(lambda position: position <= max_distance, schedule.positions()), _POINTS + 1
        )
    ]
    if len(scans) <= _TEETH:
        distances = [position - side for position in scans for side in (1, 0)]
    elif len(scans) <= _POINTS:
        return [0, *scans]
    else:
        tenths = (10, 13, 16, 20, 25, 32, 40, 50, 63, 80)
        distances = [10**k * tenth // 10 for k in range(len(str(max_distance))) for tenth in tenths]
    return sorted(
        {0, *(distance for distance in distances if distance <= max_distance), max_distance}
    )
