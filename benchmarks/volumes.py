"""Mapping a vessel tree of a million voxels with 10^5 particles: time, and memory under 2 GiB.

python -m benchmarks.volumes
"""

from __future__ import annotations

import argparse
import json

from benchmarks.timing import process, row

# Runs in a process of its own, so that its peak memory is its own.
RUN = """
import json, resource, sys, time
from shoal import open_map
from tests.swarm_runs import run
began = time.process_time()
workspace = open_map(sys.argv[1])
made = time.process_time() - began
run(open_map("vessels3d:30"), particles=2, policy=sys.argv[3])
episode = run(workspace, particles=int(sys.argv[2]), policy=sys.argv[3], max_moves=int(sys.argv[4]))
print(json.dumps({"moves": episode.moves, "seconds": episode.seconds, "status": episode.status, "shape": workspace.shape,
                  "made": made, "peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024}))
"""


def bench_volume(
    policy: str = "closest-frontier", name: str = "vessels3d:1000000", particles: int = 100_000
) -> None:
    """Map a vessel tree in a fresh process."""
    found = json.loads(process("-c", RUN, name, str(particles), policy, "1000000")[1])
    size = "x".join(map(str, found["shape"]))
    figure = f"{found['moves']} moves, {found['seconds']:.0f} s, {found['peak'] / 2**30:.2f} GiB"
    row(
        f"{name} ({size}), {particles} particles, {policy}",
        figure,
        "under 2 GiB",
        found["peak"] < 2 * 2**30,
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("policies", nargs="*", metavar="POLICY", default=["closest-frontier"])
    for chosen in parser.parse_args().policies:
        bench_volume(chosen)
