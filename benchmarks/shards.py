"""python -m benchmarks.shards [TRIALS]: one sweep as rows of the store, and as shards in Parquet, one
for each batch of a worker: CPU seconds to write, to find what is missing, and to average a measure.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.dataset
import pyarrow.parquet as pq

from benchmarks.store import fill, large
from shoal.lab import Store
from shoal.lab.statistics import estimate, summarise
from shoal.lab.sweep import trial_seed

TRIALS = 1_000_000


def measure(text: str, call: Callable[[], Any]) -> Any:
    began = time.process_time()
    found = call()
    print(f"{text}: {time.process_time() - began:.2f} CPU s", flush=True)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("trials", nargs="?", type=int, default=TRIALS)
    sweep = large(parser.parse_args().trials)
    pa.set_cpu_count(1)
    estimate([1, 2, 3])
    with tempfile.TemporaryDirectory() as folder:
        path, shards = Path(folder) / "a.sqlite", Path(folder) / "shards"
        shards.mkdir()
        with Store(path, write=True) as store:
            measure("store: write", lambda: fill(store, sweep, skip=9973))
            measure("store: what is missing", lambda: len(store.missing(sweep)))
            measure("store: summary", lambda: len(summarise(store, sweep.name, "moves")))
        measure("shards: write", lambda: write(shards, sweep))
        measure("shards: what is missing", lambda: present(shards))
        measure("shards: means of a measure", lambda: len(means(shards)))
        files = [*shards.iterdir()]
        size = sum(file.stat().st_size for file in files)
        print(f"store: {path.stat().st_size / sweep.total:.0f} bytes a trial")
        print(f"shards: {size / sweep.total:.0f} bytes a trial in {len(files)} files")


def write(shards: Path, sweep: Any) -> None:
    """Write a file for each point, with the numbers that `benchmarks.store.fill` commits."""
    for point in sweep.points:
        k = np.arange(sweep.trials)
        columns = {
            "point": np.full(len(k), point.number),
            "trial": k,
            "seed": [trial_seed(sweep.seed, point.seeds, one) for one in k.tolist()],
            "status": ["complete"] * len(k),
            "moves": 211 + k % 97,
            "scans": 212 + k % 97,
            "cost": 2331.0 + k,
            "distance": 98765 + k,
        }
        pq.write_table(pa.table(columns), shards / f"{point.number}.parquet")


def present(shards: Path) -> int:
    """Return the number of trials, of which each file tells its point and its trials."""
    return sum(
        pq.read_table(file, columns=["point", "trial"]).num_rows for file in shards.iterdir()
    )


def means(shards: Path) -> Any:
    """Return the mean and the spread of a measure at each point."""
    table = pyarrow.dataset.dataset(shards).to_table(columns=["point", "moves"])
    return table.group_by("point").aggregate([("moves", "mean"), ("moves", "stddev")])


if __name__ == "__main__":
    main()
