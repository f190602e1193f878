"""A planner's memory between two moves, and its working memory."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.planning.beam import Beam
from shoal.swarm.kernels.planning.completion import KeptStates, most
from shoal.swarm.kernels.planning.frontier_paths import path_to_nearest
from shoal.swarm.kernels.prediction.forward_model import Scene, immediate_gains, take_state
from shoal.swarm.kernels.prediction.learned_prior import LearnedPrior
from shoal.swarm.kernels.prediction.occupancy_prediction import OccupancyPrediction
from shoal.swarm.kernels.prediction.occupancy_prior import OccupancyPrior
from shoal.swarm.kernels.records import record_type

WHOLE = 1 << 20  # denominator of fractions stored as whole numbers
MEMORY = record_type(
    np.int64,
    "plan_at", "plan_length",  # place in the incumbent, and its length
    "quiet",  # moves since the last classification
    "forced",  # commands left of a path that is sent completely
    "random",  # state of the random generator
    "simulated",  # number of moves simulated so far
    "remaining",  # number of frontier cells
    "style",  # style in which the incumbent was completed
    "credit",  # number of moves that may be simulated
    "surprise",  # recent prediction error: fraction of new free cells that were not predicted as free, in 1 / WHOLE
)  # fmt: skip


class Planner(NamedTuple):
    """Memory, options and working memory."""

    memory: Any  # a record of MEMORY
    options: Any  # a record: budget, and the fields of shoal.swarm.policies.planners.tuning.Tuning
    scene: Scene
    root: NDArray[np.uint64]  # a state: the current state of the episode
    state: NDArray[np.uint64]  # a state: the state of the simulated plan
    ahead: NDArray[np.uint64]  # a board: the particles after one more move
    planes: NDArray[np.uint64]  # (PLANES, words)
    gains: NDArray[np.int64]  # (directions,)
    incumbent: NDArray[np.int8]  # the best plan so far
    trial: NDArray[np.int8]  # the plan that is simulated
    kept: KeptStates
    beam: Beam
    prior: OccupancyPrior
    prediction: OccupancyPrediction
    learned: LearnedPrior


@in_place_kernel
def draw(planner, limit):
    """Return a random whole number below ``limit`` (xorshift; its state is an entry of the memory)."""
    word = np.uint64(planner.memory.random)
    word ^= word << np.uint64(13)
    word ^= word >> np.uint64(7)
    word ^= word << np.uint64(17)
    planner.memory.random = np.int64(word >> np.uint64(1))
    return np.int64((word >> np.uint64(33)) % np.uint64(limit))


@in_place_kernel
def next_command(planner):
    """Return the next command of the incumbent, or -1 if it has none."""
    memory = planner.memory
    if memory.plan_at >= memory.plan_length:
        return -1
    memory.plan_at += 1
    return planner.incumbent[memory.plan_at - 1]


@in_place_kernel
def force(field, planner):
    """Set the plan to the path to the nearest frontier cell. Such a path always classifies a cell, so every episode ends."""
    memory = planner.memory
    take_state(field, planner.root)
    for i in range(field.open.shape[0]):
        planner.prediction.open[i] = field.open[i]
    limit = planner.incumbent.shape[0]
    memory.forced = max(0, path_to_nearest(planner.scene, planner.root, planner.planes, planner.incumbent, np.int64(0), limit))
    memory.plan_at, memory.plan_length = 0, memory.forced


@in_place_kernel
def take_greedily(field, planner):
    """Set the plan to the command that classifies most cells now, or to the path to the nearest frontier cell."""
    memory = planner.memory
    take_state(field, planner.root)
    immediate_gains(planner.scene, planner.root, planner.gains)
    planner.incumbent[0] = most(planner.gains, np.int64(-1))
    memory.plan_at, memory.plan_length = 0, 1
    if planner.incumbent[0] < 0:
        force(field, planner)


@in_place_kernel
def choose_greedy(field, planner):
    """Return the next command of the policy greedy-classify: the one that classifies most cells now, or the next one of a path."""
    memory = planner.memory
    if memory.plan_at >= memory.plan_length:
        take_greedily(field, planner)
    return next_command(planner)
