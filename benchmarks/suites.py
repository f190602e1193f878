"""python -m benchmarks.suites: make the suites of Shoal-Bench that do not exist yet, with their maps,
references and digests (src/shoal/lab/suites.json).

A suite in the file is never made again: the program only checks that its problems are unchanged. To
change a suite, declare its next version here.

    python -m benchmarks.suites [--check]
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

import shoal.lab
from shoal.lab.bench import Suite, suite_of
from shoal.lab.sweep import trial_seed
from shoal.parts import run
from shoal.swarm import GridWorkspace
from shoal.swarm.maps.imaging import find_vessels, map_of_vessels

FILE = Path(shoal.lab.__file__).with_name("suites.json")
PLACES = 10  # of each split
FIRST_TEST = 1001  # seed of the first test place; that of the first training place is 1
SEARCHED = ("hop", "loop", "either-end", "two-way", "individual-shift", "common-shift", "stay")
STEERED = ("greedy", "fewest-moves", "shortest", "robust")
GUIDED = ("random-moves", "closest-frontier", "greedy-classify", "best")


def polygon(seed: int) -> str:
    """Return a random convex polygon, the hull of 8 points in a unit square, as WKT."""
    from scipy.spatial import ConvexHull

    points = np.random.default_rng(seed).uniform(size=(8, 2))
    corners = points[ConvexHull(points).vertices].round(3)
    return "POLYGON ((" + ", ".join(f"{x} {y}" for x, y in [*corners, corners[0]]) + "))"


def region(seed: int) -> str:
    """Return a random rectangle, ring or disk, with sides in metres."""
    rng = np.random.default_rng(seed)
    width, height = rng.integers(8, 13) * 10, rng.integers(6, 10) * 10
    return (f"rectangle:{width}x{height}", f"ring:{width}x{width - 40}", f"circle:{height // 2}")[
        rng.integers(3)
    ]


def real_maps() -> list[dict[str, Any]]:
    """Return maps of the vessels in nine pieces of the photograph of a retina that scikit-image
    contains (CC0), cut in a grid.
    """
    from skimage import data

    mask = find_vessels(data.retina()).mask
    rows, columns = (np.linspace(0, side, 4).astype(int) for side in mask.shape)
    return [
        GridWorkspace(
            map_of_vessels(mask[rows[i] : rows[i + 1], columns[j] : columns[j + 1]], width=64),
            name=f"retina-{3 * i + j + 1}",
        ).to_dict()
        for i in range(3)
        for j in range(3)
    ]


def swarm(task: str, level: str, map_: Any, particles: int, budget: int) -> Suite:
    """Return a suite for a swarm, whose maps are generated, or given as ``map_``."""
    made = isinstance(map_, str)
    return _suite(
        f"{task}-{level}-v1",
        {"kind": "swarm", "task": task, "particles": particles, "max_moves": budget},
        ("policy", "map"),
        _seeded(lambda seed: f"{map_}:{seed}") if made else ((), tuple(map_)),
        ("moves", budget, "closest-frontier"),
        GUIDED,
    )


def steering(level: str, reference: str, **fields: Any) -> Suite:
    """Return a suite for two particles in random convex polygons."""
    shared = {"kind": "steering", "start": "random", "goal": "random", "max_moves": 20}
    return _suite(
        f"steering-{level}-v1",
        shared | fields,
        ("planner", "workspace"),
        _seeded(polygon),
        ("moves", 20, reference),
        STEERED,
    )


def search(level: str, **fields: Any) -> Suite:
    """Return a suite for robots in random regions."""
    return _suite(
        f"search-{level}-v1",
        {"kind": "search", "footprint": 10, **fields},
        ("allocation", "region"),
        _seeded(region),
        ("makespan", 5000, "hop"),
        SEARCHED,
    )


def _seeded(make: Any) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Return distinct training and test places, by seed."""
    found: list[Any] = []
    for first in (1, FIRST_TEST):
        wanted, seed = len(found) + PLACES, first
        while len(found) < wanted:
            place = make(seed)
            found += [place] if place not in found else []
            seed += 1
    return tuple(found[:PLACES]), tuple(found[PLACES:])


def _suite(
    name: str,
    problem: dict[str, Any],
    fields: tuple[str, str],
    places: tuple[tuple[Any, ...], tuple[Any, ...]],
    measured: tuple[str, float, str],
    baselines: tuple[str, ...],
) -> Suite:
    return Suite(name, problem, *fields, *places, 5, *measured, (), baselines, "")


def declared() -> list[Suite]:
    real = real_maps()
    return [
        swarm("mapping", "easy", "vessels:300", 30, 2000),
        swarm("mapping", "medium", "vessels:1000", 100, 4000),
        swarm("mapping", "hard", "vessels:3000", 200, 8000),
        swarm("mapping", "real", real, 50, 8000),
        swarm("coverage", "easy", "maze:21x15", 10, 2000),
        swarm("coverage", "medium", "cave:60x40", 20, 5000),
        swarm("coverage", "hard", "vessels:2000", 20, 8000),
        swarm("coverage", "real", real, 20, 8000),
        steering("easy", "fewest-moves", tolerance=0.01),
        steering("medium", "robust", tolerance=0.05, execution=0.003),
        steering("hard", "robust", tolerance=0.05, execution=0.006),
        search("easy", robots=4),
        search("medium", robots=6, loss=0.3, crashes=1),
        search("hard", robots=8, loss=0.6, crashes=3),
    ]


def finished(suite: Suite) -> Suite:
    """Return a suite with its digest and with the measured reference."""
    points = suite.sweep([suite.reference]).points
    values = tuple(
        tuple(_reference(suite, point, trial) for trial in range(suite.trials)) for point in points
    )
    return replace(suite, reference_values=values, digest=suite.content_digest())


def _reference(suite: Suite, point: Any, trial: int) -> float:
    episode = run(point.problem.opened(), seed=trial_seed(0, point.seeds, trial))
    value = float(episode.metrics[suite.measure])
    return min(value, suite.budget) if episode.status.done else suite.budget


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--check", action="store_true", help="make no new suite")
    made = json.loads(FILE.read_text()) if FILE.exists() else []
    for entry in made:
        suite_of(entry).check_unchanged()
        print(f"{entry['name']}: unchanged")
    if parser.parse_args().check:
        return
    names = {entry["name"] for entry in made}
    for suite in declared():
        if suite.name not in names:
            made.append(asdict(finished(suite)))
            print(f"{suite.name}: made", flush=True)
    FILE.write_text("[\n" + ",\n".join(json.dumps(entry) for entry in made) + "\n]\n")


if __name__ == "__main__":
    main()
