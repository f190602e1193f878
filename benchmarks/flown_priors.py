"""The stated expected time to find beside that of the flown tracks: python -m benchmarks.flown_priors

Outlines of counties, scaled to 0.4 square kilometres, with up to two no-go zones; multirotors, fixed
wings and rovers; priors that are rings and mixtures of normal distributions. Each search is planned
with its missions, the missions are written and checked, and the tracks follow from the files alone:
at each moment, a vehicle sees the square of its footprint, from the first waypoint of its search to
the last. The flown time to find is the mean, by the prior, of when each point of the ground (8 x 8
in a footprint) is first seen. A row that is not within 5 % of the stated time is marked.

With ``--orders N``, ten fixed wings that are kept apart search a square kilometre from launch points
that lie together, with N seeded rings, in each order and in the one that missions choose.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import KDTree
from tests.reference.regions import COUNTIES, county

from shoal.core.errors import InvalidInputError
from shoal.core.geometry import partial_sums, step_lengths
from shoal.missions import MissionOptions, MissionSet
from shoal.missions.mission import Mission
from shoal.search import LocalFrame, SearchProblem, SearchRegion, region_of
from shoal.search.flight.timing import Trajectory, trajectory
from shoal.search.flight.vehicle import Vehicle
from shoal.search.problem import LIKELY, ORDERS, SHORTER, TOUR
from shoal.search.problem.fields import AUTO

AREA = 4e5  # square metres
FINE = 8  # points along the side of a footprint
VEHICLES = (
    "multirotor",
    "multirotor,endurance=600,recharge=300",
    "fixed-wing,turn_radius=25",
    "rover",
)
FOOTPRINTS = (20.0, 20.0, 40.0, 20.0)

Floats = NDArray[np.float64]


def place(number: int) -> tuple[SearchRegion, list[shapely.Polygon]]:
    """Return the largest part of a county as a region on Earth, and its no-go zones."""
    outline = county(*COUNTIES[number % len(COUNTIES)][:2], area_m2=AREA).parts[0]
    outline = shapely.affinity.scale(outline, *[(AREA / outline.area) ** 0.5] * 2, origin=(0, 0))
    rng = np.random.default_rng([146, number])
    low, high = np.reshape(outline.bounds, (2, 2))
    zones = []
    for _ in range(number % 3):
        way = np.sort(rng.uniform(0, 2 * np.pi, 6))
        middle = rng.uniform(low, high)
        zone = shapely.Polygon(middle + rng.uniform(30, 70) * np.c_[np.cos(way), np.sin(way)])
        if len(shapely.get_parts(outline.difference(zone.buffer(30)))) == 1:
            zones.append(zone)
    name = ", ".join(COUNTIES[number % len(COUNTIES)][::-1])
    return region_of(outline, frame=LocalFrame(8.5, 47.4), name=name), zones


def problem_of(number: int, folder: Path) -> SearchProblem:
    """Return a seeded problem."""
    region, zones = place(number)
    rng = np.random.default_rng([147, number])
    low, high = np.reshape(region.area.bounds, (2, 2))
    inside = [
        point for point in rng.uniform(low, high, (400, 2)) if region.contains(point[None])[0]
    ]
    x, y = region.frame.to_degrees(inside[0][None])[0] if region.frame else inside[0]
    if number % 2:
        prior = f"ring:{x:.6f},{y:.6f}:0.25=60,0.5=130,0.9=350"
    else:
        rows = np.linspace(high[1], low[1], 60)[:, None]
        columns = np.linspace(low[0], high[0], 60)[None]
        values = sum(
            weight * np.exp(-((columns - at[0]) ** 2 + (rows - at[1]) ** 2) / 2 / spread**2)
            for at, spread, weight in zip(inside[:2], (60.0, 110.0), (1.0, 0.5), strict=True)
        )
        np.save(folder / f"{number}.npy", values)
        prior = str(folder / f"{number}.npy")
    kind = number % len(VEHICLES)
    launch = tuple(map(tuple, np.array(inside[2:5]).tolist()))
    no_go = shapely.union_all(zones) if zones else None
    return SearchProblem(
        region_of(region.area, frame=region.frame, no_go=no_go, name=region.name),
        robots=3,
        footprint=FOOTPRINTS[kind],
        vehicle=VEHICLES[kind],
        launch=launch,
        prior=(prior,),
    )


def searching(mission: Mission, frame: LocalFrame, vehicle: Vehicle) -> Trajectory:
    """Return the part of a mission's trajectory between the ends of its search, by its file."""
    way = mission.path_in(frame)
    flown = trajectory(way, vehicle, rate=mission.rates(vehicle))
    points = frame.to_metres(mission.waypoints)
    whole, out = partial_sums(step_lengths(way)), mission.searched
    ends = []
    for point, which in ((points[out][0], 0), (points[out][-1], -1)):
        near = np.flatnonzero(np.hypot(*(way[:, :2] - point).T) < 1e-3)
        ends.append(float(whole[near[which]]))
    along = partial_sums(step_lengths(flown.points))
    kept = (along >= ends[0] - 1e-6) & (along <= ends[1] + 1e-6)
    start = mission.start or 0.0
    return Trajectory(start + flown.times[kept], flown.points[kept])


def first_seen(points: Floats, flights: list[tuple[Trajectory, float]], angle: float) -> Floats:
    """Return when each point is first seen; infinity if never."""
    turn = np.radians(angle)
    axes = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    tree, times = KDTree(points @ axes), np.full(len(points), np.inf)
    for flight, side in flights:
        steps = np.maximum(1, np.ceil(step_lengths(flight.points[:, :2]) / (side / FINE))).astype(
            int
        )
        fine = np.concatenate(
            [
                np.linspace(one, other, count, endpoint=False)
                for one, other, count in zip(
                    flight.times[:-1], flight.times[1:], steps, strict=True
                )
            ]
            + [flight.times[-1:]]
        )
        at = flight.at(fine)[:, :2] @ axes
        for moment, seen in zip(fine, tree.query_ball_point(at, side / 2, p=np.inf), strict=True):
            times[seen] = np.minimum(times[seen], moment)
    return times


def compare_orders(count: int) -> None:
    """Print the expected time to find of the missions in each order, and the end of the missions
    over the time of the plan without the prior, in brackets.
    """
    print("| ring | as without the prior | likely | shorter | chosen | of planning |")
    print("|---|---|---|---|---|---|")
    for number in range(count):
        rng = np.random.default_rng([148, number])
        (x, y), corner = rng.uniform(200, 800, 2), rng.uniform(0, 850, 2)
        launch = tuple(map(tuple, (corner + rng.uniform(0, 150, (10, 2))).tolist()))
        plain = SearchProblem(
            "square:1000", robots=10, footprint=40, vehicle=VEHICLES[2], launch=launch
        )
        ring = f"ring:{x:.0f},{y:.0f}:0.25=80,0.5=160,0.95=400"
        cells, costs = [], []
        for fields in ({}, *({"prior": (ring,), "order": order} for order in (*ORDERS, AUTO))):
            order = str(fields.get("order"))
            begun = process_time()
            missions = MissionSet.from_problem(plain.replaced(**fields), seed=number)
            costs.append(process_time() - begun)
            if fields:
                plan = missions.plan
                assert plan is not None
                assert plan.plain_seconds is not None
                late = missions.end / plan.plain_seconds
                cells.append((order, f"{missions.run().expected_find:.0f} ({late:.2f})"))
        shown = dict(cells)
        row = [ring, shown[TOUR], shown[LIKELY], shown[SHORTER], shown[AUTO]]
        print(f"| {' | '.join(row)} | {costs[-1] / costs[0]:.1f} |", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--searches", type=int, default=20)
    parser.add_argument("--orders", type=int, default=0)
    options = parser.parse_args()
    if options.orders:
        compare_orders(options.orders)
        return
    print(
        "| region | zones | vehicle | sorties | check | stated, s | flown, s | flown over stated |"
    )
    print("|---|---|---|---|---|---|---|---|")
    ratios = []
    for number in range(options.searches):
        with TemporaryDirectory() as name:
            folder = Path(name)
            problem = problem_of(number, folder)
            try:
                missions = MissionSet.from_problem(problem, MissionOptions(), seed=number)
            except InvalidInputError as error:
                print(
                    f"| {problem.place.name} | - | {problem.vehicle.kind} | refused: {error} |||||"
                )
                continue
            check = missions.check()
            episode = missions.run()
            missions.write(folder / "missions")
            read = MissionSet.read(folder / "missions")
            plan = missions.plan
            assert plan is not None
            region = plan.grid.region
            assert region.frame is not None
            view = float(np.min(problem.view))
            flights = [
                (searching(mission, region.frame, plan.vehicle), view) for mission in read.missions
            ]
            west, south, east, north = region.area.bounds
            step = view / FINE
            x, y = np.meshgrid(
                np.arange(west + step / 2, east, step), np.arange(south + step / 2, north, step)
            )
            points = np.c_[x.ravel(), y.ravel()]
            points = points[shapely.contains_xy(region.area, *points.T)]
            prior = episode.problem.open_prior()
            assert prior is not None
            weights = sum(weight * density.density(points, step) for weight, density in prior.parts)
            times = first_seen(points, flights, float(plan.grid.angle))
            seen = np.isfinite(times)
            flown = float(weights[seen] @ times[seen] / weights[seen].sum())
            stated = episode.expected_find
            assert stated is not None
            ratios.append(flown / stated)
            mark = "" if abs(ratios[-1] - 1) <= 0.05 else " **"
            print(
                f"| {region.name} | {len(place(number)[1])} | {problem.vehicle.kind} |"
                f" {len(read.missions)} | {'passed' if check else 'failed'} | {stated:.1f} |"
                f" {flown:.1f} | {ratios[-1]:.3f}{mark} |",
                flush=True,
            )
    off = np.abs(np.array(ratios) - 1)
    print(
        f"\n{len(ratios)} searches: within {100 * off.max():.1f} %, {100 * off.mean():.1f} % on"
        f" average; {int((off > 0.05).sum())} beyond 5 %"
    )


if __name__ == "__main__":
    main()
