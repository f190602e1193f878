"""Workspaces as convex cells with doors between them, and the routes that particles can take."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.steering.certificates.relaxation import ROUND_WALLS, round_directions
from shoal.steering.workspaces.convex import ConvexWorkspace, Points
from shoal.steering.workspaces.region import Region

_MOST_CORNERS = 2000  # of a region with a certificate
_ARCS = 8  # with which the search for the round wall of a cylinder begins
_ON = 1e-9  # relative to the size: how far outside a cell, behind a wall, a start may lie


@dataclass(frozen=True, eq=False)
class Wall:
    """A wall of a cell: all points ``origin + fractions @ axes`` with fractions between 0 and 1
    that are inside the half-spaces ``inside``, rows (normal, offset); without axes, all such points
    of the workspace.

    A flat wall has one inward normal. An arc of a round wall has two, those at its ends: an input
    that goes against the normal of one of its points goes against one of these.
    """

    origin: NDArray[np.float64]
    axes: NDArray[np.float64]
    normals: NDArray[np.float64]
    inside: NDArray[np.float64]

    @property
    def is_flat(self) -> bool:
        """Whether the wall is no arc."""
        return len(self.normals) == 1


@dataclass(frozen=True, eq=False)
class RoundWall:
    """The round wall of a cylinder around ``center``, divided into arcs.

    Parameters
    ----------
    center : ndarray of float64, shape (2,)
    radius : float
    directions : ndarray of float64, shape (arcs, 2)
        Ends of the smallest arcs, counter-clockwise.
    halves : dict
        For the number of each arc that can be divided, the numbers of its halves among the walls.
    parents : dict
        For the number of each half, that of its arc.
    """

    center: NDArray[np.float64]
    radius: float
    directions: NDArray[np.float64]
    halves: dict[int, tuple[int, int]]
    parents: dict[int, int]


@dataclass(frozen=True, eq=False)
class Cells:
    """A workspace as convex cells.

    Parameters
    ----------
    walls : list of Wall
    doors : ndarray of float64, shape (doors, 2, 2)
        End points of the edges that two cells share.
    walls_of, doors_of : list of list of int
        Walls and doors of each cell.
    outer : ndarray of float64, shape (n, dimensions + 1)
        Half-spaces that contain the workspace: rows (inward normal, offset).
    corners : list of Points
        Corners of each cell; none if the whole workspace is convex.
    insides : list of ndarray of float64, each of shape (n, dimensions + 1)
        Half-spaces whose intersection is a cell, for each cell.
    stated : dict
        The cells as a certificate states them.
    round : RoundWall or None
    """

    walls: list[Wall]
    doors: NDArray[np.float64]
    walls_of: list[list[int]]
    doors_of: list[list[int]]
    outer: NDArray[np.float64]
    corners: list[Points]
    insides: list[NDArray[np.float64]]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    stated: dict[str, Any]
    round: RoundWall | None = None

    def without(self, wall: int, excluded: Collection[int]) -> list[int]:
        """Return the walls that are together a wall without others, halves of arcs, or the wall
        itself.
        """
        parents = {} if self.round is None else self.round.parents

        def above(arc: int | None) -> Iterator[int]:
            while arc is not None:
                yield arc
                arc = parents.get(arc)

        if any(ancestor in excluded for ancestor in above(wall)):
            return []
        if self.round is None or not any(wall in above(other) for other in excluded):
            return [wall]
        return [arc for half in self.round.halves[wall] for arc in self.without(half, excluded)]

    @property
    def dimensions(self) -> int:
        """Number of dimensions of the workspace, 2 or 3."""
        return len(self.low)

    def neighbor(self, cell: int, door: int) -> int:
        """Return the cell on the other side of a door."""
        return next(k for k, doors in enumerate(self.doors_of) if door in doors and k != cell)

    def cell_of(self, point: NDArray[np.float64]) -> int | None:
        """Return a cell that contains a point."""
        if not self.corners:
            return 0
        for cell, corners in enumerate(self.corners):
            sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
            if all(_orientation(a, b, point) >= -self._slack(a, b) for a, b in sides):
                return cell
        return None

    def _slack(self, begin: Points, end: Points) -> Fraction:
        """Return how far outside this edge of a cell a start may lie: nothing at a door."""
        is_door = any(
            np.array_equal(door, (begin, end)) or np.array_equal(door, (end, begin))
            for door in self.doors
        )
        size = float((self.high - self.low).max())
        return (
            Fraction(0)
            if is_door
            else Fraction(_ON * size) * Fraction(np.ptp((begin, end), axis=0).max())
        )

    def may_end(self, cell: int, goal: NDArray[np.float64], tolerance: float) -> bool:
        """Return whether no edge of a cell separates it from the box around a goal."""
        if not self.corners:
            return True
        corners = self.corners[cell]
        signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
        box = [
            tuple(
                Fraction(x) + int(s) * Fraction(tolerance)
                for x, s in zip(goal.tolist(), sign, strict=True)
            )
            for sign in signs
        ]
        return all(
            any(_orientation(a, b, spot) >= 0 for spot in box)
            for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)
        )


def _orientation(begin: Any, end: Any, point: Any) -> Fraction:
    """Return twice the signed area of a triangle, exactly."""
    (a, b), (c, d), (x, y) = ([Fraction(value) for value in spot] for spot in (begin, end, point))
    return (c - a) * (y - b) - (d - b) * (x - a)


def cells_of_place(place: Any, heights: NDArray[np.float64], limit: float) -> Cells | None:
    """Return the cells of a prism, a cylinder or a region; None for other workspaces, and for a
    region that has no exact division into convex cells, such as one whose obstacles touch.

    In a tube with open ends, the particles that start at some heights can be anywhere within the
    limit of these.
    """
    if isinstance(place, Region):
        return _region(place)
    if place.dimensions == 2:
        return None
    low, high = 0.0, place.height
    if place.open_ends:
        low, high = float(heights.min()) - limit, float(heights.max()) + limit
    return (_cylinder if place.round else _prism)(place, low, high)


def _caps(
    least: NDArray[np.float64],
    most: NDArray[np.float64],
    sides: NDArray[np.float64],
) -> tuple[list[Wall], NDArray[np.float64]]:
    """Return the end caps of a box, each inside ``sides``, and their half-spaces."""
    wide, up = np.diag(most - least)[:2], np.array([0.0, 0.0, most[2] - least[2]])
    above = np.append(least[:2], most[2])
    walls = [
        Wall(least, wide, up[None], sides),
        Wall(above, wide, -up[None], sides),
    ]
    return walls, np.array([[*up, up[2] * least[2]], [*-up, -up[2] * most[2]]])


def _prism(place: ConvexWorkspace, low: float, high: float) -> Cells:
    base = place.vertices
    along = np.roll(base, -1, axis=0) - base
    spaces = _half_planes(base)
    sides = np.insert(spaces, 2, 0.0, axis=1)
    up = np.array([0.0, 0.0, high - low])
    walls = [
        Wall(
            np.append(corner, low),
            np.array([[*side, 0.0], up]),
            np.append(normal, 0.0)[None],
            np.zeros((0, 4)),
        )
        for corner, side, normal in zip(base, along, spaces[:, :2], strict=True)
    ]
    least, most = np.append(base.min(axis=0), low), np.append(base.max(axis=0), high)
    caps, ends = _caps(least, most, sides)
    walls += [] if place.open_ends else caps
    outer = np.vstack([sides, ends])
    every = list(range(len(walls)))
    doors, stated = np.zeros((0, 2, 2)), dict[str, Any]()
    return Cells(walls, doors, [every], [[]], outer, [], [outer], least, most, stated)


def _cylinder(place: ConvexWorkspace, low: float, high: float) -> Cells:
    center, radius = place.center, place.radius
    least, most = np.append(center - radius, low), np.append(center + radius, high)
    caps, outer = _caps(least, most, np.zeros((0, 4)))
    walls = [] if place.open_ends else caps
    offset, count = len(walls), ROUND_WALLS
    directions = round_directions()
    halves, parents = {}, {}
    # as in a heap: the arcs 8 to 15 are the whole wall, and the arc k has the halves 2 k, 2 k + 1
    for k in range(_ARCS, 2 * count):
        size = count // 2 ** (k.bit_length() - 1)
        begin = size * (k - 2 ** (k.bit_length() - 1))
        if size > 1:
            halves[offset + k - _ARCS] = offset + 2 * k - _ARCS, offset + 2 * k + 1 - _ARCS
        if k >= 2 * _ARCS:
            parents[offset + k - _ARCS] = offset + k // 2 - _ARCS
        ends = directions[[begin, (begin + size) % count]]
        axis = ends.sum(axis=0)
        away = radius * float(np.min(ends @ axis / np.hypot(*ends.T))) + axis @ center
        walls.append(
            Wall(
                least,
                np.zeros((0, 3)),
                -np.insert(ends, 2, 0.0, axis=1),
                np.array([[*axis, 0.0, away]]),
            )
        )
    every = list(range(len(walls)))
    stated = {"directions": directions.tolist()}
    round_ = RoundWall(center, radius, directions, halves, parents)
    doors = np.zeros((0, 2, 2))
    return Cells(walls, doors, [every], [[]], outer, [], [outer], least, most, stated, round_)


def _region(place: Region) -> Cells | None:
    vertices = np.concatenate(place.rings)
    polygons = _convex_parts(place, vertices)
    if polygons is None:
        return None
    starts = np.cumsum([0, *(len(ring) for ring in place.rings)])
    edges: dict[tuple[int, int], int] = {}
    for begin, end in pairwise(starts):
        count = end - begin
        for k in range(count):
            edges[int(begin + k), int(begin + (k + 1) % count)] = len(edges)
    walls = []
    for a, b in edges:
        along = vertices[b] - vertices[a]
        walls.append(
            Wall(vertices[a], along[None], np.array([[-along[1], along[0]]]), np.zeros((0, 3)))
        )
    doors: dict[tuple[int, int], int] = {}
    walls_of: list[list[int]] = []
    doors_of: list[list[int]] = []
    for polygon in polygons:
        sides = _sides(polygon)
        walls_of.append([edges[side] for side in sides if side in edges])
        doors_of.append(
            [
                doors.setdefault((min(side), max(side)), len(doors))
                for side in sides
                if side not in edges
            ]
        )
    import shapely

    corners = np.asarray(shapely.MultiPoint(place.outline).convex_hull.exterior.coords)[:-1]
    index = {tuple(vertex): k for k, vertex in enumerate(vertices.tolist())}
    around = [index[tuple(corner)] for corner in corners[::-1].tolist()]  # counter-clockwise
    hull, outer = [], np.zeros((0, 3))
    for a, b in zip(around, around[1:] + around[:1], strict=True):
        # a side that is not exact is left out
        if all(_orientation(vertices[a], vertices[b], spot) >= 0 for spot in place.outline):
            hull.append([a, b])
            outer = np.vstack([outer, _half_planes(vertices[[a, b]])[:1]])
    low, high = place.bounds
    return Cells(
        walls,
        vertices[np.array(list(doors), dtype=np.int64).reshape(-1, 2)],
        walls_of,
        doors_of,
        outer,
        [vertices[polygon] for polygon in polygons],
        [_half_planes(vertices[polygon]) for polygon in polygons],
        low,
        high,
        {"cells": polygons, "hull": hull},
    )


def _touch(place: Region, vertices: Points) -> bool:
    """Return whether a corner lies on an edge that does not begin or end there."""
    begins, ends = place.edges[:, None, :2], place.edges[:, None, 2:]
    along, away = ends - begins, vertices[None] - begins
    squared = np.sum(along**2, axis=2)
    share = np.sum(along * away, axis=2) / squared
    off = np.abs(along[..., 0] * away[..., 1] - along[..., 1] * away[..., 0]) / squared
    near = (off < _ON) & (share > 0) & (share < 1)
    near &= np.any(begins != vertices, axis=2) & np.any(ends != vertices, axis=2)
    return any(
        _orientation(begins[edge, 0], ends[edge, 0], vertices[corner]) == 0
        for edge, corner in np.argwhere(near)
    )


def _half_planes(corners: Points) -> NDArray[np.float64]:
    """Return rows (normal, offset) for the sides of a counter-clockwise polygon."""
    along = np.roll(corners, -1, axis=0) - corners
    normals = np.stack([-along[:, 1], along[:, 0]], axis=1)
    return np.column_stack([normals, np.sum(normals * corners, axis=1)])


def _convex_parts(place: Region, vertices: Points) -> list[list[int]] | None:
    """Return convex polygons, as indices of their corners, that divide a region.

    The triangles of a triangulation grow together as long as they stay convex.
    """
    import shapely

    index = {tuple(vertex): k for k, vertex in enumerate(vertices.tolist())}
    if len(vertices) > _MOST_CORNERS or len(index) < len(vertices) or _touch(place, vertices):
        return None
    parts: list[list[int]] = []
    for triangle in shapely.constrained_delaunay_triangles(place.shape).geoms:
        corners = [tuple(spot) for spot in np.asarray(triangle.exterior.coords)[:-1].tolist()]
        if not all(corner in index for corner in corners):
            return None
        polygon = [index[corner] for corner in corners]
        area = _orientation(*vertices[polygon])
        if area == 0:
            return None
        parts.append(polygon if area > 0 else polygon[::-1])

    owner = {side: k for k, polygon in enumerate(parts) for side in _sides(polygon)}
    for a, b in list(owner):
        number, neighbor = owner[a, b], owner.get((b, a))
        if neighbor is None or a > b or number == neighbor:
            continue
        first, second = parts[number], parts[neighbor]
        at, to = first.index(b), second.index(a)
        union = first[at:] + first[:at] + (second[to:] + second[:to])[1:-1]
        count = len(union)
        if all(
            _orientation(*(vertices[union[(k + step) % count]] for step in (0, 1, 2))) >= 0
            for k in range(count)
        ):
            parts[number], parts[neighbor] = union, []
            owner.update((side, number) for side in _sides(union))
    return [polygon for polygon in parts if polygon]


def _sides(polygon: list[int]) -> list[tuple[int, int]]:
    return list(zip(polygon, polygon[1:] + polygon[:1], strict=True))


@dataclass(frozen=False, eq=False)
class Cover:
    """The cells that one particle can reach, once for each route to them: a tree.

    Two routes that differ by a turn around an obstacle are different. The first node is the cell of
    the start. A door that is not followed is in ``closed``, with the multipliers that prove that
    plans through it are longer than the limit.
    """

    cells: list[int]
    parents: list[int]
    entries: list[int]
    closed: list[dict[str, Any]]

    def doors_from_start(self, node: int) -> list[int]:
        """Return the doors between the start and a node."""
        doors = []
        while node:
            doors.append(self.entries[node])
            node = self.parents[node]
        return doors[::-1]

    def doors_between(self, begin: int, end: int) -> list[int]:
        """Return the doors that a particle must pass on its way from a node to another."""
        to_begin, to_end = self.doors_from_start(begin), self.doors_from_start(end)
        shared = 0
        while shared < min(len(to_begin), len(to_end)) and to_begin[shared] == to_end[shared]:
            shared += 1
        return to_begin[shared:][::-1] + to_end[shared:]

    def statement(self) -> dict[str, Any]:
        """Return the tree as a certificate states it."""
        nodes = [[entry, parent] for entry, parent in zip(self.entries, self.parents, strict=True)]
        return {"cell": self.cells[0], "nodes": nodes[1:], "closed": self.closed}
