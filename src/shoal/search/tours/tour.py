"""Tour: the cells of a region in the order in which a robot visits them, and metrics of this order."""

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
        Number of cells.
    length : float
        Sum of the lengths of all steps in cell sides, including the closing edge of a closed tour.
    closing_edge : float
        Length in cell sides of the step from the last cell back to the first cell, or 0 for an open tour.
    turns : int
        Number of cells at which the direction changes. In a closed tour, it may also change at the first and the last cell.
    turns_per_cell : float
        Number of turns divided by the number of cells.
    longest_step : float
        Length of the longest step in cell sides, apart from the closing edge.
    neighbour_steps : float
        Fraction of the steps, including the closing edge, that connect two cells with a common side (in 3 dimensions, a common
        face).
    neighbour_stretch : float
        Mean distance along the tour between two cells with a common side. On a closed tour, the shorter direction counts. The
        metric is the average nearest-neighbour stretch of Xu and Tirthapura, "A lower bound on proximity preservation by space
        filling curves", IPDPS 2012.
    dilation : float
        Largest ratio of two cells' squared distance to their distance along the tour. The closing edge counts as one step. Only
        pairs of cells at the tour distances 1, 2, 3, 4, 6, 8, 12, 16, ... are compared. Therefore the metric is a lower bound on
        the worst-case locality WL2 of Haverkort and van Walderveen, "Locality and bounding-box quality of two-dimensional
        space-filling curves", Computational Geometry 43, 2010. For the Hilbert curve, WL2 tends to 6.
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
        """Return all metrics by name, for JSON."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class Tour:
    """Cells in visiting order. A closed tour continues from its last cell to its first cell.

    Parameters
    ----------
    cells : ndarray of int64, shape (N, 2) or (N, 3)
        (row, col) with row 0 on top, or (layer, row, col); each cell at most once. The tour keeps a read-only copy.
    shape : tuple of int
        Shape of the grid, (H, W) or (L, H, W).
    closed : bool
        Whether the tour is closed.
    name : str
        Name of the tour in reports and error messages.

    Raises
    ------
    InvalidInputError
        If there are no cells, a cell is outside the grid, or a cell is visited twice.

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
        """Tour index of each cell of the tour, and -1 elsewhere; read-only int64 array of the grid's shape."""
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
    def steps(self) -> NDArray[np.float64]:
        """Length of each step of the tour, in cell sides; float64, shape (N,), or (N - 1,) for an open tour."""
        from shoal.search.kernels.measures import squared_steps

        squares = np.empty(len(self.cells), dtype=np.int64)
        squared_steps(deep(self.cells), squares)
        lengths = np.sqrt(squares if self.closed else squares[:-1])
        lengths.setflags(write=False)
        return lengths

    def metrics(self) -> TourMetrics:
        """Return the metrics of the tour. For N cells, the time grows as N log N, and the memory grows as N."""
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
