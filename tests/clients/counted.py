"""Run a program, and tell how many steps of environments it made: ``python counted.py PROGRAM``."""

from __future__ import annotations

import runpy
import sys
from functools import wraps

from shoal.envs.search import SearchWorlds
from shoal.envs.search_v0 import SearchParallelEnv
from shoal.envs.steering import SteeringWorlds
from shoal.envs.swarm import SwarmWorlds

STEPS = "steps of environments:"
made = 0


def count_worlds(kind):
    """Let the class count the worlds that take a step."""
    step = kind.step

    @wraps(step)
    def counting(worlds, actions, where=None):
        global made
        made += len(worlds.batch) if where is None else int(where.sum())
        return step(worlds, actions, where)

    kind.step = counting


def count_agents(kind):
    """Let the class count the agents that take a step."""
    step = kind.step

    @wraps(step)
    def counting(env, actions):
        global made
        made += len(actions)
        return step(env, actions)

    kind.step = counting


if __name__ == "__main__":
    for kind in (SwarmWorlds, SteeringWorlds, SearchWorlds):
        count_worlds(kind)
    count_agents(SearchParallelEnv)
    runpy.run_path(sys.argv[1], run_name="__main__")
    print(STEPS, made)
