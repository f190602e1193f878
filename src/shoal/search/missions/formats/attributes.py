"""Attributes of missions besides coordinates. GeoJSON, KML, GPX and CSV files store each attribute under one common name."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from shoal.core.errors import InvalidInputError
from shoal.search.flight.flight import FRAMES
from shoal.search.missions.diagnostics import Sheet
from shoal.search.missions.formats.numbers import plain
from shoal.search.missions.mission import KINDS, SAME_LEVEL, Mission
from shoal.search.problem.mission_options import CAPS

NAMES = ("robot", "sortie", "autopilot", "kind", "altitude_m", "altitude_frame", "speed_m_s")

MORE = ("start_s", "landing_x", "landing_y", "loiter_m", "takeover_m", "waypoints_out", "waypoints_home")
"""Names of the optional attributes of a mission, such as its start time and its landing point."""

ALTITUDES = "altitudes_m"
"""Name of the attribute for the altitudes of all waypoints, if they differ, as numbers separated by spaces."""


def attributes_of(mission: Mission) -> dict[str, str | int | float]:
    """Return the attributes of a mission by name: all in `NAMES`, and those in `MORE` and `ALTITUDES` that the mission has.

    Raises
    ------
    InvalidInputError
        If the mission has several speeds, which only mission items can express.
    """
    if mission.speeds is not None:
        raise InvalidInputError(
            f"{mission.name}: expected one speed in the formats geojson, kml, gpx and csv, got {len({*mission.speeds.tolist()})} "
            "speeds; the formats plan and wpl have them"
        )
    named = {name: getattr(mission, name.removesuffix("_m_s").removesuffix("_m")) for name in NAMES}
    more: list[float | None] = [
        mission.start,
        *(mission.landing or (None, None)),
        mission.loiter,
        mission.takeover,
        mission.waypoints_out,
        mission.waypoints_home,
    ]
    named |= {name: value for name, value in zip(MORE, more, strict=True) if value is not None}
    levels = mission.levels
    return named | ({ALTITUDES: " ".join(f"{level:.10g}" for level in levels.tolist())} if np.ptp(levels) > SAME_LEVEL else {})


def attributes_as_text(mission: Mission) -> dict[str, str]:
    """Return the attributes of a mission as texts, for file formats without numbers."""
    return {name: value if isinstance(value, str) else plain(value) for name, value in attributes_of(mission).items()}


def take_attributes(sheet: Sheet, place: str, found: Mapping[str, Any]) -> None:
    """Store the attributes of a mission file in its sheet, and add diagnostics for invalid attributes."""
    missing = [name for name in NAMES if name not in found]
    for name in missing:
        sheet.add("missing-key", place, f"expected {name!r}, got none")
    if missing:
        return
    for name in ("robot", "sortie"):
        number = _whole(found[name])
        if number is None or number < 1:
            sheet.add("wrong-value", place, f"expected a whole number of 1 or more as {name!r}, got {_short(found[name])}")
        else:
            setattr(sheet, name, number)
    for name, known in (("autopilot", CAPS), ("kind", KINDS), ("altitude_frame", FRAMES)):
        if isinstance(found[name], str) and found[name] in known:
            setattr(sheet, name, found[name])
        else:
            sheet.add("wrong-value", place, f"expected {' or '.join(map(repr, known))} as {name!r}, got {_short(found[name])}")
    more = {name: found[name] for name in MORE if name in found}
    if "landing_x" in more and "landing_y" in more:
        sheet.landing = (number_in(sheet, place, "landing_x", more), number_in(sheet, place, "landing_y", more))
    for name in ("loiter_m", "start_s", "takeover_m"):
        if name in more:
            setattr(sheet, name.rpartition("_")[0], number_in(sheet, place, name, more))
    for name in ("waypoints_out", "waypoints_home"):
        if name in more:
            number = _whole(more[name])
            if number is None or number < 0:
                sheet.add("wrong-value", place, f"expected a whole number of 0 or more as {name!r}, got {_short(more[name])}")
            else:
                setattr(sheet, name, number)
    words = str(found.get(ALTITUDES, "")).split()
    sheet.altitudes = [number_in(sheet, place, ALTITUDES, {ALTITUDES: word}) for word in words] or [
        number_in(sheet, place, "altitude_m", found)
    ]
    sheet.speed = number_in(sheet, place, "speed_m_s", found)


def spread_altitudes(sheet: Sheet, place: str) -> None:
    """Give each waypoint of a sheet an altitude: its own altitude, or the common altitude of the mission."""
    count = len(sheet.points)
    if len(sheet.altitudes) > 1 and len(sheet.altitudes) != count:
        sheet.add("wrong-value", place, f"expected {count} numbers as {ALTITUDES!r}, one per waypoint, got {len(sheet.altitudes)}")
        sheet.altitudes = sheet.altitudes[:1]
    if len(sheet.altitudes) == 1:
        sheet.altitudes *= count


def _whole(value: Any) -> int | None:
    if isinstance(value, bool):
        return None
    try:
        return int(str(value))
    except ValueError:
        return None


def number_in(sheet: Sheet, place: str, name: str, found: Mapping[str, Any]) -> float:
    """Return the attribute ``name`` as a number. If the attribute is invalid, return NaN and add a diagnostic."""
    value = found[name]
    if not isinstance(value, bool):
        try:
            number = float(value)
        except (TypeError, ValueError, OverflowError):
            pass
        else:
            if name in MORE and not math.isfinite(number):
                sheet.add("not-a-number", place, f"expected a finite number as {name!r}, got {number}")
                return math.nan
            return number
    sheet.add("wrong-value", place, f"expected a number as {name!r}, got {_short(value)}")
    return math.nan


def _short(value: Any) -> str:
    return repr(value)[:60]
