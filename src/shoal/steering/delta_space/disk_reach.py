"""The set of position differences Δ that two particles on a disk can reach with k moves, and the relative area of this set.

The first move of a cycle brings one particle to a contact c on the wall. The depth of a point below c is its distance from the
tangent of the wall at c. The second move of the cycle can bring the other particle to any point of the disk whose depth below c is
at most the depth that the other particle has after the first move. The vectors from c to all these points form a convex set that
contains the zero vector. The set of all reachable position differences is the union of these convex sets for all contacts c.
Contacts of particle 1 and contacts of particle 2 give the same union.

The attribute ``radii`` of `DiskReach` states how far this union extends from the zero vector in each direction. Let H be the
largest depth of the other particle below a contact c, and let N be the inward normal of the wall at c. In the direction of a unit
vector e, the convex set of c extends to the smaller of two lengths. The first length is H / (N·e). The second length is the length
of the chord of the disk from c in the direction e. The radius of the union in the direction e is the largest extent for all
contacts. The radii after k moves determine the largest depths for the moves k + 1 and k + 2.
"""

from __future__ import annotations

from math import pi

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_integer, check_number
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.steering.workspaces.convex import ConvexWorkspace, disk
from shoal.steering.workspaces.convex_geometry import Points

DIRECTIONS = 720
_LEVEL = 1e-12


@dataclass(frozen=True, eq=False)
class DiskReach:
    """The set of position differences Δ that two particles on a disk can reach with an even number of moves.

    The x axis points in the direction of the initial position difference Δ.

    Parameters
    ----------
    radius : float
        Radius of the disk, in any unit of length.
    distance : float
        Distance between the two particles at the start, in the same unit as ``radius``.
    moves : int
        Number of moves: 2, 4, 6, ...
    radii : ndarray of float64, shape (n,)
        For each of n directions, how far the set of position differences extends from the zero vector. The angles of the n
        directions are the midpoints of n equal intervals between 0 and π radians. The set is symmetrical about the x axis, so
        ``radii`` also holds for the negative angles.
    """

    radius: float
    distance: float
    moves: int
    radii: NDArray[np.float64]

    @property
    def workspace(self) -> ConvexWorkspace:
        """The disk as a workspace, with its centre at the origin."""
        return disk(self.radius)

    @property
    def before(self) -> NDArray[np.float64]:
        """The position difference Δ at the start; float64, shape (2,)."""
        return np.array([self.distance, 0.0])

    @property
    def outline(self) -> Points:
        """Points on the boundary of the set of position differences; float64, shape (2 n, 2) for n radii."""
        ahead = _ahead(len(self.radii))
        angles = np.concatenate([ahead, 2 * pi - ahead[::-1]])
        radii = np.concatenate([self.radii, self.radii[::-1]])
        return np.asarray(radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1))

    def contains(self, differences: ArrayLike) -> NDArray[np.bool_]:
        """Return for each position difference, shape (..., 2), whether the particles can reach it; bool, shape (...)."""
        given = np.asarray(differences, dtype=np.float64)
        angles = np.abs(np.arctan2(given[..., 1], given[..., 0]))
        return np.asarray(np.hypot(given[..., 0], given[..., 1]) <= np.interp(angles, _ahead(len(self.radii)), self.radii))

    def fraction(self) -> float:
        """Return the area of the reachable set divided by the area of the set of all position differences in the disk."""
        return float(np.mean(self.radii**2)) / (2 * self.radius) ** 2


MAX_MOVES = 10_000  # far more than any set of differences needs to fill the workspace


def check_moves(moves: int) -> int:
    """Return the number ``moves`` if it is even, at least 2 and at most `MAX_MOVES`, or raise InvalidInputError."""
    if check_integer(moves, what="moves", least=2, most=MAX_MOVES) % 2:
        raise InvalidInputError(f"moves: expected an even number, 2 or more, got {moves}")
    return int(moves)


def disk_reach(distance: float, *, moves: int, radius: float = 0.5, directions: int = DIRECTIONS) -> list[DiskReach]:
    """Return the sets of position differences that two particles on a disk can reach after 2, 4, ..., ``moves`` moves.

    Particle 2 starts to the right of particle 1. If the initial position difference has another angle to the x axis, rotate the
    sets by this angle.

    Parameters
    ----------
    distance : float
        Distance between the particles at the start, above 0 and at most twice the radius of the disk.
    moves : int
        Number of moves, even and at least 2.
    radius : float
        Radius of the disk, in the same unit as ``distance``.
    directions : int
        Number of sampled contacts, and number of sampled directions of the position difference; at least 16.

    Raises
    ------
    InvalidInputError
        If a number is out of range.

    Notes
    -----
    Source: paper W, section IV.F and figures 8 and 9.

    Examples
    --------
    >>> [round(100 * reach.fraction(), 1) for reach in disk_reach(0.1, moves=6)]
    [6.3, 30.1, 55.8]
    """
    size = 2 * check_number(radius, what="radius", above=0)
    check_number(distance, what="distance", above=0, most=size)
    check_moves(moves)
    check_integer(directions, what="directions", least=16)
    ahead = _ahead(directions // 2)
    half = np.arccos(min(1.0, distance / size))
    contacts = np.linspace(-half, half, directions)  # rotated by π: contacts lie on the side opposite to Δ
    depths = distance / size * np.cos(contacts)
    sets: list[DiskReach] = []
    for done in range(2, moves + 1, 2):
        if sets:
            contacts = np.linspace(-pi, pi, directions)
            depths = _deepest(ahead, sets[-1].radii / size, contacts)
        sets.append(DiskReach(radius, distance, done, size * _furthest(ahead, contacts, depths)))
    return sets


def _ahead(count: int) -> NDArray[np.float64]:
    """Return the angles of the directions to which the radii of a `DiskReach` belong, between 0 and π radians."""
    return pi * (np.arange(count) + 0.5) / count


def _furthest(ahead: NDArray[np.float64], contacts: NDArray[np.float64], depths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far the reachable set extends in each direction of ``ahead``, in diameters of the disk.

    For each contact, ``depths`` holds the largest depth of the other particle below the wall's tangent at the contact.
    """
    slope = np.cos(ahead[:, None] - contacts)  # length of each chord, and its inward component per unit of length
    with np.errstate(divide="ignore", invalid="ignore"):
        allowed = np.where(slope > _LEVEL, depths / slope, 0.0)
    reached = np.where(slope > _LEVEL, np.minimum(slope, allowed), 0.0)
    # The longest extent is often between two contacts, where chord and depth limit it equally.
    left = slope - allowed
    crossed = (left[:, :-1] * left[:, 1:] < 0) & (slope[:, :-1] > _LEVEL) & (slope[:, 1:] > _LEVEL)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(crossed, left[:, :-1] / (left[:, :-1] - left[:, 1:]), 0.0)
    between = np.where(crossed, slope[:, :-1] + share * (slope[:, 1:] - slope[:, :-1]), 0.0)
    return np.asarray(np.maximum(reached.max(axis=1), between.max(axis=1)))


def _deepest(ahead: NDArray[np.float64], radii: NDArray[np.float64], contacts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return, for each contact of one particle, the largest depth of the other particle below the wall's tangent at the contact."""
    around, far = np.concatenate([-ahead[::-1], ahead]), np.concatenate([radii[::-1], radii])
    slope = np.maximum(np.cos(around - contacts[:, None]), 0.0)
    return np.asarray((np.minimum(far, slope) * slope).max(axis=1))
