"""Many worlds at once: moves, measures and planes of observations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.moves import (
    DOWN,
    IN,
    LEFT,
    MERGE,
    ONE,
    OUT,
    RIGHT,
    TOP,
    UP,
    ZERO,
    Field,
    add_neighbours,
    has,
    lowest,
    popcount,
    put,
    step,
)
from shoal.swarm.kernels.search import ahead, nearest

PARTICLES, FREE, OBSTACLES, FRONTIER, UNKNOWN, MAP = 0, 1, 2, 3, 4, 5


@in_place_kernel
def word_of(worlds, world, word, plane):
    """Return one word (64 cells) of the board that a plane shows."""
    if plane == PARTICLES:
        return worlds.occupied[world, word]
    if plane == FREE:
        return worlds.open[world, word]
    if plane == OBSTACLES:
        return (worlds.known[world, word] & ~worlds.open[world, word]) | ~worlds.inside[
            worlds.map_of[world], word
        ]
    if plane == FRONTIER:
        return worlds.frontier[world, word]
    if plane == MAP:
        return worlds.free[worlds.map_of[world], word]
    return worlds.inside[worlds.map_of[world], word] & ~worlds.known[world, word]


@in_place_kernel
def write_planes(worlds, selection, planes, out, first, last):
    """Write planes of the worlds ``selection[first:last]`` to ``out``, uint8, shape (worlds,
    planes, layers x rows, columns).
    """
    rows, columns = out.shape[2], out.shape[3]
    full_words = columns // 64
    for i in range(first, last):
        for p in range(planes.shape[0]):
            for row in range(rows):
                line = out[i, p, row]
                for k in range(full_words):
                    word = word_of(worlds, selection[i], row * worlds.width + k, planes[p])
                    cells = line[64 * k : 64 * k + 64]
                    for bit in range(64):
                        cells[bit] = (word >> np.uint64(bit)) & ONE
                if 64 * full_words < columns:
                    word = word_of(worlds, selection[i], row * worlds.width + full_words, planes[p])
                    cells = line[64 * full_words :]
                    for bit in range(cells.shape[0]):
                        cells[bit] = (word >> np.uint64(bit)) & ONE
            if planes[p] == PARTICLES and worlds.counts.shape[1] > 0:
                count_particles(worlds.counts[selection[i]], out[i, p])


@in_place_kernel
def count_particles(counts, cells):
    """Write the number of particles in each cell to ``cells``, at most 255."""
    for row in range(cells.shape[0]):
        for column in range(cells.shape[1]):
            cells[row, column] = min(counts[row, column], 255)


@in_place_kernel
def mark_commands(worlds, selection, masks, first, last):
    """Mark in ``masks``, shape (worlds, commands), the commands for which the belief allows at
    least one particle to move.

    The belief allows a particle to move if the next cell is not a known obstacle and holds no
    particle. Under the rule merge, the next cell may hold particles. No particle is in the rim, so
    a shift never carries a particle into another row.
    """
    width, size = worlds.width, worlds.occupied.shape[1]
    layer = width * worlds.rows
    for i in range(first, last):
        world = selection[i]
        occupied, open_cells, known = (
            worlds.occupied[world],
            worlds.open[world],
            worlds.known[world],
        )
        masks[i, :] = 0
        for k in range(size):
            enterable = ~known[k] | open_cells[k]
            if worlds.rule != MERGE:
                enterable &= ~occupied[k]
            entered = occupied[k] >> ONE
            if k + 1 < size:
                entered |= occupied[k + 1] << TOP
            masks[i, LEFT] |= entered & enterable != ZERO
            entered = occupied[k] << ONE
            if k > 0:
                entered |= occupied[k - 1] >> TOP
            masks[i, RIGHT] |= entered & enterable != ZERO
            masks[i, UP] |= k + width < size and occupied[k + width] & enterable != ZERO
            masks[i, DOWN] |= k >= width and occupied[k - width] & enterable != ZERO
            if worlds.layers > 1:
                masks[i, IN] |= k + layer < size and occupied[k + layer] & enterable != ZERO
                masks[i, OUT] |= k >= layer and occupied[k - layer] & enterable != ZERO


class Worlds(NamedTuple):
    """The boards of all worlds. Kernels change the boards in place."""

    free: NDArray[np.uint64]  # (maps, words): the true free cells of each map
    inside: NDArray[np.uint64]  # (maps, words): the cells of each map, including a rim of one cell
    map_of: NDArray[np.int64]  # (worlds,): row of ``free`` and ``inside`` for each world
    occupied: NDArray[np.uint64]  # (worlds, words), as for open, known and frontier; see Field
    open: NDArray[np.uint64]
    known: NDArray[np.uint64]
    frontier: NDArray[np.uint64]
    counts: NDArray[np.int32]  # (worlds, rows, 64 x width); (worlds, 0, 0) except for merge
    layers: int
    rows: int
    columns: int
    width: int
    rule: int
    mapping: bool


class Starts(NamedTuple):
    """The start cells and the target cells of new episodes."""

    # rows and columns of the start cells, one world after the other; shape (cells, 2)
    cells: NDArray[np.int64]
    ends: NDArray[np.int64]  # index after the last start cell of each world; shape (worlds,)
    # for coverage; shape (worlds, words), and (0, 0) for mapping
    targets: NDArray[np.uint64]


class Steps(NamedTuple):
    """The effect of the last command and the state of the episode in each world. Kernels change the
    arrays in place.
    """

    commands: NDArray[np.int8]
    classified: NDArray[np.int32]
    frontier: NDArray[np.int32]
    travelled: NDArray[np.int64]
    moves: NDArray[np.int64]
    limits: NDArray[np.int64]  # maximum number of moves of each episode
    complete: NDArray[np.bool_]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]


@in_place_kernel
def field_of_world(worlds, world, work):
    """Return the boards of one world as a `Field`. ``work`` provides two rows of working memory."""
    return Field(
        worlds.free[worlds.map_of[world]],
        worlds.occupied[world],
        worlds.open[world],
        worlds.known[world],
        worlds.frontier[world],
        work[0],
        work[1],
        worlds.counts[world],
        worlds.layers,
        worlds.rows,
        worlds.width,
    )


@in_place_kernel
def step_worlds(worlds, selection, work, steps, repeat, first, last):
    """Send the command of world ``selection[i]`` to this world ``repeat[i]`` times, for each i from
    ``first`` to ``last - 1``.
    """
    for i in range(first, last):
        world = selection[i]
        steps.travelled[world] = 0
        steps.classified[world] = 0
        field = field_of_world(worlds, world, work)
        for _ in range(repeat[i]):
            travelled, classified, change = step(
                field, steps.commands[world], worlds.rule, worlds.mapping
            )
            steps.travelled[world] += travelled
            steps.classified[world] += classified
            steps.frontier[world] += change
        steps.moves[world] += repeat[i]
        note_end(steps, world)


@in_place_kernel
def note_end(steps, world):
    """Record whether the episode of a world has ended."""
    steps.complete[world] = steps.terminated[world] = steps.frontier[world] == 0
    steps.truncated[world] = steps.frontier[world] > 0 and steps.moves[world] >= steps.limits[world]


@in_place_kernel
def begin_worlds(worlds, selection, work, steps, starts, first, last):
    """Start episodes in the worlds ``selection[first:last]``. ``starts`` is a `Starts`."""
    cells, ends, mapping = starts.cells, starts.ends, worlds.mapping
    for i in range(first, last):
        world = selection[i]
        field = field_of_world(worlds, world, work)
        field.occupied[:] = ZERO
        field.counts[:] = 0
        for k in range(ends[i - 1] if i > 0 else 0, ends[i]):
            put(field.occupied, field.width, cells[k, 0], cells[k, 1])
            if worlds.rule == MERGE:
                field.counts[cells[k, 0], cells[k, 1]] += 1
        remaining = 0
        for k in range(field.occupied.shape[0]):
            field.open[k] = field.occupied[k] if mapping else field.free[k]
            field.known[k] = (
                field.occupied[k] if mapping else worlds.inside[worlds.map_of[world], k]
            )
            field.frontier[k] = ZERO if mapping else starts.targets[i, k] & ~field.occupied[k]
            remaining += popcount(field.frontier[k])
        for k in range(field.occupied.shape[0]):
            if mapping and field.occupied[k] != ZERO:
                remaining += add_neighbours(field, k, field.occupied[k])
        steps.commands[world] = -1
        steps.classified[world] = 0
        steps.travelled[world] = 0
        steps.moves[world] = 0
        steps.frontier[world] = remaining
        note_end(steps, world)


PROBING, MOVING = 0, 1  # indices of the measures for each command
SUM, SQUARES = 0, 1  # indices of the measures for each axis


@in_place_kernel
def write_windows(worlds, selection, planes, centers, side, out, first, last):
    """Write to ``out`` a window of cells around a centre cell of each world, with one plane for
    each kind of cell.

    The array ``out`` is uint8 and has the shape (worlds, planes, layers x side x side). A centre
    cell is given as layer, row and column. Cells outside the boards appear as obstacles.
    """
    depth = out.shape[2] // (side * side)
    for i in range(first, last):
        world, left = selection[i], centers[i, 2] - side // 2
        for p in range(planes.shape[0]):
            with_counts = planes[p] == PARTICLES and worlds.counts.shape[1] > 0
            cells, at = out[i, p], 0
            for a in range(depth):
                layer = centers[i, 0] + a - depth // 2
                for b in range(side):
                    row = centers[i, 1] + b - side // 2
                    line = layer * worlds.rows + row
                    inside = 0 <= layer < worlds.layers and 0 <= row < worlds.rows
                    if inside and with_counts:
                        for c in range(side):
                            in_map = 0 <= left + c < worlds.columns
                            cells[at + c] = (
                                min(worlds.counts[world, line, left + c], 255) if in_map else 0
                            )
                    else:
                        for c in range(0, side, 64):
                            word = ~ZERO if planes[p] == OBSTACLES else ZERO
                            if inside:
                                word = word_from(worlds, world, line, left + c, planes[p])
                            unpack(word, cells, at + c, min(64, side - c))
                    at += side


@in_place_kernel
def unpack(word, cells, at, count):
    """Write the lowest ``count`` bits of a word to the array ``cells``, from the index ``at`` on.

    A loop of a constant length becomes vector instructions. So all 64 bits are written unless the
    array ends, and the caller writes the cells that follow later.
    """
    if at + 64 <= cells.shape[0]:
        target = cells[at : at + 64]
        for bit in range(64):
            target[bit] = (word >> np.uint64(bit)) & ONE
    else:
        for bit in range(count):
            cells[at + bit] = (word >> np.uint64(bit)) & ONE


@in_place_kernel
def word_from(worlds, world, line, column, plane):
    """Return 64 cells of a plane as a word, from any column of a line on.

    Cells beyond the line are obstacles.
    """
    index, shift = column >> 6, column & 63
    word = ~ZERO if plane == OBSTACLES else ZERO
    after = word
    if 0 <= index < worlds.width:
        word = word_of(worlds, world, line * worlds.width + index, plane)
    if shift == 0:
        return word
    if 0 <= index + 1 < worlds.width:
        after = word_of(worlds, world, line * worlds.width + index + 1, plane)
    return (word >> np.uint64(shift)) | (after << np.uint64(64 - shift))


@in_place_kernel
def measure_worlds(worlds, selection, commands, axes, totals, first, last):
    """Compute sums over the particles of each world, and write the sums to three arrays.

    All arrays are int64. The array ``commands`` of shape (worlds, commands or 0, 2) counts two kinds of
    particles for each command: particles that would enter a frontier cell, and particles whose next
    cell is not a known obstacle and holds no particle. The array ``axes`` of shape (worlds, 3, 2)
    contains the sums of the particles' layers, rows and columns, and the sums of the squares of
    these indices. The array ``totals`` of shape (worlds, 3) contains the number of particles, the
    number of frontier cells, and the number of cells that are known or in the frontier.
    """
    width, rows = worlds.width, worlds.rows
    with_counts = worlds.counts.shape[1] > 0
    for i in range(first, last):
        world = selection[i]
        occupied, known = worlds.occupied[world], worlds.known[world]
        frontier, inside = worlds.frontier[world], worlds.inside[worlds.map_of[world]]
        commands[i, :, :] = 0
        axes[i, :, :] = 0
        totals[i, :] = 0
        if not with_counts and commands.shape[1] > 0:
            measure_commands(worlds, world, commands[i])
        for word in range(occupied.shape[0]):
            totals[i, 1] += popcount(frontier[word])
            totals[i, 2] += popcount((known[word] | frontier[word]) & inside[word])
            remaining = occupied[word]
            if remaining == ZERO:
                continue
            line = word // width
            start, layer, row = 64 * (word - line * width), line // rows, line % rows
            count, columns, squares = 0, 0, 0
            while remaining != ZERO:
                column = start + lowest(remaining)
                remaining &= remaining - ONE
                weight = 1
                if with_counts:
                    weight = min(worlds.counts[world, line, column], 255)
                    measure_cell(worlds, world, line, column, weight, commands[i])
                count += weight
                columns += weight * column
                squares += weight * column * column
            totals[i, 0] += count
            axes[i, 0, SUM] += count * layer
            axes[i, 0, SQUARES] += count * layer * layer
            axes[i, 1, SUM] += count * row
            axes[i, 1, SQUARES] += count * row * row
            axes[i, 2, SUM] += columns
            axes[i, 2, SQUARES] += squares


@in_place_kernel
def measure_commands(worlds, world, commands):
    """Count the particles that each command would move, 64 cells at a time; ``commands`` is a row
    of the array in `measure_worlds`.

    No particle is in the rim, so a shift never carries a particle into another row.
    """
    occupied, open_cells, known = worlds.occupied[world], worlds.open[world], worlds.known[world]
    frontier, width, size = worlds.frontier[world], worlds.width, worlds.occupied.shape[1]
    layer = width * worlds.rows
    for k in range(size):
        edge = frontier[k]
        enterable = (~known[k] | open_cells[k]) & ~occupied[k]
        entered = occupied[k] >> ONE
        if k + 1 < size:
            entered |= occupied[k + 1] << TOP
        commands[LEFT, PROBING] += popcount(entered & edge)
        commands[LEFT, MOVING] += popcount(entered & enterable)
        entered = occupied[k] << ONE
        if k > 0:
            entered |= occupied[k - 1] >> TOP
        commands[RIGHT, PROBING] += popcount(entered & edge)
        commands[RIGHT, MOVING] += popcount(entered & enterable)
        if k + width < size:
            commands[UP, PROBING] += popcount(occupied[k + width] & edge)
            commands[UP, MOVING] += popcount(occupied[k + width] & enterable)
        if k >= width:
            commands[DOWN, PROBING] += popcount(occupied[k - width] & edge)
            commands[DOWN, MOVING] += popcount(occupied[k - width] & enterable)
        if commands.shape[0] > 4 and k + layer < size:
            commands[IN, PROBING] += popcount(occupied[k + layer] & edge)
            commands[IN, MOVING] += popcount(occupied[k + layer] & enterable)
        if commands.shape[0] > 4 and k >= layer:
            commands[OUT, PROBING] += popcount(occupied[k - layer] & edge)
            commands[OUT, MOVING] += popcount(occupied[k - layer] & enterable)


@in_place_kernel
def measure_cell(worlds, world, line, column, weight, commands):
    """Add the particles of one cell to the counts of each command that would move them."""
    occupied, known, free = worlds.occupied[world], worlds.known[world], worlds.open[world]
    width, rows = worlds.width, worlds.rows
    for command in range(commands.shape[0]):
        r, c = ahead(line, column, command, rows)
        if not (0 <= r < worlds.layers * rows and 0 <= c < worlds.columns):
            continue
        if has(worlds.frontier[world], width, r, c):
            commands[command, PROBING] += weight
        if not has(occupied, width, r, c) and (
            has(free, width, r, c) or not has(known, width, r, c)
        ):
            commands[command, MOVING] += weight


@in_place_kernel
def find_nearest(worlds, selection, work, search, results, first, last):
    """Find the shortest path from any particle to the frontier in each world, and write five
    numbers about the path to ``results``.

    The array ``results`` is int64 and has the shape (worlds, 5). The five numbers are the length of
    the path, its first command, and the layer, row and column of its last cell. For a world without
    a path, all five numbers are 0.
    """
    for i in range(first, last):
        field = field_of_world(worlds, selection[i], work)
        results[i, :] = 0
        length = nearest(field, search, field.occupied)
        if length == 0:
            continue
        row, column = search.origin[0], search.origin[1]
        for k in range(length):
            row, column = ahead(row, column, search.plan[k], field.rows)
        results[i, 0], results[i, 1] = length, search.plan[0]
        results[i, 2], results[i, 3], results[i, 4] = row // field.rows, row % field.rows, column
