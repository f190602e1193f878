"""python -m benchmarks.published: closest-frontier means against the published curves of paper M, Fig. 7, as a table."""

from __future__ import annotations

import statistics

from tests.golden.test_published import PUBLISHED, published_means
from tests.swarm_runs import run_trials

from shoal import open_map

COUNTS = (100, 500, 1000, 2500, 4000)


def main() -> None:
    print("| map | " + " | ".join(f"n = {n}" for n in COUNTS) + " |\n|---|" + "---|" * len(COUNTS))
    for name, file in PUBLISHED.items():
        workspace, means, cells = open_map(name), published_means(file), []
        for n in COUNTS:
            mean = statistics.fmean(e.moves for e in run_trials(workspace, trials=100, particles=n))
            cells.append(f"{mean:.1f} ({100 * (mean / means[n] - 1):+.0f} %)")
        print(f"| `{name}` | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
