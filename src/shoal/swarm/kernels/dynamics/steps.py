"""One command under any move rule, and its effect on the frontier."""

from __future__ import annotations

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.dynamics.bits import ZERO, popcount
from shoal.swarm.kernels.dynamics.moves import TILT, push


@in_place_kernel
def cover(field):
    """Remove the cells with particles from the frontier. Return the number of removed cells."""
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


@in_place_kernel
def step(field, command, rule, mapping):
    """Carry out one command under any move rule.

    Return the number of cells travelled, the number of cells classified, and the change in the number of frontier cells.
    """
    travelled, done, change = 0, 0, 0
    while True:
        moved, classified, added = push(field, command, rule)
        travelled += moved
        done += classified
        change += added - classified
        if not mapping and moved > 0:  # coverage: the map is known, so a push classifies no cell
            covered = cover(field)
            done += covered
            change -= covered
        if rule != TILT or moved == 0:  # a tilt ends when no particle moves; the last push finds the walls
            return travelled, done, change
