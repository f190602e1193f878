"""Tours along the Hilbert curve and along the Moore curve."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.search.tours.base import TOURS, TourByOrder
from shoal.search.tours.codec import MAX_ORDER, hilbert_encode, moore_encode


@TOURS.register("hilbert")
class HilbertTour(TourByOrder):
    """The Hilbert curve through the smallest square that contains all cells and whose side is a power of 2.

    The lower left corner of the square is the lower left corner of the cells' bounding box. In 3 dimensions, the square is a cube.

    As in paper H, the tour is closed: it continues from its last cell to its first cell. In a full square, the step from the last
    cell to the first cell is one cell side shorter than a side of the square. If the cells do not fill the square, the tour keeps
    the order of the curve, and some steps cross positions without a cell.
    """

    name = "hilbert"
    dimensions: tuple[int, ...] = (2, 3)
    encode = staticmethod(hilbert_encode)

    def _in_order(self, region: NDArray[np.bool_]) -> NDArray[np.int64]:
        order = (max(region.shape) - 1).bit_length()
        if order > MAX_ORDER[region.ndim]:
            longest = 2 ** MAX_ORDER[region.ndim]
            raise InvalidInputError(f"tour {self.name}: expected at most {longest} cells along each side, got shape {region.shape}")
        cells = np.argwhere(region)
        of_square = cells.copy()
        of_square[:, -2] += 2**order - region.shape[-2]  # rows count from the top, but the curve begins at the bottom
        return cells[np.argsort(self.encode(of_square, order=order))]


@TOURS.register("open-hilbert")
class OpenHilbertTour(HilbertTour):
    """The Hilbert curve as an open path, for comparisons with closed tours: it has no way back from its end to its start."""

    name = "open-hilbert"
    closed = False


@TOURS.register("moore")
class MooreTour(HilbertTour):
    """The Moore curve through the smallest square that contains all cells and whose side is a power of 2.

    The Moore curve consists of four Hilbert curves, closed by one step.
    """

    name = "moore"
    dimensions: tuple[int, ...] = (2,)
    encode = staticmethod(moore_encode)
