"""drive(): any policy on any rig, in a closed loop."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from shoal.checks import check_integer
from shoal.episode import Status, Verification
from shoal.errors import InvalidInputError
from shoal.files import interruption_held
from shoal.swarm.episode import REASONS, SwarmEpisode
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.board import Board, GridLayout
from shoal.swarm.grid.commands import decode
from shoal.swarm.grid.randomness import trial_rng
from shoal.swarm.grid.scans import MOVE_COST, SCAN_COST
from shoal.swarm.grid.state import SwarmState, check_cells
from shoal.swarm.grid.trace import Row, Trace
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.noise.model import CONFIDENCE, Noise
from shoal.swarm.policies import POLICIES, Policy, View
from shoal.swarm.problem import SwarmProblem
from shoal.swarm.rigs.log import DriveLog, RecordedRig, digest, read_log
from shoal.swarm.rigs.protocol import Rig
from shoal.swarm.rigs.remote import LinkCounts
from shoal.swarm.rigs.tracking import ExactTracker, NoisyTracker
from shoal.swarm.simulation.deciders import Decider, ReplannedRuns, make_decider
from shoal.swarm.simulation.loop import OnMoves, closed_loop

MAX_MOVES = 1_000_000


@dataclass(frozen=True, eq=False)
class Drive:
    """What came of driving a rig; true if the map is complete.

    Parameters
    ----------
    policy : str
    status : str
        "complete", "stalled" or "limit".
    commands : str
        What was sent.
    scanned : ndarray of bool, shape (moves,)
        Whether a scan followed each command. There was one more before the first.
    belief : Belief
        The map at the end.
    cells : ndarray of int64, shape (n, ndim)
        Where the particles are believed to be at the end.
    episode : SwarmEpisode or None
        The run as an episode, in a workspace of the free cells that were found: to film, draw and verify. With noise it
        holds what the scans showed; None if no free cell was found.
    link : LinkCounts or None
        What happened on the line of a remote rig.
    seconds : float
    """

    policy: str
    status: str
    commands: str
    scanned: NDArray[np.bool_]
    belief: Belief
    cells: NDArray[np.int64]
    episode: SwarmEpisode | None
    link: LinkCounts | None
    seconds: float

    def __bool__(self) -> bool:
        return self.status == "complete"

    @property
    def moves(self) -> int:
        """Number of commands sent."""
        return len(self.commands)

    @property
    def scans(self) -> int:
        """Number of scans, the one at the start included."""
        return 1 + int(np.count_nonzero(self.scanned))

    def compared(self, truth: GridWorkspace) -> dict[str, int]:
        """Return how many cells were classified wrongly, given the true map: walls taken for free, and free cells for walls.

        Raises
        ------
        InvalidInputError
            If the map has another shape.
        """
        if truth.shape != self.belief.open.layout.shape:
            raise InvalidInputError(f"map: expected one of shape {self.belief.open.layout.shape}, got {truth.shape}")
        free = Board.of_mask(truth.free)
        return {"false_free": len(self.belief.open - free), "false_obstacles": len(self.belief.obstacles & free)}

    @property
    def sentence(self) -> str:
        """The status for people."""
        rest = "" if self else f"; {len(self.belief.frontier)} frontier cells left"
        return f"{self.status} after {self.moves} moves: {REASONS[Status(self.status)]}{rest}"


class Tracker(Protocol):
    """What makes a belief of positions."""

    belief: Belief
    state: SwarmState

    @property
    def finished(self) -> bool:
        """Whether nothing is left that could be done."""

    def blind(self, command: str, steps: int, moves: int) -> list[Row] | None:
        """Take in ``steps`` equal commands without a scan, as `update`; return None, changing nothing, if a scan is needed."""

    def update(self, command: str, steps: int, cells: NDArray[np.int64], moves: int) -> list[Row]:
        """Take in a scan after ``steps`` equal commands; return (classified, frontier, travelled) of each."""


def drive(
    rig: Rig,
    *,
    policy: str | Policy = "closest-frontier",
    seed: int = 0,
    max_moves: int = MAX_MOVES,
    scan_every: str | int = 1,
    scan_cost: float = SCAN_COST,
    move_cost: float = MOVE_COST,
    noise: Noise | None = None,
    confidence: float = CONFIDENCE,
    log: DriveLog | None = None,
    on_moves: OnMoves | None = None,
) -> Drive:
    """Map the workspace of a rig: the policy sees positions and nothing else.

    However it ends, with an error and by Ctrl-C too, the rig is sent a stop command.

    Parameters
    ----------
    rig : Rig
    policy : str or Policy
        See `shoal.swarm.policies.make_policy`.
    seed : int
        For policies that draw.
    max_moves : int
    scan_every, scan_cost, move_cost
        See `shoal.swarm.grid.scans.ScanRule`.
    noise : Noise, optional
        How often particles slip and are seen wrongly; then nothing that is seen is held against the rig.
    confidence : float
        With noise: the probability from which a cell counts as settled.
    log : DriveLog, optional
        Everything is written there, as it happens.
    on_moves : callable, optional
        Told the progress.

    Returns
    -------
    Drive

    Raises
    ------
    InvalidInputError, UnknownNameError
        For arguments that do not fit.
    RigError
        If the rig does not answer, or moves as none under its rule can.

    Examples
    --------
    >>> from shoal.swarm.rigs import SimulatedRig
    >>> result = drive(SimulatedRig(GridWorkspace([[1, 1, 1, 1]]), [(0, 0)]))
    >>> result.status, result.commands, result.episode.verify().ok
    ('complete', 'lururururdldldld', True)
    """
    seed, max_moves = check_integer(seed, what="seed", least=0), check_integer(max_moves, what="max-moves", least=0)
    if not isinstance(rig, Rig):
        raise InvalidInputError(f"rig: expected an object with name, shape, rule, send, observe and stop, got {rig!r}")
    if noise is not None and not isinstance(noise, Noise):
        raise InvalidInputError(f"noise: expected a Noise, got {noise!r}")
    asked = SwarmProblem(
        np.ones(rig.shape, dtype=np.bool_), policy=policy, rule=rig.rule, max_moves=max_moves, scan_every=scan_every,
        scan_cost=scan_cost, move_cost=move_cost, **({} if not noise else vars(noise) | {"confidence": confidence}),
    )  # fmt: skip
    asked.check_policy(GridLayout(rig.shape))
    chosen, rng = asked.chosen_policy, trial_rng(seed)

    def decider(belief: Belief) -> Decider:
        if noise is not None:
            return ReplannedRuns(chosen, rng, every=asked.scanning.step, max_moves=max_moves)
        return make_decider(asked.scanning, chosen, rule=rig.rule, mapping=True, belief=belief, rng=rng)

    return _driven(rig, decider, asked, log, on_moves, policy=chosen.name, seed=seed, noise=noise)


def redrive(rig: RecordedRig) -> Drive:
    """Drive a recorded rig with the commands and scans that it has recorded.

    Raises
    ------
    InvalidInputError, RigError
        If they do not fit together.
    """
    header = rig.header
    noise = None if header["noise"] is None else Noise(**header["noise"])
    name: str = header["policy"]
    known = name.partition(":")[0] in POLICIES or ":" in name  # of a third party's only the name is in the log
    asked = SwarmProblem(
        np.ones(rig.shape, dtype=np.bool_), policy=name if known else "auto", rule=rig.rule, max_moves=len(rig.commands),
        scan_every=header["scan_every"], **({} if not noise else vars(noise) | {"confidence": header["confidence"]}),
    )  # fmt: skip
    return _driven(rig, lambda _belief: _RecordedRuns(rig), asked, None, None, policy=name, seed=header["seed"], noise=noise)


def _driven(
    rig: Rig,
    make_decider: Callable[[Belief], Decider],
    asked: SwarmProblem,
    log: DriveLog | None,
    on_moves: OnMoves | None,
    *,
    policy: str,
    seed: int,
    noise: Noise | None,
) -> Drive:
    began, status, trace = time.perf_counter(), Status.INTERRUPTED, Trace.empty(0)
    try:
        first = check_cells(rig.observe(), rig.shape, what="positions")
        tracker: ExactTracker | NoisyTracker
        if noise is None:
            tracker = ExactTracker(rig.shape, rig.rule, first)
        else:
            tracker = NoisyTracker(rig.shape, first, noise, asked.confidence)
        if log is not None:
            said = {} if noise is None else {"noise": dict(vars(noise)), "confidence": asked.confidence}
            log.begin(rig, policy=policy, seed=seed, scan_every=asked.scanning.every, **said)
            log.scan(0, first)
        swarm = RigSwarm(rig, tracker, log)
        trace, status = closed_loop(swarm, make_decider(tracker.belief), max_moves=asked.max_moves, on_moves=on_moves)
    finally:
        try:
            with interruption_held():
                rig.stop()
        finally:  # even if the rig did not confirm the stop
            if log is not None and status is Status.INTERRUPTED:
                log.end(str(status))
            elif log is not None:
                log.end(str(status), moves=trace.moves, belief=tracker.belief)
    seconds = time.perf_counter() - began
    episode = _episode(rig, tracker, asked, trace, status=status, policy=policy, seed=seed, seconds=seconds)
    return Drive(
        policy,
        str(status),
        decode(trace.commands),
        trace.scanned,
        tracker.belief,
        tracker.state.cells,
        episode,
        getattr(rig, "counts", None),
        seconds,
    )


def _episode(
    rig: Rig, tracker: ExactTracker | NoisyTracker, asked: SwarmProblem, trace: Trace, *, status: Status, policy: str, seed: int,
    seconds: float,
) -> SwarmEpisode | None:  # fmt: skip
    """Return the run as an episode in the map that was found; None if no free cell was.

    Without noise every particle moves there as it did. With noise it is what was seen.
    """
    free = tracker.belief.open.inner
    if not free.any():
        return None
    start = tuple(map(tuple, tracker.start.tolist())) or None
    return SwarmEpisode(
        problem=asked.replaced(map=GridWorkspace(free, name=rig.name), start=start),
        start=tracker.start,
        trace=trace,
        status=status,
        policy=policy,
        first_frontier=tracker.first_frontier,
        seed=seed,
        seconds=seconds,
        observations=tuple(tracker.sights) if isinstance(tracker, NoisyTracker) else None,
    )


class RigSwarm:
    """The particles of a rig, as the closed loop controls them; see `shoal.swarm.simulation.loop.Controlled`.

    Parameters
    ----------
    rig : Rig
    tracker : Tracker
    log : DriveLog, optional
    """

    def __init__(self, rig: Rig, tracker: Tracker, log: DriveLog | None) -> None:
        self._rig, self._tracker, self._log, self._moves = rig, tracker, log, 0

    @property
    def rule(self) -> str:
        """The move rule."""
        return self._rig.rule

    @property
    def belief(self) -> Belief:
        """What is known of the map."""
        return self._tracker.belief

    @property
    def state(self) -> SwarmState:
        """Where the particles are, or are believed to be."""
        return self._tracker.state

    @property
    def finished(self) -> bool:
        """Whether nothing is left that could be done."""
        return self._tracker.finished

    def carry_out(self, command: str, steps: int, *, scan: bool) -> tuple[list[Row], bool]:
        """Send a run of commands, and observe unless that can tell nothing new."""
        for step in range(1, steps + 1):
            if self._log is not None:
                self._log.command(self._moves + step, command)
            self._rig.send(command)
        self._moves += steps
        rows = None if scan else self._tracker.blind(command, steps, self._moves)
        if rows is not None:
            return rows, False
        cells = check_cells(self._rig.observe(), self._rig.shape, what="positions")
        if self._log is not None:
            self._log.scan(self._moves, cells)
        return self._tracker.update(command, steps, cells, self._moves), True


class _RecordedRuns:
    """The runs of a log: equal commands up to the next scan."""

    def __init__(self, rig: RecordedRig) -> None:
        self._rig, self._at = rig, 0

    @property
    def due(self) -> bool:
        """Whether there was a scan after the last run."""
        return self._at in self._rig.scans

    def next(self, view: View, state: SwarmState, idle: int) -> tuple[str, int] | None:
        """Return the next run; see `Decider`."""
        commands, first = self._rig.commands, self._at
        if first == len(commands):
            return None
        self._at += 1
        while self._rig.rule != "tilt" and self._at not in self._rig.scans and commands[self._at : self._at + 1] == commands[first]:
            self._at += 1
        return commands[first], self._at - first

    def scan_after(self, belief: Belief, state: SwarmState, learnt: int) -> bool:
        """Do not ask: scans are where they were."""
        return True


def replay_log(path: str | os.PathLike[str]) -> tuple[Drive, Verification]:
    """Drive a recorded rig with the commands that were sent to it; tell whether map and status are those of the log.

    Raises
    ------
    InvalidInputError
        See `read_log`.
    RigError
        If the positions do not follow from one another.
    """
    rig = read_log(path)
    result = redrive(rig)
    ended = rig.ended
    if ended is None or ended["map"] is None:
        how = "breaks off" if ended is None else f"was {ended['status']}"
        return result, Verification(True, f"{result.moves} moves replayed; the log {how} there, before the run was over")
    again: dict[str, Any] = {"moves": result.moves, "free": len(result.belief.open)}
    again |= {"obstacles": len(result.belief.obstacles), "map": digest(result.belief)}
    if rig.header["noise"] is None and result.belief.complete != (ended["status"] == "complete"):
        return result, Verification(
            False, f"status {ended['status']!r} in the log, {len(result.belief.frontier)} frontier cells left"
        )
    for name, value in again.items():
        if ended[name] != value:
            return result, Verification(False, f"{name}: {ended[name]} in the log, {value} replayed")
    return result, Verification(True, f"{result.moves} moves replayed: the same map")
