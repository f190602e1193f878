"""Mission files read by other programs: pymavlink, gpxpy, pyogrio, and a reader of .plan written
from its description alone.

Each returns (home, waypoints) as (longitude, latitude); what it expects beside that it asserts.
"""

from __future__ import annotations

import csv
import json

import gpxpy
import numpy as np
import pyogrio
import pyogrio.raw
import shapely
from pymavlink import mavwp


def read_plan(path):
    """Read a .plan as the ground station's loader does: every key there, every type right."""
    data = json.loads(path.read_text(), parse_constant=lambda name: 1 / 0)
    assert set(data) == {
        "fileType",
        "version",
        "groundStation",
        "mission",
        "geoFence",
        "rallyPoints",
    }
    assert (data["fileType"], data["version"], data["groundStation"]) == (
        "Plan",
        1,
        "QGroundControl",
    )
    assert data["geoFence"].keys() == {"version", "circles", "polygons"}
    assert (data["geoFence"]["version"], data["geoFence"]["circles"]) == (2, [])
    for polygon in data["geoFence"]["polygons"]:
        assert polygon.keys() == {"version", "inclusion", "polygon"}
        assert (polygon["version"], type(polygon["inclusion"])) == (1, bool)
        assert all(len(corner) == 2 and abs(corner[0]) <= 90 for corner in polygon["polygon"])
    assert data["rallyPoints"].keys() == {"version", "points"}
    assert data["rallyPoints"]["version"] == 2
    assert all(len(point) == 3 for point in data["rallyPoints"]["points"])
    mission = data["mission"]
    assert set(mission) == {
        "version",
        "firmwareType",
        "vehicleType",
        "cruiseSpeed",
        "hoverSpeed",
        "globalPlanAltitudeMode",
        "plannedHomePosition",
        "items",
    }
    assert mission["version"] == 2
    assert mission["firmwareType"] in (3, 12)
    assert mission["vehicleType"] in (1, 2, 10)
    assert len(mission["plannedHomePosition"]) == 3
    for number, item in enumerate(mission["items"], start=1):
        assert set(item) == {"type", "command", "frame", "params", "autoContinue", "doJumpId"}
        assert item["type"] == "SimpleItem"
        assert item["autoContinue"] is True
        assert item["doJumpId"] == number
        assert len(item["params"]) == 7
        assert item["frame"] == (
            {1: 3, 2: 0}[mission["globalPlanAltitudeMode"]]
            if item["command"] in (16, 21, 22)
            else 2
        )
        assert all(value is None or type(value) in (int, float) for value in item["params"])
    commands = [item["command"] for item in mission["items"]]
    camera = [command for command in commands if command in (205, 206)]
    images = [command for command in camera if command == 206]
    assert camera in ([], [205], images, [205, *images])
    assert len(images) != 1
    begin = [93] * commands.count(93) + ([178] if mission["vehicleType"] == 10 else [22, 178])
    assert commands[-1] in (20, 21)
    assert [command for command in commands if command not in camera] == [
        *begin,
        *[16] * commands.count(16),
        commands[-1],
    ]
    home = mission["plannedHomePosition"]
    return (home[1], home[0]), [
        (item["params"][5], item["params"][4]) for item in mission["items"] if item["command"] == 16
    ]


def read_beside(path, loader):
    """Read the fence or the rally points beside a .waypoints file with pymavlink: (command, count,
    longitude, latitude) each.
    """
    from pymavlink import mavutil

    mavutil.set_dialect("ardupilotmega")
    loader.load(str(path))
    items = [loader.item(k) for k in range(loader.count())]
    assert [item.seq for item in items] == list(range(len(items)))
    assert {item.mission_type for item in items} == {loader.mav_mission_type()}
    return [(item.command, item.param1, item.y, item.x) for item in items]


def read_wpl(path):
    loader = mavwp.MAVWPLoader()
    loader.load(str(path))
    items = [loader.wp(k) for k in range(loader.count())]
    assert [item.seq for item in items] == list(range(len(items)))
    assert [item.current for item in items] == [1, *[0] * (len(items) - 1)]
    assert {item.autocontinue for item in items} == {1}
    assert (items[0].command, items[0].frame) == (16, 0)
    assert items[-1].command == 20
    assert {item.frame for item in items[1:] if item.command in (16, 22)} in ({3}, {0})
    return (items[0].y, items[0].x), [(item.y, item.x) for item in items[1:] if item.command == 16]


def read_by_gdal(path):
    """Read GeoJSON and KML with GDAL."""
    home, points = None, None
    for layer, _ in pyogrio.list_layers(path):
        meta, _, shapes, fields = pyogrio.raw.read(path, layer=layer)
        names = fields[[name.lower() for name in meta["fields"]].index("name")]
        for name, shape in zip(names, shapely.from_wkb(shapes), strict=True):
            array = shapely.get_coordinates(shape)
            home, points = (array[0], points) if name == "home" else (home, array)
    return tuple(home), points


def read_gpx(path):
    found = gpxpy.parse(path.read_text())
    (home,), (route,) = found.waypoints, found.routes
    assert home.name == "home"
    assert route.name == path.stem
    return (home.longitude, home.latitude), [
        (point.longitude, point.latitude) for point in route.points
    ]


def read_csv(path):
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    x, y = ("x_m", "y_m") if "x_m" in rows[0] else ("longitude", "latitude")
    place = [(float(row[x]), float(row[y])) for row in rows]
    assert [row["command"] for row in rows] == ["home", *["waypoint"] * (len(rows) - 2), "return"]
    assert place[-1] == place[0]
    return place[0], place[1:-1]


READERS = {
    ".plan": read_plan,
    ".waypoints": read_wpl,
    ".geojson": read_by_gdal,
    ".kml": read_by_gdal,
    ".gpx": read_gpx,
    ".csv": read_csv,
}


def distance_to_way(points, way):
    """Return the largest distance of points from a way."""
    line = shapely.linestrings(way) if len(way) > 1 else shapely.points(way[0])
    return float(shapely.distance(shapely.points(np.asarray(points)), line).max())
