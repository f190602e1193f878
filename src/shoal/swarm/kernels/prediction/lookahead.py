"""Search for a path through known cells, followed by one more command and a scan.

The best path has the largest number of classified cells divided by the cost of all commands and the
scan.

If no particle tries to enter an unknown cell, the belief determines the outcome of a command. The
search looks for two shifts (runs of equal commands), in perpendicular directions, that bring many
particles beside unknown cells. After the two shifts, many particles try to enter unknown cells with
one command.
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
    Field,
    move_across,
    move_along,
    popcount,
    record_type,
)

FIRST_STEPS, SECOND_STEPS = (
    12,
    8,
)  # maximum numbers of commands in the first and in the second shift
LONGEST_PLAN = FIRST_STEPS + SECOND_STEPS + 1
BEST = record_type(np.int64, "first", "first_length", "second", "second_length", "last")
PRICES = record_type(np.float64, "scan", "move")


class Lookahead(NamedTuple):
    """Working memory of the search for a path."""

    shifted: NDArray[np.uint64]  # cells of the particles after the first shift
    twice: NDArray[np.uint64]  # cells of the particles after the second shift
    counts: NDArray[np.int32]  # empty, because the number of particles in a cell has no effect
    best: Any  # a record of BEST


@in_place_kernel
def tried(field, occupied, command):
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
def predicted(field, occupied, counts):
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
    if tried(field, predicted_field.occupied, command) > 0:
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
        count = tried(field, occupied, last)
        if count > rate * (prices.scan + prices.move * (steps + 1)):
            command, rate = last, count / (prices.scan + prices.move * (steps + 1))
    return command, rate


@in_place_kernel
def axis(command):
    """Return the axis of a command: 0 for l and r, 1 for u and d, 2 for i and o."""
    return 2 if command >= IN else command % 2


@in_place_kernel
def copy(source, target):
    """Copy a board (set of cells)."""
    for i in range(source.shape[0]):
        target[i] = source[i]


@in_place_kernel
def explore(field, rule, lookahead, prices, rate):
    """Find a path and a last command that classify more cells per cost than ``rate``. Return the
    rate of the best path.

    ``lookahead.best`` receives the best path: a first shift with its length, a perpendicular second
    shift with its length, and the last command. If no path has a higher rate than ``rate``, the
    result is ``rate``.
    """
    best = lookahead.best
    once = predicted(field, lookahead.shifted, lookahead.counts)
    twice = predicted(field, lookahead.twice, lookahead.counts)
    directions = 4 if field.layers == 1 else 6
    for first in range(directions):
        copy(field.occupied, once.occupied)
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
                copy(once.occupied, twice.occupied)
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
