"""Single cycles: one wall contact and one adjustment, which bring the position difference as near as possible to a target."""

from __future__ import annotations

from math import inf, pi
from typing import NamedTuple

import numpy as np

from shoal.core.dataclass import one_line
from shoal.steering.kernels.cycles import nearest_on_circle, nearest_on_polygon
from shoal.steering.planners.chains.chain import ChainQuery
from shoal.steering.workspaces.convex_geometry import Points
from shoal.steering.workspaces.normalized_walls import NormalizedWalls


class Cycle(NamedTuple):
    """One wall contact and one adjustment by the other particle, in the units of `NormalizedWalls`.

    Attributes
    ----------
    distance : float
        Distance from the position difference after the cycle to the target difference.
    toucher : int
        Index, 0 or 1, of the particle that the wall holds.
    wall : int
        Index of the wall that holds the touching particle.
    low, high : float
        Ends of the interval of possible contacts, as positions along the wall.
    after : ndarray of float64, shape (2,)
        The position difference of the particles after the cycle.
    """

    distance: float
    toucher: int
    wall: int
    low: float
    high: float
    after: Points

    def __repr__(self) -> str:
        return one_line(self)

    def contact(self, walls: NormalizedWalls, point: Points) -> tuple[float, Points]:
        """Return the possible contact nearest to ``point``: its position along the wall, and its coordinates."""
        if self.wall == len(walls.normals):
            angle = self.low / walls.circle[2]
            return self.low, walls.circle[2] * np.array([np.cos(angle), np.sin(angle)])
        middle, along = walls.frames[self.wall]
        place = float(np.clip((point - middle) @ along, self.low, self.high))
        return place, middle + place * along


def nearest_cycles(query: ChainQuery, delta: Points, target: Points) -> list[Cycle]:
    """Return, for each wall and touching particle, the cycle in the plane that ends nearest to the position difference ``target``.

    Notes
    -----
    Source: algorithms 2 and 3 of paper W, corrected and extended to friction. On a disk, a contact of particle 2 on the opposite
    side can replace each contact of particle 1.
    """
    if query.walls.round:
        radius = query.walls.circle[2]
        after = np.zeros(2)
        distance, angle = nearest_on_circle(delta, target, query.model(), np.empty((9, 2)), np.empty(2), after)
        along = [radius * float(angle + pi * toucher) for toucher in (0, 1)]
        return [Cycle(float(distance), k, 0, along[k], along[k], after) for k in (0, 1) if distance < inf]
    walls = query.walls.sides
    found, corners, spare = np.empty((walls, 2, 5)), np.empty((2 * walls + 16, 2)), np.empty((2 * walls + 16, 2))
    nearest_on_polygon(delta, target, query.model(), corners, spare, np.empty(2), found)
    return [
        Cycle(distance, int(k), int(wall), low, high, found[wall, k, 3:])
        for wall, k in np.argwhere(found[..., 0] < inf)
        for distance, low, high in [found[wall, k, :3].tolist()]
    ]
