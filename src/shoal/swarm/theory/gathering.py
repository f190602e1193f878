"""Lower bounds and optima of gatherings."""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.swarm.grid.pairs import MOST_CELLS, fewest_to_meet, moves_of
from shoal.swarm.kernels import gathering as kernels
from shoal.swarm.theory.small_world import SmallWorld, set_bits


def fewest_by_pairs(
    free: NDArray[np.bool_],
    offsets: NDArray[np.int64],
    goal: NDArray[np.bool_] | None,
    n: int,
    rule: str,
) -> NDArray[np.int32]:
    """Return the fewest commands that bring two of n particles together, for each pair of the m free
    cells (int32, shape (m, m)). The number is -1 for pairs that no commands bring together.

    ``free`` and ``goal`` are flat masks with a rim, and ``goal`` is None if the particles may gather
    in any cell.
    """
    cells = np.flatnonzero(free)
    inside = np.zeros(0, dtype=np.bool_) if goal is None else goal[cells]
    ahead, may_stay = moves_of(free, offsets, cells, n, rule)
    return fewest_to_meet(ahead, may_stay, inside, rule).reshape(cells.size, cells.size)


def pair_bound(
    free: NDArray[np.bool_],
    offsets: NDArray[np.int64],
    goal: NDArray[np.bool_] | None,
    particles: NDArray[np.bool_],
    n: int,
    rule: str,
) -> int:
    """Return the most commands that two particles need to come together; 0 on a map with more than
    `MOST_CELLS` free cells, whose pairs would take too much memory.

    Raises
    ------
    InvalidInputError
        Raised if no commands bring two of the particles together.
    """
    if np.count_nonzero(free) > MOST_CELLS:
        return 0
    indices = np.searchsorted(np.flatnonzero(free), np.flatnonzero(particles))
    between = fewest_by_pairs(free, offsets, goal, n, rule)[np.ix_(indices, indices)]
    if (between < 0).any():
        raise InvalidInputError(
            "gathering: expected particles that commands can bring together, got two that no"
            f" commands bring together under the rule {rule}"
        )
    return int(between.max())


def count_bound(
    free: NDArray[np.bool_],
    offsets: NDArray[np.int64],
    goal: NDArray[np.bool_] | None,
    particles: NDArray[np.bool_],
    rule: str,
) -> int:
    """Return a lower bound on the number of commands, from how many particles one command gathers.

    Under the rule merge, a command frees at most one cell for each cell with a wall ahead and a free
    cell behind. Under the rule block, a particle enters the region only over an edge of the region
    that the command crosses, and each command moves at most one particle over each edge. Under the
    rule tilt, only whether a command is needed counts.
    """
    outside = particles if goal is None else particles & ~goal
    cells = np.flatnonzero(free)
    if rule == "merge":
        final_count = 1 if goal is None else int(np.count_nonzero(goal))
        excess = int(np.count_nonzero(particles)) - final_count
        a_command = [
            int(np.count_nonzero(~free[cells + step] & free[cells - step])) for step in offsets
        ]
    else:
        assert goal is not None
        excess = int(np.count_nonzero(outside))
        a_command = [int(np.count_nonzero(goal[cells + step] & ~goal[cells])) for step in offsets]
        if rule == "tilt":
            a_command = [excess]
    needed = -(-excess // max(1, *a_command)) if excess > 0 else 0
    gathered = not outside.any() if goal is not None else np.count_nonzero(particles) == 1
    return 0 if gathered else max(1, needed)


def distance_bound(
    free: NDArray[np.bool_],
    offsets: NDArray[np.int64],
    goal: NDArray[np.bool_] | None,
    particles: NDArray[np.bool_],
    rule: str,
) -> int:
    """Return a lower bound on the number of commands, from the shortest paths of single particles.

    Without a region, it is the smallest number of moves in which every particle reaches one common
    cell. With a region, it is the smallest number in which every particle reaches a cell of the
    region, under the rule block each another cell.
    """
    cells = np.flatnonzero(free)
    indices = np.searchsorted(cells, np.flatnonzero(particles))
    ahead, _ = moves_of(free, offsets, cells, 1, rule)
    steps, queue = np.zeros(cells.size, dtype=np.int64), np.zeros(cells.size, dtype=np.int64)
    paths = np.empty((indices.size, cells.size), dtype=np.int64)
    for i, cell in enumerate(indices):
        kernels.measure_paths_from(ahead, cell, -1, steps, queue)
        paths[i] = steps
    if goal is None:
        return int(paths.max(axis=0).min())
    paths = paths[:, goal[cells]]
    least, most = int(paths.min(axis=1).max()), int(paths[paths < kernels.FAR].max(initial=0))
    while rule == "block" and least < most:  # the smallest bottleneck of an assignment
        middle = (least + most) // 2
        if _can_assign(paths <= middle):
            most = middle
        else:
            least = middle + 1
    return least


def _can_assign(allowed: NDArray[np.bool_]) -> bool:
    """Return whether each row can have a column of its own."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import maximum_bipartite_matching

    matching = maximum_bipartite_matching(csr_array(allowed.astype(np.int8)), perm_type="column")
    return bool((matching >= 0).all())


def search_gathering(
    world: SmallWorld,
    free: NDArray[np.bool_],
    offsets: NDArray[np.int64],
    goal: NDArray[np.bool_] | None,
    particles: int,
    n: int,
    letters: str,
    most_states: int,
) -> tuple[int, str, int]:
    """Return the fewest commands that gather particles, a plan with them, and the number of states
    that the A* search has found. The estimate of a state is its pair bound.

    Raises
    ------
    InvalidInputError
        Raised if no commands gather the particles, or if the search needs more than ``most_states``
        states.
    """
    between = fewest_by_pairs(free, offsets, goal, n, world.rule).tolist()
    index = dict(zip(np.flatnonzero(free).tolist(), range(len(between)), strict=True))
    region = None if goal is None else world.number(goal)

    def estimate(state: int) -> int:
        cells = [index[bit] for bit in set_bits(state)]
        distances = [between[first][second] for first in cells for second in cells]
        return -1 if min(distances) < 0 else max(distances)

    def gathered(state: int) -> bool:
        return state.bit_count() == 1 if region is None else not state & ~region

    costs = {particles: 0}
    queue = [(estimate(particles), 0, particles, "")]
    while queue and queue[0][0] >= 0:
        _, negative, current, plan = heapq.heappop(queue)
        moves = -negative
        if gathered(current):
            return moves, plan, len(costs)
        if costs[current] < moves:
            continue
        for command, letter in enumerate(letters):
            successor, _ = world.step(current, 0, command, mapping=False)
            if costs.get(successor, most_states) <= moves + 1:
                continue
            if len(costs) >= most_states:
                raise InvalidInputError(f"optimum: expected at most {most_states} states, got more")
            costs[successor] = moves + 1
            remaining = estimate(successor)
            if remaining >= 0:
                heapq.heappush(queue, (moves + 1 + remaining, -moves - 1, successor, plan + letter))
    raise InvalidInputError(
        "optimum: expected a task that particles can complete under the rule"
        f" {world.rule}, got none of {len(costs)} states in which it is complete"
    )
