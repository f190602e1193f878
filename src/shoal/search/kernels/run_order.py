"""The order and the directions in which a vehicle drives rows of cells: exchanges shorten a closed tour of runs.

A *run* consists of the cells of a row between two gaps. The array ``ends`` (R, 2, 2) contains the row and the column of the first
and the last cell of each run. A closed tour is an ``order`` (R) of the runs and a flag ``backwards`` (R) for each run. The flag
``backwards`` is 1 if the vehicle drives the run from its last cell to its first cell. Link k of a tour leads from the run at place
k - 1 of the order to the run at place k.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel, kernel

_LESS = 1e-9
_LONGEST = 3  # maximum number of runs that one exchange moves together
_SPAN = 50  # number of places in the order within which a disturbance exchanges two parts
_LINKS = 50_000  # maximum of the product: number of disturbances times number of runs


@in_place_kernel
def step(ends, one, out, other, into):
    """Return the distance from one end of a run to one end of another run. End 0 is the first cell, and end 1 is the last cell."""
    rows, cols = ends[one, out, 0] - ends[other, into, 0], ends[one, out, 1] - ends[other, into, 1]
    return np.sqrt(rows * rows + cols * cols)


@in_place_kernel
def link(ends, backwards, one, other):
    """Return the distance from the exit of a run to the entry of the next run."""
    return step(ends, one, 1 - backwards[one], other, backwards[other])


@in_place_kernel
def reverse(order, backwards, begin, end):
    """Reverse the order and the directions of the runs from place ``begin`` to place ``end`` of the order."""
    low, high = begin, end
    while low < high:
        order[low], order[high] = order[high], order[low]
        low += 1
        high -= 1
    for k in range(begin, end + 1):
        backwards[order[k]] = 1 - backwards[order[k]]


@in_place_kernel
def exchange_link(ends, order, backwards, active, k):
    """Replace link k and another link by two links with a smaller total length (2-opt), if such links exist.

    Return whether the tour has changed.
    """
    n = len(order)
    best, other = -_LESS, -1
    for j in range(n):
        if j == k:
            continue
        low, high = min(j, k), max(j, k)
        before, first, last, after = order[low - 1], order[low], order[high - 1], order[high]
        if before == last:
            continue
        now = link(ends, backwards, before, first) + link(ends, backwards, last, after)
        then = step(ends, before, 1 - backwards[before], last, 1 - backwards[last])
        then += step(ends, first, backwards[first], after, backwards[after])
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
def move_runs(ends, order, backwards, active, rest, i, count):
    """Move the ``count`` runs that begin at place i of the order to another place, if the tour becomes shorter (Or-opt).

    Return whether the tour has changed.
    """
    n = len(order)
    first, last = order[i], order[(i + count - 1) % n]
    before, after = order[i - 1], order[(i + count) % n]
    saved = link(ends, backwards, before, first) + link(ends, backwards, last, after) - link(ends, backwards, before, after)
    best, place, turned = _LESS, -1, False
    for k in range(n - count - 1):
        one, other = order[(i + count + k) % n], order[(i + count + k + 1) % n]
        out, into = 1 - backwards[one], backwards[other]
        there = link(ends, backwards, one, other)
        ahead = step(ends, one, out, first, backwards[first]) + step(ends, last, 1 - backwards[last], other, into)
        back = step(ends, one, out, last, 1 - backwards[last]) + step(ends, first, backwards[first], other, into)
        if saved + there - min(ahead, back) > best:
            best, place, turned = saved + there - min(ahead, back), k, back < ahead
    if place < 0:
        return False
    for k in range(n):
        rest[k] = order[(i + k) % n]
    for run in (before, after, first, last, rest[count + place], rest[count + place + 1]):
        active[run] = True
    for k in range(n):
        order[k] = rest[count + k] if k <= place else rest[k - place - 1] if k <= place + count else rest[k]
    if turned:
        reverse(order, backwards, place + 1, place + count)
    return True


@kernel
def exchange(ends, order, backwards, active, rest):
    """Shorten a closed tour of runs until no exchange at an active run makes the tour shorter.

    An active run is a run at which an exchange may still shorten the tour. After the last exchange, no run is active.
    """
    n, helped = len(order), True
    while helped:
        helped = False
        for run in range(n):
            if not active[run]:
                continue
            active[run] = False
            i = 0
            while order[i] != run:
                i += 1
            found = exchange_link(ends, order, backwards, active, i) or exchange_link(ends, order, backwards, active, (i + 1) % n)
            for count in range(1, _LONGEST + 1):
                for back in (0, count - 1):
                    if not found:
                        found = move_runs(ends, order, backwards, active, rest, (i - back) % n, count)
            if found:
                active[run], helped = True, True


@in_place_kernel
def length(ends, order, backwards):
    """Return the total length of all links of a tour."""
    total = 0.0
    for k in range(len(order)):
        total += link(ends, backwards, order[k - 1], order[k])
    return total


@kernel
def shorten(ends, order, backwards, disturbances):
    """Shorten a closed tour of runs by exchanges and by up to ``disturbances`` random disturbances.

    A disturbance exchanges two neighbouring parts of the order, and then the exchanges shorten the disturbed tour. The kernel keeps
    a disturbed tour only if it is shorter than the best tour so far.
    """
    n = len(order)
    if n <= _LONGEST + 2:
        return
    active, rest = np.ones(n, dtype=np.bool_), np.empty(n, dtype=np.int64)
    exchange(ends, order, backwards, active, rest)
    best = length(ends, order, backwards)
    kept, kept_backwards = order.copy(), backwards.copy()
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
            order[(i + k) % n] = kept[(i + (k + part) % parts) % n]
        if state & np.uint64(1):
            for k in range(parts - part):
                backwards[order[(i + k) % n]] = 1 - backwards[order[(i + k) % n]]
        for k in (-1, 0, parts - part - 1, parts - part, parts - 1, parts):
            active[order[(i + k) % n]] = True
        exchange(ends, order, backwards, active, rest)
        found = length(ends, order, backwards)
        if found < best - _LESS:
            best = found
            kept[:], kept_backwards[:] = order, backwards
        else:
            order[:], backwards[:] = kept, kept_backwards
