"""Regions in the files of ground control stations: QGroundControl and Mission Planner."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from shoal.core.checks import check_choice, check_file, decode_text, parse_json, read_text
from shoal.core.errors import InvalidInputError
from shoal.search.regions.formats.reading import (
    Reading,
    points_of,
)
from shoal.search.regions.outline import (
    LARGEST_FILE,
    RegionOutline,
    RegionOutlines,
    Ring,
)
from shoal.search.regions.projection import REACH

LAYERS = ("survey", "fence")
"""Parts of a plan of QGroundControl that can be a region."""


_CORNERS = 72
_WPL = "QGC WPL"
# MAV_CMD_NAV_FENCE_...
_RETURN, _INSIDE, _OUTSIDE, _CIRCLE_INSIDE, _CIRCLE_OUTSIDE = range(5000, 5005)
_COLUMNS = 12


def read_plan(path: Path, reading: Reading, *, zones: bool = False) -> RegionOutlines:
    """Return the survey polygons or the fence of a plan of QGroundControl, and the exclusions of
    its fence as no-go zones.

    Raises
    ------
    InvalidInputError
        If the plan has both surveys and an inclusion fence, and no layer is chosen, or if it has
        neither.
    """
    where = str(path)
    data = parse_json(read_text(path, what="region file", most=LARGEST_FILE), where=where)
    if not isinstance(data, dict) or data.get("fileType") != "Plan":
        raise InvalidInputError(
            f'{where}: expected a plan of QGroundControl, with "fileType": "Plan", got another kind'
            " of JSON"
        )
    fence = _fence(data.get("geoFence"), where)
    kinds = {
        "survey": _surveys(data.get("mission"), where),
        "fence": [outline for outline in fence if not outline.no_go],
    }
    exclusions = [outline for outline in fence if outline.no_go]
    if zones:
        if not exclusions:
            raise InvalidInputError(
                f"{where}: expected an exclusion in the fence of the plan as a no-go zone, got none"
            )
        return RegionOutlines(tuple(exclusions), where, geographic=True, closed=False)
    present = [kind for kind, outlines in kinds.items() if outlines]
    if reading.layer is not None:
        check_choice(reading.layer, what="--layer", choices=LAYERS)
        reading.effects.add("layer")
    elif len(present) > 1:
        raise InvalidInputError(
            f"{where}: expected one kind of region, got survey polygons and a fence; choose with"
            " --layer survey or --layer fence"
        )
    chosen = reading.layer or (present[0] if present else "survey")
    if not kinds[chosen]:
        expected_shape = "a survey polygon" if chosen == "survey" else "an inclusion in the fence"
        either = (
            expected_shape if reading.layer else "a survey polygon or an inclusion in the fence"
        )
        raise InvalidInputError(
            f"{where}: expected {either}, got {' and '.join(present) or 'neither'}"
        )
    return RegionOutlines((*kinds[chosen], *exclusions), where, geographic=True, closed=False)


def _surveys(mission: Any, where: str) -> list[RegionOutline]:
    """Return the polygons of the surveys in a mission."""
    items = mission.get("items") if isinstance(mission, dict) else None
    outlines = []
    for number, item in enumerate(items if isinstance(items, list) else [], start=1):
        if isinstance(item, dict) and item.get("complexItemType") == "survey":
            place = f"{where}: item {number}, polygon"
            outlines.append(RegionOutline(Ring(_positions(item.get("polygon"), place), place)))
    return outlines


def _fence(fence: Any, where: str) -> list[RegionOutline]:
    """Return the polygons and circles of a fence. Exclusions are marked as no-go zones."""
    outlines = []
    for kind in ("polygons", "circles"):
        entries = fence.get(kind) if isinstance(fence, dict) else None
        for number, entry in enumerate(entries if isinstance(entries, list) else [], start=1):
            place = f"{where}: geoFence.{kind}[{number - 1}]"
            if not isinstance(entry, dict) or not isinstance(entry.get("inclusion"), bool):
                raise InvalidInputError(f'{place}: expected "inclusion", true or false, got none')
            no_go = not entry["inclusion"]
            if kind == "polygons":
                points = _positions(entry.get("polygon"), f"{place}.polygon")
            else:
                circle = entry.get("circle")
                fields = circle if isinstance(circle, dict) else {}
                (centre,) = _positions([fields.get("center")], f"{place}.circle.center")
                points = _circle(centre, fields.get("radius"), f"{place}.circle", around=no_go)
            outlines.append(RegionOutline(Ring(points, place), no_go=no_go))
    return outlines


def _positions(vertices: Any, place: str) -> Any:
    """Return positions (longitude, latitude) from a list of [latitude, longitude]."""
    if not isinstance(vertices, list):
        raise InvalidInputError(f"{place}: expected a list of [latitude, longitude], got none")
    for number, position in enumerate(vertices, start=1):
        good = isinstance(position, list) and len(position) in (2, 3)
        if not good or not all(
            isinstance(value, int | float) and not isinstance(value, bool) for value in position[:2]
        ):
            raise InvalidInputError(
                f"{place}: vertex {number}: expected [latitude, longitude], got"
                f" {str(position)[:60]}"
            )
    try:
        return points_of((position[1], position[0]) for position in vertices)
    except OverflowError:
        raise InvalidInputError(
            f"{place}: expected coordinates, got an integer that is too large"
        ) from None


def _circle(centre: Any, radius: Any, place: str, *, around: bool) -> Any:
    """Return a polygon around a circle, or inside it. The centre is (longitude, latitude), and the
    radius is in metres.
    """
    from pyproj import Geod

    number = isinstance(radius, int | float) and not isinstance(radius, bool)
    if not number or not 0 < radius <= REACH:
        raise InvalidInputError(
            f"{place}: expected a radius above 0 and at most {REACH:g} m, got {str(radius)[:60]}"
        )
    if not (np.isfinite(centre).all() and abs(centre[0]) <= 180 and abs(centre[1]) <= 90):
        raise InvalidInputError(
            f"{place}: expected a centre with a latitude and a longitude, got {centre[1]:g},"
            f" {centre[0]:g}"
        )
    far = radius / math.cos(math.pi / _CORNERS) if around else radius
    bearings = np.linspace(0, 360, _CORNERS, endpoint=False)
    longitude, latitude, _ = Geod(ellps="WGS84").fwd(
        np.full(_CORNERS, centre[0]),
        np.full(_CORNERS, centre[1]),
        bearings,
        np.full(_CORNERS, float(far)),
    )
    return np.stack([longitude, latitude], axis=1)


def read_polygon_file(path: Path, reading: Reading) -> RegionOutlines:
    """Return the polygon in a file of Mission Planner: ``.poly`` (a polygon), ``.fen`` (a fence),
    or items of a fence as WPL.

    Each line of a ``.poly`` or ``.fen`` file holds a latitude and a longitude. The first line of a
    ``.fen`` file is the point to which the vehicle returns.

    Raises
    ------
    InvalidInputError
        If a line is invalid. The error message names the line.
    """
    where = str(path)
    lines = [
        (number, line.strip())
        for number, line in enumerate(_text_without_comments(path).splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if lines and lines[0][1].startswith(_WPL):
        return RegionOutlines(
            tuple(_wpl_fence(lines[1:], where)), where, geographic=True, closed=False
        )
    points = [_pair(line, f"{where}: line {number}") for number, line in lines]
    if path.suffix.lower() == ".fen":
        lines, points = lines[1:], points[1:]
    if not points:
        raise InvalidInputError(
            f"{where}: expected lines with a latitude and a longitude, got none"
        )
    ring = Ring(points_of(points), where, np.array([number for number, _ in lines]))
    return RegionOutlines((RegionOutline(ring),), where, geographic=True, closed=False)


def _text_without_comments(path: Path) -> str:
    """Return the text of a file with empty comments: Mission Planner writes them in the encoding of
    its computer.
    """
    check_file(path, what="region file", most=LARGEST_FILE)
    try:
        lines = path.read_bytes().splitlines()
    except OSError as error:
        raise InvalidInputError(f"{path}: cannot be read: {error.strerror or error}") from None
    stripped = [b"#" if line.lstrip().startswith(b"#") else line for line in lines]
    return decode_text(b"\n".join(stripped), where=str(path))


def _pair(line: str, where: str) -> tuple[float, float]:
    words = line.replace(",", " ").replace(";", " ").split()
    try:
        latitude, longitude = map(float, words)
    except ValueError:
        raise InvalidInputError(
            f"{where}: expected a latitude and a longitude, got {line[:60]!r}"
        ) from None
    return longitude, latitude


def _wpl_fence(lines: list[tuple[int, str]], where: str) -> list[RegionOutline]:
    """Return the polygons and circles of a fence that Mission Planner or Shoal has written as items
    of a mission.
    """
    outlines: list[RegionOutline] = []
    vertices: list[tuple[float, float]] = []
    numbers: list[int] = []
    begun: tuple[int, int] | None = (
        None  # kind and number of vertices of the polygon that is being read
    )

    def end(number: int) -> None:
        nonlocal begun
        if begun is not None and len(vertices) != begun[1]:
            raise InvalidInputError(
                f"{where}: line {number}: expected a polygon of {begun[1]} vertices, got"
                f" {len(vertices)}"
            )
        if begun is not None:
            ring = Ring(
                points_of(vertices), f"{where}: polygon from line {numbers[0]}", np.array(numbers)
            )
            outlines.append(RegionOutline(ring, no_go=begun[0] == _OUTSIDE))
        vertices.clear()
        numbers.clear()
        begun = None

    last = 0
    for number, line in lines:
        place, last = f"{where}: line {number}", number
        words = line.split()
        if len(words) != _COLUMNS:
            raise InvalidInputError(f"{place}: expected {_COLUMNS} columns, got {len(words)}")
        try:
            command, count = int(words[3]), float(words[4])
            latitude, longitude = float(words[8]), float(words[9])
        except ValueError:
            raise InvalidInputError(f"{place}: expected numbers, got {line[:60]!r}") from None
        if command in (_INSIDE, _OUTSIDE):
            if begun is not None and (len(vertices) == begun[1] or command != begun[0]):
                end(number)
            if begun is None:
                if not 3 <= count <= len(lines):
                    raise InvalidInputError(
                        f"{place}: expected a number of vertices from 3 to {len(lines)}, got"
                        f" {count:g}"
                    )
                begun = command, int(count)
            vertices.append((longitude, latitude))
            numbers.append(number)
        elif command in (_CIRCLE_INSIDE, _CIRCLE_OUTSIDE):
            end(number)
            points = _circle(
                np.array([longitude, latitude]), count, place, around=command == _CIRCLE_OUTSIDE
            )
            outlines.append(RegionOutline(Ring(points, place), no_go=command == _CIRCLE_OUTSIDE))
        elif (
            command != _RETURN and words[0] != "0"
        ):  # the first item of a file may be the home position
            raise InvalidInputError(
                f"{place}: expected the items of a fence (commands 5000 to 5004), got the command"
                f" {command}"
            )
    end(last)
    if not outlines:
        raise InvalidInputError(
            f"{where}: expected the items of a fence (commands 5001 to 5004), got none"
        )
    return outlines
