"""The learned prior: a small neural network, trained on maps, that estimates the probability that a
cell is free.

The network computes only with integers, so all machines give equal results. The input of the
network is the belief in a square window around a cell. A particle can enter this cell from any of
the neighbouring cells. The kernel first rotates the window, so that the particle always enters the
cell at the window's centre from below. The kernel keeps the network's result for a cell until a
cell in the window becomes known.

The training does not know how many of the cells that an episode will classify are free. This share
depends on the map and on the number of particles. The kernel therefore adds a bias to the log-odds
of the network, and learns the bias during the episode (`learn_bias`).

The page docs/concepts/prediction.md explains the learned prior.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.moves import ONE, ZERO, lowest

RADIUS = 7  # number of cells from the centre of the window to its border
SPAN = 2 * RADIUS + 1
KINDS = 2  # kinds of known cells (free cell, obstacle); unknown cells add no weights
SHIFT = 8  # number of fractional bits of a weight and of the outputs of a hidden layer
ODDS = 16  # number of units of log-odds per nat
MOST_ODDS = 8  # maximum absolute value of the log-odds, in nats
_ROW = np.uint64((1 << SPAN) - 1)
_MIX, _SPREAD, _HALF = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xFF51AFD7ED558CCD), np.uint64(32)


class LearnedPrior(NamedTuple):
    """The weights of the network, working memory, and stored results."""

    places: NDArray[
        np.int64
    ]  # (commands, SPAN * SPAN): index of each cell of the window after the rotation for a command
    first: NDArray[np.int16]  # (KINDS * SPAN * SPAN, hidden)
    first_bias: NDArray[np.int32]  # (hidden,)
    second: NDArray[np.int16]  # (hidden of the second layer, hidden)
    second_bias: NDArray[np.int32]
    last: NDArray[np.int32]  # (hidden of the second layer,)
    last_bias: NDArray[np.int32]  # (1,)
    chances: NDArray[np.float64]  # table of probabilities for log-odds from -MOST_ODDS on
    inner: NDArray[np.uint64]  # all cells except the rim, which is never free
    opened: NDArray[np.uint64]  # (SPAN,): the known free cells of the window, one word for each row
    walls: NDArray[np.uint64]  # (SPAN,)
    used: NDArray[
        np.int64
    ]  # (SPAN * SPAN,): indices of the rows of ``first`` for the known cells of the window
    sums: NDArray[
        np.int16
    ]  # (hidden,); with the trained weights, every sum fits into 16 bits, and every result into 32 bits
    marks: NDArray[np.uint64]  # for each cell: hash of the window at the last evaluation
    outputs: NDArray[
        np.uint8
    ]  # for each cell: index of the network's result in ``chances``, without the bias
    bias: NDArray[
        np.float64
    ]  # (1,): bias of the log-odds in the current episode, in units of 1 / ODDS
    width: int  # words per row


@in_place_kernel
def part_of_row(board, begin, width, column):
    """Return SPAN cells of a row of a board, beginning with ``column``. The bits of cells beyond
    the end of the row are 0.
    """
    word, shift = column >> 6, np.uint64(column & 63)
    cells = ZERO
    if 0 <= word < width:
        cells = board[begin + word] >> shift
    if shift > np.uint64(64 - SPAN) and word + 1 < width:
        cells |= board[begin + word + 1] << (np.uint64(64) - shift)
    return cells & _ROW


@in_place_kernel
def look(learned, opened, known, cell, command):
    """Cut out the window around a cell that a particle would enter with ``command``. Return a hash
    of window and command.
    """
    width = learned.width
    row, column = (cell >> 6) // width - RADIUS, (cell >> 6) % width * 64 + (cell & 63) - RADIUS
    mark = np.uint64(command)
    for i in range(SPAN):
        begin = (row + i) * width
        free, wall = ZERO, _ROW
        if 0 <= begin < known.shape[0]:
            known_row = part_of_row(known, begin, width, column)
            free = part_of_row(opened, begin, width, column) & known_row
            wall = (known_row | (~part_of_row(learned.inner, begin, width, column) & _ROW)) & ~free
        learned.opened[i], learned.walls[i] = free, wall
        word = mark + ((free << np.uint64(SPAN)) | wall) + _MIX
        mark = (word ^ (word >> _HALF)) * _SPREAD
    return mark ^ (mark >> _HALF)


@in_place_kernel
def list_weights(learned, command, kind, row, cells, size):
    """For each of the given cells in one row of the window, append the index of its row of
    ``first`` to the list ``used``.

    Return the length of the list.
    """
    while cells != ZERO:
        learned.used[size] = (
            learned.places[command, row * SPAN + lowest(cells)] + kind * SPAN * SPAN
        )
        cells &= cells - ONE
        size += 1
    return size


@in_place_kernel
def add_weights(learned, size):
    """Add the rows of ``first`` that the list ``used`` contains to ``sums``.

    The loop adds four rows at once, because storing the sums takes most of the time.
    """
    first, sums, used = learned.first, learned.sums, learned.used
    for at in range(0, size - 3, 4):
        a, b, c, d = first[used[at]], first[used[at + 1]], first[used[at + 2]], first[used[at + 3]]
        for i in range(sums.shape[0]):
            sums[i] += a[i] + b[i] + c[i] + d[i]
    for at in range(size - size % 4, size):
        a = first[used[at]]
        for i in range(sums.shape[0]):
            sums[i] += a[i]


@in_place_kernel
def log_odds(learned, command):
    """Return the log-odds that the network computes for the window that `look` has cut out, in
    units of 1 / ODDS nat.
    """
    sums, none = learned.sums, np.int16(0)
    for i in range(sums.shape[0]):
        sums[i] = learned.first_bias[i]
    size = np.int64(0)
    for row in range(SPAN):
        size = list_weights(learned, command, 0, row, learned.opened[row], size)
        size = list_weights(learned, command, 1, row, learned.walls[row], size)
    add_weights(learned, size)
    for i in range(sums.shape[0]):
        sums[i] = max(sums[i], none)
    total = np.int64(learned.last_bias[0])
    for k in range(learned.second.shape[0]):
        weights, value = learned.second[k], learned.second_bias[k]
        for i in range(sums.shape[0]):
            value = np.int32(
                value + np.int32(weights[i]) * np.int32(sums[i])
            )  # 32 bits, because 64 bits would take twice as long
        total += np.int64(learned.last[k]) * (max(np.int64(value), np.int64(0)) >> SHIFT)
    return (ODDS * total) >> (2 * SHIFT)


@in_place_kernel
def learned_chance(learned, opened, known, cell, command):
    """Return the probability that a cell is free. A particle would enter the cell with the command
    ``command``.
    """
    mark = look(learned, opened, known, cell, command)
    if learned.marks[cell] != mark:
        learned.marks[cell] = mark
        at = log_odds(learned, command) + ODDS * MOST_ODDS
        learned.outputs[cell] = np.uint8(
            min(max(at, np.int64(0)), np.int64(2 * ODDS * MOST_ODDS - 1))
        )
    at = np.int64(learned.outputs[cell]) + np.int64(np.floor(learned.bias[0] + 0.5))
    return learned.chances[min(max(at, np.int64(0)), np.int64(2 * ODDS * MOST_ODDS - 1))]


@in_place_kernel
def learn_bias(learned, chance, free):
    """Add the error of a probability to the bias: one step of stochastic gradient descent on the
    log loss, with the rate 1 / ODDS.

    ``chance`` is the probability from `learned_chance` that a cell is free, and ``free`` is the
    outcome.
    """
    learned.bias[0] += (1.0 if free else 0.0) - chance
