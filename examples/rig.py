#!/usr/bin/env python3
"""A reference rig: it simulates particles in a map and uses only Python's standard library.

The rig implements version 1 of Shoal's rig protocol (docs/concepts/rigs.md). Use it as a model for
a real rig in any language. In place of magnets and a camera, it has a text map and thirty lines of
physics.

    python examples/rig.py MAP.txt --particles 30 --pty /tmp/rig        a pseudo-terminal, for shoal drive --rig serial:/tmp/rig
    python examples/rig.py MAP.txt --particles 30 --tcp 4000            a TCP port, for --rig tcp:localhost:4000
    shoal drive --rig "exec:python examples/rig.py MAP.txt"           standard input and output

To simulate a bad connection, the rig can cut the line and damage messages: --cuts 10 --damage 0.05.
The signal SIGUSR1 pulls the cable for --pause seconds. With --count FILE, the rig writes down each
command that it has carried out.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import select
import signal
import socket
import sys
import time
import zlib
from pathlib import Path

PROTOCOL = 1
STEPS = {"l": (0, -1), "r": (0, 1), "u": (-1, 0), "d": (1, 0)}


class Swarm:
    """The physics: the move rule "block" in two dimensions."""

    def __init__(self, free: set[tuple[int, int]], particles: int, seed: int) -> None:
        self.free = free
        self.cells = set(random.Random(seed).sample(sorted(free), particles))

    def move(self, command: str) -> None:
        """Move all particles by one cell, the foremost first, so that trains move together and
        queues stay.
        """
        down, right = STEPS[command]
        for cell in sorted(self.cells, key=lambda cell: -(cell[0] * down + cell[1] * right)):
            ahead = cell[0] + down, cell[1] + right
            if ahead in self.free and ahead not in self.cells:
                self.cells.remove(cell)
                self.cells.add(ahead)


class Rig:
    """The protocol: the answer to each line, independent of the kind of connection."""

    def __init__(
        self, swarm: Swarm, shape: tuple[int, int], *, name: str, duration: float = 0.0
    ) -> None:
        self.swarm, self.shape, self.name, self.duration = swarm, shape, name, duration
        self.session, self.seq, self.answer, self.stopped = "", 0, b"", False
        self.count = lambda command: None  # told of each command that was carried out
        self.quiet = lambda seconds: (
            True
        )  # waits; returns whether no stop command arrived meanwhile

    def reply(self, line: bytes) -> bytes:
        """Return the answer to one line, or b"" if there is no answer."""
        if not line.strip():
            return b""
        message = decode_message(line)
        if message is None:
            return encode_message({"type": "again"})
        if message["type"] == "stop":  # at any time and in any session
            self.stopped = True
            return encode_message({"type": "stopped"})
        if message["type"] == "hello":
            return self.welcome(message)
        return self.numbered(message)

    def welcome(self, message: dict) -> bytes:
        """Begin a new session, or continue the known one."""
        if message["session"] != self.session:
            self.session, self.seq, self.answer, self.stopped = message["session"], 0, b"", False
        about = {"shape": list(self.shape), "rule": "block", "name": self.name}
        return encode_message(
            {
                "type": "welcome",
                "protocol": PROTOCOL,
                "session": self.session,
                "seq": self.seq,
                **about,
            }
        )

    def numbered(self, message: dict) -> bytes:
        """Carry out a request with the next number; repeat the answer to a request that was already
        carried out.
        """
        seq = message["seq"]
        if seq == self.seq and self.answer:
            return self.answer
        if seq < self.seq:
            return b""  # a late copy of an old request
        if seq != self.seq + 1:
            return encode_message(
                {"type": "error", "seq": seq, "text": f"expected request {self.seq + 1}, got {seq}"}
            )
        if message["type"] == "command":
            if self.stopped:
                return encode_message(
                    {"type": "error", "seq": seq, "text": "the rig has been stopped"}
                )
            if not self.quiet(self.duration):  # the time of a real command; a stop command ends it
                return encode_message(
                    {"type": "error", "seq": seq, "text": "the rig has been stopped"}
                )
            self.swarm.move(message["command"])
            self.count(message["command"])
            self.answer = encode_message({"type": "done", "seq": seq})
        else:
            self.answer = encode_message(
                {"type": "positions", "seq": seq, "cells": sorted(self.swarm.cells)}
            )
        self.seq = seq
        return self.answer


def encode_message(message: dict) -> bytes:
    """Return a line: JSON whose last member is the CRC-32 of all bytes before it."""
    text = json.dumps(message, separators=(",", ":")).encode()[:-1]
    return b'%s,"crc":"%08x"}\n' % (text, zlib.crc32(text))


def decode_message(line: bytes) -> dict | None:
    """Return the message of a line, or None if the line is damaged."""
    text, mark, rest = line.strip().rpartition(b',"crc":"')
    if not mark or rest != b'%08x"}' % zlib.crc32(text):
        return None
    return json.loads(text + b"}")


class BadLine:
    """A bad connection: it damages some messages and cuts the line from time to time."""

    def __init__(self, *, cuts: int, damage: float, every: int, seed: int) -> None:
        self.random, self.cuts, self.damage, self.every = random.Random(seed), cuts, damage, every
        self.messages = self.damaged = self.cut = 0
        self.pulled = False

    def carry(self, data: bytes) -> bytes:
        """Return the line as it arrives at the other end."""
        self.messages += 1
        if self.random.random() >= self.damage:
            return data
        self.damaged += 1
        where = self.random.randrange(len(data))
        kind = self.random.choice(["changed", "lost", "cut short", "twice"])
        if kind == "changed":
            return (
                data[:where]
                + bytes([data[where] ^ self.random.randint(1, 255)])
                + data[where + 1 :]
            )
        return {"lost": b"", "cut short": data[:where] + b"\n", "twice": data + data}[kind]

    def due(self) -> bool:
        """Return whether to cut the line now: just before an answer is sent, which is the worst
        moment.
        """
        if self.pulled:
            return True
        if self.cut < self.cuts and self.messages >= self.every * (self.cut + 1):
            self.cut += 1
            return True
        return False


class Wire:
    """Read lines from one file descriptor and write lines to another."""

    def __init__(self, reading: int, writing: int, bad: BadLine) -> None:
        self.reading, self.writing, self.bad, self.pending = reading, writing, bad, b""

    def more(self, seconds: float | None = None) -> bool:
        """Read the available bytes, waiting at most this long; return whether there were any."""
        if not select.select([self.reading], [], [], seconds)[0]:
            return False
        data = os.read(self.reading, 65536)
        if not data:
            raise ConnectionResetError
        self.pending += data
        return True

    def quiet(self, seconds: float) -> bool:
        """Wait this long; return False at once if a stop command arrives."""
        until = time.monotonic() + seconds
        while not any(
            (decode_message(line) or {}).get("type") == "stop" for line in self.pending.split(b"\n")
        ):
            left = until - time.monotonic()
            if left <= 0 or not self.more(left):
                return True
        return False

    def send(self, data: bytes) -> None:
        """Write all bytes."""
        while data:
            select.select([], [self.writing], [])
            data = data[os.write(self.writing, data) :]

    def serve(self, rig: Rig) -> None:
        """Answer every line until the other end closes or the line is cut."""
        rig.quiet = self.quiet
        with contextlib.suppress(ConnectionError):
            while True:
                while b"\n" not in self.pending:
                    self.more()
                line, _, self.pending = self.pending.partition(b"\n")
                if not line.strip():
                    continue
                for heard in self.bad.carry(line + b"\n").split(b"\n"):
                    answer = rig.reply(heard)
                    if self.bad.due():
                        return
                    if answer:
                        self.send(self.bad.carry(answer))


def serve_pty(rig: Rig, link: Path, bad: BadLine, pause: float) -> None:
    """Serve on a pseudo-terminal; after a cut, serve on a new one under the same name."""
    import pty
    import tty

    while True:
        here, there = pty.openpty()
        tty.setraw(there)
        link.unlink(missing_ok=True)
        link.symlink_to(os.ttyname(there))
        try:
            Wire(here, here, bad).serve(rig)
        finally:
            link.unlink(missing_ok=True)
            os.close(here)
            os.close(there)
        bad.pulled = False
        time.sleep(pause)


def serve_tcp(rig: Rig, port: int, bad: BadLine, pause: float = 0.0) -> None:
    """Serve TCP connections one after another."""
    with socket.create_server(("127.0.0.1", port)) as server:
        while True:
            connection, _ = server.accept()
            with connection:
                Wire(connection.fileno(), connection.fileno(), bad).serve(rig)
            if bad.pulled:
                bad.pulled = False
                time.sleep(pause)


def main() -> None:
    """Read the map and the arguments, and serve."""
    parser = argparse.ArgumentParser(description="A reference rig for shoal drive.")
    parser.add_argument("map", type=Path, help="text map: . is free, # is a wall")
    parser.add_argument("--particles", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--duration", type=float, default=0.0, help="seconds that a command takes")
    parser.add_argument(
        "--count", type=Path, help="file to which each command that was carried out is appended"
    )
    parser.add_argument("--pty", type=Path, help="make a pseudo-terminal under this name")
    parser.add_argument("--tcp", type=int, help="listen on this port")
    parser.add_argument("--cuts", type=int, default=0, help="how often to cut the line")
    parser.add_argument("--every", type=int, default=20, help="messages between two cuts")
    parser.add_argument("--pause", type=float, default=0.2, help="seconds that a cut lasts")
    parser.add_argument(
        "--damage", type=float, default=0.0, help="share of the messages that are damaged"
    )
    given = parser.parse_args()
    rows = given.map.read_text().split()
    free = {
        (row, column)
        for row, text in enumerate(rows)
        for column, letter in enumerate(text)
        if letter == "."
    }
    rig = Rig(
        Swarm(free, given.particles, given.seed),
        (len(rows), len(rows[0])),
        name=given.map.stem,
        duration=given.duration,
    )
    if given.count:
        book = given.count.open("a", buffering=1)
        rig.count = lambda command: print(command, file=book)
    bad = BadLine(cuts=given.cuts, damage=given.damage, every=given.every, seed=given.seed)
    if hasattr(signal, "SIGUSR1"):
        signal.signal(signal.SIGUSR1, lambda *_: setattr(bad, "pulled", True))
    with contextlib.suppress(KeyboardInterrupt):
        if given.pty:
            serve_pty(rig, given.pty, bad, given.pause)
        elif given.tcp:
            serve_tcp(rig, given.tcp, bad, given.pause)
        else:
            Wire(sys.stdin.fileno(), sys.stdout.fileno(), bad).serve(rig)


if __name__ == "__main__":
    main()
