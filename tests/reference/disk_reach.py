"""The sets of Δ that moves reach on a disk by the greatest depths at contacts: what
`shoal.steering.disk_reach` is compared with.

Two more moves start with a contact c and may bring the other particle to any point q that is no
deeper below the wall there than it was. So of all that can be reached in k moves only the greatest
depth H_k(c) at each contact matters: the sets of k + 2 moves are

    { q - c : q in the disk, depth of q below the wall at c <= H_k(c) },

and H_(k+2)(c) is the greatest depth at c that any of them has.
"""

from __future__ import annotations

from math import pi

import numpy as np
from numpy.typing import NDArray

_SLACK = 1e-12


def depths_of(
    distance: float, *, moves: int, radius: float, contacts: int
) -> list[NDArray[np.float64]]:
    """Return the depths at equally spaced contacts by which 2, 4, ... moves reach what they do."""
    angles = 2 * pi * np.arange(contacts) / contacts
    depth = -distance * np.cos(angles)
    found = [np.where(2 * radius * depth >= distance * distance - _SLACK, depth, -1.0)]
    for _done in range(4, moves + 1, 2):
        found.append(_deeper(radius, angles, found[-1]))
    return found


def contains(
    depths: NDArray[np.float64], radius: float, differences: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Tell for each difference, shape (n, 2), whether it is reached; no a little too often, as few
    contacts are looked at.
    """
    angles = 2 * pi * np.arange(len(depths)) / len(depths)
    depth = -(differences @ np.stack([np.cos(angles), np.sin(angles)]))
    inside = 2 * radius * depth >= np.sum(differences * differences, axis=1)[:, None]
    return np.any(inside & (depth <= depths + _SLACK), axis=1)


def _deeper(
    radius: float, angles: NDArray[np.float64], depths: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the greatest depth below the wall at each contact that a difference reached over any
    other contact has.

    For a pair of contacts c (used) and d (next) that is the largest -d·(q - c) over the points q of
    the disk from which q - c + d lies in the disk as well, and which are no deeper below the wall
    at c than allowed: the best of a few points.
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
    """Return where the largest depth can lie: opposite in either disk, and where two of three
    borders meet.
    """
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
        sideways = (
            np.stack([-shift[..., 1], shift[..., 0]], axis=-1)
            * np.nan_to_num(rise / length)[..., None]
        )
    points += [-shift / 2 + sign * sideways for sign in (1, -1)]
    return points
