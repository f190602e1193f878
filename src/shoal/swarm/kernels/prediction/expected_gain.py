"""Expected number of cells that a run of equal commands classifies, computed from learned
probabilities of free cells.

For each particle, a run of equal commands classifies unknown cells on the particle's path. The run
certainly classifies the first unknown cell on the path. The run classifies a later unknown cell
only if all cells before it on the path are free. The adaptive scan rule learns the probability of a
free cell only from the present episode. The probability that a cell is free is the fraction of free
cells among the classified cells with equal surroundings. This fraction is smoothed towards the
fraction for coarser surroundings.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.moves import ONE, ZERO, has, lowest
from shoal.swarm.kernels.prediction.occupancy_prior import (
    PAIRS,
    OccupancyPrior,
    around,
    chance,
    learn,
    steps_of,
)
from shoal.swarm.kernels.search import ahead

BEHIND = (
    PAIRS * PAIRS
)  # number of different surroundings for each state of the cell two steps behind a cell
_LEAST = 0.01  # probability of free space below which the kernel stops following a path


class ExpectedGain(NamedTuple):
    """The prices of a scan and a move, the learned counts, and the working memory of an adaptive
    scan rule.
    """

    prices: Any  # a record of PRICES
    # the scan rule uses only model 0; ``before`` holds the cells known before the run
    prior: OccupancyPrior
    gains: NDArray[
        np.float64
    ]  # (directions, longest run + 1): expected number of cells that each step of a run classifies
    columns: int  # cells per row, including the rim


@in_place_kernel
def learn_from_run(field, gain, command):
    """Learn from the cells that a run of equal commands has classified."""
    prior = gain.prior
    step, side = steps_of(prior.rows, prior.width, command)
    for i in range(field.known.shape[0]):
        new = field.known[i] & ~prior.before[i]
        while new != ZERO:
            cell = 64 * i + lowest(new)
            number = around(field.open, prior.before, cell, step, side)
            if number < BEHIND and is_free(field.open, cell - 2 * step):
                # the particle has passed the cell two steps behind in this run, so that cell is
                # free
                number += BEHIND
            learn(prior, number, cell, is_free(field.open, cell))
            new &= new - ONE


@in_place_kernel
def is_free(opened, cell):
    """Return whether a board (set of cells) contains a cell."""
    return (opened[cell >> 6] >> np.uint64(cell & 63)) & ONE != ZERO


@in_place_kernel
def on_rim(field, columns, row, column):
    """Return whether a cell lies at the border of the board, where the path of a particle ends."""
    layer, within = row // field.rows, row % field.rows
    if within == 0 or within == field.rows - 1 or column == 0 or column == columns - 1:
        return True
    return field.layers > 1 and (layer == 0 or layer == field.layers - 1)


@in_place_kernel
def look_ahead(field, gain, row, column, command):
    """Add to ``gain.gains`` the expected number of cells that one particle classifies with each
    step of a run.

    The path ends at the next particle on the path, because the next particle classifies the cells
    beyond its own cell.
    """
    gains, width, rows = gain.gains[command], field.width, field.rows
    step, side = steps_of(rows, width, command)
    likely = 1.0
    for moves in range(1, gains.shape[0]):
        row, column = ahead(row, column, command, rows)
        if has(field.occupied, width, row, column):
            return
        if has(field.known, width, row, column):
            if not has(field.open, width, row, column):
                return
            continue
        gains[moves] += likely
        if on_rim(field, gain.columns, row, column):
            return
        cell = 64 * width * row + column
        number = around(field.open, field.known, cell, step, side)
        if (
            moves >= 3 and number < BEHIND
        ):  # the path has passed the unknown cell two steps behind, so that cell counts as free
            number += BEHIND
        likely *= chance(gain.prior, 0, number, cell)
        if likely < _LEAST:
            return


@in_place_kernel
def gains_of_runs(field, gain, command):
    """Write to ``gain.gains`` the expected number of cells that each step of a run in the direction
    ``command`` classifies.
    """
    gains = gain.gains[command]
    for step in range(gains.shape[0]):
        gains[step] = 0.0
    for i in range(field.occupied.shape[0]):
        cells = field.occupied[i]
        while cells != ZERO:
            row, column = i // field.width, 64 * (i % field.width) + lowest(cells)
            cells &= cells - ONE
            look_ahead(field, gain, row, column, command)


@in_place_kernel
def best_length(gain, command, least):
    """Return (number of steps, classified cells per cost) of the best run in one direction with at
    least ``least`` steps.
    """
    gains = gain.gains[command]
    classified, best, best_rate = 0.0, least, 0.0
    for step in range(1, gains.shape[0]):
        classified += gains[step]
        rate = classified / (gain.prices.scan + gain.prices.move * step)
        if step >= least and rate > best_rate:
            best, best_rate = step, rate
    return best, best_rate
