"""SwarmState: the cells of all particles of a swarm."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.swarm.grid.board import Board, GridLayout


def check_cells(cells: ArrayLike, shape: tuple[int, ...], *, what: str, rim: int = 1) -> NDArray[np.int64]:
    """Check cell coordinates and return them as an int64 array of shape (n, ndim), in row-major order.

    Parameters
    ----------
    cells : array_like of int, shape (n, ndim)
        Cells to check. The array of cells may be empty.
    shape : tuple of int
        Shape of the workspace.
    what : str
        Name of the argument in error messages, such as "start".
    rim : int
        Width of the rim around the workspace, in cells. Rim cells are valid.

    Raises
    ------
    InvalidInputError
        Raised if a coordinate is not a whole number, or if a cell lies outside the workspace and its rim.
    """
    expected = f"{what}: expected integer cells of shape (n, {len(shape)})"
    try:
        array = np.asarray(cells)
    except ValueError:
        raise InvalidInputError(f"{expected}, got rows of different lengths") from None
    if array.size == 0 and array.ndim < 3:
        return np.zeros((0, len(shape)), dtype=np.int64)
    if array.ndim != 2 or array.shape[1] != len(shape) or not np.issubdtype(array.dtype, np.integer):
        raise InvalidInputError(f"{expected}, got {array.dtype} {array.shape}")
    outside = (array < -rim) | (array >= np.array(shape) + rim)
    if outside.any():
        raise InvalidInputError(f"{what}: expected cells inside {shape}, got {tuple(array[outside.any(axis=1)][0].tolist())}")
    sizes = [size + 2 * rim for size in shape]
    flat = np.sort(np.ravel_multi_index(tuple(array.T.astype(np.int64) + rim), sizes))
    return np.stack(np.unravel_index(flat, sizes), axis=1) - rim


@dataclass(frozen=True, eq=False)
class SwarmState:
    """The state of a swarm: the cells of all particles.

    Parameters
    ----------
    occupied : Board
        Cells that hold at least one particle.
    counts : ndarray of int32, shape ``layout.window``, or None
        Number of particles in each cell under the rule merge, which lets particles share a cell. Under the rules block and tilt,
        ``counts`` is None.
    """

    occupied: Board
    counts: NDArray[np.int32] | None = None

    @classmethod
    def of_cells(cls, layout: GridLayout, cells: NDArray[np.int64], *, shared: bool) -> SwarmState:
        """Return the state of a swarm with particles at ``cells``, an int array of shape (n, ndim).

        Set ``shared`` to true if a cell may hold several particles.
        """
        counts = None
        if shared:
            counts = np.zeros(layout.window, dtype=np.int32)
            np.add.at(counts, tuple(cells.T + 1), 1)
        return cls(Board.of_cells(layout, cells), counts)

    @property
    def n_particles(self) -> int:
        """Number of particles in the swarm."""
        return len(self.occupied) if self.counts is None else int(self.counts.sum())

    @property
    def cells(self) -> NDArray[np.int64]:
        """Cell of each particle in row-major order (int64, shape (n, ndim)). A cell of k particles appears k times."""
        if self.counts is None:
            return self.occupied.cells
        return np.repeat(np.argwhere(self.counts > 0) - 1, self.counts[self.counts > 0], axis=0)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, SwarmState) or self.occupied != other.occupied:
            return False
        if self.counts is None or other.counts is None:
            return self.counts is other.counts
        return np.array_equal(self.counts, other.counts)

    def __hash__(self) -> int:
        return hash((self.occupied, None if self.counts is None else self.counts.tobytes()))
