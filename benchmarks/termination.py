"""python -m benchmarks.termination [EPISODES] [FIRST]: planners end, on random maps of every kind
with any number of particles.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter

import numpy as np
from tests.swarm_runs import run

from shoal.swarm import GridWorkspace
from shoal.swarm.maps.generators import generate

MAPS = (
    "line:{a}",
    "rectangle:{b}x{c}",
    "htree:{a}",
    "maze:{b}x{c}:{s}",
    "cave:{b}x{c}:{s}",
    "vessels:{d}:{s}",
    "noise",
)
POLICIES = ("best", "greedy-classify", "best:budget=20")
TASKS = ("mapping", "coverage", "subset-coverage")
RULES = ("block", "merge")


def workspace_of(rng: np.random.Generator) -> GridWorkspace:
    """Return the largest part of a random map."""
    sizes = {
        "a": int(rng.integers(1, 80)),
        "b": 3 + 2 * int(rng.integers(6)),
        "c": 3 + 2 * int(rng.integers(8)),
        "s": int(rng.integers(50)),
    }
    sizes["d"] = int(rng.integers(60, 160))
    name = MAPS[rng.integers(len(MAPS))].format(**sizes)
    if name == "noise":
        shape = tuple(int(side) for side in rng.integers(1, 7, size=3 if rng.random() < 0.3 else 2))
        free = rng.random(shape) < rng.uniform(0.3, 1)
        free.flat[0] = True
    else:
        free = generate(name)
    return GridWorkspace(free, name=name).largest_component()


def main() -> int:
    """Play; return 1 if an episode did not end."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("episodes", nargs="?", type=int, default=100_000)
    parser.add_argument("first", nargs="?", type=int, default=0, help="number of the first episode")
    given = parser.parse_args()
    episodes, first = given.episodes, given.first
    statuses: Counter[str] = Counter()
    longest = 0.0
    for number in range(first, first + episodes):
        rng = np.random.default_rng([7, number])
        workspace = workspace_of(rng)
        n = (
            int(rng.integers(1, workspace.n_free + 1))
            if rng.random() < 0.5
            else int(rng.integers(1, min(6, workspace.n_free) + 1))
        )
        options = {
            "policy": str(rng.choice(POLICIES)),
            "task": str(rng.choice(TASKS)),
            "rule": str(rng.choice(RULES)),
        }
        episode = run(workspace, particles=n, seed=number, max_moves=100_000, **options)
        statuses[episode.status] += 1
        longest = max(longest, episode.moves / workspace.n_free)
        if episode.status != "complete":
            print(
                f"episode {number}: {workspace.name}, {n} particles, {options}: {episode.sentence}",
                flush=True,
            )
        if (number + 1) % 1000 == 0:
            print(
                f"{number + 1 - first} episodes, {dict(statuses)}, at most {longest:.1f} moves a"
                " free cell",
                flush=True,
            )
    return 0 if set(statuses) == {"complete"} else 1


if __name__ == "__main__":
    sys.exit(main())
