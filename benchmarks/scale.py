"""Large maps: time a move must grow no faster than the number of cells, memory must stay under 2
GiB.
"""

from __future__ import annotations

import json

from benchmarks.timing import process, row

# Runs in a process of its own, so that its peak memory is its own. An open cave with 30 % walls in
# blocks of 8 cells.
RUN = """
import json, resource, sys
import numpy as np
from shoal import GridWorkspace
from tests.swarm_runs import run
side, particles, moves = (int(argument) for argument in sys.argv[1:])
blocks = np.random.default_rng(0).random((side // 8, side // 8)) < 0.7
workspace = GridWorkspace(np.kron(blocks, np.ones((8, 8), bool)))
run(GridWorkspace(np.ones((9, 9), bool)), particles=2)
episode = run(workspace, particles=particles, max_moves=moves)
print(json.dumps({"moves": episode.moves, "seconds": episode.seconds, "classified": int(episode.trace.classified.sum()),
                  "peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024}))
"""


def measure(side: int, particles: int, moves: int) -> dict[str, float]:
    """Map a side x side workspace for so many moves in a fresh process."""
    found: dict[str, float] = json.loads(
        process("-c", RUN, str(side), str(particles), str(moves))[1]
    )
    return found


def bench_growth() -> None:
    """Six particles in a hundred cells on each map; the first 300 moves, which learn most."""
    picoseconds = []
    for side in (256, 1024, 4096):
        run = measure(side, side * side * 6 // 100, 300)
        picoseconds.append(run["seconds"] / run["moves"] / side**2 * 1e12)
    figure = " / ".join(f"{value:.0f}" for value in picoseconds) + " ps"
    grows_slower = picoseconds[2] <= picoseconds[0]
    row(
        "time a move and cell, sides of 256 / 1024 / 4096 cells",
        figure,
        "256 to 4096: no growth",
        grows_slower,
    )


def bench_scale() -> None:
    run = measure(4096, 1_000_000, 1000)
    figure = f"{run['seconds']:.1f} s, {run['peak'] / 2**30:.2f} GiB"
    row(
        "4096 x 4096, 10^6 particles, 1000 moves",
        figure,
        "under 2 GiB",
        run["peak"] < 2 * 2**30 and run["moves"] == 1000,
    )
