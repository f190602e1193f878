"""Following particles from one picture to the next, and telling those that moved freely from those
that a wall held.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Points = NDArray[np.float64]

BAND = 0.2  # half width of the most frequent motion, as a share of its length


def match(before: Points, after: Points, expected: ArrayLike, reach: float) -> NDArray[np.int64]:
    """Return pairs of rows (before, after) that show the same particle (int64, shape (k, 2)).

    A particle moves by any part of the expected motion, because a wall may hold it: its distance
    from that segment counts, and a little its distance from the full motion. The assignment has the
    smallest sum of distances (Hungarian method); pairs farther away than ``reach`` are left out.
    """
    from scipy.optimize import linear_sum_assignment

    if not len(before) or not len(after):
        return np.empty((0, 2), dtype=np.int64)
    step = np.asarray(expected, dtype=np.float64)
    length = float(step @ step)
    moved = after[None, :, :] - before[:, None, :]
    share = np.clip(moved @ step / length, 0, 1) if length else np.zeros(moved.shape[:2])
    aside = np.linalg.norm(moved - share[..., None] * step, axis=2)
    short = np.linalg.norm(moved - step, axis=2)
    # what is out of reach costs the same everywhere, so that it cannot bend the other pairs
    cost = np.where(aside > reach, 10 * reach, aside + 0.1 * np.minimum(short, 2 * reach))
    first, second = linear_sum_assignment(cost)
    near = aside[first, second] <= reach
    return np.column_stack([first[near], second[near]]).astype(np.int64)


def free_motion(motions: Points, noise: float) -> tuple[Points, NDArray[np.bool_]]:
    """Return the motion of the particles that no wall held, and which ones these are.

    Particles that hardly moved are left out. Of the others, the most frequent motion counts: the
    one with most motions within `BAND` of its length (or three times the noise), and the median of
    these.

    Parameters
    ----------
    motions : ndarray of float64, shape (n, 2)
    noise : float
        Standard deviation of a motion along each axis.

    Returns
    -------
    motion : ndarray of float64, shape (2,)
        NaN if nothing moved.
    free : ndarray of bool, shape (n,)
    """
    lengths = np.linalg.norm(motions, axis=1)
    most = float(np.quantile(lengths, 0.95)) if len(lengths) else 0.0
    moving = np.flatnonzero(lengths > max(most / 2, 2 * noise))
    free = np.zeros(len(motions), dtype=bool)
    if not len(moving):
        return np.full(2, np.nan), free
    candidates = motions[moving]
    band = max(BAND * most, 3 * noise)
    near = np.linalg.norm(candidates[:, None] - candidates[None], axis=2) <= band
    middle = np.median(candidates[near[near.sum(1).argmax()]], axis=0)
    inside = np.linalg.norm(candidates - middle, axis=1) <= band
    free[moving[inside]] = True
    return np.median(candidates[inside], axis=0), free


def likely_shift(before: Points, after: Points, least: float, most: float) -> Points:
    """Return the shift by which most points of a picture lie on points of another: of all
    differences whose length is between two bounds, the one with most others near it.

    Returns
    -------
    shift : ndarray of float64, shape (2,)
        0 if no difference has such a length.
    """
    shifts = (after[None, :, :] - before[:, None, :]).reshape(-1, 2)
    lengths = np.linalg.norm(shifts, axis=1)
    shifts = shifts[(lengths >= least) & (lengths <= most)]
    if not len(shifts):
        return np.zeros(2)
    from scipy.spatial import KDTree

    tree = KDTree(shifts)
    near = tree.query_ball_point(shifts, BAND * most / 2)
    return np.asarray(np.median(shifts[max(near, key=len)], axis=0), dtype=np.float64)
