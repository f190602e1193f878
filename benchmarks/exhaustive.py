"""python -m benchmarks.exhaustive: whether plans of few commands for known maps are optimal, by all
shorter plans.

Options: --map NAME, --particles N, --task TASK, --trials T.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from tests.swarm_runs import run

from shoal import open_map
from shoal.swarm import GridWorld, SwarmState


def covers(world: GridWorld, state: SwarmState, left: np.ndarray, commands: int) -> bool:
    """Return whether so many commands can bring a particle onto each of the cells left."""
    most = np.count_nonzero(state.occupied.inner)  # cells that one command can settle
    left = left & ~state.occupied.inner
    lacking = np.count_nonzero(left)
    if lacking == 0:
        return True
    return bool(lacking <= commands * most) and any(
        covers(world, world.step(state, letter), left, commands - 1) for letter in "lurd"
    )


def main() -> None:
    """Print the plan's commands, those of closest-frontier and what the search says, one line a
    trial.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--map", default="rectangle:50x100")
    parser.add_argument("--particles", type=int, default=2500)
    parser.add_argument(
        "--task", default="subset-coverage", choices=("coverage", "subset-coverage")
    )
    parser.add_argument("--trials", type=int, default=10)
    given = parser.parse_args()
    workspace = open_map(given.map)
    world = GridWorld(workspace)
    for trial in range(given.trials):
        plan, base = (
            run(workspace, particles=given.particles, trial=trial, task=given.task, policy=policy)
            for policy in ("offline", "closest-frontier")
        )
        wanted = workspace.free if plan.targets is None else plan.targets
        began = time.perf_counter()
        fewer = covers(world, world.initial(plan.start), wanted, plan.moves - 1)
        verdict = "shorter ones exist" if fewer else "no plan is shorter"
        print(
            f"trial {trial}: {plan.moves} commands, closest-frontier {base.moves}; {verdict}"
            f" ({time.perf_counter() - began:.1f} s)",
            flush=True,
        )


if __name__ == "__main__":
    main()
