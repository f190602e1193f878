"""Fraction of all position differences (of the Δ configuration space) that moves reach: data for figures 4 and 8 of paper W.

On a polygon, the outline of a reachable set follows from the extents of the set in many directions, as on a disk (see
`shoal.steering.delta_space.disk_reach`).
"""

from __future__ import annotations

from functools import cached_property
from math import pi

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.steering.delta_space.disk_reach import DIRECTIONS, disk_reach
from shoal.steering.delta_space.polygon_reach import PolygonReach, polygon_reach
from shoal.steering.workspaces.convex import ConvexWorkspace
from shoal.steering.workspaces.convex_geometry import Points

FULL = 1 - 1e-6  # fraction of the area that counts as complete
_LEVEL = 1e-12


@dataclass(frozen=True, eq=False)
class DiskFractions:
    """Fraction of all position differences that two particles on a disk can reach, for each initial distance of the particles.

    Parameters
    ----------
    distances : ndarray of float64, shape (n,)
        Initial distances of the particles in diameters of the disk.
    moves : ndarray of int64, shape (k,)
        Numbers of moves: 2, 4, 6, ...
    fractions : ndarray of float64, shape (n, k)
        Reached fraction of the area of the Δ configuration space (all position differences), for each initial distance (row) and
        number of moves (column).
    """

    distances: NDArray[np.float64]
    moves: NDArray[np.int64]
    fractions: NDArray[np.float64]


def disk_fractions(distances: ArrayLike, *, moves: int = 14, directions: int = DIRECTIONS) -> DiskFractions:
    """Return the fraction of all position differences that 2, 4, ..., ``moves`` moves reach on a disk.

    Parameters
    ----------
    distances : array_like of float, shape (n,)
        Initial distances of the particles in diameters of the disk, above 0 and at most 1.
    moves, directions : int
        Number of moves and number of sampled directions, as in `disk_reach`.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> (100 * disk_fractions([0.1], moves=6).fractions).round(1).tolist()
    [[6.3, 30.1, 55.8]]
    """
    given = np.atleast_1d(np.asarray(distances, dtype=np.float64))
    if not given.size:
        raise InvalidInputError("distances: expected at least one distance, got none")
    table = [[reach.fraction() for reach in disk_reach(float(d), moves=moves, directions=directions)] for d in given]
    return DiskFractions(given, 2 * np.arange(1, moves // 2 + 1), np.array(table))


def largest_two_move_fraction() -> tuple[float, float]:
    """Return the initial distance from which two moves on a disk reach the largest fraction of position differences.

    The second returned value is this fraction.

    Notes
    -----
    The initial distance is in diameters of the disk. Section IV.F of paper W gives the fraction 0.373 at an initial distance of
    about 0.81 diameters.

    Examples
    --------
    >>> distance, fraction = largest_two_move_fraction()
    >>> round(distance, 2), round(fraction, 3)
    (0.82, 0.377)
    """
    from scipy.optimize import minimize_scalar

    found = minimize_scalar(lambda d: -disk_reach(float(d), moves=2)[0].fraction(), bounds=(0.5, 0.99), method="bounded")
    return float(found.x), -float(found.fun)


@dataclass(frozen=True, eq=False)
class PolygonFractions:
    """Growth of the set of reachable position differences on a polygon, from one start.

    Parameters
    ----------
    workspace : ConvexWorkspace
    before : ndarray of float64, shape (2,)
        The position difference Δ at the start.
    sets : list of PolygonReach
        The sets of position differences that the particles can reach after 2, 4, 6, ... moves.
    """

    workspace: ConvexWorkspace
    before: Points
    sets: list[PolygonReach]

    @cached_property
    def fractions(self) -> NDArray[np.float64]:
        """The area of each reachable set divided by the area of all position differences; float64, shape (sets,)."""
        return np.array([reach.fraction() for reach in self.sets])

    @cached_property
    def outlines(self) -> list[Points]:
        """The outline of each set of reachable position differences; float64, shape (n, 2)."""
        corners = self.workspace.differences.vertices
        ahead = np.concatenate([_around(2 * DIRECTIONS), corners / np.linalg.norm(corners, axis=1)[:, None]])
        ahead = ahead[np.argsort(np.arctan2(ahead[:, 1], ahead[:, 0]))]
        return [polygon_radii(reach, ahead)[:, None] * ahead for reach in self.sets]

    @property
    def moves(self) -> int | None:
        """The smallest number of moves to reach the fraction `FULL` of all position differences, or None if no set is so large."""
        full = np.flatnonzero(self.fractions >= FULL)
        return self.sets[full[0]].moves if full.size else None


def polygon_fractions(workspace: ConvexWorkspace, before: ArrayLike, *, moves: int = 8, contacts: int = 33) -> PolygonFractions:
    """Return the sets of position differences that two particles in a polygon reach in 2, 4, ..., ``moves`` moves.

    Parameters
    ----------
    workspace, before, moves, contacts
        The polygon, the position difference at the start, the number of moves, and the number of sample points per side, as in
        `polygon_reach`.

    Raises
    ------
    InvalidInputError

    Notes
    -----
    Source: paper W, section IV.D and figure 4.

    Examples
    --------
    >>> from shoal.steering import regular_polygon
    >>> polygon_fractions(regular_polygon(6), (0.2, 0.1)).moves
    6
    """
    sets = polygon_reach(workspace, before, moves=moves, contacts=contacts)
    return PolygonFractions(workspace, sets[0].before, sets)


def polygon_radii(reach: PolygonReach, ahead: Points) -> NDArray[np.float64]:
    """Return how far a reachable set extends from zero in the directions of n unit vectors; float64, shape (n,)."""
    radii = np.zeros(len(ahead))
    for sign, depths in zip((1.0, -1.0), reach.depths, strict=True):
        on = np.flatnonzero(depths >= 0)
        slope = sign * (reach.workspace.normals[reach.walls[on]] @ ahead.T)
        with np.errstate(divide="ignore", invalid="ignore"):
            allowed = np.where(slope > _LEVEL, depths[on, None] / slope, np.where(slope < -_LEVEL, 0.0, np.inf))
        ways = _ways(reach.workspace, reach.contacts[on], sign * ahead)
        radii = np.maximum(radii, np.minimum(ways, allowed).max(axis=0, initial=0.0))
    return radii


def border_point(space: ConvexWorkspace, ahead: ArrayLike) -> Points:
    """Return the point at which a ray from the origin leaves a workspace that contains the origin; float64, shape (2,)."""
    unit = np.asarray(ahead, dtype=np.float64)
    return np.asarray(_ways(space, np.zeros((1, 2)), unit[None])[0, 0] * unit)


def _around(count: int) -> Points:
    """Return ``count`` unit vectors with equally spaced directions."""
    angles = 2 * pi * (np.arange(count) + 0.5) / count
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _ways(workspace: ConvexWorkspace, points: Points, ahead: Points) -> NDArray[np.float64]:
    """Return the distance from each point to the wall in each given direction; float64, shape (points, directions)."""
    rates = ahead @ workspace.normals.T
    clear = np.maximum(workspace.wall_distances(points), 0.0)
    way = np.full((len(points), len(ahead)), np.inf)
    for wall in range(len(workspace.normals)):
        with np.errstate(divide="ignore", invalid="ignore"):
            way = np.minimum(way, np.where(rates[:, wall] < -_LEVEL, -clear[:, wall, None] / rates[:, wall], np.inf))
    return way
