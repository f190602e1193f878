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

import numpy as np

from shoal.jit import kernel
from shoal.steering.kernels.contact import advance_all, copy, first_contact, is_held, norm

# fraction of the workspace size: maximum distance of a particle from its goal at the end of a plan
EXACT = 1e-9
WIDEST = 0.1  # fraction of the workspace size: first change of a move in `repair`
FINEST = 1e-5
HOPELESS = (
    10.0  # largest shortage that `repair` tries to remove, as a multiple of the change of a move
)
# smallest improvement of the shortage that `repair` accepts, as a multiple of the change of a move
WORTH = 0.01


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
    before, room = 0.0, 0.0
    if not is_held(points[toucher], direction, walls):
        before, _ = first_contact(points[toucher], direction, walls, -1)
    if not is_held(points[1 - toucher], direction, walls):
        room, _ = first_contact(points[1 - toucher], direction, walls, -1)
    if not before < np.inf:
        return np.inf, change
    return before + change - room, before + change


@kernel
def finish(points, goal, toucher, walls, clear, moves):
    """Write to ``moves`` the last two moves of a plan with the given toucher (the particle that a
    wall holds).

    During the second-last move, the other particle stays farther from the walls than ``clear``.
    Return the largest remaining distance of a particle from its goal, or infinity if no feasible
    moves exist.
    """
    d = points.shape[1]
    direction = np.empty(d)
    short, length = shortage(points, goal, toucher, walls, direction)
    if short > -clear and length > 0:
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
def holds_nearby(start, goal, toucher, trial, nudges, walls, clear):
    """Return whether a plan still ends at the goals after small changes of its third-last move.

    After each change, the kernel computes the last two moves anew. The test rejects plans that
    depend on rounding errors.
    """
    tried = trial.shape[0] - 2
    moves = np.empty((2, start.shape[1]))
    state, move, spare = start.copy(), np.empty(start.shape[1]), np.empty(start.shape[1])
    for nudge in nudges:
        copy(start, state)
        for m in range(tried):
            for i in range(move.shape[0]):
                move[i] = trial[m, i] + (nudge[i] if m == tried - 1 else 0.0)
            advance_all(state, move, walls, spare)
        if finish(state, goal, toucher, walls, clear, moves) > EXACT * walls.size:
            return False
    return True


@kernel
def search(start, goal, directions, shares, nudges, enough, walls, clear, best_moves):
    """Search for plans of three moves: try many first moves, and compute the last two moves for
    each first move.

    Write the shortest plan to ``best_moves``. Return the number of records. A record is a plan that
    is shorter than all plans found before it. The search ends when the number of records is
    ``enough``.
    """
    d = start.shape[1]
    best, found = np.inf, 0
    lengths, trial, spare = np.empty(shares.shape[0]), np.empty((3, d)), np.empty(d)
    moves, state = np.empty((2, d)), np.empty((2, d))
    for direction in directions:
        for number in range(lengths_along(start, direction, shares, walls, lengths)):
            for i in range(d):
                trial[0, i] = direction[i] * lengths[number]
            copy(start, state)
            advance_all(state, trial[0], walls, spare)
            for toucher in range(2):
                error = finish(state, goal, toucher, walls, clear, moves)
                length = norm(trial[0]) + norm(moves[0]) + norm(moves[1])
                if error > EXACT * walls.size or length >= best:
                    continue
                copy(moves, trial[1:])
                if holds_nearby(start, goal, toucher, trial, nudges, walls, clear):
                    best = length
                    found += 1
                    copy(trial, best_moves)
                    if found >= enough:
                        return found
    return found


@kernel
def improve(start, goal, tried, step, nudges, walls, clear, best_moves):
    """Shorten a plan in place by small changes of all moves except the last two moves. Return the
    length of the plan.

    After each change, the kernel computes the last two moves anew.
    """
    d = start.shape[1]
    trial, moves, state, spare = best_moves.copy(), np.empty((2, d)), np.empty((2, d)), np.empty(d)
    best = total_length(best_moves)
    while step > 1e-6 * walls.size:
        moved = False
        for m in range(tried):
            for i in range(d):
                for side in (-1.0, 1.0):
                    copy(best_moves, trial)
                    trial[m, i] += side * step
                    copy(start, state)
                    for k in range(tried):
                        advance_all(state, trial[k], walls, spare)
                    for toucher in range(2):
                        if finish(state, goal, toucher, walls, clear, moves) > EXACT * walls.size:
                            continue
                        copy(moves, trial[tried:])
                        length = total_length(trial)
                        if length < best - 1e-9 * walls.size and holds_nearby(
                            start, goal, toucher, trial, nudges, walls, clear
                        ):
                            best, moved = length, True
                            copy(trial, best_moves)
        if not moved:
            step *= 0.5
    return best


@kernel
def least_shortage(start, goal, trial, walls, state, direction):
    """Simulate all moves of a plan except the last two. Return the smaller of the shortages for the
    two possible touchers.

    The shortage is the length of the second-last move, minus the distance that the other particle
    (not the toucher) can move before it meets a wall. Write the positions of the particles before
    the second-last move to ``state``.
    """
    copy(start, state)
    for m in range(trial.shape[0] - 2):
        advance_all(state, trial[m], walls, direction)
    one, _ = shortage(state, goal, 0, walls, direction)
    other, _ = shortage(state, goal, 1, walls, direction)
    return min(one, other)


@kernel
def repair(start, goal, walls, clear, trial):
    """Change all moves of a plan except the last two, in place, to reduce the shortage. Return the
    remaining shortage.

    The shortage is the length of the second-last move, minus the distance that the other particle
    (not the toucher) can move before it meets a wall. If the shortage is negative, the last two
    moves of the plan are feasible.
    """
    d = start.shape[1]
    state, direction = np.empty((2, d)), np.empty(d)
    best = least_shortage(start, goal, trial, walls, state, direction)
    step = WIDEST * walls.size
    while step > FINEST * walls.size and best > -3 * clear:
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
    """Write to ``trial`` a random move for each row of ``picks``.

    The two random numbers in a row of ``picks`` choose the direction and the length of the move.
    Return whether a move exists for every row of ``picks``.
    """
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
def search_guided(start, goal, directions, shares, picks, nudges, enough, walls, clear, plan):
    """Search for plans with as many moves as ``plan`` has rows, and write the shortest plan to
    ``plan``.

    Return the number of records. A record is a plan that is shorter than all plans found before it.
    The array ``picks`` holds random integers, int64, shape (tries, wide, moves - 2, 2). In each
    try, the search draws ``wide`` random plans, and repairs the plan with the smallest shortage
    (see `shortage`). The search ends when the number of records is ``enough``.
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
        if best == np.inf or repair(start, goal, walls, clear, nearest) > -1.5 * clear:
            continue
        least_shortage(start, goal, nearest, walls, state, direction)
        for toucher in range(2):
            if finish(state, goal, toucher, walls, clear, moves) > EXACT * walls.size:
                continue
            copy(moves, nearest[nearest.shape[0] - 2 :])
            length = total_length(nearest)
            if length < shortest and holds_nearby(
                start, goal, toucher, nearest, nudges, walls, clear
            ):
                shortest = length
                found += 1
                copy(nearest, plan)
                if found >= enough:
                    return found
    return found
