"""The state of a robot on disk: each event of its state machine, before the event has an effect.

The state machine is a pure function, so the events alone give the state again, exactly: a process
that is started anew goes on where the old one ended. A journal also holds reports, which are for
people and are not replayed.
"""

from __future__ import annotations

import json
import os
import time
from contextlib import ExitStack
from errno import ENOSPC
from math import inf
from pathlib import Path
from typing import Any
from zlib import crc32

from shoal.core.checks import check_number, describe_missing_file
from shoal.core.errors import InvalidInputError, OutputError
from shoal.search.protocol.messages import decode_beacon, encode_beacon
from shoal.search.protocol.robot import advance
from shoal.search.protocol.state import (
    Begin,
    Blocked,
    Event,
    Heard,
    Obstructed,
    Recharged,
    Robot,
    Sensed,
    Wake,
)

_KINDS = {kind.__name__: kind for kind in (Begin, Wake, Sensed, Blocked, Obstructed, Recharged)}
_WHOLE = 1 << 30  # a beacon in one piece
_SYNC = 1.0  # seconds: what was heard may be lost with the power for so long
_AHEAD = 64  # beacons that a process may have sent after the last one that is on disk


class Journal:
    """A file to which lines are appended, each with a checksum.

    A line is in the file before `record` returns, so that it outlives the process. What the robot
    alone knows is then on the disk, too, and outlives a loss of power; what it has heard comes
    there at the first event after a second, because an SD card would otherwise delay each message.

    Parameters
    ----------
    path : Path
    search : str
        Identifier of the search.
    number : int
        Number of the robot.
    epoch : float, optional
        Time at which the robot is first switched on. By default, the time of day.
    read_only : bool
        Whether the file must exist and nothing is written, as for a check.

    Attributes
    ----------
    epoch : float
        Time in seconds at which the robot was first switched on.
    events : list of Event
        The events that were in the file when it was opened.
    reports : list of dict
        The reports that were in it.
    fault : str
        Why nothing more can be written; empty as long as it can.

    Raises
    ------
    InvalidInputError
        If the file belongs to another search or robot, if another process has it open, or if it is
        broken before its end.
    OutputError
    """

    def __init__(
        self,
        path: Path,
        search: str,
        number: int,
        *,
        epoch: float | None = None,
        read_only: bool = False,
    ) -> None:
        self.path, self.epoch = path, time.time() if epoch is None else epoch
        self.fault, self._synced = "", -inf
        self.events: list[Event] = []
        self.reports: list[dict[str, Any]] = []
        head = {"search": search, "robot": number}
        missing = describe_missing_file(path)
        if missing not in ("", "no such file"):
            raise InvalidInputError(f"{path}: expected the state of a robot, got {missing}")
        try:
            self._file = os.open(
                path, os.O_RDONLY if read_only else os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644
            )
        except OSError as error:
            raise OutputError(f"{path}: cannot write: {error.strerror}") from None
        with ExitStack() as stack:
            stack.callback(os.close, self._file)
            self._lock()
            self._open(head)
            if not read_only:
                self._continue(head)
            stack.pop_all()

    def _lock(self) -> None:
        try:
            import fcntl

            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except ImportError:  # on this system, two programs of one robot are not noticed
            return
        except OSError:
            raise InvalidInputError(
                f"{self.path}: expected that no other program is this robot, got one that runs"
            ) from None

    def _open(self, head: dict[str, Any]) -> None:
        """Read what is in the file."""
        path, number = self.path, head["robot"]
        lines = self._read()
        if lines:
            first = lines[0]
            if {name: first.get(name) for name in head} != head:
                raise InvalidInputError(
                    f"{path}: expected the state of robot {number} in this search, got that of"
                    f" robot {first.get('robot')} in search {first.get('search')}"
                )
            self.epoch = check_number(first.get("epoch"), what=f"{path}: line 1: epoch")
            for number, line in enumerate(lines[1:], 2):
                if "event" not in line:
                    self.reports.append(line)
                    continue
                try:
                    self.events.append(_event_from_dict(line))
                except (KeyError, TypeError, ValueError):
                    raise self._other_version(number) from None

    def _continue(self, head: dict[str, Any]) -> None:
        """Cut off what was on the way to the disk, and begin the file if nothing else is in it."""
        try:
            os.ftruncate(self._file, self._length)
        except OSError as error:
            raise OutputError(f"{self.path}: cannot write: {error.strerror}") from None
        if self._length == 0:
            self._append({**head, "epoch": self.epoch}, now=True)
            if self.fault:
                raise OutputError(f"{self.path}: {self.fault}")

    def _read(self) -> list[dict[str, Any]]:
        self._length = 0
        try:
            data = self.path.read_bytes()
        except OSError as error:
            raise InvalidInputError(
                f"{self.path}: expected a readable state: {error.strerror}"
            ) from None
        lines: list[dict[str, Any]] = []
        pieces = data.split(b"\n")
        for number, piece in enumerate(pieces, 1):
            if not _is_whole(piece):
                # the last lines may have been on the way to the disk when the process ended
                cut = number > 1 or len(pieces) == 1
                if cut and not any(map(_is_whole, pieces[number:])):
                    break
                raise InvalidInputError(
                    f"{self.path}: line {number}: expected a line with its checksum, got a broken one"
                )
            line = json.loads(piece.partition(b" ")[2])
            if not isinstance(line, dict):
                raise self._other_version(number)
            lines.append(line)
            self._length += len(piece) + 1
        return lines

    def _other_version(self, line: int) -> InvalidInputError:
        return InvalidInputError(
            f"{self.path}: line {line}: expected an event of this version of Shoal, got another"
        )

    def _append(self, line: dict[str, Any], *, now: bool = False) -> None:
        """Append a line, and bring it to the disk now, or later with others."""
        if self.fault:
            return
        text = json.dumps(line, separators=(",", ":")).encode()
        whole = b"%08x %s\n" % (crc32(text), text)
        try:
            if os.write(self._file, whole) < len(whole):
                raise OSError(ENOSPC, os.strerror(ENOSPC))
            if now or time.monotonic() - self._synced > _SYNC:
                os.fsync(self._file)
                self._synced = time.monotonic()
        except OSError as error:
            # the robot can do its work without; only a process started anew would know less
            self.fault = f"cannot write: {error.strerror}"

    def record(self, event: Event) -> None:
        """Write an event."""
        self._append(_event_to_dict(event), now=not isinstance(event, Heard | Wake))

    def report(self, report: dict[str, Any]) -> None:
        """Write a report."""
        self._append(report)

    def replay(self, robot: Robot, time: float = 0.0) -> Robot:
        """Return the state of a robot at a time after the events of the file. The number of its
        beacons goes up a little, so that others never take a new beacon for an old one, even if the
        last events are lost.
        """
        for number, event in enumerate(self.events, 1):
            try:
                robot, _ = advance(robot, event)
            except (IndexError, KeyError, TypeError, ValueError):
                raise InvalidInputError(
                    f"{self.path}: event {number}: expected an event of this search, got another"
                ) from None
        if not self.events:
            return robot
        return robot.replaced(count=max(robot.count, int(time / robot.brief.beat)) + _AHEAD)

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)


def _is_whole(line: bytes) -> bool:
    checksum, _, text = line.partition(b" ")
    return checksum == b"%08x" % crc32(text)


def _event_to_dict(event: Event) -> dict[str, Any]:
    if isinstance(event, Heard):
        body = encode_beacon(event.beacon, _WHOLE)[0].hex()
        return {
            "event": "Heard",
            "time": event.time,
            "sender": event.beacon.sender,
            "beacon": body,
        }
    values = {name: getattr(event, name) for name in event.__slots__}
    return {"event": type(event).__name__, **values}


def _event_from_dict(line: dict[str, Any]) -> Event:
    values = dict(line)
    name = values.pop("event")
    if name == "Heard":
        beacon = decode_beacon(values["sender"], bytes.fromhex(values["beacon"]))
        return Heard(values["time"], beacon)
    if "beside" in values:
        values["beside"] = tuple(values["beside"])
    event: Event = _KINDS[name](**values)
    return event
