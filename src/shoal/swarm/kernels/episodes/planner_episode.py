"""Whole episodes of planners. One call of `play_planner` plays a piece of an episode, as in `policy_episode`.

The moves of an episode do not depend on the lengths of the pieces in which the kernel plays the episode.
"""

from __future__ import annotations

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.dynamics.bits import copy_board, popcount
from shoal.swarm.kernels.dynamics.steps import step
from shoal.swarm.kernels.episodes.policy_episode import COMPLETE, RUNNING, STALLED
from shoal.swarm.kernels.planning.plan_search import WHOLE, choose_best, choose_greedy
from shoal.swarm.kernels.planning.prediction import learn_from_command

GREEDY, BEAM_ROLLOUT = 6, 7  # codes of planners, which continue the policy codes of `policy_episode`
FADING = 8  # the moving average of prediction errors covers about this many moves that find free cells


@in_place_kernel
def choose(code, field, mapping, planner):
    """Return the next command of the planner, or -1 if no command is left."""
    if code == GREEDY:
        return choose_greedy(field, planner)
    return choose_best(field, mapping, planner)


@in_place_kernel
def measure_surprise(field, planner):
    """Update ``memory.surprise``: the moving average of the share of new free cells that were not predicted to be free."""
    memory, before, predicted = planner.memory, planner.prior.before, planner.prediction.open
    found, surprises = 0, 0
    for i in range(before.shape[0]):
        new = field.open[i] & ~before[i]
        found += popcount(new)
        surprises += popcount(new & ~predicted[i])
    if found > 0:
        memory.surprise += (WHOLE * surprises // found - memory.surprise) // FADING


@in_place_kernel
def observe_outcome(field, mapping, planner, command, done):
    """Update the memory of a planner with the effect of its last command."""
    memory = planner.memory
    memory.quiet = 0 if done > 0 else memory.quiet + 1
    if mapping and done > 0:
        learn_from_command(field, planner.prior, planner.learned, command)
        measure_surprise(field, planner)


@in_place_kernel
def play_planner(code, field, rule, mapping, planner, trace):
    """Continue an episode until the trace is full or the episode ends.

    Return the number of moves played, and the status RUNNING, COMPLETE or STALLED.
    """
    memory = planner.memory
    for move in range(trace.commands.shape[0]):
        if memory.remaining == 0:
            return move, COMPLETE
        command = choose(code, field, mapping, planner)
        if command < 0:
            return move, STALLED
        copy_board(field.known, planner.prior.before)
        travelled, done, change = step(field, command, rule, mapping)
        memory.remaining += change
        observe_outcome(field, mapping, planner, command, done)
        trace.commands[move], trace.classified[move] = command, done
        trace.frontier[move], trace.travelled[move] = memory.remaining, travelled
        trace.scanned[move] = True
    return trace.commands.shape[0], COMPLETE if memory.remaining == 0 else RUNNING
