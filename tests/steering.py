"""What tests of steering share."""

from __future__ import annotations

import numpy as np

from shoal.core.episode import Status
from shoal.core.version import versions
from shoal.steering import SteeringEpisode, SteeringProblem
from shoal.steering.run import run
from shoal.steering.simulation import replay


def steer(problem: SteeringProblem, *, seed: int = 0, **fields: object) -> SteeringEpisode:
    """Run a problem with other fields."""
    return run(problem.replaced(**fields), seed=seed)


def thrown(
    workspace: object, start: object, moves: object, *, seed: int = 3, **fields: object
) -> SteeringEpisode:
    """An episode of any moves, by hand."""
    inputs = np.array(moves, dtype=float)
    problem = SteeringProblem(workspace, start, start).replaced(**fields)
    return SteeringEpisode(
        problem=problem,
        planner="by hand",
        status=Status.LIMIT,
        reason="no plan",
        inputs=inputs,
        states=replay(problem, inputs, seed=seed),
        order=np.arange(problem.n_particles),
        seed=seed,
        lower_bound=None,
        seconds=0.0,
        versions=versions(),
    )
