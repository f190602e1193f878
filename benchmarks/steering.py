"""Planners on random instances: python -m benchmarks.steering [--instances N] [--seed S] [--only
PART]

Every plan is played by the plain simulation of tests/reference, which shares no code with the
planners.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial

import numpy as np
from shapely import Polygon, box
from tests.reference.test_planners import SHAPES, SQUARE, adversarial, instance, replayed_error
from tests.reference.test_steering import random_point
from tests.steering import steer

from shoal.steering import (
    Region,
    SteeringEpisode,
    SteeringProblem,
    cylinder,
    prism,
    region,
    regular_polygon,
)
from shoal.steering.simulation import replay


def row(name: str, episodes: list[SteeringEpisode], note: str = "") -> None:
    lengths, moves = ([getattr(e, field) for e in episodes] for field in ("length", "moves"))
    solved, below = (
        np.mean([bool(e) for e in episodes]),
        sum(e.lower_bound is not None and e.length < e.lower_bound for e in episodes if e),
    )
    times = 1e3 * np.array([e.seconds for e in episodes[1:]])
    print(
        f"{name:34s} solved {100 * solved:5.1f} %  length {np.mean(lengths):.4f}  moves"
        f" {np.mean(moves):.3f}  median {np.median(times):.1f} ms, at most {times.max():.0f}  below"
        f" the bound {below}{note}",
        flush=True,
    )


def planners(instances: int, seed: int) -> None:
    measured(
        instances,
        seed,
        (("greedy", 1e-3), ("greedy", 1e-6), ("shortest", 1e-6), ("fewest-moves", 1e-6)),
    )


def fewest(instances: int, seed: int) -> None:
    measured(instances, seed, (("fewest-moves", 1e-6),))


def measured(instances: int, seed: int, cases: tuple[tuple[str, float], ...]) -> None:
    for shape, make in SHAPES.items():
        baseline = 0.0
        for planner, tolerance in cases:
            rng = np.random.default_rng(seed)
            episodes, missed = [], 0
            for _ in range(instances):
                space = make(rng)
                episodes.append(steer(instance(rng, space, tolerance), planner=planner))
                missed += replayed_error(space, episodes[-1]) > tolerance
            mean = float(np.mean([e.length for e in episodes]))
            baseline = baseline or mean
            row(
                f"{shape}, {planner}, {tolerance:g}",
                episodes,
                f"  missed when replayed {missed}  ratio {mean / baseline:.3f}",
            )


def square(instances: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    worst, missed = 0.0, 0
    for _ in range(10 * instances):
        points = adversarial(rng)
        episode = steer(SteeringProblem(SQUARE, points[:2], points[2:]))
        worst = max(worst, episode.length)
        missed += replayed_error(SQUARE, episode) > 1e-6
    print(
        f"square, adversarial: longest of {10 * instances} {worst:.9f}, sqrt 2 + 2 ="
        f" {np.sqrt(2) + 2:.9f}, missed {missed}",
        flush=True,
    )


def friction(instances: int, seed: int) -> None:
    for planner, count in (("greedy", instances), ("shortest", instances // 5)):
        for shape, make in SHAPES.items():
            for coefficient in (0.5, 1.0, 2.0):
                rng = np.random.default_rng(seed)
                statuses, moves, times, missed = [], [], [], 0
                for _ in range(count):
                    space = make(rng)
                    episode = steer(
                        instance(rng, space), planner=planner, friction=coefficient, max_moves=1000
                    )
                    statuses.append(episode.status)
                    times.append(1e3 * episode.seconds)
                    if episode.status == "solved":
                        moves.append(episode.moves)
                        missed += replayed_error(space, episode) > 1e-6
                may = max(1, count - statuses.count("unreachable"))
                print(
                    f"{shape}, friction {coefficient:g}, {planner}: {count - may} proved"
                    f" impossible, solved {len(moves)} of {may}: {100 * len(moves) / may:.1f} %, in"
                    f" 100 moves {100 * sum(n <= 100 for n in moves) / may:.1f} %, missed when"
                    f" replayed {missed}, median {np.median(moves):.0f} moves,"
                    f" {np.median(times[1:]):.1f} ms",
                    flush=True,
                )


def robust(instances: int, seed: int) -> None:
    noise = {"execution": 1e-3, "measurement": 1e-3, "gain": 0.2}
    for shape, make in SHAPES.items():
        for planner in ("robust", "shortest"):
            rng = np.random.default_rng(seed)
            episodes = [
                steer(
                    instance(rng, make(rng), 0.01), planner=planner, **noise, seed=k, max_moves=40
                )
                for k in range(instances // 2)
            ]
            row(f"{shape}, noise, {planner}", episodes)


def space(instances: int, seed: int) -> None:
    for name, body in {
        "prism": prism(regular_polygon(5), 1.0),
        "cylinder": cylinder(0.5, 0.8),
    }.items():
        for planner in ("greedy", "shortest", "fewest-moves"):
            rng = np.random.default_rng(seed)
            episodes, no_more = [], []
            for _ in range(instances // 5):
                points = np.array(
                    [[*random_point(rng, body.base), rng.random() * body.height] for _ in range(4)]
                )
                episodes.append(
                    steer(SteeringProblem(body, points[:2], points[2:]), planner=planner)
                )
                flat = steer(
                    SteeringProblem(body.base, points[:2, :2], points[2:, :2]), planner=planner
                )
                no_more.append(episodes[-1].moves <= flat.moves)
            row(
                f"{name}, {planner}",
                episodes,
                f"  no more moves than in the plane {100 * np.mean(no_more):.1f} %",
            )


ROOMS = {
    "an obstacle": (
        region(
            [(0, 0), (4, 0), (4, 4), (0, 4)], [[(1.5, 1.5), (2.5, 1.5), (2.5, 2.5), (1.5, 2.5)]]
        ),
        2,
    ),
    "two obstacles": (
        region(
            [(0, 0), (6, 0), (6, 4), (0, 4)],
            [[(1, 1), (2, 0.8), (2.2, 2.5)], [(3.5, 1.5), (5, 1.2), (4.6, 2.9), (3.8, 3)]],
        ),
        2,
    ),
    "an L with an obstacle": (
        region(
            [(0, 0), (3, 0), (3, 1.5), (1.5, 1.5), (1.5, 3), (0, 3)],
            [[(0.6, 0.6), (0.9, 0.6), (0.9, 0.9), (0.6, 0.9)]],
        ),
        2,
    ),
    "three in the square": (SQUARE, 3),
    "four in the square": (SQUARE, 4),
}


def sampling(instances: int, seed: int) -> None:
    for name, (room, count) in ROOMS.items():
        rng = np.random.default_rng(seed)
        low, high = (
            np.array(room.shape.bounds).reshape(2, 2)
            if isinstance(room, Region)
            else (np.zeros(2), np.ones(2))
        )
        episodes = []
        for _ in range(max(2, instances // 50)):
            points: list[np.ndarray] = []
            while len(points) < 2 * count:
                point = low + (high - low) * rng.random(2)
                if room.depth(point) > 0:
                    points.append(point)
            problem = SteeringProblem(
                room, np.array(points[:count]), np.array(points[count:]), 1e-6 * room.size
            )
            episodes.append(steer(problem, planner="sampling"))
        row(f"{name}, sampling", episodes)


def random_region(rng: np.random.Generator) -> Region:
    """Return a rectangle 1 wide with one to three obstacles of three to five corners, anywhere, at
    least 0.03 from all others.
    """
    while True:
        high, obstacles = rng.uniform(0.7, 1.0), []
        for _ in range(int(rng.integers(1, 4))):
            angles = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 6)))
            center, radius = (
                rng.uniform([0.15, 0.15 * high], [0.85, 0.85 * high]),
                rng.uniform(0.06, 0.16),
            )
            obstacles.append(center + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1))
        shapes, inside = (
            [Polygon(obstacle) for obstacle in obstacles],
            box(0.03, 0.03, 0.97, high - 0.03),
        )
        apart = all(
            one.distance(other) > 0.03 for k, one in enumerate(shapes) for other in shapes[:k]
        )
        if apart and all(inside.contains(one) and one.area > 0.003 for one in shapes):
            return region([(0, 0), (1, 0), (1, high), (0, high)], obstacles)


def noise_around_obstacles(instances: int, seed: int) -> None:
    """Closed loops against plans that are sent as they are, on random workspaces of which each has
    one problem.
    """
    rng, problems = np.random.default_rng(seed), []
    for _ in range(max(2, instances // 50)):
        room = random_region(rng)
        points = random_points(rng, room, 4)
        problems.append(SteeringProblem(room, points[:2], points[2:]))
    for noise, tolerance in (
        (0.005, 0.05),
        (0.02, 0.05),
        (0.05, 0.05),
        (0.005, 0.02),
        (0.02, 0.02),
        (0.05, 0.02),
    ):
        loops = [
            steer(one, execution=noise, tolerance=tolerance, seed=k)
            for k, one in enumerate(problems)
        ]
        arrived = [e.moves for e in loops if e] or [0]
        row(
            f"noise {noise:g}, tolerance {tolerance:g}",
            loops,
            f"  moves of those that arrive {np.mean(arrived):.1f}",
        )
    plans = [steer(one) for one in problems]
    for noise, tolerance in ((0.005, 0.05), (0.02, 0.05), (0.05, 0.05)):
        noisy = [one.replaced(execution=noise) for one in problems]
        ends = [
            replay(one, plan.inputs, seed=k)[-1]
            for k, (one, plan) in enumerate(zip(noisy, plans, strict=True))
        ]
        arrive = [
            np.linalg.norm(end - one.goal, axis=1).max() <= tolerance
            for one, end in zip(problems, ends, strict=True)
        ]
        print(
            f"noise {noise:g}, tolerance {tolerance:g}, sent as planned:"
            f" {100 * np.mean(arrive):.0f} % arrive",
            flush=True,
        )


def random_points(rng: np.random.Generator, room: Region, count: int) -> np.ndarray:
    low, high = np.array(room.shape.bounds).reshape(2, 2)
    points: list[np.ndarray] = []
    while len(points) < count:
        point = low + (high - low) * rng.random(2)
        if room.depth(point) > 0:
            points.append(point)
    return np.array(points)


PARTS: dict[str, Callable[[int, int], None]] = {
    "planners": planners,
    "fewest": fewest,
    "square": square,
    "friction": friction,
    "robust": robust,
    "space": space,
    "sampling": sampling,
    "noise": noise_around_obstacles,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--instances", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--only", choices=list(PARTS))
    chosen = parser.parse_args()
    for part in [chosen.only] if chosen.only else [name for name in PARTS if name != "fewest"]:
        partial(PARTS[part], chosen.instances, chosen.seed)()


if __name__ == "__main__":
    main()
