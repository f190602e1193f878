"""Words of 64 bits."""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel

ZERO, ONE, TWO, FOUR = np.uint64(0), np.uint64(1), np.uint64(2), np.uint64(4)
ALL = np.uint64(0xFFFFFFFFFFFFFFFF)
_PAIRS = np.uint64(0x5555555555555555)
_QUADS = np.uint64(0x3333333333333333)
_BYTES = np.uint64(0x0F0F0F0F0F0F0F0F)
_SUM, _HIGH = np.uint64(0x0101010101010101), np.uint64(56)


@in_place_kernel
def popcount(word):
    """Return the number of set bits. The compiler makes one instruction of it."""
    word = word - ((word >> ONE) & _PAIRS)
    word = (word & _QUADS) + ((word >> TWO) & _QUADS)
    word = (word + (word >> FOUR)) & _BYTES
    return np.int64((word * _SUM) >> _HIGH)


@in_place_kernel
def lowest(word):
    """Return the index of the lowest set bit of a nonzero word."""
    return popcount(~word & (word - ONE))


@in_place_kernel
def highest(word):
    """Return the index of the highest set bit of a nonzero word."""
    at = 0
    for shift in (32, 16, 8, 4, 2, 1):
        if word >> np.uint64(shift) != ZERO:
            word >>= np.uint64(shift)
            at += shift
    return at


@in_place_kernel
def holds(bits, cell):
    """Return whether a bitset contains a cell."""
    return (bits[cell >> 6] >> np.uint64(cell & 63)) & ONE != ZERO
