"""Shapefile, through pyogrio (GDAL)."""

from __future__ import annotations

import warnings
from pathlib import Path

from shoal.checks import check_file
from shoal.errors import InvalidInputError
from shoal.search.regions.formats.crs import to_degrees
from shoal.search.regions.formats.layers import layer_polygons
from shoal.search.regions.formats.marks import can_mark
from shoal.search.regions.limits import LARGEST_FILE, MOST_POLYGONS, check_count
from shoal.search.regions.outline_checks import RegionOutline, RegionOutlines

_MAGIC = b"\x00\x00\x27\x0a"
_BESIDE = {".shx": "index", ".prj": "coordinate reference system"}


def read_shapefile(path: Path) -> RegionOutlines:
    """Return the polygons in a Shapefile.

    Raises
    ------
    InvalidInputError
    """
    check_file(path, what="region file", most=LARGEST_FILE)
    with path.open("rb") as file:
        if file.read(4) != _MAGIC:  # so that GDAL takes it for no other of its formats
            raise InvalidInputError(f"{path}: expected a file of shapes, got a damaged one or another format")
    for suffix in (".shx", ".prj", ".dbf", ".cpg"):
        there = [beside for form in (suffix, suffix.upper()) if (beside := path.with_suffix(form)).is_file()]
        if not there and suffix in _BESIDE:
            raise InvalidInputError(
                f"{path}: expected its {_BESIDE[suffix]} beside it in {path.with_suffix(suffix).name}, got no such file"
            )
        for beside in there:
            check_file(beside, what="part of a Shapefile", most=LARGEST_FILE)
    found, crs = _read(path)
    if not crs:
        raise InvalidInputError(f"{path.with_suffix('.prj')}: expected a coordinate reference system, got none that is known")
    return to_degrees(found, str(path), crs)


def _read(path: Path) -> tuple[tuple[RegionOutline, ...], str | None]:
    """Return the polygons and the coordinate reference system."""
    import pyogrio
    import shapely

    source = path.resolve()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what GDAL warns of is either an error later or harmless
            info = pyogrio.read_info(source)
            check_count(int(info["features"]), MOST_POLYGONS, where=str(path), what="features")
            marks = [str(name) for name in info["fields"] if can_mark(str(name))]
            meta, _, raw, columns = pyogrio.raw.read(source, columns=marks, force_2d=True)
            shapes = shapely.from_wkb(raw)
    except InvalidInputError:
        raise
    except Exception as error:  # of damaged files pyogrio raises many kinds, UnboundLocalError among them
        said = " ".join(str(error).split())[:160]
        raise InvalidInputError(f"{path}: expected a file of shapes, got a damaged one or another format: {said}") from None
    told = (
        [dict(zip(meta["fields"], values, strict=True)) for values in zip(*columns, strict=True)] if marks else [{}] * len(shapes)
    )
    return layer_polygons(zip(shapes, told, strict=True), str(path)), meta["crs"]
