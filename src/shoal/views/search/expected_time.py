"""The figure of the expected time of a search, paper H, Fig. 5."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from shoal.errors import InvalidInputError
from shoal.search.allocation.expected_time import expected_time, stay_share
from shoal.views.drawing.charts import BLUE, INK, MUTED, ORANGE, new_figure, plain_axes, set_title

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def expected_time_figure(
    *,
    robots: Sequence[int] = (1, 2, 3, 5, 7, 10, 15, 20, 30, 50),
    cells: int = 1024,
    dead: int = 5,
    trials: int = 10_000,
    seed: int = 0,
) -> Figure:
    """Return the expected time of robots that stay where they are against their number, as paper H, Fig. 5.

    Marks are Monte Carlo, with two standard errors; lines are theory: H_m/m, the same for those that live if ``dead`` of them never
    start, and the bound 1/m.

    Parameters
    ----------
    robots : sequence of int
        Numbers of robots, one or more.
    cells, trials, seed
        As `shoal.search.allocation.expected_time.expected_time` takes them.
    dead : int
        0 for no second curve.

    Raises
    ------
    InvalidInputError
    """
    if not len(robots):
        raise InvalidInputError("expected time: expected at least one number of robots, got none")
    figure = new_figure(6.8, 4.2)
    axes = figure.add_subplot()
    numbers = np.arange(1, max(robots) + 1)
    cases = [(0, BLUE, "o", "all live: H$_m$/m")]
    if 0 < dead < max(robots):
        cases.append((dead, ORANGE, "s", f"{dead} dead on arrival: H$_{{m-{dead}}}$/(m-{dead})"))
    for lost, colour, marker, words in cases:
        shown = [count for count in robots if count > lost]
        found = [expected_time(cells, count, dead=lost, trials=trials, seed=seed) for count in shown]
        curve = [(count, 100 * stay_share(int(count), dead=lost)) for count in numbers if count > lost]
        axes.plot(*np.array(curve).T, color=colour, lw=1.5, label=words)
        axes.errorbar(
            shown, [100 * one.mean for one in found], [200 * one.error for one in found], fmt=marker, mfc="white", mec=colour,
            ecolor=colour, mew=1.5, ms=5.5, capsize=2.5, lw=1.2,
        )  # fmt: skip
    axes.plot(numbers, 100 / numbers, color=MUTED, lw=1.3, ls=(0, (4, 2)), label="no search is faster: 1/m")
    if max(robots) >= 20:
        axes.annotate(
            f"20 robots: {100 * stay_share(20):.1f} %", (20, 100 * stay_share(20)), xytext=(-4, -15), textcoords="offset points",
            fontsize=9, color=BLUE, ha="center",
        )  # fmt: skip
    axes.set(xlabel="robots m", ylabel="T$_E$ as % of one robot's time", ylim=(0, 104), xlim=(0, max(robots) * 1.02 + 0.5))
    set_title(axes, f"Robots that stay where they are: {cells:,} cells, {trials:,} trials a mark")
    plain_axes(axes)
    axes.legend(frameon=False, fontsize=9, labelcolor=INK)
    return figure
