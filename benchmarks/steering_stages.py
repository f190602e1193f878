"""python -m benchmarks.steering_stages: what each stage of planning brings, on the same random
problems with it and without it.

One row a stage: length without it over length with it, as a geometric mean of paired problems with
its 95 % confidence interval (normal approximation, of the logarithms), the largest ratio, how many
problems more are not solved, and CPU time without it over CPU time with it. Above 1 the stage
helps.

With --reference FILE no stage is switched off: lengths are compared with the shortest plans known,
which FILE holds for this command. Each run adds what it finds, so that long runs make a reference
for short ones.

Options: --problems N (of each class), --classes, --only NAMES, --seed S, --reference FILE,
--planning-seed S, --work W (times as many trees and plans around obstacles).
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from shapely import Polygon
from tests.reference.test_planners import SHAPES, instance

from benchmarks.steering import ROOMS, random_points, random_region
from shoal.steering import Region, SteeringProblem, SteeringTask, disk, polygon, region
from shoal.steering.planners import annealing, improvement, make_planner, sampling, shortest
from shoal.steering.planners.task import path_length

TOLERANCE = 1e-6  # relative to the size


def notched(rng: np.random.Generator) -> Region:
    """Return a rectangle 1 wide without a polygon that crosses its border."""
    while True:
        whole = random_region(rng)
        outline = Polygon(whole.outline)
        for obstacle in whole.obstacles:
            turned = rng.uniform(0, 2 * np.pi)
            moved = (
                obstacle
                - obstacle.mean(axis=0)
                + [0.5 + 0.5 * np.cos(turned), 0.4 + 0.4 * np.sin(turned)]
            )
            outline = outline.difference(Polygon(moved))
        if outline.geom_type == "Polygon" and not outline.interiors:
            return region(np.array(outline.exterior.coords)[:-1])


def with_obstacles(count: int) -> Callable[[np.random.Generator], Region]:
    def make(rng: np.random.Generator) -> Region:
        found = random_region(rng)
        while len(found.obstacles) != count:
            found = random_region(rng)
        return found

    return make


L_SHAPE = region([(0, 0), (3, 0), (3, 1.5), (1.5, 1.5), (1.5, 3), (0, 3)])
REGIONS = {  # a workspace that stays the same and random ones, by turns
    "non-convex": (L_SHAPE, notched),
    "one obstacle": (ROOMS["an obstacle"][0], with_obstacles(1)),
    "two obstacles": (ROOMS["two obstacles"][0], with_obstacles(2)),
}


def many_sided(rng: np.random.Generator) -> Any:
    angles = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(20, 60))))
    return polygon(0.5 * np.stack([np.cos(angles), rng.uniform(0.4, 1) * np.sin(angles)], axis=1))


def convex(rng: np.random.Generator, count: int) -> Iterator[SteeringProblem]:
    """Yield problems of a square, disks, also with distant goals, hexagons, heptagons and polygons
    of 20 to 60 corners.
    """
    makers = [*SHAPES.values(), many_sided]
    for k in range(count):
        room = makers[k % len(makers)](rng)
        problem = instance(rng, room)
        if room == disk(0.5) and k % 2:
            angle = rng.uniform(0, 2 * np.pi)
            out = rng.uniform(0.9, 0.999) * 0.5 * np.array([np.cos(angle), np.sin(angle)])
            problem = SteeringProblem(room, problem.start, [out, -out])
        yield problem


def problems_of(name: str, count: int, seed: int) -> list[SteeringProblem]:
    rng = np.random.default_rng(seed)
    if name == "convex":
        return list(convex(rng, count))
    same, make = REGIONS[name]
    found = []
    for k in range(count):
        room = make(rng) if k % 2 else same
        points = random_points(rng, room, 4)
        found.append(SteeringProblem(room, points[:2], points[2:], TOLERANCE * room.size))
    return found


def without_odds(name: str) -> tuple[Any, str, Any]:
    return (
        annealing,
        "ODDS",
        {one: 0.0 if one == name else odds for one, odds in annealing.ODDS.items()},
    )


def without_stage(number: int) -> tuple[Any, str, Any]:
    return annealing, "STAGES", annealing.STAGES[:number] + annealing.STAGES[number + 1 :]


def stages_of(planner: str) -> dict[str, tuple[Any, str, Any]]:
    """Return the stages of a planner: what stands in the place of an attribute of a module without
    each of them.
    """
    if planner == "shortest":
        return {
            "the chain of greedy": (shortest, "greedy_seeds", lambda *_given: []),
            "chains of two cycles": (improvement, "CYCLES", (1, 3)),
            "chains of three cycles": (improvement, "CYCLES", (1, 2)),
            "changes of chains": (improvement.ChainPool, "improve", lambda *_given: None),
            "contacts that slide to other sides": (
                improvement,
                "slide_contacts",
                lambda _query, chain: chain,
            ),
        }
    return {
        "trees but one": (sampling, "MORE_TREES", 0),
        **{
            f"{changes} changes each": without_stage(k)
            for k, (_, changes) in enumerate(annealing.STAGES)
        },
        **{f"change: {name}": without_odds(name) for name in list(annealing.ODDS)[1:]},
    }


@contextmanager
def more_work(work: float) -> Iterator[None]:
    """Let the planner sampling grow so many times as many trees, and change so many times as many
    plans.
    """
    trees = max(1, round(work * (sampling.MORE_TREES + 1)))
    stages = tuple((max(1, round(work * number)), changes) for number, changes in annealing.STAGES)
    with (
        mock.patch.object(sampling, "MORE_TREES", trees - 1),
        mock.patch.object(annealing, "STAGES", stages),
    ):
        yield


def lengths(
    problems: list[SteeringProblem], planner: str, *, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Return the length of each plan, infinite if there is none that ends at the goals, and its CPU
    time.
    """
    found, times = [], []
    for problem in problems:
        task = SteeringTask(
            problem.world(gain=0.0),
            *problem.endpoints(0),
            problem.tolerance,
            problem.max_moves,
            seed,
        )
        begun = time.process_time()
        moves = make_planner(planner).plan(task)
        times.append(time.process_time() - begun)
        arrives = (
            moves is not None
            and task.error(task.world.play(task.start, moves)[-1]) <= task.tolerance
        )
        found.append(path_length(moves) if arrives else math.inf)
    return np.array(found), np.array(times)


def ablation(name: str, problems: list[SteeringProblem], only: list[str]) -> None:
    planner = "shortest" if name == "convex" else "sampling"
    lengths(problems[:10], planner)  # kernels are loaded
    whole, times = lengths(problems, planner)
    print(
        f"\n{name}, {planner}: {len(problems)} problems, {np.isinf(whole).sum()} not solved,"
        f" {times.mean():.2f} CPU s a plan\n"
    )
    print(
        "| without | length without / with | largest | not solved | CPU time without / with"
        " |\n|---|---|---|---|---|",
        flush=True,
    )
    for stage, switched in stages_of(planner).items():
        if only and stage not in only:
            continue
        with mock.patch.object(*switched):
            less, faster = lengths(problems, planner)
        both = np.isfinite(less) & np.isfinite(whole)
        logs = np.log(less[both] / whole[both])
        half = 1.96 * float(np.std(logs, ddof=1)) / math.sqrt(len(logs))
        low, mid, high = np.exp(logs.mean() + np.array([-half, 0, half]))
        lost = int(np.isinf(less).sum() - np.isinf(whole).sum())
        ratios = f"{mid:.3f} [{low:.3f}, {high:.3f}] | {np.exp(logs.max()):.3f}"
        print(f"| {stage} | {ratios} | {lost} | {faster.sum() / times.sum():.2f} |", flush=True)


def compared(name: str, problems: list[SteeringProblem], file: Path, seed: int) -> None:
    """Compare with the shortest plans known, and write down those that are shorter."""
    planner = "shortest" if name == "convex" else "sampling"
    lengths(problems[:10], planner)  # kernels are loaded
    found, times = lengths(problems, planner, seed=seed)
    known = json.loads(file.read_text()) if file.exists() else {}
    best = np.minimum(found, [known.get(problem.canonical(), math.inf) for problem in problems])
    known |= {
        problem.canonical(): length for problem, length in zip(problems, best.tolist(), strict=True)
    }
    file.write_text(json.dumps(known))
    mean, most = 100 * (np.mean(found / best) - 1), 100 * (np.max(found / best) - 1)
    print(
        f"{name}: {len(problems)} problems, {np.isinf(found).sum()} not solved, {times.mean():.2f}"
        f" CPU s a plan, longer than the shortest known by {mean:.1f} % in the mean, {most:.1f} %"
        " at most",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=50)
    parser.add_argument("--classes", default="convex,non-convex,one obstacle,two obstacles")
    parser.add_argument("--only", default="")
    parser.add_argument("--seed", type=int, default=2026, help="of the problems")
    parser.add_argument("--planning-seed", type=int, default=0)
    parser.add_argument("--reference", type=Path)
    parser.add_argument("--work", type=float, default=1)
    given = parser.parse_args()
    with more_work(given.work):
        for name in given.classes.split(","):
            problems = problems_of(name, given.problems, given.seed)
            if given.reference:
                compared(name, problems, given.reference, given.planning_seed)
            else:
                ablation(name, problems, [one for one in given.only.split(",") if one])


if __name__ == "__main__":
    main()
