"""KML: the polygons of placemarks."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from shoal.checks import read_text
from shoal.errors import InvalidInputError
from shoal.search.regions.formats.xml_tree import Element, XmlError, parse_xml
from shoal.search.regions.outline_checks import RegionOutline, RegionOutlines, Ring, is_true

_OTHER = ("Point", "LineString", "Track")


def read_kml(path: Path) -> RegionOutlines:
    """Return the polygons in a KML file.

    Raises
    ------
    InvalidInputError
        With the line.
    """
    try:
        root = parse_xml(read_text(path, what="region file"), root="kml")
    except XmlError as error:
        raise InvalidInputError(f"{path}: line {error.line}: {error}") from None
    zones = {id(polygon): _is_no_go(placemark) for placemark in root.all("Placemark") for polygon in placemark.all("Polygon")}
    found = [
        _outline(polygon, f"{path}: polygon {number} (line {polygon.line})", path, no_go=zones.get(id(polygon), False))
        for number, polygon in enumerate(root.all("Polygon"), start=1)
    ]
    if not found:
        passed = {element.tag for element in root.walk() if element.tag in (*_OTHER, "LinearRing")}
        got = "only " + " and ".join(sorted(passed)) if passed else "none"
        raise InvalidInputError(f"{path}: expected a Polygon, got {got}")
    return RegionOutlines(tuple(found), str(path), geographic=True)


def _is_no_go(placemark: Element) -> bool:
    """Tell whether a placemark is a zone to keep out of: its name or its extended data say so."""
    names = (child.text.strip() for child in placemark.children if child.tag == "name")
    if any(re.match(r"no[-_ ]?go\b", name, flags=re.IGNORECASE) for name in names):
        return True
    data = [element for element in placemark.walk() if element.tag in ("Data", "SimpleData")]
    values = [one.first("value") if one.tag == "Data" else one for one in data if one.attributes.get("name") == "no_go"]
    return any(value is not None and is_true(value.text) for value in values)


def _outline(polygon: Element, where: str, path: Path, *, no_go: bool) -> RegionOutline:
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


def _ring(element: Element, where: str, path: Path) -> Ring:
    words = [(word, element.line + offset) for offset, row in enumerate(element.text.split("\n")) for word in row.split()]
    if not words:
        raise InvalidInputError(f"{where}: expected coordinates, got none")
    vertices = [_vertex(word, f"{path}: line {line}") for word, line in words]
    return Ring(np.array(vertices), where, np.array([line for _, line in words]))


def _vertex(word: str, where: str) -> tuple[float, float]:
    """Read "longitude,latitude" or "longitude,latitude,altitude"."""
    parts = word.split(",")
    try:
        if len(parts) not in (2, 3):
            raise ValueError
        numbers = [float(part) for part in parts]
    except ValueError:
        hint = " (no blanks beside commas)" if word.startswith(",") or word.endswith(",") else ""
        raise InvalidInputError(f"{where}: expected longitude,latitude[,altitude]{hint}, got {word[:60]!r}") from None
    return numbers[0], numbers[1]
