"""State tables of the Hilbert curve, which convert several levels of the curve per look-up.

One level of a curve in n dimensions visits the 2^n parts of a cube in the order of a Gray code, rotated and mirrored. The *state*
describes the rotation and the mirroring by an entry corner and a direction. The states and their successors are from Hamilton,
"Compact Hilbert indices", technical report CS-2006-07, Dalhousie University, section 2. This module combines several levels of
states into one table.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LEVELS_2, LEVELS_3 = 5, 3
"""Numbers of levels per look-up in 2 and 3 dimensions. The tables have 8 and 24 KiB and fit into the fastest cache."""


def one_level(dimensions: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the parts and the states of one level of the curve: (parts, following), each of shape (states, 2^dimensions).

    For each state, ``parts`` holds the parts of the cube in the order of the curve, and ``following`` holds the state of the curve
    in each part. Bit j of a part tells on which side of the cube the part lies along axis j. The curve with state 0 begins at the
    origin, first leads along axis 1, and ends at the far end of axis 0.
    """
    count = 1 << dimensions
    states = [(0, 0)]
    parts, following = [], []
    for entry, direction in states:  # the loop appends new states to the list ``states``
        parts.append([_rotated(rank ^ (rank >> 1), direction + 1, dimensions) ^ entry for rank in range(count)])
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
    return ((odd ^ (odd + 1)).bit_length() - 1) % dimensions  # the number of ones at the low end of ``odd``


def tables(dimensions: int, levels: int) -> tuple[NDArray[np.uint16], NDArray[np.uint16], NDArray[np.int64]]:
    """Return the tables (decoding, encoding, begin). One look-up converts ``levels`` levels of the curve at once.

    The entry ``decoding[state << dimensions * levels | digits]`` contains the shifted next state, and in its lower bits the
    coordinates. In an entry, the ``levels`` bits that begin with bit j * levels contain the coordinate along axis j. In the table
    ``encoding``, digits and coordinates are exchanged. The entry ``begin[k]`` is the shifted state from which k levels of zeros
    lead to state 0. An index whose order is not a multiple of ``levels`` begins with leading zeros.
    """
    parts, following = one_level(dimensions)
    n_states, width = len(parts), dimensions * levels
    state = np.arange(n_states)[:, None]
    place = np.zeros((n_states, 1), dtype=np.int64)
    ones = sum(1 << (axis * levels) for axis in range(dimensions))
    spread = np.array(
        [sum(((part >> axis) & 1) << (axis * levels) for axis in range(dimensions)) for part in range(1 << dimensions)]
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
        begin.append(next(s for s in range(n_states) if parts[s, 0] == 0 and following[s, 0] == begin[-1]))
    return (
        (state << width | place).ravel().astype(np.uint16),
        encoding.ravel().astype(np.uint16),
        np.array(begin, dtype=np.int64) << width,
    )
