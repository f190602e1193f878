"""Arithmetic on words of 64 bits, in which each bit is a cell.

Every constant of this module is a ``np.uint64``, because in Numba ``uint64 - 1`` becomes int64, and ``>>`` of an int64 extends the
sign. No function shifts a word by 64 bits, because compiled code and Python give different results for a shift by 64 bits.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel

ZERO = np.uint64(0)
ONE = np.uint64(1)
TWO = np.uint64(2)
FOUR = np.uint64(4)
TOP = np.uint64(63)
ALL = np.uint64(0xFFFFFFFFFFFFFFFF)
_PAIRS = np.uint64(0x5555555555555555)
_QUADS = np.uint64(0x3333333333333333)
_BYTES = np.uint64(0x0F0F0F0F0F0F0F0F)
_SUM = np.uint64(0x0101010101010101)
_HIGH = np.uint64(56)
_WORDS, _HALVES = np.uint64(0x00FF00FF00FF00FF), np.uint64(0x0000FFFF0000FFFF)
_EIGHT, _SIXTEEN, _THIRTY_TWO = np.uint64(8), np.uint64(16), np.uint64(32)


@in_place_kernel
def popcount(word):
    """Return the number of set bits as int64. The compiler replaces the code of the function by one instruction."""
    word = word - ((word >> ONE) & _PAIRS)
    word = (word & _QUADS) + ((word >> TWO) & _QUADS)
    word = (word + (word >> FOUR)) & _BYTES
    return np.int64((word * _SUM) >> _HIGH)


@in_place_kernel
def reverse(word):
    """Return the bits of a word in reverse order. The compiler replaces the code of the function by few instructions."""
    word = ((word >> ONE) & _PAIRS) | ((word & _PAIRS) << ONE)
    word = ((word >> TWO) & _QUADS) | ((word & _QUADS) << TWO)
    word = ((word >> FOUR) & _BYTES) | ((word & _BYTES) << FOUR)
    word = ((word >> _EIGHT) & _WORDS) | ((word & _WORDS) << _EIGHT)
    word = ((word >> _SIXTEEN) & _HALVES) | ((word & _HALVES) << _SIXTEEN)
    return (word >> _THIRTY_TWO) | (word << _THIRTY_TWO)


@in_place_kernel
def lowest(word):
    """Return the index of the lowest set bit of a nonzero word as int64."""
    return popcount(~word & (word - ONE))


@in_place_kernel
def has(words, width, row, column):
    """Return whether a board with ``width`` words per row contains a cell."""
    return (words[row * width + (column >> 6)] >> np.uint64(column & 63)) & ONE != ZERO


@in_place_kernel
def put(words, width, row, column):
    """Add a cell to a board."""
    words[row * width + (column >> 6)] |= ONE << np.uint64(column & 63)


@in_place_kernel
def copy_board(source, target):
    """Copy a board (set of cells)."""
    for i in range(source.shape[0]):
        target[i] = source[i]
