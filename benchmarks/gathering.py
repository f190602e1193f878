"""python -m benchmarks.gathering: how many moves the policies for gathering need.

On maps of several kinds, the mean number of moves of each policy over the same starts, divided by the
mean lower bound, and the computing time. Then bounds, optima and the policy gather-beam on small
random maps under each rule; the program stops with an error if a bound is above the optimum.

Options: --trials N, --maps N (small ones; 0 for none), --particles N, --seed S.
"""

from __future__ import annotations

import argparse
import statistics

import numpy as np
from tests.reference.small import small_cases

from shoal.core.errors import InvalidInputError
from shoal.swarm import SwarmProblem
from shoal.swarm.run import run
from shoal.swarm.theory.bounds import lower_bound, optimum

MAPS = ("rectangle:20x30", "vessels:300", "vessels:1000", "maze:31x31", "cave:50x40", "htree:1000")
POLICIES = (
    "pairwise:path=static",
    "pairwise",
    "pairwise:pair=farthest",
    "gather-beam:width=1",
    "gather-beam:width=8",
    "gather-beam",
)


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument("--maps", type=int, default=200)
    parser.add_argument("--particles", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    if given.trials:
        compare_policies(given)
    if given.maps:
        check_small_maps(given)


def compare_policies(given: argparse.Namespace) -> None:
    """Print the moves and the seconds of each policy on each map."""
    for name in MAPS:
        bounds: list[int] = []
        for policy in POLICIES:
            problem = SwarmProblem(
                name,
                task="gathering",
                particles=given.particles,
                largest_component=True,
                policy=policy,
            )
            run(problem, seed=given.seed)  # compiles
            episodes = [run(problem, seed=given.seed, trial=t) for t in range(given.trials)]
            assert all(episodes), "an episode did not gather its particles"
            if not bounds:
                bounds = [
                    lower_bound(e.workspace, e.start, task="gathering", rule="merge").moves
                    for e in episodes
                ]
                print(
                    f"{name}: {problem.place.n_free} free cells, bound {statistics.fmean(bounds):.1f}"
                )
            moves = statistics.fmean(e.moves for e in episodes)
            seconds = statistics.fmean(e.seconds for e in episodes)
            ratio = moves / statistics.fmean(bounds)
            print(
                f"  {policy:24} {moves:8.1f} moves, {ratio:5.2f} x bound, {seconds:.3f} s",
                flush=True,
            )


def check_small_maps(given: argparse.Namespace) -> None:
    """Compare bounds, optima and plans on small maps, and print a line for each rule."""
    for rule in ("block", "merge", "tilt"):
        bounds, fewest, planned, solved, possible, cases = 0, 0, 0, 0, 0, 0
        exact = 0
        for seed, (workspace, start) in enumerate(small_cases(given.maps, 44)):
            rng = np.random.default_rng(seed)
            least = 1 if rule == "merge" else len(start)
            size = int(rng.integers(least, workspace.n_free + 1))
            mask = np.zeros(workspace.shape, dtype=np.bool_)
            mask[tuple(rng.permutation(workspace.cells)[:size].T)] = True
            targets = None if rule == "merge" and seed % 2 else mask
            cases += 1
            try:
                best = optimum(workspace, start, task="gathering", targets=targets, rule=rule).moves
            except InvalidInputError:
                continue  # no commands gather the particles
            possible += 1
            bound = lower_bound(
                workspace, start, task="gathering", targets=targets, rule=rule
            ).moves
            assert bound <= best, (seed, rule, bound, best)
            region = None if targets is None else np.argwhere(targets).tolist()
            episode = run(
                SwarmProblem(
                    workspace, task="gathering", region=region, start=start.tolist(), rule=rule
                )
            )
            bounds, exact = bounds + bound, exact + (bound == best)
            if episode:
                solved, planned, fewest = solved + 1, planned + episode.moves, fewest + best
        print(
            f"{rule}: {possible} of {cases} can be gathered; the bound is the optimum in {exact};"
            f" gather-beam gathers {solved}, with {planned} moves where {fewest} are optimal",
            flush=True,
        )


if __name__ == "__main__":
    main()
