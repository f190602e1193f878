"""Random plans of 2 to 12 vehicles, whose missions are flown with random delays: does the
separation hold?

    python -m benchmarks.deconfliction [COUNT] [SEED]

Vehicles set out from one point, from one each or along a line, in or outside of random regions,
some with a no-go zone. The judge is a simulation by steps of an eighth of a second, at constant
speed, that knows the missions only; each vehicle is late by a random delay of up to 10 s, in
several draws. It prints what came nearest, how many layers there were and how late starts were.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
import shapely

from shoal.missions import Mission
from shoal.missions.approach import missions_approach
from shoal.missions.deconfliction import plan_missions
from shoal.search.flight.separation import Separation
from shoal.search.planning.plan import plan_search
from shoal.search.problem import SearchProblem
from shoal.search.regions.region import region_of

_STEP = 0.125  # seconds
_DRAWS = 4


def random_problem(rng: np.random.Generator) -> SearchProblem:
    """Return a random search of 2 to 12 vehicles with their launch points."""
    robots, side = int(rng.integers(2, 13)), rng.uniform(150, 400)
    angles = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(5, 10)))
    reach = rng.uniform(0.4, 1.0, len(angles))[:, None] * side
    hull = shapely.Polygon(reach * np.column_stack([np.cos(angles), np.sin(angles)])).convex_hull
    zone = (
        shapely.Point(rng.uniform(-0.2, 0.2, 2) * side).buffer(0.12 * side, quad_segs=2)
        if rng.random() < 0.4
        else None
    )
    region = region_of(hull, no_go=zone)
    base = np.array([rng.choice([-1.3, 1.3]) * side, rng.uniform(-0.5, 0.5) * side])
    kind = rng.integers(3)
    launch = (
        [tuple(base)]
        if kind == 0
        else [tuple(base + np.array([0.0, 25.0 * (k - robots / 2)])) for k in range(robots)]
    )
    if kind == 2:
        launch = [tuple(base + rng.uniform(-60, 60, 2)) for _ in range(robots)]
    return SearchProblem(
        region,
        robots=robots,
        footprint=float(rng.choice([20, 30])),
        margin=float(rng.choice([0, 3])),
        launch=tuple(launch),
        tour=str(rng.choice(["boustrophedon", "spanning-tree"])),
        angle=float(rng.choice([0, 30])),
        vehicle="multirotor",
    )


def least_distance(missions: Sequence[Mission], late: Any, vertical: float) -> float:
    """Return the least horizontal distance of vehicles in flight that are nearer in height, by
    small steps.
    """
    flown = []
    for mission, wait in zip(missions, late, strict=True):
        way = [
            (*mission.home, 0.0),
            *(
                (x, y, mission.altitude)
                for x, y in (mission.home, *mission.waypoints.tolist(), mission.end)
            ),
        ]
        points = np.array([*way, (*mission.end, 0.0)])
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        start = (mission.start or 0.0) + wait
        flown.append(
            (
                mission.robot,
                start + np.concatenate([[0.0], np.cumsum(lengths)]) / mission.speed,
                points,
            )
        )
    least = np.inf
    for (one, mine, here), (other, theirs, there) in combinations(flown, 2):
        clock = np.arange(max(mine[0], theirs[0]), min(mine[-1], theirs[-1]), _STEP)
        if one == other or not len(clock):
            continue
        apart = np.abs(
            [
                np.interp(clock, mine, here[:, k]) - np.interp(clock, theirs, there[:, k])
                for k in range(3)
            ]
        )
        least = min(least, np.hypot(*apart[:2, apart[2] < vertical - 0.01]).min(initial=np.inf))
    return float(least)


def main(count: int, seed: int) -> None:
    """Fly random plans and print what was found."""
    separation, began = Separation(), time.perf_counter()
    nearest, exact, layers, waits, sorties = np.inf, np.inf, [], [], 0
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        plan = plan_search(random_problem(rng), seed=number)
        missions = plan_missions(plan, separation=separation)
        for _ in range(_DRAWS):
            late = separation.delay * rng.choice([0.0, 1.0, rng.random()], len(missions))
            nearest = min(nearest, least_distance(missions, late, separation.vertical))
        found = missions_approach(missions, separation, None)
        exact = min(exact, np.inf if found is None else found.horizontal)
        layers.append(len({mission.altitude for mission in missions}))
        waits.append(max(mission.start or 0.0 for mission in missions if mission.sortie == 1))
        sorties += len(missions)
        if min(nearest, exact) < separation.horizontal - 0.01:
            raise SystemExit(
                f"plan {number} of seed {seed}: {nearest:.3f} m in the simulation, {exact:.3f} m"
                " exactly"
            )
    print(f"{count} plans, {sorties} sorties, in {time.perf_counter() - began:.0f} s")
    print(f"nearest {nearest:.2f} m in the simulation, {exact:.2f} m exactly")
    late = f"last start: median {np.median(waits):.0f} s, {max(waits):.0f} s at most"
    print(f"layers: mean {np.mean(layers):.2f}, at most {max(layers)}; {late}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", nargs="?", type=int, default=50, help="plans")
    parser.add_argument("seed", nargs="?", type=int, default=0)
    given = parser.parse_args()
    main(given.count, given.seed)
