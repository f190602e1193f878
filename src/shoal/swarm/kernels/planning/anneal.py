"""Simulated annealing of a plan for a known map.

Annealing keeps a random change that makes the plan shorter, and often also a change that makes the
plan a little longer. The kernel stores the states along the plan at regular intervals. To judge a
change, the kernel simulates the plan only from the last stored state before the change.

Source: Kirkpatrick, Gelatt and Vecchi, Optimization by simulated annealing, Science 220 (1983). The
kinds of changes are an addition by Shoal (docs/concepts/planners.md).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.planning.forward_model import (
    FRONTIER,
    advance,
    copy_state,
    count,
    directions,
    immediate_gains,
    path_to_nearest,
)
from shoal.swarm.kernels.planning.plan_search import draw, most

LONGEST_CHANGE = 8  # maximum number of commands that one change inserts or removes
_FINENESS = 1 << 30  # number of different random numbers between 0 and 1


class AnnealedPlan(NamedTuple):
    """The current, the changed and the shortest plan during annealing, and the stored states along
    the current plan.
    """

    plan: NDArray[np.int8]  # the current plan
    trial: NDArray[np.int8]  # a changed copy of the current plan
    shortest: NDArray[np.int8]  # the shortest plan so far
    checkpoints: NDArray[
        np.uint64
    ]  # (places, boards, words): the states along the current plan after each ``every`` moves
    every: int


@in_place_kernel
def change(planner, plans, length):
    """Write a changed copy of the current plan to the trial plan.

    The place and the kind of the change are random. The kinds are: replace one command; insert 1,
    2, 4 or 8 equal commands; remove 1, 2, 4 or 8 commands; overwrite 1, 2, 4 or 8 commands with one
    repeated command; or replace up to four commands by one command. Return the index of the first
    changed move and the length of the trial plan.
    """
    plan, trial = plans.plan, plans.trial
    at, kind = draw(planner, np.int64(length)), draw(planner, np.int64(5))
    command = draw(planner, np.int64(directions(planner.scene)))
    many = np.int64(1) << draw(planner, np.int64(4))
    added, removed = np.int64(1), np.int64(1)
    if kind == 1:
        added, removed = many, np.int64(0)
    elif kind == 2:
        added, removed = np.int64(0), many
    elif kind == 3:
        added, removed = many, many
    elif kind == 4:
        removed = 1 + draw(planner, np.int64(4))
    for i in range(at // plans.every * plans.every, at):
        trial[i] = plan[i]
    for i in range(at, at + added):
        trial[i] = command
    end = at + added
    for i in range(at + removed, length):
        trial[end] = plan[i]
        end += 1
    return at, end


@in_place_kernel
def finish(planner, state, plan, at, length, limit):
    """Simulate the rest of a plan, and append commands until no frontier cell is left.

    The simulation begins with ``state`` and the command at index ``at``. The greedy base policy
    chooses the appended commands. Return the number of moves in the whole plan, and the number of
    simulated moves. If the whole plan needs more than ``limit`` moves, return ``limit + 1`` as the
    first number.
    """
    scene, simulated, begin = planner.scene, np.int64(0), at
    last = np.int64(plan[at - 1]) if at > 0 else np.int64(-1)
    remaining = count(state[FRONTIER])
    while remaining > 0:
        if at >= limit:
            return limit + 1, simulated + at - begin
        if at >= length:
            immediate_gains(scene, state, planner.gains)
            simulated += 1
            plan[at] = most(planner.gains, last)
            length = at + 1
            if plan[at] < 0:
                length = at + path_to_nearest(scene, state, planner.planes, plan, at, limit - at)
                simulated += limit - at
                if length <= at:
                    return limit + 1, simulated + at - begin
        last = np.int64(plan[at])
        remaining -= advance(scene, state, last)
        at += 1
    return at, simulated + at - begin


@in_place_kernel
def keep_states(planner, plans, at, length):
    """Store the states along the current plan, beginning with the last stored state before move
    ``at``.

    Return the number of simulated moves.
    """
    place = at // plans.every
    copy_state(plans.checkpoints[place], planner.state)
    for i in range(place * plans.every, length):
        if i % plans.every == 0:
            copy_state(planner.state, plans.checkpoints[i // plans.every])
        advance(planner.scene, planner.state, np.int64(plans.plan[i]))
    return length - place * plans.every


@in_place_kernel
def anneal(planner, plans, length, fewest, heat, budget):
    """Change the current plan at random until the kernel has simulated ``budget`` moves.

    The plan begins at the state ``planner.root``. The kernel accepts a plan that is longer by x
    moves with the probability exp(-x / heat). Return the lengths of the current plan and of the
    shortest plan, and the number of simulated moves.
    """
    plan, trial, capacity = plans.plan, plans.trial, plans.plan.shape[0] - 2 * LONGEST_CHANGE
    copy_state(planner.root, plans.checkpoints[0])
    spent = keep_states(planner, plans, np.int64(0), length)
    while spent < budget and length > 0:
        at, end = change(planner, plans, length)
        chance = (1.0 + draw(planner, np.int64(_FINENESS))) / _FINENESS
        limit = min(np.int64(length - heat * math.log(chance)), capacity)
        begin = at // plans.every * plans.every
        copy_state(plans.checkpoints[begin // plans.every], planner.state)
        end, simulated = finish(planner, planner.state, trial, begin, end, limit)
        spent += simulated
        if end > limit:
            continue
        for i in range(begin, end):
            plan[i] = trial[i]
        length = end
        spent += keep_states(planner, plans, begin, length)
        if length < fewest:
            fewest = length
            for i in range(length):
                plans.shortest[i] = plan[i]
    return length, fewest, spent
