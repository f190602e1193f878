"""Moves of particles on boards of bits, for all rules."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel


def record_type(number: type[np.generic], *names: str) -> np.dtype[Any]:
    """Return the type of a record whose fields are all numbers of one type."""
    return np.dtype([(name, number) for name in names])


def new_record(kind: np.dtype[Any], **values: float) -> Any:
    """Return a record with the given values. Fields without a given value are 0.

    Examples
    --------
    >>> memory = new_record(record_type(np.int64, "at", "length"), length=3)
    >>> memory.at += 1
    >>> int(memory.at), int(memory.length)
    (1, 3)
    """
    record = np.rec.array(np.zeros(1, dtype=kind))[0]
    for name, value in values.items():
        record[name] = value
    return record


ZERO = np.uint64(0)
ONE = np.uint64(1)
TWO = np.uint64(2)
FOUR = np.uint64(4)
TOP = np.uint64(63)
ALL = np.uint64(0xFFFFFFFFFFFFFFFF)
_PAIRS = np.uint64(0x5555555555555555)
_QUADS = np.uint64(0x3333333333333333)
_BYTES = np.uint64(0x0F0F0F0F0F0F0F0F)
_SUM = np.uint64(0x0101010101010101)
_HIGH = np.uint64(56)
_WORDS, _HALVES = np.uint64(0x00FF00FF00FF00FF), np.uint64(0x0000FFFF0000FFFF)
_EIGHT, _SIXTEEN, _THIRTY_TWO = np.uint64(8), np.uint64(16), np.uint64(32)


@in_place_kernel
def popcount(word):
    """Return the number of set bits as int64. The compiler replaces the code of the function by one
    instruction.
    """
    word = word - ((word >> ONE) & _PAIRS)
    word = (word & _QUADS) + ((word >> TWO) & _QUADS)
    word = (word + (word >> FOUR)) & _BYTES
    return np.int64((word * _SUM) >> _HIGH)


@in_place_kernel
def reverse(word):
    """Return the bits of a word in reverse order. The compiler replaces the code of the function by
    few instructions.
    """
    word = ((word >> ONE) & _PAIRS) | ((word & _PAIRS) << ONE)
    word = ((word >> TWO) & _QUADS) | ((word & _QUADS) << TWO)
    word = ((word >> FOUR) & _BYTES) | ((word & _BYTES) << FOUR)
    word = ((word >> _EIGHT) & _WORDS) | ((word & _WORDS) << _EIGHT)
    word = ((word >> _SIXTEEN) & _HALVES) | ((word & _HALVES) << _SIXTEEN)
    return (word >> _THIRTY_TWO) | (word << _THIRTY_TWO)


@in_place_kernel
def lowest(word):
    """Return the index of the lowest set bit of a nonzero word as int64."""
    return popcount(~word & (word - ONE))


@in_place_kernel
def has(words, width, row, column):
    """Return whether a board with ``width`` words per row contains a cell."""
    return (words[row * width + (column >> 6)] >> np.uint64(column & 63)) & ONE != ZERO


@in_place_kernel
def put(words, width, row, column):
    """Add a cell to a board."""
    words[row * width + (column >> 6)] |= ONE << np.uint64(column & 63)


@in_place_kernel
def copy_board(source, target):
    """Copy a board (set of cells)."""
    for i in range(source.shape[0]):
        target[i] = source[i]


BLOCK, MERGE, TILT = 0, 1, 2
RUNNING, COMPLETE, STALLED = 0, 1, 2  # the status of an episode
LEFT, UP, RIGHT, DOWN, IN, OUT = 0, 1, 2, 3, 4, 5
# number of words in a block of a board, or one row if a row is longer; kernels use several boards
# at once
BLOCK_WORDS = 1024
# smallest number of words in a row for which vector instructions save time in a loop over the row
SHORT_ROW = 16
GROUP = 16  # number of words that one test for tried cells covers; most words contain no tried cell


class Field(NamedTuple):
    """The boards of one running episode, as arrays of shape (layers x rows x width,). Kernels
    change the boards in place.
    """

    free: NDArray[np.uint64]  # the true free cells, which only moves may read
    occupied: NDArray[np.uint64]  # cells with particles
    open: NDArray[np.uint64]  # known free cells
    known: NDArray[np.uint64]  # cells known to be free or obstacles
    # unknown cells beside known free cells; in coverage, the targets that no particle has visited
    frontier: NDArray[np.uint64]
    tried: NDArray[np.uint64]  # unknown cells of one block that particles try to enter
    moving: NDArray[np.uint64]  # cells of one block with particles that move
    # particles in each cell, (layers x rows, 64 x width); shape (0, 0) unless the rule is merge
    counts: NDArray[np.int32]
    layers: int
    rows: int  # number of rows in a layer
    width: int  # number of words in a row


@in_place_kernel
def segments(field, command):
    """Return (lines, words from line to line, first word, words per line, words to the next row)
    for a command across rows.

    A line consists of consecutive words that have a next row. For the commands u and i, the next
    row has a negative distance, and kernels process a line from its first word. For the commands d
    and o, kernels process a line from its last word.
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
    """Move particles across rows. Return the numbers of cells travelled, cells classified, and
    cells added to the frontier.
    """
    lines, line_stride, first, length, ahead = segments(field, command)
    travelled, classified, added = 0, 0, 0
    for line in range(lines):
        for start in range(0, length, BLOCK_WORDS):
            size = min(BLOCK_WORDS, length - start)
            source = line * line_stride + first + (start if ahead < 0 else length - start - size)
            target, end = source + ahead, source + ahead + size
            some, moves = shift_across(
                field.occupied[source : source + size],
                field.occupied[target:end],
                field.free[target:end],
                field.known[target:end],
                ALL,
                field.tried[:size],
                ahead,
                rule,
                True,
            )
            travelled += moves
            if some != ZERO:
                words = learn(field, target, end)
                classified, added = classified + words[0], added + words[1]
    return travelled, classified, added


@in_place_kernel
def shift_across(source, target, free, board, flip, tried, ahead, rule, counted):
    """Move particles from the words ``source`` to the words ``target``, which are ``ahead`` words
    apart.

    Write to ``tried`` the cells that particles try to enter: only cells in ``board`` if ``flip`` is
    0, and only cells outside ``board`` if ``flip`` is ALL. Return a word that is nonzero if
    ``tried`` contains a cell, and the number of moved particles. If ``counted`` is None, the kernel
    saves time and returns 0 as the number of moved particles.
    """
    some, travelled, size, step = ZERO, 0, source.shape[0], abs(ahead)
    for i in range(tried.shape[0]):
        hit = source[i] & (board[i] ^ flip)
        tried[i] = hit
        some |= hit
    if step < SHORT_ROW:
        for column in range(min(step, size)):
            travelled += shift_column(
                source,
                target,
                free,
                column if ahead < 0 else size - 1 - column,
                ahead,
                rule,
                counted,
            )
        return some, travelled
    for offset in range(0, size, step):
        first = offset if ahead < 0 else max(size - offset - step, 0)
        last = min(offset + step, size) if ahead < 0 else size - offset
        travelled += shift_row(
            source[first:last], target[first:last], free[first:last], rule, counted
        )
    return some, travelled


@in_place_kernel
def shift_row(source, target, free, rule, counted):
    """Move particles from row ``source`` to row ``target``, whose particles all stay. Return the
    number of moved particles.
    """
    travelled = 0
    for i in range(source.shape[0]):
        going = source[i] & free[i]
        if rule != MERGE:
            going &= ~target[i]
        source[i] &= ~going
        target[i] |= going
        if counted is not None:
            travelled += popcount(going)
    return travelled


@in_place_kernel
def shift_column(source, target, free, place, ahead, rule, counted):
    """Move particles from row to row in one column of words, beginning with word ``place``. Return
    the number of moved particles.

    A register holds the staying particles of the previous row, because the rows are too short for
    vector instructions. The indices are unsigned, because tests for negative indices would take as
    long as the rest of the loop.
    """
    i, staying, travelled = np.uint64(place), target[np.uint64(place)], 0
    for _ in range((source.shape[0] - 1 - place if ahead < 0 else place) // abs(ahead) + 1):
        i = np.uint64(place)
        particles, walls = source[i], ~free[i]
        blocked = particles & (walls | staying if rule != MERGE else walls)
        target[i] = staying | (particles ^ blocked)
        if counted is not None:
            travelled += popcount(particles ^ blocked)
        staying = blocked
        place -= ahead
    source[i] = staying
    return travelled


@in_place_kernel
def learn(field, first, last):
    """Classify the tried cells in the words ``first`` to ``last - 1`` from the new cells of the
    particles.

    Return the number of classified cells, and the number of cells added to the frontier. A tried
    cell that now holds a particle is free. A tried cell without a particle is an obstacle. The
    unknown neighbours of new free cells join the frontier. An unknown neighbour may be a tried cell
    that the loop has not yet classified. Tried cells are already on the frontier, so the loop
    counts no tried cell twice.
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
    free = cells & field.occupied[i]
    if free == ZERO:
        return 0
    field.open[i] |= free
    return add_neighbours(field, i, free)


@in_place_kernel
def add_neighbours(field, i, cells):
    """Add the unknown neighbours of the ``cells`` in word ``i`` to the frontier. Return the
    number of new frontier cells.
    """
    width = field.width
    added = add_frontier(field, i, (cells << ONE) | (cells >> ONE))
    if cells >> TOP != ZERO:
        added += add_frontier(field, i + 1, ONE)
    if cells & ONE != ZERO:
        added += add_frontier(field, i - 1, ONE << TOP)
    added += add_frontier(field, i - width, cells)
    added += add_frontier(field, i + width, cells)
    if field.layers > 1:
        added += add_frontier(field, i - width * field.rows, cells)
        added += add_frontier(field, i + width * field.rows, cells)
    return added


@in_place_kernel
def add_frontier(field, i, cells):
    """Add the unknown cells among ``cells`` to one word of the frontier. Return the number of new
    frontier cells.
    """
    new = cells & ~field.known[i] & ~field.frontier[i]
    field.frontier[i] |= new
    return popcount(new)


@in_place_kernel
def start_left(free, particles, moving, rule):
    """Write to ``moving`` the particles that can move to the left."""
    inner = free.shape[0] - 1
    ahead, behind, next_free, moving_behind = free[:inner], particles[1:], free[1:], moving[1:]
    moving[0] = particles[0] & (free[0] << ONE)
    if rule == MERGE:
        for i in range(inner):
            moving_behind[i] = behind[i] & ((next_free[i] << ONE) | (ahead[i] >> TOP))
        return
    moving[0] = particles[0] & (particles[0] + (particles[0] & ~moving[0]))
    for i in range(inner):
        moving_behind[i] = behind[i] & (
            behind[i] + (behind[i] & ~((next_free[i] << ONE) | (ahead[i] >> TOP)))
        )
    crossing = ZERO
    for i in range(inner):
        crossing |= ((particles[i] & ~moving[i]) >> TOP) & moving_behind[i]
    if crossing != ZERO:
        for i in range(inner):
            if ((particles[i] & ~moving[i]) >> TOP) & moving_behind[i] != ZERO:
                moving_behind[i] &= behind[i] + ONE


@in_place_kernel
def start_right(free, particles, moving, rule):
    """Write to ``moving`` the particles that can move to the right."""
    inner = free.shape[0] - 1
    ahead, behind, moving_behind = free[1:], particles[1:], moving[1:]
    moving[inner] = particles[inner] & (free[inner] >> ONE)
    if rule == MERGE:
        for i in range(inner):
            moving[i] = particles[i] & ((free[i] >> ONE) | (ahead[i] << TOP))
        return
    moving[inner] = held_above(particles[inner], moving[inner])
    for i in range(inner):
        moving[i] = held_above(particles[i], (free[i] >> ONE) | (ahead[i] << TOP))
    crossing = ZERO
    for i in range(inner):
        crossing |= ((behind[i] & ~moving_behind[i]) << TOP) & moving[i]
    if crossing != ZERO:
        for i in range(inner - 1, -1, -1):
            if ((behind[i] & ~moving_behind[i]) << TOP) & moving[i] != ZERO:
                moving[i] &= reverse(reverse(particles[i]) + ONE)


@in_place_kernel
def held_above(particles, free):
    """Return those of the ``particles`` of a word that can move right, towards higher bits.

    ``free`` contains the cells whose next cell is free. A run of adjacent particles can move if
    ``free`` contains its highest cell.
    """
    mirrored = reverse(particles)
    return reverse(mirrored & (mirrored + reverse(particles & ~free)))


@in_place_kernel
def move_along(field, command, rule):
    """Move particles along rows. Return the numbers of cells travelled, cells classified, and cells
    added to the frontier.
    """
    travelled, classified, added = 0, 0, 0
    total = field.occupied.shape[0]
    block = max(1, BLOCK_WORDS // field.width) * field.width
    for first in range(0, total, block):
        last = min(total, first + block)
        size = last - first
        some, moves = shift_along(
            field.occupied[first:last],
            field.free[first:last],
            field.known[first:last],
            ALL,
            field.tried[:size],
            field.moving[:size],
            command,
            rule,
            True,
        )
        travelled += moves
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
        current, going = occupied[0], moving[0]
        for i in range(inner):
            behind, coming = occupied[i + 1], moving[i + 1]
            hit = ((current >> ONE) | (behind << TOP)) & (board[i] ^ flip)
            occupied[i] = (current & ~going) | (going >> ONE) | (coming << TOP)
            tried[i] = hit
            some |= hit
            if counted is not None:
                travelled += popcount(going)
            current, going = behind, coming
        occupied[inner] = (current & ~going) | (going >> ONE)
        tried[inner] = (current >> ONE) & (board[inner] ^ flip)
        if counted is not None:
            travelled += popcount(going)
        return some | tried[inner], travelled
    start_right(free, occupied, moving, rule)
    behind, coming = ZERO, ZERO
    for i in range(inner + 1):
        current, going = occupied[i], moving[i]
        hit = ((current << ONE) | (behind >> TOP)) & (board[i] ^ flip)
        occupied[i] = (current & ~going) | (going << ONE) | (coming >> TOP)
        tried[i] = hit
        some |= hit
        if counted is not None:
            travelled += popcount(going)
        behind, coming = current, going
    return some, travelled


@in_place_kernel
def carry_counts(field, command):
    """Move the numbers of particles per cell under the rule merge. Return the distance that all
    particles travelled, in cells.
    """
    free, counts, width = field.free, field.counts, field.width
    rows_ahead, columns_ahead = 0, 0
    if command == LEFT or command == RIGHT:
        columns_ahead = -1 if command == LEFT else 1
    else:
        rows_ahead = segments(field, command)[4] // width
    # the loop processes cells ahead first, so that no particle moves twice
    forward = rows_ahead + columns_ahead < 0
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
    """Let all particles try once to enter their next cells. Return the same numbers as
    `move_along`.
    """
    carried = carry_counts(field, command) if rule == MERGE else 0
    if command == LEFT or command == RIGHT:
        travelled, classified, added = move_along(field, command, rule)
    else:
        travelled, classified, added = move_across(field, command, rule)
    if rule == MERGE:
        travelled = carried
    return travelled, classified, added


@in_place_kernel
def cover(field):
    """Remove the cells with particles from the frontier. Return the number of removed cells."""
    frontier, occupied = field.frontier, field.occupied
    some = ZERO
    for i in range(frontier.shape[0]):
        some |= frontier[i] & occupied[i]
    covered = 0
    if some != ZERO:
        for i in range(frontier.shape[0]):
            covered += popcount(frontier[i] & occupied[i])
            frontier[i] &= ~occupied[i]
    return covered


@in_place_kernel
def step(field, command, rule, mapping):
    """Carry out one command under any move rule.

    Return the number of cells travelled, the number of cells classified, and the change in the
    number of frontier cells.
    """
    travelled, total, change = 0, 0, 0
    while True:
        moves, classified, added = push(field, command, rule)
        travelled += moves
        total += classified
        change += added - classified
        if not mapping and moves > 0:  # coverage: the map is known, so a push classifies no cell
            covered = cover(field)
            total += covered
            change -= covered
        # a tilt ends when no particle moves; the last push finds the walls
        if rule != TILT or moves == 0:
            return travelled, total, change
