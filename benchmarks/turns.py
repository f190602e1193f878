"""What an operator would fly: turns and lengths of one robot's search, times of six: python -m
benchmarks.turns [--held-out]

20 regions of 9 square kilometres with 0 to 3 zones to keep out of: county borders and polygons of
all kinds; footprint 40 m. Beside one robot's way round and home, at the best angle, stands the tour
round a spanning tree of the 2 x 2 blocks that lie wholly inside, at the angle and shift with most
of them: the way of the published single-robot planners, which see only those blocks. A turn is a
change of direction of more than a degree. Six robots start at random; a turn costs them a cell.
Their planned time is compared with the cells and the turns of their tour, over six. With
--held-out: 36 other regions, one robot only; of all constants, only the price of a turn was chosen
with them.
"""

from __future__ import annotations

import argparse
from itertools import product
from typing import Any

import numpy as np
import shapely
from scipy.ndimage import label
from shapely.affinity import scale
from tests.reference.regions import COUNTIES, county

from benchmarks.held_out import held_out_outlines
from shoal.search import (
    SearchProblem,
    SearchRegion,
    coverage_check,
    make_tour,
    plan_search,
    region_of,
)
from shoal.search.cells.clipping import clip_to_cells, lattice_over, rotate_shape
from shoal.search.flight.timing import turns_of

AREA = 9e6  # square metres
VEHICLE = "ideal,cruise_speed=5,turn_time=8"  # a turn takes as long as 40 m


def own_outlines() -> dict[str, Any]:
    """Return polygons of all kinds, of any size."""
    way = np.linspace(0, 1, 60)
    river = np.stack([6 * way, np.sin(9 * way) + 0.3 * np.sin(23 * way)], axis=1)
    spikes = np.linspace(0, 2 * np.pi, 14, endpoint=False)
    far = np.where(np.arange(14) % 2, 0.45, 1.0)
    lobes = np.linspace(0, 2 * np.pi, 80, endpoint=False)
    wide = 1 + 0.25 * np.sin(3 * lobes) + 0.1 * np.sin(7 * lobes + 1)
    box = shapely.box(0, 0, 3, 2)
    return {
        "L": shapely.Polygon([(0, 0), (4, 0), (4, 1.2), (1.3, 1.2), (1.3, 3), (0, 3)]),
        "U": shapely.Polygon(
            [(0, 0), (4, 0), (4, 3), (2.9, 3), (2.9, 1), (1.1, 1), (1.1, 3), (0, 3)]
        ),
        "star": shapely.Polygon(np.stack([far * np.cos(spikes), far * np.sin(spikes)], axis=1)),
        "river": shapely.LineString(river).buffer(0.45),
        "blob": shapely.Polygon(np.stack([wide * np.cos(lobes), wide * np.sin(lobes)], axis=1)),
        "field": shapely.affinity.rotate(shapely.box(0, 0, 4, 1), 27),
        "triangle": shapely.Polygon([(0, 0), (4, 0.7), (1.2, 3)]),
        "lakes": box.difference(
            shapely.union_all(
                [shapely.Point(0.8, 0.7).buffer(0.35), shapely.Point(2.1, 1.3).buffer(0.4)]
            )
        ),
        "comb": shapely.union_all(
            [
                shapely.box(0, 0, 4, 0.8),
                *(shapely.box(x, 0, x + 0.6, 2.4) for x in (0, 1.1, 2.2, 3.4)),
            ]
        ),
        "trapezium": shapely.Polygon([(0, 0), (5, 0.4), (4, 2.2), (0.4, 1.6)]),
    }


def survey_regions(*, held_out: bool = False) -> list[SearchRegion]:
    """Return 20 regions with 0 to 3 zones to keep out of, or the 36 other regions."""
    outlines = {
        f"{name}, {state}": county(state, name).parts[0] for state, name in COUNTIES
    } | own_outlines()
    found = []
    for number, (name, outline) in enumerate(
        (held_out_outlines() if held_out else outlines).items()
    ):
        rng = np.random.default_rng(1000 + number if held_out else number)
        grown = scale(outline, *[np.sqrt(AREA / outline.area)] * 2, origin=(0, 0))
        low, high = np.reshape(grown.bounds, (2, 2))
        for _ in range(number % 4):
            sides, middle = int(rng.integers(3, 8)), rng.uniform(low, high)
            way = np.sort(rng.uniform(0, 2 * np.pi, sides))
            zone = shapely.Polygon(
                middle + rng.uniform(120, 300) * np.stack([np.cos(way), np.sin(way)], axis=1)
            )
            grown = max(shapely.get_parts(grown.difference(zone)), key=lambda part: part.area)
        found.append(region_of(grown, name=name))
    return found


def around_blocks(region: SearchRegion, size: float) -> tuple[int, float, float]:
    """Return turns, length and share seen of the tour round the blocks that lie inside."""
    best: Any = None
    for angle, *shift in product(range(0, 90, 5), (0.0, 0.25, 0.5, 0.75), (0.0, 0.25, 0.5, 0.75)):
        area = rotate_shape(region.area, -angle)
        labels, count = label(
            clip_to_cells(area, lattice_over(area, 2 * size, offset=(shift[0], shift[1]))).whole
        )
        sizes = np.bincount(labels.ravel(), minlength=count + 1)[1:]
        if count and (best is None or sizes.max() > best[0]):
            best = sizes.max(), labels == sizes.argmax() + 1
    blocks, mask = best
    cells = np.kron(mask, np.ones((2, 2), dtype=bool))
    tours = [make_tour("spanning-tree", side) for side in (cells, np.ascontiguousarray(cells.T))]
    turns = min(int(turns_of(np.vstack([tour.cells, tour.cells[:2]])).sum()) for tour in tours)
    return turns, 4 * blocks * size, float(4 * blocks * size**2 / region.area_m2)


def over_bound(region: SearchRegion, size: float) -> float:
    """Return the planned time of six robots over its bound, turns in both; mean of three starts."""
    ratios = []
    for seed in range(3):
        plan = plan_search(
            SearchProblem(region, robots=6, footprint=size, angle="auto", vehicle=VEHICLE),
            seed=seed,
        )
        cost = plan.tour_cost
        ratios.append(
            plan.allocation.makespan / ((len(cost) + cost.turn_cost * cost.turns.sum()) / 6)
        )
    return float(np.mean(ratios))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--regions", type=int)
    parser.add_argument("--held-out", action="store_true")
    parser.add_argument("--footprint", type=float, default=40.0)
    options = parser.parse_args()
    print(
        "| region | tour | grid | turns | of blocks | length, m | of blocks | seen | blocks see |"
        " six robots over bound |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    ratios, over = [], []
    for region in survey_regions(held_out=options.held_out)[: options.regions]:
        plan = plan_search(
            SearchProblem(region, robots=1, footprint=options.footprint, angle="auto"), seed=1
        )
        route = plan.paths.route(np.concatenate([plan.tour.cells, plan.tour.cells[:1]]))
        seen = coverage_check(region, [route.points], options.footprint, angle=plan.grid.angle)
        turns, length, share = around_blocks(region, options.footprint)
        ours = int(turns_of(np.concatenate([route.points, route.points[1:2]])).sum())
        ratios.append((ours / turns, route.length / length))
        over.append(np.nan if options.held_out else over_bound(region, options.footprint))
        print(
            f"| {region.name} | {plan.tour.name} | {plan.grid.angle:.1f} | {ours} | {turns} |"
            f" {route.length:.0f} | {length:.0f} | {100 * seen.covered_fraction:.4f} %,"
            f" {seen.outside_m:.1f} m outside | {100 * share:.1f} % | {over[-1]:.3f} |",
            flush=True,
        )
    mean = np.exp(np.log(ratios).mean(axis=0))
    print(f"\ngeometric means: {mean[0]:.2f} times the turns, {mean[1]:.3f} times the length")
    if not options.held_out:
        print(f"planned time of six robots over its bound: {np.mean(over):.3f}")


if __name__ == "__main__":
    main()
