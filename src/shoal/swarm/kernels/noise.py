"""States and episodes under noise."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.moves import (
    COMPLETE,
    ONE,
    RUNNING,
    STALLED,
    TOP,
    ZERO,
    popcount,
    put,
    record_type,
)
from shoal.swarm.kernels.search import ahead, nearest

FAINT = 1e-5  # the belief sets lower probabilities of a particle to 0
LOST = 1e-4  # probability that a particle appears in a cell where the belief expects no particle
CLUTTER = 1e-6  # probability that a scan shows a particle in a cell that has none near it
UNKNOWN = 1e-4  # the same if a scan is weighed as a whole, because a particle may be unknown
SURE = 14.0  # maximum absolute log-odds, so that the state of a cell is never certain
LEAP = 8.0  # maximum change of the log-odds of a cell by one scan
# clutter: CLUTTER, or what the rig needs; bound: log-odds from which a cell counts as classified;
# merge: 1 if particles share cells, else 0; surest: the highest log-odds that a cell is free; leap:
# probability that a particle moves by two cells
RATES = record_type(
    np.float64, "slip", "misplace", "miss", "clutter", "bound", "merge", "surest", "leap"
)


class NoisyState(NamedTuple):
    """The true state of a simulation with noise, and the belief. Kernels change the arrays in
    place.

    All arrays except ``offsets`` are flat arrays over the workspace with a border of three cells.
    """

    truth: NDArray[np.bool_]  # free cells
    occupied: NDArray[np.bool_]  # true cells of the particles
    seen: NDArray[np.bool_]  # cells in which the last scan shows a particle
    logit: NDArray[np.float64]  # log-odds that the cell is free
    inside: NDArray[np.float64]  # probability that the cell holds a particle
    staying: NDArray[np.float64]  # probability that a particle in the cell stays
    # probability that the cell holds a particle after the move, before the scan
    moved: NDArray[np.float64]
    # for each command, the index of the next cell minus the index of the cell
    offsets: NDArray[np.int64]
    rates: Any  # a record of RATES
    layers: int  # shape of the workspace with a rim of one cell: layers, rows, columns
    rows: int
    columns: int


@in_place_kernel
def chance(logit):
    """Convert log-odds to a probability."""
    return 1.0 / (1.0 + np.exp(-logit))


@in_place_kernel
def first_and_step(size, offset):
    """Return (first cell, step) of a loop over all cells. The loop processes the cell ahead of a
    cell before the cell itself.
    """
    if offset > 0:
        return size - 1, -1
    return 0, 1


@in_place_kernel
def move_noisy(noisy, command, rng):
    """Move the particles under the rule block. Each particle may slip. Return the number of moved
    particles.
    """
    offset = noisy.offsets[command]
    at, step = first_and_step(noisy.occupied.shape[0], offset)
    particles, slip, travelled = noisy.occupied, noisy.rates.slip, 0
    for _ in range(particles.shape[0]):
        if (
            particles[at]
            and rng.random() >= slip
            and noisy.truth[at + offset]
            and not particles[at + offset]
        ):
            particles[at + offset] = True
            particles[at] = False
            travelled += 1
        at += step
    return travelled


@in_place_kernel
def look(noisy, rng):
    """Make a noisy scan. The scan misses a particle, shows it in a random neighbouring cell, or
    shows it in its own cell.

    Write the detections to ``seen``.
    """
    particles, detections, misplace, miss = (
        noisy.occupied,
        noisy.seen,
        noisy.rates.misplace,
        noisy.rates.miss,
    )
    detections[:] = False
    for at in range(particles.shape[0]):
        if not particles[at]:
            continue
        luck = rng.random()
        if luck < miss:
            continue
        if luck < miss + (1.0 - miss) * misplace:
            detections[at + noisy.offsets[int(rng.random() * noisy.offsets.shape[0])]] = True
        else:
            detections[at] = True


@in_place_kernel
def first_belief(noisy):
    """Initialize the belief from the first scan.

    A detection in a cell means a particle in the cell or a misplaced particle of a neighbouring
    cell.
    """
    misplace, miss, clutter = noisy.rates.misplace, noisy.rates.miss, noisy.rates.clutter
    hit = (1.0 - miss) * (1.0 - misplace)
    odds = (hit + clutter) / ((1.0 - miss) * misplace + clutter)
    presence = odds / (1.0 + odds)
    for at in range(noisy.seen.shape[0]):
        if noisy.seen[at]:
            noisy.inside[at] = presence
            free = presence + (1.0 - presence) * chance(noisy.logit[at])
            noisy.logit[at] = min(SURE, np.log(free / (1.0 - free)))


@in_place_kernel
def foresee(noisy, command):
    """Predict the cells of the particles after a command, before the scan.

    Write the predicted probabilities to ``staying`` and ``moved``.
    """
    inside, staying, moved = noisy.inside, noisy.staying, noisy.moved
    offset, slip = noisy.offsets[command], noisy.rates.slip
    at, step = first_and_step(inside.shape[0], offset)
    merge = noisy.rates.merge > 0.0
    moved[:] = 0.0
    for _ in range(inside.shape[0]):
        presence = inside[at]
        if presence > 0.0 and merge:  # no particle blocks another one
            ahead = at + offset
            staying[at] = 1.0 - (1.0 - slip) * max(chance(noisy.logit[ahead]), inside[ahead])
            moved[at] += (1.0 - moved[at]) * presence * staying[at]
            going = presence * (1.0 - staying[at])
            moved[ahead] += (1.0 - moved[ahead]) * going if going > FAINT * FAINT else 0.0
        elif presence > 0.0:
            ahead = at + offset
            occupancy = inside[ahead]
            enterable = (
                max(chance(noisy.logit[ahead]), occupancy) - occupancy * staying[ahead]
                if occupancy > 0.0
                else chance(noisy.logit[ahead])
            )
            staying[at] = 1.0 - (1.0 - slip) * enterable
            moved[at] += presence * staying[at]
            going = presence * (1.0 - staying[at])
            moved[ahead] += going if going > FAINT * FAINT else 0.0
        at += step


@in_place_kernel
def spread_noisy(noisy, command):
    """Update the belief after a command without a scan: predict the probabilities of particles, and
    keep the log-odds.
    """
    foresee(noisy, command)
    for at in range(noisy.inside.shape[0]):
        noisy.inside[at] = noisy.moved[at] if noisy.moved[at] > FAINT else 0.0


@in_place_kernel
def stray(noisy, at, but):
    """Return the probability that a scan shows a particle in the cell ``at``, although the cell
    holds no particle.

    The detection may come from a particle in a neighbouring cell, or from no particle. The function
    leaves out the neighbouring cell ``but``.
    """
    share = (1.0 - noisy.rates.miss) * noisy.rates.misplace / noisy.offsets.shape[0]
    none = 1.0 - noisy.rates.clutter
    for offset in noisy.offsets:
        if at + offset != but:
            none *= 1.0 - noisy.moved[at + offset] * share
    return 1.0 - none


@in_place_kernel
def likelihood(seen_behind, seen_here, behind, here, stray_behind, stray_here, hit, share):
    """Return the probability of the detections in a cell and in the cell behind it, given the
    particles in the two cells.

    ``seen_behind`` and ``seen_here`` tell whether the scan shows particles in the two cells.
    ``behind`` and ``here`` tell whether the two cells hold particles after the move. The
    probabilities ``stray_behind`` and ``stray_here`` come from `stray`. A scan shows a particle in
    its own cell with the probability ``hit``, and in each neighbouring cell with the probability
    ``share``.
    """
    neither = (1.0 - stray_behind) * (1.0 - stray_here)
    not_behind, not_here = 1.0 - stray_behind, 1.0 - stray_here
    if behind:
        neither *= 1.0 - hit - share
        not_behind *= 1.0 - hit
        not_here *= 1.0 - share
    if here:
        neither *= 1.0 - hit - share
        not_behind *= 1.0 - share
        not_here *= 1.0 - hit
    if seen_behind:
        return 1.0 - not_behind - not_here + neither if seen_here else not_here - neither
    return not_behind - neither if seen_here else neither


@in_place_kernel
def weigh(noisy, at, offset):
    """Apply Bayes' rule to the cell ``at`` together with the cell behind it, from which a particle
    may have tried to enter.

    Return the change of the log-odds that the cell ``at`` is free, and the probability that the
    cell ``at`` holds a particle.
    """
    inside, seen, slip = noisy.inside, noisy.seen, noisy.rates.slip
    miss, misplace = noisy.rates.miss, noisy.rates.misplace
    hit, share = (1.0 - miss) * (1.0 - misplace), (1.0 - miss) * misplace / noisy.offsets.shape[0]
    behind = at - offset
    free = chance(noisy.logit[at])
    occupancy = min(inside[at], free)
    coming = inside[behind]
    next_coming = inside[behind - offset] * (1.0 - slip) if coming > 0.0 else 0.0
    stay = noisy.staying[at] if occupancy > 0.0 else 0.0
    if seen[at] and noisy.moved[at] < LOST * free:
        # a particle that the belief does not know may have come from behind
        coming = max(coming, LOST)
    a, b = stray(noisy, behind, at), stray(noisy, at, behind)
    # probability of a particle behind if no particle can enter the cell
    blocked = coming + (1.0 - coming) * next_coming
    gone = coming * (1.0 - slip)
    none = likelihood(seen[behind], seen[at], False, False, a, b, hit, share)
    only_behind = likelihood(seen[behind], seen[at], True, False, a, b, hit, share)
    only_here = likelihood(seen[behind], seen[at], False, True, a, b, hit, share)
    both = likelihood(seen[behind], seen[at], True, True, a, b, hit, share)
    wall = blocked * only_behind + (1.0 - blocked) * none
    entered = gone * (next_coming * both + (1.0 - next_coming) * only_here)
    if seen[at] and not seen[behind] and not seen[behind - offset]:
        # a particle that is seen neither where it was nor one cell ahead may have leapt
        entered += noisy.rates.leap * inside[behind - offset] * only_here
    empty = (coming * slip + (1.0 - coming) * next_coming) * only_behind + (1.0 - coming) * (
        1.0 - next_coming
    ) * none
    stayed = blocked * both + (1.0 - blocked) * only_here
    share_taken = occupancy / free
    if noisy.rates.merge > 0.0:  # a particle also enters a cell in which another one stays
        behind_only = next_coming * both + (1.0 - next_coming) * only_here
        stayed = gone * behind_only + coming * slip * both + (1.0 - coming) * behind_only
    particle = (1.0 - share_taken * stay) * entered + share_taken * stay * stayed
    clear = particle + (1.0 - share_taken * stay) * empty
    tiny = 1e-300
    gained = np.log((clear + tiny) / (wall + tiny))
    total = free * clear + (1.0 - free) * wall
    return gained, free * particle / (total + tiny)


@in_place_kernel
def learn_noisy(noisy, command):
    """Update the belief after one command and the scan that followed the command."""
    foresee(noisy, command)
    offset = noisy.offsets[command]
    size = noisy.inside.shape[0]
    inside, moved, seen = noisy.inside, noisy.moved, noisy.seen
    # the loop reads each entry of ``staying`` once, before it overwrites the entry
    after = noisy.staying
    first, last = max(2 * offset, -offset), min(size - offset, size + 2 * offset)
    after[:first] = 0.0
    after[last:] = 0.0
    for at in range(first, last):
        behind = at - offset
        if noisy.logit[at] >= -SURE and (inside[behind] > 0.0 or moved[at] > 0.0 or seen[at]):
            gained, presence = weigh(noisy, at, offset)
            odds = noisy.logit[at] + max(-LEAP, min(LEAP, gained))
            noisy.logit[at] = max(-SURE, min(noisy.rates.surest, odds))
            after[at] = presence if presence > FAINT else 0.0
        else:
            after[at] = 0.0
    for at in range(after.shape[0]):
        inside[at] = after[at]


@in_place_kernel
def write(target, source):
    """Copy an array into another one of the same size."""
    for i in range(source.shape[0]):
        target[i] = source[i]


@in_place_kernel
def stray_given(noisy, at, hit, share):
    """Return the probability that a scan shows a misplaced particle in the cell ``at``, given in
    which of the neighbouring cells it shows particles.

    A particle that is shown in its own cell is shown nowhere else. One that holds a cell with the
    probability m, and is not shown there, is shown in one given neighbouring cell with the
    probability m share / (1 - m hit).
    """
    none = 1.0
    for offset in noisy.offsets:
        presence = noisy.moved[at + offset]
        if presence > 0.0 and not noisy.seen[at + offset]:
            none *= 1.0 - presence * share / max(1.0 - presence * hit, share)
    return max(1.0 - none, UNKNOWN)


@in_place_kernel
def scan_likelihood(noisy, command):
    """Return the logarithm of the probability of the scan in ``seen`` after a command, or after no
    command (-1).

    Before the command, each cell holds a particle with the probability in ``inside``, independently
    of the other cells. Particles interact only along their line: a particle enters the cell ahead
    with the probability (1 - slip) P(free) if the particle of that cell, if any, does not stay, and
    stays itself otherwise. Passing through a line from its front to its back, the loop therefore
    needs only the probability that the particle of the cell ahead stays, given what the scan shows
    farther ahead (the forward algorithm of a hidden Markov model). In contrast to `learn_noisy`,
    which treats cells as independent, no outcome counts twice, as "not there" and as "still here".
    """
    inside, moved, stays, seen = noisy.inside, noisy.moved, noisy.staying, noisy.seen
    slip, misplace, miss = noisy.rates.slip, noisy.rates.misplace, noisy.rates.miss
    hit, share = (1.0 - miss) * (1.0 - misplace), (1.0 - miss) * misplace / noisy.offsets.shape[0]
    size, offset, total = inside.shape[0], noisy.offsets[max(command, 0)], 0.0
    if command < 0:
        write(moved, inside)
    else:
        foresee(noisy, command)
    stays[:] = 0.0  # `foresee` needs its values no longer
    margin = noisy.offsets[noisy.offsets.shape[0] - 1]  # `stray_given` reads all cells beside
    at, step = first_and_step(size, offset)
    for _ in range(size):
        ahead = at + offset
        if margin <= ahead < size - margin:
            presence, blocked = inside[at], stays[ahead]
            beside = stray_given(noisy, ahead, hit, share)
            not_seen = (1.0 - hit) * (1.0 - beside)
            if_held = 1.0 - not_seen if seen[ahead] else not_seen
            if_empty = beside if seen[ahead] else 1.0 - beside
            if command < 0:
                evidence = inside[ahead] * if_held + (1.0 - inside[ahead]) * if_empty
            elif presence == 0.0 and blocked == 0.0:
                evidence = if_empty
            else:
                enterable = max(chance(noisy.logit[ahead]), inside[ahead])
                going = presence * (1.0 - slip) * enterable
                if noisy.rates.merge > 0.0:
                    if_left = blocked * if_held + (1.0 - blocked) * if_empty
                    stay, gone = (
                        (presence - going) * if_left,
                        going * if_held + (1.0 - presence) * if_left,
                    )
                    evidence = stay + gone
                    stays[at] = stay / evidence
                    total += np.log(evidence)
                    at += step
                    continue
                stay = (1.0 - blocked) * (
                    presence - going
                ) * if_empty + blocked * presence * if_held
                gone = (1.0 - blocked) * (going * if_held + (1.0 - presence) * if_empty)
                gone += blocked * (1.0 - presence) * if_held
                evidence = stay + gone
                stays[at] = stay / evidence
            if evidence < 1.0:
                total += np.log(evidence)
        at += step
    return total


@in_place_kernel
def weigh_deeds(noisy, command, before, backup, likelihoods):
    """Write to ``likelihoods`` the logarithms of the probability of the scan in ``seen`` if the rig
    carried out the command once, not at all, twice, in another direction, or late, together with
    the command ``before`` it (-1: none).

    ``backup`` is an array of the size of ``inside``.
    """
    likelihoods[0] = scan_likelihood(noisy, command)
    likelihoods[1] = scan_likelihood(noisy, -1)
    best, sum_to_best = -np.inf, 0.0
    for direction in range(noisy.offsets.shape[0]):
        if direction != command:
            value = scan_likelihood(noisy, direction)
            if value > best:
                sum_to_best = sum_to_best * np.exp(best - value) + 1.0
                best = value
            else:
                sum_to_best += np.exp(value - best)
    likelihoods[3] = best + np.log(sum_to_best / (noisy.offsets.shape[0] - 1))
    write(backup, noisy.inside)
    spread_noisy(noisy, command)
    likelihoods[2] = scan_likelihood(noisy, command)
    write(noisy.inside, backup)
    likelihoods[4] = likelihoods[2]
    if before >= 0 and before != command:
        spread_noisy(noisy, before)
        likelihoods[4] = scan_likelihood(noisy, command)
        write(noisy.inside, backup)


@in_place_kernel
def classify(noisy, open_words, known_words, occupied_words, width):
    """Write three boards of the belief: free cells, classified cells, and cells that probably hold
    a particle.

    Let x be the log-odds that a cell is free, and b the bound ``noisy.rates.bound``. The cell is
    classified as free if x >= b, and as an obstacle if x <= -b. A cell probably holds a particle if
    the probability of a particle in the cell exceeds 0.5.
    """
    rows, columns, bound = noisy.rows, noisy.columns, noisy.rates.bound
    pad = 0 if noisy.layers == 1 else 2
    for layer in range(noisy.layers):
        for row in range(rows):
            start = ((layer + pad) * (rows + 4) + row + 2) * (columns + 4) + 2
            word = (layer * rows + row) * width
            for k in range(width):
                free, known, occupied = ZERO, ZERO, ZERO
                for column in range(64 * k, min(columns, 64 * k + 64)):
                    bit = ONE << np.uint64(column - 64 * k)
                    logit = noisy.logit[start + column]
                    if logit >= bound:
                        free |= bit
                    if logit >= bound or logit <= -bound:
                        known |= bit
                    if noisy.inside[start + column] > 0.5:
                        occupied |= bit
                open_words[word + k] = free
                known_words[word + k] = known
                occupied_words[word + k] = occupied


MEMORY = record_type(
    np.int64,
    # number of moves that the guard still allows without progress, or -1 before the first plan
    "budget",
    "remaining",  # number of frontier cells
    "undecided",  # number of cells that the guard has given up
    "wakes",  # number of commands that `wake` has planned
    "at",
    "left",  # index of the next command in the plan; number of commands before the next scan
)
PATIENCE, TIMES = 50, 5  # the budget for a path of d moves is PATIENCE + TIMES * d moves


class ProgressGuard(NamedTuple):
    """The progress guard, which ensures that every episode with noise ends."""

    classified: NDArray[np.uint64]  # cells that have ever been classified
    given_up: NDArray[np.uint64]  # target cells that the guard has given up
    memory: Any  # a record of MEMORY


@in_place_kernel
def find_frontier(field, given_up):
    """Write the frontier: unclassified cells beside cells classified as free, without the cells
    that the guard has given up.

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
    """Write the belief to the boards of ``field``. Return the number of cells that are classified
    for the first time.
    """
    classify(noisy, field.open, field.known, field.occupied, field.width)
    fresh = 0
    for i in range(field.known.shape[0]):
        fresh += popcount(field.known[i] & ~guard.classified[i])
        guard.classified[i] |= field.known[i]
    guard.memory.remaining = find_frontier(field, guard.given_up)
    return fresh


@in_place_kernel
def wake(field, search, guard):
    """Plan one command if no cell is classified as free yet. Return the number of planned commands,
    0 or 1.

    With frequent errors, several scans may pass before the first cell is classified as free.
    Successive calls of `wake` use all directions in turn, and plan at most PATIENCE commands in an
    episode.
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
    """Plan the path to the nearest frontier cell. Give up frontier cells whose budget of moves is
    used up.

    Return the number of commands to send before the next scan, at most ``most``, or 0 if no path
    exists.
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

    Return the number of moves played, and the status RUNNING, COMPLETE or STALLED. A scan follows
    after at most ``every`` commands, and after command number ``limit``. The trace has space for at
    most ``limit`` commands.
    """
    memory = guard.memory
    for move in range(trace.commands.shape[0]):
        if memory.left == 0:
            memory.at, memory.left = 0, choose(field, search, guard, min(every, limit - move))
            if memory.left == 0:
                return move, COMPLETE if memory.undecided == 0 and anybody(field.open) and anybody(
                    field.occupied
                ) else STALLED
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
    """Send command number ``move`` of the trace, scan if ``trace.scanned`` says so, and write the
    results to the trace.
    """
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
