"""Whole episodes in compiled code."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.moves import (
    COMPLETE,
    DOWN,
    LEFT,
    RIGHT,
    RUNNING,
    STALLED,
    TILT,
    UP,
    ZERO,
    copy_board,
    has,
    popcount,
    put,
    record_type,
    step,
)
from shoal.swarm.kernels.planning.adaptive_scans import (
    ExpectedGain,
    Lookahead,
    best_length,
    explore,
    gains_of_runs,
    learn_from_run,
    write_plan,
)
from shoal.swarm.kernels.planning.plan_search import WHOLE, choose_best, choose_greedy
from shoal.swarm.kernels.planning.prediction import learn_from_command
from shoal.swarm.kernels.search import Search, Slides, ahead, nearest, nearest_by_tilts, opposite

EQUAL, DOUBLING, HYPER, ADAPTIVE, GIVEN = 0, 1, 2, 3, 4
# number of runs after which the next run is longer than any map is wide
_LAST_DOUBLING, _LAST_HYPER = 40, 12


class Scanning(NamedTuple):
    """The scan rule of an episode."""

    kind: int  # EQUAL, DOUBLING, HYPER, ADAPTIVE, or GIVEN (the scans of a stored episode)
    step: int  # for EQUAL: number of commands between two scans


class ScanPlanner(NamedTuple):
    """Knowledge and working memory of an adaptive policy.

    Policies that are not adaptive pass None instead of a ``ScanPlanner``. With None, Numba does not
    compile the kernels of the adaptive policy, which are as large as all other kernels of an
    episode together.
    """

    gain: ExpectedGain
    lookahead: Lookahead


@in_place_kernel
def interval(kind, step, streak):
    """Return the number of commands in a run that follows ``streak`` runs in the same direction.

    In one direction, the rule EQUAL with the step k scans after k, 2k, 3k, ... commands. The rule
    DOUBLING scans after 1, 2, 4, 8,
    ... commands. The rule HYPER scans after 1, 4, 27, ..., i^i commands.
    """
    if kind == EQUAL:
        return step
    if streak == 0:
        return 1
    if kind == DOUBLING:
        return 1 << (min(streak, _LAST_DOUBLING) - 1)
    i = min(streak, _LAST_HYPER)
    return (i + 1) ** (i + 1) - i**i


@in_place_kernel
def stretch(plan, at, length):
    """Return how many consecutive commands of a plan, beginning at index ``at``, are equal to the
    command at index ``at``.
    """
    end = at + 1
    while end < length and plan[end] == plan[at]:
        end += 1
    return end - at


@in_place_kernel
def decide_adaptive(field, rule, mapping, search, scan_planner):
    """Plan a path through known cells and a last run of equal commands into unknown cells.

    Return the length of the plan and the number of commands in its last run. The number of commands
    in the last run is 0 if the length of the last run is not yet known.

    A candidate is a run of equal commands, or a path followed by one more command. The plan is the
    candidate with the highest expected number of classified cells per cost. If the path to the
    nearest frontier cell classifies more cells per cost than every candidate, the plan is the path
    to the nearest frontier cell. In coverage, no cell is unknown, so the plan is always the path to
    the nearest frontier cell.
    """
    if not mapping:
        return nearest(field, search, field.occupied), 0
    gain, plan = scan_planner.gain, search.plan
    scan, move = gain.prices.scan, gain.prices.move
    command, steps, rate = -1, 0, 0.0
    for direction in range(gain.gains.shape[0]):
        gains_of_runs(field, gain, direction)
        length, reached = best_length(gain, direction, 1)
        if reached > rate:
            command, steps, rate = direction, length, reached
    length = 0
    # for a higher rate, the path to the nearest frontier cell cannot be better
    if rate * (scan + 2 * move) < 1:
        length = nearest(field, search, field.occupied)
        if length == 0:
            return 0, 0
        if rate * (scan + length * move) < 1:
            command, rate = -1, 1 / (scan + length * move)
    best_rate = explore(field, rule, scan_planner.lookahead, gain.prices, rate)
    if best_rate > rate:
        return write_plan(scan_planner.lookahead, plan), 0
    if command >= 0:
        plan[0] = command
        return 1, steps
    return length, 0


@in_place_kernel
def last_run(field, mapping, plan, at, length, scan_planner):
    """Return the number of commands in the last run of an adaptive plan.

    The last run becomes longer than planned if more commands classify more cells per cost.
    """
    steps = stretch(plan, at, length)
    if mapping:
        gains_of_runs(field, scan_planner.gain, plan[at])
        steps = best_length(scan_planner.gain, plan[at], steps)[0]
    return steps


MANUAL, RANDOM, CLOSEST, ELECT, DEPTH_FIRST, SWEEP = 0, 1, 2, 3, 4, 5

MEMORY = record_type(
    np.int64,
    "remaining",  # number of frontier cells
    "plan_length",
    "plan_at",
    "row",
    "column",  # cell of the driven particle: the elected particle, or the particle of depth-first
    "target_row",
    "target_column",
    "trail_length",
    "backtracking",
    "phase",
    "second",
    "gain",  # for the policy sweep only
    "idle",  # number of consecutive runs of equal commands without any effect
    # for the present run of equal commands: commands left, direction, number of previous runs in
    # this direction
    "run_left",
    "run_command",
    "streak",
    "last_run",  # number of commands in the last run of an adaptive plan, or 0 if not yet chosen
    "learnt",  # number of cells that the present run has classified
    "scanned",  # whether a scan followed the last command
    "changed",  # whether the present run has moved particles or classified cells
)
# maximum number of consecutive runs of commands without any effect, before the episode ends as
# stalled
PATIENCE = 1_000


class PolicyState(NamedTuple):
    """The memory of a policy between two moves, and the working arrays of a single move."""

    memory: Any  # a record of MEMORY
    search: Search
    scanning: Scanning
    # of elect-particle: only the cell of the elected particle; of depth-first: visited cells
    board: NDArray[np.uint64]
    # of depth-first: the commands from the start cell to the cell of the driven particle
    trail: NDArray[np.int8]
    slides: Slides  # of closest-frontier under the rule tilt


@in_place_kernel
def decide_elect(field, policy_state):
    """Plan a path from the elected particle to the nearest frontier cell. Return the length of the
    path.

    If the elected particle cannot reach a frontier cell, the particle nearest to the frontier
    becomes the elected particle.
    """
    memory, search = policy_state.memory, policy_state.search
    row, column = memory.row, memory.column
    put(policy_state.board, field.width, row, column)
    length = nearest(field, search, policy_state.board)
    policy_state.board[row * field.width + (column >> 6)] = ZERO
    if length == 0:
        length = nearest(field, search, field.occupied)
        if length == 0:
            return 0
        row, column = search.origin[0], search.origin[1]
        memory.row, memory.column = row, column
    for i in range(length):
        row, column = ahead(row, column, search.plan[i], field.rows)
    memory.target_row, memory.target_column = row, column
    return length


@in_place_kernel
def decide_depth_first(field, policy_state):
    """Plan one command for depth-first: into the first neighbouring cell that is unknown or
    unvisited, or one step back.

    Return the number of planned commands, 0 or 1.
    """
    memory, plan = policy_state.memory, policy_state.search.plan
    put(policy_state.board, field.width, memory.row, memory.column)
    memory.backtracking = 0
    for command in policy_state.search.neighbours:
        row, column = ahead(memory.row, memory.column, command, field.rows)
        fresh = has(field.open, field.width, row, column) and not has(
            policy_state.board, field.width, row, column
        )
        if fresh or not has(field.known, field.width, row, column):
            plan[0] = command
            return 1
    if memory.trail_length == 0:
        return 0
    memory.backtracking = 1
    plan[0] = opposite(policy_state.trail[memory.trail_length - 1])
    return 1


@in_place_kernel
def decide_sweep(policy_state):
    """Plan one command of the policy sweep. Return the number of planned commands, 0 or 1.

    In the first phase, the policy moves left until no particle moves. In the second phase, the
    policy alternates the commands up and right until a command right moves no particle. In the
    third phase, the policy alternates the commands down and left until a command left moves no
    particle. The policy repeats the second and the third phase while the moves classify cells.
    """
    memory, plan = policy_state.memory, policy_state.search.plan
    if memory.phase == 3:
        if memory.gain == 0:
            return 0
        memory.phase, memory.gain = 1, 0
    if memory.phase == 0:
        plan[0] = LEFT
    elif memory.phase == 1:
        plan[0] = RIGHT if memory.second == 1 else UP
    else:
        plan[0] = LEFT if memory.second == 1 else DOWN
    return 1


@in_place_kernel
def decide(code, field, rule, mapping, policy_state):
    """Write the next plan of a policy to ``policy_state.search.plan``. Return the number of planned
    commands, or 0 if the policy finds none.
    """
    if code == ELECT:
        return decide_elect(field, policy_state)
    if code == DEPTH_FIRST:
        return decide_depth_first(field, policy_state)
    if code == SWEEP:
        return decide_sweep(policy_state)
    search = policy_state.search
    if rule == TILT:
        return nearest_by_tilts(field, search, policy_state.slides, field.occupied, mapping)
    return nearest(field, search, field.occupied)


@in_place_kernel
def follow(field, policy_state, command):
    """Update the cell of the driven particle (the particle that the policy guides) after a command.

    If the cell ahead now holds a particle, this particle becomes the driven particle. Return
    whether the cell ahead holds a particle.
    """
    memory = policy_state.memory
    row, column = ahead(memory.row, memory.column, command, field.rows)
    if not has(field.occupied, field.width, row, column):
        return False
    memory.row, memory.column = row, column
    return True


@in_place_kernel
def notice_elect(field, policy_state, command):
    """Update the elected particle. If the target cell is no longer a frontier cell, request a new
    plan.
    """
    memory = policy_state.memory
    follow(field, policy_state, command)
    if not has(field.frontier, field.width, memory.target_row, memory.target_column):
        memory.plan_length = 0


@in_place_kernel
def notice_depth_first(field, policy_state, command):
    """Update the path of the driven particle, and the set of visited cells."""
    memory = policy_state.memory
    if not follow(field, policy_state, command):
        return
    if memory.backtracking == 1:
        memory.trail_length -= 1
    else:
        policy_state.trail[memory.trail_length] = command
        memory.trail_length += 1
        put(policy_state.board, field.width, memory.row, memory.column)


@in_place_kernel
def notice_sweep(policy_state, travelled, classified):
    """Update the phase of the policy sweep. A phase of the sweep ends when its command left or
    right moves no particle.
    """
    memory = policy_state.memory
    memory.gain += classified
    if memory.phase == 0 or memory.second == 1:
        if travelled == 0:
            memory.phase += 1
        memory.second = 0
    else:
        memory.second = 1


@in_place_kernel
def end_run(field, policy_state, scan_planner, recorded_scan):
    """Return whether a scan follows a run of equal commands.

    In a replay of given scans, the result is ``recorded_scan``. An adaptive policy does not scan
    after a run that has classified no cell. With a scan rule that is neither adaptive nor given, a
    scan follows each run.
    """
    memory, scanning = policy_state.memory, policy_state.scanning
    if scanning.kind == GIVEN:
        return recorded_scan
    if scan_planner is not None:
        if memory.learnt == 0:
            return False
        learn_from_run(field, scan_planner.gain, memory.run_command)
        memory.plan_length = 0
    return True


@in_place_kernel
def begin_run(code, field, rule, mapping, policy_state, scan_planner, draw):
    """Choose the next run of equal commands. Return whether a next run exists."""
    memory = policy_state.memory
    plan = policy_state.search.plan
    scanning = policy_state.scanning
    if memory.plan_at >= memory.plan_length:
        memory.plan_at, memory.last_run = 0, 0
        if code == RANDOM:
            plan[0], memory.plan_length = draw, 1
        elif code == MANUAL:  # at the end of a given plan, no further command exists
            memory.plan_length = 0
        elif scan_planner is None:
            memory.plan_length = decide(code, field, rule, mapping, policy_state)
        else:
            memory.plan_length, memory.last_run = decide_adaptive(
                field, rule, mapping, policy_state.search, scan_planner
            )
        if memory.plan_length == 0 or memory.idle >= PATIENCE:
            return False
    at, length = memory.plan_at, memory.plan_length
    command, steps = plan[at], 1
    if scan_planner is not None:
        steps = stretch(plan, at, length)
        memory.plan_at += steps
        if at + steps == length:
            steps = (
                memory.last_run
                if memory.last_run > 0
                else last_run(field, mapping, plan, at, length, scan_planner)
            )
        copy_board(field.known, scan_planner.gain.prior.before)
    elif scanning.kind == GIVEN or (scanning.kind == EQUAL and scanning.step == 1):
        memory.plan_at += 1
    else:
        memory.streak = memory.streak + 1 if command == memory.run_command else 0
        limit = interval(scanning.kind, scanning.step, memory.streak)
        steps = stretch(plan, at, length)
        # A run must end at each change of direction. The last run of a plan may continue into
        # unknown cells.
        steps = limit if at + steps == length and code != MANUAL else min(limit, steps)
        memory.plan_at += steps
    memory.run_left, memory.run_command, memory.learnt, memory.changed = steps, command, 0, 0
    return True


@in_place_kernel
def play(code, field, rule, mapping, policy_state, scan_planner, trace):
    """Continue an episode of a policy that is not a planner until the trace is full or the episode ends.

    Return the number of moves played, and the status RUNNING, COMPLETE or STALLED. For all scan
    rules except ADAPTIVE, ``scan_planner`` is None. For RANDOM, ``trace.commands`` contains the
    commands, drawn in advance. If scans are GIVEN, ``trace.scanned`` contains the scans. The
    policy learns the effect of a run of equal commands only from the scan after the run.
    """
    memory = policy_state.memory
    for move in range(trace.commands.shape[0]):
        if memory.run_left == 0:
            if memory.remaining == 0 and (
                memory.scanned == 1 or policy_state.scanning.kind != GIVEN
            ):
                return move, COMPLETE
            if not begin_run(
                code, field, rule, mapping, policy_state, scan_planner, trace.commands[move]
            ):
                return move, STALLED
        command = np.int8(memory.run_command)
        memory.run_left -= 1
        travelled, classified, change = step(field, command, rule, mapping)
        memory.remaining += change
        memory.changed |= 1 if travelled != 0 or classified != 0 else 0
        memory.learnt += classified if mapping else 0
        trace.commands[move], trace.classified[move] = command, classified
        trace.frontier[move], trace.travelled[move] = memory.remaining, travelled
        if code == ELECT:
            notice_elect(field, policy_state, command)
        elif code == DEPTH_FIRST:
            notice_depth_first(field, policy_state, command)
        elif code == SWEEP:
            notice_sweep(policy_state, travelled, classified)
        scan = False
        if memory.run_left == 0:
            memory.idle = 0 if memory.changed else memory.idle + 1
            scan = end_run(field, policy_state, scan_planner, trace.scanned[move])
        trace.scanned[move] = scan
        memory.scanned = 1 if scan else 0
    complete = memory.remaining == 0 and memory.run_left == 0
    return trace.commands.shape[0], COMPLETE if complete else RUNNING


# codes of planners, which continue the codes of policies above
GREEDY, BEAM_ROLLOUT = 6, 7
FADING = (
    8  # the moving average of prediction errors covers about this many moves that find free cells
)


@in_place_kernel
def choose(code, field, mapping, planner):
    """Return the next command of the planner, or -1 if no command is left."""
    if code == GREEDY:
        return choose_greedy(field, planner)
    return choose_best(field, mapping, planner)


@in_place_kernel
def measure_surprise(field, planner):
    """Update ``memory.surprise``: the moving average of the share of new free cells that were not
    predicted to be free.
    """
    memory, before, predicted = planner.memory, planner.prior.before, planner.prediction.open
    discovered, surprises = 0, 0
    for i in range(before.shape[0]):
        new = field.open[i] & ~before[i]
        discovered += popcount(new)
        surprises += popcount(new & ~predicted[i])
    if discovered > 0:
        memory.surprise += (WHOLE * surprises // discovered - memory.surprise) // FADING


@in_place_kernel
def observe_outcome(field, mapping, planner, command, classified):
    """Update the memory of a planner with the effect of its last command."""
    memory = planner.memory
    memory.quiet = 0 if classified > 0 else memory.quiet + 1
    if mapping and classified > 0:
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
        travelled, classified, change = step(field, command, rule, mapping)
        memory.remaining += change
        observe_outcome(field, mapping, planner, command, classified)
        trace.commands[move], trace.classified[move] = command, classified
        trace.frontier[move], trace.travelled[move] = memory.remaining, travelled
        trace.scanned[move] = True
    return trace.commands.shape[0], COMPLETE if memory.remaining == 0 else RUNNING
