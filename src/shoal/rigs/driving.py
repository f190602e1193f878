"""Tasks of a swarm on a rig: run any policy on a rig, in the closed loop that simulations also use, and
replay logs.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import cache
from itertools import count
from math import ceil, e
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import (
    check_choice,
    check_function,
    check_integer,
    check_kind,
    count_text,
    shortened,
)
from shoal.core.dataclass import dataclass
from shoal.core.episode import Status, Verification
from shoal.core.errors import InvalidInputError, OutputError, RigError, ShoalError
from shoal.core.interruption import interruption_held
from shoal.rigs.checks import Alarm, AlarmRaised, Trust, trust_of
from shoal.rigs.log import DriveLog, RecordedRig, map_digest, read_log
from shoal.rigs.monitor import Rate, tail
from shoal.rigs.physics import TOLD
from shoal.rigs.remote import LinkCounts, session_of
from shoal.rigs.resume import check_resumable, check_same_rig, go_on, is_finished
from shoal.rigs.rig import LARGEST_VIEW, NoisyRig, PositionError, Rig, SimulatedRig
from shoal.rigs.suspects import MOVES, FirstMoves
from shoal.rigs.tracking import (
    ExactRigSwarm,
    ModelBroken,
    NoisyRigSwarm,
    OnRimError,
    RigSwarm,
    observe,
)
from shoal.swarm.episode import REASONS, SwarmEpisode
from shoal.swarm.goals import Goal
from shoal.swarm.grid.board import RULES, Board, letters_of, noise_rng, trial_rng
from shoal.swarm.grid.scans import Recorder, Trace, WithTrace
from shoal.swarm.grid.state import Belief, check_cells
from shoal.swarm.grid.tasks import Gathering, Mapping
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.noise import MOST, Noise
from shoal.swarm.policies import POLICIES, Manual
from shoal.swarm.problem import DRIVEN, SwarmProblem
from shoal.swarm.simulation.loop import OnMoves, closed_loop, make_decider

# rounds of test moves in all directions, after which a rig with noise is driven without a verdict
ROUNDS = 12
NOISY_CLOSING = 120  # the same on a rig with noise, where several scans establish a motion
LOOKS = 30  # scans that tell ghosts from more particles than expected
UNLIKELY = 1e-3  # probability of a first scan from which on the expected number cannot be true
CLOSING = 10  # commands at the end of a drive that may show that the rig still acts
EVERY = 50  # moves after which the observed error rates are compared with unstated ones
MOST_TRIALS = 60  # commands at the end of a drive that may show that the rig makes no errors


OnRest = Callable[[int, Callable[[str], None]], None]
"""Function that `drive` calls between two commands, with the number of moves made and a function that
sends one command.
"""


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
    task : str
        Name of the task.
    targets, visited : int or None
        Number of target cells, and how many of them scans surely showed particles in. None for a
        mapping.
    notes : tuple of str
        What the drive did of its own accord, such as to go on with noise, and what the rig's
        attribute ``notes`` says, in sentences.
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
    task: str
    targets: int | None
    visited: int | None
    notes: tuple[str, ...]
    seconds_per_command: float | None
    seconds_per_scan: float | None

    def __bool__(self) -> bool:
        return self.status.done

    @property
    def reason(self) -> str:
        """Return one sentence that explains the status of the run."""
        ending = "" if self else f"; {len(self.belief.frontier)} frontier cells left"
        failed = [alarm.text for alarm in self.alarms if alarm.kind in ("failure", "outside")]
        if self.status is Status.INTERRUPTED and failed:
            moves = count_text(self.moves, "move")
            return f"stopped by a failure of the rig after {moves}: {failed[0]}{ending}"
        if self.status is Status.ALARM:
            ending = f": {self.alarms[-1].text}" if self.alarms else ending
        return f"{REASONS[self.status]} after {count_text(self.moves, 'move')}{ending}"

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


class Convicted(AlarmRaised):
    """Raised if the first commands show what is wrong with the rig, which no errors explain."""


class RatesTooLow(AlarmRaised):
    """Raised if a rig, of which nobody has stated error rates, makes more errors than expected."""

    def __init__(self, low: dict[str, Rate], noise: Noise | None, move: int) -> None:
        seen = ", ".join(f"{name} {rate.observed:.3f}" for name, rate in low.items())
        super().__init__(Alarm("rates", move, f"more errors than expected are observed: {seen}"))
        raised = {name: min(MOST, round(1.2 * rate.observed, 3)) for name, rate in low.items()}
        self.rates = vars(noise) | raised


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
    log: DriveLog | str | os.PathLike[str] | None = None,
    on_moves: OnMoves | None = None,
    test_move: bool = True,
    spacing: tuple[float, ...] | None = None,
    particles: int | None = None,
    rule: str | None = None,
    known: GridWorkspace | None = None,
    inlet: tuple[int, ...] | None = None,
    exact: bool | None = None,
    resume: str | os.PathLike[str] | RecordedRig | None = None,
    on_rest: OnRest | None = None,
    **fields: Any,
) -> Drive:
    """Map the workspace of a rig, or carry out another task in it. The policy knows only the
    positions that the rig reports.

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
    log : DriveLog or path, optional
        Log of the run, or the path of a new log. Shoal writes each command and each scan to the log
        immediately.
    on_moves : callable, optional
        Function that `drive` calls during the run, with the number of moves made and the number of
        remaining frontier cells.
    test_move : bool
        Whether test moves may be sent. Without them, the commands of the policy show whether
        particles move. On a rig with noise, closing moves follow in any case if the policy's
        commands do not prove the map.
    spacing : tuple of float, optional
        Size of a cell along each axis in mm, for scale bars.
    particles, rule : int and str, optional
        The expected number of particles and the expected move rule. Another number in the first
        scan (with noise: fewer than chance allows, or more) and another rule are refused before
        the first command.
    known : GridWorkspace, optional
        A map that is known beforehand, as of an earlier drive. A task such as coverage needs one. A
        mapping begins with it as prior knowledge, and checks every cell of it.
    inlet : tuple of int, optional
        A cell at which particles may come in, so that a growing number is no reason for an alarm.
    exact : bool, optional
        Whether the rig makes no errors, so that the first contradiction ends the drive. By default,
        the answer of the attribute ``exact`` of the rig, if it has one, or else False: a drive
        without stated error rates then expects none until the first contradiction, and goes on with
        the usual rates (`shoal.rigs.physics.TOLD`) from there.
    resume : path or RecordedRig, optional
        Log of a drive that was interrupted and goes on, or what `read_log` has read from it. The
        log is replayed, and the drive goes on where the particles are now; ``log`` is the same log
        if it is not given. All settings are those of the log, except that ``max_moves`` may be
        larger. Open a rig behind a connection with ``open_rig(..., resume=read_log(LOG).session)``,
        so that it can tell whether it has carried out the last command. A drive that was finished
        is only replayed.
    on_rest : callable, optional
        Function that `drive` calls between two commands, when the rig is at rest, with the number
        of moves made and a function that sends one command. It may wait, and it may send commands,
        which belief and log follow. The policy then decides anew.
    **fields
        Fields of `SwarmProblem`, such as ``task``. The list `shoal.swarm.problem.DRIVEN` contains the fields of
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
    OutputError
        Raised if the log exists already, or cannot be written.
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
    check_function(on_moves, what="on_moves")
    check_function(on_rest, what="on_rest")
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
    if rule is not None and check_choice(rule, what="rule", choices=RULES) != rig.rule:
        raise InvalidInputError(f"rule: expected {rule}, got {rig.rule} from the rig {rig.name}")
    if particles is not None:
        check_integer(particles, what="particles", least=1)
    past = None
    if resume is not None:
        past = resume if isinstance(resume, RecordedRig) else read_log(resume)
        check_same_rig(rig, past)
        seed, problem = _resumed_settings(past, seed, fields)
        check_resumable(past, problem.max_moves)
        if is_finished(past):
            return replay_log(past)[0]
        test_move, spacing, known, cautious = (
            past.test_move,
            past.spacing,
            past.known,
            past.cautious,
        )
        log = DriveLog(past.path, append=True) if log is None else log
    else:
        problem, cautious = _state_problem(rig, known, exact, fields)
        if inlet is not None:
            inlet = tuple(check_cells([inlet], rig.shape, what="inlet", rim=0)[0].tolist())
    if isinstance(log, str | os.PathLike):
        log = DriveLog(log)
    elif log is not None and not isinstance(log, DriveLog):
        raise InvalidInputError(f"log: expected a DriveLog or a path, got {shortened(log)}")
    goal = _goal(problem, known, seed)
    load_drive_kernels(problem)
    options: dict[str, Any] = {
        "log": log,
        "on_moves": on_moves,
        "test_move": test_move,
        "spacing": spacing,
        "particles": particles,
        "cautious": cautious,
        "past": past,
        "inlet": inlet if past is None else past.inlet,
        "on_rest": on_rest,
    }
    return _Driver(rig, problem, goal, seed, **options).run()


def _state_problem(
    rig: Rig, known_map: GridWorkspace | None, exact: bool | None, fields: dict[str, Any]
) -> tuple[SwarmProblem, bool]:
    """Return the problem that the arguments of `drive` state, and whether the drive may go on with
    noise.
    """
    if known_map is not None and not isinstance(known_map, GridWorkspace):
        raise InvalidInputError(f"known: expected a GridWorkspace, got {shortened(known_map)}")
    if known_map is not None and known_map.shape != tuple(rig.shape):
        raise InvalidInputError(
            f"known: expected a map of shape {tuple(rig.shape)}, as the rig {rig.name} sees, got"
            f" {known_map.name} of shape {known_map.shape}"
        )
    problem = SwarmProblem("rig", rule=rig.rule, **fields)
    problem = _put_in_view(problem, tuple(rig.shape), known_map)
    problem.check_at_place()
    if exact and problem.noise is not None:
        raise InvalidInputError("exact: expected a rig without error rates, got error rates")
    unsure = not (getattr(rig, "exact", False) if exact is None else exact)
    if "confidence" in fields and problem.noise is None and not unsure:
        raise InvalidInputError(
            "confidence: expected a confidence only for a rig that makes errors, got"
            f" {problem.confidence:g}"
        )
    return problem, problem.noise is None and unsure


def _goal(problem: SwarmProblem, known_map: GridWorkspace | None, seed: int) -> Goal:
    """Return what a drive is to do. ``seed`` determines random target cells."""
    setup = problem.setup
    if isinstance(setup.task, Gathering):
        raise InvalidInputError(
            "task: expected mapping, coverage, subset-coverage or target on a rig, got gathering,"
            " for which no scan tells surely that no particle is elsewhere"
        )
    if known_map is None and not setup.mapping:
        raise InvalidInputError(
            f"known: expected a known map for the task {problem.task_name}, got none"
        )
    targets = None if known_map is None else setup.task.choose_targets(known_map, trial_rng(seed))
    return Goal(setup.task, known_map, targets)


def _resumed_settings(
    past: RecordedRig, seed: int, fields: dict[str, Any]
) -> tuple[int, SwarmProblem]:
    """Return the seed and the problem of a log, with a larger limit of moves if it is given.

    Raises
    ------
    InvalidInputError
        Raised if another argument contradicts the log, or if the log names a policy of others that
        is not given again: no file alone makes Shoal run code.
    """
    policy = past.problem.policy
    if "policy" not in fields and SwarmProblem.names_code("policy", policy) is not None:
        raise InvalidInputError(
            f"policy: expected policy={policy!r} beside the log {past.path}, as no file alone makes"
            " Shoal run code, got none"
        )
    problem = past.problem.replaced(**fields) if fields else past.problem
    logged_values = {"seed": past.seed} | {name: getattr(past.problem, name) for name in fields}
    requested_values = {"seed": seed or past.seed} | {
        name: getattr(problem, name) for name in fields
    }
    for name in logged_values:
        if name != "max_moves" and logged_values[name] != requested_values[name]:
            raise InvalidInputError(
                f"{name}: expected {logged_values[name]} as in {past.path}, got"
                f" {requested_values[name]}"
            )
    problem = _put_in_view(problem, past.shape, past.known)
    problem.check_at_place()
    return past.seed, problem


def replay_log(
    path: str | os.PathLike[str] | RecordedRig, *, trust: bool = False
) -> tuple[Drive, Verification]:
    """Replay the commands of a log, and compare the final map and the status with the log.

    Parameters
    ----------
    path : path or RecordedRig
        The log, or what `read_log` has read from it.
    trust : bool
        Whether Shoal may run a third-party task that the log names.

    Raises
    ------
    InvalidInputError
        Raised if the file is missing, damaged or not a log.
    RigError
        Raised if the recorded positions violate the move rule.
    """
    rig = path if isinstance(path, RecordedRig) else read_log(path, trust=trust)
    problem = _put_in_view(rig.problem, rig.shape, rig.known)
    options: dict[str, Any] = {"spacing": rig.spacing, "cautious": rig.cautious, "inlet": rig.inlet}
    result = _Driver(rig, problem, _goal(problem, rig.known, rig.seed), rig.seed, **options).run()
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
        and not rig.cautious
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


def load_drive_kernels(problem: SwarmProblem) -> None:
    """Load or compile the kernels that a drive needs, so that nobody waits for the compiler between
    two commands.

    Call the function before a rig is connected. It drives a simulated rig of six cells with the
    settings of the problem.
    """
    check_kind(problem, SwarmProblem, what="problem")
    builtin = isinstance(problem.policy, str) and (
        problem.policy == "auto" or problem.policy.partition(":")[0] in POLICIES
    )
    policy = (
        problem.policy
        if builtin and problem.policy.partition(":")[0] != Manual.kind
        else "closest-frontier"
    )
    fields = {
        name: getattr(problem, name)
        for name in DRIVEN
        if name not in ("policy", "max_moves", "task", "subset", "target")
    }
    fields |= {
        name: 1.0
        for name in ("budget", "time_per_move")
        if fields[name] is not None and policy == problem.policy
    }
    if policy != problem.policy:
        fields |= {"budget": None, "time_per_move": None}
    task = "mapping" if problem.task_name == "mapping" else "coverage"
    for rule in RULES if problem.rule == "block" and problem.noise is None else (problem.rule,):
        # the policy does not support the rule or the task, as the drive itself will say
        with suppress(InvalidInputError):
            _prepare(rule, policy, task, tuple(fields.items()))
    if problem.noise is None:  # with which the drive may go on
        fields |= TOLD | ({} if isinstance(problem.scan_every, int) else {"scan_every": 1})
        with suppress(InvalidInputError):
            _prepare("block", policy, task, tuple(fields.items()))


@cache
def _prepare(rule: str, policy: str, task: str, fields: tuple[tuple[str, Any], ...]) -> None:
    workspace = GridWorkspace(np.array([[1, 1, 1], [1, 0, 1]], dtype=np.bool_))
    options: dict[str, Any] = dict(fields) | {"max_moves": 40}
    problem = SwarmProblem("rig", rule=rule, policy=policy, task=task, **options)
    known_map = None if task == "mapping" else workspace
    problem = _put_in_view(problem, workspace.shape, known_map)
    problem.check_at_place()
    rig: Rig = SimulatedRig(workspace, [(0, 0)], rule=rule)
    if problem.noise is not None:
        rig = NoisyRig(workspace, [(0, 0)], problem.noise, noise_rng(0))
    _Driver(rig, problem, _goal(problem, known_map, 0), 0).run()


def _put_in_view(
    problem: SwarmProblem, shape: tuple[int, ...], known_map: GridWorkspace | None
) -> SwarmProblem:
    """Return the problem in the field of view of a rig, of which only the size is known, or a
    map.
    """
    return problem.at_place(known_map or GridWorkspace(np.ones(shape, dtype=np.bool_), name="rig"))


class _TakenOver(Exception):  # noqa: N818 - it is no error
    """Raised if somebody has sent commands while the rig was at rest."""


@dataclass(eq=False)
class _Driver:
    """Runs a policy, or the commands of a log, on a rig, and puts the result together."""

    rig: Rig
    problem: SwarmProblem
    goal: Goal
    seed: int
    log: DriveLog | None = None
    on_moves: OnMoves | None = None
    test_move: bool = True
    spacing: tuple[float, ...] | None = None
    particles: int | None = None  # expected
    inlet: tuple[int, ...] | None = None
    cautious: bool = False  # goes on with noise after the first contradiction
    past: RecordedRig | None = None  # of a drive that goes on
    on_rest: OnRest | None = None

    def __post_init__(self) -> None:
        self.recorded = self.rig if isinstance(self.rig, RecordedRig) else None
        self.tests = self.test_move and not (
            self.recorded or isinstance(self.problem.setup.policy, Manual)
        )
        if self.recorded is None:
            self.policy = self.problem.setup.policy_name
            self.most = self.problem.max_moves
        else:
            self.policy, self.most = self.recorded.policy, len(self.recorded.commands)
        self.recorder = Recorder()
        source = self.recorded or self.past
        self.runs = None if source is None else _RecordedRuns(source)
        self.was_complete = False  # in the replay of a log
        self.alarms: list[Alarm] = []
        self.convicted = self.usual = False  # usual: nobody has stated the error rates
        self.notes: list[str] = []
        self.first_moves: FirstMoves | None = None  # during the first moves, if they are tested
        self.watched = 0  # commands that it has taken into account
        self.swarm: RigSwarm  # since the first scan

    def run(self) -> Drive:
        """Drive the rig, and stop it whatever happens. Return the result, or raise an error that
        holds it.
        """
        began, status = time.perf_counter(), Status.INTERRUPTED
        failure: BaseException | None = None
        try:
            self._begin()
            status = self._explore()
        except AlarmRaised as raised:
            self.alarms, status = [raised.alarm], Status.ALARM
            self.convicted = isinstance(raised, Convicted)
        except BaseException as error:  # goes on after the stop, with what was found until then
            failure = error
        failure = self._stop_rig(failure)
        if not hasattr(self, "swarm"):
            assert failure is not None
            raise failure
        if failure is None:
            status = self._judge(status)
        elif not isinstance(failure, KeyboardInterrupt):
            kind = "outside" if isinstance(failure, PositionError) else "failure"
            self.alarms.insert(0, Alarm(kind, self.swarm.moves, _text_of(failure)))
        if not self.convicted:  # what is wrong with the rig explains more than marks could
            self.alarms += self.swarm.marks(quick=isinstance(failure, KeyboardInterrupt))
        if self.swarm.moved:  # walls are inferred from particles that did not move
            self.alarms += self.swarm.wrong_map()
        failure = self._close_log(status, failure)
        result = self._result(status, time.perf_counter() - began)
        if failure is None:
            return result
        if isinstance(failure, KeyboardInterrupt):
            raise DriveInterrupted(result) from failure
        if isinstance(failure, RigError):
            raise DriveError(str(failure), result) from failure
        if isinstance(failure, Exception) and not isinstance(failure, ShoalError):
            raise DriveError(f"{self.rig.name}: {_text_of(failure)}", result) from failure
        failure.drive = result  # type: ignore[attr-defined]  # its catchers know its type
        raise failure

    def _begin(self) -> None:
        """Scan the particles for the first time, and begin the log."""
        source = self.rig if self.past is None else self.past
        began = time.perf_counter()
        first_scan = observe(source, 0)
        scanning = time.perf_counter() - began
        # particles may come in later
        if self.particles is not None and self.past is None and self.inlet is None:
            noise = self.problem.noise or (Noise(**TOLD) if self.cautious else None)
            seen = len(first_scan)
            for _ in range(LOOKS):  # a ghost is not in every picture
                if noise is None or seen <= self.particles:
                    break
                seen = min(seen, len(observe(source, 0)))
            check_number_seen(self.rig, self.particles, seen, noise)
        swarm = self._make_swarm(first_scan)
        swarm.rig, swarm.scanning, swarm.scans = source, scanning, 1
        swarm.most_seen = len(first_scan)
        expects = self.cautious or self.problem.noise is not None
        if self.tests and expects and self.rig.rule != "tilt":
            noise = self.problem.noise or Noise(**TOLD)
            self.first_moves = FirstMoves(
                self.rig.shape, first_scan, noise, self.goal, rule=self.rig.rule
            )
        if self.log is not None and self.past is not None:
            self.log.go_on(self.rig, self.past)
            swarm.log = self.log
        elif self.log is not None:
            self.log.begin(
                self.rig,
                policy=self.policy,
                seed=self.seed,
                problem=self.header,
                spacing=self.spacing,
                test_move=self.test_move,
                known=self.goal.known,
                inlet=self.inlet,
                cautious=self.cautious,
            )
            self.log.scan(0, first_scan)
            swarm.log = self.log
        self.swarm = swarm

    def _make_swarm(self, first_scan: NDArray[np.int64]) -> RigSwarm:
        self.header = self.problem.to_dict()
        if self.problem.noise is None:
            try:
                return ExactRigSwarm(self.rig, self.goal, first_scan, inlet=self.inlet)
            except (AlarmRaised, OnRimError) as raised:
                if not self._may_expect_noise(raised):
                    raise
                self._expect_noise(raised)
        assert self.problem.noise is not None
        noise, confidence = self.problem.noise, self.problem.confidence
        swarm = NoisyRigSwarm(self.rig, self.goal, first_scan, noise, confidence, inlet=self.inlet)
        swarm.usual = self.usual
        return swarm

    def _may_expect_noise(self, raised: Exception) -> bool:
        """Return whether the drive may go on with noise, or with more noise, after a
        contradiction.
        """
        if isinstance(raised, RatesTooLow):
            return True
        return (
            not isinstance(raised, Convicted)
            and self.problem.noise is None
            and self.problem.rule != "tilt"
            and (isinstance(self.goal.task, Mapping) or not self.goal.mapping)
            and (self.cautious or isinstance(raised, ModelBroken))
        )

    def _expect_noise(self, raised: Exception) -> None:
        """From now on, expect the usual errors of a rig."""
        every = self.problem.scan_every if isinstance(self.problem.scan_every, int) else 1
        place = self.problem.place
        expected = raised.rates if isinstance(raised, RatesTooLow) else TOLD
        self.problem = self.problem.replaced(**expected, scan_every=every).at_place(place)
        self.usual = True
        rates = ", ".join(f"--{name} {rate:g}" for name, rate in expected.items())
        why = (
            f"move {self.swarm.moves}: {raised.alarm.text}"
            if isinstance(raised, AlarmRaised) and raised.alarm.kind == "rates"
            else raised.alarm.text
            if isinstance(raised, ModelBroken)
            else f"move {self.swarm.moves if hasattr(self, 'swarm') else 0}: the positions do not"
            " follow from the commands if the rig makes no errors"
        )
        self.notes.append(f"{why}; the drive goes on and expects errors: {rates}")
        if self.log is not None and hasattr(self, "swarm") and self.swarm.rig is self.rig:
            self.log.event("noise", {"move": self.swarm.moves, "text": self.notes[-1]})

    def _go_on_with_noise(self, raised: Exception) -> None:
        """Begin a belief with noise, and take over all commands and scans so far."""
        self._expect_noise(raised)
        old, swarm = self.swarm, self._make_swarm(self.swarm.first_scan)
        swarm.sending, swarm.scanning, swarm.scans = old.sending, old.scanning, old.scans
        swarm.rig, swarm.log, self.swarm, self.recorder = old.rig, old.log, swarm, Recorder()
        placed, self.was_complete = list(old.placed), False
        for sent in (*old.sent, None):
            while placed and placed[0].move == swarm.moves:
                swarm.place(placed[0].cells, since=placed.pop(0).since)
            if sent is not None:
                rows, scanned = swarm.repeat(sent)
                self.recorder.add(sent[0], rows, scanned=scanned)
        self._check()

    def _explore(self) -> Status:
        """Carry out the task. After a contradiction that errors of the rig may explain, go on with
        noise. Return the status.
        """
        raised: AlarmRaised | OnRimError | None = None
        while True:
            try:
                if raised is not None:
                    self._go_on_with_noise(raised)
                return self._try_to_explore()
            except (AlarmRaised, OnRimError) as error:
                if not self._may_expect_noise(error):
                    raise
                raised = error

    def _try_to_explore(self) -> Status:
        """Test the rig, run the policy, and test the rig again if its last commands moved nothing.
        Return the status.
        """
        if self.runs is not None:
            status = self._replay(self.runs)
            if self.past is None:
                return self._end_status(status)
            if self.swarm.rig is self.past:
                go_on(self.rig, self.swarm, self.past, self.log, self.recorder)
                self._check()
        if self.tests:
            self._test_rig()
        swarm = self.swarm
        # after an interruption, a policy with random decisions draws others
        rng = trial_rng(self.seed, 0 if self.past is None else 1 + swarm.moves)
        self._make_decider(rng)
        for _ in range(CLOSING):
            status = self._follow(rng)
            if status is Status.COMPLETE and (self.tests or swarm.doubtful):
                self._prove_walls()
            if status is Status.COMPLETE:
                self._prove_exactness()
            if status is not Status.COMPLETE or swarm.finished:
                break
        return self._end_status(status)

    def _prove_exactness(self) -> None:
        """Send commands that must move particles, until the drive has shown that the rig makes
        fewer errors than the confidence allows.

        If a rig makes an error at a command with the probability s, n commands that must move
        particles show no error with the probability (1 - s)^n. A wrong wall in a drive without any
        contradiction has therefore at most the probability s (1 - s)^n, which is below 1 / (e (n +
        1)) for every s.
        """
        swarm = self.swarm
        if not self.cautious or not isinstance(swarm, ExactRigSwarm) or not self.goal.mapping:
            return
        needed = ceil(1 / (e * (1 - self.problem.confidence))) - 1
        for _ in range(min(MOST_TRIALS, needed - swarm.trials)):
            command = swarm.command_that_moves()
            if command is None or self.recorder.moves >= self.most:
                break
            self._send(command)
        if swarm.trials < needed:
            text = (
                f"{count_text(swarm.trials, 'command')} without an error are too few for the"
                f" confidence {self.problem.confidence:g}"
            )
            raise AlarmRaised(Alarm("rates", swarm.moves, text))

    def _follow(self, rng: np.random.Generator) -> Status:
        """Run the policy. Whenever somebody has sent commands, it decides anew."""
        while True:
            try:
                _, status = closed_loop(
                    self.swarm,
                    self.decider,
                    max_moves=self.most,
                    mapping=self.goal.mapping,
                    on_moves=lambda _moves, _frontier: self._pause(in_loop=True),
                    on_trace=lambda _trace: self._check(),
                    recorder=self.recorder,
                )
            except _TakenOver:
                self._make_decider(rng)
            else:
                return status

    def _make_decider(self, rng: np.random.Generator) -> None:
        swarm = self.swarm
        self.decider = make_decider(self.problem.setup, swarm.belief, rng, swarm.noisy)

    def _pause(self, *, in_loop: bool = False) -> None:
        """Tell of the moves made, and let others wait or send commands while the rig is at rest."""
        moves = self.recorder.moves
        if self.on_moves is not None:
            self.on_moves(moves, len(self.swarm.belief.frontier))
        if self.on_rest is not None:
            self.on_rest(moves, self._send_for_others)
        if in_loop and self.recorder.moves > moves:
            raise _TakenOver

    def _send_for_others(self, command: str) -> None:
        check_choice(command, what="command", choices=letters_of(self.swarm.layout.ndim))
        self._tell_log("manual", {"move": self.recorder.moves + 1})
        self._carry_out(command, 1, scan=True)

    def _end_status(self, status: Status) -> Status:
        complete = status is Status.COMPLETE
        return Status.STALLED if complete and not self.swarm.finished else status

    def _replay(self, runs: _RecordedRuns) -> Status:
        """Carry out the commands of a log, of which some may be carried out already."""
        if not self.swarm.moves:
            self._replay_placement(runs.rig)
        for command, steps in runs.remaining():
            self._note_completion()
            if runs.outcome_unknown:
                for _ in range(steps):
                    runs.rig.send(command)
                self.recorder.add(command, self.swarm.skip(command, steps), scanned=False)
            else:
                self._carry_out(command, steps, scan=runs.scan_due)
            self._replay_placement(runs.rig)
        self._note_completion()
        return Status.COMPLETE if self.was_complete else Status.LIMIT

    def _note_completion(self) -> None:
        # the moves after the completion show that the rig acts
        swarm = self.swarm
        self.was_complete = self.was_complete or (swarm.belief.complete and swarm.finished)

    def _replay_placement(self, recorded: RecordedRig) -> None:
        """Take over the scans that showed particles elsewhere when the drive went on."""
        move = self.swarm.moves
        for cells in recorded.placed.get(move, ()):
            positions = np.array(cells, dtype=np.int64).reshape(-1, len(recorded.shape))
            scanned_moves = (0, *recorded.scans, *(at for at in recorded.placed if at < move))
            self.swarm.place(positions, since=max(at for at in scanned_moves if at <= move))

    def _test_rig(self) -> None:
        """Send commands in all directions in turn until it is clear whether they move particles."""
        while self.first_moves is not None and self.recorder.moves < self.most:
            command = self.first_moves.next()
            if command is None:
                break
            self._send(command)
        letters = letters_of(self.swarm.layout.ndim)
        for turn in range(ROUNDS * len(letters)):
            if self.swarm.still is not None or self.recorder.moves >= self.most:
                break
            self._send(letters[turn % len(letters)])
        if self.swarm.still:
            raise AlarmRaised(self._nothing_moved())

    def _prove_walls(self) -> None:
        """Send commands that must move particles, as long as walls rest on commands at which
        nothing was seen to move.

        Under noise no scan proves anything by itself, so that several commands may be necessary.
        """
        for _ in range(NOISY_CLOSING if self.swarm.doubtful else CLOSING):
            if not self.swarm.needs_proof or self.recorder.moves >= self.most:
                break
            command = self.swarm.command_that_moves()
            if command is None:
                break
            self._send(command)

    def _send(self, command: str) -> None:
        self._carry_out(command, 1, scan=True)
        self._pause()

    def _carry_out(self, command: str, steps: int, *, scan: bool) -> None:
        rows, scanned = self.swarm.carry_out(command, steps, scan=scan)
        self.recorder.add(command, rows, scanned=scanned)
        self._check()

    def _check(self) -> None:
        """Raise an alarm if the scans so far contradict the commands."""
        test = self.first_moves
        for command, steps, cells in self.swarm.sent[self.watched :] if test else ():
            self.watched += 1
            if steps > 1 or cells is None or self.watched > MOVES:
                self.first_moves = test = None
                break
            assert test is not None
            test.update(command, cells)
            alarm = test.alarm(self.watched)
            if alarm is not None:
                raise Convicted(alarm)
        if test is not None and test.cycle:
            return  # the test says more exactly what is wrong
        self.swarm.check()
        if self.runs is not None and self.problem.noise is None:
            for event in self.runs.rig.events:
                if event["event"] == "noise" and event.get("move") == self.swarm.moves:
                    raise AlarmRaised(Alarm("rates", self.swarm.moves, event.get("text", "")))
        if self.usual and self.swarm.moves % EVERY == 0:
            low = {name: rate for name, rate in self.swarm.rates().items() if rate.too_low}
            if low:
                raise RatesTooLow(low, self.problem.noise, self.swarm.moves)
        if self.cautious and self.problem.noise is None and not self.goal.mapping:
            for wrong in self.swarm.wrong_map():  # or a particle has slipped
                raise AlarmRaised(wrong)

    def _stop_rig(self, failure: BaseException | None) -> BaseException | None:
        """Stop the rig. Return the failure that ended the drive, or Ctrl-C during the stop."""
        try:
            with interruption_held():
                self._tell_log("stop", {})
                self.rig.stop()
                interrupted = failure is not None and not isinstance(failure, Exception)
                if interrupted and (session := session_of(self.rig)) is not None:
                    self._tell_log("stopped", {"seq": session.carried_out()})
        except KeyboardInterrupt as error:
            return failure or error
        except BaseException as error:  # whatever a rig of others raises: the map must not be lost
            text = f"the rig may still move, as its stop failed: {_text_of(error)}"
            self.alarms.append(Alarm("stop", self.recorder.moves, text))
        return failure

    def _tell_log(self, event: str, details: dict[str, Any]) -> None:
        """Write an event to the log. A full disk must not keep the rig from being stopped."""
        if self.log is not None and self.recorded is None:
            with suppress(OutputError):
                self.log.event(event, details)

    def _nothing_moved(self) -> Alarm:
        text = (
            f"no particle moved at {count_text(self.swarm.moves, 'command')}: the magnets do"
            " nothing, the camera shows an old picture, or no particle has room to move"
        )
        return Alarm("still", self.swarm.moves, text)

    def _judge(self, status: Status) -> Status:
        """Return the status that the evidence allows: a map drawn from particles that did not move
        is not complete.
        """
        swarm = self.swarm
        if status is Status.STALLED and swarm.unvisited and not swarm.belief.frontier:
            if not swarm.moved:
                self.alarms.append(self._nothing_moved())
            return Status.ALARM  # else the known map is wrong, as the alarm says
        if not self.goal.mapping and status is Status.COMPLETE:
            return status  # scans showed particles in all target cells, whatever moved them
        if swarm.moved and status is Status.COMPLETE and swarm.doubtful:
            self.alarms.append(Alarm("still", swarm.moves, swarm.doubts()[0]))
            return Status.ALARM
        if swarm.moved or status is Status.ALARM:
            return status
        if status is Status.COMPLETE or swarm.still:
            self.alarms.append(self._nothing_moved())
            return Status.ALARM
        return status

    def _close_log(self, status: Status, failure: BaseException | None) -> BaseException | None:
        """Write alarms and the end to the log, even if the rig did not confirm the stop. Return the
        failure that ended the drive, or that of the log.
        """
        if self.log is None:
            return failure
        try:
            if not isinstance(failure, OutputError):
                for alarm in self.alarms:
                    details = {"alarm": alarm.kind, "move": alarm.move, "text": alarm.text}
                    self.log.event("alarm", details)
            digest = {"moves": self.recorder.moves} | map_digest(self.swarm.observed_map)
            self.log.end(status, {} if status is Status.INTERRUPTED else digest)
        except BaseException as error:  # a full disk, or a second Ctrl-C
            return failure or error
        return failure

    def _result(self, status: Status, seconds: float) -> Drive:
        swarm = self.swarm
        link: LinkCounts | None = getattr(self.rig, "counts", None)
        if link is not None and link.doubled:
            text = (
                f"{count_text(link.doubled, 'answer')} came twice: the line doubles lines, or the"
                " rig carries out requests twice"
            )
            self.alarms.append(Alarm("twice", swarm.moves, text))
        fields: dict[str, Any] = {
            "trace": self.recorder.trace,
            "status": status,
            "policy": self.policy,
            "seconds": seconds,
        }
        timed = self.recorded is None
        targets = self.goal.targets
        n_targets = None if targets is None else int(targets.sum())
        remaining = len(swarm.belief.frontier) + len(swarm.unvisited)
        before = 0 if self.past is None else len(self.past.commands)
        sent, scans = swarm.moves - before, swarm.scans
        if self.past is not None:
            scans -= len(self.past.scans)
        return Drive(
            belief=swarm.observed_map,
            cells=swarm.state.cells,
            episode=self._episode(fields),
            link=link,
            alarms=tuple(self.alarms),
            trust=trust_of(self.alarms, moved=swarm.moved, doubts=swarm.doubts()),
            rates=swarm.rates(),
            task=self.problem.task_name,
            targets=n_targets,
            visited=None if n_targets is None else n_targets - remaining,
            notes=(*self.notes, *self._missing_notes(), *getattr(self.rig, "notes", ())),
            seconds_per_command=swarm.sending / sent if timed and sent > 0 else None,
            seconds_per_scan=swarm.scanning / scans if timed and scans > 0 else None,
            **fields,
        )

    def _missing_notes(self) -> list[str]:
        """Return a sentence about expected particles that no scan has shown, or none if that is
        chance.
        """
        swarm, expected = self.swarm, self.particles
        if expected is None or self.inlet is not None or self.rig.rule == "merge":
            return []
        noise = self.problem.noise or (Noise(**TOLD) if self.cautious else None)
        unseen = tail(expected - swarm.most_seen, expected, _hidden_share(noise))
        if swarm.most_seen >= expected or unseen**swarm.scans >= UNLIKELY:
            return []
        return [
            f"{count_text(expected, 'particle')} were expected, and no scan of {swarm.scans} shows"
            f" more than {swarm.most_seen}"
        ]

    def _episode(self, fields: dict[str, Any]) -> SwarmEpisode | None:
        """Return the run as an episode in the map found, or None if no cell is known to be free.

        Without noise, every particle moves in the map found exactly as it moved on the rig. With
        noise, the scans are replayed.
        """
        swarm, goal = self.swarm, self.goal
        free = swarm.observed_map.open.inner
        if not free.any():
            return None
        start = tuple(map(tuple, swarm.start.tolist())) or None
        fields = fields | {"start": swarm.start, "seed": self.seed, "targets": goal.targets}
        fields |= {"first_frontier": swarm.first_frontier, "placed": tuple(swarm.placed)}
        workspace = GridWorkspace(free, name=self.rig.name, spacing=self.spacing)
        if swarm.observations is not None:
            scans = tuple(swarm.observations[: 1 + int(fields["trace"].scanned.sum())])
            problem = (
                self.problem.replaced(map=workspace, start=start)
                # noise excludes other tasks and rules on maps, but not on rigs
                if goal.mapping and swarm.rule == "block"
                else self.problem.at_place(workspace)
            )
            return SwarmEpisode(problem=problem, observations=scans, goal=goal, **fields)
        problem = self.problem.replaced(map=workspace, start=start)
        if (
            goal.targets is not None
            and goal.known is not None
            and not np.array_equal(free, goal.known.free)
        ):
            # the episode takes place in the map as it turned out to be, in which walls may cut off
            # target cells
            parts = workspace.components
            fields["targets"] = goal.targets & free & np.isin(parts, parts[tuple(swarm.start.T)])
            episode = SwarmEpisode(problem=problem, **fields)
            end = episode.replay.end
            return replace(episode, trace=end.trace, first_frontier=end.first_frontier)
        return SwarmEpisode(problem=problem, **fields)


def _hidden_share(noise: Noise | None) -> float:
    """Return the probability that a scan does not show a particle, or shows it elsewhere, where it
    may fall on another.
    """
    return 0.0 if noise is None else noise.miss + (1 - noise.miss) * noise.misplace


def check_number_seen(rig: Rig, expected: int, seen: int, noise: Noise | None) -> None:
    """Refuse a rig whose first scan shows another number of particles than expected.

    With noise, a rig may show ghosts, so that the driver looks several times and takes the smallest
    number: it must not exceed that of the particles. A scan shows fewer if particles are
    missed, or if a misplaced one falls on another: the probability of the number seen or of fewer
    must not be below `UNLIKELY`.
    """
    hidden = _hidden_share(noise)
    if seen > expected or tail(expected - seen, expected, hidden) < UNLIKELY:
        chance = "" if not hidden or seen > expected else ", too few for the stated noise"
        raise InvalidInputError(
            f"particles: expected {expected}, got {seen} in the first scan of the rig"
            f" {rig.name}{chance}"
        )


def _text_of(error: BaseException) -> str:
    """Return the text of an error; of an error that is not Shoal's also the type, because its text
    may say nothing alone.
    """
    return str(error) if isinstance(error, ShoalError) else f"{type(error).__name__}: {error}"


class _RecordedRuns:
    """Divides the commands of a log into runs: equal commands up to the next scan."""

    def __init__(self, rig: RecordedRig) -> None:
        self.rig, self._at = rig, 0
        self._last_placed = max(rig.placed, default=-1)

    @property
    def scan_due(self) -> bool:
        """Whether the log contains a scan after the last run of commands."""
        return self._at in self.rig.scans

    @property
    def outcome_unknown(self) -> bool:
        """Whether nobody knows what the last run of commands has done: particles were placed before
        the next scan.
        """
        if self._at > self._last_placed:
            return False
        scans, placed = self.rig.scans, self.rig.placed
        return next(at for at in count(self._at) if at in scans or at in placed) not in scans

    def remaining(self) -> Iterator[tuple[str, int]]:
        """Yield the runs that are left."""
        while (run := self._next()) is not None:
            yield run

    def _next(self) -> tuple[str, int] | None:
        commands, first = self.rig.commands, self._at
        if first == len(commands):
            return None
        self._at += 1
        while (
            self.rig.rule != "tilt"
            and self._at not in self.rig.scans
            and self._at not in self.rig.placed
            and commands[self._at : self._at + 1] == commands[first]
        ):
            self._at += 1
        return commands[first], self._at - first
