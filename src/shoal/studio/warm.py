"""Imported once, by the process that others are forked from: what they all need is loaded, and kernels with it."""

from __future__ import annotations

import gc

import shoal.steering.run
import shoal.studio.answers
import shoal.studio.jobs.work
from shoal.steering.problem import SteeringProblem
from shoal.swarm.problem import SwarmProblem
from shoal.swarm.run import load_kernels


def _load() -> None:
    """Load the kernels that are asked for first: those of the default policy, and of plans for two particles."""
    for policy in ("best", "closest-frontier"):
        load_kernels(SwarmProblem([[1, 1]], particles=1, policy=policy))
    for planner in ("greedy", "shortest"):
        start, goal = [(0.2, 0.3), (0.5, 0.35)], [(0.8, 0.2), (0.3, 0.75)]
        shoal.steering.run.run(SteeringProblem("square", start, goal, planner=planner))
    gc.freeze()  # so that forks share what is loaded


_load()
