"""The cells of a region: a grid at any angle, and the viewpoints of its cells."""

from __future__ import annotations

from collections import defaultdict, deque
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_kind, check_number, check_points
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.geometry import partial_sums
from shoal.search.cells.clipping import (
    Clipped,
    Lattice,
    Portals,
    clip_to_cells,
    lattice_over,
    portals_of,
    rotate_shape,
    with_centers_free,
)
from shoal.search.cells.viewpoints import viewpoints_of
from shoal.search.regions.margin import visible_region
from shoal.search.regions.outline import Points, check_plane_points
from shoal.search.regions.region import SearchRegion


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
    whole : CellGrid, optional
        The grid of which this one has some cells, which robots search again.
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
    whole: CellGrid | None = None

    def subset(self, mask: NDArray[np.bool_]) -> CellGrid:
        """Return a grid with some of the cells, over the same region; ``mask`` has the shape of the
        grid.
        """
        chosen, counts = mask[self.mask], np.diff(self.viewpoint_starts)
        return replace(
            self,
            mask=mask & self.mask,
            viewpoints=self.viewpoints[np.repeat(chosen, counts)],
            viewpoint_starts=partial_sums(counts[chosen]),
            whole=self,
        )

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
        return rotate_shape(self.region.area, -self.angle)

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
        valid = np.asarray(((array >= 0) & (array < self.shape)).all(axis=1))
        valid[valid] = self.mask[tuple(array[valid].T)]
        if not valid.all():
            index = int(np.argmin(valid))
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
        rows, cols = self.lattice.cells_at(self.lattice.from_region(array))
        cells = np.stack(
            [np.clip(rows, 0, self.shape[0] - 1), np.clip(cols, 0, self.shape[1] - 1)], axis=1
        )
        lost = ~self.mask[tuple(cells.T)]
        if lost.any():
            from scipy.spatial import KDTree

            cells[lost] = self.cells[KDTree(self.waypoints()).query(array[lost])[1]]
        return cells

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
        # along a bent line, the last cell of a row may touch the first one of the next row
        adjacent = (
            (self.own.ravel()[flat] == pairs).all(axis=1)
            & (flat[:, 1] - flat[:, 0] == down * width + right)
            & (flat[:, 0] % width < width - right)
        )
        rows, cols = np.divmod(flat[adjacent, 0], width)
        doors[rows, cols] = True
        return doors

    def area_of(self, cells: NDArray[np.int64]) -> Any:
        """Return the part of the region in the given cells, as a Shapely geometry in metres;
        ``cells`` has the shape (n, 2).
        """
        import shapely

        chosen = np.zeros(self.shape, dtype=np.bool_)
        chosen[tuple(cells.T)] = True
        cut = self.clipped.pieces[chosen[self.clipped.rows, self.clipped.cols]]
        rows, cols = np.nonzero(chosen & self.clipped.whole)
        whole = self.lattice.boxes(rows, cols)
        return rotate_shape(shapely.union_all(np.concatenate([cut, whole])), self.angle)

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
    check_kind(region, SearchRegion, what="region")
    angle = check_number(angle, what="angle", least=-360, most=360)
    check_points([offset], what="offset", dimensions=2, count=1)
    side = check_number(footprint, what="footprint", above=0)
    step = side if size is None else check_number(size, what="cell size", above=0)
    if step > side:
        raise InvalidInputError(
            f"cell size: expected at most the footprint, {side:g} m, got {step:g} m"
        )
    region = visible_region(region, side, angle)
    area = rotate_shape(region.area, -angle)
    free = rotate_shape(region.free, -angle) if region.restricted else None
    lattice = lattice_over(area, step, angle, offset)
    clipped = with_centers_free(clip_to_cells(area, lattice), lattice, free)
    if not clipped.whole.any() and not len(clipped.pieces):
        raise InvalidInputError(
            f"region {region.name!r}: expected an area above the rounding error in cells of"
            f" {step:g} m, got {region.area_m2:g} m2"
        )
    centers = lattice.centers(clipped.rows, clipped.cols)
    points, index = viewpoints_of(clipped.pieces, centers, footprint=side, size=step, free=free)
    return grid_of_pieces(
        region, side, lattice, clipped, portals_of(clipped, lattice), points, index
    )


def grid_of_pieces(
    region: SearchRegion,
    footprint: float,
    lattice: Lattice,
    clipped: Clipped,
    portals: Portals,
    points: Points,
    index: NDArray[np.int64],
) -> CellGrid:
    """Return the grid of a region that is divided into pieces. The arguments ``points`` and
    ``index`` are what `viewpoints_of` returns for the pieces.
    """
    mask = clipped.whole.copy()
    mask[clipped.rows, clipped.cols] = True
    own = _own_pieces(clipped)
    adopted = _assign_orphans(clipped, portals, own)
    viewpoints, starts = _order_viewpoints(clipped, lattice, mask, points, index, adopted)
    return CellGrid(
        region,
        footprint,
        mask,
        lattice,
        clipped,
        portals,
        lattice.to_region(viewpoints),
        starts,
        own,
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


def _assign_orphans(
    clipped: Clipped, portals: Portals, own: NDArray[np.int64]
) -> dict[int, list[int]]:
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
    for (first, second), portal in zip(
        portals.pairs.tolist(), portals.widths.tolist(), strict=True
    ):
        if first in orphans or second in orphans:
            beside[first].append((-portal, second))
            beside[second].append((-portal, first))

    def cell(piece: int) -> int:
        return int(clipped.rows[piece] * width + clipped.cols[piece]) if piece < n else piece - n

    # Breadth-first from all own pieces at once, wide portals first. A piece is assigned to the cell
    # of the piece that found it.
    adopters: dict[int, int] = {}
    queue = deque((piece, cell(piece)) for piece in sorted(beside) if piece not in orphans)
    while queue:
        piece, of = queue.popleft()
        for _, second in sorted(beside[piece]):
            if second in orphans and second not in adopters:
                adopters[second] = of
                queue.append((second, of))
    pieces_of: dict[int, list[int]] = defaultdict(list)
    for piece in (*adopters, *sorted(orphans - adopters.keys())):
        pieces_of[adopters.get(piece, cell(piece))].append(piece)
    return pieces_of


def _order_viewpoints(
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
    adopted_pieces = {piece for pieces in adopted.values() for piece in pieces}
    for piece, (row, col) in enumerate(
        zip(clipped.rows.tolist(), clipped.cols.tolist(), strict=True)
    ):
        if piece not in adopted_pieces:
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
    begins = partial_sums(counts)
    ordered = np.empty((int(begins[-1]), 2))
    ordered[begins[:-1]] = lattice.centers(flat // width, flat % width)
    for key, place in zip(keys.tolist(), places.tolist(), strict=True):
        ordered[begins[place] : begins[place + 1]] = np.concatenate(special[key])
    return ordered, begins
