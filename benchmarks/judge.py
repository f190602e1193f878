#!/usr/bin/env python3
"""A second plant, to judge drives: it shares no code with Shoal, and needs NumPy only.

python benchmarks/judge.py MAP.txt --particles 20 --tcp 4000 [--radius .35] [--ghosts 1]
shoal drive MAP.txt --rig tcp:localhost:4000 --json

Where Shoal's plant (`shoal.rigs.physics`) asks a rigid-body engine, this one relaxes positions: in
each short step, every disc moves with the field, and then leaves the walls and, with --solid, half
of its overlap with other discs. Without --solid, discs pass through each other and share cells.
Commands are short by --short, each disc has a gain of its own, all turn by --heading, and the
camera shows the cell of each centroid, misses some, and sees ghosts.

The rig speaks version 1 of the protocol of docs/concepts/rigs.md.
"""

from __future__ import annotations

import argparse
import json
import socket
import zlib
from pathlib import Path

import numpy as np

WAYS = {"l": (0, -1), "r": (0, 1), "u": (-1, 0), "d": (1, 0)}
STEPS = 12  # of one command
AROUND = [(row, column) for row in (-1, 0, 1) for column in (-1, 0, 1)]


class Discs:
    """Discs in a vessel of unit cells; positions are (row, column), cell (0, 0) covers [0, 1)."""

    def __init__(self, free: np.ndarray, given: argparse.Namespace) -> None:
        self.free, self.given = np.pad(free, 2), given
        self.rng = np.random.default_rng(given.seed)
        cells = np.argwhere(free)
        start = cells[self.rng.choice(len(cells), given.particles, replace=False)]
        self.at = start + 0.5
        self.gains = self.rng.normal(1, given.gain, len(start))
        self.turn = np.radians(given.heading)

    def move(self, command: str) -> None:
        """Carry out one command."""
        row, column = WAYS[command]
        sine, cosine = np.sin(self.turn), np.cos(self.turn)
        way = np.array([row * cosine - column * sine, row * sine + column * cosine])
        pulse = (1 - self.given.short) * self.rng.normal(1, self.given.pulse)
        lengths = self.gains * pulse * self.rng.normal(1, self.given.shake, len(self.at))
        for _ in range(STEPS):
            self.at += way * (lengths / STEPS)[:, None]
            for _ in range(3):
                if self.given.solid:
                    self.leave_discs()
                self.leave_walls()

    def leave_discs(self) -> None:
        """Move each two discs apart by half of their overlap."""
        apart = self.at[:, None] - self.at[None]
        far = np.hypot(*np.moveaxis(apart, -1, 0))
        np.fill_diagonal(far, np.inf)
        overlap = np.maximum(0.0, 2 * self.given.radius - far)
        share = 0.25 * overlap / np.maximum(far, 1e-9)
        self.at += (apart * share[..., None]).sum(axis=1)

    def leave_walls(self) -> None:
        """Move each disc out of the cells around it that are walls."""
        radius = self.given.radius
        home = np.floor(self.at).astype(int)
        for step in AROUND:
            if step == (0, 0):
                continue
            cell = home + step
            wall = ~self.free[tuple((cell + 2).T)]
            nearest = np.clip(self.at, cell, cell + 1)
            line = self.at - nearest
            far = np.maximum(np.hypot(line[:, 0], line[:, 1]), 1e-9)
            deep = np.where(wall, np.maximum(0.0, radius - far), 0.0)
            self.at += line * (deep / far)[:, None]

    def picture(self) -> list[list[int]]:
        """Return the cell of each centroid that the camera finds."""
        given, rng = self.given, self.rng
        seen = self.at[rng.random(len(self.at)) >= given.miss]
        seen = seen + rng.normal(0, given.blur, seen.shape)
        sides = np.array(self.free.shape) - 4
        ghosts = rng.random((rng.poisson(given.ghosts), 2)) * sides
        points = np.clip(np.vstack([seen, ghosts]), 0, sides - 1e-9)
        return np.floor(points).astype(int).tolist()


def written(message: dict) -> bytes:
    """Return the line of a message."""
    body = json.dumps(message, separators=(",", ":"))[:-1].encode()
    return body + b',"crc":"%08x"}\n' % zlib.crc32(body)


def understood(line: bytes) -> dict | None:
    """Return the message of a line, or None if it is damaged."""
    body, found, end = line.strip().rpartition(b',"crc":"')
    if not found or end != b'%08x"}' % zlib.crc32(body):
        return None
    return json.loads(body + b"}")


class Session:
    """What the rig remembers of a session: numbers, the last answer, and the stop."""

    def __init__(self, discs: Discs, shape: tuple[int, int]) -> None:
        self.discs, self.shape = discs, shape
        self.name, self.done, self.last, self.stopped = None, 0, b"", False
        self.moves = 0

    def answer(self, line: bytes) -> bytes:
        """Return what the rig says to a line."""
        if not line.strip():
            return b""
        message = understood(line)
        if message is None:
            return written({"type": "again"})
        kind = message["type"]
        if kind == "stop":
            self.stopped = True
            return written({"type": "stopped"})
        if kind == "hello":
            if message["session"] != self.name:
                self.name, self.done, self.last, self.stopped = message["session"], 0, b"", False
            about = {"shape": list(self.shape), "rule": "block", "name": "judge"}
            session = {"protocol": 1, "session": self.name, "seq": self.done}
            return written({"type": "welcome", **session, **about})
        number = message["seq"]
        if number == self.done:
            return self.last
        if number < self.done:
            return b""
        if number > self.done + 1 or (self.stopped and kind == "command"):
            return written({"type": "error", "seq": number, "text": "not now"})
        if kind == "command":
            self.discs.move(message["command"])
            self.moves += 1
            reply = {"type": "done", "seq": number}
        else:
            reply = {"type": "positions", "seq": number, "cells": self.discs.picture()}
        self.done, self.last = number, written(reply)
        return self.last


def main() -> None:
    """Read the map and the properties, and serve one connection after another."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("map", type=Path, help="text map: . is free, # is a wall")
    parser.add_argument("--particles", type=int, default=20)
    parser.add_argument("--tcp", type=int, required=True, help="listen on this port")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--once", action="store_true", help="end after the first stop")
    parser.add_argument("--solid", action="store_true", help="discs push each other")
    about = {
        "radius": (0.35, "radius of the discs, in cells"),
        "short": (0.02, "share by which commands are short"),
        "gain": (0.05, "standard deviation of the own gain of each disc"),
        "pulse": (0.01, "standard deviation of the length of a command"),
        "shake": (0.02, "standard deviation of the length, of each disc at each command"),
        "heading": (2.0, "degrees by which all motions are turned"),
        "blur": (0.03, "standard deviation of centroids, in cells"),
        "miss": (0.0, "share of the discs that a picture misses"),
        "ghosts": (0.0, "mean number of centroids of nothing in a picture"),
    }
    for name, (usual, text) in about.items():
        parser.add_argument(f"--{name}", type=float, default=usual, help=f"{text} ({usual:g})")
    given = parser.parse_args()
    free = np.array([[letter == "." for letter in row] for row in given.map.read_text().split()])
    session = Session(Discs(free, given), free.shape)
    with socket.create_server(("127.0.0.1", given.tcp)) as server:
        while not (given.once and session.stopped):
            connection, _ = server.accept()
            with connection, connection.makefile("rwb", buffering=0) as lines:
                while line := lines.readline():
                    if reply := session.answer(line):
                        lines.write(reply)


if __name__ == "__main__":
    main()
