"""python -m benchmarks.latency: how long the planner `best` thinks about a single move, at n = 1000
with the default budget.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from shoal import open_map
from shoal.swarm import GridWorkspace, GridWorld, make_policy, make_task
from shoal.swarm.grid.board import trial_rng
from shoal.swarm.grid.scans import Trace
from shoal.swarm.grid.tasks import place
from shoal.swarm.kernels.moves import RUNNING
from shoal.swarm.simulation.compiled import PlannerGame

MAPS = ("htree:5000", "rectangle:50x100", "line:5000", "vessels:5000")
PARTICLES, TRIALS = 1000, 3


def times(workspace: GridWorkspace, trial: int) -> list[float]:
    """Return the milliseconds that each move of one mapping takes, planning and simulated world
    included.
    """
    rng = trial_rng(0, trial)
    world, task = GridWorld(workspace), make_task("mapping")
    state = world.initial(place(workspace, PARTICLES, "uniform", rng))
    belief = task.begin(world, state)
    game = PlannerGame(
        make_policy("best"), world.free, state, belief, rule="block", mapping=True, rng=rng
    )
    taken, status = [], RUNNING
    while status == RUNNING:
        trace = Trace.empty(1)
        began = time.perf_counter()
        _, status = game.play_on(trace, 1)
        taken.append(1e3 * (time.perf_counter() - began))
    return taken


def main() -> None:
    """Print one line a map."""
    times(open_map("line:1100"), 0)  # loads the kernels
    for name in MAPS:
        taken = [one for trial in range(TRIALS) for one in times(open_map(name), trial)]
        print(
            f"{name:<18} {len(taken):>4} moves   median {np.median(taken):5.2f} ms   mean"
            f" {np.mean(taken):5.2f} ms   nine of ten within {np.quantile(taken, 0.9):5.2f} ms",
            flush=True,
        )


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    main()
