"""Record a policy on the training places of a suite of Shoal-Bench, for offline learning: one
Minari dataset for each place, because places have pictures of different sizes.

    python -m benchmarks.datasets mapping-easy --policy best --out FOLDER [--episodes 20] [--seed 0]

The starts are those of the seeds of the environments, not those on which the suite scores a policy.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import gymnasium

import shoal.envs  # which registers the environments
from shoal.core.errors import InvalidInputError, ShoalError
from shoal.lab import Suite, find_suite


def environment(suite: Suite, place: object) -> gymnasium.Env:
    """Return the environment of a suite's problem at one of its places."""
    fields = {name: value for name, value in suite.problem.items() if name not in {"kind", "task"}}
    names = {"mapping": "Mapping", "coverage": "Coverage"}
    kind = names.get(suite.problem.get("task", ""), "Steering")
    return gymnasium.make(f"shoal/{kind}-v0", **{suite.place: place}, **fields)


def record(suite: Suite, policy: str, folder: Path, *, episodes: int, seed: int) -> list[Path]:
    """Write the datasets, and return their folders in the order of the training places."""
    if suite.problem["kind"] == "search":
        raise InvalidInputError(
            f"suite {suite.name}: expected a suite of mapping, coverage or steering, because"
            " allocations choose no actions"
        )
    if not suite.train:
        raise InvalidInputError(f"suite {suite.name}: expected training places, got none")
    folders = []
    for number, place in enumerate(suite.train):
        target = folder / f"{suite.name}-{policy}-{number}"
        dataset = shoal.envs.record_episodes(
            environment(suite, place),
            policy,
            target,
            episodes=episodes,
            seed=seed,
            # Minari's names end with a version
            name="shoal/{0}-{2}-{3}-v{1}".format(*suite.name.rsplit("-v", 1), policy, number),
        )
        print(f"{target}: {dataset.total_episodes} episodes, {dataset.total_steps} steps")
        folders.append(target)
    return folders


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("suite")
    parser.add_argument("--policy", default="best")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    try:
        record(
            find_suite(given.suite),
            given.policy,
            given.out,
            episodes=given.episodes,
            seed=given.seed,
        )
    except ShoalError as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
