"""Tours along the Hilbert curve and along the Moore curve."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.search.tours.base import TOURS
from shoal.search.tours.codec import MAX_ORDER, hilbert_encode, moore_encode
from shoal.search.tours.masks import component_after_component, smallest_part
from shoal.search.tours.tour import Tour


@TOURS.register("hilbert")
class HilbertTour:
    """The Hilbert curve through the smallest square of 2^k cells per side that covers the cells from their lower left corner.

    As in paper H, the tour is closed: it continues from its last cell to its first cell. The closing edge is one cell side shorter
    than a side of the square. If the cells do not fill the square, they keep the order of the curve, and some steps lead across
    positions without a cell. In 3 dimensions, the square is a cube.
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
    """The Hilbert curve as an open path that does not return from its end. This tour is only for comparisons."""

    name = "open-hilbert"
    closed = False


@TOURS.register("moore")
class MooreTour:
    """The Moore curve through the smallest covering square with 2^k cells per side: four Hilbert curves, closed by one step."""

    name = "moore"
    dimensions: tuple[int, ...] = (2,)

    def make(self, mask: NDArray[np.bool_]) -> Tour:
        """Return the tour of all True cells."""
        cells, order = in_covering_square(mask, self.name)
        return _along(moore_encode(cells, order=order), mask, closed=True, name=self.name)


def in_covering_square(mask: NDArray[np.bool_], name: str) -> tuple[NDArray[np.int64], int]:
    """Return the True cells as positions in the smallest covering square or cube of 2^order cells per side, and the order.

    Raises
    ------
    InvalidInputError
        If no curve with 64-bit indices covers the cells.
    """
    low, region = smallest_part(mask)
    order = (max(region.shape) - 1).bit_length()
    if order > MAX_ORDER[mask.ndim]:
        longest = 2 ** MAX_ORDER[mask.ndim]
        raise InvalidInputError(f"tour {name}: expected at most {longest} cells along each side, got shape {mask.shape}")
    cells = np.argwhere(mask) - low
    cells[:, -2] += 2**order - region.shape[-2]  # rows count from the top, but the curve begins at the bottom
    return cells, order


def _along(indices: NDArray[np.int64], mask: NDArray[np.bool_], *, closed: bool, name: str) -> Tour:
    cells = np.argwhere(mask)[np.argsort(indices)]
    return Tour(component_after_component(cells, mask), mask.shape, closed=closed, name=name)
