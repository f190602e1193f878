"""One particle between walls: where one straight move of the shared input takes it.

`Walls` are the rows of ``normals`` with inside where ``normals[w] @ p >= offsets[w]``, and the circle (x, y, radius) around the
first two coordinates, of radius 0 if there is none. ``gain`` is (g, gx, gy, ...): at p the particle moves by
``g + (gx, gy, ...) @ p`` times the input.
"""

from __future__ import annotations

from collections import namedtuple

import numpy as np

from shoal.jit import kernel

TOUCH = 1e-9  # of the size: who is nearer to a wall than this is on it
PUSHED = 1e-9  # of the length of a move: who is moved away from a wall by less than this is held
EVENTS = 4096  # walls met, and short steps along the circle, in one move
SLOW = 1e-14  # growth of the gain on the way that is as good as none
ARC = 1 / 400  # of the radius: steps of a slide along the circle

Walls = namedtuple("Walls", "normals offsets circle size friction gain")
"""What particles move between."""


@kernel
def norm(vector):
    total = 0.0
    for i in range(vector.shape[0]):
        total += vector[i] * vector[i]
    return np.sqrt(total)


@kernel
def dot(one, other):
    total = 0.0
    for i in range(one.shape[0]):
        total += one[i] * other[i]
    return total


@kernel
def circle_normal(point, circle, normal):
    """Write the inward normal of the circle at a point; zero at its centre."""
    x, y = circle[0] - point[0], circle[1] - point[1]
    away = np.sqrt(x * x + y * y)
    for i in range(normal.shape[0]):
        normal[i] = 0.0
    if away > 0:
        normal[0], normal[1] = x / away, y / away


@kernel
def circle_distance(point, circle):
    return circle[2] - np.sqrt((point[0] - circle[0]) ** 2 + (point[1] - circle[1]) ** 2)


@kernel
def touches(point, wall, normals, offsets, circle, near):
    """Tell whether a particle is nearer than ``near`` to a wall; the wall after the last flat one is the circle."""
    if wall == normals.shape[0]:
        return circle[2] > 0 and circle_distance(point, circle) <= near
    return dot(normals[wall], point) - offsets[wall] <= near


@kernel
def normal_at(point, wall, normals, circle, normal):
    if wall == normals.shape[0]:
        circle_normal(point, circle, normal)
    else:
        normal[:] = normals[wall]


@kernel
def is_held(point, move, walls):
    """Tell whether some wall that the particle is on does not let it follow the move, friction without end."""
    normals, offsets, circle, near = walls.normals, walls.offsets, walls.circle, TOUCH * walls.size
    length = norm(move)
    normal = np.empty(move.shape[0])
    for wall in range(normals.shape[0] + 1):
        if touches(point, wall, normals, offsets, circle, near):
            normal_at(point, wall, normals, circle, normal)
            if dot(normal, move) <= PUSHED * length:
                return True
    return False


@kernel
def velocity_at(point, move, walls, velocity):
    """Write how a particle follows the input; return the wall it slides along, -1 if it is free and -2 if it is held.

    Pushed into a wall it slides by ``|T u| - friction |N u|`` along T, the direction of the move along the wall, if that is more
    than nothing and no other wall that it is on is in the way.
    """
    length, pushes = norm(move), 0
    normal = np.empty(move.shape[0])
    velocity[:] = move
    normals, offsets, circle, friction = walls.normals, walls.offsets, walls.circle, walls.friction
    count, near = normals.shape[0] + 1, TOUCH * walls.size
    for wall in range(count):
        if touches(point, wall, normals, offsets, circle, near):
            normal_at(point, wall, normals, circle, normal)
            if dot(normal, move) <= PUSHED * length:
                pushes += 1
    if pushes == 0:
        return -1
    if friction == np.inf:
        return -2
    for wall in range(count):
        if not touches(point, wall, normals, offsets, circle, near):
            continue
        normal_at(point, wall, normals, circle, normal)
        push = dot(normal, move)
        if push > PUSHED * length:
            continue
        along = 0.0
        for i in range(move.shape[0]):
            velocity[i] = move[i] - push * normal[i]
            along += velocity[i] * velocity[i]
        along = np.sqrt(along)
        left = along - friction * max(-push, 0.0)
        if left <= PUSHED * length:
            continue
        for i in range(move.shape[0]):
            velocity[i] *= left / along
        free = True
        for other in range(count):
            if other != wall and touches(point, other, normals, offsets, circle, near):
                normal_at(point, other, normals, circle, normal)
                if dot(normal, velocity) < -PUSHED * length:
                    free = False
        if free:
            return wall
    return -2


@kernel
def first_contact(point, velocity, walls, sliding):
    """Return how many times ``velocity`` a particle can go before it meets a wall other than ``sliding``, and that wall."""
    normals, offsets, circle = walls.normals, walls.offsets, walls.circle
    length = norm(velocity)
    share, met = np.inf, -1
    for wall in range(normals.shape[0]):
        speed = dot(normals[wall], velocity)
        if wall != sliding and speed < -PUSHED * length:
            found = max(dot(normals[wall], point) - offsets[wall], 0.0) / -speed
            if found < share:
                share, met = found, wall
    a = velocity[0] ** 2 + velocity[1] ** 2
    if circle[2] > 0 and a > 0 and sliding != normals.shape[0]:
        x, y = point[0] - circle[0], point[1] - circle[1]
        b = x * velocity[0] + y * velocity[1]
        c = min(x * x + y * y - circle[2] ** 2, 0.0)
        root = np.sqrt(b * b - a * c)
        # Of the two forms of the larger root the one that does not subtract nearly equal numbers.
        found = (root - b) / a if b <= 0 else -c / (b + root)
        if found < share:
            share, met = found, normals.shape[0]
    return share, met


@kernel
def input_for(share, speed, rate):
    """Return the share of an input that takes a particle ``share`` times it far; ``speed`` grows by ``rate`` times the way."""
    grown = share * rate / speed
    if abs(grown) < SLOW:
        return share / speed
    return np.log1p(grown) / rate if grown > -1 else np.inf


@kernel
def way_of(share, speed, rate):
    """Return how far a share of an input takes a particle, in times of the input; the inverse of `input_for`."""
    return speed * share if abs(rate * share) < SLOW else speed / rate * np.expm1(rate * share)


@kernel
def snap(point, wall, walls):
    """Put a particle that has met a wall exactly onto it."""
    normals, circle = walls.normals, walls.circle
    if wall == normals.shape[0]:
        x, y = point[0] - circle[0], point[1] - circle[1]
        scale = circle[2] / np.sqrt(x * x + y * y)
        point[0], point[1] = circle[0] + scale * x, circle[1] + scale * y
    elif wall >= 0:
        over = dot(normals[wall], point) - walls.offsets[wall]
        for i in range(point.shape[0]):
            point[i] -= over * normals[wall, i]


@kernel
def advance(point, move, walls):
    """Move one particle, in place; return the share of the input after which it first stopped being free, 1 if it never did."""
    if norm(move) == 0:
        return 1.0
    velocity, gain, radius = np.empty(move.shape[0]), walls.gain, walls.circle[2]
    left, free_until, on_circle = 1.0, -1.0, walls.normals.shape[0]
    for _event in range(EVENTS):
        wall = velocity_at(point, move, walls, velocity)
        if wall != -1 and free_until < 0:
            free_until = 1.0 - left
        if wall == -2:
            return free_until
        speed = gain[0] + dot(gain[1:], point)
        rate = dot(gain[1:], velocity)
        share, met = first_contact(point, velocity, walls, wall)
        if wall == on_circle:  # along the circle in short straight steps
            step = ARC * radius / max(norm(velocity), 1e-300)
            if step < share:
                share, met = step, wall
        needed = input_for(share, speed, rate)
        if needed >= left:
            way = way_of(left, speed, rate)
            for i in range(point.shape[0]):
                point[i] += way * velocity[i]
            if wall >= 0:
                snap(point, wall, walls)
            return 1.0 if free_until < 0 else free_until
        for i in range(point.shape[0]):
            point[i] += share * velocity[i]
        if wall >= 0:
            snap(point, wall, walls)
        snap(point, met, walls)
        left -= needed
        if walls.friction == np.inf:
            return 1.0 - left
    return free_until
