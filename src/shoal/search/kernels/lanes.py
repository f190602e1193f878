"""A path back and forth over any mask: runs of cells, chains of runs in consecutive rows, and the order of the chains.

A *run* consists of the cells of a row between two gaps. Where the region neither splits nor joins, each run touches one run of the
next row, and the runs form a *chain*. The path sweeps each chain back and forth. Choset calls a chain a "cell" ("Coverage of known
spaces: the boustrophedon cellular decomposition", Autonomous Robots 9, 2000). The path visits the chains depth first. The next
chain of the path is the unvisited neighbouring chain whose end is nearest to the present cell.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import kernel

LOOK = 64
"""Maximum number of unvisited neighbours of a chain that the search compares."""


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
    """Return (above, below): the indices of all pairs of touching runs in consecutive rows, sorted by the lower run."""
    above, below = np.empty(2 * len(runs), dtype=np.int64), np.empty(2 * len(runs), dtype=np.int64)
    count, upper = 0, 0
    for lower in range(len(runs)):
        row, begin, end = runs[lower]
        while upper < lower and (runs[upper, 0] < row - 1 or (runs[upper, 0] == row - 1 and runs[upper, 2] <= begin)):
            upper += 1
        k = upper
        while k < lower and runs[k, 0] == row - 1 and runs[k, 1] < end:
            above[count], below[count] = k, lower
            count += 1
            k += 1
    return above[:count], below[:count]


@kernel
def chains_of(runs, above, below):
    """Return (chain, first, last, following) for the chains of runs.

    ``chain`` contains the chain of each run. ``first`` and ``last`` contain the first and the last run of each chain. ``following``
    contains, for each run, the next run of the chain, or -1 at the end of the chain.
    """
    n = len(runs)
    up, down, over = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64), np.full(n, -1)
    for k in range(len(above)):
        down[above[k]] += 1
        up[below[k]] += 1
        over[below[k]] = above[k]
    chain, following = np.empty(n, dtype=np.int64), np.full(n, -1)
    first, last = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    count = 0
    for k in range(n):
        if up[k] == 1 and down[over[k]] == 1:
            chain[k] = chain[over[k]]
            following[over[k]] = k
        else:
            chain[k] = count
            first[count] = k
            count += 1
        last[chain[k]] = k
    return chain, first[:count], last[:count], following


@kernel
def neighbours_of(chain, count, above, below):
    """Return (offsets, others): the chains that touch each chain.

    The chains that touch chain k are ``others[offsets[k]:offsets[k + 1]]``.
    """
    offsets = np.zeros(count + 1, dtype=np.int64)
    for k in range(len(above)):
        a, b = chain[above[k]], chain[below[k]]
        if a != b:
            offsets[a + 1] += 1
            offsets[b + 1] += 1
    for k in range(count):
        offsets[k + 1] += offsets[k]
    others, fill = np.empty(offsets[count], dtype=np.int64), offsets.copy()
    for k in range(len(above)):
        a, b = chain[above[k]], chain[below[k]]
        if a != b:
            others[fill[a]], others[fill[b]] = b, a
            fill[a] += 1
            fill[b] += 1
    return offsets, others


@kernel
def nearest_end(runs, first, last, row, col):
    """Return (squared distance, from_last, from_right) of the end of a chain that is nearest to the cell (row, col).

    ``from_last`` tells whether the end lies in the last run of the chain. ``from_right`` tells whether the end is the right end of
    its run.
    """
    best, from_last, from_right = np.int64(2) ** 62, False, False
    for bottom in (False, True):
        run = runs[last if bottom else first]
        for right in (False, True):
            there = run[2] - 1 if right else run[1]
            away = (run[0] - row) ** 2 + (there - col) ** 2
            if away < best:
                best, from_last, from_right = away, bottom, right
    return best, from_last, from_right


@kernel
def sweep(runs, first, last, following, previous, from_last, from_right, cells, at):
    """Write the cells of a chain to ``cells``, back and forth from the given end. Return the index after the last row written."""
    run = last if from_last else first
    while run >= 0:
        row, begin, end = runs[run]
        for k in range(end - begin):
            cells[at, 0] = row
            cells[at, 1] = end - 1 - k if from_right else begin + k
            at += 1
        from_right = not from_right
        run = previous[run] if from_last else following[run]
    return at


@kernel
def sweep_all(mask, cells):
    """Write all cells of the mask to ``cells`` in the order of the sweep: (row, col), int64, shape (N, 2)."""
    runs = runs_of(mask)
    above, below = overlaps(runs)
    chain, first, last, following = chains_of(runs, above, below)
    previous = np.full(len(runs), -1)
    for k in range(len(runs)):
        if following[k] >= 0:
            previous[following[k]] = k
    count = len(first)
    offsets, others = neighbours_of(chain, count, above, below)
    visited, stack = np.zeros(count, dtype=np.bool_), np.empty(count, dtype=np.int64)
    pointer = offsets.copy()
    at = 0
    for root in range(count):
        if visited[root]:
            continue
        visited[root] = True
        stack[0], top = root, 1
        at = sweep(runs, first[root], last[root], following, previous, False, False, cells, at)
        while top > 0:
            here = stack[top - 1]
            found, from_last, from_right = choose(
                runs, first, last, offsets, others, visited, pointer, here, cells[at - 1, 0], cells[at - 1, 1]
            )
            if found < 0:
                top -= 1
                continue
            visited[found] = True
            stack[top] = found
            top += 1
            at = sweep(runs, first[found], last[found], following, previous, from_last, from_right, cells, at)


@kernel
def choose(runs, first, last, offsets, others, visited, pointer, here, row, col):
    """Among the unvisited chains that touch chain ``here``, return (chain, from_last, from_right) of the end nearest to (row, col).

    If all chains that touch chain ``here`` are visited, the first number is -1.
    """
    while pointer[here] < offsets[here + 1] and visited[others[pointer[here]]]:
        pointer[here] += 1
    found, nearest, from_last, from_right = -1, np.int64(2) ** 62, False, False
    for k in range(pointer[here], min(pointer[here] + LOOK, offsets[here + 1])):
        other = others[k]
        if not visited[other]:
            away, bottom, right = nearest_end(runs, first[other], last[other], row, col)
            if away < nearest:
                found, nearest, from_last, from_right = other, away, bottom, right
    return found, from_last, from_right
