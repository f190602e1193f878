"""Turns and lengths of one robot's search at the best angle: python -m benchmarks.turns [--regions N] [--footprint METRES]

Beside it the tour round a spanning tree of the 2 x 2 blocks that lie wholly inside, at the angle and shift with most of them: the
way of the published single-robot planners, which see only those blocks. Regions are county borders of 9 square kilometres.
"""

from __future__ import annotations

import argparse
from itertools import product
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import label
from tests.reference.regions import COUNTIES, county

from shoal.search import SearchProblem, SearchRegion, make_tour, plan_search, region_of
from shoal.search.cells.clipping import clip_to_cells, lattice_over, rotated_shape

STRAIGHT = 5.0  # degrees: what bends less is no turn
AREA = 9e6  # square metres


def turns_of(way: NDArray[np.float64]) -> int:
    """Return how often a closed way turns."""
    steps = np.diff(way, axis=0)
    steps = steps[np.hypot(*steps.T) > 1e-6]
    heading = np.degrees(np.arctan2(steps[:, 1], steps[:, 0]))
    return int((np.abs((np.diff(heading, append=heading[0]) + 180) % 360 - 180) > STRAIGHT).sum())


def around_blocks(region: SearchRegion, size: float) -> tuple[int, float, float]:
    """Return turns, length and share seen of the tour round the blocks that lie inside."""
    best: Any = None
    for angle, *shift in product(range(0, 90, 5), (0.0, 0.25, 0.5, 0.75), (0.0, 0.25, 0.5, 0.75)):
        area = rotated_shape(region.area, -angle)
        labels, count = label(clip_to_cells(area, lattice_over(area, 2 * size, offset=(shift[0], shift[1]))).whole)
        sizes = np.bincount(labels.ravel(), minlength=count + 1)[1:]
        if count and (best is None or sizes.max() > best[0]):
            best = sizes.max(), labels == sizes.argmax() + 1
    blocks, mask = best
    cells = np.kron(mask, np.ones((2, 2), dtype=bool))
    tours = [make_tour("spanning-tree", side) for side in (cells, np.ascontiguousarray(cells.T))]
    turns = min(turns_of(np.vstack([tour.cells, tour.cells[:1]]).astype(float)) for tour in tours)
    return turns, 4 * blocks * size, float(4 * blocks * size**2 / region.area_m2)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--regions", type=int, default=len(COUNTIES))
    parser.add_argument("--footprint", type=float, default=40.0)
    options = parser.parse_args()
    print("| region | tour | angle | turns | of blocks | length, m | of blocks | blocks see |")
    print("|---|---|---|---|---|---|---|---|")
    ratios = []
    for place in COUNTIES[: options.regions]:
        outline = county(*place)
        grown = np.sqrt(AREA / outline.area_m2)
        region = region_of(shapely.affinity.scale(outline.parts[0], grown, grown, origin=(0, 0)), name=outline.name)
        plan = plan_search(SearchProblem(region, robots=1, footprint=options.footprint, angle="auto"), seed=1)
        route = plan.paths.route(np.concatenate([plan.tour.cells, plan.tour.cells[:1]]))
        turns, length, seen = around_blocks(region, options.footprint)
        ours = turns_of(route.waypoints())
        ratios.append((ours / turns, route.length / length))
        print(
            f"| {region.name} | {plan.tour.name} | {plan.grid.angle:.1f} | {ours} | {turns} | {route.length:.0f} | {length:.0f} "
            f"| {100 * seen:.1f} % |",
            flush=True,
        )
    mean = np.exp(np.log(ratios).mean(axis=0))
    print(f"\ngeometric means: {mean[0]:.2f} times the turns, {mean[1]:.2f} times the length")


if __name__ == "__main__":
    main()
