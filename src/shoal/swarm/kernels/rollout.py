"""Planning by rollouts (spec/swarm.md, section 7, P1): candidates are completed by a base policy in the predicted world."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.swarm.kernels.beam import Beam, search_beam, take_best
from shoal.swarm.kernels.compiling import kernel
from shoal.swarm.kernels.completion import GREEDY, complete, most
from shoal.swarm.kernels.foresight import FRONTIER, Scene, copy_state, count, directions, prospects, take_state
from shoal.swarm.kernels.guess import DEPTH, LIKELY, Guess, predict
from shoal.swarm.kernels.survey import Survey
from shoal.swarm.kernels.ways import way

# entries of Planner.memory
PLAN_AT, PLAN_LENGTH = 0, 1  # of the incumbent
QUIET = 2  # moves since something was settled
STALE = 3  # moves since the last search
FORCED = 4  # commands left of a way that is played whole
RANDOM = 5  # state of the generator
IMAGINED = 6  # moves imagined so far
REMAINING = 7  # cells of the frontier
MANNER = 8  # of completion, that found the incumbent
CREDIT = 9  # moves that may be imagined
LENGTH_FORESEEN = 10
MEMORY = 12

FEW = 200  # frontier cells up to which the end is in sight
FAR_HORIZON, NEAR_HORIZON = 150, 60
FAR_DISCOUNT, NEAR_DISCOUNT = 0.99, 0.98
LEAVES, VARIATIONS, RENEW = 6, 8, 8
P1_WIDTH, P1_DEPTH = 24, 12
LONGEST = 400  # room of a plan


class Planner(NamedTuple):
    """What a planner remembers between two moves, and the space that it works in."""

    memory: NDArray[np.int64]  # (MEMORY,)
    options: NDArray[np.float64]
    scene: Scene
    root: NDArray[np.uint64]  # a state: the episode now
    state: NDArray[np.uint64]  # a state: of the plan that is imagined
    ahead: NDArray[np.uint64]  # a state: one move further
    planes: NDArray[np.uint64]  # (PLANES, words)
    gains: NDArray[np.int64]  # (directions,)
    incumbent: NDArray[np.int8]  # (LONGEST,)
    trial: NDArray[np.int8]  # (LONGEST,)
    beam: Beam
    survey: Survey
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
def look(field, mapping, planner):
    """Fill the scene with the predicted world and the root with the state of the episode."""
    if mapping:
        predict(field, planner.survey.tallies, planner.guess, DEPTH, LIKELY)
    else:
        for i in range(field.open.shape[0]):
            planner.guess.open[i] = field.open[i]
    take_state(field, planner.root)


@kernel
def weigh(planner, length, best, few):
    """Complete the trial plan; make it the incumbent if its value is above ``best``; return the higher value."""
    horizon, discount = (FAR_HORIZON, FAR_DISCOUNT) if few > 0 else (NEAR_HORIZON, NEAR_DISCOUNT)
    copy_state(planner.root, planner.state)
    scene = planner.scene
    time, value, length, moves = complete(
        scene, planner.state, planner, planner.trial, length, horizon, discount, GREEDY, 0.0, horizon
    )
    planner.memory[IMAGINED] += moves
    if few > 0:
        value = 30.0 / few * value - time
    if value <= best:
        return best
    for i in range(length):
        planner.incumbent[i] = planner.trial[i]
    planner.memory[PLAN_AT], planner.memory[PLAN_LENGTH] = 0, length
    return value


@kernel
def think(planner):
    """Replace the incumbent by the best plan found."""
    memory, scene, trial, incumbent = planner.memory, planner.scene, planner.trial, planner.incumbent
    remaining = count(planner.root[FRONTIER])
    few = remaining if remaining <= FEW else 0
    at, length = memory[PLAN_AT], memory[PLAN_LENGTH]
    for i in range(at, length):
        trial[i - at] = incumbent[i]
    best = weigh(planner, length - at, -1e9, few)
    for command in range(directions(scene)):
        trial[0] = command
        best = weigh(planner, 1, best, few)
    beam = planner.beam
    discount = FAR_DISCOUNT if few > 0 else NEAR_DISCOUNT
    half, size, imagined = search_beam(scene, planner.root, beam, planner, discount, P1_WIDTH, P1_DEPTH, 0.0, 0.0, 0)
    memory[IMAGINED] += imagined
    for _ in range(min(LEAVES, size)):
        leaf = take_best(beam.ranks[half], size)
        for i in range(P1_DEPTH):
            trial[i] = beam.plans[half, leaf, i]
        best = weigh(planner, P1_DEPTH, best, few)
    if few > 0:
        for _ in range(VARIATIONS):
            best = weigh(planner, vary(planner), best, few)


@kernel
def vary(planner):
    """Write the incumbent into the trial up to a random place, with another command there; return its length."""
    length = max(1, planner.memory[PLAN_LENGTH])
    at = draw(planner, length)
    for i in range(at):
        planner.trial[i] = planner.incumbent[i]
    planner.trial[at] = draw(planner, directions(planner.scene))
    return at + 1


@kernel
def choose_rollout(field, mapping, planner):
    """Return the next command of the policy rollout; -1 if there is none."""
    memory = planner.memory
    if memory[FORCED] == 0 and memory[QUIET] >= 3 * (FAR_HORIZON if memory[REMAINING] <= FEW else NEAR_HORIZON):
        force(field, planner)
    if memory[FORCED] > 0:
        memory[FORCED] -= 1
    elif memory[QUIET] == 0 or memory[PLAN_AT] >= memory[PLAN_LENGTH] or memory[STALE] >= RENEW:
        look(field, mapping, planner)
        think(planner)
        memory[STALE] = 0
        if memory[PLAN_LENGTH] == 0:  # all that is left is further than the horizon
            force(field, planner)
            memory[FORCED] -= 1
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
    memory[FORCED] = max(0, way(planner.scene, planner.root, planner.planes, planner.incumbent, 0, limit, 0))
    memory[PLAN_AT], memory[PLAN_LENGTH] = 0, memory[FORCED]


@kernel
def choose_greedy(field, mapping, planner):
    """Return the next command of the policy greedy-classify: the one that settles most now, else the way to the nearest."""
    memory = planner.memory
    if memory[PLAN_AT] >= memory[PLAN_LENGTH]:
        take_state(field, planner.root)
        prospects(planner.scene, planner.root, planner.gains)
        planner.incumbent[0] = most(planner.gains, -1)
        memory[PLAN_AT], memory[PLAN_LENGTH] = 0, 1
        if planner.incumbent[0] < 0:
            force(field, planner)
            memory[FORCED] = 0
    if memory[PLAN_AT] >= memory[PLAN_LENGTH]:
        return -1
    memory[PLAN_AT] += 1
    return planner.incumbent[memory[PLAN_AT] - 1]
