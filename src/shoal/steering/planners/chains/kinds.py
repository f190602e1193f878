"""Kinds of chains (sequences of touching particles and walls), and lower bounds on the lengths of chains of each kind.

The path of a particle via some walls is at least as long as the distance from its start to the mirror image of its goal in these
walls. The position difference of two particles changes only during moves in which a wall holds a particle. Let c be the length of
the total change of the position difference, from the start to the goals. Let a and b be lower bounds on the lengths of the paths of
the two particles. If only the particle with the bound a touches walls, the length of the chain is at least a + c. If both particles
touch walls, the length of the chain is at least (a + b + c) / 2.
"""

from __future__ import annotations

from math import inf

import numpy as np
from numpy.typing import NDArray

from shoal.steering.workspaces.convex_geometry import Points
from shoal.steering.workspaces.normalized_walls import NormalizedWalls

_AROUND = np.exp(2j * np.pi * np.arange(48) / 48)


def way_over_circle(one: Points, other: Points, radius: float) -> float:
    """Return the length of the shortest path from one point via a circle around the origin to the other point.

    Notes
    -----
    Let S and G be the two points as complex numbers, and let r be the radius of the circle. The contact is r z, where z with |z| =
    1 is a root of A z^4 - B z^3 + conj(B) z - conj(A) with A = conj(S G) and B = r conj(S + G) (Alhazen's problem). For points near
    the circle, several roots lie close together, so the function also tries the points of the circle nearest to S and G, and 48
    evenly spaced points.
    """
    s, g = complex(*one[:2]) / radius, complex(*other[:2]) / radius
    a, b = np.conj(s * g), np.conj(s + g)
    found = np.roots([a, -b, 0, np.conj(b), -np.conj(a)])
    spots = np.concatenate([found, [s, g], _AROUND])
    spots = spots[spots != 0]
    spots = spots / np.abs(spots)
    flat = radius * float(np.min(np.abs(spots - s) + np.abs(spots - g)))
    return float(np.hypot(flat, np.linalg.norm(one[2:] - other[2:])))


def lengths_over_walls(start: Points, goal: Points, walls: NormalizedWalls) -> NDArray[np.float64]:
    """Return, for each particle and wall, the length of the particle's shortest path to its goal via the wall.

    The result is a float64 array of the shape (2, walls + 1), whose last column belongs to the round wall.
    """
    high = np.maximum(start @ walls.normals.T - walls.offsets, 0)
    low = np.maximum(goal @ walls.normals.T - walls.offsets, 0)
    flat = np.sqrt(np.sum((start - goal) ** 2, axis=1)[:, None] + 4 * high * low)
    round_ = [way_over_circle(s, g, walls.circle[2]) if walls.round else inf for s, g in zip(start, goal, strict=True)]
    return np.column_stack([flat, round_])


def bounds_of(
    touchers: NDArray[np.int64], on: NDArray[np.int64], start: Points, goal: Points, walls: NormalizedWalls,
    lengths: NDArray[np.float64],
) -> NDArray[np.float64]:  # fmt: skip
    """Return, for each kind of chain, a lower bound on the length of all chains of this kind; float64, shape (kinds,).

    A kind of chain is a sequence of touching particles (a row of ``touchers``) and walls (a row of ``on``).

    Parameters
    ----------
    touchers, on : ndarray of int64, shape (kinds, cycles)
    start, goal : ndarray of float64, shape (2, d)
    walls : NormalizedWalls
    lengths : ndarray of float64, shape (2, walls + 1)
        The result of `lengths_over_walls`.
    """
    apart = float(np.linalg.norm((start[1] - start[0]) - (goal[1] - goal[0])))
    normals = np.vstack([walls.normals, np.zeros((1, walls.dimensions))])  # no change for mirror images in the circle
    offsets = np.append(walls.offsets, 0.0)
    least, used = np.empty((2, len(on))), np.empty((2, len(on)), dtype=np.bool_)
    for p in (0, 1):
        own = touchers == p
        used[p] = own.any(axis=1)
        image = np.repeat(goal[p][None], len(on), axis=0)
        for m in range(on.shape[1] - 1, -1, -1):
            normal = normals[on[:, m]] * own[:, m, None]
            over = np.einsum("ij,ij->i", normal, image) - offsets[on[:, m]]
            image -= 2 * over[:, None] * normal
        flat = ~(own & (on == len(walls.normals))).any(axis=1)
        direct = np.maximum(np.where(flat, np.linalg.norm(image - start[p], axis=1), 0.0), np.linalg.norm(goal[p] - start[p]))
        least[p] = np.maximum(direct, np.where(own, lengths[p][on], 0.0).max(axis=1))
    both = np.maximum((least.sum(axis=0) + apart) / 2, least.max(axis=0))
    return np.asarray(np.where(used.all(axis=0), both, np.where(used[0], least[0], least[1]) + apart))


def kinds_of(
    start: Points, goal: Points, walls: NormalizedWalls, *, cycles: int, push: float, bound: float = inf
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Return the kinds of chains with ``cycles`` contacts on flat walls that may be shorter than ``bound``, the best kind first.

    A kind of chain is a sequence of touching particles and walls. The best kind is the kind with the smallest lower bound on the
    length.

    Returns
    -------
    touchers, on : ndarray of int64, shape (kinds, cycles)
    bounds : ndarray of float64, shape (kinds,)
    """
    options = np.arange(2 * len(walls.normals))
    firsts, lasts = (_fitting(delta, walls, least) for delta, least in ((start[1] - start[0], push), (goal[1] - goal[0], -1e-12)))
    choices = [firsts, *[options] * (cycles - 2), lasts] if cycles > 1 else [np.intersect1d(firsts, lasts)]
    kinds = np.stack(np.meshgrid(*choices, indexing="ij"), axis=-1).reshape(-1, cycles)
    kinds = kinds[(kinds[:, 1:] != kinds[:, :-1]).all(axis=1)]  # mostly one contact; `improvement` inserts the others
    touchers, on = kinds % 2, kinds // 2
    bounds = bounds_of(touchers, on, start, goal, walls, lengths_over_walls(start, goal, walls))
    order = np.argsort(bounds, kind="stable")
    order = order[: np.searchsorted(bounds[order], bound)]
    return touchers[order], on[order], bounds[order]


def _fitting(delta: Points, walls: NormalizedWalls, least: float) -> NDArray[np.int64]:
    """Return the pairs of a wall and a touching particle that may be feasible, each as the number 2 · wall + particle.

    The test is fast, and never excludes a feasible pair. For each wall, the test computes the largest distance of the other
    particle from this wall over the bounding box of all possible contacts. A pair passes the test only if none of these distances
    is negative.
    """
    heights = walls.normals @ delta
    middle = walls.frames[:, 0] @ walls.normals.T - walls.offsets  # wall, other wall
    most = middle + walls.reaches[:, None] * np.abs(walls.frames[:, 1:] @ walls.normals.T).sum(axis=1)
    fits = np.stack([((most + sign * heights) >= -1e-9).all(axis=1) & (sign * heights > least) for sign in (1, -1)], axis=1)
    return np.flatnonzero(fits)
