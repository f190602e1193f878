"""Simulated annealing of plans: random changes of their steps, without and with noise."""

from __future__ import annotations

from typing import Any

import numpy as np

from shoal.core.dataclass import dataclass
from shoal.steering.kernels import annealing as kernels
from shoal.steering.planners.task import SteeringTask
from shoal.steering.workspaces.convex import Points

MOST_STEPS = 32
# how many of the shortest plans go on, and the number of random changes of each
STAGES = ((40, 2_000), (5, 25_000))
ODDS = {
    "targets": 0.7,
    "a step less": 0.1,
    "another toucher": 0.06,
    "a hand-over": 0.07,
    "a contact more": 0.05,
    "a bend": 0.02,
}
_ALIKE = 1e-4  # relative to the length: plans that differ by less are one
# relative to a move: distance that a particle may fall behind without counting as held
_EXACT = 1e-9
_NOTHING = 1e-12  # relative to the size: length of a move that is left out
QUIET = kernels.Noise(np.zeros((0, 2, 2)), np.zeros((0, 0, 2)), 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Plan:
    """A plan as a sequence of steps: translations, contacts and adjustments.

    Parameters
    ----------
    steps : shoal.steering.kernels.annealing.Steps
    count : int
        Number of steps in the plan.
    cost : float
        Without noise, the length of the plan; with noise, the mean number of moves in simulations.
        Without noise, the cost of a plan that misses the goals is infinite.
    """

    steps: kernels.Steps
    count: int
    cost: float = np.inf


class Annealing:
    """Random changes that improve plans for one task."""

    def __init__(self, task: SteeringTask, world: Any, rng: np.random.Generator) -> None:
        self.task, self._world, self._rng = task, world, rng
        odds = np.cumsum(np.fromiter(ODDS.values(), dtype=np.float64))
        self._odds, self._trial = odds / odds[-1], new_steps()
        self._kernel_task = kernels.PlanTask(
            task.start,
            np.ascontiguousarray(task.goal),
            task.tolerance,
            min(task.max_moves, MOST_STEPS),
        )

    def shorten(self, plans: list[Points]) -> list[Points]:
        """Return ``plans`` (float64, shape (moves, 2) each) and the shortest plans that random
        changes make from them, in the stages `STAGES`.
        """
        best = _distinct([self.anneal(steps_of(self.task, moves), changes=0) for moves in plans])
        for number, changes in STAGES:
            best = _distinct(
                [
                    plan if self.task.late else self.anneal(plan, changes=changes)
                    for plan in best[:number]
                ]
            )
        nothing = _NOTHING * float(self.task.world.free_space.size)
        best_moves = [plan.steps.moves[: plan.count] for plan in best]
        return [*(moves[np.hypot(*moves.T) > nothing] for moves in best_moves), *plans]

    def anneal(self, plan: Plan, *, changes: int, noise: kernels.Noise = QUIET) -> Plan:
        """Return the plan of the lowest cost that random changes make from ``plan``."""
        if plan.count > MOST_STEPS:
            return plan
        best = new_steps()
        count, cost = kernels.anneal(
            copy_of(plan).steps,
            plan.count,
            self._kernel_task,
            changes,
            self._odds,
            noise,
            self._world,
            self._rng,
            self._trial,
            best,
        )
        return Plan(best, int(count), float(cost))


def _distinct(plans: list[Plan]) -> list[Plan]:
    """Return the plans that reach the goals, the shortest first, with only one plan of each
    length.
    """
    distinct: list[Plan] = []
    for plan in sorted(plans, key=lambda plan: plan.cost):
        if plan.cost < np.inf and (not distinct or plan.cost > (1 + _ALIKE) * distinct[-1].cost):
            distinct.append(plan)
    return distinct


def copy_of(plan: Plan, first: int = 0) -> Plan:
    """Return a copy of a plan without the steps before the index ``first``."""
    steps, count = new_steps(), plan.count - first
    for new, old in zip(steps, plan.steps, strict=True):
        new[:count] = old[first : plan.count]
    return Plan(steps, count)


def new_steps() -> kernels.Steps:
    """Return empty arrays for the steps of a plan."""
    kinds, particles = np.zeros((2, MOST_STEPS), dtype=np.int64)
    return kernels.Steps(kinds, particles, *np.zeros((3, MOST_STEPS, 2)))


def steps_of(task: SteeringTask, moves: Points) -> Plan:
    """Return the plan with given moves as a sequence of steps (translations, contacts and
    adjustments).

    If the plan has more than ``MOST_STEPS`` steps, the arrays of the result hold only the first
    ``MOST_STEPS`` steps. The attribute ``count`` is nevertheless the number of all steps.
    """
    parts: list[tuple[int, int, Points, Points]] = []
    state = task.start
    for move in moves[np.hypot(*moves.T) > 0]:
        after = task.world.step(state, move)
        shares = np.linalg.norm(after - state, axis=1) / float(np.linalg.norm(move))
        held = int(np.argmin(shares))
        held_share, free_share = float(shares[held]), float(shares[1 - held])
        if held_share > 1 - _EXACT:
            parts.append((kernels.TRANSLATION, 0, after.mean(axis=0), np.zeros(2)))
        else:
            if held_share > _EXACT:
                parts.append(
                    (
                        kernels.CONTACT,
                        held,
                        after[held],
                        _direction_at(task.world.free_space, after[held]),
                    )
                )
            if free_share - held_share > _EXACT:
                parts.append((kernels.ADJUSTMENT, held, after[1] - after[0], np.zeros(2)))
        state = after
    if not parts or parts[-1][0] != kernels.TRANSLATION:
        parts.append((kernels.TRANSLATION, 0, task.goal.mean(axis=0), np.zeros(2)))
    steps = new_steps()
    for k, fields in enumerate(parts[:MOST_STEPS]):
        steps.kinds[k], steps.particles[k], steps.targets[k], steps.along[k] = fields
    return Plan(steps, len(parts))


def _direction_at(workspace: Any, point: Points) -> Points:
    """Return the direction of the wall nearest to ``point``, as a unit vector with the inside of
    the workspace on its right.
    """
    if workspace.round:
        outward = point - workspace.center
        return np.array([outward[1], -outward[0]]) / max(float(np.hypot(*outward)), 1e-300)
    ends = workspace.edges
    along = ends[:, 2:] - ends[:, :2]
    lengths = np.hypot(*along.T)
    along = along / lengths[:, None]
    places = np.clip(np.sum((point - ends[:, :2]) * along, axis=1), 0, lengths)
    away = np.linalg.norm(ends[:, :2] + places[:, None] * along - point, axis=1)
    return np.asarray(-along[int(np.argmin(away))])
