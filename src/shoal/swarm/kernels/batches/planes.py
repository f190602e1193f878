"""Boards as bytes, as input for learning: one plane of values 0 and 1 for each kind of cell."""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.dynamics.bits import ONE, TOP, ZERO
from shoal.swarm.kernels.dynamics.moves import DOWN, IN, LEFT, OUT, RIGHT, UP

PARTICLES, FREE, OBSTACLES, FRONTIER, UNKNOWN, MAP = 0, 1, 2, 3, 4, 5


@in_place_kernel
def word_of(worlds, world, word, plane):
    """Return one word (64 cells) of the board that a plane shows."""
    if plane == PARTICLES:
        return worlds.occupied[world, word]
    if plane == FREE:
        return worlds.open[world, word]
    if plane == OBSTACLES:
        return (worlds.known[world, word] & ~worlds.open[world, word]) | ~worlds.inside[worlds.map_of[world], word]
    if plane == FRONTIER:
        return worlds.frontier[world, word]
    if plane == MAP:
        return worlds.free[worlds.map_of[world], word]
    return worlds.inside[worlds.map_of[world], word] & ~worlds.known[world, word]


@in_place_kernel
def write_planes(worlds, chosen, planes, out, first, last):
    """Write planes of the worlds ``chosen[first:last]`` to ``out``, uint8, shape (worlds, planes, layers x rows, columns)."""
    rows, columns = out.shape[2], out.shape[3]
    whole = columns // 64
    for i in range(first, last):
        for p in range(planes.shape[0]):
            for row in range(rows):
                line = out[i, p, row]
                for k in range(whole):
                    word = word_of(worlds, chosen[i], row * worlds.width + k, planes[p])
                    cells = line[64 * k : 64 * k + 64]
                    for bit in range(64):
                        cells[bit] = (word >> np.uint64(bit)) & ONE
                if 64 * whole < columns:
                    word = word_of(worlds, chosen[i], row * worlds.width + whole, planes[p])
                    cells = line[64 * whole :]
                    for bit in range(cells.shape[0]):
                        cells[bit] = (word >> np.uint64(bit)) & ONE
            if planes[p] == PARTICLES and worlds.counts.shape[1] > 0:
                count_particles(worlds.counts[chosen[i]], out[i, p])


@in_place_kernel
def count_particles(counts, cells):
    """Write the number of particles in each cell to ``cells``, at most 255."""
    for row in range(cells.shape[0]):
        for column in range(cells.shape[1]):
            cells[row, column] = min(counts[row, column], 255)


@in_place_kernel
def mark_commands(worlds, chosen, merge, masks, first, last):
    """Mark in ``masks``, shape (worlds, commands), the commands for which the belief allows at least one particle to move.

    The belief allows a particle to move if the next cell is not a known obstacle and holds no particle. Under the rule merge, the
    next cell may hold particles. No particle is in the rim, so a shift never carries a particle into another row.
    """
    width, size = worlds.width, worlds.occupied.shape[1]
    layer = width * worlds.rows
    for i in range(first, last):
        world = chosen[i]
        here, open_cells, known = worlds.occupied[world], worlds.open[world], worlds.known[world]
        masks[i, :] = 0
        for k in range(size):
            room = ~known[k] | open_cells[k]
            if not merge:
                room &= ~here[k]
            entered = here[k] >> ONE
            if k + 1 < size:
                entered |= here[k + 1] << TOP
            masks[i, LEFT] |= entered & room != ZERO
            entered = here[k] << ONE
            if k > 0:
                entered |= here[k - 1] >> TOP
            masks[i, RIGHT] |= entered & room != ZERO
            masks[i, UP] |= k + width < size and here[k + width] & room != ZERO
            masks[i, DOWN] |= k >= width and here[k - width] & room != ZERO
            if worlds.layers > 1:
                masks[i, IN] |= k + layer < size and here[k + layer] & room != ZERO
                masks[i, OUT] |= k >= layer and here[k - layer] & room != ZERO
