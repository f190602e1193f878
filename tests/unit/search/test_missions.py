"""Missions: made from routes, written, read by us and by others, checked against the region."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely
from tests.missions import missions_of
from tests.reference.missions import READERS, read_plan, read_wpl
from tests.unit.search.test_mission_lint import FIELD

from shoal.cli import run
from shoal.core.errors import InvalidInputError, OutputError, UnknownNameError
from shoal.missions import (
    FORMATS,
    Mission,
    MissionFormat,
    MissionOptions,
    MissionSet,
    check_missions,
    lint,
    mission_files,
    read_mission,
    write_missions,
)
from shoal.search import LocalFrame, RegionPaths, cells_of, open_region, plan_search, region_of
from shoal.search.flight.legs import merge_straight_legs
from shoal.search.flight.sorties import Sorties
from shoal.search.flight.vehicle import vehicle_of
from shoal.search.problem import SearchProblem
from shoal.views.search.missions import missions_figure

FRAME = LocalFrame(8.5, 47.4)
RETURN = 30 / 2.5 + 30 / 1.5 + 2 * 5 / 2.5  # s: from 30 m to 60 m and down again, and two stops
LANES = [
    (-90.0, -20.0),
    (0.0, -20.0),
    (90.0, -20.0),
    (90.0, 0.0),
    (-90.0, 0.0),
    (-90.0, 20.0),
    (90.0, 20.0),
]


def far(metres):
    """Return a vehicle that goes so far at 1 m/s, and turns and climbs in no time."""
    return f"ideal,endurance={metres / 60!r},reserve=0"


def swept(region, footprint, **options):
    """Return missions of two robots that see all of a region, and its grid."""
    grid = cells_of(region, footprint)
    rows = [grid.cells[grid.cells[:, 0] == row] for row in range(grid.shape[0])]
    cells = np.vstack([row if k % 2 == 0 else row[::-1] for k, row in enumerate(rows)])
    paths = RegionPaths(grid)
    missions = []
    for robot, half in enumerate(np.array_split(cells, 2), start=1):
        missions += missions_of(paths.route(half).points, region.frame, robot=robot, **options)
    return missions, grid


@pytest.fixture(scope="module")
def field(tmp_path_factory):
    path = tmp_path_factory.mktemp("field") / "field.json"
    path.write_text(json.dumps(FIELD))
    return path


@pytest.mark.parametrize("kind", ["multirotor", "fixed-wing", "rover"])
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_what_each_vehicle_gets(kind, autopilot, tmp_path):
    (mission,) = missions_of(
        LANES, FRAME, vehicle=f"{kind},cruise_speed=15", autopilot=autopilot, home=(-100, -30)
    )
    plan, wpl = write_missions([mission], tmp_path, formats=["plan", "wpl"])
    data = json.loads(plan.read_text())["mission"]
    assert data["firmwareType"] == {"px4": 12, "ardupilot": 3}[autopilot]
    assert data["vehicleType"] == {"multirotor": 2, "fixed-wing": 1, "rover": 10}[kind]
    commands = [item["command"] for item in data["items"]]
    assert commands == [*([] if kind == "rover" else [22]), 178, *[16] * len(mission.waypoints), 20]
    assert len(commands) + 1 == mission.n_items == len(wpl.read_text().splitlines()) - 1
    # up over home to the first waypoint's altitude, or towards the first waypoint and there no more
    # than high
    if kind != "rover":
        first, take_off = (
            data["items"][commands.index(command)]["params"][4:] for command in (16, 22)
        )
        start = data["plannedHomePosition"][:2] if kind == "multirotor" else first[:2]
        assert take_off == [*start, (1.0 if kind == "multirotor" else 0.8) * first[2]]
    speed = data["items"][commands.index(178)]
    # through the air, or over ground
    assert speed["params"] == [int(kind != "fixed-wing"), 15, -1, 0, 0, 0, 0]
    radius = {"multirotor": 1, "fixed-wing": 5, "rover": 0.5}[kind]
    assert data["items"][commands.index(16)]["params"][:4] == [0, radius, 0, None]
    assert (
        data["items"][commands.index(16)]["params"][6]
        == {"multirotor": 30, "fixed-wing": 80, "rover": 0}[kind]
    )
    home, points = read_plan(plan)
    assert read_wpl(wpl) == (home, points)
    if kind != "fixed-wing":
        assert (
            np.abs(FRAME.to_metres([home, *points]) - [(-100, -30), LANES[0], *LANES[2:]]).max()
            < 0.001
        )
    assert lint(tmp_path) == []
    for path in (plan, wpl):
        assert (read_mission(path).kind, read_mission(path).speed) == (kind, 15)


def test_a_camera_in_mission_items(tmp_path):
    """Trigger from the first waypoint to the last, gimbal, heading: written, read by others and by
    us.
    """
    vehicle = (
        "multirotor,sensor_width=13.2,sensor_height=8.8,focal_length=8.8,front_overlap=0.75,yaw=90"
    )
    (mission,) = missions_of(LANES, FRAME, vehicle=vehicle)
    plan, wpl = write_missions([mission], tmp_path, formats=["plan", "wpl"])
    rows = json.loads(plan.read_text())["mission"]["items"]
    assert [row["command"] for row in rows] == [22, 178, 205, *[16, 206] * 6, 206, 20]
    assert rows[2]["params"] == [-90, 0, 0, 0, 0, 0, 2]
    assert rows[4]["params"] == [7.5, 0, 1, 0, 0, 0, 0]  # a quarter of 30 m
    assert rows[-2]["params"] == [0] * 7
    assert {row["params"][3] for row in rows if row["command"] == 16} == {90}
    assert read_wpl(wpl) == read_plan(plan)
    for path in (plan, wpl):
        read = read_mission(path)
        assert (read.trigger_distance, read.gimbal_pitch, read.yaw, read.acceptance_radius) == (
            7.5,
            -90,
            90,
            1,
        )
        assert read.n_items == mission.n_items == 18
    assert lint(tmp_path) == []


def test_every_format_by_its_own_reader(tmp_path):
    missions = missions_of(LANES, FRAME, vehicle=far(400), robot=7)
    paths = write_missions(missions, tmp_path / "new")
    assert len(missions) > 2
    assert [path.name for path in paths[: len(missions)]] == [
        "robot-07.plan",
        *(f"robot-07-{k}.plan" for k in range(2, len(missions) + 1)),
    ]
    for path in paths:
        number = int(path.stem.split("-")[2]) if path.stem.count("-") == 2 else 1
        home, points = READERS[path.suffix](path)
        assert np.abs(np.asarray(points) - missions[number - 1].waypoints).max() <= 1e-8
        assert np.abs(np.asarray(home) - missions[number - 1].home).max() <= 1e-8
        assert read_mission(path).name == path.stem
    assert lint(tmp_path / "new") == []


def test_one_waypoint(tmp_path):
    (mission,) = missions_of([(3, 4)], FRAME, home=(0, 0))
    assert mission.length == pytest.approx(10, abs=0.001)
    for path in write_missions([mission], tmp_path):
        assert len(READERS[path.suffix](path)[1]) == len(read_mission(path).waypoints) == 1


def test_no_route_no_missions():
    assert missions_of(np.zeros((0, 2)), FRAME) == ()


def test_a_battery_in_seconds():
    missions = missions_of(LANES, None, vehicle=far(400))
    assert all(390 < mission.length <= 400 for mission in missions[:-1])
    assert len(missions) > 2
    faster = missions_of(LANES, None, vehicle=far(400), rate=2.0)
    assert 700 < max(mission.length for mission in faster) <= 800


def test_length_on_the_ellipsoid():
    flat, round_ = (missions_of(LANES, frame)[0].length for frame in (None, FRAME))
    assert round_ == pytest.approx(flat, rel=1e-6)


def test_ways_home_around_obstacles():
    """A rover's ways from home and back stay in the region, and count for battery and memory."""
    region = open_region("ring:60x40")
    grid = cells_of(region, 10)
    paths = RegionPaths(grid)
    order = grid.cells[np.argsort(np.arctan2(*grid.waypoints().T[::-1]), kind="stable")]
    call = {"home": (50.0, 0.0), "vehicle": "rover,turn_time=0,endurance=10,reserve=0", "cap": 250}
    missions = missions_of(paths.route(order).points, None, find_path=paths.leg, **call)
    assert len(missions) > 2
    for mission in missions:
        way = shapely.linestrings(np.vstack([mission.home, mission.waypoints, mission.home]))
        assert shapely.covers(region.reach, way)
        assert mission.length <= 600 + 1e-6
        assert mission.n_items <= 250
    with pytest.raises(
        InvalidInputError,
        match="cap: expected room for more waypoints of robot 1, got 5: the paths",
    ):
        missions_of(paths.route(order).points, None, find_path=paths.leg, **{**call, "cap": 8})
    straight = missions_of(paths.route(order).points, None, **call)
    assert not all(
        shapely.covers(
            region.reach,
            shapely.linestrings(np.vstack([mission.home, mission.waypoints, mission.home])),
        )
        for mission in straight
    )


def test_a_path_of_thousands_of_sorties_is_refused_before_the_first_is_flown(monkeypatch):
    monkeypatch.setattr(Sorties, "_fits", None)
    lanes = np.tile([(0.0, 0.0), (500.0, 0.0)], (2000, 1))
    with pytest.raises(
        InvalidInputError, match="at most 300 sorties for robot 1, got a path of 2000"
    ):
        missions_of(lanes, None, vehicle="multirotor,endurance=2,reserve=0")
    monkeypatch.setattr(Sorties, "_latest", lambda sorties, begin, **_: float(sorties.at[-1]))
    monkeypatch.setattr(Sorties, "parts", lambda sorties: sorties._sections and [])
    assert not missions_of(lanes, None, vehicle="multirotor,endurance=2,reserve=0", rate=20.0)


def test_a_path_home_that_the_battery_does_not_allow_is_named_with_its_time():
    def detour(one, other):
        return [one, (200.0, -5.0), other]

    with pytest.raises(InvalidInputError, match="because the paths from home to") as refused:
        missions_of(
            [(0, 0), (10, 0)],
            None,
            home=(0, -10),
            vehicle="multirotor,endurance=2,reserve=0",
            find_path=detour,
        )
    needed, got = re.search(
        r"more than ([\d.]+) min .*\(0, 0\) and back take as long, got ([\d.]+) min",
        str(refused.value),
    ).groups()
    assert float(needed) > float(got)  # 200 m out, 200 m back, though home is 10 m away


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            {"vehicle": far(100), "home": (500, 0)},
            (
                r"endurance: expected sorties of more than 19.68 min for robot 1, because \(-90,"
                r" -20\) is 590.339 m from home"
            ),
        ),
        ({"vehicle": far(5)}, "endurance: expected"),
        ({"rate": 0}, "rate: expected a number, above 0, got 0"),
        ({"cap": 5}, "cap: expected a whole number, 6 or more, got 5"),
        (
            {"vehicle": "boat"},
            (
                "vehicle: expected one of ideal, multirotor, fixed-wing, rover, or a file .toml or"
                " .json, got 'boat'"
            ),
        ),
        ({"autopilot": "dji"}, "autopilot: expected one of px4, ardupilot, got 'dji'"),
        (
            {"vehicle": "multirotor,altitude=0"},
            "altitude: expected a number of metres above 0 for a vehicle that flies, got 0",
        ),
        ({"vehicle": "rover,altitude=3"}, "altitude: expected no value for a rover, got 3"),
        (
            {"altitude_frame": "moon"},
            "altitude_frame: expected one of home, sea, ground, got 'moon'",
        ),
        ({"altitude_frame": "ground"}, "altitude_frame: expected home or sea without a terrain"),
        ({"tolerance": -1}, "tolerance: expected a number, 0 or more, got -1"),
        ({"robot": 0}, "mission: robot: expected a whole number, 1 or more, got 0"),
        ({"home": (np.nan, 0)}, "home: expected finite numbers"),
    ],
)
def test_bad_options(options, said):
    with pytest.raises(InvalidInputError, match=said):
        missions_of(LANES, FRAME, **options)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"waypoints": []}, "mission: expected waypoints, got none"),
        (
            {"waypoints": [(47.4, 108.5)]},
            r"expected a longitude within ±180 and then a latitude within ±90, got \(47.4, 108.5\)",
        ),
        ({"sortie": True}, "mission: sortie: expected a whole number, 1 or more, got True"),
    ],
)
def test_bad_missions(changes, said):
    with pytest.raises(InvalidInputError, match=said):
        Mission(**{"waypoints": [(8.5, 47.4)], "home": (8.5, 47.4), **changes})


def test_missions_are_frozen():
    (mission,) = missions_of(LANES, FRAME)
    with pytest.raises(ValueError, match="read-only"):
        mission.waypoints[0] = 0


def test_metres_go_to_csv_only(tmp_path):
    missions = missions_of(LANES, None)
    assert [path.name for path in write_missions(missions, tmp_path)] == ["robot-01.csv"]
    with pytest.raises(
        InvalidInputError,
        match="format 'plan': expected missions in degrees, got robot-01 in metres",
    ):
        write_missions(missions, tmp_path, formats=["plan"])


def test_nothing_half_written(tmp_path, monkeypatch):
    missions = missions_of(LANES, FRAME)
    with pytest.raises(
        UnknownNameError, match="unknown mission format 'plam': did you mean 'plan'"
    ):
        write_missions(missions, tmp_path / "a", formats=["gpx", "plam"])
    with pytest.raises(
        InvalidInputError, match="expected each robot and sortie once, got robot-01 again"
    ):
        write_missions([*missions, *missions], tmp_path / "a")
    with pytest.raises(
        InvalidInputError, match="missions: expected at least one mission to write, got none"
    ):
        write_missions([], tmp_path / "a")
    with pytest.raises(InvalidInputError, match="formats: expected a list, got"):
        write_missions(missions, tmp_path / "a", formats="plan")
    assert not list(tmp_path.iterdir())
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "robot-01.kml").mkdir()  # the fourth of six cannot be written
    with pytest.raises(OutputError):
        write_missions(missions, tmp_path / "b")
    assert [path.name for path in (tmp_path / "b").iterdir()] == ["robot-01.kml"]


def test_files_of_an_earlier_search_do_not_stay(tmp_path):
    (tmp_path / "notes.csv").write_text("mine\n")
    write_missions(
        [replace(missions_of(LANES, FRAME)[0], robot=robot) for robot in (1, 2, 3)], tmp_path
    )
    (tmp_path / "robot-07.csv").write_text("mine, too\n")
    write_missions(missions_of(LANES, FRAME), tmp_path, formats=["plan"])
    assert {path.name for path in tmp_path.iterdir()} == {
        "notes.csv",
        "robot-07.csv",
        "robot-01.plan",
        "missions.json",
    }


@pytest.mark.parametrize(
    "manifest",
    ["{", "[]", '{"files": 3}', '{"files": ["../robot-01.csv", "notes.csv", 4, "/robot-01.csv"]}'],
)
def test_a_manifest_of_somebody_else_removes_nothing(manifest, tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "missions.json").write_text(manifest)
    for path in (tmp_path / "robot-01.csv", folder / "notes.csv"):
        path.write_text("mine\n")
    write_missions(missions_of(LANES, FRAME), folder, formats=["plan"])
    assert (tmp_path / "robot-01.csv").exists()
    assert (folder / "notes.csv").exists()


def test_a_replaced_file_keeps_its_permissions(tmp_path):
    write_missions(missions_of(LANES, FRAME), tmp_path, formats=["plan"])
    (tmp_path / "robot-01.plan").chmod(0o640)
    write_missions(missions_of(LANES, FRAME), tmp_path, formats=["plan"])
    assert (tmp_path / "robot-01.plan").stat().st_mode & 0o777 == 0o640


def test_a_format_of_ones_own(tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text(
        "from shoal.missions import MissionFormat\nTEXT = MissionFormat('.mine', lambda mission:"
        " f'{mission.robot}\\n', lambda text, sheet: None)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    (path,) = write_missions(missions_of(LANES, FRAME, robot=4), tmp_path, formats=["mine:TEXT"])
    assert (path.name, path.read_text()) == ("robot-04.mine", "4\n")
    assert isinstance(FORMATS.get("plan"), MissionFormat)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("robot-01.plan", "{}", "expected the key 'fileType', got none"),
        ("robot-01.plan", "[]", r"expected a JSON object, got \[\]"),
        ("robot-01.plan", "[" * 100_000, "expected JSON, got values nested too deeply"),
        ("robot-01.waypoints", "", "expected 'QGC WPL 110', got 'an empty file'"),
        ("robot-01.kml", "<kml><Document/></kml>", "expected one Placemark named 'route', got 0"),
        ("robot-01.kml", "<kml>" + "<a>" * 500, "expected XML, got tags nested too deeply"),
        ("robot-01.gpx", "<kml/>", "line 1: expected <gpx>, got <kml>"),
        ("robot-01.csv", "", "expected the column 'number', got none"),
        ("robot-01.geojson", "[]", "expected a FeatureCollection"),
        (
            "robot-01.json",
            "{}",
            (
                r"expected a mission file \(.plan .waypoints .geojson .kml .gpx .csv\), got the"
                r" suffix '.json'"
            ),
        ),
    ],
)
def test_files_that_are_refused(name, content, said, tmp_path):
    (tmp_path / name).write_text(content)
    with pytest.raises(InvalidInputError, match=said):
        read_mission(tmp_path / name)


def test_a_plan_of_the_ground_station_itself(tmp_path):
    """Keys that it adds, such as the heights of its items, are passed over."""
    (path,) = write_missions(missions_of(LANES, FRAME), tmp_path, formats=["plan"])
    data = json.loads(path.read_text())
    for item in data["mission"]["items"]:
        item |= {"AMSLAltAboveTerrain": None, "Altitude": 30, "AltitudeMode": 1}
    data["mission"]["vehicleType"] = 13
    path.write_text(json.dumps(data))
    assert read_mission(path).kind == "multirotor"
    assert lint(path) == []


def test_check_sees_what_was_planned(field, tmp_path):
    region = open_region(field)
    missions, _ = swept(region, 20, vehicle=far(1500))
    paths = write_missions(missions, tmp_path)
    assert len(missions) > 2
    assert len(mission_files(tmp_path)) == len(paths)
    for name in FORMATS:
        result = check_missions(tmp_path, region, 20, format=name, separation=0)
        assert not result.diagnostics
        assert result.coverage.covered_fraction > 0.99999
        assert result.coverage.outside_m == 0
        assert len(result.files) == len(missions)


def test_check_measures_what_is_missing(field, tmp_path):
    region = open_region(field)
    missions, grid = swept(region, 20)
    kept = replace(missions[0], waypoints=missions[0].waypoints[:-2])
    write_missions([kept, missions[1]], tmp_path, formats=["gpx"])
    result = check_missions(tmp_path, region, 20)
    assert result.coverage.uncovered_m2 > grid.size**2
    assert result.coverage.covered_fraction == pytest.approx(
        1 - result.coverage.uncovered_m2 / region.area_m2
    )
    result.write_uncovered(tmp_path / "uncovered.geojson")
    left = open_region(tmp_path / "uncovered.geojson")
    assert left.area_m2 == pytest.approx(result.coverage.uncovered_m2, rel=1e-4)
    assert len(mission_files(tmp_path)) == 2
    with pytest.raises(InvalidInputError, match="expected a check with a footprint"):
        check_missions(tmp_path, region, None).write_uncovered(tmp_path / "uncovered.geojson")


def test_check_of_files_that_cannot_be_read(field, tmp_path):
    """A file with a fatal mistake is not flown, and its area not seen."""
    region = open_region(field)
    missions, _ = swept(region, 20)
    first, _ = write_missions(missions, tmp_path, formats=["kml"])
    first.write_text(first.read_text().replace("<name>home", "<name>base"))
    result = check_missions(tmp_path, region, 20)
    assert result.files == ("robot-02.kml",)
    assert 0.4 < result.coverage.covered_fraction < 0.6
    assert [diagnostic.rule for diagnostic in result.errors] == ["no-home"]


def test_check_in_metres(tmp_path):
    region = open_region("rectangle:200x100")
    missions, _ = swept(region, 20)
    write_missions(missions, tmp_path)
    assert check_missions(tmp_path, region, 20).coverage.covered_fraction > 0.9999999


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["none", "FIELD"], "expected a folder of mission files, got none"),
        (["FIELD", "FIELD"], "expected a folder of mission files, got a file"),
        (["empty", "FIELD"], "expected a folder with mission files, got a folder without"),
        (["missions", "nowhere.geojson"], "expected a region file, got no such file"),
        (
            ["missions", "square:100"],
            "expected a mission in metres, as the region 'square:100' is, got one in degrees",
        ),
        (["missions", "FIELD", "--footprint", "0"], "footprint: expected a number, above 0"),
        (["missions", "FIELD", "--least", "2"], "least: expected a number from 0 to 1"),
        (
            ["missions", "FIELD", "--format", "gpy"],
            "unknown mission format 'gpy': did you mean 'gpx'",
        ),
        (["missions", "FIELD", "--format", "gpx"], "expected files of the format 'gpx', got none"),
        (
            ["missions", "FIELD", "--autopilot", "dji"],
            "autopilot: expected one of px4, ardupilot, got 'dji'",
        ),
    ],
)
def test_bad_input_of_the_command(arguments, said, field, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    write_missions(missions_of(LANES, FRAME), "missions", formats=["plan"])
    assert (
        run(
            [
                "missions",
                "check",
                *(str(field) if word == "FIELD" else word for word in arguments),
                "--out",
                "out",
            ]
        )
        == 2
    )
    captured = capsys.readouterr()
    assert said in captured.err
    assert captured.err.count("\n") == 1
    assert not captured.out
    assert not (tmp_path / "out").exists()


def test_the_command(field, tmp_path, capsys):
    region = open_region(field)
    missions, _ = swept(region, 20)
    write_missions(missions, tmp_path / "missions")
    arguments = ["missions", "check", str(tmp_path / "missions"), str(field), "--footprint", "20"]
    assert run([*arguments, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["format"], result["files"], result["errors"]) == (
        "plan",
        ["robot-01.plan", "robot-02.plan"],
        0,
    )
    assert result["covered_fraction"] > 0.99999
    assert run([*arguments[:-1], "16", "--out", str(tmp_path / "out")]) == 1
    captured = capsys.readouterr()
    assert "of the region is seen, less than 99.9 %" in captured.err
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "check.json",
        "map.png",
        "uncovered.geojson",
    }
    written = json.loads((tmp_path / "out" / "check.json").read_text())
    assert 0.5 < written["covered_fraction"] < 0.95
    assert run([*arguments[:-1], "16", "--least", "0.5"]) == 0
    assert run(arguments[:-2]) == 0
    assert "not measured" in capsys.readouterr().out


def test_the_command_with_zones_beside(tmp_path, capsys):
    field, zone = tmp_path / "field.json", tmp_path / "zone.json"
    field.write_text(json.dumps(FIELD["features"][0]))
    zone.write_text(json.dumps(FIELD["features"][1]["geometry"]))
    missions, _ = swept(open_region(field), 20)
    write_missions(missions, tmp_path / "missions", formats=["plan"])
    assert run(["missions", "check", str(tmp_path / "missions"), str(field)]) == 0
    assert (
        run(["missions", "check", str(tmp_path / "missions"), str(field), "--no-go", str(zone)])
        == 1
    )
    assert "no-go zones" in capsys.readouterr().out


def test_the_way_from_home_is_not_seen(tmp_path):
    """What counts lies between the first waypoint and the last; a launch pad may lie outside."""
    mission = Mission([(10, 10), (90, 10)], (-50, 50), geographic=False)
    write_missions([mission], tmp_path)
    seen = check_missions(tmp_path, open_region("rectangle:100x20"), 20).coverage
    assert (seen.outside_m, seen.length_m, seen.covered_fraction) == (0, 80, 1)


CAMERA = "multirotor,sensor_width=13.2,sensor_height=8.8,focal_length=8.8"


def round_the_zone(start, end):
    """Return a path that goes round the corner (250, 0)."""
    corner = (250.0, 0.0)
    return [start, end] if np.allclose(start, corner) else [start, corner, end]


def test_cameras_take_no_images_on_the_ways_out_and_home(tmp_path):
    """The trigger stayed on until the last waypoint: pictures of the way home around a no-go zone,
    drawn as if searched.
    """
    (mission,) = missions_of(
        [(250, 0), *LANES], FRAME, vehicle=CAMERA, home=(400, -100), find_path=round_the_zone, out=1
    )
    assert (mission.waypoints_out, mission.waypoints_home) == (1, 1)
    np.testing.assert_allclose(
        FRAME.to_metres(mission.waypoints[mission.searched]),
        merge_straight_legs(np.array(LANES), 0.001),
        atol=0.01,
    )
    for path in write_missions([mission], tmp_path):
        read = read_mission(path)
        assert (read.waypoints_out, read.waypoints_home) == (1, 1), path
    rows = json.loads((tmp_path / "robot-01.plan").read_text())["mission"]["items"]
    count = len(mission.waypoints) - 2
    assert [row["command"] for row in rows if row["command"] in (16, 206)] == [
        16,
        *[16, 206] * count,
        206,
        16,
    ]
    assert lint(tmp_path) == []
    region = region_of(shapely.box(-100, -40, 300, 40), frame=FRAME)
    seen = check_missions(tmp_path, region, 20.0).coverage
    assert seen.length_m == pytest.approx(4 * 180 - 180 + 40, abs=0.1)  # three rows and two steps
    (axes,) = missions_figure([read_mission(tmp_path / "robot-01.plan")], region).axes
    round_corner = [
        line for line in axes.lines if (np.hypot(*(line.get_xydata() - (250.0, 0.0)).T) < 0.1).any()
    ]
    assert [line.get_linestyle() for line in round_corner] == ["--", "--"]


def test_sorties_search_from_where_they_join_the_route_to_where_they_leave_it():
    vehicle = CAMERA + ",endurance=3,reserve=0"
    missions = missions_of(
        LANES,
        FRAME,
        vehicle=vehicle,
        home=(-90, -80),
        find_path=lambda start, end: [start, (-90.0, -60.0), end],
    )
    assert len(missions) > 1
    ends = [FRAME.to_metres(mission.waypoints[mission.searched])[[0, -1]] for mission in missions]
    for before, after in pairwise(ends):
        np.testing.assert_allclose(before[1], after[0], atol=0.01)
    assert all((mission.waypoints_out, mission.waypoints_home) == (1, 1) for mission in missions)


def test_a_search_that_ends_with_a_descent_counts_its_last_waypoint():
    """The descent has both ends at one place: its lower end was taken for the way home, and a cell
    there was not seen.
    """
    (mission,) = missions_of(
        [(0, 0, 25), (50, 0, 25), (50, 0, 15)], None, vehicle="multirotor", home=(0, 0)
    )
    assert (mission.waypoints_out, mission.waypoints_home) == (0, 0)


def test_durations_and_their_share_of_the_battery(field, tmp_path, capsys):
    region = open_region(field)
    missions, _ = swept(region, 20, vehicle="multirotor,endurance=20,reserve=0.25")
    write_missions(missions, tmp_path, vehicle=vehicle_of("multirotor,endurance=20,reserve=0.25"))
    told = json.loads((tmp_path / "missions.json").read_text())
    assert (
        told["durations_s"].keys()
        == told["usable_fractions"].keys()
        == {mission.name for mission in missions}
    )
    assert told["usable_fractions"]["robot-01"] == pytest.approx(
        (told["durations_s"]["robot-01"] + RETURN) / 900
    )
    arguments = ["missions", "check", str(tmp_path), str(field), "--footprint", "20", "--vehicle"]
    assert run([*arguments, "multirotor,endurance=20,reserve=0.25"]) == 0
    minutes, share = (
        told["durations_s"]["robot-01"] / 60,
        100 * told["usable_fractions"]["robot-01"],
    )
    out = " ".join(capsys.readouterr().out.split())
    said = re.search(
        r"flight robot-01: ([\d.]+) min, with a climb of its return ([\d.]+) % of the 15 min that the"
        r" battery allows without its reserve",
        out,
    )
    assert [float(number) for number in said.groups()] == pytest.approx([minutes, share], rel=0.01)
    assert run([*arguments, f"multirotor,endurance={minutes * 1.2},reserve=0.25"]) == 1
    out = " ".join(capsys.readouterr().out.split())
    assert re.search(
        r"expected a mission of at most [\d.]+ min, the endurance without the reserve, got", out
    )
    assert run([*arguments, "ideal", "--json"]) == 0
    flights = json.loads(capsys.readouterr().out)["flights"]
    assert [one["mission"] for one in flights] == [mission.name for mission in missions]
    assert {one["usable_fraction"] for one in flights} == {None}


def test_the_battery_lasts_for_the_climb_of_a_return(tmp_path):
    small = vehicle_of("multirotor,endurance=3.2,reserve=0")
    returning = missions_of(LANES, FRAME, vehicle=small)
    landing = missions_of(LANES, FRAME, vehicle=small, ending="land")
    assert len(returning) > 1
    for mission in returning:
        assert mission.battery_seconds(small) == pytest.approx(mission.duration(small) + RETURN)
        assert mission.battery_seconds(small) <= small.usable_seconds
    assert landing[0].battery_seconds(small) == landing[0].duration(small)
    assert landing[0].duration(small) > returning[0].duration(small) + RETURN / 2
    high = missions_of(LANES, FRAME, vehicle="multirotor,altitude=60")[0]
    assert high.battery_seconds(small) == high.duration(small)
    # the check: a mission that the battery allows without the climb only
    (whole,) = missions_of(LANES, FRAME, vehicle="multirotor")
    write_missions([whole], tmp_path, formats=["plan"])
    for spare, mistakes in ((RETURN - 1, 1), (RETURN + 1, 0)):
        minutes = (whole.duration(small) + spare) / 60
        found = lint(tmp_path, vehicle=vehicle_of(f"multirotor,reserve=0,endurance={minutes!r}"))
        told = [one.sentence for one in found if one.rule == "endurance"]
        assert len(told) == mistakes
        assert all(one.endswith("min with the climb of its return") for one in told)


@pytest.mark.parametrize("options", [{"separation": 0}, {"separation": 10, "ending": "return"}])
def test_a_later_sortie_starts_after_the_climb_of_a_return(options, tmp_path):
    problem = SearchProblem(
        "square:200", robots=2, footprint=20, vehicle="multirotor,endurance=4,recharge=1"
    )
    planned = MissionSet.from_problem(problem, MissionOptions(**options), seed=1)
    vehicle, missions = planned.plan.vehicle, planned.missions
    assert max(mission.sortie for mission in missions) > 2
    for before, after in pairwise(missions):
        if before.robot == after.robot:
            ready = before.start + before.battery_seconds(vehicle) + vehicle.recharge_seconds
            assert before.battery_seconds(vehicle) == before.duration(vehicle) + RETURN
            assert after.start >= ready - 1e-6
            if not options["separation"]:  # the plan has the same times
                times = planned.plan.sorties[after.robot - 1]
                assert times[after.sortie - 1][0] == pytest.approx(after.start, abs=0.5)
    # the check: a start that is too early by the climb alone
    late = missions[1]
    assert (late.robot, late.sortie) == (1, 2)
    ready = missions[0].battery_seconds(vehicle)
    for start, mistakes in ((ready + 1, 0), (ready - RETURN + 1, 1)):
        write_missions(
            [missions[0], replace(late, start=start)], tmp_path, formats=["csv"], vehicle=vehicle
        )
        found = lint(tmp_path, vehicle=vehicle)
        assert [one.rule for one in found].count("sorties-overlap") == mistakes


@pytest.mark.parametrize("landing", [None, "-10,-10"])
@pytest.mark.parametrize(
    "vehicle",
    [
        "multirotor,altitude=30,endurance=9,recharge=5",
        "fixed-wing,altitude=40,turn_radius=20,endurance=9,recharge=5",
        "rover,endurance=59,recharge=5",
    ],
)
def test_a_plan_without_missions_has_the_flights_of_missions_with_default_options(vehicle, landing):
    """Plans of multirotors counted the climb of a return, and flew more sorties than missions."""
    problem = SearchProblem(
        "rectangle:800x400", robots=2, footprint=30, vehicle=vehicle, land=landing
    )
    plan = plan_search(problem, seed=1)
    assert len(plan.sorties[0]) > 1
    every = [{}, {"separation": 0}, {"separation": 0, "ending": "land"}]
    every += [{"separation": 0, "ending": "return"}] if landing is None else []
    for options in every:
        planned = MissionSet.from_plan(plan, MissionOptions(**options))
        durations = [planned.scheduled.sorties, planned.plan.sorties]
        durations += [] if options else [plan.sorties]
        first, *others = (
            [seconds for sorties in own for _, seconds in sorties] for own in durations
        )
        for other in others:
            assert other == pytest.approx(first, abs=0.1)
        if options:  # without staggered starts
            assert planned.plan.planned_seconds == pytest.approx(planned.end, abs=0.1)


def test_a_plan_keeps_the_climb_of_a_return_in_the_battery():
    problem = SearchProblem("rectangle:300x200", robots=1, footprint=20, vehicle="multirotor")
    returns = MissionOptions(ending="return")
    made = MissionSet.from_problem(problem, returns)
    (plain,), names = made.missions, made.plan
    minutes = (plain.duration(vehicle_of("multirotor")) + RETURN / 2) / 60
    tight = problem.replaced(
        vehicle=f"multirotor,reserve=0,recharge=1,endurance={minutes!r}",
        tour=names.tour.name,
        allocation=names.allocation.allocator,
    )
    assert len(MissionSet.from_problem(tight, returns).missions) == 2


def test_a_mission_set_is_planned_checked_written_read_and_run(tmp_path):
    problem = SearchProblem("rectangle:120x80", robots=2, footprint=20)
    made = MissionSet.from_problem(problem, MissionOptions(format=("csv",)), seed=1)
    assert made.plan.vehicle.kind == "multirotor"  # missions need a vehicle
    check = made.check()
    assert not check.faults
    assert check.approach is None or check.approach.horizontal >= 10
    made.write(tmp_path)
    read = MissionSet.read(tmp_path)
    assert [mission.name for mission in read.missions] == ["robot-01", "robot-02"]
    assert read.check(made.check_options).report() == check.report()
    assert made.run().status.done
    with pytest.raises(InvalidInputError, match="options: expected the region of missions"):
        read.check()
    with pytest.raises(InvalidInputError, match="expected planned missions to run"):
        read.run()


def test_written_missions_repeat_no_waypoint(tmp_path, capsys):
    """The missions of the README's search did, six times."""
    search = ["search", "ring:60x30", "--robots", "3", "--footprint", "10", "--no-simulate"]
    assert run([*search, "--missions", str(tmp_path)]) == 0
    assert run(["missions", "check", str(tmp_path), "ring:60x30", "--footprint", "10"]) == 0
    assert "again" not in capsys.readouterr().out
