"""Margins: the distance that robots keep from borders and no-go zones, and the area that robots can see with a margin."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from shoal.core.errors import InvalidInputError
from shoal.search.regions.coverage import footprints_along
from shoal.search.regions.region import SearchRegion, polygons_in

_SEGMENTS = 32  # segments of a quarter circle: arcs are within 0.03 % of the margin
_POINTED = 2.0  # maximum distance of a bend from a corner, divided by the margin; the bend replaces an arc around the corner
_COARSE = 0.02  # smallest step of `coarse`, relative to the side of a square with the area of the shape
_SEEN = 1e-9  # an unseen area is a rounding error up to this fraction of the region's area


def with_margin(region: SearchRegion, margin: float) -> SearchRegion:
    """Return a region in which robots keep a margin: a distance from the border of the region and from its no-go zones.

    Parameters
    ----------
    region : SearchRegion
    margin : float
        Margin in metres, 0 or more.

    Raises
    ------
    InvalidInputError
        If the margin leaves no area where robots may be.

    Examples
    --------
    >>> from shoal.search import open_region
    >>> with_margin(open_region("rectangle:100x50"), 10).free.area
    2400.0
    """
    if margin == 0:
        return region
    free = polygons_in(region.outline.buffer(-margin, quad_segs=_SEGMENTS))
    if free.is_empty:
        raise InvalidInputError(f"margin: expected a margin that leaves some area of the region {region.name!r}, got {margin:g} m")
    bends = polygons_in(region.outline.buffer(-margin, join_style="mitre", mitre_limit=_POINTED))
    return replace(region, free=free, margin=margin, bends=bends)


def grown(shape: Any, margin: float) -> Any:
    """Return all points that are at most ``margin`` metres away from a Shapely geometry."""
    return shape.buffer(margin, quad_segs=_SEGMENTS) if margin else shape


def coarse(shape: Any, margin: float) -> Any:
    """Return a shape with few corners that contains the shape ``grown(shape, margin)`` and is only slightly larger."""
    step = max(margin / 4, _COARSE * shape.area**0.5)
    return shape.buffer(margin + step, join_style="mitre", mitre_limit=_POINTED).simplify(step)


def visible_region(region: SearchRegion, footprint: float, angle: float = 0.0) -> SearchRegion:
    """Return a region without the area that robots cannot see while they keep the margin.

    Parameters
    ----------
    region : SearchRegion
    footprint : float
        Side in metres of the square that a robot sees around itself.
    angle : float
        Angle of the square's sides in degrees, counter-clockwise from the x axis.

    Examples
    --------
    >>> from shoal.search import open_region
    >>> kept = with_margin(open_region("rectangle:100x50"), 10)
    >>> visible_region(kept, 20.0).area_m2, visible_region(kept, 10.0).area_m2
    (5000.0, 3600.0)
    """
    if region.margin == 0:
        return region
    import shapely

    edges = [shapely.get_coordinates(ring) for ring in shapely.get_rings(shapely.get_parts(region.free))]
    around: list[Any] = [shape for ring in edges for shape in footprints_along(ring[:-1], ring[1:], footprint / 2, angle)]
    seen = shapely.union_all([region.free, *around])
    if region.outline.difference(seen).area <= _SEEN * region.outline.area:
        return replace(region, area=region.outline)
    return replace(region, area=polygons_in(region.outline.intersection(seen)))
