"""Regions in the formats of geographic information systems: GeoJSON, GeoPackage and Shapefile."""

from __future__ import annotations

import re
import sqlite3
import struct
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from shoal.core.checks import check_file, parse_json, read_text
from shoal.core.errors import InvalidInputError
from shoal.search.regions.formats.reading import (
    Reading,
    can_mark,
    is_no_go,
    layer_polygons,
    names_no_go,
    only_lines_text,
)
from shoal.search.regions.outline import (
    LARGEST_DATABASE,
    LARGEST_FILE,
    MOST_POLYGONS,
    Points,
    RegionOutline,
    RegionOutlines,
    Ring,
    check_count,
    open_zip,
)
from shoal.search.regions.projection import conversion, to_degrees

_OTHER = {"Point", "MultiPoint", "LineString", "MultiLineString"}
# EPSG:25832, urn:ogc:def:crs:OGC:1.3:CRS84: a name without definition
_SYSTEM = re.compile(r"[\w:/.() -]{1,200}", re.ASCII)
# maximum steps of SQLite's virtual machine; a table with the most allowed polygons needs 1 % of the
# steps
_STEPS = 50_000_000
_AT_ONCE = 10_000
_POINT, _LINE, _POLYGON = 1, 2, 3  # types of well-known binary
_DEEPEST = 10
_UNFINISHED = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN)
# length in bytes of the bounding box in the header, by the header's flags
_ENVELOPES = {0: 0, 1: 32, 2: 48, 3: 48, 4: 64}


_LAYERS = """
    SELECT c.table_name, g.column_name, s.organization, s.organization_coordsys_id, s.definition
    FROM gpkg_contents c JOIN gpkg_geometry_columns g ON g.table_name = c.table_name
    LEFT JOIN gpkg_spatial_ref_sys s ON s.srs_id = g.srs_id WHERE c.data_type = 'features' ORDER BY c.rowid LIMIT 1000
"""


_MAGIC = b"\x00\x00\x27\x0a"
_BESIDE = {".shx": "index", ".prj": "coordinate reference system"}


PARTS = (".shp", ".shx", ".prj", ".dbf", ".cpg")
"""Suffixes of the files of a Shapefile that Shoal unpacks from a zip archive."""


def read_geojson(path: Path, reading: Reading) -> RegionOutlines:
    """Return the polygons in a GeoJSON file."""
    data = parse_json(read_text(path, what="region file", most=LARGEST_FILE), where=str(path))
    outlines: list[RegionOutline] = []
    passed: set[str] = set()
    for where, shape, no_go in _geometries(data, str(path)):
        kind = shape.get("type")
        if kind == "Polygon":
            outlines.append(_polygon(_list(shape, "coordinates", where), where, no_go))
        elif kind == "MultiPolygon":
            for k, rings in enumerate(_list(shape, "coordinates", where), start=1):
                if not isinstance(rings, list):
                    raise InvalidInputError(
                        f"{where}, polygon {k}: expected a list of rings, got {_short(rings)}"
                    )
                outlines.append(_polygon(rings, f"{where}, polygon {k}", no_go))
        elif isinstance(kind, str) and kind in _OTHER:
            lines = (
                [_points(line, where) for line in _lines(shape, where)]
                if reading.closed_lines
                else []
            )
            closed = [
                RegionOutline(Ring(points, where), (), no_go)
                for points in lines
                if reading.is_polygon(points)
            ]
            outlines += closed
            passed |= set() if closed else {kind}
        else:
            actual = "no type" if kind is None else f"the type {_short(kind)}"
            raise InvalidInputError(
                f"{where}: expected a GeoJSON Polygon, MultiPolygon, Feature or FeatureCollection,"
                f" got {actual}"
            )
    if not outlines:
        actual = only_lines_text(passed, closed_lines=reading.closed_lines)
        raise InvalidInputError(f"{path}: expected a Polygon or MultiPolygon, got {actual}")
    name = crs_name(data, str(path))
    if name is None:
        return RegionOutlines(tuple(outlines), str(path), geographic=True)
    return to_degrees(tuple(outlines), str(path), name)


def read_positions(path: Path, *, what: str) -> tuple[Points, bool, bool]:
    """Return the points in a GeoJSON file, whether these points are the vertices of a line, and
    whether they are in degrees.

    Parameters
    ----------
    path : path
    what : str
        Name of the file in error messages.
    """
    data = parse_json(read_text(path, what=what, most=LARGEST_FILE), where=str(path))
    points: list[Points] = []
    lines: list[Points] = []
    for where, shape, _ in _geometries(data, str(path)):
        kind = shape.get("type")
        if kind == "Point":
            points.append(_points([shape.get("coordinates")], where))
        elif kind in ("MultiPoint", "LineString"):
            (points if kind == "MultiPoint" else lines).append(
                _points(shape.get("coordinates"), where)
            )
        else:
            raise InvalidInputError(
                f"{where}: expected a Point, MultiPoint or LineString, got {_short(kind)}"
            )
    if len(lines) > 1 or (lines and points) or not (lines or points):
        actual = f"{len(points)} sets of points and {len(lines)} lines"
        raise InvalidInputError(f"{path}: expected points or one line, got {actual}")
    if lines and len(lines[0]) < 2:
        raise InvalidInputError(
            f"{path}: expected a line of two vertices or more, got {len(lines[0])}"
        )
    found, name = np.concatenate(lines or points), crs_name(data, str(path))
    if name is None:
        return found, bool(lines), True
    geographic, convert = conversion(name, str(path))
    return convert(found), bool(lines), geographic


def _geometries(
    data: Any, where: str, no_go: bool = False
) -> Iterator[tuple[str, dict[str, Any], bool]]:
    """Yield each geometry of a GeoJSON object, with its place in the file, and whether it is marked
    as a no-go zone.
    """
    if not isinstance(data, dict):
        raise InvalidInputError(f"{where}: expected a GeoJSON object, got {_short(data)}")
    kind = data.get("type")
    if kind == "FeatureCollection":
        zones = no_go or names_no_go(data.get("name"))
        for k, feature in enumerate(_list(data, "features", where), start=1):
            yield from _geometries(feature, f"{where}: feature {k}", zones)
    elif kind == "Feature":
        if data.get("geometry") is not None:
            properties = data.get("properties")
            zone = is_no_go(properties if isinstance(properties, dict) else {}, data.get("id"))
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
        raise InvalidInputError(
            f"{where}: expected a list of {key}, got {_short(value) if key in data else 'none'}"
        )
    return value


def _polygon(rings: list[Any], where: str, no_go: bool) -> RegionOutline:
    if not rings:
        raise InvalidInputError(f"{where}: expected a polygon with a ring, got an empty one")
    checked_rings = [
        Ring(_points(ring, f"{where}, ring {k + 1}"), f"{where}, ring {k + 1}")
        for k, ring in enumerate(rings)
    ]
    return RegionOutline(checked_rings[0], tuple(checked_rings[1:]), no_go)


def _points(ring: Any, where: str) -> Points:
    if not isinstance(ring, list):
        raise InvalidInputError(f"{where}: expected a list of positions, got {_short(ring)}")
    for k, position in enumerate(ring):
        good = isinstance(position, list) and len(position) >= 2
        if not good or not all(
            isinstance(n, int | float) and not isinstance(n, bool) for n in position
        ):
            raise InvalidInputError(
                f"{where}, vertex {k + 1}: expected [longitude, latitude], got {_short(position)}"
            )
    try:
        return np.array([position[:2] for position in ring], dtype=np.float64).reshape(-1, 2)
    except OverflowError:
        raise InvalidInputError(
            f"{where}: expected coordinates, got an integer that is too large"
        ) from None


def crs_name(data: Any, where: str) -> str | None:
    """Return the coordinate reference system that the old member "crs" names. RFC 7946 has removed
    "crs" from GeoJSON.
    """
    if not isinstance(data, dict) or data.get("crs") is None:
        return None
    crs = data["crs"]
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if not isinstance(name, str):
        raise InvalidInputError(
            f'{where}: expected a "crs" with the name of a coordinate reference system, got'
            f" {_short(crs)}"
        )
    if _SYSTEM.fullmatch(name) is None:
        raise InvalidInputError(
            f'{where}: expected a "crs" with a name such as EPSG:25832, got {_short(name)}'
        )
    return name


def _short(value: Any) -> str:
    text = (
        repr(value)
        if not isinstance(value, list | dict)
        else f"{'a list' if isinstance(value, list) else 'an object'}"
    )
    if (
        isinstance(value, list)
        and len(value) <= 4
        and not any(isinstance(item, list | dict) for item in value)
    ):
        text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def read_geopackage(path: Path, reading: Reading, *, zones: bool = False) -> RegionOutlines:
    """Return the polygons in one layer of a GeoPackage, and the polygons in all layers whose names
    mark no-go zones.

    Parameters
    ----------
    path : path
    reading : Reading
        The name of a layer is required if several layers could contain the region.
    zones : bool
        Whether to read all layers, as for a file of no-go zones.
    """
    check_file(path, what="region file", most=LARGEST_DATABASE)
    with _open_database(path) as database:
        layers = {str(row[0]): row for row in database.execute(_LAYERS)}
        names = [*layers] if zones else _choose_layers(path, reading.layer, [*layers])
        read = [_outlines(database, path, layers, name, reading) for name in names]
    if len({source.geographic for source in read}) > 1:
        raise InvalidInputError(
            f"{path}: expected only layers with positions on Earth or only layers without, got"
            f" both: {', '.join(names)[:80]}"
        )
    return RegionOutlines(
        tuple(outline for source in read for outline in source.outlines),
        str(path),
        read[0].geographic,
    )


def _choose_layers(path: Path, layer: str | None, names: list[str]) -> list[str]:
    """Return the names of the layers to read: the requested layer, and all layers of
    no-go zones.
    """
    zones = [name for name in names if names_no_go(name)]
    searched = [name for name in names if name not in zones] or zones
    if layer is not None and layer not in names:
        raise InvalidInputError(
            f"{path}: expected one of the layers {', '.join(names)[:200]}, got {layer!r}"
        )
    if layer is None and len(searched) != 1:
        actual = (
            f"{len(searched)}: {', '.join(searched)[:200]}; choose with --layer NAME"
            if searched
            else "none"
        )
        raise InvalidInputError(f"{path}: expected one layer of shapes, got {actual}")
    first = searched[0] if layer is None else layer
    return [first, *(name for name in zones if name != first)]


def _outlines(
    database: sqlite3.Connection, path: Path, layers: dict[str, Any], name: str, reading: Reading
) -> RegionOutlines:
    """Return the polygons of one layer.

    If the name of a layer marks no-go zones, all its polygons are no-go zones, unless the user
    requested this layer as the region.
    """
    table, column, organization, code, definition = layers[name]
    _check_table(database, path, str(table))
    columns = [str(row[1]) for row in database.execute(f"PRAGMA table_info({_quote(table)})")]
    marks = [name for name in columns if can_mark(name) and name != column]
    selection = ", ".join(_quote(name) for name in (column, *marks))
    if str(column) not in columns:  # a generated column could compute gigabytes from nothing
        raise InvalidInputError(
            f"{path}, layer {table!r}: expected a stored column {str(column)[:60]!r} of shapes, got"
            " none"
        )
    rows, size = [], 0
    for row in database.execute(
        f"SELECT {selection} FROM {_quote(table)} LIMIT {MOST_POLYGONS + 1}"
    ):
        rows.append(row)
        size += sum(len(value) for value in row if isinstance(value, bytes | str))
        check_count(size, LARGEST_FILE, where=f"{path}, layer {table!r}", what="bytes of shapes")
    check_count(len(rows), MOST_POLYGONS, where=f"{path}, layer {table!r}", what="features")
    where = str(path) if len(layers) == 1 else f"{path}, layer {table!r}"
    shapes = [
        _shape(blob, f"{where}: feature {number}")
        for number, (blob, *_) in enumerate(rows, start=1)
    ]
    properties = [dict(zip(marks, values, strict=True)) for _, *values in rows]
    outlines = layer_polygons(
        zip(shapes, properties, strict=True),
        where,
        reading,
        no_go=names_no_go(table) and table != reading.layer,
    )
    who = str(organization or "none").upper()
    if who == "NONE":
        return RegionOutlines(outlines, str(path), geographic=False)
    return to_degrees(outlines, str(path), f"EPSG:{code}" if who == "EPSG" else str(definition))


def _check_table(database: sqlite3.Connection, path: Path, name: str) -> None:
    """Refuse SQLite views and virtual tables, because they can run code."""
    listed = database.execute(
        "SELECT type, sql FROM sqlite_master WHERE lower(name) = lower(?)", (name,)
    ).fetchone()
    kind = "nothing" if listed is None else str(listed[0])
    if kind == "table" and "VIRTUAL" in str(listed[1]).upper().split()[:2]:
        kind = "virtual table"
    if kind != "table":
        raise InvalidInputError(
            f"{path}: expected a GeoPackage, with the table {name[:60]!r}, got a {kind}"
        )


def _shape(blob: Any, where: str) -> Any:
    """Return the Shapely geometry in a binary value of a GeoPackage, or None for an empty value."""
    import shapely

    data = b"" if blob is None else bytes(blob) if isinstance(blob, bytes) else b"?"
    if not data:
        return None
    try:
        if data[:2] != b"GP" or len(data) < 8:
            raise ValueError
        body = data[8 + _ENVELOPES[data[3] >> 1 & 7] :]  # after the header
        _check_depth(body)
        return shapely.force_2d(shapely.from_wkb(body))
    except (shapely.errors.ShapelyError, KeyError, ValueError, struct.error):
        raise InvalidInputError(
            f"{where}: expected a geometry of straight lines, got a damaged one or another kind"
        ) from None


def _check_depth(data: bytes) -> None:
    """Raise ValueError for deeply nested geometries, which would overflow the stack of the library
    GEOS and end the process.
    """
    at, open_ones = 0, [1]
    while open_ones:
        if not open_ones[-1]:
            open_ones.pop()
            continue
        open_ones[-1] -= 1
        order = "<" if data[at : at + 1] == b"\x01" else ">"
        code, count = struct.unpack_from(f"{order}II", data, at + 1)
        kind, size = (
            (code & 0xFFFF) % 1000,
            8 * (2 + bool(code & 0x80000000) + bool(code & 0x40000000)),
        )
        size += 8 * {0: 0, 1: 1, 2: 1, 3: 2}.get((code & 0xFFFF) // 1000, 0)
        if kind == _POINT:
            at += 5 + size
        elif kind in (_LINE, _POLYGON):
            at += 9
            for _ in range(count if kind == _POLYGON else 0):
                at += 4 + size * int(struct.unpack_from(f"{order}I", data, at)[0])
            at += size * count if kind == _LINE else 0
        else:
            at += 9
            open_ones.append(count)
        if len(open_ones) > _DEEPEST:
            raise ValueError("nested too deeply")


def _quote(name: Any) -> str:
    return '"' + str(name).replace('"', '""') + '"'


@contextmanager
def _open_database(path: Path) -> Iterator[sqlite3.Connection]:
    """Open an SQLite file only for reading, with protection against hostile content.

    The function converts any SQLite error to an `InvalidInputError` of one sentence. If another
    program has stored changes in a second file beside the SQLite file, SQLite reads both files.
    """
    budget = _STEPS // _AT_ONCE
    changes = [
        name
        for end in ("-wal", "-journal")
        if (name := path.with_name(path.name + end)).is_file() and name.stat().st_size
    ]
    for name in changes:
        check_file(name, what="file with the changes of a GeoPackage", most=LARGEST_DATABASE)
    how = "mode=ro" if changes else "mode=ro&immutable=1"

    def step() -> bool:
        nonlocal budget
        budget -= 1
        return budget < 0

    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?{how}", uri=True)) as database:
            database.execute("PRAGMA trusted_schema = OFF")
            database.execute("PRAGMA cell_size_check = ON")
            database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST_FILE)
            database.set_progress_handler(step, _AT_ONCE)
            for table in ("gpkg_contents", "gpkg_geometry_columns", "gpkg_spatial_ref_sys"):
                _check_table(database, path, table)
            yield database
    except (sqlite3.Error, sqlite3.Warning, OverflowError, UnicodeError) as error:
        if getattr(error, "sqlite_errorcode", 0) == sqlite3.SQLITE_INTERRUPT and budget >= 0:
            raise KeyboardInterrupt from error
        why = (
            f"one that keeps SQLite busy for more than {_STEPS} steps"
            if budget < 0
            else f"a damaged one or another format: {error}"
        )
        if changes and getattr(error, "sqlite_errorcode", 0) & 0xFF in _UNFINISHED:
            why = (
                "one that another program is changing or has left unfinished, with changes in"
                f" {changes[0].name}"
            )
        raise InvalidInputError(f"{path}: expected a GeoPackage, got {why[:160]}") from None


def read_zipped_shapefile(path: Path, reading: Reading) -> RegionOutlines:
    """Return the polygons in the Shapefile of a zip archive, which must contain exactly one
    Shapefile.

    The function unpacks the files of the Shapefile under new names, so that no path in the archive
    can lead to another folder.
    """
    with open_zip(path, what="zip archive") as archive, tempfile.TemporaryDirectory() as place:
        inside = {member.filename: member for member in archive.infolist()}
        shapes = [
            name
            for name in inside
            if PurePosixPath(name).suffix.lower() == ".shp" and "__MACOSX" not in name
        ]
        if len(shapes) != 1:
            raise InvalidInputError(
                f"{path}: expected an archive with one Shapefile, got {len(shapes)}"
            )
        stem = str(PurePosixPath(shapes[0]).with_suffix(""))
        for name, info in inside.items():
            suffix = PurePosixPath(name).suffix.lower()
            if suffix in PARTS and str(PurePosixPath(name).with_suffix("")) == stem:
                with archive.open(info) as file:
                    Path(place, f"shapes{suffix}").write_bytes(file.read(LARGEST_FILE + 1))
        try:
            return read_shapefile(Path(place, "shapes.shp"), reading, f"{path}: {stem[:80]}.shp")
        except InvalidInputError as error:
            raise InvalidInputError(
                str(error).replace(f"{place}/shapes", f"{path}: {stem[:80]}")
            ) from None


def read_shapefile(path: Path, reading: Reading, where: str = "") -> RegionOutlines:
    """Return the polygons in a Shapefile. In error messages, the text ``where`` replaces the path
    of the Shapefile.
    """
    where = where or str(path)
    check_file(path, what="region file", most=LARGEST_FILE)
    with path.open("rb") as file:
        if file.read(4) != _MAGIC:  # so that GDAL tries none of its other formats
            raise InvalidInputError(
                f"{path}: expected a file of shapes, got a damaged one or another format"
            )
    for suffix in PARTS[1:]:
        existing = [
            beside
            for form in (suffix, suffix.upper())
            if (beside := path.with_suffix(form)).is_file()
        ]
        if not existing and suffix in _BESIDE:
            raise InvalidInputError(
                f"{path}: expected its {_BESIDE[suffix]} beside it in"
                f" {path.with_suffix(suffix).name}, got no such file"
            )
        for beside in existing:
            check_file(beside, what="part of a Shapefile", most=LARGEST_FILE)
    outlines, crs = _read(path, where, reading)
    if not crs:
        raise InvalidInputError(
            f"{path.with_suffix('.prj')}: expected a known coordinate reference system, got another"
            " text"
        )
    return to_degrees(outlines, where, crs)


def _read(path: Path, where: str, reading: Reading) -> tuple[tuple[RegionOutline, ...], str | None]:
    """Return the polygons in a Shapefile, and the name of its coordinate reference system."""
    import pyogrio
    import shapely

    source = path.resolve()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # GDAL's warnings are either errors later or harmless
            info = pyogrio.read_info(source)
            check_count(int(info["features"]), MOST_POLYGONS, where=str(path), what="features")
            marks = [str(name) for name in info["fields"] if can_mark(str(name))]
            meta, _, raw, columns = pyogrio.raw.read(source, columns=marks, force_2d=True)
            shapes = shapely.from_wkb(raw)
    except InvalidInputError:
        raise
    except Exception as error:  # for damaged files pyogrio raises many kinds of exceptions, including UnboundLocalError
        message = " ".join(str(error).split())[:160]
        raise InvalidInputError(
            f"{path}: expected a file of shapes, got a damaged one or another format: {message}"
        ) from None
    properties = (
        [dict(zip(meta["fields"], values, strict=True)) for values in zip(*columns, strict=True)]
        if marks
        else [{}] * len(shapes)
    )
    return layer_polygons(zip(shapes, properties, strict=True), where, reading), meta["crs"]
