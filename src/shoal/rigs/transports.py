"""What travels between Shoal and a rig: the protocol, its messages, and transports (process, TCP,
serial line).
"""

from __future__ import annotations

import json
import os
import queue
import re
import select
import shlex
import socket
import subprocess
import threading
import time
import zlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Annotated, Any, Literal, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from shoal.core.errors import InvalidInputError, MissingExtraError, RigError

PROTOCOL: Literal[1] = 1
LONGEST_LINE = 2**24  # bytes, a million positions; a longer line counts as damaged
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


class Stop(_Message):
    """Request to stop all motion at once. After a stop, the rig refuses further commands of the
    session.
    """

    type: Literal["stop"] = "stop"


class Welcome(_Message):
    """Answer of a rig to the request hello: a description of the rig, and the number of the last
    request carried out.
    """

    type: Literal["welcome"] = "welcome"
    protocol: int
    session: str
    seq: Annotated[int, Field(ge=0)]
    shape: Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=2, max_length=3)]
    rule: str = "block"
    name: str = "rig"


class Done(_Message):
    """Answer of a rig to a command: the rig has carried out the command."""

    type: Literal["done"] = "done"
    seq: int


class Positions(_Message):
    """Answer of a rig to the request observe: the cells of all observed particles."""

    type: Literal["positions"] = "positions"
    seq: int
    cells: list[list[int]]


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


Message = Hello | Command | Observe | Stop | Welcome | Done | Positions | Stopped | Again | Refusal
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
    line = line.strip()
    found = _CRC.search(line)
    if found is None or int(found[1], 16) != zlib.crc32(line[: found.start()]):
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


T = TypeVar("T")
BAUD = 115200
CHUNK = 65536
WRITING = 5.0  # seconds after which a blocked write counts as a lost connection


class ConnectionCutError(Exception):
    """Raised if the connection to a rig is lost."""


class Transport(ABC):
    """A connection to a rig. A lost connection can be opened again.

    Parameters
    ----------
    name : str
        Name of the connection in error messages.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._pending = b""

    def open(self) -> None:
        """Open the connection. Raise ConnectionCutError if the connection cannot be opened."""
        self._pending = b""
        with _cuts():
            self._open()

    def write(self, data: bytes) -> None:
        """Send bytes. Raise ConnectionCutError if the connection is lost."""
        with _cuts():
            self._write(data)

    def read(self, timeout: float) -> bytes | None:
        """Return the next line without its newline, or None after ``timeout`` seconds.

        Raise ConnectionCutError if the connection is lost.
        """
        until = time.monotonic() + timeout
        while b"\n" not in self._pending:
            if len(self._pending) > LONGEST_LINE:
                self._pending = b""
                return b"too long"  # not a message: it will be requested again
            left = until - time.monotonic()
            if left <= 0:
                return None
            with _cuts():
                self._pending += self._read(left)
        line, _, self._pending = self._pending.partition(b"\n")
        return line

    @abstractmethod
    def _open(self) -> None: ...

    @abstractmethod
    def _write(self, data: bytes) -> None: ...

    @abstractmethod
    def _read(self, timeout: float) -> bytes:
        """Return the bytes received. If no bytes arrive within ``timeout`` seconds, return b""."""

    @abstractmethod
    def close(self) -> None:
        """Close the connection. Do nothing if the connection is not open."""


@contextmanager
def _cuts() -> Iterator[None]:
    """Convert the operating system's errors for lost connections, raised inside the ``with`` block,
    to ConnectionCutError.
    """
    try:
        yield
    except (OSError, EOFError, ValueError) as error:  # ValueError: the pipe is already closed
        raise ConnectionCutError(str(error) or type(error).__name__) from error


def _opened(end: T | None) -> T:
    """Return one end of an open connection. If the connection is closed, raise the error of a lost
    connection.
    """
    if end is None:
        raise EOFError("the connection is not open")
    return end


class SerialTransport(Transport):
    """A connection by a serial port, which the library pyserial opens.

    Parameters
    ----------
    device : str
        Device name such as ``/dev/ttyUSB0``. If the device disappears and returns with an unchanged
        name, the connection continues.
    baud : int
    """

    def __init__(self, device: str, *, baud: int = BAUD) -> None:
        super().__init__(f"serial:{device}")
        try:
            import serial
        except ImportError:
            raise MissingExtraError(
                "a serial line needs pyserial: pip install 'shoal[serial]'"
            ) from None
        self._device, self._baud = device, baud
        self._make: Callable[..., Any] = serial.Serial
        self._port: Any = None

    def _open(self) -> None:
        self._port = self._make(self._device, self._baud, timeout=0, write_timeout=WRITING)

    def _write(self, data: bytes) -> None:
        _opened(self._port).write(data)

    def _read(self, timeout: float) -> bytes:
        port = _opened(self._port)
        port.timeout = timeout
        first: bytes = port.read(1)
        return first + bytes(port.read(port.in_waiting)) if first else b""

    def close(self) -> None:
        """Close the serial port."""
        if self._port is not None:
            with suppress(OSError):
                self._port.close()


class TcpTransport(Transport):
    """A connection by TCP.

    Parameters
    ----------
    host : str
    port : int
    """

    def __init__(self, host: str, port: int) -> None:
        super().__init__(f"tcp:{host}:{port}")
        self._address = host, port
        self._socket: socket.socket | None = None

    def _open(self) -> None:
        self._socket = socket.create_connection(self._address, timeout=WRITING)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def _write(self, data: bytes) -> None:
        connection = _opened(self._socket)
        connection.settimeout(WRITING)
        connection.sendall(data)

    def _read(self, timeout: float) -> bytes:
        connection = _opened(self._socket)
        if not select.select([connection], [], [], timeout)[0]:
            return b""
        data = connection.recv(CHUNK)
        if not data:
            raise EOFError("the other end has closed the connection")
        return data

    def close(self) -> None:
        """Close the TCP connection."""
        if self._socket is not None:
            self._socket.close()


class ProcessTransport(Transport):
    """A connection by a program's standard input and output.

    The transport starts the program, and restarts a program that has ended.

    Parameters
    ----------
    command : str
        Program and arguments, quoted as for a shell. The program starts without a shell.
    """

    def __init__(self, command: str) -> None:
        super().__init__(f"exec:{command}")
        self._words = shlex.split(command)
        self._child: subprocess.Popen[bytes] | None = None
        self._came: queue.Queue[bytes] = queue.Queue()

    def _open(self) -> None:
        # The child gets its own session, so Ctrl-C reaches only this process, which sends the child
        # a stop command.
        child = subprocess.Popen(
            self._words,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
            bufsize=0,
        )
        self._child, self._came = child, queue.Queue()
        threading.Thread(target=_pump, args=(child.stdout, self._came), daemon=True).start()

    def _write(self, data: bytes) -> None:
        _opened(_opened(self._child).stdin).write(data)

    def _read(self, timeout: float) -> bytes:
        try:
            data = self._came.get(timeout=timeout)
        except queue.Empty:
            return b""
        if not data:
            self._came.put(b"")
            raise EOFError("the program has ended")
        return data

    def close(self) -> None:
        """Close the standard input of the program, wait for a short time, and then terminate the
        program.
        """
        if self._child is None:
            return
        if self._child.stdin is not None:
            with suppress(OSError):
                self._child.stdin.close()
        try:
            self._child.wait(2)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        if self._child.stdout is not None:
            self._child.stdout.close()
        self._child = None


def _pump(pipe: Any, came: queue.Queue[bytes]) -> None:
    """Forward bytes from a pipe to a queue. At the end of the pipe, put b"" into the queue."""
    with suppress(OSError, ValueError):
        while data := pipe.read(CHUNK):
            came.put(data)
    came.put(b"")


def open_transport(spec: str) -> Transport:
    """Return the connection for an address, without opening it. `shoal.rigs.open_rig` explains the
    addresses.

    Raises
    ------
    InvalidInputError, MissingExtraError

    Examples
    --------
    >>> open_transport("tcp:localhost:4000").name
    'tcp:localhost:4000'
    """
    kind, _, rest = spec.partition(":")
    expected = "rig: expected simulated, serial:DEVICE[@BAUD], tcp:HOST:PORT or exec:COMMAND"
    if kind == "serial" and rest:
        device, _, baud = rest.partition("@")
        if baud and not re.fullmatch("[1-9][0-9]{0,7}", baud):
            raise InvalidInputError(f"rig: expected a speed in baud after '@', got {baud[:40]!r}")
        if os.name == "posix" and not os.path.exists(device):
            raise InvalidInputError(
                f"rig: expected a serial port, got {device[:80]!r}, which does not exist"
            )
        return SerialTransport(device, baud=int(baud or BAUD))
    if kind == "tcp":
        host, _, port = rest.rpartition(":")
        if not host or not re.fullmatch("[0-9]{1,5}", port) or not 0 < int(port) < 65536:
            raise InvalidInputError(f"{expected}, got {spec[:80]!r}")
        return TcpTransport(host.strip("[]"), int(port))
    if kind == "exec":
        try:
            if shlex.split(rest):
                return ProcessTransport(rest)
        except ValueError as error:
            raise InvalidInputError(
                f"rig: expected a command after 'exec:', got {rest[:80]!r}: {error}"
            ) from None
    raise InvalidInputError(f"{expected}, got {spec[:80]!r}")


LARGEST_VIEW = 2**22
"""Maximum number of cells in the field of view of a rig, such as 2048 times 2048: a drive then
needs less than 1 GiB.
"""


class PositionError(RigError):
    """Raised if a position is not a cell of the field of view: not two or three whole numbers, or
    outside.
    """


@runtime_checkable
class Rig(Protocol):
    """A real or simulated device that moves particles and observes the particles' positions.

    A rig is at rest between two commands, so that a policy may take any time to compute a command.
    """

    @property
    def name(self) -> str:
        """Name of the rig, as written in summaries and files."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the rig's field of view in cells: (rows, columns) or (layers, rows, columns)."""

    @property
    def rule(self) -> str:
        """The rig's move rule: "block", "merge" or "tilt"."""

    def send(self, command: str) -> None:
        """Carry out one command: a letter of ``lurd`` in 2-D, or a letter of ``lurdio`` in 3-D."""

    def observe(self) -> NDArray[np.int64]:
        """Return the cells of all observed particles (int64, shape (n, ndim))."""

    def stop(self) -> None:
        """Stop all motion at once. After `stop`, the rig refuses further commands."""
