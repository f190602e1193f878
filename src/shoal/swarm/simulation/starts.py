"""The start of an episode: drawing start cells and target cells, and making the swarm that the closed loop controls."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from shoal.swarm.grid.placements import place
from shoal.swarm.grid.randomness import noise_rng
from shoal.swarm.grid.world import GridWorld, check_start
from shoal.swarm.noise.simulated import noisy_belief
from shoal.swarm.problem import SwarmProblem
from shoal.swarm.simulation.exact import ExactSwarm
from shoal.swarm.simulation.noisy import NoisySwarm


def draw_start(problem: SwarmProblem, rng: Generator) -> tuple[NDArray[np.int64], NDArray[np.bool_] | None]:
    """Return the start cells (int64, shape (n, ndim)), and the mask of the target cells, or None for a task without target cells.

    If the problem contains start cells, the function does not draw start cells.
    """
    workspace = problem.place
    if problem.start is None:
        start = place(workspace, problem.particles, problem.placement, rng)
    else:
        start = check_start(workspace, problem.start, rule=problem.rule)
    return start, problem.chosen_task.choose_targets(workspace, rng)


def swarm_of(
    problem: SwarmProblem, start: NDArray[np.int64], targets: NDArray[np.bool_] | None, seed: int, trial: int = 0
) -> ExactSwarm | NoisySwarm:
    """Return the swarm at the start of an episode. ``seed`` and ``trial`` determine the noise."""
    if problem.noise is not None:
        rng = noise_rng(seed, trial)
        return NoisySwarm(noisy_belief(problem.place, start, problem.noise, problem.confidence, rng), rng)
    world = GridWorld(problem.place, problem.rule)
    state = world.initial(start)
    return ExactSwarm(world, problem.chosen_task, state, problem.chosen_task.begin(world, state, targets))
