"""Random plans with their missions, flown with cut corners and wrong positions: python -m
benchmarks.deviations [--plans N] [--first N] [--cross-track METRES]

Regions of 20 kinds at random angles, some with no-go zones, footprints of 15 to 60 m, 1 to 6
vehicles of three kinds that set out from inside or from outside, kept apart in time. Each plan has
its default reserve and its default margin (or the reserve of --cross-track). The check of the
missions flies their files with corners that are cut at the acceptance radius of the vehicle and with
positions that are wrong by up to its position error, in any direction and another one every 30 s.
The table has the worst plans: what they see of the region then, what they fly outside of it, and
how far and how deep whole missions fly in no-go zones. A plan whose margin had to be smaller than the
position error of its vehicle cannot keep out of them, so these plans are counted apart. Of each plan
that misses something, its cautions must have said so before: silent is one that flies outside or in a
zone without a caution, or deeper than its caution says, or that sees less than 99.95 % with the whole
reserve of its rows. Ctrl-C ends with the table of the plans flown so far.
"""

from __future__ import annotations

import argparse
import time
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely.affinity import rotate, scale, translate

from benchmarks.strips import kinds
from shoal.core.errors import InvalidInputError
from shoal.missions import MissionSet
from shoal.missions.options import MissionOptions
from shoal.search import SearchProblem, region_of
from shoal.search.flight.deviation import deviate
from shoal.search.regions.projection import LocalFrame

SHOWN = 10  # worst plans
LEAST = 0.9995  # share of the region that missions should see in spite of errors
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


class Flown(NamedTuple):
    """What a plan's missions see and where they fly, with errors but for `plain`."""

    what: str
    reserve: float
    margin: float
    error: float
    plain: float
    seen: float
    outside: float
    in_zones: float
    depth: float
    beyond: float
    cautions: tuple[str, ...]

    @property
    def silent(self) -> bool:
        """Whether the cautions of the plan do not say what it misses."""
        outside = self.outside + self.in_zones > 0 and self.depth >= self.beyond
        unseen = self.seen < LEAST and not any("reserve" in text for text in self.cautions)
        return outside or unseen

    @property
    def narrow(self) -> bool:
        """Whether the margin is smaller than the error of positions."""
        return self.margin < self.error


def fly(number: int, **changes: Any) -> Flown:
    """Return what the missions of the problem with a number see, and where they fly."""
    name, problem = random_problem(number)
    problem = problem.replaced(**changes) if changes else problem
    missions = MissionSet.from_problem(problem, MissionOptions(format=("wpl",)), seed=number)
    result = missions.check()
    coverage, errors = result.coverage, result.with_errors
    assert missions.problem is not None
    assert coverage is not None
    assert errors is not None
    vehicle, zones = problem.chosen_vehicle, problem.place.no_go
    in_zones, depth, rng = 0.0, 0.0, np.random.default_rng(number)
    for mission in missions.missions:
        way = FRAME.to_metres(np.vstack([mission.home, mission.waypoints[:, :2], mission.end]))
        line = shapely.linestrings(deviate(way, vehicle, rng))
        inside = shapely.intersection(line, zones)
        in_zones += float(inside.length)
        places = shapely.points(shapely.get_coordinates(shapely.segmentize(inside, 1.0)))
        depth = max([depth, *shapely.distance(places, zones.boundary).tolist()])
    return Flown(
        f"{number} {name}, {problem.robots} × {vehicle.kind}, {problem.chosen_footprint:g} m",
        float(missions.problem.cross_track or 0.0),
        float(missions.problem.margin or 0.0),
        float(vehicle.position_error or 0.0),
        coverage.covered_fraction,
        errors.covered_fraction,
        errors.outside_m,
        in_zones,
        depth,
        0.0 if result.distance is None else max(0.0, vehicle.clearance - result.distance),
        missions.cautions,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plans", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--cross-track", type=float)
    options = parser.parse_args()
    changes = {} if options.cross_track is None else {"cross_track": options.cross_track}
    flown, refused, began = [], [], time.process_time()
    for number in range(options.first, options.first + options.plans):
        try:
            flown.append(fly(number, **changes))
        except InvalidInputError as error:
            refused.append(f"{number}: {error}")
        except KeyboardInterrupt:  # what was flown counts; --first goes on
            print(f"stopped at plan {number}")
            break
        if number % 20 == 19:
            worst = min(plan.seen for plan in flown)
            print(f"{len(flown)} plans flown, worst {100 * worst:.4f} % seen", flush=True)
    print(f"\n{len(flown)} plans, {len(refused)} refused, {time.process_time() - began:.0f} CPU s")
    for text in refused:
        print(f"refused: {text[:200]}")
    print(
        "\n| plan | reserve, m | margin, m | seen without errors | seen with errors | outside, m"
        " | in zones, m | how deep, m |"
    )
    print("|" + "---|" * 8)
    deepest = sorted(flown, key=lambda plan: (-plan.outside - plan.in_zones, plan.seen))[:SHOWN]
    for plan in dict.fromkeys([*deepest, *(plan for plan in flown if plan.seen < LEAST)]):
        print(
            f"| {plan.what} | {plan.reserve:.2f} | {plan.margin:.2f} | {100 * plan.plain:.4f} % |"
            f" {100 * plan.seen:.4f} % | {plan.outside:.3f} | {plan.in_zones:.3f} |"
            f" {plan.depth:.3f} |"
        )
    for narrow, which in ((False, "at least"), (True, "below")):
        plans = [plan for plan in flown if plan.narrow == narrow]
        if plans:
            print(f"\nmargin {which} the position error: {summary(plans)}")


def summary(plans: list[Flown]) -> str:
    """Return a sentence about the worst of some plans."""
    seen = np.array([plan.seen for plan in plans])
    return (
        f"{len(plans)} plans; seen with errors {100 * seen.min():.4f} % at least,"
        f" {100 * np.median(seen):.4f} % in the median, below 99.95 % in"
        f" {int((seen < LEAST).sum())}; at most {max(plan.outside for plan in plans):.3f} m outside,"
        f" {max(plan.in_zones for plan in plans):.3f} m in zones, and"
        f" {max(plan.depth for plan in plans):.3f} m deep; {sum(plan.silent for plan in plans)} silent"
    )


if __name__ == "__main__":
    main()
