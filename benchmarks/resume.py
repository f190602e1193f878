"""Drives that are interrupted again and again, and go on from their logs: of the reference rig over
TCP, a pseudo-terminal and pipes, and of the bench of the examples, whose coils and camera are two
devices.

python -m benchmarks.resume                 ten interruptions, three drives for each connection
python -m benchmarks.resume --drives 1 --interruptions 4 --only tcp

Each interruption is SIGINT, SIGKILL or a pulled cable (of the bench, that of the coils or that of the
camera), at a random moment. The drive must find the map of one that was not interrupted, its log must
replay as one drive, and the commands that the rig has counted must be those of the log. A program at the
end of pipes dies with the drive, and coils cannot be asked, so that nobody knows whether a command that
the log was the last to tell of was carried out: these are counted as unknown.
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

EXAMPLES = Path(__file__).parents[1] / "examples"
RIG, BENCH = EXAMPLES / "rig.py", EXAMPLES / "bench.py"
SHOAL = [sys.executable, "-c", "from shoal.__main__ import main; main()"]
CONNECTIONS = ("tcp", "pty", "exec", "bench")
MAP = "vessels:200"
PARTICLES = 20
KINDS = {"SIGINT": "SIGINT", "SIGKILL": "SIGKILL", "cable": "SIGUSR1"}
OF_BENCH = {"SIGINT": "SIGINT", "SIGKILL": "SIGKILL", "coils": "SIGUSR1", "camera": "SIGUSR2"}
VESSEL, ROOM = "vessels:100", 8  # the map of the bench, and its particles
DURATION, PAUSE, END_AFTER = 0.05, 2.0, 1.0  # seconds
UNPLUGGED = 6.0  # seconds: a line of coils that comes back within three is no interruption
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
            number = signal.Signals[(KINDS | OF_BENCH)[kind]]
            hit = process.pid if kind in ("SIGINT", "SIGKILL") else rig_of(process, served)
            if hit is not None:
                os.kill(hit, number)
        return process.wait(WAITING)


def driven(connection: str, interruptions: int, seed: int, folder: Path) -> dict[str, object]:
    """Return what came of one drive of the reference rig over a connection."""
    place, count = folder / "map.txt", folder / "count.txt"
    place.write_text(f"{open_map(MAP)}\n")
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
    devices = ["--rig", spec]
    words = [str(place), *devices, "--repeat-after", "0.3", "--end-after", str(END_AFTER)]
    try:
        needed = [link] if connection == "pty" else []
        again_and_again = Interrupted(words, devices, folder, needed, served)
        found = again_and_again.drive(KINDS, interruptions, seed)
    finally:
        if served is not None:
            served.terminate()
            served.wait()
    return {"connection": connection, "seed": seed} | found | {"carried out": lines_of(count)}


def driven_bench(interruptions: int, seed: int, folder: Path) -> dict[str, object]:
    """Return what came of one drive of coils and a camera."""
    link, count, port, puller = folder / "coils", folder / "count.txt", free_port(), "puller.toml"
    run = [sys.executable, str(BENCH), VESSEL, "--particles", str(ROOM), "--seed", str(seed)]
    run += ["--pty", str(link), "--port", str(port), "--count", str(count)]
    run += ["--pause", str(UNPLUGGED)]
    text = (EXAMPLES / "actuation" / "four_coil_puller.toml").read_text()
    text = text.replace("serial:/dev/ttyUSB0@115200", f"serial:{link}")
    text = text.replace("ready = 2.0", "ready = 0.0")
    # this computer may be busy for longer than .2 s, which would be one more interruption
    (folder / puller).write_text(text.replace("keep_alive = 0.2", "keep_alive = 1.0"))
    camera = f"opencv:http://127.0.0.1:{port}/,particles=bright,threshold=150,stale=1"
    devices = ["--actuator", f"coils:{folder / puller}", "--sensor", camera]
    rows, columns = (20 * (side - 1) for side in open_map(VESSEL).shape)
    marks = [
        f"--mark={19.5 + x},{19.5 + y}={y // 20},{x // 20}" for x in (0, columns) for y in (0, rows)
    ]
    words = [VESSEL, *devices]
    with subprocess.Popen(run, stdout=subprocess.DEVNULL) as served:
        try:
            wait_for([link])
            bench = str(folder / "bench.json")
            subprocess.run(
                [*SHOAL, "drive", *words, "--calibrate", bench, *marks, "--json"],
                stdout=subprocess.DEVNULL,
                check=True,
            )
            before = lines_of(count)
            # nothing of the devices must be typed again: no file alone makes Shoal run a program
            resumed = Interrupted([*words, "--calibration", bench], [], folder, [link], served)
            found = resumed.drive(OF_BENCH, interruptions, seed)
        finally:
            served.terminate()
    about = {"connection": "bench", "seed": seed} | found
    return about | {"carried out": lines_of(count) - before}


class Interrupted:
    """A drive that is interrupted, and goes on.

    Parameters
    ----------
    words, devices : list of str
        Arguments of the first command, of which the first is the map, and those that are given again.
    folder : path
    needed : list of path
        Files that must be there before a drive goes on.
    served : process or None
        The rig, if the drive does not run it itself.
    """

    def __init__(
        self,
        words: list[str],
        devices: list[str],
        folder: Path,
        needed: list[Path],
        served: subprocess.Popen[bytes] | None,
    ) -> None:
        self.log, self.needed, self.served = folder / "log.jsonl", needed, served
        self.truth = open_map(words[0])
        self.words = [*SHOAL, "drive", *words, "--log", str(self.log)]
        self.again = [*SHOAL, "drive", "--resume", str(self.log), *devices]

    def drive(self, kinds: dict[str, str], interruptions: int, seed: int) -> dict[str, object]:
        """Interrupt so many times, let the drive end, and return what came of it."""
        luck, counted = random.Random(seed), Counter[str]()
        order = luck.sample([*kinds] * interruptions, interruptions)
        for kind in order:
            wait_for(self.needed)
            words = self.again if self.log.exists() else self.words
            if interrupted(words, self.log, kind, luck.randint(1, 8), self.served) == 0:
                break
            counted[kind] += 1
            if kind == "camera":
                time.sleep(UNPLUGGED)
        wait_for(self.needed)
        done = subprocess.run([*self.again, "--json"], stdout=subprocess.PIPE, check=False)
        result, past = json.loads(done.stdout), read_log(self.log)
        replayed, verified = replay_log(self.log)
        resumed = [one for one in past.events if one["event"] == "resumed"]
        return {
            "interruptions": dict(counted),
            "resumed": len(resumed),
            "status": result["status"],
            "wrong": sum(result["wrong"].values()),
            "missing": self.truth.n_free - result["free_cells"],
            "replays": bool(verified) and replayed.commands == result["commands"],
            "in the log": len(result["commands"]),
            "unknown": sum(one["carried_out"] is None for one in resumed),
        }


def wait_for(paths: list[Path]) -> None:
    """Wait until the files are there."""
    while not all(path.exists() for path in paths):
        time.sleep(0.05)


def lines_of(path: Path) -> int:
    """Return the number of lines of a file."""
    return len(path.read_text().splitlines()) if path.exists() else 0


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
    parser.add_argument("--only", choices=CONNECTIONS)
    given = parser.parse_args()
    # a shell lets its background processes, and thereby the drives, ignore SIGINT
    signal.signal(signal.SIGINT, signal.default_int_handler)
    broken = 0
    for connection in CONNECTIONS:
        for seed in range(given.drives if given.only in (None, connection) else 0):
            with tempfile.TemporaryDirectory() as name:
                folder = Path(name)
                if connection == "bench":
                    row = driven_bench(given.interruptions, seed, folder)
                else:
                    row = driven(connection, given.interruptions, seed, folder)
            wrong = is_broken(row, given.interruptions)
            broken += wrong
            print("BROKEN" if wrong else "ok", json.dumps(row), flush=True)
    return int(bool(broken))


if __name__ == "__main__":
    sys.exit(main())
