"""Completion of a simulated plan by a base policy: single commands, or the path to the nearest frontier cell if none classifies.

The policy has two styles. Greedy takes the command that classifies most cells now. Careful subtracts a charge for each frontier
cell that is left behind, that is, beside a particle now and beside none afterwards. In a corridor, careful therefore probes both
walls before it moves on.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.dynamics.bits import popcount
from shoal.swarm.kernels.planning.frontier_paths import NEXT, TOO_FAR, WAVE, beside, path_to_nearest
from shoal.swarm.kernels.prediction.forward_model import FRONTIER, OCCUPIED, advance, immediate_gains, push
from shoal.swarm.kernels.prediction.lookahead import copy

GREEDY, CAREFUL = np.int64(0), np.int64(1)  # typed, because a kernel is compiled again for each literal argument


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
    at_hand = planes[WAVE]
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
        worth = gains[command] - charge * left_behind(scene, moved, at_hand, planes[NEXT])
        if best < 0 or worth > best_worth:
            best, best_worth = command, worth
    return best


@in_place_kernel
def left_behind(scene, occupied, at_hand, still):
    """Return the number of frontier cells beside particles before that were not tried now and are no longer beside a particle."""
    beside(scene, occupied, at_hand, still)
    tried, lost = scene.tried, 0
    for i in range(still.shape[0]):
        lost += popcount(at_hand[i] & ~tried[i] & ~still[i])
    return lost


@in_place_kernel
def complete(scene, state, space, plan, length, horizon, discount, style, charge, worth, expected, best):
    """Simulate the first ``length`` commands of a plan and complete it by the base policy, writing its commands behind them.

    Changes ``state``. The simulation stops early if the plan cannot become better than ``best``, given that a cell classified
    immediately is worth ``worth`` moves and about ``expected`` cells are to be classified. Returns (time, value, length, moves,
    classified): the time of the last classification, or ``horizon`` if cells are left; the discounted number of classified cells;
    the number of commands in the plan; the number of simulated commands; and the number of classified cells.
    """
    value, weight, last, finished, total = 0.0, 1.0, np.int64(-1), 0, 0
    at = np.int64(0)
    gains, moved, planes = space.gains, space.ahead, space.planes  # passing the whole working memory takes time
    while at < horizon:
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
