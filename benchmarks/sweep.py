"""Paper M's sweep: closest-frontier, 50 particle counts, 100 trials each."""

from __future__ import annotations

import time

from tests.swarm_runs import run_trials

from benchmarks.timing import row
from shoal import open_map


def bench_sweep() -> None:
    workspace = open_map("vessels:5000")
    began = time.perf_counter()
    for n in range(100, 5001, 100):
        run_trials(workspace, trials=100, particles=n)
    seconds = time.perf_counter() - began
    row(
        "100 trials x 50 counts of closest-frontier, vessels:5000",
        f"{seconds:.1f} s",
        "under 30 s on 2 cores",
        seconds < 30,
    )
