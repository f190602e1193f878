"""Deconfliction: separation of vehicles in flight, landings, delays, fence and rally points, as
other programs read them.
"""

from __future__ import annotations

import json
from dataclasses import replace
from unittest import mock

import numpy as np
import pytest
import shapely
from tests.missions import flight_of, missions_of
from tests.reference.missions import read_beside, read_plan

from shoal.cli import run as command
from shoal.core import notices
from shoal.core.errors import InvalidInputError
from shoal.missions import (
    Mission,
    MissionSet,
    check_missions,
    lint,
    read_mission,
    write_missions,
)
from shoal.missions.approach import airspace_of, missions_approach
from shoal.missions.deconfliction import plan_missions
from shoal.missions.fence import Fence, fence_of
from shoal.search import LocalFrame, open_region
from shoal.search.flight import separation
from shoal.search.flight.separation import Separation, conflicts, nearest_approach, stagger_starts
from shoal.search.flight.timing import Trajectory, trajectory
from shoal.search.flight.vehicle import vehicle_of
from shoal.search.planning.plan import plan_search
from shoal.search.problem import SearchProblem
from shoal.search.regions.region import region_of
from shoal.views.search.missions import missions_figure

OUTLINE = [[8.5, 47.4], [8.504, 47.4], [8.504, 47.402], [8.5, 47.402], [8.5, 47.4]]
ZONE = [[8.501, 47.4008], [8.5016, 47.4008], [8.5016, 47.4012], [8.501, 47.4012], [8.501, 47.4008]]


def random_flight(rng, legs=6):
    """Return a flight with hovering, on a few levels, of which some legs are on one line with those
    of others.
    """
    points = np.column_stack(
        [
            20.0 * rng.integers(0, 4, (legs, 2)) + rng.choice([0.0, 3.0]),
            rng.choice([28.0, 30, 33, 36], legs),
        ]
    )
    still = rng.random(legs - 1) < 0.2
    for leg in np.flatnonzero(still):
        points[leg + 1] = points[leg]
    return Trajectory(np.concatenate([[0.0], np.cumsum(rng.uniform(1, 12, legs - 1))]), points)


def sampled(one, other, later, late, vertical):
    """Return the least horizontal distance at many moments."""
    times = np.linspace(0, one.duration, 300)
    theirs = times - later - late
    both = (theirs >= 0) & (theirs <= other.duration)
    apart = np.abs(one.at(times) - other.at(theirs))
    both &= apart[:, 2] < vertical - 0.01
    return np.hypot(*apart[both, :2].T).min(initial=np.inf)


def test_the_nearest_approach_is_at_most_that_of_any_sample_and_is_one():
    rng = np.random.default_rng(5)
    for _ in range(40):
        one, other, later = random_flight(rng), random_flight(rng), rng.uniform(-15, 15)
        found = nearest_approach(one, other, vertical=5.0, later=later, tolerance=4.0)
        least = min(sampled(one, other, later, late, 5.0) for late in np.linspace(-4, 4, 17))
        if found is None:
            assert least == np.inf
            continue
        assert found.horizontal <= least + 1e-9
        assert found.horizontal > least - 4  # nothing that no sample is near
        places = np.stack([one.at(found.times[0]), other.at(found.times[1])])
        assert np.allclose(places, found.places, atol=1e-6)
        assert np.hypot(*(places[0] - places[1])[:2]) == pytest.approx(found.horizontal, abs=1e-6)
        assert abs(places[0, 2] - places[1, 2]) == pytest.approx(found.vertical, abs=1e-6)
        assert abs(found.times[0] - found.times[1] - later) <= 4 + 1e-6


def test_conflicts_are_the_delays_at_which_two_vehicles_are_too_near():
    rng = np.random.default_rng(6)
    met = 0
    for _ in range(30):
        one, other = random_flight(rng), random_flight(rng)
        barred = conflicts(one, other, horizontal=8.0, vertical=5.0)
        for later in rng.uniform(-40, 40, 8):
            found = nearest_approach(one, other, vertical=5.0, later=later)
            near = found is not None and found.horizontal < 8.0 - 1e-6
            edge = np.abs(barred - later).min(initial=np.inf) < 1e-3
            assert edge or near == ((barred[:, 0] < later) & (later < barred[:, 1])).any()
            met += near
    assert met > 20


def with_turns(flown, factor):
    """Return a flight that stands for other times."""
    lasts = np.diff(flown.times)
    lasts[~np.diff(flown.points, axis=0).any(axis=1)] *= factor
    return Trajectory(np.concatenate([[0.0], np.cumsum(lasts)]), flown.points)


def test_conflicts_are_those_of_all_times_of_turns():
    rng = np.random.default_rng(8)
    met = 0
    for _ in range(30):
        one, other = random_flight(rng), random_flight(rng)
        uncertain = [replace(flown, turns=(0.0, 1.25)) for flown in (one, other)]
        barred = conflicts(*uncertain, horizontal=8.0, vertical=5.0)
        for later, factor in zip(rng.uniform(-40, 40, 8), rng.uniform(0, 1.25, 8), strict=True):
            flights = with_turns(one, factor), with_turns(other, factor)
            found = nearest_approach(*flights, vertical=5.0, later=later)
            near = found is not None and found.horizontal < 8.0 - 1e-3
            assert not near or ((barred[:, 0] < later) & (later < barred[:, 1])).any()
            met += near
    assert met > 20


@pytest.fixture(scope="module")
def six_robots():
    """Missions of six robots, among which two came within 2.4 m of each other with turns of half
    the time.
    """
    return MissionSet.from_problem(
        SearchProblem("ring:90x29", robots=6, footprint=10, vehicle="multirotor,endurance=6")
    )


@pytest.mark.parametrize("factor", [0.0, 0.25, 0.5, 0.75, 1.0, 1.25])
def test_vehicles_keep_apart_whatever_their_turns_take(six_robots, factor):
    missions = six_robots
    vehicle, required = missions.plan.vehicle, missions.options.required_separation
    turning = vehicle.replaced(turn_time=factor * vehicle.turn_seconds)
    near = missions_approach(missions.missions, required, None, vehicle=turning)
    assert near is None or near.horizontal >= required.horizontal - 0.005


@pytest.fixture(scope="module")
def region(tmp_path_factory):
    path = tmp_path_factory.mktemp("field") / "field.json"
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [OUTLINE]}))
    return open_region(path, no_go=[np.array(ZONE)])


@pytest.fixture(scope="module")
def team(region):
    """A plan of five robots from one launch point outside, its missions with a rally point, and
    their separation.
    """
    problem = SearchProblem(
        region, robots=5, footprint=20, margin=4, launch=[(-200, 0)], vehicle="multirotor"
    )
    plan = plan_search(problem, seed=3)
    separation = Separation()
    return (
        plan,
        plan_missions(plan, separation=separation, rally=np.array([(-220.0, 40.0)])),
        separation,
    )


def simulated(missions, frame, late, climb):
    """Return the least distances of vehicles that follow missions at constant speed, by small
    steps: (both, least).
    """
    flown = []
    for mission, wait in zip(missions, late, strict=True):
        home, *way = frame.to_metres(np.vstack([mission.home, mission.waypoints, mission.landing]))
        high = mission.altitude
        points = np.array(
            [[*home, 0.0], [*home, high], *([*point, high] for point in way), [*way[-1], 0.0]]
        )
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        rises = np.abs(np.diff(points[:, 2])) > 0
        times = (
            (mission.start or 0.0)
            + wait
            + np.concatenate([[0.0], np.cumsum(lengths / np.where(rises, climb, mission.speed))])
        )
        flown.append((times, points))
    clock = np.arange(0.0, max(times[-1] for times, _ in flown), 0.25)
    places = [
        np.stack([np.interp(clock, times, points[:, axis]) for axis in range(3)], axis=1)
        for times, points in flown
    ]
    aloft = [(times[0] <= clock) & (clock <= times[-1]) for times, _ in flown]
    worst = np.inf
    for k in range(len(flown)):
        for j in range(k):
            apart = np.abs(places[k] - places[j])[aloft[k] & aloft[j]]
            low = apart[:, 2] < 5 - 1e-3
            worst = min(worst, np.hypot(*apart[low, :2].T).min(initial=np.inf))
    return worst


def test_vehicles_keep_apart_in_a_simulation_of_their_files_with_random_delays(
    team, region, tmp_path
):
    plan, missions, separation = team
    assert len(missions) == 5
    paths = [
        path
        for path in write_missions(missions, tmp_path, formats=["plan"])
        if path.suffix == ".plan"
    ]
    read = [read_mission(path) for path in paths]
    rng = np.random.default_rng(1)
    for _ in range(20):
        assert (
            simulated(read, region.frame, rng.uniform(0, 10, 5) * rng.integers(0, 2, 5), 5.0)
            > 10 - 0.05
        )
    near = missions_approach(read, separation, region.frame)
    assert near.horizontal >= 10 - 0.005
    assert (
        missions_approach(read, separation, region.frame, vehicle=plan.vehicle).horizontal
        >= 10 - 0.005
    )
    at_once = [replace(mission, start=0.0) for mission in read]
    # they all climb at one place
    assert missions_approach(at_once, separation, region.frame).horizontal < 1


def test_a_planted_conflict_is_found_with_its_time_place_and_robots(region, tmp_path):
    home, other = (8.5005, 47.4003), (8.5035, 47.4003)
    lanes = [home, other]
    there = Mission(lanes, home, robot=1, landing=home)
    back = Mission(lanes[::-1], other, robot=4, landing=other, altitude=33.0)
    write_missions([there, back], tmp_path, formats=["plan"])
    separation = Separation(10.0, 5.0, 0.0)
    near = check_missions(tmp_path, region, None, separation=separation).approach
    assert near.robots == (1, 4)
    assert near.horizontal < 0.01
    assert near.vertical == pytest.approx(3.0)
    length = np.hypot(*np.diff(region.frame.to_metres(np.array(lanes)), axis=0)[0])
    assert near.time == pytest.approx(30 / 5 + length / 2 / 5, abs=1.0)
    assert np.allclose(region.frame.to_degrees(near.place[None, :2]), [(8.502, 47.4003)], atol=1e-4)
    write_missions([there, replace(back, altitude=35.0)], tmp_path, formats=["plan"])
    apart = check_missions(tmp_path, region, None, separation=separation).approach
    assert apart is None or apart.horizontal > 10  # a layer more
    write_missions([there, replace(back, start=400.0)], tmp_path, formats=["plan"])
    assert check_missions(tmp_path, region, None, separation=separation).approach is None


def test_few_layers_and_layers_that_are_settled():
    def flight(x):
        points = np.array(
            [(0, 0, 0), (0, 0, 30), (x, 400, 30), (x, 0, 30), (0, 0, 30), (0, 0, 0)], dtype=float
        )
        times = np.concatenate(
            [[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1) / 5)]
        )
        return lambda layer: [
            Trajectory(times, points + np.array([0, 0, 5.0 * layer]) * (points[:, 2:] > 0))
        ]

    flights = [flight(100.0 * k) for k in range(4)]
    layers, delays = stagger_starts(flights, Separation())
    assert layers.max() <= 1
    assert len({*delays}) == 4
    again, waits = stagger_starts([*flights, lambda layer: []], Separation(), [0, 1, 2, 3, 0])
    assert again.tolist() == [0, 1, 2, 3, 0]
    assert waits[4] == 0
    for found, starts in ((layers, delays), (again, waits)):
        for k in range(4):
            for j in range(k):
                one, other = flights[k](found[k])[0], flights[j](found[j])[0]
                near = nearest_approach(
                    one, other, vertical=5.0, later=starts[j] - starts[k], tolerance=10.0
                )
                assert near is None or near.horizontal >= 10


def test_pairs_of_legs_are_tested_before_too_many_are_gathered(monkeypatch):
    """40 vehicles took more than a gibibyte."""
    rng = np.random.default_rng(14)
    flown = [random_flight(rng, 20) for _ in range(12)]
    flights = [lambda layer, flight=flight: [flight] for flight in flown]
    _, delays = stagger_starts(flights, Separation(), [0] * 12)
    gathered, barred_delays = [], separation._barred_delays

    def counted(near, *arguments):
        gathered.append(sum(len(pairs[2]) for pairs in near))
        return barred_delays(near, *arguments)

    monkeypatch.setattr(separation, "_TOGETHER", 100)
    monkeypatch.setattr(separation, "_barred_delays", counted)
    assert stagger_starts(flights, Separation(), [0] * 12)[1].tolist() == delays.tolist()
    assert max(gathered) <= 100 + 19 * 19
    assert sum(gathered) > 10 * max(gathered)


def test_fence_and_rally_points_are_read_by_other_programs(team, region, tmp_path):
    from pymavlink import mavutil, mavwp

    _, missions, _ = team
    written = write_missions(missions, tmp_path, formats=["plan", "wpl"])
    assert {"fence.txt", "rally.txt"} <= {path.name for path in written}
    fence = missions[0].fence
    ways = [mission.path_in(region.frame)[:, :2] for mission in missions]
    area = fence.area(region.frame)
    assert all(area.buffer(0.01).covers(shapely.linestrings(way)) for way in ways)
    assert area.intersection(region.no_go).area < 1
    assert [len(ring) for ring in fence.exclusions] == [4]
    data = json.loads((tmp_path / "robot-01.plan").read_text())
    read_plan(tmp_path / "robot-01.plan")
    polygons = data["geoFence"]["polygons"]
    assert [polygon["inclusion"] for polygon in polygons] == [True, False]
    assert np.allclose(np.array(polygons[0]["polygon"])[:, ::-1], fence.inclusion, atol=1e-8)
    (point,) = data["rallyPoints"]["points"]
    assert np.allclose(region.frame.to_metres([point[1::-1]]), (-220, 40), atol=0.01)
    assert mavutil.mavlink20()
    items = read_beside(tmp_path / "fence.txt", mavwp.MissionItemProtocol_Fence())
    assert [item[0] for item in items] == [5001] * len(fence.inclusion) + [5002] * 4
    assert [item[1] for item in items] == [len(fence.inclusion)] * len(fence.inclusion) + [4] * 4
    assert np.allclose([item[2:] for item in items], np.vstack(fence.rings), atol=1e-5)
    (rally,) = read_beside(tmp_path / "rally.txt", mavwp.MissionItemProtocol_Rally())
    assert rally[0] == 5100
    assert lint(tmp_path, region) == []
    write_missions(
        [replace(one, fence=None, rally=()) for one in missions], tmp_path, formats=["wpl"]
    )
    assert not (tmp_path / "fence.txt").exists()


@pytest.mark.parametrize("suffix", [".plan", ".waypoints", ".geojson", ".kml", ".gpx", ".csv"])
@pytest.mark.parametrize("kind", ["multirotor", "rover"])
def test_every_format_holds_start_and_landing(suffix, kind, tmp_path):
    altitude = 30.0 if kind == "multirotor" else 0.0
    mission = Mission(
        [(8.5, 47.4), (8.501, 47.4)],
        (8.499, 47.4),
        kind=kind,
        altitude=altitude,
        landing=(8.502, 47.401),
        start=37.0,
        robot=2,
    )
    write_missions([mission], tmp_path)
    read = read_mission(tmp_path / f"robot-02{suffix}")
    assert read.start == 37.0  # of `.plan` and `.waypoints`, the list of the folder holds it
    assert read.home == (8.499, 47.4)
    assert read.landing == pytest.approx((8.502, 47.401))
    assert len(read.waypoints) == 2
    assert lint(tmp_path) == []


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_no_vehicle_waits_armed_on_the_ground(autopilot, tmp_path):
    """Autopilots disarm a vehicle that is armed and does not take off: the first item is the
    take-off, however late the start.
    """
    late = Mission([(8.5, 47.4), (8.501, 47.4)], (8.499, 47.4), start=159.0, autopilot=autopilot)
    write_missions([late, replace(late, robot=2, start=0.0)], tmp_path)
    items = json.loads((tmp_path / "robot-01.plan").read_text())["mission"]["items"]
    assert items[0]["command"] == 22
    assert 93 not in {item["command"] for item in items}
    rows = [
        line.split("\t") for line in (tmp_path / "robot-01.waypoints").read_text().splitlines()[1:]
    ]
    assert [row[3] for row in rows][:2] == ["16", "22"]
    for suffix in (".geojson", ".kml", ".gpx", ".csv"):
        assert "start_s" in (tmp_path / f"robot-01{suffix}").read_text()
        assert "delay" not in (tmp_path / f"robot-01{suffix}").read_text()
    starts = (tmp_path / "starts.txt").read_text().splitlines()
    assert [line.split()[:2] for line in starts[-2:]] == [
        ["0:00:00", "robot-02"],
        ["0:02:39", "robot-01"],
    ]
    assert json.loads((tmp_path / "missions.json").read_text())["starts_s"] == {
        "robot-01": 159.0,
        "robot-02": 0.0,
    }
    assert lint(tmp_path) == []


def test_a_wait_before_the_take_off_is_a_mistake(tmp_path):
    write_missions(
        [Mission([(8.5, 47.4), (8.501, 47.4)], (8.499, 47.4))], tmp_path, formats=["plan", "wpl"]
    )
    plan = json.loads((tmp_path / "robot-01.plan").read_text())
    wait = {
        **plan["mission"]["items"][1],
        "command": 93,
        "frame": 2,
        "params": [159, -1, -1, -1, 0, 0, 0],
    }
    plan["mission"]["items"].insert(0, wait)
    (tmp_path / "robot-01.plan").write_text(json.dumps(plan))
    assert "armed-wait" in {one.rule for one in lint(tmp_path / "robot-01.plan")}
    table = tmp_path / "robot-01.waypoints"
    head, home, *rest = table.read_text().splitlines()
    table.write_text("\n".join([head, home, "1\t0\t2\t93\t159\t-1\t-1\t-1\t0\t0\t0\t1", *rest, ""]))
    assert "armed-wait" in {one.rule for one in lint(table)}


def test_the_command_writes_and_checks_it_all(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "field.json").write_text(json.dumps({"type": "Polygon", "coordinates": [OUTLINE]}))
    (tmp_path / "rally.csv").write_text("longitude,latitude\n8.499,47.399\n")
    search = (
        "search field.json --robots 3 --footprint 40 --launch 8.499,47.401 --land 8.505,47.401"
        " --missions m --format plan"
    )
    assert command([*search.split(), "--rally", "rally.csv", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["missions"]
    assert told["nearest_approach"] is None or told["nearest_approach"]["horizontal_m"] >= 10
    assert (
        len(
            {start["start_s"] for start in told["starts"]}
            | {start["altitude_m"] for start in told["starts"]}
        )
        > 1
    )
    assert command(["missions", "check", "m", "field.json", "--footprint", "40", "--json"]) == 0
    seen = json.loads(capsys.readouterr().out)
    assert seen["covered_fraction"] > 0.999
    assert seen["errors"] == 0
    assert command([*search.split(), "--separation", "0"]) == 0
    capsys.readouterr()
    assert command(["missions", "check", "m", "field.json", "--footprint", "40"]) == 1
    assert "come within" in capsys.readouterr().err
    for words, said in (
        ("--separation 1,2,3", "--separation: expected HORIZONTAL"),
        ("--delay-tolerance -1", "expected"),
    ):
        assert command([*search.split(), *words.split()]) == 2
        assert said in capsys.readouterr().err


def test_the_map_has_what_its_legend_names(team, region):
    _, missions, separation = team
    drawn = missions_figure(missions, region, missions_approach(missions, separation, region.frame))
    named = [text.get_text() for text in drawn.legends[0].get_texts()]
    flown = sorted((mission.robot, mission.altitude) for mission in missions)
    assert [name for name in named if name.startswith("robot ")] == [
        f"robot {robot} at {up:g} m" for robot, up in flown
    ]
    assert "hole" not in named  # the no-go zone makes one
    assert {"launch", "rally point", "no-go zone", "fence", "out and home"} <= {*named}
    (axes,) = drawn.axes
    written = [text.get_text() for text in axes.texts]
    assert "1\N{EN DASH}5" in written  # all set out from one place
    assert ("robots" in axes.get_title(loc="left")) == ("nearest approach" in named)
    low, high = np.array([axes.get_xlim(), axes.get_ylim()]).T
    assert all(
        (
            (low < mission.path_in(region.frame)[:, :2])
            & (mission.path_in(region.frame)[:, :2] < high)
        ).all()
        for mission in missions
    )


def test_a_rally_point_in_a_no_go_zone_is_refused(team, region):
    inside = region.frame.to_metres([(8.5013, 47.401)])
    with pytest.raises(InvalidInputError, match="rally: expected points outside of no-go zones"):
        plan_missions(team[0], rally=inside)
    with pytest.raises(InvalidInputError, match="rally: expected points within 50 km"):
        plan_missions(team[0], rally=np.array([(60_000.0, 0.0)]))
    with pytest.raises(InvalidInputError, match="rally: expected one point or more, got none"):
        plan_missions(team[0], rally=np.zeros((0, 2)))


@pytest.mark.parametrize("most", [64, 30])
def test_fences_with_too_many_corners_are_made_simpler_outwards(most):
    """The plan stays inside, and zones stay barred; a zone that would come over a way keeps its
    corners.
    """
    region = region_of(
        shapely.Point(0, 0).buffer(300, quad_segs=40),
        no_go=shapely.Point(60, 0).buffer(30, quad_segs=10),
    )
    ways = [np.array([(-250.0, 0.0), (26.0, 0.0), (26.0, 200.0)])]
    whole, thin = fence_of(region, ways), fence_of(region, ways, most=most)
    assert sum(map(len, whole.rings)) > 64 >= most >= sum(map(len, thin.rings))
    outer, zone = (shapely.Polygon(ring) for ring in thin.rings)
    assert outer.covers(region.outline)
    assert zone.covers(shapely.Polygon(whole.exclusions[0]))
    assert thin.area(None).covers(shapely.linestrings(ways[0]))
    assert outer.area < 1.3 * region.outline.convex_hull.area


def test_a_zone_over_the_border_is_an_exclusion_zone_and_no_notch():
    """A zone over the border is cut out of the outline of the region; the outline of the fence does
    not need these corners.
    """
    outline = shapely.Polygon([(-6, -174), (-189, -25), (86, 166), (144, 167), (148, -85)])
    region = region_of(outline, no_go=shapely.Polygon([(-99, 66), (97, 57), (-37, 41)]))
    fence = fence_of(region, [], most=64)
    assert len(fence.exclusions) == 1
    assert fence.area(None).symmetric_difference(region.outline).area < 1e-6


def test_a_fence_that_cannot_be_made_so_simple_is_told(monkeypatch):
    told = []
    monkeypatch.setattr(notices, "listeners", [told.append])
    posts = shapely.union_all(
        [shapely.box(x, y, x + 1, y + 1) for x in range(10, 90, 16) for y in range(10, 90, 16)]
    )
    fence = fence_of(region_of(shapely.box(0, 0, 100, 100), no_go=posts), [], most=64)
    assert 60 < sum(map(len, fence.rings)) <= 64
    assert told[0].startswith("fence: 5 of 25 no-go zones and holes are no exclusion polygons")


@pytest.fixture(scope="module")
def wing():
    return plan_search(
        SearchProblem(
            "rectangle:300x150",
            robots=2,
            footprint=50,
            margin=5,
            vehicle="fixed-wing,turn_radius=30",
        )
    )


@pytest.mark.parametrize("airspace", [None, 30.0])
def test_turns_stay_in_the_airspace_and_the_fence_contains_them(wing, airspace, tmp_path):
    region = wing.grid.region
    missions = plan_missions(wing, separation=None if airspace else Separation(), airspace=airspace)
    if not airspace:  # they loiter side by side until the last one is down
        assert [one.loiter for one in missions] == [pytest.approx(30.3)] * 2
        assert (
            missions_approach(missions, Separation(), None, vehicle=wing.vehicle).horizontal
            >= 10 - 0.005
        )
    needed = airspace_of(missions, region)
    assert (needed > 30) == (airspace is None)
    assert all(
        one.fence.area(None).covers(shapely.linestrings(one.path_in(None)[:, :2]))
        for one in missions
    )
    assert all(
        one.fence.area(None).covers(shapely.linestrings(one.circle_in(None)))
        for one in missions
        if one.loiter
    )
    if not airspace:
        drawn = missions_figure(missions, region)
        named = [text.get_text() for text in drawn.legends[0].get_texts()]
        assert "loiter circle" in named
        assert {name for name in named if name.startswith("at ")} <= {
            "at 80 m",
            "at 85 m",
        }, "no colour for each height of a climb"
        rings = [
            line.get_xydata()
            for line in drawn.axes[0].lines
            if len(line.get_xydata()) == len(missions[0].circle_in(None))
        ]
        assert all(
            any(np.array_equal(one.circle_in(None), ring) for ring in rings) for one in missions
        )
    write_missions(missions, tmp_path)
    result = check_missions(tmp_path, region, 50.0, vehicle=wing.vehicle, airspace=airspace)
    assert not result.errors
    assert result.coverage.covered_fraction > 0.9999
    assert {one.rule for one in result.diagnostics} == ({"transit"} if airspace is None else set())
    found = lint(
        tmp_path, region, vehicle=vehicle_of("fixed-wing,turn_radius=35"), airspace=needed - 1
    )
    assert {one.rule for one in found} == {"airspace", "turn-radius"}


def test_turns_keep_the_margin_to_no_go_zones():
    """Where a row ends at the margin of a zone its end is passed in other directions."""
    region = region_of(shapely.box(0, 0, 300, 150), no_go=shapely.box(120, 50, 170, 100))
    plan = plan_search(
        SearchProblem(
            region, robots=1, footprint=50, margin=15, vehicle="fixed-wing,turn_radius=30"
        )
    )
    (mission,) = plan_missions(plan)
    assert (
        shapely.distance(region.no_go, shapely.linestrings(mission.path_in(None)[:, :2]))
        > 15 - 0.01
    )


@pytest.mark.parametrize("suffix", [".plan", ".waypoints", ".geojson", ".kml", ".gpx", ".csv"])
def test_every_format_holds_loiter_and_landings_of_fixed_wings(suffix, tmp_path):
    home = (8.499, 47.4)
    away = Mission(
        [(8.5, 47.4), (8.51, 47.4)],
        home,
        kind="fixed-wing",
        altitude=80.0,
        loiter=40.4,
        takeover=95.0,
        start=12.0,
    )
    down = replace(away, robot=2, loiter=None, landing=(8.5, 47.401))
    write_missions([away, down], tmp_path)
    read = [read_mission(tmp_path / f"robot-0{robot}{suffix}") for robot in (1, 2)]
    assert [one.loiter for one in read] == [40.4, None]
    assert read[0].landing == pytest.approx(home)
    assert [one.glides for one in read] == [False, True]
    assert lint(tmp_path) == []
    if suffix == ".plan":  # the circle must lie inside the fence, too
        narrow = Fence(
            np.array([(8.49, 47.3998), (8.52, 47.3998), (8.52, 47.4002), (8.49, 47.4002)])
        )
        with pytest.raises(InvalidInputError, match="got the last circle 159 m outside the fence"):
            write_missions([replace(away, fence=narrow)], tmp_path / "narrow", formats=["plan"])
        with mock.patch("shoal.missions.files._check_written"):  # as another program writes it
            write_missions([replace(away, fence=narrow)], tmp_path / "narrow", formats=["plan"])
        assert [
            (one.rule, "in its last circle" in one.sentence) for one in lint(tmp_path / "narrow")
        ] == [("fence", True)]
    if suffix not in (".plan", ".waypoints"):
        assert [(one.takeover, one.start) for one in read] == [(95.0, 12.0)] * 2


def test_a_fixed_wing_lands_against_the_wind_on_a_slope_that_it_can_sink():
    wing = vehicle_of("fixed-wing,wind_speed=5,wind_from=90")
    lanes = [(0, 0), (900, 0), (900, 60), (0, 60)]
    (free,) = missions_of(lanes, None, vehicle=wing, landing=(100, -50))
    descent = free.path_in(None)[-2:]
    assert descent[-1].tolist() == [100, -50, 0]
    # 11 m/s over ground, 2 m/s down
    assert descent[0].tolist() == pytest.approx([100 - 11 * 80 / 2, -50, 80])
    (other,) = missions_of(
        lanes, None, vehicle=wing, landing=(100, -50), blocked=shapely.box(-200, -60, -150, -40)
    )
    aside = other.path_in(None)[-2]
    assert aside[1] != pytest.approx(-50)
    # less wind from ahead: faster over ground
    assert np.hypot(*(aside[:2] - (100, -50))) / 80 * 2 > 11
    # between the last waypoint and the approach, which is then begun over the landing point
    wall = shapely.box(-150, 0, -130, 250)
    (over,) = missions_of(
        [*lanes[:3], (200, -200)], None, vehicle=wing, landing=(100, 300), blocked=wall
    )
    assert not shapely.linestrings(over.path_in(None)[:, :2]).intersects(wall)
    assert (
        flight_of(vehicle=wing, home=np.zeros(2), ending="land")
        .trajectory(np.array([(-440.0, 0.0, 80.0)]))
        .points[-2, 2]
        == 80
    )


def test_a_fixed_wing_takes_off_against_the_wind_on_a_slope_that_it_can_climb(tmp_path):
    wing, lanes = (
        vehicle_of("fixed-wing,wind_speed=5,wind_from=90"),
        [(900, 0), (1800, 0), (1800, 60), (900, 60)],
    )
    (free,) = missions_of(lanes, None, home=(0, 0), vehicle=wing)
    far = 11 * 80 / 3  # 11 m/s over ground, 3 m/s up
    assert free.path_in(None)[:3] == pytest.approx(np.array([(0, 0, 0), (0, 0, 0), (far, 0, 80)]))
    assert trajectory(free.path_in(None)[:3], wing).duration == pytest.approx(80 / 3)
    write_missions([free], tmp_path)
    assert not lint(tmp_path, vehicle=wing)
    assert {
        one.rule
        for one in lint(
            tmp_path, vehicle=vehicle_of("fixed-wing,wind_speed=5,wind_from=90,climb_speed=2.9")
        )
    } == {"climb"}
    (aside,) = missions_of(
        lanes, None, home=(0, 0), vehicle=wing, blocked=shapely.box(100, -10, 120, 10)
    )
    assert not shapely.linestrings(aside.path_in(None)[:, :2]).intersects(
        shapely.box(100, -10, 120, 10)
    )
    (near,) = missions_of(
        [(-40, 0), (-900, 0)], None, home=(0, 0), vehicle="fixed-wing,turn_radius=20"
    )  # nearer up in circles
    assert near.heights_above_home[0] == pytest.approx(40)
    assert near.waypoints[:30, 0].min() > -16 * 40 / 3 - 50
    around = shapely.box(-20, -20, 20, 20).boundary.buffer(1)
    with pytest.raises(
        InvalidInputError,
        match=(
            "launch: expected a path without no-go zones and higher ground, on which the vehicle"
            " climbs by"
        ),
    ):
        missions_of(lanes, None, home=(0, 0), vehicle=wing, blocked=around)


@pytest.mark.parametrize("suffix", [".plan", ".waypoints"])
def test_a_multirotor_climbs_over_home_as_high_as_its_file_says(suffix, tmp_path):
    """And then on the way to the first waypoint, for files of others."""
    (mission,) = missions_of(
        [(60, 0), (60, 80)], LocalFrame(8.5, 47.4), home=(0, 0), vehicle="multirotor"
    )
    ways = []
    for take_off in (None, 10.0, 45.0):
        write_missions([replace(mission, take_off=take_off)], tmp_path)
        read = read_mission(tmp_path / f"robot-01{suffix}")
        assert read.take_off == take_off
        ways.append(read.path_in(LocalFrame(8.5, 47.4))[:3])
    assert [way[1, 2] for way in ways] == [30, 10, 45]
    assert all(way[2, 2] == 30 and np.abs(way[0]).max() < 0.01 for way in ways)
    assert (
        trajectory(ways[1], vehicle_of("multirotor")).duration
        < trajectory(ways[0], vehicle_of("multirotor")).duration
    )


def test_later_sorties_begin_when_their_vehicle_is_back(region):
    """Each when it is recharged and others leave it room, not when all have landed; simulated with
    random delays.
    """
    small = "multirotor,endurance=6,recharge=1"
    problem = SearchProblem(
        region, robots=3, footprint=20, launch=[(-120, 0)], delays=(0, 200, 400), vehicle=small
    )
    plan, separation = plan_search(problem, seed=3), Separation()
    missions = plan_missions(plan, separation=separation)
    assert max(one.sortie for one in missions) > 1
    ends = {}
    for one in missions:
        flight = trajectory(
            one.path_in(region.frame), plan.vehicle, rate=one.speed / plan.vehicle.cruise
        )
        since = one.start or 0.0
        before = ends.get((one.robot, one.sortie - 1))
        assert before is None or since >= before + 60 + separation.delay
        ends[one.robot, one.sortie] = since + flight.duration
    assert any(
        one.sortie > 1 and one.start < max(end for (_, n), end in ends.items() if n < one.sortie)
        for one in missions
    )
    assert (
        missions_approach(missions, separation, region.frame, vehicle=plan.vehicle).horizontal
        >= 10 - 0.005
    )
    rng = np.random.default_rng(2)
    shifted = missions
    crossing = [(a, b) for a in shifted for b in shifted if a.robot < b.robot]
    for _ in range(3):
        late = {one.name: rng.uniform(0, 10) for one in shifted}
        for a, b in crossing:
            assert simulated([a, b], region.frame, [late[a.name], late[b.name]], 5.0) > 10 - 0.05


def test_layers_for_takeovers_are_apart_from_all_others(team):
    _, missions, separation = team
    takeovers = sorted(one.takeover for one in missions if one.sortie == 1)
    assert np.diff([max(one.altitude for one in missions), *takeovers]).min() >= separation.vertical


def slope(folder):
    """Write ground that rises from 500 m in the west by 1 m per 3 m eastwards, around the field."""
    rows = " ".join(f"{500 + 25 * column}" for column in range(41))
    head = "ncols 41\nnrows 41\nxllcorner 8.49\nyllcorner 47.38\ncellsize 0.001\n"
    (folder / "slope.asc").write_text(head + f"{rows}\n" * 41)


@pytest.mark.parametrize(
    ("vehicle", "words"),
    [
        ("multirotor,altitude=900", "sea"),
        ("multirotor,altitude=450", "home"),
        ("multirotor", "ground"),
    ],
)
def test_rally_points_are_as_high_as_the_vehicles(tmp_path, monkeypatch, capsys, vehicle, words):
    """Heights of rally points count from home in each frame: 900 m above the sea were 900 m above
    home, and 30 m above ground were in the hill.
    """
    monkeypatch.chdir(tmp_path)
    slope(tmp_path)
    (tmp_path / "field.json").write_text(json.dumps({"type": "Polygon", "coordinates": [OUTLINE]}))
    (tmp_path / "rally.csv").write_text("longitude,latitude\n8.499,47.399\n8.5055,47.4\n")
    search = (
        f"search field.json --robots 2 --footprint 80 --vehicle {vehicle} --launch 8.499,47.399"
        f" --altitude-frame {words} --terrain slope.asc --rally rally.csv --missions m"
        " --format plan,wpl --no-simulate --json"
    )
    assert command(search.split()) == 0
    capsys.readouterr()
    high = [read_mission(path) for path in sorted((tmp_path / "m").glob("*.plan"))]
    for mission in high:
        up = max(mission.heights_above_home)
        # the ground of the second point is 162.5 m above home
        second = max(up, 192.5) if words == "ground" else up
        assert [point[2] for point in mission.rally] == pytest.approx([up, second], abs=0.02)
    shared = [point[2] for point in read_mission(tmp_path / "m" / "robot-01.waypoints").rally]
    highest = [max(one.rally[k][2] for one in high) for k in (0, 1)]
    assert shared == pytest.approx(highest, abs=0.02)
    check = "missions check m field.json --terrain slope.asc --separation 0 --json"
    assert command(check.split()) == 0
    capsys.readouterr()
    for path in (tmp_path / "m").glob("robot-*.plan"):
        data = json.loads(path.read_text())
        data["rallyPoints"]["points"][1][2] = 20.0
        path.write_text(json.dumps(data))
    assert command(check.split()) == 1
    told = json.loads(capsys.readouterr().out)["diagnostics"]
    assert {one["rule"] for one in told if one["severity"] == "error"} == {"rally"}


def test_rovers_with_rally_points_hold_at_home(tmp_path, monkeypatch, capsys):
    """A return leads a rover to the nearest rally point, straight through no-go zones."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "field.json").write_text(json.dumps({"type": "Polygon", "coordinates": [OUTLINE]}))
    (tmp_path / "rally.csv").write_text("longitude,latitude\n8.5015,47.4015\n")
    search = (
        "search field.json --robots 2 --footprint 40 --vehicle rover --autopilot ardupilot"
        " --missions m --rally rally.csv --no-simulate"
    )
    assert command([*search.split(), "--format", "wpl"]) == 0
    for path in (tmp_path / "m").glob("*.waypoints"):
        assert path.read_text().splitlines()[-1].split("\t")[3] == "17"
        mission = read_mission(path)
        assert mission.landing == pytest.approx(mission.home, abs=1e-7)
    assert lint(tmp_path / "m") == []
    for words, said in (
        ("--ending return", "ending: expected land or loiter with rally points"),
        ("--format csv,kml", "rally: expected missions in degrees in the format plan or wpl"),
        ("--altitude-frame sea", "altitude_frame: expected home for a rover"),
        ("--airspace 5", "airspace: expected a fixed wing together with it, got a rover"),
        ("--altitude-frame sea --vehicle multirotor", "rally: expected a terrain file"),
    ):
        capsys.readouterr()
        assert command([*search.split(), *words.split()]) == 2
        assert said in capsys.readouterr().err
