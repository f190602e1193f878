"""Plans of few straight moves where random ones do not fit: what comes nearest is changed until it does.

That a plan does not fit is measured, as a length: how much too early the other particle meets a wall.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import kernel
from shoal.steering.kernels.contact import advance_all, copy
from shoal.steering.kernels.shooting import EXACT, finish, holds_nearby, lengths_along, shortage, total_length

WIDEST = 0.1  # of the size: the first changes of a plan
FINEST = 1e-5
HOPELESS = 10.0  # times the change: what is left then is too much for all smaller ones
WORTH = 0.01  # times the change: less is no gain
ENOUGH = 1e-6  # of the size: room to spare


@kernel
def least_shortage(start, goal, trial, walls, state, direction):
    """Return the smaller shortage of both touchers after all but the last two moves of a plan, and write the state there."""
    copy(start, state)
    for m in range(trial.shape[0] - 2):
        advance_all(state, trial[m], walls, direction)
    one, _ = shortage(state, goal, 0, walls, direction)
    other, _ = shortage(state, goal, 1, walls, direction)
    return min(one, other)


@kernel
def repair(start, goal, walls, trial):
    """Change all but the last two moves of a plan, in place, until these have room; return the shortage that is left."""
    d = start.shape[1]
    state, direction = np.empty((2, d)), np.empty(d)
    best = least_shortage(start, goal, trial, walls, state, direction)
    step = WIDEST * walls.size
    while step > FINEST * walls.size and best > -ENOUGH * walls.size:
        moved = False
        for m in range(trial.shape[0] - 2):
            for i in range(d):
                for side in (-1.0, 1.0):
                    kept = trial[m, i]
                    trial[m, i] = kept + side * step
                    left = least_shortage(start, goal, trial, walls, state, direction)
                    if left < best - WORTH * step:
                        best, moved = left, True
                    else:
                        trial[m, i] = kept
        if not moved:
            step *= 0.5
            if best > HOPELESS * step:
                break
    return best


@kernel
def draw(start, directions, shares, picks, walls, lengths, state, trial, spare):
    """Write the moves that a row of picks says, a direction and a share each; return whether there are such."""
    copy(start, state)
    for m in range(picks.shape[0]):
        direction = directions[picks[m, 0] % directions.shape[0]]
        count = lengths_along(state, direction, shares, walls, lengths)
        if count == 0:
            return False
        for i in range(direction.shape[0]):
            trial[m, i] = direction[i] * lengths[picks[m, 1] % count]
        advance_all(state, trial[m], walls, spare)
    return True


@kernel
def search_guided(start, goal, directions, shares, picks, nudges, enough, walls, plan):
    """Write the shortest plan found of as many moves as ``plan`` has; return how many were found.

    ``picks``, int64, shape (tries, wide, moves - 2, 2): of each try the nearest of so many random plans is mended. With ``enough``
    plans found the search ends.
    """
    d = start.shape[1]
    lengths, state, direction = np.empty(shares.shape[0]), np.empty((2, d)), np.empty(d)
    trial, nearest, moves = np.zeros(plan.shape), np.zeros(plan.shape), np.empty((2, d))
    shortest, found = np.inf, 0
    for tried in range(picks.shape[0]):
        best = np.inf
        for row in picks[tried]:
            if not draw(start, directions, shares, row, walls, lengths, state, trial, direction):
                continue
            left = least_shortage(start, goal, trial, walls, state, direction)
            if left < best:
                best = left
                copy(trial, nearest)
        if best == np.inf or repair(start, goal, walls, nearest) > -0.5 * ENOUGH * walls.size:
            continue
        least_shortage(start, goal, nearest, walls, state, direction)
        for toucher in range(2):
            if finish(state, goal, toucher, walls, moves) > EXACT * walls.size:
                continue
            copy(moves, nearest[nearest.shape[0] - 2 :])
            length = total_length(nearest)
            if length < shortest and holds_nearby(start, goal, toucher, nearest, nudges, walls):
                shortest = length
                found += 1
                copy(nearest, plan)
                if found >= enough:
                    return found
    return found
