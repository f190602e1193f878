"""What of the plane a picture of a search shows."""

from __future__ import annotations

import numpy as np

from shoal.views.search.history import SearchHistory


def sides_of(history: SearchHistory) -> tuple[float, float, float, float]:
    """Return left, right, bottom and top of the grid and of the ways of robots that set out elsewhere, metres."""
    left, right, bottom, top = history.extent
    x, y = np.concatenate([history.on_picture(route.points) for route in history.episode.routes]).T
    seen = min(left, float(x.min())), max(right, float(x.max())), min(bottom, float(y.min())), max(top, float(y.max()))
    beyond = 0.0 if seen == history.extent else 0.5 * history.episode.plan.grid.size
    return seen[0] - beyond, seen[1] + beyond, seen[2] - beyond, seen[3] + beyond
