"""SwarmEpisode: what a swarm did, with noise or without, in a simulation or on a rig; everything needed to replay it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.episode import Episode, Status, Verification
from shoal.core.errors import InvalidInputError
from shoal.core.version import versions
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.commands import decode
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.grid.trace import Trace
from shoal.swarm.grid.world import GridWorld
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.noise.map_errors import MapErrors
from shoal.swarm.noise.model import Noise
from shoal.swarm.noise.moments import Moment
from shoal.swarm.problem import NOISE_MEASURES, SwarmProblem
from shoal.swarm.simulation import episode_file
from shoal.swarm.simulation.replay import ExactReplay, NoisyReplay, ObservedReplay, Replay

REASONS = {
    Status.COMPLETE: "nothing is left to do",
    Status.STALLED: "the policy could make no progress",
    Status.LIMIT: "stopped at the limit of moves",
    Status.INTERRUPTED: "somebody stopped it",
}


@dataclass(frozen=True, eq=False)
class SwarmEpisode(Episode):
    """One run of a policy on a task.

    Parameters
    ----------
    problem : SwarmProblem
        As it was asked for; its place is the workspace of the episode.
    start : ndarray of int64, shape (n, ndim)
        Cells of the particles at the start.
    trace : Trace
        What each command did.
    status : Status
        "complete", "stalled", "limit" or "interrupted". With noise it is "complete" if every cell is classified that lies beside a
        free one and that a particle could get to, and "stalled" if some had to be left undecided.
    policy : str
        The policy that was played; says what ``auto`` chose.
    first_frontier : int
        Frontier cells at the start.
    targets : ndarray of bool, the shape of the workspace, or None
        The cells to cover; None for a mapping.
    seed, trial : int
        See `shoal.swarm.grid.randomness`.
    seconds : float
        Time the run took, planning included.
    versions : dict of str
    observations : tuple of ndarray of int64, shape (k, ndim), optional
        Of a rig with noise: what each scan showed, that before the first command included. The workspace is then the free cells
        that were found.
    truth : ndarray of bool, optional
        Of such a rig: its free cells, if they are known; then it can be shown what was classified wrongly.
    """

    part: ClassVar[str] = "swarm"

    problem: SwarmProblem
    start: NDArray[np.int64]
    trace: Trace
    status: Status
    policy: str
    first_frontier: int
    targets: NDArray[np.bool_] | None = None
    seed: int = 0
    trial: int = 0
    seconds: float = 0.0
    versions: Mapping[str, str] = field(default_factory=versions)
    observations: tuple[NDArray[np.int64], ...] | None = None
    truth: NDArray[np.bool_] | None = None

    @property
    def workspace(self) -> GridWorkspace:
        """The workspace."""
        workspace: GridWorkspace = self.problem.place
        return workspace

    @property
    def task(self) -> str:
        """Name of the task."""
        return self.problem.task_name

    @property
    def rule(self) -> str:
        """The move rule."""
        return self.problem.rule

    @property
    def placement(self) -> str:
        """Name of the placement; "given" if start cells were."""
        return self.problem.placement_name

    @property
    def noisy(self) -> bool:
        """Whether there was noise: then `moments` is what there is to see."""
        return self.problem.noise is not None or self.observations is not None

    @cached_property
    def commands(self) -> str:
        """The commands as letters."""
        return decode(self.trace.commands)

    @property
    def moves(self) -> int:
        """Number of commands sent."""
        return self.trace.moves

    @property
    def scans(self) -> int:
        """Number of scans, the one at the start included."""
        return 1 + int(np.count_nonzero(self.trace.scanned))

    @property
    def cost(self) -> float:
        """Price of all moves and scans."""
        return self.problem.scanning.cost(moves=self.moves, scans=self.scans)

    @property
    def particles(self) -> int:
        """Number of particles."""
        return len(self.start)

    @property
    def distance(self) -> int:
        """Cells travelled, summed over the particles."""
        return int(self.trace.travelled.sum())

    @property
    def seconds_per_move(self) -> float:
        """Mean time of a move, planning included; 0 if there was none."""
        return self.seconds / self.moves if self.moves else 0.0

    @property
    def reason(self) -> str:
        """Why the episode has its status, in one sentence."""
        left = int(self.trace.frontier[-1]) if self.moves else self.first_frontier
        rest = "" if self else f"; {left} frontier cells left"
        done = REASONS[self.status]
        if self and self.unreachable:
            done = "every cell that particles can reach is done"
        if self.unreachable:
            rest += f"; {self.out_of_reach} lie where no particle can get"
        return f"{done}{rest}"

    @property
    def out_of_reach(self) -> str:
        """How many free cells no particle can get to, for people; empty if none."""
        return f"{self.unreachable} of {self.workspace.n_free} free cells" if self.unreachable else ""

    @cached_property
    def unreachable(self) -> int:
        """Free cells of a mapping that no particle can get to from its start: they are in other parts of the workspace."""
        if self.targets is not None or self.observations is not None:
            return 0
        parts = self.workspace.components
        return self.workspace.n_free - int(np.isin(parts, parts[tuple(self.start.T)]).sum()) if parts.max() > 1 else 0

    @property
    def sentence(self) -> str:
        """Status, moves and reason for people."""
        return f"{self.status} after {self.moves} moves: {self.reason}"

    @property
    def metrics(self) -> dict[str, Any]:
        """The numbers by name: those that sweeps store, and more."""
        numbers = {
            "status": str(self.status), "moves": self.moves, "scans": self.scans, "cost": self.cost, "distance": self.distance,
            "seconds": self.seconds,
        }  # fmt: skip
        errors = self.errors
        if errors is None:
            return numbers
        return numbers | {name: getattr(errors, name) for name in (*NOISE_MEASURES, "false_free_rate", "false_obstacle_rate")}

    def report(self) -> dict[str, Any]:
        """Return the JSON object that the command prints for one episode."""
        problem, workspace = self.problem, self.workspace
        told = {
            "task": self.task,
            "policy": self.policy,
            "map": {"name": workspace.name, "shape": list(workspace.shape), "free_cells": workspace.n_free},
            "unreachable_cells": self.unreachable,
            "particles": self.particles,
            "placement": self.placement,
            "rule": self.rule,
            "seed": self.seed,
            "scan_every": problem.scanning.every,
            "scan_cost": problem.scan_cost,
            "move_cost": problem.move_cost,
        }
        if problem.noise is not None:
            told |= {"noise": dict(vars(problem.noise)), "confidence": problem.confidence}
        return told | {name: value for name, value in self.metrics.items() if name != "seconds"} | {"reason": self.reason}

    @cached_property
    def replay(self) -> Replay:
        """The episode, played again from its commands and scans."""
        problem, about = self.problem, (self.problem.noise or Noise(), self.problem.confidence)
        if self.observations is not None:
            return ObservedReplay(self.workspace.shape, *about, self.trace, self.observations, self.truth)
        if problem.noise is not None:
            return NoisyReplay(self.workspace, self.start, *about, self.seed, self.trial, self.trace)
        return ExactReplay(GridWorld(self.workspace, self.rule), problem.chosen_task, self.start, self.targets, self.trace)

    def frames(self) -> Iterator[tuple[SwarmState, Belief]]:
        """Yield state and belief at the start and after each command, replayed step by step.

        Without noise the belief is that of the last scan, or the newest if all that has happened since was known beforehand. With
        noise the state is where particles are believed to be.
        """
        return self.replay.frames()

    def moments(self) -> Iterator[Moment]:
        """Yield what there is to see of an episode with noise, at the start and after each command."""
        return self.replay.moments()

    def final(self) -> tuple[SwarmState, Belief]:
        """Return state and belief after the last command; with noise, what is believed."""
        return self.replay.end.state, self.replay.end.belief

    @cached_property
    def probability(self) -> NDArray[np.float64] | None:
        """Of a simulation with noise: probability at the end that each cell is free; float64, with one cell of rim; else None."""
        return self.replay.last[0].probability if isinstance(self.replay, NoisyReplay) else None

    @cached_property
    def errors(self) -> MapErrors | None:
        """Of a simulation with noise: how right the map is at the end; else None."""
        if self.problem.noise is None or self.observations is not None:
            return None
        return MapErrors.of(self.workspace, self.start, self.final()[1])

    def verify(self) -> Verification:
        """Replay the commands and scans; compare everything that is stored, and whether the task is complete at the end.

        Raises
        ------
        InvalidInputError, UnknownNameError
            If the task is unknown here, or does not fit the workspace.
        """
        end = self.replay.end
        if end.first_frontier != self.first_frontier:
            return Verification(False, f"first_frontier differs: {self.first_frontier} stored, {end.first_frontier} replayed")
        if end.trace.moves != self.moves:
            return Verification(False, f"commands: {self.moves} stored, {end.trace.moves} replayed")
        wrong = self.trace.difference(end.trace) or self.replay.wrong_scan(self.problem.scanning)
        if wrong is not None:
            return Verification(False, wrong)
        if self.observations is not None:
            return Verification(True, f"{self.scans} scans taken in again: the same belief")
        if self.problem.noise is not None:
            return Verification(True, f"{self.moves} moves of {self.particles} particles with noise replayed: all the same")
        if end.state.n_particles != self.particles:
            return Verification(False, f"{self.particles} particles at the start, {end.state.n_particles} at the end")
        if end.belief.complete != bool(self):
            return Verification(False, f"status '{self.status}' stored, {len(end.belief.frontier)} frontier cells left")
        return Verification(True, f"{self.moves} moves of {self.particles} particles replayed: all the same")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the episode to an ``.npz`` file, whole or not at all.

        Raises
        ------
        InvalidInputError
            If the suffix is another, or for a drive with noise, which its log keeps.
        OutputError
            If the file cannot be written.
        """
        if self.observations is not None:
            raise InvalidInputError(f"{path}: expected an episode of a simulation, got a drive with noise, which its log keeps")
        told = {name: getattr(self, name) for name in ("policy", "first_frontier", "seed", "trial", "seconds")}
        told |= {"status": str(self.status), "versions": dict(self.versions)}
        episode_file.write(path, self.problem, told, self.trace, start=self.start, targets=self.targets)

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, trust: bool = False) -> SwarmEpisode:
        """Read an episode that `save` wrote; a task of somebody's code is run only if ``trust`` is true.

        Raises
        ------
        InvalidInputError
            If the file is missing, damaged, or of another format.
        """
        problem, told, trace, arrays = episode_file.read(path, trust=trust)
        return cls(problem=problem, trace=trace, **told, **arrays)

    def __repr__(self) -> str:
        return (
            f"<SwarmEpisode: {self.task} of {self.workspace.name!r} by {self.policy}, {self.particles} particles, "
            f"{self.moves} moves, {self.status}>"
        )
