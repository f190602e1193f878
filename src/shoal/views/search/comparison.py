"""Figure of a comparison: the best plan along each tour, side by side, with north up."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from shoal.core.checks import count_text
from shoal.search.episode import duration_text
from shoal.search.planning.comparison import PlanFigures, routes_of
from shoal.views.drawing.charts import MUTED, bare_axes, new_figure
from shoal.views.search.history import robot_colour

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_EDGE = "#39424e"
_COLUMNS = 3


def comparison_figure(plans: Sequence[PlanFigures]) -> Figure:
    """Return a figure with a panel for each compared tour: its best plan, with the route of each
    robot in the colour of the robot, and a square at each start. North is up.

    Parameters
    ----------
    plans : sequence of PlanFigures
        The compared plans, the best first, as `compare_plans` returns them.
    """
    best: dict[str, PlanFigures] = {}
    for entry in plans:
        best.setdefault(entry.names[0] + " by the prior" * entry.by_prior, entry)
    columns = min(_COLUMNS, len(best))
    rows = -(-len(best) // columns)
    left, bottom, right, top = plans[0].plan.grid.region.outline.bounds
    ratio = float(np.clip((top - bottom) / (right - left), 0.25, 2.0))
    figure = new_figure(3.4 * columns, rows * (3.2 * ratio + 0.6))
    for number, entry in enumerate(best.values(), start=1):
        axes = figure.add_subplot(rows, columns, number)
        for part in entry.plan.grid.region.parts:
            for ring in (part.exterior, *part.interiors):
                axes.plot(*np.asarray(ring.coords).T[:2], color=_EDGE, lw=0.8, zorder=1)
        for robot, route in routes_of(entry.plan):
            colour = robot_colour(robot)
            axes.plot(*route.T, color=colour, lw=0.7, zorder=2)
            axes.plot(*route[0], "s", color=colour, ms=3.5, zorder=3)
        axes.set(xticks=[], yticks=[], aspect="equal")
        bare_axes(axes)
        axes.set_title(
            f"{', '.join(entry.names)}: {duration_text(entry.seconds)},"
            f"\n{count_text(entry.turns, 'turn')}, {entry.length:.0f} m",
            fontsize=7.5,
            color=MUTED,
            parse_math=False,
        )
    return figure
