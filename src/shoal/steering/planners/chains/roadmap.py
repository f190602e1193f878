"""Chains of many cycles: paths with the fewest cycles on a roadmap of extreme position differences."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from shoal.steering.kernels.cycles import CycleModel
from shoal.steering.kernels.roadmap import fewest_cycles, linked, widen
from shoal.steering.planners.chains.chain import REFINING, Chain, ChainQuery
from shoal.steering.planners.chains.friction_roadmap import backward_nodes, turning_nodes
from shoal.steering.planners.chains.sides import between_few_sides, on_all_sides
from shoal.steering.workspaces.convex_geometry import Points

MAPS = ((300, 60, 1.02, 200), (1500, 120, 1.01, 400))
"""Settings of the roadmaps that `roadmap_chain` tries one after another. Each setting holds the maximum number of extreme position
differences, the number of ranges of directions, the factor by which a position difference must be more extreme than earlier ones in
the same range, and the number of random position differences.
"""

_INSIDE = 1 + 1e-2  # factor for margin and push, so that a chain of links satisfies the limits of `chains`
_DIRECTIONS = 48  # on a disk


def roadmap_chain(query: ChainQuery, *, maps: tuple[tuple[int, int, float, int], ...] = MAPS, seed: int = 0) -> Chain | None:
    """Return a plane chain that ends exactly with the goals' position difference, or None if no roadmap contains such a chain.

    Notes
    -----
    The method is a probabilistic roadmap in the space of the position differences, and an addition by Shoal. A link of the roadmap
    from one position difference to another means that two moves can change the first into the second. Some nodes are random
    position differences. The other nodes are, for each range of directions, the longest position difference that cycles can reach
    from the start, and the shortest position difference from which cycles can reach the goals. With friction, every path from the
    start to the goals may have to follow these extreme position differences. In a polygon with many corners, the roadmap uses only
    a few sides of the polygon.
    """
    few = between_few_sides(query)
    if few is not query:
        rough = roadmap_chain(few, maps=maps, seed=seed)
        if rough is None:
            return None
        found = on_all_sides(query, few, rough)
        length = query.settle(found.unknowns, found.touchers, found.walls, rounds=REFINING[:3])
        return replace(found, length=length) if length < inf else None
    model = replace(query, friction=query.friction * (1 - 1e-9)).model(_INSIDE)
    rng = np.random.default_rng(seed)
    for extreme, bins, gain, spread in maps:
        if query.late:
            return None
        nodes = [
            np.stack([query.before, query.after]),
            _extreme(query, model, extreme, bins, gain),
            _spread(query, rng, spread),
        ]
        chain = _over(np.concatenate(nodes), model)
        if chain is not None:
            return chain
    return None


def _extreme(query: ChainQuery, model: CycleModel, count: int, bins: int, gain: float) -> Points:
    """Return extreme position differences as nodes of the roadmap; float64, shape (nodes, 2).

    For each narrow range of directions, the nodes are the longest position difference that cycles can reach from the start, and the
    shortest position difference from which cycles can reach the goals.
    """
    walls = query.walls
    if walls.round and query.friction < inf:
        radius, friction = float(walls.circle[2]), model.friction
        return np.concatenate(
            [
                backward_nodes(query.after, radius=radius, friction=friction, margin=2 * model.margin),
                turning_nodes(query.before, query.after, radius=radius, friction=friction),
            ]
        )
    angles = _ray_angles(query)
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    found = []
    for delta, back in ((query.before, False), (query.after, True)):
        nodes, records = np.empty((count, 2)), np.full(bins, inf if back else 0.0)
        found.append(nodes[1 : widen(delta, back, rays, 2.0, model, gain, records, nodes, 0)])
    return np.concatenate(found)


def _ray_angles(query: ChainQuery) -> NDArray[np.float64]:
    """Return the angles of changes of the position difference: along walls' normals, and along the edges of friction cones."""
    normals = query.walls.normals
    if not len(normals):
        return np.asarray(2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS)
    straight = np.arctan2(normals[:, 1], normals[:, 0])
    straight = np.concatenate([straight, straight + np.pi])
    edge = float(np.arctan(query.friction)) * (1 - 1e-6)
    return np.concatenate([straight, straight - edge, straight + edge])


def _spread(query: ChainQuery, rng: np.random.Generator, count: int) -> Points:
    """Return random position differences with lengths of several orders of magnitude."""
    angles = 2 * np.pi * rng.random(count)
    sizes = np.where(rng.random(count) < 0.6, rng.random(count), 10 ** (-3 * rng.random(count)))
    far = 2 * float(query.walls.circle[2]) if query.walls.round else 2.0
    return np.asarray(far * sizes[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1))


def _over(nodes: Points, model: CycleModel) -> Chain | None:
    """Return the chain from node 0 (the start) to node 1 (the goals) that takes the fewest cycles of moves, or None."""
    parents, order = np.empty(len(nodes), dtype=np.int64), np.empty(len(nodes), dtype=np.int64)
    if not fewest_cycles(nodes, model, parents, order):
        return None
    path = [1]
    while path[-1]:
        path.append(int(parents[path[-1]]))
    path.reverse()
    steps = np.empty((len(path) - 1, 3))
    for step, before, after in zip(steps, path, path[1:], strict=False):
        linked(nodes[before], nodes[after], model, step)
    unknowns = np.concatenate([steps[:, 2], nodes[path[1:-1]].ravel()])
    return Chain(steps[:, 0].astype(np.int64), steps[:, 1].astype(np.int64), unknowns, inf)
