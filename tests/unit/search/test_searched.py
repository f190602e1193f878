"""The rest of a search after a battery stop or the loss of a vehicle: --searched TRACK."""

import json

import numpy as np
import pytest
import shapely

import shoal
from shoal.cli import run
from shoal.core.errors import InvalidInputError
from shoal.search import SearchProblem, coverage_check, open_region, plan_search
from shoal.search.regions.places import swept_area
from shoal.search.run import run as search

FLOWN = [(10.0, 10.0), (190.0, 10.0), (190.0, 30.0), (10.0, 30.0), (10.0, 50.0), (120.0, 50.0)]


def rest(**fields):
    given = {"robots": 2, "footprint": 20, "vehicle": "multirotor", "searched": [FLOWN]} | fields
    return SearchProblem("rectangle:200x120", **given)


def test_only_the_rest_is_searched_and_both_together_see_all(tmp_path):
    problem = rest()
    assert problem.place.area_m2 == pytest.approx(24000 - 200 * 40 - 130 * 20)
    assert problem.place.outline.area == 24000
    assert problem.place.unseen_m2 == pytest.approx(0.0, abs=1e-6)
    episode = search(problem, seed=1)
    assert episode
    assert episode.coverage.covered_fraction == 1.0
    flights = [route.points for route in episode.routes]
    whole = open_region("rectangle:200x120")
    together = coverage_check(whole, [*flights, np.array(FLOWN)], 20.0)
    assert together.covered_fraction == pytest.approx(1.0, abs=1e-9)
    assert coverage_check(whole, flights, 20.0).covered_fraction < 0.8
    episode.save(tmp_path / "rest.json")
    again = shoal.load(tmp_path / "rest.json")
    assert again.verify()
    assert again.problem.place.area_m2 == pytest.approx(problem.place.area_m2)


def test_parts_of_the_rest_are_reached_across_what_was_searched():
    """The track divides the rest: it is no region of two parts, and ways lead through the middle."""
    problem = rest(searched=[[(-20.0, 60.0), (220.0, 60.0)]], robots=1)
    assert len(shapely.get_parts(problem.place.area)) == 2
    assert len(problem.place.parts) == 1
    plan = plan_search(problem, seed=1)
    route = plan.route(0, plan.stops(0))
    assert not route.transit.any()
    seen = coverage_check(plan.grid.region, [route.points], 20.0, angle=plan.grid.angle)
    assert (seen.covered_fraction, seen.outside_m) == (1.0, 0.0)


def test_zones_and_margins_stay_those_of_the_whole_region():
    zone = shapely.box(60, 80, 90, 100)
    problem = rest(no_go=[zone], margin=4.0)
    assert problem.place.free.area < 24000 - zone.area
    assert problem.place.free.contains(shapely.Point(100, 20))
    plan = plan_search(problem, seed=1)
    for robot in range(2):
        way = shapely.linestrings(plan.route(robot, plan.stops(robot)).points)
        assert way.distance(zone) >= 4.0 - 1e-6


def test_what_is_seen_along_a_track():
    region = open_region("square:100")
    assert swept_area([(10.0, 10.0), (50.0, 10.0)], region, 20.0).area == pytest.approx(60 * 20)
    rows = [(10.0, 10.0), (90.0, 10.0), (90.0, 30.0), (10.0, 30.0)]
    assert swept_area(rows, region, 20.0).area == pytest.approx(100 * 40)
    rng = np.random.default_rng(1)
    shaky = np.column_stack([np.linspace(10, 90, 400), 50 + rng.uniform(-0.05, 0.05, 400)])
    assert swept_area(shaky, region, 20.0).area == pytest.approx(100 * 20, rel=0.01)


@pytest.mark.parametrize(
    ("track", "match"),
    [
        ([(0.0, 0.0)], "two points or more"),
        ([(5.0, 5.0), (5.0, 5.0)], "a track that moves"),
        ([(0.0, float("nan")), (1.0, 1.0)], "searched"),
        ([(-50.0, 60.0), (300.0, 60.0)], "not searched yet"),
    ],
)
def test_bad_tracks_are_refused(track, match):
    with pytest.raises(InvalidInputError, match=match):
        _ = rest(searched=[track], footprint=20 if match != "not searched yet" else 300).place


def test_tracks_in_files_have_the_units_of_the_region(tmp_path, capsys):
    table = tmp_path / "flown.csv"
    table.write_text("x,y\n" + "".join(f"{x},{y}\n" for x, y in FLOWN))
    given = ["search", "rectangle:200x120", "--footprint", "20", "--robots", "2", "--json"]
    assert run([*given, "--searched", str(table)]) == 0
    area = json.loads(capsys.readouterr().out)["region"]["area_m2"]
    assert area == pytest.approx(13400, abs=1)
    assert run([*given, "--searched", str(tmp_path / "none.csv")]) == 2
    assert "none.csv: expected" in capsys.readouterr().err
    line = {"type": "LineString", "coordinates": [[8.5, 47.4], [8.501, 47.4]]}
    degrees = tmp_path / "flown.geojson"
    degrees.write_text(json.dumps({"type": "Feature", "properties": {}, "geometry": line}))
    assert run([*given, "--searched", str(degrees)]) == 2
    assert "expected metres" in capsys.readouterr().err


@pytest.mark.parametrize("number", ["nan", "inf"])
def test_tracks_of_no_place_are_refused(tmp_path, number):
    track = tmp_path / "track.csv"
    track.write_text(f"x_m,y_m\n10,10\n{number},50\n")
    with pytest.raises(InvalidInputError, match=r"searched: .*track.csv: expected"):
        swept_area(str(track), open_region("square:100"), 20.0)


def test_a_track_beside_the_region_is_refused():
    problem = rest(searched=[[(5000.0, 150.0), (5100.0, 150.0)]])
    with pytest.raises(
        InvalidInputError, match="searched: expected tracks that see some of the region"
    ):
        _ = problem.place


@pytest.mark.parametrize("angle", [1e20, -361.0, float("nan")])
def test_an_angle_that_floats_cannot_turn_by_is_refused(angle):
    with pytest.raises(InvalidInputError, match="angle: expected a number from -360 to 360"):
        coverage_check(open_region("square:100"), [[(5.0, 5.0), (95.0, 5.0)]], 10.0, angle=angle)


def gpx(path, points, seconds):
    """Write a GPX track of one segment with a time for each point."""
    rows = "".join(
        f'<trkpt lat="{y}" lon="{x}"><time>2026-05-31T{int(s) // 3600:02}:{int(s) // 60 % 60:02}:'
        f"{int(s) % 60:02}Z</time></trkpt>"
        for (x, y), s in zip(points, seconds, strict=True)
    )
    path.write_text(f'<gpx version="1.1"><trk><trkseg>{rows}</trkseg></trk></gpx>')
    return str(path)


@pytest.fixture
def field(tmp_path):
    corners = [[8.5, 47.4], [8.504, 47.4], [8.504, 47.402], [8.5, 47.402], [8.5, 47.4]]
    path = tmp_path / "field.json"
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [corners]}))
    return open_region(path)


def test_a_track_is_interrupted_where_nobody_flew(field, tmp_path):
    """By a pause, and by a position that is wrong: both drew a row across the field."""
    row = [(8.5005 + 0.0001 * k, 47.4005) for k in range(20)]
    plain = swept_area(gpx(tmp_path / "row.gpx", row, range(20)), field, 20.0)
    assert swept_area(gpx(tmp_path / "none.gpx", row, [0] * 20), field, 20.0).equals(plain)
    wrong = [*row[:10], (8.5015, 47.4018), *row[10:]]
    seen = swept_area(gpx(tmp_path / "wrong.gpx", wrong, range(21)), field, 20.0)
    assert seen.difference(plain).area < 1.0
    assert seen.area > plain.area - 0.4 * 20 * 10
    later = [*row, *((x, 47.4018) for x, _ in row)]
    times = [*range(20), *range(7200, 7220)]
    seen = swept_area(gpx(tmp_path / "pause.gpx", later, times), field, 20.0)
    assert seen.area == pytest.approx(2 * plain.area, rel=1e-3)
    # a recorder that writes few positions on straight lines
    few = swept_area(gpx(tmp_path / "few.gpx", [row[0], row[9], row[-1]], [0, 9, 40]), field, 20.0)
    assert few.symmetric_difference(plain).area < 1.0
    (tmp_path / "time.gpx").write_text(
        (tmp_path / "row.gpx").read_text().replace("2026-05-31", "31.5.2026", 1)
    )
    with pytest.raises(InvalidInputError, match="line 1: expected a time"):
        swept_area(str(tmp_path / "time.gpx"), field, 20.0)


def test_tracks_of_two_robots_in_one_table_are_two_tracks(field, tmp_path):
    head, tail = "8.5005,47.4005\n1,8.5025,47.4005\n", "8.5005,47.4015\n2,8.5025,47.4015\n"
    path = tmp_path / "both.csv"
    path.write_text(f"robot,longitude,latitude\n1,{head}2,{tail}")
    assert swept_area(str(path), field, 20.0).area == pytest.approx(2 * 170.8 * 20, rel=0.01)
    path.write_text(f"name,longitude,latitude\na,{head}b,{tail}".replace("\n1,", "\nc,"))
    assert swept_area(str(path), field, 20.0).area > 2.5 * 170.8 * 20


def test_a_mission_is_no_track(tmp_path, monkeypatch, capsys):
    """The waypoints of robot 1 as a track left what it had not flown unsearched."""
    monkeypatch.chdir(tmp_path)
    search = "search square:200 --robots 2 --footprint 20"
    assert run([*search.split(), "--missions", "m", "--no-simulate"]) == 0
    assert run([*search.split(), "--searched", "m/robot-01.csv"]) == 2
    assert "expected a track that was flown, got a mission" in capsys.readouterr().err
