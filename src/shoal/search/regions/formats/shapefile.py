"""Reader of regions in Shapefiles, as separate files or in a zip archive. The library pyogrio (GDAL) reads the files."""

from __future__ import annotations

import tempfile
import warnings
from pathlib import Path, PurePosixPath

from shoal.core.checks import check_file
from shoal.core.errors import InvalidInputError
from shoal.search.regions.formats.crs import to_degrees
from shoal.search.regions.formats.layers import layer_polygons
from shoal.search.regions.formats.marks import can_mark
from shoal.search.regions.formats.reading import Reading
from shoal.search.regions.limits import LARGEST_FILE, MOST_POLYGONS, check_count, opened_zip
from shoal.search.regions.outline_checks import RegionOutline, RegionOutlines

_MAGIC = b"\x00\x00\x27\x0a"
_BESIDE = {".shx": "index", ".prj": "coordinate reference system"}


PARTS = (".shp", ".shx", ".prj", ".dbf", ".cpg")
"""Suffixes of the files of a Shapefile that Shoal unpacks from a zip archive."""


def read_zipped_shapefile(path: Path, reading: Reading) -> RegionOutlines:
    """Return the polygons in the Shapefile of a zip archive, which must contain exactly one Shapefile.

    The function unpacks the files of the Shapefile under new names, so that no path in the archive can lead to another folder.

    Raises
    ------
    InvalidInputError
    """
    with opened_zip(path, what="zip archive") as archive, tempfile.TemporaryDirectory() as place:
        inside = {one.filename: one for one in archive.infolist()}
        shapes = [name for name in inside if PurePosixPath(name).suffix.lower() == ".shp" and "__MACOSX" not in name]
        if len(shapes) != 1:
            raise InvalidInputError(f"{path}: expected an archive with one Shapefile, got {len(shapes)}")
        stem = str(PurePosixPath(shapes[0]).with_suffix(""))
        for name, one in inside.items():
            suffix = PurePosixPath(name).suffix.lower()
            if suffix in PARTS and str(PurePosixPath(name).with_suffix("")) == stem:
                with archive.open(one) as file:
                    Path(place, f"shapes{suffix}").write_bytes(file.read(LARGEST_FILE + 1))
        try:
            return read_shapefile(Path(place, "shapes.shp"), reading, f"{path}: {stem[:80]}.shp")
        except InvalidInputError as error:
            raise InvalidInputError(str(error).replace(f"{place}/shapes", f"{path}: {stem[:80]}")) from None


def read_shapefile(path: Path, reading: Reading, where: str = "") -> RegionOutlines:
    """Return the polygons in a Shapefile. In error messages, the text ``where`` replaces the path of the Shapefile.

    Raises
    ------
    InvalidInputError
    """
    where = where or str(path)
    check_file(path, what="region file", most=LARGEST_FILE)
    with path.open("rb") as file:
        if file.read(4) != _MAGIC:  # so that GDAL tries none of its other formats
            raise InvalidInputError(f"{path}: expected a file of shapes, got a damaged one or another format")
    for suffix in (".shx", ".prj", ".dbf", ".cpg"):
        there = [beside for form in (suffix, suffix.upper()) if (beside := path.with_suffix(form)).is_file()]
        if not there and suffix in _BESIDE:
            raise InvalidInputError(
                f"{path}: expected its {_BESIDE[suffix]} beside it in {path.with_suffix(suffix).name}, got no such file"
            )
        for beside in there:
            check_file(beside, what="part of a Shapefile", most=LARGEST_FILE)
    found, crs = _read(path, where, reading)
    if not crs:
        raise InvalidInputError(f"{path.with_suffix('.prj')}: expected a known coordinate reference system, got another text")
    return to_degrees(found, where, crs)


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
        said = " ".join(str(error).split())[:160]
        raise InvalidInputError(f"{path}: expected a file of shapes, got a damaged one or another format: {said}") from None
    told = (
        [dict(zip(meta["fields"], values, strict=True)) for values in zip(*columns, strict=True)] if marks else [{}] * len(shapes)
    )
    return layer_polygons(zip(shapes, told, strict=True), where, reading), meta["crs"]
