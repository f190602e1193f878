"""A* search for the fewest commands on a small map, pruned by prices of cells.

A place is a set of cells that hold particles. ``ahead[p, c]`` is the place after command c, and
``tried[p, c]`` the required cells that the particles then classify, one bit for each.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.moves import ZERO, popcount

FAR = 32767  # more commands than any plan here has
FOUND, IMPOSSIBLE, FULL, UNEXPLORED = 0, 1, 2, 3
COUNT, ENTRIES, LEVEL, GOAL = 0, 1, 2, 3  # what ``progress`` holds
_MIX, _SHIFT = np.uint64(0x9E3779B97F4A7C15), np.uint64(29)


class Graph(NamedTuple):
    """The places that a swarm can reach.

    Attributes
    ----------
    ahead : ndarray of int32, shape (places, commands)
        The place after each command, or -1 in all commands of a place that was not explored.
    tried : ndarray of uint64, shape (places, commands, words)
        The required cells that each command classifies.
    alone : ndarray of bool, shape (places,)
        Whether all particles are in one cell, under a rule other than tilt.
    """

    ahead: NDArray[np.int32]
    tried: NDArray[np.uint64]
    alone: NDArray[np.bool_]


class Prices(NamedTuple):
    """Whole prices of required cells, and how fast a swarm can earn them.

    Attributes
    ----------
    planes : ndarray of uint64, shape (lists, bits, words)
        Bit b of the price of each required cell, for each list of prices.
    sums : ndarray of int64, shape (lists,)
        The sum of all prices of a list.
    offsets : ndarray of int64, shape (lists,)
        Where the table of a list begins in ``needed``.
    needed : ndarray of int16
        For each list, place and sum s, the fewest commands that earn s from the place.
    """

    planes: NDArray[np.uint64]
    sums: NDArray[np.int64]
    offsets: NDArray[np.int64]
    needed: NDArray[np.int16]


class States(NamedTuple):
    """The states that a search has found, each a place and the cells that are left.

    Attributes
    ----------
    place, moves, before, command : ndarray of int32, shape (capacity,)
        The place, the fewest commands so far, and the state and the command before.
    left : ndarray of uint64, shape (capacity, words)
        The required cells that are left.
    expanded : ndarray of bool, shape (capacity,)
    slots : ndarray of int32, a power of two
        Hash table of the states; -1 for none.
    queued, following : ndarray of int32
        The state of each entry of the queue, and the entry below it.
    heads : ndarray of int32
        The top entry of the queue for each least number of commands of a plan; -1 for none.
    """

    place: NDArray[np.int32]
    moves: NDArray[np.int32]
    before: NDArray[np.int32]
    command: NDArray[np.int32]
    left: NDArray[np.uint64]
    expanded: NDArray[np.bool_]
    slots: NDArray[np.int32]
    queued: NDArray[np.int32]
    following: NDArray[np.int32]
    heads: NDArray[np.int32]


@in_place_kernel
def worth(cells, planes):
    """Return the sum of the prices of a set of cells."""
    total = 0
    for bit in range(planes.shape[0]):
        for i in range(planes.shape[1]):
            total += popcount(cells[i] & planes[bit, i]) << bit
    return total


@in_place_kernel
def tabulate(graph, planes, total, earned, probes, best, needed):
    """Write the fewest commands that earn each sum up to ``total`` from each place to ``needed``.

    Let V[t, p] be the most that t commands earn from p, where a command earns the prices of all
    cells that it tries, whether they are classified already or not. A command that moves no particle
    earns at most once before particles move again: another time, it would classify nothing. So with
    B[p, j] for the most that j such commands earn at p::

        V[t, p] = max over j, and commands c that lead to another place q, of
                  B[p, j] + earned[p, c] + V[t - 1 - j, q]

    A place that was not explored earns everything. ``best`` is a ring of V, ``probes`` is B.
    """
    ahead, tried = graph.ahead, graph.tried
    places, commands = ahead.shape
    depth = best.shape[0]
    for p in range(places):
        for j in range(commands + 1):
            probes[p, j] = 0
        count = 0
        for c in range(commands):
            earned[p, c] = worth(tried[p, c], planes)
            if ahead[p, c] == p and earned[p, c] > 0:
                at = count  # the dearest first
                while at > 0 and probes[p, at] < earned[p, c]:
                    probes[p, at + 1] = probes[p, at]
                    at -= 1
                probes[p, at + 1] = earned[p, c]
                count += 1
        for j in range(1, commands + 1):
            probes[p, j] += probes[p, j - 1]
        best[0, p] = total if ahead[p, 0] < 0 else 0
        for s in range(total + 1):
            needed[p * (total + 1) + s] = 0 if s <= best[0, p] else FAR
    t, same = 0, 0
    while same <= commands + 1 and t < FAR - 1:
        t += 1
        now, same = t % depth, same + 1
        for p in range(places):
            most = best[(t - 1) % depth, p]
            if most < total:
                before = most
                for j in range(min(commands, t) + 1):
                    most = max(most, probes[p, j])
                    if j < t:
                        for c in range(commands):
                            if ahead[p, c] != p:
                                then = best[(t - 1 - j) % depth, ahead[p, c]]
                                most = max(most, probes[p, j] + earned[p, c] + then)
                most = min(most, total)
                if most > before:
                    same = 0
                    for s in range(before + 1, most + 1):
                        needed[p * (total + 1) + s] = t
            best[now, p] = most


@in_place_kernel
def estimate(place, remaining, prices):
    """Return a lower bound on the number of commands that classify the cells that are left."""
    most = 0
    for i in range(prices.sums.shape[0]):
        s = worth(remaining, prices.planes[i])
        at = prices.offsets[i] + place * (prices.sums[i] + 1) + s
        most = max(most, np.int64(prices.needed[at]))
    return most


@in_place_kernel
def slot_of(place, remaining, states):
    """Return the slot of a state, or the free slot where it belongs."""
    mixed = np.uint64(place) * _MIX
    for i in range(remaining.shape[0]):
        mixed = (mixed ^ remaining[i]) * _MIX
        mixed ^= mixed >> _SHIFT
    last = states.slots.shape[0] - 1
    slot = np.int64(mixed & np.uint64(last))
    while states.slots[slot] >= 0:
        state, same = states.slots[slot], True
        for i in range(remaining.shape[0]):
            same = same and states.left[state, i] == remaining[i]
        if same and states.place[state] == place:
            return slot
        slot = (slot + 1) & last
    return slot


@in_place_kernel
def fill_slots(states, count):
    """Put the first ``count`` states into an empty hash table."""
    for state in range(count):
        states.slots[slot_of(states.place[state], states.left[state], states)] = state


@in_place_kernel
def search(graph, prices, states, progress, unclassified):
    """Go on with an A* search until it has found a plan, has no state left, or needs more room.

    ``progress`` holds the numbers of states and of entries, the least number of commands of a plan,
    and the state in which no cell is left. ``unclassified`` is memory for one set of cells.
    """
    ahead, tried = graph.ahead, graph.tried
    commands, words = ahead.shape[1], unclassified.shape[0]
    while progress[LEVEL] < states.heads.shape[0]:
        level = progress[LEVEL]
        entry = states.heads[level]
        if entry < 0:
            progress[LEVEL] += 1
            continue
        if (
            progress[COUNT] + commands > states.place.shape[0]
            or progress[ENTRIES] + commands > states.queued.shape[0]
        ):
            return FULL
        states.heads[level] = states.following[entry]
        current = states.queued[entry]
        if states.expanded[current]:
            continue
        states.expanded[current] = True
        place, moves = states.place[current], states.moves[current] + 1
        remaining, only, complete = states.left[current], -1, True
        for i in range(words):
            complete = complete and remaining[i] == ZERO
        if complete:
            progress[GOAL] = current
            return FOUND
        if ahead[place, 0] < 0:
            return UNEXPLORED
        if graph.alone[place]:
            # Particles in one cell probe a wall without a move. A probe now takes the place of any
            # later one of the same wall. Not so under tilt, where a slide probes a wall at its end.
            for c in range(commands):
                for i in range(words):
                    if ahead[place, c] == place and remaining[i] & tried[place, c, i] != ZERO:
                        only = c
        for c in range(commands):
            if only >= 0 and c != only:
                continue
            successor, changed = ahead[place, c], ahead[place, c] != place
            for i in range(words):
                unclassified[i] = remaining[i] & ~tried[place, c, i]
                changed = changed or unclassified[i] != remaining[i]
            if not changed:
                continue
            slot = slot_of(successor, unclassified, states)
            state = states.slots[slot]
            if state >= 0 and states.moves[state] <= moves:
                continue
            more = estimate(successor, unclassified, prices)
            if more >= FAR:
                continue
            if state < 0:
                state = progress[COUNT]
                progress[COUNT] += 1
                states.slots[slot] = state
                states.place[state] = successor
                for i in range(words):
                    states.left[state, i] = unclassified[i]
            states.moves[state], states.before[state], states.command[state] = moves, current, c
            states.expanded[state] = False
            entry = progress[ENTRIES]
            progress[ENTRIES] += 1
            total = min(max(level, moves + more), states.heads.shape[0] - 1)
            states.queued[entry] = state
            states.following[entry] = states.heads[total]
            states.heads[total] = entry
    return IMPOSSIBLE
