"""Gathering in plain Python: positions in lists, and breadth-first searches over sets of cells."""

from __future__ import annotations

import numpy as np

STEPS = {"l": (0, -1), "u": (-1, 0), "r": (0, 1), "d": (1, 0)}


def moved(free: np.ndarray, cells, letter: str, rule: str) -> tuple:
    """Return the sorted cells of the particles after one command, by the definition of the rule."""
    row, column = STEPS[letter]
    shape = free.shape

    def is_free(cell):
        return 0 <= cell[0] < shape[0] and 0 <= cell[1] < shape[1] and bool(free[cell])

    # the foremost particle first, so that those ahead have moved already
    ordered = sorted(cells, key=lambda cell: -(cell[0] * row + cell[1] * column))
    done: list[tuple[int, int]] = []
    for start in ordered:
        cell = start
        for _ in range(1 if rule != "tilt" else max(shape)):
            ahead = (cell[0] + row, cell[1] + column)
            if not is_free(ahead) or (rule != "merge" and ahead in done):
                break
            cell = ahead
        done.append(cell)
    return tuple(sorted(done))


def is_gathered(cells, region) -> bool:
    """Return whether all cells are in the region, or without a region equal."""
    return len(set(cells)) == 1 if region is None else all(cell in region for cell in cells)


def fewest_moves(
    free: np.ndarray, start, region, rule: str, most_states: int = 100_000
) -> int | None:
    """Return the fewest commands that gather the particles, or None if there are none or if the
    search takes too many states.
    """
    first = tuple(sorted(tuple(cell) for cell in np.asarray(start).tolist()))
    wave, seen, moves = [first], {first}, 0
    while wave:
        if any(is_gathered(cells, region) for cells in wave):
            return moves
        following = []
        for cells in wave:
            for letter in STEPS:
                there = moved(free, cells, letter, rule)
                if rule == "merge":
                    there = tuple(sorted(set(there)))
                if there not in seen:
                    seen.add(there)
                    following.append(there)
        if len(seen) > most_states:
            return None
        wave, moves = following, moves + 1
    return None
