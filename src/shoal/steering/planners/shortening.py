"""Shortening of plans for two particles around obstacles, by random changes of contacts and adjustments."""

from __future__ import annotations

from typing import Any

import numpy as np

from shoal.steering.kernels import shortening as kernels
from shoal.steering.planners.task import SteeringTask
from shoal.steering.workspaces.convex_geometry import Points

MOST_STEPS = 32
_EXACT = 1e-9  # relative to a move: distance that a particle may fall behind without counting as held


def annealed(task: SteeringTask, world: Any, moves: Points, rng: np.random.Generator, *, changes: int) -> Points:
    """Return a plan for two particles shortened by ``changes`` random changes, or the same plan if it has no cycle structure.

    Parameters
    ----------
    task : SteeringTask
    world : shoal.steering.kernels.sampling.World
    moves : ndarray of float64, shape (moves, 2)
    rng : numpy.random.Generator
    changes : int
    """
    steps, count = _apart(task, moves)
    if count > MOST_STEPS:
        return moves
    room, best = new_steps(), new_steps()
    goal, most = np.ascontiguousarray(task.goal), min(task.max_moves, MOST_STEPS)
    few, length = kernels.anneal(steps, count, task.start, goal, task.tolerance, most, changes, world, rng, room, best)
    plan = best.moves[:few][np.hypot(*best.moves[:few].T) > 0]
    return plan if length < float(np.linalg.norm(moves, axis=1).sum()) else moves


def new_steps() -> kernels.Steps:
    """Return empty arrays for the steps of a plan."""
    kinds, particles = np.zeros((2, MOST_STEPS), dtype=np.int64)
    return kernels.Steps(kinds, particles, *np.zeros((3, MOST_STEPS, 2)))


def _apart(task: SteeringTask, moves: Points) -> tuple[kernels.Steps, int]:
    """Divide a plan into steps without idle ones.

    Return the steps and their number, which exceeds the arrays' length on overflow.
    """
    parts, state = [], task.start
    for move in moves:
        after = task.world.step(state, move)
        shares = np.linalg.norm(after - state, axis=1) / float(np.linalg.norm(move))
        held = int(np.argmin(shares))
        first, last = float(shares[held]), float(shares[1 - held])
        if first > 1 - _EXACT:
            parts.append((kernels.TRANSLATION, 0, move, np.zeros(2)))
        else:
            if first > _EXACT:
                parts.append((kernels.CONTACT, held, after[held], _direction_at(task.world.room, after[held])))
            if last - first > _EXACT:
                parts.append((kernels.ADJUSTMENT, held, (last - first) * move, np.zeros(2)))
        state = after
    if not parts or parts[-1][0] != kernels.TRANSLATION:
        parts.append((kernels.TRANSLATION, 0, np.zeros(2), np.zeros(2)))
    steps = new_steps()
    for k, part in enumerate(parts[:MOST_STEPS]):
        steps.kinds[k], steps.particles[k], steps.vectors[k], steps.along[k] = part
    return steps, len(parts)


def _direction_at(room: Any, point: Points) -> Points:
    """Return the direction of the wall that is nearest to a point."""
    if room.round:
        outward = point - room.center
        return np.array([-outward[1], outward[0]]) / max(float(np.hypot(*outward)), 1e-300)
    corners = room.rings if hasattr(room, "rings") else (room.vertices,)
    ends = np.concatenate([np.hstack([ring, np.roll(ring, -1, axis=0)]) for ring in corners])
    along = ends[:, 2:] - ends[:, :2]
    lengths = np.hypot(*along.T)
    along = along / lengths[:, None]
    places = np.clip(np.sum((point - ends[:, :2]) * along, axis=1), 0, lengths)
    away = np.linalg.norm(ends[:, :2] + places[:, None] * along - point, axis=1)
    return np.asarray(along[int(np.argmin(away))])
