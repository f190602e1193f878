"""What lies behind the frontier: predicted from how free space has gone on in the same surroundings in this episode."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.swarm.kernels.bits import ONE, ZERO, has, lowest
from shoal.swarm.kernels.compiling import kernel
from shoal.swarm.kernels.search import ahead, opposite
from shoal.swarm.kernels.survey import FINE, chance, surroundings

DEPTH = 12  # cells that a prediction goes beyond the frontier
LIKELY = 0.75  # chance above which a cell is taken to be free


class Guess(NamedTuple):
    """What is known and predicted, as `survey` asks for it."""

    open: NDArray[np.uint64]  # free, or taken to be
    known: NDArray[np.uint64]  # known, or predicted
    layer: NDArray[np.uint64]  # cells to predict next
    found: NDArray[np.uint64]  # cells of this layer taken to be free
    chances: NDArray[np.float64]  # (FINE,): of each surroundings
    columns: int
    layers: int
    rows: int
    width: int


@kernel
def predict(field, tallies, guess, depth, likely):
    """Fill ``guess.open`` with the cells known to be free and those predicted so, layer by layer."""
    for fine in range(FINE):
        guess.chances[fine] = chance(tallies, fine, fine // 6)
    for i in range(field.open.shape[0]):
        guess.open[i] = field.open[i]
        guess.known[i] = field.known[i]
        guess.layer[i] = field.frontier[i]
        guess.found[i] = ZERO
    for _ in range(depth):
        if not predict_layer(guess, likely):
            return
        for i in range(guess.open.shape[0]):
            guess.open[i] |= guess.found[i]
            guess.known[i] |= guess.layer[i]
            guess.layer[i] = ZERO
        next_layer(guess)


@kernel
def predict_layer(guess, likely):
    """Find the cells of the layer that are taken to be free; tell whether there are any."""
    some = False
    for i in range(guess.layer.shape[0]):
        cells, found = guess.layer[i], ZERO
        while cells != ZERO:
            bit = lowest(cells)
            cells &= cells - ONE
            if free_chance(guess, i // guess.width, 64 * (i % guess.width) + bit) > likely:
                found |= ONE << np.uint64(bit)
        guess.found[i] = found
        some = some or found != ZERO
    return some


@kernel
def inside(guess, row, column):
    """Tell whether a cell lies inside the rim: outside all is wall."""
    layer, within = row // guess.rows, row % guess.rows
    if within < 1 or within >= guess.rows - 1 or column < 1 or column >= guess.columns - 1:
        return False
    return guess.layers == 1 or (layer >= 1 and layer < guess.layers - 1)


@kernel
def free_chance(guess, row, column):
    """Return how likely a cell is to be free: the mean over its free neighbours, from each of which it may be entered."""
    if not inside(guess, row, column):
        return 0.0
    total, ways = 0.0, 0
    for command in range(4 if guess.layers == 1 else 6):
        r, c = ahead(row, column, opposite(command), guess.rows)
        if not has(guess.open, guess.width, r, c):
            continue
        fine, _ = surroundings(guess, guess.known, row, column, command)
        total += guess.chances[fine]
        ways += 1
    return total / max(ways, 1)


@kernel
def next_layer(guess):
    """Fill the layer with the unknown neighbours of the cells just taken to be free."""
    for i in range(guess.found.shape[0]):
        cells = guess.found[i]
        while cells != ZERO:
            row, column = i // guess.width, 64 * (i % guess.width) + lowest(cells)
            cells &= cells - ONE
            for command in range(4 if guess.layers == 1 else 6):
                r, c = ahead(row, column, command, guess.rows)
                if not has(guess.known, guess.width, r, c):
                    guess.layer[r * guess.width + (c >> 6)] |= ONE << np.uint64(c & 63)
