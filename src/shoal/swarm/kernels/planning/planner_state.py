"""What a planner remembers between two moves, and the space that it works in."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import inlined_kernel, kernel
from shoal.swarm.kernels.planning.beam import Beam
from shoal.swarm.kernels.planning.completion import most
from shoal.swarm.kernels.planning.frontier_paths import way
from shoal.swarm.kernels.prediction.forward_model import Scene, prospects, take_state
from shoal.swarm.kernels.prediction.occupancy_prediction import Guess
from shoal.swarm.kernels.prediction.occupancy_prior import Experience

# entries of Planner.memory
PLAN_AT, PLAN_LENGTH = 0, 1  # of the incumbent
QUIET = 2  # moves since something was settled
STALE = 3  # moves since the last search
FORCED = 4  # commands left of a way that is played whole
RANDOM = 5  # state of the generator
IMAGINED = 6  # moves imagined so far
REMAINING = 7  # cells of the frontier
MANNER = 8  # in which the incumbent was completed
CREDIT = 9  # moves that may be imagined
SURPRISE = 10  # share of the cells found free lately that had not been predicted to be, in 1 / WHOLE
MEMORY = 11
WHOLE = 1 << 20

# entries of Planner.options
BUDGET = 0  # moves that may be imagined for each move sent, on average
FEW = 1  # frontier cells up to which the end is in sight
HORIZON, DISCOUNT = 2, 3  # of plans to the end
NEAR_HORIZON, NEAR_DISCOUNT = 4, 5  # while the end is out of sight
SHARE = 6  # moves that settling all known frontier cells at once is worth
WIDTH, DEPTH, LEAVES = 7, 8, 9  # of the beam, and leaves completed
AHEAD, RATE, CAP = 10, 11, 12  # of the outlook that ranks states of the beam: weight, discount a move, furthest
VARIATIONS = 13  # of the incumbent
CHARGE = 14  # cells that a cell left behind costs a careful completion; 0: greedy ones alone
LIKELY, LAYERS = 15, 16  # of the prediction
RUNS = 17  # whether whole runs in one direction are candidates, too
RENEW = 18  # quiet moves after which to search again
PATIENCE = 19  # quiet moves after which a whole way is played
SURE = 20  # chance that all cells up to a predicted one are free
AFTER = 21  # what a cell counts that will join the frontier if all is as predicted
WONDER = 22  # how much more settling early is worth if all that is found is a surprise
TRUST = 23  # how fast the horizon shrinks with surprises; 0: not at all
CALM = 24  # share of surprises below which the end is in sight, however many frontier cells there are
FORESEEN = 25  # share of surprises below which plans are imagined as far as the next two say
FAR_HORIZON, FAR_DISCOUNT = 26, 27
LATTICES = 28  # that the free cells may lie on, of periods 2, 4, ...
OPTIONS = 29


class Planner(NamedTuple):
    """Memory, options and work space."""

    memory: NDArray[np.int64]  # (MEMORY,)
    options: NDArray[np.float64]  # (OPTIONS,)
    scene: Scene
    root: NDArray[np.uint64]  # a state: the episode now
    state: NDArray[np.uint64]  # a state: of the plan that is imagined
    ahead: NDArray[np.uint64]  # a board: the particles one move further
    planes: NDArray[np.uint64]  # (PLANES, words)
    gains: NDArray[np.int64]  # (directions,)
    incumbent: NDArray[np.int8]  # the best plan known
    trial: NDArray[np.int8]  # the plan that is imagined
    beam: Beam
    experience: Experience
    guess: Guess


@kernel
def draw(planner, limit):
    """Return a random whole number below ``limit`` (xorshift; its state is an entry of the memory)."""
    word = np.uint64(planner.memory[RANDOM])
    word ^= word << np.uint64(13)
    word ^= word >> np.uint64(7)
    word ^= word << np.uint64(17)
    planner.memory[RANDOM] = np.int64(word >> np.uint64(1))
    return np.int64((word >> np.uint64(33)) % np.uint64(limit))


@kernel
def next_command(planner):
    """Return the next command of the incumbent; -1 if it has none."""
    memory = planner.memory
    if memory[PLAN_AT] >= memory[PLAN_LENGTH]:
        return -1
    memory[PLAN_AT] += 1
    memory[STALE] += 1
    return planner.incumbent[memory[PLAN_AT] - 1]


@kernel
def force(field, planner):
    """Take a whole way to the nearest frontier cell as the plan: playing it settles a cell, so every episode ends."""
    memory = planner.memory
    take_state(field, planner.root)
    for i in range(field.open.shape[0]):
        planner.guess.open[i] = field.open[i]
    limit = planner.incumbent.shape[0]
    memory[FORCED] = max(0, way(planner.scene, planner.root, planner.planes, planner.incumbent, np.int64(0), limit))
    memory[PLAN_AT], memory[PLAN_LENGTH] = 0, memory[FORCED]


@kernel
def take_greedily(field, planner):
    """Take the command that settles most now as the plan, or the way to the nearest frontier cell if none settles any."""
    memory = planner.memory
    take_state(field, planner.root)
    prospects(planner.scene, planner.root, planner.gains)
    planner.incumbent[0] = most(planner.gains, np.int64(-1))
    memory[PLAN_AT], memory[PLAN_LENGTH] = 0, 1
    if planner.incumbent[0] < 0:
        force(field, planner)


@inlined_kernel
def choose_greedy(field, planner):
    """Return the next command of the policy greedy-classify: the one that settles most now, else the way to the nearest."""
    memory = planner.memory
    if memory[PLAN_AT] >= memory[PLAN_LENGTH]:
        take_greedily(field, planner)
    return next_command(planner)
