"""Plans of two particles around obstacles made shorter: the same contacts and adjustments, at better places.

A plan is taken apart into steps: to a contact, an adjustment while a wall holds one particle, a translation of both. Random changes
of the places and vectors are kept where the plan still works and is shorter; the last adjustment and the last translation follow.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import Any

import numpy as np

from shoal.dataclass import dataclass
from shoal.steering.planners.task import SteeringTask
from shoal.steering.workspaces.convex_geometry import Points

LEFT_OUT = 0.1  # of the changes: a step less
WIDEST, FINEST = 0.1, 1e-6  # of the size: typical changes, at first and at the least
_GROWN, _SHRUNK = 1.6, 0.93  # what they become after one that is kept, and after one that is not
_EXACT = 1e-9  # of the size: a step that goes elsewhere by more is another one


@dataclass(frozen=True)
class Step:
    """A part of a plan.

    Parameters
    ----------
    kind : str
        "contact", "adjustment" or "translation".
    particle : int
        Which one comes to a wall, or is held.
    vector : ndarray of float64, shape (2,)
        Where the contact is; else the move.
    along : ndarray of float64, shape (2,)
        Of a contact: the direction of its wall.
    """

    kind: str
    particle: int
    vector: Points
    along: Points


def shortened_by_changes(task: SteeringTask, moves: Points, rng: np.random.Generator, *, changes: int) -> Points:
    """Return a plan of two particles made shorter by so many random changes; the same one if it cannot be taken apart."""
    steps = _apart(task, moves)
    best, length = _played(task, steps)
    if best is None:
        return moves
    size, width = float(task.world.room.size), WIDEST
    for _change in range(changes):
        if task.late or width < FINEST:
            break
        trial = list(steps)
        if rng.random() < LEFT_OUT:
            del trial[int(rng.integers(len(trial)))]
        for k in rng.choice(len(trial), size=min(len(trial), int(rng.integers(3))), replace=False).tolist():
            step = trial[k]
            change = width * size * rng.normal(size=2)
            trial[k] = replace(step, vector=step.vector + (change[0] * step.along if step.kind == "contact" else change))
        found, shorter = _played(task, trial)
        if found is not None and shorter < length:
            steps, best, length, width = trial, found, shorter, min(width * _GROWN, WIDEST)
        else:
            width *= _SHRUNK if width > 100 * FINEST else 0.99
    whole = float(np.linalg.norm(moves, axis=1).sum())
    return best if length < whole and len(best) <= task.max_moves else moves


def _apart(task: SteeringTask, moves: Points) -> list[Step]:
    """Return the steps of a plan, those left out in which nobody moves."""
    steps, state, nowhere = [], task.start, np.zeros(2)
    for move in moves:
        after = task.world.step(state, move)
        shares = np.linalg.norm(after - state, axis=1) / float(np.linalg.norm(move))
        shares = np.where(shares > 1 - 1e-9, 1.0, shares)
        held = int(np.argmin(shares))
        first, last = float(shares[held]), float(shares[1 - held])
        if first == 1:
            steps.append(Step("translation", 0, move, nowhere))
        else:
            if first > 1e-9:
                steps.append(Step("contact", held, after[held], _direction_at(task.world.room, after[held])))
            if last - first > 1e-9:
                steps.append(Step("adjustment", held, (last - first) * move, nowhere))
        state = after
    return steps


def _direction_at(room: Any, point: Points) -> Points:
    """Return the direction of the nearest wall at a point."""
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


def _played(task: SteeringTask, steps: list[Step]) -> tuple[Points | None, float]:
    """Return the moves of steps and their length; None if a step does not do what it should, or if they do not end at the goal."""
    last = max((k for k, step in enumerate(steps) if step.kind == "adjustment"), default=-1)
    if last < 0 or any(step.kind == "contact" for step in steps[last + 1 :]):
        return None, inf
    state, near, moves = task.start.copy(), _EXACT * float(task.world.room.size), []
    for k, step in enumerate(steps if last < len(steps) - 1 else [*steps, Step("translation", 0, np.zeros(2), np.zeros(2))]):
        p = step.particle
        move = step.vector - state[p] if step.kind == "contact" else step.vector
        if k == last:
            offsets = state - task.goal
            move = offsets[p] - offsets[1 - p]
        elif k > last and k >= len(steps) - 1:
            move = (task.goal - state).mean(axis=0)
        wanted = state + move
        if step.kind == "adjustment":
            wanted[p] = state[p]
        after = task.world.moved(state.copy(), move)
        if not np.abs(after - wanted).max() <= near:
            return None, inf
        moves.append(move)
        state = after
    if task.error(state) > task.tolerance:
        return None, inf
    plan = np.array([move for move in moves if float(np.hypot(*move)) > 0])
    return plan, float(np.linalg.norm(plan, axis=1).sum())
