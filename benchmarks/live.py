"""Twelve robots as processes, 30 % of the messages lost, eight killed: python -m benchmarks.live
[--runs N] [--side N] [--seed S]

Each run has random starts; eight robots are killed (SIGKILL) at random times before the time in
which all twelve could have been done, the first ones perhaps while they still listen. A line tells
what came of it, the last one counts.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

import numpy as np

from shoal.search import TourCost, allocate, make_tour
from shoal.search.problem.network import Crash, network_of
from shoal.search.protocol.state import Brief
from shoal.search.simulation.live import run_live
from shoal.search.simulation.scenario import Scenario

ROBOTS, KILLED, LOSS = 12, 8, 0.3
MARK = f"SHOAL_BENCHMARK={os.getpid()}"
HELLO = 0.3  # seconds; the machine may be busy


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument(
        "--side", type=int, default=16, help="the region is a square of so many cells a side"
    )
    parser.add_argument("--speed", type=float, default=20.0, help="cells a second")
    parser.add_argument("--channel", default="auto")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    os.environ.update([MARK.split("=")])  # those who start later have it
    tour_cost = TourCost(make_tour("hilbert-rectangle", (options.side, options.side)))
    complete, most, startups = 0, 0, []
    for run in range(options.seed, options.seed + options.runs):
        rng = np.random.default_rng(run)
        starts = rng.integers(0, len(tour_cost), ROBOTS)
        possible = allocate(tour_cost, starts).makespan
        times = rng.uniform(0.0, possible, KILLED)
        kill = [
            Crash(int(robot), float(time))
            for robot, time in zip(rng.permutation(ROBOTS)[:KILLED] + 1, times, strict=True)
        ]
        descriptors = len(os.listdir("/proc/self/fd"))
        seen = run_live(
            Scenario(
                Brief(tour_cost, hello=HELLO * options.speed),
                tuple(starts.tolist()),
                network=network_of(loss=LOSS),
                faults=tuple(kill),
                seed=run,
            ),
            speed=options.speed,
            channel=options.channel,
        )
        stray = strays() + sockets(seen.port) + len(os.listdir("/proc/self/fd")) - descriptors
        whole = seen.complete and len(seen.killed) == KILLED and not seen.failed
        complete, most = complete + whole, max(most, stray)
        startups.append(seen.startup)
        last = max(seen.declared.values(), default=float("nan"))
        print(
            f"run {run}: {'complete' if whole else 'NOT COMPLETE'}, {100 * seen.covered:.1f} %"
            f" searched, {len(seen.killed)} killed, {len(seen.declared)} declared, the last at"
            f" {last:.0f} (alone {tour_cost.whole:.0f}, all alive {possible:.0f}), {seen.lost} of"
            f" {seen.heard} messages lost, {seen.seconds:.1f} s, {seen.channel}, left behind:"
            f" {stray}",
            flush=True,
        )
    print(
        f"{complete} of {options.runs} complete; at most {most} processes, sockets and descriptors"
        " left behind; ",
        end="",
    )
    print(
        f"processes ready after {np.median(startups):.1f} s (median), {max(startups):.1f} s at the"
        " most"
    )
    return 0 if complete == options.runs and most == 0 else 1


def strays() -> int:
    """Return how many processes are left of those that this one has started: they
    inherit its mark.
    """
    found = 0
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            marked = MARK.encode() in (folder / "environ").read_bytes().split(b"\0")
        except OSError:  # gone, or another user's
            continue
        found += marked and int(folder.name) != os.getpid()
    return found


def sockets(port: int) -> int:
    """Return how many UDP sockets there are at a port."""
    lines = Path("/proc/net/udp").read_text().splitlines()[1:]
    return sum(int(line.split()[1].split(":")[1], 16) == port for line in lines) if port else 0


if __name__ == "__main__":
    sys.exit(main())
