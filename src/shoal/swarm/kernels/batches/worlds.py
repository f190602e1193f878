"""The boards of many worlds, stored one after the other. Each thread processes a range of the selected worlds.

The boards of all worlds have equal shapes. A map smaller than its board occupies the first rows and columns of the board. Particles
cannot leave their map.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.dynamics.bits import ZERO, popcount, put
from shoal.swarm.kernels.dynamics.moves import MERGE, Field, add_neighbours
from shoal.swarm.kernels.dynamics.steps import step


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
    width: int


class Steps(NamedTuple):
    """The effect of the last command and the state of the episode in each world. Kernels change the arrays in place."""

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
        worlds.free[worlds.map_of[world]], worlds.occupied[world], worlds.open[world], worlds.known[world], worlds.frontier[world],
        work[0], work[1], worlds.counts[world], worlds.layers, worlds.rows, worlds.width,
    )  # fmt: skip


@in_place_kernel
def step_worlds(worlds, steps, work, chosen, repeat, rule, mapping, first, last):
    """Send the command of world ``chosen[i]`` to this world ``repeat[i]`` times, for each i from ``first`` to ``last - 1``."""
    for i in range(first, last):
        world = chosen[i]
        steps.travelled[world] = 0
        steps.classified[world] = 0
        field = field_of_world(worlds, world, work)
        for _ in range(repeat[i]):
            travelled, done, change = step(field, steps.commands[world], rule, mapping)
            steps.travelled[world] += travelled
            steps.classified[world] += done
            steps.frontier[world] += change
        steps.moves[world] += repeat[i]
        note_end(steps, world)


@in_place_kernel
def note_end(steps, world):
    """Record whether the episode of a world has ended."""
    steps.complete[world] = steps.terminated[world] = steps.frontier[world] == 0
    steps.truncated[world] = steps.frontier[world] > 0 and steps.moves[world] >= steps.limits[world]


@in_place_kernel
def begin_worlds(worlds, steps, work, chosen, cells, ends, targets, rule, mapping, first, last):
    """Start episodes in the worlds ``chosen[first:last]``.

    ``cells`` contains the start cells (row and column) of all worlds, one world after the other. ``ends`` contains the index after
    the last start cell of each world. For coverage, ``targets`` contains the target cells of each world. For mapping, ``targets``
    is empty.
    """
    for i in range(first, last):
        world = chosen[i]
        field = field_of_world(worlds, world, work)
        field.occupied[:] = ZERO
        field.counts[:] = 0
        for k in range(ends[i - 1] if i > 0 else 0, ends[i]):
            put(field.occupied, field.width, cells[k, 0], cells[k, 1])
            if rule == MERGE:
                field.counts[cells[k, 0], cells[k, 1]] += 1
        remaining = 0
        for k in range(field.occupied.shape[0]):
            field.open[k] = field.occupied[k] if mapping else field.free[k]
            field.known[k] = field.occupied[k] if mapping else worlds.inside[worlds.map_of[world], k]
            field.frontier[k] = ZERO if mapping else targets[i, k] & ~field.occupied[k]
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
