"""Forward model: simulation of commands on the predicted map, without any effect on the running
episode.

The second half of the module searches for the nearest frontier cell of a simulated state. This
search is a variant of `frontier_search` with fewer boards.

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
    has,
    lowest,
    popcount,
    segments,
    shift_across,
    shift_along,
)
from shoal.swarm.kernels.search import ahead, dilate, opposite

OCCUPIED, FRONTIER, UNSEEN = (
    0,
    1,
    2,
)  # boards of a state; unseen cells are unknown cells outside the frontier
BOARDS = 3
UNREACHED, MOD = (
    0,
    1,
)  # planes of a path search; MOD, MOD + 1, MOD + 2 hold cells with path lengths 0, 1, 2 modulo 3
PLANES = 4
TOO_FAR = -1
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
        source_board, target_board = source[board], target[board]
        for i in range(source_board.shape[0]):
            target_board[i] = source_board[i]


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
    inner_occupied, inner_frontier, over, under = (
        occupied[width:],
        frontier[width:],
        frontier[:inner],
        frontier[2 * width :],
    )
    before, after = frontier[width - 1 :], frontier[width + 1 :]
    left, up, right, down = 0, 0, 0, 0
    for i in range(inner):
        particles, cells = inner_occupied[i], inner_frontier[i]
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
    classified, free = 0, ZERO
    for i in range(tried.shape[0]):
        classified += popcount(tried[i])
        free |= tried[i] & ground[i]
        frontier[i] &= ~tried[i]
    if scene.mapping and free != ZERO:
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
def reveal_around(scene, frontier, unseen, i, cells):
    """Add the unseen neighbours of the ``cells``, which lie in word ``i``, to the
    frontier.
    """
    width, layer = scene.width, scene.width * scene.rows
    reveal(frontier, unseen, i, (cells << ONE) | (cells >> ONE))
    if cells >> TOP != ZERO:
        reveal(frontier, unseen, i + 1, ONE)
    if cells & ONE != ZERO:
        reveal(frontier, unseen, i - 1, ONE << TOP)
    reveal(frontier, unseen, i - width, cells)
    reveal(frontier, unseen, i + width, cells)
    if scene.layers > 1:
        reveal(frontier, unseen, i - layer, cells)
        reveal(frontier, unseen, i + layer, cells)


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


@in_place_kernel
def begin_waves(scene, state, planes):
    """Start a search at the cells of the particles, which have the path length 0."""
    occupied, frontier, ground = state[OCCUPIED], state[FRONTIER], scene.ground
    unreached, near, one, two = planes[UNREACHED], planes[MOD], planes[MOD + 1], planes[MOD + 2]
    for i in range(occupied.shape[0]):
        unreached[i] = (ground[i] | frontier[i]) & ~occupied[i]
        near[i] = occupied[i]
    for i in range(occupied.shape[0]):
        one[i] = ZERO
        two[i] = ZERO


@in_place_kernel
def spread(scene, planes, frontier, level):
    """Add the cells at the path length ``level``, including rim cells, to their plane.

    Return two words: the first is nonzero if the kernel has added a cell, and the second is nonzero
    if the kernel has added a frontier cell. Three planes hold all path lengths in turn, so the
    plane of the previous path length may also hold cells at smaller path lengths. These cells have
    no effect, because the search has already reached all their neighbours.
    """
    wave, mark, unreached = (
        planes[MOD + (level - 1) % 3],
        planes[MOD + level % 3],
        planes[UNREACHED],
    )
    width, layer, size, some, hits = (
        scene.width,
        scene.width * scene.rows,
        wave.shape[0],
        ZERO,
        ZERO,
    )
    first = layer if scene.layers > 1 else width
    last = size - first
    current, before, after = (
        wave[first:last],
        wave[first - 1 : last - 1],
        wave[first + 1 : last + 1],
    )
    above, below = wave[first - width : last - width], wave[first + width : last + width]
    free, out, goals = unreached[first:last], mark[first:last], frontier[first:last]
    for i in range(out.shape[0]):
        new = (
            (current[i] << ONE)
            | (current[i] >> ONE)
            | (before[i] >> TOP)
            | (after[i] << TOP)
            | above[i]
            | below[i]
        ) & free[i]
        free[i] &= ~new
        out[i] |= new
        some |= new
        hits |= new & goals[i]
    for step in (
        -first,
        first,
    ):  # into the outermost rows (layers), which may contain frontier cells; and from layer to layer
        low, high = max(0, -step), min(size, size - step)
        if scene.layers == 1:
            low, high = (low, low + first) if step > 0 else (high - first, high)
        new, goal = join(
            wave[low + step : high + step], unreached[low:high], mark[low:high], frontier[low:high]
        )
        some, hits = some | new, hits | goal
    return some, hits


@in_place_kernel
def join(near, unreached, mark, frontier):
    """Add the unreached cells among ``near`` to the plane ``mark``.

    Return two words: the first is nonzero if the kernel has added a cell, and the second is nonzero
    if the kernel has added a frontier cell.
    """
    some, hits = ZERO, ZERO
    for i in range(mark.shape[0]):
        new = near[i] & unreached[i]
        unreached[i] &= ~new
        mark[i] |= new
        some |= new
        hits |= new & frontier[i]
    return some, hits


@in_place_kernel
def trace(scene, state, planes, index, level, plan, at):
    """Write to ``plan[at:]`` the path to the first frontier cell in word ``index`` of the boards.

    The path has ``level`` commands and goes straight on wherever possible.
    """
    hits = planes[MOD + level % 3, index] & state[FRONTIER, index]
    row, column = index // scene.width, 64 * (index % scene.width) + lowest(hits)
    last = 0
    for distance in range(level - 1, -1, -1):
        previous = planes[MOD + distance % 3]
        for turn in range(directions(scene)):
            command = (last + turn) % directions(scene)
            r, c = ahead(row, column, opposite(command), scene.rows)
            if on_board(scene, r, c) and has(previous, scene.width, r, c):
                row, column, last = r, c, command
                break
        plan[at + distance] = last


@in_place_kernel
def on_board(scene, row, column):
    """Return whether a cell lies within the words of a board."""
    return (
        row >= 0 and row < scene.layers * scene.rows and column >= 0 and column < 64 * scene.width
    )


@in_place_kernel
def path_to_nearest(scene, state, planes, plan, at, limit):
    """Write the path to the nearest frontier cell to ``plan[at:]``. Return the length of the path.

    If no path exists, return 0. If the path has more than ``limit`` moves, return TOO_FAR. If
    several frontier cells are equally near, the path leads to the first of these cells in row-major
    order.
    """
    begin_waves(scene, state, planes)
    frontier = state[FRONTIER]
    for level in range(1, limit + 1):
        some, hits = spread(scene, planes, frontier, level)
        if some == ZERO:
            return 0
        if hits != ZERO:
            mark = planes[MOD + level % 3]
            for i in range(frontier.shape[0]):
                if mark[i] & frontier[i] != ZERO:
                    trace(scene, state, planes, i, level, plan, at)
                    return level
    return TOO_FAR


@in_place_kernel
def beside(scene, cells, within, out):
    """Write to ``out`` the cells of the board ``within`` that have a neighbour in the board
    ``cells``.

    The board ``cells`` must not contain rim cells.
    """
    width, layer, size = scene.width, scene.width * scene.rows, cells.shape[0]
    reach = layer if scene.layers > 1 else width
    dilate(cells, within, out, reach, size - reach, scene)
    for i in range(reach):  # the outermost rows (in 3-D, layers)
        out[i] = cells[i + reach] & within[i]
        out[size - reach + i] = cells[size - 2 * reach + i] & within[size - reach + i]
