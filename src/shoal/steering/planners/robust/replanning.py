"""The closed loop in the plane: make the first move of the plan that needs the fewest moves in simulations, and plan again."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from math import inf
from typing import Any

import numpy as np

from shoal.steering.kernels import shortening as kernels
from shoal.steering.kernels.sampling import step
from shoal.steering.planners.robust.belief import PositionBelief
from shoal.steering.planners.sampling import MORE_ROUNDS, Translations, Tree, world_of
from shoal.steering.planners.shortening import MOST_STEPS, Plan, Shortening, copy_of, steps_of
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

    A plan is a sequence of steps. Each step computes its move from the present positions of the particles, so that it corrects the
    effects of noise. The loop compares plans by their mean number of moves in simulations with noise. If a simulated plan ends
    before the particles reach their goals, the loop adds an estimate of the remaining moves to the plan's number of moves.

    Parameters
    ----------
    task : SteeringTask
    apparatus : shoal.steering.simulation.apparatus.Apparatus
    noise : SteeringProblem
        A problem whose fields ``execution`` and ``measurement`` hold the standard deviations of the assumed noise.
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
        """Run the closed loop until the particles are probably at their goals, or until the maximum number of moves is reached."""
        plan, move = None, np.zeros(2)
        while (sent := len(self.apparatus.inputs)) < self.task.max_moves:
            if self.belief.arrived(self.task.goal, self.task.tolerance, share=sent / self.task.max_moves):
                return
            plan = self._plan(plan)
            kernels.make_move(plan.steps, 0, self.belief.state, move)
            self.apparatus.send(move.copy())
            self.belief.update(move, self.apparatus.look())

    def _plan(self, last: Plan | None) -> Plan:
        """Return the best plan for the estimated positions of the particles."""
        sent = len(self.apparatus.inputs)
        left, cycle = min(self.task.max_moves - sent, MOST_STEPS), min(self.cycle * IMPATIENCE**sent, 1e6)
        task = replace(self.task, start=self.belief.state, max_moves=left)
        errors = self.rng.normal(scale=self.deviation, size=(JUDGED, MOST_STEPS, 2))
        judged = kernels.Noise(self.belief.states, errors, self.deviation, cycle)
        few = kernels.Noise(self.belief.states[:SCENARIOS], errors[:SCENARIOS].copy(), self.deviation, cycle)
        shortening = Shortening(task, self.world, self.rng)

        def costs(plans: Iterable[Plan]) -> list[Plan]:
            return [shortening.changed(plan, changes=0, noise=judged) for plan in plans]

        found = costs(self._plans_at_hand(task, last))
        useful = [plan for plan in found if self._moves_particles(plan, few)]
        if last is None:
            found += costs(self._new_plans(shortening, FIRST_TREES))
        elif not task.late and min((plan.cost for plan in useful), default=inf) > last.cost - 1 + WORSE:
            found += costs(self._new_plans(shortening, TREES))
        found.sort(key=lambda plan: plan.cost)
        best = [plan for plan in found if self._moves_particles(plan, few)][:REFINED]
        found += costs(shortening.changed(plan, changes=CHANGES, noise=few) for plan in best if not task.late)
        useful = [plan for plan in found if self._moves_particles(plan, few)]
        return min(useful or found, key=lambda plan: plan.cost)

    def _moves_particles(self, plan: Plan, noise: kernels.Noise) -> bool:
        """Return whether, in at least one noise scenario, the first move of a plan moves a particle farther than the noise does.

        The loop carries out a plan whose first move changes nothing only if it has no other plan. After such a move, the loop would
        be in the same state, and would often choose the same move again.
        """
        move, state = np.zeros(2), np.zeros((2, 2))
        for start, errors in zip(noise.starts, noise.errors, strict=True):
            kernels.make_move(plan.steps, 0, start, move)
            state[:] = start
            step(state, move + errors[0], self.world)
            if np.abs(state - start).max() > self.deviation:
                return True
        return False

    def _plans_at_hand(self, task: SteeringTask, last: Plan | None) -> Iterator[Plan]:
        """Yield the last plan, the last plan without its first step, and translations straight to the goals or around obstacles."""
        offset = (task.start - task.goal).mean(axis=0)
        for moves in [-offset[None], *self.translations.around(offset)]:
            if len(moves) <= task.max_moves:
                yield steps_of(task, moves)
        if last is not None:
            yield from (copy_of(last, first) for first in (0, 1) if 0 < last.count - first <= task.max_moves)

    def _new_plans(self, shortening: Shortening, trees: int) -> Iterator[Plan]:
        """Yield new plans for a world without noise, and copies of these plans whose moves to contacts aim behind the walls."""
        task = shortening.task
        whole = None if isinstance(self.room, Region) else Shortest().plan(task)
        plans = [steps_of(task, np.zeros((0, 2)) if whole is None else whole)]
        for tree in range(trees if whole is None else 0):
            if tree and task.late:
                break
            moves = Tree(task, self.world, self.rng, left=MORE_ROUNDS).search(self.exact)
            if moves is not None:
                plans.append(shortening.changed(steps_of(task, moves), changes=SHORTENED))
        for plan in plans:
            for share in OVERSHOOTS if plan.count <= task.max_moves else ():
                steps = copy_of(plan).steps
                outward = np.stack([-steps.along[:, 1], steps.along[:, 0]], axis=1)
                steps.targets[:] += share * self.deviation * outward
                yield Plan(steps, plan.count)
