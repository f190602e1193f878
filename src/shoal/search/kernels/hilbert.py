"""Hilbert curves in compiled code, also of rectangles of any size."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.jit import kernel

LEVELS_2, LEVELS_3 = 5, 3
"""Numbers of levels per look-up in 2 and 3 dimensions. The tables have 8 and 24 KiB and fit into
the fastest cache.
"""


def one_level(dimensions: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the parts and the states of one level of the curve: (parts, following), each of shape
    (states, 2^dimensions).

    For each state, ``parts`` holds the parts of the cube in the order of the curve, and
    ``following`` holds the state of the curve in each part. Bit j of a part tells on which side of
    the cube the part lies along axis j. The curve with state 0 begins at the origin, first leads
    along axis 1, and ends at the far end of axis 0.
    """
    count = 1 << dimensions
    states = [(0, 0)]
    parts, following = [], []
    for entry, direction in states:  # the loop appends new states to the list ``states``
        parts.append(
            [
                _rotated(rank ^ (rank >> 1), direction + 1, dimensions) ^ entry
                for rank in range(count)
            ]
        )
        row = []
        for rank in range(count):
            inner = 0 if rank == 0 else _gray(2 * ((rank - 1) // 2))
            state = (
                entry ^ _rotated(inner, direction + 1, dimensions),
                (direction + _turn(rank, dimensions) + 1) % dimensions,
            )
            if state not in states:
                states.append(state)
            row.append(states.index(state))
        following.append(row)
    return np.array(parts), np.array(following)


def _gray(number: int) -> int:
    return number ^ (number >> 1)


def _rotated(bits: int, by: int, width: int) -> int:
    by %= width
    return ((bits << by) | (bits >> (width - by))) & ((1 << width) - 1)


def _turn(rank: int, dimensions: int) -> int:
    if rank == 0:
        return 0
    odd = rank if rank % 2 else rank - 1
    return (
        (odd ^ (odd + 1)).bit_length() - 1
    ) % dimensions  # the number of ones at the low end of ``odd``


def tables(
    dimensions: int, levels: int
) -> tuple[NDArray[np.uint16], NDArray[np.uint16], NDArray[np.int64]]:
    """Return the tables (decoding, encoding, begin). One look-up converts ``levels`` levels of the
    curve at once.

    The entry ``decoding[state << dimensions * levels | digits]`` contains the shifted next state,
    and in its lower bits the coordinates. In an entry, the ``levels`` bits that begin with bit j *
    levels contain the coordinate along axis j. In the table ``encoding``, digits and coordinates
    are exchanged. The entry ``begin[k]`` is the shifted state from which k levels of zeros lead to
    state 0. An index whose order is not a multiple of ``levels`` begins with leading zeros.
    """
    parts, following = one_level(dimensions)
    n_states, width = len(parts), dimensions * levels
    state = np.arange(n_states)[:, None]
    place = np.zeros((n_states, 1), dtype=np.int64)
    ones = sum(1 << (axis * levels) for axis in range(dimensions))
    spread = np.array(
        [
            sum(((part >> axis) & 1) << (axis * levels) for axis in range(dimensions))
            for part in range(1 << dimensions)
        ]
    )
    assert ones == spread[-1]
    for _ in range(levels):
        place = (place[:, :, None] << 1 | spread[parts[state]]).reshape(n_states, -1)
        state = following[state].reshape(n_states, -1)
    digits = np.broadcast_to(np.arange(1 << width), place.shape)
    encoding = np.empty_like(place)
    np.put_along_axis(encoding, place, state << width | digits, axis=1)
    begin = [0]
    for _ in range(levels - 1):
        begin.append(
            next(s for s in range(n_states) if parts[s, 0] == 0 and following[s, 0] == begin[-1])
        )
    return (
        (state << width | place).ravel().astype(np.uint16),
        encoding.ravel().astype(np.uint16),
        np.array(begin, dtype=np.int64) << width,
    )


DECODING_2, ENCODING_2, BEGIN_2 = tables(2, LEVELS_2)
DECODING_3, ENCODING_3, BEGIN_3 = tables(3, LEVELS_3)
WIDTH_2, WIDTH_3 = 2 * LEVELS_2, 3 * LEVELS_3
DIGITS_2, DIGITS_3 = (1 << WIDTH_2) - 1, (1 << WIDTH_3) - 1
SIDE_2, SIDE_3 = (1 << LEVELS_2) - 1, (1 << LEVELS_3) - 1
TRANSPOSED = int(BEGIN_2[1])
"""The state of the curve that leads from the origin to the far end of the y axis."""


@kernel
def index_of(x, y, order, state):
    """Return the index of the cell (x, y) on the curve that has the order ``order`` and begins in
    ``state``.

    The coordinates x and y are from 0 to 2^order - 1.
    """
    looks = (order + LEVELS_2 - 1) // LEVELS_2
    index = 0
    for look in range(looks - 1, -1, -1):
        low = look * LEVELS_2
        key = (x >> low & SIDE_2) | (y >> low & SIDE_2) << LEVELS_2
        entry = np.int64(ENCODING_2[np.uint64(state | key)])
        index = index << WIDTH_2 | (entry & DIGITS_2)
        state = entry & ~DIGITS_2
    return index


@kernel
def place_of(index, order, state):
    """Return the cell (x, y) with a given index on the curve that has the order ``order`` and
    begins in ``state``.

    The index is from 0 to 4^order - 1.
    """
    looks = (order + LEVELS_2 - 1) // LEVELS_2
    x = y = 0
    for look in range(looks - 1, -1, -1):
        entry = np.int64(DECODING_2[np.uint64(state | (index >> (look * WIDTH_2) & DIGITS_2))])
        x = x << LEVELS_2 | (entry & SIDE_2)
        y = y << LEVELS_2 | (entry >> LEVELS_2 & SIDE_2)
        state = entry & ~DIGITS_2
    return x, y


@kernel
def begin_of(order, transposed):
    """Return the state from which the leading zeros of an index lead to state 0, or to `TRANSPOSED`
    if ``transposed`` is true.
    """
    filled = (LEVELS_2 - order % LEVELS_2) % LEVELS_2
    if transposed:
        filled = (filled + 1) % 2  # each level of leading zeros transposes the curve once more
    return BEGIN_2[filled]


@kernel
def encode_2(cells, order, indices):
    begin, top = begin_of(order, False), (1 << order) - 1
    for k in range(len(cells)):
        row, col = cells[k, 0], cells[k, 1]
        # a shifted negative number stays negative, so the test also finds negative numbers
        if (row | col) >> order != 0:
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
    """Encode cells on the Moore curve, which consists of four Hilbert curves of the order ``order -
    1``.

    The Moore curve leads up through two Hilbert curves on the left, and down through two Hilbert
    curves on the right.
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
        # the left half is mirrored in x, the right half in y; without a branch, which would
        x = x & inside ^ inside * (1 - right)
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
            key = (
                (x >> low & SIDE_3)
                | (y >> low & SIDE_3) << LEVELS_3
                | (z >> low & SIDE_3) << (2 * LEVELS_3)
            )
            entry = np.int64(ENCODING_3[np.uint64(state | key)])
            index = index << WIDTH_3 | (entry & DIGITS_3)
            state = entry & ~DIGITS_3
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
            entry = np.int64(DECODING_3[np.uint64(state | (index >> (look * WIDTH_3) & DIGITS_3))])
            x = x << LEVELS_3 | (entry & SIDE_3)
            y = y << LEVELS_3 | (entry >> LEVELS_3 & SIDE_3)
            z = z << LEVELS_3 | (entry >> (2 * LEVELS_3) & SIDE_3)
            state = entry & ~DIGITS_3
        cells[k, 0] = z
        cells[k, 1] = top - y
        cells[k, 2] = x
    return -1


DEPTH = 512
"""Size of the stack of boxes. This size is enough for 2^31 cells along each side of the box, with 4
entries for each halving.
"""


@kernel
def half(length):
    """Return half of a signed length. If the length is above 2, the half is rounded up to an even
    number.
    """
    size = abs(length)
    part = size // 2
    if part % 2 == 1 and size > 2:
        part += 1
    return part if length > 0 else -part


@kernel
def push(stack, top, place, first, second, third):
    """Put a box onto the stack: its first position (x, y, z), and each side as (axis, signed
    length), the direction of the path first. Return the new size of the stack.
    """
    stack[top, 0], stack[top, 1], stack[top, 2] = place
    stack[top, 3], stack[top, 4] = first
    stack[top, 5], stack[top, 6] = second
    stack[top, 7], stack[top, 8] = third
    return top + 1


@kernel
def moved(place, axis, by):
    """Return a position (x, y, z) moved along an axis by ``by`` cells."""
    x, y, z = place
    if axis == 0:
        return x + by, y, z
    if axis == 1:
        return x, y + by, z
    return x, y, z + by


@kernel
def walk_box(start, axes, lengths, places, at):
    """Write the path through a box to ``places`` (N, 3), beginning with row ``at``. Return the
    index after the last row written.

    ``start`` is the first position (x, y, z). ``lengths`` (3,) contains the signed lengths of the
    box along ``axes``. The path ends at the far end of the first axis. A box with the length 1
    along the first axis must also have the length 1 along another axis.
    """
    stack = np.empty((DEPTH, 9), dtype=np.int64)
    place = (start[0], start[1], start[2])
    first, second = (axes[0], lengths[0]), (axes[1], lengths[1])
    top = push(stack, 0, place, first, second, (axes[2], lengths[2]))
    while top > 0:
        top -= 1
        place = (stack[top, 0], stack[top, 1], stack[top, 2])
        first = (stack[top, 3], stack[top, 4])
        second, third = (stack[top, 5], stack[top, 6]), (stack[top, 7], stack[top, 8])
        w, h, d = abs(first[1]), abs(second[1]), abs(third[1])
        if int(w == 1) + int(h == 1) + int(d == 1) >= 2:
            axis, length = first if w > 1 else (second if h > 1 else third)
            at = walk_line(place, axis, length, places, at)
        else:
            top = split(stack, top, place, first, second, third)
    return at


@kernel
def walk_line(place, axis, length, places, at):
    step = 1 if length > 0 else -1
    for _ in range(abs(length)):
        places[at, 0], places[at, 1], places[at, 2] = place
        place = moved(place, axis, step)
        at += 1
    return at


@kernel
def split(stack, top, p, first, second, third):
    """Push the parts of a box onto the stack, in the reverse order of the path's visits."""
    (i, a), (j, b), (k, c) = first, second, third
    w, h, d = abs(a), abs(b), abs(c)
    a2, b2, c2 = half(a), half(b), half(c)
    if 2 * w > 3 * h and 2 * w > 3 * d:
        q = moved(p, i, a2)
        top = push(stack, top, q, (i, a - a2), (j, b), (k, c))
        return push(stack, top, p, (i, a2), (j, b), (k, c))
    da, db, dc = np.sign(a), np.sign(b), np.sign(c)
    end = moved(p, i, a - da)
    if 3 * h > 4 * d:  # up along b, along a, down along b
        q = moved(end, j, b2 - db)
        top = push(stack, top, q, (j, -b2), (k, c), (i, a2 - a))
        q = moved(p, j, b2)
        top = push(stack, top, q, (i, a), (j, b - b2), (k, c))
        return push(stack, top, p, (j, b2), (k, c), (i, a2))
    if 3 * d > 4 * h:  # up along c, along a, down along c
        q = moved(end, k, c2 - dc)
        top = push(stack, top, q, (k, -c2), (i, a2 - a), (j, b))
        q = moved(p, k, c2)
        top = push(stack, top, q, (i, a), (j, b), (k, c - c2))
        return push(stack, top, p, (k, c2), (i, a2), (j, b))
    q = moved(end, j, b2 - db)
    top = push(stack, top, q, (j, -b2), (k, c2), (i, a2 - a))
    q = moved(moved(end, j, b2), k, c - dc)
    top = push(stack, top, q, (k, -c), (i, a2 - a), (j, b - b2))
    q = moved(moved(p, j, b2 - db), k, c - dc)
    top = push(stack, top, q, (i, a), (j, -b2), (k, c2 - c))
    q = moved(p, j, b2)
    top = push(stack, top, q, (k, c), (i, a2), (j, b - b2))
    return push(stack, top, p, (j, b2), (k, c2), (i, a2))
