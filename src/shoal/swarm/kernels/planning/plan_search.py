"""How the planner `best` chooses a command: it completes candidate plans on the predicted map, and
follows the best plan.

`choose_best` is the whole decision. `search_plans` collects the candidate plans: the rest of the
last plan, single commands, runs in one direction, the best leaves of a beam search (`search_beam`),
and random variations of the best plan so far (`vary`). `evaluate` simulates one candidate.
`complete` appends commands of the base policy to the candidate: the command that classifies the
most cells, or the path to the nearest frontier cell.

The page docs/concepts/planners.md explains the planner.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.moves import record_type
from shoal.swarm.kernels.planning.forward_model import (
    FRONTIER,
    MOD,
    TOO_FAR,
    UNSEEN,
    Scene,
    advance,
    beside,
    copy_state,
    count,
    digest,
    directions,
    immediate_gains,
    path_to_nearest,
    take_state,
)
from shoal.swarm.kernels.planning.learned_prior import LearnedPrior
from shoal.swarm.kernels.planning.prediction import OccupancyPrediction, OccupancyPrior, predict

WHOLE = 1 << 20  # denominator of fractions that records store as whole numbers
MEMORY = record_type(
    np.int64,
    "plan_at",  # index of the next command in the incumbent (the best plan so far)
    "plan_length",  # length of the incumbent
    "quiet",  # number of moves since the last classification
    "forced",  # number of commands left to send, while the planner sends a whole path
    "random",  # state of the generator of random numbers
    "simulated",  # number of moves simulated so far
    "remaining",  # number of frontier cells
    "credit",  # number of moves that the planner may simulate
    # recent share of new free cells that were not predicted to be free, in units of 1 / WHOLE
    "surprise",
)

NOTHING = -1e18  # lower than the value of any plan
LONGEST_RUN = (
    40  # maximum length of a candidate plan that moves in one direction until it classifies a cell
)

# budget below which the planner evaluates only the most promising plans, with a short horizon
BRIEF = 300.0
PLENTY = 900.0  # number of saved simulated moves from which the limit BRIEF does not apply
# for a budget below BRIEF: maximum number of saved simulated moves, as a multiple of the budget
SAVINGS = 20.0
BRIEF_HORIZON, BRIEF_DISCOUNT = 30.0, 0.97


class Beam(NamedTuple):
    """Working memory of the beam search: the states at two successive depths.

    The search uses the two halves of each array alternately.
    """

    states: NDArray[np.uint64]  # (2, width, boards, words)
    plans: NDArray[np.int8]  # (2, width, depth)
    values: NDArray[np.float64]  # (2, width): discounted numbers of classified cells
    marks: NDArray[np.uint64]  # (2, width): hashes of the states
    child: NDArray[np.uint64]  # the state after one more command


class Planner(NamedTuple):
    """The memory, the options and the working memory of a planner."""

    memory: Any  # a record of MEMORY
    options: (
        Any  # a record: budget, and the fields of shoal.swarm.policies.planners.beam_rollout.Tuning
    )
    scene: Scene
    root: NDArray[np.uint64]  # the current state of the episode
    state: NDArray[np.uint64]  # the state of the simulated plan
    planes: NDArray[np.uint64]  # (PLANES, words)
    gains: NDArray[np.int64]  # (directions,)
    incumbent: NDArray[np.int8]  # the best plan so far
    trial: NDArray[np.int8]  # the plan in simulation
    beam: Beam
    prior: OccupancyPrior
    prediction: OccupancyPrediction
    learned: LearnedPrior


@in_place_kernel
def choose_best(field, mapping, planner):
    """Return the next command of the planner `best`, or -1 if no command is left."""
    memory, options = planner.memory, planner.options
    saved = SAVINGS if options.budget < BRIEF else 1.0
    memory.credit = int(min(memory.credit + options.budget, saved * options.budget))
    if memory.forced == 0 and memory.quiet >= options.force_after:
        force(field, planner)
    renew = memory.credit > 0 and memory.quiet == 0
    if memory.forced > 0:
        memory.forced -= 1
    elif options.budget < BRIEF and not renew and memory.plan_at >= memory.plan_length:
        take_greedily(field, planner)
        memory.forced = max(0, memory.forced - 1)  # the first command of the path is sent now
    elif renew or memory.plan_at >= memory.plan_length:
        before = memory.simulated
        prepare(field, mapping, planner)
        search_plans(planner)
        memory.credit -= memory.simulated - before
        if memory.plan_length == 0:  # all frontier cells are beyond the horizon
            force(field, planner)
            memory.forced -= 1
    return next_command(planner)


@in_place_kernel
def is_brief(planner):
    """Return whether the budget allows only the most promising plans with a short horizon."""
    return planner.options.budget < BRIEF and planner.memory.credit < PLENTY


@in_place_kernel
def prepare(field, mapping, planner):
    """Write the predicted world to ``planner.scene``, and the state of the episode to
    ``planner.root``.
    """
    if mapping:
        options = planner.options
        layers, likely, joint = (
            int(options.prediction_layers),
            options.free_threshold,
            options.joint_chance,
        )
        predict(field, planner.prior, planner.learned, planner.prediction, layers, likely, joint)
    else:
        for i in range(field.open.shape[0]):
            planner.prediction.open[i] = field.open[i]
    take_state(field, planner.root)


@in_place_kernel
def search_plans(planner):
    """Replace the incumbent (the plan that the planner follows) by the best plan that the search
    finds.
    """
    memory, trial, options = planner.memory, planner.trial, planner.options
    remaining, few = count(planner.root[FRONTIER]), 0.0
    if remaining <= options.end_frontier or memory.surprise < options.end_surprise * WHOLE:
        few = remaining + options.future_weight * predicted_frontier(planner)
    at, length = memory.plan_at, memory.plan_length
    for i in range(at, length):
        trial[i - at] = planner.incumbent[i]
    best = evaluate(planner, length - at, NOTHING, few)
    brief = is_brief(planner)
    for command in range(directions(planner.scene)):
        trial[0] = command
        best = evaluate(planner, np.int64(1), best, few)
        if options.run_candidates > 0 and not brief:
            length = run(planner, command)
            if length > 1:
                best = evaluate(planner, length, best, few)
    if brief:
        return
    best = try_leaves(planner, best, few)
    if few > 0:
        for _ in range(int(options.variations)):
            best = evaluate(planner, vary(planner), best, few)


@in_place_kernel
def predicted_frontier(planner):
    """Return the number of unseen cells beside predicted free cells.

    If the prediction is correct, the unseen cells beside predicted free cells join the frontier.
    """
    beside(planner.scene, planner.scene.ground, planner.root[UNSEEN], planner.planes[MOD])
    return count(planner.planes[MOD])


@in_place_kernel
def run(planner, command):
    """Write a run of equal commands to the trial plan. The run ends with its first command that
    classifies a cell.

    Return the length of the run, or 0 if no cell is classified within LONGEST_RUN commands.
    """
    copy_state(planner.root, planner.state)
    for step in range(LONGEST_RUN):
        planner.trial[step] = command
        planner.memory.simulated += 1
        if advance(planner.scene, planner.state, command) > 0:
            return step + 1
    return 0


@in_place_kernel
def try_leaves(planner, best, few):
    """Complete the plans that end at the best leaves of the beam search. Return the value of the
    best plan so far.
    """
    options, beam, trial = planner.options, planner.beam, planner.trial
    if options.beam_leaves == 0:
        return best
    depth = int(options.beam_depth)
    half, size, simulated = search_beam(
        planner.scene,
        planner.root,
        beam,
        planner.gains,
        options.discount,
        int(options.beam_width),
        depth,
    )
    planner.memory.simulated += simulated
    for _ in range(min(int(options.beam_leaves), size)):
        leaf = take_best(beam.values[half], size)
        for i in range(depth):
            trial[i] = beam.plans[half, leaf, i]
        best = evaluate(planner, depth, best, few)
    return best


@in_place_kernel
def vary(planner):
    """Write a random variation of the incumbent to the trial plan. Return the length of the
    variation.

    Up to a random place, the variation equals the incumbent (the best plan so far). At this place,
    the function makes one of four changes: it replaces the rest of the incumbent by one random
    command, replaces the rest by k equal commands, inserts k equal commands, or removes k commands,
    where k is 1, 2, 4 or 8.
    """
    trial, incumbent = planner.trial, planner.incumbent
    length = max(1, planner.memory.plan_length)
    at, kind = draw(planner, length), draw(planner, np.int64(4))
    command, added, removed = draw(planner, directions(planner.scene)), np.int64(1), length - at
    if kind > 0:
        added = np.int64(1) << draw(planner, np.int64(4))
    if kind == 2:
        removed = np.int64(0)
    elif kind == 3:
        added, removed = np.int64(0), added
    for i in range(at):
        trial[i] = incumbent[i]
    for i in range(at, at + added):
        trial[i] = command
    end = at + added
    for i in range(at + removed, planner.memory.plan_length):
        trial[end] = incumbent[i]
        end += 1
    return end


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
def evaluate(planner, length, best, few):
    """Complete the trial plan. If its value is above ``best``, the trial plan becomes the incumbent
    (the best plan so far).

    Return the value of the trial plan or ``best``, whichever is higher.

    Let c_t be the number of cells that move t classifies. If the end is not in sight, ``few`` is 0,
    and the value of a plan is V = sum(discount^t c_t). If the planner simulates plans to the end of
    the task, ``few`` is F, the expected number of cells left to classify, and the value is V = w /
    F * sum(discount^t c_t) - T, where T is the number of moves up to the last classification. With
    reliable predictions, T includes an estimate of the moves for cells that are left at the
    horizon.
    """
    options, memory, end = planner.options, planner.memory, few > 0
    surprise = memory.surprise / WHOLE
    horizon, discount = options.horizon, options.discount
    if end and surprise < options.far_surprise:
        horizon, discount = options.far_horizon, options.far_discount
    elif not end and is_brief(planner):
        horizon, discount = min(horizon, BRIEF_HORIZON), BRIEF_DISCOUNT
    worth = (
        options.frontier_worth * (1.0 + options.surprise_weight * surprise) / few if end else 0.0
    )
    copy_state(planner.root, planner.state)
    bound = best if end else NOTHING
    time, value, length, moves, classified = complete(
        planner, length, int(horizon), discount, worth, few, bound
    )
    memory.simulated += moves
    if end:
        value = worth * value - time
        if time == int(horizon) and options.future_weight > 0 and surprise < options.end_surprise:
            # the cells that are left will cost moves at the same rate
            value -= time * count(planner.state[FRONTIER]) / max(classified, 1)
    if value <= best:
        return best
    for i in range(length):
        planner.incumbent[i] = planner.trial[i]
    memory.plan_at, memory.plan_length = 0, length
    return value


@in_place_kernel
def complete(planner, length, horizon, discount, worth, expected, best):
    """Simulate the first ``length`` commands of the trial plan, and append commands of the base
    policy up to the horizon.

    The simulation changes ``planner.state``. The simulation stops early if the plan cannot become
    better than ``best``. The early stop assumes that the immediate classification of a cell is
    worth ``worth`` moves, and that about ``expected`` cells are left to classify.

    Return five numbers: time, value, length, moves and classified. ``time`` is the number of moves
    up to the last classification, or ``horizon`` if cells are left. ``value`` is the discounted
    number of classified cells. ``length`` is the number of commands in the plan. ``moves`` is the
    number of simulated commands. ``classified`` is the number of classified cells.
    """
    scene, state, plan, gains = planner.scene, planner.state, planner.trial, planner.gains
    value, weight, last, finished, total = 0.0, 1.0, np.int64(-1), 0, 0
    at = 0
    while at < horizon:
        if at >= length:
            if worth * (value + weight * max(expected - total, 0.0)) - at <= best:
                return horizon, value, at, at, total
            immediate_gains(scene, state, gains)
            command = most(gains, last)
            if command >= 0:
                plan[at] = command
                length = at + 1
            else:
                path_length = path_to_nearest(scene, state, planner.planes, plan, at, horizon - at)
                if path_length == TOO_FAR:
                    return horizon, value, at, at, total
                if path_length == 0:
                    return finished, value, at, at, total
                length = at + path_length
        command = np.int64(plan[at])
        classified = advance(scene, state, command)
        at += 1
        if classified > 0:
            value += weight * classified
            total += classified
            finished = at
        weight *= discount
        last = command
    return horizon, value, min(length, at), at, total


@in_place_kernel
def most(gains, last):
    """Return the command that classifies the most cells, or -1 if no command classifies a cell.

    Among equally good commands, prefer ``last``, which is the previous command of the plan.
    """
    best = last if last >= 0 and gains[last] > 0 else np.int64(-1)
    for command in range(gains.shape[0]):
        if gains[command] > (gains[best] if best >= 0 else 0):
            best = command
    return best


@in_place_kernel
def search_beam(scene, root, beam, gains, discount, width, depth):
    """Search from the state ``root``. Return (index of the half of ``beam`` with the leaves, number
    of leaves, simulated moves).

    The leaves are the states at the last depth. The search ranks states by the discounted number of
    classified cells.
    """
    copy_state(root, beam.states[0, 0])
    beam.values[0, 0], beam.marks[0, 0] = 0.0, digest(root)
    old, size, weight, simulated = 0, np.int64(1), 1.0, 0
    child = beam.child
    for level in range(depth):
        new, count = 1 - old, np.int64(0)
        values, marks = beam.values[new, :width], beam.marks[new]
        for parent in range(size):
            immediate_gains(scene, beam.states[old, parent], gains)
            for command in range(gains.shape[0]):
                value = beam.values[old, parent] + weight * gains[command]
                if value <= lowest_value(values, count):
                    continue
                copy_state(beam.states[old, parent], child)
                advance(scene, child, np.int64(command))
                simulated += 1
                mark = digest(child)
                if mark == beam.marks[old, parent]:  # the command has moved nothing
                    continue
                at = place_for(values, marks, count, value, mark)
                if at < 0:
                    continue
                count = max(count, at + 1)
                copy_state(child, beam.states[new, at])
                values[at], marks[at] = value, mark
                for i in range(level):
                    beam.plans[new, at, i] = beam.plans[old, parent, i]
                beam.plans[new, at, level] = command
        if count == 0:
            return old, 0, simulated
        old, size = new, count
        weight *= discount
    return old, size, simulated


@in_place_kernel
def place_for(values, marks, size, value, mark):
    """Return the place in the beam for a new state, or -1 if the beam rejects the new state.

    If the beam contains an equal state, the new state replaces the equal state only if the new
    state has a higher value. If the beam has a free place, the new state takes the free place. In a
    full beam, the new state replaces the worst state only if the new state has a higher value.
    """
    for i in range(size):
        if marks[i] == mark:
            return i if value > values[i] else -1
    if size < values.shape[0]:
        return size
    worst = 0
    for i in range(1, size):
        if values[i] < values[worst]:
            worst = i
    return worst if value > values[worst] else -1


@in_place_kernel
def lowest_value(values, size):
    """Return the value that a new state must exceed: the worst value in a full beam, or -1 if the
    beam has a free place.
    """
    if size < values.shape[0]:
        return -1.0
    worst = values[0]
    for i in range(1, size):
        worst = min(worst, values[i])
    return worst


@in_place_kernel
def take_best(values, size):
    """Return the index of the best leaf, and clear the value of this leaf, so that the next call
    returns the next best leaf.
    """
    best = 0
    for i in range(1, size):
        if values[i] > values[best]:
            best = i
    values[best] = -1.0
    return best


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
def next_command(planner):
    """Return the next command of the incumbent (the best plan so far), or -1 at the end of the
    plan.
    """
    memory = planner.memory
    if memory.plan_at >= memory.plan_length:
        return -1
    memory.plan_at += 1
    return planner.incumbent[memory.plan_at - 1]
