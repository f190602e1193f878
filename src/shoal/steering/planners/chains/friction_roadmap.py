"""Nodes of a roadmap of position differences, for a disk with friction.

There are two kinds of nodes. Nodes of the first kind are the shortest position differences from which one, two, three and more
cycles lead to the goals. Nodes of the second kind lie on a path to the goals along which the position difference turns and becomes
shorter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.steering.contact.friction_limits import turn_on_the_way
from shoal.steering.workspaces.convex_geometry import Points

MOST_CYCLES = 500
CONTACTS, TILTS = 129, 9  # number of contacts and directions in the search for the next node
LEAST = 1e-3  # relative to the radius: smaller differences are not needed
SAME = 1e-9
BETWEEN = 300  # number of differences on a path around the centre


def backward_nodes(after: Points, *, radius: float, friction: float, margin: float) -> Points:
    """Return the shortest position differences from which 1, 2, 3, ... cycles reach ``after``; float64, shape (nodes, 2).

    Each cycle can turn the position difference to the left or to the right by the same angle. The nodes belong to chains of two
    kinds: chains that always turn to the same side, and chains that turn left and right alternately.
    """
    cone = float(np.arctan(friction)) * (1 - 1e-6)
    sizes, turns = [float(np.hypot(*after))], list[float]()
    for _cycle in range(MOST_CYCLES):
        size, turn = _smallest_before(sizes[-1], radius, cone, margin)
        if not size < sizes[-1] * (1 - SAME):
            break
        sizes.append(size)
        turns.append(turn)
        if size < LEAST * radius:
            break
    nodes = []
    signs = (-1.0) ** np.arange(len(turns))
    for side in (np.ones(len(turns)), -np.ones(len(turns)), signs, -signs):
        angles = np.arctan2(after[1], after[0]) + np.cumsum(side * turns)
        nodes.append(np.array(sizes[1:])[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1))
    return np.concatenate(nodes)


def _smallest_before(size: float, radius: float, cone: float, margin: float) -> tuple[float, float]:
    """Return length and angle of the shortest position difference that one cycle can change to length ``size`` and angle 0."""
    inner = radius - margin
    half = np.arccos(min(1.0, (radius**2 + size**2 - inner**2) / (2 * radius * size)))
    contact = np.pi + half * (1 - SAME) * np.linspace(-1, 1, CONTACTS)[:, None]
    way = contact + cone * np.linspace(-1, 1, TILTS)
    x, y = radius * np.cos(contact) + size, radius * np.sin(contact)  # depth of the other particle at the end
    along = x * np.cos(way) + y * np.sin(way)
    room = along + np.sqrt(np.maximum(along**2 - (x**2 + y**2 - inner**2), 0.0))
    back = np.clip(size * np.cos(way), 0.0, np.maximum(room, 0.0))
    before_x, before_y = size - back * np.cos(way), -back * np.sin(way)
    sizes = np.hypot(before_x, before_y)
    best = np.unravel_index(int(np.argmin(sizes)), sizes.shape)
    return float(sizes[best]), float(np.arctan2(before_y[best], before_x[best]))


def turning_nodes(before: Points, after: Points, *, radius: float, friction: float) -> Points:
    """Return position differences on a path from ``before`` to ``after`` that turns and becomes shorter; shape (nodes, 2).

    The result is empty if ``after`` is not shorter than ``before``, if friction prevents a path to ``after``, or if the position
    difference could turn without becoming shorter.
    """
    large, small = float(np.hypot(*before)), float(np.hypot(*after))
    most = float(np.arctan(friction))
    begin = float(np.arctan2(before[1], before[0]))
    turn = (float(np.arctan2(after[1], after[0])) - begin + np.pi) % (2 * np.pi) - np.pi
    if small >= large or not abs(turn) <= turn_on_the_way(large, small, radius, most) < np.inf:
        return np.zeros((0, 2))
    low, cone = 0.0, most
    for _halving in range(60):
        middle = (low + cone) / 2
        low, cone = (middle, cone) if turn_on_the_way(large, small, radius, middle) < abs(turn) else (low, middle)
    angles = np.linspace(np.arccos(large / (2 * radius)), np.arccos(small / (2 * radius)), BETWEEN + 2)[1:-1]
    sizes: NDArray[np.float64] = 2 * radius * np.cos(angles)
    whole = turn_on_the_way(large, small, radius, cone)
    bends = begin + np.array([turn_on_the_way(large, float(size), radius, cone) for size in sizes]) * (turn / whole)
    return np.asarray(sizes[:, None] * np.stack([np.cos(bends), np.sin(bends)], axis=1))
