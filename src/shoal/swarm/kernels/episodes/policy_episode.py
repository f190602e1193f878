"""Whole episodes: a policy decides, the world moves, the trace is written, without leaving compiled code.

``play`` runs for a limited number of moves and can be called again: all that a policy remembers is in ``PolicyState``. So a caller
may show progress, be interrupted between two calls and let traces grow; the result does not depend on where it was cut.
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
    "remaining",  # cells of the frontier
    "plan_length", "plan_at",
    "row", "column",  # the elected particle, or the one that depth-first drives
    "target_row", "target_column",
    "trail_length", "backtracking",
    "phase", "second", "gain",  # of sweep
    "idle",  # runs of commands in a row that changed nothing
    "run_left", "run_command", "streak",  # commands left of the run, its direction, runs before it in the same one
    "last_run",  # steps of an adaptive plan's last run, if chosen already
    "learnt",  # cells classified in this run
    "scanned",  # whether there has been a scan after the last command
    "changed",  # whether this run has moved or classified anything
)  # fmt: skip
PATIENCE = 1_000  # so many of them, and the policy is stopped


class PolicyState(NamedTuple):
    """What a policy remembers between two moves, and the space that it works in."""

    memory: Any  # a record of MEMORY
    search: Search
    scanning: Scanning
    space: Slides | ElectSpace | DepthFirstSpace | None  # of the policy


class ElectSpace(NamedTuple):
    """Work space of elect-particle."""

    single: NDArray[np.uint64]  # a board for one cell


class DepthFirstSpace(NamedTuple):
    """What depth-first remembers."""

    visited: NDArray[np.uint64]  # a board: the cells where its particle has been
    commands: NDArray[np.int8]  # that led from the root


@in_place_kernel
def decide_elect(field, mapping, policy_state):
    """Plan from the elected particle alone to the frontier cell nearest to it.

    If its part of the free space is done, the particle nearest to the frontier is elected in its place.
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
    """Probe, else step to a cell not visited, else go back one step."""
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
    """Left to the wall; up and right by turns to the other wall; down and left by turns back; and again while it helps."""
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
    """Keep track of the driven particle: whoever stands where it should have gone is it now; tell whether anybody does."""
    memory = policy_state.memory
    row, column = ahead(memory.row, memory.column, command, field.rows)
    if not has(field.occupied, field.width, row, column):
        return False
    memory.row, memory.column = row, column
    return True


@in_place_kernel
def notice_no_command(field, policy_state, command, travelled, done):
    """Let a policy go on that remembers nothing of its last command."""


@in_place_kernel
def notice_elect(field, policy_state, command, travelled, done):
    """Keep track of the elected particle; plan anew once its target is classified."""
    memory = policy_state.memory
    follow(field, policy_state, command)
    if not has(field.frontier, field.width, memory.target_row, memory.target_column):
        memory.plan_length = 0


@in_place_kernel
def notice_depth_first(field, policy_state, command, travelled, done):
    """Keep the trail of the driven particle."""
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
    """Go to the next phase where nothing moves any more."""
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
    """Tell whether to scan after a run: always, but where an adaptive policy knew the outcome beforehand."""
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
    """Return the kernels begin_run and play of a policy, which are compiled with its own two kernels and no others.

    Each policy has a play of its own below; the codes MANUAL (a given plan) and RANDOM (drawn commands) go with any of them.
    """

    @in_place_kernel
    def begin_run(code, field, rule, mapping, policy_state, scan_planner, draw):
        """Choose the next run; tell whether there is one."""
        memory, plan, scanning = policy_state.memory, policy_state.search.plan, policy_state.scanning
        if memory.plan_at >= memory.plan_length:
            memory.plan_at, memory.last_run = 0, 0
            if code == RANDOM:
                plan[0], memory.plan_length = draw, 1
            elif code == MANUAL:  # its whole plan was there from the start
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
            # A turn of the path must not be missed; its last stretch leads into the unknown and may go on there.
            steps = limit if at + steps == length and code != MANUAL else min(limit, steps)
            memory.plan_at += steps
        memory.run_left, memory.run_command, memory.learnt, memory.changed = steps, command, 0, 0
        return True

    @in_place_kernel
    def play(code, field, rule, mapping, policy_state, scan_planner, trace):
        """Play until the trace is full or the episode ends; return (moves played, RUNNING, COMPLETE or STALLED).

        ``scan_planner`` is None unless scans are ADAPTIVE. For RANDOM ``trace.commands`` holds the commands to play, drawn
        beforehand; if scans are GIVEN, ``trace.scanned`` holds them. What a run of commands does is looked at when it is scanned,
        not before: no decision falls within a run.
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
    """Choose the next run of closest-frontier, or of an adaptive scan rule; tell whether there is one."""
    return _begin_closest(code, field, rule, mapping, policy_state, scan_planner, draw)


@in_place_kernel
def play_closest(code, field, rule, mapping, policy_state, scan_planner, trace):
    """Play closest-frontier, a given plan, or commands drawn beforehand; see `play`."""
    return _play_closest(code, field, rule, mapping, policy_state, scan_planner, trace)


@in_place_kernel
def play_tilts(code, field, rule, mapping, policy_state, scan_planner, trace):
    """Play closest-frontier under rule tilt; see `play`."""
    return _play_tilts(code, field, rule, mapping, policy_state, scan_planner, trace)


@in_place_kernel
def play_elect(code, field, rule, mapping, policy_state, scan_planner, trace):
    """Play elect-particle; see `play`."""
    return _play_elect(code, field, rule, mapping, policy_state, scan_planner, trace)


@in_place_kernel
def play_depth_first(code, field, rule, mapping, policy_state, scan_planner, trace):
    """Play depth-first; see `play`."""
    return _play_depth_first(code, field, rule, mapping, policy_state, scan_planner, trace)


@in_place_kernel
def play_sweep(code, field, rule, mapping, policy_state, scan_planner, trace):
    """Play sweep; see `play`."""
    return _play_sweep(code, field, rule, mapping, policy_state, scan_planner, trace)
