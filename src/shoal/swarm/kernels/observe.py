"""What is left to do after a move: the frontier grows around cells found free, covered cells leave it."""

from __future__ import annotations


from shoal.swarm.kernels.compiling import kernel
from shoal.swarm.kernels.bits import ONE, TOP, ZERO, popcount
from shoal.swarm.kernels.moves import TILT, push


@kernel
def add_frontier(field, row, k, cells):  # type: ignore[no-untyped-def]
    """Add the unknown ones of ``cells`` to one word of the frontier; return how many are new."""
    new = cells & ~field.known[row, k] & ~field.frontier[row, k]
    field.frontier[row, k] |= new
    return popcount(new)


@kernel
def grow_frontier(field):  # type: ignore[no-untyped-def]
    """Add the unknown neighbours of the fresh cells to the frontier, empty ``fresh``; return how many were added."""
    fresh = field.fresh
    last = fresh.shape[1] - 1
    added = 0
    for row in range(fresh.shape[0]):
        for k in range(last + 1):
            cells = fresh[row, k]
            if cells == ZERO:
                continue
            fresh[row, k] = ZERO
            added += add_frontier(field, row, k, (cells << ONE) | (cells >> ONE))
            if k < last and cells >> TOP != ZERO:
                added += add_frontier(field, row, k + 1, ONE)
            if k > 0 and cells & ONE != ZERO:
                added += add_frontier(field, row, k - 1, ONE << TOP)
            added += add_frontier(field, row - 1, k, cells)
            added += add_frontier(field, row + 1, k, cells)
            if field.layers > 1:
                added += add_frontier(field, row - field.rows, k, cells)
                added += add_frontier(field, row + field.rows, k, cells)
    return added


@kernel
def cover(field):  # type: ignore[no-untyped-def]
    """Take the occupied cells out of the frontier; return how many that were."""
    covered = 0
    for row in range(field.frontier.shape[0]):
        for k in range(field.frontier.shape[1]):
            here = field.frontier[row, k] & field.occupied[row, k]
            if here != ZERO:
                field.frontier[row, k] ^= here
                covered += popcount(here)
    return covered


@kernel
def step(field, command, rule, mapping):  # type: ignore[no-untyped-def]
    """Carry out one command of any rule; return (cells travelled, cells done, change of the frontier count)."""
    travelled, done, change = 0, 0, 0
    while True:
        moved, classified = push(field, command, rule)
        travelled += moved
        if mapping:
            done += classified
            change -= classified
            if classified > 0:
                change += grow_frontier(field)
        elif moved > 0:
            covered = cover(field)
            done += covered
            change -= covered
        if rule != TILT or moved == 0:  # a tilt is over when nothing moves; its last push finds the walls
            return travelled, done, change
