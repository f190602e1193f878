"""Reader of regions in GeoPackage files (OGC 12-128), which are SQLite files. The reader never runs code in a GeoPackage."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from shoal.core.checks import check_file
from shoal.core.errors import InvalidInputError
from shoal.search.regions.formats.crs import to_degrees
from shoal.search.regions.formats.layers import layer_polygons
from shoal.search.regions.formats.marks import can_mark, names_no_go
from shoal.search.regions.formats.reading import Reading
from shoal.search.regions.limits import LARGEST_DATABASE, LARGEST_FILE, MOST_POLYGONS, check_count
from shoal.search.regions.outline_checks import RegionOutlines

_STEPS = 50_000_000  # maximum steps of SQLite's virtual machine; a table with the most allowed polygons needs 1 % of the steps
_AT_ONCE = 10_000
_POINT, _LINE, _POLYGON = 1, 2, 3  # types of well-known binary
_DEEPEST = 10
_UNFINISHED = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN)
_ENVELOPES = {0: 0, 1: 32, 2: 48, 3: 48, 4: 64}  # length in bytes of the bounding box in the header, by the header's flags
_LAYERS = """
    SELECT c.table_name, g.column_name, s.organization, s.organization_coordsys_id, s.definition
    FROM gpkg_contents c JOIN gpkg_geometry_columns g ON g.table_name = c.table_name
    LEFT JOIN gpkg_spatial_ref_sys s ON s.srs_id = g.srs_id WHERE c.data_type = 'features' ORDER BY c.rowid LIMIT 1000
"""


def read_geopackage(path: Path, reading: Reading, *, every: bool = False) -> RegionOutlines:
    """Return the polygons in one layer of a GeoPackage, and the polygons in all layers whose names mark no-go zones.

    Parameters
    ----------
    path : path
    reading : Reading
        The name of a layer is required if several layers could contain the region.
    every : bool
        Whether to read all layers, as for a file of no-go zones.

    Raises
    ------
    InvalidInputError
    """
    check_file(path, what="region file", most=LARGEST_DATABASE)
    with _opened(path) as database:
        known = {str(row[0]): row for row in database.execute(_LAYERS)}
        names = [*known] if every else _chosen(path, reading.layer, [*known])
        read = [_outlines(database, path, known, name, reading) for name in names]
    if len({one.geographic for one in read}) > 1:
        raise InvalidInputError(
            f"{path}: expected only layers with positions on Earth or only layers without, got both: {', '.join(names)[:80]}"
        )
    return RegionOutlines(tuple(outline for one in read for outline in one.outlines), str(path), read[0].geographic)


def _chosen(path: Path, layer: str | None, names: list[str]) -> list[str]:
    """Return the names of the layers to read: the requested layer, and all layers of no-go zones."""
    zones = [name for name in names if names_no_go(name)]
    searched = [name for name in names if name not in zones] or zones
    if layer is not None and layer not in names:
        raise InvalidInputError(f"{path}: expected one of the layers {', '.join(names)[:200]}, got {layer!r}")
    if layer is None and len(searched) != 1:
        got = f"{len(searched)}: {', '.join(searched)[:200]}; choose with --layer NAME" if searched else "none"
        raise InvalidInputError(f"{path}: expected one layer of shapes, got {got}")
    first = searched[0] if layer is None else layer
    return [first, *(name for name in zones if name != first)]


def _outlines(database: sqlite3.Connection, path: Path, known: dict[str, Any], name: str, reading: Reading) -> RegionOutlines:
    """Return the polygons of one layer.

    If the name of a layer marks no-go zones, all its polygons are no-go zones, unless the user requested this layer as the region.
    """
    table, column, organization, code, definition = known[name]
    _check_table(database, path, str(table))
    columns = [str(row[1]) for row in database.execute(f"PRAGMA table_info({_quoted(table)})")]
    marks = [name for name in columns if can_mark(name) and name != column]
    wanted = ", ".join(_quoted(name) for name in (column, *marks))
    if str(column) not in columns:  # a generated column could compute gigabytes from nothing
        raise InvalidInputError(f"{path}, layer {table!r}: expected a stored column {str(column)[:60]!r} of shapes, got none")
    rows, size = [], 0
    for row in database.execute(f"SELECT {wanted} FROM {_quoted(table)} LIMIT {MOST_POLYGONS + 1}"):
        rows.append(row)
        size += sum(len(value) for value in row if isinstance(value, bytes | str))
        check_count(size, LARGEST_FILE, where=f"{path}, layer {table!r}", what="bytes of shapes")
    check_count(len(rows), MOST_POLYGONS, where=f"{path}, layer {table!r}", what="features")
    where = str(path) if len(known) == 1 else f"{path}, layer {table!r}"
    shapes = [_shape(blob, f"{where}: feature {number}") for number, (blob, *_) in enumerate(rows, start=1)]
    told = [dict(zip(marks, values, strict=True)) for _, *values in rows]
    found = layer_polygons(zip(shapes, told, strict=True), where, reading, no_go=names_no_go(table) and table != reading.layer)
    who = str(organization or "none").upper()
    if who == "NONE":
        return RegionOutlines(found, str(path), geographic=False)
    return to_degrees(found, str(path), f"EPSG:{code}" if who == "EPSG" else str(definition))


def _check_table(database: sqlite3.Connection, path: Path, name: str) -> None:
    """Refuse SQLite views and virtual tables, because they can run code."""
    found = database.execute("SELECT type, sql FROM sqlite_master WHERE lower(name) = lower(?)", (name,)).fetchone()
    kind = "nothing" if found is None else str(found[0])
    if kind == "table" and "VIRTUAL" in str(found[1]).upper().split()[:2]:
        kind = "virtual table"
    if kind != "table":
        raise InvalidInputError(f"{path}: expected a GeoPackage, with the table {name[:60]!r}, got a {kind}")


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
        raise InvalidInputError(f"{where}: expected a geometry of straight lines, got a damaged one or another kind") from None


def _check_depth(data: bytes) -> None:
    """Raise ValueError for deeply nested geometries, which would overflow the stack of the library GEOS and end the process."""
    at, open_ones = 0, [1]
    while open_ones:
        if not open_ones[-1]:
            open_ones.pop()
            continue
        open_ones[-1] -= 1
        order = "<" if data[at : at + 1] == b"\x01" else ">"
        code, count = struct.unpack_from(f"{order}II", data, at + 1)
        kind, size = (code & 0xFFFF) % 1000, 8 * (2 + bool(code & 0x80000000) + bool(code & 0x40000000))
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


def _quoted(name: Any) -> str:
    return '"' + str(name).replace('"', '""') + '"'


@contextmanager
def _opened(path: Path) -> Iterator[sqlite3.Connection]:
    """Open an SQLite file only for reading, with protection against hostile content.

    The function converts any SQLite error to an `InvalidInputError` of one sentence. If another program has stored changes in a
    second file beside the SQLite file, SQLite reads both files.
    """
    left = _STEPS // _AT_ONCE
    changes = [name for end in ("-wal", "-journal") if (name := path.with_name(path.name + end)).is_file() and name.stat().st_size]
    for name in changes:
        check_file(name, what="changes of a GeoPackage", most=LARGEST_DATABASE)
    how = "mode=ro" if changes else "mode=ro&immutable=1"

    def step() -> bool:
        nonlocal left
        left -= 1
        return left < 0

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
        if getattr(error, "sqlite_errorcode", 0) == sqlite3.SQLITE_INTERRUPT and left >= 0:
            raise KeyboardInterrupt from error
        why = (
            f"one that keeps SQLite busy for more than {_STEPS} steps" if left < 0 else f"a damaged one or another format: {error}"
        )
        if changes and getattr(error, "sqlite_errorcode", 0) & 0xFF in _UNFINISHED:
            why = f"one that another program is changing or has left unfinished, with changes in {changes[0].name}"
        raise InvalidInputError(f"{path}: expected a GeoPackage, got {why[:160]}") from None
