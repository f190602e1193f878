"""python -m benchmarks.robots [RUNS [SPEED_UP]]: searches of six robots to which much happens.

Each robot is a process with a simulated autopilot of its own, at loopback addresses of their own;
each radio loses 30 % of the messages. Three programs are killed with SIGKILL, two of them are
started again from disk, one autopilot falls silent, one loses its position, and a stranger sends
forged, replayed and broken packets. Which robots, and when, is random. A run passes if every cell
was searched by a vehicle that was there, no two robots were in one cell, vehicles kept apart,
nobody left the region, and nobody was left in the air.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
from pathlib import Path

from shoal.robots.rehearsal import Happening, Rehearsal
from shoal.robots.tasks import read_task, write_task
from shoal.search import SearchProblem
from shoal.search.run import run

ROBOTS, LOSS = 6, 0.3


def happenings(chance: random.Random) -> list[Happening]:
    """Return what happens to which robot, and when."""
    robots = chance.sample(range(1, ROBOTS + 1), 5)
    killed, silent, blind = robots[:3], robots[3], robots[4]
    at = [chance.uniform(0.05, 0.6) for _ in robots]
    some = [Happening(when, "kill", robot) for when, robot in zip(at, killed, strict=False)]
    some += [
        Happening(when + chance.uniform(0.02, 0.2), "restart", robot)
        for when, robot in zip(at, killed[:2], strict=False)
    ]
    return [*some, Happening(at[3], "silence", silent), Happening(at[4], "blind", blind)]


def main(runs: int, speed_up: float) -> int:
    passed = 0
    for seed in range(runs):
        chance = random.Random(seed)
        places = chance.sample(
            [(x, y) for x in range(5, 120, 10) for y in range(5, 80, 10)], ROBOTS
        )
        problem = SearchProblem(
            region="rectangle:120x80",
            robots=ROBOTS,
            starts=tuple(places),
            footprint=10,
            vehicle="multirotor,altitude=30",
            loss=LOSS,
        )
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            write_task(run(problem, seed=seed), folder)
            rehearsal = Rehearsal(
                read_task(folder),
                folder / "runs",
                speed_up=speed_up,
                autopilot=("px4", "ardupilot")[seed % 2],
            )
            result = rehearsal.run("run", happenings(chance), stranger=True, seed=seed)
        record = result.record
        near = record.approach
        passed += not result.faults
        print(
            f"seed {seed}: {100 * record.covered_fraction:.4g} % of {record.cells} cells in"
            f" {record.seconds:.0f} s, {len(record.shared)} cells shared,"
            f" {'no approach' if near is None else str(near['horizontal_m']) + ' m'},"
            f" {len(record.hovering)} in the air, {sum(one['refused'] for one in result.robots)}"
            f" packets refused of {sum(result.stranger.values())} of the stranger, late"
            f" {result.late_s} s; {'; '.join(result.faults) or 'passed'}",
            flush=True,
        )
    print(f"{passed} of {runs} passed")
    return 0 if passed == runs else 1


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="?", type=int, default=20)
    parser.add_argument("speed_up", nargs="?", type=float, default=6.0)
    given = parser.parse_args()
    sys.exit(main(given.runs, given.speed_up))
