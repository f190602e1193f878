"""What several generators and the vessel finder need: the largest connected part, and no empty rim."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]


def largest_part(free: Mask, neighbours: NDArray[np.float64] | None = None) -> Mask:
    """Return the largest connected part of the free cells; all of them if there are none.

    Parameters
    ----------
    free : ndarray, bool, shape (H, W)
        True where free.
    neighbours : ndarray, float64, shape (3, 3), optional
        Not 0 where a cell touches the one in the middle; left, right, up and down if not given.
    """
    from scipy import ndimage

    parts, number = ndimage.label(free, neighbours)
    if number <= 1:
        return free
    size = np.bincount(parts.ravel())
    size[0] = 0
    return np.asarray(parts == np.argmax(size))


def crop(free: Mask) -> Mask:
    """Return the map, which has a free cell, without empty rows, columns and layers at its sides."""
    return np.ascontiguousarray(free[tuple(slice(int(where.min()), int(where.max()) + 1) for where in np.nonzero(free))])
