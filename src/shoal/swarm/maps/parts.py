"""The connected parts of a map: how many there are, the share of the largest, and where it lies."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from shoal.core.dataclass import one_line
from shoal.swarm.maps.generators.components import Mask

MOST_COUNTED = 2**25
"""Maximum number of cells of a map whose parts are counted: the count needs nine bytes a cell."""

Box = tuple[tuple[int, int], ...]
"""First and last index along each axis."""


class Parts(NamedTuple):
    """The connected parts of the free cells of a map.

    Attributes
    ----------
    number : int
        Number of parts.
    share : float
        Share of the largest part among all free cells, from 0 to 1.
    largest : tuple
        First and last layer, row and column of the largest part.
    whole : tuple
        First and last layer, row and column of all free cells.
    """

    number: int
    share: float
    largest: Box
    whole: Box

    def __repr__(self) -> str:
        return one_line(self)


def parts_of(free: Mask, *, corners: bool = False) -> Parts | None:
    """Return the connected parts of a map, or None for a map of more than `MOST_COUNTED` cells.

    Parameters
    ----------
    free : ndarray, bool, shape (H, W) or (D, H, W)
        True at free cells, of which there is at least one.
    corners : bool
        Whether cells that share only a corner are connected. Particles do not move diagonally, so that the cells of a map are not.

    Examples
    --------
    >>> parts_of(np.array([[1, 1, 0, 1]], dtype=bool))
    Parts(number=2, share=0.6666666666666666, largest=((0, 0), (0, 1)), whole=((0, 0), (0, 3)))
    """
    if free.size > MOST_COUNTED:
        return None
    from shoal.jit.kernels.connected import connected_parts  # needs Numba, which is slow to import

    labels, number = connected_parts(free, corners=corners)
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return Parts(number, float(sizes.max() / sizes.sum()), box_of(labels == np.argmax(sizes)), box_of(free))


def box_of(free: Mask) -> Box:
    """Return the first and the last index of the free cells along each axis."""
    axes = range(free.ndim)
    found = [np.flatnonzero(free.any(axis=tuple(other for other in axes if other != axis))) for axis in axes]
    return tuple((int(indices[0]), int(indices[-1])) for indices in found)
