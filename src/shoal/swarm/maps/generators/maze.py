"""Perfect mazes: exactly one path connects any two free cells, and all corridors are one cell wide."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def draw_maze(width: int, height: int, *, seed: int = 0) -> NDArray[np.bool_]:
    """Return a map of a maze, carved by a randomized depth-first search.

    The rooms of the maze lie in even rows and even columns, with walls between the rooms. If the width is even, the last column
    contains short random dead ends instead of rooms. If the height is even, the last row contains short random dead ends instead of
    rooms.

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
    entered, left = _walk(rows, columns, rng)
    # The wall between two neighbouring rooms is the cell halfway between them.
    free[entered // columns + left // columns, entered % columns + left % columns] = True
    if width % 2 == 0:
        free[::2, -1] = rng.random(rows) < 0.5
    if height % 2 == 0:
        free[-1, ::2] = rng.random(columns) < 0.5
    return free


def _walk(rows: int, columns: int, rng: np.random.Generator) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the flat index of each room except the first, and the flat index of the room from which the search entered it."""
    # Twelve is a multiple of 1, 2, 3 and 4, so a number below 12 chooses uniformly among 1 to 4 doors.
    draws = rng.integers(0, 12, rows * columns).tolist()
    unvisited = bytearray(b"\x01") * (rows * columns)
    room = int(rng.integers(rows * columns))
    unvisited[room] = 0
    trail = [room]
    entered: list[int] = []
    left: list[int] = []
    while trail:
        room = trail[-1]
        doors = _doors(room, rows, columns, unvisited)
        if not doors:
            trail.pop()
            continue
        left.append(room)
        room = doors[draws[len(entered)] % len(doors)]
        unvisited[room] = 0
        entered.append(room)
        trail.append(room)
    return np.array(entered, dtype=np.int64), np.array(left, dtype=np.int64)


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
