"""How much a run of equal commands is expected to classify, and what was learnt of how free space goes on.

A run in one direction classifies, for each particle, the unknown cells on its way: the first of them for certain, each further one
if all before it turn out to be free. How likely that is, is estimated from zero in each episode: the share of free cells among
those classified so far in the same surroundings, smoothed towards coarser ones.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.dynamics.bits import ONE, ZERO, has, lowest
from shoal.swarm.kernels.prediction.occupancy_prior import PAIRS, OccupancyPrior, around, chance, learn, steps_of
from shoal.swarm.kernels.search.frontier_search import ahead

BEHIND = PAIRS * PAIRS  # surroundings for each state of the cell two behind
_LEAST = 0.01  # chance below which nobody looks further


class ExpectedGain(NamedTuple):
    """Prices, what was learnt, and work space of an adaptive scan."""

    prices: Any  # a record of PRICES
    prior: OccupancyPrior  # its model 0 alone is asked; ``before``: what was known before the run
    gains: NDArray[np.float64]  # (directions, longest run + 1): cells classified at each step of a run
    columns: int  # of a row, with the rim


@in_place_kernel
def learn_from_run(field, gain, command):
    """Learn from what a run in one direction has classified."""
    prior = gain.prior
    step, side = steps_of(prior.rows, prior.width, command)
    for i in range(field.known.shape[0]):
        new = field.known[i] & ~prior.before[i]
        while new != ZERO:
            cell = 64 * i + lowest(new)
            number = around(field.open, prior.before, cell, step, side)
            if number < BEHIND and is_free(field.open, cell - 2 * step):
                number += BEHIND  # the run itself has come this way
            learn(prior, number, cell, is_free(field.open, cell))
            new &= new - ONE


@in_place_kernel
def is_free(opened, cell):
    """Tell whether a cell is on a board."""
    return (opened[cell >> 6] >> np.uint64(cell & 63)) & ONE != ZERO


@in_place_kernel
def on_rim(field, columns, row, column):
    """Tell whether a cell has no neighbour in some direction: nobody may look further from there."""
    layer, within = row // field.rows, row % field.rows
    if within == 0 or within == field.rows - 1 or column == 0 or column == columns - 1:
        return True
    return field.layers > 1 and (layer == 0 or layer == field.layers - 1)


@in_place_kernel
def look_ahead(field, gain, row, column, command):
    """Add what one particle is expected to classify on its way; others on its way speak for what is behind them."""
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
        if moves >= 3 and number < BEHIND:  # the cell two behind is unknown, but then this walk has come through it
            number += BEHIND
        likely *= chance(gain.prior, 0, number, cell)
        if likely < _LEAST:
            return


@in_place_kernel
def gains_of_runs(field, gain, command):
    """Fill the gains of one direction."""
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
    """Return (steps, cells classified per unit of cost) of the best run in one direction, of ``least`` steps or more."""
    gains = gain.gains[command]
    classified, best, best_rate = 0.0, least, 0.0
    for step in range(1, gains.shape[0]):
        classified += gains[step]
        rate = classified / (gain.prices.scan + gain.prices.move * step)
        if step >= least and rate > best_rate:
            best, best_rate = step, rate
    return best, best_rate
