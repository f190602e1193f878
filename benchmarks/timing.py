"""Honest times: the best of several runs of many repetitions, side by side in one process."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).parent.parent


def best_seconds(
    run: Callable[[], object], *, repeat: int = 7, clock: Callable[[], float] = time.perf_counter
) -> float:
    """Return the shortest time of several calls: what is left when nothing else disturbs."""
    times = []
    for _ in range(repeat):
        began = clock()
        run()
        times.append(clock() - began)
    return min(times)


def process(*arguments: str) -> tuple[float, str]:
    """Run a Python process from start to end; return (seconds, what it printed)."""
    began = time.perf_counter()
    done = subprocess.run(
        [sys.executable, *arguments], cwd=ROOT, check=True, capture_output=True, text=True
    )
    return time.perf_counter() - began, done.stdout


def row(what: str, figure: str, target: str, met: bool) -> None:
    """Print one line of the report."""
    print(f"{what:<58} {figure:>22}   {target:<28} {'ok' if met else 'NOT MET'}", flush=True)
