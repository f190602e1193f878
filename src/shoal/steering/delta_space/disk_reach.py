"""The differences Δ of two particles that k moves reach on a disk, and their fraction of all differences.

The first of two moves brings one particle into contact with the wall at a point c. The depth of a point is its distance from the
tangent of the wall at c. The second move can bring the other particle to any point q of the disk that is not deeper than this
particle was at the contact. The reachable set is therefore a union of convex sets { q - c } that contain Δ = 0. This union is
described by its *radii*: the extent of the set in each direction. Let H be the largest depth that the other particle can have at a
contact, and N the inward normal of the wall. In a direction e, this contact gives the extent H / (N·e), or the distance from c to
the opposite wall if this distance is smaller. The radius in direction e is the largest extent over all contacts. The depths for the
next two moves follow from the radii. On a disk, contacts of either particle give the same sets.
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
    """The differences Δ of two particles that an even number of moves reaches on a disk.

    The coordinates are rotated so that the initial difference Δ points to the right.

    Parameters
    ----------
    radius : float
    distance : float
        Distance between the particles at the start.
    moves : int
        2, 4, 6, ...
    radii : ndarray of float64, shape (n,)
        Extent of the set of differences Δ in n directions. The directions are the midpoints of n equal intervals of angles from 0
        to π. The set is symmetrical, so the radii in the other directions follow.
    """

    radius: float
    distance: float
    moves: int
    radii: NDArray[np.float64]

    @property
    def workspace(self) -> ConvexWorkspace:
        """The disk, around the origin."""
        return disk(self.radius)

    @property
    def before(self) -> NDArray[np.float64]:
        """Δ at the start; float64, shape (2,)."""
        return np.array([self.distance, 0.0])

    @property
    def outline(self) -> Points:
        """Boundary of the set; float64, shape (2 n, 2) for n radii."""
        ahead = _ahead(len(self.radii))
        angles = np.concatenate([ahead, 2 * pi - ahead[::-1]])
        radii = np.concatenate([self.radii, self.radii[::-1]])
        return np.asarray(radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1))

    def contains(self, differences: ArrayLike) -> NDArray[np.bool_]:
        """Return for each difference, shape (..., 2), whether it can be reached; bool, shape (...)."""
        given = np.asarray(differences, dtype=np.float64)
        angles = np.abs(np.arctan2(given[..., 1], given[..., 0]))
        return np.asarray(np.hypot(given[..., 0], given[..., 1]) <= np.interp(angles, _ahead(len(self.radii)), self.radii))

    def fraction(self) -> float:
        """Return the area of the set as a fraction of the area of all differences."""
        return float(np.mean(self.radii**2)) / (2 * self.radius) ** 2


def check_moves(moves: int) -> int:
    """Return ``moves`` if this number is even and at least 2. Other numbers raise InvalidInputError."""
    if check_integer(moves, what="moves", least=2) % 2:
        raise InvalidInputError(f"moves: expected an even number, 2 or more, got {moves}")
    return int(moves)


def disk_reach(distance: float, *, moves: int, radius: float = 0.5, directions: int = DIRECTIONS) -> list[DiskReach]:
    """Return the sets that two particles on a disk reach after 2, 4, ..., ``moves`` moves.

    Particle 2 starts to the right of particle 1.

    Only the initial distance matters, because a rotation of the start rotates the sets.

    Parameters
    ----------
    distance : float
        Distance between the particles at the start, above 0 and at most twice the radius.
    moves : int
        Number of moves, even and at least 2.
    radius : float
    directions : int
        Number of contacts, and of directions of Δ, in the computation; at least 16.

    Raises
    ------
    InvalidInputError
        If a number is out of range.

    Notes
    -----
    Source: paper W, section IV.F and Figs. 8 and 9.

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
    """Return the directions of the radii, from 0 to π."""
    return pi * (np.arange(count) + 0.5) / count


def _furthest(ahead: NDArray[np.float64], contacts: NDArray[np.float64], depths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the extent of the set of differences Δ in each direction, from contacts with given depths of the other particle."""
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
    """Return the largest depth that Δ can have below each contact."""
    around, far = np.concatenate([-ahead[::-1], ahead]), np.concatenate([radii[::-1], radii])
    slope = np.maximum(np.cos(around - contacts[:, None]), 0.0)
    return np.asarray((np.minimum(far, slope) * slope).max(axis=1))
