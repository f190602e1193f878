"""The log of a run on a rig: a file of JSON lines, written during the run. The function
`replay_log` replays a log.
"""

from __future__ import annotations

import json
import os
import time
import zlib
from contextlib import suppress
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, NonNegativeInt, TypeAdapter, ValidationError

from shoal.core.checks import as_path, check_file, parse_json, validation_message
from shoal.core.dataclass import dataclass
from shoal.core.episode import Status
from shoal.core.errors import InvalidInputError, OutputError, RigError, errors_at
from shoal.core.version import __version__
from shoal.rigs.remote import LoggedSession, session_of
from shoal.rigs.rig import LARGEST_VIEW
from shoal.swarm.grid.board import letters_of
from shoal.swarm.grid.state import Belief, check_cells
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.problem import SwarmProblem

FORMAT: Literal[1] = 1
LARGEST_LOG = 2**31  # bytes


class DriveLog:
    """A log file that is written line by line. A crash of the process loses no recorded line.

    The log file is created when the rig reports its first positions.

    Parameters
    ----------
    path : path
    options : dict, optional
        What else the header must hold for a drive that goes on: options of the command ``shoal
        drive`` by name.
    append : bool
        Whether the log exists and belongs to a drive that goes on.
    make_folder : bool
        Whether to make the folder of the log, together with the log, if it does not exist.

    Raises
    ------
    OutputError
        Raised if the log file already exists, or if Shoal cannot write the file.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        options: dict[str, Any] | None = None,
        append: bool = False,
        make_folder: bool = False,
    ) -> None:
        self.path = as_path(path, what="log")
        self.options, self._make_folder = options, make_folder
        if self.path.exists() and not append:
            raise OutputError(
                f"cannot write {self.path}: the file exists already, and a log is never overwritten"
            )
        if not make_folder and not self.path.absolute().parent.is_dir():
            raise OutputError(
                f"cannot write {self.path}: the folder {self.path.parent} does not exist"
            )
        self._file: Any = None
        self._rig: Any = None
        self._began = 0.0
        self._waiting: list[dict[str, Any]] = []
        self.pictures: Path | None = None  # folder for the picture of each scan, if it is kept
        self.moves = self.scans = 0  # of an earlier part of the drive, which are not logged again

    def begin(
        self,
        rig: Any,
        *,
        policy: str,
        seed: int,
        problem: dict[str, Any],
        spacing: Any = None,
        test_move: bool = True,
        known: GridWorkspace | None = None,
        inlet: tuple[int, ...] | None = None,
        cautious: bool = False,
    ) -> None:
        """Write the header of the log: name and shape of the rig, the policy, the seed, the fields
        of the problem, the size of a cell along each axis in mm, the map that was known beforehand,
        whether the drive may go on with noise, and what a drive that goes on needs: the session of
        a rig behind a connection, and the options.
        """
        try:
            if self._make_folder:
                self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self.path.open("x", encoding="utf-8", buffering=1)
            _lock(self._file)
        except OSError as error:
            raise OutputError(f"cannot write {self.path}: {error.strerror or error}") from None
        self._began, self._rig = time.monotonic(), rig
        header = {"kind": "header", "log": "shoal-drive", "format": FORMAT, "version": __version__}
        header |= {
            "rig": rig.name,
            "shape": list(rig.shape),
            "policy": policy,
            "seed": seed,
            "problem": problem,
        }
        header |= {} if spacing is None else {"spacing": list(spacing)}
        header |= {} if test_move else {"test_move": False}
        session = session_of(rig)
        header |= {} if session is None else {"session": session.session}
        header |= {} if self.options is None else {"options": self.options}
        header |= {} if known is None else {"known": known.to_dict()}
        header |= {} if inlet is None else {"inlet": list(inlet)}
        header |= {"cautious": True} if cautious else {}
        self._write(header)
        for entry in self._waiting:
            self._write(entry)

    def go_on(self, rig: Any, past: RecordedRig) -> None:
        """Open the log for a drive that goes on: the same file, or a new one that begins with what
        the log of the drive so far holds. A line that a power failure has cut short is removed.
        """
        lines = past.path.read_bytes()
        whole = lines[: lines.rfind(b"\n") + 1]
        try:
            if not self.path.exists():
                self.path.write_bytes(whole)
            self._file = self.path.open("a", encoding="utf-8", buffering=1)
            _lock(self._file)
            self._file.truncate(len(whole))
        except OSError as error:
            raise OutputError(f"cannot write {self.path}: {error.strerror or error}") from None
        self._rig, self._began = rig, time.monotonic() - past.lasted
        for entry in self._waiting:
            self._write(entry)
        self.moves, self.scans = len(past.commands) + len(past.tail), max(past.scans) + 1

    def command(self, move: int, command: str) -> None:
        """Record a command just before it is sent."""
        if move > self.moves:
            entry = {"kind": "command", "move": move, "command": command}
            self._write(entry | self._request(1) | {"time": self._time()})

    def scan(self, move: int, cells: NDArray[np.int64], *, placed: bool = False) -> None:
        """Record the cells in which a scan showed particles, and the values that the rig reports in
        its attribute ``values``, such as currents. ``placed`` is true if the particles are
        elsewhere than the commands would have them, as the drive was interrupted.
        """
        if move >= self.scans or placed:
            entry = {"kind": "scan", "move": move, "cells": cells.tolist()}
            entry |= {"placed": True} if placed else {}
            values = getattr(self._rig, "values", None)
            entry |= {"values": dict(values)} if values else {}
            true = getattr(self._rig, "true_cells", None)
            entry |= {"true": np.round(true, 3).tolist()} if true is not None else {}
            self._write(entry | self._request(0) | {"time": self._time()})
            self._keep_picture(move)

    def _keep_picture(self, move: int) -> None:
        """Keep what the camera of a rig shows, in the folder `pictures`."""
        show = getattr(getattr(self._rig, "sensor", None), "picture", None)
        if self.pictures is None or show is None:
            return
        from PIL import Image

        try:
            self.pictures.mkdir(parents=True, exist_ok=True)
            Image.fromarray(_in_8_bits(show())).save(self.pictures / f"{move:06d}.jpg", quality=85)
        except OSError as error:
            raise OutputError(
                f"cannot write into {self.pictures}: {error.strerror or error}"
            ) from None

    def event(self, name: str, details: dict[str, Any]) -> None:
        """Record an event of the connection, such as the loss of the connection."""
        entry = {"kind": "event", "event": name} | details
        if self._file is None:
            self._waiting.append(entry)
        else:
            self._write(entry | {"time": self._time()})

    def end(self, status: Status, digest: dict[str, Any]) -> None:
        """Record the status at the end of the run and a digest of what was found (of an interrupted
        run, none). Close the log file.
        """
        if self._file is None:
            return
        try:
            self._write({"kind": "end", "status": str(status)} | digest | {"time": self._time()})
        finally:
            with suppress(OSError):  # a full disk, of which the entries have told
                self._file.close()
            self._file = None

    def _request(self, next_: int) -> dict[str, int]:
        """Return the number of the last request, or with 1 of the next, if the rig counts them."""
        session = session_of(self._rig)
        return {} if session is None else {"seq": session.requests + next_}

    def _time(self) -> float:
        return round(time.monotonic() - self._began, 4)

    def _write(self, entry: dict[str, Any]) -> None:
        try:
            self._file.write(json.dumps(entry, separators=(",", ":")) + "\n")
        except OSError as error:
            raise OutputError(f"cannot write {self.path}: {error.strerror or error}") from None


def _in_8_bits(picture: NDArray[Any]) -> NDArray[np.uint8]:
    """Return a picture of a camera (grey, or blue-green-red) with 8 bits, as grey or red-green-blue."""
    if picture.dtype != np.uint8:
        picture = picture * (255.0 / max(1.0, float(picture.max())))
    return np.ascontiguousarray(picture[..., 2::-1] if picture.ndim == 3 else picture, np.uint8)


def _lock(file: Any) -> None:
    """Refuse a log that another process writes, until that process has ended."""
    try:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise BlockingIOError(0, "another drive writes it at the moment") from None
    except (ImportError, OSError):  # another operating system, or a file system without locks
        return


def map_digest(belief: Belief) -> dict[str, Any]:
    """Return a digest of a final belief: the numbers of free cells and obstacles, and a checksum of
    the states of all cells.
    """
    return {
        "free": len(belief.open),
        "obstacles": len(belief.obstacles),
        "map": f"{zlib.crc32(belief.states.tobytes()):08x}",
    }


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _Header(_Entry):
    kind: Literal["header"]
    log: Literal["shoal-drive"]
    format: Literal[1]
    version: str
    rig: str
    shape: Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=2, max_length=3)]
    policy: str
    seed: NonNegativeInt
    problem: dict[str, Any]
    spacing: (
        Annotated[list[Annotated[float, Field(gt=0)]], Field(min_length=2, max_length=3)] | None
    ) = None
    test_move: bool = True
    session: str | None = None
    options: dict[str, Any] | None = None
    known: dict[str, Any] | None = None
    inlet: list[int] | None = None
    cautious: bool = False


class _Command(_Entry):
    kind: Literal["command"]
    move: NonNegativeInt
    command: Annotated[str, Field(min_length=1, max_length=1)]
    seq: NonNegativeInt | None = None
    time: float


class _Scan(_Entry):
    kind: Literal["scan"]
    move: NonNegativeInt
    cells: list[list[int]]
    placed: bool = False
    values: dict[str, float] | None = None
    true: list[list[float]] | None = None
    seq: NonNegativeInt | None = None
    time: float


class _Event(_Entry):
    model_config = ConfigDict(extra="allow", frozen=True)
    kind: Literal["event"]
    event: str


class _End(_Entry):
    kind: Literal["end"]
    status: Literal["complete", "stalled", "limit", "interrupted", "alarm"]
    moves: int | None = None
    free: int | None = None
    obstacles: int | None = None
    map: str | None = None
    time: float


_ANY: TypeAdapter[_Header | _Command | _Scan | _Event | _End] = TypeAdapter(
    Annotated[_Header | _Command | _Scan | _Event | _End, Field(discriminator="kind")]
)


@dataclass
class RecordedRig:
    """A rig that plays back a log. The recorded rig accepts the recorded commands and returns the
    recorded scans.

    Parameters
    ----------
    name : str
        Name of the recorded rig.
    shape : tuple of int
        Shape of the recorded rig's field of view, in cells.
    problem : SwarmProblem
        The problem of the recorded run.
    policy : str
        Name of the policy that chose the commands.
    seed : int
    commands : str
        The recorded commands before the last scan. Commands after the last scan are omitted, unless
        their outcome was certain.
    scans : dict
        The cells in which each scan showed particles. The key of a scan is the number of commands
        before the scan.
    events : list of dict
        Recorded events of the connection, such as the loss of the connection.
    ended : dict or None
        The last line of the log, which contains the status. ``ended`` is None if the log is
        truncated.
    spacing : tuple of float or None
        Size of a cell along each axis in mm, if it was given.
    placed : dict
        By number of commands before: the cells in which a scan showed the particles when the drive
        went on, where the commands since the last scan do not explain them.
    true : dict
        By number of commands before: where the particles were, as (row, column), if a plant has told
        it at the scan.
    tail : str
        The commands after the last scan, whose outcome is unknown.
    session : LoggedSession or None
        The session of a rig behind a connection.
    version : str
        Version of Shoal that wrote the log.
    test_move : bool
        Whether test moves were allowed.
    options : dict or None
        Options of the command that wrote the log, by name.
    lasted : float
        Time of the last entry, in seconds since the start.
    path : path
        The file.
    known : GridWorkspace or None
        The map that was known beforehand.
    inlet : tuple of int or None
        The cell at which particles may have come in.
    cautious : bool
        Whether the drive might go on with noise after the first contradiction.
    """

    name: str
    shape: tuple[int, ...]
    problem: SwarmProblem
    policy: str
    seed: int
    commands: str
    scans: dict[int, list[list[int]]]
    events: list[dict[str, Any]]
    ended: dict[str, Any] | None
    spacing: tuple[float, ...] | None = None
    placed: dict[int, list[list[list[int]]]] = field(default_factory=dict)
    true: dict[int, list[list[float]]] = field(default_factory=dict)
    tail: str = ""
    session: LoggedSession | None = None
    version: str = __version__
    test_move: bool = True
    options: dict[str, Any] | None = None
    lasted: float = 0.0
    path: Path = field(default_factory=Path)
    known: GridWorkspace | None = None
    inlet: tuple[int, ...] | None = None
    cautious: bool = False
    _at: int = 0

    @property
    def rule(self) -> str:
        """The move rule of the recorded rig."""
        return self.problem.rule

    def send(self, command: str) -> None:
        """Accept a command. The command must be the next command of the log.

        Raises
        ------
        RigError
            Raised if the command differs from the next command of the log.
        """
        if self._at >= len(self.commands) or self.commands[self._at] != command:
            expected = self.commands[self._at : self._at + 1] or "the end"
            raise RigError(
                f"the log, move {self._at + 1}: expected the recorded command {expected!r}, got"
                f" {command!r}"
            )
        self._at += 1

    def observe(self) -> NDArray[np.int64]:
        """Return the cells that the recorded rig observed after the last replayed command."""
        if self._at not in self.scans:
            raise RigError(f"the log: expected a scan after move {self._at}, got none")
        return np.array(self.scans[self._at], dtype=np.int64).reshape(-1, len(self.shape))

    def stop(self) -> None:
        """Do nothing, because the recorded run is over."""


def read_log(path: str | os.PathLike[str], *, trust: bool = False) -> RecordedRig:
    """Read a log file. Ignore an incomplete last line, which a power failure may leave.

    Parameters
    ----------
    path : path
    trust : bool
        Whether the log may name a third-party task. If ``trust`` is false, refuse such a log.

    Raises
    ------
    InvalidInputError
        Raised if the file is missing, damaged or not a log. The error message contains the number
        of the wrong line.
    """
    source = as_path(path, what="log")
    check_file(source, what="log", most=LARGEST_LOG)
    # the text after the last newline is empty or an incomplete line
    lines = source.read_bytes().split(b"\n")[:-1]
    entries = [
        _entry(line, f"{source}, line {number}") for number, line in enumerate(lines, start=1)
    ]
    if not entries or not isinstance(entries[0], _Header):
        raise InvalidInputError(
            f"{source}, line 1: expected the header of a log, got"
            f" {entries[0].kind if entries else 'none'}"
        )
    header = entries[0]
    if not trust:
        SwarmProblem.refuse_code(header.problem, where=f"{source}, line 1", names=("task",))
    problem = SwarmProblem.from_dict(header.problem, where=f"{source}, line 1")
    contents = _LogContents(source, tuple(header.shape))
    if int(np.prod(header.shape, dtype=object)) > LARGEST_VIEW:
        raise InvalidInputError(
            f"{source}, line 1: expected a field of view of at most {LARGEST_VIEW} cells, got"
            f" {contents.shape}"
        )
    for number, entry in enumerate(entries[1:], start=2):
        contents.add(entry, f"{source}, line {number}")
    scans, placed = contents.scans, contents.placed
    ended, commands = contents.ended, contents.commands
    if 0 not in scans:
        raise InvalidInputError(f"{source}: expected a scan before the first command, got none")
    # what the commands after the last scan did is unknown, unless the drive ended of its own
    # accord, as then it was certain
    sent = max(*scans, *placed, 0 if ended is None else ended["moves"] or 0)
    with errors_at(f"{source}, line 1, known"):
        known_map = None if header.known is None else GridWorkspace.from_dict(header.known)
    return RecordedRig(
        header.rig,
        contents.shape,
        problem,
        header.policy,
        header.seed,
        commands[:sent],
        scans,
        contents.events,
        ended,
        spacing=None if header.spacing is None else tuple(header.spacing),
        known=known_map,
        inlet=None if header.inlet is None else tuple(header.inlet),
        cautious=header.cautious,
        placed=placed,
        true=contents.true,
        tail=commands[sent:],
        session=contents.session(header.session),
        version=header.version,
        test_move=header.test_move,
        options=header.options,
        lasted=contents.lasted,
        path=source,
    )


class _LogContents:
    """What the entries of a log after the header tell."""

    def __init__(self, source: Path, shape: tuple[int, ...]) -> None:
        self.source, self.shape, self.letters = source, shape, letters_of(len(shape))
        self.commands, self.scans, self.lasted = "", dict[int, list[list[int]]](), 0.0
        self.placed: dict[int, list[list[list[int]]]] = {}
        self.true: dict[int, list[list[float]]] = {}
        self.events: list[dict[str, Any]] = []
        self.ended: dict[str, Any] | None = None
        self._session: str | None = None
        self._command = self._last = 0
        self._stopped = False
        self._carried_out: int | None = None
        self._outcome: bool | None = True

    def add(self, entry: _Header | _Command | _Scan | _Event | _End, where: str) -> None:
        """Take an entry over.

        Raises
        ------
        InvalidInputError
            Raised if the entry does not follow from the entries before it.
        """
        if isinstance(entry, _Command):
            if entry.move != len(self.commands) + 1 or entry.command not in self.letters:
                raise InvalidInputError(
                    f"{where}: expected command {len(self.commands) + 1}, one of"
                    f" {self.letters!r}, got {entry.command!r} as command {entry.move}"
                )
            self.commands += entry.command
            self._command = self._last = entry.seq or 0
            self._outcome = True
        elif isinstance(entry, _Scan):
            self._add_scan(entry, where)
        elif isinstance(entry, _Event):
            self._add_event(entry.model_dump())
        elif isinstance(entry, _End):
            self.ended = entry.model_dump()
        self.lasted = getattr(entry, "time", self.lasted)

    def _add_scan(self, entry: _Scan, where: str) -> None:
        # a scan after an interruption may come before the last command, which is sent after it
        moves = len(self.commands)
        least = moves - 1 if entry.placed or self._outcome is False else moves
        due = least <= entry.move <= moves
        if not due or (entry.move in self.scans and not entry.placed):
            raise InvalidInputError(
                f"{where}: expected one scan after move {moves}, got one of {entry.move}"
            )
        check_cells(entry.cells, self.shape, what=where)
        if entry.true is not None:
            self.true[entry.move] = entry.true
        if entry.placed:
            self.placed.setdefault(entry.move, []).append(entry.cells)
        else:
            self.scans[entry.move] = entry.cells
        self._last = entry.seq or 0
        self._outcome = self._outcome is not False or entry.move == moves

    def _add_event(self, event: dict[str, Any]) -> None:
        self.events.append(event)
        number = event.get("seq")
        number = number if isinstance(number, int) else None
        if event["event"] == "resumed":
            self.ended, self._stopped, self._carried_out = None, False, None
            session = event.get("session")
            if isinstance(session, str) and session != self._session:
                self._session, self._command = session, 0
                outcome = event.get("carried_out")
                self._outcome = outcome if isinstance(outcome, bool) else None
            self._last = number or 0
        elif event["event"] == "repeated":
            self._command, self._last, self._outcome = number or 0, number or 0, True
        elif event["event"] == "stop":
            self._stopped = True
        elif event["event"] == "stopped":
            self._carried_out = number

    def session(self, first: str | None) -> LoggedSession | None:
        """Return the last session. ``first`` is that of the header."""
        name = self._session or first
        if name is None:
            return None
        numbers = name, self._command, self._last
        return LoggedSession(*numbers, self._stopped, self._carried_out, self._outcome)


def _entry(line: bytes, where: str) -> _Header | _Command | _Scan | _Event | _End:
    try:
        return _ANY.validate_python(parse_json(line.decode("utf-8", "replace"), where=where))
    except ValidationError as error:
        kinds = ("header", "command", "scan", "event", "end")
        raise InvalidInputError(validation_message(error, where=where, without=kinds)) from None
