"""Episodes for tests: a problem and its run in one call, by closest-frontier unless
told otherwise.
"""

from __future__ import annotations

from typing import Any

from shoal.lab import run_trials as run_trials_of
from shoal.swarm import SwarmEpisode, SwarmProblem
from shoal.swarm.noise import Noise
from shoal.swarm.run import run as run_problem

RUNNING = ("seed", "trial", "trials", "workers", "stepwise", "on_moves", "on_trial")


def problem_of(
    place: Any, *, policy: Any = "closest-frontier", noise: Noise | None = None, **fields: Any
) -> SwarmProblem:
    """Return the problem with these fields."""
    return SwarmProblem(place, policy=policy, **fields, **({} if noise is None else vars(noise)))


def run(place: Any, **given: Any) -> SwarmEpisode:
    """Play the problem with these fields, from this seed and trial."""
    running = {name: given.pop(name) for name in RUNNING if name in given}
    return run_problem(problem_of(place, **given), **running)


def run_trials(place: Any, **given: Any) -> list[SwarmEpisode]:
    """Play several trials of the problem with these fields."""
    running = {name: given.pop(name) for name in RUNNING if name in given}
    return run_trials_of(problem_of(place, **given), **running)
