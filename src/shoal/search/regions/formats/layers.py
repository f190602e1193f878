"""GeoPackage and Shapefile, through pyogrio (GDAL)."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from shoal.errors import InvalidInputError
from shoal.search.regions.formats.crs import to_degrees
from shoal.search.regions.outline_checks import RegionOutline, RegionOutlines, is_true, polygon_outlines


def read_layer(path: Path, *, layer: str | None) -> RegionOutlines:
    """Return the polygons in a layer.

    Raises
    ------
    InvalidInputError
    """
    if path.suffix.lower() == ".shp":
        for suffix, what in ((".shx", "index"), (".prj", "coordinate reference system")):
            if not any(path.with_suffix(form).is_file() for form in (suffix, suffix.upper())):
                raise InvalidInputError(
                    f"{path}: expected its {what} beside it in {path.with_suffix(suffix).name}, got no such file"
                )
    meta, shapes, zones = _read(path, _layer(path, layer))
    found: list[RegionOutline] = []
    kinds: set[str] = set()
    for k, (shape, zone) in enumerate(zip(shapes, zones, strict=True)):
        if shape is None or shape.is_empty:
            continue
        kinds.add(shape.geom_type)
        found += polygon_outlines(shape, f"{path}: feature {k + 1}", no_go=is_true(zone))
    if not found:
        got = "only " + " and ".join(sorted(kinds)) if kinds else "none"
        raise InvalidInputError(f"{path}: expected a Polygon or MultiPolygon, got {got}")
    if not meta["crs"]:
        if path.suffix.lower() == ".shp":
            raise InvalidInputError(f"{path.with_suffix('.prj')}: expected a coordinate reference system, got none that is known")
        return RegionOutlines(tuple(found), str(path), geographic=False)
    return to_degrees(tuple(found), str(path), meta["crs"])


def _layer(path: Path, wanted: str | None) -> str:
    """Return the name of the layer to read."""
    import pyogrio

    with _in_one_sentence(path):
        names = [str(row[0]) for row in pyogrio.list_layers(path) if row[1] is not None]
    if wanted is not None and wanted not in names:
        raise InvalidInputError(f"{path}: expected one of the layers {', '.join(names)}, got {wanted!r}")
    if wanted is None and len(names) != 1:
        got = f"{len(names)}: {', '.join(names)}; choose by the option layer" if names else "none"
        raise InvalidInputError(f"{path}: expected one layer of shapes, got {got}")
    return wanted if wanted is not None else names[0]


def _read(path: Path, layer: str) -> tuple[dict[str, Any], Any, Any]:
    """Return what a layer says of itself, its shapes, and its field no_go (or as many None)."""
    import pyogrio
    import shapely

    with _in_one_sentence(path):
        fields = [str(name) for name in pyogrio.read_info(path, layer=layer)["fields"]]
        field = next((name for name in fields if name.lower() == "no_go"), None)
        meta, _, raw, columns = pyogrio.raw.read(path, layer=layer, columns=[field] if field else [], force_2d=True)
        shapes = shapely.from_wkb(raw)
    return meta, shapes, columns[0] if field else [None] * len(shapes)


@contextmanager
def _in_one_sentence(path: Path) -> Iterator[None]:
    """Turn what GDAL and GEOS raise into one sentence; what they warn of is either an error later or harmless."""
    import shapely

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except (ValueError, RuntimeError, shapely.errors.ShapelyError) as error:
        said = " ".join(str(error).split())[:160]
        raise InvalidInputError(f"{path}: expected a file of shapes, got a damaged one or another format: {said}") from None
