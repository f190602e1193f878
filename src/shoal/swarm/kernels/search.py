"""Searches over cells: distances, paths to the frontier, and tilts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel, kernel
from shoal.swarm.kernels.moves import (
    BLOCK_WORDS,
    DOWN,
    IN,
    LEFT,
    ONE,
    OUT,
    RIGHT,
    TOP,
    UP,
    ZERO,
    has,
    lowest,
)


@kernel
def nearest_cells(free, offsets, start, count):
    """Return the flat indices of the ``count`` free cells nearest to ``start``, in the order of
    their path length from ``start``.

    The result is shorter if fewer than ``count`` free cells are connected to ``start``. The
    breadth-first search visits neighbours in the order of ``offsets``. No cell at the border of the
    grid may be free.
    """
    reached = np.zeros(free.shape[0], dtype=np.bool_)
    queue = np.empty(count, dtype=np.int64)
    queue[0], reached[start], size, at = start, True, 1, 0
    while at < size:
        for offset in offsets:
            neighbour = queue[at] + offset
            if size < count and free[neighbour] and not reached[neighbour]:
                reached[neighbour] = True
                queue[size] = neighbour
                size += 1
        at += 1
    return queue[:size].copy()


COLUMN_MAJOR, ROW_MAJOR = 0, 1
# planes; MOD, MOD + 1, MOD + 2 hold cells with path lengths 0, 1, 2 modulo 3
SEEN, GOALS, WAVE, NEXT, MOD = 0, 1, 2, 3, 4


class Search(NamedTuple):
    """Working memory and options of a frontier search."""

    planes: NDArray[np.uint64]  # (7, words of a board)
    plan: NDArray[np.int8]  # the commands of the path, from first to last
    neighbours: NDArray[np.int8]  # the commands in the order in which the search visits neighbours
    # the commands in the order in which `trace_back` looks for the previous cell of a path
    parents: NDArray[np.int8]
    columns: NDArray[np.uint64]  # columns in which two boards have common cells, (words of a row,)
    origin: NDArray[np.int64]  # row and column of the cell from which the plan starts
    order: int  # COLUMN_MAJOR or ROW_MAJOR


@in_place_kernel
def dilate(words, within, out, first, last, field):
    """Write to ``out`` the cells of the board ``within`` that have a neighbour in the board
    ``words``.

    The kernel processes the words from ``first`` to ``last - 1``. The slices avoid tests for
    negative indices in the loops, so that the compiler can use vector instructions.
    """
    width = field.width
    current, left, right = (
        words[first:last],
        words[first - 1 : last - 1],
        words[first + 1 : last + 1],
    )
    above, below = words[first - width : last - width], words[first + width : last + width]
    allowed, result = within[first:last], out[first:last]
    for i in range(result.shape[0]):
        cells = (current[i] << ONE) | (current[i] >> ONE) | (left[i] >> TOP) | (right[i] << TOP)
        result[i] = (cells | above[i] | below[i]) & allowed[i]
    if field.layers > 1:
        layer = width * field.rows
        above, below = words[first - layer : last - layer], words[first + layer : last + layer]
        for i in range(result.shape[0]):
            result[i] |= (above[i] | below[i]) & allowed[i]


@in_place_kernel
def meets(board_a, board_b):
    """Return whether two boards have a cell in common."""
    common = ZERO
    for i in range(board_a.shape[0]):
        common |= board_a[i] & board_b[i]
    return common != ZERO


@in_place_kernel
def start_planes(planes, sources):
    """Start a search at the cells of the board ``sources``, which have the path length 0."""
    seen, wave, near = planes[SEEN], planes[WAVE], planes[MOD]
    for i in range(sources.shape[0]):
        seen[i] = sources[i]
        wave[i] = sources[i]
        near[i] = sources[i]
    one, two = planes[MOD + 1], planes[MOD + 2]
    for i in range(sources.shape[0]):
        one[i] = ZERO
        two[i] = ZERO


@in_place_kernel
def expand(field, planes, first, last, level):
    """Replace the cells in the plane WAVE by the cells at the next path length. Return whether the
    plane WAVE is empty afterwards.

    The kernel processes the words from ``first`` to ``last - 1``. Words before ``first`` and after
    ``last - 1`` must not contain cells at the next path length.
    """
    dilate(planes[WAVE], field.open, planes[NEXT], first, last, field)
    wave, following = planes[WAVE, first:last], planes[NEXT, first:last]
    seen, mark = planes[SEEN, first:last], planes[MOD + level % 3, first:last]
    some = ZERO
    for i in range(wave.shape[0]):
        wave[i] = following[i] & ~seen[i]
        some |= wave[i]
    for i in range(wave.shape[0]):
        seen[i] |= wave[i]
        mark[i] |= wave[i]
    return some == ZERO


@in_place_kernel
def row_range(words, width, first, last):
    """Return the first and the last row of a board that contain cells, among the rows ``first`` to
    ``last``.
    """
    while first < last:
        some = ZERO
        for k in range(width):
            some |= words[first * width + k]
        if some != ZERO:
            break
        first += 1
    while last > first:
        some = ZERO
        for k in range(width):
            some |= words[last * width + k]
        if some != ZERO:
            break
        last -= 1
    return first, last


@in_place_kernel
def common_columns(board_a, board_b, columns):
    """Add to ``columns``, a row of words, the columns in which two boards have a common cell.

    ``board_a`` and ``board_b`` are two whole boards, or equal ranges of rows of two boards.
    """
    width = columns.shape[0]
    # a row is too short for vector instructions, so the outer loop is over the words of a row
    if width < 8:
        for k in range(width):
            common = columns[k]
            for i in range(k, board_a.shape[0], width):
                common |= board_a[i] & board_b[i]
            columns[k] = common
        return
    for first in range(0, board_a.shape[0], width):
        a, b = board_a[first : first + width], board_b[first : first + width]
        for k in range(width):
            columns[k] |= a[k] & b[k]


@in_place_kernel
def first_cell(field, search, board_a, board_b):
    """Return (row, column) of the first common cell of two boards, in the order ``search.order``.

    The two boards must have a common cell. ``search.columns`` must contain the columns of all
    common cells.
    """
    width, rows, layers = field.width, field.rows, field.layers
    if search.order == COLUMN_MAJOR:
        for k in range(width):
            common = search.columns[k]
            if common == ZERO:
                continue
            leftmost = common & (~common + ONE)
            for r in range(rows):
                for layer in range(layers):
                    i = (layer * rows + r) * width + k
                    if board_a[i] & board_b[i] & leftmost != ZERO:
                        return layer * rows + r, 64 * k + lowest(common)
    for r in range(rows):
        for k in range(width):
            common = ZERO
            for layer in range(layers):
                i = (layer * rows + r) * width + k
                common |= board_a[i] & board_b[i]
            if common == ZERO:
                continue
            column = 64 * k + lowest(common)
            for layer in range(layers):
                row = layer * rows + r
                if has(board_a, width, row, column) and has(board_b, width, row, column):
                    return row, column
    return -1, -1


@in_place_kernel
def ahead(row, column, command, rows):
    """Return the cell that is one step from the cell (row, column) in the direction of
    a command.
    """
    if command == LEFT:
        return row, column - 1
    if command == RIGHT:
        return row, column + 1
    if command == UP:
        return row - 1, column
    if command == DOWN:
        return row + 1, column
    if command == IN:
        return row - rows, column
    return row + rows, column


@in_place_kernel
def opposite(command):
    """Return the command that moves particles in the direction opposite to ``command``."""
    if command == IN:
        return OUT
    if command == OUT:
        return IN
    return (command + 2) % 4


@in_place_kernel
def trace_back(field, search, row, column, level):
    """Write the plan that leads from a source to a goal cell, and on to a frontier cell beside the
    goal cell.

    The goal cell (``row``, ``column``) has the path length ``level``. Return the length of the
    plan.
    """
    plan, width = search.plan, field.width
    for command in search.neighbours:
        r, c = ahead(row, column, command, field.rows)
        if has(field.frontier, width, r, c):
            plan[level] = command
            break
    for distance in range(level - 1, -1, -1):
        previous = search.planes[MOD + distance % 3]
        for command in search.parents:
            r, c = ahead(row, column, opposite(command), field.rows)
            if has(previous, width, r, c):
                plan[distance] = command
                row, column = r, c
                break
    search.origin[0], search.origin[1] = row, column
    return level + 1


@in_place_kernel
def find_goals(field, search, sources, first, last):
    """Fill GOALS with the known free cells beside the frontier, in the words ``first`` to ``last -
    1``.

    Return whether a source cell is beside the frontier. The loop processes blocks of words that fit
    into the processor's cache, so the comparison with the sources finds each block still in the
    cache.
    """
    goals, width = search.planes[GOALS], field.width
    any_goal = False
    block = max(1, BLOCK_WORDS // width) * width
    for start in range(first, last, block):
        end = min(last, start + block)
        dilate(field.frontier, field.open, goals, start, end, field)
        if meets(sources[start:end], goals[start:end]):
            any_goal = True
            common_columns(sources[start:end], goals[start:end], search.columns)
    return any_goal


@in_place_kernel
def nearest(field, search, sources):
    """Return the length of the shortest path from the board ``sources`` to a frontier cell, or 0 if
    no path exists.

    Write the commands of the path to ``search.plan``. The search expands cells of equal path length
    in the order ``search.order``, and visits the neighbours of each cell in the order
    ``search.neighbours``.
    """
    planes, width = search.planes, field.width
    goals, wave = planes[GOALS], planes[WAVE]
    # number of rows between a cell and its farthest neighbour
    reach = field.rows if field.layers > 1 else 1
    bottom, top = reach, field.layers * field.rows - 1 - reach
    for k in range(width):
        search.columns[k] = ZERO
    level = 0
    if find_goals(field, search, sources, bottom * width, (top + 1) * width):
        row, column = first_cell(field, search, sources, goals)
        return trace_back(field, search, row, column, level)
    start_planes(planes, sources)
    low, high = row_range(wave, width, bottom, top)
    reached = False
    while not reached:
        level += 1
        low, high = max(bottom, low - reach), min(top, high + reach)
        if expand(field, planes, low * width, (high + 1) * width, level):
            return 0
        low, high = row_range(wave, width, low, high)
        reached = meets(
            wave[low * width : (high + 1) * width], goals[low * width : (high + 1) * width]
        )
    common_columns(wave, goals, search.columns)
    row, column = first_cell(field, search, wave, goals)
    return trace_back(field, search, row, column, level)


class Slides(NamedTuple):
    """Working memory of the tilt search. In ``origin`` and ``command``, the index of a cell is row
    * columns + column.
    """

    # the previous stop cell on the path; -1 for a cell that is not reached, the cell itself for a
    # source
    origin: NDArray[np.int64]
    command: NDArray[np.int8]  # the command from the previous stop cell to the cell
    queue: NDArray[np.int64]  # ranks of cells, in the order of expansion


@in_place_kernel
def key_of(row, column, field, columns, order):
    """Return the rank of a cell. The search expands cells that need equally many tilts in the order
    of their ranks.
    """
    layer, r = row // field.rows, row % field.rows
    if order == COLUMN_MAJOR:
        return (column * field.rows + r) * field.layers + layer
    return (r * columns + column) * field.layers + layer


@in_place_kernel
def cell_of(key, field, columns, order):
    """Return the cell (row, column) with a given rank. This function is the inverse of `key_of`."""
    layer, rank = key % field.layers, key // field.layers
    if order == COLUMN_MAJOR:
        return layer * field.rows + rank % field.rows, rank // field.rows
    return layer * field.rows + rank // columns, rank % columns


@in_place_kernel
def slide(field, row, column, command, mapping):
    """Slide a particle through known free cells. Return (row, column, goal).

    ``row`` and ``column`` are the stop cell of the slide. ``goal`` tells whether the slide reaches
    the frontier.
    """
    goal = False
    while True:
        r, c = ahead(row, column, command, field.rows)
        if not has(field.open, field.width, r, c):
            return row, column, goal or (mapping and has(field.frontier, field.width, r, c))
        row, column = r, c
        goal = goal or (not mapping and has(field.frontier, field.width, r, c))


@in_place_kernel
def enqueue_sources(field, search, slides, sources):
    """Start the queue with the cells of the board ``sources``. Return the number of
    queued cells.
    """
    columns = field.width * 64
    for i in range(slides.origin.shape[0]):
        slides.origin[i] = -1
    count = 0
    for i in range(sources.shape[0]):
        cells = sources[i]
        while cells != ZERO:
            row, column = i // field.width, 64 * (i % field.width) + lowest(cells)
            cells &= cells - ONE
            slides.origin[row * columns + column] = row * columns + column
            slides.queue[count] = key_of(row, column, field, columns, search.order)
            count += 1
    return count


@in_place_kernel
def write_plan(search, slides, cell, command):
    """Write to the plan the commands from the source to ``cell``, followed by ``command``. Return
    the number of commands.
    """
    length, at = 1, cell
    while slides.origin[at] != at:
        length += 1
        at = slides.origin[at]
    search.plan[length - 1] = command
    for i in range(length - 2, -1, -1):
        search.plan[i] = slides.command[cell]
        cell = slides.origin[cell]
    return length


@in_place_kernel
def sort(keys, first, last):
    """Sort keys[first:last] in place by Shell's method, because Numba needs seconds to compile a
    library sort.
    """
    gap = (last - first) // 2
    while gap > 0:
        for i in range(first + gap, last):
            key, at = keys[i], i
            while at - gap >= first and keys[at - gap] > key:
                keys[at] = keys[at - gap]
                at -= gap
            keys[at] = key
        gap = gap // 2
    return


@in_place_kernel
def nearest_by_tilts(field, search, slides, sources, mapping):
    """Return the smallest number of tilts from the board ``sources`` to a frontier cell, or 0 if no
    path exists.

    Write the commands of the tilts to ``search.plan``.
    """
    columns = field.width * 64
    first, last = 0, enqueue_sources(field, search, slides, sources)
    while first < last:
        sort(slides.queue, first, last)
        end = last
        for i in range(first, last):
            row, column = cell_of(slides.queue[i], field, columns, search.order)
            index = row * columns + column
            for command in search.neighbours:
                r, c, goal = slide(field, row, column, command, mapping)
                if goal:
                    return write_plan(search, slides, index, command)
                next_index = r * columns + c
                if slides.origin[next_index] < 0:
                    slides.origin[next_index] = index
                    slides.command[next_index] = command
                    slides.queue[end] = key_of(r, c, field, columns, search.order)
                    end += 1
        first, last = last, end
    return 0
