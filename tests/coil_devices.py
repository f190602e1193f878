"""Coil controllers for tests, on pseudo-terminals or TCP: they hold what they were told last."""

from __future__ import annotations

import os
import select
import socket
import threading
import time
import tty
from contextlib import suppress


class Terminal:
    """A pseudo-terminal, whose other side is this process."""

    def __init__(self):
        self.fd, self._other = os.openpty()
        tty.setraw(self.fd)
        tty.setraw(self._other)
        self.path = os.ttyname(self._other)
        self.address = f"serial:{self.path}"

    def read(self, timeout):
        return os.read(self.fd, 4096) if select.select([self.fd], [], [], timeout)[0] else b""

    def write(self, data):
        os.write(self.fd, data)

    def close(self):
        for end in (self.fd, self._other):
            with suppress(OSError):
                os.close(end)


class Server:
    """A TCP server for one connection after the other."""

    def __init__(self):
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"tcp:127.0.0.1:{self._listener.getsockname()[1]}"
        self._line = None

    def read(self, timeout):
        if self._line is None:
            if not select.select([self._listener], [], [], timeout)[0]:
                return b""
            self._line = self._listener.accept()[0]
        if not select.select([self._line], [], [], timeout)[0]:
            return b""
        with suppress(ConnectionError):
            if data := self._line.recv(4096):
                return data
        self.cut()
        return b""

    def write(self, data):
        if self._line is not None:
            self._line.sendall(data)

    def cut(self):
        """Close the connection."""
        if self._line is not None:
            self._line.close()
            self._line = None

    def close(self):
        self.cut()
        self._listener.close()


class Controller:
    """Reads packets in a thread. ``take(controller, data)`` returns the answer to what has come; it
    appends to ``log`` what it was told to do.
    """

    def __init__(self, line, take):
        self.line, self.take, self.log = line, take, []
        self._going = True
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self):
        while self._going:
            try:
                data = self.line.read(0.01)
                if data and (answer := self.take(self, data)):
                    self.line.write(answer)
            except OSError:
                if self._going:
                    time.sleep(0.01)

    def wait(self, condition, timeout=10.0):
        """Wait until ``condition(log)`` is true."""
        until = time.monotonic() + timeout
        while not condition(self.log):
            assert time.monotonic() < until, self.log
            time.sleep(0.002)

    def close(self):
        self._going = False
        self._thread.join()
        self.line.close()

    def __enter__(self):
        return self

    def __exit__(self, *_error):
        self.close()


def lines(answer=lambda line: b"OK\n"):
    """Return what takes lines of text, notes them, and answers each."""
    rest = bytearray()

    def take(controller, data):
        rest.extend(data)
        answers = b""
        while b"\n" in rest:
            line, _, left = bytes(rest).partition(b"\n")
            rest[:] = left
            controller.log.append(line.decode())
            answers += answer(line.decode()) or b""
        return answers

    return take
