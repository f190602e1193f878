"""The lattice of a grid at any angle, the pieces into which the border of a region cuts its cells,
and the portals between neighbouring pieces.
"""

from __future__ import annotations

from collections import defaultdict
from itertools import product
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.regions.outline import Points

MAX_CELLS = 4_000_000
SPECK = 1e-9  # relative to a cell's area: smaller pieces are rounding errors
_WHOLE = 1e-9  # relative to a block: area that rounding may remove
# numbers of boxes and of corners below which it is not worth while to divide further
_ON_LINE = 1e-8  # relative to a cell: distance from a grid line that rounding may cause


@dataclass(frozen=True, eq=False)
class Lattice:
    """A grid of square cells. In the coordinate frame of the lattice, the rows of cells are
    parallel to the x axis.

    Parameters
    ----------
    left, top : float
        Coordinates of the lattice's top left corner in the lattice's frame, in metres.
    size : float
        Side of a cell in metres.
    shape : tuple of int
        Number of rows and number of columns.
    angle : float
        Angle of the rows of cells in degrees, counter-clockwise from the region's x axis.
    """

    left: float
    top: float
    size: float
    shape: tuple[int, int]
    angle: float = 0.0

    def to_region(self, points: ArrayLike) -> NDArray[np.float64]:
        """Transform points from the lattice's frame to the region's frame; float64,
        shape (..., 2).
        """
        return rotate(points, self.angle)

    def from_region(self, points: ArrayLike) -> NDArray[np.float64]:
        """Transform points from the region's frame to the lattice's frame; float64,
        shape (..., 2).
        """
        return rotate(points, -self.angle)

    def boxes(self, rows: NDArray[np.int64], cols: NDArray[np.int64], span: int = 1) -> Any:
        """Return blocks of ``span`` rows and ``span`` columns as Shapely boxes in the lattice's
        frame.

        The arguments ``rows`` and ``cols`` give the top left cell of each block. Neighbouring boxes
        have exactly equal coordinates on their common side.
        """
        import shapely

        return shapely.box(
            self.left + cols * self.size,
            self.top - (rows + span) * self.size,
            self.left + (cols + span) * self.size,
            self.top - rows * self.size,
        )

    def centers(self, rows: NDArray[np.int64], cols: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the centres of cells in the lattice's frame, in metres; float64, shape (n, 2)."""
        return np.stack(
            [self.left + (cols + 0.5) * self.size, self.top - (rows + 0.5) * self.size], axis=-1
        )

    def cells_at(self, points: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the row and the column of the cell at each point of the lattice's frame; int64,
        shapes (n,). Beside the lattice, they lie outside its shape.
        """
        cols = np.floor((points[..., 0] - self.left) / self.size).astype(np.int64)
        rows = np.floor((self.top - points[..., 1]) / self.size).astype(np.int64)
        return rows, cols


def rotate(points: ArrayLike, angle: float) -> NDArray[np.float64]:
    """Rotate points about the origin, by an angle in degrees counter-clockwise; float64, shape
    (..., 2).

    Examples
    --------
    >>> rotate([(2.0, 1.0)], 90).tolist()
    [[-1.0, 2.0]]
    """
    array = np.asarray(points, dtype=np.float64)
    if angle == 0:
        return array
    quarters, remainder = divmod(angle, 90.0)  # makes quarter turns exact
    cosine, sine = np.cos(np.radians(remainder)), np.sin(np.radians(remainder))
    for _ in range(int(quarters) % 4):
        cosine, sine = -sine, cosine
    complex_points = np.ascontiguousarray(array).view(np.complex128) * complex(cosine, sine)
    return np.asarray(complex_points.view(np.float64))


def rotate_shape(shape: Any, angle: float) -> Any:
    """Rotate a Shapely geometry about the origin, by an angle in degrees counter-clockwise."""
    import shapely

    return shape if angle == 0 else shapely.transform(shape, lambda points: rotate(points, angle))


def lattice_over(
    area: Any, size: float, angle: float = 0.0, offset: tuple[float, float] = (0.0, 0.0)
) -> Lattice:
    """Return a lattice that covers a polygon.

    Parameters
    ----------
    area : Shapely geometry
        The polygon in the lattice's frame, in metres.
    size : float
        Side of a cell in metres.
    angle, offset
        Angle and shift of the lattice, as in `shoal.search.cells_of`.

    Raises
    ------
    InvalidInputError
        If the lattice has more than 4 million cells.
    """
    left, low, right, high = area.bounds
    if (right - left) / size * ((high - low) / size) > 4 * MAX_CELLS or max(
        right - left, high - low
    ) / size > 4 * MAX_CELLS:
        cols = rows = 0
    else:
        # If rounding makes a side slightly longer than whole cells, no further cell is added.
        sides = zip((right - left, high - low), offset, strict=True)
        cols, rows = (max(1, ceil(length / size - 1e-9)) + (shift > 0) for length, shift in sides)
    if not 0 < rows * cols <= MAX_CELLS:
        least = np.sqrt((right - left) * (high - low) / MAX_CELLS)
        raise InvalidInputError(
            f"footprint: expected at most {MAX_CELLS} cells, got {(right - left) / size:.0f} times"
            f" {(high - low) / size:.0f} cells of {size:g} m; a region of {right - left:.4g} m by"
            f" {high - low:.4g} m needs about {least:.2g} m or more"
        )
    corner = (left + right - cols * size) / 2, (low + high + rows * size) / 2
    # A shifted lattice has one more row and column, half of which lies on each side.
    right_by, up_by = ((shift - 0.5) * size if shift > 0 else 0.0 for shift in offset)
    return Lattice(corner[0] + right_by, corner[1] + up_by, size, (rows, cols), angle)


@dataclass(frozen=True, eq=False)
class Clipped:
    """A region cut along the lines of a lattice, in the lattice's frame.

    Parameters
    ----------
    whole : ndarray of bool, shape (H, W)
        Whether each cell lies entirely inside the region.
    rows, cols : ndarray of int64, shape (n,)
        Row and column of the cell that contains each piece. A cell on the border of the region has
        one or several pieces.
    pieces : ndarray of Shapely polygons, shape (n,)
        Connected parts of the region, each in one cell on the border of the region.
    """

    whole: NDArray[np.bool_]
    rows: NDArray[np.int64]
    cols: NDArray[np.int64]
    pieces: Any


def clip_to_cells(area: Any, lattice: Lattice) -> Clipped:
    """Cut a polygon, which is given in the lattice's frame, along the lines of the lattice.

    The function divides blocks of cells recursively into quarters, and cuts the polygon into the
    same quarters. Because the function does not divide blocks inside the polygon, the computing
    time grows with the length of the polygon's border, not with the polygon's area.
    """
    import shapely

    height, width = lattice.shape
    whole = np.zeros(lattice.shape, dtype=np.bool_)
    span = 1 << (max(height, width) - 1).bit_length()
    rows, cols = np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64)
    shapes = np.array([area], dtype=object)
    shapely.prepare(area)
    while True:
        boxes = lattice.boxes(rows, cols, span)
        # whether most blocks are inside is asked at once; to cut them would only tell the same
        inside = shapely.contains_properly(area, boxes)
        cut = np.flatnonzero(~inside)
        shapes[cut] = _keep_polygons(shapely.intersection(shapes[cut], boxes[cut]))
        areas, full = shapely.area(shapes[cut]), shapely.area(boxes[cut])
        inside[cut] = (shapely.get_num_coordinates(shapes[cut]) == 5) & (
            areas >= full * (1 - _WHOLE)
        )
        for row, col in zip(rows[inside].tolist(), cols[inside].tolist(), strict=True):
            whole[row : row + span, col : col + span] = True
        partial = cut[~inside[cut] & (areas > SPECK * lattice.size**2)]
        rows, cols, shapes = rows[partial], cols[partial], shapes[partial]
        if span == 1:
            break
        span //= 2
        rows = np.concatenate([rows, rows, rows + span, rows + span])
        cols = np.concatenate([cols, cols + span, cols, cols + span])
        shapes = np.concatenate([shapes] * 4)
        in_lattice = (rows < height) & (cols < width)
        rows, cols, shapes = rows[in_lattice], cols[in_lattice], shapes[in_lattice]
    pieces, index = shapely.get_parts(shapes, return_index=True)
    large = shapely.area(pieces) > SPECK * lattice.size**2
    order = np.argsort(rows[index][large] * width + cols[index][large], kind="stable")
    return Clipped(
        whole, rows[index][large][order], cols[index][large][order], pieces[large][order]
    )


def with_centers_free(clipped: Clipped, lattice: Lattice, free: Any) -> Clipped:
    """Return a clipped region in which a cell is a piece, not a whole cell, if robots may not be at
    the centre of the cell.

    The argument ``free`` is the area where robots may be, in the lattice's frame. If ``free`` is
    None, robots may be in the whole region.
    """
    import shapely

    if free is None:
        return clipped
    rows, cols = np.nonzero(clipped.whole)
    shapely.prepare(free)
    barred = ~shapely.intersects_xy(free, *lattice.centers(rows, cols).T)
    rows, cols = rows[barred], cols[barred]
    whole = clipped.whole.copy()
    whole[rows, cols] = False
    rows, cols = np.concatenate([clipped.rows, rows]), np.concatenate([clipped.cols, cols])
    pieces = np.concatenate(
        [clipped.pieces, lattice.boxes(rows[len(clipped.rows) :], cols[len(clipped.cols) :])]
    )
    order = np.argsort(rows * lattice.shape[1] + cols, kind="stable")
    return Clipped(whole, rows[order], cols[order], pieces[order])


def _keep_polygons(shapes: Any) -> Any:
    """Return the polygons in each shape, without lines and points.

    The intersection of a region and a block also contains lines or points where the region only
    touches the block.
    """
    import shapely

    kinds = shapely.get_type_id(shapes)
    shapes = np.where((kinds == 3) | (kinds == 6) | (kinds == 7), shapes, shapely.Polygon())
    for k in np.flatnonzero(kinds == 7):  # a collection
        parts = shapely.get_parts(shapes[k])
        shapes[k] = shapely.MultiPolygon([part for part in parts if part.geom_type == "Polygon"])
    return shapes


def own_piece(
    clipped: Clipped, lattice: Lattice, own: NDArray[np.int64], cell: tuple[int, int]
) -> Any:
    """Return the own piece of a cell (row, column) as a Shapely geometry in the lattice's frame.

    The argument ``own`` gives the number of each cell's own piece, as in `CellGrid`.
    """
    if clipped.whole[cell]:
        return lattice.boxes(np.array([cell[0]]), np.array([cell[1]]))[0]
    return clipped.pieces[own[cell]]


@dataclass(frozen=True, eq=False)
class Portals:
    """All portals between two pieces of cells, and all portals between a piece and a whole cell.

    A whole cell lies entirely inside the region. The region's border divides all cells on the
    border into pieces.

    The number of a piece is its index in `Clipped.pieces`. The number of a whole cell is its flat
    index in the grid plus ``len(Clipped.pieces)``.

    Parameters
    ----------
    pairs : ndarray of int64, shape (g, 2)
        The numbers of the two pieces or whole cells that each portal connects.
    middles : ndarray of float64, shape (g, 2)
        Midpoint of each portal in metres.
    widths : ndarray of float64, shape (g,)
        Width of each portal in metres.
    """

    pairs: NDArray[np.int64]
    middles: Points
    widths: NDArray[np.float64]


def portals_of(clipped: Clipped, lattice: Lattice) -> Portals:
    """Return all portals between two pieces of a clipped region, and all portals between a piece
    and a whole cell.
    """
    portals = [
        portal
        for axis in (0, 1)
        for portal in _match_stretches(_stretches(clipped, lattice, axis), clipped, lattice, axis)
    ]
    pairs = np.array([portal[:2] for portal in portals], dtype=np.int64).reshape(-1, 2)
    middles = lattice.to_region(np.array([portal[2:4] for portal in portals]).reshape(-1, 2))
    return Portals(pairs, middles, np.array([portal[4] for portal in portals]))


# row and column of the cell after the line; before (0) or after (1); piece; from, to
Stretch = tuple[int, int, int, int, float, float]


def _segments(clipped: Clipped) -> tuple[Points, Points, NDArray[np.int64]]:
    """Return the sides of all pieces as three arrays: start points, end points, and indices of the
    pieces.
    """
    import shapely

    rings, ring_piece = shapely.get_rings(clipped.pieces, return_index=True)
    points, ring = shapely.get_coordinates(rings, return_index=True)
    same = ring[1:] == ring[:-1]
    return points[:-1][same], points[1:][same], ring_piece[ring[:-1][same]]


def _stretches(clipped: Clipped, lattice: Lattice, axis: int) -> list[Stretch]:
    """Return the sides of pieces that lie on grid lines. Axis 0 means vertical lines, and axis 1
    means horizontal lines.
    """
    start, end, piece = _segments(clipped)
    stretches: list[Stretch] = []
    for shift in (0, 1):
        if axis == 0:
            line = lattice.left + (clipped.cols[piece] + shift) * lattice.size
        else:
            line = lattice.top - (clipped.rows[piece] + shift) * lattice.size
        on = (
            np.maximum(np.abs(start[:, axis] - line), np.abs(end[:, axis] - line))
            <= _ON_LINE * lattice.size
        )
        along, of = 1 - axis, piece[on]
        low, high = (
            np.minimum(start[on, along], end[on, along]),
            np.maximum(start[on, along], end[on, along]),
        )
        rows, cols = clipped.rows[of] + shift * axis, clipped.cols[of] + shift * along
        columns = (rows, cols, np.full(len(of), 1 - shift), of, low, high)
        stretches += zip(*(column.tolist() for column in columns), strict=True)
    return stretches


def _match_stretches(
    stretches: list[Stretch], clipped: Clipped, lattice: Lattice, axis: int
) -> list[tuple[int, int, float, float, float]]:
    """Return a portal for each section of a grid line that two pieces, one on each side of the
    line, have in common.
    """
    width = lattice.shape[1]
    lines: dict[tuple[int, int], tuple[list[Stretch], list[Stretch]]] = defaultdict(
        lambda: ([], [])
    )
    for stretch in stretches:
        lines[stretch[:2]][stretch[2]].append(stretch)
    portals = []
    for (row, col), (before, after) in lines.items():
        for (r, c), side in (((row - axis, col - 1 + axis), before), ((row, col), after)):
            if 0 <= r < lattice.shape[0] and 0 <= c < width and clipped.whole[r, c]:
                side.append((row, col, 0, len(clipped.pieces) + r * width + c, -np.inf, np.inf))
        across = (
            lattice.left + col * lattice.size if axis == 0 else lattice.top - row * lattice.size
        )
        for first, second in product(before, after):
            low, high = max(first[4], second[4]), min(first[5], second[5])
            if high - low > _ON_LINE * lattice.size:
                middle = (low + high) / 2
                portals.append(
                    (
                        first[3],
                        second[3],
                        *((across, middle) if axis == 0 else (middle, across)),
                        high - low,
                    )
                )
    return portals
