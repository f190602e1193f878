"""Reader of regions in KML and KMZ files. A KMZ file is a zip archive that contains a KML file."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from shoal.core.checks import check_file
from shoal.core.errors import InvalidInputError
from shoal.search.regions.formats.marks import is_no_go, names_no_go
from shoal.search.regions.formats.reading import Reading, only_lines_text
from shoal.search.regions.formats.xml_tree import Element, XmlError, decode_xml, parse_xml
from shoal.search.regions.limits import LARGEST_FILE, MOST_CORNERS, check_count, opened_zip
from shoal.search.regions.outline_checks import RegionOutline, RegionOutlines, Ring

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


def read_kmz(path: Path, reading: Reading) -> RegionOutlines:
    """Return the polygons in the first KML file of a KMZ archive.

    Raises
    ------
    InvalidInputError
    """
    with opened_zip(path, what="KMZ archive") as archive:
        inside = [one for one in archive.infolist() if one.filename.lower().endswith(".kml")]
        if not inside:
            raise InvalidInputError(f"{path}: expected a .kml file in the archive, got none")
        with archive.open(inside[0]) as file:
            raw = file.read(LARGEST_FILE + 1)
    where = f"{path}: {inside[0].filename[:80]}"
    if len(raw) > LARGEST_FILE:
        raise InvalidInputError(f"{where}: expected at most {LARGEST_FILE} bytes, got more")
    return _outlines(decode_xml(raw, where=where), where, reading)


def _outlines(text: str, where: str, reading: Reading) -> RegionOutlines:
    check_count(text.count(","), 3 * MOST_CORNERS, where=where, what="commas")  # at most two in a vertex, some in descriptions
    try:
        root = parse_xml(text, root="kml")
    except XmlError as error:
        raise InvalidInputError(f"{where}: line {error.line}: {error}") from None
    found: list[RegionOutline] = []
    passed: set[str] = set()
    skipped = 0
    for number, (element, no_go, hidden) in enumerate(_shapes(root), start=1):
        what = f"{where}: polygon {number} (line {element.line})"
        if element.tag == "Polygon":
            outline = _outline(element, what, where, no_go=no_go)
        else:
            ring = element.first("coordinates")
            line = None if ring is None or not ring.text.strip() else _ring(ring, what, where)
            if line is None or not reading.is_polygon(line.points):
                passed.add(element.tag)
                continue
            outline = RegionOutline(line, (), no_go)
        if hidden is not None:
            if reading.hidden is None:
                raise InvalidInputError(
                    f"{what}: expected a visible polygon, got one that the file hides (visibility 0 in line {hidden}); choose with "
                    "--hidden use or --hidden skip"
                )
            reading.effects.add("hidden")
            if reading.hidden == "skip":
                skipped += 1
                continue
        found.append(outline)
    if not found:
        passed |= {element.tag for element in root.walk() if element.tag in _OTHER}
        got = f"{skipped} hidden ones" if skipped else only_lines_text(passed, closed_lines=reading.closed_lines)
        raise InvalidInputError(f"{where}: expected a Polygon, got {got}")
    return RegionOutlines(tuple(found), where, geographic=True)


def _shapes(root: Element) -> Iterator[tuple[Element, bool, int | None]]:
    """Yield each polygon and line, whether it is a no-go zone, and the line of a tag that hides it (None if it is visible).

    A shape is a no-go zone if its placemark or a folder around it says so, and it is hidden if one of them is.
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
        if element.tag in _FEATURES and (_child(element, "visibility") or "").strip().lower() in ("0", "false"):
            hidden = element.line
        waiting += [(child, no_go, hidden) for child in reversed(element.children)]


def _is_no_go(placemark: Element) -> bool:
    told = {child: _child(placemark, child) for child in ("name", "description", "styleUrl")}
    extended = [one for child in placemark.children if child.tag == "ExtendedData" for one in child.walk()]
    for one in extended:
        if one.tag in ("Data", "SimpleData"):
            value = one.first("value") if one.tag == "Data" else one
            told[one.attributes.get("name", "")] = "" if value is None else value.text
    return is_no_go({key: value for key, value in told.items() if key != "styleUrl"}, told["styleUrl"])


def _child(element: Element, tag: str) -> str | None:
    return next((child.text for child in element.children if child.tag == tag), None)


def _outline(polygon: Element, where: str, path: str, *, no_go: bool) -> RegionOutline:
    shells: list[Ring] = []
    holes: list[Ring] = []
    inner = {id(ring) for side in polygon.all("innerBoundaryIs") for ring in side.all("coordinates")}
    for element in polygon.all("coordinates"):
        if id(element) in inner:
            holes.append(_ring(element, f"{where}, hole {len(holes) + 1}", path))
        else:
            shells.append(_ring(element, f"{where}, outline", path))
    if not shells:
        raise InvalidInputError(f"{path}: line {polygon.line}: expected a Polygon with coordinates, got none")
    if len(shells) > 1:
        raise InvalidInputError(f"{where}, outline: expected one outer boundary, got a second one")
    return RegionOutline(shells[0], tuple(holes), no_go)


def _ring(element: Element, where: str, path: str) -> Ring:
    rows = enumerate(element.text.split("\n"))
    words = [*islice(((word, element.line + offset) for offset, row in rows for word in row.split()), MOST_CORNERS + 1)]
    check_count(len(words), MOST_CORNERS, where=where, what="vertices")
    if not words:
        raise InvalidInputError(f"{where}: expected coordinates, got none")
    vertices = [_vertex(word, f"{path}: line {line}") for word, line in words]
    return Ring(np.array(vertices), where, np.array([line for _, line in words]))


def _vertex(word: str, where: str) -> tuple[float, float]:
    """Parse a vertex of the form "longitude,latitude" or "longitude,latitude,altitude", and return the first two numbers."""
    parts = word.split(",")
    try:
        if len(parts) not in (2, 3):
            raise ValueError
        numbers = [float(part) for part in parts]
    except ValueError:
        hint = " (no blanks beside commas)" if word.startswith(",") or word.endswith(",") else ""
        raise InvalidInputError(f"{where}: expected longitude,latitude[,altitude]{hint}, got {word[:60]!r}") from None
    return numbers[0], numbers[1]
