"""Missions started each at its time, and watched to their end, on simulated time."""

from __future__ import annotations

import json
import re
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from tests.unit.robots.test_upload import missions

from shoal.cli import run
from shoal.core import notices
from shoal.core.errors import InvalidInputError
from shoal.missions import write_missions

pytest.importorskip("pymavlink")

from dataclasses import replace

from shoal.robots import modes, uploading
from shoal.robots.mavlink import Station
from shoal.robots.onboard import pair, read_cargos, read_seats
from shoal.robots.simulated import SimulatedLink, SimulatedVehicle
from shoal.robots.starting import Fleet, check_fleet, start_missions, watch_fleet
from shoal.robots.uploading import upload_missions
from shoal.search.regions.formats.flight_logs import read_tracks

LATER = 20.0  # seconds


def test_no_robot_is_left_out_whose_file_is_in_another_format(tmp_path):
    write_missions(missions(), tmp_path, formats=["plan", "wpl"])
    assert {cargo.file.suffix for cargo in read_cargos(tmp_path).values()} == {".plan"}
    (tmp_path / "robot-02.plan").unlink()
    with pytest.raises(InvalidInputError, match=r"a file \.plan of each robot, got robot-02\.wayp"):
        read_cargos(tmp_path)


@pytest.fixture
def folder(tmp_path):
    first, second = missions()
    write_missions(
        [replace(first, start=0.0), replace(second, start=LATER)], tmp_path, formats=["plan"]
    )
    return tmp_path


def fleet_of(folder, *vehicles, upload=True, **about):
    pairs = pair(read_cargos(folder), read_seats("1=1,2=2"))
    link = SimulatedLink(vehicles, **about)
    if upload:
        assert {one.status for one in upload_missions(pairs, [Station(link)])} == {"equal"}
    return Fleet(pairs, [Station(link)]), link


def two(autopilot="px4", **second):
    return SimulatedVehicle(1, autopilot=autopilot), SimulatedVehicle(
        2, autopilot=autopilot, **second
    )


@pytest.mark.parametrize(("autopilot", "loss"), [("px4", 0.3), ("ardupilot", 0.0)])
def test_each_starts_at_its_time_flies_its_mission_and_lands(folder, autopilot, loss):
    vehicles = two(autopilot)
    fleet, link = fleet_of(folder, *vehicles, loss=loss, seed=2)
    assert check_fleet(fleet), [one.sentence for one in fleet.launches.values()]
    assert not any(one.armed for one in vehicles)
    begin = link.now() + 5
    start_missions(fleet, begin=begin)
    late = [one.started_s - one.start for one in fleet.launches.values()]
    assert [one.status for one in fleet.launches.values()] == ["started"] * 2
    assert 0 <= min(late) <= max(late) < (2 if not loss else 10)
    # armed at their times, and not before
    for vehicle, planned in zip(vehicles, (0.0, LATER), strict=True):
        assert 0 <= vehicle.armed_at - begin - planned < (1 if not loss else 10)
    seen = []
    watch_fleet(
        fleet, seconds=600, on_report=lambda launches: seen.append(launches[0].telemetry.item)
    )
    assert [vehicle.armed for vehicle in vehicles] == [False, False]
    assert all(np.linalg.norm(vehicle.position) < 2 for vehicle in vehicles)  # they are back
    assert all(vehicle.breaches == 0 for vehicle in vehicles)
    assert max(item for item in seen if item is not None) >= 6
    assert fleet.now() < 500


def test_nothing_goes_on_board_without_start_times_or_the_fence_that_is_listed(folder, monkeypatch):
    told = []
    monkeypatch.setattr(notices, "listeners", [told.append])
    list_of_files = folder / "missions.json"
    whole = json.loads(list_of_files.read_text())
    for content, sentence in (
        ("{", "missions.json: expected JSON"),
        (json.dumps(whole | {"starts_s": {"robot-02": "soon"}}), "starts_s, robot-02: expected"),
        (json.dumps(whole | {"files": [*whole["files"], "fence.txt"]}), "the file fence.txt, got"),
    ):
        list_of_files.write_text(content)
        with pytest.raises(InvalidInputError, match=sentence):
            read_cargos(folder)
    assert told == []
    list_of_files.unlink()
    assert len(read_cargos(folder)) == 2
    assert "all missions start at 0 s" in told[0]


def test_a_vehicle_that_refuses_to_arm_keeps_all_on_the_ground(folder):
    vehicles = two("ardupilot", refuses_to_arm="compass not calibrated")
    fleet, _ = fleet_of(folder, *vehicles)
    assert not check_fleet(fleet)
    assert [one.status for one in fleet.launches.values()] == ["ready", "not ready"]
    assert "arming checks fail" in fleet.launches[2].sentence


def test_another_mission_on_board_is_not_started(folder):
    vehicles = two()
    fleet, _ = fleet_of(folder, *vehicles)
    item = vehicles[1].stored["mission"][3]
    vehicles[1].stored["mission"][3] = item._replace(z=item.z + 1)
    assert not check_fleet(fleet)
    assert "mission item 3: expected altitude" in fleet.launches[2].sentence


def test_a_low_battery_is_told(folder):
    vehicles = two()
    vehicles[0].charge = 0.2
    fleet, _ = fleet_of(folder, *vehicles)
    assert not check_fleet(fleet)
    assert "expected a battery of 30 %, got 20 %" in fleet.launches[1].sentence


def test_an_unknown_battery_is_not_full_enough(folder):
    vehicles = two()
    vehicles[0].charge_unknown = True
    fleet, _ = fleet_of(folder, *vehicles)
    assert not check_fleet(fleet)
    assert "expected a battery of 30 %, got no report of it" in fleet.launches[1].sentence
    fleet, _ = fleet_of(folder, *vehicles)
    assert check_fleet(fleet, lowest_battery=0)


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_refusal_at_the_start_holds_up_nobody_else(folder, autopilot):
    vehicles = two(autopilot)
    fleet, link = fleet_of(folder, *vehicles)
    assert check_fleet(fleet)
    vehicles[0].refuses_to_arm = "the propeller is missing"
    start_missions(fleet, begin=link.now(), tolerance=25.0)  # longer than until the other start
    first, second = fleet.launches.values()
    assert (first.status, second.status) == ("not started", "started")
    assert "the propeller is missing" in first.sentence
    assert second.started_s - LATER < 2
    assert not vehicles[0].armed


def test_a_vehicle_that_is_late_does_not_start(folder):
    vehicles = two()
    fleet, link = fleet_of(folder, *vehicles)
    assert check_fleet(fleet)
    vehicles[0]._silent_until = link.now() + 15
    start_missions(fleet, begin=link.now(), tolerance=10.0)
    assert [one.status for one in fleet.launches.values()] == ["not started", "started"]
    fleet.listen(fleet.now() + 20)
    assert not vehicles[0].armed


def test_a_breach_of_the_fence_is_watched(folder):
    vehicles = two()
    fleet, link = fleet_of(folder, *vehicles)
    assert check_fleet(fleet)
    start_missions(fleet, begin=link.now())
    vehicles[0].position[0] = 20_000.0
    watch_fleet(fleet, seconds=10)
    assert vehicles[0].mode == modes.RETURN
    assert [one.telemetry.breaches for one in fleet.launches.values()] == [1, 0]


def test_a_lost_ground_station_or_a_low_battery_brings_the_vehicle_home(folder):
    fleet, link = fleet_of(folder, *two(station_timeout=5.0))
    link.vehicles[0].battery = 60.0
    assert check_fleet(fleet)
    start_missions(fleet, begin=link.now())
    link.loss = 1.0  # nobody hears anybody
    link.receive(300)
    now = link.now()
    while link.now() < now + 300:
        link.receive(50)
    assert [vehicle.armed for vehicle in link.vehicles] == [False, False]
    assert all(vehicle.position[2] == 0 for vehicle in link.vehicles)


def test_a_watch_ends_in_time_though_no_vehicle_is_heard(folder, capsys, monkeypatch):
    link = SimulatedLink(two(), loss=1.0)
    monkeypatch.setattr(
        uploading, "open_stations", lambda _links, limits: nullcontext([Station(link, limits)])
    )
    begin = link.now()
    about = ["--connect", "udpin:127.0.0.1:14550", "--systems", "1=1,2=2"]
    assert run(["missions", "watch", str(folder), *about, "--seconds", "2"]) == 1
    assert "expected a heartbeat of system 1 within 2 s, got none" in capsys.readouterr().err
    assert link.now() - begin < 3


def test_the_commands_start_only_with_arm(folder, tmp_path, capsys, monkeypatch):
    vehicles = two()
    link = SimulatedLink(vehicles)
    monkeypatch.setattr(
        uploading,
        "open_stations",
        lambda _links, limits=None: nullcontext([Station(link, limits)]),
    )
    about = [str(folder), "--connect", "udpin:127.0.0.1:14550", "--systems", "1=1,2=2", "--json"]

    def report(name, *more):
        code = run(["missions", name, *about, *more])
        out, err = capsys.readouterr()
        return code, json.loads(out) if out else None, err

    code, _, err = report("start", "--arm")
    assert code == 1
    assert "expected 9 items on board, got 0" in err
    assert report("upload")[0] == 0
    code, found, _ = report("start")
    assert (code, found["armed"]) == (0, False)
    assert [one["status"] for one in found["robots"]] == ["ready"] * 2
    assert not any(vehicle.armed for vehicle in vehicles)
    code, found, _ = report("watch", "--seconds", "3")
    first = found["robots"][0]
    assert (code, first["armed"], first["mode"], first["breaches"]) == (0, False, "manual", 0)
    code, found, _ = report("start", "--arm", "--at", "+2", "--robots", "1")
    assert (code, found["armed"], found["robots"][0]["status"]) == (0, True, "started")
    assert [vehicle.armed for vehicle in vehicles] == [True, False]
    code, found, _ = report("watch", "--robots", "1")
    assert (code, found["robots"][0]["armed"], vehicles[0].armed) == (0, False, False)
    out = tmp_path / "second"
    watching = ["--arm", "--at", "+1", "--watch", "--out", str(out), "--robots", "2"]
    code, found, err = report("start", *watching)
    assert (code, found["robots"][0]["status"], vehicles[1].armed) == (0, "started", False)
    assert "armed in mission, item" in err
    highest = {track.system: max(track.heights) for track in read_tracks(out / "flight.tlog")}
    assert highest == pytest.approx({1: 0, 2: 30}, abs=2)
    code, _, err = report("start", *watching)
    assert (code, "expected a folder without flight.tlog" in err) == (2, True)
    assert json.loads((out / "start.json").read_text()) == found
    for without in (["--at", "+1"], ["--delay-tolerance", "3"], ["--watch"]):
        code, _, err = report("start", *without)
        assert (code, "expected --arm together with it" in err) == (2, True)


@pytest.mark.parametrize("at", ["25:00", "soon", "+-1", "12:60"])
def test_a_wrong_time_is_refused(folder, capsys, at):
    about = [str(folder), "--connect", "udpin:127.0.0.1:14550", "--systems", "1=1,2=2"]
    assert run(["missions", "start", *about, "--arm", "--at", at]) == 2
    assert "at: expected" in capsys.readouterr().err


def test_the_page_has_vehicles_that_fit_the_missions(folder, monkeypatch):
    page = (Path(__file__).parents[3] / "docs" / "concepts" / "missions.md").read_text()
    (script,) = re.findall(r'```python title="vehicles.py"\n(.*?)```', page, re.S)
    run_on = []
    monkeypatch.setattr("shoal.robots.run_vehicles", lambda *about: run_on.append(about))
    monkeypatch.chdir(folder.parent)
    folder.rename(folder.parent / "missions")
    exec(script, {})
    ((vehicles, link),) = run_on
    link.close()
    assert [one.system for one in vehicles] == [1, 2]
    fleet, _ = fleet_of(folder.parent / "missions", *vehicles)
    assert check_fleet(fleet)
