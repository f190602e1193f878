"""Conversion of whole arrays between cells and their indices on the Hilbert and Moore curves."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_integer
from shoal.core.errors import InvalidInputError

MAX_ORDER = {2: 31, 3: 20}
"""Largest order of a curve for 2 and for 3 dimensions. The indices of a larger curve do not fit into int64."""


def hilbert_encode(cells: ArrayLike, *, order: int) -> NDArray[np.int64]:
    """Return the index of each cell on the Hilbert curve.

    Parameters
    ----------
    cells : array_like of int, shape (..., 2) or (..., 3)
        Cells as (row, column) or (layer, row, column), where each number is from 0 to 2^order - 1, and row 0 is on top. The
        location [x, y] of paper H, with [0, 0] at the lower left, is the cell (2^order - 1 - y, x).
    order : int
        Order of the curve: 0 to 31 in 2 dimensions, 0 to 20 in 3 dimensions. The curve has 2^order cells per side.

    Returns
    -------
    ndarray of int64, shape (...)
        Indices from 0 to 4^order - 1 in 2 dimensions, or from 0 to 8^order - 1 in 3 dimensions. Index 0 is the lower left cell of
        the first layer, and the last index is the lower right cell of the first layer.

    Raises
    ------
    InvalidInputError
        If a cell is not on the curve, or if the array contains numbers that are not whole.

    Notes
    -----
    In paper H, section "Space-Filling Curves", the location [3, 5] has the index 28 on the curve of order 3.

    Examples
    --------
    >>> hilbert_encode([[2, 3], [7, 0]], order=3)
    array([28,  0])
    """
    from shoal.search.kernels import hilbert

    return _encoded({2: hilbert.encode_2, 3: hilbert.encode_3}, cells, order, "Hilbert")


def hilbert_decode(indices: ArrayLike, *, order: int, dimensions: int = 2) -> NDArray[np.int64]:
    """Return the cell at each index on the Hilbert curve, as the inverse of `hilbert_encode`.

    Parameters
    ----------
    indices : array_like of int, shape (...)
        Indices on the curve, from 0 to 2^(order * dimensions) - 1.
    order : int
        Order of the curve: 0 to 31 in 2 dimensions, 0 to 20 in 3 dimensions. The curve has 2^order cells per side.
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

    if dimensions not in MAX_ORDER:
        raise InvalidInputError(f"dimensions: expected 2 or 3, got {dimensions!r}")
    kernel = hilbert.decode_2 if dimensions == 2 else hilbert.decode_3
    return _decoded(kernel, indices, order, dimensions, "Hilbert")


def moore_encode(cells: ArrayLike, *, order: int) -> NDArray[np.int64]:
    """Return the index of each cell on the Moore curve.

    The Moore curve consists of four Hilbert curves, joined so that the end of the curve is beside its start.

    Parameters
    ----------
    cells : array_like of int, shape (..., 2)
        Cells as (row, column), where each number is from 0 to 2^order - 1, and row 0 is on top.
    order : int
        Order of the curve, from 0 to 31. The curve has 2^order cells per side.

    Returns
    -------
    ndarray of int64, shape (...)
        Indices from 0 to 4^order - 1. Index 0 is the cell in the lowest row just left of the curve's centre. The last index is the
        cell in the lowest row just right of the curve's centre.

    Raises
    ------
    InvalidInputError
        If a cell is not on the curve.

    Notes
    -----
    The source is Moore, "On certain crinkly curves", Transactions of the American Mathematical Society 1, 1900.

    Examples
    --------
    >>> moore_encode([[3, 1], [3, 2]], order=2)
    array([ 0, 15])
    """
    from shoal.search.kernels import hilbert

    return _encoded({2: hilbert.encode_moore}, cells, order, "Moore")


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

    return _decoded(hilbert.decode_moore, indices, order, 2, "Moore")


def _whole_numbers(values: ArrayLike, what: str) -> NDArray[Any]:
    try:
        array = np.asarray(values)
    except (ValueError, OverflowError):
        raise InvalidInputError(f"{what}: expected whole numbers in rows of equal length, got rows of different lengths") from None
    if array.size and array.dtype.kind not in "iu":
        raise InvalidInputError(f"{what}: expected whole numbers that fit 64 bits, got dtype {array.dtype}")
    return array


def _encoded(kernels: dict[int, Callable[..., int]], cells: ArrayLike, order: int, curve: str) -> NDArray[np.int64]:
    """Return the index of each cell on a curve. ``kernels`` maps each possible number of dimensions to a kernel."""
    array = _whole_numbers(cells, "cells")
    if array.ndim == 0 or array.shape[-1] not in kernels:
        forms = " or ".join(("(row, col)", "(layer, row, col)")[: len(kernels)])
        raise InvalidInputError(f"cells: expected {forms} along the last axis, got shape {array.shape}")
    dimensions = array.shape[-1]
    order = check_integer(order, what="order", least=0, most=MAX_ORDER[dimensions])
    flat = np.ascontiguousarray(array.reshape(-1, dimensions), dtype=np.int64)
    indices = np.empty(len(flat), dtype=np.int64)
    bad = kernels[dimensions](flat, order, indices)
    if bad >= 0:
        cell = tuple(array.reshape(flat.shape)[bad].tolist())
        raise InvalidInputError(
            f"cells: expected 0 to {2**order - 1} on the {curve} curve of order {order}, got {cell}{_where(array.ndim - 1, bad)}"
        )
    return indices.reshape(array.shape[:-1])


def _decoded(kernel: Callable[..., int], indices: ArrayLike, order: int, dimensions: int, curve: str) -> NDArray[np.int64]:
    array = _whole_numbers(indices, "indices")
    order = check_integer(order, what="order", least=0, most=MAX_ORDER[dimensions])
    flat = np.ascontiguousarray(array, dtype=np.int64).ravel()
    cells = np.empty((len(flat), dimensions), dtype=np.int64)
    bad = kernel(flat, order, cells)
    if bad >= 0:
        last = 2 ** (order * dimensions) - 1
        where = _where(array.ndim, bad)
        raise InvalidInputError(
            f"indices: expected 0 to {last} on the {curve} curve of order {order}, got {array.ravel()[bad]}{where}"
        )
    return cells.reshape((*array.shape, dimensions))


def _where(dimensions: int, number: int) -> str:
    return f" at number {number}" if dimensions else ""
