"""Chains of many cycles: a tree of differences that grows from the start's until it holds the goal's."""

from __future__ import annotations

from math import inf

import numpy as np
from numpy.typing import NDArray

from shoal.steering.chains import Chain, Errand
from shoal.steering.kernels.nearest import nearest_on_circle, nearest_on_polygon
from shoal.steering.outline import Points

GOAL_SHARE = 0.15  # how often the tree grows towards the goal itself
REACHED = 1e-12


def grown_chain(errand: Errand, *, cycles: int = 45, nodes: int = 6000, seed: int = 0) -> Chain | None:
    """Return a chain in the plane that ends with the goal's difference exactly, None if a tree of so many nodes holds none.

    Each node goes by one cycle to the difference nearest to a random one, or to the goal's, that the cycle can make.

    Notes
    -----
    Ours: a rapidly exploring random tree in the Δ configuration space, whose steps are two-move sets.
    """
    rng = np.random.default_rng(seed)
    space = _difference_samples(errand, rng, nodes)
    deltas = np.zeros((nodes + 1, 2))
    deltas[0] = errand.before
    parents, steps = np.zeros(nodes + 1, dtype=np.int64), np.zeros((nodes + 1, 3))
    depths = np.zeros(nodes + 1, dtype=np.int64)
    count = 1
    for target in space:
        towards = errand.after if rng.random() < GOAL_SHARE else target
        away = np.sum((deltas[:count] - towards) ** 2, axis=1)
        nearest = int(np.argmin(np.where(depths[:count] < cycles - 1, away, inf)))
        found = cycle_towards(errand, deltas[nearest], towards)
        if found is None or found[0] >= np.linalg.norm(deltas[nearest] - towards) - 1e-9:
            continue
        deltas[count], parents[count], steps[count] = found[1], nearest, found[2]
        depths[count] = depths[nearest] + 1
        count += 1
        last = cycle_towards(errand, found[1], errand.after)
        if last is not None and last[0] <= REACHED:
            return _chain_to(count - 1, deltas, parents, steps, last[2])
    return None


def cycle_towards(errand: Errand, delta: Points, target: Points) -> tuple[float, Points, NDArray[np.float64]] | None:
    """Return how near to a difference one cycle comes, the difference it makes, and its toucher, wall and contact."""
    if errand.walls.round:
        found = np.zeros(4)
        nearest_on_circle(delta, target, errand.walls.circle[2], errand.friction, errand.margin, errand.push, found)
        away, x, y, angle = found
        return None if away == inf else (float(away), np.array([x, y]), np.array([0.0, 0.0, angle * errand.walls.circle[2]]))
    frames, normals, offsets, _ = errand.walls.shape
    table = np.full((len(normals), 2, 5), inf)
    nearest_on_polygon(
        delta, target, frames, errand.walls.reaches, normals, offsets, errand.friction, errand.margin, errand.push, table
    )
    wall, toucher = np.unravel_index(int(np.argmin(table[..., 0])), table.shape[:2])
    away, x, y, low, high = table[wall, toucher]
    return None if away == inf else (float(away), np.array([x, y]), np.array([float(toucher), float(wall), (low + high) / 2]))


def _difference_samples(errand: Errand, rng: np.random.Generator, count: int) -> Points:
    """Return random differences of two points of the workspace's box."""
    walls = errand.walls
    if walls.round:
        half = np.array([walls.circle[2], walls.circle[2]])
    else:
        ends = np.concatenate([walls.frames[:, 0] + side * walls.reaches[:, None] * walls.frames[:, 1] for side in (-1, 1)])
        half = np.ptp(ends, axis=0) / 2
    return np.asarray((rng.random((count, 2)) - rng.random((count, 2))) * 2 * half)


def _chain_to(
    node: int, deltas: Points, parents: NDArray[np.int64], steps: NDArray[np.float64], last: NDArray[np.float64]
) -> Chain:
    path = []
    while node > 0:
        path.append(node)
        node = int(parents[node])
    path.reverse()
    cycles = np.vstack([steps[path].reshape(-1, 3), last[None]])
    unknowns = np.concatenate([cycles[:, 2], deltas[path].ravel()])
    return Chain(cycles[:, 0].astype(np.int64), cycles[:, 1].astype(np.int64), unknowns, inf)
