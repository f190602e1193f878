"""Vehicles: files, what follows from them, and where they are when."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import shapely
from tests.missions import flight_of
from tests.reference.flight import ground_speed

from shoal.cli import run
from shoal.core.errors import InvalidInputError
from shoal.missions.deconfliction import plan_missions
from shoal.search.flight.timing import trajectory, turn_cells, turn_shares, working_seconds
from shoal.search.flight.vehicle import PRESETS, Vehicle, vehicle_of
from shoal.search.planning.plan import plan_search
from shoal.search.problem import SearchProblem
from shoal.search.run import run as run_search

GOOD = {
    "preset": "fixed-wing",
    "cruise_speed": 18,
    "turn_radius": 60,
    "wind_speed": 5,
    "wind_from": 270,
}


@pytest.mark.parametrize("suffix", [".toml", ".json"])
def test_a_vehicle_file(suffix, tmp_path):
    path = tmp_path / f"drone{suffix}"
    text = (
        json.dumps(GOOD)
        if suffix == ".json"
        else "\n".join(f"{name} = {json.dumps(value)}" for name, value in GOOD.items())
    )
    path.write_text(text)
    vehicle = vehicle_of(str(path))
    assert vehicle == vehicle_of(GOOD) == Vehicle(**GOOD) == vehicle_of(path)
    assert (vehicle.kind, vehicle.cruise, vehicle.height) == ("fixed-wing", 18, 80)
    assert vehicle_of(f"{path},wind_speed=2").wind == 2
    assert vehicle_of(vehicle.to_dict()) == vehicle
    problem = SearchProblem("square:100", vehicle=path)
    assert problem.to_dict()["vehicle"] == GOOD  # a problem needs no file any more
    assert SearchProblem.from_dict(json.loads(problem.canonical())) == problem


@pytest.mark.parametrize("preset", PRESETS)
def test_presets_stand_for_themselves(preset):
    assert vehicle_of(preset).to_dict() == {"preset": preset}
    assert set(vehicle_of(preset).to_dict(defaults=True)) == set(Vehicle.declarations())


BAD = [
    (
        "d.toml",
        "cruise_speed = ",
        "d.toml: expected TOML in UTF-8, with each key once, got something else",
    ),
    (
        "d.toml",
        "cruise_speed = -3",
        "d.toml: cruise_speed: expected a number, above 0 and at most 100, got -3",
    ),
    ("d.toml", 'cruise_speed = "fast"', "d.toml: cruise_speed: expected a number"),
    (
        "d.toml",
        "cruise_sped = 3",
        "d.toml: cruise_sped: expected no such field, got 3 (did you mean 'cruise_speed'?)",
    ),
    (
        "d.toml",
        'kind = "rover"',
        "d.toml: kind: expected no such field, got 'rover' (did you mean 'preset'?)",
    ),
    (
        "d.toml",
        'preset = "zeppelin"',
        "d.toml: preset: expected one of ideal, multirotor, fixed-wing, rover, got 'zeppelin'",
    ),
    (
        "d.toml",
        "wind_speed = 5",
        (
            "d.toml: wind_speed: expected less than the cruise_speed of 5 m/s, so that the vehicle"
            " can return"
        ),
    ),
    (
        "d.toml",
        "turn_radius = 9",
        (
            "d.toml: turn_radius: expected a radius above 0 for a fixed-wing, and 0 for a vehicle"
            " that turns"
        ),
    ),
    (
        "d.toml",
        'preset = "fixed-wing"\nturn_radius = 0',
        "d.toml: turn_radius: expected a radius above 0 for a fixed-wing",
    ),
    (
        "d.toml",
        'preset = "fixed-wing"\nturn_radius = 5',
        "d.toml: turn_radius: expected at least 15.1 m at 16 m/s, where a vehicle banks",
    ),
    ("d.toml", "reserve = 1", "d.toml: reserve: expected a number"),
    (
        "d.toml",
        "endurance = 0.5",
        (
            "d.toml: endurance: expected more than the 0.533 min of climbing and sinking, without"
            " the reserve"
        ),
    ),
    (
        "d.toml",
        "altitude = 0",
        "d.toml: altitude: expected a number of metres above 0 for a vehicle that flies, got 0",
    ),
    (
        "d.toml",
        'preset = "rover"\naltitude = 3',
        "d.toml: altitude: expected no value for a rover, got 3",
    ),
    (
        "d.toml",
        'preset = "rover"\nwind_speed = 0.5',
        "d.toml: wind_speed: expected no value for a rover, got 0.5",
    ),
    (
        "d.toml",
        "sensor_width = 13",
        "d.toml: sensor_height: expected a value together with sensor_width, got none",
    ),
    (
        "d.toml",
        "sensor_width = 9\nsensor_height = 6\nfocal_length = 9\ndetector_width = 3",
        "d.toml: detector_width: expected a detector or a camera",
    ),
    ("d.toml", "side_overlap = 1", "d.toml: side_overlap: expected a number from 0 to 0.95, got 1"),
    ("d.toml", "altitude = nan", "d.toml: altitude: expected a number"),
    ("d.toml", "altitude = [3]", "d.toml: altitude: expected a number"),
    ("d.toml", "altitude = true", "d.toml: altitude: expected a number"),
    (
        "d.toml",
        "x = " + "[" * 60 + "]" * 60,
        "d.toml: expected lists and objects that are nested at most 50 deep, got deeper ones",
    ),
    ("d.toml", "#" * 100_001, "d.toml: expected a vehicle file of at most 100000 bytes"),
    ("d.toml", b"\xff", "d.toml"),
    ("d.json", "{", "d.json"),
    ("d.json", "[3]", "d.json: expected fields with values, got [3]"),
    ("d.json", '{"altitude": 1e999}', "d.json: altitude: expected a number"),
    (
        "d.ini",
        "",
        (
            "vehicle: expected one of ideal, multirotor, fixed-wing, rover, or a file .toml or"
            " .json, got 'd.ini'"
        ),
    ),
]


@pytest.mark.parametrize(("name", "content", "said"), BAD)
def test_bad_vehicle_files_are_one_sentence(name, content, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    assert run(["search", "square:100", "--vehicle", name]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith(f"shoal: {said}")
    assert captured.err.count("\n") == 1
    assert not captured.out


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("multirotr", "did you mean 'multirotor'"),
        (
            "multirotor,cruise_speed",
            "expected field=value after the preset or file, got 'cruise_speed'",
        ),
        ("multirotor,cruise_speed=fast", "vehicle: cruise_speed: expected a number"),
        ("none.toml", "none.toml: expected a vehicle file, got no such file"),
        (3, "vehicle: expected a preset, a file or fields, got 3"),
        ("", "vehicle: expected a preset, a file or fields, got ''"),
    ],
)
def test_bad_descriptions(value, said):
    with pytest.raises(InvalidInputError, match=said.replace("(", r"\(")):
        vehicle_of(value)


def test_ground_speed_is_that_of_the_wind_triangle():
    rng = np.random.default_rng(4)
    for _ in range(50):
        wind, wind_from, bearing = rng.uniform(0, 11.9), rng.uniform(0, 360), rng.uniform(0, 360)
        vehicle = Vehicle(cruise_speed=12.0, wind_speed=wind, wind_from=wind_from)
        way = (math.sin(math.radians(bearing)), math.cos(math.radians(bearing)))
        assert vehicle.ground_speed([way])[0] == pytest.approx(
            ground_speed(bearing, 12.0, wind, wind_from)
        )


def test_a_camera():
    vehicle = vehicle_of(
        "multirotor,altitude=100,sensor_width=36,sensor_height=24,focal_length=50,side_overlap=0.25,front_overlap=0.8,"
        "image_width=6000,image_height=4000"
    )
    assert vehicle.image_size == (72.0, 48.0)
    assert vehicle.row_spacing == 48.0  # 54 m, but for the length of an image
    assert vehicle.trigger_distance == 9.6
    assert vehicle.ground_sample == pytest.approx(0.012)
    [layer] = run_search(SearchProblem("square:300", vehicle=vehicle), seed=1).report()["layers"]
    assert layer["ground_sample_m"] == pytest.approx(0.012)
    assert SearchProblem("square:300", vehicle=vehicle).chosen_footprint == 48.0
    assert SearchProblem("square:300", vehicle=vehicle, footprint=20).chosen_footprint == 20.0
    assert SearchProblem("square:300", vehicle="rover,detector_width=4").chosen_footprint == 4.0
    assert SearchProblem("square:300").chosen_footprint == 10.0


def test_where_a_vehicle_is_when():
    vehicle = Vehicle(
        cruise_speed=10.0,
        climb_speed=2.0,
        sink_speed=4.0,
        turn_time=6.0,
        wind_speed=5.0,
        wind_from=270.0,
    )
    flown = trajectory(
        [(0, 0, 0), (0, 0, 20), (150, 0, 20), (150, 0, 20), (300, 0, 60), (0, 0, 60), (0, 0, 0)],
        vehicle,
    )
    # 3 s to start, 10 up, a turn, 10 with the wind, no turn where it goes straight on, 20 up, a
    # turn, 60 against the wind, ...
    assert flown.duration == pytest.approx(3 + 10 + 6 + 10 + 20 + 6 + 60 + 6 + 15 + 3)
    assert flown.at([0.0, 8.0, 16.0, 29.0]).tolist() == [
        [0, 0, 0],
        [0, 0, 10],
        [0, 0, 20],
        [150, 0, 20],
    ]
    assert (np.diff(flown.times) >= 0).all()
    slow = trajectory([(0, 0, 0), (100, 0, 0)], Vehicle(cruise_speed=10.0, turn_time=0.0), rate=0.5)
    assert slow.duration == 20


def test_a_rate_below_the_wind_is_refused():
    with pytest.raises(
        InvalidInputError, match="wind_speed: expected less than the cruise_speed of 5 m/s"
    ):
        flight_of(vehicle=Vehicle(cruise_speed=10.0, wind_speed=5.0), home=np.zeros(2), rate=0.5)


def test_planners_reckon_with_the_vehicle():
    """The cost of turns, the time of a cell and the battery, in cells."""
    vehicle = vehicle_of(
        "multirotor,cruise_speed=8,turn_time=5,endurance=20,reserve=0.25,climb_speed=3,sink_speed=1,recharge=4"
    )
    problem = SearchProblem("square:200", robots=2, footprint=20, vehicle=vehicle)
    plan = plan_search(problem)
    assert plan.tour_cost.turn_cost == turn_cells(vehicle, 20.0) == 2.0
    assert plan.cell_seconds == 2.5
    assert working_seconds(vehicle) == 15 * 60 - 10 - 30
    episode = run_search(problem)
    assert episode.scenario.brief.energy == 860 / 2.5
    assert episode.scenario.brief.recharge == (4 * 60 + 40) / 2.5  # down, and up again
    missions = plan_missions(plan)
    back = max(one.start + one.duration(vehicle) for one in missions)
    assert episode.makespan == episode.plan.planned_seconds == pytest.approx(back, rel=1e-4)
    windy = plan_search(problem.replaced(vehicle=vehicle.replaced(wind_speed=4.0, wind_from=90.0)))
    assert windy.cell_seconds == pytest.approx(20 * (1 / 12 + 1 / 4) / 2)


def test_a_smooth_curve_costs_what_it_costs_to_fly():
    """A quarter of a circle in many small bends: the arc at its speed, slower before and faster
    after it, and no stop at all.
    """
    speed, turn = 8.0, 3.2
    vehicle = Vehicle(cruise_speed=speed, turn_time=turn)
    for radius in (0.5, 2.0, 5.0, 10.0, 20.0, 40.0):
        for count in (8, 32, 90):
            angles = np.radians(np.linspace(0.0, 90.0, count + 1))
            around = radius * np.column_stack([np.cos(angles), np.sin(angles)])
            way = np.vstack([[radius, -100.0], around, [-100.0, radius]])
            slow = min(1.0, (radius / (speed * turn)) ** 0.5)
            lost = (1 - slow) ** 2 * turn + np.pi / 2 * radius / speed * (1 / slow - 1)
            flown = trajectory(np.column_stack([way, np.zeros(len(way))]), vehicle)
            least = np.hypot(*np.diff(way, axis=0).T).sum() / speed + turn
            assert least - 1e-9 <= flown.duration <= least + lost + 1e-9
            assert flown.duration == pytest.approx(least + lost, rel=0.02)
    sharp = trajectory([(0, 0, 0), (100, 0, 0), (100, 100, 0)], vehicle)
    assert sharp.duration == pytest.approx(25 + 2 * turn)


def test_legs_shorter_than_the_acceptance_radius_are_merged_outside_the_curve():
    zone = shapely.box(-20, -20, 20, 20).buffer(5, quad_segs=32)
    corner = shapely.get_coordinates(zone.exterior)
    corner = corner[(corner > 19.9).all(axis=1)]
    way = np.vstack([[25.0, -60.0], corner[np.argsort(corner[:, 1])], [-60.0, 25.0]])
    flight = flight_of(
        vehicle=vehicle_of("multirotor"), home=np.array([25.0, -60.0]), link=40.0, blocked=zone
    )
    merged_way = flight.lengthen_short_legs(way)
    assert np.hypot(*np.diff(way, axis=0).T).min() < 0.5
    assert np.hypot(*np.diff(merged_way, axis=0).T).min() > 1.0
    assert (merged_way[[0, -1]] == way[[0, -1]]).all()
    assert shapely.intersection(shapely.linestrings(merged_way), zone.buffer(-0.005)).is_empty
    assert (
        shapely.hausdorff_distance(
            shapely.linestrings(merged_way), shapely.linestrings(way), densify=0.01
        )
        < 0.2
    )


def test_a_short_leg_at_an_end_of_a_way_becomes_longer_where_a_zone_is_in_the_way():
    """A way home that began with a leg of 0.27 m around a zone kept this leg, though the acceptance
    radius was 1 m.
    """
    way = np.array(
        [[4.151, -29.965], [4.143, -29.696], [5.384, -21.892], [9.076, -14.679], [60.0, 20.0]]
    )
    zone = shapely.Polygon([[4.17, -29.965], *way[1:4], [40.0, -20.0]]).buffer(-0.001)
    for there in (way, way[::-1]):
        flight = flight_of(
            vehicle=vehicle_of("multirotor"), home=there[-1], link=40.0, blocked=zone
        )
        found = flight.lengthen_short_legs(there)
        assert np.hypot(*np.diff(found, axis=0).T).min() > 1.0
        assert (found[[0, -1]] == there[[0, -1]]).all()
        assert shapely.intersection(shapely.linestrings(found), zone.buffer(-0.005)).is_empty
        open_way = flight_of(
            vehicle=vehicle_of("multirotor"), home=there[-1], link=40.0
        ).lengthen_short_legs(there)
        assert len(open_way) == len(there) - 1


def test_where_a_way_turns_back_at_a_short_leg_no_point_is_repeated():
    there = [[0.0, 0.0], [40.0, 0.0], [40.0, 0.5], [40.0, 0.0], [80.0, 0.0]]
    beside = shapely.box(10, 0.05, 30, 20)
    flight = flight_of(
        vehicle=vehicle_of("multirotor"), home=np.zeros(2), link=40.0, blocked=beside
    )
    found = flight.lengthen_short_legs(np.array(there))
    assert found.tolist() == [there[0], there[1], there[-1]]


def test_a_start_and_a_stop_take_their_time_also_without_motion():
    """The home and the waypoint of a mission of one point differed by rounding in a plan, and not
    in the file: 2 s and 0 s.
    """
    vehicle = vehicle_of("rover")
    still, rounded = (
        trajectory([(0, 0, 0), (off, 0, 0), (0, 0, 0)], vehicle).duration for off in (0.0, 1e-9)
    )
    assert still == pytest.approx(rounded)
    assert still == vehicle.turn_seconds > 0


def test_no_bend_takes_less_than_no_time():
    """Rounding made the time that is lost in a bend -7e-15 turns, and a search was refused because
    of it.
    """
    for seed in (*range(40), 104, 757, 1078, 1242):
        rng = np.random.default_rng(seed)
        count = int(rng.integers(4, 30))
        headings = np.radians(np.cumsum(rng.uniform(-40, 40, count) * rng.integers(0, 2, count)))
        legs = rng.choice([0.3, 1, 5, 30.0], count)[:, None] * np.column_stack(
            [np.cos(headings), np.sin(headings)]
        )
        way = np.vstack([[0, 0], np.cumsum(legs, axis=0)])
        shares = turn_shares(
            way, reach=float(rng.choice([0.1, 1, 5, 20])), cut=float(rng.choice([0.3, 1.0]))
        )
        assert shares.min() >= 0


@pytest.mark.parametrize("turn", [45.0, -45.0])
def test_rounding_in_files_decides_at_no_bend_whether_a_vehicle_stops(turn):
    """Legs between cells side by side bend by just 45 degrees; the check has them from files."""
    rng, vehicle = np.random.default_rng(0), vehicle_of("multirotor")
    for heading in np.radians(rng.uniform(0, 360, 200)):
        ahead = np.array([heading, heading, heading + math.radians(turn)])
        legs = rng.uniform(10, 300, (3, 1)) * np.column_stack([np.cos(ahead), np.sin(ahead)])
        path = np.vstack([[0.0, 0.0], np.cumsum(legs, axis=0)]) + rng.uniform(-500, 500, 2)
        path = np.column_stack([path, np.full(4, 30.0)])
        planned, read = (trajectory(points, vehicle) for points in (path, path.round(8)))
        assert planned.duration == pytest.approx(read.duration, abs=1e-6)
