"""The state of a robot on disk: each event of its state machine, before the event has an effect.

The state machine is a pure function, so the events alone give the state again, exactly: a process
that is started anew goes on where the old one ended. A journal also holds reports, which are for
people and are not replayed.
"""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from typing import Any
from zlib import crc32

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
_AHEAD = 64  # beacons that a process may have sent after the last one that is on disk


class Journal:
    """A file to which lines are appended, each with a checksum, and each on the disk before
    `record` returns.

    Parameters
    ----------
    path : Path
    search : str
        Identifier of the search.
    number : int
        Number of the robot.
    epoch : float, optional
        Time at which the robot is first switched on. By default, the time of day.

    Attributes
    ----------
    epoch : float
        Time in seconds at which the robot was first switched on.
    events : list of Event
        The events that were in the file when it was opened.
    reports : list of dict
        The reports that were in it.

    Raises
    ------
    InvalidInputError
        If the file belongs to another search or robot, or is broken before its last line.
    """

    def __init__(self, path: Path, search: str, number: int, *, epoch: float | None = None) -> None:
        self.path, self.epoch = path, time.time() if epoch is None else epoch
        self.events: list[Event] = []
        self.reports: list[dict[str, Any]] = []
        head = {"search": search, "robot": number}
        lines = self._read()
        if lines:
            first = lines[0]
            if {name: first.get(name) for name in head} != head:
                raise InvalidInputError(
                    f"{path}: expected the state of robot {number} in this search, got that of"
                    f" robot {first.get('robot')} in search {first.get('search')}"
                )
            self.epoch = float(first["epoch"])
            for line in lines[1:]:
                if "event" in line:
                    self.events.append(_event_from(line))
                else:
                    self.reports.append(line)
        try:
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
            os.ftruncate(self._file, self._length)
            if not lines:
                self._append({**head, "epoch": self.epoch})
        except OSError as error:
            raise OutputError(f"{path}: cannot write: {error.strerror}") from None

    def _read(self) -> list[dict[str, Any]]:
        self._length = 0
        try:
            data = self.path.read_bytes()
        except FileNotFoundError:
            return []
        except OSError as error:
            raise InvalidInputError(
                f"{self.path}: expected a readable state: {error.strerror}"
            ) from None
        lines: list[dict[str, Any]] = []
        pieces = data.split(b"\n")
        for number, piece in enumerate(pieces, 1):
            checksum, _, text = piece.partition(b" ")
            if checksum != b"%08x" % crc32(text):
                if number >= len(pieces) - 1:
                    break  # the last line was being written when the process ended
                raise InvalidInputError(
                    f"{self.path}: line {number}: expected a line with its checksum, got a broken one"
                )
            lines.append(json.loads(text))
            self._length += len(piece) + 1
        return lines

    def _append(self, line: dict[str, Any]) -> None:
        text = json.dumps(line, separators=(",", ":")).encode()
        os.write(self._file, b"%08x %s\n" % (crc32(text), text))
        os.fsync(self._file)

    def record(self, event: Event) -> None:
        """Write an event."""
        self._append(_event_to(event))

    def report(self, report: dict[str, Any]) -> None:
        """Write a report."""
        self._append(report)

    def replay(self, robot: Robot) -> Robot:
        """Return the state of a robot after the events of the file. The number of its beacons goes
        up a little, so that others never take a new beacon for an old one.
        """
        for event in self.events:
            robot, _ = advance(robot, event)
        return robot.but(count=robot.count + _AHEAD) if self.events else robot

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)


def _event_to(event: Event) -> dict[str, Any]:
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


def _event_from(line: dict[str, Any]) -> Event:
    values = dict(line)
    name = values.pop("event")
    if name == "Heard":
        beacon = decode_beacon(values["sender"], bytes.fromhex(values["beacon"]))
        return Heard(values["time"], beacon)
    if "beside" in values:
        values["beside"] = tuple(values["beside"])
    event: Event = _KINDS[name](**values)
    return event
