"""Vertical components that make a plan in the plane work in a prism or a cylinder."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shoal.steering.contact.world import ContactWorld
from shoal.steering.planners.protocol import Planner
from shoal.steering.planners.task import SteeringTask, why_unreachable
from shoal.steering.workspaces.convex_geometry import Points

_OFF_CAPS = 1e-4  # relative to the height: minimum distance of the particles from the end caps during the plan


def plan_from_base(task: SteeringTask, planner: Planner) -> Points | None:
    """Return the plan of a planner in the plane with vertical components added, or None if there is no plan."""
    below = planar_task(task)
    if why_unreachable(below) is not None:
        return None
    flat = below.translation()
    flat = planner.plan(below) if flat is None else flat
    return None if flat is None else with_vertical_moves(task, flat)


def planar_task(task: SteeringTask) -> SteeringTask:
    """Return a three-dimensional task without its vertical coordinates, as a task in the base of the workspace."""
    room = task.world.room
    world, start, goal = ContactWorld(room.base), task.start[:, :2], task.goal[:, :2]
    return replace(task, world=world, start=start, goal=goal, tolerance=task.tolerance / 2)


def with_vertical_moves(task: SteeringTask, flat: Points) -> Points | None:
    """Add a vertical component to each move of a plan in the plane, so that both particles reach the heights of their goals.

    Whether a side wall holds a particle depends only on the move's component in the plane. Therefore the plan in the plane
    determines which fraction of each move a particle makes. The final height of each particle is a linear function of the vertical
    components. A linear program minimizes the sum of the vertical components.

    Parameters
    ----------
    task : SteeringTask
        A task in a prism or a cylinder.
    flat : ndarray of float64, shape (moves, 2)
        A plan of `planar_task`.

    Returns
    -------
    ndarray of float64, shape (moves, 3), or None
        The result is None if no vertical components solve the task, for example if a wall holds a particle during all moves but
        one.

    Notes
    -----
    A method of Shoal. Paper W, section IV.G, corrects heights by separate moves while one particle is held. This method combines
    these corrections with the other moves.
    """
    room = task.world.room
    states = ContactWorld(room.base).play(task.start[:, :2], flat)
    squares = np.einsum("ij,ij->i", flat, flat)
    shares = np.einsum("ipj,ij->ip", np.diff(states, axis=0), flat) / np.where(squares > 0, squares, 1.0)[:, None]
    upwards = _least_vertical_moves(shares, task.start[:, 2], task.aim[:, 2], room.height)
    if upwards is None:
        return None
    moves = np.column_stack([flat, upwards])
    return moves if task.reaches_goal(moves) else None


def _least_vertical_moves(
    shares: NDArray[np.float64], start: NDArray[np.float64], goal: NDArray[np.float64], height: float
) -> NDArray[np.float64] | None:
    """Return the smallest vertical moves between given heights that stay within 0 .. height, or None if no such moves exist."""
    from scipy.optimize import linprog

    count = len(shares)
    sums = np.tril(np.ones((count, count)))
    risen = [sums * shares[:, particle] for particle in range(2)]  # height gained by each particle after each move
    nothing, eye = np.zeros((count, count)), np.eye(count)
    least, most = _OFF_CAPS * height, (1 - _OFF_CAPS) * height
    rows, limits = [np.hstack([eye, -eye]), np.hstack([-eye, -eye])], [np.zeros(count), np.zeros(count)]
    for particle, sum_ in enumerate(risen):
        rows += [np.hstack([sum_, nothing])[:-1], np.hstack([-sum_, nothing])[:-1]]
        limits += [np.full(count - 1, most - start[particle]), np.full(count - 1, start[particle] - least)]
    found = linprog(
        np.concatenate([np.zeros(count), np.ones(count)]),
        A_ub=np.vstack(rows),
        b_ub=np.concatenate(limits),
        A_eq=np.vstack([np.hstack([sum_[-1], np.zeros(count)]) for sum_ in risen]),
        b_eq=goal - start,
        bounds=(None, None),
    )
    return np.asarray(found.x[:count]) if found.success else None
