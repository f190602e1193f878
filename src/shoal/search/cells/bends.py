"""Bends: where a way changes its direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

BEND = 1.0
"""Degrees: a smaller change of direction is none."""

_STILL = 1e-6  # metres: a step that is none


def bends(way: ArrayLike) -> NDArray[np.bool_]:
    """Return at which points of a way the direction changes by more than a degree; bool, shape (k,).

    Of points that coincide, the last one counts; the first and the last point of the way are no bends.

    Parameters
    ----------
    way : array_like of float64, shape (k, 2)
        Metres.

    Examples
    --------
    >>> bends([(0, 0), (5, 0), (9, 0.01), (9, 0.01), (9, 4)]).tolist()
    [False, False, False, True, False]
    """
    points = np.asarray(way, dtype=np.float64).reshape(-1, 2)
    steps = np.diff(points, axis=0)
    moves = np.flatnonzero(np.hypot(*steps.T) > _STILL)
    one, other = steps[moves[:-1]], steps[moves[1:]]
    change = np.arctan2(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0], (one * other).sum(axis=1))
    found = np.zeros(len(points), dtype=np.bool_)
    found[moves[1:]] = np.abs(change) > np.radians(BEND)
    return found
