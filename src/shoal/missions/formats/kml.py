"""Missions as KML 2.2 files: a line for the waypoints and a point for home, with longitude before
latitude.
"""

from __future__ import annotations

import math
from html import escape

import numpy as np

from shoal.core.xml import Element
from shoal.missions.diagnostics import Sheet, decimals_of, parse_root
from shoal.missions.formats.items import (
    attributes_as_text,
    degrees,
    plain,
    spread_altitudes,
    take_attributes,
)
from shoal.missions.mission import Mission


def write(mission: Mission) -> str:
    """Return a mission as the text of a KML file. A single waypoint becomes a Point, because a
    LineString needs two points.
    """
    mode, heights = _heights(mission)
    points = [
        f"{degrees(x)},{degrees(y)},{plain(z)}"
        for (x, y), z in zip(mission.waypoints.tolist(), heights, strict=True)
    ]
    shape = "LineString" if len(points) > 1 else "Point"
    data = [
        f'    <Data name="{name}"><value>{escape(value, quote=False)}</value></Data>'
        for name, value in attributes_as_text(mission).items()
    ]
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<kml xmlns="http://www.opengis.net/kml/2.2"><Document>',
        f"<name>{mission.name}</name>",
        "<Placemark>",
        "  <name>route</name>",
        "  <ExtendedData>",
        *data,
        "  </ExtendedData>",
        f"  <{shape}><altitudeMode>{mode}</altitudeMode><coordinates>",
        *points,
        f"  </coordinates></{shape}>",
        "</Placemark>",
        "<Placemark>",
        "  <name>home</name>",
        (
            f"  <Point><coordinates>{degrees(mission.home[0])},{degrees(mission.home[1])},0</coordinates></Point>"
        ),
        "</Placemark>",
        "</Document></kml>",
        "",
    ]
    return "\n".join(lines)


def _heights(mission: Mission) -> tuple[str, list[float]]:
    """Return the altitude mode of KML, and the altitudes of the waypoints in metres.

    KML supports altitudes above ground and above sea level. Heights above home can be converted
    only if home's height above sea level is known. If home's height above sea level is unknown, the
    line lies on the ground, and only the attributes contain the heights.
    """
    count = len(mission.waypoints)
    if mission.kind != "rover":
        if mission.altitude_frame == "ground":
            return "relativeToGround", np.round(mission.levels, 2).tolist()
        if mission.altitude_frame == "sea" or mission.elevation is not None:
            return (
                "absolute",
                np.round(mission.heights_above_home + (mission.elevation or 0.0), 2).tolist(),
            )
    return "clampToGround", [0.0] * count


def scan(text: str, sheet: Sheet) -> None:
    """Read the content of a KML file into a mission sheet."""
    root = parse_root(text, "kml", sheet)
    if root is None:
        return
    named: dict[str, list[Element]] = {"route": [], "home": []}
    for placemark in root.all("Placemark"):
        name = placemark.first("name")
        if name is not None and name.text.strip() in named:
            named[name.text.strip()].append(placemark)
    if len(named["route"]) != 1:
        rule = "wrong-value" if named["route"] else "missing-key"
        sheet.add(rule, "", f"expected one Placemark named 'route', got {len(named['route'])}")
    else:
        _route(sheet, named["route"][0])
    if len(named["home"]) != 1:
        sheet.add("no-home", "", f"expected one Placemark named 'home', got {len(named['home'])}")
        return
    home = _positions(sheet, named["home"][0])
    if len(home) != 1:
        sheet.add(
            "no-home",
            f"line {named['home'][0].line}",
            f"expected home with one position, got {len(home)}",
        )
    else:
        sheet.home = home[0]


def _route(sheet: Sheet, placemark: Element) -> None:
    attributes = {}
    for data in placemark.all("Data"):
        value = data.first("value")
        attributes[data.attributes.get("name", "")] = (
            value.text.strip() if value is not None else ""
        )
    take_attributes(sheet, f"line {placemark.line}", attributes)
    points = _positions(sheet, placemark)
    sheet.points = np.array(points, dtype=np.float64).reshape(-1, 2)
    sheet.places = [f"position {k}" for k in range(1, len(points) + 1)]
    spread_altitudes(sheet, f"line {placemark.line}")


def _positions(sheet: Sheet, placemark: Element) -> list[tuple[float, float]]:
    """Return the positions of a placemark as (longitude, latitude) in degrees."""
    element = placemark.first("coordinates")
    if element is None:
        sheet.add(
            "missing-key",
            f"line {placemark.line}",
            "expected coordinates in the Placemark, got none",
        )
        return []
    positions = []
    for number, word in enumerate(element.text.split(), start=1):
        parts = word.split(",")
        try:
            if len(parts) not in (2, 3):
                raise ValueError
            longitude, latitude = float(parts[0]), float(parts[1])
        except ValueError:
            where = f"line {element.line}, position {number}"
            sheet.add(
                "wrong-value", where, f"expected longitude,latitude,altitude, got {word[:60]!r}"
            )
            longitude = latitude = math.nan
        else:
            sheet.decimals = max(sheet.decimals or 0, *map(decimals_of, parts[:2]))
        positions.append((longitude, latitude))
    return positions
