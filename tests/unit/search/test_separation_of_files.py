"""The separation of missions in files of any origin: which missions are compared, and at which
heights.
"""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from shoal.cli import run
from shoal.missions import Mission, check_missions, lint, read_mission, write_missions
from shoal.missions.approach import missions_approach
from shoal.missions.fence import Fence
from shoal.search import open_region
from shoal.search.flight.separation import Separation
from shoal.search.flight.timing import RETURN_HEIGHT
from shoal.search.regions.projection import LocalFrame

FRAME = LocalFrame(8.502, 47.401)
SEPARATION = Separation(15.0, 5.0, 10.0)


def write_field(folder):
    folder.mkdir(exist_ok=True)
    ring = FRAME.to_degrees(np.array([(-150, -150), (150, -150), (150, 150), (-150, 150)]))
    geometry = {"type": "Polygon", "coordinates": [[*ring.tolist(), ring[0].tolist()]]}
    path = folder / "field.json"
    path.write_text(json.dumps({"type": "Feature", "properties": {}, "geometry": geometry}))
    return str(path)


@pytest.fixture(scope="module")
def region(tmp_path_factory):
    return open_region(write_field(tmp_path_factory.mktemp("field")))


def degrees(points):
    return [tuple(place) for place in FRAME.to_degrees(np.array(points, dtype=float)).tolist()]


def mission(points=((-100, 80), (100, 80)), home=(-100, -80), *, lands=True, **changes):
    """Return a mission with its places in metres. By default it lands at its home."""
    (place,) = degrees([home])
    return Mission(degrees(points), place, landing=place if lands else None, **changes)


def renamed(folder, names):
    """Give files other names, and take the manifest away, as folders of other programs have none."""
    for old, new in names.items():
        (folder / old).rename(folder / new)
    (folder / "missions.json").unlink(missing_ok=True)


def rules(check):
    return {diagnostic.rule for diagnostic in check.diagnostics}


@pytest.mark.parametrize("suffix", [".plan", ".waypoints"])
def test_files_without_a_robot_are_different_vehicles(suffix, tmp_path, region):
    form = "plan" if suffix == ".plan" else "wpl"
    write_missions([mission(), mission(robot=2)], tmp_path, formats=[form])
    renamed(tmp_path, {f"robot-01{suffix}": f"alpha{suffix}", f"robot-02{suffix}": f"beta{suffix}"})
    found = check_missions(tmp_path, region, None, separation=SEPARATION)
    assert found.approach is not None
    assert found.approach.robots == (1, 2)
    assert found.approach.horizontal < 0.01
    assert found.faults


def test_a_file_without_a_robot_takes_a_free_number(tmp_path, region):
    write_missions([mission(), mission(robot=2)], tmp_path, formats=["plan", "wpl"])
    renamed(tmp_path, {"robot-02.plan": "another.plan", "robot-02.waypoints": "another.waypoints"})
    found = check_missions(tmp_path, region, None, separation=SEPARATION)
    assert [one.robot for one in found.missions] == [1, 2]
    assert found.approach.horizontal < 0.01
    assert "same-robot" not in rules(found)  # the other format is no other vehicle


@pytest.mark.parametrize("form", ["plan", "geojson", "gpx"])
def test_two_files_of_one_robot_are_a_mistake_and_two_vehicles(form, tmp_path, region):
    suffix = f".{form}"
    write_missions([mission(start=0.0)], tmp_path, formats=[form])
    text = (tmp_path / f"robot-01{suffix}").read_text()
    (tmp_path / f"robot-1{suffix}").write_text(text)
    (tmp_path / "missions.json").unlink()
    found = check_missions(tmp_path, region, None, separation=SEPARATION)
    assert "same-robot" in rules(found)
    assert "sorties-overlap" not in rules(found)
    assert found.approach.horizontal < 0.01


def test_missions_of_one_robot_and_sortie_are_compared():
    near = missions_approach([mission(), mission()], SEPARATION, FRAME)
    assert near is not None
    assert near.horizontal < 0.01


def test_an_unknown_elevation_is_no_elevation_of_0():
    known = mission(elevation=400.0)
    near = missions_approach([known, mission(robot=2)], SEPARATION, FRAME)
    assert near is not None
    assert near.horizontal < 0.01
    assert near.vertical == pytest.approx(0.0, abs=0.01)
    apart = missions_approach([known, mission(robot=2, elevation=300.0)], SEPARATION, FRAME)
    assert apart is None
    above_sea = mission(robot=2, altitude=430.0, altitude_frame="sea")
    near = missions_approach([known, above_sea], SEPARATION, FRAME)
    assert near is not None  # both say their height above the sea
    assert near.vertical == pytest.approx(0.0, abs=5.0)


def crossing(**changes):
    """Return two missions whose ways home cross at the same time."""
    first = mission(((-100, 80), (100, 80)), (-100, -80), altitude=30.0, **changes)
    second = mission(((100, 80), (-100, 80)), (100, -80), altitude=40.0, robot=2, **changes)
    return [first, second]


def test_a_return_may_climb_to_any_height(tmp_path, region):
    assert missions_approach(crossing(lands=True), SEPARATION, FRAME).horizontal > 100
    write_missions(crossing(lands=False), tmp_path, formats=["plan"])
    found = check_missions(tmp_path, region, None, separation=SEPARATION)
    assert found.approach.horizontal < 1
    assert found.approach.vertical is None
    assert found.faults == [
        "robots 1 and 2 come within 0 m, and their difference in height is unknown"
    ]


def test_a_return_is_late_by_its_climb_to_the_return_height():
    first, second = crossing(lands=False)
    far = replace(second, start=10.0 + RETURN_HEIGHT)  # a second for each metre is not reached
    near = missions_approach([first, far], Separation(15.0, 5.0, 0.0), FRAME)
    assert near is None or near.horizontal > 15
    later = replace(second, start=3.5)  # first: 30 m more at 5 m/s, second: 2 s more before
    near = missions_approach([first, later], Separation(15.0, 5.0, 0.0), FRAME)
    assert near.horizontal < 1


def test_a_landing_without_a_place_is_where_the_vehicle_is(tmp_path, region):
    """It counted as a flight home."""
    write_missions(crossing(lands=True), tmp_path, formats=["plan"])
    for path in tmp_path.glob("*.plan"):
        plan = json.loads(path.read_text())
        landing = plan["mission"]["items"][-1]
        assert landing["command"] == 21
        landing["params"][4:6] = [None, None]
        path.write_text(json.dumps(plan))
    first, second = (read_mission(path) for path in sorted(tmp_path.glob("*.plan")))
    for read in (first, second):
        assert read.landing == pytest.approx(tuple(read.waypoints[-1]))
    found = check_missions(tmp_path, region, None, separation=SEPARATION)
    assert found.approach.horizontal > 50
    assert not found.faults


def test_heights_above_the_terrain_count_as_any_height(tmp_path, region):
    write_missions(
        [mission(robot=k, altitude=30.0 * k, autopilot="ardupilot") for k in (1, 2)],
        tmp_path,
        formats=["wpl"],
    )
    for path in tmp_path.glob("*.waypoints"):
        rows = [line.split("\t") for line in path.read_text().splitlines()]
        for row in rows[1:]:
            if row[3] == "16" and row[0] != "0":
                row[2] = "10"
        path.write_text("\n".join("\t".join(row) for row in rows) + "\n")
    found = check_missions(tmp_path, region, None, separation=SEPARATION)
    assert found.approach.vertical is None
    assert found.approach.horizontal < 0.01
    short = "multirotor,endurance=1"
    found = check_missions(tmp_path, region, None, separation=SEPARATION, vehicle=short)
    assert "endurance" in rules(found)
    assert len(found.flights) == 2


def test_homes_of_unknown_and_of_known_height_are_told(tmp_path, region):
    write_missions([mission(elevation=400.0, start=0.0)], tmp_path, formats=["plan"])
    found = check_missions(tmp_path, region, None, separation=SEPARATION)
    assert "elevation-missing" not in rules(found)
    missions = [mission(elevation=400.0, start=0.0), mission(robot=2, start=0.0)]
    write_missions(missions, tmp_path, formats=["plan"])
    found = check_missions(tmp_path, region, None, separation=SEPARATION)
    assert "elevation-missing" in rules(found)
    assert found.approach.horizontal < 0.01


def test_a_mission_without_a_file_of_the_checked_format_is_told(tmp_path, region, capsys):
    write_missions([mission()], tmp_path, formats=["plan"])
    write_missions([mission(robot=2)], tmp_path / "other", formats=["wpl"])
    (tmp_path / "other" / "robot-02.waypoints").rename(tmp_path / "robot-02.waypoints")
    found = check_missions(tmp_path, region, None, separation=SEPARATION)
    assert [one.file for one in found.errors if one.rule == "format-missing"] == [
        "robot-02.waypoints"
    ]
    assert found.uncompared == ("robot-02.waypoints",)
    field = write_field(tmp_path / "field")
    assert run(["missions", "check", str(tmp_path), field, "--separation", "15,5"]) == 1
    assert "not compared:" in capsys.readouterr().out


@pytest.mark.parametrize(("second", "told"), [(5.0, True), (400.0, False)])
def test_sorties_of_one_vehicle_do_not_overlap(second, told, tmp_path, region):
    sorties = [mission(start=0.0), mission(sortie=2, start=second)]
    write_missions(sorties, tmp_path, formats=["plan"])
    found = check_missions(tmp_path, region, None, separation=SEPARATION)
    assert ("sorties-overlap" in rules(found)) == told
    assert (found.faults != []) == told


def test_vehicles_without_start_times_are_told(tmp_path, region):
    missions = [mission(start=0.0), mission(robot=2, start=300.0)]
    write_missions(missions, tmp_path, formats=["plan"])
    found = check_missions(tmp_path, region, None, separation=SEPARATION)
    assert "no-start" not in rules(found)
    manifest = json.loads((tmp_path / "missions.json").read_text())
    del manifest["starts_s"]
    (tmp_path / "missions.json").write_text(json.dumps(manifest))
    found = check_missions(tmp_path, region, None, separation=SEPARATION)
    assert "no-start" in rules(found)
    assert found.approach.horizontal < 0.01


@pytest.mark.parametrize("kind", ["multirotor", "fixed-wing"])
@pytest.mark.parametrize(("autopilot", "flies"), [("px4", True), ("ardupilot", False)])
def test_the_place_of_a_take_off_is_checked_like_a_waypoint(kind, autopilot, flies, tmp_path):
    around = np.array(degrees([(-150, -150), (150, -150), (150, 150), (-150, 150)]))
    one = mission(kind=kind, autopilot=autopilot, fence=Fence(around), waypoints_out=0)
    write_missions([one], tmp_path, formats=["plan"])
    path = tmp_path / "robot-01.plan"
    before = read_mission(path)
    assert len(before.waypoints) == 2
    assert [fault for fault in lint(tmp_path) if fault.rule == "fence"] == []
    data = json.loads(path.read_text())
    (place,) = degrees([(-100, 4000)])
    data["mission"]["items"][0]["params"][4:6] = place[::-1]
    path.write_text(json.dumps(data))
    far = read_mission(path)
    assert ("fence" in {fault.rule for fault in lint(tmp_path)}) == flies
    assert (far.length > before.length + 7000) == flies
    assert len(far.waypoints) == 2 + flies
