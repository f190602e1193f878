"""Breadth-first search for the rule tilt, under which a command slides a particle until a wall stops it.

The nodes of the search are stop cells.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.dynamics.bits import ONE, ZERO, has, lowest
from shoal.swarm.kernels.search.frontier_search import COLUMN_MAJOR, ahead


class Slides(NamedTuple):
    """Working memory of the tilt search. In ``origin`` and ``command``, the index of a cell is row * columns + column."""

    origin: NDArray[np.int64]  # the previous stop cell on the path; -1 for a cell that is not reached, the cell itself for a source
    command: NDArray[np.int8]  # the command from the previous stop cell to the cell
    queue: NDArray[np.int64]  # ranks of cells, in the order of expansion


@in_place_kernel
def key_of(row, column, field, columns, order):
    """Return the rank of a cell. The search expands cells that need equally many tilts in the order of their ranks."""
    layer, r = row // field.rows, row % field.rows
    if order == COLUMN_MAJOR:
        return (column * field.rows + r) * field.layers + layer
    return (r * columns + column) * field.layers + layer


@in_place_kernel
def cell_of(key, field, columns, order):
    """Return the cell (row, column) with a given rank. This function is the inverse of `key_of`."""
    layer, rest = key % field.layers, key // field.layers
    if order == COLUMN_MAJOR:
        return layer * field.rows + rest % field.rows, rest // field.rows
    return layer * field.rows + rest // columns, rest % columns


@in_place_kernel
def slide(field, row, column, command, mapping):
    """Slide a particle through known free cells. Return (row, column, goal).

    ``row`` and ``column`` are the stop cell of the slide. ``goal`` tells whether the slide reaches the frontier.
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
    """Start the queue with the cells of the board ``sources``. Return the number of queued cells."""
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
    """Write to the plan the commands from the source to ``cell``, followed by ``command``. Return the number of commands."""
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
    """Sort keys[first:last] in place by Shell's method, because Numba needs seconds to compile a library sort."""
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
    """Return the smallest number of tilts from the board ``sources`` to a frontier cell, or 0 if no path exists.

    Write the commands of the tilts to ``search.plan``.
    """
    columns = field.width * 64
    first, last = 0, enqueue_sources(field, search, slides, sources)
    while first < last:
        sort(slides.queue, first, last)
        end = last
        for i in range(first, last):
            row, column = cell_of(slides.queue[i], field, columns, search.order)
            here = row * columns + column
            for command in search.neighbours:
                r, c, goal = slide(field, row, column, command, mapping)
                if goal:
                    return write_plan(search, slides, here, command)
                there = r * columns + c
                if slides.origin[there] < 0:
                    slides.origin[there] = here
                    slides.command[there] = command
                    slides.queue[end] = key_of(r, c, field, columns, search.order)
                    end += 1
        first, last = last, end
    return 0
