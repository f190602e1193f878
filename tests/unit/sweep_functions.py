"""Functions that sweeps of the tests play: quick ones, ones that fail, ones that kill the worker
that plays them.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path

from shoal.lab.batches import worker_versions


def number(*, seed: int, factor: int = 1, pause: float = 0.0) -> dict[str, object]:
    """Return something that depends on the seed and an argument."""
    time.sleep(pause)
    return {
        "value": seed % 1000 * factor,
        "half": seed % 7 / 2,
        "word": "even" if seed % 2 == 0 else "odd",
    }


number.measures = ("value", "half", "word")


def sick(*, seed: int, factor: int, mark: str) -> dict[str, object]:
    """Fail always and at once in the process that comes first."""
    try:
        with Path(mark).open("x") as file:
            file.write(str(os.getpid()))
    except FileExistsError:
        time.sleep(0.02)
    if Path(mark).read_text() == str(os.getpid()):
        raise OSError("no room on this machine")
    return {"value": seed % 1000 * factor}


sick.measures = ("value",)


def lengths(*, seed: int, word: str) -> dict[str, object]:
    """Return the length of a word."""
    return {"length": len(word)}


lengths.measures = ("length",)


def picky(*, seed: int, limit: int) -> dict[str, object]:
    """Fail for some seeds."""
    if seed % 10 < limit:
        raise RuntimeError(f"seed {seed}\nis one that I do not like")
    return {"value": seed}


picky.measures = ("value",)


def deadly(*, seed: int, folder: str, times: int) -> dict[str, object]:
    """Kill the worker that plays it, so many times for each seed that ends with a 3."""
    mark = Path(folder) / str(seed)
    deaths = len(mark.read_text()) if mark.exists() else 0
    if seed % 10 == 3 and deaths < times:
        mark.write_text("x" * (deaths + 1))
        os.kill(os.getpid(), signal.SIGKILL)
    return {"value": seed}


deadly.measures = ("value",)


def endless(*, seed: int) -> dict[str, object]:
    """Return what JSON cannot hold."""
    return {"value": float("inf")}


endless.measures = ("value",)


def strange(*, seed: int, kind: str) -> dict[str, object]:
    """Return or do what no store can take."""
    if kind == "exit":
        raise SystemExit(0)
    return {
        "value": {
            "huge": 10**400,
            "list": [1, 2],
            "surrogate": "\ud800",
            "long": "x" * 10**6,
            "nan": float("nan"),
        }[kind]
    }


strange.measures = ("value",)


def torn(*, seed: int, mark: str) -> dict[str, object]:
    """Kill the worker once, in the middle of the answer that it writes to its executor."""
    try:
        Path(mark).touch(exist_ok=False)
    except FileExistsError:
        return {"value": seed % 1000}
    frame = sys._getframe()
    while "result_queue" not in frame.f_locals:
        frame = frame.f_back
    writer = frame.f_locals["result_queue"]._writer.fileno()
    os.write(writer, (1000).to_bytes(4, "big") + b"a part of 1000 bytes")
    os.kill(os.getpid(), signal.SIGKILL)
    return {}


torn.measures = ("value",)


def versions_at_the_second_start():
    """Return the versions of a worker, but kill the first worker that is asked."""
    if not Path("started").exists():
        Path("started").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return worker_versions()
