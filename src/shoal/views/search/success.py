"""The prior of a search and its probability of success over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shoal.core.errors import InvalidInputError
from shoal.search import SearchEpisode
from shoal.search.episode import duration_text
from shoal.search.problem.target import Ground
from shoal.views.drawing.charts import (
    INK,
    MUTED,
    add_colour_scale,
    bare_axes,
    new_panels,
    plain_axes,
    set_title,
    text_size,
)
from shoal.views.search.history import SHADE, SearchHistory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_EDGE = "#39424e"
_LIKELY = "#1f4e8c"


def success_figure(episode: SearchEpisode) -> Figure:
    """Return a figure of a search with a prior: where the target is likely, with the robots'
    starts, and the probability that it is found, over time.

    Raises
    ------
    InvalidInputError
        If the search has no prior.
    """
    from matplotlib.colors import LinearSegmentedColormap, PowerNorm

    where = episode.plan.ground
    if where is None:
        raise InvalidInputError("figure success: expected a search with a prior, got one without")
    history = SearchHistory(episode)
    figure, (ground, chart) = new_panels(8.0, 4.2, 2, ratios=(1, 1.15))
    left, right, bottom, top = history.extent
    likely = history.probabilities(-np.inf)
    image = ground.imshow(
        np.ma.masked_invalid(history.raster(likely, np.nan)),
        extent=(left, right, bottom, top),
        interpolation="nearest",
        cmap=LinearSegmentedColormap.from_list("likely", ["#ffffff", _LIKELY]),
        norm=PowerNorm(SHADE, vmin=0.0, vmax=history.strongest),
    )
    add_colour_scale(
        ground,
        image,
        "probability of a cell",
        extend="max" if likely.max() > history.strongest else "neither",
    )
    for part in history.panels.parts:
        for ring in part:
            ground.plot(*ring.T, color=_EDGE, lw=1.0)
    # further layers are looks at the same ground
    left, right, bottom, top = history.panels.first_extent
    ground.set(xlim=(left, right), ylim=(bottom, top))
    ground.set_aspect("equal")
    bare_axes(ground)
    ground.set_xlabel("metres", color=MUTED, fontsize=text_size())
    at_start = "" if isinstance(where, Ground) else " at the start"
    set_title(ground, f"where the target is likely{at_start} (dark)")
    success = episode.success
    assert success is not None
    times, probabilities = success.times / 60.0, success.probabilities
    chart.step(
        np.append(0.0, times), np.append(0.0, probabilities), where="post", color=_LIKELY, lw=1.6
    )
    if episode.expected_find is not None:
        middle = episode.expected_find / 60.0
        late = middle > times[-1] / 2
        chart.axvline(middle, color=INK, lw=0.9, ls=(0, (4, 3)))
        chart.annotate(
            f"on average after {duration_text(episode.expected_find)}",
            (middle, 0.04),
            xytext=(-5 if late else 5, 0),
            textcoords="offset points",
            ha="right" if late else "left",
            fontsize=text_size(),
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
