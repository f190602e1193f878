"""Regions: workspaces of any shape with obstacles, for the planner ``sampling``."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_points
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.steering.kernels.chain import Shape
from shoal.steering.workspaces.convex import ConvexWorkspace, Points, SteeringWorkspace


@dataclass(frozen=True, eq=False)
class Region(SteeringWorkspace):
    """A workspace with obstacles: the points inside an outline and outside the obstacles.

    The function `region` creates a Region.

    Parameters
    ----------
    outline : ndarray of float64, shape (n, 2)
        Corners of the outline, counter-clockwise.
    obstacles : tuple of ndarray of float64, each of shape (n, 2)
        Corners of each obstacle, clockwise, so that the free space lies on the left of every edge.
    """

    outline: Points
    obstacles: tuple[Points, ...]

    kind = "region"
    dimensions = 2
    round = False
    height = 0.0

    @property
    def rings(self) -> tuple[Points, ...]:
        """Corners of the outline, followed by the corners of each obstacle; each float64, shape (n,
        2).
        """
        return self.outline, *self.obstacles

    def depth(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the distance of each point from the nearest edge, negative for points outside the
        region; float64, shape (...).
        """
        import shapely

        array = np.asarray(points, dtype=np.float64)
        spots = shapely.points(array)
        away = shapely.distance(self.shape.boundary, spots)
        return np.asarray(np.where(shapely.intersects(self.shape, spots), away, -away))

    def __repr__(self) -> str:
        return f"<Region, {len(self.outline)} corners, {len(self.obstacles)} obstacles>"


def region(outline: ArrayLike, obstacles: Sequence[ArrayLike] = ()) -> Region:
    """Return the workspace that lies inside ``outline`` and outside the obstacles.

    The obstacles must lie inside ``outline`` and must not touch each other.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> yard = region([(0, 0), (4, 0), (4, 4), (0, 4)], [[(1, 1), (2, 1), (2, 2), (1, 2)]])
    >>> yard.contains([(0.5, 0.5), (1.5, 1.5)]).tolist()
    [True, False]
    """
    from shapely import Polygon
    from shapely.geometry.polygon import orient
    from shapely.validation import explain_validity

    rings = [
        check_points(ring, what="outline" if k == 0 else f"obstacle {k}", dimensions=2)
        for k, ring in enumerate([outline, *obstacles])
    ]
    for k, ring in enumerate(rings):
        name = "outline" if k == 0 else f"obstacle {k}"
        if len(np.unique(ring, axis=0)) < 3:
            raise InvalidInputError(
                f"{name}: expected 3 different vertices or more, got {len(np.unique(ring, axis=0))}"
            )
        alone = Polygon(ring)
        if not alone.is_valid or alone.area <= 1e-12 * float(np.ptp(ring, axis=0).max()) ** 2:
            why = explain_validity(alone)
            raise InvalidInputError(
                f"{name}: expected an outline that encloses an area and does not cross itself, got:"
                f" {why}"
            )
    whole = Polygon(rings[0], rings[1:])
    if not whole.is_valid:
        raise InvalidInputError(
            "region: expected obstacles inside the outline and apart from each other, got"
            f" {explain_validity(whole)}"
        )
    turned = orient(whole)
    corners = [np.asarray(ring.coords)[:-1] for ring in (turned.exterior, *turned.interiors)]
    return Region(
        _without_repeats(corners[0]), tuple(_without_repeats(ring) for ring in corners[1:])
    )


def _without_repeats(ring: Points) -> Points:
    return np.asarray(ring[np.any(ring != np.roll(ring, 1, axis=0), axis=1)])


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


@lru_cache(maxsize=64)
def with_few_sides(walls: NormalizedWalls, count: int) -> NormalizedWalls | None:
    """Return the walls of a polygon or prism with at most ``count`` of its sides, or None if the
    kept sides enclose no area.

    The function divides the sides, in their order, into ``count`` groups of about equal size, and
    keeps the longest side of each group. The size of a group is the mean of two fractions: the
    length of the group divided by the length of the boundary, and the turning angle of the group
    divided by 2π.
    """
    flat = walls.normals[: walls.sides, :2]
    lengths = 2 * np.hypot(*(walls.frames[: walls.sides, 0, :2] - walls.corners).T)
    turns = np.arccos(np.clip(np.sum(flat * np.roll(flat, 1, axis=0), axis=1), -1, 1))
    around = np.cumsum(lengths / lengths.sum() + turns / turns.sum()) / 2
    parts = np.minimum((count * (around - around[0] / 2)).astype(np.int64), count - 1)
    kept = np.array(
        [
            min(np.flatnonzero(parts == part), key=lambda side: -lengths[side])
            for part in np.unique(parts)
        ]
    )
    normals, offsets = flat[kept], walls.offsets[kept]
    across = (
        normals[:, 0] * np.roll(normals, -1, axis=0)[:, 1]
        - normals[:, 1] * np.roll(normals, -1, axis=0)[:, 0]
    )
    if len(kept) < 3 or (across <= 0).any():
        return None
    ends = np.array(
        [np.linalg.solve(normals[[k, k - 1]], offsets[[k, k - 1]]) for k in range(len(kept))]
    )
    kept = np.concatenate([kept, np.arange(walls.sides, len(walls.normals))])
    return _with_frames(
        ends,
        walls.normals[kept],
        walls.offsets[kept],
        walls.circle,
        walls.height,
        walls.scale,
        walls.origin,
        walls.base,
    )
