"""How many configurations a swarm can be brought to, by sets and tuples, straight from the
definitions.

A configuration is the sorted tuple of the particles' cells; a cell that holds several particles is
repeated.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

Cell = tuple[int, ...]
Configuration = tuple[Cell, ...]

# (row, column), in the order l, u, r, d.
STEPS_2D: tuple[Cell, ...] = ((0, -1), (-1, 0), (0, 1), (1, 0))
# (layer, row, column), in the order l, u, r, d, i, o.
STEPS_3D: tuple[Cell, ...] = ((0, 0, -1), (0, -1, 0), (0, 0, 1), (0, 1, 0), (-1, 0, 0), (1, 0, 0))


def add(cell: Cell, step: Cell) -> Cell:
    """Return the cell one step further."""
    return tuple(a + b for a, b in zip(cell, step, strict=True))


def free_cells(free: Sequence[Any]) -> set[Cell]:
    """Return the free cells of a nested sequence (or array) of truth values."""
    cells: set[Cell] = set()
    for index, part in enumerate(free):
        if hasattr(part, "__len__"):
            cells |= {(index, *rest) for rest in free_cells(part)}
        elif part:
            cells.add((index,))
    return cells


def block_step(free: set[Cell], where: Configuration, step: Cell) -> Configuration:
    """Move by the block rule: a run of adjacent particles moves if the cell ahead of all of it is
    free.
    """
    occupied = set(where)

    def moved(cell: Cell) -> Cell:
        ahead = add(cell, step)
        while ahead in occupied:
            ahead = add(ahead, step)
        return add(cell, step) if ahead in free else cell

    return tuple(sorted(moved(cell) for cell in where))


def merge_step(free: set[Cell], where: Configuration, step: Cell) -> Configuration:
    """Move by the merge rule: each particle moves unless the next cell is an obstacle."""
    return tuple(sorted(add(cell, step) if add(cell, step) in free else cell for cell in where))


def tilt_step(free: set[Cell], where: Configuration, step: Cell) -> Configuration:
    """Repeat the block step until nothing moves."""
    while True:
        after = block_step(free, where, step)
        if after == where:
            return where
        where = after


RULES = {"block": block_step, "merge": merge_step, "tilt": tilt_step}


def reach_counts(
    free: Sequence[Any], start: Iterable[Sequence[int]], depth: int, rule: str
) -> list[int]:
    """Return the number of distinct configurations after exactly k commands, for k = 0 .. depth."""
    cells = free_cells(free)
    where: Configuration = tuple(sorted(tuple(int(index) for index in cell) for cell in start))
    if not cells.issuperset(where):
        raise ValueError("a particle starts on an obstacle")
    if rule != "merge" and len(set(where)) < len(where):
        raise ValueError("two particles start in one cell")
    steps = STEPS_3D if any(len(cell) == 3 for cell in cells) else STEPS_2D
    apply = RULES[rule]
    level = {where}
    counts = [1]
    for _ in range(depth):
        level = {apply(cells, configuration, step) for configuration in level for step in steps}
        counts.append(len(level))
    return counts
