"""Breadth-first search by dilation: the nearest frontier cell and the commands that reach it.

A level of the search is a board; the next level is its dilation within the known-free cells, which costs about as much as a move.
Since the whole path is played before the next search, planning never costs more than moving. To find the way back only the
distance modulo 3 of each cell is kept (three boards), so memory does not grow with the length of the path.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.swarm.kernels.compiling import kernel
from shoal.swarm.kernels.bits import ONE, TOP, ZERO, has, lowest
from shoal.swarm.kernels.moves import DOWN, IN, LEFT, OUT, RIGHT, UP

COLUMN_MAJOR, ROW_MAJOR = 0, 1
SEEN, GOALS, WAVE, NEXT, MOD = 0, 1, 2, 3, 4  # planes: MOD, MOD + 1, MOD + 2 hold distances 0, 1, 2 modulo 3


class Search(NamedTuple):
    """Work space and options of a search."""

    planes: NDArray[np.uint64]  # (7, layers x rows, words)
    plan: NDArray[np.int8]  # the commands found, first to last
    neighbours: NDArray[np.int8]  # the commands in the order in which neighbours are looked at
    parents: NDArray[np.int8]  # the commands in the order in which their origin is expanded
    order: int  # COLUMN_MAJOR or ROW_MAJOR


@kernel
def beside(words, row, k, layers, rows):  # type: ignore[no-untyped-def]
    """Return one word of the cells that have a neighbour in the board ``words``; row is not at the rim."""
    here = words[row, k]
    cells = (here << ONE) | (here >> ONE) | words[row - 1, k] | words[row + 1, k]
    if k > 0:
        cells |= words[row, k - 1] >> TOP
    if k + 1 < words.shape[1]:
        cells |= words[row, k + 1] << TOP
    if layers > 1:
        cells |= words[row - rows, k] | words[row + rows, k]
    return cells


@kernel
def find_goals(field, sources, goals):  # type: ignore[no-untyped-def]
    """Fill ``goals`` with the known-free cells beside the frontier; tell whether one is a source."""
    met = ZERO
    margin = field.rows if field.layers > 1 else 0
    for row in range(margin + 1, goals.shape[0] - margin - 1):
        for k in range(goals.shape[1]):
            cells = beside(field.frontier, row, k, field.layers, field.rows) & field.open[row, k]
            goals[row, k] = cells
            met |= cells & sources[row, k]
    return met != ZERO


@kernel
def expand(field, planes, low, high, level):  # type: ignore[no-untyped-def]
    """Compute level ``level`` in NEXT from WAVE, rows low to high; return (low, high, goal met) of the new level."""
    wave, following, seen, goals = planes[WAVE], planes[NEXT], planes[SEEN], planes[GOALS]
    mark = planes[MOD + level % 3]
    new_low, new_high, met = wave.shape[0], -1, ZERO
    for row in range(low, high + 1):
        for k in range(wave.shape[1]):
            cells = beside(wave, row, k, field.layers, field.rows) & field.open[row, k] & ~seen[row, k]
            following[row, k] = cells
            if cells != ZERO:
                seen[row, k] |= cells
                mark[row, k] |= cells
                met |= cells & goals[row, k]
                new_low, new_high = min(new_low, row), row
    return new_low, new_high, met != ZERO


@kernel
def first_cell(wave, goals, layers, rows, order):  # type: ignore[no-untyped-def]
    """Return (row, column) of the first common cell of two boards in the order of expansion; there is one."""
    best_row, best_column, best_key = -1, -1, 0
    columns = wave.shape[1] * 64
    for row in range(wave.shape[0]):
        layer, r = row // rows, row % rows
        for k in range(wave.shape[1]):
            cells = wave[row, k] & goals[row, k]
            if cells != ZERO:
                column = 64 * k + lowest(cells)
                if order == COLUMN_MAJOR:
                    key = (column * rows + r) * layers + layer
                else:
                    key = (r * columns + column) * layers + layer
                if best_row < 0 or key < best_key:
                    best_row, best_column, best_key = row, column, key
                break
    return best_row, best_column


@kernel
def ahead(row, column, command, rows):  # type: ignore[no-untyped-def]
    """Return the cell one step from (row, column)."""
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


@kernel
def opposite(command):  # type: ignore[no-untyped-def]
    """Return the command that undoes ``command``."""
    if command == IN:
        return OUT
    if command == OUT:
        return IN
    return (command + 2) % 4


@kernel
def trace_back(field, search, row, column, level):  # type: ignore[no-untyped-def]
    """Write the plan that leads from level 0 to the goal cell at ``level`` and on to the frontier; return its length."""
    plan = search.plan
    for command in search.neighbours:
        r, c = ahead(row, column, command, field.rows)
        if has(field.frontier, r, c):
            plan[level] = command
            break
    for distance in range(level - 1, -1, -1):
        previous = search.planes[MOD + distance % 3]
        for command in search.parents:
            r, c = ahead(row, column, opposite(command), field.rows)
            if has(previous, r, c):
                plan[distance] = command
                row, column = r, c
                break
    return level + 1


@kernel
def start_planes(planes, sources):  # type: ignore[no-untyped-def]
    """Set the planes to distance 0 at the board ``sources``; return its first and last row."""
    low, high = sources.shape[0], -1
    for row in range(sources.shape[0]):
        for k in range(sources.shape[1]):
            cells = sources[row, k]
            planes[SEEN, row, k] = cells
            planes[WAVE, row, k] = cells
            planes[MOD, row, k] = cells
            planes[MOD + 1, row, k] = ZERO
            planes[MOD + 2, row, k] = ZERO
            if cells != ZERO:
                low, high = min(low, row), row
    return low, high


@kernel
def nearest(field, search, sources):  # type: ignore[no-untyped-def]
    """Search from the board ``sources`` to the nearest frontier cell; write the plan and return its length, 0 if none.

    Ties: at each distance cells are expanded in ``search.order``, their neighbours looked at in ``search.neighbours``.
    """
    planes = search.planes
    found = find_goals(field, sources, planes[GOALS])
    level = 0
    if found:
        row, column = first_cell(sources, planes[GOALS], field.layers, field.rows, search.order)
        return trace_back(field, search, row, column, level)
    reach = field.rows if field.layers > 1 else 1
    bottom, top = reach, sources.shape[0] - 1 - reach
    low, high = start_planes(planes, sources)
    while not found:
        level += 1
        first, last = max(bottom, low - reach), min(top, high + reach)
        low, high, found = expand(field, planes, first, last, level)
        if high < 0:
            return 0
        for r in range(first, last + 1):  # the wave has no other rows
            for k in range(sources.shape[1]):
                planes[WAVE, r, k] = planes[NEXT, r, k]
    row, column = first_cell(planes[WAVE], planes[GOALS], field.layers, field.rows, search.order)
    return trace_back(field, search, row, column, level)
