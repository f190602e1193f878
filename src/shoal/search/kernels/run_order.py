"""The order in which rows of cells are driven, and which way each: a tour of segments, made shorter by exchanges.

A *run* is a row's cells between two gaps; ``ends`` (R, 2, 2) are the row and column of its first and its last cell. A closed tour
is an ``order`` (R) of the runs, and for each run whether it is driven from its last cell to its first: ``backwards`` (R), 0 or 1.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel, kernel

_LESS = 1e-9
_LONGEST = 3  # runs that are moved together


@in_place_kernel
def step(ends, one, out, other, into):
    """Return how far it is from an end of a run to one of another; 0 is the first cell, 1 the last."""
    rows, cols = ends[one, out, 0] - ends[other, into, 0], ends[one, out, 1] - ends[other, into, 1]
    return np.sqrt(rows * rows + cols * cols)


@in_place_kernel
def link(ends, backwards, one, other):
    """Return how far it is from where a run is left to where the next one is entered."""
    return step(ends, one, 1 - backwards[one], other, backwards[other])


@in_place_kernel
def reverse(order, backwards, begin, end):
    """Drive the runs from one place of the order to another, both counted, the other way round."""
    low, high = begin, end
    while low < high:
        order[low], order[high] = order[high], order[low]
        low += 1
        high -= 1
    for k in range(begin, end + 1):
        backwards[order[k]] = 1 - backwards[order[k]]


@in_place_kernel
def exchange_links(ends, order, backwards):
    """Replace two links by two shorter ones wherever that helps (2-opt); return whether anything was replaced."""
    n, found = len(order), False
    for i in range(n - 1):
        for j in range(i + 1, n):
            if i == 0 and j == n - 1:
                continue
            before, first, last, after = order[i - 1], order[i], order[j], order[(j + 1) % n]
            now = link(ends, backwards, before, first) + link(ends, backwards, last, after)
            then = step(ends, before, 1 - backwards[before], last, 1 - backwards[last])
            then += step(ends, first, backwards[first], after, backwards[after])
            if then < now - _LESS:
                reverse(order, backwards, i, j)
                found = True
    return found


@kernel
def move_runs(ends, order, backwards, count):
    """Move so many runs that follow each other to where they make the tour shorter (Or-opt); return whether any were moved."""
    n, found = len(order), False
    rest = np.empty(n - count, dtype=np.int64)
    moved = np.empty(count, dtype=np.int64)
    for i in range(n):
        for k in range(n):
            run = order[(i + k) % n]
            if k < count:
                moved[k] = run
            else:
                rest[k - count] = run
        before, first, last, after = rest[-1], moved[0], moved[-1], rest[0]
        saved = link(ends, backwards, before, first) + link(ends, backwards, last, after) - link(ends, backwards, before, after)
        best, place, turned = _LESS, -1, False
        for k in range(n - count - 1):
            one, other = rest[k], rest[k + 1]
            out, into = 1 - backwards[one], backwards[other]
            there = link(ends, backwards, one, other)
            ahead = step(ends, one, out, first, backwards[first]) + step(ends, last, 1 - backwards[last], other, into)
            back = step(ends, one, out, last, 1 - backwards[last]) + step(ends, first, backwards[first], other, into)
            if saved + there - min(ahead, back) > best:
                best, place, turned = saved + there - min(ahead, back), k, back < ahead
        if place < 0:
            continue
        found = True
        for k in range(n):
            order[k] = rest[k] if k <= place else moved[k - place - 1] if k <= place + count else rest[k - count]
        if turned:
            reverse(order, backwards, place + 1, place + count)
    return found


@kernel
def shorten(ends, order, backwards):
    """Make a closed tour of runs shorter until no exchange helps."""
    helped = len(order) > _LONGEST + 2
    while helped:
        helped = exchange_links(ends, order, backwards)
        for count in range(1, _LONGEST + 1):
            helped = move_runs(ends, order, backwards, count) or helped
