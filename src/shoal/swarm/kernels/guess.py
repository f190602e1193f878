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
from shoal.swarm.kernels.survey import COARSE, FINE, chance

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
    likely: NDArray[np.int64]  # (COARSE,): surroundings in which a cell is taken to be free: a bit for each pair beside it
    unlikely: NDArray[np.int64]  # (COARSE,): those in which it is taken to be wall at once
    active: NDArray[np.int64]  # the words with cells of this layer
    near: NDArray[np.int64]  # those and the words beside them
    listed: NDArray[np.bool_]  # (words,): whether a word is in the list that is being made
    layers: int
    rows: int
    width: int


@kernel
def predict(field, tallies, guess, depth, likely, sure):
    """Fill ``guess.open`` with the cells known to be free and those predicted so, layer by layer."""
    for fine in range(FINE):
        guess.chances[fine] = chance(tallies, fine, fine // PAIRS)
    for coarse in range(COARSE):
        seen = tallies[FINE + coarse, 0]  # of such surroundings or similar ones
        guess.unlikely[coarse] = marked(guess.chances, coarse, -1.0, UNLIKELY) if seen >= FEWEST else 0
    active = 0
    for i in range(field.open.shape[0]):
        guess.open[i] = field.open[i]
        guess.known[i] = field.known[i]
        guess.layer[i] = field.frontier[i]
        if field.frontier[i] != ZERO:
            guess.active[active] = i
            active += 1
    for layer in range(depth):
        # All cells on the way have to be free, so the farther, the surer each of them.
        needed = max(likely, sure ** (1.0 / (layer + 1.0)))
        for coarse in range(COARSE):
            guess.likely[coarse] = marked(guess.chances, coarse, needed, 2.0)
        near = list_near(guess, active)
        note_pairs(guess, guess.across, guess.width, near)
        note_pairs(guess, guess.beside, np.int64(0), near)
        if predict_walls(guess, active):
            note_pairs(guess, guess.across, guess.width, near)
            note_pairs(guess, guess.beside, np.int64(0), near)
        if not predict_layer(guess, active):
            return
        active = next_layer(guess, active)


@kernel
def marked(chances, coarse, above, below):
    """Return a bit for each pair beside a cell, in some coarse surroundings, with a chance between two bounds."""
    bits = np.int64(0)
    for here in range(PAIRS):
        if above < chances[coarse * PAIRS + here] < below:
            bits |= np.int64(1) << here
    return bits


@kernel
def list_near(guess, active):
    """List the words of the layer and those beside them, each once; return how many they are."""
    size, width = guess.layer.shape[0], guess.width
    steps = (np.int64(0), np.int64(1), width, width * guess.rows if guess.layers > 1 else width)
    near = 0
    for at in range(active):
        for step in steps:
            for word_at in (guess.active[at] - step, guess.active[at] + step):
                if 0 <= word_at < size and not guess.listed[word_at]:
                    guess.listed[word_at] = True
                    guess.near[near] = word_at
                    near += 1
    for at in range(near):
        guess.listed[guess.near[at]] = False
    return near


@kernel
def note_pairs(guess, pairs, step, near):
    """Fill the boards of pairs: neighbours ``step`` words before and after, one bit if that is 0; in the words listed."""
    for at in range(near):
        i = guess.near[at]
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
def predict_walls(guess, active):
    """Take those cells of the layer as known that are hardly ever free, so that the way between two walls is seen as such."""
    some = ZERO
    for at in range(active):
        i = guess.active[at]
        cells, walls = guess.layer[i], ZERO
        for command in range(4 if guess.layers == 1 else 6):
            entered = cells & behind(guess, guess.open, i, command)
            if entered != ZERO:
                walls |= those_in(guess, guess.unlikely, entered, i, command)
        guess.found[i] = walls
        some |= walls
    for at in range(active):
        i = guess.active[at]
        guess.known[i] |= guess.found[i]
    return some != ZERO


@kernel
def predict_layer(guess, active):
    """Find the cells of the layer that are taken to be free from every side that they can be entered from; tell if any are."""
    some = ZERO
    for at in range(active):
        i = guess.active[at]
        cells = guess.layer[i] & ~guess.known[i]
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
            wanted = table[state * PAIRS + near]
            if wanted == 0:
                continue
            those = some & behind(guess, pairs[near], i, command)
            if those == ZERO:
                continue
            for here in range(PAIRS):
                if wanted >> here & 1:
                    result |= those & pairs[here, i]
            some &= ~those  # a cell has one pair behind it
            if some == ZERO:
                break
    return result


@kernel
def next_layer(guess, active):
    """Take the layer as known, and go on behind the cells taken to be free; return how many words have cells of the next layer."""
    found, layer, width = guess.found, guess.layer, guess.width
    for at in range(active):
        i = guess.active[at]
        guess.open[i] |= found[i]
        guess.known[i] |= layer[i]
        layer[i] = ZERO
    steps = (width, width * guess.rows if guess.layers > 1 else width)
    following = 0
    for at in range(active):
        i = guess.active[at]
        cells = found[i]
        if cells == ZERO:
            continue
        following = add_to_layer(guess, i, (cells << ONE) | (cells >> ONE), following)
        following = add_to_layer(guess, i + 1, cells >> TOP, following)
        following = add_to_layer(guess, i - 1, cells << TOP, following)
        for step in steps:
            following = add_to_layer(guess, i - step, cells, following)
            following = add_to_layer(guess, i + step, cells, following)
    for at in range(following):
        guess.active[at] = guess.near[at]
    return following


@kernel
def add_to_layer(guess, i, cells, following):
    """Add the unknown ones of some cells to the layer, and their word to the list that is being made; return its length."""
    if cells == ZERO:  # the word may lie beyond the board
        return following
    new = cells & ~guess.known[i]
    if new != ZERO and guess.layer[i] == ZERO:
        guess.near[following] = i
        following += 1
    guess.layer[i] |= new
    return following
