"""Margins: the distance that robots keep from borders and no-go zones, and the area that robots can
see with a margin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from shoal.core.errors import InvalidInputError
from shoal.core.notices import tell_once
from shoal.search.regions.coverage import footprints_along
from shoal.search.regions.region import SearchRegion, polygons_in

_SEGMENTS = 32  # segments of a quarter circle: arcs are within 0.03 % of the margin
# maximum distance of a bend from a corner, divided by the margin; the bend replaces an arc around
# the corner
_POINTED = 2.0
# smallest step of `grow_coarsely`, relative to the side of a square with the area of the shape
_COARSE = 0.02
# of the wanted margin, tried in this order
_SHARES = 1.0, 0.75, 0.5, 0.35, 0.25, 0.15, 0.1, 0.05, 0.02, 0.01
# share of a region that a default margin may leave unseen: half of what the mission check tolerates
_MOST_UNSEEN = 5e-4
_MOST_LOST = 0.01  # the same for the margin that keeps vehicles out of no-go zones
_EARTH = 6_371_000.0  # metres: radius of the Earth
_SEEN = 1e-9  # an unseen area is a rounding error up to this fraction of the region's area
# GEOS simplifies the dents of a border by up to a hundredth of the distance before it grows a shape
_NARROWER = 0.98


def with_margin(
    region: SearchRegion, margin: float, *, barriers: Sequence[Any] = (), pointed: bool = False
) -> SearchRegion:
    """Return a region in which robots keep a margin: a distance from the border of the region and
    from its no-go zones.

    Parameters
    ----------
    region : SearchRegion
    margin : float
        Margin in metres, 0 or more.
    barriers : sequence of Shapely polygons
        Exclusion polygons of a fence, from which robots keep the margin too.
    pointed : bool
        Whether the area where robots may be has few corners in place of arcs. A fixed wing cannot
        follow the short sides of an arc one by one.

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
    if margin == 0 and not barriers:
        return region
    import shapely

    inner = (
        region.outline.difference(shapely.union_all(list(barriers))) if barriers else region.outline
    )
    shape: dict[str, Any] = (
        {"join_style": "mitre", "mitre_limit": _POINTED} if pointed else {"quad_segs": _SEGMENTS}
    )
    free = polygons_in(inner.buffer(-margin, **shape)) if margin else polygons_in(inner)
    if free.is_empty:
        raise InvalidInputError(
            f"margin: expected a margin that leaves some area of the region {region.name!r}, got"
            f" {margin:g} m"
        )
    bends = None
    if margin and not pointed:
        bends = polygons_in(inner.buffer(-margin, join_style="mitre", mitre_limit=_POINTED))
    return replace(
        region, free=free, margin=margin, bends=bends, barriers=tuple(barriers), pointed=pointed
    )


def sag_of(region: SearchRegion) -> float:
    """Return the largest distance in metres of a side that is straight in degrees from a side that
    is straight in metres.

    Autopilots take the sides of a fence as straight lines in longitude and latitude. Along a
    parallel, such a side leaves the straight line of a plane by L² tan(latitude) / 8R in its
    middle.
    """
    if region.frame is None:
        return 0.0
    left, _, right, _ = region.outline.bounds
    return float(
        (right - left) ** 2 * abs(np.tan(np.radians(region.frame.latitude))) / (8 * _EARTH)
    )


def without_margin(region: SearchRegion) -> SearchRegion:
    """Return a region in which robots may be everywhere in the outline."""
    return replace(
        region,
        area=region.outline,
        free=region.outline,
        margin=0.0,
        bends=None,
        barriers=(),
        pointed=False,
    )


def with_default_margin(
    region: SearchRegion,
    default: float,
    *,
    footprint: float,
    least: float = 0.0,
    inner: Any = None,
    outer: Any = None,
    divided: bool = False,
    pointed: bool = False,
) -> SearchRegion:
    """Return a region with the margin ``default``, or with the largest smaller margin that takes
    nothing from the search.

    A smaller margin is chosen if the margin ``default`` would divide the region, leave more than
    0.05 % of it unseen, or bar a start, launch or landing point. Shoal prints a notice that names
    the chosen margin and the reason.

    Parameters
    ----------
    region : SearchRegion
    default : float
        Margin in metres.
    footprint : float
        Side in metres of the smallest square that a robot sees.
    least : float
        Margin in metres with which vehicles stay out of no-go zones in spite of their errors. In a
        region with such zones, no smaller margin is chosen only to see more of the region, unless
        more than 1 % would be lost.
    inner : ndarray of float64, shape (k, 2), optional
        Points at which robots must be inside the margin.
    outer : ndarray of float64, shape (k, 2), optional
        Points that need the margin only from no-go zones.
    divided : bool
        Whether the margin may divide the region, because robots fly from part to part.
    pointed : bool
        As in `with_margin`.

    Examples
    --------
    >>> from shoal.search import open_region
    >>> with_default_margin(open_region("rectangle:100x50"), 3.0, footprint=20.0).margin
    3.0
    >>> with_default_margin(open_region("rectangle:100x4"), 3.0, footprint=20.0).margin
    1.5
    """
    import shapely

    if default <= 0:
        return region
    outline, reason = region.outline, ""
    near = [np.inf]
    if inner is not None and len(inner):
        near.append(float(shapely.distance(outline.boundary, shapely.points(inner)).min()))
    if outer is not None and len(outer) and not region.no_go.is_empty:
        near.append(float(shapely.distance(region.no_go, shapely.points(outer)).min()))
    shape: dict[str, Any] = (
        {"join_style": "mitre", "mitre_limit": _POINTED} if pointed else {"quad_segs": 4}
    )
    candidates = [(round(share * default, 3), _MOST_UNSEEN) for share in _SHARES]
    if not region.no_go.is_empty and 0 < least < default:
        smaller = [k for k, (margin, _) in enumerate(candidates) if margin < least]
        candidates.insert(smaller[0] if smaller else len(candidates), (round(least, 3), _MOST_LOST))
    for margin, unseen in candidates:
        if margin <= 0 or margin > min(near):
            reason = (
                reason or "a start, launch or landing point is nearer to a border or a no-go zone"
            )
            continue
        free = polygons_in(outline.buffer(-margin, **shape))
        if free.is_empty or (_divides(outline, free) and not divided):
            reason = reason or "the wider margin would divide the region"
        elif outline.difference(free.buffer(footprint / 2)).area > unseen * outline.area:
            reason = reason or "parts of the region could not be seen with the wider margin"
        else:
            break
    else:
        margin = 0.0
    if margin < default:
        tell_once(
            f"margin: {margin:g} m in place of the default {default:g} m, because {reason};"
            " --margin sets another one"
        )
    return with_margin(region, margin, pointed=pointed)


def _divides(outline: Any, free: Any) -> bool:
    """Return whether any part of a region consists of several parts of the area where robots may
    be. A part without such an area is not divided: whether it may stay unseen is asked elsewhere.
    """
    import shapely

    places = shapely.point_on_surface(shapely.get_parts(free))
    _, of = shapely.STRtree(shapely.get_parts(outline)).query(places, predicate="within")
    return bool((np.bincount(of, minlength=1) > 1).any())


def grow(shape: Any, margin: float, *, pointed: bool = False) -> Any:
    """Return all points that are at most ``margin`` metres away from a Shapely geometry.

    If ``pointed`` is true, the result has few corners in place of arcs, and contains some more
    points.
    """
    if not margin:
        return shape
    return (
        shape.buffer(margin, join_style="mitre", mitre_limit=_POINTED)
        if pointed
        else shape.buffer(margin, quad_segs=_SEGMENTS)
    )


def grow_coarsely(shape: Any, margin: float) -> Any:
    """Return a shape with few corners that contains the shape ``grow(shape, margin)`` and is only
    slightly larger.
    """
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
    if not region.restricted:
        return region
    area = (
        region.outline if _is_near(region, footprint) else _visible_area(region, footprint, angle)
    )
    visible = replace(region, area=area)
    vars(visible)["for_paths"] = region.for_paths
    return visible


def _is_near(region: SearchRegion, footprint: float) -> bool:
    """Return whether all of a region is so near to where robots may be that they see it at any
    angle of the footprint: they see at least the disc inside the footprint.
    """
    cache = region.for_paths  # grids at many angles ask
    if ("near", footprint) not in cache:
        inner = region.free if region.bends is None else region.bends  # inside, of fewer corners
        near = inner.buffer(_NARROWER * footprint / 2, quad_segs=4)
        far = region.outline.difference(near).area
        cache["near", footprint] = bool(far <= _SEEN * region.outline.area)
    is_near: bool = cache["near", footprint]
    return is_near


def _visible_area(region: SearchRegion, footprint: float, angle: float) -> Any:
    """Return the part of a region that robots see with a footprint at an angle."""
    import shapely

    edges = [
        shapely.get_coordinates(ring) for ring in shapely.get_rings(shapely.get_parts(region.free))
    ]
    around: list[Any] = [
        shape
        for ring in edges
        for shape in footprints_along(ring[:-1], ring[1:], footprint / 2, angle)
    ]
    seen_part = shapely.union_all([region.free, *around])
    whole = region.outline.difference(seen_part).area <= _SEEN * region.outline.area
    return region.outline if whole else polygons_in(region.outline.intersection(seen_part))
