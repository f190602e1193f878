"""Particles in a region with obstacles, slow and obvious: exact fractions, one particle, one event
at a time.

Written apart from src/shoal/steering, which it checks. A region is a list of rings of corners, the
free side on the left. There are no tolerances: who is on an edge is exactly on it.
"""

from __future__ import annotations

from fractions import Fraction


def exact(point):
    return Fraction(point[0]), Fraction(point[1])


def rings_of(outline, obstacles):
    """Exact rings, the outline counter-clockwise and the obstacles clockwise."""
    rings = [[exact(corner) for corner in ring] for ring in (outline, *obstacles)]
    return [ring if (area(ring) > 0) == (k == 0) else ring[::-1] for k, ring in enumerate(rings)]


def area(ring):
    return sum(cross(ring[k - 1], ring[k]) for k in range(len(ring)))


def cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


def minus(a, b):
    return a[0] - b[0], a[1] - b[1]


def along(point, move, share):
    return point[0] + share * move[0], point[1] + share * move[1]


def leaves(edge, move):
    """Tell whether a move leads to the left of an edge, strictly."""
    return cross(minus(edge[1], edge[0]), move) > 0


def is_between(point, a, b):
    """Tell whether a point is on the edge from a to b, not at its ends."""
    way, gone = minus(b, a), minus(point, a)
    share = gone[0] * way[0] + gone[1] * way[1]
    return cross(way, gone) == 0 and 0 < share < way[0] ** 2 + way[1] ** 2


def is_held(rings, point, move):
    """The tangent-cone rule, ring by ring."""
    for ring in rings:
        for k, corner in enumerate(ring):
            before, after = (ring[k - 1], corner), (corner, ring[(k + 1) % len(ring)])
            if point == corner:
                turn = cross(minus(*before[::-1]), minus(*after[::-1]))
                free = [leaves(before, move), leaves(after, move)]
                if not (any(free) if turn < 0 else all(free)):
                    return True
            elif is_between(point, *after) and not leaves(after, move):
                return True
    return False


def shares_met(rings, point, move):
    """The shares of a move after which the point is on some edge, in order."""
    shares = set()
    for ring in rings:
        for a, b in zip(ring, [*ring[1:], ring[0]], strict=True):
            way, gap = minus(b, a), minus(a, point)
            both = cross(move, way)
            if both != 0:
                share, place = cross(gap, way) / both, cross(gap, move) / both
                if 0 < share <= 1 and 0 <= place <= 1:
                    shares.add(share)
            elif cross(gap, move) == 0:  # along the line of the edge: its ends
                for end in (a, b):
                    there = minus(end, point)
                    share = (there[0] * move[0] + there[1] * move[1]) / (
                        move[0] ** 2 + move[1] ** 2
                    )
                    if 0 < share <= 1:
                        shares.add(share)
    return sorted(shares)


def step_one(rings, point, move):
    """Where one particle is after one move."""
    if move == (0, 0) or is_held(rings, point, move):
        return point
    for share in shares_met(rings, point, move):
        place = along(point, move, share)
        if is_held(rings, place, move):
            return place
    return along(point, move, Fraction(1))


def step(rings, points, move):
    return [step_one(rings, point, move) for point in points]
