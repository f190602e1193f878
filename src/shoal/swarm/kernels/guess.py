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

UNLIKELY = 0.25  # chance below which a cell is taken to be wall before others are looked at
FEWEST = 4  # cells seen in similar surroundings without which nothing is taken to be wall
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
    unlikely: NDArray[np.bool_]  # (FINE,): surroundings in which a cell is taken to be wall at once
    layers: int
    rows: int
    width: int


@kernel
def predict(field, tallies, guess, depth, likely, sure):
    """Fill ``guess.open`` with the cells known to be free and those predicted so, layer by layer."""
    for fine in range(FINE):
        guess.chances[fine] = chance(tallies, fine, fine // PAIRS)
        seen = tallies[FINE + fine // PAIRS, 0]  # of such surroundings or similar ones
        guess.unlikely[fine] = guess.chances[fine] < UNLIKELY and seen >= FEWEST
    for i in range(field.open.shape[0]):
        guess.open[i] = field.open[i]
        guess.known[i] = field.known[i]
        guess.layer[i] = field.frontier[i]
    for layer in range(depth):
        # All cells on the way have to be free, so the farther, the surer each of them.
        needed = max(likely, sure ** (1.0 / (layer + 1.0)))
        for fine in range(FINE):
            guess.likely[fine] = guess.chances[fine] > needed
        note_pairs(guess, guess.across, guess.width)
        note_pairs(guess, guess.beside, np.int64(0))
        if predict_walls(guess):
            note_pairs(guess, guess.across, guess.width)
            note_pairs(guess, guess.beside, np.int64(0))
        if not predict_layer(guess):
            return
        next_layer(guess)


@kernel
def note_pairs(guess, pairs, step):
    """Fill the boards of pairs: neighbours ``step`` words before and after, or one bit if that is 0."""
    size = guess.open.shape[0]
    for i in range(size):
        if guess.layer[i] == ZERO and not near_layer(guess, i):
            continue
        if step == 0:
            before_open, after_open = sideways(guess.open, i)
            before_known, after_known = sideways(guess.known, i)
        else:
            before_open, after_open = word(guess.open, i - step), word(guess.open, i + step)
            before_known, after_known = word(guess.known, i - step), word(guess.known, i + step)
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
    layer, width = guess.layer, guess.width
    if word(layer, i - 1) | word(layer, i + 1) | word(layer, i - width) | word(layer, i + width) != ZERO:
        return True
    step = width * guess.rows
    return guess.layers > 1 and word(layer, i - step) | word(layer, i + step) != ZERO


@kernel
def sideways(board, i):
    """Return one word of a board as seen from one bit to the right of each cell and from one to the left."""
    return (board[i] << ONE) | (word(board, i - 1) >> TOP), (board[i] >> ONE) | (word(board, i + 1) << TOP)


@kernel
def behind(guess, board, i, command):
    """Return the word of a board with each cell moved one step by a command: what lies behind the cells of word ``i``."""
    if command == LEFT:
        return (board[i] >> ONE) | (word(board, i + 1) << TOP)
    if command == RIGHT:
        return (board[i] << ONE) | (word(board, i - 1) >> TOP)
    return word(board, i + back_step(guess, command))


@kernel
def word(board, i):
    """Return a word of a board; outside of all is nothing."""
    return board[i] if 0 <= i < board.shape[0] else ZERO


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
    """Return what lies two steps behind the cells of word ``i``."""
    two = np.uint64(2)
    if command == LEFT:
        return (board[i] >> two) | (word(board, i + 1) << np.uint64(62))
    if command == RIGHT:
        return (board[i] << two) | (word(board, i - 1) >> np.uint64(62))
    return word(board, i + 2 * back_step(guess, command))


@kernel
def predict_walls(guess):
    """Take those cells of the layer as known that are hardly ever free, so that the way between two walls is seen as such."""
    some = ZERO
    for i in range(guess.layer.shape[0]):
        cells, walls = guess.layer[i], ZERO
        guess.found[i] = ZERO
        if cells == ZERO:
            continue
        for command in range(4 if guess.layers == 1 else 6):
            entered = cells & behind(guess, guess.open, i, command)
            if entered != ZERO:
                walls |= those_in(guess, guess.unlikely, entered, i, command)
        guess.found[i] = walls
        some |= walls
    for i in range(guess.layer.shape[0]):
        guess.known[i] |= guess.found[i]
    return some != ZERO


@kernel
def predict_layer(guess):
    """Find the cells of the layer that are taken to be free from every side that they can be entered from; tell if any are."""
    some = ZERO
    for i in range(guess.layer.shape[0]):
        cells = guess.layer[i] & ~guess.known[i]
        guess.found[i] = ZERO
        if cells == ZERO:
            continue
        yes, no = ZERO, ZERO
        for command in range(4 if guess.layers == 1 else 6):
            entered = cells & behind(guess, guess.open, i, command)
            if entered != ZERO:
                free = those_in(guess, guess.likely, entered, i, command)
                yes |= free
                no |= entered & ~free
        guess.found[i] = yes & ~no & guess.inner[i]
        some |= guess.found[i]
    return some != ZERO


@kernel
def those_in(guess, table, entered, i, command):
    """Return those of the cells of word ``i``, entered by a command, whose surroundings are marked in a table."""
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
                if table[(state * PAIRS + near) * PAIRS + here]:
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
    steps = (width, width * guess.rows if guess.layers > 1 else width)
    for i in range(size):
        cells = found[i]
        if cells == ZERO:
            continue
        layer[i] |= ((cells << ONE) | (cells >> ONE)) & ~known[i]
        layer[i + 1] |= (cells >> TOP) & ~known[i + 1]
        layer[i - 1] |= (cells << TOP) & ~known[i - 1]
        for step in steps:
            layer[i - step] |= cells & ~known[i - step]
            layer[i + step] |= cells & ~known[i + step]
