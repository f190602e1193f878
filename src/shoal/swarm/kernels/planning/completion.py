"""Completion of a simulated plan by a base policy: single commands that classify cells, or the path to the nearest frontier cell.

The policy has two styles. Greedy takes the command that classifies most cells now. Careful subtracts a charge for each frontier
cell that is left behind, that is, beside a particle now and beside none afterwards. In a corridor, careful therefore probes both
walls before it moves on.

States are kept at regular intervals of the plan. A plan that begins like the best one is simulated from the last common kept state.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.dynamics.bits import popcount
from shoal.swarm.kernels.planning.frontier_paths import MOD, TOO_FAR, UNREACHED, beside, path_to_nearest
from shoal.swarm.kernels.prediction.forward_model import FRONTIER, OCCUPIED, advance, copy_state, immediate_gains, push
from shoal.swarm.kernels.prediction.lookahead import copy
from shoal.swarm.kernels.records import record_type

GREEDY, CAREFUL = np.int64(0), np.int64(1)  # typed, because a kernel is compiled again for each literal argument
EVERY = 8  # moves between two kept states
BEST, TRIAL = 0, 1  # whose states are kept: those of the best plan so far, and those of the plan that is simulated
PROGRESS = record_type(np.float64, "value", "weight", "last", "finished", "total")  # results of a simulation so far; see `complete`


class KeptStates(NamedTuple):
    """The states of two plans after each ``EVERY`` moves. The first place, for the beginning of the plan, is not used."""

    states: NDArray[np.uint64]  # (2, places, boards, words)
    progress: Any  # (2, places) records of PROGRESS


@in_place_kernel
def keep_best(kept, begin, length):
    """Take over the kept states of the simulated plan from move ``begin`` on, because it is the best plan now."""
    for place in range(begin // EVERY + 1, min((length - 1) // EVERY + 1, kept.states.shape[1])):
        copy_state(kept.states[TRIAL, place], kept.states[BEST, place])
        kept.progress[BEST, place] = kept.progress[TRIAL, place]


@in_place_kernel
def most(gains, last):
    """Return the command that classifies most cells, preferably the last one; -1 if no command classifies any."""
    best = last if last >= 0 and gains[last] > 0 else np.int64(-1)
    for command in range(gains.shape[0]):
        if gains[command] > (gains[best] if best >= 0 else 0):
            best = command
    return best


@in_place_kernel
def most_careful(scene, state, gains, moved, planes, last, charge):
    """Return the command with most classified cells minus ``charge`` per cell left behind, among those that classify any."""
    best, best_worth = -1, 0.0
    at_hand, still = planes[UNREACHED], planes[MOD]  # here only working memory
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
    """Return the number of frontier cells that were beside a particle, were not tried by the command, and are beside none now."""
    beside(scene, occupied, at_hand, still)
    tried, lost = scene.tried, 0
    for i in range(still.shape[0]):
        lost += popcount(at_hand[i] & ~tried[i] & ~still[i])
    return lost


@in_place_kernel
def complete(scene, state, space, plan, begin, length, horizon, discount, style, charge, worth, expected, best):
    """Simulate the first ``length`` commands of a plan and append the commands of the base policy.

    The simulation begins with move ``begin`` and changes ``state``. If ``begin`` is above 0, ``state`` is the kept state of the
    best plan before this move. The simulation stops early if the plan cannot become better than ``best``, given that a cell
    classified immediately is worth ``worth`` moves and about ``expected`` cells are to be classified. Returns (time, value,
    length, moves, classified): the time of the last classification, or ``horizon`` if cells are left; the discounted number of
    classified cells; the number of commands in the plan; the number of simulated commands, including those before ``begin``; and
    the number of classified cells.
    """
    value, weight, last, finished, total = 0.0, 1.0, np.int64(-1), 0, 0
    kept, at = space.kept, begin
    if begin > 0:
        reached = kept.progress[BEST, begin // EVERY]
        value, weight, last = reached.value, reached.weight, np.int64(reached.last)
        finished, total = np.int64(reached.finished), np.int64(reached.total)
    gains, moved, planes = space.gains, space.ahead, space.planes  # passing the whole working memory takes time
    while at < horizon:
        if at % EVERY == 0 and at > begin and at // EVERY < kept.states.shape[1]:
            copy_state(state, kept.states[TRIAL, at // EVERY])
            reached = kept.progress[TRIAL, at // EVERY]
            reached.value, reached.weight, reached.last, reached.finished, reached.total = value, weight, last, finished, total
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
