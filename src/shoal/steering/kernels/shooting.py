"""Plans of few straight moves: trials in simulations give all moves except the last two, and
formulas give the last two moves.

The second-last move of a plan changes the position difference of the particles to the position
difference of the goals. The move brings one particle (the toucher) to a wall, and then moves the
other particle while the wall holds the toucher. While the wall holds the toucher, the displacement
of the other particle is the missing change of the position difference, with the opposite sign if
the toucher is the second particle. This displacement determines the direction of the move. The
length of the move is the distance from the toucher to its wall in this direction, plus the length
of the displacement. The last move of a plan brings both particles to their goals.

The last two moves are feasible if the other particle meets no wall during the second-last move. The
*shortage* of a plan is the length of the second-last move, minus the distance that the other
particle can move before it meets a wall. If no random plan is feasible, the search repairs the
plans with the smallest shortage by small changes of their moves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import kernel
from shoal.steering.kernels.contact import Walls, advance_all, copy, first_contact, is_held, norm

# fraction of the workspace size: maximum distance of a particle from its goal at the end of a plan
EXACT = 1e-9
WIDEST = 0.1  # fraction of the workspace size: first change of a move in `repair`
FINEST = 1e-5
# largest shortage that `repair` tries to remove, as a multiple of the change of a move
HOPELESS = 10.0
# smallest improvement of the shortage that `repair` accepts, as a multiple of the change of a move
WORTH = 0.01


class Shot(NamedTuple):
    """A task of shooting."""

    start: NDArray[np.float64]  # (2, d)
    goal: NDArray[np.float64]  # (2, d)
    walls: Walls
    clear: float  # distance of the other particle from walls during the second-last move
    nudges: NDArray[np.float64]  # (nudges, d): changes of the third-last move that a plan stands


class Trials(NamedTuple):
    """The moves that a search tries."""

    directions: NDArray[np.float64]  # (directions, d)
    shares: NDArray[np.float64]  # (lengths,): of the lengths from one contact to the other


@kernel
def lengths_along(points, direction, shares, walls, lengths):
    """Write trial lengths of a move in a given direction to ``lengths``. Return the number of trial
    lengths.

    The shortest trial length brings one particle to a wall, and the longest trial length brings
    both particles to walls. A shorter move would not change the position difference. For a particle
    that a wall already holds, the length of the move to a wall is 0.
    """
    first, second = np.inf, 0.0
    for p in range(2):
        share = 0.0
        if not is_held(points[p], direction, walls):
            share, _ = first_contact(points[p], direction, walls, -1)
        first, second = min(first, share), max(second, share)
    if not second < np.inf or second <= 0:
        return 0
    count = 0
    for share in shares:
        length = first + share * (second - first)
        if length > 1e-9 * walls.size:
            lengths[count] = length
            count += 1
    return count


@kernel
def shortage(points, goal, toucher, walls, direction):
    """Return the shortage of the second-last move with the given toucher, and the length of this
    move.

    The shortage is the length of the move, minus the distance that the other particle (not the
    toucher) can move before it meets a wall. The shortage is infinite if the toucher meets no wall.
    ``direction`` receives the direction of the move. Shortage and length are 0 if the position
    difference of the particles already equals the position difference of the goals.
    """
    d = points.shape[1]
    sign = 1.0 if toucher == 0 else -1.0
    change = 0.0
    for i in range(d):
        direction[i] = sign * ((goal[1, i] - goal[0, i]) - (points[1, i] - points[0, i]))
        change += direction[i] ** 2
    change = np.sqrt(change)
    if change < EXACT * walls.size:
        return 0.0, 0.0
    for i in range(d):
        direction[i] /= change
    before, free = 0.0, 0.0
    if not is_held(points[toucher], direction, walls):
        before, _ = first_contact(points[toucher], direction, walls, -1)
    if not is_held(points[1 - toucher], direction, walls):
        free, _ = first_contact(points[1 - toucher], direction, walls, -1)
    if not before < np.inf:
        return np.inf, change
    return before + change - free, before + change


@kernel
def finish(points, shot, toucher, moves):
    """Write to ``moves`` the last two moves of a plan with the given toucher (the particle that a
    wall holds).

    During the second-last move, the other particle stays farther from the walls than
    ``shot.clear``. Return the largest remaining distance of a particle from its goal, or infinity
    if no feasible moves exist.
    """
    d, goal, walls = points.shape[1], shot.goal, shot.walls
    direction = np.empty(d)
    short, length = shortage(points, goal, toucher, walls, direction)
    if short > -shot.clear and length > 0:
        return np.inf
    for i in range(d):
        moves[0, i] = direction[i] * length
    state = points.copy()
    advance_all(state, moves[0], walls, direction)
    for i in range(d):
        moves[1, i] = goal[0, i] - state[0, i]
    advance_all(state, moves[1], walls, direction)
    error = 0.0
    for p in range(2):
        total = 0.0
        for i in range(d):
            total += (state[p, i] - goal[p, i]) ** 2
        error = max(error, np.sqrt(total))
    return error


@kernel
def total_length(moves):
    total = 0.0
    for m in range(moves.shape[0]):
        total += norm(moves[m])
    return total


@kernel
def holds_nearby(shot, toucher, trial):
    """Return whether a plan still ends at the goals after small changes of its third-last move.

    After each change, the kernel computes the last two moves anew. The test rejects plans that
    depend on rounding errors.
    """
    early, d = trial.shape[0] - 2, shot.start.shape[1]
    moves, state, move, velocity = np.empty((2, d)), shot.start.copy(), np.empty(d), np.empty(d)
    for nudge in shot.nudges:
        copy(shot.start, state)
        for m in range(early):
            for i in range(d):
                move[i] = trial[m, i] + (nudge[i] if m == early - 1 else 0.0)
            advance_all(state, move, shot.walls, velocity)
        if finish(state, shot, toucher, moves) > EXACT * shot.walls.size:
            return False
    return True


@kernel
def complete(state, shot, trial, most, plan):
    """Add the last two moves to a plan whose other moves lead to ``state``; write the shorter of
    the two results (one for each toucher) to ``plan``.

    Return the length of the plan, or infinity if no plan is shorter than ``most``.
    """
    moves, best = np.empty((2, state.shape[1])), np.inf
    for toucher in range(2):
        if finish(state, shot, toucher, moves) > EXACT * shot.walls.size:
            continue
        copy(moves, trial[trial.shape[0] - 2 :])
        length = total_length(trial)
        if length < min(most, best) and holds_nearby(shot, toucher, trial):
            best = length
            copy(trial, plan)
    return best


@kernel
def search(shot, trials, enough, plan):
    """Search for plans of three moves: try many first moves, and compute the last two moves for
    each first move.

    Write the shortest plan to ``plan``. Return the number of records. A record is a plan that is
    shorter than all plans found before it. The search ends when the number of records is
    ``enough``.
    """
    d = shot.start.shape[1]
    best, records = np.inf, 0
    lengths, trial, velocity = np.empty(trials.shares.shape[0]), np.empty((3, d)), np.empty(d)
    state = np.empty((2, d))
    for direction in trials.directions:
        for number in range(
            lengths_along(shot.start, direction, trials.shares, shot.walls, lengths)
        ):
            for i in range(d):
                trial[0, i] = direction[i] * lengths[number]
            copy(shot.start, state)
            advance_all(state, trial[0], shot.walls, velocity)
            length = complete(state, shot, trial, best, plan)
            if length < best:
                best, records = length, records + 1
                if records >= enough:
                    return records
    return records


@kernel
def improve(shot, step, plan):
    """Shorten a plan in place by small changes of all moves except the last two moves. Return the
    length of the plan.

    After each change, the kernel computes the last two moves anew.
    """
    d, early, size = shot.start.shape[1], plan.shape[0] - 2, shot.walls.size
    trial, state, velocity = plan.copy(), np.empty((2, d)), np.empty(d)
    best = total_length(plan)
    while step > 1e-6 * size:
        better = False
        for m in range(early):
            for i in range(d):
                for side in (-1.0, 1.0):
                    copy(plan, trial)
                    trial[m, i] += side * step
                    copy(shot.start, state)
                    for k in range(early):
                        advance_all(state, trial[k], shot.walls, velocity)
                    length = complete(state, shot, trial, best - 1e-9 * size, plan)
                    if length < best:
                        best, better = length, True
        if not better:
            step *= 0.5
    return best


@kernel
def least_shortage(shot, trial, state, direction):
    """Simulate all moves of a plan except the last two. Return the smaller of the shortages for the
    two possible touchers.

    Write the positions of the particles before the second-last move to ``state``.
    """
    copy(shot.start, state)
    for m in range(trial.shape[0] - 2):
        advance_all(state, trial[m], shot.walls, direction)
    shortage_of_first, _ = shortage(state, shot.goal, 0, shot.walls, direction)
    shortage_of_second, _ = shortage(state, shot.goal, 1, shot.walls, direction)
    return min(shortage_of_first, shortage_of_second)


@kernel
def repair(shot, trial):
    """Change all moves of a plan except the last two, in place, to reduce the shortage. Return the
    remaining shortage. If it is negative, the last two moves of the plan are feasible.
    """
    d = shot.start.shape[1]
    state, direction = np.empty((2, d)), np.empty(d)
    best = least_shortage(shot, trial, state, direction)
    step = WIDEST * shot.walls.size
    while step > FINEST * shot.walls.size and best > -3 * shot.clear:
        better = False
        for m in range(trial.shape[0] - 2):
            for i in range(d):
                for side in (-1.0, 1.0):
                    before = trial[m, i]
                    trial[m, i] = before + side * step
                    remaining = least_shortage(shot, trial, state, direction)
                    if remaining < best - WORTH * step:
                        best, better = remaining, True
                    else:
                        trial[m, i] = before
        if not better:
            step *= 0.5
            if best > HOPELESS * step:
                break
    return best


@kernel
def draw(shot, trials, picks, lengths, state, trial, velocity):
    """Write to ``trial`` a random move for each row of ``picks``.

    The two random numbers in a row of ``picks`` choose the direction and the length of the move.
    Return whether a move exists for every row of ``picks``.
    """
    copy(shot.start, state)
    for m in range(picks.shape[0]):
        direction = trials.directions[picks[m, 0] % trials.directions.shape[0]]
        count = lengths_along(state, direction, trials.shares, shot.walls, lengths)
        if count == 0:
            return False
        for i in range(direction.shape[0]):
            trial[m, i] = direction[i] * lengths[picks[m, 1] % count]
        advance_all(state, trial[m], shot.walls, velocity)
    return True


@kernel
def search_guided(shot, trials, picks, enough, plan):
    """Search for plans with as many moves as ``plan`` has rows, and write the shortest plan to
    ``plan``.

    Return the number of records. A record is a plan that is shorter than all plans found before it.
    The array ``picks`` holds random integers, int64, shape (tries, wide, moves - 2, 2). In each
    try, the search draws ``wide`` random plans, and repairs the plan with the smallest shortage
    (see `shortage`). The search ends when the number of records is ``enough``.
    """
    d = shot.start.shape[1]
    lengths, state, direction = np.empty(trials.shares.shape[0]), np.empty((2, d)), np.empty(d)
    trial, nearest = np.zeros(plan.shape), np.zeros(plan.shape)
    shortest, records = np.inf, 0
    for number in range(picks.shape[0]):
        best = np.inf
        for row in picks[number]:
            if not draw(shot, trials, row, lengths, state, trial, direction):
                continue
            missing = least_shortage(shot, trial, state, direction)
            if missing < best:
                best = missing
                copy(trial, nearest)
        if best == np.inf or repair(shot, nearest) > -1.5 * shot.clear:
            continue
        least_shortage(shot, nearest, state, direction)
        length = complete(state, shot, nearest, shortest, plan)
        if length < shortest:
            shortest, records = length, records + 1
            if records >= enough:
                return records
    return records
