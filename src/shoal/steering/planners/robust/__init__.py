"""Planner robust: a closed loop of moves and observations, for simulated worlds with noise."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import Any

import numpy as np

from shoal.steering.planners.narrow import plan_with_clearance
from shoal.steering.planners.protocol import PLANNERS
from shoal.steering.planners.robust.cycles import Cycles
from shoal.steering.planners.robust.replanning import Replanning
from shoal.steering.planners.sampling import Sampling
from shoal.steering.planners.shortest import Shortest
from shoal.steering.planners.task import SteeringTask
from shoal.steering.workspaces.convex_geometry import Points
from shoal.steering.workspaces.region import Region

ASSUMED = 1 / 16  # relative to the tolerance: assumed noise if the problem has none
QUIET_MOVES = 12  # maximum number of moves with assumed noise
SLIGHT = 1 / 12  # relative to the tolerance: with stronger noise, plans are evaluated in simulated noise
STOOD, STOOD_RUNS = (0.25, 0.0625), 3  # relative to the tolerance: noise levels to test, and number of runs for each


@PLANNERS.register("robust")
class Robust:
    """A planner for worlds with noise, which works in a closed loop: make one move, observe the particles, and plan again.

    In the plane, the planner compares plans by simulations with noise (class `Replanning`). In three dimensions, and in a convex
    workspace with a nonuniform gain or slight noise, the planner makes one cycle at a time (class `Cycles`).

    Notes
    -----
    Source: an addition by Shoal, for apparatuses with a nonuniform field, such as the apparatus in section VII.A of paper W.
    """

    name = "robust"
    obstacles = True

    def plan(self, task: SteeringTask) -> Points | None:
        """Return a short plan for a world without noise, in which no closed loop is necessary."""
        return (Sampling() if isinstance(task.world.room, Region) else Shortest()).plan(task)

    def control(self, task: SteeringTask, apparatus: Any) -> tuple[Points, Points]:
        """Run the closed loop, and return the moves that were sent and the resulting positions of the particles.

        In a world without noise, the method first sends a short plan. If this plan fails, the method puts the particles back at
        their starts and runs the closed loop with a small assumed noise. Whether or not the short plan fails, the method stores in
        ``apparatus.remark`` how much noise the closed loop would tolerate.
        """
        if apparatus.problem.noisy:
            _loop(task, apparatus, apparatus.problem, slight=SLIGHT).run()
        else:
            short = replace(task, max_moves=min(task.max_moves, QUIET_MOVES))
            for move in _moves_or_none(plan_with_clearance(task, self), task):
                apparatus.send(move)
            if task.error(apparatus.states[-1]) > task.tolerance:
                apparatus.restart()
                _loop(short, apparatus, apparatus.with_noise(ASSUMED * task.tolerance).problem).run()
            apparatus.remark = _noise_stood(short, apparatus)
        d = task.start.shape[1]
        return np.array(apparatus.inputs).reshape(-1, d), np.array(apparatus.states)


def _loop(task: SteeringTask, apparatus: Any, noise: Any, *, slight: float = inf) -> Cycles | Replanning:
    """Return the closed loop that suits the workspace and the noise.

    Noise is slight if its standard deviation is at most ``slight`` times the tolerance of the goals.
    """
    convex = not isinstance(task.world.room, Region)
    known = noise.gain > 0 or max(noise.execution, noise.measurement) <= slight * task.tolerance
    return (Cycles if convex and (known or task.world.room.dimensions == 3) else Replanning)(task, apparatus, noise)


def _moves_or_none(moves: Points | None, task: SteeringTask) -> Points:
    """Return the plan ``moves``, or an empty array if ``moves`` is None or has too many moves."""
    return np.zeros((0, task.start.shape[1])) if moves is None or len(moves) > task.max_moves else moves


def _noise_stood(task: SteeringTask, apparatus: Any) -> str:
    """Return a sentence about the largest tested execution noise with which all runs of the closed loop succeed."""
    for share in STOOD:
        noise = share * task.tolerance
        for seed in range(STOOD_RUNS):
            trial = apparatus.with_noise(noise, seed=seed)
            _loop(task, trial, trial.problem).run()
            if task.error(trial.states[-1]) > task.tolerance or task.late:
                break
        else:
            return f"in {STOOD_RUNS} of {STOOD_RUNS} runs with execution noise {noise:.2g} the loop also reaches the goals"
    return f"execution noise of {STOOD[-1] * task.tolerance:.2g} is too much here"
