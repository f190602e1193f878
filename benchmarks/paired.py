"""python -m benchmarks.paired: moves of the planner `best` against its moves at another commit, from
equal starts.

One row a map, one column a number of particles: geometric means of the ratios of paired trials, with
95 % confidence intervals (of the logarithms, normal approximation) and the numbers of trials. The
last row and column are geometric means of the entries.

The file `BEFORE` holds the moves of commit 7cca8171, which had all mechanisms that were removed since
(docs/concepts/planners-measured.md). To compare with another commit, copy this module to its
checkout, and type there and here

    python -m benchmarks.paired --save moves.json
    python -m benchmarks.paired --against moves.json

CPU times compare only if one machine measured both.

Without --save, at most the trials of the other file are played.

Options: --trials N, --few-trials N (up to 100 particles), --first N, --counts, --maps, --task,
--save FILE, --against FILE.
"""

from __future__ import annotations

import argparse
import json
import math
import time
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from tests.swarm_runs import run

from shoal import open_map

BEFORE = Path(__file__).with_name("paired.json")
MAPS = "vessels:5000,htree:5000,rectangle:50x100,line:5000,cave:120x80"
COUNTS = "100,500,1000,2500,4000"
Estimate = tuple[float, float]  # mean of logarithms, its standard error


def play(point: dict[str, Any], place: Any, n: int, task: str, first: int, trials: int) -> bool:
    """Add trials to a point for about a second. Return whether trials are still missing."""
    end = time.process_time() + 1
    while len(point["moves"]) < trials and time.process_time() < end:
        trial, began = first + len(point["moves"]), time.process_time()
        episode = run(place, particles=n, trial=trial, policy="best", task=task)
        assert episode.status == "complete", episode
        point["seconds"] += time.process_time() - began
        if trial == first:
            point["start"] = zlib.crc32(np.ascontiguousarray(episode.start, dtype="<i8").tobytes())
        point["moves"].append(episode.moves)
    return len(point["moves"]) < trials


def logarithms(ours: dict[str, Any], theirs: dict[str, Any]) -> list[float]:
    """Return the logarithms of the ratios of paired trials."""
    assert ours["start"] == theirs["start"], "the starts differ: another map or random generator"
    pairs = zip(ours["moves"], theirs["moves"], strict=False)
    return [math.log(max(1, a) / max(1, b)) for a, b in pairs]


def mean_of(estimates: list[Estimate]) -> Estimate:
    """Return the mean of independent estimates."""
    means, errors = np.array(estimates).T
    return float(means.mean()), float(np.hypot.reduce(errors) / len(errors))


def interval(estimate: Estimate) -> str:
    """Return a geometric mean with its interval."""
    mean, half = estimate[0], 1.96 * estimate[1]
    return f"{math.exp(mean):.3f} [{math.exp(mean - half):.3f}, {math.exp(mean + half):.3f}]"


def show(points: dict[tuple[str, int], list[float]], maps: list[str], counts: list[int]) -> None:
    """Print the table of the logarithms of each map and number of particles."""
    estimates = {
        key: (float(np.mean(logs)), float(np.std(logs, ddof=1)) / math.sqrt(len(logs)))
        for key, logs in points.items()
        if len(logs) > 1
    }

    def mean(chosen: list[tuple[str, int]]) -> str:
        some = [estimates[key] for key in chosen if key in estimates]
        return interval(mean_of(some)) if some else ""

    print(
        f"| map | {' | '.join(f'n = {n}' for n in counts)} | all |\n|{'---|' * (len(counts) + 2)}"
    )
    for name in maps:
        row = [
            f"{interval(estimates[name, n])} ({len(points[name, n])})"
            if (name, n) in estimates
            else ""
            for n in counts
        ]
        print(f"| `{name}` | {' | '.join(row)} | {mean([(name, n) for n in counts])} |")
    columns = [mean([(name, n) for name in maps]) for n in counts]
    print(f"| all | {' | '.join(columns)} | {mean(list(estimates))} |")


def main() -> None:
    """Play all points by turns, so that a busy machine slows all of them, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=300)
    parser.add_argument("--few-trials", type=int, default=300, help="up to 100 particles")
    parser.add_argument("--first", type=int, default=0, help="the first trial")
    parser.add_argument("--counts", default=COUNTS)
    parser.add_argument("--maps", default=MAPS)
    parser.add_argument("--task", default="mapping")
    parser.add_argument("--save", type=Path)
    parser.add_argument("--against", type=Path, default=BEFORE)
    given = parser.parse_args()
    places = {name: open_map(name) for name in given.maps.split(",")}
    counts = [int(n) for n in given.counts.split(",")]
    for place in places.values():  # what compiles and loads is not timed
        run(place, particles=min(counts), policy="best", task=given.task)
    points = {(name, n): f"{given.task} {name} {n}" for name in places for n in counts}
    theirs = json.loads(given.against.read_text()) if given.against.exists() else {}
    trials = {
        (name, n): min(given.trials, given.few_trials) if n <= 100 else given.trials
        for name, n in points
    }
    if not given.save:  # no other trials have a partner
        for at, key in points.items():
            trials[at] = min(trials[at], len(theirs[key]["moves"]) if key in theirs else 0)
    ours: dict[str, Any] = {
        key: {"start": 0, "seconds": 0.0, "moves": []} for key in points.values()
    }
    missing = [at for at in points if trials[at]]
    while missing:
        for name, n in list(missing):
            point = ours[points[name, n]]
            if not play(point, places[name], n, given.task, given.first, trials[name, n]):
                missing.remove((name, n))
        if given.save:
            given.save.write_text(json.dumps(ours) + "\n")
    pairs = {
        at: (ours[key], theirs[key])
        for at, key in points.items()
        if ours[key]["moves"] and key in theirs
    }
    if not pairs:
        print(f"{given.against}: expected moves of {', '.join(points.values())}, got none of them")
        return
    show({key: logarithms(*pair) for key, pair in pairs.items()}, list(places), counts)
    times = [
        math.log(a["seconds"] / sum(a["moves"]) * sum(b["moves"]) / b["seconds"])
        for a, b in pairs.values()
    ]
    print(
        f"\nCPU time a move, geometric mean: {math.exp(np.mean(times)):.3f} of the other commit's"
    )


if __name__ == "__main__":
    main()
