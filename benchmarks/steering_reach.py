"""Which steering problems can be solved at all, by a search that shares no planning with Shoal.

A translation changes no difference of two particles, so that the search goes over differences: a
wall with the inward normal N and the tangent T holds a particle, or lets it slide along, while the
input moves the other; the difference then changes along -N + s T with |s| at most the friction. The
search is one in breadth over fine cells, from the starts on, and keeps in each cell the exact
difference that it came to. It takes every place along the walls and lengths that grow by a cell.

In a convex workspace, a difference that is reached is a fact: the walls allow these presses, without
errors. In others, the particles may have to go around something in between, so that the search
counts too much as reachable, never too little. That nothing is found is no proof, but was looked for
everywhere, as finely as the cells are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from shoal.jit import kernel
from shoal.steering.kernels.pressing import is_inside
from shoal.steering.planners import pressing
from shoal.steering.planners.sampling import world_of
from shoal.steering.problem import SteeringProblem

CELLS = 220  # along each axis of the table of differences
SLOPES = 5  # of presses, both edges of the friction cone among them
SPACING = 1 / 16  # relative to the size: distance of places along straight walls
STEEPEST = 20.0  # friction, more of which counts as this
MOST = 200  # presses in a row


@kernel
def search(start_x, start_y, goal_x, goal_y, near, friction, places, normals, edges, circle, cell):
    """Return the number of presses to the first difference within ``near`` of the goals', or -1, and
    the least distance from it of all differences reached.
    """
    n = CELLS
    seen = np.full((n, n), -1, dtype=np.int32)
    queue = np.empty((n * n, 2))
    queue[0, 0], queue[0, 1] = start_x, start_y
    seen[int(start_x / cell + n / 2), int(start_y / cell + n / 2)] = 0
    head, tail, least = 0, 1, np.inf
    while head < tail:
        x, y = queue[head, 0], queue[head, 1]
        depth = seen[int(x / cell + n / 2), int(y / cell + n / 2)]
        head += 1
        least = min(least, np.sqrt((x - goal_x) ** 2 + (y - goal_y) ** 2))
        if least <= near:
            return depth, least
        if depth >= MOST:
            continue
        for place in range(places.shape[0]):
            for sign in (-1.0, 1.0):  # of the change of the difference by the particle that moves
                wall_x, wall_y = places[place, 0], places[place, 1]
                if not is_inside(wall_x + sign * x, wall_y + sign * y, edges, circle):
                    continue
                for k in range(SLOPES):
                    slope = friction * (2.0 * k / (SLOPES - 1) - 1.0)
                    step = cell / np.sqrt(1 + slope * slope)
                    step_x = step * (-normals[place, 0] + slope * normals[place, 1])
                    step_y = step * (-normals[place, 1] - slope * normals[place, 0])
                    to_x, to_y = x, y
                    for _ in range(2 * n):
                        to_x += sign * step_x
                        to_y += sign * step_y
                        if not is_inside(wall_x + sign * to_x, wall_y + sign * to_y, edges, circle):
                            break
                        row, column = int(to_x / cell + n / 2), int(to_y / cell + n / 2)
                        if seen[row, column] < 0:
                            seen[row, column] = depth + 1
                            queue[tail, 0], queue[tail, 1] = to_x, to_y
                            tail += 1
    return -1, least


class Reach(NamedTuple):
    """What the search has found."""

    presses: int  # to the difference of the goals; -1 if the search does not reach it
    least: float  # distance from it of the nearest difference reached, relative to the size


def reach_of(problem: SteeringProblem, friction: float, within: float) -> Reach:
    """Return whether the goals of a problem can be reached on walls with a friction, each particle
    within a distance relative to the size.
    """
    size = float(problem.place.size)
    world = world_of(problem.world())
    start, goal = problem.endpoints(0)
    before, after = start[1] - start[0], goal[1] - goal[0]
    presses, least = search(
        *before.tolist(),
        *after.tolist(),
        2 * within * size,
        min(float(friction), STEEPEST),
        *pressing.holding_places(problem.place, SPACING),
        world.edges,
        world.walls.circle,
        2.2 * size / CELLS,
    )
    return Reach(int(presses), float(least) / size)
