"""Run a program, and tell how many steps of environments it made: ``python counted.py PROGRAM``."""

from __future__ import annotations

import runpy
import sys
from collections import Counter
from functools import wraps

from shoal.envs.search import SearchWorlds
from shoal.envs.search_v0 import SearchParallelEnv
from shoal.envs.steering import SteeringWorlds
from shoal.envs.swarm import SwarmWorlds

STEPS = "steps of environments:"


def count(kind, steps, of):
    """Let ``kind.step`` add to ``steps`` what ``of`` returns for its arguments."""
    step = kind.step

    @wraps(step)
    def counting(self, *args, **options):
        steps[kind] += of(self, *args, **options)
        return step(self, *args, **options)

    kind.step = counting


def worlds_of(worlds, actions, where=None):
    """Return the number of worlds that take a step."""
    return len(worlds.batch) if where is None else int(where.sum())


def agents_of(env, actions):
    """Return the number of agents that take a step."""
    return len(actions)


if __name__ == "__main__":
    steps: Counter[type] = Counter()
    for kind in (SwarmWorlds, SteeringWorlds, SearchWorlds):
        count(kind, steps, worlds_of)
    count(SearchParallelEnv, steps, agents_of)
    runpy.run_path(sys.argv[1], run_name="__main__")
    print(STEPS, steps.total())
