"""python -m benchmarks.kills [KILLS]: kill -9 coordinators and workers of a sweep at random moments; the table must not notice.

After every kill the store is checked; at the end its rows are compared with those of a run without any.
"""

from __future__ import annotations

import os
import random
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from shoal.lab import Store, Sweep, run_sweep
from shoal.lab.storage.integrity import faults_of

SPEC = """
name = "killed"
trials = {trials}
seed = 11
paired = ["policy"]
[problem]
kind = "swarm"
map = "maze:21x15"
[axes]
policy = ["closest-frontier", "elect-particle", "random-moves"]
particles = {{ from = 4, to = 20, step = 2 }}
"""
LONGEST = 3.0  # seconds until a kill, from the start or, four times in five, from the first batch on


def children(process: int) -> list[int]:
    """Return the worker processes of a coordinator: its children but the one that tracks shared memory."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
            command = (stat.parent / "cmdline").read_text()
        except OSError:
            continue  # it has ended meanwhile
        if int(fields[1]) == process and "resource_tracker" not in command:
            found.append(int(stat.parent.name))
    return found


def start(spec: Path, store: Path) -> subprocess.Popen[bytes]:
    command = [
        sys.executable,
        "-c",
        "from shoal.__main__ import main; main()",
        "sweep",
        "run",
        str(spec),
        "--store",
        str(store),
        "--workers",
        "2",
    ]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def batches_of(store: Path) -> int:
    try:
        with sqlite3.connect(f"file:{store}?mode=ro", uri=True) as connection:
            return int(connection.execute("SELECT count(*) FROM batches").fetchone()[0])
    except sqlite3.Error:  # not made yet
        return 0


def wait_for_batch(store: Path, coordinator: subprocess.Popen[bytes]) -> None:
    """Wait until the coordinator has committed something."""
    before = batches_of(store)
    while coordinator.poll() is None and batches_of(store) == before:
        time.sleep(0.02)


def faults_in(path: Path) -> list[str]:
    if not path.exists():
        return []
    with Store(path) as store:
        return faults_of(store)


def main() -> None:
    kills = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    trials = int(sys.argv[2]) if len(sys.argv) > 2 else 4000
    random.seed(5)
    killed: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        spec, store, whole = (Path(folder) / name for name in ("killed.toml", "killed.sqlite", "whole.sqlite"))
        spec.write_text(SPEC.format(trials=trials))
        sweep = Sweep.load(spec)
        coordinator, complete_after = None, 0
        while sum(killed.values()) < kills:
            if coordinator is None or coordinator.poll() is not None:
                if coordinator is not None and coordinator.returncode > 0:
                    raise SystemExit(f"the coordinator failed: {coordinator.stderr.read().decode()}")
                if coordinator is not None and coordinator.returncode == 0:
                    complete_after = complete_after or sum(killed.values())
                coordinator = start(spec, store)
            if random.random() < 0.8:
                wait_for_batch(store, coordinator)
            time.sleep(random.uniform(0, LONGEST))
            workers = children(coordinator.pid)
            victim = random.choice(workers) if workers and random.random() < 0.5 else coordinator.pid
            if coordinator.poll() is not None:
                continue
            os.kill(victim, signal.SIGKILL)
            killed["coordinator" if victim == coordinator.pid else "worker"] += 1
            if victim == coordinator.pid:
                coordinator.wait()
            wrong = faults_in(store)
            done = 0
            if store.exists():
                with Store(store) as opened:
                    done = opened.status("killed").done if "killed" in opened.names else 0
            print(
                f"kill {sum(killed.values())}: {killed.most_common()}, {done} of {sweep.total} trials, faults: {wrong or 'none'}",
                flush=True,
            )
            if wrong:
                raise SystemExit(1)
        if coordinator is not None and coordinator.poll() is None:
            coordinator.wait()
        run_sweep(sweep, store, workers=2)
        run_sweep(sweep, whole, workers=0)
        with Store(store) as one, Store(whole) as other:
            same = [*one.rows("killed")] == [*other.rows("killed")]
            print(
                f"faults: {faults_of(one) or 'none'}; rows {'equal' if same else 'DIFFER FROM'} those of the run without kills",
                end="; ",
            )
            print(f"complete after {complete_after or 'all'} kills; orphans: {orphans() or 'none'}")
            sys.exit(not same)


def orphans() -> list[int]:
    """Return worker processes that outlived their coordinator."""
    return [
        int(path.parent.name)
        for path in Path("/proc").glob("[0-9]*/cmdline")
        if b"spawn_main" in _read(path) and (path.parent / "stat").read_text().rpartition(")")[2].split()[1] == "1"
    ]


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:
        return b""


if __name__ == "__main__":
    main()
