"""Priors: what a user may give, which probabilities cells get from it, and what a search does."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from math import exp

import numpy as np
import pytest
from scipy.io import netcdf_file
from shapely import Polygon, box

from shoal.cli import run as shoal
from shoal.core.errors import InvalidInputError
from shoal.missions import MissionOptions, MissionSet, mission_set
from shoal.search import SearchProblem, open_region, region_of
from shoal.search.cells.layers import layers_of
from shoal.search.episode import SearchEpisode
from shoal.search.planning import plan as planning
from shoal.search.planning.plan import SearchPlan, plan_search
from shoal.search.problem.prior import (
    DistanceRing,
    Raster,
    Segments,
    Spread,
    _shares,
    open_prior,
)
from shoal.search.regions.places import read_points
from shoal.search.run import run

SQUARE = {"region": "square:100", "robots": 2, "footprint": 10}


def corner(tmp_path, *, rows=10, columns=10):
    """Save an array whose north-east pixel is likely."""
    values = np.full((rows, columns), 0.1)
    values[0, -1] = 90.1
    np.save(tmp_path / "corner.npy", values)
    return str(tmp_path / "corner.npy"), values / values.sum()


@pytest.fixture
def notices(monkeypatch):
    heard = []
    monkeypatch.setattr("shoal.core.notices.listeners", [heard.append])
    return heard


def odds_at(plan):
    """Return the probability of each cell of a lattice with row 0 in the north."""
    found = np.zeros(plan.grid.shape)
    found[tuple(plan.tour.cells.T)] = plan.tour_cost.odds
    return found


def test_an_array_spans_the_region_with_row_0_in_the_north(tmp_path):
    file, values = corner(tmp_path)
    plan = plan_search(SearchProblem(**SQUARE, prior=[file]), seed=1)
    places = plan.positions(np.arange(100))
    likely = places[np.argmax(plan.tour_cost.odds)]
    assert likely.tolist() == [95.0, 95.0]
    rows, columns = ((100 - places[:, 1]) // 10).astype(int), (places[:, 0] // 10).astype(int)
    np.testing.assert_allclose(plan.tour_cost.odds, values[rows, columns], atol=1e-12)


@pytest.mark.parametrize(
    ("rows", "columns", "told"),
    [
        (20, 20, None),
        (10, 10, None),
        (33, 33, None),
        (1, 1, None),
        (
            19,
            20,
            "19 rows of 20 numbers span the 100 m by 100 m of the region, so that each number stands"
            " for 5 m by 5.263 m",
        ),
        (1, 20, "its 1 row of 20 numbers span"),
    ],
)
def test_an_array_of_another_shape_than_the_region_is_said(rows, columns, told, tmp_path, notices):
    file, _ = corner(tmp_path, rows=rows, columns=columns)
    open_prior([file], 0.0, open_region("square:100"))
    assert len(notices) == (told is not None)
    if told is not None:
        assert told in notices[0]
        assert "exchanged" not in notices[0]


def test_an_array_whose_rows_and_columns_are_exchanged_is_said(tmp_path, notices):
    file, _ = corner(tmp_path, rows=30, columns=15)
    region = open_region("rectangle:299x151")
    open_prior([corner(tmp_path, rows=15, columns=30)[0]], 0.0, region)
    assert not notices
    corner(tmp_path, rows=30, columns=15)
    open_prior([file], 0.0, region)
    assert notices[0].endswith("with rows and columns exchanged, for squares")


def test_the_odds_of_turned_cells_are_those_of_the_ground_under_them():
    ring = "ring:50,50:0.5=20,0.9=30"
    straight, turned = (
        plan_search(SearchProblem(**SQUARE, prior=[ring], angle=angle), seed=1) for angle in (0, 30)
    )
    assert straight.prior_inside == pytest.approx(turned.prior_inside, abs=0.01)
    for plan in (straight, turned):
        away = np.linalg.norm(plan.positions(np.arange(len(plan.tour))) - 50, axis=1)
        assert plan.tour_cost.odds.sum() == pytest.approx(1)
        inner = plan.tour_cost.odds[away < 20].sum() * plan.prior_inside
        assert inner == pytest.approx(0.5, abs=0.12)  # cells of 10 m across the ring


def test_a_ring_has_its_quantiles():
    ring = DistanceRing(np.zeros(2), np.array([0.25, 0.5, 0.9]), np.array([100.0, 300.0, 900.0]))
    step = 4.0
    axis = np.arange(-3000, 3000, step) + step / 2
    points = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    masses = ring.density(points, step) * step**2
    away = np.linalg.norm(points, axis=1)
    for share, distance in ((0.25, 100), (0.5, 300), (0.9, 900)):
        assert masses[away <= distance].sum() == pytest.approx(share, abs=0.01)
    slope = 0.4 / 600
    assert masses[away > 1500].sum() == pytest.approx(0.1 * exp(-600 * slope / 0.1), abs=0.003)


def drawn_from(part, rng, count=200_000):
    """Return random places of targets, by the definition of a part."""
    if isinstance(part, DistanceRing):
        shares, distances = np.append(0, part.shares), np.append(0, part.distances)
        share = rng.random(count)
        away = np.interp(share, shares, distances)
        slope = (shares[-1] - shares[-2]) / (distances[-1] - distances[-2])
        rest = 1 - shares[-1]
        beyond = share > shares[-1]
        away[beyond] -= np.log((1 - share[beyond]) / rest) * rest / slope
        angle = rng.uniform(0, 2 * np.pi, count)
        return part.middle + away[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    if isinstance(part, Spread):
        own = rng.choice(len(part.weights), count, p=part.weights)
        return part.points[own] + part.spreads[own, None] * rng.normal(size=(count, 2))
    if isinstance(part, Segments):
        own = rng.choice(len(part.weights), count, p=part.weights)
        corners = np.array([shape.bounds for shape in part.shapes])[own]
        return corners[:, :2] + rng.random((count, 2)) * (corners[:, 2:] - corners[:, :2])
    own = rng.choice(part.values.size, count, p=part.values.ravel())
    row, column = np.divmod(own, part.values.shape[1])
    inner = rng.random((count, 2))
    return np.column_stack(
        [
            part.west + (column + inner[:, 0]) * part.sides[0],
            part.north - (row + inner[:, 1]) * part.sides[1],
        ]
    )


def spike(size):
    values = np.zeros((size, size))
    values[size // 3, size // 2], values[0, 0] = 0.7, 0.3
    return values


def ring(middle, *pairs):
    shares, distances = np.array(pairs, dtype=float).T
    return DistanceRing(np.array(middle, dtype=float), shares, distances)


@pytest.mark.parametrize(
    "part",
    [
        ring((1, 1), (0.25, 40), (0.5, 60)),  # in the middle of a square
        ring((0, 0), (0.9, 0.01), (0.95, 60)),  # on a corner
        ring((1.3, -4.2), (0.01, 39.9), (0.99, 40.1)),  # narrower than a square
        ring((3, 3), (1, 0.2)),
        ring((3.1, 2.7), (0.5, 0.2), (0.999, 0.3)),
        Spread(np.array([[1.0, 1.0], [-20.0, 8.3]]), np.array([0.05, 30.0]), np.array([0.5, 0.5])),
        Spread(np.array([[5.99, 2.01], [3.0, 3.0]]), np.array([1e-9, 0.7]), np.array([0.4, 0.6])),
        Segments((box(0.1, 0.1, 0.5, 0.3), box(-40, 7, 60, 7.2)), np.array([0.4, 0.6])),
        Segments((box(-90.5, -30, 33, 70.5), box(1, 1, 9, 1.5)), np.array([0.7, 0.3])),
        Raster(spike(200), -100.3, 99.7, (1.0, 1.0)),
        Raster(spike(1000), -30.0, 30.0, (0.06, 0.07)),
        Raster(spike(9), -50.0, 50.0, (10.3, 7.7)),
    ],
)
def test_squares_have_the_probability_of_their_ground(part):
    """However narrow the peaks: no square has more or less than the share of targets in it."""
    step, half = 2.0, 120
    axis = np.arange(-half, half) * step + step / 2
    middles = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    masses = (part.density(middles, step) * step**2).reshape(2 * half, 2 * half)
    targets = drawn_from(part, np.random.default_rng(1))
    columns, rows = np.floor(targets / step).astype(int).T + half
    there = (columns >= 0) & (columns < 2 * half) & (rows >= 0) & (rows < 2 * half)
    counts = np.zeros((2 * half, 2 * half))
    np.add.at(counts, (rows[there], columns[there]), 1 / len(targets))
    assert masses.min() >= 0
    # far from its middle, a ring counts as straight in each square
    assert masses.sum() <= 1 + (0.003 if isinstance(part, DistanceRing) else 1e-9)
    assert masses.sum() == pytest.approx(there.mean(), abs=0.004)
    assert np.abs(masses - counts).max() < 0.005
    for size in (8, 60):  # and no larger squares
        wide = [
            table.reshape(2 * half // size, size, 2 * half // size, size).sum(axis=(1, 3))
            for table in (masses, counts)
        ]
        assert np.abs(wide[0] - wide[1]).max() < 0.006


def test_squares_are_covered_by_a_rectangle_as_by_any_shape():
    rectangle = box(3.3, 1.2, 37.7, 39.1)
    notched = rectangle.difference(box(3.3, 1.2, 4.5, 2.5))
    middles = np.stack(np.meshgrid(*2 * [np.arange(-2, 45) + 0.25]), axis=-1).reshape(-1, 2)
    whole, part = (_shares(shape, middles, 1.0) for shape in (rectangle, notched))
    assert whole.sum() == pytest.approx(rectangle.area)
    assert part.sum() == pytest.approx(notched.area)
    elsewhere = (middles > 5.5).any(axis=1)
    assert whole[elsewhere] == pytest.approx(part[elsewhere])


@pytest.mark.parametrize(
    ("width", "height", "shape", "tolerance"),
    [(36.6, 73.1, (3, 2), 1e-9), (82.8, 70.9, (1, 7), 2e-3), (9.0, 43.0, (5, 1), 1e-9)],
)
def test_cells_have_what_an_array_says_of_their_ground(tmp_path, width, height, shape, tolerance):
    """Also those that are partly outside the region, which is where the array ends."""
    values = np.random.default_rng(4).random(shape) ** 6
    np.save(tmp_path / "prior.npy", values)
    problem = SearchProblem(
        f"rectangle:{width}x{height}",
        robots=1,
        footprint=10,
        angle=0,
        prior=[str(tmp_path / "prior.npy")],
    )
    plan = plan_search(problem, seed=1)
    (left, top), size = plan.grid.corner, plan.grid.size
    rows, columns = plan.grid.shape
    east = _overlaps(left + size * np.arange(columns + 1), np.linspace(0, width, shape[1] + 1))
    south = _overlaps(size * np.arange(rows + 1) - top, np.linspace(-height, 0, shape[0] + 1))
    masses = south @ values @ east.T
    assert odds_at(plan) == pytest.approx(masses / masses.sum(), abs=tolerance)


def _overlaps(cells, pixels):
    """Return the length that each interval between two cells has in common with each pixel."""
    common = np.minimum.outer(cells[1:], pixels[1:]) - np.maximum.outer(cells[:-1], pixels[:-1])
    return np.maximum(common, 0)


def test_a_middle_on_a_sample_has_no_more_than_its_share():
    field = {"region": "square:160", "robots": 1, "footprint": 8, "angle": 0}
    plans = [
        plan_search(SearchProblem(**field, prior=[f"ring:{x},71:0.25=20,0.5=40,0.95=75"]), seed=1)
        for x in (71, 70.7)
    ]
    most = 0.25 / 20 * 8 * 4 * np.arcsinh(1) / (2 * np.pi)  # in the middle of a cell
    for plan in plans:
        assert 0.5 * most < plan.tour_cost.odds.max() * plan.prior_inside < most
        assert plan.prior_inside == pytest.approx(0.95, abs=0.03)
    assert plans[0].prior_inside == pytest.approx(plans[1].prior_inside, abs=0.002)


def test_segments_that_cover_a_slanted_region_are_in_it_entirely(tmp_path):
    outline = [[0, 0], [90, 20], [70, 100], [-10, 60], [0, 0]]
    (tmp_path / "area.geojson").write_text(
        json.dumps({"type": "Polygon", "coordinates": [outline]})
    )
    feature = {
        "type": "Feature",
        "geometry": {"type": "Polygon", "coordinates": [outline]},
        "properties": {"probability": 1},
    }
    (tmp_path / "prior.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": [feature]})
    )
    region = region_of(Polygon(outline))
    for prior, elsewhere in ((str(tmp_path / "prior.geojson"), 0.3), ("ring:40,40:0.9=1", 0.999)):
        problem = SearchProblem(region, robots=2, footprint=10, prior=[prior], elsewhere=elsewhere)
        plan = plan_search(problem, seed=1)
        assert type(plan.prior_inside) is float
        assert plan.prior_inside == pytest.approx(1, abs=1e-3)
        assert plan.tour_cost.odds.sum() == pytest.approx(1)


def test_segments_points_and_mixtures(tmp_path):
    def feature(kind, coordinates, **properties):
        geometry = {"type": kind, "coordinates": coordinates}
        return {"type": "Feature", "geometry": geometry, "properties": properties}

    def file(name, *features):
        path = tmp_path / name
        path.write_text(json.dumps({"type": "FeatureCollection", "features": list(features)}))
        return str(path)

    left = [[[0, 0], [50, 0], [50, 100], [0, 100], [0, 0]]]
    right = [[[50, 0], [100, 0], [100, 100], [50, 100], [50, 0]]]
    halves = file(
        "halves.geojson",
        feature("Polygon", left, probability=30),
        feature("Polygon", right, probability=10),
    )
    spots = file("spots.json", feature("Point", [80, 80], spread_m=3))
    plan = plan_search(SearchProblem(**SQUARE, prior=[f"3*{halves}", spots], elsewhere=0.2), seed=1)
    west = plan.positions(np.arange(100))[:, 0] < 50
    # of .8, three quarters are halves, and the rest is one spot in the east
    assert plan.tour_cost.odds[west].sum() == pytest.approx(0.2 * 0.5 + 0.6 * 0.75, abs=0.01)
    assert plan.prior_inside == pytest.approx(1, abs=0.01)


def test_a_raster_with_its_own_place(tmp_path):
    head = "ncols 4\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 50\nNODATA_value -1\n"
    (tmp_path / "grid.asc").write_text(head + "0 3 9 9\n1 0 9 -1\n")
    plan = plan_search(SearchProblem(**SQUARE, prior=[str(tmp_path / "grid.asc")]), seed=1)
    places = plan.positions(np.arange(100))
    north, east = places[:, 1] > 50, places[:, 0] > 50
    odds = plan.tour_cost.odds
    assert odds[north & east].sum() == pytest.approx(0.75)
    assert odds[~north & ~east].sum() == pytest.approx(0.25)
    assert plan.prior_inside == pytest.approx(4 / 31)


def test_a_likely_corner_is_searched_early_and_all_the_rest_in_time(tmp_path):
    file, values = corner(tmp_path)
    plain = run(SearchProblem(**SQUARE), seed=1)
    for at_most in (1.0, 1.1, 1.25):
        likely = run(SearchProblem(**SQUARE, prior=[file], at_most=at_most), seed=1)
        assert likely.status == "complete"
        assert likely.plan.planned_seconds <= at_most * plain.plan.planned_seconds * (1 + 1e-9)
        places = plain.plan.positions(np.arange(100))
        rows, columns = ((100 - places[:, 1]) // 10).astype(int), (places[:, 0] // 10).astype(int)
        before = values[rows, columns] @ plain.visits.times
        assert likely.expected_find < before
        assert likely.visits.times.max() == likely.makespan
        again = values[rows, columns] @ likely.visits.times[_same(plain, likely)]
        assert again == pytest.approx(likely.expected_find)


def _same(one, other):
    """Return the tour index in another plan of each cell of a plan."""
    return other.plan.tour.position[tuple(one.plan.tour.cells.T)]


def test_vehicles_keep_the_limit_of_their_flights(tmp_path):
    file, _ = corner(tmp_path)
    field = {**SQUARE, "vehicle": "multirotor", "launch": ((-5.0, -5.0),)}
    plain = plan_search(SearchProblem(**field), seed=1)
    likely = plan_search(SearchProblem(**field, prior=[file], at_most=1.2), seed=1)
    assert likely.plain_seconds == plain.planned_seconds
    assert likely.planned_seconds <= 1.2 * plain.planned_seconds
    first = [likely.positions(likely.stops(robot))[:8] for robot in range(2)]
    assert any((abs(stops - 95) < 1).all(axis=1).any() for stops in first)


def test_an_episode_holds_its_prior(tmp_path):
    file, _ = corner(tmp_path)
    prior = [file, "2*ring:20,20:0.5=10"]
    episode = run(SearchProblem(**SQUARE, prior=prior, elsewhere=0.1), seed=1)
    episode.save(tmp_path / "episode.json")
    (tmp_path / "corner.npy").unlink()
    loaded = SearchEpisode.load(tmp_path / "episode.json")
    assert loaded.verify()
    assert loaded.expected_find == episode.expected_find
    np.testing.assert_array_equal(loaded.plan.tour_cost.odds, episode.plan.tour_cost.odds)


def test_an_episode_holds_the_system_of_its_raster(tmp_path):
    outline = [[7.9, 49.9], [7.902, 49.9], [7.902, 49.902], [7.9, 49.902], [7.9, 49.9]]
    (tmp_path / "area.geojson").write_text(
        json.dumps({"type": "Polygon", "coordinates": [outline]})
    )
    # UTM zone 32
    head = "ncols 4\nnrows 4\nxllcorner 420900\nyllcorner 5527900\ncellsize 100\n"
    (tmp_path / "grid.asc").write_text(head + "1 2 3 4\n" * 4)
    (tmp_path / "grid.prj").write_text("EPSG:32632")
    prior = [str(tmp_path / "grid.asc")]
    problem = SearchProblem(str(tmp_path / "area.geojson"), robots=1, footprint=40, prior=prior)
    episode = run(problem, seed=1)
    assert 0 < episode.plan.prior_inside < 1
    episode.save(tmp_path / "episode.json")
    (tmp_path / "grid.asc").unlink()
    (tmp_path / "grid.prj").unlink()
    loaded = SearchEpisode.load(tmp_path / "episode.json")
    assert loaded.verify()
    np.testing.assert_array_equal(loaded.plan.tour_cost.odds, episode.plan.tour_cost.odds)


def test_the_command_writes_first_visits(tmp_path, capsys):
    file, values = corner(tmp_path)
    out = tmp_path / "out"
    words = ["search", "square:100", "--robots", "2", "--footprint", "10", "--seed", "1", "--json"]
    for more in ([], ["--prior", file, "--at-most", "1.1"]):
        assert shoal([*words, *more, "--out", str(out)]) == 0
        result = json.loads(capsys.readouterr().out)
        rows = list(csv.DictReader((out / "visits.csv").read_text().splitlines()))
        assert list(rows[0]) == ["x_m", "y_m", "robot", "time_s"]
        assert len(rows) == 100
        assert max(float(row["time_s"]) for row in rows) == pytest.approx(result["makespan_s"])
        expected = sum(
            values[int((100 - float(row["y_m"])) // 10), int(float(row["x_m"]) // 10)]
            * float(row["time_s"])
            for row in rows
        )
        assert result["expected_find_s"] == (pytest.approx(expected) if more else None)
    assert shoal([word for word in words if word != "--json"] + ["--prior", file]) == 0
    assert "found after" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("prior", "message"),
    [
        ("nothing.npy", "nothing.npy"),
        ("picture.png", r"expected ring:X,Y:SHARE=METRES,... or a file .npy"),
        ("ring:0,0:0.5=10,0.4=20", "increasing shares"),
        ("ring:0,0:1.5=10", "increasing shares"),
        ("ring:0:0.5=10", "increasing shares"),
        ("ring:nan,0:0.5=10", "increasing shares"),
        ("0*ring:0,0:0.5=10", "weight"),
    ],
)
def test_what_is_no_prior_is_refused(prior, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InvalidInputError, match=message):
        plan_search(SearchProblem(**SQUARE, prior=[prior]), seed=1)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.zeros((3, 3)), "zeros only"),
        (np.array([[1.0, -1.0]]), "-1"),
        (np.array([[1.0, np.nan]]), "nan"),
        (np.ones(3), "rows and columns"),
        (np.array([["a"]]), "rows and columns"),
        (np.array([[object()]]), "allow_pickle|Object arrays"),
    ],
)
def test_arrays_that_hold_no_probabilities_are_refused(values, message, tmp_path):
    np.save(tmp_path / "wrong.npy", values, allow_pickle=True)
    with pytest.raises(InvalidInputError, match=message):
        open_prior([str(tmp_path / "wrong.npy")], 0.0, open_region("square:100"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[]", "FeatureCollection"),
        ('{"features": [1]}', "expected a geometry"),
        ('{"features": [{"geometry": {"type": "Point", "coordinates": [1, 1]}}]}', "spread_m"),
        (
            '{"features": [{"geometry": {"type": "Polygon", "coordinates":'
            ' [[[0, 0], [1, 0], [1, 1], [0, 0]]]}, "properties": {}}]}',
            "probability",
        ),
        (
            '{"features": [{"geometry": {"type": "LineString", "coordinates": [[0, 0], [1, 0]]},'
            ' "properties": {"spread_m": 1}}]}',
            "Polygon or a Point",
        ),
    ],
)
def test_features_that_are_no_prior_are_refused(text, message, tmp_path):
    (tmp_path / "wrong.geojson").write_text(text)
    with pytest.raises(InvalidInputError, match=message):
        open_prior([str(tmp_path / "wrong.geojson")], 0.0, open_region("square:100"))


@pytest.mark.parametrize("role", ["prior", "starts"])
def test_points_in_a_projection_that_the_file_names_are_converted(role, tmp_path):
    """As in files of regions, an old member "crs" names another system than WGS84."""
    outline = [[8.999, 49.999], [9.002, 49.999], [9.002, 50.002], [8.999, 50.002], [8.999, 49.999]]
    (tmp_path / "area.geojson").write_text(
        json.dumps({"type": "Polygon", "coordinates": [outline]})
    )
    region = open_region(str(tmp_path / "area.geojson"))

    def points(crs, *places):
        data = {
            "type": "FeatureCollection",
            "features": [
                {
                    "type": "Feature",
                    "geometry": {"type": "Point", "coordinates": place},
                    "properties": {"spread_m": 5},
                }
                for place in places
            ],
        }
        if crs:
            data["crs"] = {"type": "name", "properties": {"name": crs}}
        (tmp_path / "points.geojson").write_text(json.dumps(data))
        if role == "starts":
            return read_points(tmp_path / "points.geojson", region, what="starts")
        [(_, spread)] = open_prior([str(tmp_path / "points.geojson")], 0.0, region).parts
        return spread.points

    degrees = points(None, [9.0, 50.0], [9.001, 50.001])
    np.testing.assert_allclose(
        points("EPSG:25832", [500000.0, 5538630.7], [500071.66, 5538741.9]), degrees, atol=0.1
    )
    np.testing.assert_array_equal(
        points("urn:ogc:def:crs:OGC:1.3:CRS84", [9.0, 50.0], [9.001, 50.001]), degrees
    )
    with pytest.raises(InvalidInputError, match="expected a known coordinate reference system"):
        points("EPSG:99999", [1, 1])
    region = open_region("square:100")
    with pytest.raises(InvalidInputError, match="expected metres, "):
        points("EPSG:25832", [500000.0, 5538630.7])


def test_weights_that_overflow_together_are_scaled():
    prior = open_prior(
        ["1e308*ring:50,50:0.5=20", "1e308*ring:20,20:0.5=20"], 0.5, open_region("square:100")
    )
    assert [weight for weight, _ in prior.parts] == [0.25, 0.25]


def test_a_target_that_is_nowhere_in_the_region_is_refused():
    with pytest.raises(InvalidInputError, match="expected some probability"):
        plan_search(SearchProblem(**SQUARE, prior=["ring:5000,5000:1=10"]), seed=1)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"at_most": 1.1}, "at_most: expected a prior"),
        ({"elsewhere": 0.1}, "elsewhere: expected a prior"),
        ({"drift": (1.0, 0.0)}, "drift: expected a prior"),
        ({"prior": ["ring:0,0:0.5=9"], "drift": (1.0,)}, "two velocities"),
        ({"prior": ["ring:0,0:0.5=9"], "drift": (1.0, 0.0, -1.0)}, "spread"),
        ({"prior": ["ring:0,0:0.5=9"], "drift": (1.0, 0.0), "targets": 2}, "stand still"),
        ({"prior": ["tracks.nc"], "elsewhere": 0.1}, "tracks of particles alone"),
        ({"prior": ["tracks.nc", "ring:0,0:0.5=9"]}, "tracks of particles alone"),
        ({"prior": ["tracks.nc"], "bands": (10, 20)}, "one altitude"),
        ({"prior": ["ring:0,0:0.5=9"], "at_most": 0.9}, "at_most: expected"),
    ],
)
def test_fields_that_contradict_each_other_are_refused(fields, message):
    with pytest.raises(InvalidInputError, match=message):
        SearchProblem(**SQUARE, **fields)


def looks_at(episode, side=10.0):
    """Return the times of all searches of the squares of a lattice with row 0 in the south."""
    looks = [[] for _ in range(int(100 / side) ** 2)]
    for robot, log in enumerate(episode.trace.robots):
        squares = (episode.plan.positions(log.cells)[:, :2] // side).astype(int) @ (1, 100 // side)
        times = episode.clock(log.times, robot)
        for square, moment in zip(squares.astype(int).tolist(), times.tolist(), strict=True):
            looks[square].append(moment)
    return [sorted(own) for own in looks]


@pytest.mark.parametrize(
    "fields",
    [
        {"faults": "crash:1@30", "loss": 0.5, "at_most": 1.0},
        {"at_most": 1.4},
        {"passes": 2},
        {"at_most": 1.4, "footprint": (10.0, 30.0)},
        {"at_most": 1.4, "bands": (20.0, 30.0)},
        {"at_most": 1.4, "obstacles": 3},
    ],
)
def test_success_and_expected_time_are_those_of_many_simulated_targets(tmp_path, fields):
    file, values = corner(tmp_path)
    problem = SearchProblem(**SQUARE, prior=[file], detection=0.7).replaced(**fields)
    episode = run(problem, seed=3)
    assert episode.status == "complete"
    if "footprint" in fields:  # a wide robot sees cells around its own
        looks = [[] for _ in range(100)]
        for robot, log in enumerate(episode.trace.robots):
            for seen, moment in zip(
                episode.plan.visible_cells(robot, log.cells),
                episode.clock(log.times, robot).tolist(),
                strict=True,
            ):
                places = episode.plan.positions(seen)[:, :2] // 10
                for square in (places @ (1, 10)).astype(int):
                    looks[square].append(moment)
        looks = [sorted(own) for own in looks]
    else:
        looks = looks_at(episode)
    seen = np.array([bool(own) for own in looks])
    assert (~seen).sum() == fields.get("obstacles", 0)
    assert max(map(len, looks)) > 1 + ("bands" in fields)
    rng, last = np.random.default_rng(1), episode.makespan
    odds = np.where(seen, np.flipud(values).ravel(), 0.0)
    odds /= odds.sum()
    times, found = [], 0
    for square in rng.choice(100, size=20_000, p=odds):
        look, own = int(rng.geometric(0.7)) - 1, looks[square]
        times.append(own[look % len(own)] + look // len(own) * last)
        found += look < len(own)
    success = episode.success.probability / np.flipud(values).ravel()[seen].sum()
    assert found / len(times) == pytest.approx(success, abs=0.01)
    assert np.mean(times) == pytest.approx(episode.expected_find, rel=0.02)


def test_likely_cells_are_searched_again_where_a_search_may_miss_the_target(tmp_path):
    file, _ = corner(tmp_path)
    problem = SearchProblem(**SQUARE, prior=[file], detection=0.5, at_most=1.3)
    plan = plan_search(problem, seed=1)
    assert plan.planned_seconds <= 1.3 * plan.plain_seconds * (1 + 1e-9)
    places = plan.positions(np.concatenate([plan.stops(robot) for robot in range(2)]))[:, :2]
    squares, counts = np.unique((places // 10).astype(int) @ (1, 10), return_counts=True)
    assert squares.tolist() == list(range(100))
    assert counts[99] == counts.max() > 2
    sure = plan_search(problem.replaced(detection=1.0), seed=1)
    assert len(sure.tour) == 100


CRASHES = "crash:1@9,crash:2@25,crash:4@70"


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"faults": CRASHES},
        {"bands": (20.0, 30.0), "faults": CRASHES, "footprint": 20},
        {"obstacles": 4, "faults": CRASHES},
        {"bands": (20.0, 30.0), "obstacles": 4, "footprint": 20},
        {"region": "box:60x60x30", "prior": ["ring:20,20:0.5=10,0.9=30"], "faults": CRASHES},
    ],
)
def test_nothing_is_left_out_with_second_looks_and_one_survivor_finishes(fields):
    # around a hole, so that ways between looks at the same place are measured
    field = {"region": "ring:100x70", "prior": ["ring:40,35:0.5=10,0.9=30"], "footprint": 10}
    problem = SearchProblem(**(field | fields), robots=4, detection=0.6, at_most=1.4, loss=0.4)
    episode = run(problem, seed=1)
    assert episode.status == "complete"
    plan = episode.plan
    layers = layers_of(plan.grid)
    assert any(layer.whole is not None for layer in layers)
    assert plan.planned_seconds <= 1.4 * plan.plain_seconds * (1 + 1e-9)
    # every cell of every layer but for the obstacles, on which no robot can be
    assert np.isinf(episode.visits.times).sum() == len(episode.scenario.obstacles)
    assert all(seen.covered_fraction > 1 - 1e-6 for seen in episode.coverages) or fields.get(
        "obstacles"
    )
    assert len(episode.report()["layers"]) == sum(layer.whole is None for layer in layers)
    assert episode.verify()


def test_the_widest_cells_over_a_place_are_searched_again():
    # from 40 m, a camera sees twice as far across as from 20 m
    camera = "multirotor,sensor_width=13.2,sensor_height=8.8,focal_length=8.8,image_width=4000"
    problem = SearchProblem(
        "square:150",
        robots=2,
        vehicle=camera,
        bands=(20.0, 40.0),
        prior=["ring:40,35:0.5=10,0.9=30"],
        detection=0.6,
        at_most=1.4,
        margin=0.0,
    )
    plan = plan_search(problem, seed=1)
    low, high, *further = layers_of(plan.grid)
    assert high.size > low.size
    assert further
    assert all(layer.whole is high for layer in further)


def test_a_cell_that_is_searched_again_counts_once(tmp_path):
    file, _ = corner(tmp_path)
    episode = run(SearchProblem(**SQUARE, prior=[file], detection=0.6, at_most=1.5))
    cells, looks = len(np.unique(episode._same_cells)), len(episode.plan.tour_cost)
    assert cells < looks
    report = episode.report()
    assert report["region"]["cells"] == episode.n_cells == cells
    assert report["region"]["further_looks"] == looks - cells
    assert episode.reason.startswith(
        f"all {cells} cells that robots can reach were searched, with {looks - cells} further looks"
    )
    assert episode.unreachable == 0
    faults = [f"crash:{robot}@9" for robot in range(1, SQUARE["robots"] + 1)]
    problem = SearchProblem(**SQUARE, prior=[file], detection=0.6, at_most=1.5, faults=faults)
    assert re.fullmatch(
        rf"\d+ of {cells} cells that robots can reach were never searched, and \d+ of"
        rf" {looks - cells} further looks at cells were not taken",
        run(problem).reason,
    )


def test_missions_contain_second_looks(tmp_path):
    file, _ = corner(tmp_path)
    problem = SearchProblem(
        **SQUARE, prior=[file], detection=0.6, at_most=1.5, vehicle="multirotor", margin=0.0
    )
    missions = MissionSet.from_problem(problem, MissionOptions(format=("csv",)), seed=1).run()
    assert missions.status == "complete"
    assert len(missions.plan.tour) > 100
    assert missions.plan.planned_seconds <= 1.5 * missions.plan.plain_seconds * (1 + 1e-9)


def test_the_file_of_visits_has_each_cell_once(tmp_path):
    file, _ = corner(tmp_path)
    problem = SearchProblem(**SQUARE, prior=[file], detection=0.5, at_most=1.3)
    episode = run(problem, seed=1)
    assert len(episode.plan.tour) > 100
    episode.save_visits(tmp_path / "visits.csv")
    rows = list(csv.DictReader((tmp_path / "visits.csv").read_text().splitlines()))
    assert list(rows[0]) == ["x_m", "y_m", "robot", "time_s"]
    first = {int(float(row["x_m"]) // 10 + float(row["y_m"]) // 10 * 10): row for row in rows}
    assert len(first) == len(rows) == 100
    for square, looks in enumerate(looks_at(episode)):
        assert float(first[square]["time_s"]) == pytest.approx(looks[0])


def test_the_file_of_visits_tells_places_of_wide_coordinates_apart(tmp_path):
    corner = np.array([467_000.25, 5_247_000.5])
    outline = corner + np.array([(0, 0), (10, 0), (10, 10), (0, 10)])
    file = tmp_path / "utm.csv"
    file.write_text("x_m,y_m\n" + "".join(f"{x},{y}\n" for x, y in outline.tolist()))
    episode = run(SearchProblem(str(file), robots=2, footprint=1, angle=0), seed=1)
    episode.save_visits(tmp_path / "visits.csv")
    rows = list(csv.DictReader((tmp_path / "visits.csv").read_text().splitlines()))
    places = np.array([(float(row["x_m"]), float(row["y_m"])) for row in rows])
    cells = np.round(places - corner - 0.5, 5)
    assert {*map(tuple, cells.tolist())} == {(x, y) for x in range(10) for y in range(10)}


@pytest.mark.parametrize("angle", [0.0, 30.0])
def test_the_file_of_visits_has_each_cell_of_several_passes_once(angle, tmp_path):
    episode = run(SearchProblem(**SQUARE, passes=2, angle=angle), seed=1)
    episode.save_visits(tmp_path / "visits.csv")
    rows = list(csv.DictReader((tmp_path / "visits.csv").read_text().splitlines()))
    cells = len(episode.plan.tour) // 2
    places = [(row["x_m"], row["y_m"]) for row in rows]
    assert len(rows) == len(set(places)) == cells
    times = [float(row["time_s"]) for row in rows]
    assert times == sorted(times)
    lowest = episode.plan.tour.cells[:, 0] == 0
    firsts = episode.visits.times
    grid = episode.plan.grid.layers
    centres = np.concatenate(
        [
            layer.lattice.to_region(layer.lattice.centers(*episode.plan.tour.cells[chosen, 1:].T))
            for layer, chosen in zip(grid, (lowest, ~lowest), strict=True)
        ]
    )
    firsts = np.concatenate([firsts[lowest], firsts[~lowest]])
    # by plain comparison of the centres of all cells
    earliest = [
        min(firsts[k] for k in range(len(firsts)) if np.abs(centres[k] - centres[j]).max() < 1e-6)
        for j in range(cells)
    ]
    assert sorted(earliest) == pytest.approx(times)


def drifting(tmp_path, **fields):
    file, _ = corner(tmp_path)
    return SearchProblem(**SQUARE, prior=[file], drift=(-0.2, 0.0, 0.05)).replaced(**fields)


@pytest.mark.parametrize("fields", [{}, {"detection": 0.7, "at_most": 1.4}, {"passes": 2}])
def test_times_of_moving_targets_are_those_of_many_simulated_ones(tmp_path, fields):
    problem = drifting(tmp_path, **fields)
    episode = run(problem, seed=1)
    assert episode.status == "complete"
    plan, rng, count = episode.plan, np.random.default_rng(5), 20_000
    _, values = corner(tmp_path)
    rows, columns = np.divmod(rng.choice(100, size=count, p=values.ravel()), 10)
    begins = (np.column_stack([columns, 9 - rows]) + rng.random((count, 2))) * 10
    velocities = np.array([-0.2, 0.0]) + 0.05 * rng.normal(size=(count, 2))
    horizon = problem.at_most * plan.plain_seconds
    times = np.full(count, horizon)
    looks = [
        (moment, place)
        for robot, log in enumerate(episode.trace.robots)
        for moment, place in zip(
            episode.clock(log.times, robot), plan.positions(log.cells)[:, :2], strict=True
        )
    ]
    found = np.zeros(count, dtype=bool)
    for moment, place in sorted(looks, key=lambda look: look[0]):
        there = (np.abs(begins + moment * velocities - place) <= 5).all(axis=1)
        there &= ~found & (rng.random(count) < problem.detection)
        times[there], found = np.minimum(moment, horizon), found | there
    assert found.mean() == pytest.approx(episode.success.probability, abs=0.02)
    assert times.mean() == pytest.approx(episode.expected_find, rel=0.03)
    gone = begins + episode.makespan * velocities
    outside = ((gone < 0) | (gone > 100)).any(axis=1).mean()
    assert episode.report()["prior"]["left"] == pytest.approx(outside, abs=0.02)


def test_a_plan_that_knows_the_drift_finds_the_target_earlier(tmp_path):
    moving = plan_search(drifting(tmp_path, robots=1), seed=2)
    still = plan_search(drifting(tmp_path, robots=1, drift=None), seed=2)
    ignoring = replace(still, ground=replace(moving.ground, grid=still.grid, tour=still.tour))
    problem = drifting(tmp_path, robots=1)
    assert moving.planned_seconds <= 1.25 * moving.plain_seconds * (1 + 1e-9)
    cells = np.concatenate([moving.stops(0)])
    assert sorted(cells.tolist()) == list(range(100))
    knowing = planning._expected_time(moving, problem)
    assert knowing < planning._expected_time(ignoring, problem)


def tracks_file(path, *, version):
    """Write tracks as OpenDrift does: of three particles, one is taken out, and one released
    later.
    """
    lon = np.array([[8.0, 8.001, np.nan], [8.0005, 8.0005, 8.0005], [np.nan, 8.0, 8.0]])
    lat = np.array([[50.0, 50.0, np.nan], [50.0005, 50.001, 50.001], [np.nan, 50.0, 50.0]])
    time = np.array([1000.0, 1060.0, 1120.0])
    units = "seconds since 1970-01-01 00:00:00"
    if version == 3:
        with netcdf_file(path, "w") as file:
            file.createDimension("trajectory", 3)
            file.createDimension("time", 3)
            file.createVariable("time", "d", ("time",))[:] = time
            file.variables["time"].units = units
            for name, values in (("lon", lon), ("lat", lat)):
                variable = file.createVariable(name, "f", ("trajectory", "time"))
                variable._FillValue = np.float32(-999.0)
                variable[:] = np.where(np.isnan(values), -999.0, values)
        return
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        file["time"] = time
        file["time"].attrs["units"] = units
        for name, values in (("lon", lon), ("lat", lat)):
            file[name] = values.astype(np.float32)
            file[name].attrs["_FillValue"] = np.float32([np.nan])


@pytest.mark.parametrize("version", [3, 4])
def test_tracks_of_particles_move_as_in_the_file(tmp_path, version):
    tracks_file(tmp_path / "tracks.nc", version=version)
    outline = [[7.999, 49.999], [8.002, 49.999], [8.002, 50.002], [7.999, 50.002], [7.999, 49.999]]
    (tmp_path / "area.geojson").write_text(
        json.dumps({"type": "Polygon", "coordinates": [outline]})
    )
    region = open_region(str(tmp_path / "area.geojson"))
    tracks = open_prior([str(tmp_path / "tracks.nc")], 0.0, region).tracks
    assert tracks.times.tolist() == [0.0, 60.0, 120.0]
    places = tracks.at(np.array([0.0, 30.0, 60.0, 500.0]))
    degrees = region.frame.to_degrees(places.reshape(-1, 2)).reshape(4, 2, 2)
    expected = [[8.0, 50.0], [8.0005, 50.0], [8.001, 50.0], [8.001, 50.0]]
    np.testing.assert_allclose(degrees[:, 0], expected, atol=1e-6)
    np.testing.assert_allclose(degrees[:, 1, 1], [50.0005, 50.00075, 50.001, 50.001], atol=1e-5)
    problem = SearchProblem(
        str(tmp_path / "area.geojson"), robots=2, footprint=20, prior=[str(tmp_path / "tracks.nc")]
    )
    episode = run(problem, seed=1)
    assert episode.status == "complete"
    assert episode.expected_find <= 1.25 * episode.plan.plain_seconds
    episode.save(tmp_path / "episode.json")
    (tmp_path / "tracks.nc").unlink()
    assert SearchEpisode.load(tmp_path / "episode.json").expected_find == episode.expected_find


@pytest.mark.parametrize("content", [b"CDF\x01", b"\x89HDF\r\n\x1a\n", b"text"])
def test_files_that_hold_no_tracks_are_refused(tmp_path, content):
    (tmp_path / "tracks.nc").write_bytes(content)
    outline = [[7.999, 49.999], [8.002, 49.999], [8.002, 50.002], [7.999, 49.999]]
    (tmp_path / "area.geojson").write_text(
        json.dumps({"type": "Polygon", "coordinates": [outline]})
    )
    with pytest.raises(InvalidInputError, match=r"tracks\.nc: expected"):
        open_prior([str(tmp_path / "tracks.nc")], 0.0, open_region(str(tmp_path / "area.geojson")))
    with pytest.raises(InvalidInputError, match="on Earth"):
        open_prior([str(tmp_path / "tracks.nc")], 0.0, open_region("square:100"))


def test_drift_on_the_command_line(tmp_path, capsys):
    file, _ = corner(tmp_path)
    words = ["search", "square:100", "--robots", "2", "--footprint", "10", "--prior", file]
    assert shoal([*words, "--drift", "-0.2,0:0.05", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["prior"]["left"] > 0
    assert shoal([*words, "--drift", "fast"]) == 2
    assert "VX,VY" in capsys.readouterr().err


def test_random_targets_are_where_the_prior_says(tmp_path):
    values = np.zeros((10, 10))
    values[0, :3] = 1.0
    np.save(tmp_path / "row.npy", values)
    problem = SearchProblem(**SQUARE, prior=[str(tmp_path / "row.npy")], targets=3)
    episode = run(problem, seed=1)
    places = episode.plan.positions(list(episode.scenario.targets))
    assert sorted(places.tolist()) == [[5.0, 95.0], [15.0, 95.0], [25.0, 95.0]]
    with pytest.raises(InvalidInputError, match="at most 3"):
        run(problem.replaced(targets=4), seed=1)


def test_missions_follow_the_prior(tmp_path):
    file, _ = corner(tmp_path)
    field = {**SQUARE, "vehicle": "multirotor", "cross_track": 0.0, "margin": 0.0}
    plain, likely = (
        MissionSet.from_problem(
            SearchProblem(**field, prior=prior), MissionOptions(format=("csv",)), seed=1
        ).run()
        for prior in ([], [file])
    )
    assert plain.expected_find is None
    odds = likely.plan.tour_cost.odds[_same(likely, plain)]
    assert likely.expected_find < odds @ plain.visits.times


@pytest.mark.parametrize(("apart", "late"), [((0,), False), ((60, 30), True)])
def test_missions_that_wait_beyond_the_limit_are_told(tmp_path, monkeypatch, apart, late):
    file, _ = corner(tmp_path)
    said = []
    monkeypatch.setattr(mission_set, "tell_once", said.append)
    launch = ((-5.0, -5.0), (-4.0, -5.0))
    problem = SearchProblem(**SQUARE, vehicle="multirotor", launch=launch, prior=[file])
    made = MissionSet.from_problem(problem, MissionOptions(separation=apart), seed=1)
    limit = 1.25 * made.plan.plain_seconds
    assert (made.end > limit + 1) == late
    texts = [text for text in said if text.startswith("at_most")]
    assert len(texts) == late
    assert all(f"within {limit:.0f} s" in text for text in texts)


@pytest.mark.parametrize(
    ("vehicle", "apart", "ring", "chosen"),
    [
        ("multirotor", (60, 30), "67,71", "shorter"),
        ("rover", (15,), "34,43", "tour"),
        ("rover", (0,), "58,36", "auto"),
    ],
)
def test_missions_have_the_order_that_finds_the_target_first_if_vehicles_wait(
    tmp_path, monkeypatch, vehicle, apart, ring, chosen
):
    said = []
    monkeypatch.setattr(mission_set, "tell_once", said.append)
    problem = SearchProblem(
        "square:100",
        robots=3,
        footprint=10,
        vehicle=vehicle,
        launch=((5.0, 5.0), (10.0, 5.0), (15.0, 5.0)),
        prior=[f"ring:{ring}:0.25=8,0.5=16,0.95=40"],
    )
    options = MissionOptions(format=("csv",), separation=apart)
    best, tour = (
        MissionSet.from_problem(problem.replaced(**order), options, seed=1)
        for order in ({}, {"order": "tour"})
    )
    assert best.problem.order == chosen
    assert any(text.startswith("order:") for text in said) == (chosen != "auto")
    limit = 1.25 * best.plan.plain_seconds
    assert best.end <= max(limit + 1, 1.25 * tour.end)
    episode = best.run()
    stated = episode.expected_find
    assert stated <= tour.run().expected_find + 1e-6
    # who reads the episode plans the same order again
    episode.save(tmp_path / "episode.json")
    again = SearchEpisode.load(tmp_path / "episode.json")
    assert again.verify()
    assert again.expected_find == pytest.approx(stated)


def test_the_order_of_the_tour_is_that_without_a_prior(tmp_path):
    file, _ = corner(tmp_path)
    plain = plan_search(SearchProblem(**SQUARE), seed=1)
    tour, shorter, likely = (
        plan_search(SearchProblem(**SQUARE, prior=[file], order=order, detection=0.7), seed=1)
        for order in ("tour", "shorter", "likely")
    )
    assert all(np.array_equal(tour.stops(robot), plain.stops(robot)) for robot in range(2))
    longest = [plan.planned_seconds / plain.planned_seconds for plan in (tour, shorter, likely)]
    assert longest[0] == 1.0
    assert longest[1] <= 1.125 + 1e-9
    assert longest[2] <= 1.25 + 1e-9
    with pytest.raises(InvalidInputError, match="order"):
        SearchProblem(**SQUARE, order="tour")


def test_a_limit_that_no_order_keeps_is_said(tmp_path, monkeypatch):
    file, _ = corner(tmp_path)
    said = []
    monkeypatch.setattr(planning, "tell_once", said.append)
    monkeypatch.setattr(planning, "_reallocate", lambda trial, *_: replace(trial, flies=True))
    monkeypatch.setattr(SearchPlan, "planned_seconds", property(lambda self: 1.0 + 9 * self.flies))
    kept = plan_search(SearchProblem(**SQUARE, prior=[file]), seed=1)
    assert kept.tour_cost.at_most == 0
    assert "at most 1.25 times" in said[0]


def test_a_header_that_promises_too_much_is_refused(tmp_path):
    with (tmp_path / "huge.npy").open("wb") as file:
        shape = (10**9, 10**6)
        header = {"descr": "<f8", "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_1_0(file, header)
        file.write(bytes(80))
    with pytest.raises(InvalidInputError, match=r"huge\.npy: expected"):
        open_prior([str(tmp_path / "huge.npy")], 0.0, open_region("square:100"))


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("x.npy", "?", "base 64"),
        ("x.geojson", "/w==", "base 64"),
        ("..", "AAAA", "expected a file"),
        ("x.npy", "AAAA", "expected an array"),
    ],
)
def test_contents_of_strange_files_are_refused(name, data, message):
    part = {"weight": 1.0, "name": name, "data": data}
    with pytest.raises(InvalidInputError, match=message):
        plan_search(SearchProblem(**SQUARE, prior=[part]), seed=1)
