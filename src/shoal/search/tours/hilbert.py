"""The Hilbert curve, closed by its long closing edge or open; on other shapes the covering curve, restricted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.search.tours.base import TOURS
from shoal.search.tours.codec import MAX_ORDER, hilbert_encode, moore_encode
from shoal.search.tours.masks import bounds, component_after_component
from shoal.search.tours.tour import Tour


@TOURS.register("hilbert")
class HilbertTour:
    """The Hilbert curve through the smallest square of 2^k cells a side over the True cells, its lower left corner theirs.

    Closed as in paper H (the index goes on modulo the number of cells), by an edge as long as the square but for one cell.
    On other shapes the cells come in the order of the curve, with steps over what is left out. In 3 dimensions a cube.
    """

    name = "hilbert"
    dimensions: tuple[int, ...] = (2, 3)
    closed = True

    def make(self, mask: NDArray[np.bool_]) -> Tour:
        """Return the tour of all True cells."""
        cells, order = in_covering_square(mask, self.name)
        return _along(hilbert_encode(cells, order=order), mask, closed=self.closed, name=self.name)


@TOURS.register("open-hilbert")
class OpenHilbertTour(HilbertTour):
    """The Hilbert curve as a line segment: it does not come back from its end. For comparison."""

    name = "open-hilbert"
    closed = False


@TOURS.register("moore")
class MooreTour:
    """The Moore curve, four Hilbert curves closed by one step, through the smallest square of 2^k cells a side over the cells."""

    name = "moore"
    dimensions: tuple[int, ...] = (2,)

    def make(self, mask: NDArray[np.bool_]) -> Tour:
        """Return the tour of all True cells."""
        cells, order = in_covering_square(mask, self.name)
        return _along(moore_encode(cells, order=order), mask, closed=True, name=self.name)


def in_covering_square(mask: NDArray[np.bool_], name: str) -> tuple[NDArray[np.int64], int]:
    """Return the True cells in the frame of the smallest square (cube) of 2^order cells a side over them, and the order.

    Raises
    ------
    InvalidInputError
        If no curve with 64-bit indices covers them.
    """
    low, size = bounds(mask)
    order = int(size.max() - 1).bit_length()
    if order > MAX_ORDER[mask.ndim]:
        longest = 2 ** MAX_ORDER[mask.ndim]
        raise InvalidInputError(f"tour {name}: expected at most {longest} cells along each side, got shape {mask.shape}")
    cells = np.argwhere(mask) - low
    cells[:, -2] += 2**order - size[-2]  # rows count from the top, the curve begins at the bottom
    return cells, order


def _along(indices: NDArray[np.int64], mask: NDArray[np.bool_], *, closed: bool, name: str) -> Tour:
    cells = np.argwhere(mask)[np.argsort(indices)]
    return Tour(component_after_component(cells, mask), mask.shape, closed=closed, name=name)
