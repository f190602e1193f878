"""Whole episodes in compiled code: decisions of a policy, moves of the world, and the trace.

``play`` runs for a limited number of moves and can be called again, because ``PolicyState`` contains the policy's whole memory. So
a caller can show progress, be interrupted between two calls, and enlarge traces. The result does not depend on the division into
calls.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import in_place_kernel
from shoal.swarm.kernels.dynamics.bits import ZERO, has, put
from shoal.swarm.kernels.dynamics.moves import DOWN, LEFT, RIGHT, UP
from shoal.swarm.kernels.dynamics.steps import step
from shoal.swarm.kernels.episodes.scan_runs import (
    EQUAL,
    GIVEN,
    Scanning,
    decide_adaptive,
    interval,
    last_run,
    stretch,
)
from shoal.swarm.kernels.prediction.expected_gain import learn_from_run
from shoal.swarm.kernels.prediction.lookahead import copy
from shoal.swarm.kernels.records import record_type
from shoal.swarm.kernels.search.frontier_search import Search, ahead, nearest, opposite
from shoal.swarm.kernels.search.tilt_search import Slides, nearest_by_tilts

RUNNING, COMPLETE, STALLED = 0, 1, 2
MANUAL, RANDOM, CLOSEST, ELECT, DEPTH_FIRST, SWEEP = 0, 1, 2, 3, 4, 5

MEMORY = record_type(
    np.int64,
    "remaining",  # number of frontier cells
    "plan_length", "plan_at",
    "row", "column",  # the elected particle, or the particle driven by depth-first
    "target_row", "target_column",
    "trail_length", "backtracking",
    "phase", "second", "gain",  # for the policy sweep only
    "idle",  # number of consecutive runs of commands without any effect
    # commands left of the run, its direction, and number of previous runs in the same direction
    "run_left", "run_command", "streak",
    "last_run",  # steps of an adaptive plan's last run, if already chosen
    "learnt",  # cells classified in this run
    "scanned",  # whether a scan followed the last command
    "changed",  # whether this run has moved particles or classified cells
)  # fmt: skip
PATIENCE = 1_000  # number of runs without effect after which the policy is stopped


class PolicyState(NamedTuple):
    """A policy's memory between two moves, and its working memory."""

    memory: Any  # a record of MEMORY
    search: Search
    scanning: Scanning
    space: Slides | ElectSpace | DepthFirstSpace | None  # own memory of the policy


class ElectSpace(NamedTuple):
    """Working memory of elect-particle."""

    single: NDArray[np.uint64]  # a board for one cell


class DepthFirstSpace(NamedTuple):
    """The memory of depth-first."""

    visited: NDArray[np.uint64]  # a board: the cells visited by the driven particle
    commands: NDArray[np.int8]  # the commands from the start cell to the cell of the driven particle


@in_place_kernel
def decide_elect(field, mapping, policy_state):
    """Plan a path from the elected particle to the frontier cell nearest to it.

    If no frontier cell is left in its part of the free space, the particle nearest to the frontier is elected instead.
    """
    memory, search = policy_state.memory, policy_state.search
    row, column = memory.row, memory.column
    put(policy_state.space.single, field.width, row, column)
    length = nearest(field, search, policy_state.space.single)
    policy_state.space.single[row * field.width + (column >> 6)] = ZERO
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
def decide_depth_first(field, mapping, policy_state):
    """Probe an unknown neighbour, otherwise enter an unvisited cell, otherwise go back one step."""
    memory, plan = policy_state.memory, policy_state.search.plan
    put(policy_state.space.visited, field.width, memory.row, memory.column)
    memory.backtracking = 0
    for command in policy_state.search.neighbours:
        row, column = ahead(memory.row, memory.column, command, field.rows)
        fresh = has(field.open, field.width, row, column) and not has(policy_state.space.visited, field.width, row, column)
        if fresh or not has(field.known, field.width, row, column):
            plan[0] = command
            return 1
    if memory.trail_length == 0:
        return 0
    memory.backtracking = 1
    plan[0] = opposite(policy_state.space.commands[memory.trail_length - 1])
    return 1


@in_place_kernel
def decide_sweep(field, mapping, policy_state):
    """Move left to the wall. Then alternate up and right until nothing moves, and down and left on the way back.

    Repeat the way there and back while it classifies cells.
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
def decide_closest(field, mapping, policy_state):
    """Plan the path of the nearest particle to the nearest frontier cell."""
    return nearest(field, policy_state.search, field.occupied)


@in_place_kernel
def decide_tilts(field, mapping, policy_state):
    """Plan the fewest tilts that bring a particle to the frontier."""
    return nearest_by_tilts(field, policy_state.search, policy_state.space, field.occupied, mapping)


@in_place_kernel
def follow(field, policy_state, command):
    """Update the driven particle: it is now the particle in the cell that it should have entered. Return whether there is one."""
    memory = policy_state.memory
    row, column = ahead(memory.row, memory.column, command, field.rows)
    if not has(field.occupied, field.width, row, column):
        return False
    memory.row, memory.column = row, column
    return True


@in_place_kernel
def notice_no_command(field, policy_state, command, travelled, done):
    """Do nothing, for policies without memory of their last command."""


@in_place_kernel
def notice_elect(field, policy_state, command, travelled, done):
    """Update the elected particle, and request a new plan once its target is classified."""
    memory = policy_state.memory
    follow(field, policy_state, command)
    if not has(field.frontier, field.width, memory.target_row, memory.target_column):
        memory.plan_length = 0


@in_place_kernel
def notice_depth_first(field, policy_state, command, travelled, done):
    """Update the path of the driven particle."""
    memory, trail = policy_state.memory, policy_state.space
    if not follow(field, policy_state, command):
        return
    if memory.backtracking == 1:
        memory.trail_length -= 1
    else:
        trail.commands[memory.trail_length] = command
        memory.trail_length += 1
        put(trail.visited, field.width, memory.row, memory.column)


@in_place_kernel
def notice_sweep(field, policy_state, command, travelled, done):
    """Start the next phase if no particle moves any more."""
    memory = policy_state.memory
    memory.gain += done
    if memory.phase == 0 or memory.second == 1:
        if travelled == 0:
            memory.phase += 1
        memory.second = 0
    else:
        memory.second = 1


@in_place_kernel
def end_run(field, policy_state, scan_planner, given):
    """Return whether to scan after a run. The answer is yes unless an adaptive policy already knew the outcome."""
    memory, scanning = policy_state.memory, policy_state.scanning
    if scanning.kind == GIVEN:
        return given
    if scan_planner is not None:
        if memory.learnt == 0:
            return False
        learn_from_run(field, scan_planner.gain, memory.run_command)
        memory.plan_length = 0
    return True


def player(decide, notice):
    """Return the kernels begin_run and play of a policy, compiled with only the policy's own two kernels.

    Each policy below has its own ``play``. The codes MANUAL (a given plan) and RANDOM (drawn commands) work with any of them.
    """

    @in_place_kernel
    def begin_run(code, field, rule, mapping, policy_state, scan_planner, draw):
        """Choose the next run. Return whether there is one."""
        memory, plan, scanning = policy_state.memory, policy_state.search.plan, policy_state.scanning
        if memory.plan_at >= memory.plan_length:
            memory.plan_at, memory.last_run = 0, 0
            if code == RANDOM:
                plan[0], memory.plan_length = draw, 1
            elif code == MANUAL:  # the whole plan existed from the start
                memory.plan_length = 0
            elif scan_planner is None:
                memory.plan_length = decide(field, mapping, policy_state)
            else:
                memory.plan_length, memory.last_run = decide_adaptive(field, rule, mapping, policy_state.search, scan_planner)
            if memory.plan_length == 0 or memory.idle >= PATIENCE:
                return False
        at, length = memory.plan_at, memory.plan_length
        command, steps = plan[at], 1
        if scan_planner is not None:
            steps = stretch(plan, at, length)
            memory.plan_at += steps
            if at + steps == length:
                steps = memory.last_run if memory.last_run > 0 else last_run(field, mapping, plan, at, length, scan_planner)
            copy(field.known, scan_planner.gain.prior.before)
        elif scanning.kind == GIVEN or (scanning.kind == EQUAL and scanning.step == 1):
            memory.plan_at += 1
        else:
            memory.streak = memory.streak + 1 if command == memory.run_command else 0
            limit, steps = interval(scanning.kind, scanning.step, memory.streak), stretch(plan, at, length)
            # A run must not skip a change of direction. The last part of a plan leads into unknown cells and may be longer.
            steps = limit if at + steps == length and code != MANUAL else min(limit, steps)
            memory.plan_at += steps
        memory.run_left, memory.run_command, memory.learnt, memory.changed = steps, command, 0, 0
        return True

    @in_place_kernel
    def play(code, field, rule, mapping, policy_state, scan_planner, trace):
        """Run until the trace is full or the episode ends; return (moves played, RUNNING, COMPLETE or STALLED).

        ``scan_planner`` is None unless scans are ADAPTIVE. For RANDOM, ``trace.commands`` contains the commands, drawn in advance.
        If scans are GIVEN, ``trace.scanned`` contains them. The effect of a run is observed only at its scan, because no decision
        is made within a run.
        """
        memory = policy_state.memory
        for move in range(trace.commands.shape[0]):
            if memory.run_left == 0:
                if memory.remaining == 0 and (memory.scanned == 1 or policy_state.scanning.kind != GIVEN):
                    return move, COMPLETE
                if not begin_run(code, field, rule, mapping, policy_state, scan_planner, trace.commands[move]):
                    return move, STALLED
            command = np.int8(memory.run_command)
            memory.run_left -= 1
            travelled, done, change = step(field, command, rule, mapping)
            memory.remaining += change
            memory.changed |= 1 if travelled != 0 or done != 0 else 0
            memory.learnt += done if mapping else 0
            trace.commands[move], trace.classified[move] = command, done
            trace.frontier[move], trace.travelled[move] = memory.remaining, travelled
            notice(field, policy_state, command, travelled, done)
            scan = False
            if memory.run_left == 0:
                memory.idle = 0 if memory.changed else memory.idle + 1
                scan = end_run(field, policy_state, scan_planner, trace.scanned[move])
            trace.scanned[move] = scan
            memory.scanned = 1 if scan else 0
        done = memory.remaining == 0 and memory.run_left == 0
        return trace.commands.shape[0], COMPLETE if done else RUNNING

    return begin_run, play


_begin_closest, _play_closest = player(decide_closest, notice_no_command)
_play_tilts = player(decide_tilts, notice_no_command)[1]
_play_elect = player(decide_elect, notice_elect)[1]
_play_depth_first = player(decide_depth_first, notice_depth_first)[1]
_play_sweep = player(decide_sweep, notice_sweep)[1]


@in_place_kernel
def begin_run(code, field, rule, mapping, policy_state, scan_planner, draw):
    """Choose the next run of closest-frontier, or of an adaptive scan rule. Return whether there is one."""
    return _begin_closest(code, field, rule, mapping, policy_state, scan_planner, draw)


@in_place_kernel
def play_closest(code, field, rule, mapping, policy_state, scan_planner, trace):
    """Run closest-frontier, a given plan, or commands drawn in advance; see `play`."""
    return _play_closest(code, field, rule, mapping, policy_state, scan_planner, trace)


@in_place_kernel
def play_tilts(code, field, rule, mapping, policy_state, scan_planner, trace):
    """Run closest-frontier under the rule tilt; see `play`."""
    return _play_tilts(code, field, rule, mapping, policy_state, scan_planner, trace)


@in_place_kernel
def play_elect(code, field, rule, mapping, policy_state, scan_planner, trace):
    """Run elect-particle; see `play`."""
    return _play_elect(code, field, rule, mapping, policy_state, scan_planner, trace)


@in_place_kernel
def play_depth_first(code, field, rule, mapping, policy_state, scan_planner, trace):
    """Run depth-first; see `play`."""
    return _play_depth_first(code, field, rule, mapping, policy_state, scan_planner, trace)


@in_place_kernel
def play_sweep(code, field, rule, mapping, policy_state, scan_planner, trace):
    """Run sweep; see `play`."""
    return _play_sweep(code, field, rule, mapping, policy_state, scan_planner, trace)
