"""A workspace as the arrays that kernels take, in units of its size around its centre."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from shoal.steering.kernels.chain_limits import Shape
from shoal.steering.workspaces.convex import ConvexWorkspace
from shoal.steering.workspaces.convex_geometry import Points

_FAR = 1e-3  # of the size: a wall that is farther from another one is not in the way there


@dataclass(frozen=True, eq=False)
class NormalizedWalls:
    """The flat walls and the circle of a workspace, scaled to size 1.

    Parameters
    ----------
    frames : ndarray of float64, shape (walls, d, d)
        The middle of each flat wall and d - 1 unit vectors along it.
    reaches : ndarray of float64, shape (walls,)
        Half of the largest extent of each flat wall along these.
    normals, offsets : ndarray of float64, shapes (walls, d) and (walls,)
    near : ndarray of bool, shape (walls + 1, walls)
        Which flat walls may be in the way of a contact along each other one and, in the last row, along the circle.
    circle : ndarray of float64, shape (3,)
        x, y and radius of the round wall; zeros if there is none.
    height : float
        Of a prism or cylinder.
    scale : float
        Length of the unit.
    origin : ndarray of float64, shape (d,)
        Where zero lies.
    base : NormalizedWalls or None
        Of a prism or cylinder: the walls of its base, in the plane.
    """

    frames: NDArray[np.float64]
    reaches: NDArray[np.float64]
    normals: NDArray[np.float64]
    offsets: NDArray[np.float64]
    near: NDArray[np.bool_]
    circle: NDArray[np.float64]
    height: float
    scale: float
    origin: Points
    base: NormalizedWalls | None = None

    @property
    def dimensions(self) -> int:
        """2 or 3."""
        return len(self.origin)

    @property
    def round(self) -> bool:
        """Whether there is a circle; it is the wall after the last flat one."""
        return bool(self.circle[2] > 0)

    @property
    def shape(self) -> Shape:
        """What the kernels of chains take."""
        return Shape(self.frames, self.normals, self.offsets, self.circle, self.near)

    def normalized(self, points: Points) -> Points:
        """Return points of the workspace in these units."""
        return np.ascontiguousarray((points - self.origin) / self.scale)

    def restored(self, points: Points) -> Points:
        """Return points in these units as those of the workspace."""
        return points * self.scale + self.origin


@lru_cache(maxsize=256)
def normalize_walls(workspace: ConvexWorkspace) -> NormalizedWalls:
    """Return the walls of a workspace."""
    d, scale = workspace.dimensions, workspace.size
    origin = np.zeros(d)
    origin[:2] = workspace.center
    corners = (workspace.vertices - workspace.center) / scale
    height = workspace.height / scale
    frames = np.zeros((len(workspace.normals), d, d))
    reaches = np.zeros(len(workspace.normals))
    sides = len(corners)
    if sides:
        ends = np.roll(corners, -1, axis=0)
        lengths = np.hypot(*(ends - corners).T)
        frames[:sides, 0, :2] = (corners + ends) / 2
        frames[:sides, 1, :2] = (ends - corners) / lengths[:, None]
        reaches[:sides] = lengths / 2
    if d == 3:
        frames[:sides, 0, 2] = height / 2
        frames[:sides, 2, 2] = 1.0
        reaches[:sides] = np.maximum(reaches[:sides], height / 2)
        for cap, level in zip(range(sides, len(frames)), (0.0, height), strict=False):
            frames[cap] = np.array([[0.0, 0.0, level], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
            reaches[cap] = 1.0
    offsets = (workspace.offsets - workspace.normals @ origin) / scale
    near = ~np.eye(len(frames) + 1, len(frames), dtype=np.bool_)
    if d == 2 and sides:  # a wall that is off both ends of another one leaves all of that free
        normals = workspace.normals
        off = np.minimum(normals @ corners.T, normals @ ends.T) - offsets[:, None]
        near[:-1] &= off.T < _FAR
    circle = np.array([0.0, 0.0, workspace.radius / scale])
    base = normalize_walls(workspace.base) if d == 3 else None
    return NormalizedWalls(
        frames, reaches, np.ascontiguousarray(workspace.normals), offsets, near, circle, height, scale, origin, base
    )
