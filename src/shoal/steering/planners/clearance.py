"""Plans that stand disturbances: a planner is asked with the clearance, and nearer to walls where it
leaves no room.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np

from shoal.core.geometry import unit_vectors
from shoal.steering.contact.clearance import PLANNED
from shoal.steering.contact.world import ContactWorld, touched_normals
from shoal.steering.planners.greedy import Greedy
from shoal.steering.planners.task import (
    Planner,
    SteeringTask,
    choose,
    misses,
    without_useless_moves,
)
from shoal.steering.workspaces.convex import Points

_LENGTHS = (0.2, 0.05)  # relative to the size: length of the last move
_NARROW_PUSH = 0.1  # least component of the last move into a wall, relative to its length
_DIRECTIONS = 16


def plan_with_clearance(task: SteeringTask, planner: Planner) -> Points | None:
    """Return the moves of the plan that ``planner`` finds for ``task``, or None if the planner
    finds no plan.

    If a translation solves the task, the function returns the translation. If the planning time is
    limited, the function also considers the plan that the planner greedy finds without a limit,
    which takes some milliseconds. Where there is no room for the clearance of the task, the
    function plans with smaller distances from walls, because such a plan may still stand all
    disturbances. With friction, and between places on walls, it also does so if it has found a plan
    already, because such a plan may be much shorter.
    """
    by_moves = getattr(planner, "prefers", "length") == "moves"
    simple = isinstance(task.world, ContactWorld) and len(task.start) == 2
    everywhere = simple and not getattr(planner, "general", False) and _needs_narrow(task)
    plans: list[Points | None] = []
    if task.deadline < inf and simple and planner.name != Greedy.name:
        plans.append(plan_with_clearance(replace(task, deadline=inf), Greedy()))
    best, sure = None, False
    for margin in dict.fromkeys((task.clearance, 0.0)):
        own = replace(task, margin=margin)
        shift = own.translation()
        solved = shift is not None and own.is_sure(shift)
        if not solved:
            plans.append(planner.plan(own))
            if simple and task.clearance and margin == 0.0 and not sure:
                plans.append(with_last_push(own, planner))
        plans.append(shift)
        best = choose(task, plans, by_moves=by_moves)
        sure = best is not None and not misses(task, best) and task.is_sure(best)
        if task.late or solved or (sure and not everywhere):
            break
    return without_useless_moves(task, best)


def _needs_narrow(task: SteeringTask) -> bool:
    """Return whether plans nearer to the walls than the clearance may be much shorter than plans
    that keep it.

    With friction, or between places on walls, the clearance excludes chains of contacts that stand
    all disturbances nevertheless.
    """
    workspace, near = task.world.free_space, PLANNED * task.clearance * task.world.free_space.size
    return bool(
        task.world.friction < inf
        or (workspace.depth(np.concatenate([task.start, task.goal])) <= near).any()
    )


def with_last_push(task: SteeringTask, planner: Planner) -> Points | None:
    """Return a plan that ends with a push into the walls at a goal, or None if the search finds
    none that stands disturbances.

    If both goals lie in corners, walls may hold both particles during a last translation that is
    shorter than the clearance. The search therefore plans to a goal of one particle on its wall,
    and to a place of the other particle away from all walls. The last move pushes the first
    particle into its wall and brings the other particle to its goal.
    """
    workspace = task.world.free_space
    if workspace.dimensions != 2:
        return None
    angles = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    towards = unit_vectors(angles)
    plans: list[Points | None] = []
    for held in (0, 1):
        walls = touched_normals(workspace, task.goal[held], within=task.tolerance / workspace.size)
        for length in _LENGTHS if len(walls) else ():
            begins = task.aim[1 - held] - length * workspace.size * towards
            into = (walls @ towards.T).min(axis=0) < -_NARROW_PUSH
            depth = np.where(into, workspace.depth(begins), -np.inf)
            best = int(np.argmax(depth))
            if depth[best] <= 10 * task.clearance * workspace.size or task.late:
                continue
            goal = task.aim.copy()
            goal[1 - held] = begins[best]
            before = replace(
                task,
                goal=goal,
                tolerance=task.tolerance / 2,
                max_moves=task.max_moves - 1,
                margin=task.clearance,
            )
            moves = planner.plan(before)
            if moves is None:
                continue
            end = task.world.final(task.start, moves)
            plan = np.vstack([moves, task.aim[1 - held] - end[1 - held]])
            if not misses(task, plan) and task.is_sure(plan):
                plans.append(plan)
                break
    return choose(task, plans)
