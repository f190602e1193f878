"""What several generators and the vessel finder need: the largest connected part, and no empty rim."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]


def largest_part(free: Mask, *, corners: bool = False) -> Mask:
    """Return the largest connected part of the free cells; all of them if there are none.

    Parameters
    ----------
    free : ndarray, bool, shape (H, W)
        True where free.
    corners : bool
        Whether cells touch that share no more than a corner.
    """
    from shoal.jit.kernels.connected import connected_parts  # needs Numba, which takes long to import

    parts, number = connected_parts(free, corners=corners)
    if number <= 1:
        return free
    size = np.bincount(parts.ravel())
    size[0] = 0
    return np.asarray(parts == np.argmax(size))


def crop(free: Mask) -> Mask:
    """Return the map, which has a free cell, without empty rows, columns and layers at its sides."""
    return np.ascontiguousarray(free[tuple(slice(int(where.min()), int(where.max()) + 1) for where in np.nonzero(free))])
