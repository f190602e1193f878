"""Searches in layers: tours and robots against their bounds, what crossing rows cost, and the time
of a large plan.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from shoal.search import SearchProblem, plan_search
from shoal.search.cells.layers import LayeredGrid

VOLUMES: tuple[tuple[str, dict[str, object]], ...] = (
    ("box:200x120x30", {}),
    ("box:210x130x50", {}),
    ("box:100x100x100", {}),
    ("square:300", {"bands": (30, 50, 70), "footprint": 20}),
    ("ring:200x120", {"bands": (30, 50), "footprint": 10}),
    (
        "ring:200x120",
        {"bands": (30, 50), "vehicle": "ideal,sensor_width=13,sensor_height=8.8,focal_length=30"},
    ),
)
TWICE = ("square:300", "rectangle:400x200", "ring:150x60", "circle:150")
ROBOTS = 6
SEEDS = 10


def volumes() -> None:
    """Print for each volume the length of its tour and its bound, in cells, and the time of six
    robots over their bound.

    No closed tour is shorter than a step a cell, in which two climbs lead from layer to layer and
    back. A step counts as a cell at least, as it does for robots.
    """
    print(
        "| region | layers | tour | cells | tour in cells | bound | over | climbs | six robots over"
        " bound |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for region, fields in VOLUMES:
        plans = [
            plan_search(SearchProblem(region, robots=ROBOTS, **fields), seed=seed)
            for seed in range(SEEDS)
        ]  # type: ignore[arg-type]
        cost, grid = plans[0].tour_cost, plans[0].grid
        assert isinstance(grid, LayeredGrid)
        ups = np.diff(np.append(plans[0].tour.cells[:, 0], plans[0].tour.cells[0, 0]))
        rise = 2 * float(np.ptp(grid.altitudes)) * grid.climb / grid.size
        bound = cost.least - 2 * (len(grid.layers) - 1) + rise
        length = float(np.maximum(cost.steps, 1.0).sum())
        over = np.mean(
            [plan.allocation.makespan / (plan.tour_cost.least / ROBOTS) for plan in plans]
        )
        told = (
            region,
            len(grid.layers),
            plans[0].tour.name,
            grid.n_cells,
            f"{length:.0f}",
            f"{bound:.0f}",
            f"{length / bound:.3f}",
            np.count_nonzero(ups),
            f"{over:.3f}",
        )
        print("|", " | ".join(map(str, told)), "|", flush=True)


def crossed() -> None:
    """Print what going round twice costs, a turn a cell, with rows alike and with rows of the
    second pass across.
    """
    print("| region | once | twice | crossed | over twice |")
    print("|---|---|---|---|---|")
    for region in TWICE:
        fields = {"vehicle": "multirotor,turn_time=2", "tour": "boustrophedon", "robots": 1}
        once, both = (
            plan_search(SearchProblem(region, passes=passes, **fields)).tour_cost.whole
            for passes in (1, 2)
        )  # type: ignore[arg-type]
        print(
            f"| {region} | {once:.0f} | {2 * once:.0f} | {both:.0f} | {both / once / 2:.3f} |",
            flush=True,
        )


def scale() -> None:
    """Print the time of a plan of a million cells in ten layers for a thousand robots, of the
    process alone.
    """
    plan_search(SearchProblem("box:100x100x30", robots=4))
    began = time.process_time()
    plan = plan_search(SearchProblem("box:3200x3200x100", robots=1000, footprint=10), seed=1)
    print(f"{len(plan.tour)} cells, 1000 robots: {time.process_time() - began:.2f} s")


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    volumes()
    crossed()
    scale()
