"""Conversion between indices and cells of Hilbert and Moore curves. One table look-up converts several levels of the curve.

The table look-ups use unsigned indices. Unsigned indices need no tests for negative values, which halves the time.

The last argument of each encoder and decoder is the output array. The encoders and decoders return the number of the first entry
out of range, or -1 if all entries are valid. A square has 2^order cells along each side. A cell (row, col) of the square has the
coordinates x = col and y = 2^order - 1 - row. In three dimensions, the third coordinate of a cell (layer, row, col) is z = layer.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import kernel
from shoal.search.kernels.hilbert_tables import LEVELS_2, LEVELS_3, tables

DECODING_2, ENCODING_2, BEGIN_2 = tables(2, LEVELS_2)
DECODING_3, ENCODING_3, BEGIN_3 = tables(3, LEVELS_3)
WIDTH_2, WIDTH_3 = 2 * LEVELS_2, 3 * LEVELS_3
DIGITS_2, DIGITS_3 = (1 << WIDTH_2) - 1, (1 << WIDTH_3) - 1
SIDE_2, SIDE_3 = (1 << LEVELS_2) - 1, (1 << LEVELS_3) - 1
TRANSPOSED = int(BEGIN_2[1])
"""The state of the curve that leads from the origin to the far end of the y axis."""


@kernel
def index_of(x, y, order, state):
    """Return the index of the cell (x, y) on the curve that has the order ``order`` and begins in ``state``.

    The coordinates x and y are from 0 to 2^order - 1.
    """
    looks = (order + LEVELS_2 - 1) // LEVELS_2
    index = 0
    for look in range(looks - 1, -1, -1):
        low = look * LEVELS_2
        key = (x >> low & SIDE_2) | (y >> low & SIDE_2) << LEVELS_2
        found = np.int64(ENCODING_2[np.uint64(state | key)])
        index = index << WIDTH_2 | (found & DIGITS_2)
        state = found & ~DIGITS_2
    return index


@kernel
def place_of(index, order, state):
    """Return the cell (x, y) with a given index on the curve that has the order ``order`` and begins in ``state``.

    The index is from 0 to 4^order - 1.
    """
    looks = (order + LEVELS_2 - 1) // LEVELS_2
    x = y = 0
    for look in range(looks - 1, -1, -1):
        found = np.int64(DECODING_2[np.uint64(state | (index >> (look * WIDTH_2) & DIGITS_2))])
        x = x << LEVELS_2 | (found & SIDE_2)
        y = y << LEVELS_2 | (found >> LEVELS_2 & SIDE_2)
        state = found & ~DIGITS_2
    return x, y


@kernel
def begin_of(order, transposed):
    """Return the state from which the leading zeros of an index lead to state 0, or to `TRANSPOSED` if ``transposed`` is true."""
    filled = (LEVELS_2 - order % LEVELS_2) % LEVELS_2
    if transposed:
        filled = (filled + 1) % 2  # each level of leading zeros transposes the curve once more
    return BEGIN_2[filled]


@kernel
def encode_2(cells, order, indices):
    begin, top = begin_of(order, False), (1 << order) - 1
    for k in range(len(cells)):
        row, col = cells[k, 0], cells[k, 1]
        if (row | col) >> order != 0:  # a shifted negative number stays negative, so the test also finds negative numbers
            return k
        indices[k] = index_of(col, top - row, order, begin)
    return -1


@kernel
def decode_2(indices, order, cells):
    begin, top = begin_of(order, False), (1 << order) - 1
    for k in range(len(indices)):
        index = indices[k]
        if index >> (2 * order) != 0:
            return k
        x, y = place_of(index, order, begin)
        cells[k, 0] = top - y
        cells[k, 1] = x
    return -1


@kernel
def encode_moore(cells, order, indices):
    """Encode cells on the Moore curve, which consists of four Hilbert curves of the order ``order - 1``.

    The Moore curve leads up through two Hilbert curves on the left, and down through two Hilbert curves on the right.
    """
    if order == 0:
        indices[:] = 0
        return first_other_than_zero(cells)
    below = order - 1
    begin, top, inside = begin_of(below, True), (1 << order) - 1, (1 << below) - 1
    for k in range(len(cells)):
        row, col = cells[k, 0], cells[k, 1]
        if (row | col) >> order != 0:
            return k
        x, y = col, top - row
        right, upper = x >> below, y >> below
        quarter = upper + right * (3 - 2 * upper)
        x = x & inside ^ inside * (1 - right)  # the left half is mirrored in x, the right half in y; without a branch, which would
        y = y & inside ^ inside * right  # be mispredicted half of the time
        indices[k] = quarter << (2 * below) | index_of(x, y, below, begin)
    return -1


@kernel
def decode_moore(indices, order, cells):
    if order == 0:
        cells[:] = 0
        return first_other_than_zero(indices.reshape(-1, 1))
    below = order - 1
    begin, top, inside = begin_of(below, True), (1 << order) - 1, (1 << below) - 1
    for k in range(len(indices)):
        index = indices[k]
        if index >> (2 * order) != 0:
            return k
        quarter = index >> (2 * below)
        right = quarter >> 1
        upper = quarter & 1 ^ right
        x, y = place_of(index & ((1 << (2 * below)) - 1), below, begin)
        cells[k, 0] = top - ((y ^ inside * right) + (upper << below))
        cells[k, 1] = (x ^ inside * (1 - right)) + (right << below)
    return -1


@kernel
def first_other_than_zero(rows):
    for k in range(len(rows)):
        for value in rows[k]:
            if value != 0:
                return k
    return -1


@kernel
def encode_3(cells, order, indices):
    looks = (order + LEVELS_3 - 1) // LEVELS_3
    begin, top = BEGIN_3[looks * LEVELS_3 - order], (1 << order) - 1
    for k in range(len(cells)):
        z, row, x = cells[k, 0], cells[k, 1], cells[k, 2]
        if (z | row | x) >> order != 0:
            return k
        y, state, index = top - row, begin, 0
        for look in range(looks - 1, -1, -1):
            low = look * LEVELS_3
            key = (x >> low & SIDE_3) | (y >> low & SIDE_3) << LEVELS_3 | (z >> low & SIDE_3) << (2 * LEVELS_3)
            found = np.int64(ENCODING_3[np.uint64(state | key)])
            index = index << WIDTH_3 | (found & DIGITS_3)
            state = found & ~DIGITS_3
        indices[k] = index
    return -1


@kernel
def decode_3(indices, order, cells):
    looks = (order + LEVELS_3 - 1) // LEVELS_3
    begin, top = BEGIN_3[looks * LEVELS_3 - order], (1 << order) - 1
    for k in range(len(indices)):
        index = indices[k]
        if index >> (3 * order) != 0:
            return k
        x, y, z, state = 0, 0, 0, begin
        for look in range(looks - 1, -1, -1):
            found = np.int64(DECODING_3[np.uint64(state | (index >> (look * WIDTH_3) & DIGITS_3))])
            x = x << LEVELS_3 | (found & SIDE_3)
            y = y << LEVELS_3 | (found >> LEVELS_3 & SIDE_3)
            z = z << LEVELS_3 | (found >> (2 * LEVELS_3) & SIDE_3)
            state = found & ~DIGITS_3
        cells[k, 0] = z
        cells[k, 1] = top - y
        cells[k, 2] = x
    return -1
