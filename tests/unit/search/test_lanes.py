"""Rows along a line: cells, plans, missions and pictures of long regions."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import shapely
from tests.soak import often

import shoal
from shoal.core import notices
from shoal.core.errors import InvalidInputError
from shoal.missions import MissionSet, check_missions
from shoal.search import SearchProblem, coverage_check, open_region, plan_search, region_of
from shoal.search.cells.lanes import cells_along, center_line
from shoal.search.cells.viewpoints import difference
from shoal.search.flight.timing import turns_of
from shoal.search.planning import plan as plan_module
from shoal.search.planning.plan import turns_by_robot
from shoal.search.regions.coverage import Image
from shoal.search.regions.places import read_line
from shoal.search.regions.projection import LocalFrame
from shoal.views.search.page import page_data

LINE = shapely.LineString([(0, 0), (300, 40), (500, 250), (900, 300), (1000, 600), (1500, 650)])


def strip(width, **kind):
    return region_of(LINE.buffer(width / 2, cap_style="flat"), frame=None, **kind)


def ways_of(plan):
    robots = range(len(plan.places))
    return [plan.route(one, plan.stops(one)).points for one in robots if len(plan.stops(one))]


def test_cells_divide_the_region_and_each_is_seen_from_the_line():
    region = strip(13)
    grid = cells_along(region, 15, np.array(LINE.coords))
    assert grid.shape[0] == 1
    assert LINE.length / 15 <= grid.n_cells <= LINE.length / 15 + 7
    pieces = shapely.transform(grid.clipped.pieces, grid.lattice.to_region)
    assert shapely.area(pieces).sum() == pytest.approx(region.area_m2, rel=1e-9)
    assert shapely.union_all(pieces).symmetric_difference(region.area).area < 1e-3
    assert shapely.distance(shapely.points(grid.viewpoints), LINE).max() < 0.02 * 15 + 1e-9
    assert (grid.cell_of(grid.waypoints()) == grid.cells).all()
    assert len(grid.portals.pairs) == grid.n_cells - 1
    assert grid.doors_east.all()


def test_a_region_as_wide_as_long_has_cells_along_its_middle():
    """Its middle branches, so parts of a cell may touch in a point alone."""
    region = open_region("square:50")
    grid = cells_along(region, 10, center_line(region, 10))
    pieces = shapely.transform(grid.clipped.pieces, grid.lattice.to_region)
    assert shapely.union_all(pieces).symmetric_difference(region.area).area < 1e-3


@pytest.mark.parametrize("footprint", [10, 15])
def test_two_robots_share_a_corridor_by_its_length(footprint):
    problem = SearchProblem(
        "rectangle:1543x13", robots=2, footprint=footprint, along="centre", vehicle="ideal"
    )
    plan = plan_search(problem, seed=1)
    assert plan.planned_seconds <= 1.05 * plan.least_seconds
    seen = coverage_check(plan.grid.region, ways_of(plan), footprint, image=plan.image)
    assert (seen.covered_fraction, seen.outside_m) == (1.0, 0.0)


@pytest.mark.parametrize("robots", [1, 3, 2][: often(2, 3)])
def test_a_bent_strip_is_flown_one_way_along_its_line(robots):
    fields = {"robots": robots, "footprint": 15, "vehicle": "ideal"}
    along = plan_search(SearchProblem(strip(13), along=tuple(LINE.coords), **fields), seed=1)
    plain = plan_search(SearchProblem(strip(13), angle="auto", **fields), seed=1)
    ways = ways_of(along)
    seen = coverage_check(along.grid.region, ways, 15, angle=along.grid.angle, image=along.image)
    assert seen.covered_fraction > 1 - 1e-5
    assert seen.outside_m == 0
    turns, others = (sum(int(turns_of(way).sum()) for way in one) for one in (ways, ways_of(plain)))
    assert turns <= 10
    assert turns < others / 3
    assert along.planned_seconds < plain.planned_seconds
    length = sum(float(np.hypot(*np.diff(way, axis=0).T).sum()) for way in ways)
    assert length < 2.1 * LINE.length


def test_wider_stretches_have_more_lanes():
    wide = shapely.union_all([shapely.box(0, -6, 1000, 6), shapely.box(400, -20, 700, 20)])
    region = region_of(wide, frame=None)
    grid = cells_along(region, 15, np.array([(0.0, 0.0), (1000.0, 0.0)]))
    assert grid.mask.sum(axis=0).max() == 3
    assert (grid.mask[:, :20].sum(axis=0) == 1).all()
    plan = plan_search(
        SearchProblem(region, robots=1, footprint=15, along=((0, 0), (1000, 0)), vehicle="ideal"),
        seed=1,
    )
    seen = coverage_check(region, ways_of(plan), 15, image=plan.image)
    assert seen.covered_fraction > 1 - 1e-5
    assert sum(np.hypot(*np.diff(way, axis=0).T).sum() for way in ways_of(plan)) < 2700


def test_the_middle_of_a_river_is_found():
    region = strip(13)
    line = center_line(region, 15)
    assert shapely.LineString(line).hausdorff_distance(LINE) < 40  # to the ends
    assert shapely.distance(shapely.points(line), LINE).max() < 3
    assert len(line) <= 12
    ring = center_line(open_region("ring:60x50"), 12)
    assert shapely.LineString(ring).length > 150


def test_a_line_is_read_from_all_its_forms(tmp_path):
    frame = LocalFrame(8.5, 47.4)
    degrees = frame.to_degrees(np.array(LINE.coords))
    text = "LINESTRING (" + ", ".join(f"{x:.8f} {y:.8f}" for x, y in degrees) + ")"
    region = region_of(LINE.buffer(7), frame=frame)
    files = {
        "a.wkt": text,
        "a.geojson": json.dumps({"type": "LineString", "coordinates": degrees.tolist()}),
        "a.gpx": "<gpx><trk><trkseg>"
        + "".join(f'<trkpt lon="{x}" lat="{y}"/>' for x, y in degrees)
        + "</trkseg></trk></gpx>",
        "a.csv": "longitude,latitude\n" + "\n".join(f"{x},{y}" for x, y in degrees),
    }
    for name, content in files.items():
        (tmp_path / name).write_text(content)
        found = read_line(str(tmp_path / name), region, what="along")
        np.testing.assert_allclose(found, LINE.coords, atol=0.01)
    np.testing.assert_allclose(read_line(text, region, what="along"), LINE.coords, atol=0.01)


@pytest.mark.parametrize(
    ("name", "content", "word"),
    [
        ("a.gpx", "<gpx/>", "expected one track or route, got 0"),
        ("a.gpx", "<gpx><rte><rtept lon='x' lat='2'/></rte></gpx>", "expected lon and lat"),
        ("a.gpx", "<kml/>", "expected <gpx>"),
        ("a.wkt", "POINT (1 2)", r"expected .* LINESTRING \(0 0, 2 0\), got 'POINT \(1 2\)'"),
        ("a.wkt", "LINE", "expected well-known text such as LINESTRING"),
        ("a.wkt", "LINESTRING EMPTY", "expected a LINESTRING, got an empty one"),
        ("a.wkt", "LINESTRING (1 2)", "a.wkt: expected a line of two points or more, got 1$"),
        ("a.wkt", "LINESTRING (1 2, 3 x)", "a.wkt, vertex 2: expected two numbers, .* '3 x'$"),
        ("a.wkt", "LINESTRING (1 2, 3 4", "as many closing as opening parentheses, got 0 and 1$"),
        ("a.wkt", "LINESTRING (1 2, 3 4 5)", "vertex 2: expected 2 numbers, as the f.* '3 4 5'$"),
        ("a.wkt", "LINESTRING Z (1 2, 3 4)", "vertex 1: expected 3 numbers, as Z says, got '1 2'$"),
        ("a.wkt", "LINESTRING (1 2, 1 2 3 4 5)", "vertex 2: expected from 2 to 4 n.* '1 2 3 4 5'$"),
        ("a.csv", "x,y\n1,1\n", "expected a line of two points or more, got 1"),
        ("a.csv", "1\n2\n", r"a.csv: line 1: expected two numbers, x,y, got '1' \(1 column\)$"),
    ],
)
def test_a_wrong_line_is_refused(tmp_path, name, content, word):
    (tmp_path / name).write_text(content)
    with pytest.raises(InvalidInputError, match=word):
        read_line(
            str(tmp_path / name),
            region_of(shapely.box(0, 0, 9, 9), frame=LocalFrame(8, 47))
            if name == "a.gpx"
            else open_region("square:9"),
            what="along",
        )


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            {"along": "POLYGON ((0 0, 9 0, 9 9, 0 0))"},
            "along: expected well-known text such as LINESTRING (0 0, 2 0), got 'POLYGON ((0 0, 9"
            " 0, 9 9, 0 0))'",
        ),
        (
            {"along": "MULTILINESTRING ((0 0, 9 0), (1 1, 2 2))"},
            "along: expected a LINESTRING, got a MultiLineString",
        ),
        (
            {"launch": "POINT (0 5)"},
            "launch: expected a file of launch points, or points such as 0,-5;10,-5, got 'POINT (0"
            " 5)'",
        ),
        ({"launch": "1,2;3"}, "launch, point 2: expected two numbers, x,y, got '3'"),
        ({"land": "1,2,3"}, "land, point 1: expected two numbers, x,y, got '1,2,3'"),
        (
            {"searched": ("LINESTRING (0 5, 9 5)",)},
            "searched: expected a file of the points of a track, got 'LINESTRING (0 5, 9 5)'",
        ),
        ({"targets": "POINT (0 5)"}, "targets: expected a file of targets, got 'POINT (0 5)'"),
    ],
)
def test_text_in_place_of_a_line_or_of_points_is_refused_with_its_place(fields, message):
    with pytest.raises(InvalidInputError) as error:
        shoal.run(SearchProblem("square:9", robots=2, footprint=3, **fields))
    assert str(error.value) == message


def test_what_contradicts_a_line_is_refused():
    with pytest.raises(InvalidInputError, match="along: expected no angle"):
        SearchProblem("square:90", along="centre", angle=30)
    with pytest.raises(InvalidInputError, match="along: expected one altitude and one pass, got 2"):
        SearchProblem("square:90", along="centre", passes=2)
    with pytest.raises(InvalidInputError, match="along: expected one altitude and one pass, got a"):
        SearchProblem("box:90x90x20", along="centre")
    short = SearchProblem("square:90", along=((0, 0), (3, 0)), footprint=10)
    with pytest.raises(InvalidInputError, match="along: expected a line of at least one footprint"):
        plan_search(short)
    closed = SearchProblem("square:90", along=((0, 0), (30, 0), (30, 30), (0, 0)), footprint=10)
    with pytest.raises(InvalidInputError, match="along: expected a line with two ends"):
        plan_search(closed)


def test_missions_along_a_line_are_checked_with_footprints_that_turn(tmp_path):
    region = region_of(LINE.buffer(6.5, cap_style="flat"), frame=LocalFrame(8.5, 47.4))
    problem = SearchProblem(
        region, robots=2, footprint=20, along=tuple(LINE.coords), vehicle="multirotor", margin=0.5
    )
    missions = MissionSet.from_problem(problem, seed=1)
    assert missions.check().coverage.covered_fraction > 0.9999
    missions.write(tmp_path)
    found = check_missions(tmp_path, region, 20.0)
    assert found.coverage.covered_fraction > 0.9999
    narrow = check_missions(tmp_path, region, 13.2)
    assert narrow.coverage.covered_fraction > 0.98
    upright = check_missions(tmp_path, region, 13.2, angle=45.0)
    assert upright.coverage.covered_fraction < narrow.coverage.covered_fraction
    with pytest.raises(InvalidInputError, match="angle: expected turning or a number"):
        check_missions(tmp_path, region, 20.0, angle="north")


def test_searches_along_a_line_run_are_stored_and_drawn(tmp_path):
    episode = shoal.run(
        strip(30), robots=3, footprint=15, along=tuple(LINE.coords), crashes=1, seed=2
    )
    assert episode.makespan is not None
    assert episode.trace.takeovers
    path = tmp_path / "episode.json"
    episode.save(path)
    again = type(episode).load(path)
    assert again.plan.grid.n_cells == episode.plan.grid.n_cells
    told = page_data(episode)
    assert told["cells"] == episode.plan.grid.n_cells
    panels = shoal.views.search.history.SearchHistory(episode).panels
    assert {*panels.numbers.ravel().tolist()} - {-1} == {*range(episode.plan.grid.n_cells)}


def notices_of(monkeypatch, make):
    """Return the notices about rows along a line while ``make`` runs."""
    told = []
    monkeypatch.setattr(notices, "listeners", [told.append])
    monkeypatch.setattr(plan_module, "listeners", notices.listeners)
    monkeypatch.setattr(notices, "_told", set())
    make()
    return [text for text in told if text.startswith("along")]


def test_a_region_that_is_not_long_is_told_what_straight_rows_need(monkeypatch):
    problem = SearchProblem(
        "square:100", robots=2, footprint=10, along="centre", vehicle="ideal", allocation="loop"
    )
    (text,) = notices_of(monkeypatch, lambda: plan_search(problem, seed=1))
    found = re.match(r"along: robots need (\d+) s and turn (\d+) .* and (\d+) s and (\d+) ", text)
    seconds, turns, straight_seconds, straight_turns = map(int, found.groups())
    straight = plan_search(problem.replaced(along=None, angle=90, tour="boustrophedon"), seed=1)
    assert straight_seconds == round(straight.planned_seconds) < seconds / 2
    assert straight_turns == turns_by_robot(straight).sum() < turns / 10


def test_missions_along_a_line_tell_what_straight_rows_need(monkeypatch):
    problem = SearchProblem(
        "square:60", robots=1, footprint=10, along="centre", vehicle="ideal", allocation="loop"
    )
    (text,) = notices_of(monkeypatch, lambda: MissionSet.from_problem(problem, seed=1))
    assert "in straight rows at" in text


def test_a_corridor_is_not_told_of_straight_rows(monkeypatch):
    problem = SearchProblem(strip(13), along="centre", robots=2, footprint=15, vehicle="ideal")
    assert notices_of(monkeypatch, lambda: plan_search(problem, seed=1)) == []


def test_a_corner_that_only_a_turned_footprint_sees_has_a_viewpoint():
    """The footprint turns with its robot, so it may see less than one at the angle of the line."""
    problem = SearchProblem(
        "ring:100x70", robots=2, footprint=5.528, along="centre", margin=3.01, allocation="loop"
    )
    # the squares that lie in the footprint whatever its heading, which the plan is made of
    grid = cells_along(problem.place, problem.chosen_footprint / 2**0.5, problem.line)
    assert shapely.intersects_xy(grid.region.free.buffer(1e-6), *grid.viewpoints.T).all()
    assert (np.diff(grid.viewpoint_starts) > 0).all()


def test_a_comb_has_a_middle_line_and_a_circle_has_none():
    gaps = [shapely.box(x, 40, x + 40, 150) for x in (70, 150)]
    comb = region_of(shapely.box(0, 0, 230, 150).difference(shapely.union_all(gaps)), frame=None)
    missions = MissionSet.from_problem(
        SearchProblem(comb, along="centre", robots=1, footprint=10, vehicle="ideal"), seed=0
    )
    assert missions.check().coverage.covered_fraction > 1 - 1e-5
    with pytest.raises(InvalidInputError, match="'circle:80' has no middle line"):
        plan_search(SearchProblem("circle:80", along="centre", robots=2, footprint=10))


def test_shapes_that_cross_themselves_are_taken_as_what_they_cover():
    bow = shapely.Polygon([(0, 0), (2, 2), (2, 0), (0, 2)])
    (rest,) = difference(np.array([bow]), np.array([shapely.box(0, 0, 1, 2)]))
    assert rest.area == pytest.approx(1)


def comb(length, width, bend=0):
    """A comb of five teeth on a spine of 400 m that bends in its middle."""
    spine = shapely.LineString([(0, 0), (200, bend), (400, 0)])
    teeth = [
        shapely.LineString([(x, y), (x, y + length)]).buffer(width / 2, cap_style="flat")
        for x in np.linspace(40, 360, 5)
        for y in [float(np.interp(x, [0, 200, 400], [0, bend, 0]))]
    ]
    back = spine.buffer(width / 2, cap_style="flat", join_style="mitre")
    return region_of(shapely.union_all([back, *teeth]), frame=None)


@pytest.mark.parametrize("shape", [(40, 16, 20), (60, 24, 40), (60, 16, 80)])
def test_robots_see_all_of_a_comb_along_its_middle(shape):
    """Far from the line, cells outside of its bends are wider than a footprint."""
    region, middle = comb(*shape), ((0, 0), (200, shape[2]), (400, 0))
    for along in ("centre", middle):
        episode = shoal.run(SearchProblem(region, robots=2, footprint=15, along=along))
        assert episode.status == "complete"
        assert episode.coverage.covered_fraction > 1 - 1e-5


def test_a_search_whose_footprints_leave_gaps_is_incomplete():
    episode = shoal.run(SearchProblem(strip(13), robots=2, footprint=15, along="centre"))
    assert episode.status == "complete"
    assert "footprints" not in episode.reason
    narrower = replace(episode, plan=replace(episode.plan, image=Image(0.8, 0.8)))
    assert narrower.makespan is not None  # each cell was searched
    assert narrower.status == "incomplete"
    text = r"; no robot saw ([\d.]+) m² between footprints \(7.7 % of the region\)$"
    unseen = float(re.search(text, narrower.reason)[1])
    assert unseen == pytest.approx(narrower.coverage.uncovered_m2, rel=1e-3)


def test_what_robots_cannot_reach_is_no_gap():
    problem = SearchProblem(
        "rectangle:300x30", robots=2, footprint=10, along=((0, 15), (300, 15)), obstacles=4
    )
    episode = shoal.run(problem, seed=2)
    assert episode.coverage.covered_fraction < 1 - 1e-3
    assert episode.status == "complete"
    assert "between footprints" not in episode.reason


@pytest.mark.parametrize("shape", [(60, 16), (20, 24, 40), (60, 24, 20)])
def test_cells_along_the_middle_of_combs_divide_them(shape):
    """Cells of a Voronoi diagram of points on one line overlap in GEOS 3.13."""
    region = comb(*shape)
    grid = cells_along(region, 15, center_line(region, 15))
    pieces = shapely.transform(grid.clipped.pieces, grid.lattice.to_region)
    assert shapely.area(pieces).sum() == pytest.approx(region.area_m2, rel=1e-6)
    assert shapely.covered_by(pieces, region.area.buffer(1e-6)).all()
