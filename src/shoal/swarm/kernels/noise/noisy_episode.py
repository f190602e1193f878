"""Whole episodes with noise: the policy closest-frontier plans a path after each scan, and a guard ends every episode.

The scan rule and the length of the path limit the number of commands between two scans.

The guard counts a cell as progress when the cell is classified for the first time, even if the belief about the cell changes later.
The guard gives the path to a target cell a budget of moves, which grows with the length of the path. Without progress within the
budget of moves, the guard gives up the target cell for the rest of the episode. Every episode ends, because each cell can count as
progress only once, and can be given up only once.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.dynamics.bits import ONE, TOP, ZERO, popcount, put
from shoal.swarm.kernels.noise.noisy_state import classify, learn_noisy, look, move_noisy, spread_noisy
from shoal.swarm.kernels.records import record_type
from shoal.swarm.kernels.search.frontier_search import ahead, nearest

RUNNING, COMPLETE, STALLED = 0, 1, 2
MEMORY = record_type(
    np.int64,
    "budget",  # number of moves that the guard still allows without progress, or -1 before the first plan
    "remaining",  # number of frontier cells
    "undecided",  # number of cells that the guard has given up
    "wakes",  # number of commands that `wake` has planned
    "at", "left",  # index of the next command in the plan; number of commands before the next scan
)  # fmt: skip
PATIENCE, TIMES = 50, 5  # the budget for a path of d moves is PATIENCE + TIMES * d moves


class ProgressGuard(NamedTuple):
    """The progress guard, which ensures that every episode with noise ends."""

    classified: NDArray[np.uint64]  # cells that have ever been classified
    given_up: NDArray[np.uint64]  # target cells that the guard has given up
    memory: Any  # a record of MEMORY


@in_place_kernel
def find_frontier(field, given_up):
    """Write the frontier: unclassified cells beside cells classified as free, without the cells that the guard has given up.

    Return the number of frontier cells.
    """
    cells, width, size = field.open, field.width, field.open.shape[0]
    layer = width * field.rows
    count = 0
    for i in range(size):
        beside = (cells[i] << ONE) | (cells[i] >> ONE)
        if i > 0:
            beside |= cells[i - 1] >> TOP
        if i + 1 < size:
            beside |= cells[i + 1] << TOP
        if i >= width:
            beside |= cells[i - width]
        if i + width < size:
            beside |= cells[i + width]
        if field.layers > 1:
            if i >= layer:
                beside |= cells[i - layer]
            if i + layer < size:
                beside |= cells[i + layer]
        field.frontier[i] = beside & ~field.known[i] & ~given_up[i]
        count += popcount(field.frontier[i])
    return count


@in_place_kernel
def refresh(noisy, field, guard):
    """Write the belief to the boards of ``field``. Return the number of cells that are classified for the first time."""
    classify(noisy, field.open, field.known, field.occupied, field.width)
    fresh = 0
    for i in range(field.known.shape[0]):
        fresh += popcount(field.known[i] & ~guard.classified[i])
        guard.classified[i] |= field.known[i]
    guard.memory.remaining = find_frontier(field, guard.given_up)
    return fresh


@in_place_kernel
def wake(field, search, guard):
    """Plan one command if no cell is classified as free yet. Return the number of planned commands, 0 or 1.

    With frequent errors, several scans may pass before the first cell is classified as free. Successive calls of `wake` use all
    directions in turn, and plan at most PATIENCE commands in an episode.
    """
    memory = guard.memory
    if anybody(field.open) or memory.wakes >= PATIENCE:
        return 0
    search.plan[0] = memory.wakes % search.neighbours.shape[0]
    memory.wakes += 1
    return 1


@in_place_kernel
def anybody(board):
    """Return whether a board contains at least one cell."""
    some = ZERO
    for word in board:
        some |= word
    return some != ZERO


@in_place_kernel
def choose(field, search, guard, most):
    """Plan the path to the nearest frontier cell. Give up frontier cells whose budget of moves is used up.

    Return the number of commands to send before the next scan, at most ``most``, or 0 if no path exists.
    """
    memory = guard.memory
    if memory.remaining == 0:
        return wake(field, search, guard)
    while memory.remaining > 0:
        length = nearest(field, search, field.occupied)
        if length == 0:
            return 0
        if memory.budget < 0:
            memory.budget = PATIENCE + TIMES * length
        if memory.budget > 0:
            steps = min(length, most)
            memory.budget -= steps
            return steps
        row, column = search.origin[0], search.origin[1]
        for i in range(length):
            row, column = ahead(row, column, search.plan[i], field.rows)
        put(guard.given_up, field.width, row, column)
        memory.undecided += 1
        memory.budget = -1
        memory.remaining = find_frontier(field, guard.given_up)
    return 0


@in_place_kernel
def play_noisy(noisy, field, search, guard, rng, trace, every, limit):
    """Continue an episode until the trace is full or the episode ends.

    Return the number of moves played, and the status RUNNING, COMPLETE or STALLED. A scan follows after at most ``every`` commands,
    and after command number ``limit``. The trace has space for at most ``limit`` commands.
    """
    memory = guard.memory
    for move in range(trace.commands.shape[0]):
        if memory.left == 0:
            memory.at, memory.left = 0, choose(field, search, guard, min(every, limit - move))
            if memory.left == 0:
                return move, COMPLETE if memory.undecided == 0 and anybody(field.open) and anybody(field.occupied) else STALLED
        trace.commands[move] = search.plan[memory.at]
        memory.at += 1
        memory.left -= 1
        trace.scanned[move] = memory.left == 0
        step_noisy(noisy, field, guard, rng, trace, move)
        if trace.classified[move] > 0:
            memory.budget = -1
    return trace.commands.shape[0], RUNNING


@in_place_kernel
def step_noisy(noisy, field, guard, rng, trace, move):
    """Send command number ``move`` of the trace, scan if ``trace.scanned`` says so, and write the results to the trace."""
    command = trace.commands[move]
    trace.travelled[move] = move_noisy(noisy, command, rng)
    if trace.scanned[move]:
        look(noisy, rng)
        learn_noisy(noisy, command)
    else:
        spread_noisy(noisy, command)
    trace.classified[move] = refresh(noisy, field, guard)
    trace.frontier[move] = guard.memory.remaining


@in_place_kernel
def follow_noisy(noisy, field, guard, rng, trace):
    """Replay an episode: send the commands of the trace and repeat its scans, without planning."""
    for move in range(trace.commands.shape[0]):
        step_noisy(noisy, field, guard, rng, trace, move)
