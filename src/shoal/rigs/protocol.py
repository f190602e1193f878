"""The messages between Shoal and a rig, version 1: one JSON object with a checksum on each line."""

from __future__ import annotations

import json
import re
import zlib
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from shoal.core.checks import shortened
from shoal.core.errors import InvalidInputError

PROTOCOL: Literal[1] = 1
_CRC = re.compile(rb',"crc":"([0-9a-f]{8})"}$')


class _Message(BaseModel):
    """Base class of all messages. Shoal ignores unknown members of a message, so that rigs may send
    additional members.
    """

    model_config = ConfigDict(extra="ignore", frozen=True, strict=True)


class Hello(_Message):
    """Request to begin a session with a rig, or to resume a session after a lost connection."""

    type: Literal["hello"] = "hello"
    protocol: int = PROTOCOL
    session: str


class Command(_Message):
    """Request to move all particles by one command: a letter of ``lurd`` in 2-D, or of ``lurdio``
    in 3-D.
    """

    type: Literal["command"] = "command"
    seq: Annotated[int, Field(ge=1)]
    command: str


class Observe(_Message):
    """Request to observe all particles and report their positions."""

    type: Literal["observe"] = "observe"
    seq: Annotated[int, Field(ge=1)]


class Push(_Message):
    """Request to push all particles in any direction, for rigs that say in ``can`` that they can:
    ``angle`` in degrees counterclockwise from the command r, for some ``seconds``.
    """

    type: Literal["push"] = "push"
    seq: Annotated[int, Field(ge=1)]
    angle: float
    seconds: Annotated[float, Field(ge=0)]


class Look(_Message):
    """Request to report where the particles are, not only in which cells, for rigs that say in
    ``can`` that they can.
    """

    type: Literal["look"] = "look"
    seq: Annotated[int, Field(ge=1)]


class Stop(_Message):
    """Request to stop all motion at once. After a stop, the rig refuses further commands of the
    session.
    """

    type: Literal["stop"] = "stop"


class Welcome(_Message):
    """Answer of a rig to the request hello: a description of the rig, and the number of the last
    request carried out.

    ``can`` names the requests beyond this version that the rig carries out: ``push``, ``look``.
    ``pulse`` is the time of a push that moves particles by one cell, in seconds.
    """

    type: Literal["welcome"] = "welcome"
    protocol: int
    session: str
    seq: Annotated[int, Field(ge=0)]
    shape: Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=2, max_length=3)]
    rule: str = "block"
    name: str = "rig"
    can: list[str] = []
    pulse: Annotated[float, Field(gt=0)] = 1.0


class Done(_Message):
    """Answer of a rig to a command: the rig has carried out the command. ``values`` may hold
    commanded and measured values by name, such as a current, for the log.
    """

    type: Literal["done"] = "done"
    seq: int
    values: dict[str, float] | None = None


class Positions(_Message):
    """Answer of a rig to the request observe: the cells of all observed particles. ``values`` may
    hold measured values by name for the log.
    """

    type: Literal["positions"] = "positions"
    seq: int
    cells: list[list[int]]
    values: dict[str, float] | None = None


class Points(_Message):
    """Answer of a rig to the request look: (row, column) of each observed particle, where whole
    numbers are the middles of cells. ``number`` is that of the picture, if the rig counts them.
    """

    type: Literal["points"] = "points"
    seq: int
    points: list[list[float]]
    number: int | None = None
    values: dict[str, float] | None = None


class Stopped(_Message):
    """Answer of a rig to the request stop: the rig has stopped."""

    type: Literal["stopped"] = "stopped"


class Again(_Message):
    """Report that the last received line was damaged. The receiver of this message must send the
    damaged line again.
    """

    type: Literal["again"] = "again"


class Refusal(_Message):
    """Answer of a rig that cannot carry out a request. The member ``text`` gives the reason for the
    refusal.
    """

    type: Literal["error"] = "error"
    seq: int | None = None
    text: str


Message = (
    Hello
    | Command
    | Observe
    | Push
    | Look
    | Stop
    | Welcome
    | Done
    | Positions
    | Points
    | Stopped
    | Again
    | Refusal
)
_ANY: TypeAdapter[Message] = TypeAdapter(Annotated[Message, Field(discriminator="type")])


def encode_message(message: Message) -> bytes:
    r"""Return a message as a line of bytes: a JSON object with a checksum, and a newline.

    The checksum is the CRC-32 (as in zlib) of all bytes of the line before ``,"crc":``, written
    with eight hexadecimal digits.

    Examples
    --------
    >>> encode_message(Command(seq=7, command="l"))
    b'{"type":"command","seq":7,"command":"l","crc":"07eb29f8"}\n'
    """
    text = json.dumps(
        message.model_dump(exclude_none=True), separators=(",", ":"), ensure_ascii=True
    ).encode()[:-1]
    return b'%s,"crc":"%08x"}\n' % (text, zlib.crc32(text))


def decode_message(line: bytes) -> Message | None:
    """Return the message in a line of bytes, or None if the line is damaged.

    Raises
    ------
    InvalidInputError
        Raised if the line has a correct checksum, but contains no message of the protocol. A wrong
        message with a correct checksum is a fault of the rig, and not of the connection.
    """
    if not isinstance(line, bytes | bytearray):
        raise InvalidInputError(f"line: expected bytes, got {shortened(line)}")
    line = line.strip()
    checksum = _CRC.search(line)
    if checksum is None or int(checksum[1], 16) != zlib.crc32(line[: checksum.start()]):
        return None
    try:
        return _ANY.validate_json(line)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "type"
        raise InvalidInputError(
            f"the rig: expected a message of protocol {PROTOCOL}, got"
            f" {line[:80].decode(errors='replace')!r} ({where}: {first['msg']})"
        ) from None
