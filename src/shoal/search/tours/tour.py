"""Tour: the cells of a region in the order in which a robot visits them, and metrics of tours."""

from __future__ import annotations

from dataclasses import asdict, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.tours.masks import deep


@dataclass(frozen=True)
class TourMetrics:
    """Metrics of a tour: its length, its turns, and how far apart neighbouring cells lie along the tour.

    Attributes
    ----------
    cells : int
        Number of cells on the tour.
    length : float
        Sum of the lengths of all steps in cell sides, including the closing edge of a closed tour.
    closing_edge : float
        Length in cell sides of the step from the tour's last cell back to its first cell, or 0 for an open tour.
    turns : int
        Number of cells at which the direction changes. On a closed tour, the direction can also change at the first and the last
        cell.
    turns_per_cell : float
        Number of turns divided by the number of cells.
    longest_step : float
        Length of the longest step in cell sides, apart from the closing edge.
    neighbour_steps : float
        Fraction of all steps, including the closing edge, that lead to a neighbouring cell. Neighbouring cells share a side, or a
        face in 3 dimensions.
    neighbour_stretch : float
        Mean distance along the tour between two cells that share a side. On a closed tour, the distance is measured in the shorter
        direction. The neighbour stretch is the average nearest-neighbour stretch of Xu and Tirthapura, "A lower bound on proximity
        preservation by space filling curves", IPDPS 2012.
    dilation : float
        Largest ratio between the squared distance of two cells and their distance along the tour. On a closed tour, the distance
        along the tour is measured in the shorter direction. The computation uses only pairs of cells whose distance along the tour
        is 1, 2, 3, 4, 6, 8, 12, 16, ... steps. Because the computation leaves out pairs of cells, the dilation is a lower bound on
        the worst-case locality WL2 of Haverkort and van Walderveen, "Locality and bounding-box quality of two-dimensional
        space-filling curves", Computational Geometry 43, 2010. For the Hilbert curve, the locality WL2 tends to 6.
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
        """Return a mapping from the name of each metric to its value, which can be written as JSON."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class Tour:
    """Cells of a grid in the order in which a robot visits them. A closed tour continues from its last cell to its first.

    Parameters
    ----------
    cells : ndarray of int64, shape (N, 2) or (N, 3)
        Cells as (row, column) or (layer, row, column), where row 0 is on top. A tour must not contain a cell twice. The tour keeps
        a read-only copy of the array ``cells``.
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
        cells = np.array(self.cells)
        shape = tuple(int(side) for side in self.shape)
        if len(shape) not in (2, 3):
            raise InvalidInputError(f"tour {self.name}: expected a grid of shape (H, W) or (L, H, W), got {shape}")
        if cells.ndim != 2 or cells.shape[1] != len(shape) or not len(cells) or cells.dtype.kind not in "iu":
            raise InvalidInputError(
                f"tour {self.name}: expected whole numbers of shape (N, {len(shape)}), N at least 1, "
                f"got {cells.dtype} of shape {cells.shape}"
            )
        cells = cells.astype(np.int64, copy=False)
        outside = ((cells < 0) | (cells >= np.array(shape))).any(axis=1)
        if outside.any():
            number = int(outside.argmax())
            raise InvalidInputError(f"tour {self.name}: cell {tuple(cells[number].tolist())}, number {number}, is outside {shape}")
        cells.setflags(write=False)
        object.__setattr__(self, "cells", cells)
        object.__setattr__(self, "shape", shape)
        object.__setattr__(self, "closed", bool(self.closed))
        _ = self.position  # refuses a cell visited twice

    def __len__(self) -> int:
        return len(self.cells)

    @cached_property
    def position(self) -> NDArray[np.int64]:
        """Tour index of each cell, and -1 for cells that are not on the tour; read-only int64 array of the grid's shape."""
        from shoal.search.kernels.measures import fill_position

        position = np.full(self.shape, -1, dtype=np.int64)
        twice = fill_position(deep(self.cells), position if position.ndim == 3 else position[None])
        if twice >= 0:
            raise InvalidInputError(
                f"tour {self.name}: expected each cell once, got {tuple(self.cells[twice].tolist())} again as number {twice}"
            )
        position.setflags(write=False)
        return position

    @cached_property
    def runs_along_rows(self) -> bool:
        """Whether at least half of the tour's length runs along the rows of cells, and not across them."""
        return self._runs_along_rows(self.cells)

    @staticmethod
    def _runs_along_rows(cells: NDArray[np.int64]) -> bool:
        across, along = np.abs(np.diff(cells[:, -2:], axis=0)).sum(axis=0).tolist()
        return bool(along >= across)

    def row_angle(self, angle: float, layer: int | None = None) -> float:
        """Return the direction in which most of the tour's length runs, in degrees from 0 to below 180.

        Parameters
        ----------
        angle : float
            Angle of the rows of cells in degrees.
        layer : int, optional
            Number of the layer in which the function measures lengths, for a tour through several layers. By default, the function
            measures lengths in all layers.

        Examples
        --------
        >>> up_and_down = Tour(np.array([[0, 0], [1, 0], [2, 0], [2, 1], [1, 1], [0, 1]]), (3, 2), closed=True, name="round")
        >>> up_and_down.row_angle(45.0)
        135.0
        """
        cells = self.cells if layer is None or len(self.shape) == 2 else self.cells[self.cells[:, 0] == layer]
        return (angle + 90.0 * (not self._runs_along_rows(cells))) % 180.0

    @cached_property
    def steps(self) -> NDArray[np.float64]:
        """Length of each step of the tour in cell sides; float64, shape (N,) for a closed tour, (N - 1,) for an open tour."""
        from shoal.search.kernels.measures import squared_steps

        squares = np.empty(len(self.cells), dtype=np.int64)
        squared_steps(deep(self.cells), squares)
        lengths = np.sqrt(squares if self.closed else squares[:-1])
        lengths.setflags(write=False)
        return lengths

    def metrics(self) -> TourMetrics:
        """Return the metrics of the tour. For N cells, computing time grows as N log N, and memory grows as N."""
        from shoal.search.kernels import measures

        n, steps, cells = len(self.cells), self.steps, deep(self.cells)
        inner = steps[: n - 1]
        position = self.position if self.position.ndim == 3 else self.position[None]
        gaps, pairs = measures.neighbour_gaps(position, self.closed, n)
        turns = int(measures.count_turns(cells, self.closed))
        return TourMetrics(
            cells=n,
            length=float(steps.sum()),
            closing_edge=float(steps[-1]) if self.closed else 0.0,
            turns=turns,
            turns_per_cell=turns / n,
            longest_step=float(inner.max()) if len(inner) else 0.0,
            neighbour_steps=float(np.mean(steps == 1)) if n > 1 else 1.0,
            neighbour_stretch=float(gaps / pairs) if pairs else 0.0,
            dilation=float(measures.dilation(cells, self.closed)),
        )
