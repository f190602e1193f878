"""Mapping with a rig: run any policy on a rig, in the closed loop that simulations also use, and replay logs."""

from __future__ import annotations

import os
import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_choice, check_integer
from shoal.core.dataclass import dataclass
from shoal.core.episode import Status, Verification
from shoal.core.errors import InvalidInputError
from shoal.core.interruption import interruption_held
from shoal.swarm.episode import REASONS, SwarmEpisode
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.board import Board, GridLayout
from shoal.swarm.grid.randomness import trial_rng
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.grid.trace import Trace, WithTrace
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.policies import View, shown_name
from shoal.swarm.problem import DRIVEN, SwarmProblem
from shoal.swarm.rigs.log import DriveLog, RecordedRig, map_digest, read_log
from shoal.swarm.rigs.protocol import Rig
from shoal.swarm.rigs.remote import LinkCounts
from shoal.swarm.rigs.tracking import ExactRigSwarm, NoisyRigSwarm, RigSwarm
from shoal.swarm.simulation.deciders import make_decider
from shoal.swarm.simulation.loop import OnMoves, closed_loop


@dataclass(frozen=True, eq=False)
class Drive(WithTrace):
    """The result of a run on a rig. ``bool(drive)`` is true if the map is complete.

    Parameters
    ----------
    policy : str
        Name of the policy that chose the commands. If the problem has the policy ``auto``, the field contains the name of the
        selected policy.
    status : Status
    trace : Trace
        All commands sent to the rig, with the effect of each command.
    belief : Belief
        The belief at the end of the run: the known state of each cell.
    cells : ndarray of int64, shape (n, ndim)
        Estimated cells of the particles at the end of the run.
    episode : SwarmEpisode or None
        The run as an episode, for films, figures and verification. The workspace of the episode consists of the free cells that the
        particles found. If the rig has noise, the episode contains the scans. If the particles found no free cell, ``episode`` is
        None.
    link : LinkCounts or None
        Statistics of the connection to a remote rig, or None for a rig that is not remote.
    seconds : float
    """

    policy: str
    status: Status
    trace: Trace
    belief: Belief
    cells: NDArray[np.int64]
    episode: SwarmEpisode | None
    link: LinkCounts | None
    seconds: float

    def __bool__(self) -> bool:
        return self.status.done

    @property
    def reason(self) -> str:
        """Return one sentence that explains the status of the run."""
        rest = "" if self else f"; {len(self.belief.frontier)} frontier cells left"
        return f"{REASONS[self.status]} after {self.moves} moves{rest}"

    def compared(self, truth: GridWorkspace) -> dict[str, int]:
        """Return the number of obstacles that the run classified as free, and the number of free cells classified as obstacles.

        Raises
        ------
        InvalidInputError
            Raised if ``truth`` and the field of view of the rig have different shapes.
        """
        if truth.shape != self.belief.open.layout.shape:
            raise InvalidInputError(f"map: expected one of shape {self.belief.open.layout.shape}, got {truth.shape}")
        free = Board.of_mask(truth.free)
        return {"false_free": len(self.belief.open - free), "false_obstacles": len(self.belief.obstacles & free)}


def drive(rig: Rig, *, seed: int = 0, log: DriveLog | None = None, on_moves: OnMoves | None = None, **fields: Any) -> Drive:
    """Map the workspace of a rig. The policy knows only the positions that the rig reports.

    At the end of the run, the function stops the rig, even after an error or Ctrl-C.

    Parameters
    ----------
    rig : Rig
    seed : int
        Seed of the random numbers, for policies with random decisions.
    log : DriveLog, optional
        Log of the run. Shoal writes each command and each scan to the log immediately.
    on_moves : callable, optional
        Function that `drive` calls during the run, with the number of moves made and the number of remaining frontier cells.
    **fields
        Fields of `SwarmProblem`. The list `shoal.swarm.problem.DRIVEN` contains the fields of `SwarmProblem` that are valid for a
        rig. If ``slip``, ``misplace`` or ``miss`` is given, wrong positions count as noise, and not as an error of the rig.

    Raises
    ------
    InvalidInputError, UnknownNameError
        Raised if an argument is invalid.
    RigError
        Raised if the rig does not answer, or if the rig's particles violate the move rule.

    Examples
    --------
    >>> from shoal.swarm.rigs import SimulatedRig
    >>> result = drive(SimulatedRig(GridWorkspace([[1, 1, 1, 1]]), [(0, 0)]), policy="closest-frontier")
    >>> result.status, result.commands, result.episode.verify().ok
    (<Status.COMPLETE: 'complete'>, 'lururururdldldld', True)
    """
    seed = check_integer(seed, what="seed", least=0)
    for name in fields:
        check_choice(name, what="drive", choices=DRIVEN)
    if not isinstance(rig, Rig):
        raise InvalidInputError(f"rig: expected an object with name, shape, rule, send, observe and stop, got {rig!r}")
    problem = SwarmProblem("rig", rule=rig.rule, **fields)
    problem.check_policy(GridLayout(rig.shape))
    return _driven(rig, problem, seed=seed, log=log, on_moves=on_moves)


def _driven(rig: Rig, problem: SwarmProblem, *, seed: int, log: DriveLog | None = None, on_moves: OnMoves | None = None) -> Drive:
    began, status, trace = time.perf_counter(), Status.INTERRUPTED, Trace.empty(0)
    recorded = rig if isinstance(rig, RecordedRig) else None
    policy = shown_name(problem.chosen_policy, problem.policy) if recorded is None else recorded.policy
    most = problem.max_moves if recorded is None else len(recorded.commands)
    try:
        noise = problem.noise
        swarm: RigSwarm = ExactRigSwarm(rig) if noise is None else NoisyRigSwarm(rig, noise, problem.confidence)
        if log is not None:
            log.begin(rig, problem, policy=policy, seed=seed)
            log.scan(0, swarm.observations[0] if isinstance(swarm, NoisyRigSwarm) else swarm.start)
            swarm.log = log
        decider = make_decider(problem, swarm.belief, trial_rng(seed)) if recorded is None else _RecordedRuns(recorded)
        trace, status = closed_loop(swarm, decider, max_moves=most, on_moves=on_moves)
    finally:
        try:
            with interruption_held():
                rig.stop()
        finally:  # even if the rig did not confirm the stop
            if log is not None:
                log.end(status, moves=trace.moves, belief=None if status is Status.INTERRUPTED else swarm.belief)
    seconds = time.perf_counter() - began
    about: dict[str, Any] = {"trace": trace, "status": status, "policy": policy, "seconds": seconds}
    episode = None
    if swarm.belief.open:
        # Without noise, every particle moves in the map found exactly as it moved on the rig. With noise, the scans are replayed.
        found = GridWorkspace(swarm.belief.open.inner, name=rig.name)
        episode = SwarmEpisode(
            problem=problem.replaced(map=found, start=tuple(map(tuple, swarm.start.tolist())) or None),
            start=swarm.start,
            first_frontier=swarm.first_frontier,
            seed=seed,
            observations=tuple(swarm.observations) if isinstance(swarm, NoisyRigSwarm) else None,
            **about,
        )
    return Drive(belief=swarm.belief, cells=swarm.state.cells, episode=episode, link=getattr(rig, "counts", None), **about)


class _RecordedRuns:
    """Divides the commands of a log into runs: equal commands up to the next scan."""

    def __init__(self, rig: RecordedRig) -> None:
        self._rig, self._at = rig, 0

    @property
    def due(self) -> bool:
        """Whether the log contains a scan after the last run of commands."""
        return self._at in self._rig.scans

    def next(self, view: View, state: SwarmState, idle: int) -> tuple[str, int] | None:
        """Return the command of the next run and the number of commands in the run. If no commands are left, return None."""
        commands, first = self._rig.commands, self._at
        if first == len(commands):
            return None
        self._at += 1
        while self._rig.rule != "tilt" and self._at not in self._rig.scans and commands[self._at : self._at + 1] == commands[first]:
            self._at += 1
        return commands[first], self._at - first

    def scan_after(self, belief: Belief, state: SwarmState, learnt: int) -> bool:
        """Return true. The log determines when a scan is made."""
        return True


def replay_log(path: str | os.PathLike[str], *, trust: bool = False) -> tuple[Drive, Verification]:
    """Replay the commands of a log, and compare the final map and the status with the log.

    Parameters
    ----------
    path : path
    trust : bool
        Whether Shoal may run a third-party task that the log names.

    Raises
    ------
    InvalidInputError
        Raised if the file is missing, damaged or not a log.
    RigError
        Raised if the recorded positions violate the move rule.
    """
    rig = read_log(path, trust=trust)
    result = _driven(rig, rig.problem, seed=rig.seed)
    ended = rig.ended
    if ended is None or ended["map"] is None:
        how = "breaks off" if ended is None else f"was {ended['status']}"
        if result.status is Status.LIMIT:  # the end of the log is not a limit set by a user
            episode = None if result.episode is None else replace(result.episode, status=Status.INTERRUPTED)
            result = replace(result, status=Status.INTERRUPTED, episode=episode)
        return result, Verification(True, f"{result.moves} moves replayed; the log {how} before the end of the run")
    if rig.problem.noise is None and result.belief.complete != (ended["status"] == "complete"):
        return result, Verification(
            False, f"status {ended['status']!r} in the log, {len(result.belief.frontier)} frontier cells left"
        )
    for name, value in ({"moves": result.moves} | map_digest(result.belief)).items():
        if ended[name] != value:
            return result, Verification(False, f"{name}: {ended[name]} in the log, {value} replayed")
    return result, Verification(True, f"{result.moves} moves replayed: the same map")
