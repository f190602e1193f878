"""Interrupt every command at random moments: ``python -m tests.hostile.signals 200``."""

from __future__ import annotations

import argparse
import os
import random
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

COMMANDS = (
    "--help",
    "map vessels:3000 --particles 200 --out {out}",
    "map cave:60x60 --particles 50 --film {out}/a.gif",
    "maps",
    "map vessels:20000 --particles 500 --policy best --out {out}",
    "cover maze:21x21 --particles 9 --out {out}",
    "steer {in}/steer.json --planner shortest --out {out}",
    "reach square --out {out}",
    "search square:800 --robots 5 --footprint 10 --missions {out}/missions --out {out}",
    "tour spanning-tree cave:64x48 --out {out}",
    "line --cells 1000 --particles 100 --monte-carlo 1000000 --out {out}",
    "schedule --scan-cost 10 --move-cost 1 --max-distance 500 --out {out}",
    "sweep run {in}/sweep.toml --store {out}/store",
    "sweep summary {in}/store",
    "replay {in}/episode.npz --out {out}",
    "drive maze:21x21 --particles 4 --log {out}/drive.jsonl",
    "missions check {in}/missions square:200 --footprint 10",
    "maps vessels:30000 --out {out}/a.png",
    "demo --out {out}",
)
SWEEP = (
    'name = "x"\ntrials = 400\n[problem]\nkind = "swarm"\nmap = "vessels:400"\n[axes]\nparticles ='
    " [20, 50, 90]\n"
)
STEER = (
    '{"kind": "steering", "workspace": "hexagon", "start": [[0.1, 0.1], [0.2, 0.1]], "goal": [[0.1,'
    " 0.2], [0.2, 0.2]]}"
)
# what Python says that a signal meets before any of our code
_BEFORE_OURS = "init_import_site", "Could not import runpy"
SHOAL = [sys.executable, "-m", "shoal"]


def interrupted(words: list[str], out: Path, after: float, number: int) -> list[str]:
    """Send a signal to a command some seconds after it was started; return what is wrong with how
    it ended.
    """
    process = subprocess.Popen(
        [*SHOAL, *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    time.sleep(after)
    process.send_signal(number)
    sent = time.monotonic()
    try:
        said = process.communicate(timeout=30)[1]
    except subprocess.TimeoutExpired:
        process.kill()
        return ["it did not end within 30 s"]
    took = time.monotonic() - sent
    left = sorted(path.name for path in out.rglob("*") if path.name.startswith("."))
    if any(words in said for words in _BEFORE_OURS):
        return []
    ours = [
        line
        for line in said.splitlines()
        if line.startswith("shoal: ") and not line.startswith("shoal: notice: ")
    ]
    most = 5 if words[0] in {"map", "cover"} else 1  # these write the unfinished episode
    wrong = [f"{took:.1f} s"] if process.returncode not in (0, 1) and took > most else []
    # the last while Python itself begins or ends: shells tell it as 130, too
    if process.returncode not in (130, 0, 1, -number):
        wrong.append(f"exit code {process.returncode}: {said[-1500:]}")
    if (len(ours) > 1 and process.returncode == 130) or "Traceback" in said or "Exception" in said:
        wrong.append(said)
    try:
        os.killpg(process.pid, 0)
        time.sleep(2.0)  # workers notice by themselves
        os.killpg(process.pid, 0)
        there = subprocess.run(
            ["ps", "-eo", "pgid,stat,args"], capture_output=True, text=True, check=True
        ).stdout
        there = "; ".join(
            line[:160] for line in there.splitlines() if line.split()[0] == str(process.pid)
        )
        os.killpg(process.pid, signal.SIGKILL)
        wrong.append(f"processes are left: {there}")
    except ProcessLookupError:
        pass
    return wrong + ([f"left behind: {left}"] if left else [])


def main() -> int:
    """Return 1 if anything was wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.hostile.signals", description=__doc__)
    parser.add_argument("count", type=int)
    parser.add_argument("--latest", type=float, default=5.0, help="seconds")
    parser.add_argument("--signal", default="SIGINT")
    parser.add_argument("--only", default="", help="commands that begin so")
    options = parser.parse_args()
    # a shell's background ignores it, and so would the commands
    signal.signal(signal.SIGINT, signal.default_int_handler)
    chance = random.Random(1)
    failures = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "sweep.toml").write_text(SWEEP)
        (folder / "steer.json").write_text(STEER)
        for words in (
            "map vessels:300 --out {in}",
            "search square:200 --robots 2 --footprint 10 --missions {in}/missions",
        ):
            subprocess.run(
                [*SHOAL, *shlex.split(words.replace("{in}", name))], check=True, capture_output=True
            )
        words = ["sweep", "run", f"{name}/sweep.toml", "--store", f"{name}/store", "--trials", "4"]
        subprocess.run([*SHOAL, *words], check=True, capture_output=True)
        commands = [one for one in COMMANDS if one.startswith(options.only)]
        for number in range(options.count):
            text = commands[number % len(commands)]
            out = folder / f"out-{number}"
            out.mkdir()
            after = chance.uniform(0, options.latest)
            words = shlex.split(text.replace("{in}", name).replace("{out}", str(out)))
            wrong = interrupted(words, out, after, getattr(signal, options.signal))
            if wrong:
                failures += 1
                print(f"{text}, after {after:.3f} s: {'; '.join(wrong)}", flush=True)
    print(f"{options.count} signals, {failures} answered wrongly")
    return int(failures > 0)


if __name__ == "__main__":
    sys.exit(main())
