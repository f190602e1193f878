"""Runs of cells in rows, in compiled code: boustrophedon decomposition, and order of the runs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel, kernel

LOOK = 64
"""Maximum number of unvisited neighbours of a chain that the search compares."""


_LESS = 1e-9
_LONGEST = 3  # maximum number of runs that one exchange moves together
_SPAN = 50  # number of places in the order within which a disturbance exchanges two parts
_LINKS = 50_000  # maximum of the product: number of disturbances times number of runs


class Chains(NamedTuple):
    """Runs in chains: two consecutive runs of a chain touch, and touch no other runs between them.

    Parameters
    ----------
    runs : ndarray of int64, shape (R, 3)
        Row, first column, and column after the last cell of each run, in reading order.
    first, last : ndarray of int64, shape (C,)
        First and last run of each chain.
    following, previous : ndarray of int64, shape (R,)
        The next and the previous run of each run's chain, or -1.
    offsets, others : ndarray of int64, shapes (C + 1,) and (P,)
        The chains that touch chain k are ``neighbours[offsets[k]:offsets[k + 1]]``.
    """

    runs: NDArray[np.int64]
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    following: NDArray[np.int64]
    previous: NDArray[np.int64]
    offsets: NDArray[np.int64]
    others: NDArray[np.int64]


@kernel
def sweep_all(mask, cells):
    """Write all cells of the mask to ``cells`` in the order of the sweep: (row, col), int64, shape
    (N, 2).
    """
    chains = chains_of(runs_of(mask))
    count = len(chains.first)
    visited, stack = np.zeros(count, dtype=np.bool_), np.empty(count, dtype=np.int64)
    pointer = chains.offsets.copy()
    at = 0
    for root in range(count):
        if visited[root]:
            continue
        visited[root] = True
        stack[0], top = root, 1
        at = sweep(chains, root, False, False, cells, at)
        while top > 0:
            row, col = cells[at - 1, 0], cells[at - 1, 1]
            chain, from_last, from_right = choose(
                chains, visited, pointer, stack[top - 1], row, col
            )
            if chain < 0:
                top -= 1
                continue
            visited[chain] = True
            stack[top] = chain
            top += 1
            at = sweep(chains, chain, from_last, from_right, cells, at)


@kernel
def runs_of(mask):
    """Return (row, begin, end) of all runs in reading order; int64, shape (R, 3).

    ``end`` is the column after the last cell of a run.
    """
    height, width = mask.shape
    count = 0
    for row in range(height):
        for col in range(width):
            count += mask[row, col] and (col == 0 or not mask[row, col - 1])
    runs = np.empty((count, 3), dtype=np.int64)
    at = -1
    for row in range(height):
        for col in range(width):
            if mask[row, col]:
                if col == 0 or not mask[row, col - 1]:
                    at += 1
                    runs[at, 0], runs[at, 1] = row, col
                runs[at, 2] = col + 1
    return runs


@kernel
def overlaps(runs):
    """Return (above, below): the indices of all pairs of touching runs in consecutive rows, sorted
    by the lower run.
    """
    above, below = np.empty(2 * len(runs), dtype=np.int64), np.empty(2 * len(runs), dtype=np.int64)
    count, upper = 0, 0
    for lower in range(len(runs)):
        row, begin, end = runs[lower]
        while upper < lower and (
            runs[upper, 0] < row - 1 or (runs[upper, 0] == row - 1 and runs[upper, 2] <= begin)
        ):
            upper += 1
        k = upper
        while k < lower and runs[k, 0] == row - 1 and runs[k, 1] < end:
            above[count], below[count] = k, lower
            count += 1
            k += 1
    return above[:count], below[:count]


@kernel
def chains_of(runs):
    """Return the chains of runs: a run continues the chain of the run above it if the two runs
    touch no other runs between their rows.
    """
    above, below = overlaps(runs)
    n = len(runs)
    up, down, over = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64), np.full(n, -1)
    for k in range(len(above)):
        down[above[k]] += 1
        up[below[k]] += 1
        over[below[k]] = above[k]
    chain, following, previous = np.empty(n, dtype=np.int64), np.full(n, -1), np.full(n, -1)
    first, last = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    count = 0
    for k in range(n):
        if up[k] == 1 and down[over[k]] == 1:
            chain[k] = chain[over[k]]
            following[over[k]], previous[k] = k, over[k]
        else:
            chain[k] = count
            first[count] = k
            count += 1
        last[chain[k]] = k
    offsets, neighbours = neighbours_of(chain, count, above, below)
    return Chains(runs, first[:count], last[:count], following, previous, offsets, neighbours)


@kernel
def neighbours_of(chain, count, above, below):
    """Return (offsets, neighbours): the chains that touch each chain.

    The chains that touch chain k are ``neighbours[offsets[k]:offsets[k + 1]]``.
    """
    offsets = np.zeros(count + 1, dtype=np.int64)
    for k in range(len(above)):
        a, b = chain[above[k]], chain[below[k]]
        if a != b:
            offsets[a + 1] += 1
            offsets[b + 1] += 1
    for k in range(count):
        offsets[k + 1] += offsets[k]
    neighbours, fill = np.empty(offsets[count], dtype=np.int64), offsets.copy()
    for k in range(len(above)):
        a, b = chain[above[k]], chain[below[k]]
        if a != b:
            neighbours[fill[a]], neighbours[fill[b]] = b, a
            fill[a] += 1
            fill[b] += 1
    return offsets, neighbours


@kernel
def choose(chains, visited, pointer, chain, row, col):
    """Among the unvisited chains that touch chain ``chain``, return (chain, from_last, from_right)
    of the end nearest to (row, col).

    If all chains that touch chain ``chain`` are visited, the first number is -1. ``pointer``
    contains, for each chain, the place in ``chains.others`` before which all are visited.
    """
    end = chains.offsets[chain + 1]
    while pointer[chain] < end and visited[chains.others[pointer[chain]]]:
        pointer[chain] += 1
    nearest_chain, nearest, from_last, from_right = -1, np.int64(2) ** 62, False, False
    for k in range(pointer[chain], min(pointer[chain] + LOOK, end)):
        other = chains.others[k]
        if not visited[other]:
            away, bottom, right = nearest_end(chains, other, row, col)
            if away < nearest:
                nearest_chain, nearest, from_last, from_right = other, away, bottom, right
    return nearest_chain, from_last, from_right


@kernel
def nearest_end(chains, chain, row, col):
    """Return (squared distance, from_last, from_right) of the end of a chain that is nearest to the
    cell (row, col).

    ``from_last`` tells whether the end lies in the last run of the chain. ``from_right`` tells
    whether the end is the right end of its run.
    """
    best, from_last, from_right = np.int64(2) ** 62, False, False
    for bottom in (False, True):
        run = chains.runs[chains.last[chain] if bottom else chains.first[chain]]
        for right in (False, True):
            col_of_end = run[2] - 1 if right else run[1]
            away = (run[0] - row) ** 2 + (col_of_end - col) ** 2
            if away < best:
                best, from_last, from_right = away, bottom, right
    return best, from_last, from_right


@kernel
def sweep(chains, chain, from_last, from_right, cells, at):
    """Write the cells of a chain to ``cells``, back and forth from the given end. Return the index
    after the last row written.
    """
    run = chains.last[chain] if from_last else chains.first[chain]
    while run >= 0:
        row, begin, end = chains.runs[run]
        for k in range(end - begin):
            cells[at, 0] = row
            cells[at, 1] = end - 1 - k if from_right else begin + k
            at += 1
        from_right = not from_right
        run = chains.previous[run] if from_last else chains.following[run]
    return at


@in_place_kernel
def nearest_next(ends, order, backwards):
    """Write the order of strips in which the next end is the nearest one, and whether each strip
    runs from its last cell to its first, from the first cell of the first strip.

    ``ends`` (n, 2, 2) are the first and the last cell of each strip.
    """
    n = len(ends)
    for strip in range(n):
        backwards[strip] = -1  # not in the order yet
    row, col = ends[0, 0]
    for k in range(n):
        best = np.int64(2) ** 62
        for strip in range(n):
            if backwards[strip] >= 0:
                continue
            for end in range(2):
                down, right = ends[strip, end, 0] - row, ends[strip, end, 1] - col
                away = down * down + right * right
                if away < best:
                    best, order[k], from_end = away, strip, end
        backwards[order[k]] = from_end
        row, col = ends[order[k], 1 - from_end]


@kernel
def shorten(ends, detours, order, backwards, turn, disturbances):
    """Shorten a closed tour of runs by exchanges and by up to ``disturbances`` random disturbances.

    A link costs its length, ``turn`` for each of its ends at which the direction changes, and what
    ``detours`` (2 R, 2 R) adds to it.

    A disturbance exchanges two neighbouring parts of the order, and then the exchanges shorten the
    disturbed tour. The kernel keeps a disturbed tour only if it is shorter than the best tour so
    far.
    """
    n = len(order)
    if n <= _LONGEST + 2:
        return
    costs = costs_of(ends, turn) + detours
    active, scratch = np.ones(n, dtype=np.bool_), np.empty(n, dtype=np.int64)
    exchange(costs, order, backwards, active, scratch)
    best = length(costs, order, backwards)
    best_order, best_backwards = order.copy(), backwards.copy()
    state, span = np.uint64(1), min(n - 1, _SPAN)
    drawn = np.empty(3, dtype=np.int64)
    for _ in range(min(disturbances, _LINKS // n)):
        for k in range(3):  # G. Marsaglia, "Xorshift RNGs", 2003
            state ^= state << np.uint64(13)
            state ^= state >> np.uint64(7)
            state ^= state << np.uint64(17)
            drawn[k] = np.int64((state >> np.uint64(33)) % np.uint64(n if k == 0 else span))
        i, part, parts = drawn[0], min(drawn[1], drawn[2]), max(drawn[1], drawn[2]) + 1
        if part == 0:
            continue
        for k in range(parts):
            order[(i + k) % n] = best_order[(i + (k + part) % parts) % n]
        if state & np.uint64(1):
            for k in range(parts - part):
                backwards[order[(i + k) % n]] = 1 - backwards[order[(i + k) % n]]
        for k in (-1, 0, parts - part - 1, parts - part, parts - 1, parts):
            active[order[(i + k) % n]] = True
        exchange(costs, order, backwards, active, scratch)
        total = length(costs, order, backwards)
        if total < best - _LESS:
            best = total
            best_order[:], best_backwards[:] = order, backwards
        else:
            order[:], backwards[:] = best_order, best_backwards


@kernel
def exchange(costs, order, backwards, active, scratch):
    """Shorten a closed tour of runs until no exchange at an active run makes the tour shorter.

    An active run is a run at which an exchange may still shorten the tour. After the last exchange,
    no run is active.
    """
    n, helped, improved = len(order), True, True
    # of the run at each place of the order: the end at which it begins, and the cost of the link
    entries, links = np.empty(n, dtype=np.int64), np.empty(n)
    while helped:
        helped = False
        for run in range(n):
            if not active[run]:
                continue
            active[run] = False
            if improved:
                for k in range(n):
                    entries[k] = 2 * order[k] + backwards[order[k]]
                for k in range(n):
                    links[k] = costs[entries[k - 1] ^ 1, entries[k]]
            i = 0
            while order[i] != run:
                i += 1
            improved = exchange_link(
                costs, order, backwards, active, entries, links, i
            ) or exchange_link(costs, order, backwards, active, entries, links, (i + 1) % n)
            for count in range(1, _LONGEST + 1):
                for back in (0, count - 1):
                    if not improved:
                        improved = move_runs(
                            costs,
                            order,
                            backwards,
                            active,
                            scratch,
                            entries,
                            links,
                            (i - back) % n,
                            count,
                        )
            if improved:
                active[run], helped = True, True


@in_place_kernel
def exchange_link(costs, order, backwards, active, entries, links, k):
    """Replace link k and another link by two links with a smaller total length (2-opt), if such
    links exist.

    Return whether the tour has changed.
    """
    n = len(order)
    best, other = -_LESS, -1
    for j in range(n):
        if j == k:
            continue
        low, high = min(j, k), max(j, k)
        # ends 2 r and 2 r + 1 are those of run r
        then = costs[entries[low - 1] ^ 1, entries[high - 1] ^ 1]
        then += costs[entries[low], entries[high]]
        now = links[low] + links[high]
        if then - now < best:
            best, other = then - now, j
    if other < 0:
        return False
    low, high = min(other, k), max(other, k)
    for place in (low - 1, low, high - 1, high):
        active[order[place]] = True
    reverse(order, backwards, low, high - 1)
    return True


@in_place_kernel
def move_runs(costs, order, backwards, active, scratch, entries, links, i, count):
    """Move the ``count`` runs that begin at place i of the order to another place, if the tour
    becomes shorter (Or-opt).

    Return whether the tour has changed.
    """
    n = len(order)
    first, last = order[i], order[(i + count - 1) % n]
    before, after = order[i - 1], order[(i + count) % n]
    begin, end = entries[i], entries[(i + count - 1) % n] ^ 1
    saved = links[i] + links[(i + count) % n] - costs[entries[i - 1] ^ 1, entries[(i + count) % n]]
    best, place, reversed_runs = _LESS, -1, False
    at = (i + count) % n
    for k in range(n - count - 1):
        out = entries[at] ^ 1
        at = at + 1 if at + 1 < n else 0
        into = entries[at]
        ahead = costs[out, begin] + costs[end, into]
        back = costs[out, end] + costs[begin, into]
        if saved + links[at] - min(ahead, back) > best:
            best, place, reversed_runs = saved + links[at] - min(ahead, back), k, back < ahead
    if place < 0:
        return False
    for k in range(n):
        scratch[k] = order[(i + k) % n]
    for run in (before, after, first, last, scratch[count + place], scratch[count + place + 1]):
        active[run] = True
    for k in range(n):
        order[k] = (
            scratch[count + k]
            if k <= place
            else scratch[k - place - 1]
            if k <= place + count
            else scratch[k]
        )
    if reversed_runs:
        reverse(order, backwards, place + 1, place + count)
    return True


@in_place_kernel
def reverse(order, backwards, begin, end):
    """Reverse the order and the directions of the runs from place ``begin`` to place ``end`` of the
    order.
    """
    low, high = begin, end
    while low < high:
        order[low], order[high] = order[high], order[low]
        low += 1
        high -= 1
    for k in range(begin, end + 1):
        backwards[order[k]] = 1 - backwards[order[k]]


@in_place_kernel
def link(costs, backwards, source, target):
    """Return the cost of the link from the exit of a run to the entry of the next run."""
    return step(costs, source, 1 - backwards[source], target, backwards[target])


@in_place_kernel
def step(costs, source, out, target, into):
    """Return the cost of a link from one end of a run to one end of another run. End 0 is the first
    cell, and end 1 is the last cell.
    """
    return costs[2 * source + out, 2 * target + into]


@kernel
def costs_of(ends, turn):
    """Return the cost of a link from each end of each run to each end of each run: its length, and
    the price ``turn`` for each change of direction; float64, shape (2 R, 2 R).

    Exchanges look at each cost many times.
    """
    n = len(ends)
    costs = np.empty((2 * n, 2 * n))
    for source in range(n):
        for out in range(2):
            for target in range(n):
                for into in range(2):
                    rows = ends[target, into, 0] - ends[source, out, 0]
                    cols = ends[target, into, 1] - ends[source, out, 1]
                    cost = np.sqrt(rows * rows + cols * cols)
                    if turn > 0:
                        cost += turn * (
                            bends(ends, source, out, rows, cols)
                            + bends(ends, target, into, -rows, -cols)
                        )
                    costs[2 * source + out, 2 * target + into] = cost
    return costs


@in_place_kernel
def bends(ends, run, end, rows, cols):
    """Return 0 if the direction (rows, cols) continues a run beyond one of its ends, and 1
    otherwise.
    """
    down, right = (
        ends[run, end, 0] - ends[run, 1 - end, 0],
        ends[run, end, 1] - ends[run, 1 - end, 1],
    )
    ahead = down * rows + right * cols > 0 and abs(down * cols - right * rows) < _LESS
    return 0.0 if ahead else 1.0


@in_place_kernel
def length(costs, order, backwards):
    """Return the total cost of all links of a tour."""
    total = 0.0
    for k in range(len(order)):
        total += link(costs, backwards, order[k - 1], order[k])
    return total
