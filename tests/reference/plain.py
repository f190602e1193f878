"""Plain-array reference of the swarm: one array entry per cell, loops over the whole grid, no bit
packing.

Written from the specification alone, so that it can be compared with the packed implementation. The
inner functions are compiled by numba; with ``NUMBA_DISABLE_JIT=1`` the same code runs as ordinary
Python.

Arrays inside are padded by one obstacle cell on each side: shape ``(L, H + 2, W + 2)`` with ``L =
1`` for a 2-D workspace and ``L = D + 2`` for a 3-D one. Four of them describe an episode:

- ``counts``   int32, particles in each cell;
- ``free``     bool, the true map;
- ``state``    uint8, what is known: UNKNOWN, FREE or OBSTACLE (coverage: all is known from the start);
- ``frontier`` bool, the cells still to be dealt with. Mapping: unknown cells next to a known-free
  cell. Coverage: wanted cells where no particle has stood.

With these, both tasks look alike to a policy: travel through cells in state FREE to a frontier
cell.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

Grid = NDArray[Any]
Cell = tuple[int, int, int]

LETTERS = "lurdio"
# Where each command leads, as (layer, row, column).
D_LAYER = np.array([0, 0, 0, 0, -1, 1])
D_ROW = np.array([0, -1, 0, 1, 0, 0])
D_COL = np.array([-1, 0, 1, 0, 0, 0])
REVERSE = np.array([2, 3, 0, 1, 5, 4])

UNKNOWN, FREE, OBSTACLE = 0, 1, 2
BLOCK, MERGE, TILT = 0, 1, 2
MAPPING, COVERAGE = 0, 1
COLUMN_MAJOR, ROW_MAJOR = 0, 1
COMPLETE, LIMIT, STALLED = 0, 1, 2
UNSEEN, SOURCE = -1, -2  # marks of the search, apart from all command codes

RULES = ("block", "merge", "tilt")
TASKS = ("mapping", "coverage")
TIES = ("column-major", "row-major")
STATUSES = ("complete", "limit", "stalled")
POLICIES = ("closest-frontier", "elect-particle", "random-moves", "depth-first")

# Columns of an episode's log, one row for each move.
COMMAND, TRAVELLED, CLASSIFIED, LEFT = 0, 1, 2, 3


# ----------------------------------------------------------------------------------------------
# moving


@njit(cache=True)
def directions(grid: Grid) -> int:
    """Return the number of commands: 4 on a single layer, else 6."""
    return 4 if grid.shape[0] == 1 else 6


@njit(cache=True)
def neighbour(layer: int, row: int, col: int, command: int) -> Cell:
    """Return the cell that `command` leads to."""
    return layer + D_LAYER[command], row + D_ROW[command], col + D_COL[command]


@njit(cache=True)
def sweep_order(size: int, step: int) -> tuple[int, int, int]:
    """Return range arguments for one axis such that the cells ahead come before those behind."""
    if step > 0:
        return size - 1, -1, -1
    return 0, size, 1


@njit(cache=True)
def move(counts: Grid, free: Grid, command: int) -> int:
    """Move every particle by the block rule, in place; return how many moved.

    Cells ahead are dealt with first. So when a particle's turn comes, the next cell still holds a
    particle only if that particle cannot move.
    """
    layers, rows, cols = counts.shape
    d_layer, d_row, d_col = D_LAYER[command], D_ROW[command], D_COL[command]
    layer_0, layer_1, layer_step = sweep_order(layers, d_layer)
    row_0, row_1, row_step = sweep_order(rows, d_row)
    col_0, col_1, col_step = sweep_order(cols, d_col)
    travelled = 0
    for layer in range(layer_0, layer_1, layer_step):
        for row in range(row_0, row_1, row_step):
            for col in range(col_0, col_1, col_step):
                if counts[layer, row, col] == 0:
                    continue
                to_layer, to_row, to_col = layer + d_layer, row + d_row, col + d_col
                if free[to_layer, to_row, to_col] and counts[to_layer, to_row, to_col] == 0:
                    counts[to_layer, to_row, to_col] = 1
                    counts[layer, row, col] = 0
                    travelled += 1
    return travelled


@njit(cache=True)
def move_merge(counts: Grid, free: Grid, command: int) -> int:
    """Move every particle by the merge rule, in place; return how many moved.

    Cells ahead are dealt with first, so what moves into a cell is never moved again.
    """
    layers, rows, cols = counts.shape
    d_layer, d_row, d_col = D_LAYER[command], D_ROW[command], D_COL[command]
    layer_0, layer_1, layer_step = sweep_order(layers, d_layer)
    row_0, row_1, row_step = sweep_order(rows, d_row)
    col_0, col_1, col_step = sweep_order(cols, d_col)
    travelled = 0
    for layer in range(layer_0, layer_1, layer_step):
        for row in range(row_0, row_1, row_step):
            for col in range(col_0, col_1, col_step):
                here = counts[layer, row, col]
                if here == 0:
                    continue
                to_layer, to_row, to_col = layer + d_layer, row + d_row, col + d_col
                if free[to_layer, to_row, to_col]:
                    counts[to_layer, to_row, to_col] += here
                    counts[layer, row, col] = 0
                    travelled += here
    return travelled


# -------------------------------------------------------------------------------------------
# observing


@njit(cache=True)
def learn_free(state: Grid, frontier: Grid, layer: int, row: int, col: int) -> int:
    """Make a cell known free; return the number of frontier cells gained next to it."""
    state[layer, row, col] = FREE
    gained = 0
    for command in range(directions(state)):
        there = neighbour(layer, row, col, command)
        if state[there] == UNKNOWN and not frontier[there]:
            frontier[there] = True
            gained += 1
    return gained


@njit(cache=True)
def classify(
    before: Grid, counts: Grid, state: Grid, frontier: Grid, command: int
) -> tuple[int, int]:
    """Classify the unknown cells attempted from `before`; return (classified, frontier cells
    gained).
    """
    layers, rows, cols = counts.shape
    classified, gained = 0, 0
    for layer in range(layers):
        for row in range(rows):
            for col in range(cols):
                if before[layer, row, col] == 0:
                    continue
                there = neighbour(layer, row, col, command)
                if state[there] != UNKNOWN:
                    continue
                # The cell lies next to a particle, so it was a frontier cell.
                classified += 1
                frontier[there] = False
                if counts[there] > 0:
                    gained += learn_free(state, frontier, there[0], there[1], there[2])
                else:
                    state[there] = OBSTACLE
    return classified, gained


@njit(cache=True)
def cover(counts: Grid, frontier: Grid) -> int:
    """Take the occupied cells off the frontier; return how many were on it."""
    layers, rows, cols = counts.shape
    covered = 0
    for layer in range(layers):
        for row in range(rows):
            for col in range(cols):
                if counts[layer, row, col] > 0 and frontier[layer, row, col]:
                    frontier[layer, row, col] = False
                    covered += 1
    return covered


@njit(cache=True)
def substep(
    counts: Grid, free: Grid, state: Grid, frontier: Grid, command: int, rule: int, task: int
) -> tuple[int, int, int]:
    """Move by at most one cell and observe; return (travelled, classified or covered, frontier
    gained).
    """
    before = counts.copy()
    travelled = move_merge(counts, free, command) if rule == MERGE else move(counts, free, command)
    if task == COVERAGE:
        return travelled, cover(counts, frontier), 0
    classified, gained = classify(before, counts, state, frontier, command)
    return travelled, classified, gained


@njit(cache=True)
def step(
    counts: Grid, free: Grid, state: Grid, frontier: Grid, command: int, rule: int, task: int
) -> tuple[int, int, int]:
    """Carry out one command; return (travelled, classified or covered, frontier gained).

    A tilt is sub-steps until one in which nothing moves; that last one is observed too, because it
    shows what stops the particles.
    """
    travelled, classified, gained = substep(counts, free, state, frontier, command, rule, task)
    moved = travelled
    while rule == TILT and moved > 0:
        moved, more_classified, more_gained = substep(
            counts, free, state, frontier, command, rule, task
        )
        travelled += moved
        classified += more_classified
        gained += more_gained
    return travelled, classified, gained


# ----------------------------------------------------------------------------------------- search


@njit(cache=True)
def put(cells: Grid, index: int, cell: Cell) -> None:
    """Write a cell into a row of an array of cells."""
    cells[index, 0], cells[index, 1], cells[index, 2] = cell


@njit(cache=True)
def get(cells: Grid, index: int) -> Cell:
    """Return a row of an array of cells."""
    return cells[index, 0], cells[index, 1], cells[index, 2]


@njit(cache=True)
def encode(cell: Cell, shape: Cell, ties: int) -> int:
    """Number a cell so that numerical order is the order of expansion."""
    layer, row, col = cell
    layers, rows, cols = shape
    if ties == COLUMN_MAJOR:
        return (col * rows + row) * layers + layer
    return (row * cols + col) * layers + layer


@njit(cache=True)
def decode(code: int, shape: Cell, ties: int) -> Cell:
    """Return the cell of a number made by `encode`."""
    layers, rows, cols = shape
    layer, rest = code % layers, code // layers
    if ties == COLUMN_MAJOR:
        return layer, rest % rows, rest // rows
    return layer, rest // cols, rest % cols


@njit(cache=True)
def occupied_cells(counts: Grid, ties: int) -> Grid:
    """Return the occupied cells, one a row, in the order of expansion."""
    layers, rows, cols = counts.shape
    cells = np.empty((counts.size, 3), np.int64)
    size = 0
    if ties == COLUMN_MAJOR:
        for col in range(cols):
            for row in range(rows):
                for layer in range(layers):
                    if counts[layer, row, col] > 0:
                        put(cells, size, (layer, row, col))
                        size += 1
    else:
        for row in range(rows):
            for col in range(cols):
                for layer in range(layers):
                    if counts[layer, row, col] > 0:
                        put(cells, size, (layer, row, col))
                        size += 1
    return cells[:size].copy()


@njit(cache=True)
def advance(
    state: Grid, frontier: Grid, cell: Cell, command: int, slide: bool
) -> tuple[bool, Cell]:
    """Follow `command` through known-free cells, one cell or (slide) to the end.

    Return whether it leads to a frontier cell, and the cell reached (before the frontier cell).
    """
    while True:
        there = neighbour(cell[0], cell[1], cell[2], command)
        if frontier[there]:
            return True, cell
        if state[there] != FREE:
            return False, cell
        cell = there
        if not slide:
            return False, cell


@njit(cache=True)
def trace(queue: Grid, parent: Grid, came_by: Grid, cell: Cell, last: int) -> tuple[Grid, Cell]:
    """Return the commands from a source to `cell`, followed by the command `last`; and
    the source.
    """
    length = 1
    at = cell
    while came_by[at] != SOURCE:
        length += 1
        at = get(queue, parent[at])
    path = np.empty(length, np.int64)
    path[length - 1] = last
    at = cell
    for index in range(length - 2, -1, -1):
        path[index] = came_by[at]
        at = get(queue, parent[at])
    return path, at


@njit(cache=True)
def find_path(
    sources: Grid, state: Grid, frontier: Grid, slide: bool, ties: int
) -> tuple[Grid, Cell]:
    """Return the commands from the nearest source to the nearest frontier cell, and that source;
    empty if there is no way.

    A breadth-first search, level by level, each level sorted into the order of expansion (`sources`
    are so already). With `slide` a step of the search is a tilt of a lone particle.
    """
    shape = state.shape
    came_by = np.full(shape, UNSEEN, np.int8)
    parent = np.empty(shape, np.int64)  # index in the queue
    queue = np.empty((state.size, 3), np.int64)
    codes = np.empty(state.size, np.int64)  # the level that is being discovered
    begin, end = 0, len(sources)
    for index in range(end):
        cell = get(sources, index)
        put(queue, index, cell)
        came_by[cell] = SOURCE
    while begin < end:
        size = 0
        for index in range(begin, end):
            cell = get(queue, index)
            for command in range(directions(state)):
                found, there = advance(state, frontier, cell, command, slide)
                if found:
                    return trace(queue, parent, came_by, cell, command)
                # Where there is no way, `there` is the cell itself, which has been seen.
                if came_by[there] == UNSEEN:
                    came_by[there] = command
                    parent[there] = index
                    codes[size] = encode(there, shape, ties)
                    size += 1
        codes[:size].sort()
        for index in range(size):
            put(queue, end + index, decode(codes[index], shape, ties))
        begin, end = end, end + size
    return np.empty(0, np.int64), get(sources, 0)


# -------------------------------------------------------------------------------------------
# episodes


@njit(cache=True)
def new_log() -> Grid:
    """Return an empty log, with room for some moves."""
    return np.empty((16, 4), np.int64)


@njit(cache=True)
def record(log: Grid, moves: int, command: int, travelled: int, classified: int, left: int) -> Grid:
    """Write a move into the log and return the log, twice as long if it was full."""
    if moves == len(log):
        longer = np.empty((2 * moves, 4), np.int64)
        for index in range(moves):
            for column in range(4):
                longer[index, column] = log[index, column]
        log = longer
    log[moves, COMMAND] = command
    log[moves, TRAVELLED] = travelled
    log[moves, CLASSIFIED] = classified
    log[moves, LEFT] = left
    return log


@njit(cache=True)
def finish(log: Grid, moves: int) -> Grid:
    """Return the part of the log that is in use."""
    return log[:moves].copy()


@njit(cache=True)
def replay(
    counts: Grid, free: Grid, state: Grid, frontier: Grid, commands: Grid, rule: int, task: int
) -> Grid:
    """Carry out all `commands`, in place; return the log."""
    left = np.count_nonzero(frontier)
    log = new_log()
    moves = 0
    for command in commands:
        travelled, classified, gained = step(counts, free, state, frontier, command, rule, task)
        left += gained - classified
        log = record(log, moves, command, travelled, classified, left)
        moves += 1
    return finish(log, moves)


@njit(cache=True)
def closest_frontier_episode(
    counts: Grid,
    free: Grid,
    state: Grid,
    frontier: Grid,
    rule: int,
    task: int,
    ties: int,
    max_moves: int,
) -> tuple[int, Grid]:
    """Run closest-frontier to its end, in place; return (status, log)."""
    left = np.count_nonzero(frontier)
    log = new_log()
    moves = 0
    while left > 0 and moves < max_moves:
        path, _ = find_path(occupied_cells(counts, ties), state, frontier, rule == TILT, ties)
        if len(path) == 0:
            return STALLED, finish(log, moves)
        for command in path:
            travelled, classified, gained = step(counts, free, state, frontier, command, rule, task)
            left += gained - classified
            log = record(log, moves, command, travelled, classified, left)
            moves += 1
            if left == 0 or moves == max_moves:
                break
    return (COMPLETE if left == 0 else LIMIT), finish(log, moves)


@njit(cache=True)
def end_of_path(cell: Cell, path: Grid) -> Cell:
    """Return the cell that a path of single steps leads to."""
    for command in path:
        cell = neighbour(cell[0], cell[1], cell[2], command)
    return cell


@njit(cache=True)
def elect_particle_episode(
    counts: Grid,
    free: Grid,
    state: Grid,
    frontier: Grid,
    elected: Cell,
    rule: int,
    task: int,
    ties: int,
    max_moves: int,
) -> tuple[int, Grid]:
    """Run elect-particle from the cell `elected` to its end, in place; return (status, log)."""
    left = np.count_nonzero(frontier)
    log = new_log()
    moves = 0
    sources = np.empty((1, 3), np.int64)
    while left > 0 and moves < max_moves:
        put(sources, 0, elected)
        path, _ = find_path(sources, state, frontier, False, ties)
        # its part of the free space is done: elect the particle nearest to the frontier
        if len(path) == 0:
            path, elected = find_path(occupied_cells(counts, ties), state, frontier, False, ties)
        if len(path) == 0:
            return STALLED, finish(log, moves)
        target = end_of_path(elected, path)
        for command in path:
            travelled, classified, gained = step(counts, free, state, frontier, command, rule, task)
            left += gained - classified
            log = record(log, moves, command, travelled, classified, left)
            moves += 1
            # Whether the elected particle moved there or was blocked by one there: that one is
            # elected now.
            there = neighbour(elected[0], elected[1], elected[2], command)
            if counts[there] > 0:
                elected = there
            # A classified or covered cell never gets back onto the frontier.
            if left == 0 or moves == max_moves or not frontier[target]:
                break
    return (COMPLETE if left == 0 else LIMIT), finish(log, moves)


@njit(cache=True)
def forward_command(state: Grid, visited: Grid, token: Cell) -> int:
    """Return the first command to a cell that is unknown, or known free and not visited; -1 if
    none.
    """
    for command in range(directions(state)):
        there = neighbour(token[0], token[1], token[2], command)
        if state[there] == UNKNOWN or (state[there] == FREE and not visited[there]):
            return command
    return -1


@njit(cache=True)
def depth_first_episode(
    counts: Grid,
    free: Grid,
    state: Grid,
    frontier: Grid,
    token: Cell,
    rule: int,
    task: int,
    max_moves: int,
) -> tuple[int, Grid]:
    """Run depth-first with the token starting in the cell `token`, in place; return
    (status, log).
    """
    left = np.count_nonzero(frontier)
    log = new_log()
    moves = 0
    visited = np.zeros(counts.shape, np.bool_)
    visited[token] = True
    trail = np.empty(counts.size, np.int64)  # the forward commands from the root to the token
    depth = 0
    while left > 0 and moves < max_moves:
        command = forward_command(state, visited, token)
        forward = command >= 0
        if not forward:
            if depth == 0:
                return STALLED, finish(log, moves)
            command = REVERSE[trail[depth - 1]]
        travelled, classified, gained = step(counts, free, state, frontier, command, rule, task)
        left += gained - classified
        log = record(log, moves, command, travelled, classified, left)
        moves += 1
        there = neighbour(token[0], token[1], token[2], command)
        if counts[there] > 0:
            token = there
            visited[token] = True
            if forward:
                trail[depth] = command
                depth += 1
            else:
                depth -= 1
    return (COMPLETE if left == 0 else LIMIT), finish(log, moves)


def random_moves_episode(
    world: World, rule: int, task: int, rng: np.random.Generator, max_moves: int
) -> tuple[int, Grid]:
    """Run random-moves to its end, in place; return (status, log). Not compiled: it draws from
    `rng`.
    """
    left = int(np.count_nonzero(world.frontier))
    rows: list[tuple[int, int, int, int]] = []
    while left > 0 and len(rows) < max_moves:
        command = int(rng.integers(0, directions(world.counts)))
        travelled, classified, gained = step(
            world.counts, world.free, world.state, world.frontier, command, rule, task
        )
        left += gained - classified
        rows.append((command, travelled, classified, left))
    return (COMPLETE if left == 0 else LIMIT), np.array(rows, np.int64).reshape(len(rows), 4)


# ----------------------------------------------------------------------------------------- top
# level


class World(NamedTuple):
    """The padded arrays of one episode; see the head of this module."""

    counts: Grid
    free: Grid
    state: Grid
    frontier: Grid


def pad(grid: Grid) -> Grid:
    """Return `grid` with a layer axis and one cell of zeros around (no layers of zeros around a 2-D
    grid).
    """
    if grid.ndim == 2:
        return np.pad(grid[None], ((0, 0), (1, 1), (1, 1)))
    return np.pad(grid, 1)


def unpad(grid: Grid, ndim: int) -> Grid:
    """Undo `pad` for a workspace of `ndim` dimensions."""
    if ndim == 2:
        return grid[0, 1:-1, 1:-1].copy()
    return grid[1:-1, 1:-1, 1:-1].copy()


def count_cells(cells: ArrayLike, shape: tuple[int, ...]) -> Grid:
    """Return how often each cell occurs in a list of cells, as an array of the given shape."""
    counts = np.zeros(shape, np.int32)
    for cell in np.asarray(cells, np.int64).reshape(-1, len(shape)):
        if any(index < 0 or index >= size for index, size in zip(cell, shape, strict=True)):
            raise ValueError(f"cell {tuple(cell)} is outside the workspace")
        counts[tuple(cell)] += 1
    return counts


def wanted_cells(free: Grid, targets: ArrayLike | None) -> Grid:
    """Return a mask of the cells to cover: all free cells, or `targets` (a mask or a list of
    cells).
    """
    if targets is None:
        return free.copy()
    given = np.asarray(targets)
    is_mask = given.dtype == np.bool_ and given.shape == free.shape
    wanted = given if is_mask else count_cells(given, free.shape) > 0
    if np.any(wanted & ~free):
        raise ValueError("a target lies on an obstacle")
    return wanted


def make_world(
    free: ArrayLike,
    start: ArrayLike,
    *,
    rule: str = "block",
    task: str = "mapping",
    targets: ArrayLike | None = None,
) -> World:
    """Return the padded arrays at the start of an episode, the start positions observed."""
    space = np.asarray(free, dtype=np.bool_)
    occupied = count_cells(start, space.shape)
    if np.any((occupied > 0) & ~space):
        raise ValueError("a particle starts on an obstacle")
    if rule != "merge" and np.any(occupied > 1):
        raise ValueError("two particles start in one cell")
    if task == "mapping" and targets is not None:
        raise ValueError("mapping takes no targets")
    counts, truth = pad(occupied), pad(space)
    if task == "coverage":
        state = np.where(truth, FREE, OBSTACLE).astype(np.uint8)
        frontier = pad(wanted_cells(space, targets))
        cover(counts, frontier)
        return World(counts, truth, state, frontier)
    state = np.full(truth.shape, UNKNOWN, np.uint8)
    frontier = np.zeros(truth.shape, np.bool_)
    state[counts > 0] = FREE  # before the loop, lest a particle's cell is taken for a frontier cell
    for layer, row, col in np.argwhere(counts > 0):
        learn_free(state, frontier, layer, row, col)
    return World(counts, truth, state, frontier)


def report(world: World, log: Grid, ndim: int) -> dict[str, Any]:
    """Return the result of an episode by name."""
    return {
        "counts": unpad(world.counts, ndim),
        "travelled": log[:, TRAVELLED].copy(),
        "classified": log[:, CLASSIFIED].copy(),
        "frontier": log[:, LEFT].copy(),
        "state": world.state,
        "frontier_cells": world.frontier,
    }


def command_codes(commands: str, ndim: int) -> Grid:
    """Return a command string as codes."""
    letters = LETTERS[: 2 * ndim]
    for letter in commands:
        if letter not in letters:
            raise ValueError(f"unknown command {letter!r}")
    return np.array([letters.index(letter) for letter in commands], np.int64)


def simulate(
    free: ArrayLike,
    start: ArrayLike,
    commands: str,
    *,
    rule: str = "block",
    task: str = "mapping",
    targets: ArrayLike | None = None,
) -> dict[str, Any]:
    """Carry out all `commands`, also those after the task is complete.

    Returns `counts` (particles in each cell of the workspace at the end), per-move arrays
    `travelled`, `classified` (or covered) and `frontier` (cells left), and the padded final arrays
    `state` and `frontier_cells`.
    """
    ndim = np.ndim(free)
    world = make_world(free, start, rule=rule, task=task, targets=targets)
    codes = command_codes(commands, ndim)
    log = replay(*world, codes, RULES.index(rule), TASKS.index(task))
    return report(world, log, ndim)


def run(
    free: ArrayLike,
    start: ArrayLike,
    *,
    policy: str = "closest-frontier",
    rule: str = "block",
    task: str = "mapping",
    targets: ArrayLike | None = None,
    ties: str = "column-major",
    rng: np.random.Generator | None = None,
    max_moves: int = 1_000_000,
) -> dict[str, Any]:
    """Run a policy; return what `simulate` returns, with `commands` and `status` besides."""
    ndim = np.ndim(free)
    world = make_world(free, start, rule=rule, task=task, targets=targets)
    rule_code, task_code, ties_code = RULES.index(rule), TASKS.index(task), TIES.index(ties)
    if policy == "closest-frontier":
        status, log = closest_frontier_episode(*world, rule_code, task_code, ties_code, max_moves)
    elif policy == "random-moves":
        status, log = random_moves_episode(world, rule_code, task_code, need_rng(rng), max_moves)
    elif policy == "elect-particle":
        cells = single_step_cells(world, policy, rule)
        elected = cells[int(need_rng(rng).integers(0, len(cells)))]
        status, log = elect_particle_episode(
            *world, elected, rule_code, task_code, ties_code, max_moves
        )
    elif policy == "depth-first":
        token = single_step_cells(world, policy, rule)[0]
        status, log = depth_first_episode(*world, token, rule_code, task_code, max_moves)
    else:
        raise ValueError(f"unknown policy {policy!r}")
    commands = "".join(LETTERS[code] for code in log[:, COMMAND])
    return {"commands": commands, "status": STATUSES[status], **report(world, log, ndim)}


def need_rng(rng: np.random.Generator | None) -> np.random.Generator:
    """Return `rng`, which must be there."""
    if rng is None:
        raise ValueError("this policy draws at random: pass rng")
    return rng


def single_step_cells(world: World, policy: str, rule: str) -> list[Cell]:
    """Return the occupied padded cells in row-major order, for policies that follow one
    particle.
    """
    if rule == "tilt":
        raise ValueError(f"{policy} is not defined under tilt")
    cells = [(int(layer), int(row), int(col)) for layer, row, col in np.argwhere(world.counts > 0)]
    if not cells:
        raise ValueError(f"{policy} needs a particle")
    return cells
