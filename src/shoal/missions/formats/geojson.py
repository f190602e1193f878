"""Missions as GeoJSON files (RFC 7946): a line for the waypoints and a point for home, with
longitude before latitude.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from shoal.missions.diagnostics import Sheet
from shoal.missions.formats.items import (
    Number,
    attributes_of,
    degrees,
    dump_json,
    load_json,
    raw,
    spread_altitudes,
    take_attributes,
)
from shoal.missions.mission import Mission

_FARTHEST = 10**300  # a larger whole number may overflow a float


def write(mission: Mission) -> str:
    """Return a mission as the text of a GeoJSON file. A single waypoint becomes a Point, because a
    LineString needs two points.
    """
    points = [[raw(degrees(value)) for value in point] for point in mission.waypoints.tolist()]
    line: dict[str, Any] = {"type": "LineString", "coordinates": points}
    if len(points) == 1:
        line = {"type": "Point", "coordinates": points[0]}
    home = {"type": "Point", "coordinates": [raw(degrees(value)) for value in mission.home]}
    route = {
        "type": "Feature",
        "properties": {"role": "route", "name": mission.name, **attributes_of(mission)},
        "geometry": line,
    }
    place = {"type": "Feature", "properties": {"role": "home", "name": "home"}, "geometry": home}
    return dump_json({"type": "FeatureCollection", "features": [route, place]}) + "\n"


def scan(text: str, sheet: Sheet) -> None:
    """Read the content of a GeoJSON file into a mission sheet."""
    data = load_json(text, sheet)
    if not sheet.readable:
        return
    if (
        not isinstance(data, dict)
        or data.get("type") != "FeatureCollection"
        or not isinstance(data.get("features"), list)
    ):
        sheet.add(
            "wrong-value",
            "",
            "expected a FeatureCollection with a list of features, got something else",
        )
        return
    roles = {"route": 0, "home": 0}
    for number, feature in enumerate(data["features"], start=1):
        properties = feature.get("properties") if isinstance(feature, dict) else None
        role = properties.get("role") if isinstance(properties, dict) else None
        if properties is None or role not in ("route", "home"):
            continue
        roles[role] += 1
        if role == "route" and roles[role] == 1:
            take_attributes(sheet, f"feature {number}", properties)
            _route(sheet, f"feature {number}", feature.get("geometry"))
        elif roles[role] == 1:
            _home(sheet, f"feature {number}", feature.get("geometry"))
    if roles["route"] != 1:
        sheet.add(
            "missing-key" if not roles["route"] else "wrong-value",
            "",
            f"expected one feature of the role 'route', got {roles['route']}",
        )
    if roles["home"] != 1:
        sheet.add("no-home", "", f"expected one feature of the role 'home', got {roles['home']}")


def _route(sheet: Sheet, where: str, geometry: Any) -> None:
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    coordinates = geometry.get("coordinates") if isinstance(geometry, dict) else None
    if kind not in ("LineString", "Point") or not isinstance(coordinates, list):
        sheet.add(
            "wrong-value",
            where,
            f"expected a LineString, or a Point for one waypoint, got {kind!r}",
        )
        return
    positions = [coordinates] if kind == "Point" else coordinates
    pairs = [
        _position(sheet, f"{where}, position {k}", position)
        for k, position in enumerate(positions, start=1)
    ]
    sheet.points = np.array(pairs, dtype=np.float64).reshape(-1, 2)
    sheet.places = [f"position {k}" for k in range(1, len(pairs) + 1)]
    spread_altitudes(sheet, where)


def _home(sheet: Sheet, where: str, geometry: Any) -> None:
    if not isinstance(geometry, dict) or geometry.get("type") != "Point":
        sheet.add("wrong-value", where, "expected a Point as home, got something else")
        return
    sheet.home = _position(sheet, where, geometry.get("coordinates"))


def _position(sheet: Sheet, where: str, position: Any) -> tuple[float, float]:
    good = isinstance(position, list) and len(position) in (2, 3)
    if not good or not all(
        value is None or (isinstance(value, int | float) and not isinstance(value, bool))
        for value in position
    ):
        sheet.add(
            "wrong-value", where, f"expected [longitude, latitude], got {repr(position)[:60]}"
        )
        return math.nan, math.nan
    if any(isinstance(value, int) and abs(value) > _FARTHEST for value in position):
        sheet.add(
            "out-of-range", where, f"expected [longitude, latitude], got {repr(position)[:60]}"
        )
        return math.nan, math.nan
    sheet.decimals = max(
        sheet.decimals or 0,
        *(value.decimals if isinstance(value, Number) else 0 for value in position[:2]),
    )
    longitude, latitude = (math.nan if value is None else float(value) for value in position[:2])
    return longitude, latitude
