"""What robots tell one another, and how it looks on the wire: JSON with a version and a checksum."""

from __future__ import annotations

import json
import re
from typing import Any, Literal, get_args
from zlib import crc32

from shoal.checks import check_integer, shortened
from shoal.dataclass import dataclass
from shoal.errors import InvalidInputError
from shoal.search.cells.footprint import WIDEST

VERSION: Literal[1] = 1
Status = Literal["listening", "searching", "waiting", "complete"]


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """The latest heartbeat of a robot: its number, how many beacons it had sent, where it started, its speed and its status.

    Besides, how many cells wide its footprint is, the cell that it is in or on the way to, and how far it is behind: how
    much longer it has taken for its ways than by its speed.
    """

    robot: int
    count: int
    start: int
    rate: float
    status: Status
    width: int = 1
    place: int = 0
    lag: float = 0.0


@dataclass(frozen=True, slots=True)
class Beacon:
    """All that a robot knows, told again and again, so that no single message matters.

    Parameters
    ----------
    sender : int
    heartbeats : tuple of Heartbeat
        Of the sender, first, and of all others that it has heard of, from themselves or from others.
    searched : tuple of (int, int)
        By robot, the cells that it says it has searched, as bits.
    found : tuple of (int, int)
        By cell, the robots that have found something there, as bits.
    closed : tuple of (int, int)
        By robot, the cells that it says cannot be entered, as bits.
    """

    sender: int
    heartbeats: tuple[Heartbeat, ...]
    searched: tuple[tuple[int, int], ...]
    found: tuple[tuple[int, int], ...] = ()
    closed: tuple[tuple[int, int], ...] = ()


def encode_beacon(beacon: Beacon) -> bytes:
    """Return a beacon as bytes: eight hexadecimal digits, the checksum (CRC-32), then JSON.

    Examples
    --------
    >>> decode_beacon(encode_beacon(Beacon(1, (Heartbeat(1, 0, 5, 1.0, "listening"),), ((1, 0b100000),)))).searched
    ((1, 32),)
    """
    body: dict[str, Any] = {
        "version": VERSION,
        "sender": beacon.sender,
        "heartbeats": [_told(heartbeat) for heartbeat in beacon.heartbeats],
        "searched": {robot: f"{bits:x}" for robot, bits in beacon.searched},
        "found": {cell: f"{bits:x}" for cell, bits in beacon.found},
    }
    if beacon.closed:
        body["closed"] = {robot: f"{bits:x}" for robot, bits in beacon.closed}
    text = json.dumps(body, separators=(",", ":")).encode()
    return f"{crc32(text):08x}".encode() + text


def _told(heartbeat: Heartbeat) -> dict[str, Any]:
    told = {name: getattr(heartbeat, name) for name in Heartbeat.__slots__}
    if heartbeat.width == 1:
        del told["width"]
    return told


def decode_beacon(data: bytes) -> Beacon:
    """Return the beacon that bytes hold.

    Raises
    ------
    InvalidInputError
        If the checksum is wrong or it is no beacon of this version.
    """
    if len(data) < 8 or f"{crc32(data[8:]):08x}".encode() != data[:8]:
        raise InvalidInputError(f"beacon: expected a checksum and what it fits, got {len(data)} damaged bytes")
    try:
        body = json.loads(data[8:])
        if not isinstance(body, dict) or body.keys() - {"closed"} != _FIELDS or body["version"] != VERSION:
            raise InvalidInputError(f"expected the fields {', '.join(sorted(_FIELDS))} of version {VERSION}")
        heartbeats = tuple(_heartbeat(told) for told in body["heartbeats"])
        sender = check_integer(body["sender"], what="sender", least=0)
        return Beacon(sender, heartbeats, *(_sets(body.get(name, {})) for name in ("searched", "found", "closed")))
    except (ValueError, TypeError, AttributeError, RecursionError) as error:
        raise InvalidInputError(f"beacon: expected a beacon of version {VERSION}, got another: {shortened(str(error))}") from None


_FIELDS = {"version", "sender", "heartbeats", "searched", "found"}
_HEX = re.compile("[0-9a-f]+")
_STATUSES = frozenset(get_args(Status))
_FASTEST = 1e9
_WIDTHS = range(1, WIDEST + 1, 2)


def _heartbeat(told: Any) -> Heartbeat:
    """Return a heartbeat from the wire; TypeError for missing and unknown fields. Quick, as every message has many."""
    heartbeat = Heartbeat(**told)
    numbers = (heartbeat.robot, heartbeat.count, heartbeat.start, heartbeat.width)
    if any(type(number) is not int or number < 0 for number in numbers) or heartbeat.status not in _STATUSES:
        raise InvalidInputError(f"expected numbers of 0 or more and a status, got {told}")
    if heartbeat.width not in _WIDTHS or type(heartbeat.rate) not in (int, float) or not 0 < heartbeat.rate <= _FASTEST:
        raise InvalidInputError(f"expected a rate above 0, at most {_FASTEST:g}, and an odd width up to {WIDEST}, got {told}")
    return heartbeat


def _sets(told: Any) -> tuple[tuple[int, int], ...]:
    """Return sets from the wire, where they are hexadecimal."""
    found = []
    for number, bits in told.items():
        if not number.isdecimal() or _HEX.fullmatch(bits) is None:
            raise InvalidInputError(f"expected numbers with hexadecimal digits, got {number!r}: {bits!r}")
        found.append((int(number), int(bits, 16)))
    return tuple(found)
