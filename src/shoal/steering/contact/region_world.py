"""RegionWorld: motion of particles under one shared displacement, in a region with obstacles."""

from __future__ import annotations

from functools import cached_property
from math import ceil, inf, sqrt

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.steering.contact.world import SteeringWorld
from shoal.steering.kernels import region_contact as kernels
from shoal.steering.workspaces.base import TOUCH
from shoal.steering.workspaces.convex_geometry import Points
from shoal.steering.workspaces.region import Region


@dataclass(frozen=True, eq=False)
class RegionWorld(SteeringWorld):
    """The dynamics of particles under one shared displacement, in a region of any shape whose walls hold particles.

    If the displacement u satisfies ``N u <= 0``, an edge with the inward normal N holds each particle that touches the edge. At a
    corner with less than 180 degrees of free space, each of the two edges alone can hold a particle. At a corner with more than 180
    degrees of free space, such as most corners of obstacles, the two edges hold a particle only together, because otherwise the
    space in the direction of the displacement is free. During a straight move, a particle stops at the first edge that holds the
    particle, and stays at this edge until the end of the move. Particles do not collide with each other.

    Parameters
    ----------
    workspace : Region
    touch : float
        Contact tolerance, as a fraction of the workspace's size: a particle at most this far from an edge touches the edge.

    Notes
    -----
    Source: an extension by Shoal, after the outlook of paper W, section VIII. In a convex region, the dynamics follow equation 1 of
    paper W, section III.

    Examples
    --------
    >>> from shoal.steering import region
    >>> yard = region([(0, 0), (4, 0), (4, 4), (0, 4)], [[(1, 1), (2, 1), (2, 2), (1, 2)]])
    >>> RegionWorld(yard).step([(0.5, 1.5), (0.5, 0.5)], (2.0, 0.0)).tolist()
    [[1.0, 1.5], [2.5, 0.5]]
    >>> RegionWorld(yard).step([(1.0, 1.0), (1.5, 1.0)], (0.25, -0.5)).tolist()
    [[1.25, 0.5], [1.75, 0.5]]
    """

    workspace: Region
    touch: float = TOUCH

    friction = inf

    @cached_property
    def edges(self) -> kernels.Edges:
        """The edges of the region, as arrays for the compiled functions."""
        edges = np.ascontiguousarray(self.workspace.edges)
        along = edges[:, 2:] - edges[:, :2]
        lengths = np.hypot(*along.T)
        normals = np.stack([-along[:, 1], along[:, 0]], axis=1) / lengths[:, None]
        links = np.empty((len(edges), 2), dtype=np.int64)
        first = 0
        for ring in self.workspace.rings:
            places = first + np.arange(len(ring))
            links[places] = np.stack([np.roll(places, 1), np.roll(places, -1)], axis=1)
            first += len(ring)
        before = along[links[:, 0]]
        reflex = before[:, 0] * along[:, 1] - before[:, 1] * along[:, 0] < 0
        size = float(self.workspace.size) * self.touch / TOUCH
        return kernels.Edges(edges, normals, lengths, links, reflex, size, _boxes_of_runs(edges))

    def is_held(self, point: Points, move: Points) -> bool:
        """Return whether an edge holds a particle at ``point`` at the start of the displacement ``move``."""
        return bool(kernels.is_held(point, move, *self.edges))

    def final(self, points: Points, moves: Points) -> Points:
        """Return the positions of the particles after all moves, float64, shape (n, dimensions), without checks of the input."""
        state = np.array(points, dtype=np.float64, order="C")
        if len(moves):
            kernels.advance_plan(state, np.ascontiguousarray(moves, dtype=np.float64), self.edges)
        return state

    def moved(self, state: Points, move: Points) -> Points:
        """Apply the displacement ``move`` to the positions in the array ``state`` in place, without checks."""
        for point in state:
            kernels.advance(point, move, self.edges)
        return state


def _boxes_of_runs(edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the bounding box of each group of consecutive edges; float64, shape (groups, 4).

    The number of groups is about equal to the number of edges in a group.
    """
    runs = ceil(sqrt(len(edges)))
    length = -(-len(edges) // runs)
    ends = edges[np.minimum(np.arange(runs * length), len(edges) - 1)].reshape(runs, 2 * length, 2)
    return np.stack([ends.min(axis=1), ends.max(axis=1)], axis=2).reshape(runs, 4)
