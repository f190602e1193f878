"""Convex workspaces in two and three dimensions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from math import pi
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import (
    check_bool,
    check_integer,
    check_kind,
    check_number,
    check_points,
    fault_place,
)
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.geometry import left_of, unit_vectors

Points = NDArray[np.float64]

_FLAT = 1e-9  # relative to the size: a thinner outline has no interior
_STRAIGHT = 1e-12  # relative to the squared size: a corner with a smaller turn is dropped


class InwardCornerError(InvalidInputError):
    """Raised if an outline bends inward."""


def convex_outline(vertices: ArrayLike) -> Points:
    """Return the corners of a convex polygon in counter-clockwise order; float64, shape (n, 2).

    The order of ``vertices`` may be clockwise or counter-clockwise. The last vertex may repeat the
    first vertex. The result leaves out repeated vertices and vertices in the middle of a straight
    side.

    Raises
    ------
    InvalidInputError
        If the outline is flat, crosses itself or is not convex. The error message gives the number
        of the wrong vertex, counted from 1.

    Examples
    --------
    >>> convex_outline([(0, 0), (0, 1), (1, 1), (1, 0.5), (1, 0)]).tolist()
    [[1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]]
    """
    from shapely import LinearRing, Polygon

    points = check_points(vertices, what="polygon", dimensions=2)
    places = np.arange(len(points))
    distinct = (
        np.any(points != np.roll(points, 1, axis=0), axis=1)
        if len(points) > 1
        else np.ones(len(points), dtype=np.bool_)
    )
    corners, places = points[distinct], places[distinct]
    if len(corners) < 3:
        raise InvalidInputError(
            f"polygon: expected 3 different vertices or more, got {len(corners)}"
        )
    size = float(np.ptp(corners, axis=0).max())
    area = signed_area(corners)
    ring = LinearRing(corners)
    if abs(area) <= _FLAT * size * size and _thickness(corners) <= _FLAT * size:
        raise InvalidInputError(
            f"polygon: expected an outline with an interior, got a flat one, {len(points)} vertices"
            " on a line"
        )
    if not ring.is_simple:
        where = fault_place(Polygon(corners))
        raise InvalidInputError(
            f"polygon: expected an outline that does not cross itself, got one that does{where}"
        )
    if area < 0:
        corners, places = corners[::-1], places[::-1]
    turns = _turns(corners)
    straight = np.abs(turns) <= _STRAIGHT * size * size
    corners, places, turns = corners[~straight], places[~straight], turns[~straight]
    if (turns < 0).any():
        worst = int(np.argmax(turns < 0))
        corner = tuple(corners[worst].tolist())
        raise InwardCornerError(
            "polygon: expected a convex outline (a region takes any outline), "
            f"got one that bends inward at vertex {places[worst] + 1}, {corner}"
        )
    return np.ascontiguousarray(corners)


def hull(points: Points) -> Points:
    """Return the corners of the convex hull of ``points``; float64, shape (n, 2).

    If all points lie on one line, the result consists of the two end points.
    """
    from shapely import MultiPoint

    shape = MultiPoint(points).convex_hull
    return (
        np.asarray(shape.exterior.coords)[:-1]
        if shape.geom_type == "Polygon"
        else np.asarray(shape.coords)
    )


def clip_polygon(corners: Points, normal: Points, most: float) -> Points:
    """Return the corners of the part of a convex polygon in which ``normal @ point <= most``."""
    inside = []
    depths = corners @ normal - most
    for point, following, depth, next_depth in zip(
        corners, np.roll(corners, -1, axis=0), depths, np.roll(depths, -1), strict=True
    ):
        if depth <= 0:
            inside.append(point)
        if (depth < 0 < next_depth) or (next_depth < 0 < depth):
            inside.append(point + depth / (depth - next_depth) * (following - point))
    return np.array(inside).reshape(-1, 2)


def signed_area(corners: Points) -> float:
    """Return the area of the polygon with the given corners, negative if the corners are in
    clockwise order.
    """
    x, y = corners.T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _thickness(corners: Points) -> float:
    """Return the largest distance of a corner from the straight line that fits all corners best."""
    centred = corners - corners.mean(axis=0)
    return float(np.abs(centred @ np.linalg.svd(centred, full_matrices=False)[2][1]).max())


def _turns(corners: Points) -> NDArray[np.float64]:
    before, after = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
    return np.asarray(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])


TOUCH = 1e-9  # relative to the size: a particle closer to a wall than this is on it
EXACT_TOUCH = 1e-12  # relative to the size: contact tolerance in sensitive computations


class SteeringWorkspace(ABC):
    """Base class of the workspaces of steering: areas or volumes in which particles move.

    Attributes
    ----------
    kind : str
        Name of the kind of workspace in error messages, such as "polygon".
    """

    kind: str

    @property
    @abstractmethod
    def dimensions(self) -> int:
        """Number of dimensions of the workspace, 2 or 3."""

    @property
    @abstractmethod
    def rings(self) -> tuple[Points, ...]:
        """One array of corners for the outline, followed by one array for each obstacle; each
        float64, shape (n, 2).

        The free space lies on the left of each edge from one corner to the next.
        """

    @cached_property
    def size(self) -> float:
        """The larger of the workspace's extents along x and y. Relative tolerances are fractions of
        this size.
        """
        return float(np.ptp(self.rings[0], axis=0).max())

    @property
    def bounds(self) -> tuple[Points, Points]:
        """The points (smallest x, smallest y) and (largest x, largest y) of the workspace; each
        float64, shape (2,).
        """
        return self.rings[0].min(axis=0), self.rings[0].max(axis=0)

    @cached_property
    def edges(self) -> NDArray[np.float64]:
        """One row (start x, start y, end x, end y) for each edge of the workspace; float64, shape
        (edges, 4).

        The free space lies on the left of each edge.
        """
        return np.concatenate([np.hstack([ring, np.roll(ring, -1, axis=0)]) for ring in self.rings])

    @cached_property
    def shape(self) -> Any:
        """The area inside the outline and outside the obstacles, as a Shapely polygon."""
        from shapely import Polygon

        return Polygon(self.rings[0], self.rings[1:])

    @abstractmethod
    def depth(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the distance of each point from the nearest wall, negative outside the workspace;
        float64, shape (...).
        """

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return whether each point lies inside the workspace or on a wall, with the tolerance
        `TOUCH`; bool, shape (...).
        """
        return np.asarray(self.depth(points) >= -TOUCH * self.size)

    def check_inside(self, points: ArrayLike, *, what: str) -> Points:
        """Check that points lie in the workspace, and return the points as a float64 array of shape
        (n, dimensions).

        Raises
        ------
        InvalidInputError
            If a point lies outside the workspace.
        """
        array = check_points(points, what=what, dimensions=self.dimensions)
        outside = ~self.contains(array)
        if outside.any():
            index = int(np.argmax(outside))
            raise InvalidInputError(
                f"{what}: expected points inside the {self.kind}, got"
                f" ({', '.join(f'{x:.6g}' for x in array[index].tolist())}) at point {index + 1},"
                f" {-float(self.depth(array[index])):.3g} outside"
            )
        return array


@dataclass(frozen=True, eq=False)
class ConvexWorkspace(SteeringWorkspace):
    """A convex workspace, bounded by flat walls, by a round wall, or by both.

    The functions `polygon`, `disk`, `regular_polygon`, `prism` and `cylinder` create convex
    workspaces. Points are (x, y) or (x, y, z), and drawings show the y axis upwards.

    Parameters
    ----------
    kind : str
        "polygon", "disk", "prism" or "cylinder".
    vertices : ndarray of float64, shape (n, 2)
        Corners of the polygon or of the prism's base, counter-clockwise; an empty array for a disk
        or a cylinder.
    radius : float
        Radius of the disk or cylinder; 0 for a polygon or a prism.
    center : ndarray of float64, shape (2,)
        Centre of the disk or of the cylinder's base; for a polygon or a prism, the mean of
        ``vertices``.
    height : float
        Height of the prism or cylinder, whose base lies at z = 0; 0 for a plane workspace.
    open_ends : bool
        Whether the prism or cylinder is a tube without end caps. Particles can leave a tube through
        its open ends, where no wall holds particles.
    """

    kind: str
    vertices: Points
    radius: float
    center: Points
    height: float = 0.0
    open_ends: bool = False

    @property
    def dimensions(self) -> int:
        """Number of dimensions of the workspace, 2 or 3."""
        return 3 if self.height else 2

    @property
    def round(self) -> bool:
        """Whether the side wall of the workspace is round: a circle or a cylinder."""
        return self.radius > 0

    @cached_property
    def size(self) -> float:
        """The larger of the workspace's extents along x and y. Relative tolerances are fractions of
        this size.
        """
        return 2 * self.radius if self.round else super().size

    @property
    def rings(self) -> tuple[Points, ...]:
        """A tuple with one array: the corners of the polygon or of the prism's base; float64, shape
        (n, 2).
        """
        return (self.vertices,)

    @property
    def bounds(self) -> tuple[Points, Points]:
        """The points (smallest x, smallest y) and (largest x, largest y) of the workspace; each
        float64, shape (2,).
        """
        return (
            (self.center - self.radius, self.center + self.radius) if self.round else super().bounds
        )

    @property
    def middle(self) -> Points:
        """The centre of the workspace, which lies at half the height of a prism or cylinder;
        float64, shape (dimensions,).
        """
        return self.center if self.dimensions == 2 else np.append(self.center, self.height / 2)

    @cached_property
    def normals(self) -> Points:
        """Inward unit normals of the side walls, then of the floor and the ceiling; float64, shape
        (walls, dimensions).
        """
        along = np.roll(self.vertices, -1, axis=0) - self.vertices
        sides: Points = left_of(along) / np.hypot(*along.T)[:, None]
        if self.dimensions == 2:
            return sides
        sides = np.hstack([sides, np.zeros((len(sides), 1))])
        caps = np.zeros((0, 3)) if self.open_ends else np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
        return np.vstack([sides, caps])

    @cached_property
    def offsets(self) -> NDArray[np.float64]:
        """Offsets of the flat walls: a point is inside these walls if ``normals @ point >=
        offsets``; float64, shape (walls,).
        """
        sides = np.sum(self.normals[: len(self.vertices), :2] * self.vertices, axis=1)
        return (
            sides
            if self.dimensions == 2 or self.open_ends
            else np.concatenate([sides, [0.0, -self.height]])
        )

    @cached_property
    def base(self) -> ConvexWorkspace:
        """The polygon or disk that is the base of the prism or cylinder; for a plane workspace, the
        workspace itself.
        """
        return ConvexWorkspace(
            "disk" if self.round else "polygon", self.vertices, self.radius, self.center
        )

    @cached_property
    def differences(self) -> ConvexWorkspace:
        """The Δ configuration space: all differences of the positions of two particles in a plane
        workspace.

        The position differences in a polygon form a polygon, and the position differences in a disk
        form a disk of twice the radius.

        For a workspace with n sides, the polygon of differences has 2n sides, minus two for each
        pair of parallel sides. Source: paper W, section IV.A.

        Examples
        --------
        >>> [len(regular_polygon(n).differences.vertices) for n in (3, 4, 5, 6)]
        [6, 4, 10, 6]
        """
        if self.dimensions != 2:
            raise InvalidInputError(
                f"Δ configuration space: expected a plane workspace, got a {self.kind}"
            )
        if self.round:
            return disk(2 * self.radius)
        return polygon(hull((self.vertices[:, None] - self.vertices[None]).reshape(-1, 2)))

    def wall_distances(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the distance of each point from each flat wall, negative behind the wall; float64,
        shape (..., walls).
        """
        return np.asarray(points, dtype=np.float64) @ self.normals.T - self.offsets

    def circle_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the distance of each point from the round wall, negative for points outside the
        wall.

        If the workspace has no round wall, all distances are infinite.
        """
        flat = np.asarray(points, dtype=np.float64)[..., :2] - self.center
        return (
            np.asarray(self.radius - np.hypot(flat[..., 0], flat[..., 1]))
            if self.round
            else np.full(flat.shape[:-1], np.inf)
        )

    def depth(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the distance of each point from the nearest wall, negative outside the workspace;
        float64, shape (...).
        """
        walls = self.wall_distances(points)
        nearest = walls.min(axis=-1) if walls.shape[-1] else np.full(walls.shape[:-1], np.inf)
        return np.asarray(np.minimum(nearest, self.circle_distance(points)))

    def extent(self, direction: ArrayLike) -> float:
        """Return the largest ``|direction · (p - c)|`` for all points p of the workspace, where the
        point c is the centre.
        """
        vector = np.asarray(direction, dtype=np.float64)
        flat = vector[:2]
        side = (
            self.radius * np.hypot(*flat)
            if self.round
            else np.max(np.abs((self.vertices - self.center) @ flat))
        )
        return float(side + (abs(vector[2]) * self.height / 2 if len(vector) == 3 else 0.0))

    def inset(self, margin: float, *, what: str = "margin") -> ConvexWorkspace:
        """Return a smaller copy of a plane workspace, in which every wall has moved inwards by
        ``margin``. Errors call it ``what``.

        Raises
        ------
        InvalidInputError
            If ``margin`` leaves no area, or if the workspace is not plane.

        Examples
        --------
        >>> disk(0.5).inset(0.125).radius
        0.375
        """
        if self.dimensions == 3:
            raise InvalidInputError(
                f"{what}: expected a plane workspace, got a {self.kind}, which has no inset"
            )
        if self.round:
            radius = self.radius - margin
            if radius <= 0:
                raise InvalidInputError(
                    f"{what}: expected less than the radius {self.radius:g}, got {margin:g}"
                )
            return disk(radius, center=self.center)
        corners = self.vertices
        for normal, offset in zip(self.normals, self.offsets, strict=True):
            corners = clip_polygon(corners, -normal, -(float(offset) + margin))
        try:
            return polygon(corners)
        except InvalidInputError:
            raise InvalidInputError(
                f"{what}: expected a distance that leaves room in the polygon, got {margin:g}"
            ) from None

    def __repr__(self) -> str:
        shape = f"radius {self.radius:g}" if self.round else f"{len(self.vertices)} corners"
        return (
            f"<ConvexWorkspace {self.kind},"
            f" {shape}{f', height {self.height:g}' if self.height else ''}>"
        )


def polygon(vertices: ArrayLike) -> ConvexWorkspace:
    """Return a convex polygon as a workspace.

    Parameters
    ----------
    vertices : array_like of float, shape (n, 2)
        Corners of the polygon, clockwise or counter-clockwise. The function
        `shoal.steering.workspaces.convex.convex_outline` describes the accepted outlines.

    Raises
    ------
    InvalidInputError
        If the polygon has fewer than three corners or is not convex.

    Examples
    --------
    >>> square = polygon([(0, 0), (1, 0), (1, 1), (0, 1)])
    >>> square.contains([(0.5, 0.5), (1.5, 0.5)]).tolist()
    [True, False]
    """
    corners = convex_outline(vertices)
    return ConvexWorkspace("polygon", corners, 0.0, corners.mean(axis=0))


def regular_polygon(sides: int, *, radius: float = 0.5) -> ConvexWorkspace:
    """Return a regular polygon around the origin, whose lowest side is horizontal.

    Parameters
    ----------
    sides : int
        Number of sides of the polygon, at least 3.
    radius : float
        Radius of the circle through the corners of the polygon.
    """
    check_integer(sides, what="sides", least=3, most=1000)
    angles = -pi / 2 + pi / sides + 2 * pi * np.arange(sides) / sides
    return polygon(check_number(radius, what="radius", above=0) * unit_vectors(angles))


def disk(radius: float = 0.5, *, center: ArrayLike = (0.0, 0.0)) -> ConvexWorkspace:
    """Return a disk as a workspace.

    Parameters
    ----------
    radius : float
        Radius of the disk, above 0.
    center : array_like of float, shape (2,)
    """
    middle = check_points([center], what="center", dimensions=2, count=1)[0]
    return ConvexWorkspace(
        "disk", np.zeros((0, 2)), check_number(radius, what="radius", above=0), middle
    )


def prism(base: ConvexWorkspace, height: float, *, open_ends: bool = False) -> ConvexWorkspace:
    """Return the right prism over a polygon, or the cylinder over a disk, between z = 0 and z =
    ``height``.

    Parameters
    ----------
    base : ConvexWorkspace
        A polygon or a disk.
    height : float
        Height of the prism, above 0.
    open_ends : bool
        Whether the prism is a tube without end caps.
    """
    if check_kind(base, ConvexWorkspace, what="base").dimensions != 2:
        raise InvalidInputError(f"prism: expected a polygon or a disk as base, got {base!r}")
    kind = "cylinder" if base.round else "prism"
    return ConvexWorkspace(
        kind,
        base.vertices,
        base.radius,
        base.center,
        check_number(height, what="height", above=0),
        check_bool(open_ends, what="open_ends"),
    )


def cylinder(radius: float, height: float, *, open_ends: bool = False) -> ConvexWorkspace:
    """Return the cylinder around the z axis, between z = 0 and z = ``height``.

    Parameters
    ----------
    radius, height : float
        Radius and height of the cylinder, above 0.
    open_ends : bool
        Whether the cylinder is a tube without end caps.
    """
    return prism(disk(radius), height, open_ends=open_ends)
