"""What Δ can be made in k moves on a disk, and which share of all differences that is.

Two more moves start with a contact c and may bring the other particle to any point q that is no deeper below the wall there than
it was. So of all that can be reached in k moves only the greatest depth H_k(c) at each contact matters: the sets of k + 2 moves are

    { q - c : q in the disk, depth of q below the wall at c <= H_k(c) },

and H_(k+2)(c) is the greatest depth at c that any of them has. On a disk the second particle's contacts give the same sets.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from shoal.checks import check_integer
from shoal.errors import InvalidInputError
from shoal.steering.workspaces.convex import ConvexWorkspace, disk

_SLACK = 1e-12
_AT_ONCE = 2_000_000


@dataclass(frozen=True, eq=False)
class DiskReach:
    """What can be reached on a disk after an even number of moves, Δ at the start turned to point right.

    Parameters
    ----------
    radius : float
    moves : int
        2, 4, 6, ...
    angles : ndarray of float64, shape (contacts,)
        Of the contacts that are looked at.
    depths : ndarray of float64, shape (contacts,)
        H_(moves - 2): how deep below the wall at each contact the other particle may lie; negative where it cannot be.
    distance : float
        Between the particles at the start.
    """

    radius: float
    moves: int
    angles: NDArray[np.float64]
    depths: NDArray[np.float64]

    distance: float = 0.0

    @property
    def workspace(self) -> ConvexWorkspace:
        """The disk, around the origin."""
        return disk(self.radius)

    @property
    def before(self) -> NDArray[np.float64]:
        """Δ at the start; float64, shape (2,)."""
        return np.array([self.distance, 0.0])

    def contains(self, differences: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell for each difference, shape (..., 2), whether it can be reached; bool, shape (...).

        Contacts between two of `angles` are not looked at, so this says no a little too often.
        """
        points = differences.reshape(-1, 2)
        found = np.zeros(len(points), dtype=np.bool_)
        wall = np.stack([np.cos(self.angles), np.sin(self.angles)])
        rows = max(1, _AT_ONCE // len(self.angles))
        for first in range(0, len(points), rows):
            part = points[first : first + rows]
            depth = -(part @ wall)
            inside = 2 * self.radius * depth >= np.sum(part * part, axis=1)[:, None]
            found[first : first + rows] = np.any(inside & (depth <= self.depths + _SLACK), axis=1)
        return found.reshape(differences.shape[:-1])

    def fraction(self, *, rings: int = 400, spokes: int = 120) -> float:
        """Return the share of the area of all differences, from so many sample points."""
        radii = 2 * self.radius * np.sqrt((np.arange(rings) + 0.5) / rings)  # rings of equal area
        turns = 2 * pi * (np.arange(spokes) + 0.5) / spokes
        points = np.stack([radii[:, None] * np.cos(turns), radii[:, None] * np.sin(turns)], axis=-1)
        return float(self.contains(points).mean())


def check_moves(moves: int) -> int:
    """Return an even number of moves; raise InvalidInputError for others."""
    if check_integer(moves, what="moves", least=2) % 2:
        raise InvalidInputError(f"moves: expected an even number, 2 or more, got {moves}")
    return int(moves)


def disk_reach(distance: float, *, moves: int, radius: float = 0.5, contacts: int = 720) -> list[DiskReach]:
    """Return what two particles on a disk can reach after 2, 4, ..., ``moves`` moves; particle 2 starts to the right of 1.

    Only the distance at the start matters: a turn of the start turns the sets.

    Parameters
    ----------
    distance : float
        Between the particles at the start, above 0 and at most twice the radius.
    moves : int
        Even, 2 or more.
    radius : float
    contacts : int
        How many contacts are looked at; the sets are slightly too small by that.

    Raises
    ------
    InvalidInputError
        For other numbers.

    Notes
    -----
    Source: paper W, section IV.F and Figs. 8 and 9.

    Examples
    --------
    >>> [round(100 * reach.fraction()) for reach in disk_reach(0.1, moves=6)]
    [6, 30, 56]
    """
    if not 0 < distance <= 2 * radius:
        raise InvalidInputError(f"distance: expected a number above 0 and at most {2 * radius:g}, got {distance!r}")
    check_moves(moves)
    angles = 2 * pi * np.arange(contacts) / contacts
    depth = -distance * np.cos(angles)
    depths = np.where(2 * radius * depth >= distance * distance - _SLACK, depth, -1.0)
    sets = [DiskReach(radius, 2, angles, depths, distance)]
    for done in range(4, moves + 1, 2):
        depths = _deeper(radius, angles, depths)
        sets.append(DiskReach(radius, done, angles, depths, distance))
    return sets


def _deeper(radius: float, angles: NDArray[np.float64], depths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the greatest depth below the wall at each contact that a difference reached over any other contact has.

    For a pair of contacts c (used) and d (next) that is the largest -d·(q - c) over the points q of the disk from which
    q - c + d lies in the disk as well, and which are no deeper below the wall at c than allowed: the best of a few points.
    """
    wall = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    used, allowed = wall[depths >= 0], depths[depths >= 0]
    here, there = radius * used[:, None], radius * wall[None]
    shift = there - here  # of the second disk: |q + shift| <= radius
    best = np.full(len(angles), -1.0)
    limit = (radius - allowed)[:, None]
    for candidates in _corners(radius, used[:, None], wall[None], shift, limit):
        fits = np.sum(candidates**2, axis=-1) <= radius**2 + _SLACK
        fits &= np.sum((candidates + shift) ** 2, axis=-1) <= radius**2 + _SLACK
        fits &= np.sum(candidates * used[:, None], axis=-1) >= limit - _SLACK
        depth = -np.sum((candidates - here) * wall[None], axis=-1)
        best = np.maximum(best, np.max(np.where(fits, depth, -1.0), axis=0))
    return best


def _corners(
    radius: float,
    used: NDArray[np.float64],
    wall: NDArray[np.float64],
    shift: NDArray[np.float64],
    limit: NDArray[np.float64],
) -> list[NDArray[np.float64]]:
    """Return where the largest depth can lie: opposite in either disk, and where two of three borders meet."""
    across = np.stack([-used[..., 1], used[..., 0]], axis=-1)
    full = np.broadcast_to(-radius * wall, shift.shape)
    points = [full, full - shift]
    chord = np.sqrt(np.maximum(radius**2 - limit**2, 0.0))[..., None]
    middle = limit[..., None] * used
    points += [np.broadcast_to(middle + sign * chord * across, shift.shape) for sign in (1, -1)]
    # The line meets the second disk, whose centre is -shift.
    off = limit + np.sum(shift * used, axis=-1)
    half = np.sqrt(np.maximum(radius**2 - off**2, 0.0))[..., None]
    foot = -shift + off[..., None] * used
    points += [foot + sign * half * across for sign in (1, -1)]
    length = np.sqrt(np.sum(shift**2, axis=-1))
    rise = np.sqrt(np.maximum(radius**2 - length**2 / 4, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        sideways = np.stack([-shift[..., 1], shift[..., 0]], axis=-1) * np.nan_to_num(rise / length)[..., None]
    points += [-shift / 2 + sign * sideways for sign in (1, -1)]
    return points
