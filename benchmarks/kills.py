"""python -m benchmarks.kills [KILLS [DISKS]]: kill sweeps at random moments, and let disks be full
at any stage.

SIGKILL, SIGTERM and SIGINT go to the coordinator, to one of its workers, or to all of them. A disk
is a small file system in memory, of a size between nothing and what the whole store takes; it grows
before the same command is run again. After each the store is checked, and at the end its rows are
compared with those of a run without any.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import closing
from pathlib import Path
from typing import Any

from shoal.lab import Store, Sweep, run_sweep
from shoal.lab.store import faults_of, is_locked

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
LONGEST = (
    2.0  # seconds until a kill, from the start or, four times in five, from the first batch on
)
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
VICTIMS = ("coordinator", "worker", "group")
ROOM = 2**26  # bytes of a disk that has grown


def sweep_command(spec: Path, store: Path) -> list[str]:
    return [
        sys.executable,
        "-m",
        "shoal",
        "sweep",
        "run",
        str(spec),
        "--store",
        str(store),
        "--workers",
        "2",
    ]


def workers_of(coordinator: int) -> list[int]:
    """Return the worker processes of a coordinator: its children but the one that tracks shared
    memory.
    """
    return [
        process
        for process, parent, command in _processes()
        if parent == coordinator and b"resource_tracker" not in command
    ]


def orphans() -> list[int]:
    """Return worker processes that outlived their coordinator."""
    return [
        process
        for process, parent, command in _processes()
        if parent == 1 and b"spawn_main" in command
    ]


def _processes() -> list[tuple[int, int, bytes]]:
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(stat.read_text().rpartition(")")[2].split()[1])
            found.append((int(stat.parent.name), parent, (stat.parent / "cmdline").read_bytes()))
        except OSError:
            continue  # it has ended meanwhile
    return found


def wait_for_batch(store: Path, coordinator: subprocess.Popen[bytes]) -> None:
    """Wait until the coordinator has committed something."""
    before = _batches_in(store)
    while coordinator.poll() is None and _batches_in(store) == before:
        time.sleep(0.02)


def _batches_in(store: Path) -> int:
    try:
        with closing(sqlite3.connect(f"file:{store}?mode=ro", uri=True)) as connection:
            return int(connection.execute("SELECT count(*) FROM batches").fetchone()[0])
    except sqlite3.Error:  # not made yet
        return 0


def rows_of(path: Path) -> list[Any]:
    with Store(path) as store:
        return [*store.rows("killed")]


def faults_in(path: Path, *, lock: bool = False) -> list[str]:
    """Return what is wrong with a store and its folder; a lock, which nobody holds, is left by
    SIGKILL until the next takes it.
    """
    ours = {path.name + end for end in ("", "-wal", "-shm")} | (
        {f".{path.name}.killed.lock"} if lock else set()
    )
    wrong = [f"left behind: {one.name}" for one in path.parent.iterdir() if one.name not in ours]
    if path.exists():
        with Store(path) as store:
            wrong += faults_of(store)
    return wrong


def done_in(path: Path) -> int:
    if not path.exists():
        return 0
    with Store(path) as store:
        return store.status("killed").done if "killed" in store.names else 0


def kill(spec: Path, store: Path, kills: int) -> list[str]:
    """Kill sweeps and run them again; return what was wrong."""
    killed: Counter[str] = Counter()
    wrong: list[str] = []
    coordinator = None
    while sum(killed.values()) < kills:
        if coordinator is None:
            coordinator = subprocess.Popen(
                sweep_command(spec, store),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                start_new_session=True,
            )
        if random.random() < 0.8:
            wait_for_batch(store, coordinator)
        time.sleep(random.uniform(0, LONGEST))
        number, victim = random.choice(SIGNALS), random.choice(VICTIMS)
        workers = workers_of(coordinator.pid)
        if coordinator.poll() is None and (workers or victim != "worker"):
            if victim == "group":
                os.killpg(coordinator.pid, number)
            else:
                os.kill(random.choice(workers) if victim == "worker" else coordinator.pid, number)
            killed[f"{number.name} to {victim}"] += 1
            wrong += [] if victim == "worker" else _ended(coordinator, number)
            wrong += faults_in(store, lock=True)
            wrong += (
                ["the lock is held"]
                if coordinator.poll() is not None and is_locked(store, "killed")
                else []
            )
            print(
                f"kill {sum(killed.values())}: {number.name} to {victim}, {done_in(store)} trials"
                f" done, {wrong or 'nothing wrong'}",
                flush=True,
            )
        if coordinator.poll() is not None:
            if coordinator.returncode not in (0, 130, -9):
                stderr = coordinator.stderr
                said = stderr.read().decode() if stderr and not stderr.closed else ""
                wrong.append(f"exit code {coordinator.returncode}: {said}")
            # begun anew: what is complete cannot be killed
            if done_in(store) and coordinator.returncode == 0:
                store.unlink()
            coordinator = None
    if coordinator is not None:
        coordinator.wait()
    subprocess.run(sweep_command(spec, store), check=True, capture_output=True)
    print(f"{kills} kills: {dict(sorted(killed.items()))}")
    return wrong + faults_in(store)


def _ended(coordinator: subprocess.Popen[bytes], number: signal.Signals) -> list[str]:
    """Return what is wrong with how a coordinator ends that got a signal: 130 and one line, or as
    SIGKILL has it.
    """
    started = time.monotonic()
    said = coordinator.communicate()[1].decode()
    wrong = (
        [f"{time.monotonic() - started:.1f} s after {number.name}"]
        if time.monotonic() - started > 3
        else []
    )
    lines = [
        line for line in said.splitlines() if line.startswith("shoal: ") and "warning" not in line
    ]
    good = (
        number == signal.SIGKILL
        or coordinator.returncode == 0
        or (coordinator.returncode == 130 and len(lines) == 1)
    )
    early = coordinator.returncode == -number and not said  # while Python itself began
    return (
        wrong
        if (good or early) and "Traceback" not in said
        else [*wrong, f"{coordinator.returncode} after {number.name}: {said}"]
    )


def fill(spec: Path, folder: Path, disks: int, size: int) -> list[str]:
    """Run sweeps on disks from nothing to the size of the whole store, then again with room; return
    what was wrong.
    """
    wrong, stages = [], Counter[str]()
    for number in range(disks):
        disk = folder / f"disk-{number}"
        disk.mkdir()
        room = 4096 + 2 * size * number // max(disks - 1, 1)  # the log is as large as the file
        _mount(disk, f"size={room}")
        store = disk / "store"
        ended = subprocess.run(
            sweep_command(spec, store), capture_output=True, text=True, check=False
        )
        said = [line for line in ended.stderr.splitlines() if line.startswith("shoal: ")]
        if (
            ended.returncode not in (0, 2)
            or (ended.returncode == 2) != (len(said) == 1)
            or "Traceback" in ended.stderr
        ):
            wrong.append(f"disk of {room} bytes: exit code {ended.returncode}: {ended.stderr}")
        stage = (
            "whole"
            if ended.returncode == 0
            else "no store"
            if not store.exists()
            else "no batch"
            if not done_in(store)
            else "some"
        )
        stages[stage] += 1
        wrong += faults_in(store)
        before = done_in(store)
        _mount(disk, f"remount,size={ROOM}")
        again = subprocess.run(
            sweep_command(spec, store), capture_output=True, text=True, check=False
        )
        if again.returncode:
            wrong.append(
                f"disk of {room} bytes, with room: exit code {again.returncode}: {again.stderr}"
            )
        wrong += faults_in(store)
        if rows_of(store) != rows_of(folder / "whole"):
            wrong.append(f"disk of {room} bytes: other rows than without")
        print(
            f"disk {number + 1}: {room} bytes, {stage}, {before} trials kept,"
            f" {' '.join(said)[:160]}; {wrong or 'nothing wrong'}",
            flush=True,
        )
        subprocess.run(["umount", disk], check=True)
    print(f"{disks} full disks: {dict(stages)}")
    return wrong


def _mount(disk: Path, options: str) -> None:
    subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", disk], check=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kills", nargs="?", type=int, default=50)
    parser.add_argument("disks", nargs="?", type=int, default=20)
    parser.add_argument("--alone", action="store_true", help="the mounts are seen by nobody else")
    given = parser.parse_args()
    if not given.alone:  # what is mounted is seen by nobody else, and any user may mount
        alone = [
            "unshare",
            "--map-root-user",
            "--mount",
            sys.executable,
            "-m",
            "benchmarks.kills",
            *sys.argv[1:],
            "--alone",
        ]
        sys.exit(subprocess.run(alone, check=False).returncode)
    kills, disks = given.kills, given.disks
    random.seed(5)
    # a shell's background ignores it, and so would the sweeps
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "kills").mkdir()
        spec, store, whole = folder / "killed.toml", folder / "kills" / "store", folder / "whole"
        spec.write_text(SPEC.format(trials=400))
        wrong = []
        if kills:
            wrong += kill(spec, store, kills)
            run_sweep(Sweep.load(spec), whole, workers=0)
            wrong += [] if rows_of(store) == rows_of(whole) else ["other rows than without kills"]
            whole.unlink()
        if disks:
            spec.write_text(SPEC.format(trials=100))
            run_sweep(Sweep.load(spec), whole, workers=0)
            wrong += fill(spec, folder, disks, whole.stat().st_size)
    print(
        f"{kills} kills, {disks} full disks: {wrong or 'nothing wrong'}; orphans:"
        f" {orphans() or 'none'}"
    )
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
