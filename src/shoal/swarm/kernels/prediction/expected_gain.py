"""How much a run of equal commands is expected to settle, and what was learnt of how free space goes on.

A run in one direction settles, for each particle, the unknown cells on its way: the first of them for certain, each further one
if all before it turn out to be free. How likely that is, is estimated from zero in each episode: the share of free cells among
those classified so far in the same surroundings, smoothed towards coarser ones.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import kernel
from shoal.swarm.kernels.dynamics.bits import ONE, ZERO, has, lowest
from shoal.swarm.kernels.dynamics.moves import LEFT, RIGHT, UP
from shoal.swarm.kernels.search.frontier_search import ahead, opposite

FINE, COARSE = 108, 18  # surroundings: fine ones, then coarse ones, then one entry for all
TALLIES = FINE + COARSE + 1
_BEHIND = 6  # coarse numbers for each state of the cell two behind
_LEAST = 0.01  # chance below which nobody looks further


class Survey(NamedTuple):
    """Prices, tallies and work space of an adaptive scan."""

    prices: Any  # a record of PRICES
    tallies: NDArray[np.int64]  # (TALLIES, 2): cells classified, and found free
    gains: NDArray[np.float64]  # (directions, longest run + 1): cells settled at each step of a run
    known: NDArray[np.uint64]  # a board: what was known before the run
    columns: int  # of a row, with the rim


@kernel
def cell_state(field, known, row, column):
    """Return 0 for an unknown cell, 1 for a free one, 2 for an obstacle, as of the board ``known``."""
    if not has(known, field.width, row, column):
        return 0
    return 1 if has(field.open, field.width, row, column) else 2


@kernel
def beside(field, known, row, column, command):
    """Return a number 0 to 5 for the unordered states of the two cells beside one, across the direction of a command."""
    first = UP if command == LEFT or command == RIGHT else LEFT
    r, c = ahead(row, column, first, field.rows)
    one = cell_state(field, known, r, c)
    r, c = ahead(row, column, opposite(first), field.rows)
    other = cell_state(field, known, r, c)
    low, high = min(one, other), max(one, other)
    return high * (high + 1) // 2 + low


@kernel
def surroundings(field, known, row, column, command):
    """Return (fine, coarse) numbers of what is around a cell that is entered by a command: behind it and beside its way."""
    back = opposite(command)
    near_row, near_column = ahead(row, column, back, field.rows)
    r, c = ahead(near_row, near_column, back, field.rows)
    behind = cell_state(field, known, r, c)
    if behind == 0 and has(field.open, field.width, r, c):
        behind = 1  # the run itself has come this way
    coarse = behind * _BEHIND + beside(field, known, near_row, near_column, command)
    return coarse * 6 + beside(field, known, row, column, command), coarse


@kernel
def chance(tallies, fine, coarse):
    """Return how likely a cell is to be free in such surroundings."""
    everywhere, coarser = tallies[FINE + COARSE], tallies[FINE + coarse]
    likely = (everywhere[1] + 1.0) / (everywhere[0] + 2.0)
    likely = (coarser[1] + 2.0 * likely) / (coarser[0] + 2.0)
    return (tallies[fine, 1] + 2.0 * likely) / (tallies[fine, 0] + 2.0)


@kernel
def take_stock(field, survey, command):
    """Add what a run in one direction has classified to the tallies."""
    tallies, width = survey.tallies, field.width
    for i in range(field.known.shape[0]):
        new = field.known[i] & ~survey.known[i]
        while new != ZERO:
            row, column = i // width, 64 * (i % width) + lowest(new)
            new &= new - ONE
            fine, coarse = surroundings(field, survey.known, row, column, command)
            free = 1 if has(field.open, width, row, column) else 0
            for entry in (fine, FINE + coarse, FINE + COARSE):
                tallies[entry, 0] += 1
                tallies[entry, 1] += free


@kernel
def on_rim(field, columns, row, column):
    """Tell whether a cell has no neighbour in some direction: nobody may look further from there."""
    layer, within = row // field.rows, row % field.rows
    if within == 0 or within == field.rows - 1 or column == 0 or column == columns - 1:
        return True
    return field.layers > 1 and (layer == 0 or layer == field.layers - 1)


@kernel
def look_ahead(field, survey, row, column, command):
    """Add what one particle is expected to settle on its way; others on its way speak for what is behind them."""
    gains, width, rows = survey.gains[command], field.width, field.rows
    likely = 1.0
    for step in range(1, gains.shape[0]):
        row, column = ahead(row, column, command, rows)
        if has(field.occupied, width, row, column):
            return
        if has(field.known, width, row, column):
            if not has(field.open, width, row, column):
                return
            continue
        gains[step] += likely
        if on_rim(field, survey.columns, row, column):
            return
        fine, coarse = surroundings(field, field.known, row, column, command)
        if step >= 3 and coarse < _BEHIND:  # the cell two behind is unknown, but then this walk has come through it
            fine, coarse = fine + 6 * _BEHIND, coarse + _BEHIND
        likely *= chance(survey.tallies, fine, coarse)
        if likely < _LEAST:
            return


@kernel
def look_around(field, survey, command):
    """Fill the gains of one direction."""
    gains = survey.gains[command]
    for step in range(gains.shape[0]):
        gains[step] = 0.0
    for i in range(field.occupied.shape[0]):
        cells = field.occupied[i]
        while cells != ZERO:
            row, column = i // field.width, 64 * (i % field.width) + lowest(cells)
            cells &= cells - ONE
            look_ahead(field, survey, row, column, command)


@kernel
def best_length(survey, command, least):
    """Return (steps, cells settled per unit of cost) of the best run in one direction, of ``least`` steps or more."""
    gains = survey.gains[command]
    settled, best, best_rate = 0.0, least, 0.0
    for step in range(1, gains.shape[0]):
        settled += gains[step]
        rate = settled / (survey.prices.scan + survey.prices.move * step)
        if step >= least and rate > best_rate:
            best, best_rate = step, rate
    return best, best_rate
