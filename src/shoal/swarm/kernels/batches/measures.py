"""Observations of many worlds: windows around cells, sums over the particles, and paths to the frontier."""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.batches.planes import OBSTACLES, PARTICLES, word_of
from shoal.swarm.kernels.batches.worlds import field_of_world
from shoal.swarm.kernels.dynamics.bits import ONE, ZERO, has, lowest, popcount
from shoal.swarm.kernels.search.frontier_search import ahead, nearest

PROBING, MOVING = 0, 1  # indices of the measures for each command
SUM, SQUARES = 0, 1  # indices of the measures for each axis


@in_place_kernel
def write_windows(worlds, chosen, planes, centers, columns, out, first, last):
    """Write to ``out`` a window of cells around a centre cell of each world, with one plane for each kind of cell.

    The array ``out`` is uint8 and has the shape (worlds, planes, layers, rows, columns). A centre cell is given as layer, row and
    column. Cells outside the boards appear as obstacles. The boards have ``columns`` columns.
    """
    depth, height, side = out.shape[2], out.shape[3], out.shape[4]
    for i in range(first, last):
        world = chosen[i]
        for p in range(planes.shape[0]):
            counted = planes[p] == PARTICLES and worlds.counts.shape[1] > 0
            for a in range(depth):
                layer = centers[i, 0] + a - depth // 2
                for b in range(height):
                    row = centers[i, 1] + b - height // 2
                    inside = 0 <= layer < worlds.layers and 0 <= row < worlds.rows
                    line = layer * worlds.rows + row
                    for c in range(side):
                        column = centers[i, 2] + c - side // 2
                        cell = 1 if planes[p] == OBSTACLES else 0
                        if inside and 0 <= column < columns:
                            if counted:
                                cell = min(worlds.counts[world, line, column], 255)
                            else:
                                word = word_of(worlds, world, line * worlds.width + (column >> 6), planes[p])
                                cell = 1 if (word >> np.uint64(column & 63)) & ONE != ZERO else 0
                        out[i, p, a, b, c] = cell


@in_place_kernel
def measure_worlds(worlds, chosen, columns, commands, axes, totals, first, last):
    """Compute sums over the particles of each world, and write the sums to three arrays.

    All arrays are int64. The array ``commands`` of shape (worlds, commands, 2) counts two kinds of particles for each command:
    particles that would enter a frontier cell, and particles whose next cell is not a known obstacle and holds no particle. The
    array ``axes`` of shape (worlds, 3, 2) contains the sums of the particles' layers, rows and columns, and the sums of the squares
    of these indices. The array ``totals`` of shape (worlds, 3) contains the number of particles, the number of frontier cells, and
    the number of cells that are known or in the frontier.
    """
    width, rows = worlds.width, worlds.rows
    for i in range(first, last):
        world = chosen[i]
        occupied, known, free = worlds.occupied[world], worlds.known[world], worlds.open[world]
        frontier, inside = worlds.frontier[world], worlds.inside[worlds.map_of[world]]
        commands[i, :, :] = 0
        axes[i, :, :] = 0
        totals[i, :] = 0
        for word in range(occupied.shape[0]):
            totals[i, 1] += popcount(frontier[word])
            totals[i, 2] += popcount((known[word] | frontier[word]) & inside[word])
            left = occupied[word]
            while left != ZERO:
                row, column = word // width, 64 * (word % width) + lowest(left)
                left &= left - ONE
                weight = min(worlds.counts[world, row, column], 255) if worlds.counts.shape[1] > 0 else 1
                totals[i, 0] += weight
                for axis in range(3):
                    place = column if axis == 2 else (row % rows if axis == 1 else row // rows)
                    axes[i, axis, SUM] += weight * place
                    axes[i, axis, SQUARES] += weight * place * place
                for command in range(commands.shape[1]):
                    r, c = ahead(row, column, command, rows)
                    if not (0 <= r < worlds.layers * rows and 0 <= c < columns):
                        continue
                    if has(frontier, width, r, c):
                        commands[i, command, PROBING] += weight
                    if not has(occupied, width, r, c) and (has(free, width, r, c) or not has(known, width, r, c)):
                        commands[i, command, MOVING] += weight


@in_place_kernel
def find_nearest(worlds, chosen, work, search, found, first, last):
    """Find the shortest path from any particle to the frontier in each world, and write five numbers about the path to ``found``.

    The array ``found`` is int64 and has the shape (worlds, 5). The five numbers are the length of the path, its first command, and
    the layer, row and column of its last cell. For a world without a path, all five numbers are 0.
    """
    for i in range(first, last):
        field = field_of_world(worlds, chosen[i], work)
        found[i, :] = 0
        length = nearest(field, search, field.occupied)
        if length == 0:
            continue
        row, column = search.origin[0], search.origin[1]
        for k in range(length):
            row, column = ahead(row, column, search.plan[k], field.rows)
        found[i, 0], found[i, 1] = length, search.plan[0]
        found[i, 2], found[i, 3], found[i, 4] = row // field.rows, row % field.rows, column
