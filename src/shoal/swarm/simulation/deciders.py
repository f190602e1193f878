"""Deciders convert the commands of a policy into runs of equal commands. A scan follows each run of commands."""

from __future__ import annotations

import traceback
from typing import Any, Protocol

import numpy as np
from numpy.random import Generator

from shoal.core.errors import InvalidInputError, ShoalError
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.commands import LETTERS, encode, letters_of
from shoal.swarm.grid.fields import RULE_CODES, field_of
from shoal.swarm.grid.scans import ScanRule
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.kernels.episodes import policy_episode
from shoal.swarm.kernels.noise.noisy_episode import PATIENCE as NOISY_PATIENCE
from shoal.swarm.kernels.noise.noisy_episode import TIMES
from shoal.swarm.noise.belief import NoisyBelief
from shoal.swarm.noise.lookout import Lookout
from shoal.swarm.policies.manual import Manual
from shoal.swarm.policies.protocol import Policy, View
from shoal.swarm.problem import SwarmProblem
from shoal.swarm.simulation.compiled import policy_state_of, scan_planner_of

PATIENCE = policy_episode.PATIENCE
"""Number of consecutive runs, without any motion or classified cell, after which the episode ends as stalled."""
NOISY_TIMES = 20
"""Factor in the limit on moves without a newly classified cell, for episodes with noise.

The limit is ``NOISY_TIMES * (NOISY_PATIENCE + TIMES * d)`` moves, where d is the number of known free cells. The expression in
brackets is the budget that the policy closest-frontier gives to a path of d moves.
"""


class Decider(Protocol):
    """Chooses the runs of equal commands in an episode."""

    @property
    def due(self) -> bool:
        """Whether a scan must follow the last run of commands.

        If `due` is false, the swarm may omit a scan whose outcome is certain.
        """

    def next(self, view: View, state: SwarmState, idle: int) -> tuple[str, int] | None:
        """Return the command of the next run and the number of commands in the run. If no commands are left, return None."""

    def scan_after(self, belief: Belief, state: SwarmState, learnt: int) -> bool:
        """Return whether a scan was necessary after the last run.

        ``learnt`` is the number of cells that the last run classified.
        """


def make_decider(problem: SwarmProblem, belief: Belief, rng: Generator, noisy: NoisyBelief | None) -> Decider:
    """Return the decider for the policy and the scan rule of a problem.

    ``belief`` is the belief at the start of the episode. ``noisy`` is the belief that an episode with noise changes in place.
    """
    policy, scanning = problem.chosen_policy, problem.scanning
    if noisy is not None:
        return ReplannedRuns(policy, noisy, rng, every=scanning.step, max_moves=problem.max_moves)
    if scanning.kind != "adaptive":
        return PlannedRuns(scanning, policy, rng)
    options = {name: getattr(policy, name) for name in ("ties", "neighbours")}
    mapping = getattr(problem.chosen_task, "mapping", True)
    return AdaptiveRuns(belief, rule=problem.rule, mapping=mapping, scanning=scanning, **options)


class PlannedRuns:
    """Divides the plans of a policy into runs of equal commands.

    A run never extends over a change of direction in a plan. The last run of a plan may continue beyond the frontier cell to which
    the plan leads, except with the policy manual.
    """

    due = True

    def __init__(self, scanning: ScanRule, policy: Policy, rng: Generator) -> None:
        self.scanning, self.policy, self.rng = scanning, policy, rng
        self.memory: Any = None
        self.plan, self.at, self.streak, self.last = "", 0, 0, ""

    def next(self, view: View, state: SwarmState, idle: int) -> tuple[str, int] | None:
        """Return the command of the next run and the number of commands in the run. If no commands are left, return None."""
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
        rest = self.plan[self.at :]
        stretch = len(rest) - len(rest.lstrip(command))
        limit = self.scanning.interval(self.streak)
        return limit if stretch == len(rest) and not isinstance(self.policy, Manual) else min(limit, stretch)

    def scan_after(self, belief: Belief, state: SwarmState, learnt: int) -> bool:
        """Return true, because a scan is necessary after every run."""
        return True


class AdaptiveRuns:
    """Chooses runs by the adaptive scan rule, with the kernels that also choose the runs of compiled episodes.

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

    def __init__(self, belief: Belief, *, rule: str, mapping: bool, scanning: ScanRule, **options: str) -> None:
        layout = belief.open.layout
        size = int(np.prod(layout.window))
        self.rule, self.mapping = rule, mapping
        self.policy_state = policy_state_of(layout, size, belief, scanning=scanning, **options)
        self.scan_planner = scan_planner_of(layout, scanning)

    def next(self, view: View, state: SwarmState, idle: int) -> tuple[str, int] | None:
        """Return the command of the next run and the number of commands in the run. If no commands are left, return None."""
        memory, belief = self.policy_state.memory, view.belief
        memory.remaining, memory.idle, memory.run_left = len(belief.frontier), idle, 0
        # the belief replaces the true state, because no kernel called here moves particles
        field = field_of(belief.open.words, state, belief)
        rule, closest = RULE_CODES[self.rule], policy_episode.CLOSEST
        if not policy_episode.begin_run(closest, field, rule, self.mapping, self.policy_state, self.scan_planner, np.int8(0)):
            return None
        return LETTERS[memory.run_command], int(memory.run_left)

    def scan_after(self, belief: Belief, state: SwarmState, learnt: int) -> bool:
        """Return whether a scan was necessary after the last run. ``learnt`` is the number of cells that the run classified."""
        self.policy_state.memory.learnt = learnt
        return bool(policy_episode.end_run(field_of(belief.open.words, state, belief), self.policy_state, self.scan_planner, False))


class ReplannedRuns:
    """Chooses runs in episodes with noise. Each run is one command.

    The swarm scans at the end of each plan, and at the latest ``every`` commands after the last scan. After a scan, a policy
    without memory discards the rest of its plan and makes a new plan. A policy that classifies no new cell for too many moves is
    stopped, so that every episode ends. `NOISY_TIMES` determines the limit on moves without a new cell.

    Where the policy has no commands although the mapping is not complete, a `Lookout` chooses them. The policy ``manual`` is left
    alone, because its commands are the user's.
    """

    def __init__(self, policy: Policy, noisy: NoisyBelief, rng: Generator, *, every: int, max_moves: int) -> None:
        self.policy, self.noisy, self.rng, self.every, self.max_moves = policy, noisy, rng, every, max_moves
        self.lookout = None if isinstance(policy, Manual) else Lookout(noisy)
        self.unseen, self.due = 0, True
        self.memory: Any = None
        self.plan, self.in_vain, self.wakes = "", 0, 0

    def next(self, view: View, state: SwarmState, idle: int) -> tuple[str, int] | None:
        """Return the next command, in a run of length 1. If no commands are left, return None."""
        planned = self._planned(view)
        if planned is not None or self.lookout is None or self.noisy.finished:
            return planned
        self.plan, self.memory, self.unseen, self.due = "", None, 0, True  # the policy begins anew where the particles then are
        code = self.lookout.next()
        return None if code is None else (LETTERS[code], 1)

    def _planned(self, view: View) -> tuple[str, int] | None:
        self.in_vain = 0 if view.classified else self.in_vain + 1
        if self.in_vain > NOISY_TIMES * (NOISY_PATIENCE + TIMES * len(view.belief.open)):
            return None
        if not view.belief.open:  # if scans are often wrong, the first free cell needs several moves
            self.wakes, self.unseen, self.due = self.wakes + 1, 0, True
            letters = letters_of(view.occupied.layout.ndim)
            return (letters[(self.wakes - 1) % len(letters)], 1) if self.wakes <= NOISY_PATIENCE else None
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

    If the policy raises an exception or returns an invalid decision, raise an error with a one-sentence message.
    """
    try:
        answer = policy.decide(view, memory, rng)
    except ShoalError:
        raise
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        what = f"{type(error).__name__}: {' '.join(str(error).split())}"
        raise InvalidInputError(
            f"policy {policy.name}: the method decide failed at {place.filename}, line {place.lineno}: {what}"
        ) from error
    if not isinstance(answer, tuple) or len(answer) != 2 or not isinstance(answer[0], str):
        raise InvalidInputError(f"policy {policy.name}: expected decide to return (commands, memory), got {answer!r:.80}")
    return answer
