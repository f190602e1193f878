"""What a rig is: whatever carries out commands and sees particles."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from shoal.errors import InvalidInputError


@runtime_checkable
class Rig(Protocol):
    """What moves particles and sees them.

    Between two commands a rig is at rest: whoever drives it may think as long as it takes.
    """

    @property
    def name(self) -> str:
        """Name for summaries and files."""

    @property
    def shape(self) -> tuple[int, ...]:
        """The cells that it can see: (rows, columns) or (layers, rows, columns)."""

    @property
    def rule(self) -> str:
        """Its move rule: "block", "merge" or "tilt"."""

    def send(self, command: str) -> None:
        """Carry out one command, a letter out of ``lurd`` (3-D: ``lurdio``), once."""

    def observe(self) -> NDArray[np.int64]:
        """Return the cells of the particles; int64, shape (n, ndim)."""

    def stop(self) -> None:
        """Come to rest at once and take no further commands."""


def check_cells(cells: object, shape: tuple[int, ...], *, what: str) -> NDArray[np.int64]:
    """Return the cells that a rig has told as int64, shape (n, ndim), in row-major order.

    Raises
    ------
    InvalidInputError
        If they are no cells, or one lies outside ``shape`` and the rim around it.
    """
    try:
        array = np.asarray(cells)
    except ValueError:
        raise InvalidInputError(f"{what}: expected cells of {len(shape)} numbers, got rows of different lengths") from None
    if array.size == 0:
        return np.zeros((0, len(shape)), dtype=np.int64)
    if array.ndim != 2 or array.shape[1] != len(shape) or not np.issubdtype(array.dtype, np.integer):
        raise InvalidInputError(f"{what}: expected integer cells of shape (n, {len(shape)}), got {array.dtype} {array.shape}")
    outside = ((array < -1) | (array > np.array(shape))).any(axis=1)
    if outside.any():
        cell = tuple(int(i) for i in array[outside][0])
        raise InvalidInputError(f"{what}: expected cells inside {shape}, got {cell}")
    ordered: NDArray[np.int64] = array[np.lexsort(array.T[::-1])].astype(np.int64)
    return ordered
