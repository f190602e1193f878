"""Connections that carry lines of bytes: a program, TCP, or a serial line. A lost connection can be
opened again.
"""

from __future__ import annotations

import os
import queue
import re
import select
import shlex
import socket
import subprocess
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, TypeVar

from shoal.core.checks import check_text
from shoal.core.errors import InvalidInputError, MissingExtraError

T = TypeVar("T")
LONGEST_LINE = 2**24  # bytes, a million positions; a longer line counts as damaged
BAUD = 115200
CHUNK = 65536
WAITING = 256  # chunks of a program that Shoal has not read yet, after which the program must wait
ENDING = 0.5  # seconds that a program takes at most to end after it has closed a pipe
WRITING = 5.0  # seconds after which a blocked write counts as a lost connection


class ConnectionCutError(Exception):
    """Raised if the connection to a rig is lost or cannot be opened."""

    @property
    def refused(self) -> bool:
        """Whether nobody listens at the address, perhaps because the rig is still starting."""
        return isinstance(self.__cause__, ConnectionRefusedError)


class Transport(ABC):
    """A connection to a rig. A lost connection can be opened again.

    Parameters
    ----------
    name : str
        Name of the connection in error messages.
    """

    returns = True
    """Whether a connection that is lost as soon as it is opened may work some time later."""

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
            remaining = until - time.monotonic()
            if remaining <= 0:
                return None
            with _cuts():
                self._pending += self._read(remaining)
        line, _, self._pending = self._pending.partition(b"\n")
        return line

    def receive(self, timeout: float) -> bytes:
        """Return the bytes that have come, at the latest after ``timeout`` seconds.

        Raise ConnectionCutError if the connection is lost.
        """
        if not self._pending:
            with _cuts():
                return self._read(timeout)
        came, self._pending = self._pending, b""
        return came

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

    The transport starts the program, and restarts a program that has ended. A program that ends
    again before it answers will do so every time.

    Parameters
    ----------
    command : str
        Program and arguments, quoted as for a shell. The program starts without a shell.
    """

    returns = False

    def __init__(self, command: str) -> None:
        super().__init__(f"exec:{command}")
        self._words = shlex.split(check_text(command, what="command"))
        self._child: subprocess.Popen[bytes] | None = None
        self._came: queue.Queue[bytes] = queue.Queue(WAITING)

    def _open(self) -> None:
        # The child gets its own session, so Ctrl-C reaches only this process, which sends the child
        # a stop command.
        try:
            child = subprocess.Popen(
                self._words,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,
                bufsize=0,
            )
        except OSError as error:
            raise EOFError(
                f"the program {self._words[0]!r} cannot be started: {error.strerror or error}"
            ) from error
        self._child, self._came = child, queue.Queue(WAITING)
        threading.Thread(target=_pump, args=(child.stdout, self._came), daemon=True).start()

    def _write(self, data: bytes) -> None:
        try:
            _opened(_opened(self._child).stdin).write(data)
        except OSError as error:
            raise EOFError(self._end("input")) from error

    def _read(self, timeout: float) -> bytes:
        try:
            data = self._came.get(timeout=timeout)
        except queue.Empty:
            return b""
        if not data:
            self._came.put(b"")
            raise EOFError(self._end("output"))
        return data

    def _end(self, pipe: str) -> str:
        """Return how the program has ended, or which of its pipes it has closed."""
        try:
            code = _opened(self._child).wait(ENDING)
        except subprocess.TimeoutExpired:
            return f"the program has closed its standard {pipe}"
        if code < 0:
            return f"the program was ended by signal {-code}"
        return f"the program has ended with exit code {code}"

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
        with suppress(queue.Empty):  # the thread may wait for space
            while True:
                self._came.get_nowait()
        if self._child.stdout is not None:
            self._child.stdout.close()
        self._child = None


def _pump(pipe: Any, came: queue.Queue[bytes]) -> None:
    """Forward bytes from a pipe to a queue. At the end of the pipe, put b"" into the queue."""
    with suppress(OSError, ValueError):
        while data := pipe.read(CHUNK):
            came.put(data)
    came.put(b"")


def open_transport(spec: str, *, what: str = "rig") -> Transport:
    """Return the connection for an address, without opening it. `shoal.rigs.open_rig` explains the
    addresses.

    Parameters
    ----------
    spec : str
        The address, such as ``tcp:HOST:PORT``.
    what : str
        What has the address, for error messages.

    Raises
    ------
    InvalidInputError, MissingExtraError

    Examples
    --------
    >>> open_transport("tcp:localhost:4000").name
    'tcp:localhost:4000'
    """
    kind, _, endpoint = check_text(spec, what=what).partition(":")
    expected = f"{what}: expected serial:DEVICE[@BAUD], tcp:HOST:PORT or exec:COMMAND"
    if kind == "serial" and endpoint:
        device, _, baud = endpoint.partition("@")
        if baud and not re.fullmatch("[1-9][0-9]{0,7}", baud):
            raise InvalidInputError(
                f"{what}: expected a speed in baud after '@', got {baud[:40]!r}"
            )
        if os.name == "posix" and not os.path.exists(device):
            raise InvalidInputError(
                f"{what}: expected a serial port, got {device[:80]!r}, which does not exist"
            )
        return SerialTransport(device, baud=int(baud or BAUD))
    if kind == "tcp":
        host, _, port = endpoint.rpartition(":")
        if not host or not re.fullmatch("[0-9]{1,5}", port) or not 0 < int(port) < 65536:
            raise InvalidInputError(f"{expected}, got {spec[:80]!r}")
        return TcpTransport(host.strip("[]"), int(port))
    if kind == "exec":
        try:
            if shlex.split(endpoint):
                return ProcessTransport(endpoint)
        except ValueError as error:
            raise InvalidInputError(
                f"{what}: expected a command after 'exec:', got {endpoint[:80]!r}: {error}"
            ) from None
    raise InvalidInputError(f"{expected}, got {spec[:80]!r}")
