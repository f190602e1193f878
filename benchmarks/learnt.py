"""python -m benchmarks.learnt [--seeds 0 1 ...]: train the network of examples/tune_mapping.py with
each seed, run it on the mapping suites of Shoal-Bench, and print the table of docs/how-to/shoal-bench.md.

Needs the extras of `make test-clients`: .venv-clients/bin/python -m benchmarks.learnt
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

SUITES = ("mapping-easy", "mapping-medium", "mapping-hard", "mapping-real")
EXAMPLES = Path(__file__).parents[1] / "examples"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--folder", type=Path, default=Path(), help="of networks and results")
    given = parser.parse_args()
    models, store = [], given.folder / "learnt.sqlite"
    for seed in given.seeds:
        file = given.folder / f"tuned-{seed}.onnx"
        if not file.exists():
            run(str(EXAMPLES / "tune_mapping.py"), "--seed", str(seed), "--export", str(file))
        models.append(f"model:{file}")
    suites = [word for suite in SUITES for word in ("--suite", suite)]
    run("-m", "shoal", "bench", "run", *models, *suites, "--store", str(store), "--workers", "1")


def run(*words: str) -> None:
    # sums in one order on every machine: another number of threads trains another network
    subprocess.run([sys.executable, *words], check=True, env=os.environ | {"OMP_NUM_THREADS": "1"})


if __name__ == "__main__":
    main()
