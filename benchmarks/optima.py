"""python -m benchmarks.optima: small coverages against their exact optimum, and the optimum against
the lower bound.

Options: --cases N, --seed S.
"""

from __future__ import annotations

import argparse
import statistics

from tests.reference.small import small_cases
from tests.swarm_runs import run

from shoal.swarm.policies.planners.offline import plan_coverage
from shoal.swarm.theory.bounds import lower_bound, optimum

POLICIES = ("best", "rollout", "closest-frontier")


def main() -> None:
    """Print the mean excess over the optimum of each policy and of the offline plan."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--cases", type=int, default=200, help="drawn; those with nothing to do are left out"
    )
    parser.add_argument("--seed", type=int, default=11)
    given = parser.parse_args()
    excess: dict[str, list[float]] = {name: [] for name in (*POLICIES, "plan_coverage")}
    gaps = []
    for workspace, start in small_cases(given.cases, given.seed):
        fewest = optimum(workspace, start).moves
        if fewest == 0:
            continue
        for name in POLICIES:
            excess[name].append(
                run(workspace, task="coverage", start=start, policy=name).moves / fewest - 1
            )
        excess["plan_coverage"].append(len(plan_coverage(workspace, start)) / fewest - 1)
        gaps.append(fewest / lower_bound(workspace, start).moves)
    print(
        f"{len(gaps)} coverages; the optimum is {statistics.fmean(gaps):.2f} times the lower bound"
        " on average"
    )
    for name, values in excess.items():
        print(f"{name:<18} {100 * statistics.fmean(values):5.1f} % over the optimum on average")


if __name__ == "__main__":
    main()
