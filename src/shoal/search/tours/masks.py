"""Masks: bool arrays that are True for cells that a robot must search, and the connected components
of masks.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_array
from shoal.core.errors import InvalidInputError

MAX_CELLS = 2**28
"""Maximum number of cells of a grid (16384 x 16384)."""


def check_mask(mask_or_shape: Any) -> NDArray[np.bool_]:
    """Check a mask of the cells to search, or make a full mask from the shape of a rectangle or
    box.

    Parameters
    ----------
    mask_or_shape : array_like of bool, shape (H, W) or (L, H, W); or a tuple of 2 or 3 int
        A mask that is True for cells that a robot must search, with row 0 on top, or the shape of a
        full grid.

    Returns
    -------
    ndarray of bool, shape (H, W) or (L, H, W)
        The mask as a contiguous array.

    Raises
    ------
    InvalidInputError
        If the mask has an invalid dtype or an invalid number of dimensions, no True cell, or more
        than ``MAX_CELLS`` cells.
    """
    array = check_array(mask_or_shape, expected="mask: expected booleans or a shape")
    if array.ndim == 1 and array.dtype.kind in "iu":
        return np.ones(_check_shape(array.tolist()), dtype=np.bool_)
    if array.ndim not in (2, 3):
        raise InvalidInputError(
            f"mask: expected a mask or a shape of 2 or 3 dimensions, got an array of {array.ndim}"
        )
    if array.dtype != np.bool_:
        raise InvalidInputError(
            f"mask: expected booleans, True for a cell to be searched, got dtype {array.dtype}"
        )
    if array.size > MAX_CELLS:
        raise InvalidInputError(
            f"mask: expected at most {MAX_CELLS} cells, got {array.size}, shape {array.shape}"
        )
    if not array.any():
        raise InvalidInputError(
            f"mask: expected at least one cell to be searched, got none in shape {array.shape}"
        )
    return np.ascontiguousarray(array)


def _check_shape(shape: list[int]) -> tuple[int, ...]:
    if len(shape) not in (2, 3):
        raise InvalidInputError(
            f"shape: expected (rows, columns) or (layers, rows, columns), got {tuple(shape)}"
        )
    if min(shape) < 1:
        raise InvalidInputError(
            f"shape: expected at least one cell along each side, got {tuple(shape)}"
        )
    count = 1
    for side in shape:
        count *= side
    if count > MAX_CELLS:
        raise InvalidInputError(
            f"shape: expected at most {MAX_CELLS} cells, got {count}, shape {tuple(shape)}"
        )
    return tuple(shape)


def components(mask: ArrayLike) -> NDArray[np.int32]:
    """Return the number of each cell's connected component (1, 2, ... in reading order), or 0 where
    the mask is False.

    Two cells are connected if they share a side in 2 dimensions, or a face in 3 dimensions.

    Parameters
    ----------
    mask : array_like of bool, shape (H, W) or (L, H, W)

    Returns
    -------
    ndarray of int32, of the mask's shape

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
        occupied = np.flatnonzero(
            mask.any(axis=tuple(other for other in range(mask.ndim) if other != axis))
        )
        ends.append((int(occupied[0]), int(occupied[-1]) + 1))
    return np.array(ends, dtype=np.int64)[:, 0], mask[tuple(slice(*pair) for pair in ends)]


def deep(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return cells as a contiguous array of (layer, row, column). Cells that are given as (row,
    column) get layer 0.
    """
    if cells.shape[1] == 3:
        return np.ascontiguousarray(cells)
    filled = np.zeros((len(cells), 3), dtype=np.int64)
    filled[:, 1:] = cells
    return filled


def component_after_component(
    cells: NDArray[np.int64], mask: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Return cells sorted by connected component, so that all cells of one component follow one
    another.

    The cells of a component keep their order. The components come in the order of their first cells
    in ``cells``.
    """
    labels = components(mask)
    if labels.max() == 1:
        return cells
    of_cell = labels[tuple(cells.T)]
    first = np.full(labels.max() + 1, len(cells))
    np.minimum.at(first, of_cell, np.arange(len(cells)))
    order: NDArray[np.int64] = cells[np.argsort(first[of_cell], kind="stable")]
    return order


def arc_bits(first: int, count: int, n: int) -> int:
    """Return the bitset of ``count`` consecutive cells, beginning with cell number ``first``, on a
    closed tour of n cells.

    Examples
    --------
    >>> bin(arc_bits(3, 3, 5))
    '0b11001'
    """
    block = ((1 << min(count, n)) - 1) << (first % n)
    return (block | (block >> n)) & ((1 << n) - 1)


def rotate_bits(bits: int, first: int, n: int) -> int:
    """Return a bitset with new cell numbers on a closed tour of n cells, where the cell ``first``
    gets the number 0.

    Examples
    --------
    >>> bin(rotate_bits(0b10010, 3, 5))
    '0b1010'
    """
    first %= n
    return ((bits >> first) | (bits << (n - first))) & ((1 << n) - 1)


def next_in(bits: int, first: int, n: int) -> int | None:
    """Return the cell ``first`` if it is in a bitset, or else the next cell of the bitset on a
    closed tour of n cells.

    If the bitset is empty, the result is None.

    Examples
    --------
    >>> next_in(0b00010, 3, 5)
    1
    """
    rotated_bits = rotate_bits(bits, first, n)
    return (
        None if not rotated_bits else ((rotated_bits & -rotated_bits).bit_length() - 1 + first) % n
    )


def runs(bits: int, first: int, n: int) -> Iterator[tuple[int, int]]:
    """Yield the runs of consecutive cells of a bitset as pairs (first cell, number of cells).

    The function goes once around a closed tour of n cells, beginning with the cell ``first``.

    Examples
    --------
    >>> list(runs(0b11011, 2, 5))
    [(3, 4)]
    >>> list(runs(0b11011, 4, 5))
    [(4, 3), (3, 1)]
    """
    remaining, at = rotate_bits(bits, first, n), first % n
    while remaining:
        skip = (remaining & -remaining).bit_length() - 1
        remaining >>= skip
        at += skip
        length = (~remaining & (remaining + 1)).bit_length() - 1
        yield at % n, length
        remaining >>= length
        at += length


def members(bits: int) -> Iterator[int]:
    """Yield the cell numbers of a bitset in increasing order.

    Examples
    --------
    >>> list(members(0b10110))
    [1, 2, 4]
    """
    while bits:
        low = bits & -bits
        yield low.bit_length() - 1
        bits ^= low


def bitset_of(cells: Iterable[int]) -> int:
    """Return the bitset of given cell numbers.

    Examples
    --------
    >>> bin(bitset_of([1, 2, 4]))
    '0b10110'
    """
    bits = 0
    for cell in cells:
        bits |= 1 << cell
    return bits


def bits_to_array(bits: int, n: int) -> NDArray[np.bool_]:
    """Return a bool array of shape (n,) that is true at the numbers in a bitset.

    Examples
    --------
    >>> bits_to_array(0b101, 4).tolist()
    [True, False, True, False]
    """
    data = np.frombuffer(bits.to_bytes((n + 7) // 8, "little"), dtype=np.uint8)
    return np.unpackbits(data, count=n, bitorder="little").astype(np.bool_)


def array_to_bits(members: NDArray[np.bool_]) -> int:
    """Return the bitset of the indices at which a bool array is true.

    Examples
    --------
    >>> array_to_bits(np.array([True, False, True, False]))
    5
    """
    return int.from_bytes(np.packbits(members, bitorder="little").tobytes(), "little")


def at_least(sets: list[int], k: int) -> int:
    """Return the bitset of the cells that are in at least k of several bitsets.

    Examples
    --------
    >>> bin(at_least([0b0111, 0b0110, 0b1100], 2))
    '0b110'
    """
    levels = [0] * k  # levels[j] holds the cells that are in more than j sets
    for bits in sets:
        for j in range(k - 1, 0, -1):
            levels[j] |= levels[j - 1] & bits
        levels[0] |= bits
    return levels[k - 1] if k else -1


_FEW = 16  # number of intervals above which NumPy arrays are faster than a loop


def intervals(bits: int) -> list[tuple[int, int]]:
    """Return the runs of consecutive numbers in a bitset as pairs (first number, length), in
    increasing order.

    Examples
    --------
    >>> intervals(0b11011)
    [(0, 2), (3, 2)]
    """
    if (bits & ~(bits << 1)).bit_count() <= _FEW:
        return list(runs(bits, 0, bits.bit_length())) if bits else []
    inside = np.zeros(bits.bit_length() + 2, dtype=np.int8)
    inside[1:-1] = bits_to_array(bits, bits.bit_length())
    edges = np.diff(inside)
    first = np.flatnonzero(edges > 0)
    return list(zip(first.tolist(), (np.flatnonzero(edges < 0) - first).tolist(), strict=True))


def bits_of_intervals(spans: list[tuple[int, int]]) -> int:
    """Return the bitset of all numbers in runs that are given as pairs (first number, length).

    Examples
    --------
    >>> bin(bits_of_intervals([(0, 2), (3, 2)]))
    '0b11011'
    """
    if len(spans) <= _FEW:
        bits = 0
        for first, length in spans:
            bits |= ((1 << length) - 1) << first
        return bits
    inside = np.zeros(max(first + length for first, length in spans), dtype=np.bool_)
    for first, length in spans:
        inside[first : first + length] = True
    return array_to_bits(inside)
