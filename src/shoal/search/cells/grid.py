"""The cells of a region: a grid at any angle, cells cut by the border, their portals, and the
footprint that sees them.
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Sequence
from functools import cached_property
from itertools import product
from math import ceil
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_number
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.regions.margin import visible_region
from shoal.search.regions.outline import Points, check_plane_points
from shoal.search.regions.region import SearchRegion
from shoal.search.tours import Tour

MAX_CELLS = 4_000_000
_WHOLE = 1e-9  # relative to a block: area that rounding may remove
SPECK = 1e-9  # relative to a cell's area: smaller pieces are rounding errors


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
        return rotated(points, self.angle)

    def from_region(self, points: ArrayLike) -> NDArray[np.float64]:
        """Transform points from the region's frame to the lattice's frame; float64,
        shape (..., 2).
        """
        return rotated(points, -self.angle)

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


def rotated(points: ArrayLike, angle: float) -> NDArray[np.float64]:
    """Rotate points about the origin, by an angle in degrees counter-clockwise; float64, shape
    (..., 2).

    Examples
    --------
    >>> rotated([(2.0, 1.0)], 90).tolist()
    [[-1.0, 2.0]]
    """
    array = np.asarray(points, dtype=np.float64)
    if angle == 0:
        return array
    quarters, rest = divmod(angle, 90.0)  # makes quarter turns exact
    cosine, sine = np.cos(np.radians(rest)), np.sin(np.radians(rest))
    for _ in range(int(quarters) % 4):
        cosine, sine = -sine, cosine
    turned = np.ascontiguousarray(array).view(np.complex128) * complex(cosine, sine)
    return np.asarray(turned.view(np.float64))


def rotated_shape(shape: Any, angle: float) -> Any:
    """Rotate a Shapely geometry about the origin, by an angle in degrees counter-clockwise."""
    import shapely

    return shape if angle == 0 else shapely.transform(shape, lambda points: rotated(points, angle))


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


def _polygonal(shapes: Any) -> Any:
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


_ON_LINE = 1e-8  # relative to a cell: distance from a grid line that rounding may cause


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
    found = [
        portal
        for axis in (0, 1)
        for portal in _matched(_stretches(clipped, lattice, axis), clipped, lattice, axis)
    ]
    pairs = np.array([portal[:2] for portal in found], dtype=np.int64).reshape(-1, 2)
    middles = lattice.to_region(np.array([portal[2:4] for portal in found]).reshape(-1, 2))
    return Portals(pairs, middles, np.array([portal[4] for portal in found]))


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
    found: list[Stretch] = []
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
        found += zip(*(column.tolist() for column in columns), strict=True)
    return found


def _matched(
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
    found = []
    for (row, col), (before, after) in lines.items():
        for (r, c), side in (((row - axis, col - 1 + axis), before), ((row, col), after)):
            if 0 <= r < lattice.shape[0] and 0 <= c < width and clipped.whole[r, c]:
                side.append((row, col, 0, len(clipped.pieces) + r * width + c, -np.inf, np.inf))
        across = (
            lattice.left + col * lattice.size if axis == 0 else lattice.top - row * lattice.size
        )
        for one, other in product(before, after):
            low, high = max(one[4], other[4]), min(one[5], other[5])
            if high - low > _ON_LINE * lattice.size:
                middle = (low + high) / 2
                found.append(
                    (
                        one[3],
                        other[3],
                        *((across, middle) if axis == 0 else (middle, across)),
                        high - low,
                    )
                )
    return found


_HAIR = 1e-9  # relative to a footprint
# maximum number of viewpoints of a piece before the vehicle follows the border of the free area
# instead
_MOST = 3


def viewpoints_on_rows(
    clipped: Clipped,
    lattice: Lattice,
    own: NDArray[np.int64],
    *,
    footprint: float,
    free: Any = None,
) -> Any:
    """Return, for each piece, a point from which the whole piece is visible, on the centre line of
    its row of cells.

    The viewpoint of a piece may lie in the previous or the next cell of the row. Of several
    possible points, the function chooses the point farthest towards the neighbouring cell that
    contains more of the region. If both neighbouring cells contain equally large areas of the
    region, the function chooses the point nearest to the centre of the piece's cell.

    Parameters
    ----------
    clipped : Clipped
    lattice : Lattice
    own : ndarray of int64, shape (H, W)
        Number of each cell's own piece, as in `CellGrid`.
    footprint : float
        Side of the footprint in metres.
    free : Shapely geometry, optional
        The area in which robots may be. By default, robots may be in the whole region.

    Returns
    -------
    list of (ndarray of float64, shape (1, 2)) or None
        One viewpoint for each piece, in the lattice's frame. A piece gets None if no point of the
        centre line sees the whole piece.
    """
    import shapely

    bounds, half = shapely.bounds(clipped.pieces).reshape(-1, 4), footprint / 2
    least, most = bounds[:, 2] - half, bounds[:, 0] + half
    asked = np.flatnonzero(most >= least)
    found: list[Points | None] = [None] * len(clipped.pieces)
    if not len(asked):
        return found
    least, most = least[asked], np.maximum(most[asked], least[asked] + _HAIR)
    x, y = lattice.centers(clipped.rows[asked], clipped.cols[asked]).T
    rooms = np.stack(
        [clipped.pieces[asked], *(_beside(clipped, lattice, own, asked, step) for step in (-1, 1))],
        axis=1,
    )
    parts, of = shapely.get_parts(shapely.union_all(rooms, axis=1), return_index=True)
    order = np.lexsort(
        (shapely.distance(parts, shapely.point_on_surface(clipped.pieces[asked])[of]), of)
    )
    room = parts[order[np.searchsorted(of[order], np.arange(len(asked)))]]
    ends = np.stack([np.stack([least, y], axis=1), np.stack([most, y], axis=1)], axis=1)
    lines = shapely.intersection(room, shapely.linestrings(ends))
    lines = lines if free is None else shapely.intersection(lines, free)
    places, of = shapely.get_coordinates(lines, return_index=True)
    begins = np.searchsorted(of, np.arange(len(asked) + 1))
    before, after = np.nan_to_num(shapely.area(rooms[:, 1:])).T
    for k, number in enumerate(asked.tolist()):
        among = places[begins[k] : begins[k + 1], 0]
        if len(among):
            best = among[np.argmin(np.abs(among - x[k]))]
            best = (
                among.min()
                if before[k] > after[k]
                else among.max()
                if after[k] > before[k]
                else best
            )
            found[number] = np.array([[best, y[k]]])
    return found


def _beside(
    clipped: Clipped,
    lattice: Lattice,
    own: NDArray[np.int64],
    numbers: NDArray[np.int64],
    step: int,
) -> Any:
    """Return, for each given piece, the own piece of the cell ``step`` columns away, or None;
    Shapely geometries, shape (n,).
    """
    rows, cols = clipped.rows[numbers], clipped.cols[numbers] + step
    there = np.flatnonzero((cols >= 0) & (cols < lattice.shape[1]))
    there = there[own[rows[there], cols[there]] >= 0]
    whole = clipped.whole[rows[there], cols[there]]
    full, cut = there[whole], there[~whole]
    rooms = np.full(len(numbers), None, dtype=object)
    rooms[full] = lattice.boxes(rows[full], cols[full])
    rooms[cut] = clipped.pieces[own[rows[cut], cols[cut]]]
    return rooms


def own_piece(
    clipped: Clipped, lattice: Lattice, own: NDArray[np.int64], cell: tuple[int, int]
) -> Any:
    """Return the own piece of a cell (row, column) as a Shapely geometry in the lattice's frame.

    The argument ``own`` gives the number of each cell's own piece, as in `CellGrid`.
    """
    if clipped.whole[cell]:
        return lattice.boxes(np.array([cell[0]]), np.array([cell[1]]))[0]
    return clipped.pieces[own[cell]]


def viewpoints_of(
    pieces: Any,
    centers: Points,
    *,
    footprint: float,
    size: float,
    known: Sequence[Points | None] = (),
    free: Any = None,
) -> tuple[Points, NDArray[np.int64]]:
    """Return, for each piece, one or several viewpoints from which the whole piece is visible.

    If a piece contains the centre of its cell, this centre is the viewpoint of the piece. For any
    other piece, the viewpoint is a point from which the whole piece is visible, as near to the
    centre as possible. If no point sees the whole piece, the piece gets several viewpoints.

    Parameters
    ----------
    pieces : ndarray of Shapely polygons, shape (n,)
        The pieces in the lattice's frame, each inside a square of side ``size``.
    centers : ndarray of float64, shape (n, 2)
        Centre of each piece's cell in the lattice's frame.
    footprint, size : float
        Side of the footprint and side of a cell in metres. The cell must not be larger than the
        footprint.
    known : sequence of (ndarray of float64, shape (k, 2)) or None
        Viewpoints found by `viewpoints_on_rows`, for pieces that do not contain the centre of their
        cell.
    free : Shapely geometry, optional
        The area where robots may be. If ``free`` is given, all viewpoints lie in ``free``, inside
        or beside their piece.

    Returns
    -------
    points : ndarray of float64, shape (k, 2)
        The viewpoints in the lattice's frame.
    index : ndarray of int64, shape (k,)
        Number of the piece that belongs to each viewpoint, in increasing order.
    """
    import shapely

    from_center = shapely.intersects_xy(pieces, centers[:, 0], centers[:, 1])
    if free is not None:
        shapely.prepare(free)
        from_center &= shapely.intersects_xy(free, centers[:, 0], centers[:, 1])
    places = [
        centers[k : k + 1] if easy else known[k] if known else None
        for k, easy in enumerate(from_center.tolist())
    ]
    speck = SPECK * size * size
    hard = [k for k, place in enumerate(places) if place is None]
    if free is None and hard:
        for k, place in zip(
            hard, _single(pieces[hard], centers[hard], footprint / 2, speck), strict=True
        ):
            places[k] = place
    found = [
        _viewpoints(pieces[k], free, centers[k], footprint, speck) if place is None else place
        for k, place in enumerate(places)
    ]
    counts = [len(points) for points in found]
    points = np.concatenate(found) if found else np.zeros((0, 2))
    return points, np.repeat(np.arange(len(found)), counts)


def _single(pieces: Any, centers: Points, half: float, speck: float) -> list[Points | None]:
    """Return, for each piece, the viewpoint in the piece that sees the whole piece and is nearest
    to the centre, or None.
    """
    import shapely

    low, high = np.split(shapely.bounds(pieces), 2, axis=1)
    hair = 2 * _HAIR * half
    least, most = (
        np.minimum(high - half, low + half) - hair,
        np.maximum(high - half, low + half) + hair,
    )
    among = shapely.intersection(pieces, shapely.box(*least.T, *most.T))
    lines = shapely.shortest_line(among, shapely.points(centers))
    there = np.flatnonzero(~shapely.is_missing(lines) & (high - low <= 2 * half + hair).all(axis=1))
    points = shapely.get_coordinates(lines[there])[::2]
    left = shapely.area(
        shapely.difference(pieces[there], shapely.box(*(points - half).T, *(points + half).T))
    )
    found: list[Points | None] = [None] * len(pieces)
    for k, place in zip(there[left <= speck].tolist(), points[left <= speck], strict=True):
        found[k] = place[None]
    return found


def _viewpoints(piece: Any, free: Any, center: Points, footprint: float, speck: float) -> Points:
    """Return points from which, together, a whole piece is visible.

    The points lie inside the piece. If robots may only be in ``free``, the points lie in ``free``,
    inside or beside the piece.
    """
    half = footprint / 2
    if free is None:
        return _within(piece, piece, center, half, speck)[0]
    room = _around(free, piece, half)
    places, left = _within(piece, room, center, half, speck, most=_MOST)
    if left.area <= speck:
        return places
    # A robot sees the rest while it follows the border of the free area. From single points on a
    # slanted border, it would not.
    return np.concatenate([places, *_lines(_around(free.boundary, left, half))])


def _lines(shape: Any) -> list[Points]:
    """Return the points of each line of a Shapely geometry, line by line."""
    import shapely

    lines = [
        part
        for part in shapely.get_parts(shapely.line_merge(shape))
        if part.geom_type == "LineString"
    ]
    return [shapely.get_coordinates(line) for line in lines]


def _around(shape: Any, piece: Any, half: float) -> Any:
    """Return the points of a shape from which a robot's footprint overlaps a piece, as a Shapely
    geometry.
    """
    import shapely

    low, high = np.reshape(piece.bounds, (2, 2))
    return shapely.intersection(shape, shapely.box(*(low - half), *(high + half)))


def _square(place: Points, half: float) -> Any:
    import shapely

    return shapely.box(*(place - half), *(place + half))


def _within(
    piece: Any, room: Any, center: Points, half: float, speck: float, most: float = np.inf
) -> tuple[Points, Any]:
    """Return at most ``most`` viewpoints in ``room`` for a piece, and the part of the piece that no
    viewpoint sees.
    """
    import shapely

    chosen: list[Points] = []
    left, near = piece, center
    while left.area > speck and len(chosen) < most:
        place = _from_one(room, left, near, half)
        if place is None:
            # A point of the remaining part sees at least its own surroundings, so the loop ends.
            part = max(shapely.get_parts(left), key=lambda shape: float(shape.area))
            low, high = np.reshape(left.bounds, (2, 2))
            place = _nearest(part if chosen else piece, near if not chosen else (low + high) / 2)
            place = place if room is piece else _nearest(room, place)
        chosen.append(place)
        left = left.difference(_square(place, half))
        near = place
    return np.array(chosen).reshape(-1, 2), left


def _from_one(room: Any, left: Any, near: Points, half: float) -> Points | None:
    """Return, among all points of ``room`` that see the whole part ``left`` of a piece, the point
    nearest to ``near``.

    If no point sees the whole part ``left``, the result is None.
    """
    import shapely

    low, high = np.reshape(left.bounds, (2, 2))
    least, most, hair = high - half, low + half, 2 * _HAIR * half
    if (least > most + hair).any():
        return None
    among = room.intersection(
        shapely.box(*(np.minimum(least, most) - hair), *(np.maximum(least, most) + hair))
    )
    return None if among.is_empty else _nearest(among, near)


def _nearest(shape: Any, point: Points) -> Points:
    import shapely

    line = shapely.shortest_line(shape, shapely.points(point))
    return np.asarray(shapely.get_coordinates(line)[0])


@dataclass(frozen=True, eq=False)
class CellGrid:
    """The cells of a region. The function `cells_of` creates a `CellGrid`.

    The border of the region may divide a cell into several pieces. Portals connect neighbouring
    pieces. The largest piece of a cell is called the cell's own piece. Any other piece is assigned
    to the cell whose own piece is the fewest portals away, so that no robot has to drive around a
    wall to see the piece.

    Parameters
    ----------
    region : SearchRegion
        The region, whose attribute ``area`` is the area that robots can see.
    footprint : float
        Side in metres of the square that a robot sees, which is centred on the robot and parallel
        to the rows of cells.
    mask : ndarray of bool, shape (H, W)
        Whether each cell contains a part of the region, with row 0 on top.
    lattice : Lattice
        Position, size and angle of the cells.
    clipped : Clipped
        The cells that lie entirely inside the region, and the pieces of the cells on the region's
        border.
    portals : Portals
        The openings through which a robot moves from piece to piece.
    viewpoints : ndarray of float64, shape (k, 2)
        Viewpoints in metres, sorted by cell, row by row. The viewpoints of one cell have the order
        in which a robot visits them.
    viewpoint_starts : ndarray of int64, shape (cells + 1,)
        Index of each cell's first viewpoint, followed by the number of all viewpoints.
    own : ndarray of int64, shape (H, W)
        Number of each cell's own piece, numbered as in `Portals`. Positions without a cell have the
        number -1.
    """

    region: SearchRegion
    footprint: float
    mask: NDArray[np.bool_]
    lattice: Lattice
    clipped: Clipped
    portals: Portals
    viewpoints: Points
    viewpoint_starts: NDArray[np.int64]
    own: NDArray[np.int64]

    @property
    def size(self) -> float:
        """Side of a cell in metres."""
        return self.lattice.size

    @property
    def corner(self) -> tuple[float, float]:
        """Coordinates (x, y) of the grid's top left corner in the lattice's frame, in metres."""
        return self.lattice.left, self.lattice.top

    @property
    def angle(self) -> float:
        """Angle of the rows of cells in degrees, counter-clockwise from the region's x axis."""
        return self.lattice.angle

    @cached_property
    def area(self) -> Any:
        """The region's area in the lattice's frame, as a Shapely geometry."""
        return rotated_shape(self.region.area, -self.angle)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and number of columns."""
        return self.lattice.shape

    @property
    def n_cells(self) -> int:
        """Number of cells that contain a part of the region."""
        return len(self.viewpoint_starts) - 1

    @cached_property
    def cells(self) -> NDArray[np.int64]:
        """The cells as pairs (row, column), sorted row by row; int64, shape (n_cells, 2)."""
        return np.argwhere(self.mask)

    @cached_property
    def _ordinal(self) -> NDArray[np.int64]:
        ordinal = np.full(self.shape, -1, dtype=np.int64)
        ordinal[self.mask] = np.arange(self.n_cells)
        return ordinal

    def waypoints(self) -> Points:
        """Return the first viewpoint of each cell in metres, in the order of `CellGrid.cells`;
        float64, shape (n_cells, 2).
        """
        return np.asarray(self.viewpoints[self.viewpoint_starts[:-1]])

    def ordinals(self, cells: ArrayLike) -> NDArray[np.int64]:
        """Return, for cells given as (row, column), their indices in `CellGrid.cells`; int64, shape
        (n,).

        Raises
        ------
        InvalidInputError
            If a cell contains no part of the region.
        """
        array = np.asarray(cells)
        if (
            array.ndim != 2
            or array.shape[1] != 2
            or not (array.size == 0 or np.issubdtype(array.dtype, np.integer))
        ):
            raise InvalidInputError(
                f"cells: expected integers of shape (n, 2), got {array.dtype} of shape"
                f" {array.shape}"
            )
        there = np.asarray(((array >= 0) & (array < self.shape)).all(axis=1))
        there[there] = self.mask[tuple(array[there].T)]
        if not there.all():
            index = int(np.argmin(there))
            raise InvalidInputError(
                f"cells: expected cells of the region, got {tuple(array[index].tolist())} at place"
                f" {index + 1}"
            )
        return np.asarray(self._ordinal[tuple(array.T)])

    def viewpoints_in(self, cell: tuple[int, int]) -> Points:
        """Return the viewpoints of one cell, in the order in which a robot visits them; float64,
        shape (k, 2), k >= 1.
        """
        index = int(self.ordinals(np.array([cell]))[0])
        return np.asarray(
            self.viewpoints[self.viewpoint_starts[index] : self.viewpoint_starts[index + 1]]
        )

    def waypoint(self, cell: tuple[int, int]) -> Points:
        """Return the first viewpoint of a cell in metres; float64, shape (2,).

        If a cell lies entirely inside the region, its first viewpoint is usually the centre of the
        cell.
        """
        return np.asarray(self.viewpoints_in(cell)[0])

    def cell_of(self, points: ArrayLike) -> NDArray[np.int64]:
        """Return the cell that contains each point, or the cell with the nearest viewpoint if no
        cell contains the point.

        Returns
        -------
        ndarray of int64, shape (n, 2)
        """
        array = check_plane_points(points, what="points")
        there = self.lattice.from_region(array)
        cols = np.floor((there[:, 0] - self.lattice.left) / self.size).astype(np.int64)
        rows = np.floor((self.lattice.top - there[:, 1]) / self.size).astype(np.int64)
        found = np.stack(
            [np.clip(rows, 0, self.shape[0] - 1), np.clip(cols, 0, self.shape[1] - 1)], axis=1
        )
        lost = ~self.mask[tuple(found.T)]
        if lost.any():
            from scipy.spatial import KDTree

            found[lost] = self.cells[KDTree(self.waypoints()).query(array[lost])[1]]
        return found

    @cached_property
    def components(self) -> NDArray[np.int64]:
        """For each cell, the index in `SearchRegion.parts` of the part that contains the cell;
        int64, shape (H, W).

        Positions without a cell have the index -1.
        """
        import shapely

        labels = np.where(self.mask, 0, -1)
        parts = self.region.parts
        if len(parts) > 1:
            points = self.waypoints()
            away = [shapely.distance(part, shapely.points(points)) for part in parts]
            labels[self.mask] = np.argmin(away, axis=0)
        return labels

    @cached_property
    def doors_east(self) -> NDArray[np.bool_]:
        """Whether a portal joins the own pieces of each cell and of the next cell in its row; bool,
        shape (H, W - 1).
        """
        return self._doors(0, 1)

    @cached_property
    def doors_south(self) -> NDArray[np.bool_]:
        """Whether a portal joins the own pieces of each cell and of the cell below; bool, shape (H
        - 1, W).
        """
        return self._doors(1, 0)

    def _doors(self, down: int, right: int) -> NDArray[np.bool_]:
        height, width = self.shape
        whole = self.clipped.whole
        doors = whole[: height - down, : width - right] & whole[down:, right:]
        if not doors.size:  # a grid of one row or one column: a step along it is no step across it
            return doors
        n, pairs = len(self.clipped.pieces), self.portals.pairs
        number = np.minimum(pairs, n - 1)
        flat = np.where(
            pairs < n, self.clipped.rows[number] * width + self.clipped.cols[number], pairs - n
        )
        both = (self.own.ravel()[flat] == pairs).all(axis=1) & (
            flat[:, 1] - flat[:, 0] == down * width + right
        )
        rows, cols = np.divmod(flat[both, 0], width)
        doors[rows, cols] = True
        return doors

    def __repr__(self) -> str:
        height, width = self.shape
        return (
            f"<CellGrid {height}x{width}, {self.n_cells} cells of {self.size:g} m,"
            f" {len(self.viewpoints)} viewpoints>"
        )


def cells_of(
    region: SearchRegion,
    footprint: float,
    *,
    size: float | None = None,
    angle: float = 0.0,
    offset: tuple[float, float] = (0.0, 0.0),
    on_rows: bool = False,
) -> CellGrid:
    """Divide a region into square cells for robots with a square footprint.

    Parameters
    ----------
    region : SearchRegion
    footprint : float
        Side in metres of the square that a robot sees. If the footprint is larger than the region,
        the grid has a single cell.
    size : float, optional
        Side of a cell in metres, at most the footprint. By default, cells are as large as the
        footprint. If the cells are smaller than the footprint, neighbouring footprints overlap.
    angle : float
        Angle of the rows of cells and of the footprint's sides, in degrees counter-clockwise from
        the x axis.
    offset : tuple of float
        Shift of the lattice in cell sides, from 0 to 1: along its rows, and upwards across its
        rows. A lattice without a shift is centred on the bounding box of the region.
    on_rows : bool
        Whether viewpoints of border cells lie on the centre lines of rows where possible.
        Viewpoints on centre lines save bends on tours that follow the rows.

    Returns
    -------
    CellGrid

    Raises
    ------
    InvalidInputError
        If the footprint is not a positive number, or the lattice would have more than 4 million
        cells.

    Examples
    --------
    >>> from shoal.search import open_region
    >>> grid = cells_of(open_region("rectangle:40x20"), 10)
    >>> grid
    <CellGrid 2x4, 8 cells of 10 m, 8 viewpoints>
    >>> grid.viewpoints_in((0, 0)).tolist()
    [[5.0, 15.0]]
    >>> grid.cell_of([(39.0, 1.0)]).tolist()
    [[1, 3]]
    """
    side = check_number(footprint, what="footprint", above=0)
    step = side if size is None else check_number(size, what="cell size", above=0)
    if step > side:
        raise InvalidInputError(
            f"cell size: expected at most the footprint, {side:g} m, got {step:g} m"
        )
    region = visible_region(region, side, angle)
    area = rotated_shape(region.area, -angle)
    free = rotated_shape(region.free, -angle) if region.restricted else None
    lattice = lattice_over(area, step, angle, offset)
    clipped = with_centers_free(clip_to_cells(area, lattice), lattice, free)
    portals = portals_of(clipped, lattice)
    mask = clipped.whole.copy()
    mask[clipped.rows, clipped.cols] = True
    if not mask.any():
        raise InvalidInputError(
            f"region {region.name!r}: expected an area above the rounding error in cells of"
            f" {step:g} m, got {region.area_m2:g} m2"
        )
    own = _own_pieces(clipped)
    centers = lattice.centers(clipped.rows, clipped.cols)
    known = viewpoints_on_rows(clipped, lattice, own, footprint=side, free=free) if on_rows else ()
    points, index = viewpoints_of(
        clipped.pieces, centers, footprint=side, size=step, known=known, free=free
    )
    adopted = _adopted(clipped, portals, own)
    viewpoints, starts = _in_order(clipped, lattice, mask, points, index, adopted)
    return CellGrid(
        region, side, mask, lattice, clipped, portals, lattice.to_region(viewpoints), starts, own
    )


def _own_pieces(clipped: Clipped) -> NDArray[np.int64]:
    """Return the number of each cell's own piece, numbered as in `Portals`; int64, shape (H, W)."""
    import shapely

    height, width = clipped.whole.shape
    own = np.where(
        clipped.whole, len(clipped.pieces) + np.arange(height * width).reshape(height, width), -1
    )
    order = np.argsort(shapely.area(clipped.pieces), kind="stable")
    own[clipped.rows[order], clipped.cols[order]] = order  # largest last
    return own


def _adopted(clipped: Clipped, portals: Portals, own: NDArray[np.int64]) -> dict[int, list[int]]:
    """Assign each piece that is not a cell's own piece to the cell whose own piece is the fewest
    portals away.

    The result maps the flat index of a cell to the numbers of its assigned pieces. A piece from
    which no portals lead to an own piece is assigned to the cell in which it lies.
    """
    width = own.shape[1]
    n = len(clipped.pieces)
    orphans = {k for k in range(n) if own[clipped.rows[k], clipped.cols[k]] != k}
    if not orphans:
        return {}
    beside: dict[int, list[tuple[float, int]]] = defaultdict(list)
    for (one, other), portal in zip(portals.pairs.tolist(), portals.widths.tolist(), strict=True):
        if one in orphans or other in orphans:
            beside[one].append((-portal, other))
            beside[other].append((-portal, one))

    def cell(piece: int) -> int:
        return int(clipped.rows[piece] * width + clipped.cols[piece]) if piece < n else piece - n

    # Breadth-first from all own pieces at once, wide portals first. A piece is assigned to the cell
    # of the piece that found it.
    adopters: dict[int, int] = {}
    queue = deque((piece, cell(piece)) for piece in sorted(beside) if piece not in orphans)
    while queue:
        piece, of = queue.popleft()
        for _, other in sorted(beside[piece]):
            if other in orphans and other not in adopters:
                adopters[other] = of
                queue.append((other, of))
    found: dict[int, list[int]] = defaultdict(list)
    for piece in (*adopters, *sorted(orphans - adopters.keys())):
        found[adopters.get(piece, cell(piece))].append(piece)
    return found


def _in_order(
    clipped: Clipped,
    lattice: Lattice,
    mask: NDArray[np.bool_],
    points: Points,
    index: NDArray[np.int64],
    adopted: dict[int, list[int]],
) -> tuple[Points, NDArray[np.int64]]:
    """Return the viewpoints of all cells, and the index of each cell's first viewpoint."""
    width = mask.shape[1]
    starts = np.searchsorted(index, np.arange(len(clipped.pieces) + 1))
    special: dict[int, list[Points]] = {}
    taken = {piece for pieces in adopted.values() for piece in pieces}
    for piece, (row, col) in enumerate(
        zip(clipped.rows.tolist(), clipped.cols.tolist(), strict=True)
    ):
        if piece not in taken:
            special[row * width + col] = [points[starts[piece] : starts[piece + 1]]]
    for cell, pieces in adopted.items():
        center = lattice.centers(np.array([cell // width]), np.array([cell % width]))
        special.setdefault(cell, [center]).extend(
            points[starts[piece] : starts[piece + 1]] for piece in pieces
        )
    flat = np.flatnonzero(mask)
    counts = np.ones(len(flat), dtype=np.int64)
    keys = np.array(sorted(special), dtype=np.int64)
    places = np.searchsorted(flat, keys)
    counts[places] = [sum(len(part) for part in special[key]) for key in keys.tolist()]
    begins = np.concatenate([[0], np.cumsum(counts)])
    ordered = np.empty((int(begins[-1]), 2))
    ordered[begins[:-1]] = lattice.centers(flat // width, flat % width)
    for key, place in zip(keys.tolist(), places.tolist(), strict=True):
        ordered[begins[place] : begins[place + 1]] = np.concatenate(special[key])
    return ordered, begins


Numbers = NDArray[np.int64]
_FOOTPRINT_HAIR = 1e-9  # relative to a cell: rounding error
_USED = 0.75  # share of a wide footprint's width that counts in the comparison of cell sizes
WIDEST = 99  # maximum effective width of a footprint in cells
_PARTS = (
    1,
    3,
    5,
)  # numbers of cells across a footprint that are tried in the choice of the cell size


class Footprint(Protocol):
    """Interface of the objects that tell `TourCost` which cells a robot sees from a cell."""

    def seen(self, cell: int, width: int) -> Numbers:
        """Return the cells that a robot in ``cell`` sees, including ``cell``, as increasing tour
        indices.
        """


class MaskFootprint:
    """Visibility between the cells of a tour in 2 or 3 dimensions. A position without a cell hides
    the cells behind it.

    Parameters
    ----------
    tour : Tour

    Examples
    --------
    >>> from shoal.search.tours import make_tour
    >>> MaskFootprint(make_tour("comb", (2, 5))).seen(0, 3).tolist()
    [0, 1, 8, 9]
    """

    def __init__(self, tour: Tour) -> None:
        self._cells, self._position = tour.cells, tour.position
        self._known: dict[tuple[int, int], Numbers] = {}

    def seen(self, cell: int, width: int) -> Numbers:
        """Return the cells that a robot in ``cell`` sees, including ``cell``, as increasing tour
        indices.
        """
        if width == 1:
            return np.array([cell], dtype=np.int64)
        key = (cell, width)
        found = self._known.get(key)
        if found is None:
            found = self._known[key] = np.sort(self._look(cell, width))
        return found

    def _look(self, cell: int, width: int) -> Numbers:
        middle = self._cells[cell]
        low, high = (
            np.maximum(middle - width // 2, 0),
            np.minimum(middle + width // 2 + 1, self._position.shape),
        )
        block = self._position[
            tuple(slice(*ends) for ends in zip(low.tolist(), high.tolist(), strict=True))
        ]
        around = np.asarray(block[block >= 0], dtype=np.int64)
        if self._plain(cell, around, block):
            return around
        return around[[other == cell or self._clear(cell, int(other)) for other in around]]

    def _plain(self, cell: int, around: Numbers, block: NDArray[np.int64]) -> bool:
        """Return whether every position of the footprint around a cell is a cell of the tour."""
        return len(around) == block.size

    def _clear(self, cell: int, other: int) -> bool:
        """Return whether a robot in ``cell`` sees the whole cell ``other``: all positions between
        them must be cells.
        """
        ends = np.sort(self._cells[[cell, other]], axis=0)
        return bool(
            (
                self._position[tuple(slice(low, high + 1) for low, high in ends.T.tolist())] >= 0
            ).all()
        )


class RegionFootprint(MaskFootprint):
    """Visibility inside a region. Walls block the view, unless a path inside the footprint leads
    around the wall.

    Parameters
    ----------
    grid : CellGrid
    tour : Tour
    """

    def __init__(self, grid: CellGrid, tour: Tour) -> None:
        super().__init__(tour)
        self._grid = grid
        self._half, self._room = 0.0, None

    # Computed for the first wide footprint, because most searches have none.

    @cached_property
    def _index(self) -> Numbers:
        return self._grid.ordinals(self._cells)

    @cached_property
    def _viewpoints(self) -> NDArray[np.float64]:
        """First viewpoint of each cell in the lattice's frame, in metres."""
        return self._grid.lattice.from_region(
            self._grid.viewpoints[self._grid.viewpoint_starts[self._index]]
        )

    @cached_property
    def _single(self) -> NDArray[np.bool_]:
        """Whether each cell has a single viewpoint, and therefore consists only of its
        own piece.
        """
        return np.asarray(np.diff(self._grid.viewpoint_starts)[self._index] == 1)

    @cached_property
    def _whole(self) -> NDArray[np.bool_]:
        return np.asarray(self._grid.clipped.whole[tuple(self._cells.T)] & self._single)

    def _plain(self, cell: int, around: Numbers, block: NDArray[np.int64]) -> bool:
        return len(around) == block.size and bool(self._whole[around].all())

    def _look(self, cell: int, width: int) -> Numbers:
        self._room = None
        self._half = width * self._grid.size / 2
        return super()._look(cell, width)

    def _clear(self, cell: int, other: int) -> bool:
        """Return whether the own piece of the cell ``other`` lies in the footprint and can be
        reached inside the footprint.
        """
        import shapely

        if not self._single[other]:
            return False  # the cell has several viewpoints because no single one sees all of it
        grid, (row, col) = self._grid, self._cells[other].tolist()
        piece, place = (
            own_piece(grid.clipped, grid.lattice, grid.own, (row, col)),
            self._viewpoints[cell],
        )
        bounds = np.array(piece.bounds).reshape(2, 2)
        if (np.abs(bounds - place) > self._half + _FOOTPRINT_HAIR * self._grid.size).any():
            return False
        if self._room is None:
            self._room = self._room_around(place)
        return bool(shapely.intersects(self._room, shapely.point_on_surface(piece)))

    def _room_around(self, place: NDArray[np.float64]) -> Any:
        """Return the part of the region inside the footprint that is connected to the robot's
        position.
        """
        import shapely

        square = shapely.box(*(place - self._half), *(place + self._half))
        parts = shapely.get_parts(shapely.intersection(self._grid.area, square))
        return parts[int(np.argmin(shapely.distance(parts, shapely.points(place))))]


def check_widths(widths: NDArray[np.int64], robots: int) -> None:
    """Check that each robot has one footprint width, which is an odd number of cells from 1 to
    `WIDEST`.

    Raises
    ------
    InvalidInputError
    """
    good = widths.shape == (robots,) and widths.dtype.kind in "iu" and (widths % 2 == 1).all()
    if not good or (widths < 1).any() or (widths > WIDEST).any():
        raise InvalidInputError(
            f"widths: expected {robots} odd numbers of cells up to {WIDEST}, got"
            f" {widths.tolist()!r:.200}"
        )


def widths_of(footprints: ArrayLike, size: float) -> Numbers:
    """Return the effective width of each footprint, as an odd number of cells from 1 to `WIDEST`;
    int64.

    The effective width is the largest odd number of cells that fit side by side in the footprint.

    Parameters
    ----------
    footprints : array_like of float
        Sides of the footprints in metres.
    size : float
        Side of a cell in metres.

    Examples
    --------
    >>> widths_of([2.0, 4.0, 6.0, 11.0], 2.0).tolist()
    [1, 1, 3, 5]
    """
    held = np.floor(np.asarray(footprints, dtype=np.float64) / size * (1 + _FOOTPRINT_HAIR)).astype(
        np.int64
    )
    return np.asarray(np.clip(held - (held + 1) % 2, 1, WIDEST))


def cell_side(footprints: ArrayLike, rates: ArrayLike) -> float:
    """Return the cell size, in metres, for which all robots together see the most area per second.

    The cell size is at most the side of the smallest footprint. Of several equally good sizes, the
    function chooses the largest. If a footprint is wider than one cell, the function counts only
    three quarters of its width. The factor 3/4 approximates `gain_of`.

    Parameters
    ----------
    footprints : array_like of float, shape (m,)
        Side of each robot's footprint in metres.
    rates : array_like of float, shape (m,)
        Speed of each robot.

    Examples
    --------
    >>> cell_side([2.0, 6.0], [1.0, 1.0]), cell_side([2.0, 4.0], [1.0, 1.0])
    (2.0, 1.3333333333333333)
    """
    sides = np.asarray(footprints, dtype=np.float64)
    if sides.min() == sides.max():
        return float(sides[0])
    tried = np.unique([side / parts for side in np.unique(sides) for parts in _PARTS])[
        ::-1
    ]  # largest first
    tried = tried[tried <= sides.min()]
    widths = [widths_of(sides, side) for side in tried]
    seen = [
        float((np.where(wide > 1, _USED * wide, 1.0) * side * np.asarray(rates)).sum())
        for wide, side in zip(widths, tried, strict=True)
    ]
    return float(tried[int(np.argmax(np.array(seen) > max(seen) * (1 - 1e-9)))])
