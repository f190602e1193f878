"""Conversion of outlines from the coordinate reference system of a file to WGS84 longitude and latitude."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from shoal.core.errors import InvalidInputError
from shoal.search.regions.outline_checks import RegionOutline, RegionOutlines, Ring


def to_degrees(outlines: tuple[RegionOutline, ...], where: str, crs: str) -> RegionOutlines:
    """Convert outlines from a coordinate reference system to WGS84 longitude and latitude in degrees.

    In the given outlines, the east coordinate comes before the north coordinate, as in GeoJSON, GeoPackage and Shapefile.

    Parameters
    ----------
    outlines : tuple of RegionOutline
    where : str
        Name of the file in error messages.
    crs : str
        The coordinate reference system: a name, an EPSG code or WKT. If the system has no position on Earth, the function returns
        the outlines unchanged, in metres.

    Raises
    ------
    InvalidInputError
        If the coordinate reference system is unknown, or if a coordinate is out of the system's range.
    """
    from pyproj import CRS, Transformer
    from pyproj.exceptions import ProjError

    try:
        system = CRS.from_user_input(crs)
    except ProjError:
        name = " ".join(crs.split())
        raise InvalidInputError(f"{where}: expected a known coordinate reference system, got {name[:80]!r}") from None
    if system.type_name == "Engineering CRS" or system.name.startswith("Undefined"):
        return RegionOutlines(outlines, where, geographic=False)
    if system.equals(CRS.from_epsg(4326), ignore_axis_order=True):
        return RegionOutlines(outlines, where, geographic=True)
    try:
        transformer = Transformer.from_crs(system, CRS.from_epsg(4326), always_xy=True)
    except ProjError:
        raise InvalidInputError(
            f"{where}: expected a coordinate reference system that can be converted to WGS84, got {system.name!r}"
        ) from None
    moved = tuple(
        replace(outline, shell=_moved(outline.shell, transformer), holes=tuple(_moved(hole, transformer) for hole in outline.holes))
        for outline in outlines
    )
    return RegionOutlines(moved, where, geographic=True)


def _moved(ring: Ring, transformer: Any) -> Ring:
    finite = np.isfinite(ring.points).all(axis=1)
    points = ring.points.copy()
    points[finite] = np.stack(transformer.transform(*ring.points[finite].T), axis=1)
    ring.check_vertices(~finite | np.isfinite(points).all(axis=1), "coordinates inside the file's coordinate reference system")
    return replace(ring, points=points)
