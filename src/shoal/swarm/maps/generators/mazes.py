"""Generated maps without blood vessels: mazes, caves and H-trees."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.swarm.maps.reading import MAX_CELLS, Mask
from shoal.swarm.maps.resampling import largest_part


def draw_maze(width: int, height: int, *, seed: int = 0) -> NDArray[np.bool_]:
    """Return a map of a maze, carved by a randomized depth-first search.

    The rooms of the maze lie in even rows and even columns, with walls between the rooms. If the
    width is even, the last column contains short random dead ends instead of rooms. If the height
    is even, the last row contains short random dead ends instead of rooms.

    Parameters
    ----------
    width, height : int
        Width and height of the maze, in cells.
    seed : int
        Seed of the random numbers. Equal sizes and equal seeds give equal maps.

    Returns
    -------
    ndarray, bool, shape (height, width)
        True at free cells. The free cells form a 4-connected tree.
    """
    rng = np.random.default_rng([seed, height, width])
    free = np.zeros((height, width), dtype=np.bool_)
    rooms = free[::2, ::2]
    rooms[:] = True
    rows, columns = rooms.shape
    entered, previous = _walk(rows, columns, rng)
    # The wall between two neighbouring rooms is the cell halfway between them.
    free[entered // columns + previous // columns, entered % columns + previous % columns] = True
    if width % 2 == 0:
        free[::2, -1] = rng.random(rows) < 0.5
    if height % 2 == 0:
        free[-1, ::2] = rng.random(columns) < 0.5
    return free


def _walk(
    rows: int, columns: int, rng: np.random.Generator
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the flat index of each room except the first, and the flat index of the room from
    which the search entered it.
    """
    # Twelve is a multiple of 1, 2, 3 and 4, so a number below 12 chooses uniformly among 1 to 4
    # doors.
    draws = rng.integers(0, 12, rows * columns).tolist()
    unvisited = bytearray(b"\x01") * (rows * columns)
    room = int(rng.integers(rows * columns))
    unvisited[room] = 0
    trail = [room]
    entered: list[int] = []
    previous: list[int] = []
    while trail:
        room = trail[-1]
        doors = _doors(room, rows, columns, unvisited)
        if not doors:
            trail.pop()
            continue
        previous.append(room)
        room = doors[draws[len(entered)] % len(doors)]
        unvisited[room] = 0
        entered.append(room)
        trail.append(room)
    return np.array(entered, dtype=np.int64), np.array(previous, dtype=np.int64)


def _doors(room: int, rows: int, columns: int, unvisited: bytearray) -> list[int]:
    """Return the flat indices of the unvisited rooms beside ``room``."""
    row, column = divmod(room, columns)
    doors = []
    if column > 0 and unvisited[room - 1]:
        doors.append(room - 1)
    if row > 0 and unvisited[room - columns]:
        doors.append(room - columns)
    if column < columns - 1 and unvisited[room + 1]:
        doors.append(room + 1)
    if row < rows - 1 and unvisited[room + columns]:
        doors.append(room + columns)
    return doors


FIRST_SHARE = 0.5  # initial fraction of free cells; increased until the cave is large enough
WANTED_SHARE = 0.38  # minimum fraction of the picture that the cave fills
ROUNDS = 5  # smoothing steps; small pictures get fewer, otherwise their caves would vanish


def draw_cave(width: int, height: int, *, seed: int = 0) -> Mask:
    """Return a map of a cave with smooth walls.

    Parameters
    ----------
    width, height : int
        Size of the map in cells.
    seed : int
        Seed of the random numbers. Equal sizes and equal seeds give equal maps.

    Returns
    -------
    ndarray, bool, shape (height, width)
        True at free cells. The free cells are 4-connected and fill more than a third of the map.
    """
    rng = np.random.default_rng([seed, height, width])
    rounds = min(ROUNDS, min(width, height) // 4)
    share = FIRST_SHARE
    while True:
        free = rng.random((height, width)) < share
        for _ in range(rounds):
            free = _smooth(free)
        cave = largest_part(free)
        if np.count_nonzero(cave) >= WANTED_SHARE * cave.size or share >= 1:
            return cave
        share += 0.02


def _smooth(free: Mask) -> Mask:
    """Replace each cell by the majority of the 3 x 3 cells around it. Cells outside the map count
    as walls.
    """
    count = np.pad(free, 1).astype(np.int8)
    count = count[:-2] + count[1:-1] + count[2:]
    count = count[:, :-2] + count[:, 1:-1] + count[:, 2:]
    return np.asarray(count >= 5)


LEFT_RIGHT = np.array([[0, -1], [0, 1]])
DOWN_UP = np.array([[1, 0], [-1, 0]])


def draw_htree(count: int) -> NDArray[np.bool_]:
    """Return a map of an H-tree with exactly ``count`` free cells. The H-tree has no loops, and its
    corridors are one cell wide.

    The generator draws the smallest regular tree with at least ``count`` cells, and removes cells
    until ``count`` cells remain. The removal begins at the tips of the branches in the lower left
    corner.

    Parameters
    ----------
    count : int
        Number of free cells, at least 1.

    Returns
    -------
    ndarray, bool, shape (H, W)
        True at free cells. A map of 5000 free cells has the shape (125, 125).

    Raises
    ------
    InvalidInputError
        Raised if the map would have more than ``MAX_CELLS`` free and obstacle cells.

    Source: paper M, figure 7 (map "H-tree").
    """
    halves = half_lengths(count)
    width, height = 1 + 2 * sum(halves[::2]), 1 + 2 * sum(halves[1::2])
    if width * height > MAX_CELLS:
        raise InvalidInputError(
            f"expected an H-tree in a picture of at most {MAX_CELLS} cells, got {count} free cells,"
            f" which need {height}x{width}"
        )
    return draw_bars(halves, count)


def half_lengths(count: int) -> tuple[int, ...]:
    """Return the half-lengths, in cells, of the bars at each level of the smallest H-tree with at
    least ``count`` cells.

    >>> half_lengths(5000)
    (32, 32, 16, 16, 8, 8, 4, 4, 2, 2)
    """
    levels = 0
    while tree_size(_regular(levels)) < count:
        levels += 1
    return _regular(levels)


def tree_size(halves: tuple[int, ...]) -> int:
    """Return the number of cells of the H-tree with the given half-lengths. Level k, counted from
    0, has 2^(k+1) half bars.
    """
    return 1 + sum(half << (level + 1) for level, half in enumerate(halves))


def draw_bars(halves: tuple[int, ...], count: int) -> NDArray[np.bool_]:
    """Return a map of the H-tree whose bars have the given half-lengths, cut down to ``count``
    cells.

    Parameters
    ----------
    halves : tuple of int
        Half-length of the bars at each level of the tree, in cells. Bars at even levels are
        horizontal, and bars at odd levels are vertical.
    count : int
        Number of cells to keep, from 1 to ``tree_size(halves)``.

    Returns
    -------
    ndarray, bool, shape (H, W)
        True at free cells. The map has no border rows or columns of obstacles.
    """
    cells = np.zeros((1, 2), dtype=np.int64)
    if halves:
        arms = _arms(halves)
        # Cut one arm after the other, from its tip, until enough cells are removed.
        surplus = tree_size(halves) - count - (np.cumsum(arms.length) - arms.length)
        lengths = arms.length - np.clip(surplus, 0, arms.length)
        arm = np.repeat(np.arange(len(lengths)), lengths)
        along = 1 + np.arange(len(arm)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        cells = np.concatenate([cells, arms.start[arm] + along[:, None] * arms.step[arm]])
        cells -= cells.min(axis=0)
    free = np.zeros(cells.max(axis=0) + 1, dtype=np.bool_)
    free[cells[:, 0], cells[:, 1]] = True
    return free


class _Arms(NamedTuple):
    """Arms (half bars) of an H-tree. Each arm has the cells ``start + step``, ..., ``start + length
    * step``.
    """

    start: NDArray[np.int64]  # (arms, 2), row and column
    step: NDArray[np.int64]  # (arms, 2)
    length: NDArray[np.int64]  # (arms,)


def _regular(levels: int) -> tuple[int, ...]:
    """Return the half-length of the bars at each level of a regular H-tree, in cells.

    The half-length is 2 cells at the last two levels, 4 cells at the two levels before them, and so
    on.
    """
    return tuple(2 ** ((levels - level + 1) // 2) for level in range(levels))


def _arms(halves: tuple[int, ...]) -> _Arms:
    """Return all arms of an H-tree in the order in which the generator removes them.

    Each arm comes after all arms that grow from it. At each fork, the left or lower arm, with all
    arms that grow from it, comes before the opposite arm. In this order, the generator removes one
    branch after another, beginning in the lower left corner.
    """
    starts, steps, lengths, levels, last_leaves = [], [], [], [], []
    tips = np.zeros((1, 2), dtype=np.int64)
    for level, half in enumerate(halves):
        start = np.repeat(tips, 2, axis=0)
        step = np.tile(DOWN_UP if level % 2 else LEFT_RIGHT, (len(tips), 1))
        tips = start + half * step
        starts.append(start)
        steps.append(step)
        lengths.append(np.full(len(tips), half))
        levels.append(np.full(len(tips), level))
        # Number the tips of the whole tree from the corner. Each arm is cut together with the last
        # tip that it leads to.
        last_leaves.append(np.arange(1, len(tips) + 1) << (len(halves) - 1 - level))
    order = np.lexsort((-np.concatenate(levels), np.concatenate(last_leaves)))
    return _Arms(
        np.concatenate(starts)[order], np.concatenate(steps)[order], np.concatenate(lengths)[order]
    )
