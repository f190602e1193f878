"""A region cut along the lines of a square grid: whole cells by the block, cells on the border with their exact shape."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.dataclass import dataclass

_WHOLE = 1e-9  # of a block: what is missing of it by rounding
SPECK = 1e-9  # of a cell's area: what is smaller is rounding, not region


@dataclass(frozen=True, eq=False)
class Lattice:
    """The lines of a square grid.

    Parameters
    ----------
    left, top : float
        Of the top left corner, metres.
    size : float
        Side of a cell, metres.
    shape : tuple of int
        Rows and columns.
    """

    left: float
    top: float
    size: float
    shape: tuple[int, int]

    def boxes(self, rows: NDArray[np.int64], cols: NDArray[np.int64], span: int = 1) -> Any:
        """Return blocks of ``span`` times ``span`` cells as Shapely boxes; a line has the same coordinate in all of them."""
        import shapely

        return shapely.box(
            self.left + cols * self.size,
            self.top - (rows + span) * self.size,
            self.left + (cols + span) * self.size,
            self.top - rows * self.size,
        )

    def centers(self, rows: NDArray[np.int64], cols: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the centres of cells; float64, shape (n, 2)."""
        return np.stack([self.left + (cols + 0.5) * self.size, self.top - (rows + 0.5) * self.size], axis=-1)


@dataclass(frozen=True, eq=False)
class Clipped:
    """A region on a lattice.

    Parameters
    ----------
    whole : ndarray of bool, shape (H, W)
        Cells that lie wholly inside.
    rows, cols : ndarray of int64, shape (n,)
        The cell of each piece; a cell on the border has one piece or several.
    pieces : ndarray of Shapely polygons, shape (n,)
        The connected pieces of the region in cells on the border.
    """

    whole: NDArray[np.bool_]
    rows: NDArray[np.int64]
    cols: NDArray[np.int64]
    pieces: Any


def clip_to_cells(area: Any, lattice: Lattice) -> Clipped:
    """Cut a polygon along a lattice.

    Blocks are cut into quarters, each with what its parent kept of the polygon, so that no cell looks at the whole outline, and a
    block wholly inside is done at once: the work grows with the border, not with the area.
    """
    import shapely

    height, width = lattice.shape
    whole = np.zeros(lattice.shape, dtype=np.bool_)
    span = 1 << (max(height, width) - 1).bit_length()
    rows, cols = np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64)
    shapes = np.array([area], dtype=object)
    while True:
        boxes = lattice.boxes(rows, cols, span)
        shapes = _polygonal(shapely.intersection(shapes, boxes))
        areas, full = shapely.area(shapes), shapely.area(boxes)
        inside = (shapely.get_num_coordinates(shapes) == 5) & (areas >= full * (1 - _WHOLE))
        for row, col in zip(rows[inside].tolist(), cols[inside].tolist(), strict=True):
            whole[row : row + span, col : col + span] = True
        left = ~inside & (areas > SPECK * lattice.size**2)
        rows, cols, shapes = rows[left], cols[left], shapes[left]
        if span == 1:
            break
        span //= 2
        rows = np.concatenate([rows, rows, rows + span, rows + span])
        cols = np.concatenate([cols, cols + span, cols, cols + span])
        shapes = np.concatenate([shapes] * 4)
        there = (rows < height) & (cols < width)
        rows, cols, shapes = rows[there], cols[there], shapes[there]
    pieces, index = shapely.get_parts(shapes, return_index=True)
    kept = shapely.area(pieces) > SPECK * lattice.size**2
    order = np.argsort(rows[index][kept] * width + cols[index][kept], kind="stable")
    return Clipped(whole, rows[index][kept][order], cols[index][kept][order], pieces[kept][order])


def _polygonal(shapes: Any) -> Any:
    """Return shapes without the lines and points where a region only touches a block."""
    import shapely

    kinds = shapely.get_type_id(shapes)
    shapes = np.where((kinds == 3) | (kinds == 6) | (kinds == 7), shapes, shapely.Polygon())
    for k in np.flatnonzero(kinds == 7):  # a collection
        parts = shapely.get_parts(shapes[k])
        shapes[k] = shapely.MultiPolygon([part for part in parts if part.geom_type == "Polygon"])
    return shapes
