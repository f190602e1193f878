"""Bends: paths around corners with few turns."""

from __future__ import annotations

import numpy as np

from shoal.search.cells.visibility_graph import leg_lengths
from shoal.search.regions.outline import Points
from shoal.search.regions.region import SearchRegion

_FEWEST = 4  # legs: a shorter path, such as around a building, keeps its bends
_MOST = 200  # legs: a longer path keeps its bends


def with_fewer_bends(region: SearchRegion, path: Points, price: float) -> Points:
    """Return a path that stays on some of the legs of ``path``, and is not longer than it by more
    than ``price`` metres for each bend that it saves.

    A shortest path around a round lake bends at each corner of its border. The new path follows the
    lines of a few legs, up to the points at which they cross. The legs are chosen by dynamic
    programming: the crossing of two lines costs the price and the distance from the end of the one
    leg to the beginning of the other.

    Parameters
    ----------
    region : SearchRegion
    path : ndarray of float64, shape (k, 2)
        A path inside the region, in metres.
    price : float
        Length in metres that a bend may cost.
    """
    count = len(path) - 1
    if not _FEWEST <= count <= _MOST:
        return path
    lengths = leg_lengths(path)
    if (lengths <= 0).any():
        return path
    return np.vstack([path[:1], region.border.with_fewer_bends(path, lengths, price), path[-1:]])
