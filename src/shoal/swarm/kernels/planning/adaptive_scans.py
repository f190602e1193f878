"""Plans of the adaptive scan rule: long runs into unknown cells, and paths through known cells
followed by one more command.

**Runs** (`ExpectedGain`). For each particle, a run of equal commands classifies unknown cells on
the particle's path. The run certainly classifies the first unknown cell on the path. The run
classifies a later unknown cell only if all cells before it on the path are free. The adaptive scan
rule learns the probability of a free cell only from the present episode. The probability that a
cell is free is the fraction of free cells among the classified cells with equal surroundings. This
fraction is smoothed towards the fraction for coarser surroundings.

**Paths** (`Lookahead`). If no particle tries to enter an unknown cell, the belief determines the
outcome of a command. The search looks for two shifts (runs of equal commands), in perpendicular
directions, that bring many particles beside unknown cells. After the two shifts, many particles try
to enter unknown cells with one command. The best path has the largest number of classified cells
divided by the cost of all commands and the scan.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.moves import (
    DOWN,
    IN,
    LEFT,
    ONE,
    RIGHT,
    TOP,
    UP,
    ZERO,
    Field,
    copy_board,
    has,
    lowest,
    move_across,
    move_along,
    popcount,
    record_type,
)
from shoal.swarm.kernels.planning.prediction import (
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
FIRST_STEPS, SECOND_STEPS = (
    12,
    8,
)  # maximum numbers of commands in the first and in the second shift
LONGEST_PLAN = FIRST_STEPS + SECOND_STEPS + 1
BEST = record_type(np.int64, "first", "first_length", "second", "second_length", "last")
PRICES = record_type(np.float64, "scan", "move")


class ExpectedGain(NamedTuple):
    """The prices of a scan and a move, the learned counts, and the working memory of an adaptive
    scan rule.
    """

    prices: Any  # a record of PRICES
    # the scan rule uses only the counts; ``before`` holds the cells known before the run
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
            learn(prior, number, is_free(field.open, cell))
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
        likely *= chance(gain.prior, number)
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


class Lookahead(NamedTuple):
    """Working memory of the search for a path."""

    shifted: NDArray[np.uint64]  # cells of the particles after the first shift
    twice: NDArray[np.uint64]  # cells of the particles after the second shift
    counts: NDArray[np.int32]  # empty, because the number of particles in a cell has no effect
    best: Any  # a record of BEST


@in_place_kernel
def count_tried(field, occupied, command):
    """Return the number of unknown cells that particles in the cells ``occupied`` would try to
    enter with one command.
    """
    known, size = field.known, field.known.shape[0]
    total = 0
    if command == LEFT:
        for i in range(size - 1):
            total += popcount(((occupied[i] >> ONE) | (occupied[i + 1] << TOP)) & ~known[i])
        return total
    if command == RIGHT:
        known, before = known[1:], occupied[1:]
        for i in range(size - 1):
            total += popcount(((before[i] << ONE) | (occupied[i] >> TOP)) & ~known[i])
        return total
    ahead = field.width if command in (UP, DOWN) else field.width * field.rows
    if command in (UP, IN):
        sources, targets = occupied[ahead:], known[: size - ahead]
    else:
        sources, targets = occupied[: size - ahead], known[ahead:]
    for i in range(sources.shape[0]):
        total += popcount(sources[i] & ~targets[i])
    return total


@in_place_kernel
def known_field(field, occupied, counts):
    """Return the known part of the map as a field, with particles in the cells ``occupied``.

    Unknown cells count as walls, because no particle tries to enter them.
    """
    return Field(
        field.open,
        occupied,
        field.open,
        field.known,
        field.frontier,
        field.tried,
        field.moving,
        counts,
        field.layers,
        field.rows,
        field.width,
    )


@in_place_kernel
def shift(field, predicted_field, command, rule):
    """Move the particles of a predicted field if the outcome of the command is certain. Return
    whether a particle has moved.
    """
    if count_tried(field, predicted_field.occupied, command) > 0:
        return False
    if command == LEFT or command == RIGHT:
        return move_along(predicted_field, command, rule)[0] > 0
    return move_across(predicted_field, command, rule)[0] > 0


@in_place_kernel
def best_last_command(field, lookahead, occupied, prices, steps, rate):
    """Return the best last command for particles in the cells ``occupied``, and its rate of
    classified cells per cost.

    If no command has a higher rate than ``rate``, return -1 and ``rate``.
    """
    command = -1
    for last in range(4 if field.layers == 1 else 6):
        count = count_tried(field, occupied, last)
        if count > rate * (prices.scan + prices.move * (steps + 1)):
            command, rate = last, count / (prices.scan + prices.move * (steps + 1))
    return command, rate


@in_place_kernel
def axis(command):
    """Return the axis of a command: 0 for l and r, 1 for u and d, 2 for i and o."""
    return 2 if command >= IN else command % 2


@in_place_kernel
def explore(field, rule, lookahead, prices, rate):
    """Find a path and a last command that classify more cells per cost than ``rate``. Return the
    rate of the best path.

    ``lookahead.best`` receives the best path: a first shift with its length, a perpendicular second
    shift with its length, and the last command. If no path has a higher rate than ``rate``, the
    result is ``rate``.
    """
    best = lookahead.best
    once = known_field(field, lookahead.shifted, lookahead.counts)
    twice = known_field(field, lookahead.twice, lookahead.counts)
    directions = 4 if field.layers == 1 else 6
    for first in range(directions):
        copy_board(field.occupied, once.occupied)
        for length in range(1, FIRST_STEPS + 1):
            if not shift(field, once, first, rule):
                break
            last, rate = best_last_command(field, lookahead, once.occupied, prices, length, rate)
            if last >= 0:
                best.first, best.first_length, best.second_length, best.last = (
                    first,
                    length,
                    0,
                    last,
                )
            for second in range(directions):
                if axis(first) == axis(second):
                    continue
                copy_board(once.occupied, twice.occupied)
                for further in range(1, SECOND_STEPS + 1):
                    if not shift(field, twice, second, rule):
                        break
                    last, rate = best_last_command(
                        field, lookahead, twice.occupied, prices, length + further, rate
                    )
                    if last >= 0:
                        best.first, best.first_length, best.last = first, length, last
                        best.second, best.second_length = second, further
    return rate


@in_place_kernel
def write_plan(lookahead, plan):
    """Write the path in ``lookahead.best`` to a plan. Return the number of commands."""
    best = lookahead.best
    first, second = best.first_length, best.second_length
    for i in range(first):
        plan[i] = best.first
    for i in range(second):
        plan[first + i] = best.second
    plan[first + second] = best.last
    return first + second + 1
