"""drive(): any policy on any rig, in a closed loop."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from shoal.errors import InvalidInputError
from shoal.files import interruption_held
from shoal.swarm.episode import STATUSES, Episode, Verification
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.board import Board, GridLayout
from shoal.swarm.grid.commands import decode, encode
from shoal.swarm.grid.scans import MOVE_COST, SCAN_COST, ScanRule
from shoal.swarm.grid.state import SwarmState, check_cells
from shoal.swarm.grid.tasks import Mapping
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.noise.asking import AskedRuns
from shoal.swarm.noise.model import CONFIDENCE, Noise
from shoal.swarm.noise.running import check_noisy
from shoal.swarm.policies import Compiled, Policy, View, make_policy
from shoal.swarm.policies.compiled import check_scanning
from shoal.swarm.rigs.course import Course
from shoal.swarm.rigs.log import DriveLog, RecordedRig, digest, read_log
from shoal.swarm.rigs.protocol import Rig
from shoal.swarm.rigs.remote import LinkCounts
from shoal.swarm.rigs.tracking import ExactTracker, NoisyTracker
from shoal.swarm.running import MAX_MOVES, check_numbers, trial_rng
from shoal.swarm.stepwise import OnMoves, Runs, runs_of


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
    episode : Episode or None
        The run as an episode, in a workspace of the free cells that were found: to film, draw and verify. With noise a
        `shoal.swarm.noise.SeenEpisode`; None if no free cell was found.
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
    episode: Episode | None
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
        return f"{self.status} after {self.moves} moves: {STATUSES[self.status]}{rest}"


class Tracker(Protocol):
    """What makes a belief of positions."""

    belief: Belief
    state: SwarmState

    @property
    def finished(self) -> bool:
        """Whether nothing is left that could be done."""

    def blind(self, command: str, steps: int, moves: int) -> list[tuple[int, int, int]] | None:
        """Take in ``steps`` equal commands without a scan, as `update`; return None, changing nothing, if a scan is needed."""

    def update(self, command: str, steps: int, cells: NDArray[np.int64], moves: int) -> list[tuple[int, int, int]]:
        """Take in a scan after ``steps`` equal commands; return (done, frontier, travelled) of each."""


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
    chosen, scanning = make_policy(policy), ScanRule.parse(scan_every, scan_cost=scan_cost, move_cost=move_cost)
    check_numbers(seed=seed, max_moves=max_moves)
    if not isinstance(rig, Rig):
        raise InvalidInputError(f"rig: expected an object with name, shape, rule, send, observe and stop, got {rig!r}")
    if isinstance(chosen, Compiled):
        chosen.check(GridLayout(rig.shape), rig.rule)
    check_scanning(scanning, chosen, rig.rule)
    if noise is not None:
        check_noisy(noise, confidence, rule=rig.rule, task=Mapping(), scanning=scanning)

    asked = None if noise is None else AskedRuns(chosen, trial_rng(seed), scanning.step)

    def runs(belief: Belief) -> Runs:
        return asked or runs_of(scanning, chosen, Mapping(), rig.rule, belief, trial_rng(seed), None)

    def may_skip(move: int) -> bool:
        return scanning.kind == "adaptive" if asked is None else not asked.due and move < max_moves

    return _driven(
        rig,
        runs,
        may_skip,
        max_moves,
        log,
        on_moves,
        policy=chosen.name,
        seed=seed,
        scanning=scanning,
        noise=noise,
        confidence=confidence,
    )


def redrive(rig: RecordedRig) -> Drive:
    """Drive a recorded rig with the commands and scans that it has recorded.

    Raises
    ------
    InvalidInputError, RigError
        If they do not fit together.
    """
    header = rig.header
    about: dict[str, Any] = {"policy": header["policy"], "seed": header["seed"]}
    about |= {"scanning": ScanRule.parse(header["scan_every"])}
    if header["noise"] is not None:
        about |= {"noise": Noise(**header["noise"]), "confidence": header["confidence"]}
    known = lambda move: move not in rig.scans  # noqa: E731  # as short as what it says
    return _driven(rig, lambda _belief: _RecordedRuns(rig), known, len(rig.commands), None, None, **about)


def _driven(
    rig: Rig,
    make_runs: Callable[[Belief], Runs],
    may_skip: Callable[[int], bool],
    max_moves: int,
    log: DriveLog | None,
    on_moves: OnMoves | None,
    *,
    policy: str,
    seed: int,
    scanning: ScanRule,
    noise: Noise | None = None,
    confidence: float = CONFIDENCE,
) -> Drive:
    began = time.perf_counter()
    status, course = "interrupted", Course()
    try:
        first = check_cells(rig.observe(), rig.shape, what="positions")
        tracker: ExactTracker | NoisyTracker
        tracker = ExactTracker(rig.shape, rig.rule, first) if noise is None else NoisyTracker(rig.shape, first, noise, confidence)
        if log is not None:
            said = {} if noise is None else {"noise": dict(vars(noise)), "confidence": confidence}
            log.begin(rig, policy=policy, seed=seed, scan_every=scanning.every, **said)
            log.scan(0, first)
        status = _loop(rig, make_runs(tracker.belief), may_skip, tracker, course, max_moves, log, on_moves)
    finally:
        try:
            with interruption_held():
                rig.stop()
        finally:  # even if the rig did not confirm the stop
            if log is not None and status == "interrupted":
                log.end(status)
            elif log is not None:
                log.end(status, moves=len(course.codes), belief=tracker.belief)
    seconds = time.perf_counter() - began
    about: dict[str, Any] = {"policy": policy, "seed": seed, "scanning": scanning, "noise": noise, "confidence": confidence}
    episode = course.episode(rig, tracker, status=status, seconds=seconds, **about)
    return Drive(
        policy,
        status,
        decode(np.array(course.codes, dtype=np.int8)),
        np.array(course.scanned, dtype=np.bool_),
        tracker.belief,
        tracker.state.cells,
        episode,
        getattr(rig, "counts", None),
        seconds,
    )


class _RecordedRuns:
    """The runs of a log: equal commands up to the next scan."""

    def __init__(self, rig: RecordedRig) -> None:
        self._rig, self._at = rig, 0

    def next(self, view: View, state: SwarmState, idle: int) -> tuple[str, int] | None:
        """Return the next run; see `Runs`."""
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


def _loop(
    rig: Rig,
    runs: Runs,
    may_skip: Callable[[int], bool],
    tracker: Tracker,
    course: Course,
    max_moves: int,
    log: DriveLog | None,
    on_moves: OnMoves | None,
) -> str:
    """Play until nothing is left to do; return the status."""
    while True:
        if tracker.belief.complete and tracker.finished:
            return "complete"
        if len(course.codes) >= max_moves:
            return "limit"
        view = View(tracker.belief, tracker.state.occupied, rig.rule, True, len(course.codes), *course.last)
        run = runs.next(view, tracker.state, course.idle)
        if run is None:
            return "complete" if tracker.finished else "stalled"
        command, planned = run
        steps, known = min(planned, max_moves - len(course.codes)), len(tracker.belief.known)
        for step in range(steps):
            if log is not None:
                log.command(len(course.codes) + step + 1, command)
            rig.send(command)
        moves = len(course.codes) + steps
        rows = tracker.blind(command, steps, moves) if may_skip(moves) else None
        scanned = rows is None
        if rows is None:
            cells = check_cells(rig.observe(), rig.shape, what="positions")
            if log is not None:
                log.scan(moves, cells)
            rows = tracker.update(command, steps, cells, moves)
        course.add(int(encode(command, ndim=len(rig.shape))[0]), rows, scanned=scanned)
        runs.scan_after(tracker.belief, tracker.state, len(tracker.belief.known) - known)  # told, so that it learns
        if on_moves is not None:
            on_moves(moves, len(tracker.belief.frontier))


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
