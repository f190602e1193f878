"""python -m benchmarks.published: closest-frontier means against the published curves of paper M,
Fig. 7, as a table.
"""

from __future__ import annotations

import argparse
import statistics

from shoal.lab import run_trials
from shoal.papers.mapping.curves import MAPS
from shoal.papers.recipe import published_curve
from shoal.swarm import SwarmProblem

COUNTS = (100, 500, 1000, 2500, 4000)


def main() -> None:
    print("| map | " + " | ".join(f"n = {n}" for n in COUNTS) + " |\n|---|" + "---|" * len(COUNTS))
    for name, (_, file) in MAPS.items():
        curve, cells = published_curve(file), []
        for n in COUNTS:
            problem = SwarmProblem(name, policy="closest-frontier", particles=n)
            mean = statistics.fmean(episode.moves for episode in run_trials(problem, trials=100))
            published = float(curve.mean[curve.x == n][0])
            cells.append(f"{mean:.1f} ({100 * (mean / published - 1):+.0f} %)")
        print(f"| `{name}` | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    main()
