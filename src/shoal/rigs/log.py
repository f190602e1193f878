"""The log of a run on a rig: a file of JSON lines, written during the run. The function
`replay_log` replays a log.
"""

from __future__ import annotations

import json
import os
import time
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, NonNegativeInt, TypeAdapter, ValidationError

from shoal.core.checks import check_file, parse_json, validation_message
from shoal.core.dataclass import dataclass
from shoal.core.episode import Status
from shoal.core.errors import InvalidInputError, OutputError, RigError, errors_at
from shoal.core.version import __version__
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

    Raises
    ------
    OutputError
        Raised if the log file already exists, or if Shoal cannot write the file.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        if self.path.exists():
            raise OutputError(
                f"cannot write {self.path}: the file exists already, and a log is never overwritten"
            )
        if not self.path.absolute().parent.is_dir():
            raise OutputError(
                f"cannot write {self.path}: the folder {self.path.parent} does not exist"
            )
        self._file: Any = None
        self._began = 0.0
        self._waiting: list[dict[str, Any]] = []

    def begin(
        self,
        rig: Any,
        *,
        policy: str,
        seed: int,
        problem: dict[str, Any],
        spacing: Any = None,
        known: GridWorkspace | None = None,
        cautious: bool = False,
    ) -> None:
        """Write the header of the log: name and shape of the rig, the policy, the seed, the fields
        of the problem, the size of a cell along each axis in mm, the map that was known beforehand,
        and whether the drive may go on with noise.
        """
        try:
            self._file = self.path.open("x", encoding="utf-8", buffering=1)
        except OSError as error:
            raise OutputError(f"cannot write {self.path}: {error.strerror or error}") from None
        self._began = time.monotonic()
        header = {"kind": "header", "log": "shoal-drive", "format": FORMAT, "version": __version__}
        header |= {
            "rig": rig.name,
            "shape": list(rig.shape),
            "policy": policy,
            "seed": seed,
            "problem": problem,
        }
        header |= {} if spacing is None else {"spacing": list(spacing)}
        header |= {} if known is None else {"known": known.to_dict()}
        header |= {"cautious": True} if cautious else {}
        self._write(header)
        for entry in self._waiting:
            self._write(entry)

    def command(self, move: int, command: str) -> None:
        """Record a command just before it is sent."""
        self._write({"kind": "command", "move": move, "command": command, "time": self._time()})

    def scan(self, move: int, cells: NDArray[np.int64]) -> None:
        """Record the cells in which a scan showed particles."""
        self._write({"kind": "scan", "move": move, "cells": cells.tolist(), "time": self._time()})

    def event(self, what: str, details: dict[str, Any]) -> None:
        """Record an event of the connection, such as the loss of the connection."""
        entry = {"kind": "event", "event": what} | details
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

    def _time(self) -> float:
        return round(time.monotonic() - self._began, 4)

    def _write(self, entry: dict[str, Any]) -> None:
        try:
            self._file.write(json.dumps(entry, separators=(",", ":")) + "\n")
        except OSError as error:
            raise OutputError(f"cannot write {self.path}: {error.strerror or error}") from None


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
    known: dict[str, Any] | None = None
    cautious: bool = False


class _Command(_Entry):
    kind: Literal["command"]
    move: NonNegativeInt
    command: Annotated[str, Field(min_length=1, max_length=1)]
    time: float


class _Scan(_Entry):
    kind: Literal["scan"]
    move: NonNegativeInt
    cells: list[list[int]]
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
    known : GridWorkspace or None
        The map that was known beforehand.
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
    known: GridWorkspace | None = None
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
            there = self.commands[self._at : self._at + 1] or "the end"
            raise RigError(
                f"the log, move {self._at + 1}: expected the recorded command {there!r}, got"
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
    source = Path(path)
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
    commands, scans, events, ended = "", {}, [], None
    shape = tuple(header.shape)
    if int(np.prod(shape, dtype=object)) > LARGEST_VIEW:
        raise InvalidInputError(
            f"{source}, line 1: expected a field of view of at most {LARGEST_VIEW} cells, got"
            f" {shape}"
        )
    letters = letters_of(len(shape))
    for number, entry in enumerate(entries[1:], start=2):
        where = f"{source}, line {number}"
        if isinstance(entry, _Command):
            if entry.move != len(commands) + 1 or entry.command not in letters:
                raise InvalidInputError(
                    f"{where}: expected command {len(commands) + 1}, one of {letters!r}, "
                    f"got {entry.command!r} as command {entry.move}"
                )
            commands += entry.command
        elif isinstance(entry, _Scan):
            if entry.move != len(commands) or entry.move in scans:
                raise InvalidInputError(
                    f"{where}: expected one scan after move {len(commands)}, got one of"
                    f" {entry.move}"
                )
            check_cells(entry.cells, shape, what=where)
            scans[entry.move] = entry.cells
        elif isinstance(entry, _Event):
            events.append(entry.model_dump())
        elif isinstance(entry, _End):
            ended = entry.model_dump()
    if 0 not in scans:
        raise InvalidInputError(f"{source}: expected a scan before the first command, got none")
    # what the commands after the last scan did is unknown, unless the drive ended of its own
    # accord, as then it was certain
    last = 0 if ended is None else ended["moves"] or 0
    sent = commands[: max(*scans, last)] if last else commands[: max(scans)]
    spacing = None if header.spacing is None else tuple(header.spacing)
    with errors_at(f"{source}, line 1, known"):
        known = None if header.known is None else GridWorkspace.from_dict(header.known)
    about: dict[str, Any] = {"spacing": spacing, "known": known, "cautious": header.cautious}
    return RecordedRig(
        header.rig,
        shape,
        problem,
        header.policy,
        header.seed,
        sent,
        scans,
        events,
        ended,
        **about,
    )


def _entry(line: bytes, where: str) -> _Header | _Command | _Scan | _Event | _End:
    try:
        return _ANY.validate_python(parse_json(line.decode("utf-8", "replace"), where=where))
    except ValidationError as error:
        kinds = ("header", "command", "scan", "event", "end")
        raise InvalidInputError(validation_message(error, where=where, without=kinds)) from None
