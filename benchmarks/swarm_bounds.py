"""python -m benchmarks.swarm_bounds: lower bounds of the swarm against brute force on small random
maps, and against plans of the planner offline on a larger map.

Each small case is a map of at most --cells free cells with one to four particles, under each move
rule, and with each task: mapping, coverage, coverage of a random subset, and one target. The program
stops with an error if a bound is above the optimum.

Options: --maps N, --cells N, --seed S, --trials N (of offline), --map MAP, --particles N.
"""

from __future__ import annotations

import argparse
import statistics
from collections import Counter

import numpy as np
from tests.reference.small import small_cases
from tests.swarm_runs import run

from shoal.core.errors import InvalidInputError
from shoal.swarm.theory.bounds import lower_bound, optimum

RULES = ("block", "merge", "tilt")
MOST_STATES = 50_000  # of a mapping, whose states are subsets of free cells and walls


def main() -> None:
    """Print the mean ratio of the optimum to the bound, and which bounds were the largest."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--maps", type=int, default=200)
    parser.add_argument("--cells", type=int, default=12, help="most free cells of a small map")
    parser.add_argument("--seed", type=int, default=44)
    parser.add_argument("--trials", type=int, default=8, help="plans of offline")
    parser.add_argument("--map", default="vessels:1000")
    parser.add_argument("--particles", type=int, default=100)
    given = parser.parse_args()
    check_small_maps(given)
    compare_with_plans(given)


def check_small_maps(given: argparse.Namespace) -> None:
    """Compare bounds with optima, and print a line for each task and move rule."""
    cases = []
    for workspace, start in small_cases(100 * given.maps, given.seed):
        if 2 <= workspace.n_free <= given.cells and len(cases) < given.maps:
            cases.append((workspace, start))
    for task in ("coverage", "subset coverage", "target", "mapping"):
        for rule in RULES:
            ratios, names, exact, impossible, large = [], Counter[str](), 0, 0, 0
            for seed, (workspace, start) in enumerate(cases):
                rng = np.random.default_rng(seed)
                case: dict[str, object] = {"task": "mapping" if task == "mapping" else "coverage"}
                if task == "subset coverage":
                    case["targets"] = workspace.free & (rng.random(workspace.shape) < 0.4)
                if task == "target":
                    case["targets"] = np.zeros(workspace.shape, dtype=np.bool_)
                    case["targets"][tuple(rng.choice(workspace.cells))] = True
                bound = lower_bound(workspace, start, rule=rule, **case)
                try:
                    most = MOST_STATES if task == "mapping" else 2_000_000
                    fewest = optimum(workspace, start, rule=rule, most_states=most, **case).moves
                except InvalidInputError as error:
                    if "at most" in str(error):
                        large += 1
                    elif "can complete" in str(error):
                        impossible += 1
                    else:
                        raise
                    continue
                if bound.moves > fewest:
                    raise SystemExit(
                        f"{task}, {rule}: {bound} above {fewest}, {workspace}, {start}"
                    )
                if fewest:
                    exact += bound.moves == fewest
                    ratios.append(fewest / bound.moves)
                    names[bound.name] += 1
            mean = statistics.fmean(ratios) if ratios else float("nan")
            print(
                f"{task:<16} {rule:<6} {len(ratios)} cases, {impossible} impossible,"
                f" {large} with too many states; optimum / bound {mean:.3f}, equal in {exact}; {dict(names)}",
                flush=True,
            )


def compare_with_plans(given: argparse.Namespace) -> None:
    """Print the ratio of the plans of offline to the bounds."""
    ratios = []
    for trial in range(given.trials):
        episode = run(
            given.map, particles=given.particles, task="coverage", policy="offline", trial=trial
        )
        bound = lower_bound(episode.workspace, episode.start)
        ratios.append(episode.moves / bound.moves)
        print(f"{episode.moves} moves, {bound}: {ratios[-1]:.2f} times", flush=True)
    if ratios:
        print(f"{given.map}, {given.particles} particles: {statistics.fmean(ratios):.2f} times")


if __name__ == "__main__":
    main()
