"""The closed loop in the plane: make the first move of the plan that arrives soonest in simulations, and plan again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from shoal.steering.kernels import shortening as kernels
from shoal.steering.planners.robust.belief import PositionBelief
from shoal.steering.planners.sampling import MORE_ROUNDS, Translations, Tree, world_of
from shoal.steering.planners.shortening import MOST_STEPS, annealed, improved, new_steps, steps_of
from shoal.steering.planners.shortest import Shortest
from shoal.steering.planners.task import SteeringTask
from shoal.steering.workspaces.region import Region

FIRST_TREES, TREES = 4, 2  # grown at the start, and where the plan so far has become worse than it was
SHORTENED = 5_000  # changes of a new plan in a world without noise
OVERSHOOTS = (0.0, 1.5, 3.0)  # standard deviations of noise: how far behind walls contacts of new plans aim
MARGINS = (3.0, 1.5, 0.5)  # of these: how far from walls ways around obstacles keep
SCENARIOS, JUDGED = 32, 256  # in which plans are changed, and in which they are judged
REFINED, CHANGES = 3, 400  # of the best plans, so many changes each
WORSE = 0.5  # moves more than were expected: then new plans are looked for
IMPATIENCE = 1.15  # growth of the cost of a wrong difference with each move, so that no loop waits for better luck
CYCLE = 3  # moves that mend a wrong difference, at the least


class Replanning:
    """One run of the closed loop in the plane.

    A plan is a sequence of steps. Each step leads to its target from any positions of the particles, so that it corrects the
    effects of noise. Plans are compared by their mean number of moves in simulations with noise. If a plan ends before the goals,
    an estimate of the remaining moves is added.

    Parameters
    ----------
    task : SteeringTask
    apparatus : shoal.steering.simulation.apparatus.Apparatus
    noise : SteeringProblem
        The problem with the assumed noise: its fields ``execution`` and ``measurement``.
    """

    def __init__(self, task: SteeringTask, apparatus: Any, noise: Any) -> None:
        self.task, self.apparatus = task, apparatus
        self.world, self.room = world_of(task.world), task.world.room
        self.rng = np.random.default_rng([task.seed, 4])
        self.belief = PositionBelief(self.room, self.world, noise, apparatus.look(), self.rng)
        self.deviation = max(float(np.hypot(noise.execution, noise.measurement)), 1e-9 * self.room.size)
        near, far = (1 - np.exp(-0.5 * (share * task.tolerance / self.deviation) ** 2) for share in (1.0, 1.2))
        self.cycle = float(min(1 / near + CYCLE / far, 1e3))
        margins = tuple(share * self.deviation / self.room.size for share in MARGINS)
        self.translations = Translations(task, margins)
        self.exact = Translations(task)

    def run(self) -> None:
        """Run until the particles are observed at their goals, or the maximum number of moves is reached."""
        plan, expected = None, 0.0
        move = np.zeros(2)
        while (sent := len(self.apparatus.inputs)) < self.task.max_moves:
            if self.belief.arrived(self.task.goal, self.task.tolerance, share=sent / self.task.max_moves):
                return
            plan, expected = self._plan(plan, expected)
            kernels.make_move(plan[0], 0, self.belief.state, move)
            self.apparatus.send(move.copy())
            self.belief.update(move, self.apparatus.look())
            expected -= 1

    def _plan(self, last: Any, expected: float) -> tuple[tuple[kernels.Steps, int], float]:
        """Return the steps of the best plan from the present belief, and its mean number of moves."""
        sent = len(self.apparatus.inputs)
        left, cycle = min(self.task.max_moves - sent, MOST_STEPS), min(self.cycle * IMPATIENCE**sent, 1e6)
        task = replace(self.task, start=self.belief.state, max_moves=left)
        errors = self.rng.normal(scale=self.deviation, size=(JUDGED, MOST_STEPS, 2))
        judged = kernels.Noise(self.belief.states, errors, self.deviation, cycle)
        found = [self._judged(plan, judged) for plan in self._plans_at_hand(task, last)]
        if last is None:
            found += [self._judged(plan, judged) for plan in self._new_plans(task, FIRST_TREES)]
        elif not task.late and min(cost for _, cost in found) > expected + WORSE:
            found += [self._judged(plan, judged) for plan in self._new_plans(task, TREES)]
        found = sorted(found, key=lambda one: one[1])
        few = kernels.Noise(self.belief.states[:SCENARIOS], errors[:SCENARIOS].copy(), self.deviation, cycle)
        for plan, _cost in found[:REFINED]:
            if not task.late:
                steps, count, _ = improved(task, self.world, _copied(plan), plan[1], self.rng, changes=CHANGES, noise=few)
                found.append(self._judged((steps, count), judged))
        return min(found, key=lambda one: one[1])

    def _judged(self, plan: tuple[kernels.Steps, int], noise: kernels.Noise) -> tuple[tuple[kernels.Steps, int], float]:
        """Return a plan with its mean number of moves in simulations with noise."""
        task = replace(self.task, start=self.belief.state)
        _, _, cost = improved(task, self.world, _copied(plan), plan[1], self.rng, changes=0, noise=noise)
        return plan, cost

    def _plans_at_hand(self, task: SteeringTask, last: Any) -> Iterator[tuple[kernels.Steps, int]]:
        """Yield the rest of the last plan, this rest with its first step repeated, and translations, also around obstacles."""
        offset = (task.start - task.goal).mean(axis=0)
        for moves in [-offset[None], *self.translations.around(offset)]:
            if len(moves) <= task.max_moves:
                yield steps_of(task, moves)
        if last is not None:
            for first in (0, 1):
                if 0 < last[1] - first <= task.max_moves:
                    yield _copied(last, first), last[1] - first

    def _new_plans(self, task: SteeringTask, trees: int) -> Iterator[tuple[kernels.Steps, int]]:
        """Yield plans for a world without noise, and the same plans with contacts that push into their walls."""
        plans = [None if isinstance(self.room, Region) else Shortest().plan(task)]
        for tree in range(trees if plans[0] is None else 0):
            if tree and task.late:
                break
            moves = Tree(task, self.world, self.rng, left=MORE_ROUNDS).search(self.exact)
            plans.append(None if moves is None else annealed(task, self.world, moves, self.rng, changes=SHORTENED))
        for moves in plans:
            plan = steps_of(task, np.zeros((0, 2)) if moves is None else moves)
            for share in OVERSHOOTS if plan[1] <= task.max_moves else ():
                steps = _copied(plan)
                outward = np.stack([-steps.along[:, 1], steps.along[:, 0]], axis=1)
                steps.targets[:] += share * self.deviation * outward
                yield steps, plan[1]


def _copied(plan: tuple[kernels.Steps, int], first: int = 0) -> kernels.Steps:
    """Return a copy of the steps of a plan, beginning with a given step."""
    steps, count = new_steps(), plan[1] - first
    for new, old in zip(steps, plan[0], strict=True):
        new[:count] = old[first : plan[1]]
    return steps
