"""Which steering problems can be solved at all, by a search that shares no planning with Shoal.

A translation changes no difference of two particles, so that the search goes over differences: a
wall with the inward normal N and the tangent T holds a particle, or lets it slide along, while the
input moves the other; the difference then changes along -N + s T with |s| at most the friction. The
search is one in breadth over fine cells, from the starts on, and keeps in each cell the exact
difference that it came to. It takes every place along the walls and lengths that grow by a cell.

In a workspace that is not convex, two places of the particles with one difference need not be joined
by a translation: the places of the first particle where both are inside can fall into parts. Then
each part of a cell's difference is searched apart (`parts_of`, on a raster of the same cells).

In a convex workspace, a difference that is reached is a fact: the walls allow these presses, without
errors. In others, it is one up to the width of a cell. That nothing is found is no proof, but was
looked for everywhere, as finely as the cells are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from shoal.jit import kernel
from shoal.steering.kernels.pressing import is_inside
from shoal.steering.planners import pressing
from shoal.steering.planners.sampling import world_of
from shoal.steering.problem import SteeringProblem

CELLS = 220  # along each axis of the table of differences
RASTER = 104  # cells of the same size along each axis of the workspace
MARGIN = 2  # empty cells of the raster around the workspace
NEIGHBOURS = 2  # cells around a place of a particle, in which its part is looked up
SLOPES = 5  # of presses, both edges of the friction cone among them
SPACING = 1 / 16  # relative to the size: distance of places along straight walls
STEEPEST = 20.0  # friction, more of which counts as this
MOST = 200  # presses in a row
PARTS = 4  # of the places with one difference, at most


def parts_of(problem: SteeringProblem, cell: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the parts into which the places of the first particle fall, for each cell of differences.

    The arrays are, for each cell of differences, the index of its picture (int32, -1 if all places hang
    together); the pictures (int8, shape (n, RASTER, RASTER)), which hold the number of the part, from 1,
    or 0; and the lower corner of the raster.
    """
    world = world_of(problem.world())
    low = np.asarray(problem.place.bounds[0]) - MARGIN * cell
    which, pictures = np.full((CELLS, CELLS), -1, dtype=np.int32), []
    if problem.place.kind == "region":
        # the first particle at the middles of cells, the second at their corners: they differ
        # by the middle of a cell of differences
        ones, others = (
            np.array(
                [
                    [
                        is_inside(
                            low[0] + (i + by) * cell,
                            low[1] + (k + by) * cell,
                            world.edges,
                            world.walls.circle,
                        )
                        for k in range(RASTER)
                    ]
                    for i in range(RASTER)
                ]
            )
            for by in (0.5, 0.0)
        )
        wide = np.pad(others, CELLS)
        for i in range(CELLS):
            for k in range(CELLS):
                row, column = i + 1 - CELLS // 2 + CELLS, k + 1 - CELLS // 2 + CELLS
                both = ones & wide[row : row + RASTER, column : column + RASTER]
                picture, count = ndimage.label(both, np.ones((3, 3)))
                if count > 1:
                    which[i, k] = len(pictures)
                    pictures.append(np.minimum(picture, PARTS).astype(np.int8))
    return which, np.array(pictures or [np.zeros((RASTER, RASTER), dtype=np.int8)]), low


@kernel
def part_at(x, y, row, column, cell, which, pictures, low):
    """Return the part that a place of the first particle belongs to, from 1; 0 if none is near."""
    if which[row, column] < 0:
        return 1
    picture = pictures[which[row, column]]
    i, k = int((x - low[0]) / cell), int((y - low[1]) / cell)
    part, least = 0, np.inf
    for a in range(max(i - NEIGHBOURS, 0), min(i + NEIGHBOURS + 1, RASTER)):
        for b in range(max(k - NEIGHBOURS, 0), min(k + NEIGHBOURS + 1, RASTER)):
            away = ((a + 0.5) * cell + low[0] - x) ** 2 + ((b + 0.5) * cell + low[1] - y) ** 2
            if picture[a, b] and away < least:
                part, least = picture[a, b], away
    return part


@kernel
def search(start, goal, near, friction, places, normals, edges, circle, cell, which, pictures, low):
    """Return the number of presses to the first difference within ``near`` of the goals', or -1, and
    the least distance from it of all differences reached, in the part of the goals.
    """
    n = CELLS
    seen = np.full((n, n, PARTS + 1), -1, dtype=np.int32)
    queue = np.empty((n * n * 2, 2))
    parts = np.empty(n * n * 2, dtype=np.int64)
    goal_x, goal_y = goal[1, 0] - goal[0, 0], goal[1, 1] - goal[0, 1]
    queue[0] = start[1] - start[0]
    row, column = int(queue[0, 0] / cell + n / 2), int(queue[0, 1] / cell + n / 2)
    parts[0] = part_at(start[0, 0], start[0, 1], row, column, cell, which, pictures, low)
    seen[row, column, parts[0]] = 0
    head, tail, least = 0, 1, np.inf
    while head < tail:
        x, y, part = queue[head, 0], queue[head, 1], parts[head]
        row, column = int(x / cell + n / 2), int(y / cell + n / 2)
        depth = seen[row, column, part]
        head += 1
        away = np.sqrt((x - goal_x) ** 2 + (y - goal_y) ** 2)
        if away < least:
            at_goal = part_at(goal[0, 0], goal[0, 1], row, column, cell, which, pictures, low)
            if at_goal == 0 or at_goal == part:
                least = away
        if least <= near:
            return depth, least
        if depth >= MOST:
            continue
        for place in range(places.shape[0]):
            for sign in (-1.0, 1.0):  # of the change of the difference by the particle that moves
                wall_x, wall_y = places[place, 0], places[place, 1]
                if not is_inside(wall_x + sign * x, wall_y + sign * y, edges, circle):
                    continue
                first_x, first_y = wall_x, wall_y
                if sign < 0:
                    first_x, first_y = wall_x - x, wall_y - y
                here = part_at(first_x, first_y, row, column, cell, which, pictures, low)
                if here != part:
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
                        i, j = int(to_x / cell + n / 2), int(to_y / cell + n / 2)
                        first_x, first_y = wall_x, wall_y
                        if sign < 0:
                            first_x, first_y = wall_x - to_x, wall_y - to_y
                        into = part_at(first_x, first_y, i, j, cell, which, pictures, low)
                        if into and seen[i, j, into] < 0 and tail < len(queue):
                            seen[i, j, into] = depth + 1
                            queue[tail, 0], queue[tail, 1] = to_x, to_y
                            parts[tail] = into
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
    world, cell = world_of(problem.world()), 2.2 * size / CELLS
    start, goal = problem.endpoints(0)
    presses, least = search(
        np.ascontiguousarray(start),
        np.ascontiguousarray(goal),
        2 * within * size,
        min(float(friction), STEEPEST),
        *pressing.holding_places(problem.place, SPACING),
        world.edges,
        world.walls.circle,
        cell,
        *parts_of(problem, cell),
    )
    return Reach(int(presses), float(least) / size)
