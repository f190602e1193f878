"""Any region is seen wholly from inside: random polygons, and real outlines."""

from __future__ import annotations

import json

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.reference.regions import COUNTIES, county, random_polygon, swept

from shoal.core.errors import InvalidInputError
from shoal.search import RegionPaths, cells_of, open_region, region_of


@settings(max_examples=25)
@given(st.integers(0, 2**32), st.sampled_from([25.0, 60.0, 400.0]))
def test_a_sweep_sees_everything_and_stays_inside(seed, footprint):
    region = region_of(random_polygon(np.random.default_rng(seed)))
    seen, _ = swept(region, footprint)
    assert seen.covered_fraction >= 0.999999
    assert seen.legs_outside == 0


@settings(max_examples=40)
@given(st.integers(0, 2**32))
def test_cells_are_where_the_region_is(seed):
    rng = np.random.default_rng(seed)
    region = region_of(random_polygon(rng))
    grid = cells_of(region, float(rng.uniform(20, 90)))
    for cell in grid.cells[rng.integers(0, grid.n_cells, 20)]:
        assert region.contains(grid.viewpoints_in(cell)).all()
        box = grid.lattice.boxes(*np.array([cell]).T)[0]
        assert box.intersection(region.area).area > 0
    inside = grid.waypoints()
    assert grid.region.contains(inside).all()
    assert grid.mask[tuple(grid.cell_of(inside).T)].all()


@settings(max_examples=20)
@given(st.integers(0, 2**32))
def test_ways_between_any_two_places(seed):
    rng = np.random.default_rng(seed)
    region = region_of(max(shapely.get_parts(random_polygon(rng)), key=shapely.area))
    grid = cells_of(region, 40)
    paths = RegionPaths(grid)
    places = grid.viewpoints[rng.integers(0, len(grid.viewpoints), 12)]
    route = paths.legs(places)
    assert np.array_equal(route.points[route.stops], places)
    lines = shapely.linestrings(np.stack([route.points[:-1], route.points[1:]], axis=1))
    assert shapely.covers(region.area.buffer(1e-6), lines).all()


@pytest.mark.parametrize("place", COUNTIES[::3])
def test_real_outlines(place):
    region = county(*place)
    assert region.area_m2 == pytest.approx(4e6)
    seen, _ = swept(region, 60.0)
    assert seen.covered_fraction >= 0.999999
    assert seen.legs_outside == 0


RING = [[8.5, 47.4], [8.52, 47.4], [8.52, 47.41], [8.5, 47.4]]
WORDS = " ".join(f"{x},{y},0" for x, y in RING)
FILES = {
    ".geojson": json.dumps(
        {
            "type": "Feature",
            "properties": {"no_go": 0},
            "geometry": {"type": "Polygon", "coordinates": [RING]},
        }
    ),
    ".kml": "<kml><Placemark><Polygon><outerBoundaryIs><coordinates>"
    f"{WORDS}</coordinates></outerBoundaryIs></Polygon></Placemark></kml>",
    ".csv": "x,y,ring\n0,0,a\n9,0,a\n9,9,a\n\n2,1,b\n8,1,b\n8,7,b\n",
}


def complaint(path):
    """Return what is said of a file that is refused; nothing of one that is read."""
    try:
        open_region(path)
    except InvalidInputError as error:
        return str(error)
    return ""


@settings(max_examples=150)
@given(st.sampled_from(sorted(FILES)), st.data())
def test_damaged_files_are_refused_in_one_sentence_or_read(tmp_path_factory, suffix, data):
    raw = bytearray(FILES[suffix].encode())
    for _ in range(data.draw(st.integers(1, 4))):
        low = data.draw(st.integers(0, len(raw) - 1))
        raw[low : low + data.draw(st.integers(0, 6))] = data.draw(
            st.one_of(
                st.binary(max_size=4),
                st.sampled_from(
                    [b"1e999", b"-", b"[", b"]", b'"', b"null", b"\n", b",", b"<", b"&"]
                ),
            )
        )
        raw = raw or bytearray(b" ")
    path = tmp_path_factory.getbasetemp() / f"damaged{suffix}"
    path.write_bytes(bytes(raw))
    assert "\n" not in complaint(path)
