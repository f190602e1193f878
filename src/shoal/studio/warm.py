"""Imports of all common libraries and kernels, for the process from which all other studio processes are forked."""

from __future__ import annotations

import gc

import shoal.steering.run
import shoal.studio.answers
import shoal.studio.jobs.missions
import shoal.studio.jobs.sweeps
from shoal.steering.problem import SteeringProblem
from shoal.studio.jobs.work import play_live
from shoal.swarm.problem import SwarmProblem
from shoal.swarm.run import load_kernels


def _load() -> None:
    """Load the kernels that a run with the default policy needs, and the kernels for steering two particles."""
    for policy in ("best", "closest-frontier"):
        problem = SwarmProblem([[1, 1]], particles=1, policy=policy)
        load_kernels(problem)
    play_live(problem, 0, lambda _word, _what: None)
    for planner in ("greedy", "shortest"):
        start, goal = [(0.2, 0.3), (0.5, 0.35)], [(0.8, 0.2), (0.3, 0.75)]
        shoal.steering.run.run(SteeringProblem("square", start, goal, planner=planner))
    gc.freeze()  # so that forks share the loaded objects


_load()
