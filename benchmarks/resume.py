"""Drives of the reference rig that are interrupted again and again, over TCP, a pseudo-terminal and
pipes, and go on from their logs.

python -m benchmarks.resume                 ten interruptions, three drives for each connection
python -m benchmarks.resume --drives 1 --interruptions 4 --only tcp

Each interruption is SIGINT, SIGKILL or a pulled cable, at a random moment. The drive must find the map
of one that was not interrupted, its log must replay as one drive, and the commands that the rig has
counted must be those of the log. A program at the end of pipes dies with the drive, so that nobody knows
whether it has carried out a command that the log was the last to tell of: these are printed.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from shoal import open_map
from shoal.rigs import read_log, replay_log

RIG = Path(__file__).parents[1] / "examples" / "rig.py"
SHOAL = [sys.executable, "-c", "from shoal.__main__ import main; main()"]
MAP = "vessels:200"
PARTICLES = 20
KINDS = ("SIGINT", "SIGKILL", "cable")
DURATION, PAUSE, END_AFTER = 0.05, 2.0, 1.0  # seconds
WAITING = 60.0  # seconds for an interrupted drive to end


def free_port() -> int:
    """Return a port on which nobody listens."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def rig_of(process: subprocess.Popen[bytes], served: subprocess.Popen[bytes] | None) -> int | None:
    """Return the process number of the rig: the served one, or the program that the drive runs."""
    if served is not None:
        return served.pid
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return int(children[0]) if children else None


def interrupted(
    words: list[str], log: Path, kind: str, moves: int, served: subprocess.Popen[bytes] | None
) -> int:
    """Drive until the log holds so many more commands, interrupt, and return the exit code."""

    def sent() -> int:
        return log.read_bytes().count(b'"kind":"command"') if log.exists() else 0

    until = sent() + moves
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        while process.poll() is None and sent() < until:
            time.sleep(0.003)
        if process.poll() is None:
            if kind == "cable":
                rig = rig_of(process, served)
                if rig is not None:
                    os.kill(rig, signal.SIGUSR1)
            else:
                process.send_signal(getattr(signal, kind))
        return process.wait(WAITING)


def driven(connection: str, interruptions: int, seed: int, folder: Path) -> dict[str, object]:
    """Return what came of one drive over a connection."""
    luck, truth = random.Random(seed), open_map(MAP)
    place, log, count = folder / "map.txt", folder / "log.jsonl", folder / "count.txt"
    place.write_text(f"{truth}\n")
    options = [str(place), "--particles", str(PARTICLES), "--seed", str(seed)]
    options += ["--duration", str(DURATION), "--pause", str(PAUSE), "--count", str(count)]
    port, link, served = free_port(), folder / "rig", None
    ends = {"tcp": ["--tcp", str(port)], "pty": ["--pty", str(link)], "exec": []}[connection]
    run = [sys.executable, str(RIG), *options, *ends]
    spec = {
        "tcp": f"tcp:127.0.0.1:{port}",
        "pty": f"serial:{link}",
        "exec": f"exec:{' '.join(run)}",
    }[connection]
    if connection != "exec":
        served = subprocess.Popen(run)
    while connection == "pty" and not link.exists():
        time.sleep(0.01)
    patience = ["--repeat-after", "0.3", "--end-after", str(END_AFTER)]
    words = [*SHOAL, "drive", str(place), "--rig", spec, "--log", str(log), *patience]
    again = [*SHOAL, "drive", "--resume", str(log), "--rig", spec]
    kinds: Counter[str] = Counter()
    order = luck.sample(KINDS * 4, 4 * len(KINDS))
    try:
        while kinds.total() < interruptions:
            kind = order[kinds.total() % len(order)]
            code = interrupted(
                again if log.exists() else words, log, kind, luck.randint(1, 8), served
            )
            if code == 0:
                break
            kinds[kind] += 1
            while kind == "cable" and connection == "pty" and not link.exists():
                time.sleep(0.05)
        done = subprocess.run([*again, "--json"], stdout=subprocess.PIPE, check=False)
    finally:
        if served is not None:
            served.terminate()
            served.wait()
    result = json.loads(done.stdout)
    past = read_log(log)
    replayed, verified = replay_log(log)
    carried_out = count.read_text().split()
    unknown = sum(one["event"] == "resumed" and one["carried_out"] is None for one in past.events)
    return {
        "connection": connection,
        "seed": seed,
        "interruptions": dict(kinds),
        "resumed": sum(one["event"] == "resumed" for one in past.events),
        "status": result["status"],
        "wrong": sum(result["wrong"].values()),
        "missing": truth.n_free - result["free_cells"],
        "replays": bool(verified) and replayed.commands == result["commands"],
        "in the log": len(result["commands"]),
        "carried out": len(carried_out),
        "unknown": unknown,
    }


def is_broken(row: dict[str, object], interruptions: int) -> bool:
    """Return whether a drive has not kept its promise, or was interrupted too rarely."""
    logged, counted, unknown = (row[name] for name in ("in the log", "carried out", "unknown"))
    assert isinstance(logged, int)
    assert isinstance(counted, int)
    assert isinstance(unknown, int)
    right = (
        row["resumed"] == interruptions
        and row["status"] == "complete"
        and not row["wrong"]
        and not row["missing"]
    )
    return not (right and row["replays"] and counted <= logged <= counted + unknown)


def main() -> int:
    """Measure, print a row for each drive, and return 1 if a promise is broken."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--drives", type=int, default=3)
    parser.add_argument("--interruptions", type=int, default=10)
    parser.add_argument("--only", choices=("tcp", "pty", "exec"))
    given = parser.parse_args()
    # a shell lets its background processes, and thereby the drives, ignore SIGINT
    signal.signal(signal.SIGINT, signal.default_int_handler)
    broken = 0
    for connection in ("tcp", "pty", "exec"):
        for seed in range(given.drives if given.only in (None, connection) else 0):
            with tempfile.TemporaryDirectory() as folder:
                row = driven(connection, given.interruptions, seed, Path(folder))
            wrong = is_broken(row, given.interruptions)
            broken += wrong
            print("BROKEN" if wrong else "ok", json.dumps(row), flush=True)
    return int(bool(broken))


if __name__ == "__main__":
    sys.exit(main())
