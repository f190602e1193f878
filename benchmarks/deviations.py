"""Random plans with their missions, flown with cut corners and wrong positions: python -m
benchmarks.deviations [--plans N] [--first N] [--cross-track METRES]

Regions of 20 kinds at random angles, some with no-go zones, footprints of 15 to 60 m, 1 to 6
vehicles of three kinds that set out from inside or from outside, kept apart in time. Each plan has
its default reserve and its default margin (or the reserve of --cross-track). The check of the
missions flies their files with corners that are cut at the acceptance radius of the vehicle and with
positions that are wrong by up to its position error, in any direction and another one every 30 s.
The table has the worst plans: what they see of the region then, what they fly outside of it, and
what whole missions fly in no-go zones.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
import shapely
from shapely.affinity import rotate, scale, translate

from benchmarks.strips import kinds
from shoal.core.errors import InvalidInputError
from shoal.missions import MissionSet
from shoal.missions.options import MissionOptions
from shoal.search import SearchProblem, region_of
from shoal.search.flight.deviation import deviated
from shoal.search.regions.projection import LocalFrame

SHOWN = 10  # worst plans
FRAME = LocalFrame(8.5, 47.4)


def random_problem(number: int) -> tuple[str, SearchProblem]:
    """Return a name and a search with the given number."""
    rng = np.random.default_rng([4500, number])
    shapes = kinds()
    name = str(rng.choice([*shapes]))
    footprint = float(np.round(rng.uniform(15, 60)))
    cells = float(rng.uniform(60, 400))
    shape = rotate(shapes[name], float(rng.uniform(0, 180)))
    shape = scale(shape, *[(cells * footprint**2 / shape.area) ** 0.5] * 2, origin=(0, 0))
    shape = translate(shape, *-np.array(shape.bounds[:2]))
    zones: list[Any] = []
    for _ in range(int(rng.integers(0, 3))):
        x, y = rng.uniform(0, 1, 2) * np.array(shape.bounds[2:])
        sides = footprint * rng.uniform(1.5, 4, 2)
        box = shapely.box(x, y, x + sides[0], y + sides[1])
        zones.append(rotate(box, float(rng.uniform(0, 90))))
    whole = shape.difference(shapely.union_all(zones)) if zones else shape
    parts = sorted(shapely.get_parts(whole), key=lambda part: -part.area)
    barred = shapely.union_all([*zones, *parts[1:]]) if zones else None
    region = region_of(shape, frame=FRAME, no_go=barred, name=name)
    vehicle = str(rng.choice(["multirotor", "multirotor", "rover", "fixed-wing"]))
    robots = int(rng.integers(1, 7))
    launch = None
    if vehicle != "rover" and rng.random() < 0.5:
        launch = ((-2.0 * footprint, float(rng.uniform(0, shape.bounds[3]))),)
    return name, SearchProblem(
        region, robots=robots, footprint=footprint, launch=launch, vehicle=vehicle, angle="auto"
    )


def fly(number: int, **changes: Any) -> tuple[str, float, float, float, float, float]:
    """Return what was flown, and the shares of the region that are seen without errors and with
    them, the metres outside and in zones, and the reserve of the rows.
    """
    name, problem = random_problem(number)
    problem = problem.replaced(**changes) if changes else problem
    missions = MissionSet.from_problem(problem, MissionOptions(format=("wpl",)), seed=number)
    result = missions.check()
    coverage, errors = result.coverage, result.with_errors
    assert missions.problem is not None
    assert coverage is not None
    assert errors is not None
    in_zones, rng = 0.0, np.random.default_rng(number)
    vehicle = problem.chosen_vehicle
    for mission in missions.missions:
        way = FRAME.to_metres(np.vstack([mission.home, mission.waypoints[:, :2], mission.end]))
        line = shapely.linestrings(deviated(way, vehicle, rng))
        in_zones += float(shapely.intersection(line, problem.place.no_go).length)
    what = f"{number} {name}, {problem.robots} × {vehicle.kind}, {problem.chosen_footprint:g} m"
    reserve = float(missions.problem.cross_track or 0.0)
    return (
        what,
        coverage.covered_fraction,
        errors.covered_fraction,
        errors.outside_m,
        in_zones,
        reserve,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plans", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--cross-track", type=float)
    options = parser.parse_args()
    changes = {} if options.cross_track is None else {"cross_track": options.cross_track}
    found, refused, began = [], [], time.process_time()
    for number in range(options.first, options.first + options.plans):
        try:
            found.append(fly(number, **changes))
        except InvalidInputError as error:
            refused.append(f"{number}: {error}")
        if number % 20 == 19:
            worst = min(one[2] for one in found)
            print(f"{len(found)} plans flown, worst {100 * worst:.4f} % seen", flush=True)
    print(f"\n{len(found)} plans, {len(refused)} refused, {time.process_time() - began:.0f} CPU s")
    for text in refused:
        print(f"refused: {text[:200]}")
    print(
        "\n| plan | reserve, m | seen without errors | seen with errors | outside, m | in zones, m |"
    )
    print("|---|---|---|---|---|---|")
    worst_first = sorted(found, key=lambda one: (-one[3] - one[4], one[2]))
    for what, plain, seen, outside, zones, reserve in worst_first[:SHOWN]:
        print(
            f"| {what} | {reserve:.2f} | {100 * plain:.4f} % | {100 * seen:.4f} % | {outside:.3f} |"
            f" {zones:.3f} |"
        )
    shares = np.array([one[2] for one in found])
    print(
        f"\nseen with errors: {100 * shares.min():.4f} % at least, {100 * np.median(shares):.4f} % in"
        f" the median, below 99.95 % in {int((shares < 0.9995).sum())} plans; at most"
        f" {max(one[3] for one in found):.3f} m outside and {max(one[4] for one in found):.3f} m in"
        " zones"
    )


if __name__ == "__main__":
    main()
