"""Episodes step by step: any policy on any task, with nothing but the pure functions of the world and the task."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from shoal.errors import InvalidInputError, ShoalError
from shoal.swarm.episode import Episode
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.commands import encode
from shoal.swarm.grid.scans import ScanRule, states_of_run
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.grid.world import GridWorld
from shoal.swarm.policies import Manual, Policy, View

PATIENCE = 1_000  # as in kernels.play
"""So many commands in a row that move no particle and settle no cell: the policy is stopped as stalled."""

OnMoves = Callable[[int, int], None]
"""Called now and then with (moves so far, frontier cells left)."""


def play_stepwise(
    blank: Episode,
    world: GridWorld,
    policy: Policy,
    task: Any,
    state: SwarmState,
    belief: Belief,
    rng: Generator,
    max_moves: int,
    on_moves: OnMoves | None = None,
    *,
    given: NDArray[np.bool_] | None = None,
) -> tuple[Episode, SwarmState, Belief]:
    """Play any policy on any task, one pure step after another; ``given`` are the scans of a replay.

    Between two scans nothing is decided; what a run of commands did is worked out from the scan at its end.
    """
    runs = runs_of(blank.scanning, policy, task, world.rule, belief, rng, given)
    log, status, last = _Log(), "limit", (0, 0)
    while True:
        over = len(log.codes) >= max_moves
        if belief.complete and (given is None or over or log.scanned[-1:] != [False]):
            status = "complete"
            break
        if over:
            break
        view = View(belief, state.occupied, world.rule, getattr(task, "mapping", True), len(log.codes), *last)
        run = runs.next(view, state, log.idle)
        if run is None:
            status = "stalled"
            break
        command, planned = run
        steps, known = min(planned, max_moves - len(log.codes)), len(belief.known)
        code = int(encode(command, ndim=world.workspace.ndim)[0])
        first, stuck = len(log.codes), False
        for pushes in _pushes(world, state, command, steps):
            travelled = done = 0
            for after in pushes:
                still, stuck = stuck, after is state
                if still and stuck:  # nobody has moved at the command before either, which has found the walls
                    continue
                travelled += distance_of_push(state, after, command)
                updated = task.update(belief, command, state.occupied, after.occupied)
                done += settled(belief, updated)
                state, belief = after, updated
            log.add(code, done, len(belief.frontier), travelled)
            if on_moves is not None:
                on_moves(len(log.codes), len(belief.frontier))
        last = log.since(first)
        log.idle = 0 if any(last) else log.idle + 1
        # A run that the limit of moves cuts short is looked at where it ends, if it was to be looked at at all.
        ended = runs.scan_after(belief, state, len(belief.known) - known)
        log.scanned += [False] * (steps - 1) + [ended]
    return log.episode(blank, status), state, belief


def _pushes(world: GridWorld, state: SwarmState, command: str, steps: int) -> Iterator[Iterator[SwarmState]]:
    """Yield for each command of a run the states after its pushes; of a longer run only its end is looked at."""
    if steps == 1:
        yield world.pushes(state, command)
        return
    after = state
    for _ in range(steps):
        before, after = after, world.step(after, command)
        if after == before:  # and so for the rest of the run
            break
    for between in states_of_run(state, after, command, steps):
        yield iter([between])


@dataclass
class _Log:
    """One entry a command."""

    codes: list[int] = field(default_factory=list)
    rows: list[tuple[int, int, int]] = field(default_factory=list)
    scanned: list[bool] = field(default_factory=list)
    idle: int = 0

    def add(self, code: int, done: int, frontier: int, travelled: int) -> None:
        self.codes.append(code)
        self.rows.append((done, frontier, travelled))

    def since(self, first: int) -> tuple[int, int]:
        """Return (travelled, done) of the commands from ``first`` on."""
        return sum(row[2] for row in self.rows[first:]), sum(row[0] for row in self.rows[first:])

    def episode(self, blank: Episode, status: str) -> Episode:
        columns = np.array(self.rows, dtype=np.int64).reshape(-1, 3)
        return replace(
            blank,
            codes=np.array(self.codes, dtype=np.int8),
            done=columns[:, 0].astype(np.int32),
            frontier=columns[:, 1].astype(np.int32),
            travelled=columns[:, 2].copy(),
            scanned=np.array(self.scanned, dtype=np.bool_),
            status=status,
        )


class Runs(Protocol):
    """What chooses the runs of an episode."""

    def next(self, view: View, state: SwarmState, idle: int) -> tuple[str, int] | None:
        """Return a command and how often to send it, or None if there is nothing left to send."""

    def scan_after(self, belief: Belief, state: SwarmState, learnt: int) -> bool:
        """Tell whether to scan after the run that classified ``learnt`` cells."""


def runs_of(
    scanning: ScanRule,
    policy: Policy,
    task: Any,
    rule: str,
    belief: Belief,
    rng: Generator,
    given: NDArray[np.bool_] | None,
) -> Runs:
    """Return what chooses the runs of a policy under a scan rule."""
    if scanning.kind != "adaptive" or given is not None:
        return PlannedRuns(scanning, policy, rng, given)
    from shoal.swarm.engine import AdaptiveRuns

    options = {name: getattr(policy, name) for name in ("ties", "neighbours")}
    return AdaptiveRuns(belief, rule=rule, mapping=getattr(task, "mapping", True), scanning=scanning, **options)


class PlannedRuns:
    """Cuts the plans of a policy into runs.

    A run never goes past a turn of the plan. The plan's last stretch leads into the unknown, so a run may go on there.
    """

    def __init__(self, scanning: ScanRule, policy: Policy, rng: Generator, given: NDArray[np.bool_] | None) -> None:
        self.scanning, self.policy, self.rng, self.given = scanning, policy, rng, given
        self.memory: Any = None
        self.plan, self.at, self.sent, self.streak, self.last = "", 0, 0, 0, ""

    def next(self, view: View, state: SwarmState, idle: int) -> tuple[str, int] | None:
        """Return the next run; see `Runs`."""
        if self.at >= len(self.plan):
            (self.plan, self.memory), self.at = decided(self.policy, view, self.memory, self.rng), 0
            if not self.plan or idle >= PATIENCE:
                return None
            encode(self.plan, ndim=view.occupied.layout.ndim)
        command = self.plan[self.at]
        steps = 1 if self.given is not None or self.scanning.every_move else self._steps(command)
        self.at, self.sent = self.at + steps, self.sent + steps
        return command, steps

    def _steps(self, command: str) -> int:
        self.streak, self.last = (self.streak + 1 if command == self.last else 0), command
        rest = self.plan[self.at :]
        stretch = len(rest) - len(rest.lstrip(command))
        limit = self.scanning.interval(self.streak)
        return limit if stretch == len(rest) and not isinstance(self.policy, Manual) else min(limit, stretch)

    def scan_after(self, belief: Belief, state: SwarmState, learnt: int) -> bool:
        """Scan after every run, or as given; see `Runs`."""
        return True if self.given is None else bool(self.given[self.sent - 1])


def decided(policy: Policy, view: View, memory: Any, rng: Generator) -> tuple[str, Any]:
    """Ask a policy; say in one sentence what is wrong with an answer, or where its own code failed."""
    try:
        answer = policy.decide(view, memory, rng)
    except ShoalError:
        raise
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        what = f"{type(error).__name__}: {' '.join(str(error).split())}"
        raise InvalidInputError(
            f"policy {policy.name}: its decide failed at {place.filename}, line {place.lineno}: {what}"
        ) from error
    if not isinstance(answer, tuple) or len(answer) != 2 or not isinstance(answer[0], str):
        raise InvalidInputError(f"policy {policy.name}: expected decide to return (commands, memory), got {answer!r:.80}")
    return answer


def distance_of_push(before: SwarmState, after: SwarmState, command: str) -> int:
    """Return how many particles moved one cell in a push.

    In a queue the leader stays and the others close up, so particles are told apart by their order: the occupied cells
    summed along the direction of the command say how far the swarm has moved in all.
    """
    axis = {"l": -1, "r": -1, "u": -2, "d": -2, "i": -3, "o": -3}[command]
    sign = 1 if command in "rdo" else -1
    return sign * int(after.cells[:, axis].sum() - before.cells[:, axis].sum())


def settled(before: Belief, after: Belief) -> int:
    """Return how many cells a push settled: newly known ones (mapping) or frontier cells covered (coverage)."""
    learnt = len(after.known) - len(before.known)
    return learnt if learnt else len(before.frontier - after.frontier)
