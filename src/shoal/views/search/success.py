"""The prior of a search and its probability of success over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.search import SearchEpisode
from shoal.search.episode import duration_text
from shoal.search.problem.target import Ground
from shoal.views.drawing.charts import INK, MUTED, bare_axes, new_figure, plain_axes, set_title
from shoal.views.search.history import SearchHistory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_EDGE = "#39424e"
_LIKELY = "#1f4e8c"
_STRONGEST = 0.995  # quantile of the probability per cell that gets the full colour


def success_figure(episode: SearchEpisode) -> Figure:
    """Return a figure of a search with a prior: where the target is likely, with the robots'
    starts, and the probability that it is found, over time.

    Raises
    ------
    InvalidInputError
        If the search has no prior.
    """
    where = episode.plan.ground
    if where is None:
        raise InvalidInputError("figure success: expected a search with a prior, got one without")
    still = where if isinstance(where, Ground) else where.still(0.0)
    seen = still.cells[:, 0] >= 0
    odds = np.zeros(len(episode.plan.tour))
    np.add.at(odds, still.cells[seen, 0], still.masses[seen])
    history = SearchHistory(episode)
    figure = new_figure(8.0, 4.2)
    ground, chart = figure.subplots(1, 2, width_ratios=(1, 1.15))
    left, right, bottom, top = history.extent
    ground.imshow(
        history.raster(_shades(odds), 1.0),
        extent=(left, right, bottom, top),
        interpolation="nearest",
    )
    for part in history.panels.parts:
        for ring in part:
            ground.plot(*ring.T, color=_EDGE, lw=1.0)
    # further layers are looks at the same ground
    left, right, bottom, top = history.panels.first_extent
    ground.set(xlim=(left, right), ylim=(bottom, top))
    ground.set_aspect("equal")
    bare_axes(ground)
    at_start = "" if still is where else " at the start"
    set_title(ground, f"where the target is likely{at_start}")
    success = episode.success
    assert success is not None
    times, found = success.times / 60.0, success.probabilities
    chart.step(np.append(0.0, times), np.append(0.0, found), where="post", color=_LIKELY, lw=1.6)
    if episode.expected_find is not None:
        middle = episode.expected_find / 60.0
        chart.axvline(middle, color=INK, lw=0.9, ls=(0, (4, 3)))
        chart.annotate(
            f"on average after {duration_text(episode.expected_find)}",
            (middle, 0.04),
            xytext=(5, 0),
            textcoords="offset points",
            fontsize=8,
            color=MUTED,
        )
    chart.set(
        xlim=(0, None),
        ylim=(0, 1.02),
        xlabel="time, in minutes",
        ylabel="probability that the target is found",
    )
    plain_axes(chart)
    set_title(chart, "probability of success")
    return figure


def _shades(odds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the colour of each cell: the darker, the likelier; float64, shape (N, 3)."""
    from matplotlib.colors import to_rgb

    most = max(float(np.quantile(odds, _STRONGEST)), 1e-300)
    strength = np.clip(odds / most, 0.0, 1.0)[:, None] ** 0.6
    return np.asarray(1.0 - strength * (1.0 - np.array(to_rgb(_LIKELY))))
