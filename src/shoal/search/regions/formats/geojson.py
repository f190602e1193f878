"""Reader of regions and points in GeoJSON files (RFC 7946). Every error message names the place of a mistake in the file."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from shoal.core.checks import parse_json, read_text
from shoal.core.errors import InvalidInputError
from shoal.search.regions.formats.crs import to_degrees
from shoal.search.regions.formats.marks import is_no_go, names_no_go
from shoal.search.regions.formats.reading import Reading, only_lines_text
from shoal.search.regions.limits import LARGEST_FILE
from shoal.search.regions.outline_checks import Points, RegionOutline, RegionOutlines, Ring

_OTHER = {"Point", "MultiPoint", "LineString", "MultiLineString"}
_SYSTEM = re.compile(r"[\w:/.() -]{1,200}", re.ASCII)  # EPSG:25832, urn:ogc:def:crs:OGC:1.3:CRS84: a name without definition


def read_geojson(path: Path, reading: Reading) -> RegionOutlines:
    """Return the polygons in a GeoJSON file.

    Raises
    ------
    InvalidInputError
    """
    data = parse_json(read_text(path, what="region file", most=LARGEST_FILE), where=str(path))
    found: list[RegionOutline] = []
    passed: set[str] = set()
    for where, shape, no_go in _geometries(data, str(path)):
        kind = shape.get("type")
        if kind == "Polygon":
            found.append(_polygon(_list(shape, "coordinates", where), where, no_go))
        elif kind == "MultiPolygon":
            for k, rings in enumerate(_list(shape, "coordinates", where), start=1):
                if not isinstance(rings, list):
                    raise InvalidInputError(f"{where}, polygon {k}: expected a list of rings, got {_short(rings)}")
                found.append(_polygon(rings, f"{where}, polygon {k}", no_go))
        elif isinstance(kind, str) and kind in _OTHER:
            lines = [_points(line, where) for line in _lines(shape, where)] if reading.closed_lines else []
            closed = [RegionOutline(Ring(points, where), (), no_go) for points in lines if reading.is_polygon(points)]
            found += closed
            passed |= set() if closed else {kind}
        else:
            got = "no type" if kind is None else f"the type {_short(kind)}"
            raise InvalidInputError(f"{where}: expected a GeoJSON Polygon, MultiPolygon, Feature or FeatureCollection, got {got}")
    if not found:
        got = only_lines_text(passed, closed_lines=reading.closed_lines)
        raise InvalidInputError(f"{path}: expected a Polygon or MultiPolygon, got {got}")
    name = _crs_name(data, str(path))
    if name is None:
        return RegionOutlines(tuple(found), str(path), geographic=True)
    return to_degrees(tuple(found), str(path), name)


def read_positions(path: Path, *, what: str) -> tuple[Points, bool]:
    """Return the points in a GeoJSON file, and whether these points are the vertices of a line.

    Parameters
    ----------
    path : path
    what : str
        Name of the file in error messages.

    Raises
    ------
    InvalidInputError
    """
    data = parse_json(read_text(path, what=what, most=LARGEST_FILE), where=str(path))
    points: list[Points] = []
    lines: list[Points] = []
    for where, shape, _ in _geometries(data, str(path)):
        kind = shape.get("type")
        if kind == "Point":
            points.append(_points([shape.get("coordinates")], where))
        elif kind in ("MultiPoint", "LineString"):
            (points if kind == "MultiPoint" else lines).append(_points(shape.get("coordinates"), where))
        else:
            raise InvalidInputError(f"{where}: expected a Point, MultiPoint or LineString, got {_short(kind)}")
    if len(lines) > 1 or (lines and points) or not (lines or points):
        got = f"{len(points)} sets of points and {len(lines)} lines"
        raise InvalidInputError(f"{path}: expected points or one line, got {got}")
    if lines and len(lines[0]) < 2:
        raise InvalidInputError(f"{path}: expected a line of two vertices or more, got {len(lines[0])}")
    return np.concatenate(lines or points), bool(lines)


def _geometries(data: Any, where: str, no_go: bool = False) -> Iterator[tuple[str, dict[str, Any], bool]]:
    """Yield each geometry of a GeoJSON object, with its place in the file, and whether it is marked as a no-go zone."""
    if not isinstance(data, dict):
        raise InvalidInputError(f"{where}: expected a GeoJSON object, got {_short(data)}")
    kind = data.get("type")
    if kind == "FeatureCollection":
        zones = no_go or names_no_go(data.get("name"))
        for k, feature in enumerate(_list(data, "features", where), start=1):
            yield from _geometries(feature, f"{where}: feature {k}", zones)
    elif kind == "Feature":
        if data.get("geometry") is not None:
            told = data.get("properties")
            zone = is_no_go(told if isinstance(told, dict) else {}, data.get("id"))
            yield from _geometries(data["geometry"], where, no_go or zone)
    elif kind == "GeometryCollection":
        for k, geometry in enumerate(_list(data, "geometries", where), start=1):
            yield from _geometries(geometry, f"{where}, geometry {k}", no_go)
    else:
        yield where, data, no_go


def _lines(shape: dict[str, Any], where: str) -> list[Any]:
    """Return the lines of a geometry that may have some."""
    if shape["type"] == "MultiLineString":
        return _list(shape, "coordinates", where)
    return [shape.get("coordinates")] if shape["type"] == "LineString" else []


def _list(data: dict[str, Any], key: str, where: str) -> list[Any]:
    value = data.get(key)
    if not isinstance(value, list):
        raise InvalidInputError(f"{where}: expected a list of {key}, got {_short(value) if key in data else 'none'}")
    return value


def _polygon(rings: list[Any], where: str, no_go: bool) -> RegionOutline:
    if not rings:
        raise InvalidInputError(f"{where}: expected a polygon with a ring, got an empty one")
    made = [Ring(_points(ring, f"{where}, ring {k + 1}"), f"{where}, ring {k + 1}") for k, ring in enumerate(rings)]
    return RegionOutline(made[0], tuple(made[1:]), no_go)


def _points(ring: Any, where: str) -> Points:
    if not isinstance(ring, list):
        raise InvalidInputError(f"{where}: expected a list of positions, got {_short(ring)}")
    for k, position in enumerate(ring):
        good = isinstance(position, list) and len(position) >= 2
        if not good or not all(isinstance(n, int | float) and not isinstance(n, bool) for n in position):
            raise InvalidInputError(f"{where}, vertex {k + 1}: expected [longitude, latitude], got {_short(position)}")
    try:
        return np.array([position[:2] for position in ring], dtype=np.float64).reshape(-1, 2)
    except OverflowError:
        raise InvalidInputError(f"{where}: expected coordinates, got an integer that is too large") from None


def _crs_name(data: Any, where: str) -> str | None:
    """Return the coordinate reference system that the old member "crs" names. RFC 7946 has removed "crs" from GeoJSON."""
    if not isinstance(data, dict) or data.get("crs") is None:
        return None
    crs = data["crs"]
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if not isinstance(name, str):
        raise InvalidInputError(f'{where}: expected a "crs" with the name of a coordinate reference system, got {_short(crs)}')
    if _SYSTEM.fullmatch(name) is None:
        raise InvalidInputError(f'{where}: expected a "crs" with a name such as EPSG:25832, got {_short(name)}')
    return name


def _short(value: Any) -> str:
    text = repr(value) if not isinstance(value, list | dict) else f"{'a list' if isinstance(value, list) else 'an object'}"
    if isinstance(value, list) and len(value) <= 4 and not any(isinstance(item, list | dict) for item in value):
        text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
