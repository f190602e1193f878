"""Planner shortest: the shortest of many chains of contacts; in three dimensions also plans of the
plane with vertical moves.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shoal.steering.contact.world import ContactWorld
from shoal.steering.planners.chains import Chain, ChainQuery
from shoal.steering.planners.greedy import Greedy, greedy_chain
from shoal.steering.planners.improvement import improved_chains
from shoal.steering.planners.task import (
    Planner,
    SteeringTask,
    choose,
    plan_chain,
    why_unreachable,
    without_useless_moves,
)
from shoal.steering.workspaces.convex import Points

# relative to the height: minimum distance of the particles from the end caps during the plan
_OFF_CAPS = 1e-4


def plan_from_base(task: SteeringTask, planner: Planner) -> Points | None:
    """Return the plan that a planner makes in the plane, with added vertical components, or None if
    no such plan is found.
    """
    below = planar_task(task)
    if why_unreachable(below) is not None:
        return None
    flat = below.translation()
    flat = planner.plan(below) if flat is None else flat
    return None if flat is None else with_vertical_moves(task, flat)


def planar_task(task: SteeringTask) -> SteeringTask:
    """Return the task in the base of the prism or cylinder: ``task`` without vertical coordinates,
    and with half the tolerance.
    """
    workspace = task.world.free_space
    world, start, goal = ContactWorld(workspace.base), task.start[:, :2], task.goal[:, :2]
    return replace(task, world=world, start=start, goal=goal, tolerance=task.tolerance / 2)


def with_vertical_moves(task: SteeringTask, flat: Points) -> Points | None:
    """Add a vertical component to each move of a plan in the plane, so that both particles reach
    the heights of their goals.

    The plan in the plane determines which fraction of each move a particle makes, because only the
    horizontal component of a move determines whether a side wall holds a particle. The final height
    of each particle is a linear function of the vertical components of the moves. A linear program
    minimizes the sum of the absolute vertical components.

    Parameters
    ----------
    task : SteeringTask
        A task in a prism or a cylinder.
    flat : ndarray of float64, shape (moves, 2)
        A plan for the result of `planar_task`, that is, for the task in the plane.

    Returns
    -------
    ndarray of float64, shape (moves, 3), or None
        The plan with vertical components, or None if no vertical components solve the task, for
        example because a wall holds one particle during all moves except one.

    Notes
    -----
    The method is an addition by Shoal. Section IV.G of paper W corrects the heights with separate
    moves while a wall holds one particle. Shoal combines the corrections of the heights with the
    moves of the plan in the plane.
    """
    workspace = task.world.free_space
    states = ContactWorld(workspace.base).play(task.start[:, :2], flat)
    squares = np.einsum("ij,ij->i", flat, flat)
    shares = (
        np.einsum("ipj,ij->ip", np.diff(states, axis=0), flat)
        / np.where(squares > 0, squares, 1.0)[:, None]
    )
    upwards = _least_vertical_moves(shares, task.start[:, 2], task.aim[:, 2], workspace.height)
    if upwards is None:
        return None
    moves = np.column_stack([flat, upwards])
    return moves if task.reaches_goal(moves) else None


def _least_vertical_moves(
    shares: NDArray[np.float64],
    start: NDArray[np.float64],
    goal: NDArray[np.float64],
    height: float,
) -> NDArray[np.float64] | None:
    """Return the vertical moves of the smallest total length that lead from the heights ``start``
    to ``goal``, or None.

    ``shares`` holds the fraction of each move that each particle makes. Between the moves, all
    particles stay between floor and ceiling.
    """
    from scipy.optimize import linprog

    count = len(shares)
    sums = np.tril(np.ones((count, count)))
    risen = [
        sums * shares[:, particle] for particle in range(2)
    ]  # height gained by each particle after each move
    nothing, eye = np.zeros((count, count)), np.eye(count)
    least, most = _OFF_CAPS * height, (1 - _OFF_CAPS) * height
    rows, limits = (
        [np.hstack([eye, -eye]), np.hstack([-eye, -eye])],
        [np.zeros(count), np.zeros(count)],
    )
    for particle, sum_ in enumerate(risen):
        rows += [np.hstack([sum_, nothing])[:-1], np.hstack([-sum_, nothing])[:-1]]
        limits += [
            np.full(count - 1, most - start[particle]),
            np.full(count - 1, start[particle] - least),
        ]
    solution = linprog(
        np.concatenate([np.zeros(count), np.ones(count)]),
        A_ub=np.vstack(rows),
        b_ub=np.concatenate(limits),
        A_eq=np.vstack([np.hstack([sum_[-1], np.zeros(count)]) for sum_ in risen]),
        b_eq=goal - start,
        bounds=(None, None),
    )
    return np.asarray(solution.x[:count]) if solution.success else None


class Shortest:
    """A planner that returns the shortest of many chains of wall contacts and adjustments.

    Without a time limit, the plan is less than 0.1 % longer than the plan of the planner greedy, or
    shorter. A plan with more moves than another is returned only if it is shorter by at least 0.1
    %.

    In a cycle, one particle touches a wall. Then the other particle moves (adjustment) while the
    wall holds the first particle. For chains of one, two or three cycles, the planner tries all
    sequences of touching particles and walls. From the shortest chains, the planner makes shorter
    chains by inserting and removing cycles.

    Notes
    -----
    Source: section V of paper W. Shoal limits contacts to their feasible range, and extends the
    method to several cycles.
    """

    name = "shortest"

    def plan(self, task: SteeringTask) -> Points | None:
        """Return the moves of a plan for ``task``; see the class `Planner`."""
        plans: list[Points | None] = [Greedy().plan(task)]
        # the shortest chains may drive out all those whose plans stand disturbances
        for thorough in (True, False):
            for initial_moves, query in task.departures():
                for chain in improved_chains(query, greedy_seeds(query, task), thorough=thorough):
                    plans += plan_chain(task, initial_moves, chain, query)
            if task.late or any(task.is_sure(plan) for plan in plans[1:] if plan is not None):
                break
        if task.world.free_space.dimensions == 3 and not task.late:
            plans.append(without_useless_moves(task, plan_from_base(task, self)))
        return choose(task, plans)


def greedy_seeds(query: ChainQuery, task: SteeringTask) -> list[Chain]:
    """Return a list with the chain of the planner `greedy`, or an empty list if `greedy` finds no
    chain.
    """
    chain = greedy_chain(
        query, tolerance=task.tolerance / query.walls.scale / 4, cycles=(task.max_moves - 1) // 2
    )
    return [] if chain is None else [chain]
