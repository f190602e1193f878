"""What GeoJSON, KML, GPX and CSV files say of a mission beside its coordinates, under the same names."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from shoal.search.flight.flight import FRAMES
from shoal.search.missions.diagnostics import Sheet
from shoal.search.missions.mission import KINDS, Mission
from shoal.search.problem.mission_options import CAPS

NAMES = ("robot", "sortie", "autopilot", "kind", "altitude_m", "altitude_frame", "speed_m_s")

MORE = ("delay_s", "landing_x", "landing_y")
"""Those that a file may lack: a mission of no delay that ends by a return home."""


def attributes_of(mission: Mission) -> dict[str, str | int | float]:
    """Return the attributes of a mission, in the order of `NAMES` and, as far as it has them, `MORE`."""
    named = {name: getattr(mission, name.removesuffix("_m_s").removesuffix("_m")) for name in NAMES}
    more: list[float | None] = [mission.delay or None, *(mission.landing or (None, None))]
    return named | {name: value for name, value in zip(MORE, more, strict=True) if value is not None}


def take_attributes(sheet: Sheet, place: str, found: Mapping[str, Any]) -> None:
    """Fill a sheet with attributes as a file has them, numbers or text, and note what is wrong with them."""
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
    if "delay_s" in more:
        sheet.delay = _real(sheet, place, "delay_s", more)
    if "landing_x" in more and "landing_y" in more:
        sheet.landing = (_real(sheet, place, "landing_x", more), _real(sheet, place, "landing_y", more))
    sheet.altitudes = [_real(sheet, place, "altitude_m", found)]
    sheet.speed = _real(sheet, place, "speed_m_s", found)


def _whole(value: Any) -> int | None:
    if isinstance(value, bool):
        return None
    try:
        return int(str(value))
    except ValueError:
        return None


def _real(sheet: Sheet, place: str, name: str, found: Mapping[str, Any]) -> float:
    value = found[name]
    if not isinstance(value, bool):
        try:
            return float(value)
        except (TypeError, ValueError, OverflowError):
            pass
    sheet.add("wrong-value", place, f"expected a number as {name!r}, got {_short(value)}")
    return math.nan


def _short(value: Any) -> str:
    return repr(value)[:60]
