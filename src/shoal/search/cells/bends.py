"""Bends: paths around corners with few turns."""

from __future__ import annotations

from math import inf

import numpy as np

from shoal.core.geometry import cross
from shoal.search.cells.visibility_graph import inside, leg_lengths
from shoal.search.regions.outline import Points
from shoal.search.regions.region import SearchRegion

_FEWEST = 4  # legs: a shorter path, such as around a building, keeps its bends
_MOST = 200  # legs: a longer path keeps its bends


def with_fewer_bends(region: SearchRegion, way: Points, price: float) -> Points:
    """Return a path that stays on some of the legs of ``way``, and is not longer than it by more
    than ``price`` metres for each bend that it saves.

    A shortest path around a round lake bends at each corner of its border. The new path follows
    the lines of a few legs, up to the points at which they cross. The legs are chosen by dynamic
    programming: the crossing of two lines costs the price and the way from the end of the one leg
    to the beginning of the other.

    Parameters
    ----------
    region : SearchRegion
    way : ndarray of float64, shape (k, 2)
        A path inside the region, in metres.
    price : float
        Length in metres that a bend may cost.
    """
    count = len(way) - 1
    if not _FEWEST <= count <= _MOST:
        return way
    starts, ends = way[:-1], way[1:]
    lengths = leg_lengths(way)
    if (lengths <= 0).any():
        return way
    units = (ends - starts) / lengths[:, None]
    one, other = np.triu_indices(count, 2)
    # The point ends[i] + a u_i = starts[j] - b u_j, with a and b at least 0, lies ahead on both.
    gap = starts[other] - ends[one]
    sine = cross(units[one], units[other])
    ahead = np.abs(sine) > 1e-9
    one, other, gap, sine = one[ahead], other[ahead], gap[ahead], sine[ahead]
    a, b = cross(gap, units[other]) / sine, cross(units[one], gap) / sine
    saved = other - one - 1
    past = np.append(0.0, np.cumsum(lengths))
    longer = a + b - (past[other] - past[one + 1])
    good = (a >= 0) & (b >= 0) & (longer < price * saved)
    one, other, a, b = one[good], other[good], a[good], b[good]
    crossings = ends[one] + a[:, None] * units[one]
    free = inside(region, ends[one], crossings)
    free[free] = inside(region, crossings[free], starts[other[free]])
    one, other, a, b, crossings = one[free], other[free], a[free], b[free], crossings[free]
    if not len(one):
        return way
    costs, before, at = np.full(count, inf), np.full(count, -1), np.full((count, 2), np.nan)
    costs[0] = lengths[0]
    into = np.argsort(other, kind="stable")
    begins = np.searchsorted(other[into], np.arange(count + 1))
    for leg in range(1, count):
        costs[leg], before[leg], at[leg] = costs[leg - 1] + price, leg - 1, way[leg]
        for k in into[begins[leg] : begins[leg + 1]].tolist():
            cost = costs[one[k]] + price + a[k] + b[k]
            if cost < costs[leg]:
                costs[leg], before[leg], at[leg] = cost, one[k], crossings[k]
        costs[leg] += lengths[leg]
    bends, leg = [], count - 1
    while leg > 0:
        bends.append(at[leg])
        leg = int(before[leg])
    return np.vstack([way[:1], *(bend[None] for bend in bends[::-1]), way[-1:]])
