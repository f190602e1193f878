"""Missions on board of vehicles: uploads over links that lose, double and delay, to autopilots that
round, drop and mix, and what is read back.
"""

from __future__ import annotations

import json
import threading
from dataclasses import replace

import numpy as np
import pytest
from tests.missions import missions_of

from shoal.cli import run
from shoal.core.errors import InvalidInputError
from shoal.missions import write_missions
from shoal.missions.fence import Fence
from shoal.missions.formats.items import Item
from shoal.search import LocalFrame

pytest.importorskip("pymavlink")

from shoal.robots.mavlink import LinkLimits, Station, open_link
from shoal.robots.mission_protocol import (
    FENCE,
    MISSION,
    RALLY,
    compare_items,
    download_items,
    item_on_air,
    upload_items,
)
from shoal.robots.onboard import pair, read_cargos, read_seats
from shoal.robots.simulated import Quirks, SimulatedLink, SimulatedVehicle, run_vehicles
from shoal.robots.uploading import items_for, upload_missions
from shoal.search.regions.formats.flight_logs import dialect

HOME = (8.5, 47.4)
AROUND = np.array([(8.4, 47.3), (8.6, 47.3), (8.6, 47.5), (8.4, 47.5)])
ZONE = np.array([(8.51, 47.41), (8.52, 47.41), (8.52, 47.42)])
LANES = [(0, 0), (90, 0), (90, 20), (0, 20), (0, 40), (90, 40)]
BOTH = {1: 1, 2: 7}


def missions(count=2, *, fenced=True, vehicle="multirotor", autopilot="px4"):
    """Return a mission for each robot, with a fence and a rally point."""
    made = []
    for robot in range(1, count + 1):
        (mission,) = missions_of(
            np.array(LANES, dtype=float) + 5.0 * robot,
            LocalFrame(*HOME),
            robot=robot,
            vehicle=vehicle,
            autopilot=autopilot,
        )
        made.append(
            replace(mission, fence=Fence(AROUND, (ZONE,)), rally=(HOME,)) if fenced else mission
        )
    return made


@pytest.fixture
def folder(tmp_path):
    write_missions(missions(), tmp_path, formats=["plan"])
    return tmp_path


def pairs_of(folder, systems=BOTH, **options):
    text = ",".join(f"{robot}={system}" for robot, system in systems.items())
    return pair(read_cargos(folder), read_seats(text), **options)


def uploaded(folder, *vehicles, limits=None, systems=BOTH, **about):
    """Return the deliveries to vehicles on one simulated link, by robot, and the link."""
    link = SimulatedLink(vehicles, **about)
    pairs = pairs_of(folder, systems)
    made = upload_missions(pairs, [Station(link, limits)])
    return {one.robot: one for one in made}, link


def two(autopilot="px4", **quirks):
    return (
        SimulatedVehicle(1, autopilot=autopilot, quirks=Quirks(**quirks)),
        SimulatedVehicle(7, autopilot=autopilot),
    )


def on_board(folder, vehicle, robot=1):
    """Return the numbers of items that differ on board from the files, by kind, without protocol."""
    cargo = read_cargos(folder)[robot]
    return {
        kind: compare_items(
            kind,
            [item_on_air(item) for item in cargo.items[kind]],
            vehicle.stored[kind],
            autopilot=12,
        ).different
        for kind in (MISSION, FENCE, RALLY)
    }


NONE = {MISSION: 0, FENCE: 0, RALLY: 0}


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize("form", ["plan", "wpl"])
def test_each_vehicle_gets_what_its_file_says(tmp_path, autopilot, form):
    write_missions(missions(autopilot=autopilot), tmp_path, formats=[form])
    vehicles = two(autopilot)
    made, _ = uploaded(tmp_path, *vehicles)
    assert [
        (one.status, one.different, one.mission, one.fence, one.rally) for one in made.values()
    ] == [("equal", 0, 9, 7, 1)] * 2
    assert [on_board(tmp_path, one, robot) for robot, one in enumerate(vehicles, 1)] == [NONE] * 2
    assert not any(one.armed for one in vehicles)


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize(
    "quirks",
    [
        {"asks_floats": True},
        {"asks_backwards": True},
        {"asks_twice": True},
        {"lost_acks": 9},
        {"doubled_acks": True},
        {"late_acks": 3.0},
        {"mixes": 2},
        {"listens": True},
        {"silent_after": 5},
        {"silent_after": 30},
    ],
    ids=lambda quirks: ",".join(f"{name}={value}" for name, value in quirks.items()),
)
def test_quirks_of_autopilots_leave_nothing_different(folder, autopilot, quirks):
    vehicles = two(autopilot, **quirks)
    made, _ = uploaded(folder, *vehicles)
    assert [(one.status, one.different) for one in made.values()] == [("equal", 0)] * 2
    assert on_board(folder, vehicles[0]) == NONE


def test_several_vehicles_on_a_link_are_served_at_the_same_time(folder):
    vehicles = two(silent_after=9)
    made, _ = uploaded(folder, *vehicles, at_once=2, loss=0.1, delay=0.02)
    assert [(one.status, one.different) for one in made.values()] == [("equal", 0)] * 2
    assert [on_board(folder, one, robot) for robot, one in enumerate(vehicles, 1)] == [NONE] * 2


@pytest.mark.parametrize("at_once", [1, 2])
def test_an_interrupted_upload_says_what_is_not_known(folder, at_once):
    vehicles = two()
    link = SimulatedLink(vehicles, at_once=at_once)
    station = Station(link)
    said = []

    def interrupt(_vehicle, message):
        if message.get_type() == "MISSION_REQUEST_INT" and message.seq == 3:
            raise KeyboardInterrupt

    station.on_message = interrupt
    with pytest.raises(KeyboardInterrupt):
        upload_missions(pairs_of(folder), [station], on_event=said.append)
    assert "robot 1: interrupted: what is on board is not known" in " ".join(said)


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize("seed", range(4))
def test_three_messages_in_ten_may_be_lost_in_each_direction(folder, autopilot, seed):
    vehicles = two(autopilot)
    made, _ = uploaded(folder, *vehicles, loss=0.3, delay=0.05, seed=seed)
    assert [(one.status, one.different) for one in made.values()] == [("equal", 0)] * 2
    assert [on_board(folder, one, robot) for robot, one in enumerate(vehicles, 1)] == [NONE] * 2


def test_what_was_on_board_before_comes_back_after_a_refusal(folder, tmp_path):
    old = replace(missions(fenced=False)[1], robot=1)
    write_missions([old], tmp_path / "old", formats=["plan"])
    vehicle, other = two()
    uploaded(tmp_path / "old", vehicle, systems={1: 1})
    before = [*vehicle.stored[MISSION]]
    vehicle._mixes = 3  # fence, rally points, mission: half of the new items, the rest the old ones
    made, _ = uploaded(folder, vehicle, other, limits=LinkLimits(attempts=1))
    assert made[1].status == "different"
    assert "mission: restored as before" in made[1].sentence
    assert not compare_items(MISSION, before, vehicle.stored[MISSION], autopilot=12).different


def test_a_vehicle_that_stores_nothing_right_ends_empty_and_says_so(folder):
    vehicle, other = two(spoils=(("mission", 0, "z", 9.0),))
    made, _ = uploaded(folder, vehicle, other)
    assert made[1].status == "different"
    assert made[1].different == 1
    assert "empty as before" in made[1].sentence
    assert vehicle.stored == {MISSION: [], FENCE: [], RALLY: []}


@pytest.mark.parametrize("lacking", [("fence",), ("rally",), ("fence", "rally")])
@pytest.mark.parametrize("says", ["as asked", "as mission", "never"])
def test_a_vehicle_without_fence_or_rally_points_is_told(folder, lacking, says):
    vehicles = two("ardupilot", lacking=lacking, says_lacking=says)
    made, _ = uploaded(folder, *vehicles)
    assert made[1].status == "unsupported"
    assert made[1].different == sum({"fence": 7, "rally": 1}[kind] for kind in lacking)
    assert ("the vehicle has no fence" in made[1].sentence) == ("fence" in lacking)
    assert on_board(folder, vehicles[0])[MISSION] == 0


def test_a_vehicle_without_a_fence_needs_none_if_the_files_have_none(tmp_path):
    write_missions(missions(fenced=False), tmp_path, formats=["plan"])
    made, _ = uploaded(tmp_path, *two(lacking=("fence", "rally")))
    assert [one.status for one in made.values()] == ["equal", "equal"]


def test_an_old_fence_is_cleared_if_the_files_have_none(folder, tmp_path):
    write_missions(missions(fenced=False), tmp_path / "open", formats=["plan"])
    vehicles = two()
    uploaded(folder, *vehicles)
    assert vehicles[0].stored[FENCE]
    made, _ = uploaded(tmp_path / "open", *vehicles)
    assert made[1].status == "equal"
    assert not vehicles[0].stored[FENCE]


def test_floats_only_are_compared_as_floats_and_said(folder):
    vehicles = two(knows_floats_only=True)
    made, _ = uploaded(folder, *vehicles)
    assert made[1].status == "equal"
    assert any("float32" in note for note in made[1].notes)


@pytest.mark.parametrize(
    ("quirks", "said"),
    [
        ({"silent_after": 10, "silent_for": 1e6}, "was not heard for"),
        ({"mute": True}, "gave no answer"),
        ({"refuses": {"mission": 4}}, "no space"),
        ({"refuses": {"mission": 3}}, "unsupported"),
        ({"refuses": {"fence": 14}}, "denied"),
        ({"stores_nothing": True}, "expected 9 items on board, got 0"),
    ],
)
def test_failures_are_told_as_failures(folder, quirks, said):
    vehicles = two(**quirks)
    made, _ = uploaded(folder, *vehicles)
    assert made[1].status in ("failed", "refused", "different")
    assert said in made[1].sentence
    assert made[2].status == "equal"


def test_nothing_is_sent_if_a_vehicle_is_silent_or_of_the_wrong_type(folder):
    for vehicle, status in (
        (SimulatedVehicle(3), "failed"),
        (SimulatedVehicle(7, kind="rover"), "refused"),
    ):
        first = SimulatedVehicle(1)
        made, _ = uploaded(folder, first, vehicle)
        assert made[2].status == status
        assert made[1].status == ("equal" if status == "failed" else "refused")
        assert bool(first.stored[MISSION]) == (status == "failed")
        assert not vehicle.stored[MISSION]


def test_a_file_that_does_not_say_what_flies_fits_a_fixed_wing(tmp_path):
    for form, status in (("plan", "refused"), ("wpl", "equal")):
        write_missions(missions(1), tmp_path / form, formats=[form])
        made, _ = uploaded(tmp_path / form, SimulatedVehicle(1, kind="fixed-wing"), systems={1: 1})
        assert made[1].status == status
    made, _ = uploaded(tmp_path / "wpl", SimulatedVehicle(1, kind="rover"), systems={1: 1})
    assert made[1].status == "refused"


def test_nothing_is_sent_to_a_system_that_is_no_robots(folder):
    vehicles = (*two(), SimulatedVehicle(9))
    said = []
    link = SimulatedLink(vehicles)
    upload_missions(pairs_of(folder), [Station(link)], on_event=said.append)
    assert "system 9 on simulated is no robot's" in said[0]
    assert vehicles[2]._taken == 0


def test_an_armed_vehicle_gets_nothing(folder):
    vehicles = two()
    vehicles[0].armed = True
    made, _ = uploaded(folder, *vehicles)
    assert (made[1].status, made[2].status) == ("refused", "equal")
    assert "armed" in made[1].sentence
    assert not vehicles[0].stored[MISSION]


def test_two_vehicles_with_one_system_id_are_refused(folder):
    vehicles = SimulatedVehicle(1), SimulatedVehicle(7), SimulatedVehicle(7)
    made, _ = uploaded(folder, *vehicles)
    assert (made[1].status, made[2].status) == ("equal", "refused")
    assert "2 addresses" in made[2].sentence
    assert not vehicles[1].stored[MISSION]


def test_other_systems_on_the_link_do_not_matter(folder):
    make, mav = dialect(), dialect().MAVLink(None, 9, 1)
    mav_of_station = make.MAVLink(None, 255, 190)
    spoken = [-1.0]

    def stranger(now):
        """Send what another vehicle and another station might, each tenth of a second."""
        if now < spoken[0] + 0.1:
            return []
        spoken[0] = now
        acks = [make.MAVLink_mission_ack_message(255, 190, 0, kind) for kind in range(3)]
        asks = [make.MAVLink_mission_request_int_message(255, 190, 2, kind) for kind in range(3)]
        others = [make.MAVLink_mission_count_message(1, 1, 3, 0)]
        return (
            [bytes(one.pack(mav)) for one in [*acks, *asks]]
            + [bytes(one.pack(mav_of_station)) for one in others]
            + [b"\xfd\x09garbage", b"\xfe"]
        )

    vehicles = two()
    made, _ = uploaded(folder, *vehicles, strangers=[stranger])
    assert [one.status for one in made.values()] == ["equal", "equal"]
    assert on_board(folder, vehicles[0]) == NONE


@pytest.mark.parametrize(
    ("field", "value", "different"),
    [
        ("x", 1, 0),
        ("x", 2, 1),
        ("y", -3, 1),
        ("z", 0.01, 0),
        ("z", 0.02, 1),
        ("command", 1, 1),
        ("params", 0.005, 0),
        ("params", 0.5, 1),
    ],
)
def test_each_field_has_its_tolerance(field, value, different):
    sent = item_on_air(Item(16, 3, (4.0, 2.0, 0.0, None, 47.4, 8.5, 30.0)))
    found = sent._replace(
        **{
            field: (4.0 + value, *sent.params[1:])
            if field == "params"
            else getattr(sent, field) + value
        }
    )
    assert compare_items(MISSION, [sent], [found], autopilot=12).different == different


def test_frames_alike_and_fields_that_autopilots_drop_are_no_difference():
    sent = item_on_air(Item(16, 3, (0.0, 2.0, 0.0, 90.0, 47.4, 8.5, 30.0)))
    result = compare_items(
        MISSION, [sent], [sent._replace(frame=6, params=(0.0, 0.0, 0.0, 0.0))], autopilot=12
    )
    assert (result.different, dict(result.dropped)) == (0, {"acceptance radius": 1, "heading": 1})
    turned = sent._replace(params=(0.0, 2.0, 0.0, -270.0))
    assert compare_items(MISSION, [sent], [turned], autopilot=12).different == 0
    for wrong in (sent._replace(frame=0), sent._replace(params=(0.0, 5.0, 0.0, 90.0))):
        assert compare_items(MISSION, [sent], [wrong], autopilot=12).different == 1


def test_a_cargo_of_thousands_of_items_goes_through():
    vehicle = SimulatedVehicle(1)
    items = [
        item_on_air(Item(16, 3, (0.0, 0.0, 0.0, None, 47 + k * 1e-5, 8.5, 30.0)))
        for k in range(2000)
    ]
    station = Station(SimulatedLink([vehicle], loss=0.05, delay=0.01))
    while 1 not in station.vehicles:
        station.listen(station.now() + 1)
    upload_items(station, station.vehicles[1], MISSION, items)
    found = download_items(station, station.vehicles[1], MISSION)
    assert compare_items(MISSION, items, found, autopilot=12).different == 0


# -- the command --------------------------------------------------------------------------------


@pytest.fixture
def on_air():
    """Return a function that runs vehicles on a link, in a thread."""
    ended = threading.Event()
    threads = []

    def start(link, *vehicles):
        opened = open_link(link)
        thread = threading.Thread(
            target=run_vehicles, args=(vehicles, opened), kwargs={"ended": ended.is_set}
        )
        thread.start()
        threads.append((thread, opened))

    yield start
    ended.set()
    for thread, opened in threads:
        thread.join()
        opened.close()


def free_port():
    import socket

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def report(capsys, *arguments):
    code = run(["missions", "upload", *map(str, arguments), "--json"])
    out, err = capsys.readouterr()
    return code, (json.loads(out)["robots"] if out else None), err


def test_the_command_uploads_over_real_sockets(folder, capsys, on_air):
    port, listening = free_port(), free_port()
    vehicles = SimulatedVehicle(1), SimulatedVehicle(1, quirks=Quirks(listens=True))
    on_air(f"udpout:127.0.0.1:{port}", vehicles[0])
    on_air(f"udpin:127.0.0.1:{listening}", vehicles[1])
    systems = f"1=1@udpin:127.0.0.1:{port},2=1@udpout:127.0.0.1:{listening}"
    code, robots, err = report(capsys, folder, "--systems", systems)
    assert code == 0, err
    assert [
        (one["robot"], one["system"], one["mission"], one["fence"], one["rally"]) for one in robots
    ] == [
        (1, 1, 9, 7, 1),
        (2, 1, 9, 7, 1),
    ]
    assert [(one["different"], one["status"]) for one in robots] == [(0, "equal")] * 2
    assert [on_board(folder, one, robot) for robot, one in enumerate(vehicles, 1)] == [NONE] * 2


def test_a_dry_run_opens_no_link(folder, capsys):
    out = folder / "out"
    given = ("--connect", "tcp:127.0.0.1:9", "--systems", "1=1,2=2", "--dry-run", "--out", out)
    code, robots, _ = report(capsys, folder, *given)
    assert code == 0
    assert json.loads((out / "upload.json").read_text()) == {"robots": robots}
    assert [(one["status"], one["different"], one["mission"]) for one in robots] == [
        ("dry-run", None, 9)
    ] * 2


@pytest.mark.parametrize(
    ("systems", "said"),
    [
        ("1=1", "got none for robot 2"),
        ("1=1,2=1", "got system 1 for robots 1 and 2"),
        ("1=1,1=2", "got robot 1 again"),
        ("1=1,2=2,3=3", "got robot 3"),
        ("1=1,2=256", "system id from 1 to 255"),
        ("1=1;2=2", "expected ROBOT=SYSTEM"),
        ("nowhere.txt", "nowhere.txt: expected a list such as 1=1,2=7, or a file"),
    ],
)
def test_a_wrong_mapping_is_refused(folder, capsys, systems, said):
    code, robots, err = report(
        capsys, folder, "--connect", "udpin:127.0.0.1:14550", "--systems", systems
    )
    assert (code, robots) == (2, None)
    assert said in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    "link",
    [
        "udpin:14550",
        "udp:127.0.0.1:1",
        "tcp:127.0.0.1:9",
        "serial:/dev/none",
        "udpin:127.0.0.1:70000",
    ],
)
def test_a_wrong_link_is_refused(folder, capsys, link):
    code, robots, err = report(capsys, folder, "--connect", link, "--systems", "1=1,2=2")
    assert (code, robots) == (2, None)
    assert "connect: expected" in err


def test_a_file_of_systems_and_a_choice_of_robots(folder, tmp_path, capsys):
    file = tmp_path / "systems.txt"
    file.write_text("# the fleet\n1=4\n2=7@serial:/dev/ttyUSB0@57600  # the old one\n\n")
    seats = read_seats(str(file))
    assert (seats[1].system, seats[2].link) == (4, "serial:/dev/ttyUSB0@57600")
    chosen = ("--connect", "tcp:127.0.0.1:9", "--systems", file, "--robots", "2", "--dry-run")
    code, robots, _ = report(capsys, folder, *chosen)
    assert (code, [one["robot"] for one in robots]) == (0, [2])


def test_files_without_items_for_autopilots_are_refused(tmp_path):
    write_missions(missions(), tmp_path, formats=["gpx"])
    with pytest.raises(InvalidInputError, match="expected missions for autopilots"):
        read_cargos(tmp_path)
    write_missions(missions(), tmp_path, formats=["plan"])
    with pytest.raises(InvalidInputError, match="sortie: expected one of"):
        read_cargos(tmp_path, sortie=2)


def test_home_is_the_first_item_for_ardupilot_alone(folder):
    cargo = read_cargos(folder)[1]
    for autopilot, extra in ((12, 0), (3, 1), (0, 0)):
        vehicle = type("Heard", (), {"autopilot": autopilot})
        items = items_for(cargo, vehicle)[MISSION]
        assert len(items) == len(cargo.items[MISSION]) + extra
