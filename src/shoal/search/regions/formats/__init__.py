"""Read the polygons in a file; its suffix says the format.

- ``.geojson .json``: GeoJSON; longitude first, degrees, unless an old "crs" member names another system. A feature whose property
  ``no_go`` is true is a zone to keep out of.
- ``.kml``: the polygons of its placemarks. A placemark is a no-go zone if its extended data say ``no_go`` = 1 or true, or if its
  name begins with "no-go", "no_go" or "nogo".
- ``.gpkg .shp``: in the coordinate reference system that they name (for a Shapefile, beside it in ``.prj``). A feature whose
  field ``no_go`` is true is a no-go zone. A GeoPackage layer in no system on Earth is in metres.
- ``.csv``: metres, one vertex a line, ``x,y``; a heading and lines beginning with # may be there. A blank line, or another value
  in a third column, begins the next ring. Rings may be closed or not. A ring inside another is a hole of it, a ring inside a hole
  a part again.

Points and lines in a file are passed over if it holds a polygon. Parts that overlap are taken together.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from shoal.checks import check_file
from shoal.errors import InvalidInputError
from shoal.search.regions.formats.geojson import read_geojson
from shoal.search.regions.formats.kml import read_kml
from shoal.search.regions.formats.layers import read_layer
from shoal.search.regions.formats.table import read_table
from shoal.search.regions.outline_checks import RegionOutlines

_READERS: dict[str, Callable[[Path], RegionOutlines]] = {
    ".geojson": read_geojson,
    ".json": read_geojson,
    ".kml": read_kml,
    ".csv": read_table,
}
_LAYERED = (".gpkg", ".shp")


def read_outlines(path: str | os.PathLike[str], *, layer: str | None = None) -> RegionOutlines:
    """Return the polygons in a file.

    Parameters
    ----------
    path : path
    layer : str, optional
        Which layer of a GeoPackage.

    Raises
    ------
    InvalidInputError
        If the file is missing, damaged, of another format, or holds no polygon; the message says where.
    """
    source = Path(path)
    suffix = source.suffix.lower()
    if suffix not in _READERS and suffix not in _LAYERED and not source.is_dir():
        known = " ".join((*_READERS, *_LAYERED))
        raise InvalidInputError(f"{source}: expected a region file ({known}), got the suffix {source.suffix!r}")
    try:
        check_file(source, what="region file")
        if suffix in _LAYERED:
            return read_layer(source, layer=layer)
        if layer is not None:
            raise InvalidInputError(f"layer: expected it only with a GeoPackage, got {layer!r} with {source}")
        return _READERS[suffix](source)
    except OSError as error:
        raise InvalidInputError(f"{source}: cannot be read: {error.strerror or error}") from None
