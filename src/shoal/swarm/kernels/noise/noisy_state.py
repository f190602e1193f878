"""Particles that slip, are seen beside their cell, or are not seen; and what such scans tell of each cell.

Arrays are flat, over the workspace with a pad of three cells around it: the rim, which is probed as any wall, and two more that are
never free, so that no neighbour needs a test. Cells are taken in such an order that those ahead come before those behind.

The belief holds for each cell the log-odds that it is free, and the probability that a particle is in it. A move and its scan
change them in two passes: where the particles may have gone, then Bayes' rule for each cell and the one behind it, from which a
particle may have tried to enter. Their two detections are weighed together, since a particle that was not let in is still behind.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import kernel
from shoal.swarm.kernels.dynamics.bits import ONE, ZERO
from shoal.swarm.kernels.records import record_type

FAINT = 1e-5  # less likely particles are dropped
LOST = 1e-4  # that a particle which belief has lost shows up in a cell
CLUTTER = 1e-6  # that something is seen in a cell for no reason
SURE = 14.0  # the largest log-odds: nothing is beyond doubt
LEAP = 8.0  # the most that one scan adds or takes
RATES = record_type(np.float64, "slip", "misplace", "miss", "bound")  # bound: log-odds from which a cell counts as classified


class Haze(NamedTuple):
    """The truth of a simulation, and the belief; flat arrays over the padded workspace, changed in place."""

    truth: NDArray[np.bool_]  # free cells
    there: NDArray[np.bool_]  # where particles are
    seen: NDArray[np.bool_]  # what the last scan showed
    logit: NDArray[np.float64]  # log-odds that a cell is free
    inside: NDArray[np.float64]  # probability that a particle is in a cell
    staying: NDArray[np.float64]  # that it stays, if there is one
    moved: NDArray[np.float64]  # probability of a particle after the move, before the scan
    offsets: NDArray[np.int64]  # to the neighbour in the direction of each command
    rates: Any  # a record of RATES
    layers: int  # of the board's window
    rows: int
    columns: int


@kernel
def chance(logit):
    """Return the probability of log-odds."""
    return 1.0 / (1.0 + np.exp(-logit))


@kernel
def first_and_step(size, offset):
    """Return (first cell, step) that take the cells ahead before those behind."""
    if offset > 0:
        return size - 1, -1
    return 0, 1


@kernel
def move_hazy(haze, command, rng):
    """Move the particles by rule block; each stays of itself with the rate of slips. Return how many moved."""
    offset = haze.offsets[command]
    at, step = first_and_step(haze.there.shape[0], offset)
    there, slip, travelled = haze.there, haze.rates.slip, 0
    for _ in range(there.shape[0]):
        if there[at] and rng.random() >= slip and haze.truth[at + offset] and not there[at + offset]:
            there[at + offset] = True
            there[at] = False
            travelled += 1
        at += step
    return travelled


@kernel
def look(haze, rng):
    """Fill ``seen``: each particle is missed, seen in a random neighbouring cell, or seen where it is."""
    there, seen, misplace, miss = haze.there, haze.seen, haze.rates.misplace, haze.rates.miss
    seen[:] = False
    for at in range(there.shape[0]):
        if not there[at]:
            continue
        luck = rng.random()
        if luck < miss:
            continue
        if luck < miss + (1.0 - miss) * misplace:
            seen[at + haze.offsets[int(rng.random() * haze.offsets.shape[0])]] = True
        else:
            seen[at] = True


@kernel
def first_belief(haze):
    """Begin the belief with the first scan: where something is seen there is a particle, unless it was seen beside its cell."""
    misplace, miss = haze.rates.misplace, haze.rates.miss
    hit = (1.0 - miss) * (1.0 - misplace)
    odds = (hit + CLUTTER) / ((1.0 - miss) * misplace + CLUTTER)
    held = odds / (1.0 + odds)
    for at in range(haze.seen.shape[0]):
        if haze.seen[at]:
            haze.inside[at] = held
            free = held + (1.0 - held) * chance(haze.logit[at])
            haze.logit[at] = min(SURE, np.log(free / (1.0 - free)))


@kernel
def foresee(haze, command):
    """Fill ``staying`` and ``moved``: where particles may be after a command, before it is looked."""
    inside, staying, moved = haze.inside, haze.staying, haze.moved
    offset, slip = haze.offsets[command], haze.rates.slip
    at, step = first_and_step(inside.shape[0], offset)
    moved[:] = 0.0
    for _ in range(inside.shape[0]):
        held = inside[at]
        if held > 0.0:
            ahead = at + offset
            taken = inside[ahead]
            room = max(chance(haze.logit[ahead]), taken) - taken * staying[ahead] if taken > 0.0 else chance(haze.logit[ahead])
            staying[at] = 1.0 - (1.0 - slip) * room
            moved[at] += held * staying[at]
            going = held * (1.0 - staying[at])
            moved[ahead] += going if going > FAINT * FAINT else 0.0
        at += step


@kernel
def spread_hazy(haze, command):
    """Take in a command that no scan follows: particles go where they may have gone, and nothing is learnt of the cells."""
    foresee(haze, command)
    for at in range(haze.inside.shape[0]):
        haze.inside[at] = haze.moved[at] if haze.moved[at] > FAINT else 0.0


@kernel
def stray(haze, at, but):
    """Return the probability that a scan shows in a cell a particle of a neighbouring one, other than ``but``."""
    share = (1.0 - haze.rates.miss) * haze.rates.misplace / haze.offsets.shape[0]
    none = 1.0 - CLUTTER
    for offset in haze.offsets:
        if at + offset != but:
            none *= 1.0 - haze.moved[at + offset] * share
    return 1.0 - none


@kernel
def likelihood(seen_behind, seen_here, behind, here, stray_behind, stray_here, hit, share):
    """Return the probability of two detections if particles are (or are not) behind and here after the move."""
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


@kernel
def weigh(haze, at, offset):
    """Weigh what was seen in a cell and behind it; return (log-odds gained that it is free, probability of a particle in it)."""
    inside, seen, slip = haze.inside, haze.seen, haze.rates.slip
    miss, misplace = haze.rates.miss, haze.rates.misplace
    hit, share = (1.0 - miss) * (1.0 - misplace), (1.0 - miss) * misplace / haze.offsets.shape[0]
    behind = at - offset
    free = chance(haze.logit[at])
    taken = min(inside[at], free)
    coming = inside[behind]
    next_coming = inside[behind - offset] * (1.0 - slip) if coming > 0.0 else 0.0
    stay = haze.staying[at] if taken > 0.0 else 0.0
    if seen[at] and haze.moved[at] < LOST * free:
        coming = max(coming, LOST)  # a particle that belief has lost
    a, b = stray(haze, behind, at), stray(haze, at, behind)
    held = coming + (1.0 - coming) * next_coming  # somebody behind, if nobody gets in
    gone = coming * (1.0 - slip)
    none = likelihood(seen[behind], seen[at], False, False, a, b, hit, share)
    only_behind = likelihood(seen[behind], seen[at], True, False, a, b, hit, share)
    only_here = likelihood(seen[behind], seen[at], False, True, a, b, hit, share)
    both = likelihood(seen[behind], seen[at], True, True, a, b, hit, share)
    wall = held * only_behind + (1.0 - held) * none
    entered = gone * (next_coming * both + (1.0 - next_coming) * only_here)
    empty = (coming * slip + (1.0 - coming) * next_coming) * only_behind + (1.0 - coming) * (1.0 - next_coming) * none
    stayed = held * both + (1.0 - held) * only_here
    share_taken = taken / free
    particle = (1.0 - share_taken * stay) * entered + share_taken * stay * stayed
    room = particle + (1.0 - share_taken * stay) * empty
    tiny = 1e-300
    gained = np.log((room + tiny) / (wall + tiny))
    total = free * room + (1.0 - free) * wall
    return gained, free * particle / (total + tiny)


@kernel
def learn_hazy(haze, command):
    """Take in a scan after one command."""
    foresee(haze, command)
    offset = haze.offsets[command]
    size = haze.inside.shape[0]
    inside, moved, seen = haze.inside, haze.moved, haze.seen
    after = haze.staying  # read for the cell itself only, just before it is written
    first, last = max(2 * offset, -offset), min(size - offset, size + 2 * offset)
    after[:first] = 0.0
    after[last:] = 0.0
    for at in range(first, last):
        behind = at - offset
        if haze.logit[at] >= -SURE and (inside[behind] > 0.0 or moved[at] > 0.0 or seen[at]):
            gained, held = weigh(haze, at, offset)
            haze.logit[at] = max(-SURE, min(SURE, haze.logit[at] + max(-LEAP, min(LEAP, gained))))
            after[at] = held if held > FAINT else 0.0
        else:
            after[at] = 0.0
    inside[:] = after


@kernel
def settle(haze, open_words, known_words, occupied_words, width):
    """Write boards of the belief: cells settled as free, settled at all, and holding a particle more likely than not."""
    rows, columns, bound = haze.rows, haze.columns, haze.rates.bound
    pad = 0 if haze.layers == 1 else 2
    for layer in range(haze.layers):
        for row in range(rows):
            start = ((layer + pad) * (rows + 4) + row + 2) * (columns + 4) + 2
            word = (layer * rows + row) * width
            for k in range(width):
                free, known, held = ZERO, ZERO, ZERO
                for column in range(64 * k, min(columns, 64 * k + 64)):
                    bit = ONE << np.uint64(column - 64 * k)
                    logit = haze.logit[start + column]
                    if logit >= bound:
                        free |= bit
                    if logit >= bound or logit <= -bound:
                        known |= bit
                    if haze.inside[start + column] > 0.5:
                        held |= bit
                open_words[word + k], known_words[word + k], occupied_words[word + k] = free, known, held
