"""Missions as `QGC WPL 110` files: a table of mission items with latitude before longitude."""

from __future__ import annotations

import math

from shoal.missions.diagnostics import Sheet, decimals_of
from shoal.missions.formats.fences import HEADER
from shoal.missions.formats.items import (
    WAYPOINT,
    Item,
    check_take_off,
    degrees,
    items_of,
    kind_of,
    plain,
    read_items,
)
from shoal.missions.mission import Mission

_FIELDS = (
    "seq",
    "current",
    "frame",
    "command",
    "p1",
    "p2",
    "p3",
    "p4",
    "latitude",
    "longitude",
    "altitude",
    "autocontinue",
)


def write(mission: Mission) -> str:
    """Return a mission as the text of a WPL file. WPL has no unset parameters, so a missing heading
    becomes 0 degrees (north).
    """
    longitude, latitude = mission.home
    home = Item(WAYPOINT, 0, (0.0, 0.0, 0.0, 0.0, latitude, longitude, mission.elevation or 0.0))
    rows = [_row(number, item) for number, item in enumerate([home, *items_of(mission)])]
    return "\n".join([HEADER, *rows, ""])


def _row(number: int, item: Item) -> str:
    *first, latitude, longitude, altitude = (
        0.0 if value is None else value for value in item.params
    )
    place = [degrees(latitude), degrees(longitude), degrees(altitude)]
    return "\t".join(
        [
            str(number),
            str(int(number == 0)),
            str(item.frame),
            str(item.command),
            *map(plain, first),
            *place,
            "1",
        ]
    )


def scan(text: str, sheet: Sheet) -> None:
    """Read the content of a WPL file into a mission sheet."""
    lines = text.splitlines()
    if not lines or lines[0].strip() != HEADER:
        sheet.add(
            "wrong-header",
            "line 1",
            f"expected {HEADER!r}, got {lines[0][:40] if lines else 'an empty file'!r}",
        )
        return
    rows = [
        (number, line.split("\t"))
        for number, line in enumerate(lines[1:], start=2)
        if line.strip() and line[0] != "#"
    ]
    items = [item for number, fields in rows if (item := _item(sheet, number, fields)) is not None]
    if not sheet.readable:
        return
    if not items or items[0].command != WAYPOINT or items[0].frame != 0:
        sheet.add(
            "no-home",
            "line 2",
            "expected home in the first row: 0 1 0 16 ..., got "
            + ("none" if not items else "another item"),
        )
        return
    latitude, longitude = (math.nan if value is None else value for value in items[0].params[4:6])
    sheet.home, sheet.elevation = (longitude, latitude), items[0].params[6] or None
    sheet.decimals = max(decimals_of(field) for _, fields in rows for field in fields[8:10])
    read_items(sheet, items[1:])
    if not any(sheet.headings or ()):
        sheet.yaw = sheet.headings = None  # north, or none
    sheet.kind, sheet.kind_is_stated = kind_of(sheet, items[1:]), False
    check_take_off(sheet, items[1:])
    for place, (number, fields) in enumerate(rows):
        if int(fields[0]) != place:
            sheet.add("sequence", f"line {number}", f"expected seq {place}, got {fields[0]}")
        if (fields[1] == "1") != (place == 0):
            sheet.add(
                "current", f"line {number}", f"expected current {int(place == 0)}, got {fields[1]}"
            )
        if fields[11].strip() != "1":
            sheet.add(
                "autocontinue",
                f"line {number}",
                "expected autocontinue 1, got 0: the vehicle stops here",
            )


def _item(sheet: Sheet, number: int, fields: list[str]) -> Item | None:
    place = f"line {number}"
    if len(fields) != len(_FIELDS):
        sheet.add(
            "field-count", place, f"expected {len(_FIELDS)} fields between tabs, got {len(fields)}"
        )
        return None
    numbers: list[float] = []
    for name, field in zip(_FIELDS, fields, strict=True):
        whole = name in ("seq", "current", "frame", "command", "autocontinue")
        try:
            numbers.append(int(field) if whole else float(field))
        except ValueError:
            sheet.add(
                "wrong-value",
                place,
                f"expected {'a whole number' if whole else 'a number'} as {name}, got"
                f" {field[:40]!r}",
            )
            return None
    if not {numbers[1], numbers[11]} <= {0, 1}:
        sheet.add(
            "wrong-value",
            place,
            f"expected 0 or 1 as current and autocontinue, got {fields[1]} and {fields[11]}",
        )
        return None
    return Item(int(numbers[3]), int(numbers[2]), tuple(numbers[4:11]), place)
