"""Planning by rollouts: a base policy completes candidate plans in the predicted world, and the
planner follows the best plan.

The page docs/concepts/planners.md explains planning by rollouts.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.planning.beam import search_beam, take_best
from shoal.swarm.kernels.planning.completion import (
    BEST,
    CAREFUL,
    EVERY,
    GREEDY,
    LEAD,
    complete,
    keep_best,
)
from shoal.swarm.kernels.planning.frontier_paths import MOD, beside
from shoal.swarm.kernels.planning.planner_state import (
    WHOLE,
    draw,
    force,
    next_command,
    take_greedily,
)
from shoal.swarm.kernels.prediction.forward_model import (
    FRONTIER,
    UNSEEN,
    advance,
    copy_state,
    count,
    directions,
    take_state,
)
from shoal.swarm.kernels.prediction.occupancy_prediction import predict

NOTHING = -1e18  # lower than the value of any plan
# budget below which the planner evaluates only the most promising plans, with a short horizon
BRIEF = 300.0
PLENTY = 900.0  # number of saved simulated moves from which the limit BRIEF does not apply
# for a budget below BRIEF: maximum number of saved simulated moves, as a multiple of the budget
SAVINGS = 20.0
BRIEF_HORIZON, BRIEF_DISCOUNT = 30.0, 0.97
NO_MOVES = np.int64(0)
LONGEST_RUN = (
    40  # maximum length of a candidate plan that moves in one direction until it classifies a cell
)


@in_place_kernel
def prepare(field, mapping, planner):
    """Write the predicted world to ``planner.scene``, and the state of the episode to
    ``planner.root``.
    """
    if mapping:
        options = planner.options
        predict(
            field,
            planner.prior,
            planner.learned,
            planner.prediction,
            int(options.prediction_layers),
            options.free_threshold,
            options.joint_chance,
        )
    else:
        for i in range(field.open.shape[0]):
            planner.prediction.open[i] = field.open[i]
    take_state(field, planner.root)


@in_place_kernel
def is_brief(planner):
    """Return whether the budget allows only the most promising plans with a short horizon."""
    return planner.options.budget < BRIEF and planner.memory.credit < PLENTY


@in_place_kernel
def evaluate(planner, shared, length, best, few, style):
    """Complete the trial plan. If its value is above ``best``, the trial plan becomes the incumbent
    (the best plan so far).

    Return the value of the trial plan or ``best``, whichever is higher. The trial plan begins with
    the first ``shared`` commands of the incumbent.

    If the planner simulates plans to the end of the task, ``few`` is the expected number of cells
    left to classify. The value of a plan is then w c - n, where w is a weight, c is the discounted
    number of classified cells, and n is the number of moves. With reliable predictions, n includes
    an estimate of the moves for cells that are left at the horizon. If the planner simulates plans
    only up to a near horizon, ``few`` is 0, and the value of a plan is the discounted number of
    classified cells.
    """
    options, memory = planner.options, planner.memory
    surprise = memory.surprise / WHOLE
    brief = is_brief(planner)
    horizon = int(min(options.near_horizon, BRIEF_HORIZON) if brief else options.near_horizon)
    discount = BRIEF_DISCOUNT if brief else options.discount
    if (
        few > 0
    ):  # with large prediction errors, the simulation of the far future is not worth its time
        far = surprise < options.far_surprise
        discount = options.far_discount if far else options.discount
        horizon += int(
            max((options.far_horizon if far else options.horizon) - horizon, 0)
            * (1.0 - surprise) ** options.surprise_shrink
        )
    share = options.frontier_worth * (1.0 + options.surprise_weight * surprise)
    worth = share / few if few > 0 else 0.0
    place = min(shared // EVERY, planner.kept.states.shape[1] - 1)
    begin = place * EVERY
    copy_state(planner.kept.states[BEST, place] if place > 0 else planner.root, planner.state)
    # with reliable predictions, a plan that is behind may still finish earlier
    raced = few > 0 and best > NOTHING and surprise >= options.end_surprise
    time, value, length, moves, classified = complete(
        planner.scene,
        planner.state,
        planner,
        planner.trial,
        begin,
        length,
        horizon,
        discount,
        style,
        options.left_behind_cost,
        worth,
        few,
        best if few > 0 else NOTHING,
        shared + LEAD,
        memory.plan_length if raced else NO_MOVES,
    )
    memory.simulated += moves
    if few > 0:
        value = worth * value - time
        if (
            time == horizon and options.future_weight > 0 and surprise < options.end_surprise
        ):  # if the prediction is reliable, the cells that are left cost moves at the same rate
            value -= horizon * count(planner.state[FRONTIER]) / max(classified, 1)
    if value <= best:
        return best
    keep_best(planner.kept, begin, length)
    for i in range(begin, length):
        planner.incumbent[i] = planner.trial[i]
    memory.plan_at, memory.plan_length, memory.style = 0, length, style
    return value


@in_place_kernel
def search_plans(planner):
    """Replace the incumbent (the plan that the planner follows) by the best plan that the search
    finds.
    """
    memory, trial, options = planner.memory, planner.trial, planner.options
    remaining = count(planner.root[FRONTIER])
    few = 0.0
    if remaining <= options.end_frontier or memory.surprise < options.end_surprise * WHOLE:
        few = remaining + options.future_weight * predicted_frontier(planner)
    at, length = memory.plan_at, memory.plan_length
    for i in range(at, length):
        trial[i - at] = planner.incumbent[i]
    best = evaluate(planner, NO_MOVES, length - at, NOTHING, few, memory.style)
    if options.left_behind_cost > 0:
        if (
            not is_brief(planner) or memory.surprise < options.end_surprise * WHOLE
        ):  # a careful plan takes longer to simulate
            best = evaluate(planner, NO_MOVES, NO_MOVES, best, few, CAREFUL)
        best = evaluate(planner, NO_MOVES, NO_MOVES, best, few, GREEDY)
    for command in range(directions(planner.scene)):
        trial[0] = command
        best = evaluate(planner, NO_MOVES, np.int64(1), best, few, memory.style)
        if options.run_candidates > 0 and not is_brief(planner):
            length = run(planner, command)
            if length > 1:
                best = evaluate(planner, NO_MOVES, length, best, few, memory.style)
    if is_brief(planner):
        return
    best = try_leaves(planner, best, few)
    if few > 0:
        for _ in range(int(options.variations)):
            shared, length = vary(planner)
            best = evaluate(planner, shared, length, best, few, memory.style)


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
        best = evaluate(planner, NO_MOVES, depth, best, few, planner.memory.style)
    return best


@in_place_kernel
def vary(planner):
    """Write a random variation of the incumbent to the trial plan.

    Up to a random place, the variation equals the incumbent (the best plan so far). At this place,
    the function makes one of four changes: it replaces the rest of the incumbent by one random
    command, replaces the rest by k equal commands, inserts k equal commands, or removes k commands,
    where k is 1, 2, 4 or 8. If ``run_candidates`` is 0, only the first of these four changes is
    possible. Return the number of commands before the change, and the length of the variation.
    """
    trial, incumbent = planner.trial, planner.incumbent
    length = max(1, planner.memory.plan_length)
    at = draw(planner, length)
    for i in range(at):
        trial[i] = incumbent[i]
    kind = draw(planner, np.int64(4)) if planner.options.run_candidates > 0 else 0
    command, steps, skipped = draw(planner, directions(planner.scene)), 1, length - at
    if kind > 0:
        steps = 1 << draw(planner, np.int64(4))
    if kind == 2:
        skipped = 0
    elif kind == 3:
        skipped, steps = steps, 0
    for i in range(steps):
        trial[at + i] = command
    at_end = at + steps
    for i in range(at + skipped, planner.memory.plan_length):
        trial[at_end] = incumbent[i]
        at_end += 1
    return at, at_end


@in_place_kernel
def choose_rollout(field, mapping, planner):
    """Return the next command of the policy rollout or beam-rollout, or -1 if no
    command is left.
    """
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
