"""The best planner: rollouts of two manners, a beam that looks at what is left, and a budget."""

from __future__ import annotations

from shoal.swarm.kernels.beam import search_beam, take_best
from shoal.swarm.kernels.compiling import kernel
from shoal.swarm.kernels.completion import CAREFUL, GREEDY, complete
from shoal.swarm.kernels.foresight import FRONTIER, copy_state, count, directions
from shoal.swarm.kernels.guess import predict
from shoal.swarm.kernels.foresight import take_state
from shoal.swarm.kernels.rollout import (
    CREDIT,
    FORCED,
    IMAGINED,
    MANNER,
    PLAN_AT,
    PLAN_LENGTH,
    QUIET,
    STALE,
    draw,
    force,
)
from shoal.swarm.kernels.ways import outlook

# entries of Planner.options
BUDGET, FEW, HORIZON, NEAR_HORIZON, DISCOUNT, NEAR_DISCOUNT = 0, 1, 2, 3, 4, 5
WIDTH, DEPTH, LEAVES, AHEAD, RATE, CAP = 6, 7, 8, 9, 10, 11
VARIATIONS, CHARGE, SHARE, TAIL, LIKELY, LAYERS = 12, 13, 14, 15, 16, 17
SLACK, PATIENCE, BOTH = 18, 19, 20
OPTIONS = 24


@kernel
def weigh(planner, length, best, few, manner):
    """Complete the trial plan; make it the incumbent if its value is above ``best``; return the higher value."""
    options, memory = planner.options, planner.memory
    horizon = int(options[HORIZON] if few > 0 else options[NEAR_HORIZON])
    discount = options[DISCOUNT] if few > 0 else options[NEAR_DISCOUNT]
    copy_state(planner.root, planner.state)
    bound = horizon
    if few > 0 and best > -horizon:
        bound = min(horizon, int(options[SLACK] - best))
    time, value, length, moves = complete(
        planner.scene, planner.state, planner, planner.trial, length, horizon, discount, manner, options[CHARGE], bound
    )
    memory[IMAGINED] += moves
    if few > 0:
        value = options[SHARE] / few * value - time
    if time == horizon and options[TAIL] > 0.0:
        rest = outlook(planner.scene, planner.state, planner.planes, options[RATE], int(options[CAP]))
        value += options[TAIL] * rest * (options[SHARE] / few if few > 0 else 1.0)
    if value <= best:
        return best
    for i in range(length):
        planner.incumbent[i] = planner.trial[i]
    memory[PLAN_AT], memory[PLAN_LENGTH], memory[MANNER] = 0, length, manner
    return value


@kernel
def think(planner):
    """Replace the incumbent by the best plan found."""
    memory, scene, trial, options = planner.memory, planner.scene, planner.trial, planner.options
    remaining = count(planner.root[FRONTIER])
    few = remaining if remaining <= options[FEW] else 0
    at, length = memory[PLAN_AT], memory[PLAN_LENGTH]
    for i in range(at, length):
        trial[i - at] = planner.incumbent[i]
    best = weigh(planner, length - at, -1e9, few, memory[MANNER])
    best = weigh(planner, 0, best, few, CAREFUL)
    best = weigh(planner, 0, best, few, GREEDY)
    for command in range(directions(scene)):
        trial[0] = command
        best = weigh(planner, 1, best, few, memory[MANNER])
        if options[BOTH] > 0:
            trial[0] = command
            best = weigh(planner, 1, best, few, 1 - memory[MANNER])
    best = try_leaves(planner, best, few)
    for _ in range(int(options[VARIATIONS])):
        best = weigh(planner, vary(planner), best, few, memory[MANNER])


@kernel
def try_leaves(planner, best, few):
    """Complete the best leaves of a beam; return the value of the best plan."""
    options, beam, trial = planner.options, planner.beam, planner.trial
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
    """Write the incumbent into the trial up to a random place, with another command there; return its length."""
    length = max(1, planner.memory[PLAN_LENGTH])
    at = draw(planner, length)
    for i in range(at):
        planner.trial[i] = planner.incumbent[i]
    planner.trial[at] = draw(planner, directions(planner.scene))
    return at + 1


@kernel
def choose_best(field, mapping, planner):
    """Return the next command; -1 if there is none."""
    memory, options = planner.memory, planner.options
    memory[CREDIT] = min(memory[CREDIT] + int(options[BUDGET]), int(options[BUDGET]))
    if memory[FORCED] == 0 and memory[QUIET] >= options[PATIENCE]:
        force(field, planner)
    if memory[FORCED] > 0:
        memory[FORCED] -= 1
    elif memory[PLAN_AT] >= memory[PLAN_LENGTH] or (memory[CREDIT] > 0 and (memory[QUIET] == 0 or memory[STALE] >= 8)):
        if mapping:
            predict(field, planner.survey.tallies, planner.guess, int(options[LAYERS]), options[LIKELY])
        else:
            for i in range(field.open.shape[0]):
                planner.guess.open[i] = field.open[i]
        take_state(field, planner.root)
        before = memory[IMAGINED]
        think(planner)
        memory[STALE] = 0
        memory[CREDIT] -= memory[IMAGINED] - before
        if memory[PLAN_LENGTH] == 0:  # all that is left is further than the horizon
            force(field, planner)
            memory[FORCED] -= 1
    if memory[PLAN_AT] >= memory[PLAN_LENGTH]:
        return -1
    memory[PLAN_AT] += 1
    memory[STALE] += 1
    return planner.incumbent[memory[PLAN_AT] - 1]
