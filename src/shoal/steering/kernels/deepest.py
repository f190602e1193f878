"""The greatest depth below each contact that a reached difference has: many small linear programs, by clipping."""

from __future__ import annotations

import numpy as np

from shoal.steering.kernels.compiling import kernel
from shoal.steering.kernels.contact import dot
from shoal.steering.kernels.nearest import clip

TINY = 1e-12


@kernel
def deeper(corners, normals, offsets, contacts, walls, depths):
    """Return the greatest depths after one more cycle, shape (2, contacts); negative where the toucher cannot be.

    For a pair of contacts c (used, of particle s) and d (next, of particle t) that is the largest t N_d . D over D = s (q - c),
    q in the polygon no deeper below the wall of c than allowed, and d + t D in the polygon: a polygon cut by half-planes.
    """
    n, sides = contacts.shape[0], normals.shape[0]
    best = np.full((2, n), -1.0)
    one, other = np.empty((4 * sides + 8, 2)), np.empty((4 * sides + 8, 2))
    normal, spot = np.empty(2), np.empty(2)
    for s in range(2):
        sign = 1.0 if s == 0 else -1.0
        for c in range(n):
            if depths[s, c] < 0:
                continue
            wall = walls[c]
            one[:sides] = corners
            for i in range(2):
                normal[i] = -normals[wall, i]
            slab = clip(one, sides, normal, -(offsets[wall] + depths[s, c]) - TINY, other)
            for t in range(2):
                turn = sign * (1.0 if t == 0 else -1.0)
                for d in range(n):
                    one[:slab] = other[:slab]
                    count = inside_shifted(one, slab, contacts[c], contacts[d], turn, normals, offsets)
                    for k in range(count):
                        for i in range(2):
                            spot[i] = turn * (one[k, i] - contacts[c, i])
                        best[t, d] = max(best[t, d], dot(normals[walls[d]], spot))
    return best


@kernel
def inside_shifted(corners, count, used, following, turn, normals, offsets):
    """Cut a polygon, in place, to the points q with ``following + turn (q - used)`` inside; return how many corners are left."""
    spare = np.empty((corners.shape[0], 2))
    normal = np.empty(2)
    for wall in range(normals.shape[0]):
        for i in range(2):
            normal[i] = turn * normals[wall, i]
        least = offsets[wall] - dot(normals[wall], following) + turn * dot(normals[wall], used)
        count = clip(corners, count, normal, least - TINY, spare)
        corners[:count] = spare[:count]
        if count == 0:
            return 0
    return count
