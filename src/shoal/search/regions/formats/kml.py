"""Regions in KML, KMZ and GPX files."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_file
from shoal.core.errors import InvalidInputError
from shoal.core.xml import Element, XmlError, decode_xml, parse_xml
from shoal.search.regions.formats.reading import (
    Reading,
    is_no_go,
    names_no_go,
    only_lines_text,
)
from shoal.search.regions.outline import (
    LARGEST_FILE,
    MOST_CORNERS,
    Points,
    RegionOutline,
    RegionOutlines,
    Ring,
    check_count,
    open_zip,
)

_LINES = ("LineString", "LinearRing")
_OTHER = ("Point", "Track")
_CONTAINERS = ("Document", "Folder")
_FEATURES = (*_CONTAINERS, "Placemark")


def read_kml(path: Path, reading: Reading) -> RegionOutlines:
    """Return the polygons in a KML file.

    Raises
    ------
    InvalidInputError
        If the file is invalid. The error message names the line of the mistake.
    """
    check_file(path, what="region file", most=LARGEST_FILE)
    return _outlines(decode_xml(path.read_bytes(), where=str(path)), str(path), reading)


def read_gpx_line(path: Path) -> Points:
    """Return the points of the only track or route of a GPX file, as longitude and latitude in
    degrees; float64, shape (k, 2).
    """
    lines = read_gpx_lines(path, "trkseg", "rte")
    if len(lines) != 1:
        raise InvalidInputError(f"{path}: expected one track or route, got {len(lines)}")
    return lines[0]


def read_gpx_lines(path: Path, *kinds: str) -> list[Points]:
    """Return the points of the elements of some kinds in a GPX file, such as segments of tracks or
    routes, as longitude and latitude in degrees; float64, each of shape (k, 2).
    """
    return [_gpx_points(path, line) for line in _gpx_elements(path, *kinds)]


def read_gpx_tracks(path: Path) -> list[tuple[Points, NDArray[np.float64] | None]]:
    """Return the points of each segment of a track in a GPX file, as in `read_gpx_lines`, and their
    times in seconds, float64 of shape (k,), if all of them have one.
    """
    return [
        (_gpx_points(path, line), _gpx_times(path, line)) for line in _gpx_elements(path, "trkseg")
    ]


def _gpx_elements(path: Path, *kinds: str) -> list[Element]:
    check_file(path, what="GPX file with a line or a track", most=LARGEST_FILE)
    try:
        root = parse_xml(decode_xml(path.read_bytes(), where=str(path)), root="gpx")
    except XmlError as error:
        raise InvalidInputError(f"{path}: line {error.line}: {error}") from None
    return [line for kind in kinds for line in root.all(kind)]


def _gpx_times(path: Path, line: Element) -> NDArray[np.float64] | None:
    elements = [point.first("time") for point in line.all("trkpt")]
    if None in elements:
        return None
    times = []
    for element in elements:
        assert element is not None
        try:
            time = datetime.fromisoformat(element.text.strip())
        except ValueError:
            raise InvalidInputError(
                f"{path}: line {element.line}: expected a time such as 2026-05-31T12:00:00Z, got"
                f" {element.text[:40]!r}"
            ) from None
        times.append((time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp())
    return np.array(times, dtype=np.float64)


def _gpx_points(path: Path, line: Any) -> Points:
    points = []
    for point in (*line.all("trkpt"), *line.all("rtept")):
        try:
            points.append([float(point.attributes[name]) for name in ("lon", "lat")])
        except (KeyError, ValueError):
            raise InvalidInputError(
                f"{path}: line {point.line}: expected lon and lat in degrees, got"
                f" {point.attributes!r:.80}"
            ) from None
    return np.array(points, dtype=np.float64).reshape(-1, 2)


def read_kmz(path: Path, reading: Reading) -> RegionOutlines:
    """Return the polygons in the first KML file of a KMZ archive."""
    with open_zip(path, what="KMZ archive") as archive:
        inside = [
            member for member in archive.infolist() if member.filename.lower().endswith(".kml")
        ]
        if not inside:
            raise InvalidInputError(f"{path}: expected a .kml file in the archive, got none")
        with archive.open(inside[0]) as file:
            raw = file.read(LARGEST_FILE + 1)
    where = f"{path}: {inside[0].filename[:80]}"
    if len(raw) > LARGEST_FILE:
        raise InvalidInputError(f"{where}: expected at most {LARGEST_FILE} bytes, got more")
    return _outlines(decode_xml(raw, where=where), where, reading)


def _outlines(text: str, where: str, reading: Reading) -> RegionOutlines:
    # at most two in a vertex, some in descriptions
    check_count(text.count(","), 3 * MOST_CORNERS, where=where, what="commas")
    try:
        root = parse_xml(text, root="kml")
    except XmlError as error:
        raise InvalidInputError(f"{where}: line {error.line}: {error}") from None
    outlines: list[RegionOutline] = []
    passed: set[str] = set()
    skipped = 0
    for number, (element, no_go, hidden) in enumerate(_shapes(root), start=1):
        label = f"{where}: polygon {number} (line {element.line})"
        if element.tag == "Polygon":
            outline = _outline(element, label, where, no_go=no_go)
        else:
            ring = element.first("coordinates")
            line = None if ring is None or not ring.text.strip() else _ring(ring, label, where)
            if line is None or not reading.is_polygon(line.points):
                passed.add(element.tag)
                continue
            outline = RegionOutline(line, (), no_go)
        if hidden is not None:
            if reading.hidden is None:
                raise InvalidInputError(
                    f"{label}: expected a visible polygon, got one that the file hides (visibility"
                    f" 0 in line {hidden}); choose with --hidden use or --hidden skip"
                )
            reading.effects.add("hidden")
            if reading.hidden == "skip":
                skipped += 1
                continue
        outlines.append(outline)
    if not outlines:
        passed |= {element.tag for element in root.walk() if element.tag in _OTHER}
        actual = (
            f"{skipped} hidden ones"
            if skipped
            else only_lines_text(passed, closed_lines=reading.closed_lines)
        )
        raise InvalidInputError(f"{where}: expected a Polygon, got {actual}")
    return RegionOutlines(tuple(outlines), where, geographic=True)


def _shapes(root: Element) -> Iterator[tuple[Element, bool, int | None]]:
    """Yield each polygon and line, whether it is a no-go zone, and the line of a tag that hides it
    (None if it is visible).

    A shape is a no-go zone if its placemark or a folder around it says so, and it is hidden if one
    of them is.
    """
    waiting: list[tuple[Element, bool, int | None]] = [(root, False, None)]
    while waiting:
        element, no_go, hidden = waiting.pop()
        if element.tag in _CONTAINERS:
            no_go = no_go or names_no_go(_child(element, "name"))
        elif element.tag == "Placemark":
            no_go = no_go or _is_no_go(element)
        elif element.tag in ("Polygon", *_LINES):
            yield element, no_go, hidden
            continue
        if element.tag in _FEATURES and (_child(element, "visibility") or "").strip().lower() in (
            "0",
            "false",
        ):
            hidden = element.line
        waiting += [(child, no_go, hidden) for child in reversed(element.children)]


def _is_no_go(placemark: Element) -> bool:
    properties = {child: _child(placemark, child) for child in ("name", "description", "styleUrl")}
    extended = [
        element
        for child in placemark.children
        if child.tag == "ExtendedData"
        for element in child.walk()
    ]
    for element in extended:
        if element.tag in ("Data", "SimpleData"):
            value = element.first("value") if element.tag == "Data" else element
            properties[element.attributes.get("name", "")] = "" if value is None else value.text
    return is_no_go(
        {key: value for key, value in properties.items() if key != "styleUrl"},
        properties["styleUrl"],
    )


def _child(element: Element, tag: str) -> str | None:
    return next((child.text for child in element.children if child.tag == tag), None)


def _outline(polygon: Element, where: str, path: str, *, no_go: bool) -> RegionOutline:
    shells: list[Ring] = []
    holes: list[Ring] = []
    inner = {
        id(ring) for side in polygon.all("innerBoundaryIs") for ring in side.all("coordinates")
    }
    for element in polygon.all("coordinates"):
        if id(element) in inner:
            holes.append(_ring(element, f"{where}, hole {len(holes) + 1}", path))
        else:
            shells.append(_ring(element, f"{where}, outline", path))
    if not shells:
        raise InvalidInputError(
            f"{path}: line {polygon.line}: expected a Polygon with coordinates, got none"
        )
    if len(shells) > 1:
        raise InvalidInputError(f"{where}, outline: expected one outer boundary, got a second one")
    return RegionOutline(shells[0], tuple(holes), no_go)


def _ring(element: Element, where: str, path: str) -> Ring:
    rows = enumerate(element.text.split("\n"))
    words = [
        *islice(
            ((word, element.line + offset) for offset, row in rows for word in row.split()),
            MOST_CORNERS + 1,
        )
    ]
    check_count(len(words), MOST_CORNERS, where=where, what="vertices")
    if not words:
        raise InvalidInputError(f"{where}: expected coordinates, got none")
    vertices = [_vertex(word, f"{path}: line {line}") for word, line in words]
    return Ring(np.array(vertices), where, np.array([line for _, line in words]))


def _vertex(word: str, where: str) -> tuple[float, float]:
    """Parse a vertex of the form "longitude,latitude" or "longitude,latitude,altitude", and return
    the first two numbers.
    """
    parts = word.split(",")
    try:
        if len(parts) not in (2, 3):
            raise ValueError
        numbers = [float(part) for part in parts]
    except ValueError:
        hint = " (no blanks beside commas)" if word.startswith(",") or word.endswith(",") else ""
        raise InvalidInputError(
            f"{where}: expected longitude,latitude[,altitude]{hint}, got {word[:60]!r}"
        ) from None
    return numbers[0], numbers[1]
