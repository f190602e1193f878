"""Readers of region files. The suffix of a file determines its format.

- ``.geojson .json``: GeoJSON in degrees with longitude first. An old GeoJSON file may name another
  coordinate system in "crs".
- ``.kml .kmz``: KML. From a KML file, the reader takes the polygons of all placemarks. From a KMZ
  archive, the reader takes the first KML file.
- ``.gpkg``: GeoPackage. Each layer of a GeoPackage names its coordinate system. In a layer without
  a coordinate system on Earth, coordinates are in metres.
- ``.shp .zip``: Shapefile. The ``.prj`` file of a Shapefile names the coordinate system. A zip
  archive must contain exactly one Shapefile.
- ``.csv``: a CSV file with one vertex in each line. A heading may name the columns (``x_m,y_m``, or
  ``longitude,latitude``). The reader ignores lines that begin with #. A new ring begins after a
  blank line, or when the value in a third column changes. A ring may repeat its first vertex at its
  end. A ring inside another ring is a hole, and a ring inside a hole is a part of the region.

- ``.plan``: a plan of QGroundControl. From a plan, the reader takes the survey polygons or the
  inclusions of the fence. The exclusions of the fence are no-go zones.
- ``.poly .fen .waypoints .txt``: a polygon or a fence of Mission Planner, with a latitude and a
  longitude in each line, or a fence as items of a mission. Exclusions of the fence are no-go zones.

The encoding of a KML file is the encoding that its first line declares. Other text files are in
UTF-8.

A polygon is a no-go zone if it has a property such as ``no_go``, ``noFly`` or ``exclusion`` that is
not false. The name or the kind of a polygon can mark the polygon as a no-go zone ("No-go: pond",
"NFZ 3"). The name of a folder, a collection or a layer can mark all polygons in it as no-go zones.
If a file contains a polygon, the reader ignores points and lines, unless the user wants closed
lines as polygons. The reader unites overlapping polygons. The module `shoal.search.regions.outline`
lists the maximum sizes of files.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from shoal.core.checks import check_file, is_wkt
from shoal.core.errors import InvalidInputError
from shoal.search.regions.formats.geodata import (
    read_geojson,
    read_geopackage,
    read_shapefile,
    read_zipped_shapefile,
)
from shoal.search.regions.formats.ground_stations import read_plan, read_polygon_file
from shoal.search.regions.formats.kml import read_kml, read_kmz
from shoal.search.regions.formats.reading import Reading
from shoal.search.regions.formats.tables import read_table
from shoal.search.regions.outline import (
    LARGEST_DATABASE,
    MOST_CORNERS,
    MOST_POLYGONS,
    RegionOutlines,
    check_count,
)

_READERS: dict[str, Callable[[Path, Reading], RegionOutlines]] = {
    ".geojson": read_geojson,
    ".json": read_geojson,
    ".kml": read_kml,
    ".kmz": read_kmz,
    ".csv": read_table,
    ".shp": read_shapefile,
    ".zip": read_zipped_shapefile,
    ".poly": read_polygon_file,
    ".fen": read_polygon_file,
    ".waypoints": read_polygon_file,
    ".txt": read_polygon_file,
}
# formats with layers, of which some are zones
_LAYERED = {".gpkg": read_geopackage, ".plan": read_plan}


def read_outlines(
    path: str | os.PathLike[str], reading: Reading | None = None, *, zones: bool = False
) -> RegionOutlines:
    """Return the polygons in a region file.

    Parameters
    ----------
    path : path
    reading : Reading, optional
        The layer of a GeoPackage or a plan, and other choices of the user.
    zones : bool
        Whether all polygons in the file are no-go zones. If true, the function reads all layers of
        a GeoPackage, and only the exclusions of a plan.

    Raises
    ------
    InvalidInputError
        If the file is missing, damaged, too large or of another format, or if it contains no
        polygon. The error message names the place of the mistake.
    """
    source, reading = Path(path), reading or Reading()
    suffix = source.suffix.lower()
    if suffix not in _READERS and suffix not in _LAYERED and not source.is_dir():
        suffixes = " ".join((*_READERS, *_LAYERED))
        actual = "well-known text" if is_wkt(str(source)) else f"the suffix {source.suffix!r}"
        raise InvalidInputError(f"{source}: expected a region file ({suffixes}), got {actual}")
    try:
        check_file(source, what="region file", most=LARGEST_DATABASE)
        if suffix in _LAYERED:
            outlines = _LAYERED[suffix](source, reading, zones=zones)
        elif (
            reading.layer is not None
            and not zones
            and (suffix, reading.layer) != (".shp", source.stem)
        ):
            raise InvalidInputError(
                f"--layer: expected a GeoPackage or a plan of QGroundControl, got {reading.layer!r}"
                f" with {source}"
            )
        else:
            outlines = _READERS[suffix](source, reading)
    except OSError as error:
        raise InvalidInputError(f"{source}: cannot be read: {error.strerror or error}") from None
    check_count(len(outlines.outlines), MOST_POLYGONS, where=str(source), what="polygons")
    corners = sum(len(ring.points) for outline in outlines.outlines for ring in outline.rings)
    check_count(corners, MOST_CORNERS, where=str(source), what="corners")
    return outlines
