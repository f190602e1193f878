"""What a user waits for: importing the package, and a second command in a fresh process."""

from __future__ import annotations

import statistics

from benchmarks.timing import process, row

IMPORT = "import time; t = time.perf_counter(); import shoal; print(time.perf_counter() - t)"
COMMAND = (
    "import sys; from shoal.cli import run; sys.exit(run(['map', 'vessels:5000', '-n', '1000',"
    " '--json']))"
)


def bench_import() -> None:
    seconds = statistics.median(float(process("-c", IMPORT)[1]) for _ in range(5))
    row("import shoal", f"{seconds:.3f} s", "under 0.3 s", seconds < 0.3)


def bench_second_run() -> None:
    process("-c", COMMAND)
    seconds = statistics.median(process("-c", COMMAND)[0] for _ in range(5))
    row(
        "a second shoal map vessels:5000 -n 1000, whole process",
        f"{seconds:.2f} s",
        "under 1.5 s",
        seconds < 1.5,
    )
