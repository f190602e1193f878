"""First commands, which compile, and second ones, which load: CPU seconds in a fresh copy, also as
multiples of ``import numba``.

The last column is the command's own work, such as planning: its CPU seconds if it runs once more in
the same process, where all modules, kernels and maps are loaded.

python -m benchmarks.starts [--only planner]
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from shoal.swarm.maps.imaging.samples import retina

ROOT = Path(__file__).parent.parent
COMMANDS = {
    "closest-frontier": "map vessels:1000 -n 50 --policy closest-frontier --json",
    "planner": "map vessels:1000 -n 50 --json",
    "noise": "map vessels:1000 -n 50 --slip 0.1 --policy closest-frontier --json",
    "adaptive scans": "map vessels:1000 -n 50 --scan-every adaptive --scan-cost 2 --json",
    "coverage": "cover vessels:1000 -n 50 --json",
    "steering": "steer square --start 0.1,0.2_0.3,0.4 --goal 0.4,0.3_0.2,0.1 --json",
    "search": "search rectangle:60x40 --robots 3 --footprint 5 --json",
    "tour": "tour spanning-tree cave:20x15 --json",
    "help": "--help",
}
# Most of their time goes into scikit-image, Matplotlib and pictures: a table of their own.
WITH_PICTURES = {
    "photograph and film": (
        "map retina.png --vessels -n 300 --out result --film result/film.html --json"
    ),
    "steering film": (
        "steer square --start 0.1,0.2_0.3,0.4 --goal 0.4,0.3_0.2,0.1 --film plan.html --json"
    ),
}


BYTE_CODE = """
import compileall, numba, shoal, pathlib
compileall.compile_dir(pathlib.Path(shoal.__file__).parent, quiet=2)
"""

AGAIN = """
import contextlib, io, sys, time
from shoal.cli import run
with contextlib.redirect_stdout(io.StringIO()):
    run(sys.argv[1:])
    began = time.process_time()
    run(sys.argv[1:])
print(time.process_time() - began)
"""


def cpu_seconds(*arguments: str, source: Path) -> float:
    """Run a Python process on a copy of the sources; return its CPU seconds."""
    return measured(*arguments, source=source)[0]


def measured(*arguments: str, source: Path) -> tuple[float, str]:
    """Run a Python process on a copy of the sources; return its CPU seconds and what it printed."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    kept = {
        name: value
        for name, value in os.environ.items()
        if name not in ("PYTHONDONTWRITEBYTECODE", "SHOAL_CACHE")
    }
    environment = {
        **kept,
        "PYTHONPATH": str(source),
        "PYTHONPYCACHEPREFIX": str(source.parent / "bytecode"),
    }
    done = subprocess.run(
        [sys.executable, *arguments],
        env=environment,
        capture_output=True,
        text=True,
        cwd=source.parent,
        check=False,
    )
    if done.returncode:
        raise SystemExit(f"{' '.join(arguments)}: {done.stderr}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.stdout


def copy_sources(folder: Path) -> Path:
    """Copy the package without anything compiled; return the folder to import it from."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(ROOT / "src", folder, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def measure(kind: str, command: str, source: Path, unit: float) -> float:
    """Print what a command takes in a fresh copy, then once more; return the CPU seconds of the
    first time.
    """
    copy_sources(source)
    # an underscore is a blank within a word
    words = tuple(word.replace("_", " ") for word in command.split())
    run = ("-m", "shoal", *words)
    cpu_seconds("-c", BYTE_CODE, source=source)  # which is no part of it
    first = cpu_seconds(*run, source=source)
    second = min(cpu_seconds(*run, source=source) for _ in range(2))
    work = min(float(measured("-c", AGAIN, *words, source=source)[1]) for _ in range(2))
    print(
        f"| {kind} | {first:.1f} | {first / unit:.1f} | {second:.2f} | {second / unit:.2f} |"
        f" {work:.2f} |",
        flush=True,
    )
    return first


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", choices=COMMANDS | WITH_PICTURES)
    only = parser.parse_args().only
    with tempfile.TemporaryDirectory() as name:
        source = copy_sources(Path(name) / "src")
        Image.fromarray(retina()).save(Path(name) / "retina.png")
        unit = min(cpu_seconds("-c", "import numba", source=source) for _ in range(3))
        print(f"import numba: {unit:.2f} CPU s")
        for table in (COMMANDS, WITH_PICTURES):
            chosen = {kind: command for kind, command in table.items() if only in (None, kind)}
            if not chosen:
                continue
            print(
                "\n| command | first | times import numba | second | times import numba | own"
                " work |"
            )
            print("|---|---|---|---|---|---|")
            total = sum(measure(kind, command, source, unit) for kind, command in chosen.items())
            print(f"| all | {total:.1f} | {total / unit:.1f} | | | |")


if __name__ == "__main__":
    main()
