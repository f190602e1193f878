"""Planning by rollouts: candidates are completed by a base policy in the predicted world, and the best one is followed.

Source: docs/concepts/planners.md.
"""

from __future__ import annotations

import numpy as np

from shoal.jit import inlined_kernel, kernel
from shoal.swarm.kernels.planning.beam import search_beam, take_best
from shoal.swarm.kernels.planning.completion import CAREFUL, GREEDY, complete
from shoal.swarm.kernels.planning.frontier_paths import NEXT, beside
from shoal.swarm.kernels.planning.planner_state import (
    AFTER,
    AHEAD,
    BUDGET,
    CALM,
    CAP,
    CHARGE,
    CREDIT,
    DEPTH,
    DISCOUNT,
    FAR_DISCOUNT,
    FAR_HORIZON,
    FEW,
    FORCED,
    FORESEEN,
    HORIZON,
    IMAGINED,
    LATTICES,
    LAYERS,
    LEAVES,
    LIKELY,
    MANNER,
    NEAR_DISCOUNT,
    NEAR_HORIZON,
    PATIENCE,
    PLAN_AT,
    PLAN_LENGTH,
    QUIET,
    RATE,
    RENEW,
    RUNS,
    SHARE,
    STALE,
    SURE,
    SURPRISE,
    TRUST,
    VARIATIONS,
    WHOLE,
    WIDTH,
    WONDER,
    draw,
    force,
    next_command,
    take_greedily,
)
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
        manner = believed(planner.experience, int(options[LATTICES]))
        predict(field, planner.experience, manner, planner.guess, int(options[LAYERS]), options[LIKELY], options[SURE])
    else:
        for i in range(field.open.shape[0]):
            planner.guess.open[i] = field.open[i]
    take_state(field, planner.root)


@kernel
def is_brief(planner):
    """Tell whether there is time only for the most promising plans, not imagined far."""
    return planner.options[BUDGET] < BRIEF and planner.memory[CREDIT] < PLENTY


@kernel
def weigh(planner, length, best, few, manner):
    """Complete the trial plan; make it the incumbent if its value is above ``best``; return the higher value.

    With the end in sight a plan is worth what it settles early, less its moves until all is settled.
    """
    options, memory = planner.options, planner.memory
    surprise = memory[SURPRISE] / WHOLE
    brief = is_brief(planner)
    horizon = int(min(options[NEAR_HORIZON], BRIEF_HORIZON) if brief else options[NEAR_HORIZON])
    discount = BRIEF_DISCOUNT if brief else options[NEAR_DISCOUNT]
    if few > 0:  # where predictions fail, what lies far ahead is not worth imagining
        far = surprise < options[FORESEEN]
        discount = options[FAR_DISCOUNT] if far else options[DISCOUNT]
        horizon += int(max(options[FAR_HORIZON if far else HORIZON] - horizon, 0) * (1.0 - surprise) ** options[TRUST])
    share = options[SHARE] * (1.0 + options[WONDER] * surprise)
    worth = share / few if few > 0 else 0.0
    copy_state(planner.root, planner.state)
    time, value, length, moves, settled = complete(
        planner.scene, planner.state, planner, planner.trial, length, horizon, discount, manner, options[CHARGE],
        worth, few, best if few > 0 else NOTHING,
    )  # fmt: skip
    memory[IMAGINED] += moves
    if few > 0:
        value = worth * value - time
        if time == horizon and options[AFTER] > 0 and surprise < options[CALM]:  # the rest at the same rate, if it can be foreseen
            value -= horizon * count(planner.state[FRONTIER]) / max(settled, 1)
    if value <= best:
        return best
    for i in range(length):
        planner.incumbent[i] = planner.trial[i]
    memory[PLAN_AT], memory[PLAN_LENGTH], memory[MANNER] = 0, length, manner
    return value


@inlined_kernel
def think(planner):
    """Replace the incumbent by the best plan found."""
    memory, trial, options = planner.memory, planner.trial, planner.options
    remaining = count(planner.root[FRONTIER])
    few = 0.0
    if remaining <= options[FEW] or memory[SURPRISE] < options[CALM] * WHOLE:
        few = remaining + options[AFTER] * foreseen(planner)
    at, length = memory[PLAN_AT], memory[PLAN_LENGTH]
    for i in range(at, length):
        trial[i - at] = planner.incumbent[i]
    best = weigh(planner, length - at, NOTHING, few, memory[MANNER])
    if options[CHARGE] > 0:
        if not is_brief(planner) or memory[SURPRISE] < options[CALM] * WHOLE:  # a careful plan takes longer to imagine
            best = weigh(planner, np.int64(0), best, few, CAREFUL)
        best = weigh(planner, np.int64(0), best, few, GREEDY)
    for command in range(directions(planner.scene)):
        trial[0] = command
        best = weigh(planner, np.int64(1), best, few, memory[MANNER])
        if options[RUNS] > 0 and not is_brief(planner):
            length = run(planner, command)
            if length > 1:
                best = weigh(planner, length, best, few, memory[MANNER])
    if is_brief(planner):
        return
    best = try_leaves(planner, best, few)
    if few > 0:
        for _ in range(int(options[VARIATIONS])):
            best = weigh(planner, vary(planner), best, few, memory[MANNER])


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
        planner.memory[IMAGINED] += 1
        if advance(planner.scene, planner.state, command) > 0:
            return step + 1
    return 0


@inlined_kernel
def try_leaves(planner, best, few):
    """Complete the best leaves of a beam; return the value of the best plan."""
    options, beam, trial = planner.options, planner.beam, planner.trial
    if options[LEAVES] == 0:
        return best
    depth = int(options[DEPTH])
    discount = options[DISCOUNT] if few > 0 else options[NEAR_DISCOUNT]
    half, size, imagined = search_beam(
        planner.scene, planner.root, beam, planner, discount, int(options[WIDTH]), depth,
        options[AHEAD], options[RATE], int(options[CAP]),
    )  # fmt: skip
    planner.memory[IMAGINED] += imagined
    for _ in range(min(int(options[LEAVES]), size)):
        leaf = take_best(beam.ranks[half], size)
        for i in range(depth):
            trial[i] = beam.plans[half, leaf, i]
        best = weigh(planner, depth, best, few, planner.memory[MANNER])
    return best


@kernel
def vary(planner):
    """Write a variation of the incumbent into the trial; return its length.

    Another command at a random place, and all behind it left to the base policy; with RUNS also a run of up to eight commands
    there, and what the incumbent had behind it, perhaps without some of it.
    """
    trial, incumbent = planner.trial, planner.incumbent
    length = max(1, planner.memory[PLAN_LENGTH])
    at = draw(planner, length)
    for i in range(at):
        trial[i] = incumbent[i]
    kind = draw(planner, np.int64(4)) if planner.options[RUNS] > 0 else 0
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
    for i in range(at + skipped, planner.memory[PLAN_LENGTH]):
        trial[at_end] = incumbent[i]
        at_end += 1
    return at_end


@inlined_kernel
def choose_rollout(field, mapping, planner):
    """Return the next command; -1 if there is none."""
    memory, options = planner.memory, planner.options
    saved = SAVINGS if options[BUDGET] < BRIEF else 1.0
    memory[CREDIT] = int(min(memory[CREDIT] + options[BUDGET], saved * options[BUDGET]))
    if memory[FORCED] == 0 and memory[QUIET] >= options[PATIENCE]:
        force(field, planner)
    renew = memory[CREDIT] > 0 and (memory[QUIET] == 0 or memory[STALE] >= options[RENEW])
    if memory[FORCED] > 0:
        memory[FORCED] -= 1
    elif options[BUDGET] < BRIEF and not renew and memory[PLAN_AT] >= memory[PLAN_LENGTH]:
        take_greedily(field, planner)
        memory[FORCED] = max(0, memory[FORCED] - 1)  # its first command is sent now
    elif renew or memory[PLAN_AT] >= memory[PLAN_LENGTH]:
        before = memory[IMAGINED]
        look(field, mapping, planner)
        think(planner)
        memory[STALE] = 0
        memory[CREDIT] -= memory[IMAGINED] - before
        if memory[PLAN_LENGTH] == 0:  # all that is left is further than the horizon
            force(field, planner)
            memory[FORCED] -= 1
    return next_command(planner)
