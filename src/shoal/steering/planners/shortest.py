"""The shortest plan over walls that is found."""

from __future__ import annotations

import numpy as np

from shoal.steering.planners.chains.chain import Chain, ChainQuery, refined, shortest_chain
from shoal.steering.planners.greedy import greedy_chain, misses
from shoal.steering.planners.protocol import PLANNERS
from shoal.steering.planners.task import SteeringTask, path_length
from shoal.steering.workspaces.convex_geometry import Points


@PLANNERS.register("shortest")
class Shortest:
    """The shortest chain of up to three contacts and adjustments; where three are not enough, a greedy one made short.

    Notes
    -----
    Source: paper W, section V, with contacts clamped to where they can be, and several cycles.
    """

    name = "shortest"

    def plan(self, task: SteeringTask) -> Points | None:
        """Return moves; see `Planner`."""
        best: Points | None = None
        for first, state in task.departures():
            query = task.chain_query(start=state)
            for chain in (shortest_chain(query), shortened_greedy(query, task)):
                moves = None if chain is None else task.moves_of(chain, query)
                if moves is None:
                    continue
                whole = np.array([*first, *moves])
                if best is None or _rank(task, whole) < _rank(task, best):
                    best = whole
        return best


def _rank(task: SteeringTask, moves: Points) -> tuple[bool, float]:
    """Order plans: those that end within the tolerance first, then by length."""
    return misses(task, moves), path_length(moves)


def shortened_greedy(query: ChainQuery, task: SteeringTask) -> Chain | None:
    """Return the chain of the planner greedy, of any number of cycles, made shorter."""
    chain = greedy_chain(query, tolerance=task.tolerance / query.walls.scale / 4, cycles=(task.max_moves - 1) // 2)
    return None if chain is None else refined(query, chain)
