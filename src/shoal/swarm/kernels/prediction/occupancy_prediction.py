"""Prediction of free cells on and behind the frontier, layer by layer, with the experts of
`occupancy_prior`.

The first layer is the frontier. Each later layer consists of the unknown neighbours of cells that
are predicted to be free.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.moves import ONE, ZERO, lowest
from shoal.swarm.kernels.prediction.learned_prior import learned_chance
from shoal.swarm.kernels.prediction.occupancy_prior import (
    LEARNED,
    LEAST,
    MODELS,
    PAIRS,
    around,
    counted_chance,
    place,
    steps_of,
)

UNLIKELY = 0.25  # probability of a free cell below which the kernel predicts a wall
FEWEST = (
    4  # minimum number of classified cells with similar surroundings for the prediction of a wall
)
UNDECIDED, WALL, FREE = 0, 1, 2
NOT_ASKED = -1.0


class OccupancyPrediction(NamedTuple):
    """The known and the predicted cells, as boards, and working memory of the prediction."""

    open: NDArray[np.uint64]  # cells known or predicted to be free
    known: NDArray[np.uint64]  # known or predicted cells
    inner: NDArray[np.uint64]  # all cells except the rim
    cells: NDArray[np.int64]  # the cells of the present layer, as 64 * word + bit
    following: NDArray[np.int64]  # the cells of the next layer
    verdicts: NDArray[np.int8]  # UNDECIDED, WALL or FREE for each cell of the present layer
    told: NDArray[np.float64]  # results of the learned prior for the cells of the present layer
    chances: NDArray[
        np.float64
    ]  # results of `counted_chance` for all surroundings at all places; NOT_ASKED before the first use
    layers: int
    rows: int
    width: int


@in_place_kernel
def predict(field, prior, learned, prediction, depth, likely, sure):
    """Write to ``prediction.open`` the known free cells and the cells predicted to be free, layer
    by layer.
    """
    size = np.int64(0)
    prediction.chances[:] = NOT_ASKED
    for i in range(field.open.shape[0]):
        prediction.open[i] = field.open[i]
        prediction.known[i] = field.known[i]
        size = list_cells(prediction.cells, size, i, field.frontier[i])
    for layer in range(depth):
        # All cells of a path must be free, so cells in later layers need a higher probability.
        needed = max(likely, sure ** (1.0 / (layer + 1.0)))
        find_walls(prediction, prior, learned, size)
        if not find_free(prediction, prior, learned, size, needed):
            return
        size = next_layer(prediction, size)


@in_place_kernel
def list_cells(cells, size, i, word):
    """Append the cells in one word of a board to a list. Return the length of the list."""
    while word != ZERO:
        cells[size] = 64 * i + lowest(word)
        word &= word - ONE
        size += 1
    return size


@in_place_kernel
def counted(prediction, prior, cell, number):
    """Return the result of `counted_chance` for a cell.

    The kernel computes each result of `counted_chance` only once, and stores it.
    """
    at, places = place(prior, MODELS - 1, cell)
    entry = number * places + at
    if prediction.chances[entry] == NOT_ASKED:
        prediction.chances[entry] = counted_chance(prior, number, cell)
    return prediction.chances[entry]


@in_place_kernel
def ask_learned(prediction, learned, cell):
    """Return the learned prior's probability that a cell is free, for the first side from which a
    particle can enter the cell.
    """
    for command in range(4):
        if is_open(prediction.open, cell - steps_of(prediction.rows, prediction.width, command)[0]):
            return learned_chance(learned, prediction.open, prediction.known, cell, command)
    return 0.5


@in_place_kernel
def find_walls(prediction, prior, learned, size):
    """Predict walls in the cells of the layer that are probably not free.

    The kernel predicts walls before `find_free` predicts free cells, because the experts recognize
    corridors between known walls.
    """
    opened, known, seen, share = (
        prediction.open,
        prediction.known,
        prior.tallies[1:],
        prior.weights[LEARNED],
    )
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
            if mixed(prediction, prior, k, number) < UNLIKELY and (
                share > 0.5 or seen[number // PAIRS, 0] >= FEWEST
            ):
                prediction.verdicts[k] = WALL
                break
    for k in range(size):
        if prediction.verdicts[k] == WALL:
            mark(known, prediction.cells[k])


@in_place_kernel
def mixed(prediction, prior, k, number):
    """Return the weighted mean of all experts' probabilities that cell number k of the layer is
    free.
    """
    share = prior.weights[LEARNED]
    if share <= LEAST:
        return counted(prediction, prior, prediction.cells[k], number)
    if share >= 1.0 - LEAST:
        return prediction.told[k]
    return share * prediction.told[k] + (1.0 - share) * counted(
        prediction, prior, prediction.cells[k], number
    )


@in_place_kernel
def find_free(prediction, prior, learned, size, needed):
    """Predict which cells of the layer are free. Return whether any cell of the layer is predicted
    to be free.

    A cell is predicted to be free if its probability exceeds ``needed`` for every side from which a
    particle can enter the cell.
    """
    opened, known, share = prediction.open, prediction.known, prior.weights[LEARNED]
    directions, some = 4 if prediction.layers == 1 else 6, False
    for k in range(size):
        cell = prediction.cells[k]
        if prediction.verdicts[k] == WALL:
            continue
        if (
            share > LEAST and prediction.told[k] <= needed
        ):  # walls predicted by `find_walls` may change the result
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
    """Return whether a board contains a cell. For a cell outside the words of the board, return
    false.
    """
    word = cell >> 6
    return 0 <= word < board.shape[0] and (board[word] >> np.uint64(cell & 63)) & ONE != ZERO


@in_place_kernel
def mark(board, cell):
    """Add a cell to a board."""
    board[cell >> 6] |= ONE << np.uint64(cell & 63)


@in_place_kernel
def next_layer(prediction, size):
    """Mark the cells of the layer as known, and list the unknown neighbours of the layer's free
    cells as the next layer.

    Return the number of cells in the next layer.
    """
    for k in range(size):
        mark(prediction.known, prediction.cells[k])
        if prediction.verdicts[k] == FREE:
            mark(prediction.open, prediction.cells[k])
    following, row = np.int64(0), 64 * prediction.width
    for k in range(size):
        if prediction.verdicts[k] != FREE:
            continue
        cell = prediction.cells[k]  # a free cell is not on the rim, so it has all neighbours
        for step in (np.int64(1), row, row * prediction.rows):
            if step == row * prediction.rows and prediction.layers == 1:
                continue
            for near in (cell - step, cell + step):
                if not (prediction.known[near >> 6] >> np.uint64(near & 63)) & ONE:
                    mark(prediction.known, near)  # so that the loop lists the cell only once
                    prediction.following[following] = near
                    following += 1
    for k in range(following):
        prediction.cells[k] = prediction.following[k]
        prediction.known[prediction.cells[k] >> 6] &= ~(ONE << np.uint64(prediction.cells[k] & 63))
    return following
