"""Probability that a cell is free: a mean over several experts, weighted by their success in the
episode so far.

The count experts (models 0, 1, ...) compute the fraction of free cells among the classified cells
with equal surroundings. The fine surroundings of a cell are five cells: the cell behind the free
neighbour from which a particle enters, the two cells beside this neighbour, and the two cells
beside the cell itself. The coarse surroundings are the first three of these five cells. The
fraction for fine surroundings is smoothed towards the fraction for coarse surroundings. Model m > 0
uses the surroundings and the position of the cell modulo ``2**m``, because corridors of mazes,
trees and chips often lie on a lattice. In each episode, the count experts start without counts. The
last expert is a network trained on maps (`learned_prior`).

When a cell is classified, every expert estimates the probability of a free cell before the expert
learns the result. The weight of an expert is multiplied by the probability that the expert gave to
the result. After each classification, a small fraction of all weight is distributed evenly, so that
another expert can gain weight again.

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
from shoal.swarm.kernels.prediction.learned_prior import learn_bias, learned_chance

MODELS = 4
LEARNED = MODELS  # index of the learned expert, after the count experts
EXPERTS = MODELS + 1
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
# Order of the tallies: one tally for all cells; then, for each model, tallies of coarse and of fine
# surroundings at each place.
WEIGHT = 2.0  # weight of the coarser fraction, in cells
DEALT = 0.002  # fraction of all weight that each classification distributes evenly over the experts
LEAST = 0.01  # weight below which predictions leave out an expert


class OccupancyPrior(NamedTuple):
    """The counts and the weights of the experts."""

    # (places, 2): number of classified cells, number of free cells among the classified cells; row
    # 0 is for all cells
    tallies: NDArray[np.int64]
    weights: NDArray[np.float64]  # (EXPERTS,): weights with sum 1; 0 for an unused expert
    told: NDArray[
        np.float64
    ]  # (EXPERTS,): each expert's probability that the last classified cell is free
    before: NDArray[np.uint64]  # the cells known before the last command
    layers: int
    rows: int  # rows per layer
    width: int  # words per row


def size_of(layers: int) -> int:
    """Return the number of tallies (pairs of counts) that the count experts need for a map with
    ``layers`` layers.
    """
    axes = 2 if layers == 1 else 3
    return 1 + sum((COARSE + FINE) << (model * axes) for model in range(MODELS))


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
    one, other = state_of(opened, known, cell - side), state_of(opened, known, cell + side)
    low, high = min(one, other), max(one, other)
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
def place(prior, model, cell):
    """Return (index of the cell's position modulo ``2**model``, number of possible positions)."""
    mask = (np.int64(1) << model) - 1
    row = (cell >> 6) // prior.width
    if prior.layers == 1:
        return ((row & mask) << model) | (cell & mask), np.int64(1) << (2 * model)
    layer, within = row // prior.rows, row % prior.rows
    return ((((layer & mask) << model) | (within & mask)) << model) | (cell & mask), np.int64(
        1
    ) << (3 * model)


@in_place_kernel
def smoothed(tallies, entry, likely):
    """Return the fraction of free cells in one tally, smoothed towards the coarser fraction
    ``likely``.
    """
    return (tallies[entry, 1] + WEIGHT * likely) / (tallies[entry, 0] + WEIGHT)


@in_place_kernel
def chance(prior, model, number, cell):
    """Return one count expert's probability that a cell is free. ``number`` identifies the
    surroundings of the cell.
    """
    tallies, coarse, first = prior.tallies, number // PAIRS, 1
    likely = smoothed(tallies, 0, 0.5)
    for level in range(model):
        at, places = place(prior, level, cell)
        likely = smoothed(tallies, first + coarse * places + at, likely)
        first += (COARSE + FINE) * places
    at, places = place(prior, model, cell)
    likely = smoothed(tallies, first + coarse * places + at, likely)
    return smoothed(tallies, first + (COARSE + number) * places + at, likely)


@in_place_kernel
def counted_chance(prior, number, cell):
    """Return the weighted mean of the count experts' probabilities that a cell is free."""
    some, total = 0.0, 0.0
    for model in range(MODELS):
        if prior.weights[model] > LEAST:
            some += prior.weights[model]
            total += prior.weights[model] * chance(prior, model, number, cell)
    return total / some if some > 0.0 else 0.5


@in_place_kernel
def learn(prior, number, cell, free):
    """Compute every count expert's probability for a cell, as in `chance`, and then add the cell to
    the counts.

    Each count expert smooths its coarse fraction towards the coarse fraction of the previous count
    expert.
    """
    tallies, coarse, first = prior.tallies, number // PAIRS, 1
    likely, one = smoothed(tallies, 0, 0.5), np.int64(1) if free else np.int64(0)
    tallies[0, 0] += 1
    tallies[0, 1] += one
    for model in range(MODELS):
        at, places = place(prior, model, cell)
        coarsely, finely = first + coarse * places + at, first + (COARSE + number) * places + at
        likely = smoothed(tallies, coarsely, likely)
        prior.told[model] = smoothed(tallies, finely, likely)
        for entry in (coarsely, finely):
            tallies[entry, 0] += 1
            tallies[entry, 1] += one
        first += (COARSE + FINE) * places


@in_place_kernel
def weigh(prior, free):
    """Multiply each expert's weight by the probability that the expert gave to the result.

    Then distribute a small fraction of all weight evenly over the experts.
    """
    weights, total, having = prior.weights, 0.0, 0
    for expert in range(EXPERTS):
        weights[expert] *= prior.told[expert] if free else 1.0 - prior.told[expert]
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
                prior.told[LEARNED] = learned_chance(learned, field.open, before, cell, command)
                learn_bias(learned, prior.told[LEARNED], free)
            learn(prior, around(field.open, before, cell, step, side), cell, free)
            weigh(prior, free)
            new &= new - ONE
