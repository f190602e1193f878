"""Missions as CSV files, with a line for home, a line for each waypoint, and a line for the return.

Coordinates in a CSV mission are in degrees, or in metres if the region has no position on Earth.
"""

from __future__ import annotations

import csv

import numpy as np

from shoal.missions.diagnostics import Sheet
from shoal.missions.formats.items import (
    ALTITUDES,
    MORE,
    NAMES,
    attributes_as_text,
    degrees,
    number_in,
    plain,
    position_in,
    take_attributes,
)
from shoal.missions.mission import Mission

_ALTITUDE = "altitude_m"
_DEGREES = ("longitude", "latitude")
_METRES = ("x_m", "y_m")


def write(mission: Mission) -> str:
    """Return a mission as the text of a CSV file: home, the waypoints, and the return home."""
    attributes = {
        name: text for name, text in attributes_as_text(mission).items() if name != ALTITUDES
    }
    columns = ("number", "command", *(_DEGREES if mission.geographic else _METRES), *attributes)
    levels = mission.levels
    altitudes = [levels[0], *levels.tolist(), levels[-1]]
    stops = [mission.home, *mission.waypoints.tolist(), mission.end]
    commands = ["home", *["waypoint"] * len(mission.waypoints), "return"]
    rows = [
        [
            str(number),
            command,
            degrees(x),
            degrees(y),
            *(attributes | {_ALTITUDE: plain(altitude)}).values(),
        ]
        for number, (command, (x, y), altitude) in enumerate(
            zip(commands, stops, altitudes, strict=True)
        )
    ]
    return "\n".join([",".join(row) for row in [list(columns), *rows]]) + "\n"


def scan(text: str, sheet: Sheet) -> None:
    """Read the content of a CSV file into a mission sheet."""
    try:
        rows = [
            (number, row)
            for number, row in enumerate(csv.reader(text.splitlines(), strict=True), start=1)
            if row
        ]
    except csv.Error as error:
        sheet.add("unreadable", "", f"expected a table with commas, got something else: {error}")
        return
    heading = [name.strip() for name in rows[0][1]] if rows else []
    sheet.geographic = not {*_METRES} & {*heading}
    columns = ("number", "command", *(_DEGREES if sheet.geographic else _METRES), *NAMES)
    missing = [name for name in columns if name not in heading]
    for name in missing:
        sheet.add("missing-key", "line 1", f"expected the column {name!r}, got none")
    if missing:
        return
    for line, row in rows[1:]:
        if len(row) != len(heading):
            sheet.add(
                "field-count", f"line {line}", f"expected {len(heading)} fields, got {len(row)}"
            )
    if sheet.readable:
        _items(
            sheet,
            [
                (line, dict(zip(heading, map(str.strip, row), strict=True)))
                for line, row in rows[1:]
            ],
        )


def _items(sheet: Sheet, rows: list[tuple[int, dict[str, str]]]) -> None:
    points: list[tuple[float, float]] = []
    for place, (line, row) in enumerate(rows):
        if row["number"] != str(place):
            sheet.add(
                "sequence", f"line {line}", f"expected number {place}, got {row['number'][:20]!r}"
            )
        if row["command"] == "home" and sheet.home is None:
            sheet.home = _position(sheet, line, row)
        elif row["command"] == "waypoint":
            points.append(_position(sheet, line, row))
            sheet.places.append(f"line {line}")
        elif row["command"] != "return" or place != len(rows) - 1:
            sheet.add(
                "wrong-value",
                f"line {line}",
                f"expected home, waypoints and then one return, got {row['command'][:40]!r}",
            )
    sheet.points = np.array(points, dtype=np.float64).reshape(-1, 2)
    if sheet.home is None:
        sheet.add("no-home", "", "expected a line with the command 'home', got none")
    if rows:
        _attributes(sheet, rows)
        if rows[-1][1]["command"] != "return":
            sheet.add(
                "no-return",
                f"line {rows[-1][0]}",
                f"expected a return at the end, got {rows[-1][1]['command'][:40]!r}",
            )


def _attributes(sheet: Sheet, rows: list[tuple[int, dict[str, str]]]) -> None:
    """Read the attributes of a mission from the first line of a CSV file.

    All lines of the file must have equal attributes, except for altitudes.
    """
    names = [name for name in (*NAMES, *MORE) if name in rows[0][1]]
    first = {name: rows[0][1][name] for name in names}
    take_attributes(sheet, f"line {rows[0][0]}", first)
    sheet.altitudes = [
        number_in(sheet, f"line {line}", _ALTITUDE, row)
        for line, row in rows
        if row["command"] == "waypoint"
    ]
    for line, row in rows[1:]:
        for name in names:
            if name != _ALTITUDE and row[name] != first[name]:
                sheet.add(
                    "wrong-value",
                    f"line {line}",
                    f"expected {first[name]!r} as every {name!r}, got {row[name][:40]!r}",
                )


def _position(sheet: Sheet, line: int, row: dict[str, str]) -> tuple[float, float]:
    names = _DEGREES if sheet.geographic else _METRES
    return position_in(sheet, f"line {line}", names, row)
