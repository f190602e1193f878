"""Expected time to find a target with a prior, beside the plan without: python -m benchmarks.priors

Seeded priors on a square of 40 x 40 cells, four robots, detection 1: of ten priors, four or five are
mixtures of one to four normal distributions, as many are rings around a point with log-normal
distances, and one is the same everywhere. Robots start at random or clustered places and are
simulated with the protocol. Both times come from the first searches of all cells (visits.csv), and
the probabilities from the prior itself.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from shoal.search import SearchEpisode, SearchProblem
from shoal.search.run import run

SIDE, CELL = 40, 10.0


def prior(number: int) -> tuple[str, NDArray[np.float64]]:
    """Return the family of a seeded prior, and its probabilities with row 0 in the north."""
    rng = np.random.default_rng([46, number])
    rows, columns = np.mgrid[:SIDE, :SIDE] + 0.5
    family = "uniform" if number % 10 == 9 else ("normal", "ring")[number % 2]
    if family == "normal":
        values = np.zeros((SIDE, SIDE))
        for _ in range(int(rng.integers(1, 5))):
            row, column = rng.uniform(0, SIDE, 2)
            spread = rng.uniform(0.05, 0.2) * SIDE
            near = ((rows - row) ** 2 + (columns - column) ** 2) / spread**2
            values += rng.uniform(0.3, 1.0) * np.exp(-near / 2) / spread**2
    elif family == "ring":
        row, column = rng.uniform(0.2 * SIDE, 0.8 * SIDE, 2)
        away = np.hypot(rows - row, columns - column) + 0.3
        middle, spread = np.log(rng.uniform(0.1, 0.4) * SIDE), rng.uniform(0.3, 0.9)
        values = np.exp(-(((np.log(away) - middle) / spread) ** 2) / 2) / away**2
    else:
        values = np.ones((SIDE, SIDE))
    return family, values / values.sum()


def judged(episode: SearchEpisode, values: NDArray[np.float64]) -> tuple[float, float]:
    """Return the expected time to find and the time of the last first search, in seconds."""
    visits, plan = episode.visits, episode.plan
    places = plan.positions(np.arange(len(plan.tour)))
    rows = SIDE - 1 - (places[:, 1] // CELL).astype(int)
    odds = values[rows, (places[:, 0] // CELL).astype(int)]
    return float(odds @ visits.times), float(visits.times.max())


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--priors", type=int, default=200)
    parser.add_argument("--at-most", type=float, nargs="+", default=[1.25, 1.05])
    options = parser.parse_args()
    found: dict[tuple[str, float], list[tuple[float, float, float]]] = {}
    with TemporaryDirectory() as folder:
        for number in range(options.priors):
            family, values = prior(number)
            file = Path(folder) / "prior.npy"
            np.save(file, values)
            problem = SearchProblem(
                f"square:{SIDE * CELL:g}",
                robots=4,
                footprint=CELL,
                starts=("random", "clustered")[number // 2 % 2],
            )
            begun = time.process_time()
            before, plain = judged(run(problem, seed=number), values)
            spent = time.process_time() - begun
            for at_most in options.at_most:
                begun = time.process_time()
                episode = run(problem.replaced(prior=(str(file),), at_most=at_most), seed=number)
                after, last = judged(episode, values)
                cost = (time.process_time() - begun) / spent
                for name in ("all", family):
                    found.setdefault((name, at_most), []).append(
                        (after / before, last / plain, cost)
                    )
    print("| priors | number | at most | time to find | time for all: mean (most) | CPU |")
    print("|---|---|---|---|---|---|")
    for (name, at_most), rows in sorted(found.items(), key=lambda one: (-one[0][1], one[0][0])):
        (find, last, cost), most = np.mean(rows, axis=0), np.max(rows, axis=0)
        print(
            f"| {name} | {len(rows)} | {at_most:g} | {find:.3f} | {last:.3f} ({most[1]:.3f}) |"
            f" {cost:.1f} |"
        )


if __name__ == "__main__":
    main()
