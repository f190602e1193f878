"""Searches over radio modems: python -m benchmarks.serial_radio [--robots N] [--baud B] [--duty D]

Each robot is a process of its own (shoal robot) at one end of a pseudo-terminal. A hub at the other
ends hands every byte to all other robots, at the rate of the line at most, and breaks a share of the
bytes. Time may pass faster: --speed-up 4 with --baud 38400 is 9600 baud in a quarter of the time.
One row a search: whether it is complete, what the robots sent (bytes and messages a second of one
robot and of all, share of the time in which one sends), and what arrived.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import selectors
import subprocess
import sys
import tempfile
import threading
import time
import tty
from collections import deque
from contextlib import suppress

import shoal
from shoal.robots.tasks import write_task


class Bus:
    """A hub of pseudo-terminals, on which everything that one end sends arrives at all others."""

    def __init__(self, ends: int, *, rate: float, broken: float, seed: int = 0) -> None:
        pairs = [os.openpty() for _ in range(ends)]
        for _, end in pairs:
            tty.setraw(end)
        self.paths = [os.ttyname(end) for _, end in pairs]
        self.sent = [0] * ends  # bytes
        self.frames = self.unread = 0
        self._pairs, self._rate, self._broken = pairs, rate, broken
        self._random, self._ended = random.Random(seed), False
        self._thread = threading.Thread(target=self._carry, daemon=True)
        self._thread.start()

    def _carry(self) -> None:
        selector = selectors.DefaultSelector()
        hubs = [hub for hub, _ in self._pairs]
        waiting: list[deque[int]] = [deque() for _ in hubs]
        for number, hub in enumerate(hubs):
            os.set_blocking(hub, False)
            selector.register(hub, selectors.EVENT_READ, number)
        before = time.monotonic()
        credit = 0.0
        while not self._ended:
            for key, _ in selector.select(0.005):
                data = os.read(key.fd, 4096)
                self.sent[key.data] += len(data)
                self.frames += data.count(0) // 2  # zeros stand before and after a frame
                for number, queue in enumerate(waiting):
                    if number != key.data:
                        queue.extend(data)
            now = time.monotonic()
            credit = min(credit + (now - before) * self._rate, self._rate)
            before = now
            share = int(credit)
            credit -= share
            for hub, queue in zip(hubs, waiting, strict=True):
                data = bytes(self._through(queue.popleft()) for _ in range(min(share, len(queue))))
                written = 0
                if data:
                    with suppress(BlockingIOError):  # nobody reads: a robot that has ended
                        written = os.write(hub, data)
                self.unread += len(data) - written

    def _through(self, byte: int) -> int:
        return self._random.randrange(256) if self._random.random() < self._broken else byte

    def close(self) -> None:
        """End the hub."""
        self._ended = True
        self._thread.join()
        for pair in self._pairs:
            for end in pair:
                os.close(end)


def search(given: argparse.Namespace, seed: int) -> dict[str, object]:
    """Return what came of one search."""
    with tempfile.TemporaryDirectory() as folder:
        episode = shoal.run(given.region, robots=given.robots, footprint=10, seed=seed)
        write_task(episode, folder)
        rate = given.baud / 10
        bus = Bus(given.robots, rate=rate, broken=given.broken, seed=seed)
        begun = time.monotonic()
        robots = [
            subprocess.Popen(
                [
                    *(sys.executable, "-m", "shoal", "robot", folder, f"--id={number}", "--json"),
                    f"--radio=serial:{path}@{given.baud},duty={given.duty:g}",
                    f"--speed-up={given.speed_up:g}",
                ],
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
            )
            for number, path in enumerate(bus.paths, 1)
        ]
        results = []
        for robot in robots:
            try:
                results.append(json.loads(robot.communicate(timeout=given.timeout)[0]))
            except (subprocess.TimeoutExpired, ValueError):
                robot.kill()
                robot.communicate()
        seconds = time.monotonic() - begun
        bus.close()
    messages = [result["messages"] for result in results]
    heard, refused = (sum(one[name] for one in messages) for name in ("heard", "refused"))
    return {
        "complete": sum(bool(result["complete"]) for result in results),
        "searched": sum(int(result["searched"]) for result in results),
        "seconds": round(seconds * given.speed_up),
        "bytes a second of one": round(max(bus.sent) / seconds / given.speed_up, 1),
        "bytes a second of all": round(sum(bus.sent) / seconds / given.speed_up, 1),
        "sending": round(max(bus.sent) / seconds / rate, 3),
        "messages a second of all": round(bus.frames / seconds / given.speed_up, 2),
        "arrived": round(heard / bus.frames / (given.robots - 1), 3),
        "refused": refused,
        "unread": bus.unread,
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--region", default="rectangle:120x80")
    parser.add_argument("--robots", type=int, default=12)
    parser.add_argument("--searches", type=int, default=3)
    parser.add_argument("--baud", type=int, default=9600)
    parser.add_argument("--duty", type=float, default=0.05)
    parser.add_argument("--broken", type=float, default=0.05)
    parser.add_argument("--speed-up", type=float, default=1.0)
    parser.add_argument("--timeout", type=float, default=900.0)
    options = parser.parse_args()
    for number in range(options.searches):
        print(json.dumps(search(options, number)), flush=True)
