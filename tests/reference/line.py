"""One dimension, slow and obvious: particles as a list of positions, moved one step at a time."""

from __future__ import annotations

import numpy as np


def step(positions: list[int], cells: int, direction: int) -> tuple[list[int], bool]:
    """Return where the particles are after one command, and whether one of them ran into the end of
    the line.
    """
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


def printed_coverage_moves(positions, *, cells):
    """Return the papers' formula for coverage_moves (paper M, section III.A.2); positions of shape
    (..., n) are ascending.
    """
    p = np.asarray(positions)
    ends = p[..., 0] + cells - p[..., -1]
    inner = (np.diff(p) - 1).max(axis=-1) if p.shape[-1] > 1 else np.zeros_like(ends)
    return p[..., 0] + 1 + np.maximum(ends, inner)


def largest_gap(positions, *, cells):
    """Return the empty cells in the largest of all n + 1 gaps, those at the two ends included."""
    p = np.asarray(positions)
    walls = np.zeros_like(p[..., :1])
    return (np.diff(np.concatenate([walls, p, walls + cells + 1], axis=-1)) - 1).max(axis=-1)
