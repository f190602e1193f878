"""The mission linter finds each mistake when it alone is planted into good files."""

from __future__ import annotations

import json
import re
from contextlib import suppress
from dataclasses import replace
from unittest import mock

import numpy as np
import pytest
from tests.missions import missions_of

from shoal.cli import run
from shoal.core.errors import InvalidInputError
from shoal.missions import (
    FORMATS,
    RULES,
    Mission,
    check_missions,
    lint,
    read_mission,
    write_missions,
)
from shoal.missions.fence import Fence
from shoal.search import open_region
from shoal.search.flight.separation import Separation
from shoal.search.flight.vehicle import vehicle_of
from shoal.search.regions.projection import LocalFrame

FIELD = {
    "type": "FeatureCollection",
    "features": [
        {
            "type": "Feature",
            "properties": {"no_go": zone},
            "geometry": {
                "type": "Polygon",
                "coordinates": [[[w, s], [e, s], [e, n], [w, n], [w, s]]],
            },
        }
        for zone, (w, s, e, n) in [
            (False, (8.5, 47.4, 8.504, 47.402)),
            (True, (8.5018, 47.4008, 8.5022, 47.4012)),
        ]
    ],
}
LANES = [
    (8.50030017, 47.40030013),
    (8.50370017, 47.40030013),
    (8.50370017, 47.40060013),
    (8.50030017, 47.40060013),
]
OUTSIDE = [*LANES[:2], (8.5047, 47.4004), *LANES[2:]]
HOME = (8.50010011, 47.40010019)
AROUND = [(8.5000, 47.4000), (8.5038, 47.4000), (8.5038, 47.4007), (8.5000, 47.4007)]
WIDE = [(8.4990, 47.3990), (8.5050, 47.3990), (8.5050, 47.4030), (8.4990, 47.4030)]

EXPECTED = {
    "autopilot": "px4",
    "airspace": 20.0,
    "separation": 10.0,
}


@pytest.fixture(scope="module")
def region(tmp_path_factory):
    path = tmp_path_factory.mktemp("field") / "field.json"
    path.write_text(json.dumps(FIELD))
    return open_region(path)


def mission(**changes):
    return Mission(**{"waypoints": LANES, "home": HOME, **changes})


def text(change, *, name="robot-01"):
    """Change the text of a file."""
    return lambda folder, suffix: edit(folder / f"{name}{suffix}", change)


def edit(path, change):
    before = path.read_text()
    after = change(before)
    assert after != before, "nothing was planted"
    path.write_text(after)


def swap(old, new, count=1):
    return text(lambda before: before.replace(old, new, count))


def pattern(old, new, count=1):
    return text(lambda before: re.sub(old, new, before, count=count, flags=re.S))


def plan(change, name="robot-01"):
    """Change the content of a .plan, which keeps its decimals."""

    def plant(folder, suffix):
        path = folder / f"{name}{suffix}"
        data = json.loads(path.read_text())
        change(data)
        path.write_text(json.dumps(data))

    return plant


def items(change):
    return plan(lambda data: change(data["mission"]["items"]))


def numbered(rows):
    for number, item in enumerate(rows, start=1):
        item["doJumpId"] = number


def manifest(content):
    """Write another manifest."""
    return lambda folder, _: (folder / "missions.json").write_text(content)


def drop(index):
    def change(rows):
        del rows[index]
        numbered(rows)

    return items(change)


def inserted(command):
    """Add an item after the second waypoint, where that waypoint is."""

    def change(rows):
        rows.insert(4, rows[3] | {"command": command, "params": [0, 0, 0, *rows[3]["params"][3:]]})
        numbered(rows)

    return items(change)


def lines(change):
    return text(lambda before: "\n".join(change(before.splitlines())) + "\n")


def wpl(row, field, value):
    def change(rows):
        fields = rows[row].split("\t")
        fields[field] = value
        return [*rows[:row], "\t".join(fields), *rows[row + 1 :]]

    return lines(change)


def swapped_rows(rows):
    return [
        *rows[:4],
        *("\t".join([*f[:8], f[9], f[8], *f[10:]]) for f in (row.split("\t") for row in rows[4:8])),
        *rows[8:],
    ]


def instead(then=None, **changes):
    """Write another mission, and change it."""

    def plant(folder, suffix):
        # as a program writes them that does not look
        with mock.patch("shoal.missions.files._check_written"):
            write_missions(
                [mission(**changes)],
                folder,
                formats=[name for name in FORMATS if FORMATS.get(name).suffix == suffix],
            )
        if then is not None:
            then(folder, suffix)

    return plant


def rover(plant=None, **changes):
    def both(folder, suffix):
        instead(kind="rover", altitude=0.0, **changes)(folder, suffix)
        if plant is not None:
            plant(folder, suffix)

    return both


def beside(*missions):
    started = [replace(one, start=1000.0 * (one.sortie - 1)) for one in (mission(), *missions)]
    return lambda folder, _suffix: write_missions(started, folder, formats=["plan"])


def every_axis(folder, suffix):
    """Swap all axes of a file, home too: only where the mission should be tells."""
    points = [point[::-1] for point in LANES]
    instead(waypoints=points, home=HOME[::-1])(folder, suffix)


def cut_fence(folder, suffix):
    """Take the last corner out of the file of the fence."""
    instead(fence=Fence(np.array(AROUND)))(folder, suffix)
    edit(folder / "fence.txt", lambda before: before.rsplit("\n", 2)[0])


def fence_circle(*, inclusion, radius, polygons=None, center=(47.4003, 8.502)):
    """Add a circle to the fence, over the first leg of the search."""
    circle = {
        "inclusion": inclusion,
        "version": 1,
        "circle": {"center": list(center), "radius": radius},
    }

    def change(data):
        data["geoFence"]["circles"] = [circle]
        if polygons is not None:
            data["geoFence"]["polygons"] = polygons

    return instead(plan(change), fence=Fence(np.array(AROUND)))


def fence_row(command, first):
    """Add a circle to the fence beside `.waypoints` files, over the first leg of the search."""

    def plant(folder, suffix):
        instead(fence=Fence(np.array(AROUND)))(folder, suffix)
        edit(
            folder / "fence.txt",
            lambda rows: rows + f"4\t0\t0\t{command}\t{first}\t0\t0\t0\t47.4003\t8.502\t0\t1\n",
        )

    return plant


def later_speed(value, at=3):
    """Add an item that changes the speed to the other items, which already have one."""
    return items(
        lambda rows: (
            rows.insert(at, json.loads(json.dumps(rows[1])))
            or rows[at]["params"].__setitem__(1, value)
            or numbered(rows)
        )
    )


def other_speed(folder, _suffix):
    write_missions([mission()], folder, formats=["plan", "gpx"])
    edit(folder / "robot-01.gpx", lambda before: before.replace('speed_m_s="5"', 'speed_m_s="6"'))


def other_place(folder, _suffix):
    write_missions([mission()], folder, formats=["plan", "kml"])
    edit(
        folder / "robot-01.kml",
        lambda before: before.replace("8.50370017,47.40060013", "8.50370017,47.40059913"),
    )


def other_autopilot(folder, _suffix):
    write_missions([mission()], folder, formats=["geojson", "kml"])
    edit(folder / "robot-01.kml", lambda before: before.replace("px4", "ardupilot"))


def extra_waypoints(count):
    rng = np.random.default_rng(5)
    return [(8.5003 + 0.003 * x, 47.4003 + 0.0003 * y) for x, y in rng.random((count, 2))]


DOCTYPE = '<!DOCTYPE kml [<!ENTITY a "47">]>\n<kml'
# rule, suffix, what plants it, where it is found (place), other rules that come with it
PLANTS = [
    ("unreadable", ".plan", swap('"version": 1,', '"version": 1 1,'), "line 3", ()),
    ("unreadable", ".geojson", swap("[", "[[", 1), "line", ()),
    ("unreadable", ".kml", swap("<name>", "<nome>"), "line 3", ()),
    ("unreadable", ".kml", swap("<kml", DOCTYPE), "line 2", ()),
    ("unreadable", ".gpx", swap("<rtept", "&x;<rtept"), "line 6", ()),
    (
        "unreadable",
        ".csv",
        lambda folder, _: (folder / "robot-01.csv").write_bytes(b"number,\xff\n"),
        "line 1",
        (),
    ),
    ("missing-key", ".plan", plan(lambda data: data.pop("geoFence")), "", ()),
    ("missing-key", ".plan", plan(lambda data: data.pop("rallyPoints")), "", ()),
    ("missing-key", ".plan", plan(lambda data: data["mission"].pop("firmwareType")), "mission", ()),
    (
        "missing-key",
        ".plan",
        items(lambda rows: rows[2].pop("autoContinue")),
        "mission, item 3",
        (),
    ),
    ("missing-key", ".plan", items(lambda rows: rows[2].pop("doJumpId")), "mission, item 3", ()),
    ("missing-key", ".geojson", swap('"autopilot"', '"wagon"'), "feature 1", ()),
    ("missing-key", ".kml", swap('name="sortie"', 'name="flight"'), "line", ()),
    ("missing-key", ".gpx", pattern("<rte>.*</rte>", ""), "", ()),
    ("missing-key", ".gpx", swap("<rtept lat", "<rtept latitude"), "line 6", ()),
    ("missing-key", ".csv", swap("latitude", "lat"), "line 1", ()),
    (
        "wrong-value",
        ".plan",
        items(lambda rows: rows[1].update(autoContinue=1)),
        "mission, item 2, autoContinue",
        (),
    ),
    (
        "wrong-value",
        ".plan",
        items(lambda rows: rows[1].update(type="ComplexItem")),
        "mission, item 2, type",
        (),
    ),
    (
        "wrong-value",
        ".plan",
        plan(lambda data: data["mission"].update(version=1)),
        "mission, version",
        (),
    ),
    (
        "wrong-value",
        ".plan",
        plan(lambda data: data["mission"].update(vehicleType=6)),
        "mission",
        (),
    ),
    ("wrong-value", ".waypoints", wpl(5, 8, "north"), "line 6", ()),
    ("wrong-value", ".waypoints", wpl(5, 11, "true"), "line 6", ()),
    ("wrong-value", ".geojson", swap('"kind": "multirotor"', '"kind": "boat"'), "feature 1", ()),
    ("wrong-value", ".csv", swap("2,waypoint", "2,loiter"), "line 4", ()),
    ("wrong-value", ".csv", pattern(r"(\n2,.*?),5\n", r"\1,6\n"), "line 4", ()),
    ("wrong-header", ".waypoints", swap("QGC WPL 110", "QGC WPL 100"), "line 1", ()),
    (
        "field-count",
        ".waypoints",
        lines(lambda rows: [*rows[:5], rows[5].replace("\t1", "", 1), *rows[6:]]),
        "line 6",
        (),
    ),
    (
        "field-count",
        ".waypoints",
        lines(lambda rows: [*rows[:5], rows[5].replace("\t", " "), *rows[6:]]),
        "line 6",
        (),
    ),
    ("field-count", ".csv", swap("3,waypoint", "3,waypoint,"), "line 5", ()),
    (
        "params-count",
        ".plan",
        items(lambda rows: rows[3]["params"].pop()),
        "mission, item 4, params",
        (),
    ),
    ("no-home", ".waypoints", lines(lambda rows: [rows[0], *rows[2:]]), "line 2", ()),
    ("no-home", ".geojson", swap('"role": "home"', '"role": "base"'), "", ()),
    ("no-home", ".kml", swap("<name>home", "<name>base"), "", ()),
    ("no-home", ".gpx", swap("<name>home", "<name>base"), "", ()),
    ("no-home", ".csv", lines(lambda rows: [rows[0], *rows[2:]]), "", ("sequence",)),
    (
        "zero-waypoints",
        ".plan",
        items(lambda rows: rows.__delitem__(slice(2, 6)) or numbered(rows)),
        "",
        (),
    ),
    ("zero-waypoints", ".plan", items(lambda rows: rows.clear()), "", ()),
    ("zero-waypoints", ".waypoints", lines(lambda rows: rows[:2]), "", ()),
    (
        "zero-waypoints",
        ".kml",
        pattern(r"(<altitudeMode>\w+</altitudeMode><coordinates>).*?<", r"\1<"),
        "",
        (),
    ),
    ("zero-waypoints", ".gpx", pattern("<rtept.*?/>\n", "", 0), "", ()),
    (
        "zero-waypoints",
        ".csv",
        lines(lambda rows: [row for row in rows if "waypoint" not in row]),
        "",
        ("sequence",),
    ),
    (
        "not-a-number",
        ".plan",
        items(lambda rows: rows[3]["params"].__setitem__(4, None)),
        "item 4",
        (),
    ),
    (
        "not-a-number",
        ".plan",
        items(lambda rows: rows[3]["params"].__setitem__(6, float("nan"))),
        "item 4",
        (),
    ),
    (
        "not-a-number",
        ".plan",
        items(lambda rows: rows[1]["params"].__setitem__(1, float("inf"))),
        "",
        (),
    ),
    ("not-a-number", ".waypoints", wpl(5, 9, "nan"), "line 6", ()),
    # without a height of home, no two heights could be compared
    (
        "not-a-number",
        ".plan",
        plan(lambda data: data["mission"]["plannedHomePosition"].__setitem__(2, float("nan"))),
        "home",
        (),
    ),
    ("not-a-number", ".waypoints", wpl(1, 10, "inf"), "home", ()),
    ("altitude", ".waypoints", wpl(1, 10, "1e9"), "home", ()),
    ("not-a-number", ".waypoints", wpl(2, 10, "nan"), "line 3", ()),
    (
        "not-a-number",
        ".plan",
        items(lambda rows: rows[0]["params"].__setitem__(6, None)),
        "item 1",
        (),
    ),
    (
        "altitude",
        ".plan",
        items(lambda rows: rows[0]["params"].__setitem__(6, 2e4)),
        "take-off",
        (),
    ),
    (
        "altitude",
        ".plan",
        instead(items(lambda rows: rows[-1]["params"].__setitem__(6, 0)), loiter=0.0),
        "item 7",
        (),
    ),
    ("altitude", ".waypoints", instead(wpl(8, 10, "90"), loiter=0.0), "line 9", ()),
    (
        "acceptance",
        ".plan",
        items(lambda rows: rows[4]["params"].__setitem__(1, 600)),
        "item 5",
        (),
    ),
    (
        "elevation-missing",
        ".plan",
        items(lambda rows: [row.update(frame=0) for row in rows if row["frame"] == 3]),
        "home",
        (),
    ),
    ("not-a-number", ".kml", swap("8.50370017,", "inf,"), "position 2", ()),
    ("out-of-range", ".waypoints", wpl(5, 9, "188.5"), "line 6", ()),
    (
        "out-of-range",
        ".plan",
        items(lambda rows: rows[3]["params"].__setitem__(5, -188.5)),
        "item 4",
        (),
    ),
    ("axes-swapped", ".waypoints", lines(swapped_rows), "line 5", ()),
    (
        "axes-swapped",
        ".plan",
        items(lambda rows: [r["params"].insert(4, r["params"].pop(5)) for r in rows[2:6]]),
        "item 3",
        (),
    ),
    ("axes-swapped", ".geojson", every_axis, "position 1", ()),
    ("axes-swapped", ".gpx", every_axis, "line 6", ()),
    (
        "antimeridian",
        ".csv",
        instead(waypoints=[(179.999, 47.4), (-179.999, 47.4)], home=(179.998, 47.4)),
        "line 4",
        (),
    ),
    ("sequence", ".waypoints", lines(lambda rows: [*rows[:5], *rows[6:]]), "line 6", ()),
    ("sequence", ".waypoints", wpl(4, 0, "9"), "line 5", ()),
    ("sequence", ".csv", swap("3,waypoint", "4,waypoint"), "line 5", ()),
    (
        "do-jump-id",
        ".plan",
        items(lambda rows: [row.update(doJumpId=1) for row in rows]),
        "item 2",
        (),
    ),
    ("frame", ".plan", items(lambda rows: rows[3].update(frame=0)), "item 4", ()),
    ("frame", ".plan", items(lambda rows: rows[-1].update(frame=3)), "item 7", ()),
    ("frame", ".waypoints", wpl(6, 2, "0"), "line 7", ()),
    ("take-off", ".plan", drop(0), "item 2", ()),
    ("take-off", ".waypoints", wpl(2, 3, "16"), "line 3", ()),
    (
        "take-off",
        ".plan",
        rover(items(lambda rows: rows.insert(0, take_off()) or numbered(rows))),
        "item 1",
        (),
    ),
    (
        "armed-wait",
        ".plan",
        items(lambda rows: rows.insert(0, wait()) or numbered(rows)),
        "item 1",
        (),
    ),
    ("armed-wait", ".waypoints", wpl(2, 3, "93"), "line 3", ("take-off", "frame")),
    (
        "armed-wait",
        ".plan",
        items(lambda rows: rows.insert(0, wait() | {"command": 112}) or numbered(rows)),
        "item 1",
        (),
    ),
    (
        "armed-wait",
        ".plan",
        items(lambda rows: rows.insert(0, take_off() | {"command": 19}) or numbered(rows)),
        "item 1",
        (),
    ),
    (
        "armed-wait",
        ".plan",
        items(lambda rows: rows.insert(0, take_off() | {"command": 18}) or numbered(rows)),
        "item 1",
        (),
    ),
    ("take-off", ".plan", items(lambda rows: rows[0]["params"].__setitem__(6, 0)), "item 1", ()),
    ("take-off", ".plan", items(lambda rows: rows[0]["params"].__setitem__(6, -3)), "item 1", ()),
    ("take-off", ".waypoints", wpl(2, 10, "0"), "line 3", ()),
    ("no-return", ".plan", drop(-1), "item 6", ()),
    ("no-return", ".waypoints", lines(lambda rows: rows[:-1]), "line 8", ()),
    ("no-return", ".csv", lines(lambda rows: rows[:-1]), "line 6", ()),
    ("autocontinue", ".plan", items(lambda rows: rows[3].update(autoContinue=False)), "item 4", ()),
    ("autocontinue", ".waypoints", wpl(5, 11, "0"), "line 6", ()),
    ("current", ".waypoints", wpl(5, 1, "1"), "line 6", ()),
    ("current", ".waypoints", wpl(1, 1, "0"), "line 2", ()),
    ("unknown-command", ".plan", items(lambda rows: rows[1].update(command=203)), "item 2", ()),
    *(
        (
            "unchecked-command",
            ".plan",
            items(lambda rows, command=command: rows[1].update(command=command)),
            "item 2",
            (),
        )
        # loiters, landings and ends of a payload, a change of height, jumps, other modes, a home
        # elsewhere, a view elsewhere, a fence turned off
        for command in (30, 31, 85, 94, 113, 176, 177, 179, 186, 192, 195, 201, 207, 601, 999)
    ),
    ("unchecked-command", ".waypoints", wpl(2, 3, "177"), "line 3", ("take-off",)),
    (
        "unchecked-command",
        ".plan",
        rover(items(lambda rows: rows[-1].update(command=21)), landing=HOME),
        "item 6",
        (),
    ),
    ("ends-early", ".plan", inserted(20), "item 5", ("frame",)),
    ("ends-early", ".plan", inserted(21), "item 5", ()),
    ("take-off", ".plan", inserted(22), "item 5", ()),
    ("stay", ".plan", items(lambda rows: rows[1].update(command=19)), "item 2", ()),
    (
        "stay",
        ".plan",
        items(lambda rows: rows[3].__setitem__("params", [9, *rows[3]["params"][1:]])),
        "item 4",
        (),
    ),
    ("stay", ".waypoints", wpl(5, 4, "100000"), "line 6", ()),
    ("manifest", ".plan", manifest("{"), "missions.json", ()),
    ("manifest", ".csv", manifest("[]"), "missions.json", ()),
    ("manifest", ".plan", manifest('{"starts_s": 3}'), "missions.json, starts_s", ()),
    (
        "manifest",
        ".plan",
        manifest('{"starts_s": {"robot-01": "soon"}}'),
        "missions.json, starts_s, robot-01",
        (),
    ),
    (
        "manifest",
        ".plan",
        manifest('{"starts_s": {"robot-01": -1}}'),
        "missions.json, starts_s, robot-01",
        (),
    ),
    (
        "manifest",
        ".plan",
        manifest('{"starts_s": {"robot-01": NaN}}'),
        "missions.json, starts_s, robot-01",
        (),
    ),
    (
        "manifest",
        ".plan",
        manifest(
            '{"ways": {"robot-01": {"waypoints": 9, "waypoints_out": -1, "waypoints_home": 0}}}'
        ),
        "missions.json, ways, robot-01, waypoints_out",
        (),
    ),
    (
        "manifest",
        ".plan",
        manifest('{"footprint_angle_degrees": "north"}'),
        "missions.json, footprint_angle_degrees",
        (),
    ),
    (
        "file-missing",
        ".plan",
        manifest('{"files": ["robot-01.plan", "robot-02.plan"]}'),
        "missions.json",
        (),
    ),
    (
        "file-missing",
        ".waypoints",
        manifest('{"files": ["robot-01.waypoints", "fence.txt"]}'),
        "missions.json",
        (),
    ),
    (
        "file-gone",
        ".plan",
        manifest('{"files": ["robot-01.plan", "robot-01.kml"]}'),
        "missions.json",
        (),
    ),
    (
        "file-gone",
        ".waypoints",
        manifest('{"files": ["robot-01.waypoints", "starts.txt"]}'),
        "missions.json",
        (),
    ),
    ("unlisted", ".plan", manifest('{"files": ["fence.txt"]}'), "", ("file-missing",)),
    ("firmware", ".plan", plan(lambda data: data["mission"].update(firmwareType=3)), "", ()),
    ("firmware", ".plan", plan(lambda data: data["mission"].update(firmwareType=0)), "mission", ()),
    ("firmware", ".gpx", swap("px4", "ardupilot"), "", ()),
    (
        "firmware-mixed",
        ".plan",
        beside(mission(robot=2), mission(robot=3, autopilot="ardupilot")),
        "",
        ("firmware", "homes-near"),
    ),
    ("cap", ".plan", instead(waypoints=extra_waypoints(1997)), "", ()),
    ("cap", ".waypoints", instead(waypoints=extra_waypoints(1997)), "", ()),
    ("cap", ".csv", instead(waypoints=extra_waypoints(1997)), "", ()),
    (
        "altitude",
        ".plan",
        items(lambda rows: [row["params"].__setitem__(6, -5) for row in rows[2:6]]),
        "item 3",
        (),
    ),
    ("altitude", ".kml", swap("<value>30</value>", "<value>30000</value>"), "position 1", ()),
    ("altitude", ".gpx", rover(swap('altitude_m="0"', 'altitude_m="8"')), "line 6", ("vehicle",)),
    (
        "altitude",
        ".plan",
        items(lambda rows: rows[3]["params"].__setitem__(6, 0)),
        "item 4",
        ("altitude-varies",),
    ),
    (
        "below-home",
        ".plan",
        items(lambda rows: [row["params"].__setitem__(6, -20) for row in rows[2:4]]),
        "item 3",
        (),
    ),
    (
        "below-home",
        ".waypoints",
        lines(lambda rows: [*rows[:4], *(deep(row) for row in rows[4:6]), *rows[6:]]),
        "line 5",
        (),
    ),
    (
        "terrain-frame",
        ".waypoints",
        lines(lambda rows: [*rows[:4], *(above_terrain(row) for row in rows[4:8]), *rows[8:]]),
        "line 5",
        (),
    ),
    (
        "frame",
        ".plan",
        items(lambda rows: [row.update(frame=10) for row in rows[2:6]]),
        "item 3",
        (),
    ),
    (
        "spline",
        ".plan",
        items(lambda rows: [row.update(command=82) for row in rows[2:6]]),
        "item 3",
        (),
    ),
    ("spline", ".waypoints", wpl(5, 3, "82"), "line 6", ()),
    # in the no-go zone, below home, at no height, at a pole
    *(
        (
            "not-a-number" if np.isnan(point).any() else "rally",
            ".plan",
            instead(
                plan(lambda data, point=point: data["rallyPoints"].update(points=[point])),
                landing=HOME,
            ),
            "rally point 1",
            (),
        )
        for point in (
            [47.401, 8.502, 30],
            [47.4003, 8.502, -30],
            [47.4003, 8.502, 0],
            [47.4003, 8.502, float("nan")],
            [-90, 0, 30],
        )
    ),
    (
        "rally",
        ".plan",
        instead(fence=Fence(np.array(AROUND)), landing=HOME, rally=((8.502, 47.4011),)),
        "rally point 1",
        (),
    ),
    (
        "rally",
        ".waypoints",
        instead(landing=HOME, rally=((8.5001, 47.4001), (8.502, 47.401))),
        "rally point 2",
        (),
    ),
    # it would return to the nearest rally point
    ("rally", ".plan", instead(rally=(LANES[0],)), "", ()),
    ("rally", ".waypoints", rover(rally=(LANES[0],)), "", ()),
    (
        "invalid",
        ".csv",
        instead(waypoints_out=1, waypoints_home=0, then=swap(",1,0\n", ",4,0\n", -1)),
        "",
        (),
    ),
    ("altitude-high", ".plan", instead(altitude=150.0), "item 3", ()),
    ("altitude-varies", ".plan", items(lambda rows: rows[3]["params"].__setitem__(6, 40)), "", ()),
    (
        "camera",
        ".plan",
        instead(trigger_distance=8.0, then=items(lambda rows: rows.pop(-2) and numbered(rows))),
        "item 10",
        (),
    ),
    (
        "camera",
        ".plan",
        instead(trigger_distance=8.0, then=items(lambda rows: rows[3]["params"].__setitem__(0, 0))),
        "item 4",
        (),
    ),
    (
        "gimbal",
        ".plan",
        instead(
            gimbal_pitch=-90.0, then=items(lambda rows: rows[2]["params"].__setitem__(0, -100))
        ),
        "item 3",
        (),
    ),
    ("gimbal", ".waypoints", instead(gimbal_pitch=-90.0, then=wpl(4, 10, "0")), "line 5", ()),
    ("acceptance", ".plan", instead(acceptance_radius=40.0), "item 4", ()),
    (
        "approach",
        ".plan",
        instead(kind="fixed-wing", landing=(8.5003, 47.4009)),
        "item 6",
        ("turn-radius", "climb"),
    ),
    ("turn-radius", ".csv", instead(kind="fixed-wing"), "line 5", ("climb",)),
    (
        "climb",
        ".geojson",
        instead(kind="fixed-wing", altitude=110.0),
        "position 1",
        ("turn-radius",),
    ),
    ("endurance", ".plan", instead(speed=0.01), "", ()),
    (
        "airspace",
        ".csv",
        instead(kind="fixed-wing", waypoints=OUTSIDE),
        "",
        ("turn-radius", "few-decimals", "climb"),
    ),
    ("speed", ".plan", items(lambda rows: rows[1]["params"].__setitem__(1, 0)), "", ()),
    ("speed", ".plan", later_speed(0), "item 4", ()),
    ("speed", ".plan", later_speed(-5), "item 4", ()),
    ("speed", ".plan", later_speed(500), "item 4", ()),
    ("not-a-number", ".plan", later_speed(float("nan")), "item 4", ()),
    (
        "speed",
        ".waypoints",
        lines(lambda rows: [*rows[:5], rows[3].replace("\t5\t", "\t0\t", 1), *rows[5:]]),
        "line 6",
        ("sequence",),
    ),
    ("endurance", ".plan", later_speed(0.01), "", ()),
    ("speed", ".csv", swap(",5\n", ",500\n", -1), "", ("too-fast",)),
    ("too-fast", ".csv", swap(",5\n", ",8\n", -1), "", ()),
    ("too-fast", ".plan", later_speed(25.0), "item 5", ()),
    ("home-far", ".plan", instead(home=(8.6, 47.4)), "home", ()),
    ("homes-near", ".plan", beside(mission(robot=2)), "", ()),
    ("homes-near", ".csv", beside(mission(robot=2, home=(8.5, 47.4), landing=HOME)), "", ()),
    ("few-decimals", ".waypoints", pattern(r"(\t\d+\.\d{6})\d\d", r"\1", 0), "", ()),
    ("few-decimals", ".kml", pattern(r"(\d+\.\d{6})\d\d", r"\1", 0), "", ()),
    (
        "duplicate",
        ".plan",
        instead(waypoints=[LANES[0], LANES[1], LANES[1], LANES[2]]),
        "item 5",
        (),
    ),
    (
        "outside-region",
        ".plan",
        instead(waypoints=[*LANES, (8.5043, 47.4003)]),
        "item 7",
        ("transit",),
    ),
    ("no-go", ".plan", instead(waypoints=[*LANES[:1], (8.502, 47.401)]), "item 4", ()),
    ("no-go", ".gpx", instead(waypoints=[(8.5003, 47.401), (8.5037, 47.401)]), "line 7", ()),
    (
        "leg-outside",
        ".plan",
        rover(waypoints=[LANES[0], (8.4999, 47.4001), *LANES[1:]]),
        "item 3",
        ("outside-region",),
    ),
    ("fence", ".plan", instead(fence=Fence(np.add(AROUND, [-0.0002, 0.0]))), "item 4", ()),
    (
        "fence",
        ".waypoints",
        instead(fence=Fence(np.array(AROUND), (np.add(AROUND, [0.002, 0.0001]),))),
        "line 6",
        (),
    ),
    ("fence", ".plan", fence_circle(inclusion=False, radius=30), "item 4", ()),
    ("fence", ".plan", fence_circle(inclusion=True, radius=3), "item 3", ()),
    (
        "fence",
        ".plan",
        fence_circle(inclusion=False, radius=30, polygons=[]),
        "item 4",
        ("fence-open",),
    ),
    ("fence", ".plan", fence_circle(inclusion=True, radius=3, polygons=[]), "item 3", ()),
    ("wrong-value", ".plan", fence_circle(inclusion=True, radius=-3), "geoFence, circles", ()),
    (
        "fence",
        ".plan",
        instead(
            fence=Fence(np.array(AROUND), more=(np.add(AROUND, [0.1, 0.0]),)),
            autopilot="ardupilot",
        ),
        "",
        ("firmware",),
    ),
    ("fence-open", ".plan", instead(fence=Fence(np.array(WIDE))), "", ()),
    ("fence-open", ".waypoints", instead(fence=Fence(np.array(WIDE))), "", ()),
    ("fence", ".waypoints", fence_row(5004, 30), "line 6", ()),
    ("fence", ".waypoints", fence_row(5003, 3), "line 5", ()),
    ("beside", ".waypoints", fence_row(5003, 0), "fence.txt", ()),
    ("beside", ".waypoints", cut_fence, "fence.txt", ()),
    ("formats-differ", ".plan", other_speed, "", ("too-fast",)),
    ("formats-differ", ".plan", other_place, "", ()),
    ("formats-differ", ".kml", other_autopilot, "", ("firmware-mixed", "firmware")),
    ("sortie-missing", ".plan", beside(mission(sortie=3)), "", ()),
]


def take_off():
    params = [0, 0, 0, None, 47.4001, 8.5001, 0]
    return {
        "type": "SimpleItem",
        "command": 22,
        "frame": 3,
        "params": params,
        "autoContinue": True,
        "doJumpId": 1,
    }


def deep(row):
    return "\t".join([*row.split("\t")[:10], "-20.00000000", "1"])


def above_terrain(row):
    number, current, _, *rest = row.split("\t")
    return "\t".join([number, current, "10", *rest])


def wait():
    return take_off() | {"command": 93, "frame": 2, "params": [159, -1, -1, -1, 0, 0, 0]}


def write_good(folder, suffix):
    write_missions(
        [mission()],
        folder,
        formats=[name for name in FORMATS if FORMATS.get(name).suffix == suffix],
    )


@pytest.mark.parametrize(
    ("rule", "suffix", "plant", "place", "others"),
    PLANTS,
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_planted_mistakes_are_found(rule, suffix, plant, place, others, tmp_path, region):
    write_good(tmp_path, suffix)
    vehicle = vehicle_of("multirotor,endurance=1000")
    assert lint(tmp_path, region, vehicle=vehicle, **EXPECTED) == []
    plant(tmp_path, suffix)
    with suppress(InvalidInputError):
        kind = read_mission(tmp_path / f"robot-01{suffix}").kind
        speed = ",cruise_speed=5" if kind == "rover" else ""  # that of all planted missions
        vehicle = vehicle_of(f"{kind},endurance=1000{speed}")
    found = lint(tmp_path, region, vehicle=vehicle, **EXPECTED)
    assert {diagnostic.rule for diagnostic in found} - {*others} == {rule}, found
    diagnostic = next(diagnostic for diagnostic in found if diagnostic.rule == rule)
    assert diagnostic.place.startswith(place), diagnostic
    assert diagnostic.severity == RULES[rule].severity
    assert diagnostic.sentence.startswith("expected ")
    assert "got " in diagnostic.sentence
    assert f"{diagnostic.file}, {diagnostic.place}: " in str(diagnostic) or not diagnostic.place
    if RULES[rule].fatal and plant is not every_axis:
        with pytest.raises(InvalidInputError, match="expected"):
            read_mission(tmp_path / f"robot-01{suffix}")


def test_files_of_a_folder_that_are_gone_are_told_once_for_each_format(tmp_path, region):
    written = write_missions(
        [mission(robot=robot, start=0.0) for robot in (1, 2)],
        tmp_path,
        formats=["plan", "wpl", "kml"],
    )
    assert "file-gone" not in {one.rule for one in lint(tmp_path, region, **EXPECTED)}
    for path in written:
        if path.suffix in {".kml", ".txt"} or path.name == "robot-02.waypoints":
            path.unlink()
    found = [one.sentence for one in lint(tmp_path, region, **EXPECTED) if one.rule == "file-gone"]
    assert found == [
        "expected the file starts.txt, the table of the start times, got none",
        "expected the .kml files of 2 missions, got none",
        "expected the file robot-02.waypoints, got none",
    ]


def test_every_rule_is_planted():
    others = {
        "vehicle",
        "cap-ardupilot",
        "transit",
        "fence-near",
        "no-manifest",
        "fence-differs",
        "same-robot",
        "no-start",
        "format-missing",
        "elevation-missing",
        "sorties-overlap",
        "images",
    }  # below, and in the tests of fences, of the separation of files and of cameras
    assert {rule for rule, *_ in PLANTS} | others == {*RULES}


def test_axes_swapped_against_other_robots(tmp_path):
    missions = [mission(robot=number) for number in (1, 2, 3)]
    write_missions(
        [*missions, mission(robot=4, waypoints=[p[::-1] for p in LANES], home=HOME[::-1])],
        tmp_path,
        formats=["plan"],
    )
    (diagnostic,) = lint(tmp_path)
    assert (diagnostic.file, diagnostic.place, diagnostic.rule) == (
        "robot-04.plan",
        "home",
        "axes-swapped",
    )


def test_transit_between_parts(tmp_path):
    path = tmp_path / "parts.json"
    squares = [
        [[[w, 47.4], [w + 0.001, 47.4], [w + 0.001, 47.401], [w, 47.401], [w, 47.4]]]
        for w in (8.5, 8.502)
    ]
    path.write_text(json.dumps({"type": "MultiPolygon", "coordinates": squares}))
    write_missions(
        [mission(waypoints=[(8.5005, 47.4005), (8.5025, 47.4005)], home=(8.5005, 47.4005))],
        tmp_path,
        formats=["plan"],
    )
    (diagnostic,) = lint(tmp_path / "robot-01.plan", open_region(path))
    assert (diagnostic.rule, diagnostic.severity, diagnostic.place) == (
        "transit",
        "warning",
        "item 4",
    )


def test_caps(tmp_path):
    many = mission(waypoints=extra_waypoints(697))
    write_missions([many], tmp_path, formats=["wpl"])
    assert [diagnostic.rule for diagnostic in lint(tmp_path)] == ["cap-ardupilot"]
    assert [diagnostic.rule for diagnostic in lint(tmp_path, autopilot="ardupilot")] == ["cap"]
    assert [diagnostic.rule for diagnostic in lint(tmp_path, cap=250)] == ["cap"]
    assert lint(tmp_path, cap=701) == []
    write_missions([replace(many, autopilot="ardupilot")], tmp_path, formats=["plan"])
    assert [diagnostic.rule for diagnostic in lint(tmp_path)] == ["cap"]
    write_missions(
        [mission(waypoints=extra_waypoints(696), autopilot="ardupilot")],
        tmp_path,
        formats=["plan", "wpl"],
    )
    assert lint(tmp_path) == []


def test_one_file_alone(tmp_path):
    write_missions([mission()], tmp_path, formats=["plan"])
    assert lint(tmp_path / "robot-01.plan") == []


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("none", "expected a mission file"),
        ("none.plan", "expected a mission file, got the error: No such file"),
        (".", "expected a folder with mission files, got a folder without"),
    ],
)
def test_nothing_to_look_over(source, said, tmp_path):
    with pytest.raises(InvalidInputError, match=said):
        lint(tmp_path / source)


def test_metres_and_degrees_do_not_mix(tmp_path, region):
    write_missions(missions_of([(0, 0), (9, 0)], None), tmp_path)
    with pytest.raises(
        InvalidInputError,
        match="expected a mission in degrees, as the region 'field' is, got one in metres",
    ):
        lint(tmp_path, region)
    write_missions([mission()], tmp_path)
    with pytest.raises(InvalidInputError, match="expected a mission in metres"):
        lint(tmp_path, open_region("square:100"))


@pytest.mark.parametrize("options", [{"autopilot": "px5"}, {"cap": 0}])
def test_options_of_the_linter(options, tmp_path):
    write_missions([mission()], tmp_path)
    with pytest.raises(InvalidInputError, match=f"{next(iter(options))}: expected"):
        lint(tmp_path, **options)


def test_homes_of_different_vehicles_are_apart_by_the_separation(tmp_path):
    apart = [
        mission(robot=number, home=(8.5 + east, 47.4001), start=0.0)
        for number, east in ((1, 0.0), (2, 0.0002), (3, 0.00041))
    ]
    write_missions(
        [*apart, replace(apart[2], sortie=2, start=900.0)], tmp_path, formats=["plan", "wpl"]
    )
    assert lint(tmp_path, separation=15.0) == []
    assert lint(tmp_path) == []
    found = lint(tmp_path, separation=16.0)
    assert [(one.file, one.rule, one.severity) for one in found] == [
        ("robot-02.plan", "homes-near", "warning"),
        ("robot-02.waypoints", "homes-near", "warning"),
    ]
    assert (
        "at least 16 m apart, got 15.1 m between robots 1 and 2 and 1 more pair as near"
        in found[0].sentence
    )
    write_missions(
        [replace(one, kind="fixed-wing", landing=HOME, loiter=40.0) for one in apart],
        tmp_path,
        formats=["csv"],
    )
    assert lint(tmp_path, separation=15.0) == []  # one place to circle around


def test_a_waypoint_in_a_hole_names_the_hole(tmp_path):
    path = tmp_path / "hole.json"
    (outer,), (hole,) = (feature["geometry"]["coordinates"] for feature in FIELD["features"])
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [outer, hole]}))
    write_missions([mission(waypoints=[*LANES[:1], (8.502, 47.401)])], tmp_path, formats=["plan"])
    (diagnostic,) = (
        one for one in lint(tmp_path, open_region(path)) if one.rule == "outside-region"
    )
    assert diagnostic.sentence.endswith(" m inside the hole around (8.502, 47.401)")


def test_mistakes_are_an_exit_code(tmp_path, region, capsys):
    (tmp_path / "field.json").write_text(json.dumps(FIELD))
    missions = tmp_path / "missions"
    write_missions([mission()], missions, formats=["plan"])
    assert run(["missions", "check", str(missions), str(tmp_path / "field.json")]) == 0
    items(lambda rows: [row.update(doJumpId=1) for row in rows])(missions, ".plan")
    capsys.readouterr()
    assert run(["missions", "check", str(missions), str(tmp_path / "field.json")]) == 1
    said = capsys.readouterr()
    assert "robot-01.plan, item 2: expected doJumpId 2, got 1" in " ".join(said.out.split())
    assert "3 more like it" in said.out
    assert said.err == "shoal: 6 mistakes in the mission files\n"


@pytest.mark.parametrize("suffix", [".plan", ".waypoints", ".geojson", ".kml", ".gpx", ".csv"])
def test_numbers_that_nobody_means_are_mistakes(suffix, tmp_path, region):
    """A sortie with the number 999999999999 once took all memory, an integer of 400 digits gave a
    traceback.
    """
    write_good(tmp_path, suffix)
    path = tmp_path / f"robot-01{suffix}"
    good = path.read_text()
    for found in list(re.finditer(r"-?\d+(\.\d+)?", good))[::3]:
        for strange in ("999999999999", "1" + "0" * 400):
            path.write_text(good[: found.start()] + strange + good[found.end() :])
            assert all("\n" not in diagnostic.sentence for diagnostic in lint(tmp_path, region))


@pytest.mark.parametrize("encoding", ["utf-7", "rot13", "zlib", "idna", "big5", "gb2312", "utf-32"])
def test_encodings_that_a_mission_declares_do_no_harm(encoding, tmp_path, region):
    for suffix in (".kml", ".gpx"):
        write_good(tmp_path, suffix)
        path = tmp_path / f"robot-01{suffix}"
        path.write_text(path.read_text().replace("UTF-8", encoding))
    assert {diagnostic.severity for diagnostic in lint(tmp_path, region)} <= {"warning"}


@pytest.mark.parametrize(
    "plant",
    [
        items(lambda rows: [row.update(command=82) for row in rows[2:6]]),
        items(lambda rows: [row["params"].insert(4, row["params"].pop(5)) for row in rows[2:6]]),
        items(lambda rows: rows[3]["params"].__setitem__(4, None)),
        items(
            lambda rows: rows.__setitem__(
                slice(2, 6), [{"type": "ComplexItem", "complexItemType": "survey"}]
            )
        ),
        items(lambda rows: [row["params"].__setitem__(6, 0) for row in rows[:6]]),
        items(lambda rows: rows[1]["params"].__setitem__(1, 0)),
        items(lambda rows: [row.update(frame=10) for row in rows[2:6]]),
        items(lambda rows: rows[2]["params"].__setitem__(6, -40)),
    ],
    ids=["spline", "swapped", "null", "survey", "on the ground", "no speed", "terrain", "valley"],
)
@pytest.mark.parametrize("vehicle", [None, "multirotor"])
def test_a_check_reports_each_of_them_and_is_no_refusal(plant, vehicle, tmp_path, region):
    """The check of the whole folder, with a footprint: a mistake is a row of its report, whatever
    else cannot be measured then.
    """
    write_good(tmp_path, ".plan")
    plant(tmp_path, ".plan")
    result = check_missions(tmp_path, region, 40, vehicle=vehicle, separation=Separation())
    assert result.diagnostics
    assert 0 <= result.coverage.covered_fraction < 1


def test_a_survey_of_qgroundcontrol_counts_as_its_items(tmp_path, region):
    def survey(rows):
        rows[2:6] = [
            {
                "type": "ComplexItem",
                "complexItemType": "survey",
                "TransectStyleComplexItem": {"Items": rows[2:6]},
            }
        ]

    write_good(tmp_path, ".plan")
    before = check_missions(tmp_path, region, 40)
    items(survey)(tmp_path, ".plan")
    after = check_missions(tmp_path, region, 40)
    assert after.diagnostics == before.diagnostics == ()
    assert after.coverage.covered_fraction == before.coverage.covered_fraction > 0
    data = json.loads((tmp_path / "robot-01.plan").read_text())
    data["mission"]["items"][2]["TransectStyleComplexItem"]["Items"][1]["params"][4] = None
    (tmp_path / "robot-01.plan").write_text(json.dumps(data))
    assert [one.place for one in lint(tmp_path, region)] == ["item 3, part 2"]


def test_a_check_takes_a_region_as_a_search_does(tmp_path):
    (tmp_path / "field.json").write_text(json.dumps(FIELD))
    write_missions([mission()], tmp_path / "m", formats=["plan"])
    seen = [
        check_missions(tmp_path / "m", given, 40)
        for given in (str(tmp_path / "field.json"), tmp_path / "field.json")
    ]
    seen.append(check_missions(tmp_path / "m", open_region(tmp_path / "field.json"), 40))
    assert len({one.coverage.covered_fraction for one in seen}) == 1
    write_missions(
        [Mission([(5.0, 5.0), (15.0, 5.0)], (0.0, 0.0), geographic=False)], tmp_path / "p"
    )
    assert (
        check_missions(
            tmp_path / "p", "rectangle:20x10", 10.0, vehicle="multirotor"
        ).coverage.covered_fraction
        == 1.0
    )


def one_place(longitude, latitude, after=8):
    """Change the second waypoint of a file in any format."""
    old = (LANES[1][0], LANES[1][1])
    new = [f"{value:.{after}f}" for value in (longitude, latitude)]

    def change(before):
        pairs = [
            (f"{old[0]:.8f},{old[1]:.8f}", f"{new[0]},{new[1]}"),
            (f"[{old[0]:.8f},{old[1]:.8f}]", f"[{new[0]},{new[1]}]"),
            (f'lat="{old[1]:.8f}" lon="{old[0]:.8f}"', f'lat="{new[1]}" lon="{new[0]}"'),
            (f"{old[1]:.8f}\t{old[0]:.8f}", f"{new[1]}\t{new[0]}"),
        ]
        for one, other in pairs:
            before = before.replace(one, other, 1)
        spaced = re.compile(rf"{old[0]:.8f}(,\s+){old[1]:.8f}")
        before = spaced.sub(lambda found: f"{new[0]}{found[1]}{new[1]}", before, count=1)
        spaced = re.compile(rf"{old[1]:.8f}(,\s+){old[0]:.8f}")
        return spaced.sub(lambda found: f"{new[1]}{found[1]}{new[0]}", before, count=1)

    return text(change)


@pytest.mark.parametrize("suffix", [".plan", ".waypoints", ".geojson", ".kml", ".gpx", ".csv"])
@pytest.mark.parametrize(
    "place", [(47.4006, 8.5008), (8.50370017, 8.5015914)], ids=["swapped", "latitude"]
)
def test_one_waypoint_on_another_continent_is_a_row_beside_the_others(
    suffix, place, tmp_path, capsys
):
    (tmp_path / "field.json").write_text(json.dumps(FIELD))
    folder = tmp_path / "m"
    write_missions([mission(waypoints=OUTSIDE), mission(robot=2, home=(8.5005, 47.4))], folder)
    one_place(*place)(folder, suffix)
    (name,) = [name for name in FORMATS if FORMATS.get(name).suffix == suffix]
    base = [
        "missions",
        "check",
        str(folder),
        str(tmp_path / "field.json"),
        "--footprint",
        "40",
        "--format",
        name,
        "--json",
    ]
    for more in ([], ["--vehicle", "multirotor"]):
        assert run([*base, *more]) == 1
        rows = json.loads(capsys.readouterr().out)["diagnostics"]
        ours = [
            row["sentence"]
            for row in rows
            if row["file"] == f"robot-01{suffix}" and row["rule"] == "outside-region"
        ]
        assert len(ours) == 2  # the planted waypoint, and the one that was outside before
        assert ("swapped" in ours[0]) == (place[0] > 40)
    assert len({row["file"] for row in rows}) > 1
    assert [one.rule for one in lint(folder / f"robot-01{suffix}") if one.severity == "error"]


def test_a_waypoint_on_another_continent_adds_no_view_between_its_neighbours(tmp_path, region):
    write_missions([mission(waypoints=[LANES[0], LANES[1], LANES[2]])], tmp_path, formats=["csv"])
    one_place(47.4006, 8.5008)(tmp_path, ".csv")
    away = check_missions(tmp_path, region, 40).coverage
    assert away.length_m == 0.0


@pytest.mark.parametrize("kind", ["multirotor", "fixed-wing"])
@pytest.mark.parametrize("index", [1, 3])
def test_a_waypoint_on_another_continent_is_a_row_for_each_kind_and_place(
    kind, index, tmp_path, region
):
    way = [*LANES]
    way[index] = way[index][::-1]
    write_missions([mission(kind=kind, waypoints=way)], tmp_path, formats=["plan"])
    found = [one for one in lint(tmp_path, region) if one.rule == "outside-region"]
    assert [one.place for one in found] == [f"item {index + 3}"]
    assert check_missions(tmp_path, region, 40, vehicle=kind, separation=Separation()).flights == ()


def wing_rows():
    """A fixed wing that searches a narrow field across: both ends of each row are outside it."""
    field = {**FIELD, "features": [json.loads(json.dumps(FIELD["features"][0]))]}
    field["features"][0]["geometry"]["coordinates"] = [
        [[8.5, 47.4], [8.5004, 47.4], [8.5004, 47.4004], [8.5, 47.4004], [8.5, 47.4]]
    ]
    rows = [47.40003, 47.40013, 47.40023, 47.40033]
    way = [
        (8.4985 if (k + side) % 2 else 8.5019, row) for k, row in enumerate(rows) for side in (0, 1)
    ]
    return field, [(8.5021, 47.4), *way, (8.5001, 47.40038)]


@pytest.mark.parametrize("listed", [True, False])
def test_rows_of_a_fixed_wing_from_outside_to_outside_count_in_each_format(listed, tmp_path):
    field, way = wing_rows()
    (tmp_path / "field.json").write_text(json.dumps(field))
    flown = Mission(way, (8.5021, 47.3999), kind="fixed-wing", waypoints_out=1, waypoints_home=1)
    write_missions([flown], tmp_path / "m", formats=["plan", "wpl", "csv"])
    assert ("ways" in json.loads((tmp_path / "m" / "missions.json").read_text())) is True
    if not listed:
        (tmp_path / "m" / "missions.json").unlink()
    found = [
        check_missions(tmp_path / "m", tmp_path / "field.json", 16, format=name)
        for name in ("csv", "plan", "wpl")
    ]
    assert [one.coverage.covered_fraction for one in found] == [pytest.approx(1.0)] * 3
    outside = [one.coverage.outside_m for one in found]
    assert not listed or outside[1:] == pytest.approx(outside[:1] * 2, abs=1.0)


def test_a_list_of_missions_about_another_file_is_not_believed(tmp_path):
    field, way = wing_rows()
    (tmp_path / "field.json").write_text(json.dumps(field))
    write_missions(
        [Mission(way, (8.5021, 47.3999), kind="fixed-wing", waypoints_out=5, waypoints_home=1)],
        tmp_path,
        formats=["plan"],
    )
    drop(3)(tmp_path, ".plan")
    assert read_mission(tmp_path / "robot-01.plan").waypoints_out is None
    (tmp_path / "missions.json").write_text('{"ways": {"robot-01": 5}}')
    with pytest.raises(
        InvalidInputError, match=r"robot-01.plan, missions.json, ways, robot-01: exp"
    ):
        read_mission(tmp_path / "robot-01.plan")


def test_a_start_that_contradicts_the_manifest_is_told(tmp_path, region):
    write_missions([mission(start=20.0)], tmp_path, formats=["plan", "csv"])
    assert lint(tmp_path, region) == []
    manifest('{"starts_s": {"robot-01": 26}}')(tmp_path, "")
    assert [(fault.file, fault.sentence) for fault in lint(tmp_path, region)] == [
        ("robot-01.csv", "expected 20 s, the start in robot-01.csv, got 26 s")
    ]


def test_missions_without_their_manifest_or_fence_are_told(tmp_path, region):
    write_missions(
        [mission(robot=robot, start=20.0 * robot) for robot in (1, 2)], tmp_path, formats=["plan"]
    )
    assert lint(tmp_path, region) == []
    (tmp_path / "missions.json").unlink()
    assert [fault.rule for fault in lint(tmp_path, region)] == ["no-manifest"]
    (tmp_path / "missions.json").mkdir()
    (fault,) = lint(tmp_path, region)
    assert (fault.rule, fault.sentence) == ("manifest", "expected a file, got a folder")
    (tmp_path / "missions.json").rmdir()
    (tmp_path / "robot-02.plan").unlink()
    assert lint(tmp_path, region) == []  # one mission needs no start time


def test_a_mission_without_the_fence_of_the_others_is_told(tmp_path, region):
    missions = [mission(robot=1, fence=Fence(np.array(AROUND))), mission(robot=2, fence=None)]
    write_missions(missions, tmp_path, formats=["plan"])
    assert [(fault.file, fault.rule) for fault in lint(tmp_path, region)] == [
        ("robot-02.plan", "fence-differs")
    ]


@pytest.mark.parametrize(("inclusion", "radius"), [(False, 10), (True, 900)])
def test_a_circle_of_the_fence_that_bars_no_path_is_no_mistake(inclusion, radius, tmp_path, region):
    write_good(tmp_path, ".plan")
    fence_circle(inclusion=inclusion, radius=radius, center=(47.40045, 8.502))(tmp_path, ".plan")
    assert [one.rule for one in lint(tmp_path, region)] == []
    near = lint(tmp_path, region, fence_distance=7.2)  # the rows are 16.7 m from its middle
    assert {one.rule for one in near} == (set() if inclusion else {"fence-near"})


def test_inclusion_polygons_apart_are_alternatives(tmp_path, region):
    write_good(tmp_path, ".plan")
    beyond = (np.add(AROUND, [0.1, 0.0]),)
    instead(fence=Fence(np.array(AROUND), more=beyond))(tmp_path, ".plan")
    assert lint(tmp_path, region) == []
    assert len(read_mission(tmp_path / "robot-01.plan").fence.outlines) == 2
    instead(fence=Fence(np.array(AROUND), more=(np.add(AROUND, [0.002, 0.0]),)))(tmp_path, ".plan")
    assert {one.rule for one in lint(tmp_path, region)} == {"fence"}


@pytest.mark.parametrize("ending", [b"\n", b"\r\n"])
def test_comments_of_mission_planner_may_have_any_encoding(ending, tmp_path):
    rows = [
        b"#saved by M\xfcller",
        b"47.4 8.5",
        b"  # Stra\xdfe",
        b"47.4 8.504",
        b"47.402 8.504",
        b"47.402 8.5",
    ]
    (tmp_path / "a.poly").write_bytes(ending.join(rows))
    (tmp_path / "b.poly").write_bytes(ending.join(row for row in rows if b"#" not in row))
    assert (
        open_region(tmp_path / "a.poly").area_m2
        == open_region(tmp_path / "b.poly").area_m2
        > 60_000
    )
    (tmp_path / "a.poly").write_bytes(ending.join([*rows, b"47,4\xb0 8,5"]))
    with pytest.raises(InvalidInputError, match="UTF-8, got byte 0xb0 in line 7"):
        open_region(tmp_path / "a.poly")


def test_each_leg_has_the_speed_of_the_item_before_it(tmp_path, region):
    ideal = vehicle_of("ideal,climb_speed=2,sink_speed=2")
    write_good(tmp_path, ".plan")
    before = read_mission(tmp_path / "robot-01.plan")
    later_speed(1.0)(tmp_path, ".plan")
    after = read_mission(tmp_path / "robot-01.plan")
    assert before.speeds is None
    assert after.speeds.tolist() == [5.0, 1.0, 1.0, 1.0, 1.0]
    way = after.path_in(LocalFrame(*HOME))
    legs = np.hypot(*np.diff(way[:, :2], axis=0).T)
    slow = legs[2:].sum()
    assert after.duration(ideal) - before.duration(ideal) == pytest.approx(
        slow / 1.0 - slow / 5.0, rel=1e-6
    )
    told = check_missions(tmp_path, region, None, vehicle=ideal).flights[0]["duration_s"]
    assert told == pytest.approx(after.duration(ideal))
    # no change, the same, the usual one, another one
    for value, same in ((-1.0, True), (5.0, True), (-2.0, True), (4.0, False)):
        write_good(tmp_path, ".plan")
        later_speed(value)(tmp_path, ".plan")
        assert (read_mission(tmp_path / "robot-01.plan").speeds is None) == same
        assert lint(tmp_path, region) == []


def test_no_leg_counts_as_faster_than_the_vehicle(tmp_path, region):
    vehicle = vehicle_of("multirotor")
    write_good(tmp_path, ".plan")
    (usual,) = check_missions(tmp_path, region, None, vehicle=vehicle).flights
    later_speed(25.0)(tmp_path, ".plan")
    fast = check_missions(tmp_path, region, None, vehicle=vehicle)
    assert list(fast.flights) == [usual]
    assert [(one.rule, one.sentence) for one in fast.diagnostics] == [
        (
            "too-fast",
            "expected at most 5 m/s, the cruise speed of the vehicle, got 25 m/s: the check counts"
            " 5 m/s there",
        )
    ]
    # a robot of a team may be faster than the team's vehicle, if the folder says so
    manifest = json.loads((tmp_path / "missions.json").read_text())
    for stated, left in ((25.0, []), (10.0, ["too-fast"])):
        told = manifest | {"cruise_speeds": {"robot-01": stated}}
        (tmp_path / "missions.json").write_text(json.dumps(told))
        own = check_missions(tmp_path, region, None, vehicle=vehicle)
        assert [one.rule for one in own.diagnostics] == left
        assert own.flights[0]["duration_s"] < usual["duration_s"]
    told = manifest | {"cruise_speeds": {"robot-01": 0}}
    (tmp_path / "missions.json").write_text(json.dumps(told))
    wrong = check_missions(tmp_path, region, None, vehicle=vehicle)
    assert [one.rule for one in wrong.diagnostics] == ["manifest"]
    # without a speed in the file, the vehicle's own
    write_good(tmp_path, ".waypoints")
    edit(
        tmp_path / "robot-01.waypoints",
        lambda text: "\n".join(
            "\t".join([str(k - 1), *row.split("\t")[1:]]) if k else row
            for k, row in enumerate(row for row in text.splitlines() if "\t178\t" not in row)
        ),
    )
    slow = vehicle_of("multirotor,cruise_speed=2,turn_time=2")
    own = check_missions(tmp_path, region, None, vehicle=slow, format="wpl")
    assert own.flights[0]["duration_s"] > 1.5 * usual["duration_s"]


@pytest.mark.parametrize("kind", ["multirotor", "fixed-wing"])
def test_missions_with_several_speeds_are_written_and_read(kind, tmp_path):
    speeds = [12.0, 12.0, 9.0, 9.0, 15.0]
    made = mission(
        kind=kind,
        speed=12.0,
        speeds=np.array(speeds),
        waypoints_out=1,
        waypoints_home=1,
        trigger_distance=8.0,
    )
    write_missions([made], tmp_path, formats=["plan", "wpl"])
    for suffix in (".plan", ".waypoints"):
        found = read_mission(tmp_path / f"robot-01{suffix}")
        assert (found.speeds.tolist(), found.speed, found.waypoints_out, found.n_items) == (
            speeds,
            12.0,
            1,
            made.n_items,
        )
    assert [one.rule for one in lint(tmp_path) if one.rule != "turn-radius"] == []
    with pytest.raises(InvalidInputError, match="robot-01: expected one speed in the formats"):
        write_missions([made], tmp_path, formats=["csv"])
    with pytest.raises(InvalidInputError, match="speeds: expected numbers above 0"):
        mission(speeds=np.zeros(5))


def test_a_mission_too_slow_for_the_wind_is_a_row_and_no_refusal(tmp_path, region):
    write_good(tmp_path, ".plan")
    later_speed(1.0)(tmp_path, ".plan")
    result = check_missions(
        tmp_path, region, 40, vehicle="multirotor,wind_speed=3", separation=Separation()
    )
    assert [one.rule for one in result.diagnostics] == ["speed"]
    assert result.flights == ()


@pytest.mark.parametrize(
    "plant",
    [
        items(lambda rows: rows[3]["params"].__setitem__(4, None)),
        plan(lambda data: data["rallyPoints"].update(points="x")),
        plan(lambda data: data["geoFence"].update(circles=[3])),
        one_place(8.52, 47.4003),
    ],
    ids=["null", "rally", "circle", "outside"],
)
def test_no_option_hides_a_mistake(plant, tmp_path, capsys):
    (tmp_path / "field.json").write_text(json.dumps(FIELD))
    corner = "ncols 12\nnrows 12\nxllcorner 8.499\nyllcorner 47.399\ncellsize 0.0005\n"
    (tmp_path / "flat.asc").write_text(corner + "\n".join([" ".join(["400"] * 12)] * 12))
    flown = [mission(fence=Fence(np.array(AROUND))), mission(robot=2, home=(8.5005, 47.4002))]
    write_missions(flown, tmp_path / "m", formats=["plan"])
    plant(tmp_path / "m", ".plan")
    options = (
        ["--terrain", "flat.asc"],
        ["--fence-distance", "1"],
        ["--vehicle", "multirotor"],
        ["--bands", "30"],
        ["--cap", "99"],
    )
    for one in options:
        given = [str(tmp_path / word) if word == "flat.asc" else word for word in one]
        assert (
            run(
                [
                    "missions",
                    "check",
                    str(tmp_path / "m"),
                    str(tmp_path / "field.json"),
                    "--footprint",
                    "40",
                    "--json",
                    *given,
                ]
            )
            == 1
        )
        rows = json.loads(capsys.readouterr().out)["diagnostics"]
        assert [row["file"] for row in rows if row["severity"] == "error"][:1] == ["robot-01.plan"]
    assert (
        run(
            [
                "missions",
                "check",
                str(tmp_path / "m"),
                str(tmp_path / "field.json"),
                "--terrain",
                str(tmp_path / "none.asc"),
            ]
        )
        == 2
    )


def test_a_mission_that_lands_where_it_is_does_not_return_home(tmp_path):
    """ArduPilot lands in place if a landing has no position; PX4 takes zeros for a position."""
    path = tmp_path / "robot-01.plan"
    write_missions([mission(landing=HOME, autopilot="ardupilot")], tmp_path, formats=["plan"])
    items(lambda rows: rows[-1]["params"].__setitem__(slice(4, 6), [0, 0]))(tmp_path, ".plan")
    assert read_mission(path).landing == pytest.approx(LANES[-1], abs=1e-7)
    items(lambda rows: rows[-1]["params"].__setitem__(slice(4, 6), [None, None]))(tmp_path, ".plan")
    assert read_mission(path).landing == pytest.approx(LANES[-1], abs=1e-7)
    plan(lambda data: data["mission"].update(firmwareType=12))(tmp_path, ".plan")
    items(lambda rows: rows[-1]["params"].__setitem__(slice(4, 6), [0, 0]))(tmp_path, ".plan")
    assert read_mission(path).landing == (0.0, 0.0)


def test_a_check_with_another_kind_of_vehicle_says_so(tmp_path, region):
    """Turns of a fixed wing would not be checked in the missions of a multirotor."""
    write_missions([mission()], tmp_path, formats=["plan", "csv"])
    found = lint(tmp_path, region, vehicle=vehicle_of("fixed-wing"))
    assert {(one.rule, one.file) for one in found} == {
        ("vehicle", "robot-01.plan"),
        ("vehicle", "robot-01.csv"),
    }
    assert lint(tmp_path, region, vehicle=vehicle_of("multirotor")) == []
    assert lint(tmp_path, region, vehicle=vehicle_of("ideal")) == []


@pytest.mark.parametrize("kind", ["multirotor", "fixed-wing", "rover"])
def test_files_that_state_no_kind_are_missions_of_the_vehicle_of_the_check(tmp_path, region, kind):
    """Mission Planner writes the missions of planes and copters alike: the turns of a plane went
    unchecked.
    """
    write_missions([mission()], tmp_path, formats=["wpl"])
    found = {one.rule for one in lint(tmp_path, region, vehicle=vehicle_of(kind))}
    assert found == {
        "multirotor": set(),
        "fixed-wing": {"turn-radius", "climb", "transit"},
        "rover": {"altitude", "too-fast"},
    }[kind] - ({"transit"} if kind == "fixed-wing" else set())
