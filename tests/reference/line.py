"""One dimension, slow and obvious: particles as a list of positions, moved one step at a time."""

from __future__ import annotations


def step(positions: list[int], cells: int, direction: int) -> tuple[list[int], bool]:
    """Return where the particles are after one command, and whether one of them ran into the end of the line."""
    after: list[int] = []
    met_wall = False
    for position in sorted(positions, reverse=direction > 0):
        target = position + direction
        if not 1 <= target <= cells:
            met_wall = True
            after.append(position)
        elif target in after:
            after.append(position)
        else:
            after.append(target)
    return sorted(after), met_wall


def left_then_right(positions: list[int], cells: int) -> tuple[int, int]:
    """Return the moves until both ends are found, and until every cell has held a particle, too."""
    here, visited, moves = list(positions), set(positions), 0
    met = False
    while not met:
        here, met = step(here, cells, -1)
        visited |= set(here)
        moves += 1
    boundary = 0
    while not boundary or len(visited) < cells:
        here, met = step(here, cells, 1)
        visited |= set(here)
        moves += 1
        if met and not boundary:
            boundary = moves
    return boundary, moves
