"""Shortening of plans for two particles around obstacles, by random changes of contacts and adjustments."""

from __future__ import annotations

from typing import Any

import numpy as np

from shoal.steering.kernels import shortening as kernels
from shoal.steering.planners.task import SteeringTask
from shoal.steering.workspaces.convex_geometry import Points

MOST_STEPS = 32
_EXACT = 1e-9  # relative to a move: distance that a particle may fall behind without counting as held
_NOTHING = 1e-12  # relative to the size: length of a move that is left out
QUIET = kernels.Noise(np.zeros((0, 2, 2)), np.zeros((0, 0, 2)), 0.0, 0.0)


def annealed(task: SteeringTask, world: Any, moves: Points, rng: np.random.Generator, *, changes: int) -> Points:
    """Return a plan for two particles, shortened by ``changes`` random changes.

    A plan that does not consist of cycles stays unchanged.

    Parameters
    ----------
    task : SteeringTask
    world : shoal.steering.kernels.sampling.World
    moves : ndarray of float64, shape (moves, 2)
    rng : numpy.random.Generator
    changes : int
    """
    steps, count = steps_of(task, moves)
    if count > MOST_STEPS:
        return moves
    best, few, length = improved(task, world, steps, count, rng, changes=changes)
    plan = best.moves[:few][np.hypot(*best.moves[:few].T) > _NOTHING * task.world.room.size]
    return plan if length < float(np.linalg.norm(moves, axis=1).sum()) else moves


def improved(
    task: SteeringTask, world: Any, steps: kernels.Steps, count: int, rng: np.random.Generator, *, changes: int, noise: Any = QUIET
) -> tuple[kernels.Steps, int, float]:
    """Return the steps of a plan after random changes, their number, and their cost. The given arrays are overwritten.

    The cost of a plan is its length. With noise, it is the mean number of moves until the particles arrive.
    """
    room, best = new_steps(), new_steps()
    goal, most = np.ascontiguousarray(task.goal), min(task.max_moves, MOST_STEPS)
    few, cost = kernels.anneal(steps, count, task.start, goal, task.tolerance, most, changes, noise, world, rng, room, best)
    return best, int(few), float(cost)


def new_steps() -> kernels.Steps:
    """Return empty arrays for the steps of a plan."""
    kinds, particles = np.zeros((2, MOST_STEPS), dtype=np.int64)
    return kernels.Steps(kinds, particles, *np.zeros((3, MOST_STEPS, 2)))


def steps_of(task: SteeringTask, moves: Points) -> tuple[kernels.Steps, int]:
    """Divide a plan into steps, and leave out steps without effect.

    Return the steps and their number. If the number exceeds the length of the arrays, the plan has too many steps.
    """
    parts, state = [], task.start
    for move in moves[np.hypot(*moves.T) > 0]:
        after = task.world.step(state, move)
        shares = np.linalg.norm(after - state, axis=1) / float(np.linalg.norm(move))
        held = int(np.argmin(shares))
        first, last = float(shares[held]), float(shares[1 - held])
        if first > 1 - _EXACT:
            parts.append((kernels.TRANSLATION, 0, after.mean(axis=0), np.zeros(2)))
        else:
            if first > _EXACT:
                parts.append((kernels.CONTACT, held, after[held], _direction_at(task.world.room, after[held])))
            if last - first > _EXACT:
                parts.append((kernels.ADJUSTMENT, held, after[1] - after[0], np.zeros(2)))
        state = after
    if not parts or parts[-1][0] != kernels.TRANSLATION:
        parts.append((kernels.TRANSLATION, 0, task.goal.mean(axis=0), np.zeros(2)))
    steps = new_steps()
    for k, part in enumerate(parts[:MOST_STEPS]):
        steps.kinds[k], steps.particles[k], steps.targets[k], steps.along[k] = part
    return steps, len(parts)


def _direction_at(room: Any, point: Points) -> Points:
    """Return the direction of the wall that is nearest to a point, with the inside on its right."""
    if room.round:
        outward = point - room.center
        return np.array([outward[1], -outward[0]]) / max(float(np.hypot(*outward)), 1e-300)
    corners = room.rings if hasattr(room, "rings") else (room.vertices,)
    ends = np.concatenate([np.hstack([ring, np.roll(ring, -1, axis=0)]) for ring in corners])
    along = ends[:, 2:] - ends[:, :2]
    lengths = np.hypot(*along.T)
    along = along / lengths[:, None]
    places = np.clip(np.sum((point - ends[:, :2]) * along, axis=1), 0, lengths)
    away = np.linalg.norm(ends[:, :2] + places[:, None] * along - point, axis=1)
    return np.asarray(-along[int(np.argmin(away))])
