"""The walls of a convex workspace in the units of the planners: scaled to the size 1."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.steering.kernels.chain import Shape
from shoal.steering.kernels.cycles import CycleModel
from shoal.steering.workspaces.convex import ConvexWorkspace, Points

# relative to the size: at this distance a wall does not interfere with contacts on another wall
_FAR = 1e-3


@dataclass(frozen=True, eq=False)
class NormalizedWalls:
    """The flat walls and the round wall of a workspace, scaled to the workspace size 1.

    Parameters
    ----------
    frames : ndarray of float64, shape (walls, d, d)
        For each flat wall, its midpoint and d - 1 unit vectors along the wall.
    reaches : ndarray of float64, shape (walls,)
        For each side wall, half of its length; in space, half of the larger of its length and its
        height. For the end caps, 1.
    normals, offsets : ndarray of float64, shapes (walls, d) and (walls,)
        Inward unit normals and offsets of the flat walls: a point is inside these walls if
        ``normals @ point >= offsets``.
    near : ndarray of bool, shape (walls + 1, walls)
        For each wall (row) and each flat wall (column), whether the flat wall may interfere with a
        contact on the wall of the row. The last row is for the round wall.
    circle : ndarray of float64, shape (3,)
        Centre (x, y) and radius of the round wall; the radius is 0 if the workspace has no round
        wall.
    height : float
        Height of the prism or cylinder, in normalized units.
    scale : float
        Length of one normalized unit, in the workspace's unit of length.
    origin : ndarray of float64, shape (d,)
        The point of the workspace that is the origin of the normalized coordinates.
    base : NormalizedWalls or None
        For a prism or a cylinder, the walls of its base in the plane.
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
        """Number of dimensions of the workspace, 2 or 3."""
        return len(self.origin)

    @property
    def sides(self) -> int:
        """Number of flat side walls, without floor and ceiling."""
        return len(self.normals) - (
            2 if self.dimensions == 3 and len(self.normals) and self.normals[-1, 2] < 0 else 0
        )

    @property
    def corners(self) -> Points:
        """Start points of the flat side walls in the plane; float64, shape (sides, 2)."""
        frames, d = self.frames[: self.sides], self.dimensions
        # there is one in space
        lengths = self.reaches[: self.sides] if d == 2 else self.base.reaches  # type: ignore[union-attr]
        return np.asarray(frames[:, 0, :2] - lengths[:, None] * frames[:, 1, :2])

    @property
    def round(self) -> bool:
        """Whether the workspace has a round wall.

        The index of the round wall is the number of flat walls.
        """
        return bool(self.circle[2] > 0)

    @property
    def shape(self) -> Shape:
        """The walls as arrays for the compiled functions that optimize chains of contacts."""
        return Shape(self.frames, self.normals, self.offsets, self.circle, self.near)

    def cycle_model(self, friction: float, margin: float, push: float) -> CycleModel:
        """Return the walls and constants for kernels that compute cycles."""
        return CycleModel(
            self.frames,
            self.reaches,
            self.normals,
            self.offsets,
            self.circle,
            friction,
            margin,
            push,
        )

    def inward(self, wall: int, contact: Points) -> Points:
        """Return the inward unit normal of a wall at a contact, which is given in workspace
        coordinates.
        """
        if wall < len(self.normals):
            return np.asarray(self.normals[wall])
        normal = np.zeros(len(contact))
        normal[:2] = self.origin[:2] - contact[:2]
        return normal / float(np.hypot(*normal[:2]))

    def normalized(self, points: Points) -> Points:
        """Convert points from workspace coordinates to normalized coordinates."""
        return np.ascontiguousarray((points - self.origin) / self.scale)

    def restored(self, points: Points) -> Points:
        """Convert points from normalized coordinates to workspace coordinates."""
        return points * self.scale + self.origin


@lru_cache(maxsize=256)
def normalize_walls(workspace: ConvexWorkspace) -> NormalizedWalls:
    """Return the walls of a workspace, scaled to the workspace size 1 and centred."""
    scale, origin = workspace.size, np.zeros(workspace.dimensions)
    origin[:2] = workspace.center
    offsets = (workspace.offsets - workspace.normals @ origin) / scale
    base = normalize_walls(workspace.base) if workspace.dimensions == 3 else None
    height, circle = workspace.height / scale, np.array([0.0, 0.0, workspace.radius / scale])
    corners = (workspace.vertices - workspace.center) / scale
    return _with_frames(corners, workspace.normals, offsets, circle, height, scale, origin, base)


def _with_frames(
    corners: Points,
    normals: Points,
    offsets: NDArray[np.float64],
    circle: NDArray[np.float64],
    height: float,
    scale: float,
    origin: Points,
    base: NormalizedWalls | None,
) -> NormalizedWalls:
    """Return the normalized walls: the sides from each corner to the next corner, followed by the
    end caps.
    """
    d, sides = len(origin), len(corners)
    frames, reaches = np.zeros((len(normals), d, d)), np.zeros(len(normals))
    near = ~np.eye(len(normals) + 1, len(normals), dtype=np.bool_)
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
    elif sides:  # a wall beyond both ends of another wall does not interfere with it
        off = np.minimum(normals @ corners.T, normals @ ends.T) - offsets[:, None]
        near[:-1] &= off.T < _FAR
    return NormalizedWalls(
        frames,
        reaches,
        np.ascontiguousarray(normals),
        offsets,
        near,
        circle,
        height,
        scale,
        origin,
        base,
    )


_ROUND = 0.95  # least ratio of the distances of sides and corners of a polygon that is nearly round


@lru_cache(maxsize=64)
def with_round_wall(walls: NormalizedWalls) -> NormalizedWalls | None:
    """Return a disk around a polygon, or None if the polygon is not nearly round."""
    if walls.dimensions != 2 or not walls.sides:
        return None
    radius = float(np.hypot(*walls.corners.T).max())
    if -walls.offsets.max() < _ROUND * radius:
        return None
    nothing = np.zeros((0, 2))
    circle = np.array([0.0, 0.0, radius])
    return _with_frames(nothing, nothing, np.zeros(0), circle, 0.0, walls.scale, walls.origin, None)


@lru_cache(maxsize=64)
def with_few_sides(walls: NormalizedWalls, count: int) -> NormalizedWalls | None:
    """Return the walls of a polygon or prism with at most ``count`` of its sides, or None if the
    chosen sides enclose no area.

    The function divides the sides, in their order, into ``count`` groups of about equal size, and
    keeps the longest side of each group. The size of a group is the mean of two fractions: the
    length of the group divided by the length of the boundary, and the turning angle of the group
    divided by 2π.
    """
    flat = walls.normals[: walls.sides, :2]
    lengths = 2 * np.hypot(*(walls.frames[: walls.sides, 0, :2] - walls.corners).T)
    turns = np.arccos(np.clip(np.sum(flat * np.roll(flat, 1, axis=0), axis=1), -1, 1))
    around = np.cumsum(lengths / lengths.sum() + turns / turns.sum()) / 2
    groups = np.minimum((count * (around - around[0] / 2)).astype(np.int64), count - 1)
    chosen = np.array(
        [
            min(np.flatnonzero(groups == group), key=lambda side: -lengths[side])
            for group in np.unique(groups)
        ]
    )
    normals, offsets = flat[chosen], walls.offsets[chosen]
    across = (
        normals[:, 0] * np.roll(normals, -1, axis=0)[:, 1]
        - normals[:, 1] * np.roll(normals, -1, axis=0)[:, 0]
    )
    if len(chosen) < 3 or (across <= 0).any():
        return None
    ends = np.array(
        [np.linalg.solve(normals[[k, k - 1]], offsets[[k, k - 1]]) for k in range(len(chosen))]
    )
    chosen = np.concatenate([chosen, np.arange(walls.sides, len(walls.normals))])
    return _with_frames(
        ends,
        walls.normals[chosen],
        walls.offsets[chosen],
        walls.circle,
        walls.height,
        walls.scale,
        walls.origin,
        walls.base,
    )
