"""One command: every particle tries one cell.

A particle stays if the next cell is an obstacle or holds one that stays. Across rows this is a chain from row to row, each row
looked at after the one that it moves into. Along a row the particles that stay are runs of set bits that end at a wall: towards
lower bits one addition a word clears exactly such runs, since its carry runs through them; towards higher bits, where no carry
runs, they are filled by six doubling steps. A run that goes on in the next word is rare and mended afterwards.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.swarm.kernels.bits import ONE, TOP, ZERO, has, popcount
from shoal.swarm.kernels.compiling import kernel

BLOCK, MERGE, TILT = 0, 1, 2
LEFT, UP, RIGHT, DOWN, IN, OUT = 0, 1, 2, 3, 4, 5


class Field(NamedTuple):
    """The boards of one running episode, changed in place; uint64, shape (layers x rows x width,)."""

    free: NDArray[np.uint64]  # the truth, which only moves may read
    occupied: NDArray[np.uint64]  # where particles are
    open: NDArray[np.uint64]  # known to be free
    known: NDArray[np.uint64]  # known to be free or obstacle
    frontier: NDArray[np.uint64]  # unknown next to known-free; in coverage the cells still to be covered
    fresh: NDArray[np.uint64]  # found free by the present push, empty between pushes
    before: NDArray[np.uint64]  # where particles were before the present push
    staying: NDArray[np.uint64]  # work space of the present push
    counts: NDArray[np.int32]  # particles of each cell, (layers x rows, 64 x width); shape (0, 0) but for merge
    layers: int
    rows: int  # of a layer
    width: int  # words of a row


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
def move_across(field, command, rule):  # type: ignore[no-untyped-def]
    """Move from row to row (u, d, i, o); return the cells travelled."""
    free, occupied, width = field.free, field.occupied, field.width
    lines, line_stride, first, stride, length, ahead = passes(field, command)
    sharing = ~ZERO if rule == MERGE else ZERO  # all ones: who is in the way does not matter
    travelled = 0
    for line in range(lines):
        source = line * line_stride + first
        for _ in range(length):
            here, there = source * width, (source + ahead) * width
            for k in range(width):
                cells = occupied[here + k]
                held = occupied[there + k]  # the next row has moved: who is there stays there
                moving = cells & free[there + k] & (~held | sharing)
                occupied[there + k] = held | moving
                occupied[here + k] = cells & ~moving
                travelled += popcount(moving)
            source += stride
    return travelled


@kernel
def stay_left(field, rule):  # type: ignore[no-untyped-def]
    """Fill ``staying`` with the particles that a move to the left leaves where they are."""
    free, before, staying = field.free, field.before, field.staying
    last = free.shape[0] - 1
    staying[0] = ZERO  # the first and the last row are rim
    for i in range(last):
        staying[i + 1] = before[i + 1] & ~((free[i + 1] << ONE) | (free[i] >> TOP))
    if rule == MERGE:
        return
    for i in range(last + 1):
        staying[i] = before[i] & ~(before[i] + staying[i])
    crossing = ZERO
    for i in range(last):
        crossing |= (staying[i] >> TOP) & before[i + 1] & ~staying[i + 1]
    if crossing != ZERO:
        for i in range(1, last + 1):
            if (staying[i - 1] >> TOP) & before[i] & ~staying[i] != ZERO:
                staying[i] |= before[i] & ~(before[i] + ONE)


@kernel
def stay_right(field, rule):  # type: ignore[no-untyped-def]
    """Fill ``staying`` with the particles that a move to the right leaves where they are."""
    free, before, staying = field.free, field.before, field.staying
    last = free.shape[0] - 1
    staying[last] = ZERO
    for i in range(last):
        staying[i] = before[i] & ~((free[i] >> ONE) | (free[i + 1] << TOP))
    if rule == MERGE:
        return
    for i in range(last):
        staying[i] = fill_down(staying[i], before[i])
    crossing = ZERO
    for i in range(last):
        crossing |= (staying[i + 1] << TOP) & before[i] & ~staying[i]
    if crossing != ZERO:
        for i in range(last - 1, -1, -1):
            seed = (staying[i + 1] << TOP) & before[i] & ~staying[i]
            if seed != ZERO:
                staying[i] |= fill_down(seed, before[i])


@kernel
def fill_down(seeds, runs):  # type: ignore[no-untyped-def]
    """Return the bits of ``runs`` that a chain of set bits connects to a higher or equal bit of ``seeds``."""
    for doubling in range(6):
        step = np.uint64(1 << doubling)
        seeds |= runs & (seeds >> step)
        runs &= runs >> step
    return seeds


@kernel
def move_along(field, command, rule):  # type: ignore[no-untyped-def]
    """Move along the rows (l, r); return the cells travelled."""
    before, staying, occupied = field.before, field.staying, field.occupied
    last = before.shape[0] - 1
    travelled = 0
    if command == LEFT:
        stay_left(field, rule)
        for i in range(last):
            moving, following = before[i] & ~staying[i], before[i + 1] & ~staying[i + 1]
            occupied[i] = staying[i] | (moving >> ONE) | (following << TOP)
    else:
        stay_right(field, rule)
        for i in range(last):
            moving, following = before[i + 1] & ~staying[i + 1], before[i] & ~staying[i]
            occupied[i + 1] = staying[i + 1] | (moving << ONE) | (following >> TOP)
    for i in range(last + 1):
        travelled += popcount(before[i] & ~staying[i])
    return travelled


@kernel
def carry_counts(field, command):  # type: ignore[no-untyped-def]
    """Move the particle counts of rule merge; return the cells travelled."""
    free, counts, width = field.free, field.counts, field.width
    travelled = 0
    if command == LEFT or command == RIGHT:
        ahead = -1 if command == LEFT else 1
        columns = counts.shape[1]
        for row in range(counts.shape[0]):
            for i in range(1, columns - 1):
                column = i if command == LEFT else columns - 1 - i
                n = counts[row, column]
                if n > 0 and has(free, width, row, column + ahead):
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
                if n > 0 and has(free, width, source + ahead, column):
                    counts[source + ahead, column] += n
                    counts[source, column] = 0
                    travelled += n
            source += stride
    return travelled


@kernel
def push(field, command, rule):  # type: ignore[no-untyped-def]
    """Try one cell with every particle, keep the old places in ``before``; return the cells travelled."""
    for i in range(field.occupied.shape[0]):
        field.before[i] = field.occupied[i]
    carried = carry_counts(field, command) if rule == MERGE else 0
    if command == LEFT or command == RIGHT:
        travelled = move_along(field, command, rule)
    else:
        travelled = move_across(field, command, rule)
    return carried if rule == MERGE else travelled
