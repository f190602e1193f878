"""One command: every particle tries one cell, and each unknown cell that was tried is classified.

A particle stays if the next cell is an obstacle or holds one that stays. Across rows this is a chain from row to row, each row
looked at after the one that it moves into. Along a row the particles that stay are runs of set bits that end at a wall: towards
lower bits one addition a word clears exactly such runs, since its carry runs through them; towards higher bits, where no carry
runs, they are filled by six doubling steps. A run that goes on in the next word is rare and mended afterwards.

Boards are worked through in blocks of rows that fit the processor's cache, so that a large one is read from memory once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.dynamics.bits import ALL, ONE, TOP, ZERO, has, popcount

BLOCK, MERGE, TILT = 0, 1, 2
LEFT, UP, RIGHT, DOWN, IN, OUT = 0, 1, 2, 3, 4, 5
BLOCK_WORDS = 1024  # of each board (or one row, if that is longer); a handful of boards is in use at once


class Field(NamedTuple):
    """The boards of one running episode, changed in place; uint64, shape (layers x rows x width,), or one block of them."""

    free: NDArray[np.uint64]  # the truth, which only moves may read
    occupied: NDArray[np.uint64]  # where particles are
    open: NDArray[np.uint64]  # known to be free
    known: NDArray[np.uint64]  # known to be free or obstacle
    frontier: NDArray[np.uint64]  # unknown next to known-free; in coverage the cells still to be covered
    tried: NDArray[np.uint64]  # of one block: unknown cells that particles try to enter
    before: NDArray[np.uint64]  # of one block: where particles were
    staying: NDArray[np.uint64]  # of one block: particles that stay
    counts: NDArray[np.int32]  # particles of each cell, (layers x rows, 64 x width); shape (0, 0) but for merge
    layers: int
    rows: int  # of a layer
    width: int  # words of a row


@in_place_kernel
def segments(field, command):
    """Return (lines, words from line to line, first word, words of a line, words to the next row) of a cross-row command.

    The words of a line are those that have a next row. They are moved in this order: u and i from the first word on,
    d and o from the last word back.
    """
    layer = field.rows * field.width
    if command == UP:
        return field.layers, layer, field.width, layer - field.width, -field.width
    if command == DOWN:
        return field.layers, layer, 0, layer - field.width, field.width
    if command == IN:
        return 1, 0, layer, (field.layers - 1) * layer, -layer
    return 1, 0, 0, (field.layers - 1) * layer, layer


@in_place_kernel
def move_across(field, command, rule):
    """Move from row to row (u, d, i, o) and learn; return (travelled, classified, added to the frontier)."""
    lines, line_stride, first, length, ahead = segments(field, command)
    travelled, classified, added = 0, 0, 0
    for line in range(lines):
        for start in range(0, length, BLOCK_WORDS):
            size = min(BLOCK_WORDS, length - start)
            source = line * line_stride + first + (start if ahead < 0 else length - start - size)
            target, end = source + ahead, source + ahead + size
            moving = field.before[:size]
            some = shift_across(
                field.occupied[source : source + size], field.occupied[target:end], field.free[target:end],
                field.known[target:end], ALL, field.tried[:size], moving, ahead, rule,
            )  # fmt: skip
            for i in range(size):
                travelled += popcount(moving[i])
            if some != ZERO:
                words = learn(field, target, end)
                classified, added = classified + words[0], added + words[1]
    return travelled, classified, added


@in_place_kernel
def shift_across(here, there, free, board, flip, tried, moving, ahead, rule):
    """Move words of particles from ``here`` to ``there``, which lie ``ahead`` words apart, in loops that become vector code.

    Notes in ``tried`` the cells entered or run against that are on ``board``, or not on it if ``flip`` is ALL, and in ``moving``
    who moves. Returns the union of what was tried, one word.
    """
    some = ZERO
    for i in range(moving.shape[0]):
        hit = here[i] & (board[i] ^ flip)
        tried[i] = hit
        some |= hit
    for i in range(moving.shape[0]):
        moving[i] = here[i] & free[i]
    if rule != MERGE:
        hold(there, moving, ahead)
    for i in range(moving.shape[0]):
        here[i] &= ~moving[i]
    for i in range(moving.shape[0]):
        there[i] |= moving[i]
    return some


@in_place_kernel
def hold(there, moving, ahead):
    """Take those out of ``moving`` that are held up by one ahead which stays: the only recurrence from row to row."""
    size, step = moving.shape[0], abs(ahead)
    first = min(step, size)
    if ahead < 0:
        for i in range(first):
            moving[i] &= ~there[i]
        later, before, blocking = moving[first:], moving[: size - first], there[first:]
        for i in range(later.shape[0]):
            later[i] &= ~blocking[i] | before[i]
        return
    for i in range(size - first, size):
        moving[i] &= ~there[i]
    later, before, blocking = moving[: size - first], moving[first:], there[: size - first]
    i = np.uint64(later.shape[0])  # unsigned: no test for negative indices, which takes as long as all else
    while i > ZERO:
        i -= ONE
        later[i] &= ~blocking[i] | before[i]


@in_place_kernel
def learn(field, first, last):
    """Classify the block of tried cells, words ``first`` to ``last - 1``, by where particles are now; return (classified, added).

    A tried cell is free if a particle stands in it, else obstacle. The unknown neighbours of those found free join the frontier;
    among them may be cells that were tried, too, and come later here, but they are on the frontier already.
    """
    tried = field.tried
    classified, added = 0, 0
    for i in range(first, last):
        cells = tried[i - first]
        if cells == ZERO:
            continue
        classified += popcount(cells)
        field.known[i] |= cells
        field.frontier[i] &= ~cells
        found = cells & field.occupied[i]
        if found == ZERO:
            continue
        field.open[i] |= found
        added += add_neighbours(field, i, found)
    return classified, added


@in_place_kernel
def add_neighbours(field, i, found):
    """Add the unknown neighbours of the cells ``found`` of one word to the frontier; return how many are new."""
    width = field.width
    added = add_frontier(field, i, (found << ONE) | (found >> ONE))
    if found >> TOP != ZERO:
        added += add_frontier(field, i + 1, ONE)
    if found & ONE != ZERO:
        added += add_frontier(field, i - 1, ONE << TOP)
    added += add_frontier(field, i - width, found)
    added += add_frontier(field, i + width, found)
    if field.layers > 1:
        added += add_frontier(field, i - width * field.rows, found)
        added += add_frontier(field, i + width * field.rows, found)
    return added


@in_place_kernel
def add_frontier(field, i, cells):
    """Add the unknown ones of ``cells`` to one word of the frontier; return how many are new."""
    new = cells & ~field.known[i] & ~field.frontier[i]
    field.frontier[i] |= new
    return popcount(new)


@in_place_kernel
def stay_left(free, before, staying, rule):
    """Fill ``staying`` with the particles that a move to the left leaves where they are."""
    inner = free.shape[0] - 1
    blocked = before[0] & ~(free[0] << ONE)
    if rule == MERGE:
        staying[0] = blocked
        for i in range(inner):
            staying[i + 1] = before[i + 1] & ~((free[i + 1] << ONE) | (free[i] >> TOP))
        return
    staying[0] = before[0] & ~(before[0] + blocked)
    for i in range(inner):
        here = before[i + 1]
        staying[i + 1] = here & ~(here + (here & ~((free[i + 1] << ONE) | (free[i] >> TOP))))
    crossing = ZERO
    for i in range(inner):
        crossing |= (staying[i] >> TOP) & before[i + 1] & ~staying[i + 1]
    if crossing != ZERO:
        for i in range(inner):
            if (staying[i] >> TOP) & before[i + 1] & ~staying[i + 1] != ZERO:
                staying[i + 1] |= before[i + 1] & ~(before[i + 1] + ONE)


@in_place_kernel
def stay_right(free, before, staying, rule):
    """Fill ``staying`` with the particles that a move to the right leaves where they are."""
    inner = free.shape[0] - 1
    staying[inner] = before[inner] & ~(free[inner] >> ONE)
    if rule == MERGE:
        for i in range(inner):
            staying[i] = before[i] & ~((free[i] >> ONE) | (free[i + 1] << TOP))
        return
    staying[inner] = fill_down(staying[inner], before[inner])
    for i in range(inner):
        staying[i] = fill_down(before[i] & ~((free[i] >> ONE) | (free[i + 1] << TOP)), before[i])
    crossing = ZERO
    for i in range(inner):
        crossing |= (staying[i + 1] << TOP) & before[i] & ~staying[i]
    if crossing != ZERO:
        for i in range(inner - 1, -1, -1):
            seed = (staying[i + 1] << TOP) & before[i] & ~staying[i]
            if seed != ZERO:
                staying[i] |= fill_down(seed, before[i])


@in_place_kernel
def fill_down(seeds, runs):
    """Return the bits of ``runs`` that a chain of set bits connects to a higher or equal bit of ``seeds``."""
    for doubling in range(6):
        step = np.uint64(1 << doubling)
        seeds |= runs & (seeds >> step)
        runs &= runs >> step
    return seeds


@in_place_kernel
def move_along(field, command, rule):
    """Move along the rows (l, r) and learn; return (travelled, classified, added to the frontier)."""
    travelled, classified, added = 0, 0, 0
    total = field.occupied.shape[0]
    block = max(1, BLOCK_WORDS // field.width) * field.width
    for first in range(0, total, block):
        last = min(total, first + block)
        size = last - first
        before, staying = field.before[:size], field.staying[:size]
        some = shift_along(
            field.occupied[first:last], field.free[first:last], field.known[first:last], ALL, field.tried[:size], before, staying,
            command, rule,
        )  # fmt: skip
        for i in range(size):
            travelled += popcount(before[i] & ~staying[i])
        if some != ZERO:
            words = learn(field, first, last)
            classified, added = classified + words[0], added + words[1]
    return travelled, classified, added


@in_place_kernel
def shift_along(occupied, free, board, flip, tried, before, staying, command, rule):
    """Move particles along whole rows, as `shift_across` does; ``before`` and ``staying`` hold who was there and who stays."""
    inner = occupied.shape[0] - 1
    for i in range(inner + 1):
        before[i] = occupied[i]
    some = ZERO
    following, moved = before[1:], staying[1:]
    if command == LEFT:
        stay_left(free, before, staying, rule)
        wanted, hit = board[:inner], tried[:inner]
        for i in range(inner):
            occupied[i] = staying[i] | ((before[i] & ~staying[i]) >> ONE) | ((following[i] & ~moved[i]) << TOP)
        for i in range(inner):
            hit[i] = ((before[i] >> ONE) | (following[i] << TOP)) & (wanted[i] ^ flip)
            some |= hit[i]
        occupied[inner] = staying[inner] | ((before[inner] & ~staying[inner]) >> ONE)
        tried[inner] = (before[inner] >> ONE) & (board[inner] ^ flip)
        return some | tried[inner]
    stay_right(free, before, staying, rule)
    occupied[0] = staying[0] | ((before[0] & ~staying[0]) << ONE)
    tried[0] = (before[0] << ONE) & (board[0] ^ flip)
    target, wanted, hit = occupied[1:], board[1:], tried[1:]
    for i in range(inner):
        target[i] = moved[i] | ((following[i] & ~moved[i]) << ONE) | ((before[i] & ~staying[i]) >> TOP)
    for i in range(inner):
        hit[i] = ((following[i] << ONE) | (before[i] >> TOP)) & (wanted[i] ^ flip)
        some |= hit[i]
    return some | tried[0]


@in_place_kernel
def carry_counts(field, command):
    """Move the particle counts of rule merge; return the cells travelled."""
    free, counts, width = field.free, field.counts, field.width
    rows_ahead, columns_ahead = 0, 0
    if command == LEFT or command == RIGHT:
        columns_ahead = -1 if command == LEFT else 1
    else:
        rows_ahead = segments(field, command)[4] // width
    forward = rows_ahead + columns_ahead < 0  # cells clear the way for those behind them, as above
    rows, columns = counts.shape
    travelled = 0
    for a in range(rows):
        row = a if forward else rows - 1 - a
        for b in range(columns):
            column = b if forward else columns - 1 - b
            n = counts[row, column]
            if n > 0 and has(free, width, row + rows_ahead, column + columns_ahead):
                counts[row + rows_ahead, column + columns_ahead] += n
                counts[row, column] = 0
                travelled += n
    return travelled


@in_place_kernel
def push(field, command, rule):
    """Try one cell with every particle; return (cells travelled, cells classified, cells added to the frontier)."""
    carried = carry_counts(field, command) if rule == MERGE else 0
    if command == LEFT or command == RIGHT:
        travelled, classified, added = move_along(field, command, rule)
    else:
        travelled, classified, added = move_across(field, command, rule)
    if rule == MERGE:
        travelled = carried
    return travelled, classified, added
