"""Two particles and walls, slow and obvious: one particle, one move, one wall at a time, in plain
numbers.

Written apart from src/shoal/steering, which it checks. A space is a list of walls: ("line", nx, ny,
offset) with inside where nx x + ny y >= offset, or ("circle", cx, cy, r).
"""

from __future__ import annotations

from math import hypot, sqrt

NEAR = 1e-9


def lines_of(corners):
    """The walls of a polygon given counter-clockwise."""
    walls = []
    for (ax, ay), (bx, by) in zip(corners, [*corners[1:], corners[0]], strict=True):
        length = hypot(bx - ax, by - ay)
        nx, ny = (ay - by) / length, (bx - ax) / length
        walls.append(("line", nx, ny, nx * ax + ny * ay))
    return walls


def distance(wall, point):
    """Distance of a point to a wall, negative outside."""
    x, y = point
    if wall[0] == "line":
        return wall[1] * x + wall[2] * y - wall[3]
    return wall[3] - hypot(x - wall[1], y - wall[2])


def normal(wall, point):
    """Inward normal of a wall at a point on it."""
    if wall[0] == "line":
        return wall[1], wall[2]
    away = hypot(point[0] - wall[1], point[1] - wall[2])
    return (wall[1] - point[0]) / away, (wall[2] - point[1]) / away


def is_held(walls, point, move, size):
    length = hypot(*move)
    for wall in walls:
        if distance(wall, point) <= NEAR * size:
            nx, ny = normal(wall, point)
            if nx * move[0] + ny * move[1] <= NEAR * length:
                return True
    return False


def share_until(wall, point, move):
    """The share of a move at which a point inside meets a wall; more than 1 if it does not."""
    if wall[0] == "line":
        speed = wall[1] * move[0] + wall[2] * move[1]
        return max(distance(wall, point), 0.0) / -speed if speed < -NEAR * hypot(*move) else 2.0
    x, y, r = point[0] - wall[1], point[1] - wall[2], wall[3]
    a, b, c = (
        move[0] ** 2 + move[1] ** 2,
        x * move[0] + y * move[1],
        min(x * x + y * y - r * r, 0.0),
    )
    return (-b + sqrt(b * b - a * c)) / a


def step(walls, points, move, size):
    """Where the particles are after one move."""
    after = []
    for point in points:
        if not any(move) or is_held(walls, point, move, size):
            after.append(tuple(point))
            continue
        share = min(1.0, *(share_until(wall, point, move) for wall in walls))
        after.append((point[0] + share * move[0], point[1] + share * move[1]))
    return after


def velocity_with_friction(walls, point, move, size, friction):
    """How a particle follows a move where a push into a wall slides, and the wall it slides along,
    if any.
    """
    length = hypot(*move)
    on = [(wall, normal(wall, point)) for wall in walls if distance(wall, point) <= NEAR * size]
    pushed = [
        (wall, (nx, ny)) for wall, (nx, ny) in on if nx * move[0] + ny * move[1] <= NEAR * length
    ]
    if not pushed:
        return tuple(move), None
    for wall, (nx, ny) in pushed:
        push = -(nx * move[0] + ny * move[1])
        along = (move[0] + push * nx, move[1] + push * ny)
        speed = hypot(*along)
        left = speed - friction * max(push, 0.0)
        if left > NEAR * length:
            velocity = (along[0] * left / speed, along[1] * left / speed)
            if all(
                ox * velocity[0] + oy * velocity[1] >= -NEAR * length
                for other, (ox, oy) in on
                if other is not wall
            ):
                return velocity, wall
    return (0.0, 0.0), None


def step_with_friction(walls, points, move, size, friction):
    """Where the particles are after one move, between walls with friction; along a circle by short
    chords.
    """
    after = []
    for start in points:
        point = start
        left = 1.0
        while left > 0 and any(move):
            velocity, sliding = velocity_with_friction(walls, point, move, size, friction)
            if not any(velocity):
                break
            share = min(
                left,
                *(share_until(wall, point, velocity) for wall in walls if wall is not sliding),
                left,
            )
            if sliding and sliding[0] == "circle":
                share = min(share, 1e-3 * size / hypot(*velocity))
            point = point[0] + share * velocity[0], point[1] + share * velocity[1]
            if sliding:
                (nx, ny), over = normal(sliding, point), distance(sliding, point)
                point = point[0] - over * nx, point[1] - over * ny
            left -= share
        after.append(tuple(point))
    return after
