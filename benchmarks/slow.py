"""How much later a search ends in which robots are slow or die: python -m benchmarks.slow [--seeds
N] [--region NAME]

Six robots on a ring, no messages lost and 30 %: the time until all is searched over that with six
healthy robots, mean and worst.
"""

from __future__ import annotations

import argparse

import numpy as np

from shoal.search import SearchProblem
from shoal.search.run import run

FAULTS = {
    "one 1.5 times too slow": "slow:2@0:1.5",
    "one 5 times": "slow:2@0:5",
    "one 50 times": "slow:2@0:50",
    "one 10 times, from the middle of its part on": "slow:2@57:10",
    "one 10 times, at the end of its part": "slow:2@100:10",
    "two neighbours 5 times": "slow:2@0:5,slow:3@0:5",
    "every second one 5 times": "slow:1@0:5,slow:3@0:5,slow:5@0:5",
    "one 5 times, another dies": "slow:2@0:5,crash:3@30",
    "one stands still from 20 to 100": "pause:2@20:100",
    "one dies": "crash:2@20",
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--region", default="ring:200x150")
    options = parser.parse_args()
    seeds = range(1, options.seeds + 1)
    problem = SearchProblem(options.region, robots=6, footprint=10, allocation="hop")
    well = [run(problem, seed=seed).trace.covered_at for seed in seeds]
    print("| faults | mean | worst | mean, 30 % lost | worst, 30 % lost |\n|---|---|---|---|---|")
    for what, faults in FAULTS.items():
        found = []
        for loss in (0.0, 0.3):
            faulty = problem.replaced(faults=faults, loss=loss)
            shares = np.array([run(faulty, seed=seed).trace.covered_at for seed in seeds]) / well
            found += [f"{shares.mean():.2f}", f"{shares.max():.2f}"]
        print(f"| {what} | " + " | ".join(found) + " |", flush=True)


if __name__ == "__main__":
    main()
