"""Prediction of free cells: the experts' probabilities, and the predicted map on and behind the
frontier.

Two experts estimate the probability that a cell is free. The count expert computes the fraction of
free cells among the classified cells with equal surroundings. The fine surroundings of a cell are
five cells: the cell behind the free neighbour from which a particle enters, the two cells beside
this neighbour, and the two cells beside the cell itself. The coarse surroundings are the first
three of these five cells. The fraction for fine surroundings is smoothed towards the fraction for
coarse surroundings. In each episode, the count expert starts without counts. The other expert is a
network trained on maps (`learned_prior`).

When a cell is classified, both experts estimate the probability of a free cell before they learn
the result. The weight of an expert is multiplied by the probability that the expert gave to the
result. After each classification, a small fraction of all weight is distributed evenly, so that the
other expert can gain weight again.

`predict` applies the experts layer by layer. The first layer is the frontier. Each later layer
consists of the unknown neighbours of cells that are predicted to be free.

Sources: docs/concepts/prediction.md; Dawid, Statistical theory: the prequential approach, Journal
of the Royal Statistical Society A 147 (1984); Herbster and Warmuth, Tracking the best expert,
Machine Learning 32 (1998).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.moves import DOWN, IN, LEFT, ONE, RIGHT, UP, ZERO, lowest
from shoal.swarm.kernels.planning.learned_prior import learn_bias, learned_chance

COUNTED, LEARNED = 0, 1  # indices of the experts
EXPERTS = 2
STATES, PAIRS = (
    3,
    6,
)  # number of states of a cell (unknown, free, obstacle); number of unordered pairs of states
COARSE = (
    STATES * PAIRS
)  # number of coarse surroundings: cell behind the free neighbour, pair beside the free neighbour
FINE = (
    COARSE * PAIRS
)  # number of fine surroundings: coarse surroundings, and the pair beside the cell
TALLIES = (
    1 + COARSE + FINE
)  # one tally for all cells, then tallies of coarse and of fine surroundings
WEIGHT = 2.0  # weight of the coarser fraction, in cells
DEALT = 0.002  # fraction of all weight that each classification distributes evenly over the experts
LEAST = 0.01  # weight below which predictions leave out an expert
UNLIKELY = 0.25  # probability of a free cell below which the kernel predicts a wall
FEWEST = (
    4  # minimum number of classified cells with similar surroundings for the prediction of a wall
)
UNDECIDED, WALL, FREE = 0, 1, 2
NOT_ASKED = -1.0


class OccupancyPrior(NamedTuple):
    """The counts of the count expert, and the weights of both experts."""

    tallies: NDArray[
        np.int64
    ]  # (TALLIES, 2): number of classified cells, number of free cells among the classified cells
    weights: NDArray[np.float64]  # (EXPERTS,): weights with sum 1; 0 for an unused expert
    forecasts: NDArray[
        np.float64
    ]  # (EXPERTS,): each expert's probability that the last classified cell is free
    before: NDArray[np.uint64]  # the cells known before the last command
    rows: int  # rows per layer
    width: int  # words per row


class OccupancyPrediction(NamedTuple):
    """The known and the predicted cells, as boards, and working memory of the prediction."""

    open: NDArray[np.uint64]  # cells known or predicted to be free
    known: NDArray[np.uint64]  # known or predicted cells
    inner: NDArray[np.uint64]  # all cells except the rim
    cells: NDArray[np.int64]  # the cells of the present layer, as 64 * word + bit
    following: NDArray[np.int64]  # the cells of the next layer
    verdicts: NDArray[np.int8]  # UNDECIDED, WALL or FREE for each cell of the present layer
    learned_chances: NDArray[
        np.float64
    ]  # results of the learned prior for the cells of the present layer
    chances: NDArray[
        np.float64
    ]  # (FINE,): results of `chance` for all surroundings; NOT_ASKED before the first use
    layers: int
    rows: int
    width: int


@in_place_kernel
def state_of(opened, known, cell):
    """Return 0 for an unknown cell, 1 for a free cell, and 2 for an obstacle. ``cell`` is 64 * word
    + bit.
    """
    word, bit = cell >> 6, np.uint64(cell & 63)
    certain = (known[word] >> bit) & ONE
    return np.int64(certain + certain - (certain & (opened[word] >> bit)))


@in_place_kernel
def steps_of(rows, width, command):
    """Return two offsets in cell numbers: a step in the direction of a command, and a step at right
    angles to it.
    """
    row = 64 * width
    if command == LEFT or command == RIGHT:
        return (-1 if command == LEFT else 1), row
    if command == UP or command == DOWN:
        return (-row if command == UP else row), 1
    layer = row * rows
    return (-layer if command == IN else layer), 1


@in_place_kernel
def pair_at(opened, known, cell, side):
    """Return a number from 0 to 5 that identifies the states of the two cells beside a cell,
    regardless of their order.
    """
    first, second = state_of(opened, known, cell - side), state_of(opened, known, cell + side)
    low, high = min(first, second), max(first, second)
    return high * (high + 1) // 2 + low


@in_place_kernel
def around(opened, known, cell, step, side):
    """Return the number of the surroundings of a cell that a particle enters by ``step`` from a
    free cell.

    The free cell from which the particle comes is not on the rim of the board, so all surrounding
    cells are on the board.
    """
    number = state_of(opened, known, cell - 2 * step)
    number = number * PAIRS + pair_at(opened, known, cell - step, side)
    return number * PAIRS + pair_at(opened, known, cell, side)


@in_place_kernel
def smooth(tallies, entry, likely):
    """Return the fraction of free cells in one tally, smoothed towards the coarser fraction
    ``likely``.
    """
    return (tallies[entry, 1] + WEIGHT * likely) / (tallies[entry, 0] + WEIGHT)


@in_place_kernel
def chance(prior, number):
    """Return the count expert's probability that a cell is free. ``number`` identifies the
    surroundings of the cell.
    """
    tallies = prior.tallies
    likely = smooth(tallies, 0, 0.5)
    likely = smooth(tallies, 1 + number // PAIRS, likely)
    return smooth(tallies, 1 + COARSE + number, likely)


@in_place_kernel
def learn(prior, number, free):
    """Compute the count expert's probability for a cell, and then add the cell to the counts."""
    prior.forecasts[COUNTED] = chance(prior, number)
    for entry in (0, 1 + number // PAIRS, 1 + COARSE + number):
        prior.tallies[entry, 0] += 1
        prior.tallies[entry, 1] += 1 if free else 0


@in_place_kernel
def weigh(prior, free):
    """Multiply each expert's weight by the probability that the expert gave to the result.

    Then distribute a small fraction of all weight evenly over the experts.
    """
    weights, total, having = prior.weights, 0.0, 0
    for expert in range(EXPERTS):
        weights[expert] *= prior.forecasts[expert] if free else 1.0 - prior.forecasts[expert]
        total += weights[expert]
        having += 1 if weights[expert] > 0.0 else 0
    for expert in range(EXPERTS):
        if weights[expert] > 0.0:
            weights[expert] = (1.0 - DEALT) * weights[expert] / total + DEALT / having


@in_place_kernel
def learn_from_command(field, prior, learned, command):
    """Learn from all cells that the last command has classified."""
    before = prior.before
    step, side = steps_of(prior.rows, prior.width, command)
    for i in range(field.known.shape[0]):
        new = field.known[i] & ~before[i]
        while new != ZERO:
            cell, free = 64 * i + lowest(new), field.open[i] & new & (~new + ONE) != ZERO
            if prior.weights[LEARNED] > 0.0:
                prior.forecasts[LEARNED] = learned_chance(
                    learned, field.open, before, cell, command
                )
                learn_bias(learned, prior.forecasts[LEARNED], free)
            learn(prior, around(field.open, before, cell, step, side), free)
            weigh(prior, free)
            new &= new - ONE


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
def cached_chance(prediction, prior, number):
    """Return the result of `chance` for fine surroundings. The kernel computes each result only
    once in a prediction.
    """
    if prediction.chances[number] == NOT_ASKED:
        prediction.chances[number] = chance(prior, number)
    return prediction.chances[number]


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
    opened, known, tallies, share = (
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
            prediction.learned_chances[k] = ask_learned(prediction, learned, cell)
        for command in range(directions):
            step, side = steps_of(prediction.rows, prediction.width, command)
            if not is_open(opened, cell - step):
                continue
            number = around(opened, known, cell, step, side)
            if mean_chance(prediction, prior, k, number) < UNLIKELY and (
                share > 0.5 or tallies[number // PAIRS, 0] >= FEWEST
            ):
                prediction.verdicts[k] = WALL
                break
    for k in range(size):
        if prediction.verdicts[k] == WALL:
            mark(known, prediction.cells[k])


@in_place_kernel
def mean_chance(prediction, prior, k, number):
    """Return the weighted mean of the experts' probabilities that cell number k of the layer is
    free.
    """
    share = prior.weights[LEARNED]
    if share <= LEAST:
        return cached_chance(prediction, prior, number)
    if share >= 1.0 - LEAST:
        return prediction.learned_chances[k]
    return share * prediction.learned_chances[k] + (1.0 - share) * cached_chance(
        prediction, prior, number
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
            share > LEAST and prediction.learned_chances[k] <= needed
        ):  # walls predicted by `find_walls` may change the result
            prediction.learned_chances[k] = ask_learned(prediction, learned, cell)
        for command in range(directions):
            step, side = steps_of(prediction.rows, prediction.width, command)
            if not is_open(opened, cell - step):
                continue
            prediction.verdicts[k] = FREE
            if (
                not mean_chance(prediction, prior, k, around(opened, known, cell, step, side))
                > needed
            ):
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
