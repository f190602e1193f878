"""What robots tell one another, and how it looks on the wire: JSON with a version and a checksum."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Annotated, Any, Literal
from zlib import crc32

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, NonNegativeInt, PositiveFloat, StringConstraints, ValidationError

from shoal.errors import InvalidInputError
from shoal.search.cells.footprint import WIDEST, check_odd

VERSION: Literal[1] = 1
Status = Literal["listening", "searching", "waiting", "complete"]


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """The latest heartbeat of a robot: its number, how many beacons it had sent, where it started, its speed and its status.

    Besides, how many cells wide its footprint is.
    """

    robot: int
    count: int
    start: int
    rate: float
    status: Status
    width: int = 1


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


Width = Annotated[int, Field(ge=1, le=WIDEST), AfterValidator(check_odd)]
Bits = Annotated[str, StringConstraints(pattern="^[0-9a-f]+$")]


class HeartbeatForm(BaseModel):
    """A heartbeat on the wire."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    robot: NonNegativeInt
    count: NonNegativeInt
    start: NonNegativeInt
    rate: PositiveFloat
    status: Status
    width: Width = 1


class BeaconForm(BaseModel):
    """A beacon on the wire; sets are hexadecimal."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    version: Literal[1]
    sender: NonNegativeInt
    heartbeats: list[HeartbeatForm]
    searched: dict[NonNegativeInt, Bits]
    found: dict[NonNegativeInt, Bits]
    closed: dict[NonNegativeInt, Bits] = {}


def encode(beacon: Beacon) -> bytes:
    """Return a beacon as bytes: eight hexadecimal digits, the checksum (CRC-32), then JSON.

    Examples
    --------
    >>> decode(encode(Beacon(1, (Heartbeat(1, 0, 5, 1.0, "listening"),), ((1, 0b100000),)))).searched
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
    told = {name: getattr(heartbeat, name) for name in HeartbeatForm.model_fields}
    if heartbeat.width == 1:
        del told["width"]
    return told


def decode(data: bytes) -> Beacon:
    """Return the beacon that bytes hold.

    Raises
    ------
    InvalidInputError
        If the checksum is wrong or it is no beacon of this version.
    """
    if len(data) < 8 or f"{crc32(data[8:]):08x}".encode() != data[:8]:
        raise InvalidInputError(f"beacon: expected a checksum and what it fits, got {len(data)} damaged bytes")
    try:
        form = BeaconForm.model_validate_json(data[8:])
        searched = tuple((robot, int(bits, 16)) for robot, bits in form.searched.items())
        found = tuple((cell, int(bits, 16)) for cell, bits in form.found.items())
        closed = tuple((robot, int(bits, 16)) for robot, bits in form.closed.items())
    except (ValidationError, ValueError) as error:
        raise InvalidInputError(f"beacon: expected a beacon of version {VERSION}, got {str(error).splitlines()[0]}") from None
    heartbeats = tuple(
        Heartbeat(heartbeat.robot, heartbeat.count, heartbeat.start, heartbeat.rate, heartbeat.status, heartbeat.width)
        for heartbeat in form.heartbeats
    )
    return Beacon(form.sender, heartbeats, searched, found, closed)
