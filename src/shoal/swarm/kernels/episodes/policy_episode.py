"""Whole episodes: a policy decides, the world moves, the trace is written, without leaving compiled code.

``play`` runs for a limited number of moves and can be called again: all that a policy remembers is in ``Mind``. So a caller may
show progress, be interrupted between two calls and let logs grow, and the result does not depend on where it was cut.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.jit import kernel
from shoal.swarm.kernels.dynamics.bits import ZERO, has, put
from shoal.swarm.kernels.dynamics.moves import DOWN, LEFT, RIGHT, TILT, UP
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
from shoal.swarm.kernels.prediction.expected_gain import take_stock
from shoal.swarm.kernels.prediction.lookahead import copy
from shoal.swarm.kernels.search.frontier_search import Search, ahead, nearest, opposite
from shoal.swarm.kernels.search.tilt_search import Slides, nearest_by_tilts

RUNNING, COMPLETE, STALLED = 0, 1, 2
MANUAL, RANDOM, CLOSEST, ELECT, DEPTH_FIRST, SWEEP = 0, 1, 2, 3, 4, 5

# entries of Mind.memory
REMAINING = 0  # cells of the frontier
PLAN_LENGTH, PLAN_AT = 1, 2
ROW, COLUMN = 3, 4  # the elected particle, or the one that depth-first drives
TARGET_ROW, TARGET_COLUMN = 5, 6
TRAIL_LENGTH, BACKTRACKING = 7, 8
PHASE, SECOND, GAIN = 9, 10, 11  # of sweep
IDLE = 12  # runs of commands in a row that changed nothing
RUN_LEFT, RUN_COMMAND, STREAK = 13, 14, 15  # commands left of the run, its direction, runs before it in the same one
LAST_RUN = 16  # steps of an adaptive plan's last run, if chosen already
LEARNT = 17  # cells classified in this run
SCANNED = 18  # whether there has been a scan after the last command
CHANGED = 19  # whether this run has moved or settled anything
MEMORY = 20  # size

PATIENCE = 1_000  # so many of them, and the policy is stopped


class Mind(NamedTuple):
    """What a policy remembers between two moves, and the space that it works in."""

    memory: NDArray[np.int64]  # (MEMORY,)
    search: Search
    slides: Slides
    single: NDArray[np.uint64]  # a board for one cell
    visited: NDArray[np.uint64]  # depth-first: the cells where its particle has been
    trail: NDArray[np.int8]  # depth-first: the commands that led from the root
    scanning: Scanning


@kernel
def decide_elect(field, mind):
    """Plan from the elected particle alone to the frontier cell nearest to it.

    If its part of the free space is done, the particle nearest to the frontier is elected in its place.
    """
    memory, search = mind.memory, mind.search
    row, column = memory[ROW], memory[COLUMN]
    put(mind.single, field.width, row, column)
    length = nearest(field, search, mind.single)
    mind.single[row * field.width + (column >> 6)] = ZERO
    if length == 0:
        length = nearest(field, search, field.occupied)
        if length == 0:
            return 0
        row, column = search.origin[0], search.origin[1]
        memory[ROW], memory[COLUMN] = row, column
    for i in range(length):
        row, column = ahead(row, column, search.plan[i], field.rows)
    memory[TARGET_ROW], memory[TARGET_COLUMN] = row, column
    return length


@kernel
def decide_depth_first(field, mind):
    """Probe, else step to a cell not visited, else go back one step."""
    memory, plan = mind.memory, mind.search.plan
    put(mind.visited, field.width, memory[ROW], memory[COLUMN])
    memory[BACKTRACKING] = 0
    for command in mind.search.neighbours:
        row, column = ahead(memory[ROW], memory[COLUMN], command, field.rows)
        fresh = has(field.open, field.width, row, column) and not has(mind.visited, field.width, row, column)
        if fresh or not has(field.known, field.width, row, column):
            plan[0] = command
            return 1
    if memory[TRAIL_LENGTH] == 0:
        return 0
    memory[BACKTRACKING] = 1
    plan[0] = opposite(mind.trail[memory[TRAIL_LENGTH] - 1])
    return 1


@kernel
def decide_sweep(mind):
    """Left to the wall; up and right by turns to the other wall; down and left by turns back; and again while it helps."""
    memory, plan = mind.memory, mind.search.plan
    if memory[PHASE] == 3:
        if memory[GAIN] == 0:
            return 0
        memory[PHASE], memory[GAIN] = 1, 0
    if memory[PHASE] == 0:
        plan[0] = LEFT
    elif memory[PHASE] == 1:
        plan[0] = RIGHT if memory[SECOND] == 1 else UP
    else:
        plan[0] = LEFT if memory[SECOND] == 1 else DOWN
    return 1


@kernel
def decide(code, field, rule, mapping, mind, draw):
    """Write the next commands into the plan; return how many, 0 if the policy has none left."""
    if code == RANDOM:
        mind.search.plan[0] = draw
        return 1
    if code == CLOSEST:
        if rule == TILT:
            return nearest_by_tilts(field, mind.search, mind.slides, field.occupied, mapping)
        return nearest(field, mind.search, field.occupied)
    if code == ELECT:
        return decide_elect(field, mind)
    if code == DEPTH_FIRST:
        return decide_depth_first(field, mind)
    if code == SWEEP:
        return decide_sweep(mind)
    return 0  # MANUAL: its whole plan was there from the start


@kernel
def follow(field, mind, command):
    """Keep track of the driven particle: whoever stands where it should have gone is it now; tell whether anybody does."""
    memory = mind.memory
    row, column = ahead(memory[ROW], memory[COLUMN], command, field.rows)
    if not has(field.occupied, field.width, row, column):
        return False
    memory[ROW], memory[COLUMN] = row, column
    return True


@kernel
def notice(code, field, mind, command, travelled, done):
    """Let the policy see what its last command did."""
    memory = mind.memory
    if code == ELECT:
        follow(field, mind, command)
        if not has(field.frontier, field.width, memory[TARGET_ROW], memory[TARGET_COLUMN]):
            memory[PLAN_LENGTH] = 0
    elif code == DEPTH_FIRST:
        if not follow(field, mind, command):
            return
        if memory[BACKTRACKING] == 1:
            memory[TRAIL_LENGTH] -= 1
        else:
            mind.trail[memory[TRAIL_LENGTH]] = command
            memory[TRAIL_LENGTH] += 1
            put(mind.visited, field.width, memory[ROW], memory[COLUMN])
    elif code == SWEEP:
        memory[GAIN] += done
        if memory[PHASE] == 0 or memory[SECOND] == 1:
            if travelled == 0:
                memory[PHASE] += 1
            memory[SECOND] = 0
        else:
            memory[SECOND] = 1


@kernel
def begin_run(code, field, rule, mapping, mind, scout, draw):
    """Choose the next run; tell whether there is one."""
    memory, plan, scanning = mind.memory, mind.search.plan, mind.scanning
    if memory[PLAN_AT] >= memory[PLAN_LENGTH]:
        memory[PLAN_AT], memory[LAST_RUN] = 0, 0
        if scout is None:
            memory[PLAN_LENGTH] = decide(code, field, rule, mapping, mind, draw)
        else:
            memory[PLAN_LENGTH], memory[LAST_RUN] = decide_adaptive(field, rule, mapping, mind.search, scout)
        if memory[PLAN_LENGTH] == 0 or memory[IDLE] >= PATIENCE:
            return False
    at, length = memory[PLAN_AT], memory[PLAN_LENGTH]
    command, steps = plan[at], 1
    if scout is not None:
        steps = stretch(plan, at, length)
        memory[PLAN_AT] += steps
        if at + steps == length:
            steps = memory[LAST_RUN] if memory[LAST_RUN] > 0 else last_run(field, mapping, plan, at, length, scout)
        copy(field.known, scout.survey.known)
    elif scanning.kind == GIVEN or (scanning.kind == EQUAL and scanning.step == 1):
        memory[PLAN_AT] += 1
    else:
        memory[STREAK] = memory[STREAK] + 1 if command == memory[RUN_COMMAND] else 0
        limit, steps = interval(scanning.kind, scanning.step, memory[STREAK]), stretch(plan, at, length)
        # A turn of the path must not be missed; its last stretch leads into the unknown and may go on there.
        steps = limit if at + steps == length and code != MANUAL else min(limit, steps)
        memory[PLAN_AT] += steps
    memory[RUN_LEFT], memory[RUN_COMMAND], memory[LEARNT], memory[CHANGED] = steps, command, 0, 0
    return True


@kernel
def end_run(field, mind, scout, given):
    """Tell whether to scan after a run: always, but where an adaptive policy knew the outcome beforehand."""
    memory, scanning = mind.memory, mind.scanning
    if scanning.kind == GIVEN:
        return given
    if scout is not None:
        if memory[LEARNT] == 0:
            return False
        take_stock(field, scout.survey, memory[RUN_COMMAND])
        memory[PLAN_LENGTH] = 0
    return True


@kernel
def play(code, field, rule, mapping, mind, scout, trace):
    """Play until the trace is full or the episode ends; return (moves played, RUNNING, COMPLETE or STALLED).

    ``scout`` is None unless scans are ADAPTIVE. For RANDOM ``trace.commands`` holds the commands to play, drawn beforehand; if
    scans are GIVEN, ``trace.scanned`` holds them. What a run of commands does is looked at when it is scanned, not before: no
    decision falls within a run.
    """
    memory = mind.memory
    for move in range(trace.commands.shape[0]):
        if memory[RUN_LEFT] == 0:
            if memory[REMAINING] == 0 and (memory[SCANNED] == 1 or mind.scanning.kind != GIVEN):
                return move, COMPLETE
            if not begin_run(code, field, rule, mapping, mind, scout, trace.commands[move]):
                return move, STALLED
        command = np.int8(memory[RUN_COMMAND])
        memory[RUN_LEFT] -= 1
        travelled, done, change = step(field, command, rule, mapping)
        memory[REMAINING] += change
        memory[CHANGED] |= 1 if travelled != 0 or done != 0 else 0
        memory[LEARNT] += done if mapping else 0
        trace.commands[move], trace.classified[move] = command, done
        trace.frontier[move], trace.travelled[move] = memory[REMAINING], travelled
        notice(code, field, mind, command, travelled, done)
        scan = False
        if memory[RUN_LEFT] == 0:
            memory[IDLE] = 0 if memory[CHANGED] else memory[IDLE] + 1
            scan = end_run(field, mind, scout, trace.scanned[move])
        trace.scanned[move] = scan
        memory[SCANNED] = 1 if scan else 0
    done = memory[REMAINING] == 0 and memory[RUN_LEFT] == 0
    return trace.commands.shape[0], COMPLETE if done else RUNNING
