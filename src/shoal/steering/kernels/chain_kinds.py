"""Branch and bound over the kinds of chains: which particle touches which wall, in which order.

A kind is dropped by a lower bound of its length: a particle that touches walls goes at least to its goal mirrored in them; all that
changes the difference is a move while one particle is held. So with one toucher the length is at least its way plus |Dg - Ds|; with
both, half of the sum of both lengths and |Dg - Ds|.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import kernel
from shoal.steering.kernels.contact import dot


@kernel
def distance_between(one, other):
    total = 0.0
    for i in range(one.shape[0]):
        total += (one[i] - other[i]) ** 2
    return np.sqrt(total)


@kernel
def reflected(one, other, wall, shape):
    """Return the length of the shortest way from one point to the other over a wall; on the circle from many angles."""
    if wall < shape.normals.shape[0]:
        normal, offset = shape.normals[wall], shape.offsets[wall]
        high, low = dot(normal, one) - offset, dot(normal, other) - offset
        return np.sqrt(distance_between(one, other) ** 2 + 4 * max(high, 0.0) * max(low, 0.0))
    return over_circle(one, other, shape.circle)[0]


@kernel
def over_circle(one, other, circle):
    """Return the length of the shortest way over the circle and the angle of its contact.

    Descends from the best of a few angles and from the feet of both points: near the wall the way has narrow valleys there.
    """
    best, at = np.inf, 0.0
    climb = 0.0
    for i in range(2, one.shape[0]):
        climb += (one[i] - other[i]) ** 2
    starts = np.empty(3)
    starts[0] = np.arctan2(one[1] - circle[1], one[0] - circle[0])
    starts[1] = np.arctan2(other[1] - circle[1], other[0] - circle[0])
    for k in range(48):
        angle = 2 * np.pi * k / 48
        way = bent(one, other, circle, angle)
        if way < best:
            best, at = way, angle
    starts[2] = at
    for first in starts:
        angle, way = first, bent(one, other, circle, first)
        step = 2 * np.pi / 48
        for _halving in range(60):
            moved = False
            for turn in (-step, step):
                found = bent(one, other, circle, angle + turn)
                if found < way:
                    way, angle, moved = found, angle + turn, True
            if not moved:
                step *= 0.5
        if way < best:
            best, at = way, angle
    return np.sqrt(best * best + climb), at


@kernel
def bent(one, other, circle, angle):
    x, y = circle[0] + circle[2] * np.cos(angle), circle[1] + circle[2] * np.sin(angle)
    return np.sqrt((x - one[0]) ** 2 + (y - one[1]) ** 2) + np.sqrt((x - other[0]) ** 2 + (y - other[1]) ** 2)


@kernel
def reflected_lengths(start, goal, shape):
    """Return each particle's shortest way to its goal over each wall; shape (2, walls + 1), the last is the circle."""
    walls = shape.normals.shape[0]
    lengths = np.full((2, walls + 1), np.inf)
    for p in range(2):
        for wall in range(walls + (1 if shape.circle[2] > 0 else 0)):
            lengths[p, wall] = reflected(start[p], goal[p], wall, shape)
    return lengths


@kernel
def bound_of(touchers, walls, start, goal, lengths, shape):
    """Return a lower bound of the length of all chains of a kind, given what `reflected_lengths` returns."""
    d, normals, offsets = start.shape[1], shape.normals, shape.offsets
    apart = distance_between(start[1] - start[0], goal[1] - goal[0])
    used = np.zeros(2, dtype=np.bool_)
    least = np.zeros(2)
    for p in range(2):
        least[p] = distance_between(start[p], goal[p])
        image = goal[p].copy()
        flat = True
        for m in range(walls.shape[0] - 1, -1, -1):
            if touchers[m] != p:
                continue
            used[p] = True
            least[p] = max(least[p], lengths[p, walls[m]])
            if walls[m] < normals.shape[0]:
                over = 2 * (dot(normals[walls[m]], image) - offsets[walls[m]])
                for i in range(d):
                    image[i] -= over * normals[walls[m], i]
            else:
                flat = False
        if flat and used[p]:
            least[p] = max(least[p], distance_between(start[p], image))
    if used[0] and used[1]:
        return max((least[0] + least[1] + apart) / 2, least[0], least[1])
    return (least[0] if used[0] else least[1]) + apart


@kernel
def room_for(delta, sign, wall, reaches, shape):
    """Tell, quickly and generously, whether a toucher somewhere on a flat wall can have the other particle inside.

    The other's distance to each wall is linear in the contact, so its largest value over the frame's box must not be negative.
    """
    frame = shape.frames[wall]
    for other in range(shape.normals.shape[0]):
        normal = shape.normals[other]
        value = dot(normal, frame[0]) - shape.offsets[other] + sign * dot(normal, delta)
        for k in range(1, frame.shape[0]):
            value += reaches[wall] * abs(dot(normal, frame[k]))
        if value < -1e-9:
            return False
    return True


@kernel
def kinds_of(cycles, start, goal, reaches, shape, push, bound, lengths):
    """Return the kinds of chains of so many cycles over flat walls that may be shorter than a bound: touchers, walls and bounds."""
    before, after = start[1] - start[0], goal[1] - goal[0]
    options = 2 * shape.normals.shape[0]
    firsts, lasts = np.zeros(options, dtype=np.bool_), np.zeros(options, dtype=np.bool_)
    for option in range(options):
        wall, sign = option // 2, (1.0 if option % 2 == 0 else -1.0)
        normal = shape.normals[wall]
        firsts[option] = sign * dot(normal, before) > push and room_for(before, sign, wall, reaches, shape)
        lasts[option] = sign * dot(normal, after) > -1e-12 and room_for(after, sign, wall, reaches, shape)
    total = options**cycles
    touchers, walls = np.zeros(cycles, dtype=np.int64), np.zeros(cycles, dtype=np.int64)
    found = 0
    kept_touchers = np.zeros((64, cycles), dtype=np.int64)
    kept_walls, bounds = np.zeros((64, cycles), dtype=np.int64), np.zeros(64)
    number = 0
    while number < total:
        rest, jump = number, 1
        for m in range(cycles - 1, -1, -1):  # the last cycle changes fastest
            option = rest % options
            rest //= options
            touchers[m], walls[m] = option % 2, option // 2
        good = lasts[2 * walls[cycles - 1] + touchers[cycles - 1]]
        if not firsts[2 * walls[0] + touchers[0]]:
            good, jump = False, options ** (cycles - 1)
        for m in range(1, cycles):  # twice the same would be once
            if walls[m] == walls[m - 1] and touchers[m] == touchers[m - 1]:
                good = False
        if good:
            least = bound_of(touchers, walls, start, goal, lengths, shape)
            if least < bound:
                if found == bounds.shape[0]:
                    kept_touchers = np.concatenate((kept_touchers, np.zeros_like(kept_touchers)))
                    kept_walls = np.concatenate((kept_walls, np.zeros_like(kept_walls)))
                    bounds = np.concatenate((bounds, np.zeros_like(bounds)))
                kept_touchers[found], kept_walls[found], bounds[found] = touchers, walls, least
                found += 1
        number += jump
    order = np.argsort(bounds[:found])
    return kept_touchers[:found][order], kept_walls[:found][order], bounds[:found][order]
