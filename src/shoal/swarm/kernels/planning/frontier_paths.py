"""The nearest frontier cell of a simulated state, and a straight path to this cell.

The search is a variant of `frontier_search` with fewer boards.
"""

from __future__ import annotations

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.moves import ONE, TOP, ZERO, has, lowest
from shoal.swarm.kernels.prediction.forward_model import FRONTIER, OCCUPIED, directions
from shoal.swarm.kernels.search import ahead, dilate, opposite

UNREACHED, MOD = 0, 1  # planes; MOD, MOD + 1, MOD + 2 hold cells with path lengths 0, 1, 2 modulo 3
PLANES = 4
TOO_FAR = -1


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
    here, before, after = wave[first:last], wave[first - 1 : last - 1], wave[first + 1 : last + 1]
    above, below = wave[first - width : last - width], wave[first + width : last + width]
    free, out, goals = unreached[first:last], mark[first:last], frontier[first:last]
    for i in range(out.shape[0]):
        new = (
            (here[i] << ONE)
            | (here[i] >> ONE)
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
