"""python -m benchmarks.region_certificates: gaps of certificates with obstacles and in three
dimensions, with the bound of shortest paths beside them, and whether a bound is above any plan.

Options: --problems N (a class), --seconds S (of the processor), --plans N (a class), --seed K,
--only CLASS.

A problem has the plan of the planner auto. The plans that no bound may exceed are random moves from
a random start, with the places where they end as goals: the search for their bound knows only that
plans of 1.3 times their length are possible.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from time import process_time
from typing import Any

import numpy as np
from numpy.random import Generator

from shoal.steering import (
    SteeringProblem,
    certify,
    check_certificate,
    cylinder,
    polygon,
    prism,
    region,
    regular_polygon,
)
from shoal.steering.certificates.cells import cells_of_place
from shoal.steering.certificates.geodesics import geodesic_bound
from shoal.steering.certificates.route_search import RouteSearch
from shoal.steering.run import run

ELL = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
COMB = [
    *((0, 0), (3, 0), (3, 2), (2.4, 2), (2.4, 0.8), (1.8, 0.8)),
    *((1.8, 2), (1.2, 2), (1.2, 0.8), (0.6, 0.8), (0.6, 2), (0, 2)),
]
BLOCK = [(0.8, 0.5), (1.2, 0.5), (1.2, 0.9), (0.8, 0.9)]
_AROUND = np.arange(8) * np.pi / 4
_CIRCLE = np.stack([np.cos(_AROUND), np.sin(_AROUND)], axis=1)

PLACES: dict[str, Callable[[Generator], Any]] = {
    "L": lambda rng: region(ELL),
    "obstacle": lambda rng: region([(0, 0), (2, 0), (2, 1.4), (0, 1.4)], [BLOCK]),
    "comb": lambda rng: region(COMB),
    "ring": lambda rng: region(_CIRCLE, [0.5 * _CIRCLE[::2]]),
    "prism": lambda rng: prism(
        regular_polygon(int(rng.integers(3, 7)))
        if rng.integers(2)
        else polygon([*ELL[:2], (0, 1)]),
        float(rng.uniform(0.3, 1.5)),
    ),
    "cylinder": lambda rng: cylinder(0.5, float(rng.uniform(0.3, 1.5))),
    "tube": lambda rng: cylinder(0.5, float(rng.uniform(0.3, 1.5)), open_ends=True),
}
_SLACK = 1e-9  # relative: rounding errors of the length of a plan
_STEPS = 60  # divisions of a search whose bound is compared with random moves


def _points(place: Any, count: int, rng: Generator) -> Any:
    """Return random points of a workspace."""
    low, high = place.bounds
    if place.dimensions == 3:
        low, high = np.append(low, 0.0), np.append(high, place.height)
    found: list[Any] = []
    while len(found) < count:
        point = rng.uniform(low, high)
        if place.contains(point):
            found.append(point)
    return np.array(found)


def gaps_of(name: str, number: int, given: argparse.Namespace) -> tuple[float, float] | None:
    """Return the gap of a problem by shortest paths, and by a certificate, which is checked."""
    rng = np.random.default_rng([given.seed, number, list(PLACES).index(name)])
    place = PLACES[name](rng)
    points = _points(place, 4, rng)
    problem = SteeringProblem(place, points[:2], points[2:])
    episode = run(problem, seed=number)
    if not episode:
        return None
    before = max(geodesic_bound(problem, points[:2], points[2:]), episode.lower_bound or 0.0)
    found = certify(episode, seconds=given.seconds, clock=process_time)
    assert found.proof is not None
    assert check_certificate(found.proof)
    assert found.gap is not None
    return episode.length / before - 1, found.gap


def slack_of(name: str, number: int, seed: int) -> float | None:
    """Return how much longer random moves are than the bound for their start and end, relative;
    None if they cannot be a plan.
    """
    rng = np.random.default_rng([seed, number, list(PLACES).index(name), 1])
    place = PLACES[name](rng)
    start = _points(place, 2, rng)
    problem = SteeringProblem(place, start, start)
    moves = rng.normal(size=(rng.integers(1, 7), place.dimensions))
    moves *= (
        place.size
        * rng.uniform(0.05, 0.7, size=(len(moves), 1))
        / np.linalg.norm(moves, axis=1, keepdims=True)
    )
    goal = problem.world(gain=0.0).play(start, moves)[-1]
    length = float(np.linalg.norm(moves, axis=1).sum())
    cells = cells_of_place(place, start[:, -1], 1.3 * length)
    assert cells is not None
    search = RouteSearch(cells, start, goal, 1e-6, 1.3 * length)
    if not search.possible:
        return None
    for _ in range(_STEPS if search.trees else 0):
        search.step(process_time)
    assert search.lower <= length * (1 + _SLACK), (name, number, search.lower, length)
    return length / search.lower - 1 if search.lower else None


def main() -> None:
    """Print a table of gaps, and how many plans were compared with bounds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--plans", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=tuple(PLACES))
    given = parser.parse_args()
    print("| class | problems | mean gap before | mean gap | largest | at most 0.1 % | plans |")
    for name in [given.only] if given.only else PLACES:
        both = [gaps_of(name, number, given) for number in range(given.problems)]
        before, after = np.array([one for one in both if one is not None]).reshape(-1, 2).T
        plans = [slack_of(name, number, given.seed) for number in range(given.plans)]
        slacks = [slack for slack in plans if slack is not None]
        print(
            f"| {name} | {len(after)} | {100 * before.mean():.1f} % | {100 * after.mean():.1f} % |"
            f" {100 * after.max():.1f} % | {100 * np.mean(after <= 1e-3):.0f} % | {len(slacks)},"
            f" the nearest {100 * min(slacks, default=np.nan):.2g} % longer |",
            flush=True,
        )


if __name__ == "__main__":
    main()
