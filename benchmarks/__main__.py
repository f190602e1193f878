"""make bench: every speed that is promised, measured in one run against the plain-array reference.

The reference (tests/reference/plain.py) is an independent implementation with one array entry a
cell, compiled the same way.
"""

from __future__ import annotations

import argparse

from benchmarks.kernels import bench_episode, bench_move
from benchmarks.line import bench_line
from benchmarks.processes import bench_import, bench_second_run
from benchmarks.scale import bench_growth, bench_scale
from benchmarks.sweep import bench_sweep
from benchmarks.tours import bench_codec, bench_tours


def main() -> None:
    print(f"{'':<58} {'measured':>22}   {'promised':<28}")
    for bench in (
        bench_move,
        bench_episode,
        bench_sweep,
        bench_line,
        bench_import,
        bench_second_run,
        bench_growth,
        bench_scale,
        bench_codec,
        bench_tours,
    ):
        bench()


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    main()
