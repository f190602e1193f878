"""Footprints: the cells that a robot sees from a cell, and the size of cells for footprints."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.errors import InvalidInputError
from shoal.search.cells.clipping import (
    own_piece,
)
from shoal.search.cells.grid import CellGrid
from shoal.search.tours import Tour

WIDEST = 99  # maximum effective width of a footprint in cells
_FOOTPRINT_HAIR = 1e-9  # relative to a cell: rounding error
_USED = 0.75  # share of a wide footprint's width that counts in the comparison of cell sizes
# numbers of cells across a footprint that are tried in the choice of the cell size
_PARTS = 1, 3, 5
Numbers = NDArray[np.int64]


class Footprint(Protocol):
    """Interface of the objects that tell `TourCost` which cells a robot sees from a cell."""

    def visible_cells(self, cell: int, width: int) -> Numbers:
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
    >>> MaskFootprint(make_tour("comb", (2, 5))).visible_cells(0, 3).tolist()
    [0, 1, 8, 9]
    """

    def __init__(self, tour: Tour) -> None:
        self._cells, self._position = tour.cells, tour.position
        self._cache: dict[tuple[int, int], Numbers] = {}

    def visible_cells(self, cell: int, width: int) -> Numbers:
        """Return the cells that a robot in ``cell`` sees, including ``cell``, as increasing tour
        indices.
        """
        if width == 1:
            return np.array([cell], dtype=np.int64)
        key = (cell, width)
        cells = self._cache.get(key)
        if cells is None:
            cells = self._cache[key] = np.sort(self._look(cell, width))
        return cells

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
        self._half, self._visible = 0.0, None

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
        self._visible = None
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
        if self._visible is None:
            self._visible = self._visible_area(place)
        return bool(shapely.intersects(self._visible, shapely.point_on_surface(piece)))

    def _visible_area(self, place: NDArray[np.float64]) -> Any:
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
    widths = np.floor(
        np.asarray(footprints, dtype=np.float64) / size * (1 + _FOOTPRINT_HAIR)
    ).astype(np.int64)
    return np.asarray(np.clip(widths - (widths + 1) % 2, 1, WIDEST))


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
    # largest first
    candidates = np.unique([side / parts for side in np.unique(sides) for parts in _PARTS])[::-1]
    candidates = candidates[candidates <= sides.min()]
    widths = [widths_of(sides, side) for side in candidates]
    rates_of_search = [
        float((np.where(wide > 1, _USED * wide, 1.0) * side * np.asarray(rates)).sum())
        for wide, side in zip(widths, candidates, strict=True)
    ]
    return float(
        candidates[int(np.argmax(np.array(rates_of_search) > max(rates_of_search) * (1 - 1e-9)))]
    )
