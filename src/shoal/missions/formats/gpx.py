"""Missions as GPX 1.1 files: a route for the waypoints, and a waypoint for home.

Elevations in GPX are heights above sea level. The writer writes elevations only if altitudes are
heights above sea level, or if home's height above sea level is known. The reader ignores elevations
if the file stores altitudes above ground, or an altitude for each waypoint.
"""

from __future__ import annotations

import numpy as np

from shoal.core.xml import Element
from shoal.missions.diagnostics import Sheet, parse_root
from shoal.missions.formats.items import (
    attributes_as_text,
    degrees,
    position_in,
    spread_altitudes,
    take_attributes,
)
from shoal.missions.mission import Mission


def write(mission: Mission) -> str:
    """Return a mission as the text of a GPX file."""
    attributes = " ".join(
        f'{name}="{value}"' for name, value in attributes_as_text(mission).items()
    )
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        (
            '<gpx version="1.1" creator="Shoal" xmlns="http://www.topografix.com/GPX/1/1"'
            ' xmlns:shoal="urn:shoal:mission">'
        ),
        f"<wpt {_place(*mission.home)}><name>home</name></wpt>",
        f"<rte><name>{mission.name}</name><number>{mission.robot}</number>",
        f"<extensions><shoal:mission {attributes}/></extensions>",
        *(
            f"<rtept {_place(x, y)}{end}"
            for (x, y), end in zip(mission.waypoints.tolist(), _ends(mission), strict=True)
        ),
        "</rte>",
        "</gpx>",
        "",
    ]
    return "\n".join(lines)


def _ends(mission: Mission) -> list[str]:
    """Return the text after the position of each waypoint, with an elevation if the height above
    sea level is known.
    """
    if mission.elevation is None and mission.altitude_frame != "sea":
        return ["/>"] * len(mission.waypoints)
    heights = mission.heights_above_home + (mission.elevation or 0.0)
    return [f"><ele>{height:.2f}</ele></rtept>" for height in heights.tolist()]


def _place(longitude: float, latitude: float) -> str:
    return f'lat="{degrees(latitude)}" lon="{degrees(longitude)}"'


def scan(text: str, sheet: Sheet) -> None:
    """Read the content of a GPX file into a mission sheet."""
    root = parse_root(text, "gpx", sheet)
    if root is None:
        return
    routes = root.all("rte")
    if len(routes) != 1:
        sheet.add(
            "wrong-value" if routes else "missing-key",
            "",
            f"expected one route <rte>, got {len(routes)}",
        )
    else:
        _route(sheet, routes[0])
    homes = [
        point
        for point in root.all("wpt")
        if (name := point.first("name")) is not None and name.text.strip() == "home"
    ]
    if len(homes) != 1:
        sheet.add("no-home", "", f"expected one <wpt> named 'home', got {len(homes)}")
    else:
        sheet.home = _position(sheet, homes[0])


def _route(sheet: Sheet, route: Element) -> None:
    attributes = route.first("mission")
    take_attributes(
        sheet, f"line {route.line}", {} if attributes is None else attributes.attributes
    )
    elements = route.all("rtept")
    points = [_position(sheet, element) for element in elements]
    sheet.points = np.array(points, dtype=np.float64).reshape(-1, 2)
    sheet.places = [f"line {element.line}" for element in elements]
    if len(sheet.altitudes) > 1:
        spread_altitudes(sheet, f"line {route.line}")
        return
    raised = [_elevation(sheet, element) for element in elements]
    base = next((height for height in raised if height is not None), 0.0)
    if sheet.altitude_frame == "ground":  # on terrain, whose elevations differ anyway
        raised = [base] * len(raised)
    sheet.altitudes = [
        altitude + (base if height is None else height) - base
        for altitude in sheet.altitudes
        for height in raised
    ]


def _elevation(sheet: Sheet, element: Element) -> float | None:
    elevation = element.first("ele")
    try:
        return None if elevation is None else float(elevation.text)
    except ValueError:
        sheet.add(
            "wrong-value",
            f"line {elevation.line if elevation else 0}",
            f"expected a number as 'ele', got {elevation.text[:40] if elevation else ''!r}",
        )
        return None


def _position(sheet: Sheet, element: Element) -> tuple[float, float]:
    return position_in(sheet, f"line {element.line}", ("lon", "lat"), element.attributes)
