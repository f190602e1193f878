"""The memory of a planner between two moves, and its working memory."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.moves import record_type
from shoal.swarm.kernels.planning.beam import Beam
from shoal.swarm.kernels.planning.completion import KeptStates, most
from shoal.swarm.kernels.planning.frontier_paths import path_to_nearest
from shoal.swarm.kernels.prediction.forward_model import Scene, immediate_gains, take_state
from shoal.swarm.kernels.prediction.learned_prior import LearnedPrior
from shoal.swarm.kernels.prediction.occupancy_prediction import OccupancyPrediction
from shoal.swarm.kernels.prediction.occupancy_prior import OccupancyPrior

WHOLE = 1 << 20  # denominator of fractions that records store as whole numbers
MEMORY = record_type(
    np.int64,
    "plan_at",
    # index of the next command in the incumbent (the best plan so far); length of the incumbent
    "plan_length",
    "quiet",  # number of moves since the last classification
    "forced",  # number of commands left to send, while the planner sends a whole path
    "random",  # state of the generator of random numbers
    "simulated",  # number of moves simulated so far
    "remaining",  # number of frontier cells
    "style",  # style of the base policy that completed the incumbent
    "credit",  # number of moves that the planner may simulate
    # recent share of new free cells that were not predicted to be free, in units of 1 / WHOLE
    "surprise",
)


class Planner(NamedTuple):
    """The memory, the options and the working memory of a planner."""

    memory: Any  # a record of MEMORY
    options: Any  # a record: budget, and the fields of shoal.swarm.policies.planners.tuning.Tuning
    scene: Scene
    root: NDArray[np.uint64]  # the current state of the episode
    state: NDArray[np.uint64]  # the state of the simulated plan
    ahead: NDArray[np.uint64]  # the cells of the particles after one more move
    planes: NDArray[np.uint64]  # (PLANES, words)
    gains: NDArray[np.int64]  # (directions,)
    incumbent: NDArray[np.int8]  # the best plan so far
    trial: NDArray[np.int8]  # the plan in simulation
    kept: KeptStates
    beam: Beam
    prior: OccupancyPrior
    prediction: OccupancyPrediction
    learned: LearnedPrior


@in_place_kernel
def draw(planner, limit):
    """Return a random whole number from 0 to ``limit - 1`` by the xorshift method.

    ``planner.memory.random`` holds the state of the generator.
    """
    word = np.uint64(planner.memory.random)
    word ^= word << np.uint64(13)
    word ^= word >> np.uint64(7)
    word ^= word << np.uint64(17)
    planner.memory.random = np.int64(word >> np.uint64(1))
    return np.int64((word >> np.uint64(33)) % np.uint64(limit))


@in_place_kernel
def next_command(planner):
    """Return the next command of the incumbent (the best plan so far), or -1 at the end of the
    plan.
    """
    memory = planner.memory
    if memory.plan_at >= memory.plan_length:
        return -1
    memory.plan_at += 1
    return planner.incumbent[memory.plan_at - 1]


@in_place_kernel
def force(field, planner):
    """Replace the incumbent (the best plan so far) by the path to the nearest frontier cell.

    A whole path always classifies a cell, so every episode ends.
    """
    memory = planner.memory
    take_state(field, planner.root)
    for i in range(field.open.shape[0]):
        planner.prediction.open[i] = field.open[i]
    limit = planner.incumbent.shape[0]
    memory.forced = max(
        0,
        path_to_nearest(
            planner.scene, planner.root, planner.planes, planner.incumbent, np.int64(0), limit
        ),
    )
    memory.plan_at, memory.plan_length = 0, memory.forced


@in_place_kernel
def take_greedily(field, planner):
    """Replace the incumbent (the best plan so far) by the command that classifies the most cells
    with one move.

    If no single command classifies a cell, the new incumbent is the path to the nearest frontier
    cell.
    """
    memory = planner.memory
    take_state(field, planner.root)
    immediate_gains(planner.scene, planner.root, planner.gains)
    planner.incumbent[0] = most(planner.gains, np.int64(-1))
    memory.plan_at, memory.plan_length = 0, 1
    if planner.incumbent[0] < 0:
        force(field, planner)


@in_place_kernel
def choose_greedy(field, planner):
    """Return the next command of the policy greedy-classify, or -1 if no command is left.

    The policy sends the command that classifies the most cells with one move. If no single command
    classifies a cell, the policy sends the commands of the path to the nearest frontier cell.
    """
    memory = planner.memory
    if memory.plan_at >= memory.plan_length:
        take_greedily(field, planner)
    return next_command(planner)
