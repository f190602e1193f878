"""Search in three dimensions: volumes, altitude bands, passes."""

from __future__ import annotations

import json

import numpy as np
import pytest
import shapely
from tests.missions import flight_of, missions_of

from shoal import InvalidInputError, run
from shoal.cli import run as call
from shoal.missions import check_missions, write_missions
from shoal.missions.approach import missions_approach
from shoal.missions.deconfliction import plan_missions
from shoal.missions.files import read_mission
from shoal.search import SearchEpisode, SearchProblem, make_tour, open_region, plan_search
from shoal.search.flight.legs import separate_climbs
from shoal.search.flight.separation import Separation
from shoal.search.flight.terrain import Terrain
from shoal.search.flight.vehicle import vehicle_of
from shoal.search.tours.curves import join_layers
from shoal.views import figure
from shoal.views.search.history import SearchHistory
from shoal.views.search.missions import missions_figure
from shoal.views.search.page import page_data

CAMERA = "multirotor,sensor_width=13,sensor_height=8.8,focal_length=30"
DEGREES = {
    "type": "Polygon",
    "coordinates": [[[7.0, 50.0], [7.001, 50.0], [7.001, 50.0006], [7.0, 50.0006], [7.0, 50.0]]],
}


@pytest.fixture(scope="module")
def box():
    """A search of a box in which a robot dies."""
    problem = SearchProblem(
        "box:60x40x30", robots=3, vehicle="multirotor", faults="crash:2@15", targets=2
    )
    return run(problem, seed=1)


@pytest.fixture(scope="module")
def bands():
    """A search of a ring from two altitudes; the camera sees more from the higher one."""
    return run(SearchProblem("ring:60x25", bands=(30, 50), robots=2, vehicle=CAMERA), seed=1)


@pytest.fixture(scope="module")
def passes():
    """A search twice, rows across rows."""
    return run(SearchProblem("rectangle:60x40", passes=2, robots=2, angle=10), seed=1)


def test_all_of_a_box_is_searched_and_climbs_take_their_time(box):
    grid, vehicle = box.plan.grid, box.plan.vehicle
    assert grid.n_cells == 6 * 4 * 3 == len(box.plan.tour)
    assert box.plan.altitudes == [5.0, 15.0, 25.0]
    assert vehicle.height == 5.0
    assert grid.climb == pytest.approx((1 / 2.5 + 1 / 1.5) / 2 * 5.0)
    assert box
    assert [seen.covered_fraction for seen in box.coverages] == [1.0] * 3
    assert box.trace.takeovers
    for route in box.routes:
        legs = np.abs(np.diff(route.points, axis=0))
        assert not (
            legs[:, :2].any(axis=1) & (legs[:, 2] > 0)
        ).any()  # straight up or down, or level
    steps = box.plan.tour_cost.steps
    climbs = np.diff(np.append(box.plan.tour.cells[:, 0], box.plan.tour.cells[0, 0])) != 0
    assert climbs.sum() == 4  # two a pair of layers
    assert ((steps[climbs] > grid.climb - 1e-9) & (steps[climbs] < grid.climb + 1 + 1e-9)).all()
    assert steps[~climbs] == pytest.approx(1.0)
    assert box.plan.tour_cost.least == 72


def test_a_box_saved_and_loaded_is_verified(box, tmp_path):
    box.save(tmp_path / "box.json")
    again = SearchEpisode.load(tmp_path / "box.json")
    assert again.verify()
    assert again.report()["layers"] == box.report()["layers"]


def test_a_region_with_a_height_is_saved_whole(tmp_path):
    region = open_region("box:30x20x20")
    episode = run(SearchProblem(region, robots=1, simulate=False), seed=1)
    episode.save(tmp_path / "box.json")
    assert SearchEpisode.load(tmp_path / "box.json").problem.place.height == 20


def test_each_band_has_the_cells_of_its_footprint(bands):
    low, high = bands.plan.grid.layers
    assert (low.size, high.size) == pytest.approx((8.8, 8.8 * 5 / 3))
    assert bands
    # images without overlap along slanted legs miss slivers near bends
    assert min(seen.covered_fraction for seen in bands.coverages) > 0.998
    assert bands.plan.tour_cost.least == pytest.approx(low.n_cells + high.n_cells * 5 / 3)
    assert bands.plan.allocation.makespan >= bands.plan.tour_cost.least / 2
    assert sorted({*bands.routes[0].points[:, 2], *bands.routes[1].points[:, 2]}) == [30.0, 50.0]


def test_ways_between_layers_lead_around_walls_and_up(bands):
    """From the west of the ring below to its east above: half round and 20 m up."""
    cost, cells = bands.plan.tour_cost, bands.plan.tour.cells
    places = bands.plan.positions(np.arange(len(cells)))
    west = int(np.argmin(places[:, 0] + 1e3 * cells[:, 0]))
    east = int(np.argmax(places[:, 0] + 1e3 * cells[:, 0]))
    level = bands.plan.paths.legs(places[[west, east], :2]).points[:, :2]
    assert np.hypot(*np.diff(level, axis=0).T).sum() > 1.05 * np.hypot(
        *(places[east] - places[west])[:2]
    )
    expected = (
        np.hypot(*np.diff(level, axis=0).T).sum() + 20 * bands.plan.grid.climb
    ) / bands.plan.grid.size
    assert cost.length(west, east) == cost.length(east, west) == pytest.approx(expected)
    far = cost.distances.lengths(west)
    assert far[west] == 0
    assert far[east] == pytest.approx(expected, rel=0.15)


def test_rows_of_the_second_pass_cross_those_of_the_first(passes):
    first, second = passes.plan.grid.layers
    assert (first.angle, second.angle) == (10.0, 100.0)
    assert passes.plan.tour.name == "boustrophedon"
    assert passes
    assert [seen.covered_fraction for seen in passes.coverages] == [1.0, 1.0]
    assert passes.plan.altitudes == [30.0, 30.0]


def test_wide_footprints_see_their_own_layer():
    plan = plan_search(SearchProblem("box:90x90x20", robots=2, footprint=(10, 30)), seed=1)
    middle = int(plan.tour.position[1, 4, 4])
    seen = plan.tour.cells[plan.visible_cells(1, [middle])[0]]
    assert len(seen) == 9
    assert {*seen[:, 0]} == {1}


@pytest.fixture(scope="module")
def banded(tmp_path_factory):
    """A plan in three bands, and its missions."""
    file = tmp_path_factory.mktemp("banded") / "field.json"
    file.write_text(json.dumps(DEGREES))
    problem = SearchProblem(file, bands=(30, 50, 70), robots=2, footprint=20, vehicle="multirotor")
    plan = plan_search(problem, seed=1)
    return plan, plan_missions(plan, separation=Separation())


@pytest.mark.parametrize("form", ["plan", "wpl", "geojson", "kml", "gpx", "csv"])
def test_missions_hold_each_altitude_in_every_format(form, banded, tmp_path):
    plan, missions = banded
    write_missions(missions, tmp_path / "out", formats=[form])
    region = plan.grid.region
    for mission in missions:
        path = next(
            path
            for path in (tmp_path / "out").iterdir()
            if path.name.startswith(f"{mission.name}.")
        )
        found = read_mission(path)
        assert found.heights_above_home == pytest.approx(mission.heights_above_home, abs=0.01)
        assert {*np.round(found.levels)} <= {30, 35, 50, 55, 70, 75}
    near = missions_approach(missions, Separation(), region.frame, vehicle=plan.vehicle)
    assert near is None or near.horizontal > 9.99
    check = check_missions(
        tmp_path / "out", region, 20.0, bands=(30, 50, 70), separation=Separation()
    )
    if form != "gpx":  # which has no heights where that of home is not known
        assert not check.diagnostics
    assert [seen.covered_fraction for seen in check.coverages] == pytest.approx([1.0] * 3, abs=1e-4)
    assert check_missions(
        tmp_path / "out", region, 20.0, bands=(30, 90)
    ).coverage.covered_fraction == pytest.approx(0.5, abs=1e-4)


def test_vehicles_in_a_box_stay_in_the_middle_of_layers(box):
    missions = plan_missions(box.plan, separation=Separation())
    assert {*np.concatenate([mission.heights_above_home for mission in missions])} <= {
        5.0,
        15.0,
        25.0,
    }
    near = missions_approach(missions, Separation(), None, vehicle=box.plan.vehicle)
    assert near is None or near.horizontal > 9.99


def test_the_map_of_missions_names_the_altitudes_of_each_robot(box):
    missions = plan_missions(box.plan, separation=Separation())
    drawn = missions_figure(missions, box.plan.grid.region)
    flown = {
        f"robot {mission.robot} at"
        f" {' to '.join(f'{up:g}' for up in sorted({min(mission.levels), max(mission.levels)}))} m"
        for mission in missions
    }
    assert {text.get_text() for text in drawn.legends[0].texts} >= flown
    assert len(flown) == len({mission.robot for mission in missions}) > 1


def test_bands_above_terrain_keep_their_heights():
    slope = Terrain(np.array([[0.0, 40.0], [0.0, 40.0]]), -50.0, 50.0, (100.0, 100.0), None)
    way = [
        (-40.0, 0.0, 30.0),
        (40.0, 0.0, 30.0),
        (40.0, 0.0, 50.0),
        (-40.0, 10.0, 50.0),
        (-40.0, 20.0, 30.0),
    ]
    (mission,) = missions_of(
        way, None, altitude_frame="ground", terrain=slope, vehicle="multirotor", home=(0, 0)
    )
    ground = slope.at(mission.waypoints, None) - slope.at([(0.0, 0.0)], None)
    assert mission.heights_above_home - ground == pytest.approx(mission.levels, abs=2.0)
    assert {*np.round(mission.levels).tolist()} == {30.0, 50.0}
    with pytest.raises(InvalidInputError, match="altitude: expected more than"):
        missions_of(
            np.array(way) - [0, 0, 25], None, terrain=slope, vehicle="multirotor", home=(0, 0)
        )


def test_climbs_come_before_ways_and_descents_after_them():
    way, ups = separate_climbs(
        np.array([(0.0, 0.0), (0.0, 0.0), (9.0, 0.0)]), np.array([30.0, 50.0, 30.0])
    )
    assert np.column_stack([way, ups]).tolist() == [[0, 0, 30], [0, 0, 50], [9, 0, 50], [9, 0, 30]]


def test_fixed_wings_climb_in_circles():
    """No steeper than they can, in whole circles, on the side where there is room; refused where
    there is none.
    """
    way = np.array(
        [
            (0.0, 0.0, 80.0),
            (900.0, 0.0, 80.0),
            (900.0, 0.0, 140.0),
            (900.0, 300.0, 140.0),
            (0.0, 300.0, 100.0),
        ]
    )
    wing = vehicle_of("fixed-wing,wind_speed=4,wind_from=200")
    for blocked, side in ((None, 1), (shapely.box(850, 10, 950, 90), -1)):
        flown = flight_of(vehicle=wing, home=np.array([-50.0, 0.0]), blocked=blocked).waypoints(way)
        first, last = (
            int(np.flatnonzero((flown[:, :2] == (900, 0)).all(axis=1) & (flown[:, 2] == up))[0])
            for up in (80, 140)
        )
        climb = flown[first : last + 1]
        assert (side * climb[1:-1, 1] > -1e-6).all()
        steps, rises = np.hypot(*np.diff(climb[:, :2], axis=0).T), np.diff(climb[:, 2])
        assert (rises > 0).all()
        assert (rises / steps <= 3.0 / 20.0 + 1e-9).all(), "3 m/s at 16 m/s and the wind"
        assert (
            np.hypot(*(climb[1:-1, :2] - (900, side * wing.ground_radius)).T).max()
            < 1.06 * wing.ground_radius
        )
        assert {80.0, 140.0, 100.0} <= {*flown[:, 2].tolist()}
        assert (flown[-1, 2], flown[0, 2]) == (100.0, 80.0)
    with pytest.raises(
        InvalidInputError,
        match=r"turn_radius: expected room to climb in a circle of .* m, got none at",
    ):
        flight_of(
            vehicle=wing,
            home=np.zeros(2),
            blocked=shapely.union_all([shapely.box(895, y, 905, y + 10) for y in (-131, 121)]),
        ).waypoints(way)


def test_fixed_wings_search_several_altitudes(tmp_path):
    """Whole missions through two bands, read back: all is seen at both, and no turn is narrower
    than the radius.
    """
    plan = plan_search(
        SearchProblem(
            "rectangle:400x200",
            robots=1,
            footprint=50,
            bands=(80, 120),
            vehicle="fixed-wing,turn_radius=30",
        )
    )
    write_missions(plan_missions(plan, separation=Separation()), tmp_path)
    result = check_missions(tmp_path, plan.grid.region, 50.0, bands=(80, 120), vehicle=plan.vehicle)
    assert not result.errors
    assert all(one.covered_fraction > 0.9999 for one in result.coverages)


def test_pictures_show_all_layers(box, bands, passes):
    for episode, labels in (
        (box, ["5 m", "15 m", "25 m"]),
        (bands, ["30 m", "50 m"]),
        (passes, ["rows at 10°", "rows at 100°"]),
    ):
        history = SearchHistory(episode)
        assert [words for words, *_ in history.panels.labels] == labels
        numbers = history.panels.numbers
        assert {*numbers.ravel().tolist()} - {-1} == {*range(history.n_cells)}
        drawn = figure(episode)
        assert {text.get_text() for text in drawn.axes[0].texts} >= {*labels}
        told = page_data(episode)
        assert [label[0] for label in told["labels"]] == labels
        parts = shapely.union_all([shapely.Polygon(rings[0]) for rings in history.panels.parts])
        inside = [history.trajectories[robot].points[-1] for robot in range(history.n_robots)]
        assert shapely.contains(parts.buffer(1e-6), shapely.points(inside)).all()


def test_layers_of_one_cell_and_of_different_ones_are_joined():
    tour = join_layers(
        [make_tour("comb", (1, 1)), make_tour("comb", (2, 3)), make_tour("comb", (1, 1))]
    )
    assert len(tour) == 8
    assert tour.metrics().longest_step <= np.sqrt(6)


def test_commands_search_and_check_a_box(tmp_path, capsys):
    folder = str(tmp_path / "missions")
    arguments = [
        "search",
        "box:40x40x20",
        "--robots",
        "2",
        "--footprint",
        "10",
        "--missions",
        folder,
        "--json",
    ]
    assert call(arguments) == 0
    told = json.loads(capsys.readouterr().out)
    assert [layer["altitude_m"] for layer in told["layers"]] == [5.0, 15.0]
    assert call(["missions", "check", folder, "box:40x40x20", "--footprint", "10", "--json"]) == 0
    assert [band["covered_fraction"] for band in json.loads(capsys.readouterr().out)["bands"]] == [
        1.0,
        1.0,
    ]


@pytest.mark.parametrize(
    "fields",
    [
        {"bands": (30, 50), "faults": "crash:2@9"},
        {"passes": 2, "region": "ring:50x25"},
        {"region": "box:60x40x30", "loss": 0.2},
        {
            "bands": (30, 50),
            "footprint": None,
            "vehicle": "multirotor,sensor_width=9,sensor_height=9,focal_length=27",
        },
    ],
)
def test_an_unknown_obstacle_stands_in_all_layers_and_robots_climb_beside_it(fields):
    episode = run(
        SearchProblem(
            **{"region": "rectangle:80x60", "robots": 3, "footprint": 10, "obstacles": 3} | fields
        ),
        seed=1,
    )
    assert episode.makespan is not None  # each cell was searched
    # beside obstacles, images of a camera lie slanted, and leave gaps
    whole = "footprint" not in fields
    assert (episode.status == "complete") == whole == ("between footprints" not in episode.reason)
    assert episode.verify()
    grid, tour, blocked = episode.plan.grid, episode.plan.tour, episode.scenario.obstacles
    layers = tour.cells[list(blocked), 0]
    assert set(layers.tolist()) == set(range(len(grid.layers)))
    assert np.bincount(layers)[0] == 3
    for log, route in zip(episode.trace.robots, episode.routes, strict=True):
        assert not {*log.cells.tolist()} & {*blocked}
        passed = {int(cell) for detour in log.detours for cell in detour}
        assert not passed & {*blocked}
        up, across = (
            np.diff(route.points[:, 2]) != 0,
            np.diff(route.points[:, :2], axis=0).any(axis=1),
        )
        assert not (up & across).any(), "climbs are vertical"
        for number in np.flatnonzero(up).tolist():
            for low in route.points[number : number + 2]:
                layer = int(np.abs(grid.altitudes - low[2]).argmin())
                assert (
                    int(tour.position[layer, *grid.layers[layer].cell_of(low[None, :2])[0]])
                    not in blocked
                )
    reached = episode.scenario.goal
    assert (
        sum(reached >> cell & 1 for cell in range(grid.n_cells))
        + len(blocked)
        + episode.unreachable
        == grid.n_cells
    )


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"bands": (30, 30)}, "bands: expected one altitude or more, each once"),
        ({"bands": (0, 30)}, "bands: expected a number, above 0.*, got 0"),
        (
            {"bands": (30, 50), "vehicle": "rover"},
            "vehicle: expected a flying vehicle for bands or a box, got a rover",
        ),
        (
            {"region": "box:20x20x10", "bands": (5, 15)},
            "bands: expected altitudes up to 10 m, the top of the box, got 15 m",
        ),
        ({"region": "box:20x20"}, "expected box:WIDTHxDEPTHxHEIGHT"),
        (
            {"region": "box:10x10x100000", "footprint": 1},
            "expected at most 1000 layers, a footprint of 1 m thick, got 100000",
        ),
        ({"passes": 0}, "passes: expected a whole number from 1 to 100, got 0"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(fields, message):
    with pytest.raises(InvalidInputError, match=message):
        plan_search(SearchProblem(**{"region": "square:40", "robots": 1} | fields))
