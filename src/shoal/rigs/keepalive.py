"""A process of its own that owns the line to coils, and turns the field off when the drive is gone.

For devices that hold their last packet until the next one. The drive sends its packets to this
process, which passes them on. While the field is on, the drive must be heard: after ``silence``
seconds without a message, after ``longest`` seconds with the field on, and as soon as the drive has
ended (its pipe is closed, whatever has killed it), the process sends the packet that turns the
field off. It does so itself if the line had to be opened again.

It cannot help if the computer loses its power, if this process itself is killed, or if the line is
unplugged while the field is on.

Messages are a letter, a length of two bytes and the data. To the process: ``1`` and ``0`` (a packet
after which the field is on, or off), ``.`` (the drive is alive). From the process: ``R`` (the line
is open), ``W`` (a packet of the kind ``0`` was written), ``D`` (bytes of the device), ``S`` (the field was turned off, and why), ``E`` (the line is
lost, and why).
"""

from __future__ import annotations

import json
import os
import select
import signal
import struct
import subprocess
import sys
import threading
import time
from contextlib import suppress
from typing import IO, Any

from shoal.core.errors import ShoalError
from shoal.rigs.transports import ConnectionCutError, Transport, open_transport

OFF_TIMES, OFF_PAUSE = 3, 0.02  # how often the process says "off" at the end, and seconds between
LAST = 10.0  # seconds for which it tries to open a lost line again to say "off"
STARTING = 20.0  # seconds within which the process must have opened the line
WRITING = 5.0  # seconds within which it must have written a packet
READING = 0.05  # seconds between two looks whether the line is still wanted
LONGEST = 0xFFFF  # bytes of data in a message


def pack(kind: bytes, data: bytes = b"") -> bytes:
    """Return a message."""
    return kind + struct.pack("<H", len(data)) + data


class Messages:
    """The messages in a stream of bytes."""

    def __init__(self) -> None:
        self._buffer = b""

    def add(self, data: bytes) -> list[tuple[bytes, bytes]]:
        """Return the messages that are complete once these bytes have come: kind and data."""
        self._buffer += data
        messages = []
        while len(self._buffer) >= 3:
            (length,) = struct.unpack("<H", self._buffer[1:3])
            if len(self._buffer) < 3 + length:
                break
            messages.append((self._buffer[:1], self._buffer[3 : 3 + length]))
            self._buffer = self._buffer[3 + length :]
        return messages


class KeeperLine:
    """A line to coils, kept by a process of its own.

    Parameters
    ----------
    address : str
    off : bytes
        The packet that turns the field off.
    silence : float
        Seconds without a message of the drive after which the process turns the field off.
    longest : float
        Seconds that the field may be on.
    """

    def __init__(self, address: str, *, off: bytes, silence: float, longest: float) -> None:
        self.name = address
        settings = {"address": address, "off": off.hex(), "silence": silence, "longest": longest}
        # its own session: neither Ctrl-C nor a closed terminal must reach it
        self._child = subprocess.Popen(
            [sys.executable, "-P", "-m", "shoal.rigs.keepalive", json.dumps(settings)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
            bufsize=0,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )
        self._messages, self._waiting, self._written = Messages(), b"", 0
        self.why = ""  # why the process has turned the field off
        self._open, self._taking = False, threading.Lock()

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._child.pid

    @property
    def alive(self) -> bool:
        """Whether the process lives."""
        return self._child.poll() is None

    def open(self) -> None:
        """Wait until the process has opened the line."""
        until = time.monotonic() + STARTING
        while not self._open:
            if time.monotonic() > until:
                raise ConnectionCutError("the keep-alive process does not answer")
            self._take(READING)

    def write(self, data: bytes, *, on: bool) -> None:
        """Send a packet, after which the field is on or off. If it is off, wait until the process
        has written it.
        """
        written, until = self._written, time.monotonic() + WRITING
        if on:
            self.why = ""
        self._send(pack(b"1" if on else b"0", data))
        while not on and self._written == written:
            if time.monotonic() > until:
                raise ConnectionCutError("the keep-alive process does not answer")
            self._take(READING)

    def ping(self) -> None:
        """Say that the drive is alive."""
        self._send(pack(b"."))

    def read(self, timeout: float) -> bytes:
        """Return what the device has sent, at the latest after ``timeout`` seconds."""
        if not self._waiting:
            self._take(timeout)
        came, self._waiting = self._waiting, b""
        return came

    def close(self) -> None:
        """End the process, which turns the field off."""
        if self._child.stdin is not None and not self._child.stdin.closed:
            self._child.stdin.close()
        try:
            self._child.wait(2)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        if self._child.stdout is not None:
            self._child.stdout.close()

    def _send(self, message: bytes) -> None:
        try:
            pipe = self._child.stdin
            assert pipe is not None
            pipe.write(message)
        except (OSError, ValueError) as error:
            raise ConnectionCutError("the keep-alive process has ended") from error

    def _take(self, timeout: float) -> None:
        """Take in what the process says within some time, or sooner."""
        with self._taking:  # another thread may stop the coils during a push
            self._take_in(min(timeout, READING))

    def _take_in(self, timeout: float) -> None:
        pipe = self._child.stdout
        assert pipe is not None
        if pipe.closed or not select.select([pipe], [], [], timeout)[0]:
            return
        data = os.read(pipe.fileno(), LONGEST)
        if not data:
            raise ConnectionCutError("the keep-alive process has ended")
        for kind, content in self._messages.add(data):
            if kind == b"R":
                self._open = True
            elif kind == b"W":
                self._written += 1
            elif kind == b"D":
                self._waiting += content
            elif kind == b"S":
                self.why = content.decode()
            else:
                raise ConnectionCutError(content.decode())


class Keeper:
    """What the process does.

    Parameters
    ----------
    transport : Transport
    off : bytes
    silence, longest : float
    out : file
        Where the messages to the drive go.
    """

    def __init__(
        self, transport: Transport, off: bytes, *, silence: float, longest: float, out: IO[bytes]
    ) -> None:
        self.transport, self.off = transport, off
        self.silence, self.longest, self._out = silence, longest, out
        self._lock, self._ended = threading.Lock(), False
        self._on, self._lost = False, False

    def run(self, source: int) -> None:
        """Pass messages on until the drive has ended."""
        self.transport.open()
        reader = threading.Thread(target=self._read, daemon=True)
        reader.start()
        self._tell(b"R")
        messages, heard, began = Messages(), time.monotonic(), 0.0
        try:
            while True:
                remaining = None
                if self._on:
                    remaining = max(0.0, min(heard + self.silence, began + self.longest) - _now())
                if not select.select([source], [], [], remaining)[0]:
                    self._turn_off(_now() - heard >= self.silence)
                    continue
                data = os.read(source, LONGEST)
                if not data:
                    return
                heard = _now()
                for kind, content in messages.add(data):
                    if kind == b"1" and not self._on:
                        began = heard
                    if kind in (b"0", b"1"):
                        # on, even before the bytes are out: they may be when an error is raised
                        self._on = kind == b"1"
                        if self._write(content) and kind == b"0":
                            self._tell(b"W")
        finally:
            self._end()

    def _turn_off(self, silent: bool) -> None:
        self._on = False
        self._write(self.off)
        why = (
            f"the drive was silent for {self.silence:g} s"
            if silent
            else f"the field was on for {self.longest:g} s"
        )
        self._tell(b"S", why.encode())

    def _write(self, data: bytes) -> bool:
        """Send a packet, and return whether the line was there. Open a lost line again."""
        try:
            if self._lost:  # it may still take bytes
                raise ConnectionCutError("the line is lost")
            self.transport.write(data)
        except ConnectionCutError as error:
            self._tell(b"E", str(error).encode())
            self._reopen(0.0)
            return False
        return True

    def _reopen(self, patience: float) -> None:
        """Open a lost line again, and say "off" first of all."""
        until = _now() + patience
        while True:
            try:
                self.transport.close()
                self.transport.open()
                self.transport.write(self.off)
                self._lost = False
                return
            except ConnectionCutError:
                if _now() >= until:
                    return
                time.sleep(READING)

    def _end(self) -> None:
        """Turn the field off, whatever it takes."""
        for _ in range(OFF_TIMES):
            if not self._write(self.off):
                self._reopen(LAST)
            time.sleep(OFF_PAUSE)
        self._ended = True
        self.transport.close()

    def _read(self) -> None:
        while not self._ended:
            try:
                data = self.transport.receive(READING)
            except ConnectionCutError as error:
                if not (self._ended or self._lost):
                    self._lost = True
                    self._tell(b"E", str(error).encode())
                time.sleep(READING)
                continue
            if data:
                self._tell(b"D", data)

    def _tell(self, kind: bytes, data: bytes = b"") -> None:
        with self._lock, suppress(OSError, ValueError):  # the drive may be gone
            self._out.write(pack(kind, data[:LONGEST]))


def _now() -> float:
    return time.monotonic()


def main() -> None:
    """Run the process: its argument says what to keep, in JSON."""
    for number in (signal.SIGINT, getattr(signal, "SIGHUP", signal.SIGINT)):
        signal.signal(number, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    settings: dict[str, Any] = json.loads(sys.argv[1])
    out = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # nothing else may write among the messages
    try:
        keeper = Keeper(
            open_transport(settings["address"]),
            bytes.fromhex(settings["off"]),
            silence=settings["silence"],
            longest=settings["longest"],
            out=out,
        )
        keeper.run(0)
    except (ConnectionCutError, ShoalError) as error:
        with suppress(OSError):
            out.write(pack(b"E", str(error).encode()[:LONGEST]))


if __name__ == "__main__":
    main()
