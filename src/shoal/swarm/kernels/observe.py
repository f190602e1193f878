"""What a push tells: tried cells are classified, the frontier grows around cells found free, covered cells leave it."""

from __future__ import annotations

from shoal.swarm.kernels.bits import ONE, TOP, ZERO, popcount
from shoal.swarm.kernels.compiling import kernel
from shoal.swarm.kernels.moves import IN, LEFT, OUT, RIGHT, TILT, UP, push


@kernel
def find_tried(field, command):  # type: ignore[no-untyped-def]
    """Fill ``fresh`` with the unknown cells that particles tried to enter; tell whether there are any."""
    before, known, tried = field.before, field.known, field.fresh
    last = known.shape[0] - 1
    if command == LEFT:
        for i in range(last):
            tried[i] = ((before[i] >> ONE) | (before[i + 1] << TOP)) & ~known[i]
    elif command == RIGHT:
        for i in range(last):
            tried[i + 1] = ((before[i + 1] << ONE) | (before[i] >> TOP)) & ~known[i + 1]
    else:
        offset = field.width
        if command == IN or command == OUT:
            offset *= field.rows
        inner = last + 1 - offset
        if command == UP or command == IN:
            before, known, tried = before[offset:], known[:inner], tried[:inner]
        else:
            before, known, tried = before[:inner], known[offset:], tried[offset:]
        for i in range(inner):
            tried[i] = before[i] & ~known[i]
    some = ZERO
    for i in range(tried.shape[0]):
        some |= tried[i]
    return some != ZERO


@kernel
def classify(field):  # type: ignore[no-untyped-def]
    """Classify the cells of ``fresh`` by where particles are now, leave those found free in it; return how many they were."""
    tried, known = field.fresh, field.known
    classified = 0
    for i in range(tried.shape[0]):
        classified += popcount(tried[i])
        known[i] |= tried[i]
    for i in range(tried.shape[0]):
        field.frontier[i] &= ~tried[i]
        tried[i] &= field.occupied[i]
        field.open[i] |= tried[i]
    return classified


@kernel
def add_frontier(field, i, cells):  # type: ignore[no-untyped-def]
    """Add the unknown ones of ``cells`` to one word of the frontier; return how many are new."""
    new = cells & ~field.known[i] & ~field.frontier[i]
    field.frontier[i] |= new
    return popcount(new)


@kernel
def grow_frontier(field):  # type: ignore[no-untyped-def]
    """Add the unknown neighbours of the fresh cells to the frontier, empty ``fresh``; return how many were added."""
    fresh, width = field.fresh, field.width
    added = 0
    for i in range(fresh.shape[0]):
        cells = fresh[i]
        if cells == ZERO:
            continue
        fresh[i] = ZERO
        added += add_frontier(field, i, (cells << ONE) | (cells >> ONE))
        added += add_frontier(field, i + 1, cells >> TOP)
        added += add_frontier(field, i - 1, cells << TOP)
        added += add_frontier(field, i - width, cells)
        added += add_frontier(field, i + width, cells)
        if field.layers > 1:
            added += add_frontier(field, i - width * field.rows, cells)
            added += add_frontier(field, i + width * field.rows, cells)
    return added


@kernel
def cover(field):  # type: ignore[no-untyped-def]
    """Take the occupied cells out of the frontier; return how many that were."""
    frontier, occupied = field.frontier, field.occupied
    some = ZERO
    for i in range(frontier.shape[0]):
        some |= frontier[i] & occupied[i]
    covered = 0
    if some != ZERO:
        for i in range(frontier.shape[0]):
            covered += popcount(frontier[i] & occupied[i])
            frontier[i] &= ~occupied[i]
    return covered


@kernel
def step(field, command, rule, mapping):  # type: ignore[no-untyped-def]
    """Carry out one command of any rule; return (cells travelled, cells done, change of the frontier count)."""
    travelled, done, change = 0, 0, 0
    while True:
        moved = push(field, command, rule)
        travelled += moved
        if mapping:
            if find_tried(field, command):
                classified = classify(field)
                done += classified
                change += grow_frontier(field) - classified
        elif moved > 0:
            covered = cover(field)
            done += covered
            change -= covered
        if rule != TILT or moved == 0:  # a tilt is over when nothing moves; its last push finds the walls
            return travelled, done, change
