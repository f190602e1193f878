"""Forward model: simulation of commands on the predicted map, without any effect on the running
episode.

A state consists of three boards (sets of cells): the cells of the particles, the frontier cells,
and the unseen cells, which are the unknown cells outside the frontier. In mapping and in coverage,
the forward model classifies a frontier cell when a particle tries to enter the cell. In coverage,
every attempt to enter a frontier cell succeeds, because a frontier cell is free and holds no
particle.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.moves import (
    DOWN,
    GROUP,
    IN,
    LEFT,
    ONE,
    OUT,
    RIGHT,
    TOP,
    UP,
    ZERO,
    popcount,
    segments,
    shift_across,
    shift_along,
)

OCCUPIED, FRONTIER, UNSEEN = (
    0,
    1,
    2,
)  # boards of a state; unseen cells are unknown cells outside the frontier
BOARDS = 3
_MIX, _SPREAD, _HALF = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xFF51AFD7ED558CCD), np.uint64(32)


class Scene(NamedTuple):
    """The predicted map, and working memory for moves on the predicted map."""

    ground: NDArray[np.uint64]  # the cells that are predicted to be free
    tried: NDArray[np.uint64]  # frontier cells that a particle tried to enter with the last command
    moving: NDArray[np.uint64]  # cells of the particles that move
    rule: int
    mapping: bool
    layers: int
    rows: int
    width: int


@in_place_kernel
def copy_state(source, target):
    """Copy the three boards of a state."""
    for board in range(BOARDS):
        here, there = source[board], target[board]
        for i in range(here.shape[0]):
            there[i] = here[i]


@in_place_kernel
def take_state(field, state):
    """Copy the particles and the belief of a running episode to a state of the forward model."""
    occupied, frontier, unseen = state[OCCUPIED], state[FRONTIER], state[UNSEEN]
    for i in range(occupied.shape[0]):
        occupied[i] = field.occupied[i]
        frontier[i] = field.frontier[i]
        unseen[i] = ~(field.known[i] | field.frontier[i])


@in_place_kernel
def immediate_gains(scene, state, gains):
    """Write to ``gains`` the number of frontier cells that each command would classify.

    The outermost rows (in 3-D, layers) must contain no particle.
    """
    occupied, frontier, size, width = state[OCCUPIED], state[FRONTIER], state.shape[1], scene.width
    inner = size - 2 * width
    here, wanted, over, under = (
        occupied[width:],
        frontier[width:],
        frontier[:inner],
        frontier[2 * width :],
    )
    before, after = frontier[width - 1 :], frontier[width + 1 :]
    left, up, right, down = 0, 0, 0, 0
    for i in range(inner):
        particles, cells = here[i], wanted[i]
        left += popcount(particles & ((cells << ONE) | (before[i] >> TOP)))
        right += popcount(particles & ((cells >> ONE) | (after[i] << TOP)))
        up += popcount(particles & over[i])
        down += popcount(particles & under[i])
    gains[LEFT], gains[UP], gains[RIGHT], gains[DOWN] = left, up, right, down
    if scene.layers > 1:
        layer, into, out = width * scene.rows, 0, 0
        for i in range(size - layer):
            into += popcount(occupied[layer + i] & frontier[i])
            out += popcount(occupied[i] & frontier[layer + i])
        gains[IN], gains[OUT] = into, out


@in_place_kernel
def advance(scene, state, command):
    """Simulate one command, which changes ``state`` in place. Return the number of classified
    frontier cells.

    After the call, ``scene.tried`` contains the classified cells.
    """
    if push(scene, state[OCCUPIED], state[FRONTIER], command) == ZERO:
        return 0
    tried, ground, frontier = scene.tried, scene.ground, state[FRONTIER]
    classified, found = 0, ZERO
    for i in range(tried.shape[0]):
        classified += popcount(tried[i])
        found |= tried[i] & ground[i]
        frontier[i] &= ~tried[i]
    if scene.mapping and found != ZERO:
        discover(scene, frontier, state[UNSEEN])
    return classified


@in_place_kernel
def push(scene, occupied, frontier, command):
    """Move the particles in place. Write to ``scene.tried`` the frontier cells that a particle
    tries to enter.

    Return a word that is nonzero if ``scene.tried`` contains a cell.
    """
    if command == LEFT or command == RIGHT:
        return shift_along(
            occupied,
            scene.ground,
            frontier,
            ZERO,
            scene.tried,
            scene.moving,
            command,
            scene.rule,
            None,
        )[0]
    for i in range(scene.tried.shape[0]):
        scene.tried[i] = ZERO
    lines, stride, first, length, ahead = segments(scene, command)
    some = ZERO
    for line in range(lines):
        source = line * stride + first
        target, end = source + ahead, source + ahead + length
        some |= shift_across(
            occupied[source : source + length],
            occupied[target:end],
            scene.ground[target:end],
            frontier[target:end],
            ZERO,
            scene.tried[target:end],
            ahead,
            scene.rule,
            None,
        )[0]
    return some


@in_place_kernel
def discover(scene, frontier, unseen):
    """Add the unseen neighbours of all newly found free cells to the frontier."""
    for start in range(0, frontier.shape[0], GROUP):
        tried, ground, some = (
            scene.tried[start : start + GROUP],
            scene.ground[start : start + GROUP],
            ZERO,
        )
        for i in range(tried.shape[0]):
            some |= tried[i] & ground[i]
        if some == ZERO:
            continue
        for i in range(tried.shape[0]):
            if tried[i] & ground[i] != ZERO:
                reveal_around(scene, frontier, unseen, start + i, tried[i] & ground[i])


@in_place_kernel
def reveal_around(scene, frontier, unseen, i, found):
    """Add the unseen neighbours of the cells ``found``, which lie in word ``i``, to the
    frontier.
    """
    width, layer = scene.width, scene.width * scene.rows
    reveal(frontier, unseen, i, (found << ONE) | (found >> ONE))
    if found >> TOP != ZERO:
        reveal(frontier, unseen, i + 1, ONE)
    if found & ONE != ZERO:
        reveal(frontier, unseen, i - 1, ONE << TOP)
    reveal(frontier, unseen, i - width, found)
    reveal(frontier, unseen, i + width, found)
    if scene.layers > 1:
        reveal(frontier, unseen, i - layer, found)
        reveal(frontier, unseen, i + layer, found)


@in_place_kernel
def reveal(frontier, unseen, i, cells):
    """Add the unseen cells among ``cells`` to one word of the frontier."""
    new = cells & unseen[i]
    frontier[i] |= new
    unseen[i] &= ~new


@in_place_kernel
def count(board):
    """Return the number of cells in a board."""
    total = 0
    for i in range(board.shape[0]):
        total += popcount(board[i])
    return total


@in_place_kernel
def directions(scene):
    """Return the number of different commands: 4 in two dimensions, 6 in three dimensions."""
    return 4 if scene.layers == 1 else 6


@in_place_kernel
def digest(state):
    """Return a hash of the particles and the frontier as uint64.

    The hash is a sum of words mixed with their indices, because the compiler can compute a sum with
    vector instructions.
    """
    value = ZERO
    for board in range(2):
        words = state[board]
        for i in range(words.shape[0]):
            word = words[i] + np.uint64(i + 7919 * board) * _MIX
            word = (word ^ (word >> _HALF)) * _SPREAD
            value += word ^ (word >> _HALF)
    return value
