"""python -m benchmarks.store: a store of 10^6 trials: what is missing, status, export; seconds and
the largest memory.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from shoal.lab import Store, Sweep
from shoal.lab.batches import Answer, worker_versions
from shoal.lab.exchange import export, frame
from shoal.lab.store import faults_of
from shoal.lab.sweep import trial_seed

TRIALS = 1_000_000
POINTS = 1000


def measure(name: str, call: Callable[[], Any]) -> Any:
    began = time.perf_counter()
    result = call()
    mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"{name:24} {time.perf_counter() - began:6.2f} s, at most {mib:.0f} MiB so far", flush=True
    )
    return result


def fill(store: Store, sweep: Sweep, skip: int) -> None:
    """Commit all trials but every ``skip``-th, in batches as a run would."""
    store.add(sweep, {})
    for gap in store.missing(sweep):
        rows = [
            (
                gap.id,
                k,
                trial_seed(sweep.seed, gap.point.seeds, k),
                f'["complete",{211 + k % 97},{212 + k % 97},{2331.0 + k},{98765 + k}]',
            )
            for k in range(gap.first, gap.stop)
            if (gap.id * sweep.trials + k) % skip
        ]
        store.commit(sweep, Answer(rows, [], 0.5, [], worker_versions(), "benchmark"))


def large(trials: int, *, seed: int = 0) -> Sweep:
    """Return a sweep of so many trials at `POINTS` points."""
    axes = {
        "particles": {"from": 1, "to": POINTS // 2, "step": 1},
        "policy": ["closest-frontier", "elect-particle"],
    }
    problem = {"kind": "swarm", "map": "vessels:5000"}
    return Sweep(
        name="large",
        problem=problem,
        axes=axes,
        trials=trials // POINTS,
        seed=seed,
        paired=("policy",),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("trials", nargs="?", type=int, default=TRIALS)
    sweep = large(parser.parse_args().trials)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "large.sqlite"
        with Store(path, write=True) as store:
            measure("fill", lambda: fill(store, sweep, skip=9973))
        print(f"{path.stat().st_size / 2**20:.0f} MiB on disk")
        again = measure(
            "read the spec", lambda: Sweep(**{**sweep.describe(), "paired": tuple(sweep.paired)})
        )
        with Store(path) as store:
            gaps = measure("what is missing", lambda: store.missing(again))
            assert (
                sum(gap.stop - gap.first for gap in gaps)
                == sweep.total - store.status("large").done
            )
            measure("status", lambda: store.status("large"))
            measure("export to CSV", lambda: export(store, "large", Path(folder) / "large.csv"))
            measure(
                "export to Parquet", lambda: export(store, "large", Path(folder) / "large.parquet")
            )
            measure("check", lambda: faults_of(store))
            measure("data frame", lambda: len(frame(store, "large")))


if __name__ == "__main__":
    main()
