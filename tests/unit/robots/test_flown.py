"""Flight logs beside their missions: logs of a station, of ArduPilot and of PX4, what was seen on the
real tracks, and the rest as a region of a new search.
"""

from __future__ import annotations

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
import shapely

from shoal.cli import run
from shoal.core.errors import InvalidInputError
from shoal.missions import CheckOptions, read_mission
from shoal.robots.flown import check_flown
from shoal.search import LocalFrame, SearchProblem, read_tracks, region_of
from shoal.search.regions.places import swept_area

pytest.importorskip("pymavlink")

from shoal.robots.mavlink import ARMED
from shoal.search.regions.formats.flight_logs import dialect

FIELD = [[8.5, 47.4], [8.5016, 47.4], [8.5016, 47.4008], [8.5, 47.4008], [8.5, 47.4]]
FOOTPRINT = 20
BEGIN = 1_790_000_000.0  # seconds since 1970


@pytest.fixture(scope="module")
def field(tmp_path_factory):
    """Return a folder with a region and the missions of two robots."""
    folder = tmp_path_factory.mktemp("field")
    region = {
        "type": "Feature",
        "properties": {},
        "geometry": {"type": "Polygon", "coordinates": [FIELD]},
    }
    (folder / "field.json").write_text(json.dumps(region))
    made = ["search", str(folder / "field.json"), "--robots", "2", "--footprint", str(FOOTPRINT)]
    # starts in different cells: both robots have work
    made += ["--seed", "6"]
    options = [
        "--vehicle",
        "multirotor",
        "--allocation",
        "stay",
        "--missions",
        str(folder / "missions"),
        "--format",
        "plan",
        "--cross-track",
        "0",
    ]
    assert run([*made, *options]) == 0
    return folder


def flight(field, robot, *, until=1.0, beside=0.0, begin=BEGIN, height=30.0):
    """Return the rows (time, longitude, latitude, height) of a flight along a mission: the first
    part of its way, a given distance north of it, and back home.
    """
    mission = read_mission(field / "missions" / f"robot-{robot:02d}.plan")
    frame = LocalFrame(*mission.home)
    way = frame.to_metres(mission.waypoints)
    lengths = np.r_[0.0, np.cumsum(np.hypot(*np.diff(way, axis=0).T))]
    end = until * lengths[-1]
    far = np.union1d(np.arange(0.0, end, 1.0), lengths[lengths <= end])
    points = np.column_stack([np.interp(far, lengths, way[:, k]) for k in (0, 1)])
    points[:, 1] += beside
    ups = np.linspace(0.0, height, 10)
    home = np.linspace(points[-1], (0.0, 0.0), 40)
    points = np.vstack([np.zeros((10, 2)), points, home, np.zeros((10, 2))])
    heights = np.r_[ups, np.full(len(points) - 20, height), ups[::-1]]
    times = begin + 0.2 * np.arange(len(points))
    return np.column_stack([times, frame.to_degrees(points), heights])


def write_tlog(path, rows_by_system):
    make = dialect()
    packets = []
    for system, rows in rows_by_system.items():
        mav = make.MAVLink(None, system, 1)
        beat = make.MAVLink_heartbeat_message(2, 12, 1 | ARMED, 0, 4, 3)
        packets.append((rows[0, 0] - 1, bytes(beat.pack(mav))))
        for time, x, y, up in rows.tolist():
            place = round(1e7 * y), round(1e7 * x), round(1000 * up), round(1000 * up)
            message = make.MAVLink_global_position_int_message(0, *place, 0, 0, 0, 0)
            packets.append((time, bytes(message.pack(mav))))
    packets.sort()
    path.write_bytes(
        b"\x00junk" + b"".join(struct.pack(">Q", round(1e6 * t)) + data for t, data in packets)
    )
    return path


def write_dataflash(path, rows, *, name="POS"):
    """Write a log as ArduPilot does: each kind of message is described by a message FMT."""

    def described(number, size, kind, types, columns):
        text = kind.encode(), types.encode(), ",".join(columns).encode()
        return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, size, *text)

    position = ("TimeUS", "Lat", "Lng", "Alt", "RelHomeAlt", "RelOriginAlt")
    gps = (
        "TimeUS",
        "Status",
        "GMS",
        "GWk",
        "NSats",
        "HDop",
        "Lat",
        "Lng",
        "Alt",
        "Spd",
        "GCrs",
        "VZ",
        "U",
    )
    data = [
        described(128, 89, "FMT", "BBnNZ", ("Type", "Length", "Name", "Format", "Columns")),
        described(1, 31, "POS", "QLLfff", position),
        described(2, 46, "GPS", "QBIHBcLLefffB", gps),
    ]
    week, seconds = divmod(BEGIN - 315964800 + 18, 604800)  # of GPS
    for number, (time, x, y, up) in enumerate(rows.tolist()):
        since = time - BEGIN + 5
        stamp, place = round(1e6 * since), (round(1e7 * y), round(1e7 * x))
        if number % 5 == 0 or name == "GPS":
            when = round(1000 * (seconds + since - 5)), int(week)
            about = struct.pack(
                "<QBIHBhiiifffB",
                stamp,
                3,
                *when,
                12,
                80,
                *place,
                round(100 * (400 + up)),
                0,
                0,
                0,
                1,
            )
            data.append(b"\xa3\x95\x02" + about)
        if name == "POS":
            about = struct.pack("<Qiifff", stamp, *place, 400 + up, up, up)
            data.append(b"\xa3\x95\x01" + about)
    path.write_bytes(b"".join(data))
    return path


def write_ulog(path, rows, *, clock=True):
    """Write a log as PX4 does: the formats of its topics, and then their data."""

    def message(kind, body):
        return struct.pack("<HB", len(body), ord(kind)) + body

    head = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)
    data = [head, message("B", bytes(40))]
    formats = (
        "vehicle_global_position:uint64_t timestamp;double lat;double lon;float alt;",
        "home_position:uint64_t timestamp;float alt;",
        "vehicle_gps_position:uint64_t timestamp;uint64_t time_utc_usec;",
    )
    data += [message("F", text.encode()) for text in formats]
    for number, text in enumerate(formats):
        data.append(message("A", struct.pack("<BH", 0, number) + text.partition(":")[0].encode()))
    data.append(message("D", struct.pack("<HQf", 1, 10, 400.0)))
    if clock:
        data.append(message("D", struct.pack("<HQQ", 2, 10_000_000, round(1e6 * BEGIN))))
    for time, x, y, up in rows.tolist():
        stamp = round(1e6 * (time - BEGIN + 10))
        data.append(message("D", struct.pack("<HQddf", 0, stamp, y, x, 400 + up)))
    path.write_bytes(b"".join(data))
    return path


def flown(capsys, field, *arguments):
    about = ["--region", str(field / "field.json"), "--footprint", str(FOOTPRINT), "--json"]
    code = run(["missions", "flown", str(field / "missions"), *map(str, arguments), *about])
    out, err = capsys.readouterr()
    return code, (json.loads(out) if out else None), err


def test_the_height_of_a_track_sets_the_size_of_images(field, tmp_path, capsys):
    """A flight at 2 m counted as one at 30 m."""
    systems = ["--systems", "1=1,2=2"]
    logs = {}
    for height in (2.0, 15.0, 30.0, 30.5):
        path = tmp_path / f"{height}.tlog"
        logs[height] = write_tlog(path, {n: flight(field, n, height=height) for n in (1, 2)})
    lens = "sensor_width=6,sensor_height=6,focal_length=8"  # 22.5 m from 30 m
    seen = {}
    for height, log in logs.items():
        about = ["--region", field / "field.json", "--vehicle", f"multirotor,{lens}", "--json"]
        run(["missions", "flown", *map(str, [field / "missions", log, *systems, *about])])
        seen[height] = json.loads(capsys.readouterr().out)["covered_fraction"]
    assert seen[30.5] >= seen[30.0] > 0.999
    assert seen[15.0] == pytest.approx(11.25 / 20, abs=0.1)
    assert seen[2.0] == pytest.approx(1.5 / 20, abs=0.02)
    # a detector sees as much from any height
    about = ["--region", field / "field.json", "--footprint", "20", "--json"]
    run(["missions", "flown", *map(str, [field / "missions", logs[15.0], *systems, *about])])
    assert json.loads(capsys.readouterr().out)["covered_fraction"] > 0.999


@pytest.mark.parametrize("suffix", ["tlog", "bin", "ulg"])
def test_each_kind_of_log_has_the_track_that_was_written(field, tmp_path, suffix):
    if suffix == "ulg":
        pytest.importorskip("pyulog")
    rows = flight(field, 1)
    path = tmp_path / f"log.{suffix}"
    writer = {
        "tlog": lambda p, r: write_tlog(p, {4: r}),
        "bin": write_dataflash,
        "ulg": write_ulog,
    }[suffix]
    (track,) = read_tracks(writer(path, rows))
    assert (track.system, track.absolute) == (4 if suffix == "tlog" else None, True)
    np.testing.assert_allclose(track.places, rows[:, 1:3], atol=1e-7)
    np.testing.assert_allclose(track.heights, rows[:, 3], atol=0.01)
    np.testing.assert_allclose(track.times, rows[:, 0], atol=0.3)  # the receiver's leap seconds


def test_a_log_without_estimates_gives_the_receivers_positions(field, tmp_path):
    rows = flight(field, 1)
    (track,) = read_tracks(write_dataflash(tmp_path / "gps.bin", rows, name="GPS"))
    np.testing.assert_allclose(track.heights, rows[:, 3], atol=0.02)


def test_flights_along_their_missions_have_seen_all(field, tmp_path, capsys):
    log = write_tlog(
        tmp_path / "all.tlog", {4: flight(field, 1), 9: flight(field, 2, begin=BEGIN + 7)}
    )
    about = ["--out", tmp_path / "out", "--margin", "0.5", "--angle", "0", "--separation", "1,2"]
    code, found, err = flown(capsys, field, log, "--systems", "1=4,2=9", *about)
    assert code == 0, err
    assert found["covered_fraction"] > 0.9995
    assert not (tmp_path / "out" / "rest.geojson").exists()
    for one in found["robots"]:
        assert one["searched_m"] == pytest.approx(one["planned_search_m"], abs=2)
        assert one["farthest_m"] < 0.1
    assert found["nearest_approach"]["robots"] == [1, 2]


def test_the_rest_of_an_aborted_flight_is_a_region_for_a_new_search(field, tmp_path, capsys):
    logs = (
        write_tlog(tmp_path / "one.tlog", {1: flight(field, 1)}),
        write_dataflash(tmp_path / "two.bin", flight(field, 2, until=0.5)),
    )
    out = tmp_path / "out"
    code, found, err = flown(capsys, field, f"1={logs[0]}", f"2={logs[1]}", "--out", out)
    assert code == 1
    assert "less than 99.9 %" in err
    # what the second vehicle flew over on its way home does not count
    second = found["robots"][1]
    assert second["searched_m"] == pytest.approx(0.5 * second["planned_search_m"], abs=25)
    first, other = (robot["planned_search_m"] for robot in found["robots"])
    flown_m = first + 0.5 * other
    assert found["covered_fraction"] == pytest.approx(flown_m / (first + other), abs=0.04)
    assert found["rest_m2"] == pytest.approx(found["uncovered_m2"], rel=0.05)
    again = ["search", str(out / "rest.geojson"), "--robots", "2", "--footprint", str(FOOTPRINT)]
    assert run([*again, "--vehicle", "multirotor", "--transit", "--json"]) == 0
    new = json.loads(capsys.readouterr().out)
    assert new["region"]["area_m2"] == pytest.approx(found["rest_m2"], rel=0.01)


def test_a_track_beside_its_path_sees_what_is_below_it(field, tmp_path, capsys):
    rows = {1: flight(field, 1, beside=4.0), 2: flight(field, 2)}
    code, found, _ = flown(
        capsys, field, write_tlog(tmp_path / "a.tlog", rows), "--systems", "1=1,2=2"
    )
    assert code == 1
    assert found["robots"][0]["farthest_m"] == pytest.approx(4.0, abs=0.2)
    assert 0.9 < found["covered_fraction"] < 0.999


@pytest.mark.parametrize(
    ("height", "sentence"),
    [
        (0.5, "flown 0.5 to 0.5 m above home, more than 6 m below the planned height"),
        (10.0, "flown 10 to 10 m above home, more than 6 m below the planned height"),
        (25.0, None),
        (35.0, None),
        (90.0, "flown 90 to 90 m above home, more than 6 m above the planned height"),
    ],
)
def test_heights_far_from_the_planned_one_are_told(field, tmp_path, capsys, height, sentence):
    log = write_tlog(tmp_path / "a.tlog", {1: flight(field, 1, height=height)})
    told, err = flown(capsys, field, log, "--systems", "1=1")[1:]
    (robot,) = told["robots"]
    assert robot["searched_m"] == pytest.approx(robot["planned_search_m"], abs=1)
    lower, higher = robot["lower_m"], robot["higher_m"]
    if sentence is None:
        assert max(lower, higher) < 0.01
        assert "planned height" not in err
    else:
        assert sorted((lower, higher)) == pytest.approx([0, robot["planned_search_m"]], abs=5)
        assert sentence in err
        assert told["notes"] == [
            one.removeprefix("shoal: ") for one in err.splitlines()[: 1 + (height < 1)]
        ]


def test_a_part_of_a_search_that_was_too_low_is_told(field, tmp_path, capsys):
    rows = flight(field, 1)
    half = len(rows) // 2
    rows[half : half + 40, 3] = np.linspace(12.0, 20.0, 40)
    log = write_tlog(tmp_path / "a.tlog", {1: rows})
    told, err = flown(capsys, field, log, "--systems", "1=1")[1:]
    assert told["robots"][0]["lower_m"] == pytest.approx(40, abs=5)
    assert "m of its search were flown 12 to 20 m above home, more than 6 m below" in err


def test_missions_with_heights_above_ground_are_not_compared(field):
    mission = read_mission(field / "missions" / "robot-01.plan")
    path = field / "a.tlog"
    (track,) = read_tracks(write_tlog(path, {1: flight(field, 1)}))
    unknown = replace(mission, altitude_frame="ground", heights=None, rally=())
    result = check_flown([(unknown, track)], None, angle=None)
    assert result.report()["robots"][0]["lower_m"] is None
    assert "its heights were not compared" in result.report()["notes"][0]
    # over a valley, planned heights above home may be small: what counts is the usual height
    count = len(mission.waypoints)
    valley = np.where(np.arange(count) < count // 3, 2.0, 30.0)
    result = check_flown([(replace(mission, heights=valley), track)], None, angle=None)
    (robot,) = result.report()["robots"]
    assert robot["lower_m"] == 0
    assert 10 < robot["higher_m"] < 0.6 * robot["planned_search_m"]


def test_a_flight_that_never_reaches_its_search_has_seen_nothing(field, tmp_path, capsys):
    rows = flight(field, 1)
    rows[:, 1:3] += 0.01
    code, found, _ = flown(capsys, field, f"1={write_ulog_or_skip(tmp_path / 'a.ulg', rows)}")
    assert (code, found["covered_fraction"], found["robots"][0]["searched_m"]) == (1, 0.0, 0.0)


def write_ulog_or_skip(path, rows):
    pytest.importorskip("pyulog")
    return write_ulog(path, rows)


def test_logs_without_a_time_of_day_have_no_nearest_approach(field, tmp_path, capsys):
    pytest.importorskip("pyulog")
    logs = [
        f"{k}={write_ulog(tmp_path / f'{k}.ulg', flight(field, k), clock=False)}" for k in (1, 2)
    ]
    _, found, err = flown(capsys, field, *logs)
    assert found["nearest_approach"] is None
    assert "no time of day" in err


def meeting(way):
    """Return the rows of a flight of 100 s over places in metres of the field, at 30 m."""
    times = np.arange(0.0, 101.0, 0.5)
    points = np.column_stack(
        [np.interp(times, [0, 50, 100], axis) for axis in zip(*way, strict=True)]
    )
    heights = np.where((times > 2) & (times < 98), 30.0, 0.0)
    degrees = LocalFrame(8.5, 47.4).to_degrees(points)
    return np.column_stack([BEGIN + times, degrees, heights])


CROSSING = {
    1: [(0.0, 0.0), (50.0, 0.0), (100.0, 0.0)],
    2: [(0.0, 80.0), (50.0, 0.0), (100.0, 80.0)],
}


def test_positions_that_a_log_lacks_are_not_straight_flights(field, tmp_path, capsys):
    rows = {k: meeting(way) for k, way in CROSSING.items()}
    about = ["--systems", "1=1,2=2", "--separation", "15,5", "--least", "0"]
    code, found, err = flown(capsys, field, write_tlog(tmp_path / "all.tlog", rows), *about)
    assert (code, found["nearest_approach"]["horizontal_m"] < 0.1) == (1, True)
    assert found["without_positions_s"] == 0
    times = rows[2][:, 0] - BEGIN
    rows[2] = rows[2][(times < 20) | (times > 80)]
    code, found, err = flown(capsys, field, write_tlog(tmp_path / "gap.tlog", rows), *about)
    assert code == 1
    assert found["nearest_approach"]["horizontal_m"] > 40
    assert found["without_positions_s"] == pytest.approx(61.0, abs=0.1)
    assert "robot 2: its log has no positions for 61 s while others flew" in err
    assert "come within 0 m of robot 1" in err
    assert "the separation is not known for the whole flights" in err


def test_a_short_gap_far_from_others_is_told_and_no_fault(field, tmp_path, capsys):
    rows = {k: meeting(way) for k, way in CROSSING.items()}
    rows[2][:, 2] += 0.003  # 330 m farther north
    times = rows[2][:, 0] - BEGIN
    rows[2] = rows[2][(times < 20) | (times > 24)]
    log = write_tlog(tmp_path / "gap.tlog", rows)
    about = ["--systems", "1=1,2=2", "--separation", "15,5", "--least", "0"]
    code, found, err = flown(capsys, field, log, *about)
    assert (code, err) == (0, "")
    assert found["without_positions_s"] == pytest.approx(5.0, abs=0.1)
    assert "no positions" not in err


def test_a_log_that_ends_in_flight_is_told(field, tmp_path, capsys):
    rows = {k: meeting(way) for k, way in CROSSING.items()}
    rows[2] = rows[2][rows[2][:, 0] < BEGIN + 20]
    log = write_tlog(tmp_path / "end.tlog", rows)
    about = ["--systems", "1=1,2=2", "--separation", "15,5", "--least", "0"]
    code, found, err = flown(capsys, field, log, *about)
    assert code == 1
    assert found["nearest_approach"]["horizontal_m"] > 40
    assert "robot 2: its log ends in flight, while others flew" in err


def test_a_clock_that_steps_back_is_told(field, tmp_path, capsys):
    rows = {k: meeting(way) for k, way in CROSSING.items()}
    for one in rows.values():
        one[one[:, 0] > BEGIN + 20, 0] -= 60
    # packets stay in the order in which they came, so each vehicle has a log of its own here
    logs = []
    for k, one in rows.items():
        path = write_tlog(tmp_path / f"{k}.tlog", {1: one[:41]})
        later = write_tlog(tmp_path / "later.tlog", {1: one[41:]})
        path.write_bytes(path.read_bytes() + later.read_bytes())
        later.unlink()
        logs.append(f"{k}={path}")
    about = ["--separation", "15,5", "--least", "0"]
    code, found, err = flown(capsys, field, *logs, *about)
    assert code == 1
    assert found["nearest_approach"] is None
    assert found["robots"][0]["duration_s"] == pytest.approx(95, abs=1.5)
    assert "robot 1: the clock of its log steps back by 59.5 s" in err
    assert "not known, because the clock of a log steps back" in err


def test_an_unknown_elevation_is_none_of_0_m(field, tmp_path):
    missions = [
        replace(read_mission(field / "missions" / f"robot-0{k}.plan"), elevation=height)
        for k, height in ((1, 400.0), (2, None))
    ]
    log = write_tlog(tmp_path / "all.tlog", {k: meeting(way) for k, way in CROSSING.items()})
    options = CheckOptions(field / "field.json", separation=(15.0, 5.0))
    found = check_flown(list(zip(missions, read_tracks(log), strict=True)), options, angle=None)
    assert found.approach.horizontal < 0.1
    assert found.approach.vertical < 0.1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["a.tlog", "--systems", "1=1,2=1"], "each vehicle once"),
        (["a.tlog"], "expected to know its robot"),
        (["1=a.tlog"], "expected one vehicle in a log of robot 1, got 2"),
        (["a.tlog", "--systems", "1=7,2=8"], "expected a track of a robot"),
        (["a.tlog", "--systems", "5=1,2=2"], "expected a robot of the missions"),
        (["broken.bin"], "broken.bin"),
        (["damaged.bin"], "damaged.bin: expected a log of ArduPilot, got the error: "),
        (["broken.ulg"], "broken.ulg"),
        (["broken.tlog"], "expected positions"),
        (["none.tlog"], "none.tlog"),
        (["a.txt"], "expected a flight log"),
    ],
)
def test_logs_of_nobody_are_refused(field, tmp_path, capsys, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    write_tlog(tmp_path / "a.tlog", {1: flight(field, 1), 2: flight(field, 2)})
    for name in ("broken.bin", "broken.ulg", "broken.tlog"):
        (tmp_path / name).write_bytes(b"\x00\xfe\xfdnothing" * 50)
    whole = write_dataflash(tmp_path / "whole.bin", flight(field, 1)).read_bytes()
    # an unknown type of a column
    (tmp_path / "damaged.bin").write_bytes(whole.replace(b"QLLfff", b"QLL\\ff", 1))
    code, found, err = flown(capsys, field, *arguments)
    assert (code, found) == (2, None), err
    assert said in err
    assert err.count("\n") == 1


def test_a_damaged_log_prints_nothing(field, tmp_path, capfd):
    """The reader of pymavlink printed a line for each byte that it skipped."""
    path = write_dataflash(tmp_path / "noise.bin", flight(field, 1))
    whole = path.read_bytes()
    path.write_bytes(whole[:2000] + bytes(range(256)) * 4 + whole[2000:])
    assert len(read_tracks(path)) == 1
    assert capfd.readouterr() == ("", "")


def test_an_unknown_suffix_is_refused(tmp_path):
    with pytest.raises(InvalidInputError, match="expected a flight log"):
        read_tracks(tmp_path / "log.csv")


def test_a_search_reads_flight_logs_and_gpx_as_tracks(tmp_path):
    """What counts is the flight, without gaps: 200 m and 100 m of 400 m."""
    frame = LocalFrame(8.5, 47.4)
    region = region_of(shapely.box(0, 0, 400, 40), frame=frame)
    along = np.arange(0.0, 401.0, 2.0)
    heights = np.where(along < 300, 30.0, 0.2)  # the last 100 m on the ground
    times = BEGIN + along + np.where(along > 200, 60.0, 0.0)  # 60 s without a position
    degrees = frame.to_degrees(np.column_stack([along, np.full(len(along), 20.0)]))
    log = write_tlog(tmp_path / "flown.tlog", {1: np.column_stack([times, degrees, heights])})
    assert swept_area(str(log), region, 20.0).area == pytest.approx(
        (200 + 20 + 96 + 20 - 18) * 20, rel=1e-3
    )
    points = [f"<trkpt lat='{y:.7f}' lon='{x:.7f}'/>" for x, y in degrees.tolist()]
    segments = "".join(f"<trkseg>{''.join(points[a:b])}</trkseg>" for a, b in ((0, 51), (101, 151)))
    (tmp_path / "flown.gpx").write_text(f"<gpx><trk>{segments}</trk></gpx>")
    seen = swept_area(str(tmp_path / "flown.gpx"), region, 20.0)
    assert seen.area == pytest.approx((100 + 20 + 98 + 20) * 20, rel=1e-3)
    (tmp_path / "planned.gpx").write_text("<gpx><rte><rtept lat='1' lon='2'/></rte></gpx>")
    with pytest.raises(InvalidInputError, match="a track that was flown"):
        swept_area(str(tmp_path / "planned.gpx"), region, 20.0)


def test_climbs_are_no_search(tmp_path, monkeypatch):
    """A fixed wing that climbs for 200 m, searches 200 m at 80 m, and sinks for 200 m."""
    heard = []
    monkeypatch.setattr("shoal.core.notices.listeners", [heard.append])
    frame = LocalFrame(8.5, 47.4)
    region = region_of(shapely.box(0, 0, 1000, 40), frame=frame)
    along = np.arange(0.0, 801.0, 2.0)
    heights = np.interp(along, [0.0, 200.0, 600.0, 800.0], [0.0, 80.0, 80.0, 0.0])
    degrees = frame.to_degrees(np.column_stack([along, np.full(len(along), 20.0)]))
    rows = np.column_stack([BEGIN + along / 10, degrees, heights])
    log = str(write_tlog(tmp_path / "wing.tlog", {1: rows}))
    # from 160 m, where it is 64 m high, to 640 m
    assert swept_area(log, region, 20.0).area == pytest.approx((480 + 20) * 20, rel=1e-3)
    assert len(heard) == 1
    assert "39 % of the way in flight count as climbs and descents" in heard[0]
    assert "lower than 64 m above home" in heard[0]
    # the camera of a vehicle at 40 m sees enough from 32 m on
    seen = swept_area(log, region, 20.0, altitude=40.0)
    assert seen.area == pytest.approx((640 + 20) * 20, rel=1e-3)
    camera = "sensor_width=13.2,sensor_height=8.8,focal_length=8.8"
    problem = SearchProblem(
        region, searched=[log], robots=1, vehicle=f"fixed-wing,altitude=160,{camera}"
    )
    with pytest.raises(InvalidInputError, match="expected a flight of 128 m above home"):
        problem.place.outline  # noqa: B018  # it opens the tracks


def test_heights_of_rovers_are_errors(field, tmp_path):
    """A receiver that said 40 m kept two rovers apart that met, and half a track was none."""
    missions = [
        replace(
            read_mission(field / "missions" / f"robot-0{robot}.plan"), kind="rover", altitude=0.0
        )
        for robot in (1, 2)
    ]
    rows = flight(field, 1, height=0.0)
    high = rows.copy()
    high[len(high) // 2 :, 3] = 40.0
    (low,) = read_tracks(write_tlog(tmp_path / "low.tlog", {1: rows}))
    (up,) = read_tracks(write_tlog(tmp_path / "up.tlog", {2: high}))
    options = CheckOptions(str(field / "field.json"), footprint=FOOTPRINT, separation=(10.0, 5.0))
    met = check_flown(
        [(missions[0], low), (missions[1], replace(up, heights=up.heights + 20))],
        options,
        angle=None,
    )
    assert met.approach.horizontal == pytest.approx(0.0, abs=0.01)
    region = options.place
    whole = swept_area(str(tmp_path / "low.tlog"), region, FOOTPRINT)
    seen = swept_area(str(tmp_path / "up.tlog"), region, FOOTPRINT, flies=False)
    assert seen.equals(whole)
    assert swept_area(str(tmp_path / "up.tlog"), region, FOOTPRINT).area < 0.7 * whole.area
