"""How likely a cell is to be free, as a small network tells that has seen maps: whole numbers alone, so the same on every machine.

It looks at what is known in a square window around the cell, turned so that the way in is below. What it tells of a cell is kept
until something in its window becomes known.

Source: docs/concepts/prediction.md.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.dynamics.bits import ONE, ZERO, lowest

RADIUS = 7  # of the window
SPAN = 2 * RADIUS + 1
KINDS = 2  # of cells that are known: free ones and obstacles; no weights are added for unknown ones
SHIFT = 8  # bits of a weight behind the point, and of what a hidden layer hands on
ODDS = 16  # parts of a nat in which chances are told
MOST_ODDS = 8  # nats, either way
_ROW = np.uint64((1 << SPAN) - 1)
_MIX, _SPREAD, _HALF = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xFF51AFD7ED558CCD), np.uint64(32)


class LearnedPrior(NamedTuple):
    """Weights, work space, and what was told before."""

    places: NDArray[np.int64]  # (commands, SPAN * SPAN): where each cell of the window is once it is turned
    first: NDArray[np.int16]  # (KINDS * SPAN * SPAN, hidden)
    first_bias: NDArray[np.int32]  # (hidden,)
    second: NDArray[np.int16]  # (hidden of the second layer, hidden)
    second_bias: NDArray[np.int32]
    last: NDArray[np.int32]  # (hidden of the second layer,)
    last_bias: NDArray[np.int32]  # (1,)
    chances: NDArray[np.float64]  # by log-odds, from -MOST_ODDS on
    inner: NDArray[np.uint64]  # a board: all cells but the rim, which is never free
    opened: NDArray[np.uint64]  # (SPAN,): the free cells of the window, row by row
    walls: NDArray[np.uint64]  # (SPAN,)
    sums: NDArray[np.int32]  # (hidden,)
    marks: NDArray[np.uint64]  # of each cell: a hash of its window when it was last asked about
    told: NDArray[np.uint8]  # and the place of the answer in ``chances``
    width: int  # words of a row


@in_place_kernel
def part_of_row(board, begin, width, column):
    """Return SPAN cells of a row from a column on; none is set beyond its ends."""
    word, shift = column >> 6, np.uint64(column & 63)
    cells = ZERO
    if 0 <= word < width:
        cells = board[begin + word] >> shift
    if shift > np.uint64(64 - SPAN) and word + 1 < width:
        cells |= board[begin + word + 1] << (np.uint64(64) - shift)
    return cells & _ROW


@in_place_kernel
def look(learned, opened, known, cell, command):
    """Cut out the window around a cell that is entered by a command; return a hash of it."""
    width = learned.width
    row, column = (cell >> 6) // width - RADIUS, (cell >> 6) % width * 64 + (cell & 63) - RADIUS
    mark = np.uint64(command)
    for i in range(SPAN):
        begin = (row + i) * width
        free, wall = ZERO, _ROW
        if 0 <= begin < known.shape[0]:
            seen = part_of_row(known, begin, width, column)
            free = part_of_row(opened, begin, width, column) & seen
            wall = (seen | (~part_of_row(learned.inner, begin, width, column) & _ROW)) & ~free
        learned.opened[i], learned.walls[i] = free, wall
        word = mark + ((free << np.uint64(SPAN)) | wall) + _MIX
        mark = (word ^ (word >> _HALF)) * _SPREAD
    return mark ^ (mark >> _HALF)


@in_place_kernel
def add_weights(learned, command, kind, row, cells):
    """Add to the sums the weights of some cells of one row of the window."""
    sums = learned.sums
    while cells != ZERO:
        weights = learned.first[learned.places[command, row * SPAN + lowest(cells)] + kind * SPAN * SPAN]
        for i in range(sums.shape[0]):
            sums[i] += weights[i]
        cells &= cells - ONE


@in_place_kernel
def log_odds(learned, command):
    """Return what the network tells of the window cut out last, in ODDS parts of a nat."""
    sums, none = learned.sums, np.int32(0)
    for i in range(sums.shape[0]):
        sums[i] = learned.first_bias[i]
    for row in range(SPAN):
        add_weights(learned, command, 0, row, learned.opened[row])
        add_weights(learned, command, 1, row, learned.walls[row])
    for i in range(sums.shape[0]):
        sums[i] = max(sums[i], none)
    total = np.int64(learned.last_bias[0])
    for k in range(learned.second.shape[0]):
        weights, value = learned.second[k], learned.second_bias[k]
        for i in range(sums.shape[0]):
            value += weights[i] * sums[i]
        total += np.int64(learned.last[k]) * (np.int64(max(value, none)) >> SHIFT)
    return (ODDS * total) >> (2 * SHIFT)


@in_place_kernel
def learned_chance(learned, opened, known, cell, command):
    """Return how likely a cell is to be free that is entered by a command."""
    mark = look(learned, opened, known, cell, command)
    if learned.marks[cell] != mark:
        learned.marks[cell] = mark
        at = log_odds(learned, command) + ODDS * MOST_ODDS
        learned.told[cell] = np.uint8(min(max(at, np.int64(0)), np.int64(2 * ODDS * MOST_ODDS - 1)))
    return learned.chances[learned.told[cell]]
