"""One command: every particle tries one cell, and what that tells about unknown cells.

All in place and in one pass, in the order in which particles clear the way for one another: row by row against the direction of
the command, so that whoever is still in the next row when its turn has passed is there to stay. Along a row a queue against a
wall is a run of set bits that starts at the wall: to the left one addition with carry clears exactly such runs; to the right,
where no carry runs, they are filled by doubling steps, as many as the longest queue needs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.swarm.kernels.compiling import kernel
from shoal.swarm.kernels.bits import ONE, TOP, ZERO, has, popcount

BLOCK, MERGE, TILT = 0, 1, 2
LEFT, UP, RIGHT, DOWN, IN, OUT = 0, 1, 2, 3, 4, 5


class Field(NamedTuple):
    """The boards of one running episode, all changed in place; uint64, shape (layers x rows, words of a row)."""

    free: NDArray[np.uint64]  # the truth, which only moves may read
    occupied: NDArray[np.uint64]  # where particles are
    open: NDArray[np.uint64]  # known to be free
    known: NDArray[np.uint64]  # known to be free or obstacle
    frontier: NDArray[np.uint64]  # unknown next to known-free; in coverage the cells still to be covered
    fresh: NDArray[np.uint64]  # found free by the present move, empty between moves
    counts: NDArray[np.int32]  # particles of each cell, (layers x rows, 64 x words); shape (0, 0) but for merge
    layers: int
    rows: int


@kernel
def passes(field, command):  # type: ignore[no-untyped-def]
    """Return (lines, line stride, first row, row stride, rows of a line, offset of the next row) of a cross-row command."""
    layers, rows = field.layers, field.rows
    if command == UP:
        return layers, rows, 1, 1, rows - 1, -1
    if command == DOWN:
        return layers, rows, rows - 2, -1, rows - 1, 1
    if command == IN:
        return rows, 1, rows, rows, layers - 1, -rows
    return rows, 1, (layers - 2) * rows, -rows, layers - 1, rows


@kernel
def learn(field, row, k, unknown):  # type: ignore[no-untyped-def]
    """Classify the attempted cells ``unknown`` of one word by where particles are now; return how many they were."""
    found = unknown & field.occupied[row, k]
    field.known[row, k] |= unknown
    field.frontier[row, k] &= ~unknown
    field.open[row, k] |= found
    field.fresh[row, k] |= found
    return popcount(unknown)


@kernel
def move_across(field, command, rule):  # type: ignore[no-untyped-def]
    """Move along rows' normals (u, d, i, o); return (cells travelled, cells classified)."""
    free, occupied, known = field.free, field.occupied, field.known
    lines, line_stride, first, stride, length, ahead = passes(field, command)
    blocking = rule != MERGE
    travelled, classified = 0, 0
    for line in range(lines):
        source = line * line_stride + first
        for _ in range(length):
            target = source + ahead
            for k in range(free.shape[1]):
                here = occupied[source, k]
                if here == ZERO:
                    continue
                moving = here & free[target, k]
                if blocking:
                    moving &= ~occupied[target, k]  # the next row has moved: who is there stays there
                occupied[target, k] |= moving
                occupied[source, k] = here & ~moving
                travelled += popcount(moving)
                unknown = here & ~known[target, k]
                if unknown != ZERO:
                    classified += learn(field, target, k, unknown)
            source += stride
    return travelled, classified


@kernel
def move_left(field, rule):  # type: ignore[no-untyped-def]
    """Move one column to the left; return (cells travelled, cells classified)."""
    free, occupied, known = field.free, field.occupied, field.known
    last = free.shape[1] - 1
    blocking = rule != MERGE
    travelled, classified = 0, 0
    for row in range(free.shape[0]):
        carry = ZERO  # a stopped queue goes on in the next word
        beside = ZERO  # is the last cell of the previous word free?
        unknown = ZERO
        for k in range(last + 1):
            here, here_free = occupied[row, k], free[row, k]
            following = occupied[row, k + 1] << TOP if k < last else ZERO
            staying = here & ~((here_free << ONE) | beside)
            beside = here_free >> TOP
            if blocking:
                total = here + staying
                overflow = total < here
                total += carry
                carry = ONE if overflow or total < carry else ZERO
                staying = here & ~total
            moving = here & ~staying
            occupied[row, k] = staying | (moving >> ONE)
            travelled += popcount(moving)
            if k > 0:
                occupied[row, k - 1] |= moving << TOP
                if unknown != ZERO:
                    classified += learn(field, row, k - 1, unknown)
            unknown = ((here >> ONE) | following) & ~known[row, k]
        if unknown != ZERO:
            classified += learn(field, row, k, unknown)
    return travelled, classified


@kernel
def fill_down(seeds, runs):  # type: ignore[no-untyped-def]
    """Return the bits of ``runs`` that a chain of set bits connects to a higher or equal bit of ``seeds``."""
    step = ONE
    while runs != ZERO:
        seeds |= runs & (seeds >> step)
        runs &= runs >> step
        step = step << ONE
        if step > TOP:
            break
    return seeds


@kernel
def move_right(field, rule):  # type: ignore[no-untyped-def]
    """Move one column to the right; return (cells travelled, cells classified)."""
    free, occupied, known = field.free, field.occupied, field.known
    last = free.shape[1] - 1
    blocking = rule != MERGE
    travelled, classified = 0, 0
    for row in range(free.shape[0]):
        queued = ZERO  # top bit: does the first particle of the word above stay?
        beside = ZERO  # top bit: is the first cell of the word above free?
        unknown = ZERO
        for k in range(last, -1, -1):
            here, here_free = occupied[row, k], free[row, k]
            preceding = occupied[row, k - 1] >> TOP if k > 0 else ZERO
            staying = here & ~((here_free >> ONE) | beside)
            beside = here_free << TOP
            if blocking:
                staying |= here & queued
                if staying != ZERO:
                    staying = fill_down(staying, here)
                queued = staying << TOP
            moving = here & ~staying
            occupied[row, k] = staying | (moving << ONE)
            travelled += popcount(moving)
            if k < last:
                occupied[row, k + 1] |= moving >> TOP
                if unknown != ZERO:
                    classified += learn(field, row, k + 1, unknown)
            unknown = ((here << ONE) | preceding) & ~known[row, k]
        if unknown != ZERO:
            classified += learn(field, row, k, unknown)
    return travelled, classified


@kernel
def carry_counts(field, command):  # type: ignore[no-untyped-def]
    """Move the particle counts of rule merge, before the boards; return the cells travelled."""
    free, counts = field.free, field.counts
    travelled = 0
    if command == LEFT or command == RIGHT:
        ahead = -1 if command == LEFT else 1
        width = counts.shape[1]
        for row in range(counts.shape[0]):
            for i in range(1, width - 1):
                column = i if command == LEFT else width - 1 - i
                n = counts[row, column]
                if n > 0 and has(free, row, column + ahead):
                    counts[row, column + ahead] += n
                    counts[row, column] = 0
                    travelled += n
        return travelled
    lines, line_stride, first, stride, length, ahead = passes(field, command)
    for line in range(lines):
        source = line * line_stride + first
        for _ in range(length):
            for column in range(counts.shape[1]):
                n = counts[source, column]
                if n > 0 and has(free, source + ahead, column):
                    counts[source + ahead, column] += n
                    counts[source, column] = 0
                    travelled += n
            source += stride
    return travelled


@kernel
def push(field, command, rule):  # type: ignore[no-untyped-def]
    """Try one cell with every particle and classify what was tried; return (cells travelled, cells classified)."""
    carried = carry_counts(field, command) if rule == MERGE else 0
    if command == LEFT:
        travelled, classified = move_left(field, rule)
    elif command == RIGHT:
        travelled, classified = move_right(field, rule)
    else:
        travelled, classified = move_across(field, command, rule)
    return carried if rule == MERGE else travelled, classified
