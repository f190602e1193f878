"""Planner shortest: a search for the shortest chain of wall contacts."""

from __future__ import annotations

from shoal.steering.planners.chains.chain import Chain, ChainQuery
from shoal.steering.planners.chains.improvement import improved_chains
from shoal.steering.planners.choice import choose, plans_of, without_useless_moves
from shoal.steering.planners.greedy import Greedy, greedy_chain
from shoal.steering.planners.protocol import PLANNERS
from shoal.steering.planners.task import SteeringTask
from shoal.steering.planners.vertical_moves import plan_from_base
from shoal.steering.workspaces.convex_geometry import Points


@PLANNERS.register("shortest")
class Shortest:
    """A planner that returns the shortest of many chains of wall contacts and adjustments.

    Without a time limit, the plan is less than 0.1 % longer than the plan of the planner greedy, or shorter. A plan with more moves
    than another is returned only if it is shorter by at least 0.1 %.

    In a cycle, one particle touches a wall. Then the other particle moves (adjustment) while the wall holds the first particle. For
    chains of one, two or three cycles, the planner tries all sequences of touching particles and walls. From the shortest chains,
    the planner makes shorter chains by inserting and removing cycles.

    Notes
    -----
    Source: section V of paper W. Shoal limits contacts to their feasible range, and extends the method to several cycles.
    """

    name = "shortest"

    def plan(self, task: SteeringTask) -> Points | None:
        """Return the moves of a plan for ``task``; see the class `Planner`."""
        plans: list[Points | None] = [Greedy().plan(task)]
        for first, query in task.departures():
            for chain in improved_chains(query, _greedy_seeds(query, task)):
                plans += plans_of(task, first, chain, query)
        if task.world.room.dimensions == 3 and not task.late:
            plans.append(without_useless_moves(task, plan_from_base(task, self)))
        return choose(task, plans)


def _greedy_seeds(query: ChainQuery, task: SteeringTask) -> list[Chain]:
    """Return a list with the chain of the planner `greedy`, or an empty list if `greedy` finds no chain."""
    chain = greedy_chain(query, tolerance=task.tolerance / query.walls.scale / 4, cycles=(task.max_moves - 1) // 2)
    return [] if chain is None else [chain]
