"""Reader of regions in KML and KMZ files. A KMZ file is a zip archive that contains a KML file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from shoal.core.checks import decode_text, read_text
from shoal.core.errors import InvalidInputError
from shoal.search.regions.formats.marks import is_no_go, names_no_go
from shoal.search.regions.formats.xml_tree import Element, XmlError, parse_xml
from shoal.search.regions.limits import LARGEST_FILE, opened_zip
from shoal.search.regions.outline_checks import RegionOutline, RegionOutlines, Ring

_OTHER = ("Point", "LineString", "Track")
_CONTAINERS = ("Document", "Folder")


def read_kml(path: Path) -> RegionOutlines:
    """Return the polygons in a KML file.

    Raises
    ------
    InvalidInputError
        If the file is invalid. The error message names the line of the mistake.
    """
    return _outlines(read_text(path, what="region file", most=LARGEST_FILE), str(path))


def read_kmz(path: Path) -> RegionOutlines:
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
    return _outlines(decode_text(raw, where=where), where)


def _outlines(text: str, where: str) -> RegionOutlines:
    try:
        root = parse_xml(text, root="kml")
    except XmlError as error:
        raise InvalidInputError(f"{where}: line {error.line}: {error}") from None
    zones = _zones(root)
    found = [
        _outline(polygon, f"{where}: polygon {number} (line {polygon.line})", where, no_go=id(polygon) in zones)
        for number, polygon in enumerate(root.all("Polygon"), start=1)
    ]
    if not found:
        passed = {element.tag for element in root.walk() if element.tag in (*_OTHER, "LinearRing")}
        got = "only " + " and ".join(sorted(passed)) if passed else "none"
        raise InvalidInputError(f"{where}: expected a Polygon, got {got}")
    return RegionOutlines(tuple(found), where, geographic=True)


def _zones(root: Element) -> set[int]:
    """Return the identities of the polygon elements that a placemark or a folder around the polygon marks as no-go zones."""
    marked = [one for one in root.walk() if one.tag in _CONTAINERS and names_no_go(_child(one, "name"))]
    marked += [one for one in root.all("Placemark") if _is_no_go(one)]
    return {id(polygon) for one in marked for polygon in one.all("Polygon")}


def _is_no_go(placemark: Element) -> bool:
    told = {child: _child(placemark, child) for child in ("name", "description", "styleUrl")}
    for one in placemark.walk():
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
    words = [(word, element.line + offset) for offset, row in enumerate(element.text.split("\n")) for word in row.split()]
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
