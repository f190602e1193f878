"""Fences and rally points, in separate `QGC WPL 110` files for ArduPilot, and in the `.plan` file
for QGroundControl.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from shoal.core.errors import InvalidInputError
from shoal.missions.fence import Fence, circle_ring
from shoal.missions.formats.items import Item, degrees, plain, raw
from shoal.search.regions.outline import Points

FENCE, RALLY = "fence.txt", "rally.txt"
"""Names of the files for the fence and the rally points, which all ``.waypoints`` files of a folder
share.
"""

HEADER = "QGC WPL 110"
_INSIDE, _OUTSIDE, _RALLY_POINT = 5001, 5002, 5100  # MAV_CMD
_CIRCLES = {5003: _INSIDE, 5004: _OUTSIDE}  # MAV_CMD of circles, with their radius in metres
_GLOBAL, _RELATIVE = 0, 3  # MAV_FRAME
_ABOVE_HOME = (_RELATIVE, 6)  # the second with integer coordinates
_FIELDS = 12

Places = tuple[tuple[float, ...], ...]


def fence_text(fence: Fence) -> str:
    """Return a fence as a table of mission items. Each item is a corner, with the number of corners
    of its polygon.
    """
    rows = [
        (
            _GLOBAL,
            _OUTSIDE if number >= len(fence.outlines) else _INSIDE,
            float(len(ring)),
            x,
            y,
            0.0,
        )
        for number, ring in enumerate(fence.rings)
        for x, y in ring.tolist()
    ]
    return _table(rows)


def rally_text(points: Places) -> str:
    """Return rally points with their heights above home as a table of mission items."""
    return _table([(_RELATIVE, _RALLY_POINT, 0.0, x, y, up) for x, y, up in points])


def _table(rows: Sequence[tuple[int, int, float, float, float, float]]) -> str:
    lines = [
        "\t".join(
            [
                str(number),
                "0",
                str(frame),
                str(command),
                plain(first),
                "0",
                "0",
                "0",
                degrees(y),
                degrees(x),
                degrees(z),
                "1",
            ]
        )
        for number, (frame, command, first, x, y, z) in enumerate(rows)
    ]
    return "\n".join([HEADER, *lines, ""])


def read_fence(text: str, where: str) -> Fence:
    """Return the fence that a table of mission items describes."""
    rings: list[tuple[int, list[tuple[float, float]]]] = []
    missing, corners = 0, 0.0
    for line, command, _, first, (*place, _) in _rows(text, where):
        if command in _CIRCLES and not missing:
            if not 0 < first < math.inf:
                raise InvalidInputError(
                    f"{where}: line {line}: expected a radius of a circle above 0 m, got {first:g}"
                )
            kind = _CIRCLES[command]
            rings.append(
                (
                    kind,
                    [
                        (x, y)
                        for x, y in circle_ring(
                            (place[0], place[1]), first, inclusion=kind == _INSIDE
                        ).tolist()
                    ],
                )
            )
            continue
        if command not in (_INSIDE, _OUTSIDE) or not 3 <= first < 1e6 or first % 1:
            raise InvalidInputError(
                f"{where}: line {line}: expected command 5001 or 5002 with a count of 3 corners or"
                f" more, or 5003 or 5004 for a circle, got {command}"
            )
        if not missing:
            rings.append((command, []))
            missing = int(first)
            corners = first
        elif command != rings[-1][0] or first != corners:
            raise InvalidInputError(
                f"{where}: line {line}: expected {missing} more corners of the previous polygon,"
                " got another polygon"
            )
        rings[-1][1].append((place[0], place[1]))
        missing -= 1
    inside = [np.array(ring) for command, ring in rings if command == _INSIDE]
    if missing or not rings:
        raise InvalidInputError(
            f"{where}: expected complete polygons, got {missing or 'all'} corners too few"
        )
    return fence_from(inside, [np.array(ring) for command, ring in rings if command == _OUTSIDE])


def fence_from(inside: Sequence[Points], outside: Sequence[Points]) -> Fence:
    """Return a fence with any numbers of inclusion and exclusion rings."""
    outline, *more = inside or [np.zeros((0, 2))]
    return Fence(outline, tuple(outside), tuple(more))


def read_rally(text: str, where: str) -> Places:
    """Return the rally points, with their heights above home, that a table of mission items
    describes.
    """
    rows = _rows(text, where)
    for line, command, frame, _, _ in rows:
        if command != _RALLY_POINT or frame not in _ABOVE_HOME:
            raise InvalidInputError(
                f"{where}: line {line}: expected command 5100 and frame 3 (altitude above home), got"
                f" {command} and {frame}"
            )
    return tuple(place for *_, place in rows)


def _rows(text: str, where: str) -> list[tuple[int, int, int, float, tuple[float, float, float]]]:
    """Return the line, the command, the frame, the first parameter and the position of each item in
    a table of mission items.
    """
    lines = text.splitlines()
    if not lines or lines[0].strip() != HEADER:
        raise InvalidInputError(
            f"{where}: line 1: expected {HEADER!r}, got"
            f" {lines[0][:40] if lines else 'an empty file'!r}"
        )
    rows = []
    for number, line in enumerate(lines[1:], start=2):
        fields = line.split()
        if not fields:
            continue
        try:
            if len(fields) != _FIELDS:
                raise ValueError
            frame, command = int(fields[2]), int(fields[3])
            first, latitude, longitude, height = (float(fields[k]) for k in (4, 8, 9, 10))
            if not (abs(longitude) <= 180 and abs(latitude) <= 90):
                raise ValueError
        except ValueError:
            raise InvalidInputError(
                f"{where}: line {number}: expected 12 numbers of a mission item, got {line[:60]!r}"
            ) from None
        rows.append((number, command, frame, first, (longitude, latitude, height)))
    return rows


def plan_fence(fence: Fence | None) -> dict[str, Any]:
    """Return the section of a ``.plan`` file that describes a fence."""
    polygons = [
        {
            "inclusion": fence is not None and number < len(fence.outlines),
            "polygon": [[raw(degrees(y)), raw(degrees(x))] for x, y in ring.tolist()],
            "version": 1,
        }
        for number, ring in enumerate(() if fence is None else fence.rings)
    ]
    return {"version": 2, "circles": [], "polygons": polygons}


def plan_rally(points: Places) -> dict[str, Any]:
    """Return the section of a ``.plan`` file that describes rally points."""
    return {
        "version": 2,
        "points": [[raw(degrees(y)), raw(degrees(x)), up] for x, y, up in points],
    }


def fence_items(
    rings: Sequence[tuple[Any, bool]], circles: Sequence[tuple[Any, bool]]
) -> list[Item]:
    """Return a fence as items: each corner (latitude, longitude) with the number of corners of its
    polygon, and each circle with its radius. The second part of a pair says whether it is inside.
    """
    corners = [
        Item(
            _INSIDE if inside else _OUTSIDE,
            _GLOBAL,
            (float(len(ring)), 0.0, 0.0, 0.0, latitude, longitude, 0.0),
        )
        for ring, inside in rings
        for latitude, longitude in ring
    ]
    commands = {kind: command for command, kind in _CIRCLES.items()}
    return corners + [
        Item(
            commands[_INSIDE if inside else _OUTSIDE],
            _GLOBAL,
            (circle.radius, 0.0, 0.0, 0.0, *circle.center, 0.0),
        )
        for circle, inside in circles
    ]


def rally_items(points: Sequence[tuple[Any, float]]) -> list[Item]:
    """Return rally points, each (latitude, longitude) with its altitude above home, as items."""
    return [
        Item(_RALLY_POINT, _RELATIVE, (0.0, 0.0, 0.0, 0.0, *place, altitude))
        for place, altitude in points
    ]


def table_items(text: str) -> list[Item]:
    """Return the items of a table that `read_fence`, `read_rally` or the format WPL has read."""
    rows = [line.split() for line in text.splitlines()[1:]]
    return [
        Item(int(row[3]), int(row[2]), tuple(float(value) for value in row[4:11]))
        for row in rows
        if row and not row[0].startswith("#")
    ]
