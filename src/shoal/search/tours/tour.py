"""Tours: closed sequences of cells, how they are made, and how they are written."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import asdict, field
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_array, check_integer, check_list
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.registry import Registry
from shoal.search.tours.masks import component_after_component, deep, smallest_part


@dataclass(frozen=True)
class TourMetrics:
    """Metrics of a tour: its length, its turns, and how far apart neighbouring cells lie along the
    tour.

    Attributes
    ----------
    cells : int
        Number of cells on the tour.
    length : float
        Sum of the lengths of all steps in cell sides, including the closing edge of a closed tour.
    closing_edge : float
        Length in cell sides of the step from the tour's last cell back to its first cell, or 0 for
        an open tour.
    turns : int
        Number of cells at which the direction changes. On a closed tour, the direction can also
        change at the first and the last cell.
    turns_per_cell : float
        Number of turns divided by the number of cells.
    longest_step : float
        Length of the longest step in cell sides, apart from the closing edge.
    neighbour_steps : float
        Fraction of all steps, including the closing edge, that lead to a neighbouring cell.
        Neighbouring cells share a side, or a face in 3 dimensions.
    neighbour_stretch : float
        Mean distance along the tour between two cells that share a side. On a closed tour, the
        distance is measured in the shorter direction. The neighbour stretch is the average
        nearest-neighbour stretch of Xu and Tirthapura, "A lower bound on proximity preservation by
        space filling curves", IPDPS 2012.
    dilation : float
        Largest ratio between the squared distance of two cells and their distance along the tour.
        On a closed tour, the distance along the tour is measured in the shorter direction. The
        computation uses only pairs of cells whose distance along the tour is 1, 2, 3, 4, 6, 8, 12,
        16, ... steps. Because the computation leaves out pairs of cells, the dilation is a lower
        bound on the worst-case locality WL2 of Haverkort and van Walderveen, "Locality and
        bounding-box quality of two-dimensional space-filling curves", Computational Geometry 43,
        2010. For the Hilbert curve, the locality WL2 tends to 6.
    """

    cells: int
    length: float
    closing_edge: float
    turns: int
    turns_per_cell: float
    longest_step: float
    neighbour_steps: float
    neighbour_stretch: float
    dilation: float

    def report(self) -> dict[str, Any]:
        """Return a mapping from the name of each metric to its value, which can be
        written as JSON.
        """
        return asdict(self)


@dataclass(frozen=True, eq=False)
class Tour:
    """Cells of a grid in the order in which a robot visits them. A closed tour continues from its
    last cell to its first.

    Parameters
    ----------
    cells : ndarray of int64, shape (N, 2) or (N, 3)
        Cells as (row, column) or (layer, row, column), where row 0 is on top. A tour must not
        contain a cell twice. The tour keeps a read-only copy of the array ``cells``.
    shape : tuple of int
        Shape of the grid, (H, W) or (L, H, W).
    closed : bool
        Whether the tour is closed.
    name : str
        Name of the tour in reports and error messages.

    Raises
    ------
    InvalidInputError
        If the tour has no cells, contains a cell twice, or contains a cell outside the grid.

    Examples
    --------
    >>> tour = Tour(np.array([[0, 0], [0, 1], [1, 1], [1, 0]]), (2, 2), closed=True, name="round")
    >>> tour.position.tolist()
    [[0, 1], [3, 2]]
    >>> tour.metrics().length
    4.0
    """

    cells: NDArray[np.int64]
    shape: tuple[int, ...]
    closed: bool = field(kw_only=True)
    name: str = field(kw_only=True)

    def __post_init__(self) -> None:
        cells = check_array(self.cells, expected=f"tour {self.name}: expected cells").copy()
        shape = tuple(
            check_integer(side, what=f"tour {self.name}: shape", least=1)
            for side in check_list(self.shape, what=f"tour {self.name}: shape")
        )
        if len(shape) not in (2, 3):
            raise InvalidInputError(
                f"tour {self.name}: expected a grid of shape (H, W) or (L, H, W), got {shape}"
            )
        if (
            cells.ndim != 2
            or cells.shape[1] != len(shape)
            or not len(cells)
            or cells.dtype.kind not in "iu"
        ):
            raise InvalidInputError(
                f"tour {self.name}: expected whole numbers of shape (N, {len(shape)}), N at least"
                f" 1, got {cells.dtype} of shape {cells.shape}"
            )
        cells = cells.astype(np.int64, copy=False)
        outside = ((cells < 0) | (cells >= np.array(shape))).any(axis=1)
        if outside.any():
            number = int(outside.argmax())
            raise InvalidInputError(
                f"tour {self.name}: cell {tuple(cells[number].tolist())}, number {number}, is"
                f" outside {shape}"
            )
        cells.setflags(write=False)
        object.__setattr__(self, "cells", cells)
        object.__setattr__(self, "shape", shape)
        object.__setattr__(self, "closed", bool(self.closed))
        _ = self.position  # refuses a cell visited twice

    def __len__(self) -> int:
        return len(self.cells)

    @cached_property
    def position(self) -> NDArray[np.int64]:
        """Tour index of each cell, and -1 for cells that are not on the tour; read-only int64 array
        of the grid's shape.
        """
        from shoal.search.kernels.metrics import fill_position

        position = np.full(self.shape, -1, dtype=np.int64)
        twice = fill_position(deep(self.cells), position if position.ndim == 3 else position[None])
        if twice >= 0:
            raise InvalidInputError(
                f"tour {self.name}: expected each cell once, got"
                f" {tuple(self.cells[twice].tolist())} again as number {twice}"
            )
        position.setflags(write=False)
        return position

    @cached_property
    def runs_along_rows(self) -> bool:
        """Whether at least half of the tour's length runs along the rows of cells, and not across
        them.
        """
        return self._runs_along_rows(self.cells)

    @staticmethod
    def _runs_along_rows(cells: NDArray[np.int64]) -> bool:
        across, along = np.abs(np.diff(cells[:, -2:], axis=0)).sum(axis=0).tolist()
        return bool(along >= across)

    def row_angle(self, angle: float, layer: int | None = None) -> float:
        """Return the direction in which most of the tour's length runs, in degrees from 0 to below
        180.

        Parameters
        ----------
        angle : float
            Angle of the rows of cells in degrees.
        layer : int, optional
            Number of the layer in which the function measures lengths, for a tour through several
            layers. By default, the function measures lengths in all layers.

        Examples
        --------
        >>> up_and_down = Tour(np.array([[0, 0], [1, 0], [2, 0], [2, 1], [1, 1], [0, 1]]), (3, 2), closed=True, name="round")
        >>> up_and_down.row_angle(45.0)
        135.0
        """
        along_rows = (
            self.runs_along_rows
            if layer is None or len(self.shape) == 2
            else self._runs_along_rows(self.cells[self.cells[:, 0] == layer])
        )
        return (angle + 90.0 * (not along_rows)) % 180.0

    @cached_property
    def steps(self) -> NDArray[np.float64]:
        """Length of each step of the tour in cell sides; float64, shape (N,) for a closed tour, (N
        - 1,) for an open tour.
        """
        from shoal.search.kernels.metrics import squared_steps

        squares = np.empty(len(self.cells), dtype=np.int64)
        squared_steps(deep(self.cells), squares)
        lengths = np.sqrt(squares if self.closed else squares[:-1])
        lengths.setflags(write=False)
        return lengths

    def metrics(self) -> TourMetrics:
        """Return the metrics of the tour. For N cells, computing time grows as N log N, and memory
        grows as N.
        """
        from shoal.search.kernels import metrics

        n, steps, cells = len(self.cells), self.steps, deep(self.cells)
        inner = steps[: n - 1]
        position = self.position if self.position.ndim == 3 else self.position[None]
        gaps, pairs = metrics.neighbour_gaps(position, self.closed, n)
        turns = int(metrics.count_turns(cells, self.closed))
        return TourMetrics(
            cells=n,
            length=float(steps.sum()),
            closing_edge=float(steps[-1]) if self.closed else 0.0,
            turns=turns,
            turns_per_cell=turns / n,
            longest_step=float(inner.max()) if len(inner) else 0.0,
            neighbour_steps=float(np.mean(steps == 1)) if n > 1 else 1.0,
            neighbour_stretch=float(gaps / pairs) if pairs else 0.0,
            dilation=float(metrics.dilation(cells, self.closed)),
        )


@runtime_checkable
class TourMaker(Protocol):
    """An object that computes a tour through the cells of a grid.

    Attributes
    ----------
    name : str
        Name of the tour in reports and error messages.
    dimensions : tuple of int
        Numbers of dimensions of the masks that `make` accepts: (2,) or (2, 3).
    """

    name: str
    dimensions: tuple[int, ...]

    def make(self, mask: NDArray[np.bool_]) -> Tour:
        """Return a tour that visits each True cell of ``mask`` once.

        The mask has the shape (H, W) or (L, H, W), and at least one True cell.
        """
        ...


TOURS: Registry[type[TourMaker]] = Registry("tour")


class TourByOrder(ABC):
    """A tour maker that sorts the cells of each connected component, and visits one component after
    another.
    """

    name: str
    dimensions: tuple[int, ...] = (2,)
    closed = True

    def make(self, mask: NDArray[np.bool_]) -> Tour:
        """Return the tour through all True cells of the mask."""
        low, region = smallest_part(mask)
        cells = component_after_component(self._in_order(region), region)
        return Tour(cells + low, mask.shape, closed=self.closed, name=self.name)

    @abstractmethod
    def _in_order(self, region: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Return all True cells of ``region`` in the order of the tour; int64, shape (N,
        dimensions).
        """


def check_covers(tour: Tour, mask: NDArray[np.bool_]) -> Tour:
    """Return a tour unchanged if it visits all True cells of a mask and no other cells."""
    if tour.shape != mask.shape:
        raise InvalidInputError(
            f"tour {tour.name}: expected the shape {mask.shape} of the mask, got {tour.shape}"
        )
    wrong = (tour.position >= 0) != mask
    if wrong.any():
        cell = tuple(int(index) for index in np.unravel_index(int(wrong.argmax()), mask.shape))
        does = "leaves out" if mask[cell] else "visits"
        raise InvalidInputError(
            f"tour {tour.name}: expected a tour of the True cells and no others, but it {does} cell"
            f" {cell}"
        )
    return tour


MAX_ORDER = {2: 31, 3: 20}
"""Largest order of a curve for 2 and for 3 dimensions. The indices of a larger curve do not fit
into int64.
"""


def hilbert_encode(cells: ArrayLike, *, order: int) -> NDArray[np.int64]:
    """Return the index of each cell on the Hilbert curve.

    Parameters
    ----------
    cells : array_like of int, shape (..., 2) or (..., 3)
        Cells as (row, column) or (layer, row, column), where each number is from 0 to 2^order - 1,
        and row 0 is on top. The location [x, y] of paper H, with [0, 0] at the lower left, is the
        cell (2^order - 1 - y, x).
    order : int
        Order of the curve: 0 to 31 in 2 dimensions, 0 to 20 in 3 dimensions. The curve has 2^order
        cells per side.

    Returns
    -------
    ndarray of int64, shape (...)
        Indices from 0 to 4^order - 1 in 2 dimensions, or from 0 to 8^order - 1 in 3 dimensions.
        Index 0 is the lower left cell of the first layer, and the last index is the lower right
        cell of the first layer.

    Raises
    ------
    InvalidInputError
        If a cell is not on the curve, or if the array contains numbers that are not whole.

    Notes
    -----
    In paper H, section "Space-Filling Curves", the location [3, 5] has the index 28 on the curve of
    order 3.

    Examples
    --------
    >>> hilbert_encode([[2, 3], [7, 0]], order=3)
    array([28,  0])
    """
    from shoal.search.kernels import hilbert

    return _encode({2: hilbert.encode_2, 3: hilbert.encode_3}, cells, order, "Hilbert")


def hilbert_decode(indices: ArrayLike, *, order: int, dimensions: int = 2) -> NDArray[np.int64]:
    """Return the cell at each index on the Hilbert curve, as the inverse of `hilbert_encode`.

    Parameters
    ----------
    indices : array_like of int, shape (...)
        Indices on the curve, from 0 to 2^(order * dimensions) - 1.
    order : int
        Order of the curve: 0 to 31 in 2 dimensions, 0 to 20 in 3 dimensions. The curve has 2^order
        cells per side.
    dimensions : int
        Number of dimensions of the curve: 2 or 3.

    Returns
    -------
    ndarray of int64, shape (..., dimensions)
        Cells as (row, column) or (layer, row, column), where row 0 is on top.

    Raises
    ------
    InvalidInputError
        If an index is not on the curve.

    Examples
    --------
    >>> hilbert_decode([28, 0, 63], order=3).tolist()
    [[2, 3], [7, 0], [7, 7]]
    >>> hilbert_decode(2**20, order=10)
    Traceback (most recent call last):
    ...
    shoal.core.errors.InvalidInputError: indices: expected 0 to 1048575 on the Hilbert curve of order 10, got 1048576
    """
    from shoal.search.kernels import hilbert

    check_integer(dimensions, what="dimensions", least=2, most=3)
    kernel = hilbert.decode_2 if dimensions == 2 else hilbert.decode_3
    return _decode(kernel, indices, order, dimensions, "Hilbert")


def moore_encode(cells: ArrayLike, *, order: int) -> NDArray[np.int64]:
    """Return the index of each cell on the Moore curve.

    The Moore curve consists of four Hilbert curves, joined so that the end of the curve is beside
    its start.

    Parameters
    ----------
    cells : array_like of int, shape (..., 2)
        Cells as (row, column), where each number is from 0 to 2^order - 1, and row 0 is on top.
    order : int
        Order of the curve, from 0 to 31. The curve has 2^order cells per side.

    Returns
    -------
    ndarray of int64, shape (...)
        Indices from 0 to 4^order - 1. Index 0 is the cell in the lowest row just left of the
        curve's centre. The last index is the cell in the lowest row just right of the curve's
        centre.

    Raises
    ------
    InvalidInputError
        If a cell is not on the curve.

    Notes
    -----
    The source is Moore, "On certain crinkly curves", Transactions of the American Mathematical
    Society 1, 1900.

    Examples
    --------
    >>> moore_encode([[3, 1], [3, 2]], order=2)
    array([ 0, 15])
    """
    from shoal.search.kernels import hilbert

    return _encode({2: hilbert.encode_moore}, cells, order, "Moore")


def moore_decode(indices: ArrayLike, *, order: int) -> NDArray[np.int64]:
    """Return the cell at each index on the Moore curve, as the inverse of `moore_encode`.

    Parameters
    ----------
    indices : array_like of int, shape (...)
        Indices on the curve, from 0 to 4^order - 1.
    order : int
        Order of the curve, from 0 to 31. The curve has 2^order cells per side.

    Returns
    -------
    ndarray of int64, shape (..., 2)
        Cells as (row, column), where row 0 is on top.

    Raises
    ------
    InvalidInputError
        If an index is not on the curve.

    Examples
    --------
    >>> moore_decode([0, 1, 2, 3], order=1).tolist()
    [[1, 0], [0, 0], [0, 1], [1, 1]]
    """
    from shoal.search.kernels import hilbert

    return _decode(hilbert.decode_moore, indices, order, 2, "Moore")


def _whole_numbers(values: ArrayLike, what: str) -> NDArray[Any]:
    array = check_array(values, expected=f"{what}: expected whole numbers")
    if array.size and array.dtype.kind not in "iu":
        raise InvalidInputError(
            f"{what}: expected whole numbers that fit 64 bits, got dtype {array.dtype}"
        )
    return array


def _encode(
    kernels: dict[int, Callable[..., int]], cells: ArrayLike, order: int, curve: str
) -> NDArray[np.int64]:
    """Return the index of each cell on a curve. ``kernels`` maps each possible number of dimensions
    to a kernel.
    """
    array = _whole_numbers(cells, "cells")
    if array.ndim == 0 or array.shape[-1] not in kernels:
        forms = " or ".join(("(row, col)", "(layer, row, col)")[: len(kernels)])
        raise InvalidInputError(
            f"cells: expected {forms} along the last axis, got shape {array.shape}"
        )
    dimensions = array.shape[-1]
    order = check_integer(order, what="order", least=0, most=MAX_ORDER[dimensions])
    flat = np.ascontiguousarray(array.reshape(-1, dimensions), dtype=np.int64)
    indices = np.empty(len(flat), dtype=np.int64)
    bad = kernels[dimensions](flat, order, indices)
    if bad >= 0:
        cell = tuple(array.reshape(flat.shape)[bad].tolist())
        raise InvalidInputError(
            f"cells: expected 0 to {2**order - 1} on the {curve} curve of order {order}, got"
            f" {cell}{_where(array.ndim - 1, bad)}"
        )
    return indices.reshape(array.shape[:-1])


def _decode(
    kernel: Callable[..., int], indices: ArrayLike, order: int, dimensions: int, curve: str
) -> NDArray[np.int64]:
    array = _whole_numbers(indices, "indices")
    order = check_integer(order, what="order", least=0, most=MAX_ORDER[dimensions])
    flat = np.ascontiguousarray(array, dtype=np.int64).ravel()
    cells = np.empty((len(flat), dimensions), dtype=np.int64)
    bad = kernel(flat, order, cells)
    if bad >= 0:
        last = 2 ** (order * dimensions) - 1
        where = _where(array.ndim, bad)
        raise InvalidInputError(
            f"indices: expected 0 to {last} on the {curve} curve of order {order}, got"
            f" {array.ravel()[bad]}{where}"
        )
    return cells.reshape((*array.shape, dimensions))


def _where(dimensions: int, number: int) -> str:
    return f" at number {number}" if dimensions else ""
