"""python -m benchmarks.clusters [TRIALS]: one sweep with local and with Dask workers, of which some
are killed; the tables must be equal. Seconds of processors, not of the clock, as tests share them.

With --cheap, a trial only draws a number, so that the cost is that of the sweep itself.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import resource
import signal
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import psutil
from distributed import Client, LocalCluster

from shoal.lab import Store, Sweep, run_sweep

WORKERS = (1, 2, 4)
TRIALS = 20_000
KILLS = 2


def draw(*, seed: int, particles: int) -> dict[str, float]:
    """Return a number that depends on the seed: the cheapest trial."""
    return {"drawn": random.Random(seed).random() * particles}


draw.measures = ["drawn"]  # type: ignore[attr-defined]


def sweep_of(trials: int, *, cheap: bool = False) -> Sweep:
    """Return a sweep of so many trials at ten points."""
    episode = {"kind": "swarm", "map": "maze:9x7", "policy": "closest-frontier"}
    return Sweep(
        name="cluster",
        problem={"kind": "function", "function": f"{__spec__.name}:draw"} if cheap else episode,
        axes={"particles": [*range(1, 11)]},
        trials=trials // 10,
        seed=5,
    )


def digest_of(path: Path) -> str:
    """Return a digest of all rows of a store."""
    digest = hashlib.blake2b(digest_size=8)
    with Store(path) as store:
        for chunk in store.chunks("cluster"):
            digest.update(repr(chunk).encode())
    return digest.hexdigest()


class Children:
    """The processes that this process has started, and theirs: their seconds of processors."""

    def __init__(self, kills: int) -> None:
        self.kills, self.killed = kills, 0
        self.seconds: dict[int, float] = {}
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._watch)

    def __enter__(self) -> Children:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()

    def look(self) -> None:
        """Note the seconds of all processes; a process that ends keeps what was noted last."""
        for process in psutil.Process().children(recursive=True):
            try:
                times = process.cpu_times()
            except psutil.Error:
                continue
            self.seconds[process.pid] = times.user + times.system

    def _watch(self) -> None:
        while not self._end.wait(0.1):
            self.look()

    def kill(self, _: Any) -> None:
        """Kill the process that has worked longest, after a batch, until there were enough."""
        self.look()
        busy = {pid: s for pid, s in self.seconds.items() if s > 1 and psutil.pid_exists(pid)}
        if self.killed < self.kills and busy:
            pid = max(busy, key=lambda pid: busy[pid])
            os.kill(pid, signal.SIGKILL)
            del self.seconds[pid]
            self.killed += 1


def measure(sweep: Sweep, workers: int, *, dask: bool, kills: int) -> str:
    """Run the sweep in a store of its own, print a line, and return the digest of its rows."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "s.sqlite"
        with Children(kills) as children:
            options: dict[str, Any] = {"workers": workers}
            cluster = None
            if dask:
                cluster = LocalCluster(
                    n_workers=workers, threads_per_worker=1, dashboard_address=None
                )
                options = {"dask": cluster.scheduler_address}
                Client(cluster).wait_for_workers(workers)
            children.look()
            idle, own, began = dict(children.seconds), time.process_time(), time.perf_counter()
            status = run_sweep(sweep, path, on_progress=children.kill, **options)
            seconds, own = time.perf_counter() - began, time.process_time() - own
            children.look()
            spent = sum(s - idle.get(pid, 0.0) for pid, s in children.seconds.items())
            if cluster is not None:
                cluster.close()
        assert status.complete, status
        digest = digest_of(path)
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        size = path.stat().st_size / sweep.total
    print(
        f"| {'Dask' if dask else 'local'} | {workers} | {children.killed} |"
        f" {sweep.total / (spent + own):.0f} | {1e6 * own / sweep.total:.0f} µs | {seconds:.1f} s |"
        f" {memory:.0f} MiB | {size:.0f} | `{digest}` |",
        flush=True,
    )
    return digest


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("trials", type=int, nargs="?", default=TRIALS)
    parser.add_argument("--cheap", action="store_true", help="trials that only draw a number")
    parser.add_argument("--workers", type=int, nargs="+", default=WORKERS)
    parser.add_argument("--kinds", nargs="+", choices=("local", "dask"), default=("local", "dask"))
    given = parser.parse_args()
    sweep = sweep_of(given.trials, cheap=given.cheap)
    print(f"{sweep.total} trials\n")
    print(
        "| workers | number | killed | trials a CPU second | coordinator's CPU time a trial |"
        " elapsed | coordinator's memory | bytes a trial | digest of the table |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    digests = {measure(sweep, 1, dask=False, kills=0)}
    for kind in given.kinds:
        digests |= {
            measure(sweep, workers, dask=kind == "dask", kills=KILLS) for workers in given.workers
        }
    assert len(digests) == 1, digests


if __name__ == "__main__":
    main()
