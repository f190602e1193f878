"""Conversion between geographic coordinates (longitude and latitude) and a plane local frame in
metres.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from shoal.core.checks import check_number
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.regions.outline import (
    Points,
    RegionOutline,
    RegionOutlines,
    Ring,
    check_plane_points,
    text_of,
)

REACH = 100_000.0  # metres from the origin; at this distance, the scale error is 1.2e-4
DECIMALS = 8  # decimals of degrees in mission files: 1.1 mm
# metres: a path and a polygon of a mission file, both rounded, are less than this nearer to each
# other than planned
ROUNDED = 0.01


@dataclass(frozen=True)
class LocalFrame:
    """A local frame in metres east and north of an origin: a transverse Mercator projection of
    WGS84 with scale 1 at the origin.

    The projection preserves angles, but lengths in the frame are slightly longer than lengths on
    Earth. At the distance x to the east or west of the origin, lengths in the frame exceed lengths
    on Earth by the fraction (x / R)² / 2, where R is the radius of the Earth. According to PROJ,
    lengths within 20 km of the origin are at most 4.9e-6 (5 mm per kilometre) too long, at
    latitudes from 0 to 80 degrees. Lengths in the frame exceed lengths on Earth by at most 3.1e-5
    within 50 km of the origin, and by at most 1.2e-4 within 100 km.

    Parameters
    ----------
    longitude, latitude : float
        Longitude and latitude of the origin in degrees (WGS84).

    Examples
    --------
    >>> frame = LocalFrame(8.5, 47.4)
    >>> frame.to_metres([(8.5, 47.4), (8.51, 47.4)]).round(2).tolist()
    [[0.0, 0.0], [754.87, 0.05]]
    >>> frame.to_degrees([(754.87, 0.05)]).round(6).tolist()
    [[8.51, 47.4]]
    """

    longitude: float
    latitude: float

    def __post_init__(self) -> None:
        for name, most in (("longitude", 180.0), ("latitude", 89.9)):
            value = check_number(
                getattr(self, name), what=f"local frame: {name}", least=-most, most=most
            )
            object.__setattr__(self, name, value)

    @classmethod
    def around(cls, lonlat: ArrayLike) -> LocalFrame:
        """Return a local frame whose origin is the middle of the bounding box of points (longitude,
        latitude) in degrees.
        """
        array = check_plane_points(lonlat, what="local frame")
        middle = (array.min(axis=0) + array.max(axis=0)) / 2
        return cls(round(float(middle[0]), 6), round(float(middle[1]), 6))

    @property
    def proj(self) -> str:
        """Description of the projection in PROJ's notation."""
        return (
            f"+proj=tmerc +lat_0={self.latitude!r} +lon_0={self.longitude!r} +k=1 +x_0=0 +y_0=0"
            " +ellps=WGS84 +units=m"
        )

    def to_metres(self, lonlat: ArrayLike) -> Points:
        """Convert points from (longitude, latitude) in degrees to (east, north) in metres; float64,
        shape (n, 2).

        Raises
        ------
        InvalidInputError
            If a point is farther from the origin than twice `REACH`.
        """
        array = check_plane_points(lonlat, what="longitudes and latitudes")
        # Points that are far away in degrees are refused before PROJ, whose series is valid only
        # near the origin.
        east = np.abs((array[:, 0] - self.longitude + 180) % 360 - 180) * np.cos(
            np.radians(array[:, 1])
        )
        near = np.maximum(east, np.abs(array[:, 1] - self.latitude)) * 110_000.0 <= 3 * REACH
        points = np.full(array.shape, np.inf)
        points[near] = np.stack(
            _transformer(self.proj).transform(array[near, 0], array[near, 1]), axis=1
        )
        self._check_near(points, array, "")
        return points

    def to_degrees(self, points: ArrayLike) -> Points:
        """Convert points from (east, north) in metres to (longitude, latitude) in degrees; float64,
        shape (n, 2).

        Raises
        ------
        InvalidInputError
            If a point is farther from the origin than twice `REACH`.
        """
        array = check_plane_points(points, what="points")
        self._check_near(array, array, " m")
        return np.stack(
            _transformer(self.proj).transform(array[:, 0], array[:, 1], direction="INVERSE"), axis=1
        )

    def scale_error(self, lonlat: ArrayLike) -> float:
        """Return the largest relative error of a length in the frame at points (longitude,
        latitude), as PROJ measures it.

        Examples
        --------
        >>> f"{LocalFrame(6.0, 47.4).scale_error([(5.99, 47.4), (6.01, 47.4)]):.1e}"
        '7.0e-09'
        """
        from pyproj import Proj

        array = check_plane_points(lonlat, what="longitudes and latitudes")
        scales = np.asarray(Proj(self.proj).get_factors(array[:, 0], array[:, 1]).meridional_scale)
        return float(np.abs(scales - 1).max(initial=0.0))

    def written(self, points: ArrayLike) -> Points:
        """Return points in metres as a mission file contains them: with longitudes and latitudes
        rounded to `DECIMALS` decimals.

        Raises
        ------
        InvalidInputError
            If a point is farther from the origin than twice `REACH`.
        """
        return self.to_metres(np.round(self.to_degrees(points), DECIMALS))

    def _check_near(self, points: Points, original: Points, unit: str) -> None:
        """Refuse points in metres that are too far from the origin. The error message shows the
        user's original point.
        """
        near = np.hypot(*points.T) <= 2 * REACH
        if not near.all():
            raise InvalidInputError(
                f"local frame: expected points within {2 * REACH / 1000:g} km of the origin"
                f" {text_of([self.longitude, self.latitude])}, got"
                f" {text_of(original[int(np.argmin(near))])}{unit}"
            )


@lru_cache(maxsize=64)
def _transformer(proj: str) -> Any:
    from pyproj import Transformer

    return Transformer.from_pipeline(proj)


def to_degrees(outlines: tuple[RegionOutline, ...], where: str, crs: str) -> RegionOutlines:
    """Convert outlines from a coordinate reference system to WGS84 longitude and latitude in
    degrees.

    In the given outlines, the east coordinate comes before the north coordinate, as in GeoJSON,
    GeoPackage and Shapefile.

    Parameters
    ----------
    outlines : tuple of RegionOutline
    where : str
        Name of the file in error messages.
    crs : str
        The coordinate reference system: a name, an EPSG code or WKT. If the system has no position
        on Earth, the function returns the outlines unchanged, in metres.

    Raises
    ------
    InvalidInputError
        If the coordinate reference system is unknown, or if a coordinate is out of the system's
        range.
    """
    geographic, transformer = _to_wgs84(crs, where)
    moved = (
        outlines
        if transformer is None
        else tuple(
            replace(
                outline,
                shell=_transform_ring(outline.shell, transformer),
                holes=tuple(_transform_ring(hole, transformer) for hole in outline.holes),
            )
            for outline in outlines
        )
    )
    return RegionOutlines(moved, where, geographic=geographic)


def conversion(crs: str, where: str) -> tuple[bool, Callable[[Points], Points]]:
    """Return whether a coordinate reference system has a position on Earth, and the function that
    converts points from it to WGS84 longitude and latitude in degrees, as in `to_degrees`. Points
    of a system without a position stay in metres.
    """
    geographic, transformer = _to_wgs84(crs, where)

    def convert(points: Points) -> Points:
        return points if transformer is None else np.stack(transformer.transform(*points.T), axis=1)

    return geographic, convert


def _to_wgs84(crs: str, where: str) -> tuple[bool, Any]:
    """Return whether a system has a position on Earth, and its transformer to WGS84, or None if its
    coordinates stay as they are.
    """
    from pyproj import CRS, Transformer
    from pyproj.exceptions import ProjError

    try:
        system = CRS.from_user_input(crs)
    except ProjError:
        name = " ".join(crs.split())
        raise InvalidInputError(
            f"{where}: expected a known coordinate reference system, got {name[:80]!r}"
        ) from None
    if system.type_name == "Engineering CRS" or system.name.startswith("Undefined"):
        return False, None
    if system.equals(CRS.from_epsg(4326), ignore_axis_order=True):
        return True, None
    try:
        return True, Transformer.from_crs(system, CRS.from_epsg(4326), always_xy=True)
    except ProjError:
        raise InvalidInputError(
            f"{where}: expected a coordinate reference system that can be converted to WGS84, got"
            f" {system.name!r}"
        ) from None


def _transform_ring(ring: Ring, transformer: Any) -> Ring:
    finite = np.isfinite(ring.points).all(axis=1)
    points = ring.points.copy()
    points[finite] = np.stack(transformer.transform(*ring.points[finite].T), axis=1)
    ring.check_vertices(
        ~finite | np.isfinite(points).all(axis=1),
        "coordinates inside the file's coordinate reference system",
    )
    return replace(ring, points=points)
