"""What lies behind the frontier: predicted from how free space has gone on in the same surroundings in this episode.

`survey` tells for each of 108 surroundings of a cell, seen from a free neighbour, how likely it is to be free. Here all cells of a
board are looked at together: for each part of the surroundings there is a board of the cells where it is so.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.swarm.kernels.bits import ONE, TOP, ZERO
from shoal.swarm.kernels.compiling import kernel
from shoal.swarm.kernels.moves import DOWN, IN, LEFT, RIGHT, UP
from shoal.swarm.kernels.survey import FINE, chance

DEPTH = 12  # cells that a prediction goes beyond the frontier
LIKELY = 0.75  # chance above which a cell is taken to be free
PAIRS = 6  # unordered pairs of states: unknown, free, obstacle


class Guess(NamedTuple):
    """What is known and predicted; boards."""

    open: NDArray[np.uint64]  # free, or taken to be
    known: NDArray[np.uint64]  # known, or predicted
    layer: NDArray[np.uint64]  # cells to predict next
    found: NDArray[np.uint64]  # cells of this layer taken to be free
    inner: NDArray[np.uint64]  # all cells but the rim
    across: NDArray[np.uint64]  # (PAIRS, words): cells whose neighbours above and below are in such states
    beside: NDArray[np.uint64]  # (PAIRS, words): the same for left and right
    chances: NDArray[np.float64]  # (FINE,): how likely a cell is to be free in each surroundings
    likely: NDArray[np.bool_]  # (FINE,): surroundings in which a cell is taken to be free
    layers: int
    rows: int
    width: int


@kernel
def predict(field, tallies, guess, depth, likely, sure):
    """Fill ``guess.open`` with the cells known to be free and those predicted so, layer by layer."""
    for fine in range(FINE):
        guess.chances[fine] = chance(tallies, fine, fine // PAIRS)
    for i in range(field.open.shape[0]):
        guess.open[i] = field.open[i]
        guess.known[i] = field.known[i]
        guess.layer[i] = field.frontier[i] & guess.inner[i]
    for layer in range(depth):
        # All cells on the way have to be free, so the farther, the surer each of them.
        needed = max(likely, sure ** (1.0 / (layer + 1.0)))
        for fine in range(FINE):
            guess.likely[fine] = guess.chances[fine] > needed
        note_pairs(guess, guess.across, guess.width)
        note_pairs(guess, guess.beside, np.int64(0))
        if not predict_layer(guess):
            return
        next_layer(guess)


@kernel
def note_pairs(guess, pairs, step):
    """Fill the boards of pairs: neighbours ``step`` words before and after, or one bit if that is 0."""
    size = guess.open.shape[0]
    reach = np.int64(max(step, 1))
    for i in range(reach, size - reach):
        if guess.layer[i] == ZERO and not near_layer(guess, i):
            continue
        if step == 0:
            before_open, after_open = sideways(guess.open, i)
            before_known, after_known = sideways(guess.known, i)
        else:
            before_open, after_open = guess.open[i - step], guess.open[i + step]
            before_known, after_known = guess.known[i - step], guess.known[i + step]
        both, neither = before_known & after_known, ~(before_known | after_known)
        free, any_free = before_open & after_open, before_open | after_open
        pairs[0, i] = neither
        pairs[1, i] = any_free & ~both
        pairs[2, i] = free
        pairs[3, i] = ~neither & ~both & ~any_free
        pairs[4, i] = both & any_free & ~free
        pairs[5, i] = both & ~any_free


@kernel
def near_layer(guess, i):
    """Tell whether a word lies beside one with cells to predict."""
    layer, width, size = guess.layer, guess.width, guess.layer.shape[0]
    if layer[i - 1] | layer[i + 1] != ZERO:
        return True
    if layer[max(i - width, 0)] | layer[min(i + width, size - 1)] != ZERO:
        return True
    step = width * guess.rows
    return guess.layers > 1 and layer[max(i - step, 0)] | layer[min(i + step, size - 1)] != ZERO


@kernel
def sideways(board, i):
    """Return one word of a board as seen from one bit to the right of each cell and from one to the left."""
    return (board[i] << ONE) | (board[i - 1] >> TOP), (board[i] >> ONE) | (board[i + 1] << TOP)


@kernel
def behind(guess, board, i, command):
    """Return the word of a board with each cell moved one step by a command: what lies behind the cells of word ``i``."""
    if command == LEFT:
        return (board[i] >> ONE) | (board[i + 1] << TOP)
    if command == RIGHT:
        return (board[i] << ONE) | (board[i - 1] >> TOP)
    return board[i + back_step(guess, command)]


@kernel
def back_step(guess, command):
    """Return how many words further a cell lies than the one that a command across rows leads to."""
    if command == UP:
        return guess.width
    if command == DOWN:
        return -guess.width
    return guess.width * guess.rows if command == IN else -guess.width * guess.rows


@kernel
def twice_behind(guess, board, i, command):
    """Return what lies two steps behind the cells of word ``i``; outside of all is nothing."""
    two = np.uint64(2)
    if command == LEFT:
        return (board[i] >> two) | (board[i + 1] << np.uint64(62))
    if command == RIGHT:
        return (board[i] << two) | (board[i - 1] >> np.uint64(62))
    at = i + 2 * back_step(guess, command)
    return board[at] if 0 <= at < board.shape[0] else ZERO


@kernel
def predict_layer(guess):
    """Find the cells of the layer that are taken to be free from every side that they can be entered from; tell if any are."""
    some = ZERO
    for i in range(guess.layer.shape[0]):
        cells = guess.layer[i]
        guess.found[i] = ZERO
        if cells == ZERO:
            continue
        yes, no = ZERO, ZERO
        for command in range(4 if guess.layers == 1 else 6):
            entered = cells & behind(guess, guess.open, i, command)
            if entered != ZERO:
                free = taken_free(guess, entered, i, command)
                yes |= free
                no |= entered & ~free
        guess.found[i] = yes & ~no
        some |= guess.found[i]
    return some != ZERO


@kernel
def taken_free(guess, entered, i, command):
    """Return those of the cells of word ``i``, entered by a command, whose surroundings make them likely to be free."""
    pairs = guess.across if command == LEFT or command == RIGHT else guess.beside
    free, known = twice_behind(guess, guess.open, i, command), twice_behind(guess, guess.known, i, command)
    result = ZERO
    for state in range(3):
        some = entered & (~known if state == 0 else (free if state == 1 else known & ~free))
        if some == ZERO:
            continue
        for near in range(PAIRS):
            those = some & behind(guess, pairs[near], i, command)
            if those == ZERO:
                continue
            for here in range(PAIRS):
                if guess.likely[(state * PAIRS + near) * PAIRS + here]:
                    result |= those & pairs[here, i]
    return result


@kernel
def next_layer(guess):
    """Take the layer as known, and go on with the unknown neighbours of the cells just taken to be free."""
    found, layer, known, width = guess.found, guess.layer, guess.known, guess.width
    size = found.shape[0]
    for i in range(size):
        guess.open[i] |= found[i]
        known[i] |= layer[i]
        layer[i] = ZERO
    for i in range(width, size - width):
        cells = (found[i] << ONE) | (found[i] >> ONE) | (found[i - 1] >> TOP) | (found[i + 1] << TOP)
        layer[i] = (cells | found[i - width] | found[i + width]) & ~known[i] & guess.inner[i]
    if guess.layers > 1:
        step = width * guess.rows
        for i in range(step, size - step):
            layer[i] |= (found[i - step] | found[i + step]) & ~known[i] & guess.inner[i]
