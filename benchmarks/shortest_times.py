"""python -m benchmarks.shortest_times --against CHECKOUT: processor seconds of the planner
`shortest`, and lengths of its plans, against those of another commit.

The problems are those of `benchmarks.certificates`. One process for each side stays open; both plan
each problem in turn, and the least time of several plans counts. One row a class: the geometric mean
of the ratios of times, and the greatest and the least ratio of lengths.

Options: --only CLASS, --against CHECKOUT (a folder with ``src`` of the other commit, for example made by
``git archive COMMIT src | tar -x -C CHECKOUT``), --problems N (a class), --repeat N.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from benchmarks.certificates import CLASSES

HERE = Path(__file__).parent.parent

# the other side may have other modules: only what both have is imported
PLAN = """
import json, sys, time
from shoal.steering import SteeringProblem, polygon
from shoal.steering.run import run
for line in sys.stdin:
    fields, seed, repeat = json.loads(line)
    if "corners" in fields:
        fields["workspace"] = polygon(fields.pop("corners"))
    problem, least = SteeringProblem(**fields), float("inf")
    for _ in range(repeat):
        begun = time.process_time()
        episode = run(problem, seed=seed)
        least = min(least, time.process_time() - begun)
    print(json.dumps([least, episode.length if episode else None]), flush=True)
"""


def _opened(folder: Path) -> subprocess.Popen[str]:
    environment = os.environ | {"PYTHONPATH": str(folder / "src")}
    return subprocess.Popen(
        [sys.executable, "-c", PLAN],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def _planned(side: subprocess.Popen[str], question: str) -> tuple[float, float | None]:
    assert side.stdin is not None
    assert side.stdout is not None
    side.stdin.write(question + "\n")
    side.stdin.flush()
    seconds, length = json.loads(side.stdout.readline())
    return seconds, length


def main() -> None:
    """Print the ratios of times and lengths by class."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--against", type=Path, required=True)
    parser.add_argument("--problems", type=int, default=10)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--only", choices=tuple(CLASSES))
    given = parser.parse_args()
    sides = [_opened(HERE), _opened(given.against)]
    every = []
    print("| class | problems | time | longest | shortest |\n|---|---|---|---|---|")
    for index, (name, make) in enumerate(CLASSES.items()):
        if given.only not in (None, name):
            continue
        times, lengths = [], []
        for number in range(given.problems):
            rng = np.random.default_rng([0, number, index])
            fields = make(rng)
            seed = int(rng.integers(1 << 30))
            if not isinstance(fields["workspace"], str):
                fields["corners"] = fields.pop("workspace").vertices.tolist()
            given_fields = {
                key: value.tolist() if isinstance(value, np.ndarray) else value
                for key, value in fields.items()
            }
            question = json.dumps([given_fields, seed, given.repeat])
            (now, length), (before, other) = (_planned(side, question) for side in sides)
            if length is not None and other is not None:
                times.append(now / before)
                lengths.append(length / other)
        every += times
        print(
            f"| {name} | {len(times)} | {np.exp(np.mean(np.log(times))):.2f} |"
            f" {max(lengths):.6f} | {min(lengths):.6f} |",
            flush=True,
        )
    print(f"| all | {len(every)} | {np.exp(np.mean(np.log(every))):.2f} | | |")
    for side in sides:
        side.communicate()


if __name__ == "__main__":
    main()
