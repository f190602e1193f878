"""Replays of episodes without noise, of simulations with noise, and of runs on a rig with recorded
scans.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.swarm.goals import Goal
from shoal.swarm.grid.board import Board, GridLayout, decode, noise_rng, trial_rng
from shoal.swarm.grid.scans import Placement, Recorder, Row, ScanRule, Trace
from shoal.swarm.grid.state import Belief, SwarmState
from shoal.swarm.grid.tasks import Gathering
from shoal.swarm.grid.world import GridWorld
from shoal.swarm.kernels import noise as kernels
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.noise import (
    Moment,
    Noise,
    NoisyBelief,
    exact_looks,
    inner_of,
    looks_of,
    noisy_belief,
)
from shoal.swarm.policies.compiled import Manual
from shoal.swarm.simulation.compiled import PolicyGame, compiled_loop, is_compiled
from shoal.swarm.simulation.gathering import GatheringGame
from shoal.swarm.simulation.swarms import ExactSwarm


class End(NamedTuple):
    """The result of a replay: the state, the belief, the trace, and the number of frontier cells at
    the start.
    """

    state: SwarmState
    belief: Belief
    trace: Trace
    first_frontier: int


class Replay(Protocol):
    """A replay of an episode from its commands and scans."""

    def frames(self) -> Iterator[tuple[SwarmState, Belief]]:
        """Yield the state of the swarm and the belief, at the start and after each command."""

    def moments(self) -> Iterator[Moment]:
        """Yield a `Moment` of an episode with noise, at the start and after each command."""

    @property
    def end(self) -> End:
        """The state of the swarm and the belief at the end of the replay, and the trace of the
        replay.
        """

    def wrong_scan(self, scanning: ScanRule) -> str | None:
        """Return a description of the first scan that violates the scan rule. If all scans follow
        the scan rule, return None.
        """


@dataclass(frozen=True)
class ExactReplay:
    """A replay of an episode without noise.

    Parameters
    ----------
    world : GridWorld
    task : Task
    start : ndarray of int64, shape (n, ndim)
    targets : ndarray of bool, or None
    trace : Trace
        The recorded trace, from which the replay takes the commands and the scans.
    placed : tuple of Placement
    """

    world: GridWorld
    task: Any
    start: NDArray[np.int64]
    targets: NDArray[np.bool_] | None
    trace: Trace
    placed: tuple[Placement, ...] = ()

    def _begin(self) -> ExactSwarm:
        state = self.world.initial(self.start)
        belief = self.task.begin(self.world, state, self.targets)
        return ExactSwarm(self.world, self.task, state, belief)

    def frames(self) -> Iterator[tuple[SwarmState, Belief]]:
        """Yield the state of the swarm and the belief, at the start and after each command.

        The belief contains what the last scan showed. If the outcome of a command after the last
        scan is certain, the belief also contains this outcome.
        """
        swarm = self._begin()
        belief = swarm.belief
        yield swarm.state, belief
        for _, scanned, _ in self._steps(swarm):
            if scanned or swarm.belief.known == belief.known:
                belief = swarm.belief
            yield swarm.state, belief

    def _steps(self, swarm: ExactSwarm) -> Iterator[tuple[str, bool, list[Row]]]:
        """Carry out one command after another. Yield the command, whether a scan followed, and its
        entry in the trace. Commands of unknown effect, after which particles were placed, do
        nothing.
        """
        self._place(swarm, 0)
        for move, (command, scanned) in enumerate(
            zip(decode(self.trace.commands), self.trace.scanned.tolist(), strict=True), start=1
        ):
            if any(since < move <= at for at, since, _ in self.placed):
                rows = [(0, len(swarm.belief.frontier), 0)]
            else:
                rows = swarm.carry_out(command, 1)[0]
            self._place(swarm, move)
            yield command, scanned, rows

    def _place(self, swarm: ExactSwarm, move: int) -> None:
        for at, _, cells in self.placed:
            if at == move:
                swarm.state = self.world.initial(cells)
                swarm.belief = swarm.belief.with_particles(swarm.state.occupied)

    def moments(self) -> Iterator[Moment]:
        """Yield a `Moment` of the scans, for pages that cannot simulate placed particles."""
        for state, belief in self.frames():
            yield Moment(state.occupied.mask, exact_looks(belief))

    @cached_property
    def end(self) -> End:
        """The result of the replay. Compiled code replays built-in tasks."""
        swarm = self._begin()
        first, recorded = len(swarm.belief.frontier), self.trace
        if is_compiled(self.task) and not self.placed:
            policy = Manual(decode(recorded.commands))
            game = PolicyGame(policy, swarm, trial_rng(0), scanning=None)
            trace, _ = compiled_loop(game, recorded.moves, scanned=recorded.scanned)
            if trace.moves == recorded.moves:
                return End(*game.final, trace, first)
            # compiled code stops at completion, but a drive of a rig ends with closing moves
        if isinstance(self.task, Gathering) and not self.placed and recorded.scanned.all():
            region = None if self.targets is None else Board.of_mask(self.targets)
            policy = Manual(decode(recorded.commands))
            gathering = GatheringGame(policy, swarm, region, trial_rng(0))
            trace, _ = compiled_loop(gathering, recorded.moves)
            if trace.moves == recorded.moves:
                return End(*gathering.final, trace, first)
        recorder = Recorder()
        for command, scanned, rows in self._steps(swarm):
            recorder.add(command, rows, scanned=scanned)
        return End(swarm.state, swarm.belief, recorder.trace, first)

    def wrong_scan(self, scanning: ScanRule) -> str | None:
        """Return a description of the first scan that violates the scan rule. If all scans follow
        the scan rule, return None.

        Every scan rule requires a scan before each change of direction. A drive that was
        interrupted is not checked.
        """
        if self.placed:
            return None
        commands, scanned = self.trace.commands, self.trace.scanned
        if scanning.every_move and not scanned.all():
            return (
                f"no scan after move {int(np.argmin(scanned)) + 1}, although there should be one"
                " after every move"
            )
        unseen = 0  # moves since the last scan whose effect is not yet observed
        for move, (code, scan) in enumerate(
            zip(commands.tolist(), scanned.tolist(), strict=True), start=1
        ):
            if unseen and code != commands[move - 2]:
                return f"no scan after move {move - 1}, where the direction changes"
            if (
                scanning.kind != "adaptive"
                or unseen
                or (self.targets is None and self.trace.classified[move - 1] > 0)
            ):
                unseen += 1
            if scanning.kind == "equal" and unseen > scanning.step:
                return f"no scan after move {move - 1}, {scanning.step} moves after the one before"
            unseen = 0 if scan else unseen
        return f"no scan after the last move, {self.trace.moves}" if unseen else None


class _BeliefReplay(ABC):
    """Base class of the replays with noise, which compute one belief after another."""

    trace: Trace
    placed: tuple[Placement, ...] = ()

    @abstractmethod
    def beliefs(self) -> Iterator[tuple[NoisyBelief, NDArray[np.bool_]]]:
        """Yield the belief and a mask of the cells of the particles, at the start and after each
        command.

        The mask includes the rim. The yielded belief is always the same object, which changes in
        place.

        For a rig, the cells of the particles are the cells in which the last scan showed particles.
        """

    @abstractmethod
    def _truth(self) -> NDArray[np.bool_] | None: ...

    def frames(self) -> Iterator[tuple[SwarmState, Belief]]:
        """Yield the estimated state of the swarm and the belief, at the start and after each
        command.
        """
        for belief, _ in self.beliefs():
            yield SwarmState(belief.occupied), belief.belief

    def moments(self) -> Iterator[Moment]:
        """Yield a `Moment` at the start and after each command."""
        free = self._truth()
        truth = None if free is None else np.pad(free, 1)
        for belief, particles in self.beliefs():
            yield Moment(particles, looks_of(belief, truth))

    def wrong_scan(self, scanning: ScanRule) -> str | None:
        """Return a description of the first scan that violates the scan rule. If all scans follow
        the scan rule, return None.

        In an episode with noise, the direction of the commands may change without a scan. A drive
        that was interrupted is not checked.
        """
        if self.placed:
            return None
        unseen, most = 0, scanning.step
        for move, scan in enumerate(self.trace.scanned.tolist(), start=1):
            unseen = 0 if scan else unseen + 1
            if unseen == most:
                return f"no scan after move {move}, {most} moves after the one before"
        return f"no scan after the last move, {self.trace.moves}" if unseen else None


@dataclass(frozen=True)
class NoisyReplay(_BeliefReplay):
    """A replay of a simulation with noise. The replay draws the noise of the episode again from the
    episode's seed.

    Parameters
    ----------
    workspace : GridWorkspace
    start : ndarray of int64, shape (n, ndim)
    noise : Noise
    confidence : float
    seed, trial : int
    trace : Trace
    """

    workspace: GridWorkspace
    start: NDArray[np.int64]
    noise: Noise
    confidence: float
    seed: int
    trial: int
    trace: Trace

    def _begin(self) -> tuple[NoisyBelief, np.random.Generator]:
        rng = noise_rng(self.seed, self.trial)
        return noisy_belief(self.workspace, self.start, self.noise, self.confidence, rng), rng

    def _truth(self) -> NDArray[np.bool_]:
        return self.workspace.free

    def beliefs(self) -> Iterator[tuple[NoisyBelief, NDArray[np.bool_]]]:
        """Yield the belief and the true cells of the particles, at the start and after each
        command.
        """
        belief, rng = self._begin()
        yield belief, self._particles(belief)
        for code, scanned in zip(self.trace.commands, self.trace.scanned.tolist(), strict=True):
            kernels.move_noisy(belief.state, code, rng)
            if scanned:
                kernels.look(belief.state, rng)
                belief.learn(code)
            else:
                belief.spread_code(code)
            yield belief, self._particles(belief)

    def _particles(self, belief: NoisyBelief) -> NDArray[np.bool_]:
        return np.array(
            inner_of(belief.state.occupied, self.workspace.shape, rim=1), dtype=np.bool_
        )

    @cached_property
    def last(self) -> tuple[NoisyBelief, End]:
        """The belief after the last command as a `NoisyBelief`, and the result of the replay as an
        `End`.
        """
        belief, rng = self._begin()
        first, trace = belief.remaining, Trace.empty(self.trace.moves)
        trace.commands[:], trace.scanned[:] = self.trace.commands, self.trace.scanned
        belief.follow(rng, trace)
        return belief, End(SwarmState(belief.occupied), belief.belief, trace, first)

    @property
    def end(self) -> End:
        """The result of the replay."""
        return self.last[1]


@dataclass(frozen=True)
class ObservedReplay(_BeliefReplay):
    """A replay of a run on a rig with noise, from the recorded scans.

    Parameters
    ----------
    shape : tuple of int
    noise : Noise
    confidence : float
    trace : Trace
    observations : tuple of ndarray of int64, shape (k, ndim)
        Cells in which each scan showed particles, including the scan before the first command.
    truth : ndarray of bool, or None
        The true free cells, or None if the true map is unknown.
    goal : Goal
        The task, with the map that was known beforehand.
    rule : str
    placed : tuple of Placement
    """

    shape: tuple[int, ...]
    noise: Noise
    confidence: float
    trace: Trace
    observations: tuple[NDArray[np.int64], ...]
    truth: NDArray[np.bool_] | None
    goal: Goal
    rule: str
    placed: tuple[Placement, ...] = ()

    def _truth(self) -> NDArray[np.bool_] | None:
        return self.truth

    def beliefs(self) -> Iterator[tuple[NoisyBelief, NDArray[np.bool_]]]:
        """Yield the belief and the cells in which the last scan showed particles, at the start and
        after each command.
        """
        for belief, detections, _ in self._steps():
            yield belief, detections

    def _steps(self) -> Iterator[tuple[NoisyBelief, NDArray[np.bool_], int]]:
        """Yield what `beliefs` yields, and the number of frontier cells before particles were
        placed.
        """
        layout = GridLayout(self.shape)
        boards = (Board.of_cells(layout, cells) for cells in self.observations)
        detections = next(boards)
        belief = self.goal.noisy(detections, self.noise, self.confidence, rule=self.rule)
        placements = [(at, Board.of_cells(layout, cells)) for at, _, cells in self.placed]
        first = belief.remaining
        for _, detections in (placement for placement in placements if placement[0] == 0):
            belief.place(detections)
        yield belief, detections.mask, first
        for move, (command, scanned) in enumerate(
            zip(decode(self.trace.commands), self.trace.scanned.tolist(), strict=True), start=1
        ):
            if scanned:
                detections = next(boards)
                belief.update(command, detections)
            else:
                belief.spread(command)
            frontier = belief.remaining
            for _, detections in (placement for placement in placements if placement[0] == move):
                belief.place(detections)
            yield belief, detections.mask, frontier

    @cached_property
    def end(self) -> End:
        """The result of the replay.

        The columns ``classified`` and ``travelled`` are copies of the recorded columns, because the
        recorded scans do not determine these columns.
        """
        frontier: list[int] = []
        belief: Any = None
        for step in self._steps():
            belief = step[0]
            frontier.append(step[2])
        trace = self.trace._replace(frontier=np.array(frontier[1:], dtype=np.int32))
        return End(SwarmState(belief.occupied), belief.belief, trace, frontier[0])
