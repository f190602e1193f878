"""Chains of wall contacts to almost antipodal (opposite) goals on a disk, planned backwards from the goals."""

from __future__ import annotations

from math import inf, pi

import numpy as np

from shoal.steering.planners.chains.chain import Chain, ChainQuery
from shoal.steering.planners.chains.search import shortest_chain

NEAR = 0.6  # relative to the diameter: longer differences are planned backwards
TURN = 0.9  # fraction of the largest turn that a cycle allows


def antipodal_chain(query: ChainQuery, *, cycles: int, sides: tuple[float, float] = (1.0, -1.0)) -> Chain | None:
    """Return a chain of wall contacts on a disk to a position difference that is nearly as long as the diameter of the disk.

    The result is None if the goals' distance is much shorter than the diameter of the disk, or if the chain would need more than
    ``cycles`` cycles.

    On a disk of radius r, one cycle can increase the distance D of the particles to sqrt(2 r D) at most. Such a cycle turns the
    position difference by acos(sqrt(D / (2 r))) radians to the left or to the right. The algorithm plans backwards from the goals.
    A cycle that ends at the distance E and turns by the angle t starts at the distance E cos t. The algorithm adds such cycles
    until the position difference before the earliest cycle is at most 0.6 times as long as the diameter of the disk. A chain of at
    most three other cycles leads from the start to this position difference. ``sides`` contains two signs, which the backward turns
    use alternately. A positive sign means a counter-clockwise turn.

    Notes
    -----
    Source: figure 15 in section VI of paper W, which shows that particles can approach antipodal goals but not reach them. Planning
    backwards is an addition by Shoal.
    """
    if query.walls.dimensions != 2:
        return None
    radius = query.walls.circle[2]
    far = 2 * radius - 2 * query.margin
    length, angle = float(np.hypot(*query.after)), float(np.arctan2(query.after[1], query.after[0]))
    if length <= NEAR * 2 * radius:
        return None
    steps, contacts = [(min(length, far), angle)], list[float]()
    while steps[-1][0] > NEAR * 2 * radius and len(steps) < cycles - 3:
        length, angle = steps[-1]
        turn = TURN * float(np.arccos(length / (2 * radius)))
        angle += sides[len(contacts) % 2] * turn
        contacts.append(angle + pi)
        shorter = length * float(np.cos(turn)) + 2 * query.push
        if shorter >= length:  # with such a push, no cycle reaches the difference
            return None
        steps.append((shorter, angle))
    first = steps[-1]
    if first[0] > NEAR * 2 * radius:
        return None
    bottom = first[0] * np.array([np.cos(first[1]), np.sin(first[1])])
    way = ChainQuery(
        query.walls,
        query.start,
        np.stack([-bottom / 2, bottom / 2]),
        friction=query.friction,
        margin=query.margin,
        push=query.push,
    )
    begun = shortest_chain(way, first_found=True)
    if begun is None:
        return None
    deltas = [
        *begun.differences(query.before, bottom)[1:],
        *(size * np.array([np.cos(a), np.sin(a)]) for size, a in steps[-2::-1]),
    ]
    along = np.concatenate([begun.unknowns[: begun.cycles], radius * np.array(contacts[::-1])])
    touchers = np.concatenate([begun.touchers, np.zeros(len(contacts), dtype=np.int64)])
    return Chain(touchers, np.zeros(len(touchers), dtype=np.int64), np.concatenate([along, *deltas[:-1]]), inf, last=deltas[-1])
