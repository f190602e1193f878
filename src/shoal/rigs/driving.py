"""Mapping with a rig: run any policy on a rig, in the closed loop that simulations also use, and
replay logs.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_choice, check_integer, count_text
from shoal.core.dataclass import dataclass
from shoal.core.episode import Status, Verification
from shoal.core.errors import InvalidInputError, OutputError, RigError, ShoalError
from shoal.core.interruption import interruption_held
from shoal.rigs.checks import Alarm, AlarmRaised, Rate, Trust, trust_of
from shoal.rigs.log import DriveLog, RecordedRig, map_digest, read_log
from shoal.rigs.remote import LinkCounts
from shoal.rigs.simulated import NoisyRig, SimulatedRig
from shoal.rigs.tracking import ExactRigSwarm, NoisyRigSwarm, RigSwarm
from shoal.rigs.transports import LARGEST_VIEW, PositionError, Rig
from shoal.swarm.episode import REASONS, SwarmEpisode
from shoal.swarm.grid.board import RULES, Board, GridLayout, letters_of, noise_rng, trial_rng
from shoal.swarm.grid.scans import Recorder, Trace, WithTrace
from shoal.swarm.grid.state import Belief, SwarmState
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.policies import POLICIES, Manual, View, shown_name
from shoal.swarm.problem import DRIVEN, SwarmProblem
from shoal.swarm.simulation.loop import OnMoves, closed_loop, make_decider

# rounds of test moves in all directions, after which a rig with noise is driven without a verdict
ROUNDS = 12
NOISY_CLOSING = 120  # the same on a rig with noise, where several scans establish a motion
CLOSING = 10  # commands at the end of a drive that may show that the rig still acts


@dataclass(frozen=True, eq=False)
class Drive(WithTrace):
    """The result of a run on a rig. ``bool(drive)`` is true if the map is complete.

    Parameters
    ----------
    policy : str
        Name of the policy that chose the commands. If the problem has the policy ``auto``, the
        field contains the name of the selected policy.
    status : Status
        "alarm" if the rig contradicted the commands or no particle was ever seen to move. Such a
        map is never "complete".
    trace : Trace
        All commands sent to the rig, with the effect of each command. The command that raised an
        alarm is left out.
    belief : Belief
        The belief at the end of the run: the known state of each cell.
    cells : ndarray of int64, shape (n, ndim)
        Estimated cells of the particles at the end of the run.
    episode : SwarmEpisode or None
        The run as an episode, for films, figures and verification. The workspace of the episode
        consists of the free cells that the particles found. If the rig has noise, the episode
        contains the scans. If the particles found no free cell, ``episode`` is None.
    link : LinkCounts or None
        Statistics of the connection to a remote rig, or None for a rig that is not remote.
    seconds : float
    alarms : tuple of Alarm
        What the rig did although it should not, in the order of the commands.
    trust : Trust
        How far the map can be trusted, and why.
    rates : dict of str to Rate
        For a rig with noise: the stated and the observed error rates, by name.
    seconds_per_command, seconds_per_scan : float or None
        Mean time that the rig took for a command and for a scan, in seconds. None if there was
        none, and for replays.
    """

    policy: str
    status: Status
    trace: Trace
    belief: Belief
    cells: NDArray[np.int64]
    episode: SwarmEpisode | None
    link: LinkCounts | None
    seconds: float
    alarms: tuple[Alarm, ...]
    trust: Trust
    rates: dict[str, Rate]
    seconds_per_command: float | None
    seconds_per_scan: float | None

    def __bool__(self) -> bool:
        return self.status.done

    @property
    def reason(self) -> str:
        """Return one sentence that explains the status of the run."""
        rest = "" if self else f"; {len(self.belief.frontier)} frontier cells left"
        if self.status is Status.ALARM:
            rest = f": {self.alarms[-1].text}" if self.alarms else rest
        return f"{REASONS[self.status]} after {count_text(self.moves, 'move')}{rest}"

    def compared(self, truth: GridWorkspace) -> dict[str, int]:
        """Return the number of obstacles that the run classified as free, and the number of free
        cells classified as obstacles.

        Raises
        ------
        InvalidInputError
            Raised if ``truth`` and the field of view of the rig have different shapes.
        """
        if truth.shape != self.belief.open.layout.shape:
            raise InvalidInputError(
                f"map: expected one of shape {self.belief.open.layout.shape}, got {truth.shape}"
            )
        free = Board.of_mask(truth.free)
        return {
            "false_free": len(self.belief.open - free),
            "false_obstacles": len(self.belief.obstacles & free),
        }


class DriveError(RigError):
    """Raised if a rig fails during a run. The attribute ``drive`` holds the result up to the
    failure.
    """

    def __init__(self, message: str, drive: Drive) -> None:
        super().__init__(message)
        self.drive = drive


class DriveInterrupted(KeyboardInterrupt):
    """Raised if Ctrl-C ends a run. The attribute ``drive`` holds the result up to the
    interruption.
    """

    def __init__(self, drive: Drive) -> None:
        super().__init__()
        self.drive = drive


def drive(
    rig: Rig,
    *,
    seed: int = 0,
    log: DriveLog | None = None,
    on_moves: OnMoves | None = None,
    test_move: bool = True,
    spacing: tuple[float, ...] | None = None,
    **fields: Any,
) -> Drive:
    """Map the workspace of a rig. The policy knows only the positions that the rig reports.

    At the end of the run, the function stops the rig, even after an error or Ctrl-C. Kernels are
    compiled before the first scan.

    Before the policy begins, test moves in one direction after the other show that the commands
    move particles. If the last commands moved nothing, a closing move through known free cells
    shows that the rig still acts. The policy ``manual`` gets no test moves, because its commands
    are the user's.

    Parameters
    ----------
    rig : Rig
    seed : int
        Seed of the random numbers, for policies with random decisions.
    log : DriveLog, optional
        Log of the run. Shoal writes each command and each scan to the log immediately.
    on_moves : callable, optional
        Function that `drive` calls during the run, with the number of moves made and the number of
        remaining frontier cells.
    test_move : bool
        Whether test moves may be sent. Without them, the commands of the policy show whether
        particles move. On a rig with noise, closing moves follow in any case if the policy's
        commands do not prove the map.
    spacing : tuple of float, optional
        Size of a cell along each axis in mm, for scale bars.
    **fields
        Fields of `SwarmProblem`. The list `shoal.swarm.problem.DRIVEN` contains the fields of
        `SwarmProblem` that are valid for a rig. If ``slip``, ``misplace`` or ``miss`` is given,
        wrong positions count as noise, and not as an error of the rig.

    Returns
    -------
    Drive
        The status is "alarm" if the rig contradicts the commands, or if no particle was ever seen
        to move.

    Raises
    ------
    InvalidInputError, UnknownNameError
        Raised if an argument is invalid.
    RigError
        Raised if the rig does not answer, or if a position lies outside the field of view. After
        the first scan, the error is a `DriveError`, whose attribute ``drive`` holds the result so
        far.
    DriveInterrupted
        Raised after Ctrl-C. The attribute ``drive`` holds the result so far.

    Whatever else ends the run after the first scan, such as SystemExit or an error of a policy or
    of the log, is raised unchanged, with the result so far in its attribute ``drive``.

    Examples
    --------
    >>> from shoal.rigs import SimulatedRig
    >>> result = drive(SimulatedRig(GridWorkspace([[1, 1, 1, 1]]), [(0, 0)]), policy="closest-frontier")
    >>> result.status, result.commands, result.episode.verify().ok
    (<Status.COMPLETE: 'complete'>, 'lururururdldldldr', True)
    >>> result.trust.level, result.alarms
    ('high', ())
    """
    seed = check_integer(seed, what="seed", least=0)
    for name in fields:
        check_choice(name, what="drive", choices=DRIVEN)
    if not isinstance(rig, Rig):
        raise InvalidInputError(
            f"rig: expected an object with name, shape, rule, send, observe and stop, got {rig!r}"
        )
    sides = rig.shape if isinstance(rig.shape, tuple | list | np.ndarray) else ()
    if len(sides) not in (2, 3) or not all(
        isinstance(side, int | np.integer) and side > 0 for side in sides
    ):
        raise RigError(
            f"{rig.name}: expected as shape two or three positive integers, got {rig.shape!r}"
        )
    if int(np.prod(rig.shape, dtype=object)) > LARGEST_VIEW:
        raise RigError(
            f"{rig.name}: expected a field of view of at most {LARGEST_VIEW} cells, got"
            f" {tuple(rig.shape)}"
        )
    problem = SwarmProblem("rig", rule=rig.rule, **fields)
    problem.check_policy(GridLayout(rig.shape))
    load_drive_kernels(problem)
    return _driven(
        rig, problem, seed=seed, log=log, on_moves=on_moves, test_move=test_move, spacing=spacing
    )


def load_drive_kernels(problem: SwarmProblem) -> None:
    """Load or compile the kernels that a drive needs, so that nobody waits for the compiler between
    two commands.

    Call the function before a rig is connected. It drives a simulated rig of six cells with the
    settings of the problem.
    """
    known = isinstance(problem.policy, str) and (
        problem.policy == "auto" or problem.policy.partition(":")[0] in POLICIES
    )
    policy = (
        problem.policy
        if known and not isinstance(problem.chosen_policy, Manual)
        else "closest-frontier"
    )
    fields = {
        name: getattr(problem, name) for name in DRIVEN if name not in ("policy", "max_moves")
    }
    fields |= {
        name: 1.0
        for name in ("budget", "time_per_move")
        if fields[name] is not None and policy == problem.policy
    }
    if policy != problem.policy:
        fields |= {"budget": None, "time_per_move": None}
    for rule in RULES if problem.rule == "block" and problem.noise is None else (problem.rule,):
        with suppress(
            InvalidInputError
        ):  # the policy does not support the rule, as the drive itself will say
            _prepare(rule, policy, tuple(fields.items()))


@cache
def _prepare(rule: str, policy: str, fields: tuple[tuple[str, Any], ...]) -> None:
    problem = SwarmProblem("rig", rule=rule, policy=policy, max_moves=40, **dict(fields))
    workspace = GridWorkspace(np.array([[1, 1, 1], [1, 0, 1]], dtype=np.bool_))
    problem.check_policy(GridLayout(workspace.shape))
    rig: Rig = SimulatedRig(workspace, [(0, 0)], rule=rule)
    if problem.noise is not None:
        rig = NoisyRig(workspace, [(0, 0)], problem.noise, noise_rng(0))
    _driven(rig, problem, seed=0)


def _driven(
    rig: Rig,
    problem: SwarmProblem,
    *,
    seed: int,
    log: DriveLog | None = None,
    on_moves: OnMoves | None = None,
    test_move: bool = True,
    spacing: tuple[float, ...] | None = None,
) -> Drive:
    began, status, recorder = time.perf_counter(), Status.INTERRUPTED, Recorder()
    recorded = rig if isinstance(rig, RecordedRig) else None
    policy = (
        shown_name(problem.chosen_policy, problem.policy) if recorded is None else recorded.policy
    )
    alarms: list[Alarm] = []
    swarm: RigSwarm | None = None
    failure: BaseException | None = None
    try:
        noise = problem.noise
        swarm = (
            ExactRigSwarm(rig) if noise is None else NoisyRigSwarm(rig, noise, problem.confidence)
        )
        if log is not None:
            log.begin(rig, problem, policy=policy, seed=seed, spacing=spacing)
            log.scan(0, swarm.observations[0] if isinstance(swarm, NoisyRigSwarm) else swarm.start)
            swarm.log = log
        status = _explored(
            swarm, problem, recorder, recorded, seed=seed, test=test_move, on_moves=on_moves
        )
    except AlarmRaised as raised:
        alarms, status = [raised.alarm], Status.ALARM
    except (
        BaseException
    ) as error:  # the rig is stopped first; then the error goes on, with what was found until then
        failure = error
    try:
        with interruption_held():
            rig.stop()
    except KeyboardInterrupt as error:
        failure = failure or error
    except BaseException as error:  # whatever a rig of others raises: the map must not be lost
        alarms.append(
            Alarm(
                "stop",
                recorder.moves,
                f"the rig may still move, as its stop failed: {_told(error)}",
            )
        )
    if swarm is None:
        assert failure is not None
        raise failure
    if failure is None:
        status = _judged(status, swarm, alarms)
    elif not isinstance(failure, KeyboardInterrupt):
        alarms.insert(
            0,
            Alarm(
                "outside" if isinstance(failure, PositionError) else "failure",
                swarm.moves,
                _told(failure),
            ),
        )
    alarms += swarm.marks()
    trace = recorder.trace
    if log is not None:  # even if the rig did not confirm the stop
        try:
            for alarm in alarms if not isinstance(failure, OutputError) else ():
                log.event("alarm", {"alarm": alarm.kind, "move": alarm.move, "text": alarm.text})
            log.end(
                status,
                moves=trace.moves,
                belief=None if status is Status.INTERRUPTED else swarm.belief,
            )
        except BaseException as error:  # a full disk, or a second Ctrl-C
            failure = failure or error
    about: dict[str, Any] = {
        "trace": trace,
        "status": status,
        "policy": policy,
        "seconds": time.perf_counter() - began,
    }
    result = _result(rig, swarm, problem, alarms, about, seed=seed, spacing=spacing)
    if isinstance(failure, KeyboardInterrupt):
        raise DriveInterrupted(result) from failure
    if isinstance(failure, RigError) or (
        isinstance(failure, Exception) and not isinstance(failure, ShoalError)
    ):
        what = str(failure) if isinstance(failure, RigError) else f"{rig.name}: {_told(failure)}"
        raise DriveError(what, result) from failure
    if failure is not None:
        failure.drive = result  # type: ignore[attr-defined]  # its catchers know its type
        raise failure
    return result


def _explored(
    swarm: RigSwarm,
    problem: SwarmProblem,
    recorder: Recorder,
    recorded: RecordedRig | None,
    *,
    seed: int,
    test: bool,
    on_moves: OnMoves | None,
) -> Status:
    """Test the rig, run the policy, and test the rig again if its last commands moved nothing.
    Return the status.
    """
    most = problem.max_moves if recorded is None else len(recorded.commands)
    test = test and recorded is None and not isinstance(problem.chosen_policy, Manual)

    def check(_trace: Trace | None = None) -> None:
        if isinstance(swarm, NoisyRigSwarm):
            swarm.check()

    def send(command: str) -> None:
        rows, scanned = swarm.carry_out(command, 1, scan=True)
        recorder.add(command, rows, scanned=scanned)
        check()
        if on_moves is not None:
            on_moves(recorder.moves, len(swarm.belief.frontier))

    if test:
        letters = letters_of(swarm.layout.ndim)
        for turn in range(ROUNDS * len(letters)):
            if swarm.still is not None or recorder.moves >= most:
                break
            send(letters[turn % len(letters)])
        if swarm.still:
            raise AlarmRaised(_nothing_moved(swarm))
    if recorded is not None:
        runs = _RecordedRuns(recorded)
        _, status = closed_loop(
            swarm, runs, max_moves=most, on_moves=on_moves, on_trace=check, recorder=recorder
        )
        for command, steps in runs.rest():  # the closing moves, after the map was complete
            rows, scanned = swarm.carry_out(command, steps, scan=runs.due)
            recorder.add(command, rows, scanned=scanned)
            check()
        return status if status is not Status.COMPLETE or swarm.finished else Status.STALLED
    decider = make_decider(problem, swarm.belief, trial_rng(seed), swarm.noisy)
    for _ in range(CLOSING):
        _, status = closed_loop(
            swarm, decider, max_moves=most, on_moves=on_moves, on_trace=check, recorder=recorder
        )
        # under noise no scan proves anything by itself: a map is only complete after commands that
        # must move particles
        if status is Status.COMPLETE and (test or swarm.doubtful):
            for _ in range(NOISY_CLOSING if swarm.doubtful else CLOSING):
                open_question = (
                    swarm.doubtful if isinstance(swarm, NoisyRigSwarm) else swarm.unproven
                )
                proof = (
                    swarm.command_that_moves() if open_question and recorder.moves < most else None
                )
                if proof is None:
                    break
                send(proof)
        if status is not Status.COMPLETE or swarm.finished:
            break
    return status if status is not Status.COMPLETE or swarm.finished else Status.STALLED


def _nothing_moved(swarm: RigSwarm) -> Alarm:
    text = (
        f"no particle moved at {count_text(swarm.moves, 'command')}: the magnets do nothing, the"
        " camera shows an old picture, or no particle has room to move"
    )
    return Alarm("still", swarm.moves, text)


def _told(error: BaseException) -> str:
    """Return the text of an error; of an error that is not Shoal's also the type, because its text
    may say nothing alone.
    """
    return str(error) if isinstance(error, ShoalError) else f"{type(error).__name__}: {error}"


def _doubt(swarm: RigSwarm) -> str:
    """Return why the evidence for the walls is not enough."""
    unshown = swarm.unshown if isinstance(swarm, NoisyRigSwarm) else []
    if unshown:
        return (
            f"no particle was surely seen to move at command {' or '.join(map(repr, unshown))},"
            " from which walls were inferred"
        )
    return (
        f"{swarm.unproven} {_cells_were(swarm.unproven)} classified while nothing was seen to move,"
        " more than the confidence allows: the magnets do nothing any more, the camera shows an"
        " old picture, or no particle has room to move"
    )


def _cells_were(number: int) -> str:
    return "cell was" if number == 1 else "cells were"


def _judged(status: Status, swarm: RigSwarm, alarms: list[Alarm]) -> Status:
    """Return the status that the evidence allows: a map drawn from particles that did not move is
    not complete.
    """
    if swarm.moved and status is Status.COMPLETE and swarm.doubtful:
        alarms.append(Alarm("still", swarm.moves, _doubt(swarm)))
        return Status.ALARM
    if swarm.moved or status is Status.ALARM or not (status is Status.COMPLETE or swarm.still):
        return status
    alarms.append(_nothing_moved(swarm))
    return Status.ALARM


def _result(
    rig: Rig,
    swarm: RigSwarm,
    problem: SwarmProblem,
    alarms: list[Alarm],
    about: dict[str, Any],
    *,
    seed: int,
    spacing: tuple[float, ...] | None,
) -> Drive:
    trace: Trace = about["trace"]
    noisy = swarm if isinstance(swarm, NoisyRigSwarm) else None
    link: LinkCounts | None = getattr(rig, "counts", None)
    doubts = []
    if noisy is not None and swarm.moved and (swarm.doubtful or noisy.unshown):
        doubts.append(_doubt(swarm))
    elif noisy is None and swarm.unproven:
        text = (
            f"{swarm.unproven} {_cells_were(swarm.unproven)} classified by the last commands, at"
            " which nothing was seen to move"
        )
        doubts.append(text)
    if link is not None and link.doubled:
        text = (
            f"{count_text(link.doubled, 'answer')} came twice: the line doubles lines, or the rig"
            " carries out requests twice"
        )
        alarms.append(Alarm("twice", swarm.moves, text))
    episode = None
    if swarm.belief.open.inner.any():
        # Without noise, every particle moves in the map found exactly as it moved on the rig. With
        # noise, the scans are replayed.
        found = GridWorkspace(swarm.belief.open.inner, name=rig.name, spacing=spacing)
        episode = SwarmEpisode(
            problem=problem.replaced(
                map=found, start=tuple(map(tuple, swarm.start.tolist())) or None
            ),
            start=swarm.start,
            first_frontier=swarm.first_frontier,
            seed=seed,
            observations=(
                None if noisy is None else tuple(noisy.observations[: 1 + int(trace.scanned.sum())])
            ),
            **about,
        )
    return Drive(
        belief=swarm.belief,
        cells=swarm.state.cells,
        episode=episode,
        link=link,
        alarms=tuple(alarms),
        trust=trust_of(alarms, moved=swarm.moved, doubts=doubts),
        rates={} if noisy is None else noisy.monitor.rates(),
        seconds_per_command=(
            swarm.sending / swarm.moves
            if swarm.moves and not isinstance(rig, RecordedRig)
            else None
        ),
        seconds_per_scan=(
            swarm.scanning / swarm.scans
            if swarm.scans and not isinstance(rig, RecordedRig)
            else None
        ),
        **about,
    )


class _RecordedRuns:
    """Divides the commands of a log into runs: equal commands up to the next scan."""

    def __init__(self, rig: RecordedRig) -> None:
        self._rig, self._at = rig, 0

    @property
    def due(self) -> bool:
        """Whether the log contains a scan after the last run of commands."""
        return self._at in self._rig.scans

    def rest(self) -> Iterator[tuple[str, int]]:
        """Yield the runs that are left."""
        while (run := self._next()) is not None:
            yield run

    def next(self, view: View, state: SwarmState, idle: int) -> tuple[str, int] | None:
        """Return the command of the next run and the number of commands in the run. If no commands
        are left, return None.
        """
        return self._next()

    def _next(self) -> tuple[str, int] | None:
        commands, first = self._rig.commands, self._at
        if first == len(commands):
            return None
        self._at += 1
        while (
            self._rig.rule != "tilt"
            and self._at not in self._rig.scans
            and commands[self._at : self._at + 1] == commands[first]
        ):
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
    result = _driven(rig, rig.problem, seed=rig.seed, spacing=rig.spacing)
    ended = rig.ended
    if ended is None or ended["map"] is None:
        how = "breaks off" if ended is None else f"was {ended['status']}"
        if result.status is Status.LIMIT:  # the end of the log is not a limit set by a user
            episode = (
                None
                if result.episode is None
                else replace(result.episode, status=Status.INTERRUPTED)
            )
            result = replace(result, status=Status.INTERRUPTED, episode=episode)
        return result, Verification(
            True, f"{result.moves} moves replayed; the log {how} before the end of the run"
        )
    if (
        rig.problem.noise is None
        and ended["status"] != "alarm"
        and result.belief.complete != (ended["status"] == "complete")
    ):
        return result, Verification(
            False,
            f"status {ended['status']!r} in the log, {len(result.belief.frontier)} frontier cells"
            " left",
        )
    for name, value in ({"moves": result.moves} | map_digest(result.belief)).items():
        if ended[name] != value:
            return result, Verification(
                False, f"{name}: {ended[name]} in the log, {value} replayed"
            )
    return result, Verification(True, f"{result.moves} moves replayed: the same map")
