"""Drives that go on after an interruption: what the log tells, what the rig knows, and where the
particles are.
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.core.version import __version__
from shoal.rigs.checks import AlarmRaised
from shoal.rigs.log import DriveLog, RecordedRig
from shoal.rigs.remote import Resumption, session_of
from shoal.rigs.rig import PositionError, Rig
from shoal.rigs.tracking import RigSwarm
from shoal.swarm.grid.board import letters_of
from shoal.swarm.grid.scans import Recorder

FINISHED = ("complete", "stalled")


def check_resumable(past: RecordedRig, max_moves: int) -> None:
    """Refuse a log of another version of Shoal, or of a drive that cannot go on.

    Raises
    ------
    InvalidInputError
    """
    if past.version != __version__:
        raise InvalidInputError(
            f"{past.path}: expected a log of Shoal {__version__}, got one of {past.version}, which"
            " may have decided otherwise"
        )
    status = None if past.ended is None else past.ended["status"]
    if status == "alarm":
        raise InvalidInputError(
            f"{past.path}: expected a drive that was interrupted, got one that ended with an alarm:"
            " what its scans show contradicts its commands, so start a new drive"
        )
    if status == "limit" and len(past.commands) >= max_moves:
        raise InvalidInputError(
            f"{past.path}: expected --max-moves above {len(past.commands)}, as the drive ended at"
            f" its limit of moves, got {max_moves}"
        )


def is_finished(past: RecordedRig) -> bool:
    """Return whether the drive of a log has ended of its own accord, so that nothing is left."""
    return past.ended is not None and past.ended["status"] in FINISHED


def check_same_rig(rig: Rig, past: RecordedRig) -> None:
    """Refuse a rig that is not the rig of a log.

    Raises
    ------
    InvalidInputError
    """
    logged = (past.name, past.shape, past.rule)
    actual_values = (rig.name, tuple(rig.shape), rig.rule)
    for name, expected, actual in zip(
        ("name", "shape", "rule"), logged, actual_values, strict=True
    ):
        if expected != actual:
            raise InvalidInputError(
                f"{past.path}: expected the rig of the log, with the {name} {expected}, got"
                f" {actual}"
            )


def rebuild(rig: Any, past: RecordedRig) -> None:
    """Bring a simulated rig or a physical plant, which was made anew, to the state that the log
    tells: send it all commands, and compare each scan with that of the log.

    Parameters
    ----------
    rig : Rig
    past : RecordedRig

    Raises
    ------
    InvalidInputError
        Raised if a scan is another than in the log.
    """
    check_same_rig(rig, past)
    commands = past.commands + past.tail
    for move in range(len(commands) + 1):
        if move:
            rig.send(commands[move - 1])
        if move in past.scans:
            scan = np.array(past.scans[move], dtype=np.int64).reshape(-1, len(past.shape))
            if not np.array_equal(rig.observe(), scan):
                raise InvalidInputError(
                    f"{past.path}: expected a simulation that comes out as in the log, got other"
                    f" positions after move {move}: the map, the seed or a library is another"
                )
    rig.resumption = Resumption(goes_on=True, carried_out=True)


class _ScanOnlyRig:
    """A rig in the place of another that has carried out the commands already."""

    def __init__(self, rig: Rig, cells: NDArray[np.int64]) -> None:
        self.name, self.shape, self.rule, self._cells = rig.name, rig.shape, rig.rule, cells

    def send(self, command: str) -> None:
        """Do nothing, because the command was carried out before the interruption."""

    def observe(self) -> NDArray[np.int64]:
        """Return what the first scan after the interruption shows."""
        return self._cells

    def stop(self) -> None:
        """Do nothing."""


def go_on(
    rig: Any, swarm: RigSwarm, past: RecordedRig, log: DriveLog | None, recorder: Recorder
) -> None:
    """Find out what the commands after the last scan of a log have done, and where the particles
    are.

    If the session goes on, the rig knows whether it has carried out the last command of the log;
    if not, the command is sent again under its number. Then a scan shows what the commands since
    the last scan have done. In a new session, particles may be anywhere: if the commands do not
    explain the scan, or if nobody knows whether the last one was carried out, the belief takes the
    particles as placed anew, and learns nothing from these commands.

    Raises
    ------
    RigError, AlarmRaised, OutputError
    """
    session = session_of(rig)
    state = getattr(rig if session is None else session, "resumption", None)
    state = state or Resumption(False, None)
    event = log.event if log is not None else lambda _what, _details: None
    details: dict[str, Any] = {
        "move": swarm.moves,
        "goes_on": state.goes_on,
        "carried_out": state.carried_out,
    }
    if session is not None:
        details |= {"session": session.session, "seq": session.requests}
    event("resumed", details)
    swarm.rig = rig
    tail: str | None = past.tail
    last = ""
    if tail and state.carried_out is False:
        if state.goes_on:  # the same request, as if its answer had been lost
            _repeat(rig, event, swarm.moves + len(tail), tail[-1])
        else:
            tail, last = tail[:-1], tail[-1]
    if tail or state.lost_command or not state.goes_on:
        cells = swarm.observe()
        if state.lost_command:
            tail = _add_lost_command(swarm, past.tail, cells, log)
        certain = state.goes_on and not state.lost_command
        outcome_known = state.goes_on or state.carried_out is not None
        if (
            not outcome_known
            or tail is None
            or not _explain_scan(swarm, tail, cells, recorder, certain)
        ):
            since = swarm.moves
            for command in past.tail if tail is None else tail:
                recorder.add(command, swarm.skip(command, 1), scanned=False)
            if log is not None:
                log.scan(swarm.moves, cells, placed=True)
            swarm.place(cells, since=since)
    if last:
        _repeat(rig, event, swarm.moves + 1, last)
        _carry_out(swarm, last, 1, swarm.observe(), recorder)


def _repeat(rig: Any, event: Any, move: int, command: str) -> None:
    """Send the last command of the log, which was not carried out."""
    session = session_of(rig)
    number = {} if session is None else {"seq": session.requests + 1}
    event("repeated", {"move": move} | number)
    rig.send(command)


def _add_lost_command(
    swarm: RigSwarm, tail: str, cells: NDArray[np.int64], log: DriveLog | None
) -> str | None:
    """Return the commands after the last scan, with the one that the rig has carried out and the
    log has lost. Return None if the scan does not tell which it was.
    """
    if swarm.noisy is not None:
        return None
    swarm.log, candidates = None, []  # these are trials
    snapshot = _snapshot(swarm)
    for letter in letters_of(swarm.layout.ndim):
        if _explain_scan(swarm, tail + letter, cells, Recorder(), certain=False):
            candidates.append((letter, swarm.state != snapshot["state"]))
        _restore(swarm, snapshot)
    swarm.log = log
    if len(candidates) != 1 or not candidates[0][1]:
        return None
    letter = candidates[0][0]
    if log is not None:
        log.command(swarm.moves + len(tail) + 1, letter)
    return tail + letter


def _explain_scan(
    swarm: RigSwarm, tail: str, cells: NDArray[np.int64], recorder: Recorder, certain: bool
) -> bool:
    """Update the belief with a scan after commands that were carried out, and return true. If the
    commands do not explain the scan, leave everything as it is, and return false; if it is certain
    that nothing else has moved the particles, raise AlarmRaised.
    """
    if swarm.noisy is not None and not certain:
        return False
    if not tail:
        return bool(np.array_equal(cells, swarm.state.cells))
    snapshot, trial, runs = _snapshot(swarm), Recorder(), _runs(tail, swarm.rule)
    if not certain:  # the log must not hold a scan before it is clear what it means
        swarm.log = None
    try:
        for command, steps in runs[:-1]:
            rows = swarm.predict(command, steps)
            if rows is None:  # a scan is missing in between
                _restore(swarm, snapshot)
                return False
            swarm.moves += steps
            swarm.sent.append((command, steps, None))
            trial.add(command, rows, scanned=False)
        _carry_out(swarm, *runs[-1], cells, trial)
    except (AlarmRaised, PositionError):
        if certain:
            raise
        _restore(swarm, snapshot)
        return False
    swarm.log = snapshot["log"]
    if swarm.log is not None and not certain:
        swarm.log.scan(swarm.moves, cells)
    recorder.extend(trial)
    return True


def _snapshot(swarm: RigSwarm) -> dict[str, Any]:
    """Return the attributes of a swarm without noise, of which only lists and sets are changed in
    place.
    """
    return {name: _copy_container(value) for name, value in vars(swarm).items()}


def _copy_container(value: Any) -> Any:
    return copy.copy(value) if isinstance(value, list | set) else value


def _restore(swarm: RigSwarm, snapshot: dict[str, Any]) -> None:
    vars(swarm).clear()
    vars(swarm).update({name: _copy_container(value) for name, value in snapshot.items()})


def _carry_out(
    swarm: RigSwarm, command: str, steps: int, cells: NDArray[np.int64], recorder: Recorder
) -> None:
    """Take over a scan after commands that the rig has carried out already."""
    rig, swarm.rig = swarm.rig, _ScanOnlyRig(swarm.rig, cells)
    try:
        rows, scanned = swarm.carry_out(command, steps, scan=True)
    finally:
        swarm.rig = rig
    recorder.add(command, rows, scanned=scanned)


def _runs(commands: str, rule: str) -> list[tuple[str, int]]:
    """Divide commands into runs of equal ones; under the rule tilt, each is a run."""
    runs: list[tuple[str, int]] = []
    for command in commands:
        if runs and runs[-1][0] == command and rule != "tilt":
            runs[-1] = command, runs[-1][1] + 1
        else:
            runs.append((command, 1))
    return runs
