"""The nearest frontier cell of a simulated state and a straight path to it. The search is `frontier_search` with fewer boards."""

from __future__ import annotations

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.dynamics.bits import ZERO, has, lowest
from shoal.swarm.kernels.prediction.forward_model import FRONTIER, OCCUPIED, directions
from shoal.swarm.kernels.search.frontier_search import ahead, dilate, opposite

SEEN, WAVE, NEXT, WITHIN, MOD = 0, 1, 2, 3, 4  # planes: MOD, MOD + 1, MOD + 2 hold distances 0, 1, 2 modulo 3
PLANES = 7
TOO_FAR = -1


@in_place_kernel
def begin_waves(scene, state, planes):
    """Set the planes to distance 0 at the particles."""
    occupied, frontier = state[OCCUPIED], state[FRONTIER]
    seen, wave, within, near = planes[SEEN], planes[WAVE], planes[WITHIN], planes[MOD]
    one, two, following = planes[MOD + 1], planes[MOD + 2], planes[NEXT]
    for i in range(occupied.shape[0]):
        seen[i] = occupied[i]
        wave[i] = occupied[i]
        near[i] = occupied[i]
    for i in range(occupied.shape[0]):
        within[i] = scene.ground[i] | frontier[i]
        one[i] = ZERO
        two[i] = ZERO
        following[i] = ZERO


@in_place_kernel
def spread(scene, planes, level):
    """Replace WAVE by the next level, including the rim. Return the union of its words as one word."""
    wave, following, within = planes[WAVE], planes[NEXT], planes[WITHIN]
    seen, mark = planes[SEEN], planes[MOD + level % 3]
    size, width = wave.shape[0], scene.width
    reach = width * scene.rows if scene.layers > 1 else width
    dilate(wave, within, following, reach, size - reach, scene)
    rim_rows(wave, within, following, reach, scene)
    some = ZERO
    for i in range(size):
        wave[i] = following[i] & ~seen[i]
        some |= wave[i]
    for i in range(size):
        seen[i] |= wave[i]
        mark[i] |= wave[i]
    return some


@in_place_kernel
def rim_rows(wave, within, following, reach, scene):
    """Dilate into the outermost rows (layers), which contain no particles but may contain frontier cells."""
    end = wave.shape[0] - reach
    for i in range(reach):
        following[i] = wave[i + reach] & within[i]
        following[end + i] = wave[end - reach + i] & within[end + i]


@in_place_kernel
def trace(scene, state, planes, index, level, plan, at):
    """Write the path that ends in word ``index`` of the frontier, reached at ``level``. Straight continuations are preferred."""
    hits = planes[WAVE, index] & state[FRONTIER, index]
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
    return row >= 0 and row < scene.layers * scene.rows and column >= 0 and column < 64 * scene.width


@in_place_kernel
def path_to_nearest(scene, state, planes, plan, at, limit):
    """Write the path to a nearest frontier cell to ``plan[at:]``. Return its length.

    The length is 0 if there is no path, and TOO_FAR if the path has more than ``limit`` moves.

    Among equally near cells, the first in row-major order is used.
    """
    begin_waves(scene, state, planes)
    wave, frontier, size = planes[WAVE], state[FRONTIER], state.shape[1]
    for level in range(1, limit + 1):
        if spread(scene, planes, level) == ZERO:
            return 0
        some = ZERO
        for i in range(size):
            some |= wave[i] & frontier[i]
        if some != ZERO:
            for i in range(size):
                if wave[i] & frontier[i] != ZERO:
                    trace(scene, state, planes, i, level, plan, at)
                    return level
    return TOO_FAR


@in_place_kernel
def beside(scene, cells, within, out):
    """Write to ``out`` the cells of ``within`` that have a neighbour in ``cells``. ``cells`` must not contain rim cells."""
    width, layer, size = scene.width, scene.width * scene.rows, cells.shape[0]
    reach = layer if scene.layers > 1 else width
    dilate(cells, within, out, reach, size - reach, scene)
    rim_rows(cells, within, out, reach, scene)
