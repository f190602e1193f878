"""Planner fewest-moves: a search for a plan with the smallest number of straight moves."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np

from shoal.steering.planners.chain_search import roadmap_chain, shortest_chain
from shoal.steering.planners.chains import refined
from shoal.steering.planners.shortest import Shortest, plan_from_base, shooting_plan
from shoal.steering.planners.task import PLANNERS, SteeringTask, choose, misses, plans_of
from shoal.steering.workspaces.convex import Points

DENSE_MAP = ((1500, 120, 1.01, 2500),)  # see `shoal.steering.planners.chain_search.MAPS`
LONGEST = 15  # number of moves of a plan whose end is also searched among plans of four moves


@PLANNERS.register("fewest-moves")
class FewestMoves:
    """A planner that searches for the plan with the fewest straight moves.

    Among plans with the same number of moves, the planner prefers the shortest plan.

    A chain of m wall contacts takes 2 m + 1 moves. Fewer moves are often enough, because a single
    move can bring one particle to a wall and then adjust the position of the other particle. The
    planner tries plans of three moves with many directions and lengths of the first move. It then
    draws random plans of four to six moves, and repairs the plans that almost succeed. It compares
    all these plans with the plans of chains, and with plans that begin like a chain and have other
    last moves.
    """

    name = "fewest-moves"
    prefers = "moves"

    def plan(self, task: SteeringTask) -> Points | None:
        """Return the moves of a plan for ``task``; see the class `Planner`."""
        plans = [self._chains(task)]
        if task.world.room.dimensions == 3:
            plans.append(plan_from_base(task, self))
        chains = choose(task, plans, by_moves=True)
        most = inf if chains is None else len(chains)
        shot = False
        for count in (2, 3, 4, 5, 6):
            if task.late or (count >= most and not (count == most == 3)):
                break
            found = shooting_plan(task, count)
            plans.append(found)
            if found is not None and task.is_sure(found):
                shot = True
                break
        if (
            not shot and most > 3 and not task.late
        ):  # the shortest chain may need fewer moves than its number of cycles suggests
            plans.append(Shortest().plan(task))
        few = choose(task, plans, by_moves=True)
        if not shot and few is not None:
            plans.append(_finished(task, few))
        return choose(task, plans, by_moves=True)

    def _chains(self, task: SteeringTask) -> Points | None:
        """Return the moves of a chain of wall contacts with as few cycles as the searches find, or
        None if they find no chain.
        """
        best = None
        for first, query in task.departures():
            chain = shortest_chain(query, first_found=True)
            if chain is not None:
                best = choose(task, [best, *plans_of(task, first, chain, query)], by_moves=True)
        if best is None or misses(task, best) or not task.is_sure(best):
            best = choose(task, [best, self._long(task), Shortest().plan(task)], by_moves=True)
        return best

    def _long(self, task: SteeringTask) -> Points | None:
        """Return the plan of the chain with the fewest cycles on a dense roadmap, or None if this
        search finds no plan.
        """
        if task.world.room.dimensions == 3 or task.world.friction < inf or task.late:
            return None
        best = None
        for first, query in task.departures():
            chain = roadmap_chain(query, maps=DENSE_MAP)
            moves = None if chain is None else task.moves_of(refined(query, chain), query)
            if moves is not None and not misses(task, np.array([*first, *moves])):
                best = choose(task, [best, np.array([*first, *moves])], by_moves=True)
        return best


def _finished(task: SteeringTask, plan: Points) -> Points | None:
    """Return ``plan`` with its last moves replaced by three or four moves, or None if no
    replacement saves moves.
    """
    states = task.world.play(task.start, plan)
    lasts = (3, 4) if len(plan) <= LONGEST else (3,)
    for total in range(lasts[0] + 1, len(plan)):
        for count in lasts:
            begun = total - count
            if task.late:
                return None
            last = shooting_plan(replace(task, start=states[begun]), count) if begun > 0 else None
            if last is not None:
                whole = np.concatenate([plan[:begun], last])
                if task.reaches_goal(whole) and task.is_sure(whole):
                    return whole
    return None
