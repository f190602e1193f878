"""Functions for map generators and the vessel finder: the largest connected part of a map, and the removal of borders."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]


def largest_part(free: Mask, *, corners: bool = False) -> Mask:
    """Return the largest connected part of the free cells of a map. If the map has no free cells, return the map unchanged.

    Parameters
    ----------
    free : ndarray, bool, shape (H, W)
        True at free cells.
    corners : bool
        Whether cells that share only a corner count as connected.
    """
    from shoal.jit.kernels.connected import connected_parts  # needs Numba, which is slow to import

    parts, number = connected_parts(free, corners=corners)
    if number <= 1:
        return free
    size = np.bincount(parts.ravel())
    size[0] = 0
    return np.asarray(parts == np.argmax(size))


def crop(free: Mask) -> Mask:
    """Cut off the outer rows, columns and layers of a map that contain no free cell. The map must have at least one free cell."""
    return np.ascontiguousarray(free[tuple(slice(int(where.min()), int(where.max()) + 1) for where in np.nonzero(free))])
