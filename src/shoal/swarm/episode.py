"""SwarmEpisode: the record of one run of a swarm, simulated or on a rig. An episode contains all
data for a replay.
"""

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
from shoal.swarm.goals import Goal
from shoal.swarm.grid.scans import Placement, Trace, WithTrace, lengths_and_times
from shoal.swarm.grid.state import Belief, SwarmState
from shoal.swarm.grid.tasks import make_task
from shoal.swarm.grid.world import GridWorld
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.noise import MapErrors, Moment, Noise
from shoal.swarm.problem import NOISE_MEASURES, SwarmProblem
from shoal.swarm.simulation import episode_file
from shoal.swarm.simulation.replay import ExactReplay, NoisyReplay, ObservedReplay, Replay

REASONS = {
    Status.COMPLETE: "no frontier cell is left",
    Status.STALLED: "the policy could make no progress",
    Status.LIMIT: "stopped at the limit of moves",
    Status.INTERRUPTED: "interrupted",
    Status.ALARM: "stopped by an alarm about the rig",
}


@dataclass(frozen=True, eq=False)
class SwarmEpisode(WithTrace, Episode):
    """The record of one run of a swarm problem, with all data for an exact replay.

    Parameters
    ----------
    problem : SwarmProblem
        The problem as the user declared it. The attribute ``place`` of the problem is the workspace
        of the episode.
    start : ndarray of int64, shape (n, ndim)
        Cells of the particles at the start of the episode.
    trace : Trace
        The effect of each command of the episode.
    status : Status
        The status at the end: "complete", "stalled", "limit", "interrupted" or, on a rig, "alarm".
        With noise, "complete" means that every cell that a particle may still enter is classified.
        With noise, "stalled" means that some reachable cells beside free cells are undecided.
    policy : str
        Name of the policy that chose the commands. If the problem has the policy ``auto``, the
        field contains the name of the selected policy.
    first_frontier : int
        Number of frontier cells at the start of the episode.
    targets : ndarray of bool, the shape of the workspace, or None
        The cells that the particles must cover, or the region of a gathering; None for a mapping.
    seed, trial : int
        Seed and trial number, which determine all random numbers of the episode.
    seconds : float
        Computing time of the episode in seconds, including the time for planning.
    versions : dict of str
    observations : tuple of ndarray of int64, shape (k, ndim), optional
        For a rig with noise: the cells in which each scan showed particles, including the scan
        before the first command. The workspace of an episode on a rig with noise consists of all
        cells that the swarm classified as free.
    truth : ndarray of bool, optional
        For a rig with noise: the true free cells, if the true map is known. Figures compare the
        classified cells with the true free cells.
    true_cells : dict of int to ndarray of float64, shape (n, 2), optional
        For a drive of a plant: where the particles were, as (row, column), after a number of commands.
        It is shown, but not saved.
    placed : tuple of Placement
        For a drive of a rig that was interrupted: where scans showed the particles when it went on,
        if the commands do not explain it.
    goal : Goal, optional
        For a rig with noise: the task, with the map that was known beforehand.
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
    true_cells: Mapping[int, NDArray[np.float64]] | None = None
    placed: tuple[Placement, ...] = ()
    goal: Goal | None = None

    @property
    def workspace(self) -> GridWorkspace:
        """The workspace in which the episode took place."""
        workspace: GridWorkspace = self.problem.place
        return workspace

    @property
    def task(self) -> str:
        """Name of the problem's task."""
        return self.problem.task_name

    @property
    def rule(self) -> str:
        """Name of the move rule: "block", "merge" or "tilt"."""
        return self.problem.rule

    @property
    def placement(self) -> str:
        """Name of the placement of the particles, or "given" if the user gave start cells."""
        return self.problem.placement_name

    @property
    def noisy(self) -> bool:
        """Whether the episode has noise. For pictures of an episode with noise, use `moments`
        instead of `frames`.
        """
        return self.problem.noise is not None or self.observations is not None

    @property
    def cost(self) -> float:
        """Total price of all moves and scans of the episode."""
        return self.problem.scanning.cost(moves=self.moves, scans=self.scans)

    @property
    def particles(self) -> int:
        """Number of particles in the swarm."""
        return len(self.start)

    @property
    def distance(self) -> int:
        """Distance that all particles together travelled during the episode, in cells."""
        return int(self.trace.travelled.sum())

    @property
    def lengths_and_times(self) -> dict[str, Any]:
        """Lengths in metres and millimetres, and times of the apparatus in seconds
        (`shoal.swarm.grid.scans.lengths_and_times`).
        """
        about = {name: getattr(self.problem, name) for name in ("move_seconds", "scan_seconds")}
        return lengths_and_times(
            self.trace, scans=self.scans, spacing=self.workspace.spacing, **about
        )

    @property
    def seconds_per_move(self) -> float:
        """Mean computing time per move in seconds, including the time for planning. Without moves,
        the property is 0.
        """
        return self.seconds / self.moves if self.moves else 0.0

    @property
    def reason(self) -> str:
        """One sentence that explains the status of the episode."""
        frontier = int(self.trace.frontier[-1]) if self.moves else self.first_frontier
        gathers = self.task == "gathering"
        cells = "cells with particles to gather" if gathers else "frontier cells"
        supplement = "" if self else f"; {frontier} {cells} left"
        sentence = REASONS[self.status]
        if self and gathers:
            sentence = "all particles are gathered"
        if self and self.unreachable:
            sentence = "every cell that particles can reach is classified"
        if self.unreachable:
            supplement += f"; no particle can reach {self.out_of_reach}"
        return f"{sentence}{supplement}"

    @property
    def out_of_reach(self) -> str:
        """Text with the number of free cells out of reach of all particles. If all free cells are
        in reach, the text is empty.
        """
        return (
            f"{self.unreachable} of {self.workspace.n_free} free cells" if self.unreachable else ""
        )

    @cached_property
    def unreachable(self) -> int:
        """Number of free cells that no path of free cells connects to a start cell. In a coverage
        and in a gathering, the number is 0.
        """
        map_known = self.targets is not None or self.task == "gathering"
        if map_known or self.observations is not None:
            return 0
        parts = self.workspace.components
        began = np.vstack([self.start, *(cells for _, _, cells in self.placed)])
        return (
            self.workspace.n_free - int(np.isin(parts, parts[tuple(began.T)]).sum())
            if parts.max() > 1
            else 0
        )

    @property
    def sentence(self) -> str:
        """Return one sentence with the status, the number of moves and the reason for
        the status.
        """
        return f"{self.status} after {self.moves} moves: {self.reason}"

    @property
    def metrics(self) -> dict[str, Any]:
        """Return the metrics of the episode by name: all measures that sweeps store, and other
        numbers about the result.
        """
        numbers = {
            "status": str(self.status),
            "moves": self.moves,
            "scans": self.scans,
            "cost": self.cost,
            "distance": self.distance,
            "seconds": self.seconds,
        }
        errors = self.errors
        if errors is None:
            return numbers
        return numbers | {
            name: getattr(errors, name)
            for name in (*NOISE_MEASURES, "false_free_rate", "false_obstacle_rate")
        }

    def report(self) -> dict[str, Any]:
        """Return the JSON object that commands print for one episode."""
        problem, workspace = self.problem, self.workspace
        report = {
            "task": self.task,
            "policy": self.policy,
            "map": {
                "name": workspace.name,
                "shape": list(workspace.shape),
                "free_cells": workspace.n_free,
            },
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
            report |= {"noise": dict(vars(problem.noise)), "confidence": problem.confidence}
        report |= {name: value for name, value in self.metrics.items() if name != "seconds"}
        return report | self.lengths_and_times | {"reason": self.reason}

    @cached_property
    def replay(self) -> Replay:
        """The replay of the episode, computed from its stored commands and scans."""
        problem, model = self.problem, (self.problem.noise or Noise(), self.problem.confidence)
        if self.observations is not None:
            goal, shape = self.goal or Goal(make_task("mapping")), self.workspace.shape
            stored = self.observations, self.truth
            return ObservedReplay(shape, *model, self.trace, *stored, goal, self.rule, self.placed)
        if problem.noise is not None:
            return NoisyReplay(
                self.workspace, self.start, *model, self.seed, self.trial, self.trace
            )
        return ExactReplay(
            GridWorld(self.workspace, self.rule),
            problem.setup.task,
            self.start,
            self.targets,
            self.trace,
            self.placed,
        )

    def frames(self) -> Iterator[tuple[SwarmState, Belief]]:
        """Yield the state of the swarm and the belief, at the start and after each command.

        Without noise, the belief contains what the last scan showed. If the outcome of a command
        after the last scan is certain, the belief also contains this outcome. With noise, the state
        holds the most likely positions of the particles.
        """
        return self.replay.frames()

    def moments(self) -> Iterator[Moment]:
        """Yield a `Moment` at the start and after each command."""
        return self.replay.moments()

    def final(self) -> tuple[SwarmState, Belief]:
        """Return the swarm's state and the belief after the last command. In an episode with noise,
        the state is an estimate.
        """
        return self.replay.end.state, self.replay.end.belief

    @cached_property
    def probability(self) -> NDArray[np.float64] | None:
        """Final probability that each cell is free, for the cells of the workspace and of a rim
        that is one cell wide (float64).

        For an episode without noise, and for a run on a rig, the property is None.
        """
        return self.replay.last[0].probability if isinstance(self.replay, NoisyReplay) else None

    @cached_property
    def errors(self) -> MapErrors | None:
        """Classification errors of the final map of a simulation with noise.

        The property is None for episodes without noise and for runs on a rig.
        """
        if self.problem.noise is None or self.observations is not None:
            return None
        return MapErrors.of(self.workspace, self.start, self.final()[1])

    def verify(self) -> Verification:
        """Replay the commands and scans, and compare the replay with all stored values of the
        episode.

        For an episode without noise, also check the status: it must be "complete" exactly if no
        frontier cells remain at the end.

        Raises
        ------
        InvalidInputError, UnknownNameError
            Raised if the running process does not know the task, or if the task does not fit the
            workspace.
        """
        end = self.replay.end
        if end.first_frontier != self.first_frontier:
            return Verification(
                False,
                f"first_frontier differs: {self.first_frontier} stored, {end.first_frontier}"
                " replayed",
            )
        if end.trace.moves != self.moves:
            return Verification(False, f"commands: {self.moves} stored, {end.trace.moves} replayed")
        difference = self.trace.difference(end.trace) or self.replay.wrong_scan(
            self.problem.scanning
        )
        if difference is not None:
            return Verification(False, difference)
        if self.observations is not None:
            return Verification(True, f"{self.scans} scans processed again: the same belief")
        if self.problem.noise is not None:
            return Verification(
                True,
                f"{self.moves} moves of {self.particles} particles with noise replayed: all the"
                " same",
            )
        if end.state.n_particles != self.particles:
            return Verification(
                False,
                f"{self.particles} particles at the start, {end.state.n_particles} at the end",
            )
        if end.belief.complete != bool(self) and self.status is not Status.ALARM:
            return Verification(
                False,
                f"status '{self.status}' stored, {len(end.belief.frontier)} frontier cells left",
            )
        return Verification(
            True, f"{self.moves} moves of {self.particles} particles replayed: all the same"
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the episode to an ``.npz`` file. A failed write leaves no partial file.

        Raises
        ------
        InvalidInputError
            Raised if the path does not end in ``.npz``, or if the episode comes from a rig with
            noise or from a drive after whose interruption the particles were elsewhere. The log of
            the rig already stores such an episode.
        OutputError
            Raised if Shoal cannot write the file.
        """
        if self.observations is not None or self.placed:
            raise InvalidInputError(
                f"{path}: expected an episode of a simulation, got a drive of a rig"
                f" {'that was interrupted' if self.placed else 'with noise'}, which the log of the"
                " rig contains"
            )
        values = {
            name: getattr(self, name)
            for name in ("policy", "first_frontier", "seed", "trial", "seconds")
        }
        values |= {"status": str(self.status), "versions": dict(self.versions)}
        episode_file.write(
            path, self.problem, values, self.trace, start=self.start, targets=self.targets
        )

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, trust: bool = False) -> SwarmEpisode:
        """Read an episode that `save` wrote. If ``trust`` is false, refuse a file with a
        third-party task.

        Raises
        ------
        InvalidInputError
            Raised if the file is missing or damaged, or has another format.
        """
        return cls(**episode_file.read(path, trust=trust))

    def __repr__(self) -> str:
        return (
            f"<SwarmEpisode: {self.task} of {self.workspace.name!r} by {self.policy},"
            f" {self.particles} particles, {self.moves} moves, {self.status}>"
        )
