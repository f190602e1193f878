"""Conversion of a layer's features to outlines. A feature is a geometry with properties that may mark a no-go zone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from shoal.core.errors import InvalidInputError
from shoal.search.regions.formats.marks import is_no_go
from shoal.search.regions.formats.reading import Reading, only_lines_text
from shoal.search.regions.outline_checks import RegionOutline, polygon_outlines


def layer_polygons(
    shapes: Iterable[tuple[Any, Mapping[str, Any]]], where: str, reading: Reading, *, no_go: bool = False
) -> tuple[RegionOutline, ...]:
    """Return the polygons in the features of a layer.

    Parameters
    ----------
    shapes : iterable of (geometry, mapping)
        The features as pairs: a Shapely geometry or None, and a mapping of properties by name.
    where : str
        Name of the file or of the layer in error messages.
    reading : Reading
    no_go : bool
        Whether all polygons are no-go zones, regardless of their properties.

    Raises
    ------
    InvalidInputError
        If no feature has a polygon.
    """
    found: list[RegionOutline] = []
    kinds: set[str] = set()
    for number, (shape, told) in enumerate(shapes, start=1):
        if shape is not None and not shape.is_empty:
            kinds.add(shape.geom_type)
            lines = reading.closed_lines and "LineString" in shape.geom_type
            areas = _closed(shape, reading) if lines else shape
            found += polygon_outlines(areas, f"{where}: feature {number}", no_go=no_go or is_no_go(told))
    if not found:
        got = only_lines_text(kinds, closed_lines=reading.closed_lines)
        raise InvalidInputError(f"{where}: expected a Polygon or MultiPolygon, got {got}")
    return tuple(found)


def _closed(shape: Any, reading: Reading) -> Any:
    """Return the closed lines of a Shapely geometry as polygons."""
    import shapely

    lines = [shapely.get_coordinates(line) for line in shapely.get_parts(shape)]
    return shapely.GeometryCollection([shapely.Polygon(points) for points in lines if reading.is_polygon(points)])
