"""Regions of any shape, searched and checked: python -m benchmarks.regions [--polygons N]
[--counties N] [--seed S]

Every region is swept by a plain back-and-forth order of its cells, part by part, with ways that
stay inside; then the independent check, by Shapely alone, says what was seen. Random polygons have
holes, spikes, walls and necks; the real outlines are county borders, scaled to a few square
kilometres.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from tests.reference.regions import COUNTIES, county, random_polygon, swept

from shoal.search import SearchRegion, region_of


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--polygons", type=int, default=200)
    parser.add_argument("--counties", type=int, default=len(COUNTIES))
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    polygons = [
        (region_of(random_polygon(rng), name=f"random {k}"), float(rng.choice([8, 20, 45])))
        for k in range(options.polygons)
    ]
    measure("random polygons", polygons)
    measure("counties", [(county(*place), 20.0) for place in COUNTIES[: options.counties]])


def measure(name: str, cases: list[tuple[SearchRegion, float]]) -> None:
    results, cells, slowest = [], 0, 0.0
    for region, footprint in cases:
        began = time.perf_counter()
        result, n = swept(region, footprint)
        slowest = max(slowest, time.perf_counter() - began)
        cells += n
        results.append(result)
        if result.covered_fraction < 0.9999 or result.legs_outside:
            print(
                f"  {region!r}: {result.covered_fraction:.6f}, outside {result.outside_m:g} m",
                flush=True,
            )
    worst = 100 * min(result.covered_fraction for result in results)
    outside = sum(result.legs_outside for result in results)
    print(
        f"{name}: {len(results)} regions, {cells} cells, least seen {worst:.6f} %, legs outside"
        f" {outside}, {slowest:.1f} s at most"
    )


if __name__ == "__main__":
    main()
