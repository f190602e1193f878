"""Completion of a simulated plan by a base policy: commands that classify cells, or the path to the
nearest frontier cell.

The base policy has two styles. The greedy style chooses the command that classifies the most cells
with one move. The careful style subtracts a charge for each frontier cell that a command leaves
behind. A frontier cell is left behind if it is beside a particle before the command, and beside no
particle after the command. In a corridor, the careful style probes both walls before the particles
move on.

The kernel keeps states at regular intervals of the plan. If a plan begins like the best plan so
far, the simulation starts from the last kept state before the first different command.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.moves import popcount, record_type
from shoal.swarm.kernels.planning.frontier_paths import (
    MOD,
    TOO_FAR,
    UNREACHED,
    beside,
    path_to_nearest,
)
from shoal.swarm.kernels.prediction.forward_model import (
    FRONTIER,
    OCCUPIED,
    advance,
    copy_state,
    immediate_gains,
    push,
)
from shoal.swarm.kernels.prediction.lookahead import copy

GREEDY, CAREFUL = (
    np.int64(0),
    np.int64(1),
)  # NumPy numbers, because Numba would compile a kernel again for each literal argument
EVERY = 8  # number of moves between two kept states
BEST, TRIAL = 0, 1  # the plans with kept states: the best plan so far, and the plan in simulation
LEAD, BEHIND = (
    16,
    2.0,
)  # `is_behind` applies from LEAD moves after the first changed command on; BEHIND counts cells
PROGRESS = record_type(
    np.float64, "value", "weight", "last", "finished", "total"
)  # results up to a kept state


class KeptStates(NamedTuple):
    """The states that two plans reach after ``EVERY``, 2 ``EVERY``, 3 ``EVERY``, ... moves, and the
    results up to these states.

    Place k holds the state after k ``EVERY`` moves. Place 0 is not used.
    """

    states: NDArray[np.uint64]  # (2, places, boards, words)
    progress: Any  # (2, places) records of PROGRESS


@in_place_kernel
def keep_best(kept, begin, length):
    """Replace the kept states and results of the best plan after move ``begin`` by the states and
    results of the simulated plan.
    """
    for place in range(begin // EVERY + 1, min((length - 1) // EVERY + 1, kept.progress.shape[1])):
        if place < kept.states.shape[1]:
            copy_state(kept.states[TRIAL, place], kept.states[BEST, place])
        kept.progress[BEST, place] = kept.progress[TRIAL, place]


@in_place_kernel
def most(gains, last):
    """Return the command that classifies the most cells, or -1 if no command classifies a cell.

    Among equally good commands, prefer ``last``, which is the previous command of the plan.
    """
    best = last if last >= 0 and gains[last] > 0 else np.int64(-1)
    for command in range(gains.shape[0]):
        if gains[command] > (gains[best] if best >= 0 else 0):
            best = command
    return best


@in_place_kernel
def most_careful(scene, state, gains, moved, planes, last, charge):
    """Return the command with the highest worth: the number of classified cells minus ``charge``
    per frontier cell left behind.

    The choice is among the commands that classify at least one cell. If no command classifies a
    cell, the result is -1.
    """
    best, best_worth = -1, 0.0
    at_hand, still = (
        planes[UNREACHED],
        planes[MOD],
    )  # this function uses the two planes only as working memory
    some, only = 0, -1
    for command in range(gains.shape[0]):
        if gains[command] > 0:
            some, only = some + 1, command
    if some <= 1:
        return only
    beside(scene, state[OCCUPIED], state[FRONTIER], at_hand)
    for turn in range(gains.shape[0]):
        command = (max(last, 0) + turn) % gains.shape[0]
        if gains[command] == 0:
            continue
        copy(state[OCCUPIED], moved)
        push(scene, moved, state[FRONTIER], command)
        worth = gains[command] - charge * left_behind(scene, moved, at_hand, still)
        if best < 0 or worth > best_worth:
            best, best_worth = command, worth
    return best


@in_place_kernel
def left_behind(scene, occupied, at_hand, still):
    """Return the number of frontier cells that a command leaves behind: beside a particle before
    the command, but not after it.

    Frontier cells that a particle tried to enter do not count.
    """
    beside(scene, occupied, at_hand, still)
    tried, lost = scene.tried, 0
    for i in range(still.shape[0]):
        lost += popcount(at_hand[i] & ~tried[i] & ~still[i])
    return lost


@in_place_kernel
def is_behind(trial, best):
    """Return whether a plan is clearly worse than the best plan after the same number of moves.

    The number n counts the cells that a plan has classified, and v is the discounted number of
    these cells. The plan is clearly worse if n < n_best - ``BEHIND`` and v < v_best, where n_best
    and v_best are the numbers of the best plan.
    """
    return trial.total < best.total - BEHIND and trial.value < best.value


@in_place_kernel
def complete(
    scene,
    state,
    space,
    plan,
    begin,
    length,
    horizon,
    discount,
    style,
    charge,
    worth,
    expected,
    best,
    begins,
    ends,
):
    """Simulate the first ``length`` commands of a plan, and append commands of the base policy up
    to the horizon.

    The simulation begins with move ``begin`` and changes ``state``. If ``begin`` is above 0,
    ``state`` must be the kept state of the best plan before move ``begin``. The simulation stops
    early if the plan cannot become better than ``best``. The early stop assumes that the immediate
    classification of a cell is worth ``worth`` moves. It also assumes that about ``expected`` cells
    are left to classify. From move ``begins`` to move ``ends``, the simulation stops early if the
    plan is behind the best plan (`is_behind`).

    Return five numbers: time, value, length, moves and classified. ``time`` is the number of moves
    up to the last classification, or ``horizon`` if cells are left. ``value`` is the discounted
    number of classified cells. ``length`` is the number of commands in the plan. ``moves`` is the
    number of simulated commands, including the commands before ``begin``. ``classified`` is the
    number of classified cells.
    """
    value, weight, last, finished, total = 0.0, 1.0, np.int64(-1), 0, 0
    kept, at = space.kept, begin
    if begin > 0:
        reached = kept.progress[BEST, begin // EVERY]
        value, weight, last = reached.value, reached.weight, np.int64(reached.last)
        finished, total = np.int64(reached.finished), np.int64(reached.total)
    gains, moved, planes = (
        space.gains,
        space.ahead,
        space.planes,
    )  # passing all working memory takes time
    while at < horizon:
        if at % EVERY == 0 and at > begin and at // EVERY < kept.progress.shape[1]:
            place = at // EVERY
            if place < kept.states.shape[1]:
                copy_state(state, kept.states[TRIAL, place])
            reached = kept.progress[TRIAL, place]
            reached.value, reached.weight, reached.last, reached.finished, reached.total = (
                value,
                weight,
                last,
                finished,
                total,
            )
            if begins <= at < ends and is_behind(reached, kept.progress[BEST, place]):
                return horizon, value, at, at, total
        if at >= length:
            if worth * (value + weight * max(expected - total, 0.0)) - at <= best:
                return horizon, value, at, at, total
            immediate_gains(scene, state, gains)
            if style == CAREFUL:
                command = most_careful(scene, state, gains, moved, planes, last, charge)
            else:
                command = most(gains, last)
            if command >= 0:
                plan[at] = command
                length = at + 1
            else:
                found = path_to_nearest(scene, state, planes, plan, at, horizon - at)
                if found == TOO_FAR:
                    return horizon, value, at, at, total
                if found == 0:
                    return finished, value, at, at, total
                length = at + found
        command = np.int64(plan[at])
        classified = advance(scene, state, command)
        at += 1
        if classified > 0:
            value += weight * classified
            total += classified
            finished = at
        weight *= discount
        last = command
    return horizon, value, min(length, at), at, total
