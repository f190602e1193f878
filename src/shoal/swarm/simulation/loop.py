"""The closed loop of a swarm: scan, decide, move."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.random import Generator

from shoal.core.episode import Status
from shoal.core.errors import InvalidInputError, ShoalError, describe_error
from shoal.swarm.grid.board import LETTERS, Board, encode, letters_of
from shoal.swarm.grid.scans import Recorder, Row, ScanRule, Trace
from shoal.swarm.grid.state import RULE_CODES, Belief, SwarmState, field_of
from shoal.swarm.kernels import episodes
from shoal.swarm.kernels.noise import PATIENCE as NOISY_PATIENCE
from shoal.swarm.kernels.noise import TIMES
from shoal.swarm.noise import Lookout, NoisyBelief
from shoal.swarm.policies.compiled import Manual
from shoal.swarm.policies.protocol import Policy, View
from shoal.swarm.problem import SwarmSetup
from shoal.swarm.simulation.compiled import policy_state_of, scan_planner_of

PATIENCE = episodes.PATIENCE
"""Number of consecutive runs, without any motion or classified cell, after which the episode ends
as stalled.
"""
NOISY_TIMES = 20
"""Factor in the limit on moves without a newly classified cell, for episodes with noise.

The limit is ``NOISY_TIMES * (NOISY_PATIENCE + TIMES * d)`` moves, where d is the number of known
free cells. The expression in brackets is the budget that the policy closest-frontier gives to a
path of d moves.
"""


class Decider(Protocol):
    """Chooses the runs of equal commands in an episode."""

    @property
    def due(self) -> bool:
        """Whether a scan must follow the last run of commands.

        If `due` is false, the swarm may omit a scan whose outcome is certain.
        """

    def next(self, view: View, state: SwarmState, idle: int) -> tuple[str, int] | None:
        """Return the command of the next run and the number of commands in the run. If no commands
        are left, return None.
        """

    def scan_after(self, belief: Belief, state: SwarmState, learnt: int) -> bool:
        """Return whether a scan was necessary after the last run.

        ``learnt`` is the number of cells that the last run classified.
        """


def make_decider(
    setup: SwarmSetup, belief: Belief, rng: Generator, noisy: NoisyBelief | None
) -> Decider:
    """Return the decider for the policy and the scan rule of a problem.

    ``belief`` is the belief at the start of the episode. ``noisy`` is the belief that an episode
    with noise changes in place.
    """
    problem, policy, scanning = setup.problem, setup.policy, setup.problem.scanning
    if noisy is not None:
        return ReplannedRuns(policy, noisy, rng, every=scanning.step, max_moves=problem.max_moves)
    if scanning.kind != "adaptive":
        return PlannedRuns(scanning, policy, rng)
    options = {name: getattr(policy, name) for name in ("ties", "neighbours")}
    return AdaptiveRuns(
        belief, rule=problem.rule, mapping=setup.mapping, scanning=scanning, **options
    )


class PlannedRuns:
    """Divides the plans of a policy into runs of equal commands.

    A run never extends over a change of direction in a plan. The last run of a plan may continue
    beyond the frontier cell to which the plan leads, except with the policy manual.
    """

    due = True

    def __init__(self, scanning: ScanRule, policy: Policy, rng: Generator) -> None:
        self.scanning, self.policy, self.rng = scanning, policy, rng
        self.memory: Any = None
        self.plan, self.at, self.streak, self.last = "", 0, 0, ""

    def next(self, view: View, state: SwarmState, idle: int) -> tuple[str, int] | None:
        """Return the command of the next run and the number of commands in the run. If no commands
        are left, return None.
        """
        if self.at >= len(self.plan):
            (self.plan, self.memory), self.at = decided(self.policy, view, self.memory, self.rng), 0
            if not self.plan or idle >= PATIENCE:
                return None
            encode(self.plan, ndim=view.occupied.layout.ndim)
        command = self.plan[self.at]
        steps = 1 if self.scanning.every_move else self._steps(command)
        self.at += steps
        return command, steps

    def _steps(self, command: str) -> int:
        self.streak, self.last = (self.streak + 1 if command == self.last else 0), command
        remaining = self.plan[self.at :]
        stretch = len(remaining) - len(remaining.lstrip(command))
        limit = self.scanning.interval(self.streak)
        return (
            limit
            if stretch == len(remaining) and not isinstance(self.policy, Manual)
            else min(limit, stretch)
        )

    def scan_after(self, belief: Belief, state: SwarmState, learnt: int) -> bool:
        """Return true, because a scan is necessary after every run."""
        return True


class AdaptiveRuns:
    """Chooses runs by the adaptive scan rule, with the kernels that also choose the runs of
    compiled episodes.

    Parameters
    ----------
    belief : Belief
        The belief at the start of the episode.
    rule : str
    mapping : bool
    scanning : ScanRule
    options : ties and neighbours of closest-frontier
    """

    due = False

    def __init__(
        self, belief: Belief, *, rule: str, mapping: bool, scanning: ScanRule, **options: Any
    ) -> None:
        layout = belief.open.layout
        size = int(np.prod(layout.window))
        self.rule, self.mapping = rule, mapping
        self.policy_state = policy_state_of(layout, size, belief, scanning=scanning, **options)
        self.scan_planner = scan_planner_of(layout, scanning)

    def next(self, view: View, state: SwarmState, idle: int) -> tuple[str, int] | None:
        """Return the command of the next run and the number of commands in the run. If no commands
        are left, return None.
        """
        memory, belief = self.policy_state.memory, view.belief
        memory.remaining, memory.idle, memory.run_left = len(belief.frontier), idle, 0
        # the belief replaces the true state, because no kernel called here moves particles
        field = field_of(belief.open.words, state, belief)
        rule, closest = RULE_CODES[self.rule], episodes.CLOSEST
        if not episodes.begin_run(
            closest, field, rule, self.mapping, self.policy_state, self.scan_planner, np.int8(0)
        ):
            return None
        return LETTERS[memory.run_command], int(memory.run_left)

    def scan_after(self, belief: Belief, state: SwarmState, learnt: int) -> bool:
        """Return whether a scan was necessary after the last run. ``learnt`` is the number of cells
        that the run classified.
        """
        self.policy_state.memory.learnt = learnt
        return bool(
            episodes.end_run(
                field_of(belief.open.words, state, belief),
                self.policy_state,
                self.scan_planner,
                False,
            )
        )


class ReplannedRuns:
    """Chooses runs in episodes with noise. Each run is one command.

    The swarm scans at the end of each plan, and at the latest ``every`` commands after the last
    scan. After a scan, a policy without memory discards the rest of its plan and makes a new plan.
    A policy that classifies no new cell for too many moves is stopped, so that every episode ends.
    `NOISY_TIMES` determines the limit on moves without a new cell.

    Where the policy has no commands although the mapping is not complete, a `Lookout` chooses them.
    The policy ``manual`` is left alone, because its commands are the user's.
    """

    def __init__(
        self, policy: Policy, noisy: NoisyBelief, rng: Generator, *, every: int, max_moves: int
    ) -> None:
        self.policy = policy
        self.noisy = noisy
        self.rng = rng
        self.every = every
        self.max_moves = max_moves
        self.lookout = None if isinstance(policy, Manual) else Lookout(noisy)
        self.unseen, self.due = 0, True
        self.memory: Any = None
        self.plan, self.in_vain, self.wakes = "", 0, 0

    def next(self, view: View, state: SwarmState, idle: int) -> tuple[str, int] | None:
        """Return the next command, in a run of length 1. If no commands are left, return None."""
        planned = self._plan(view)
        if planned is not None or self.lookout is None or self.noisy.finished:
            return planned
        # the policy begins anew where the particles then are
        self.plan, self.memory, self.unseen, self.due = "", None, 0, True
        code = self.lookout.next()
        return None if code is None else (LETTERS[code], 1)

    def _plan(self, view: View) -> tuple[str, int] | None:
        self.in_vain = 0 if view.classified else self.in_vain + 1
        if self.in_vain > NOISY_TIMES * (NOISY_PATIENCE + TIMES * len(view.belief.open)):
            return None
        # if scans are often wrong, the first free cell needs several moves
        if not view.belief.open:
            self.wakes, self.unseen, self.due = self.wakes + 1, 0, True
            letters = letters_of(view.occupied.layout.ndim)
            return (
                (letters[(self.wakes - 1) % len(letters)], 1)
                if self.wakes <= NOISY_PATIENCE
                else None
            )
        if view.belief.complete:
            return None
        if not self.plan:
            self.plan, self.memory = decided(self.policy, view, self.memory, self.rng)
            if not self.plan:
                return None
            encode(self.plan, ndim=view.occupied.layout.ndim)
        command, self.plan = self.plan[0], self.plan[1:]
        self.due = self.unseen + 1 >= self.every or not self.plan
        self.unseen = 0 if self.due else self.unseen + 1
        if self.due and self.memory is None:
            self.plan = ""
        self.due = self.due or view.moves + 1 >= self.max_moves
        return command, 1

    def scan_after(self, belief: Belief, state: SwarmState, learnt: int) -> bool:
        """Return whether a scan was necessary after the last command."""
        return self.due


def decided(policy: Policy, view: View, memory: Any, rng: Generator) -> tuple[str, Any]:
    """Call the method ``decide`` of a policy, and return the decision.

    If the policy raises an exception or returns an invalid decision, raise an error with a
    one-sentence message.
    """
    try:
        decision = policy.decide(view, memory, rng)
    except ShoalError:
        raise
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        raise InvalidInputError(
            f"policy {policy.name}: the method decide failed at {place.filename}, line"
            f" {place.lineno}: {describe_error(error)}"
        ) from error
    if not isinstance(decision, tuple) or len(decision) != 2 or not isinstance(decision[0], str):
        raise InvalidInputError(
            f"policy {policy.name}: expected decide to return (commands, memory), got"
            f" {decision!r:.80}"
        )
    return decision


OnMoves = Callable[[int, int], None]
"""Function that the closed loop calls after each run of commands, with the numbers of moves made
and frontier cells left.
"""

OnTrace = Callable[[Trace], None]
"""Function that the closed loop calls with each new piece of the trace."""


Stop = Callable[[], bool]
"""Function that tells whether the run must end after the moves made so far, with the status
``interrupted``.
"""


class Controlled(Protocol):
    """The swarm that the closed loop controls.

    The swarm carries out commands, and provides the belief and the cells of the particles, which
    policies read. With noise, the belief and the cells of the particles are estimates.
    """

    @property
    def belief(self) -> Belief:
        """The belief of the task: the known state of each cell."""

    @property
    def state(self) -> SwarmState:
        """The state of the controlled swarm: the cells of all particles."""

    @property
    def rule(self) -> str:
        """Name of the move rule: "block", "merge" or "tilt"."""

    @property
    def finished(self) -> bool:
        """Whether no cells are left that particles can still classify or cover."""

    def carry_out(self, command: str, steps: int, *, scan: bool) -> tuple[list[Row], bool]:
        """Send the command ``steps`` times, scan if necessary, and update the belief and the state.

        Parameters
        ----------
        command : str
        steps : int
        scan : bool
            Whether a scan must follow the commands. If ``scan`` is false, the swarm may omit a scan
            whose outcome is certain.

        Returns
        -------
        list of tuple of int, and bool
            The trace entries (classified, frontier, travelled) of each command, and whether the
            swarm made a scan.
        """


def closed_loop(
    swarm: Controlled,
    decider: Decider,
    *,
    max_moves: int,
    mapping: bool = True,
    on_moves: OnMoves | None = None,
    on_trace: OnTrace | None = None,
    recorder: Recorder | None = None,
    stop: Stop | None = None,
    targets: Board | None = None,
) -> tuple[Trace, Status]:
    """Run a swarm until no frontier cells are left, the policy has no more commands, or the maximum
    number of moves is reached.

    The policy makes no decision between two scans. The scan at the end of a run of equal commands
    determines the effect of each command in the run.

    Parameters
    ----------
    swarm : Controlled
    decider : Decider
        Object that converts the policy's commands into runs of equal commands.
    max_moves : int
    mapping : bool
        True for a mapping, whose frontier cells are unknown. False for a coverage, whose frontier
        cells are known to be free. Policies receive ``mapping`` in their `View`.
    on_moves, on_trace, stop : callable, optional
    targets : Board, optional
        The target cells of the task, which policies receive in their `View`.
    recorder : Recorder, optional
        Recorder to continue. It keeps the trace if the swarm raises an exception.

    Returns
    -------
    The trace and the status of the run.
    """
    recorder = Recorder() if recorder is None else recorder
    while True:
        if swarm.belief.complete and swarm.finished:
            return recorder.trace, Status.COMPLETE
        if recorder.moves >= max_moves:
            return recorder.trace, Status.LIMIT
        if stop is not None and stop():
            return recorder.trace, Status.INTERRUPTED
        view = View(
            swarm.belief,
            swarm.state.occupied,
            swarm.rule,
            mapping,
            recorder.moves,
            *recorder.last,
            targets,
        )
        run = decider.next(view, swarm.state, recorder.idle)
        if run is None:
            return recorder.trace, Status.COMPLETE if swarm.finished else Status.STALLED
        command, planned = run
        classified = len(swarm.belief.known)
        rows, scanned = swarm.carry_out(
            command, min(planned, max_moves - recorder.moves), scan=decider.due
        )
        scan_due = decider.scan_after(
            swarm.belief, swarm.state, len(swarm.belief.known) - classified
        )
        recorder.add(command, rows, scanned=scanned and scan_due)
        if on_trace is not None:
            on_trace(recorder.newest(len(rows)))
        if on_moves is not None:
            on_moves(recorder.moves, len(swarm.belief.frontier))
