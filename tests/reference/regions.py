"""Regions to try search on, and the plainest way to sweep one."""

from __future__ import annotations

import numpy as np
import shapely
from shapely.affinity import scale, translate

from shoal.search import (
    AreaCoverage,
    CellGrid,
    RegionPaths,
    Route,
    SearchRegion,
    cells_of,
    coverage_check,
    region_of,
)

COUNTIES = (  # islands, fjords, capes, river borders, one with holes in it
    ("AK", "Sitka"),
    ("NC", "Dare"),
    ("MD", "Dorchester"),
    ("LA", "Plaquemines"),
    ("ME", "Hancock"),
    ("WA", "San Juan"),
    ("FL", "Monroe"),
    ("MI", "Keweenaw"),
    ("VA", "Albemarle"),
    ("CA", "Marin"),
)


def random_polygon(
    rng: np.random.Generator, size: float = 1000.0
) -> shapely.Polygon | shapely.MultiPolygon:
    """Return a polygon within a square: a star with spikes, with corridors attached to it, less
    some holes.
    """
    n = int(rng.integers(5, 80))
    angles = np.sort(rng.random(n)) * 2 * np.pi
    rough = rng.choice([0.1, 0.5, 0.9])
    radii = size / 2 * (1 - rough * rng.random(n))
    shape = shapely.Polygon(
        np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1)
    ).buffer(0)
    for _ in range(int(rng.integers(0, 3))):
        ends = size * (rng.random((3, 2)) - 0.5)
        shape = shape.union(
            shapely.LineString(ends).buffer(
                rng.uniform(0.002, 0.03) * size, cap_style="flat", join_style="mitre"
            )
        )
    for _ in range(int(rng.integers(0, 6))):
        k = int(rng.integers(3, 9))
        turns = np.sort(rng.random(k)) * 2 * np.pi
        ring = (
            np.stack([np.cos(turns), np.sin(turns)], axis=1)
            * rng.uniform(0.005, 0.2)
            * size
            * rng.random((k, 1))
        )
        shape = shape.difference(
            shapely.Polygon(ring + size * 0.7 * (rng.random(2) - 0.5)).buffer(0)
        )
    walls = shapely.MultiLineString(
        list(size * (rng.random((int(rng.integers(1, 3)), 2, 2)) - 0.5))
    )
    shape = shape.difference(walls.buffer(rng.uniform(1e-4, 3e-3) * size, cap_style="flat"))
    parts = [part for part in shapely.get_parts(shape) if part.area > 1e-6 * size * size]
    return shapely.MultiPolygon(parts) if parts else random_polygon(rng, size)


def county(state: str, name: str, *, area_m2: float = 4e6) -> SearchRegion:
    """Return the outline of a county, scaled to an area."""
    from bokeh_sampledata.us_counties import records

    geometry = next(record["geometry"] for record in records(state=state) if record["name"] == name)
    middle = geometry.centroid
    flat = scale(
        translate(geometry, -middle.x, -middle.y), np.cos(np.radians(middle.y)), 1, origin=(0, 0)
    )
    times = np.sqrt(area_m2 / flat.area)
    return region_of(scale(flat, times, times, origin=(0, 0)), name=f"{name}, {state}")


def back_and_forth(grid: CellGrid) -> Route:
    """Return a way through all cells, part by part, row by row."""
    cells = grid.cells
    labels = grid.components[tuple(cells.T)]
    along = np.where(cells[:, 0] % 2 == 0, cells[:, 1], -cells[:, 1])
    cells = cells[np.lexsort((along, cells[:, 0], labels))]
    return RegionPaths(grid, transit=True).route(cells)


def swept(region: SearchRegion, footprint: float) -> tuple[AreaCoverage, int]:
    """Arc a region; return what the independent check says of it, and the number of cells."""
    grid = cells_of(region, footprint)
    route = back_and_forth(grid)
    return coverage_check(
        region, np.split(route.points, np.flatnonzero(route.transit) + 1), footprint
    ), grid.n_cells
