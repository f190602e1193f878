"""Searches with a probability matrix as environments: search_v0 beside DSSE (PyPI, 1.1.9):
python -m benchmarks.dsse [--dsse PYTHON]

PYTHON is an interpreter with DSSE, such as that of a virtual environment of its own. Both search
20 x 20 cells for one moving target, with agents that choose at random among the moves and a search
(DSSE: a move and a search are two actions; here, a robot searches each cell that it enters). Printed
are steps in a CPU second, and of ten seeds, how many repeat: the same seed and the same actions give
the same observations, rewards and moves of the target.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import time

import numpy as np

SIDE, STEPS = 20, 200

DSSE = """
import contextlib, io, json, sys, time
import numpy as np
from DSSE import DroneSwarmSearch

def run(robots, seed, steps):
    with contextlib.redirect_stdout(io.StringIO()):
        env = DroneSwarmSearch(grid_size=20, render_mode="ansi", drone_amount=robots,
                               timestep_limit=10**9, person_amount=1,
                               person_initial_position=(10, 10), dispersion_inc=0.05)
    rng, told, spent, done = np.random.default_rng(seed), [], 0.0, 0
    while done < steps:
        begun = time.process_time()
        observations, _ = env.reset(seed=seed)
        spent += time.process_time() - begun
        while env.agents and done < steps:
            actions = {agent: int(rng.integers(0, 9)) for agent in env.agents}
            begun = time.process_time()
            observations, rewards, *_ = env.step(actions)
            spent += time.process_time() - begun
            done += 1
            told.append([sum(rewards.values()), float(np.sum([o[1].sum() + sum(o[0]) for o in observations.values()])),
                         sorted((person.x, person.y) for person in env.persons_set)])
    return told, spent

result = {"speed": {}, "repeat": 0}
for robots in (2, 8):
    run(robots, 0, 20)
    result["speed"][robots] = STEPS / run(robots, 1, STEPS)[1]
result["repeat"] = sum(run(2, seed, 60)[0] == run(2, seed, 60)[0] for seed in range(10))
print(json.dumps(result))
"""


def run(robots: int, seed: int, steps: int) -> tuple[list[list[object]], float]:
    """Return what robots are told in so many steps, and the CPU time of the environment."""
    from shoal.envs import search_v0

    env = search_v0.parallel_env(
        region=f"square:{SIDE}",
        footprint=1,
        robots=robots,
        targets=1,
        prior=[f"ring:{SIDE / 2},{SIDE / 2}:0.5=3,0.95=8"],
        target_moves=0.1,
        until="found",
        found_reward=1,
    )
    rng, told, spent, done = np.random.default_rng(seed), [], 0.0, 0
    while done < steps:
        begun = time.process_time()
        env.reset(seed=seed)
        spent += time.process_time() - begun
        while env.agents and done < steps:
            actions = {agent: int(rng.integers(1, 6)) for agent in env.agents}
            begun = time.process_time()
            observations, rewards, *_ = env.step(actions)
            spent += time.process_time() - begun
            done += 1
            seen = sum(
                float(one["likely"].astype(float) @ np.arange(SIDE) @ np.arange(SIDE))
                + float(one["planes"].sum())
                for one in observations.values()
            )
            told.append([sum(rewards.values()), seen, [*env.unwrapped.missing]])
    return told, spent


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dsse", metavar="PYTHON")
    options = parser.parse_args()
    rows = {"search_v0": {"speed": {}, "repeat": 0}}
    for robots in (2, 8):
        run(robots, 0, 20)
        rows["search_v0"]["speed"][str(robots)] = STEPS / run(robots, 1, STEPS)[1]
    rows["search_v0"]["repeat"] = sum(run(2, s, 60)[0] == run(2, s, 60)[0] for s in range(10))
    if options.dsse:
        code = DSSE.replace("STEPS", str(STEPS))
        done = subprocess.run(
            [options.dsse, "-c", code], capture_output=True, text=True, check=True, timeout=600
        )
        rows["DSSE 1.1.9"] = json.loads(done.stdout.splitlines()[-1])
    print("| environment | steps in a CPU second, 2 robots | 8 robots | seeds of ten that repeat |")
    print("|---|---|---|---|")
    for name, row in rows.items():
        two, eight = (row["speed"][robots] for robots in ("2", "8"))
        print(f"| {name} | {two:.0f} | {eight:.0f} | {row['repeat']} |")


if __name__ == "__main__":
    main()
