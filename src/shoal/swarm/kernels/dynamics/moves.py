"""One command: particles try to enter their next cells, and the command classifies the unknown cells among these next cells.

A particle stays if its next cell is an obstacle or holds a particle that stays. In a move across rows (up, down, in or out), the
particles of one row enter another row. The kernel processes the entered row first.

In a move along rows (left or right), the staying particles form runs of set bits that end at a wall. A move to the left is a move
towards lower bits: one addition per word clears exactly these runs, because the carry passes through each run. For a move to the
right, the kernel reverses the bits of each word before the addition. In the end, the kernel corrects the rare runs that continue in
the next word.

The kernel processes boards in blocks of rows that fit into the processor's cache, and so reads a large board from memory only once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.dynamics.bits import ALL, ONE, TOP, ZERO, has, popcount, reverse

BLOCK, MERGE, TILT = 0, 1, 2
LEFT, UP, RIGHT, DOWN, IN, OUT = 0, 1, 2, 3, 4, 5
BLOCK_WORDS = 1024  # number of words in a block of a board, or one row if a row is longer; kernels use several boards at once
SHORT_ROW = 16  # smallest number of words in a row for which vector instructions save time in a loop over the row
GROUP = 16  # number of words that one test for tried cells covers; most words contain no tried cell


class Field(NamedTuple):
    """The boards of one running episode, as arrays of shape (layers x rows x width,). Kernels change the boards in place."""

    free: NDArray[np.uint64]  # the true free cells, which only moves may read
    occupied: NDArray[np.uint64]  # cells with particles
    open: NDArray[np.uint64]  # known free cells
    known: NDArray[np.uint64]  # cells known to be free or obstacles
    frontier: NDArray[np.uint64]  # unknown cells beside known free cells; in coverage, the targets that no particle has visited
    tried: NDArray[np.uint64]  # unknown cells of one block that particles try to enter
    moving: NDArray[np.uint64]  # cells of one block with particles that move
    counts: NDArray[np.int32]  # particles in each cell, (layers x rows, 64 x width); shape (0, 0) unless the rule is merge
    layers: int
    rows: int  # number of rows in a layer
    width: int  # number of words in a row


@in_place_kernel
def segments(field, command):
    """Return (lines, words from line to line, first word, words per line, words to the next row) for a command across rows.

    A line consists of consecutive words that have a next row. For the commands u and i, the next row has a negative distance, and
    kernels process a line from its first word. For the commands d and o, kernels process a line from its last word.
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
    """Move particles across rows. Return the numbers of cells travelled, cells classified, and cells added to the frontier."""
    lines, line_stride, first, length, ahead = segments(field, command)
    travelled, classified, added = 0, 0, 0
    for line in range(lines):
        for start in range(0, length, BLOCK_WORDS):
            size = min(BLOCK_WORDS, length - start)
            source = line * line_stride + first + (start if ahead < 0 else length - start - size)
            target, end = source + ahead, source + ahead + size
            some, moved = shift_across(
                field.occupied[source : source + size], field.occupied[target:end], field.free[target:end],
                field.known[target:end], ALL, field.tried[:size], ahead, rule, True,
            )  # fmt: skip
            travelled += moved
            if some != ZERO:
                words = learn(field, target, end)
                classified, added = classified + words[0], added + words[1]
    return travelled, classified, added


@in_place_kernel
def shift_across(here, there, free, board, flip, tried, ahead, rule, counted):
    """Move particles from the words ``here`` to the words ``there``, which are ``ahead`` words apart.

    Write to ``tried`` the cells that particles try to enter: only cells in ``board`` if ``flip`` is 0, and only cells outside
    ``board`` if ``flip`` is ALL. Return a word that is nonzero if ``tried`` contains a cell, and the number of moved particles. If
    ``counted`` is None, the kernel saves time and returns 0 as the number of moved particles.
    """
    some, travelled, size, step = ZERO, 0, here.shape[0], abs(ahead)
    for i in range(tried.shape[0]):
        hit = here[i] & (board[i] ^ flip)
        tried[i] = hit
        some |= hit
    if step < SHORT_ROW:
        for column in range(min(step, size)):
            travelled += shift_column(here, there, free, column if ahead < 0 else size - 1 - column, ahead, rule, counted)
        return some, travelled
    for done in range(0, size, step):
        first = done if ahead < 0 else max(size - done - step, 0)
        last = min(done + step, size) if ahead < 0 else size - done
        travelled += shift_row(here[first:last], there[first:last], free[first:last], rule, counted)
    return some, travelled


@in_place_kernel
def shift_row(here, there, free, rule, counted):
    """Move particles from row ``here`` to row ``there``, whose particles all stay. Return the number of moved particles."""
    travelled = 0
    for i in range(here.shape[0]):
        going = here[i] & free[i]
        if rule != MERGE:
            going &= ~there[i]
        here[i] &= ~going
        there[i] |= going
        if counted is not None:
            travelled += popcount(going)
    return travelled


@in_place_kernel
def shift_column(here, there, free, place, ahead, rule, counted):
    """Move particles from row to row in one column of words, beginning with word ``place``. Return the number of moved particles.

    A register holds the staying particles of the previous row, because the rows are too short for vector instructions. The indices
    are unsigned, because tests for negative indices would take as long as the rest of the loop.
    """
    i, staying, travelled = np.uint64(place), there[np.uint64(place)], 0
    for _ in range((here.shape[0] - 1 - place if ahead < 0 else place) // abs(ahead) + 1):
        i = np.uint64(place)
        particles, walls = here[i], ~free[i]
        held = particles & (walls | staying if rule != MERGE else walls)
        there[i] = staying | (particles ^ held)
        if counted is not None:
            travelled += popcount(particles ^ held)
        staying = held
        place -= ahead
    here[i] = staying
    return travelled


@in_place_kernel
def learn(field, first, last):
    """Classify the tried cells in the words ``first`` to ``last - 1`` from the new cells of the particles.

    Return the number of classified cells, and the number of cells added to the frontier. A tried cell that now holds a particle is
    free. A tried cell without a particle is an obstacle. The unknown neighbours of new free cells join the frontier. An unknown
    neighbour may be a tried cell that the loop has not yet classified. Tried cells are already on the frontier, so the loop counts
    no tried cell twice.
    """
    classified, added = 0, 0
    for start in range(0, last - first, GROUP):
        tried, some = field.tried[start : min(start + GROUP, last - first)], ZERO
        for i in range(tried.shape[0]):
            some |= tried[i]
        if some == ZERO:
            continue
        for i in range(tried.shape[0]):
            if tried[i] != ZERO:
                classified += popcount(tried[i])
                added += learn_word(field, first + start + i, tried[i])
    return classified, added


@in_place_kernel
def learn_word(field, i, cells):
    """Classify the tried cells of one word. Return the number of cells added to the frontier."""
    field.known[i] |= cells
    field.frontier[i] &= ~cells
    found = cells & field.occupied[i]
    if found == ZERO:
        return 0
    field.open[i] |= found
    return add_neighbours(field, i, found)


@in_place_kernel
def add_neighbours(field, i, found):
    """Add the unknown neighbours of the cells ``found`` in word ``i`` to the frontier. Return the number of new frontier cells."""
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
    """Add the unknown cells among ``cells`` to one word of the frontier. Return the number of new frontier cells."""
    new = cells & ~field.known[i] & ~field.frontier[i]
    field.frontier[i] |= new
    return popcount(new)


@in_place_kernel
def start_left(free, here, moving, rule):
    """Write to ``moving`` the particles that can move to the left."""
    inner = free.shape[0] - 1
    ahead, behind, next_free, moved = free[:inner], here[1:], free[1:], moving[1:]
    moving[0] = here[0] & (free[0] << ONE)
    if rule == MERGE:
        for i in range(inner):
            moved[i] = behind[i] & ((next_free[i] << ONE) | (ahead[i] >> TOP))
        return
    moving[0] = here[0] & (here[0] + (here[0] & ~moving[0]))
    for i in range(inner):
        moved[i] = behind[i] & (behind[i] + (behind[i] & ~((next_free[i] << ONE) | (ahead[i] >> TOP))))
    crossing = ZERO
    for i in range(inner):
        crossing |= ((here[i] & ~moving[i]) >> TOP) & moved[i]
    if crossing != ZERO:
        for i in range(inner):
            if ((here[i] & ~moving[i]) >> TOP) & moved[i] != ZERO:
                moved[i] &= behind[i] + ONE


@in_place_kernel
def start_right(free, here, moving, rule):
    """Write to ``moving`` the particles that can move to the right."""
    inner = free.shape[0] - 1
    ahead, behind, moved = free[1:], here[1:], moving[1:]
    moving[inner] = here[inner] & (free[inner] >> ONE)
    if rule == MERGE:
        for i in range(inner):
            moving[i] = here[i] & ((free[i] >> ONE) | (ahead[i] << TOP))
        return
    moving[inner] = held_above(here[inner], moving[inner])
    for i in range(inner):
        moving[i] = held_above(here[i], (free[i] >> ONE) | (ahead[i] << TOP))
    crossing = ZERO
    for i in range(inner):
        crossing |= ((behind[i] & ~moved[i]) << TOP) & moving[i]
    if crossing != ZERO:
        for i in range(inner - 1, -1, -1):
            if ((behind[i] & ~moved[i]) << TOP) & moving[i] != ZERO:
                moving[i] &= reverse(reverse(here[i]) + ONE)


@in_place_kernel
def held_above(here, free):
    """Return the particles of the word ``here`` that can move to the right, towards higher bits.

    ``free`` contains the cells whose next cell is free. A run of adjacent particles can move if ``free`` contains its highest cell.
    """
    turned = reverse(here)
    return reverse(turned & (turned + reverse(here & ~free)))


@in_place_kernel
def move_along(field, command, rule):
    """Move particles along rows. Return the numbers of cells travelled, cells classified, and cells added to the frontier."""
    travelled, classified, added = 0, 0, 0
    total = field.occupied.shape[0]
    block = max(1, BLOCK_WORDS // field.width) * field.width
    for first in range(0, total, block):
        last = min(total, first + block)
        size = last - first
        some, moved = shift_along(
            field.occupied[first:last], field.free[first:last], field.known[first:last], ALL, field.tried[:size],
            field.moving[:size], command, rule, True,
        )  # fmt: skip
        travelled += moved
        if some != ZERO:
            words = learn(field, first, last)
            classified, added = classified + words[0], added + words[1]
    return travelled, classified, added


@in_place_kernel
def shift_along(occupied, free, board, flip, tried, moving, command, rule, counted):
    """Move particles along whole rows. The arguments and the results are as in `shift_across`."""
    some, travelled, inner = ZERO, 0, occupied.shape[0] - 1
    if command == LEFT:
        start_left(free, occupied, moving, rule)
        here, going = occupied[0], moving[0]
        for i in range(inner):
            behind, coming = occupied[i + 1], moving[i + 1]
            hit = ((here >> ONE) | (behind << TOP)) & (board[i] ^ flip)
            occupied[i] = (here & ~going) | (going >> ONE) | (coming << TOP)
            tried[i] = hit
            some |= hit
            if counted is not None:
                travelled += popcount(going)
            here, going = behind, coming
        occupied[inner] = (here & ~going) | (going >> ONE)
        tried[inner] = (here >> ONE) & (board[inner] ^ flip)
        if counted is not None:
            travelled += popcount(going)
        return some | tried[inner], travelled
    start_right(free, occupied, moving, rule)
    behind, coming = ZERO, ZERO
    for i in range(inner + 1):
        here, going = occupied[i], moving[i]
        hit = ((here << ONE) | (behind >> TOP)) & (board[i] ^ flip)
        occupied[i] = (here & ~going) | (going << ONE) | (coming >> TOP)
        tried[i] = hit
        some |= hit
        if counted is not None:
            travelled += popcount(going)
        behind, coming = here, going
    return some, travelled


@in_place_kernel
def carry_counts(field, command):
    """Move the numbers of particles per cell under the rule merge. Return the distance that all particles travelled, in cells."""
    free, counts, width = field.free, field.counts, field.width
    rows_ahead, columns_ahead = 0, 0
    if command == LEFT or command == RIGHT:
        columns_ahead = -1 if command == LEFT else 1
    else:
        rows_ahead = segments(field, command)[4] // width
    forward = rows_ahead + columns_ahead < 0  # the loop processes cells ahead first, so that no particle moves twice
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
    """Let all particles try once to enter their next cells. Return the same numbers as `move_along`."""
    carried = carry_counts(field, command) if rule == MERGE else 0
    if command == LEFT or command == RIGHT:
        travelled, classified, added = move_along(field, command, rule)
    else:
        travelled, classified, added = move_across(field, command, rule)
    if rule == MERGE:
        travelled = carried
    return travelled, classified, added
