"""Planner fewest-moves: a search for a plan with the smallest number of straight moves, among chains
and by shooting.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np

from shoal.core.geometry import unit_vectors
from shoal.steering.contact.clearance import PLANNED
from shoal.steering.kernels import shooting
from shoal.steering.kernels.contact import Walls
from shoal.steering.kernels.shooting import Shot, Trials
from shoal.steering.planners.chain_search import roadmap_chain, shortest_chain
from shoal.steering.planners.chains import refine_chain
from shoal.steering.planners.shortest import Shortest, plan_from_base
from shoal.steering.planners.task import (
    SteeringTask,
    choose,
    misses,
    path_length,
    plan_chain,
)
from shoal.steering.workspaces.convex import Points
from shoal.steering.workspaces.walls import normalize_walls

DENSE_MAP = ((1500, 120, 1.01, 2500),)  # see `shoal.steering.planners.chain_search.MAPS`
LONGEST = 15  # number of moves of a plan whose end is also searched among plans of four moves


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
        if task.world.free_space.dimensions == 3:
            plans.append(plan_from_base(task, self))
        chains = choose(task, plans, by_moves=True)
        most = inf if chains is None else len(chains)
        shot = False
        for count in (2, 3, 4, 5, 6):
            if task.late or (count >= most and not (count == most == 3)):
                break
            plan_by_shooting = shooting_plan(task, count)
            plans.append(plan_by_shooting)
            if plan_by_shooting is not None and task.is_sure(plan_by_shooting):
                shot = True
                break
        if (
            not shot and most > 3 and not task.late
        ):  # the shortest chain may need fewer moves than its number of cycles suggests
            plans.append(Shortest().plan(task))
        few = choose(task, plans, by_moves=True)
        if not shot and few is not None:
            plans.append(_replace_end(task, few))
        return choose(task, plans, by_moves=True)

    def _chains(self, task: SteeringTask) -> Points | None:
        """Return the moves of a chain of wall contacts with as few cycles as the searches find, or
        None if they find no chain.
        """
        best = None
        for initial_moves, query in task.departures():
            chain = shortest_chain(query, first_found=True)
            if chain is not None:
                best = choose(
                    task, [best, *plan_chain(task, initial_moves, chain, query)], by_moves=True
                )
        if best is None or misses(task, best) or not task.is_sure(best):
            best = choose(
                task, [best, self._plan_on_dense_map(task), Shortest().plan(task)], by_moves=True
            )
        return best

    def _plan_on_dense_map(self, task: SteeringTask) -> Points | None:
        """Return the plan of the chain with the fewest cycles on a dense roadmap, or None if this
        search finds no plan.
        """
        if task.world.free_space.dimensions == 3 or task.world.friction < inf or task.late:
            return None
        best = None
        for initial_moves, query in task.departures():
            chain = roadmap_chain(query, maps=DENSE_MAP)
            moves = None if chain is None else task.moves_of(refine_chain(query, chain), query)
            if moves is not None and not misses(task, np.array([*initial_moves, *moves])):
                best = choose(task, [best, np.array([*initial_moves, *moves])], by_moves=True)
        return best


def _replace_end(task: SteeringTask, plan: Points) -> Points | None:
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
            ending = shooting_plan(replace(task, start=states[begun]), count) if begun > 0 else None
            if ending is not None:
                finished = np.concatenate([plan[:begun], ending])
                if task.reaches_goal(finished) and task.is_sure(finished):
                    return finished
    return None


SHARES = np.array([0.0, 0.02, 0.06, 0.12, 0.2, 0.3, 0.42, 0.55, 0.7, 0.85, 0.97, 1.0])
DIRECTIONS = {2: 180, 3: 900}
# factor for the number of directions, if the first directions give no plan of three moves in the
# plane
DENSE = 4
NUDGE = 1e-6  # of the size, at least
NARROW = 1e-8  # of the size: distance of the other particle from walls without a clearance
REPAIRS = {
    4: (400, 10),
    5: (400, 10),
    6: (250, 10),
}  # for plans of each number of moves: attempts, and random plans per attempt
PARTS = 20  # order of the attempts if time is limited
ENOUGH = 4  # number of plans of which the shortest is used
_ALL = 1_000_000


def shooting_plan(task: SteeringTask, count: int) -> Points | None:
    """Return a plan of ``count`` moves (2 to 6), float64 of shape (count, d), or None if the
    simulations find no plan.
    """
    walls = normalize_walls(task.world.free_space)
    d = walls.dimensions
    clear = max(PLANNED * task.margin, NARROW)
    shot = Shot(
        walls.normalized(task.start),
        walls.normalized(task.aim),
        Walls(
            walls.normals,
            walls.offsets,
            walls.circle,
            1.0,
            float(task.world.friction),
            np.eye(d + 1)[0],
        ),
        clear,
        max(NUDGE, clear) * np.vstack([np.eye(d), -np.eye(d)]),
    )
    if count == 2:
        two = _plan_of_two(shot)
        return None if two is None else two * walls.scale
    moves = np.zeros((count, d))
    dense = Trials(directions(d, DENSE * DIRECTIONS[d]), SHARES)
    if count == 3:
        few = Trials(directions(d, DIRECTIONS[d]), SHARES)
        records = shooting.search(shot, few, _ALL, moves)
        if not records and d == 2:
            records = shooting.search(shot, dense, 1, moves)
    else:
        picks = np.random.default_rng(0).integers(0, 2**31, (*REPAIRS[count], count - 2, 2))
        records = 0
        for some in [picks] if task.deadline == inf else np.array_split(picks, PARTS):
            if records == 0 and not task.late:
                records = shooting.search_guided(shot, dense, some, ENOUGH, moves)
    if not records:
        return None
    shooting.improve(shot, 0.05, moves)
    return moves * walls.scale


def _plan_of_two(shot: Shot) -> Points | None:
    """Return the shorter of the two possible plans with two moves (one plan for each touching
    particle), or None.
    """
    plans = []
    for toucher in (0, 1):
        two = np.zeros_like(shot.start)
        if shooting.finish(shot.start, shot, toucher, two) <= shooting.EXACT:
            plans.append(two)
    return min(plans, key=path_length, default=None)


def directions(d: int, count: int) -> Points:
    """Return ``count`` unit vectors with evenly distributed directions in ``d`` dimensions."""
    if d == 2:
        angles = 2 * np.pi * (np.arange(count) + 0.5) / count
        return unit_vectors(angles)
    # a golden spiral
    turns, heights = (
        np.arange(count) * np.pi * (3 - np.sqrt(5)),
        1 - (2 * np.arange(count) + 1) / count,
    )
    flat = np.sqrt(1 - heights**2)
    return np.stack([flat * np.cos(turns), flat * np.sin(turns), heights], axis=1)
