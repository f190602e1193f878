"""Regions narrower than one footprint: rectangles, L shapes, slivers and triangles, at all angles,
for all vehicles and tours.
"""

from __future__ import annotations

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.soak import SOAK, often

from shoal.core.errors import InvalidInputError
from shoal.missions import MissionOptions, MissionSet
from shoal.search.flight.vehicle import PRESETS
from shoal.search.problem import TOURS, SearchProblem
from shoal.search.regions.projection import LocalFrame
from shoal.search.regions.region import region_of
from shoal.search.run import run
from shoal.views.search.missions import save_missions_map

SHAPES = {
    "rectangle": lambda w, h: shapely.box(0, 0, w, h),
    "corner": lambda w, h: shapely.union(
        shapely.box(0, 0, w, min(w, h) / 3), shapely.box(0, 0, min(w, h) / 3, h)
    ),
    "triangle": lambda w, h: shapely.Polygon([(0, 0), (w, 0), (w / 3, h)]),
    "sliver": lambda w, h: shapely.Polygon([(0, 0), (w, h / 50), (1.5 * w, 0), (w, -h / 50)]),
}


def thin(kind, width, height, angle, *, earth):
    shape = shapely.affinity.rotate(SHAPES[kind](20 * width, 20 * height), angle)
    return region_of(shape, frame=LocalFrame(8.5, 47.4) if earth else None)


@settings(max_examples=often(30, 60))
@given(
    kind=st.sampled_from(sorted(SHAPES)),
    width=st.floats(0.2, 3),
    height=st.floats(0.02, 1.2),
    angle=st.floats(0, 180),
    earth=st.booleans(),
    vehicle=st.sampled_from(sorted(PRESETS)),
    tour=st.sampled_from(["auto", *TOURS]),
    robots=st.integers(1, 4),
    rows=st.sampled_from([None, "auto", 0.0, 30.0]),
)
def test_a_region_narrower_than_its_footprint_is_searched(
    kind, width, height, angle, earth, vehicle, tour, robots, rows
):
    problem = SearchProblem(
        thin(kind, width, height, angle, earth=earth),
        footprint=20.0,
        robots=robots,
        vehicle=vehicle,
        tour=tour,
        angle=rows,
    )
    episode = run(problem, seed=0)
    assert episode
    assert episode.coverage.covered_fraction > 0.9999


@pytest.mark.parametrize(
    ("kind", "vehicle"),
    [
        (kind, vehicle)
        for number, kind in enumerate(SHAPES)
        for vehicle in (PRESETS if SOAK else [*PRESETS][number % 2 :: 2])
    ],
)
def test_missions_of_thin_regions_are_written(kind, vehicle, tmp_path):
    problem = SearchProblem(thin(kind, 0.5, 0.4, 17.0, earth=True), footprint=20.0, vehicle=vehicle)
    made = MissionSet.from_problem(problem, MissionOptions(format=("plan",)))
    episode = made.run()
    assert episode.coverage.covered_fraction > 0.9999
    written = [*made.write(tmp_path), *save_missions_map(made, tmp_path)]
    assert {path.suffix for path in written} == {".plan", ".txt", ".png"}


@pytest.mark.parametrize(("width", "height"), [(10, 8), (8, 10), (19, 61), (61, 19), (0.01, 300)])
def test_the_doors_of_one_row_or_column_of_cells_lead_along_it(width, height):
    from shoal.search.cells.grid import cells_of

    grid = cells_of(region_of(shapely.box(0, 0, width, height)), 20)
    rows, columns = grid.shape
    assert grid.doors_east.shape == (rows, columns - 1)
    assert grid.doors_south.shape == (rows - 1, columns)
    assert np.all(grid.doors_east)
    assert np.all(grid.doors_south)


def test_a_margin_that_leaves_nothing_is_still_refused_if_it_was_asked_for():
    with pytest.raises(InvalidInputError, match="margin: expected a margin that leaves some area"):
        run(SearchProblem(thin("rectangle", 1, 0.1, 0, earth=False), margin=3.0))
