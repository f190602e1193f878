"""Lower bounds for any workspace and any number of particles, by shortest paths of one or two."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import combinations, permutations
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.steering.problem import SteeringProblem
from shoal.steering.workspaces.convex import ConvexWorkspace, Points

_GROWN = 1e-9  # relative to the size: how far a line of sight may leave the region
_MOST = 6  # particles whose assignments to goals are tried one by one


def geodesic_bound(problem: SteeringProblem, start: Points, goal: Points) -> float:
    """Return a lower bound on the length of all plans, from the shortest path of each particle.

    A plan is at least as long as the path of each particle. Without sliding, a plan of two
    particles is at least as long as half of the sum of their paths and of the change of their
    difference, because an input that does not move one of them changes the difference. A plan is
    one for each two of its particles, so in a convex workspace it is at least as long as the bound
    of the planner `Shortest` for them.
    """
    space = problem.world().free_space
    paths = geodesics(space, start, goal)
    orders = (
        permutations(range(len(start)))
        if problem.interchangeable and len(start) <= _MOST
        else [tuple(range(len(start)))]
    )
    if problem.interchangeable and len(start) > _MOST:
        return max(float(paths.min(axis=1).max()) - problem.tolerance, 0.0)
    pairs = _pair_bounds(problem, start, goal) if isinstance(space, ConvexWorkspace) else None
    bounds = []
    for order in orders:
        least = _bound(problem, start, goal[list(order)], paths[range(len(order)), order])
        if pairs is not None:
            for i, j in combinations(range(len(order)), 2):
                least = max(least, pairs(i, j, order[i], order[j]))
        bounds.append(least)
    return max(min(bounds), 0.0)


def _pair_bounds(
    problem: SteeringProblem, start: Points, goal: Points
) -> Callable[[int, int, int, int], float]:
    """Return a function with the bound for two particles, by their numbers and those of their
    goals.
    """
    from shoal.steering.planners.task import SteeringTask

    world = problem.world(gain=0.0)

    @cache
    def bound(i: int, j: int, goal_i: int, goal_j: int) -> float:
        ends = start[[i, j]], goal[[goal_i, goal_j]]
        return SteeringTask(world, *ends, problem.tolerance, problem.max_moves, 0).lower_bound()

    return bound


def _bound(
    problem: SteeringProblem, start: Points, goal: Points, paths: NDArray[np.float64]
) -> float:
    least = float(paths.max()) - problem.tolerance
    if problem.friction < inf:  # a particle that slides moves, and changes the difference
        return least
    for i, j in combinations(range(len(start)), 2):
        apart = float(np.linalg.norm((goal[j] - goal[i]) - (start[j] - start[i])))
        total = float(paths[i] + paths[j]) + apart
        least = max(least, total / 2 - 2 * problem.tolerance)
    return least


def geodesics(space: Any, start: Points, goal: Points) -> NDArray[np.float64]:
    """Return the length of the shortest path from each start to each goal; float64, shape
    (starts, goals).
    """
    straight = np.linalg.norm(goal[None] - start[:, None], axis=2)
    if isinstance(space, ConvexWorkspace):
        return np.asarray(straight)
    import shapely
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    # A slightly larger region has shorter paths, so that rounding errors never raise a bound.
    shape = space.shape.buffer(_GROWN * space.size, join_style="mitre")
    shapely.prepare(shape)
    nodes = np.concatenate([start, goal, *space.rings])
    tails, heads = np.triu_indices(len(nodes), 1)
    lines = shapely.linestrings(np.stack([nodes[tails], nodes[heads]], axis=1))
    lengths = np.linalg.norm(nodes[tails] - nodes[heads], axis=1)
    # Shapely finds no line between points at one place in any shape
    visible = shapely.covers(shape, lines) | (lengths == 0)
    # sparse, because SciPy takes lengths of about zero in a full matrix for missing edges
    edges = lengths[visible], (tails[visible], heads[visible])
    graph = csr_array(edges, shape=(len(nodes), len(nodes)))
    distances = dijkstra(graph, directed=False, indices=range(len(start)))
    distances = distances[:, len(start) : len(start) + len(goal)]
    return np.asarray(np.maximum(np.where(np.isfinite(distances), distances, 0.0), straight))
