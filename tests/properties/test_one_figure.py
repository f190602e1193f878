"""A search with vehicles has one time and one coverage: of its plan, its simulation and its written
missions.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
import shapely
from matplotlib.colors import to_rgb
from tests.soak import often

from shoal.missions import MissionOptions, MissionSet, check_missions, lint
from shoal.search.episode import duration_text
from shoal.search.flight.vehicle import vehicle_of
from shoal.search.planning.plan import end_of, plan_search
from shoal.search.problem import SearchProblem
from shoal.search.problem.network import Crash
from shoal.search.regions.coverage import Image, coverage_check
from shoal.search.regions.projection import LocalFrame
from shoal.search.regions.region import region_of
from shoal.search.run import run
from shoal.views.search.history import robot_colour
from shoal.views.search.page import page_data
from shoal.views.search.timeline import timeline_figure

VEHICLES = (
    "multirotor",
    "multirotor,cruise_speed=8",
    "rover",
    "fixed-wing,turn_radius=30,altitude=60",
)
CAMERA = "altitude=60,sensor_width=13.2,sensor_height=8.8,focal_length=8.8,front_overlap=0.7,side_overlap="


def random_problem(rng, kind):
    """Return a problem with a random region, number of robots, launch points, margin, wind, camera
    and battery.
    """
    angles = np.sort(rng.uniform(0, 2 * np.pi, 8))
    radii = rng.uniform(0.6, 1.0, 8) * rng.uniform(110, 190)
    outline = shapely.Polygon(
        radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    ).convex_hull
    zone = shapely.affinity.translate(shapely.box(-9, -6, 9, 6), *rng.uniform(-30, 30, 2))
    area = outline.difference(zone) if rng.random() < 0.5 else outline
    region = region_of(area, frame=LocalFrame(8.5, 47.4), name="field")
    robots = int(rng.integers(1, 4))
    vehicle, footprint = VEHICLES[kind], float(rng.choice([25, 40]))
    if kind < 2 and rng.random() < 0.5:
        vehicle, footprint = f"{vehicle},{CAMERA}{rng.choice([0, 0.2, 0.4])}", None
    if kind == 0 and rng.random() < 0.5:
        vehicle += ",endurance=5,recharge=2"  # several sorties
    if kind != 2 and rng.random() < 0.4:
        vehicle += f",wind_speed=3,wind_from={rng.integers(360)}"
    options = {"margin": 5.0} if rng.random() < 0.5 else {}
    if kind != 2:
        options["launch"] = [(-200.0 - 15 * robot, 0.0) for robot in range(robots)]
    return SearchProblem(region, robots=robots, footprint=footprint, vehicle=vehicle, **options)


def robot_ends(episode, check):
    """Return the time in seconds at which each robot is back, by the check of the written missions,
    the plan, the simulation, the timeline and the player; shape (5, robots).
    """
    robots = range(len(episode.trace.robots))
    flown = np.zeros(len(robots))
    starts = {one.name: (one.robot - 1, one.start or 0.0) for one in check.missions}
    for flight in check.flights:
        robot, start = starts[flight["mission"]]
        flown[robot] = max(flown[robot], start + flight["duration_s"])
    figure = timeline_figure(episode)
    drawn = np.zeros(len(robots))
    for bars in figure.axes[0].collections:
        for robot in robots:
            if np.allclose(bars.get_facecolor()[0, :3], to_rgb(robot_colour(robot))):
                drawn[robot] = max(
                    drawn[robot], *(path.vertices[:, 0].max() for path in bars.get_paths())
                )
    page = page_data(episode)
    played = [
        max([end for _, end, kind, _ in robot["activities"] if kind == "own"], default=0.0)
        for robot in page["robots"]
    ]
    last = [float(log.times[-1]) if log.times.size else 0.0 for log in episode.trace.robots]
    return np.array(
        [
            flown,
            [end_of(sorties) for sorties in episode.plan.sorties],
            [float(episode.clock(last[robot], robot)) for robot in robots],
            60.0 * drawn,
            page["climb"] + page["cellTime"] * np.array(played),
        ]
    )


def assert_one_time_a_robot(episode, check):
    ends = robot_ends(episode, check)
    np.testing.assert_allclose(ends, np.broadcast_to(ends[0], ends.shape), rtol=0.02)
    assert episode.makespan == pytest.approx(ends[0].max(), rel=0.02)


@pytest.mark.parametrize("seed", range(often(2, 8)))
def test_plan_simulation_timeline_and_missions_agree(seed, tmp_path):
    rng = np.random.default_rng([41, seed])
    problem = random_problem(rng, seed % 4)
    missions = MissionSet.from_problem(problem, MissionOptions(format=("plan", "csv")), seed=seed)
    episode = missions.run()
    missions.write(tmp_path)
    vehicle = vehicle_of(problem.vehicle)
    check = check_missions(tmp_path, problem.place, problem.chosen_footprint, vehicle=vehicle)
    starts = {one.name: one.start for one in check.missions}
    back = max(starts[flight["mission"]] + flight["duration_s"] for flight in check.flights)
    report = episode.report()
    for time in (
        report["makespan_s"],
        report["planned_s"],
        episode.clock(episode.trace.covered_at),
        episode.makespan,
    ):
        assert time == pytest.approx(back, rel=0.02)
    assert_one_time_a_robot(episode, check)
    compared = [one.seconds for one in episode.plan.compared if one.allocation is not None]
    assert not compared or min(compared) == compared[0]
    assert check.coverage.covered_fraction == pytest.approx(
        episode.coverage.covered_fraction, abs=2e-4
    )
    assert check.coverage.covered_fraction > 0.999
    assert not check.errors
    # a bend may lie nearer to the next waypoint than a vehicle comes: a warning, and told
    told = {"transit", "homes-near", "acceptance"}
    assert not {one.rule for one in check.diagnostics} - told


def narrow_problem(rng, kind):
    """Return a problem with more robots than a narrow region has room for, so that most of them
    depart late, or have no mission.
    """
    width, length, angle = rng.uniform(7, 14), rng.uniform(20, 90), rng.uniform(0, 180)
    strip = shapely.affinity.rotate(shapely.box(0, 0, length, width), angle)
    region = region_of(strip, frame=LocalFrame(18.4, 60.1), name="strip")
    options = {"vehicle": ("multirotor,wind_speed=3,wind_from=200", "rover", "multirotor")[kind]}
    if kind == 2:
        reach = 1.3 * length
        middle = np.array(strip.centroid.coords[0])
        options |= {
            "launch": [
                (float(middle[0] + reach), float(middle[1] + 4.0 * robot)) for robot in range(3)
            ],
            "stay_inside": True,
        }
    return SearchProblem(
        region, robots=3 if kind == 2 else int(rng.integers(3, 5)), footprint=8.0, **options
    )


@pytest.mark.parametrize("seed", range(often(2, 6)))
def test_vehicles_that_depart_late_fly_their_own_missions(seed, tmp_path):
    """Other vehicles took waiting ones for lost, and the headline came before the last missions had
    begun.
    """
    problem = narrow_problem(np.random.default_rng([43, seed]), seed % 3)
    missions = MissionSet.from_problem(problem, MissionOptions(format=("plan",)), seed=seed)
    episode = missions.run()
    missions.write(tmp_path)
    assert episode.plan.delays.any()
    check = check_missions(tmp_path, problem.place, 8.0, vehicle=vehicle_of(problem.vehicle))
    assert [one["duration_s"] for one in check.flights] == pytest.approx(
        [one.duration(episode.plan.vehicle) for one in missions.missions], abs=0.05
    )
    back = max((one.start or 0.0) + one.duration(episode.plan.vehicle) for one in missions.missions)
    assert episode.makespan == episode.plan.planned_seconds == pytest.approx(back)
    assert_one_time_a_robot(episode, check)
    assert episode.trace.takeovers == 0
    for robot, log in enumerate(episode.trace.robots):
        assert log.cells.tolist() == episode.plan.stops(robot).tolist()
    assert {one.robot for one in missions.missions} == {
        robot for robot, log in enumerate(episode.trace.robots, 1) if log.cells.size
    }


def test_a_vehicle_lost_before_its_late_departure_is_replaced():
    """That robots wait for the planned departure of another one does not mean that they wait for a
    dead one.
    """
    given = {"robots": 2, "footprint": 10.0, "delays": (0.0, 500.0)}
    well = run(SearchProblem("rectangle:80x20", **given))
    assert [log.cells.size for log in well.trace.robots] == [8, 8]
    assert well.trace.takeovers == 0
    lost = run(SearchProblem("rectangle:80x20", faults=(Crash(2, 20.0),), **given))
    assert lost.status == "complete"
    assert lost.trace.robots[0].cells.size == 16
    assert lost.trace.covered_at < well.trace.covered_at


def test_the_timeline_ends_at_the_headline(tmp_path):
    problem = random_problem(np.random.default_rng(5), 1)
    episode = MissionSet.from_problem(problem, seed=1).run()
    words = " ".join(text.get_text() for text in timeline_figure(episode).axes[0].texts)
    assert "all searched" in words
    assert duration_text(episode.makespan) in episode.reason
    assert (
        duration_text(episode.makespan) in words
        or duration_text(float(episode.clock(max(episode.trace.declared.values())))) in words
    )


@pytest.fixture(scope="module")
def meadow(tmp_path_factory):
    """A field of 180 m by 130 m with a zone, whose margin has round corners of many short legs."""
    outer = [[8.5, 47.4], [8.5024, 47.4], [8.5024, 47.4012], [8.5, 47.4012], [8.5, 47.4]]
    zone = [
        [8.5008, 47.4004],
        [8.5011, 47.4004],
        [8.5011, 47.4006],
        [8.5008, 47.4006],
        [8.5008, 47.4004],
    ]
    features = [
        {
            "type": "Feature",
            "properties": properties,
            "geometry": {"type": "Polygon", "coordinates": [ring]},
        }
        for properties, ring in (({"name": "meadow"}, outer), ({"role": "no-go"}, zone))
    ]
    path = tmp_path_factory.mktemp("meadow") / "field.json"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def test_round_corners_of_a_margin_take_no_stop_each(meadow, tmp_path):
    """Where each of 60 points of the corners was a stop, the best of the compared plans took 7.7
    minutes instead of 2.8.
    """
    vehicle = f"multirotor,cruise_speed=8,endurance=22,{CAMERA}0.3"
    problem = SearchProblem(
        str(meadow),
        robots=2,
        vehicle=vehicle,
        margin=5.0,
        launch="8.4998,47.3999;8.5,47.3998",
        allocation="hop",
    )
    missions = MissionSet.from_problem(problem, MissionOptions(format=("plan",)), seed=0)
    episode = missions.run()
    missions.write(tmp_path)
    assert max(one.duration(episode.plan.vehicle) for one in missions.missions) <= 180
    fixed = plan_search(problem.replaced(tour="spanning-tree").at_place(problem.place))
    assert plan_search(problem).planned_seconds <= fixed.planned_seconds
    assert "acceptance" not in {one.rule for one in lint(tmp_path, problem.place)}


def test_what_a_camera_sees_is_one_figure(meadow, tmp_path):
    """The check found 98.5 % of what the plan called seen: its squares had another angle."""
    vehicle = f"multirotor,cruise_speed=8,endurance=22,{CAMERA}0.3"
    problem = SearchProblem(str(meadow), robots=3, vehicle=vehicle)
    missions = MissionSet.from_problem(problem, MissionOptions(format=("plan",)), seed=0)
    episode = missions.run()
    missions.write(tmp_path)
    check = check_missions(tmp_path, str(meadow), problem.chosen_footprint, vehicle=vehicle)
    assert check.coverage.covered_fraction == pytest.approx(
        episode.coverage.covered_fraction, abs=1e-5
    )
    assert check.coverage.covered_fraction > 0.9999
    assert not check.diagnostics


def test_an_image_turns_with_its_vehicle():
    wide = Image(across=1.5, along=1.0)
    square = region_of(shapely.box(-100, -100, 100, 100))
    for angle in (0.0, 30.0, 77.0):
        way = 30 * np.array([(0.0, 0.0), (np.cos(np.radians(angle)), np.sin(np.radians(angle)))])
        seen = coverage_check(square, [way], 20.0, image=wide)
        # as wide as 1.5, as long as the leg and 1
        assert 40_000 - seen.uncovered_m2 == pytest.approx(30 * (30 + 20), rel=1e-6)
    north = coverage_check(
        square, [[(0.0, 0.0), (30.0, 0.0)]], 20.0, image=Image(1.5, 1.0, yaw=0.0)
    )
    assert 40_000 - north.uncovered_m2 == pytest.approx(20 * (30 + 30), rel=1e-6)
