"""Missions are safe as written: an independent reader of the files tests each leg against each
polygon of the fence.
"""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely
from shapely.affinity import rotate

from shoal.cli import run as command
from shoal.core.errors import InvalidInputError
from shoal.missions import (
    Mission,
    MissionOptions,
    MissionSet,
    check_missions,
    fence,
    lint,
    write_missions,
)
from shoal.missions.deconfliction import plan_missions
from shoal.missions.fence import Fence, corners_of, enclosing_polygons
from shoal.search.cells.grid import cells_of
from shoal.search.cells.routing import RegionPaths
from shoal.search.flight.dubins import NoRoomError
from shoal.search.flight.separation import Separation
from shoal.search.planning.plan import plan_at_margin, plan_search
from shoal.search.problem import SearchProblem
from shoal.search.regions.margin import sag_of, with_default_margin
from shoal.search.regions.projection import LocalFrame
from shoal.search.regions.region import region_of

FRAME = LocalFrame(18.4, -33.9)
FRAME60 = LocalFrame(8.5, 60.0)
MOST = {"px4": 64, "ardupilot": 70}
TIGHT = 0.01  # metres: rounded coordinates, and the plane of this reader


def metres(lonlat, origin):
    """Metres east and north on a sphere: not Shoal's projection."""
    array = np.radians(np.asarray(lonlat, dtype=np.float64) - origin) * 6_371_008.8
    return array * (np.cos(np.radians(origin[1])), 1.0)


def read_plan(path):
    """Return the path from home to the end, the last circles, and the polygons with whether each is
    an inclusion.
    """
    data = json.loads(path.read_text())
    latitude, longitude, _ = data["mission"]["plannedHomePosition"]
    items = [
        (one["command"], *one["params"][4:6][::-1], one["params"][2])
        for one in data["mission"]["items"]
    ]
    polygons = [
        ([corner[::-1] for corner in one["polygon"]], one["inclusion"])
        for one in data["geoFence"]["polygons"]
    ]
    return flown((longitude, latitude), items), polygons


def read_waypoints(path):
    rows = [line.split("\t") for line in path.read_text().splitlines()[1:]]
    items = [(int(row[3]), float(row[9]), float(row[8]), float(row[6])) for row in rows]
    polygons: list[tuple[list[tuple[float, float]], bool]] = []
    missing = 0
    for line in (path.parent / "fence.txt").read_text().splitlines()[1:]:
        row = line.split("\t")
        if not missing:
            polygons.append(([], row[3] == "5001"))
            missing = int(float(row[4]))
        polygons[-1][0].append((float(row[9]), float(row[8])))
        missing -= 1
    return flown(items[0][1:3], items[1:]), polygons


def flown(home, items):
    way, circles = [home], []
    for command_, longitude, latitude, radius in items:
        if command_ in (16, 17, 21):
            way.append((longitude, latitude))
        elif command_ == 20:
            way.append(home)
        if command_ == 17 and radius:
            circles.append(((longitude, latitude), radius))
    return way, circles


def judge(folder, most):
    """Return the smallest distance of any leg from any polygon of the fence, after tests of all of
    them.
    """
    nearest = np.inf
    files = [(path, read_plan) for path in folder.glob("*.plan")] + [
        (path, read_waypoints) for path in folder.glob("*.waypoints")
    ]
    assert files
    for path, reader in files:
        (way, circles), polygons = reader(path)
        assert 1 <= sum(kept for _, kept in polygons) <= 1, path
        assert sum(len(ring) for ring, _ in polygons) <= most, path
        points = metres(way, way[0])
        legs = [
            *shapely.linestrings(np.stack([points[:-1], points[1:]], axis=1)),
            *(
                shapely.Point(metres([place], way[0])[0]).buffer(radius).exterior
                for place, radius in circles
            ),
        ]
        for ring, kept in polygons:
            area = shapely.Polygon(metres(ring, way[0]))
            if kept:
                assert shapely.covers(area.buffer(TIGHT), legs).all(), (path, "outside")
            else:
                crossed = shapely.intersection(area.buffer(-TIGHT), legs)
                assert shapely.is_empty(crossed).all(), (path, shapely.length(crossed).max())
            border = area.exterior if kept else area
            nearest = min(nearest, float(shapely.distance(border, legs).min()))
    return nearest


def star(x, y, radius, corners=16, depth=0.8):
    """A zone with many corners, every other one of which points inwards."""
    angles = np.linspace(0, 2 * np.pi, 2 * corners, endpoint=False)
    far = radius * np.where(np.arange(2 * corners) % 2, 1.0, depth)
    return shapely.Polygon(np.column_stack([x + far * np.cos(angles), y + far * np.sin(angles)]))


def written(region, folder, autopilot="px4", **settings):
    settings = {
        "tour": "boustrophedon",
        "angle": 0.0,
        "allocation": "hop",
    } | settings  # what takes no time to plan
    made = MissionSet.from_problem(
        SearchProblem(region, **settings),
        MissionOptions(format=("plan", "wpl"), autopilot=autopilot),
    )
    made.write(folder)
    return made


def field(zones, width=300.0, height=200.0, frame=FRAME):
    return region_of(
        shapely.box(0, 0, width, height),
        frame=frame,
        no_go=shapely.union_all(zones) if zones else None,
    )


@pytest.mark.parametrize(
    ("east", "more"),
    [
        (179.999, {"launch": "-179.9995,-16.999", "vehicle": "multirotor"}),
        (179.999999, {"vehicle": "fixed-wing"}),
    ],
)
def test_missions_across_the_180_degree_meridian_are_refused(east, more, tmp_path):
    """The sentence was one about a fence that a path leaves by 86 m."""
    square = shapely.box(east - 0.002, -17.0, east, -16.998)
    path = tmp_path / "field.geojson"
    path.write_text(shapely.to_geojson(square))
    problem = SearchProblem(path, robots=1, footprint=20, **more)
    missions = MissionSet.from_problem(problem)
    with pytest.raises(
        InvalidInputError, match=r"robot-01.*do not cross the 180° meridian, got lo"
    ):
        missions.write(tmp_path / "missions")


FOUR = [star(68, 60, 16), star(68, 140, 20), star(180, 70, 23), star(210, 150, 16)]


@pytest.mark.parametrize("autopilot", MOST)
def test_no_leg_enters_a_many_cornered_zone_of_the_written_fence(tmp_path, autopilot):
    made = written(field(FOUR), tmp_path, autopilot, robots=2, footprint=20.0, vehicle="multirotor")
    # 2 m position error, 1 m acceptance radius, 1 cm rounding
    assert made.problem.margin == pytest.approx(3.01)
    assert judge(tmp_path, MOST[autopilot]) > 2.99
    assert not check_missions(tmp_path, made.problem.place, 20.0, fence_distance=2.99).errors


@pytest.mark.parametrize("count", [25, 40])
def test_more_zones_than_a_fence_has_corners_are_merged_before_the_search_is_planned(
    tmp_path, count
):
    rng = np.random.default_rng(count)
    zones = [star(*rng.uniform((20, 20), (380, 280)), rng.uniform(2, 6), 5) for _ in range(count)]
    written(field(zones, 400.0, 300.0), tmp_path, robots=2, footprint=30.0, vehicle="multirotor")
    assert judge(tmp_path, 64) > 2.9


@pytest.mark.parametrize("number", range(6))
def test_random_regions_and_zones(tmp_path, number):
    rng = np.random.default_rng(number)
    outline = shapely.union(
        shapely.box(0, 0, *rng.uniform((150, 60), (300, 100))),
        shapely.box(0, 0, *rng.uniform((50, 150), (90, 250))),
    )
    zones = [
        star(
            *rng.uniform((10, 10), (200, 150)),
            rng.uniform(5, 20),
            int(rng.integers(3, 25)),
            rng.uniform(0.5, 1),
        )
        for _ in range(4)
    ]
    region = region_of(outline, frame=FRAME, no_go=shapely.union_all(zones))
    settings = (
        {"launch": tuple((-30.0, float(y)) for y in rng.uniform(-50, 200, 2))} if number % 2 else {}
    )
    made = written(
        region,
        tmp_path,
        list(MOST)[number % 2],
        robots=2,
        footprint=20.0,
        vehicle="multirotor",
        transit=True,
        **settings,
    )
    assert judge(tmp_path, 64 if number % 2 == 0 else 70) > made.problem.margin - 2 * TIGHT
    assert not check_missions(tmp_path, made.problem.place, 20.0).errors


def test_a_fixed_wing_flies_from_part_to_part_around_the_zone_between_them(tmp_path):
    outline = shapely.union(shapely.box(-200, -90, 200, -60), shapely.box(-12, -90, 13, 90))
    region = region_of(outline, frame=FRAME, no_go=shapely.Point(2, 12).buffer(9, quad_segs=2))
    made = written(region, tmp_path, robots=2, footprint=10.0, vehicle="fixed-wing", transit=True)
    assert made.problem.margin > 0.5
    assert judge(tmp_path, 64) > made.problem.margin - 0.1
    assert not check_missions(tmp_path, region, 10.0).errors


@pytest.mark.parametrize("zones", [FOUR, []])
def test_a_saved_search_with_missions_is_verified_after_loading(zones, tmp_path):
    region = field(zones) if zones else "ring:120x60"  # the hole of the ring has many corners, too
    given = {
        "robots": 1,
        "footprint": 40.0,
        "vehicle": "multirotor",
        "tour": "boustrophedon",
        "angle": 0.0,
    }
    episode = MissionSet.from_problem(
        SearchProblem(region, **given), MissionOptions(format=() if zones else ("plan",))
    ).run()
    assert episode.problem.place.barriers
    episode.save(tmp_path / "episode.json")
    loaded = type(episode).load(tmp_path / "episode.json")
    assert loaded.problem.place.free.equals_exact(episode.problem.place.free, 1e-6)
    assert loaded.verify()


def test_transits_lead_around_zones_and_are_marked():
    region = region_of(shapely.box(0, 0, 100, 40), no_go=shapely.box(40, -20, 60, 50))
    route = RegionPaths(cells_of(region, 20), transit=True).legs([(30.0, 20.0), (70.0, 20.0)])
    assert not shapely.linestrings(route.points).intersects(
        shapely.box(40, -20, 60, 50).buffer(-1e-6)
    )
    assert route.transit.all()
    assert len(route.points) == 4


def test_fixed_wings_loiter_clear_of_zones():
    region = region_of(shapely.box(0, 0, 400, 300), frame=FRAME, no_go=shapely.box(30, 20, 60, 80))
    plan = plan_search(
        SearchProblem(
            region,
            robots=1,
            footprint=40.0,
            vehicle="fixed-wing",
            launch=((10.0, 50.0),),
            margin=2.0,
        )
    )
    (mission,) = plan_missions(plan, separation=Separation())
    circle = shapely.Polygon(mission.circle_in(FRAME))
    assert circle.distance(region.no_go) > 1.9


def test_vehicles_that_loiter_are_timed_by_flights_and_not_by_their_circles():
    plan = plan_search(
        SearchProblem("rectangle:300x200", robots=3, footprint=40.0, vehicle="fixed-wing")
    )
    missions = plan_missions(plan, separation=Separation())
    assert all(mission.loiter for mission in missions)
    assert max(mission.start or 0.0 for mission in missions) < 600


def test_vehicles_that_are_recharged_land_and_circles_beyond_the_battery_are_said():
    fields = {"footprint": 40.0, "launch": "-10,50;-10,150"}
    problem = SearchProblem(
        "rectangle:600x400", robots=2, vehicle="fixed-wing,endurance=8,recharge=5", **fields
    )
    plan = plan_search(problem)
    with pytest.raises(InvalidInputError, match=r"sorties that land, .* \(robot \d flies 2\)"):
        plan_missions(plan, separation=Separation(), ending="loiter")
    sorties = plan_missions(plan, separation=Separation())
    assert {mission.loiter for mission in sorties} == {None}
    for before, after in pairwise(sorties):
        if after.sortie == before.sortie + 1:
            ready = before.start + before.duration(plan.vehicle) + plan.vehicle.recharge_seconds
            assert after.start >= ready - 1e-6
    one = problem.replaced(vehicle="fixed-wing,endurance=16", delays=(0.0, 900.0))
    missions = MissionSet.from_problem(one, MissionOptions(separation=(40.0, 10.0)))
    assert [sentence for sentence in missions.cautions if "robot 1 circles until" in sentence]
    enough = one.replaced(vehicle="fixed-wing,endurance=60")
    missions = MissionSet.from_problem(enough, MissionOptions(separation=(40.0, 10.0)))
    assert not [sentence for sentence in missions.cautions if "circles" in sentence]


def test_altitudes_above_an_unknown_sea_are_said():
    problem = SearchProblem("rectangle:300x200", robots=1, footprint=40.0, vehicle="multirotor")
    for frame, count in (("home", 0), ("sea", 1)):
        missions = MissionSet.from_problem(problem, MissionOptions(altitude_frame=frame))
        assert len([one for one in missions.cautions if "count from the sea" in one]) == count


def test_a_path_outside_the_written_fence_is_refused_before_a_file_exists(tmp_path):
    plan = plan_search(
        SearchProblem(field([]), robots=1, footprint=40.0, vehicle="multirotor", angle=0.0)
    )
    missions = plan_missions(plan)
    fence = Fence(
        missions[0].fence.inclusion,
        (FRAME.to_degrees(shapely.get_coordinates(shapely.box(80, 0, 120, 200))[:-1]),),
    )
    for name in ("plan", "wpl", "geojson", "kml", "gpx", "csv"):
        with pytest.raises(
            InvalidInputError,
            match=r"robot-01\.\w+: expected paths and rally points inside the fence as the file",
        ):
            write_missions([replace(missions[0], fence=fence)], tmp_path / "out", formats=(name,))
    assert not (tmp_path / "out").exists()
    rally = replace(missions[0], rally=(tuple(FRAME.to_degrees([(500.0, 500.0)])[0].tolist()),))
    with pytest.raises(InvalidInputError, match="rally point 1"):
        write_missions([rally], tmp_path / "out", formats=("plan",))
    assert not (tmp_path / "out").exists()


def test_zones_that_have_no_room_in_the_fence_are_said(tmp_path, monkeypatch):
    said = []
    monkeypatch.setattr("shoal.core.notices.listeners", [said.append])
    monkeypatch.setattr("shoal.core.notices._told", set())
    monkeypatch.setattr(
        "shoal.missions.mission_set.region_with_barriers", lambda region, most, **_: region
    )
    region = field(
        [
            star(*place, 2.0, 5)
            for place in np.random.default_rng(1).uniform((10, 10), (190, 90), (30, 2))
        ],
        200,
        100,
    )
    written(region, tmp_path, footprint=20.0, vehicle="multirotor")
    assert judge(tmp_path, 64) > 0
    left = [
        text
        for text in said
        if "no exclusion polygons, because the autopilot stores at most 64 corners" in text
    ]
    assert len(left) == 1


def test_the_default_margin_is_what_the_vehicle_needs_or_what_the_region_has_room_for():
    big, narrow = (region_of(shapely.box(0, 0, *sides)) for sides in ((200, 100), (200, 3)))
    assert with_default_margin(big, 3.0, footprint=20.0).margin == 3.0
    assert 0 < with_default_margin(narrow, 3.0, footprint=20.0).margin < 1.5
    assert (
        with_default_margin(big, 3.0, footprint=20.0, inner=np.array([(1.0, 50.0)])).margin <= 1.0
    )
    zone = region_of(shapely.box(0, 0, 200, 100), no_go=shapely.box(50, 50, 60, 60))
    assert SearchProblem(zone, vehicle="rover").place.margin == pytest.approx(1.51)
    assert SearchProblem(zone).place.margin == 0  # the ideal vehicle is where it should be
    assert SearchProblem(zone, vehicle="rover", margin=0.0).place.margin == 0
    assert SearchProblem(big, vehicle="rover").place.margin == 0  # neither a zone nor a fence


@pytest.mark.parametrize("vehicle", ["multirotor", "rover"])
def test_with_the_margin_0_paths_along_a_side_are_written(vehicle, tmp_path):
    region = field([star(150, 100, 40, 6, 0.6)])
    written(region, tmp_path, robots=2, footprint=20.0, vehicle=vehicle, margin=0.0, angle=17.0)
    assert judge(tmp_path, 64) < 0.01


def test_long_sides_of_a_fence_are_straight_in_degrees_and_the_margin_has_room_for_it():
    region = region_of(shapely.box(-2500, 0, 2500, 100), frame=LocalFrame(8.5, 60.0))
    ends, middle = FRAME60.to_degrees([(-2500, 0), (2500, 0)]), FRAME60.to_degrees([(0.0, 0.0)])[0]
    sag = abs(FRAME60.to_metres([(middle[0], ends[:, 1].mean())])[0, 1])
    assert sag_of(region) == pytest.approx(sag, rel=0.02)
    assert sag > 0.8
    assert SearchProblem(region, vehicle="multirotor").with_own_margin(
        region, fenced=True
    ).margin == pytest.approx(3 + sag, abs=0.03)


def test_missions_without_a_margin_say_so(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("shoal.core.notices._told", set())
    words = [
        "search",
        "rectangle:200x100",
        "--footprint",
        "20",
        "--vehicle",
        "multirotor",
        "--format",
        "csv",
        "--missions",
    ]
    assert command([*words, str(tmp_path / "a"), "--json"]) == 0
    out = capsys.readouterr()
    assert json.loads(out.out)["region"]["margin_m"] == pytest.approx(3.01)
    assert json.loads(out.out)["missions"]["cautions"] == []
    assert command([*words, str(tmp_path / "b"), "--margin", "0", "--json"]) == 0
    out = capsys.readouterr()
    assert json.loads(out.out)["region"]["margin_m"] == 0
    assert "paths may touch the fence" in out.err
    # rows keep half of a footprint from the sides
    assert json.loads(out.out)["missions"]["cautions"] == []
    small = [*words[:3], "12", *words[4:], str(tmp_path / "c"), "--cross-track", "1"]
    assert command(small) == 0
    assert "rows keep a reserve of 1 m, not of 2.24 m" in " ".join(capsys.readouterr().out.split())


def test_the_check_says_how_far_vehicles_may_be_outside(tmp_path):
    """By the files alone, and as the plan says."""
    region = region_of(shapely.Polygon([(0, 0), (300, 40), (90, 250)]))
    problem = SearchProblem(region, footprint=20.0, vehicle="multirotor")
    for margin, reserve in ((None, None), (1.0, None), (None, 0.0)):
        wanted = problem.replaced(margin=margin, cross_track=reserve)
        missions = MissionSet.from_problem(wanted, MissionOptions(format=("csv",)))
        missions.write(tmp_path / f"{margin}{reserve}")
        result = check_missions(tmp_path / f"{margin}{reserve}", region, 20.0, vehicle="multirotor")
        assert result.distance == pytest.approx(3.01 if margin is None else 1.0, abs=0.01)
        told = " ".join(result.cautions)
        assert ("up to 2 m outside of the region" in told) == (margin is not None)
        assert ("rows are too far apart" in told) == (reserve is not None)
        assert result.report()["cautions"] == list(result.cautions)
        planned = " ".join(missions.cautions)
        assert ("up to 2 m outside of the region" in planned) == (margin is not None)
        assert ("rows keep a reserve of 0 m, not of 2.24 m" in planned) == (reserve is not None)


def test_half_of_the_reserve_is_given_up_where_straight_rows_have_no_room(monkeypatch):
    def plan(problem, **kwargs):
        if problem.cross_track > 2:
            problem = problem.replaced(tour="spanning-tree").at_place(problem.place)
        return plan_at_margin(problem, **kwargs)

    monkeypatch.setattr("shoal.missions.mission_set.plan_at_margin", plan)
    problem = SearchProblem("rectangle:200x100", footprint=20.0, vehicle="multirotor", angle=0.0)
    for longer, tour in ((2, "spanning-tree"), (1, "boustrophedon")):
        monkeypatch.setattr("shoal.missions.mission_set._MUCH_LONGER", longer)
        missions = MissionSet.from_problem(problem)
        assert missions.plan.tour.name == tour
        assert bool(missions.cautions) == (tour != "spanning-tree")


def test_missions_of_one_waypoint_and_paths_outside_are_cautioned(tmp_path):
    """They have no leg inside the region whose distance from the border could be measured."""
    narrow = SearchProblem(
        region_of(shapely.box(0, 0, 40, 4)), footprint=20.0, vehicle="multirotor"
    )
    missions = MissionSet.from_problem(narrow, MissionOptions(format=("csv",)))
    assert {len(one.waypoints) for one in missions.missions} == {1}
    assert "up to 1 m outside of the region" in " ".join(missions.cautions)
    missions.write(tmp_path / "narrow")
    smaller = region_of(shapely.box(0, 0, 30, 4))
    for region, distance in ((narrow.place, 2.0), (smaller, 0.0)):
        result = check_missions(tmp_path / "narrow", region, 20.0, vehicle="multirotor")
        assert result.distance == pytest.approx(distance, abs=0.01)
        assert result.cautions


def test_vehicles_without_room_give_up_reserve_before_the_margin_that_keeps_them_inside(
    monkeypatch,
):
    tried = []

    def plan(problem, **kwargs):
        tried.append((problem.cross_track, problem.margin, kwargs["rotated_rows"]))
        if problem.cross_track > 2 or problem.margin > 2.9:
            raise NoRoomError("turn_radius: expected room for turns, got none")
        return plan_at_margin(problem, **kwargs)

    monkeypatch.setattr("shoal.missions.mission_set.plan_at_margin", plan)
    problem = SearchProblem("rectangle:200x100", footprint=20.0, vehicle="multirotor", angle=0.0)
    missions = MissionSet.from_problem(problem)
    wide, least, half = 3.01, 2.01, 1.118
    assert tried == [
        (2.236, wide, False),
        (2.236, least, False),
        (half, wide, False),
        (half, least, False),
    ]
    assert missions.plan.grid.region.margin == pytest.approx(2.01)
    assert "rows keep a reserve of 1.12 m, not of 2.24 m" in missions.cautions[-1]


def test_a_margin_below_the_error_of_positions_is_the_last_resort(monkeypatch):
    tried = []

    def plan(problem, **kwargs):
        tried.append((problem.cross_track, problem.margin))
        raise NoRoomError("turn_radius: expected room for turns, got none")

    monkeypatch.setattr("shoal.missions.mission_set.plan_at_margin", plan)
    problem = SearchProblem("rectangle:200x100", footprint=20.0, vehicle="multirotor", angle=0.0)
    with pytest.raises(NoRoomError, match="room for turns"):
        MissionSet.from_problem(problem)
    assert [margin for _, margin in tried] == [3.01, 2.01] * 3 + [0.0] * 3
    assert [reserve for reserve, _ in tried[-3:]] == [2.236, 1.118, 0.0]


def test_the_check_finds_paths_that_are_nearer_to_the_fence_than_asked(tmp_path, capsys):
    made = written(field(FOUR), tmp_path, robots=1, footprint=20.0, vehicle="multirotor")
    assert not [
        one
        for one in lint(tmp_path, made.problem.place, fence_distance=2.9)
        if one.rule == "fence-near"
    ]
    near = [
        one
        for one in lint(tmp_path, made.problem.place, fence_distance=4.0)
        if one.rule == "fence-near"
    ]
    assert near
    assert "expected at least 4 m between all paths and the fence, got 3" in near[0].sentence
    write_missions(made.missions, tmp_path / "csv", formats=("csv",))
    with pytest.raises(InvalidInputError, match="fence_distance: expected missions with a fence"):
        lint(tmp_path / "csv", fence_distance=1.0)


@pytest.mark.parametrize("seed", range(4))
def test_enclosing_polygons_contain_the_given_ones_and_keep_clear(seed):
    rng = np.random.default_rng(seed)
    shapes = [star(40 * k, 0, 10, int(rng.integers(3, 40)), rng.uniform(0.4, 1)) for k in range(3)]
    lines = shapely.multilinestrings([[(x, -50), (x, 50)] for x in (20, 60)])
    away = [shape.distance(lines) for shape in shapes]
    found = enclosing_polygons(shapes, 15, clear=[(lines, far) for far in away])
    assert corners_of(found) <= 15
    for shape, simple, far in zip(shapes, found, away, strict=True):
        assert simple.is_valid
        assert simple.buffer(1e-6).covers(shape)
        assert simple.distance(lines) > far - 0.01


@pytest.mark.parametrize("seed", range(8))
def test_corners_on_a_side_do_not_become_needles(seed):
    """Sides that lie on one line but for rounding meet anywhere: a corner was 10^18 m away."""
    rng = np.random.default_rng(seed)
    for _ in range(20):
        box = rotate(shapely.box(0, 0, *rng.uniform(20, 900, 2)), rng.uniform(0, 180))
        (simple,) = enclosing_polygons([shapely.segmentize(box, rng.uniform(5, 60))], 8)
        assert corners_of([simple]) <= 8
        assert simple.buffer(1e-6).covers(box)
        assert simple.length < 1.1 * box.length


def test_a_zone_does_not_grow_over_a_path_along_its_side():
    """With margin 0, a path may follow the sides of a zone."""
    zone = shapely.Polygon([(0, 0), (10, 0), (10, 10), (5, 9), (0, 10)])
    path = shapely.LineString([(10, 10), (5, 9), (0, 10)])
    (simple,) = enclosing_polygons([zone], 4, clear=[(path, 0.0)])
    assert simple.buffer(-2e-3).intersection(path).length == 0


def test_ways_outside_are_those_that_a_fixed_wing_flies():
    """With its climb and its turns: from a launch point inside, it was said to stay inside."""
    square = shapely.box(0, 0, 1000, 1000)

    def plan_from(x, y, **vehicle):
        return plan_search(
            SearchProblem(
                "square:1000",
                robots=1,
                footprint=40,
                vehicle={"preset": "fixed-wing", "endurance": 180.0} | vehicle,
                launch=((x, y),),
                simulate=False,
            ),
            seed=1,
        )

    # north along the side, to a climb that ends 300 m outside, where it turns in a circle
    slow = plan_from(20.0, 20.0, climb_speed=1.0)
    (flight,) = slow.flown_sorties(0, slow.stops(0)).trajectories()
    away, left = 0.0, False
    for begin, end in pairwise(flight.points[:, :2]):
        leg = shapely.LineString([begin, end])
        away += leg.length - leg.intersection(square).length
        left |= not square.covers(shapely.Point(end))
        if left and square.covers(shapely.Point(end)):
            break
    assert slow.outside_lengths(0)[0] == pytest.approx(away, abs=0.1)
    assert away > 900.0
    out, home = plan_from(500.0, 500.0).outside_lengths(0)
    assert out == 0.0
    assert home > 50.0  # it turns beyond the border
    assert plan_from(-300.0, 500.0).outside_lengths(0)[0] > 500.0  # 300 m away


def test_stay_inside_crosses_the_border_once_and_at_the_nearest_place():
    given = {"robots": 1, "footprint": 20.0, "launch": ((-60.0, 90.0),), "simulate": False}
    region = region_of(shapely.union(shapely.box(0, 0, 200, 30), shapely.box(0, 0, 30, 200)))
    free, kept = (
        plan_search(SearchProblem(region, stay_inside=stay, **given)) for stay in (False, True)
    )
    assert kept.outside_lengths(0)[0] == pytest.approx(60.0)
    assert kept.outside_lengths(0)[1] == pytest.approx(60.0)
    assert sum(free.outside_lengths(0)) > 120.0
    for stop in ((100.0, 10.0), (20.0, 150.0)):
        way = shapely.linestrings(kept.leg((-60.0, 90.0), stop))
        assert way.difference(region.outline.buffer(1e-6)).length == pytest.approx(60.0)


@pytest.mark.parametrize("launch", [None, "10,10"])
def test_stay_inside_without_a_point_outside_is_refused(launch, capsys):
    words = [
        "search",
        "rectangle:100x50",
        "--stay-inside",
        *(["--launch", launch] if launch else []),
    ]
    assert command(words) == 2
    assert (
        "stay_inside: expected launch or landing points outside the region"
        in capsys.readouterr().err
    )


@pytest.mark.parametrize(
    ("corners", "left"),
    [
        # a spur of no width
        ([(0, 0), (100, 0), (100, 50), (140, 50), (100, 50.0001), (100, 100), (0, 100)], 5),
        ([(0, 0), (100, 0), (100, 50), (140, 50), (100, 50.003), (100, 100), (0, 100)], 7),
        (
            [
                (0, 0),
                (100, 0),
                (99, 50),
                (60, 50),
                (30, 60),
                (60, 50.0000001),
                (100, 100),
                (0, 100),
            ],
            6,
        ),
        # two parts that meet at a corner
        ([(0, 0), (50, 49.9999999), (100, 0), (100, 100), (50, 50.0000001), (0, 100)], None),
    ],
)
@pytest.mark.parametrize("whole", [True, False])
def test_rings_are_simple_in_the_rounded_coordinates(corners, left, whole):
    shape = shapely.Polygon(corners)
    rings = fence._round_rings(shape, FRAME, whole=whole)
    assert all(
        shapely.Polygon(ring).is_valid and (ring == np.round(ring, 8)).all() for ring in rings
    )
    assert len(rings) == (1 if whole or left else 2)
    assert left is None or len(rings[0]) <= left
    there = shapely.union_all([shapely.Polygon(FRAME.to_metres(ring)) for ring in rings])
    assert there.buffer(0.01).covers(shape.buffer(-0.01))
    assert shape.buffer(0.2).covers(there)


def test_a_fence_that_crosses_itself_is_refused_before_a_file_exists(tmp_path):
    ring = FRAME.to_degrees(
        np.array(
            [(0.0, 0.0), (100.0, 0.0), (100.0, 50.0), (140.0, 50.0), (100.0, 50.0), (0.0, 100.0)]
        )
    )
    way = FRAME.to_degrees(np.array([(10.0, 10.0), (40.0, 10.0)]))
    flown = Mission(way, tuple(way[0].tolist()), fence=Fence(ring))
    with pytest.raises(InvalidInputError, match="neither touch nor cross themselves"):
        write_missions([flown], tmp_path / "m", formats=["plan"])
    assert not (tmp_path / "m").exists()


def test_a_fixed_wings_mission_that_cannot_be_flown_as_written_is_said():
    problem = SearchProblem("rectangle:300x200", robots=1, footprint=40.0, vehicle="fixed-wing")
    missions = MissionSet.from_problem(problem)
    assert not [one for one in missions.cautions if "as written" in one]
    (mission,) = missions.missions
    sharp = mission.waypoints.copy()
    middle = len(sharp) // 2
    sharp[middle] = sharp[middle - 1] + 0.3 * (sharp[middle - 2] - sharp[middle - 1])
    missions._missions = (replace(mission, waypoints=sharp),)
    del missions.__dict__["missions"]
    (said,) = [one for one in missions.cautions if "as written" in one]
    assert "expected a radius of at least 40 m" in said
