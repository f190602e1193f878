"""Masks: bool arrays that are True for cells that a robot must search, and the connected components of masks."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.errors import InvalidInputError

MAX_CELLS = 2**28
"""Maximum number of cells of a grid (16384 x 16384)."""


def check_mask(mask_or_shape: Any) -> NDArray[np.bool_]:
    """Check a mask of the cells to search, or make a full mask from the shape of a rectangle or box.

    Parameters
    ----------
    mask_or_shape : array_like of bool, shape (H, W) or (L, H, W); or a tuple of 2 or 3 int
        A mask that is True for cells that a robot must search, with row 0 on top, or the shape of a full grid.

    Returns
    -------
    ndarray of bool, shape (H, W) or (L, H, W)
        The mask as a contiguous array.

    Raises
    ------
    InvalidInputError
        If the mask has an invalid dtype or an invalid number of dimensions, no True cell, or more than ``MAX_CELLS`` cells.
    """
    try:
        array = np.asarray(mask_or_shape)
    except ValueError:
        raise InvalidInputError("mask: expected rows of equal length, got rows of different lengths") from None
    if array.ndim == 1 and array.dtype.kind in "iu":
        return np.ones(_check_shape(array.tolist()), dtype=np.bool_)
    if array.ndim not in (2, 3):
        raise InvalidInputError(f"mask: expected a mask or a shape of 2 or 3 dimensions, got an array of {array.ndim}")
    if array.dtype != np.bool_:
        raise InvalidInputError(f"mask: expected booleans, True for a cell to be searched, got dtype {array.dtype}")
    if array.size > MAX_CELLS:
        raise InvalidInputError(f"mask: expected at most {MAX_CELLS} cells, got {array.size}, shape {array.shape}")
    if not array.any():
        raise InvalidInputError(f"mask: expected at least one cell to be searched, got none in shape {array.shape}")
    return np.ascontiguousarray(array)


def _check_shape(shape: list[int]) -> tuple[int, ...]:
    if len(shape) not in (2, 3):
        raise InvalidInputError(f"shape: expected (rows, columns) or (layers, rows, columns), got {tuple(shape)}")
    if min(shape) < 1:
        raise InvalidInputError(f"shape: expected at least one cell along each side, got {tuple(shape)}")
    count = 1
    for side in shape:
        count *= side
    if count > MAX_CELLS:
        raise InvalidInputError(f"shape: expected at most {MAX_CELLS} cells, got {count}, shape {tuple(shape)}")
    return tuple(shape)


def components(mask: ArrayLike) -> NDArray[np.int32]:
    """Return the number of each cell's connected component (1, 2, ... in reading order), or 0 where the mask is False.

    Two cells are connected if they share a side in 2 dimensions, or a face in 3 dimensions.

    Parameters
    ----------
    mask : array_like of bool, shape (H, W) or (L, H, W)

    Returns
    -------
    ndarray of int32, of the mask's shape

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> components(np.array([[True, False], [False, True]])).tolist()
    [[1, 0], [0, 2]]
    """
    from shoal.jit.kernels.connected import connected_parts  # needs Numba, which is slow to import

    return connected_parts(check_mask(mask))[0]


def smallest_part(mask: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Crop a mask to the bounding box of its True cells.

    Returns
    -------
    ndarray of int64, shape (dimensions,)
        The first cell of the bounding box.
    ndarray of bool
        The mask inside the bounding box.
    """
    ends = []
    for axis in range(mask.ndim):
        found = np.flatnonzero(mask.any(axis=tuple(other for other in range(mask.ndim) if other != axis)))
        ends.append((int(found[0]), int(found[-1]) + 1))
    return np.array(ends, dtype=np.int64)[:, 0], mask[tuple(slice(*pair) for pair in ends)]


def deep(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return cells as a contiguous array of (layer, row, column). Cells that are given as (row, column) get layer 0."""
    if cells.shape[1] == 3:
        return np.ascontiguousarray(cells)
    filled = np.zeros((len(cells), 3), dtype=np.int64)
    filled[:, 1:] = cells
    return filled


def component_after_component(cells: NDArray[np.int64], mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return cells sorted by connected component, so that all cells of one component follow one another.

    The cells of a component keep their order. The components come in the order of their first cells in ``cells``.
    """
    labels = components(mask)
    if labels.max() == 1:
        return cells
    of_cell = labels[tuple(cells.T)]
    first = np.full(labels.max() + 1, len(cells))
    np.minimum.at(first, of_cell, np.arange(len(cells)))
    order: NDArray[np.int64] = cells[np.argsort(first[of_cell], kind="stable")]
    return order
