"""Planning by rollouts: candidates are completed by a base policy in the predicted world, and the best one is followed.

Source: docs/concepts/planners.md.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import inlined_kernel, kernel
from shoal.swarm.kernels.planning.beam import search_beam, take_best
from shoal.swarm.kernels.planning.completion import CAREFUL, GREEDY, complete
from shoal.swarm.kernels.planning.frontier_paths import NEXT, beside
from shoal.swarm.kernels.planning.planner_state import WHOLE, draw, force, next_command, take_greedily
from shoal.swarm.kernels.prediction.forward_model import FRONTIER, UNSEEN, advance, copy_state, count, directions, take_state
from shoal.swarm.kernels.prediction.occupancy_prediction import predict
from shoal.swarm.kernels.prediction.occupancy_prior import believed

NOTHING = -1e18  # the value of no plan
BRIEF = 300.0  # budget below which only the most promising plans are weighed, and not far,
PLENTY = 900.0  # unless so many imagined moves have been saved up,
SAVINGS = 20.0  # of at most so many moves
BRIEF_HORIZON, BRIEF_DISCOUNT = 30.0, 0.97
LONGEST_RUN = 40  # of a candidate that goes in one direction until it settles something


@kernel
def look(field, mapping, planner):
    """Fill the scene with the predicted world and the root with the state of the episode."""
    if mapping:
        options = planner.options
        manner = believed(planner.experience, int(options.lattices))
        predict(field, planner.experience, manner, planner.guess, int(options.layers), options.likely, options.sure)
    else:
        for i in range(field.open.shape[0]):
            planner.guess.open[i] = field.open[i]
    take_state(field, planner.root)


@kernel
def is_brief(planner):
    """Tell whether there is time only for the most promising plans, not imagined far."""
    return planner.options.budget < BRIEF and planner.memory.credit < PLENTY


@kernel
def weigh(planner, length, best, few, manner):
    """Complete the trial plan; make it the incumbent if its value is above ``best``; return the higher value.

    With the end in sight a plan is worth what it settles early, less its moves until all is settled.
    """
    options, memory = planner.options, planner.memory
    surprise = memory.surprise / WHOLE
    brief = is_brief(planner)
    horizon = int(min(options.near_horizon, BRIEF_HORIZON) if brief else options.near_horizon)
    discount = BRIEF_DISCOUNT if brief else options.near_discount
    if few > 0:  # where predictions fail, what lies far ahead is not worth imagining
        far = surprise < options.foreseen
        discount = options.far_discount if far else options.discount
        horizon += int(max((options.far_horizon if far else options.horizon) - horizon, 0) * (1.0 - surprise) ** options.trust)
    share = options.share * (1.0 + options.wonder * surprise)
    worth = share / few if few > 0 else 0.0
    copy_state(planner.root, planner.state)
    time, value, length, moves, settled = complete(
        planner.scene, planner.state, planner, planner.trial, length, horizon, discount, manner, options.charge,
        worth, few, best if few > 0 else NOTHING,
    )  # fmt: skip
    memory.imagined += moves
    if few > 0:
        value = worth * value - time
        if time == horizon and options.after > 0 and surprise < options.calm:  # the rest at the same rate, if it can be foreseen
            value -= horizon * count(planner.state[FRONTIER]) / max(settled, 1)
    if value <= best:
        return best
    for i in range(length):
        planner.incumbent[i] = planner.trial[i]
    memory.plan_at, memory.plan_length, memory.manner = 0, length, manner
    return value


@inlined_kernel
def think(planner):
    """Replace the incumbent by the best plan found."""
    memory, trial, options = planner.memory, planner.trial, planner.options
    remaining = count(planner.root[FRONTIER])
    few = 0.0
    if remaining <= options.few or memory.surprise < options.calm * WHOLE:
        few = remaining + options.after * foreseen(planner)
    at, length = memory.plan_at, memory.plan_length
    for i in range(at, length):
        trial[i - at] = planner.incumbent[i]
    best = weigh(planner, length - at, NOTHING, few, memory.manner)
    if options.charge > 0:
        if not is_brief(planner) or memory.surprise < options.calm * WHOLE:  # a careful plan takes longer to imagine
            best = weigh(planner, np.int64(0), best, few, CAREFUL)
        best = weigh(planner, np.int64(0), best, few, GREEDY)
    for command in range(directions(planner.scene)):
        trial[0] = command
        best = weigh(planner, np.int64(1), best, few, memory.manner)
        if options.runs > 0 and not is_brief(planner):
            length = run(planner, command)
            if length > 1:
                best = weigh(planner, length, best, few, memory.manner)
    if is_brief(planner):
        return
    best = try_leaves(planner, best, few)
    if few > 0:
        for _ in range(int(options.variations)):
            best = weigh(planner, vary(planner), best, few, memory.manner)


@kernel
def foreseen(planner):
    """Return how many cells will join the frontier if all is as predicted: those beside cells taken to be free."""
    beside(planner.scene, planner.scene.ground, planner.root[UNSEEN], planner.planes[NEXT])
    return count(planner.planes[NEXT])


@kernel
def run(planner, command):
    """Write a run in one direction until it settles something into the trial; return its length, 0 if it does not."""
    copy_state(planner.root, planner.state)
    for step in range(LONGEST_RUN):
        planner.trial[step] = command
        planner.memory.imagined += 1
        if advance(planner.scene, planner.state, command) > 0:
            return step + 1
    return 0


@inlined_kernel
def try_leaves(planner, best, few):
    """Complete the best leaves of a beam; return the value of the best plan."""
    options, beam, trial = planner.options, planner.beam, planner.trial
    if options.leaves == 0:
        return best
    depth = int(options.depth)
    discount = options.discount if few > 0 else options.near_discount
    half, size, imagined = search_beam(
        planner.scene, planner.root, beam, planner, discount, int(options.width), depth,
        options.ahead, options.rate, int(options.cap),
    )  # fmt: skip
    planner.memory.imagined += imagined
    for _ in range(min(int(options.leaves), size)):
        leaf = take_best(beam.ranks[half], size)
        for i in range(depth):
            trial[i] = beam.plans[half, leaf, i]
        best = weigh(planner, depth, best, few, planner.memory.manner)
    return best


@kernel
def vary(planner):
    """Write a variation of the incumbent into the trial; return its length.

    Another command at a random place, and all behind it left to the base policy; with RUNS also a run of up to eight commands
    there, and what the incumbent had behind it, perhaps without some of it.
    """
    trial, incumbent = planner.trial, planner.incumbent
    length = max(1, planner.memory.plan_length)
    at = draw(planner, length)
    for i in range(at):
        trial[i] = incumbent[i]
    kind = draw(planner, np.int64(4)) if planner.options.runs > 0 else 0
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
    return at_end


@inlined_kernel
def choose_rollout(field, mapping, planner):
    """Return the next command; -1 if there is none."""
    memory, options = planner.memory, planner.options
    saved = SAVINGS if options.budget < BRIEF else 1.0
    memory.credit = int(min(memory.credit + options.budget, saved * options.budget))
    if memory.forced == 0 and memory.quiet >= options.patience:
        force(field, planner)
    renew = memory.credit > 0 and (memory.quiet == 0 or memory.stale >= options.renew)
    if memory.forced > 0:
        memory.forced -= 1
    elif options.budget < BRIEF and not renew and memory.plan_at >= memory.plan_length:
        take_greedily(field, planner)
        memory.forced = max(0, memory.forced - 1)  # its first command is sent now
    elif renew or memory.plan_at >= memory.plan_length:
        before = memory.imagined
        look(field, mapping, planner)
        think(planner)
        memory.stale = 0
        memory.credit -= memory.imagined - before
        if memory.plan_length == 0:  # all that is left is further than the horizon
            force(field, planner)
            memory.forced -= 1
    return next_command(planner)
