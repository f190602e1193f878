"""Prediction of the cells behind the frontier by the experts of `occupancy_prior`, layer by layer."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.dynamics.bits import ONE, ZERO, lowest
from shoal.swarm.kernels.prediction.learned_prior import learned_chance
from shoal.swarm.kernels.prediction.occupancy_prior import LEARNED, LEAST, MODELS, PAIRS, around, counted_chance, place, steps_of

UNLIKELY = 0.25  # probability below which a cell is predicted as wall before other cells are evaluated
FEWEST = 4  # minimum number of cells seen in similar surroundings for predicting a wall
UNDECIDED, WALL, FREE = 0, 1, 2
NOT_ASKED = -1.0


class OccupancyPrediction(NamedTuple):
    """Known and predicted cells, as boards."""

    open: NDArray[np.uint64]  # known or predicted free cells
    known: NDArray[np.uint64]  # known or predicted cells
    inner: NDArray[np.uint64]  # all cells except the rim
    cells: NDArray[np.int64]  # the cells of this layer, as 64 * word + bit
    following: NDArray[np.int64]  # the cells of the next layer
    verdicts: NDArray[np.int8]  # marks of the cells of this layer
    told: NDArray[np.float64]  # results of the learned expert for the cells of this layer
    chances: NDArray[np.float64]  # results for each surroundings at each place; NOT_ASKED if not computed yet
    layers: int
    rows: int
    width: int


@in_place_kernel
def predict(field, prior, learned, prediction, depth, likely, sure):
    """Fill ``prediction.open`` with the known free cells and the cells predicted as free, layer by layer."""
    size = np.int64(0)
    prediction.chances[:] = NOT_ASKED
    for i in range(field.open.shape[0]):
        prediction.open[i] = field.open[i]
        prediction.known[i] = field.known[i]
        size = list_cells(prediction.cells, size, i, field.frontier[i])
    for layer in range(depth):
        # All cells of a path must be free, so cells farther away need a higher probability.
        needed = max(likely, sure ** (1.0 / (layer + 1.0)))
        find_walls(prediction, prior, learned, size)
        if not find_free(prediction, prior, learned, size, needed):
            return
        size = next_layer(prediction, size)


@in_place_kernel
def list_cells(cells, size, i, word):
    """Append the cells of one word of a board to a list. Return its length."""
    while word != ZERO:
        cells[size] = 64 * i + lowest(word)
        word &= word - ONE
        size += 1
    return size


@in_place_kernel
def counted(prediction, prior, cell, number):
    """Return the result of `counted_chance`, which is computed once for each surroundings at each place."""
    at, places = place(prior, MODELS - 1, cell)
    entry = number * places + at
    if prediction.chances[entry] == NOT_ASKED:
        prediction.chances[entry] = counted_chance(prior, number, cell)
    return prediction.chances[entry]


@in_place_kernel
def ask_learned(prediction, learned, cell):
    """Return the learned expert's result for a cell, seen from the first side from which it can be entered."""
    for command in range(4):
        if is_open(prediction.open, cell - steps_of(prediction.rows, prediction.width, command)[0]):
            return learned_chance(learned, prediction.open, prediction.known, cell, command)
    return 0.5


@in_place_kernel
def find_walls(prediction, prior, learned, size):
    """Mark cells of the layer that are hardly ever free as known walls, so that corridors between them are recognized."""
    opened, known, seen, share = prediction.open, prediction.known, prior.tallies[1:], prior.weights[LEARNED]
    directions = 4 if prediction.layers == 1 else 6
    for k in range(size):
        cell = prediction.cells[k]
        prediction.verdicts[k] = UNDECIDED if is_open(prediction.inner, cell) else WALL
        if prediction.verdicts[k] == WALL:
            continue
        if share > LEAST:
            prediction.told[k] = ask_learned(prediction, learned, cell)
        for command in range(directions):
            step, side = steps_of(prediction.rows, prediction.width, command)
            if not is_open(opened, cell - step):
                continue
            number = around(opened, known, cell, step, side)
            if mixed(prediction, prior, k, number) < UNLIKELY and (share > 0.5 or seen[number // PAIRS, 0] >= FEWEST):
                prediction.verdicts[k] = WALL
                break
    for k in range(size):
        if prediction.verdicts[k] == WALL:
            mark(known, prediction.cells[k])


@in_place_kernel
def mixed(prediction, prior, k, number):
    """Return the mixed probability of all experts that a cell of the layer is free."""
    share = prior.weights[LEARNED]
    if share <= LEAST:
        return counted(prediction, prior, prediction.cells[k], number)
    if share >= 1.0 - LEAST:
        return prediction.told[k]
    return share * prediction.told[k] + (1.0 - share) * counted(prediction, prior, prediction.cells[k], number)


@in_place_kernel
def find_free(prediction, prior, learned, size, needed):
    """Find the cells of the layer that are predicted free from every possible entry side. Return whether there are any."""
    opened, known, share = prediction.open, prediction.known, prior.weights[LEARNED]
    directions, some = 4 if prediction.layers == 1 else 6, False
    for k in range(size):
        cell = prediction.cells[k]
        if prediction.verdicts[k] == WALL:
            continue
        if share > LEAST and prediction.told[k] <= needed:  # the new walls may change the results
            prediction.told[k] = ask_learned(prediction, learned, cell)
        for command in range(directions):
            step, side = steps_of(prediction.rows, prediction.width, command)
            if not is_open(opened, cell - step):
                continue
            prediction.verdicts[k] = FREE
            if not mixed(prediction, prior, k, around(opened, known, cell, step, side)) > needed:
                prediction.verdicts[k] = UNDECIDED
                break
        some |= prediction.verdicts[k] == FREE
    return some


@in_place_kernel
def is_open(board, cell):
    """Return whether a cell is on a board. Cells beyond the board are not."""
    word = cell >> 6
    return 0 <= word < board.shape[0] and (board[word] >> np.uint64(cell & 63)) & ONE != ZERO


@in_place_kernel
def mark(board, cell):
    """Add a cell to a board."""
    board[cell >> 6] |= ONE << np.uint64(cell & 63)


@in_place_kernel
def next_layer(prediction, size):
    """Mark the layer as known and continue behind its free cells. Return the number of cells of the next layer."""
    for k in range(size):
        mark(prediction.known, prediction.cells[k])
        if prediction.verdicts[k] == FREE:
            mark(prediction.open, prediction.cells[k])
    following, row = np.int64(0), 64 * prediction.width
    for k in range(size):
        if prediction.verdicts[k] != FREE:
            continue
        cell = prediction.cells[k]  # it is not on the rim, so it has all its neighbours
        for step in (np.int64(1), row, row * prediction.rows):
            if step == row * prediction.rows and prediction.layers == 1:
                continue
            for near in (cell - step, cell + step):
                if not (prediction.known[near >> 6] >> np.uint64(near & 63)) & ONE:
                    mark(prediction.known, near)  # so that it is listed once
                    prediction.following[following] = near
                    following += 1
    for k in range(following):
        prediction.cells[k] = prediction.following[k]
        prediction.known[prediction.cells[k] >> 6] &= ~(ONE << np.uint64(prediction.cells[k] & 63))
    return following
