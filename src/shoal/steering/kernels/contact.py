"""Motion of one particle between walls for one straight move of the shared input.

Walls are flat, or a circle around the first two coordinates.
"""

from __future__ import annotations

from math import expm1, inf, log1p, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel

TOUCH = 1e-9  # fraction of the workspace size: a particle closer to a wall touches the wall
# fraction of the length of a move: if a move leads off a wall by less, the wall holds the particle
PUSHED = 1e-9
EVENTS = 4096  # most events in one move: wall contacts and short steps along the circle
SLOW = 1e-14  # the kernels ignore smaller relative changes of the gain along a path
ARC = 1 / 400  # fraction of the radius: length of one step of a slide along the circle


class Walls(NamedTuple):
    """The walls between which particles move, and how far an input moves them."""

    normals: NDArray[np.float64]  # (walls, d): inward
    offsets: NDArray[np.float64]  # (walls,): a point p is inside if normals @ p >= offsets
    circle: NDArray[np.float64]  # (3,): x, y, radius; the radius is 0 without a round wall
    size: float  # of the workspace; a particle touches a wall within TOUCH times the size
    friction: float
    gain: NDArray[np.float64]
    """(d + 1,): (g, gx, gy, ...), if a particle at p moves by g + (gx, gy, ...)·p times the
    input."""
    pushed: float = PUSHED
    """Fraction of a move: a wall holds a particle unless the move leads off it by more."""


@in_place_kernel
def norm(vector):
    total = 0.0
    for i in range(vector.shape[0]):
        total += vector[i] * vector[i]
    return sqrt(total)


@in_place_kernel
def dot(u, v):
    total = 0.0
    for i in range(u.shape[0]):
        total += u[i] * v[i]
    return total


@in_place_kernel
def circle_distance(point, circle):
    return circle[2] - sqrt((point[0] - circle[0]) ** 2 + (point[1] - circle[1]) ** 2)


@in_place_kernel
def touches(point, wall, walls, near):
    """Return whether the distance of a particle from a wall is at most ``near``.

    The wall index after the last flat wall means the circle.
    """
    if wall == walls.normals.shape[0]:
        return walls.circle[2] > 0 and circle_distance(point, walls.circle) <= near
    return dot(walls.normals[wall], point) - walls.offsets[wall] <= near


@in_place_kernel
def normal_part(point, wall, walls, i):
    """Return coordinate ``i`` of a wall's inward normal at a point. At the centre of the circle,
    the circle's normal is zero.
    """
    if wall < walls.normals.shape[0]:
        return walls.normals[wall, i]
    away = walls.circle[2] - circle_distance(point, walls.circle)
    return (walls.circle[i] - point[i]) / away if i < 2 and away > 0 else 0.0


@in_place_kernel
def inward(point, wall, vector, walls):
    """Return the component of a vector along a wall's inward normal at a point."""
    total = 0.0
    for i in range(vector.shape[0]):
        total += normal_part(point, wall, walls, i) * vector[i]
    return total


@in_place_kernel
def is_held(point, move, walls):
    """Return whether a wall that the particle touches would prevent the move if the friction were
    infinite.
    """
    near, most = TOUCH * walls.size, walls.pushed * norm(move)
    for wall in range(walls.normals.shape[0] + 1):
        if touches(point, wall, walls, near) and inward(point, wall, move, walls) <= most:
            return True
    return False


@in_place_kernel
def velocity_at(point, move, walls, velocity):
    """Write to ``velocity`` the velocity of a particle per unit of input.

    Return the wall along which the particle slides, -1 if the particle is free, and -2 if walls
    hold the particle. A particle pushed into a wall slides by ``along - friction * into``, where
    ``along`` and ``into`` are the components of the move along and into the wall. The particle does
    not slide if this number is negative, or if another wall blocks the slide.
    """
    for i in range(move.shape[0]):
        velocity[i] = move[i]
    if not is_held(point, move, walls):
        return -1
    if walls.friction == inf:
        return -2
    count, near, least = walls.normals.shape[0] + 1, TOUCH * walls.size, PUSHED * norm(move)
    for wall in range(count):
        if not touches(point, wall, walls, near):
            continue
        push = inward(point, wall, move, walls)
        if push > walls.pushed * norm(move):
            continue
        for i in range(move.shape[0]):
            velocity[i] = move[i] - push * normal_part(point, wall, walls, i)
        along = norm(velocity)
        speed = along - walls.friction * max(-push, 0.0)
        if speed <= least:
            continue
        for i in range(move.shape[0]):
            velocity[i] *= speed / along
        free = True
        for other_wall in range(count):
            if (
                other_wall != wall
                and touches(point, other_wall, walls, near)
                and inward(point, other_wall, velocity, walls) < -least
            ):
                free = False
        if free:
            return wall
    return -2


@in_place_kernel
def first_contact(point, velocity, walls, sliding):
    """Return how far a particle can move before it meets a wall, in multiples of ``velocity``, and
    the index of this wall.

    The function ignores the wall ``sliding``, along which the particle slides.
    """
    normals, offsets, circle = walls.normals, walls.offsets, walls.circle
    length = norm(velocity)
    share, met = inf, -1
    for wall in range(normals.shape[0]):
        speed = dot(normals[wall], velocity)
        if wall != sliding and speed < -PUSHED * length:
            candidate = max(dot(normals[wall], point) - offsets[wall], 0.0) / -speed
            if candidate < share:
                share, met = candidate, wall
    # |point + share velocity - centre| = radius is a share² + 2 b share + c = 0
    a = velocity[0] ** 2 + velocity[1] ** 2
    if circle[2] > 0 and a > 0 and sliding != normals.shape[0]:
        x, y = point[0] - circle[0], point[1] - circle[1]
        b = x * velocity[0] + y * velocity[1]
        c = min(x * x + y * y - circle[2] ** 2, 0.0)
        root = sqrt(b * b - a * c)
        # Of the two formulas for the larger root, this code uses the one that never subtracts
        # almost equal numbers.
        candidate = (root - b) / a if b <= 0 else -c / (b + root)
        if candidate < share:
            share, met = candidate, normals.shape[0]
    return share, met


@in_place_kernel
def input_for(share, speed, rate):
    """Return the fraction of the input that moves a particle by ``share`` times its velocity
    vector.

    ``speed`` is the gain at the start of the path. On a path of the length of the velocity vector,
    the gain changes by ``rate``.
    """
    grown = share * rate / speed
    if abs(grown) < SLOW:
        return share / speed
    return log1p(grown) / rate if grown > -1 else inf


@in_place_kernel
def share_for(share, speed, rate):
    """Return how far the fraction ``share`` of the input moves a particle, in multiples of its
    velocity. Inverse of `input_for`.
    """
    return speed * share if abs(rate * share) < SLOW else speed / rate * expm1(rate * share)


@in_place_kernel
def snap(point, wall, walls):
    """Move a particle that has met a wall exactly onto the wall."""
    normals, circle = walls.normals, walls.circle
    if wall == normals.shape[0]:
        x, y = point[0] - circle[0], point[1] - circle[1]
        scale = circle[2] / sqrt(x * x + y * y)
        point[0], point[1] = circle[0] + scale * x, circle[1] + scale * y
    elif wall >= 0:
        over = dot(normals[wall], point) - walls.offsets[wall]
        for i in range(point.shape[0]):
            point[i] -= over * normals[wall, i]


@in_place_kernel
def advance(point, move, walls, velocity):
    """Move one particle in place. Return the fraction of the input after which a wall first held or
    braked the particle, or 1.

    The result is 1 if the particle was free during the whole move. The array ``velocity`` is
    working memory.
    """
    if norm(move) == 0:
        return 1.0
    gain, radius = walls.gain, walls.circle[2]
    remaining, free_until, on_circle = 1.0, -1.0, walls.normals.shape[0]
    for _event in range(EVENTS):
        wall = velocity_at(point, move, walls, velocity)
        if wall != -1 and free_until < 0:
            free_until = 1.0 - remaining
        if wall == -2:
            return free_until
        speed, rate = gain[0], 0.0
        for i in range(point.shape[0]):
            speed += gain[1 + i] * point[i]
            rate += gain[1 + i] * velocity[i]
        share, met = first_contact(point, velocity, walls, wall)
        if wall == on_circle:  # along the circle in short straight steps
            step = ARC * radius / max(norm(velocity), 1e-300)
            if step < share:
                share, met = step, wall
        needed = input_for(share, speed, rate)
        if needed >= remaining:
            distance = share_for(remaining, speed, rate)
            for i in range(point.shape[0]):
                point[i] += distance * velocity[i]
            if wall >= 0:
                snap(point, wall, walls)
            return 1.0 if free_until < 0 else free_until
        for i in range(point.shape[0]):
            point[i] += share * velocity[i]
        if wall >= 0:
            snap(point, wall, walls)
        snap(point, met, walls)
        remaining -= needed
        if walls.friction == inf:
            return 1.0 - remaining
    return free_until


@in_place_kernel
def advance_all(state, move, walls, velocity):
    """Move all particles in place. Return the smallest fraction of the input after which a wall
    first held or braked a particle.
    """
    least = 1.0
    for p in range(state.shape[0]):
        least = min(least, advance(state[p], move, walls, velocity))
    return least


@in_place_kernel
def advance_plans(states, plans, walls, velocity):
    """Make all moves of each plan with all particles of its state in place.

    ``states`` has shape (plans, particles, dimensions), ``plans`` (plans, moves, dimensions).
    """
    for k in range(plans.shape[0]):
        for m in range(plans.shape[1]):
            advance_all(states[k], plans[k, m], walls, velocity)


@in_place_kernel
def advance_worlds(states, moves, chosen, gains, walls, shares, velocity):
    """Move all particles of the worlds ``chosen`` in place. Each world has its own move and its own
    gain.

    Write the result of `advance` for each particle to ``shares``, shape (worlds, particles).
    """
    for k in range(chosen.shape[0]):
        world = chosen[k]
        own = Walls(
            walls.normals,
            walls.offsets,
            walls.circle,
            walls.size,
            walls.friction,
            gains[world],
            walls.pushed,
        )
        for p in range(states.shape[1]):
            shares[world, p] = advance(states[world, p], moves[world], own, velocity)


@in_place_kernel
def copy(source, target):
    """Copy a 2-D array to the first rows and columns of another 2-D array."""
    for i in range(source.shape[0]):
        for k in range(source.shape[1]):
            target[i, k] = source[i, k]
