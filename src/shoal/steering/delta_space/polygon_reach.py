"""The set of position differences Δ that two particles in a polygon can reach with k moves, and the relative area of this set.

The depth of a point below a wall is its distance from the line of the wall. Suppose that, after k moves, one more move brings one
particle to a contact c on a wall. Let the sign σ be 1 if this particle is particle 1, and -1 if it is particle 2. Let H_k(c, σ) be
the largest possible depth of the other particle below the wall of c. Let S(c, σ) be the set of all vectors σ (q - c), where q is a
point of the polygon with a depth of at most H_k(c, σ) below the wall of c. The set of position differences that k + 2 moves can
reach is the union of the sets S(c, σ) over all contacts c and both signs σ. The code computes the depths H_k from the set that k
moves can reach.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_points
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.steering.delta_space.disk_reach import check_moves
from shoal.steering.delta_space.two_moves import toucher_shares, two_move_pieces
from shoal.steering.kernels.cycles import deeper
from shoal.steering.planners.chains.chain import ChainQuery
from shoal.steering.planners.chains.kinds import kinds_of
from shoal.steering.workspaces.convex import ConvexWorkspace
from shoal.steering.workspaces.convex_geometry import Points, clipped, hull
from shoal.steering.workspaces.normalized_walls import normalize_walls

_CLOSE = 1e-9


@dataclass(frozen=True, eq=False)
class PolygonReach:
    """The set of position differences Δ that two particles in a polygon can reach with an even number of moves.

    Parameters
    ----------
    workspace : ConvexWorkspace
    before : ndarray of float64, shape (2,)
        The position difference Δ at the start.
    moves : int
        Number of moves: 2, 4, 6, ...
    contacts : ndarray of float64, shape (contacts, 2)
        Sample points on the walls.
    walls : ndarray of int64, shape (contacts,)
        Index of the wall on which each sample point in ``contacts`` lies.
    depths : ndarray of float64, shape (2, contacts)
        For each contact of one particle, the largest depth of the other particle below the wall of the contact, before the last two
        moves. Row 0 is for contacts of particle 1, and row 1 for contacts of particle 2. The depth is negative if the particle
        cannot come to the contact.
    """

    workspace: ConvexWorkspace
    before: Points
    moves: int
    contacts: Points
    walls: NDArray[np.int64]
    depths: NDArray[np.float64]

    def contains(self, differences: ArrayLike) -> NDArray[np.bool_]:
        """Return for each position difference, shape (..., 2), whether the particles can reach it; bool, shape (...).

        For two moves, the result is exact. For more than two moves, the result can be wrongly False near the boundary of the
        reachable set. The reason is that the method knows the depths only at sample points of the walls. Between two neighbouring
        sample points, the method uses the smaller of the two depths. The method `reaches` is exact for any number of moves.
        """
        import shapely

        spots = shapely.points(np.asarray(differences, dtype=np.float64))
        return np.asarray(shapely.dwithin(self._area, spots, _CLOSE * self.workspace.size))

    @cached_property
    def _area(self) -> Any:
        import shapely

        whole = shapely.union_all(shapely.convex_hull([shapely.multipoints(piece) for piece in self.pieces]))
        shapely.prepare(whole)
        return whole

    def reaches(self, after: ArrayLike) -> bool:
        """Return whether the particles can reach the position difference ``after``; exact for any number of moves.

        The method tries all sequences of wall contacts, each by particle 1 or particle 2. Use the method for up to six moves only,
        because for n walls the computing time grows as ``(2 n) ** (moves / 2)``.

        Raises
        ------
        InvalidInputError
            If ``after`` is not the difference of two points of the workspace.
        """
        goal = check_points([after], what="after", dimensions=2, count=1)[0]
        if not self.workspace.differences.contains(goal):
            raise InvalidInputError(f"after: expected the difference of two points of the polygon, got {tuple(goal.tolist())}")
        walls = normalize_walls(self.workspace)
        start, end = (np.stack([-delta / 2, delta / 2]) / walls.scale for delta in (self.before, goal))
        query = ChainQuery(walls, start, end, margin=0.0, push=0.0, rounds=np.empty(0))
        for cycles in range(1, self.moves // 2 + 1):
            touchers, on, _ = kinds_of(start, end, walls, cycles=cycles, push=0.0)
            if any(query.settle(query.guess(cycles), *kind, enough=1e-12) < np.inf for kind in zip(touchers, on, strict=True)):
                return True
        return False

    @cached_property
    def pieces(self) -> list[Points]:
        """Convex polygons for drawing, whose union is the reachable set; each float64, shape (n, 2), counter-clockwise."""
        if self.moves == 2:
            return two_move_pieces(self.workspace, self.before)
        found = []
        corners = self.workspace.vertices
        for sign, depths in zip((1.0, -1.0), self.depths, strict=True):
            for wall in range(len(corners)):
                on = np.flatnonzero((self.walls == wall) & (depths >= 0))
                normal, offset = self.workspace.normals[wall], float(self.workspace.offsets[wall])
                slabs = [clipped(corners, normal, offset + float(depths[k])) - self.contacts[k] for k in on]
                # Between two contacts, the set contains the set of the lower depth swept along the wall.
                for k, following in zip(range(len(on)), on[1:], strict=False):
                    low = min(float(depths[on[k]]), float(depths[following]))
                    slab = clipped(corners, normal, offset + low)
                    found.append(hull(sign * np.concatenate([slab - self.contacts[on[k]], slab - self.contacts[following]])))
                found += [hull(sign * slab) for slab in slabs]
        return [piece for piece in found if len(piece) > 2]

    @cached_property
    def outline(self) -> list[tuple[Points, list[Points]]]:
        """The reachable set for drawing: pairs (outline, holes), one for each connected part, rounded to 1e-6 of the size."""
        import shapely

        whole = shapely.union_all([shapely.Polygon(piece) for piece in self.pieces], grid_size=1e-6 * self.workspace.size)
        parts = [part for part in getattr(whole, "geoms", [whole]) if part.geom_type == "Polygon" and not part.is_empty]
        return [
            (np.asarray(part.exterior.coords)[:-1], [np.asarray(ring.coords)[:-1] for ring in part.interiors]) for part in parts
        ]

    def fraction(self) -> float:
        """Return the area of the reachable set divided by the area of the set of all position differences in the polygon.

        For two moves, the fraction is exact. For more than two moves, the fraction refers to the approximate set that the method
        `contains` uses.
        """
        from shapely import Polygon

        area = sum(Polygon(outline, holes).area for outline, holes in self.outline)
        return float(min(area / self.workspace.differences.shape.area, 1.0))


def polygon_reach(workspace: ConvexWorkspace, before: ArrayLike, *, moves: int, contacts: int = 33) -> list[PolygonReach]:
    """Return the sets of position differences that two particles in a polygon can reach after 2, 4, ..., ``moves`` moves.

    Parameters
    ----------
    workspace : ConvexWorkspace
        The polygon.
    before : array_like of float, shape (2,)
        The position difference Δ at the start.
    moves : int
        Number of moves, even and at least 2.
    contacts : int
        Number of sample points on each side of the polygon.

    Raises
    ------
    InvalidInputError

    Notes
    -----
    Source: paper W, section IV.C and figure 4, corrected.

    Examples
    --------
    >>> from shoal.steering import regular_polygon
    >>> sets = polygon_reach(regular_polygon(3), (0.2, 0.1), moves=6)
    >>> [round(100 * reach.fraction()) for reach in sets]
    [29, 100, 100]
    """
    if workspace.kind != "polygon":
        raise InvalidInputError(f"reach: expected a polygon, got {workspace!r}")
    start = check_points([before], what="before", dimensions=2, count=1)[0]
    if not workspace.differences.contains(start):
        raise InvalidInputError(f"before: expected the difference of two points of the polygon, got {tuple(start.tolist())}")
    check_moves(moves)
    corners, ends = workspace.vertices, np.roll(workspace.vertices, -1, axis=0)
    # Equally spaced, plus the ends of the start's contact range, where depths jump.
    jumps = np.clip(np.concatenate([np.stack(toucher_shares(workspace, (sign * start,))) for sign in (1.0, -1.0)]), 0, 1)
    shares = np.sort(np.hstack([np.broadcast_to(np.linspace(0, 1, contacts), (len(corners), contacts)), jumps.T]), axis=1)
    points = (corners[:, None] + shares[:, :, None] * (ends - corners)[:, None]).reshape(-1, 2)
    walls = np.repeat(np.arange(len(corners)), shares.shape[1])
    depths = np.full((2, len(points)), -1.0)
    for row, sign in enumerate((1.0, -1.0)):
        depth = sign * (workspace.normals @ start)[walls]
        fits = workspace.contains(points + sign * start) & (depth > _CLOSE * workspace.size)
        depths[row] = np.where(fits, depth, -1.0)
    sets = [PolygonReach(workspace, start, 2, points, walls, depths)]
    normals, offsets = np.ascontiguousarray(workspace.normals), workspace.offsets
    spare = [np.empty((4 * len(corners) + 8, 2)) for _ in range(3)]
    for done in range(4, moves + 1, 2):
        before_that, depths = depths, np.empty_like(depths)
        deeper(np.ascontiguousarray(corners), normals, offsets, points, walls, before_that, depths, *spare)
        sets.append(PolygonReach(workspace, start, done, points, walls, depths))
    return sets
