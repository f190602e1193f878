"""Geofences for autopilots: an outline that vehicles must not leave, and zones that vehicles must not enter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.notices import tell_once
from shoal.search.missions.polygons import Clear, corners_of, enclosing_polygons
from shoal.search.regions.margin import with_margin, without_margin
from shoal.search.regions.outline_checks import Points
from shoal.search.regions.projection import DECIMALS, REACH, ROUNDED, LocalFrame
from shoal.search.regions.region import TOUCH, SearchRegion

ROOM = 15.0  # metres: distance of the fence from paths outside the region
CORNERS = {"ardupilot": 70, "px4": 64}
"""Maximum number of corners of a fence, over all its rings, that each autopilot stores.

ArduPilot's limit of 70 corners was tested on a Cube autopilot. The limit of 64 corners is PX4's maximum number of MAVLink items
in a fence.
"""

_LEAST_INCLUSION = 4  # corners that remain for the outline
_LEAST_KEPT = 0.9  # share of the free area that polygons with few corners may leave at least
_CIRCLE = 180  # corners of a ring in place of a circle: within 0.2 mm of a circle of 1 m, and within 16 mm of one of 100 m
_ANYWHERE = 4 * REACH  # metres: beyond all that a local frame can hold
_BEYOND = 100.0  # metres beyond the region and the launch points: there no zone matters


@dataclass(frozen=True, eq=False)
class Fence:
    """A geofence in the unit of a mission: degrees with longitude first, or metres.

    Parameters
    ----------
    inclusion : ndarray of float64, shape (k, 2)
        Ring that vehicles must not leave. The first corner of the ring is not repeated at the end. A ring without corners is no
        limit: such a fence has only exclusion rings.
    exclusions : tuple of ndarray of float64, each of shape (k, 2)
        Rings that vehicles must not enter.
    more : tuple of ndarray of float64, each of shape (k, 2)
        More inclusion rings, in files of other programs. Autopilots interpret several inclusion rings differently: ArduPilot needs
        vehicles inside all of them, PX4 inside any. Shoal takes what all of them have in common, or their union if that is nothing.
    """

    inclusion: Points
    exclusions: tuple[Points, ...] = ()
    more: tuple[Points, ...] = ()

    @property
    def outlines(self) -> tuple[Points, ...]:
        """The inclusion rings of the fence."""
        return tuple(ring for ring in (self.inclusion, *self.more) if len(ring))

    @property
    def rings(self) -> tuple[Points, ...]:
        """All rings of the fence: the inclusion rings, followed by the exclusion rings."""
        return (*self.outlines, *self.exclusions)

    def area(self, frame: LocalFrame | None) -> Any:
        """Return the area in which the fence allows vehicles, as a Shapely geometry in metres of a local frame."""
        import shapely

        placed = [ring if frame is None else frame.to_metres(ring) for ring in self.rings]
        shapes = [shapely.make_valid(shapely.Polygon(ring)) for ring in placed]
        outlines, zones = shapes[: len(self.outlines)], shapes[len(self.outlines) :]
        inside = shapely.intersection_all(outlines) if outlines else shapely.box(-_ANYWHERE, -_ANYWHERE, _ANYWHERE, _ANYWHERE)
        inside = shapely.union_all(outlines) if inside.is_empty else inside
        return inside.difference(shapely.union_all(zones))

    def clearances(self, ways: Sequence[Points], frame: LocalFrame | None) -> NDArray[np.float64]:
        """Return the distance in metres of each path from the nearest border of the fence; float64, shape (k,).

        The distance of a path that leaves the fence or enters an exclusion zone is negative: the length of the path in there, but
        at least the distance by which it is in there.

        Parameters
        ----------
        ways : sequence of ndarray of float64, each of shape (n, 2)
            Paths in metres of the local frame; a path of one point is a point.
        frame : LocalFrame or None
        """
        import shapely

        area = self.area(frame)
        border = area.boundary
        allowed = area.buffer(ROUNDED / 2)  # a path along a side is rounded apart from the side
        shapely.prepare([allowed, border])
        lines = np.array([shapely.linestrings(way) if len(way) > 1 else shapely.points(way[0]) for way in ways], dtype=object)
        away = np.asarray(shapely.distance(border, lines))
        for index in np.flatnonzero(~shapely.covers(allowed, lines)).tolist():
            beyond = shapely.difference(lines[index], area)
            ends = shapely.points(shapely.get_coordinates(beyond))
            away[index] = -max(float(beyond.length), float(shapely.distance(area, ends).max(initial=0.0)))
        return away


def circle_ring(place: tuple[float, float], radius: float, *, inclusion: bool) -> Points:
    """Return a ring in degrees for a circle of a fence with a radius in metres: inside an inclusion circle, else around it."""
    angles = np.linspace(0.0, 2 * np.pi, _CIRCLE, endpoint=False)
    reach = min(radius, REACH) / (1.0 if inclusion else float(np.cos(np.pi / _CIRCLE)))
    return LocalFrame(*place).to_degrees(reach * np.column_stack([np.cos(angles), np.sin(angles)]))


def fenced_region(region: SearchRegion, most: int, *, places: Points, wing: bool = False) -> SearchRegion:
    """Return a region whose no-go zones are polygons that an autopilot can store, so that a search keeps clear of these polygons.

    Paths that avoid only the no-go zones themselves can leave no room for a polygon with few corners. If the no-go zones and the
    outline have at most ``most`` corners, or if the polygons would take too much of it, the region stays as it is.

    Parameters
    ----------
    region : SearchRegion
        The region with its margin.
    most : int
        Maximum number of corners of the whole fence.
    places : ndarray of float64, shape (k, 2)
        Launch and landing points in metres, which the polygons leave free.
    wing : bool
        Whether the vehicles are fixed wings, which may turn above holes that are no no-go zones.
    """
    import shapely

    there = shapely.multipoints(places)
    kept = [hole for hole in (() if wing else region.holes) if not hole.intersects(there)]
    window = _window(shapely.union_all([region.outline, there]))
    zones = [
        _clipped(zone, window)
        for zone in _solid_parts(shapely.union_all([region.no_go, *kept]), region.outline)
        if zone.intersects(window)
    ]
    inclusion = corners_of(_solid_parts(_filled(region).convex_hull)) + _LEAST_INCLUSION
    room = most - min(inclusion, max(_LEAST_INCLUSION, most // 4))
    if not zones or corners_of(zones) <= room:
        return region
    clear = (there, region.margin + ROUNDED) if len(places) else None
    plain = without_margin(region)

    def undivided(polygons: list[Any]) -> bool:
        free = plain.outline.difference(shapely.union_all(polygons)).buffer(-region.margin, quad_segs=2)
        largest = max(shapely.area(shapely.get_parts(free)).tolist(), default=0.0)
        return largest > _LEAST_KEPT * float(region.parts[0].area)

    barriers = enclosing_polygons(zones, room, clear=[clear] * len(zones), merge=undivided)
    if corners_of(barriers) > room:
        return region
    try:
        found = with_margin(plain, region.margin, barriers=barriers, pointed=wing)
    except InvalidInputError:
        return region
    kept_parts = found.parts[: len(region.parts)]
    if len(kept_parts) < len(found.parts):  # pockets between polygons that were merged
        free = shapely.union_all(kept_parts)
        if free.area < _LEAST_KEPT * region.free.area:
            return region
        tell_once(
            f"fence: {region.free.area - free.area:.3g} m² between no-go zones cannot be entered, because the autopilot stores at "
            f"most {most} corners"
        )
        found = replace(found, free=free, bends=None)
    return found


def fence_of(region: SearchRegion, ways: Sequence[Points], *, most: int | None = None) -> Fence:
    """Return a fence around a region and the paths of all vehicles, in the unit of the region (degrees or metres).

    The fence contains the whole region, and a margin of `ROOM` metres around each path outside the region. No-go zones, and holes
    to which no path comes nearer than the region's margin, become exclusion zones. The fence has a single outline, because
    autopilots interpret several outlines in different ways. If the region and the margins around paths are not connected, the
    outline is their convex hull.

    If the fence has too many corners, the function replaces its polygons by simpler polygons that contain them. An exclusion zone
    grows only where it comes no nearer to any path than its nearest path was before. If the fence still has too many corners, the
    smallest holes and no-go zones are left out, and Shoal prints a notice.

    Parameters
    ----------
    region : SearchRegion
    ways : sequence of ndarray of float64, each of shape (k, 2)
        Paths in metres, including launch and landing points.
    most : int, optional
        Maximum number of corners of all rings together that the autopilot stores.
    """
    import shapely

    legs = np.concatenate([_legs(way) for way in ways] or [np.zeros(0, dtype=object)])
    flown = shapely.geometrycollections(legs)
    filled = _filled(region)
    shapely.prepare([flown, filled])
    outside = legs[~shapely.covers(filled, legs)]
    strips = [shapely.difference(outside, filled)]
    strips[0] = shapely.buffer(strips[0], ROOM, quad_segs=2)
    if region.margin:  # between the border and the margin, vehicles start and land
        free = region.free.buffer(ROUNDED)
        shapely.prepare(free)
        near = shapely.difference(legs[~shapely.covers(free, legs)], free)
        strips.append(shapely.buffer(shapely.intersection(near, filled), region.margin, quad_segs=2))
    whole = shapely.union_all([filled, *np.concatenate(strips)])
    whole = whole.union(region.no_go.intersection(whole.convex_hull))  # a notch has fewer corners as an exclusion zone
    outer = shapely.Polygon(whole.exterior) if whole.geom_type == "Polygon" else whole.convex_hull
    zones, holes = _zones(region, flown, _window(outer))
    zones, beyond = _split(zones, outer)
    holes, _ = _split(holes, outer)
    simple = _simplified(outer, [*zones, *holes], beyond, flown, most)
    if most is not None and corners_of(simple) > most and beyond:
        simple = _simplified(outer, [*zones, *beyond, *holes], [], flown, most)
    if most is not None and corners_of(simple) > most:
        simple = _largest(outer, [*zones, *beyond], holes, flown, most)
    (outline, *_), *others = (_written(part, region.frame, whole=not number) for number, part in enumerate(simple))
    return Fence(outline, tuple(ring for rings in others for ring in rings))


def _written(shape: Any, frame: LocalFrame | None, *, whole: bool) -> list[Points]:
    """Return the rounded rings of a polygon without holes for a mission file, which neither touch nor cross themselves.

    Rounding can make two corners equal, and lays thin parts of a polygon onto themselves: these parts have no area and are left
    out. If a polygon falls into several parts, each of them is a ring. With ``whole``, the polygon is widened until it is one part.
    """
    import shapely

    rings: list[Points] = []
    for width in (0.0, ROUNDED, 10 * ROUNDED):
        grown_by = shape.buffer(width, join_style="mitre") if width else shape
        ring = shapely.get_coordinates(grown_by.exterior)[:-1]
        if frame is None:
            made = shapely.make_valid(shapely.Polygon(ring), method="structure")
        else:
            corners = shapely.Polygon(np.round(frame.to_degrees(ring), DECIMALS))
            if corners.is_valid:
                return [shapely.get_coordinates(corners.exterior)[:-1]]
            made = shapely.set_precision(shapely.make_valid(corners, method="structure"), 10.0**-DECIMALS)
        parts = sorted((one for one in shapely.get_parts(made) if one.geom_type == "Polygon"), key=lambda one: -one.area)
        found = [shapely.get_coordinates(part.exterior)[:-1] for part in parts]
        if frame is not None:
            found = [np.round(one, DECIMALS) for one in found]
        rings = rings or found
        if len(found) == 1 or (found and not whole):
            return found
    return rings


def _largest(outer: Any, zones: list[Any], holes: list[Any], flown: Any, most: int) -> list[Any]:
    """Return the outline and the largest zones of a fence, as many as have room, and print how many are left out."""
    ranked = [*sorted(zones, key=lambda zone: -zone.area), *sorted(holes, key=lambda hole: -hole.area)]
    kept = len(ranked)
    simple = _simplified(outer, ranked, [], flown, most)
    while kept and (over := corners_of(simple) - most) > 0:
        while kept and over > 0:
            over -= corners_of([simple[kept]])
            kept -= 1
        simple = _simplified(outer, ranked[:kept], [], flown, most)
    left = ranked[kept:]
    away = min((float(zone.distance(flown)) for zone in left if not flown.is_empty), default=0.0)
    tell_once(
        f"fence: {len(left)} of {len(ranked)} no-go zones and holes are no exclusion polygons, because the autopilot stores at "
        f"most {most} corners; all paths keep at least {away:.3g} m from them"
    )
    return simple


def _simplified(outer: Any, zones: list[Any], beyond: list[Any], flown: Any, most: int | None) -> list[Any]:
    """Return the outline and the zones of a fence, with at most ``most`` corners if this is possible.

    The outline does not grow into the zones ``beyond`` it.
    """
    import shapely

    shapes = [outer, *zones]
    if most is None or corners_of(shapes) <= most:
        return shapes
    clear: list[Clear] = [(shapely.union_all(beyond), 0.0) if beyond else None]
    clear += [None if flown.is_empty else (flown, max(float(flown.distance(zone)) - ROUNDED, 0.0)) for zone in zones]
    return enclosing_polygons(shapes, most, clear=clear)


def _legs(way: Points) -> NDArray[Any]:
    """Return the legs of a path as Shapely lines, or its only point."""
    import shapely

    return np.asarray(shapely.points(way[:1]) if len(way) == 1 else shapely.linestrings(np.stack([way[:-1], way[1:]], axis=1)))


def _filled(region: SearchRegion) -> Any:
    """Return the outline of a region without its holes."""
    import shapely

    return shapely.union_all([shapely.Polygon(part.exterior) for part in shapely.get_parts(region.outline)])


def _window(shape: Any) -> Any:
    """Return the rectangle around a shape, outside of which no zone matters."""
    import shapely

    return shapely.box(*shape.bounds).buffer(_BEYOND, join_style="mitre")


def _clipped(zone: Any, window: Any) -> Any:
    """Return the part of a zone inside a window, if this part is a polygon with fewer corners than the zone."""
    part = zone.intersection(window)
    return part if part.geom_type == "Polygon" and corners_of([part]) < corners_of([zone]) else zone


def _solid_parts(shape: Any, ground: Any = None) -> list[Any]:
    """Return polygons without holes that fill a shape: its holes too, except where they hold ``ground``.

    Rounding errors of a union can leave parts that are thinner than a coordinate is exact; they bar nothing.
    """
    import shapely

    found, left = [], [part for part in shapely.get_parts(shape) if part.geom_type == "Polygon"]
    while left:
        part = left.pop()
        if part.buffer(-TOUCH).is_empty:
            continue
        holes = [shapely.Polygon(ring) for ring in part.interiors]
        held = next((hole for hole in holes if ground is not None and hole.buffer(-TOUCH).intersects(ground)), None)
        if held is None:
            found.append(shapely.Polygon(part.exterior))
            continue
        low, under, high, top = part.bounds  # a ring around ground becomes two polygons, cut through the middle of the ground
        middle = held.centroid.x
        for half in (shapely.box(low, under, middle, top), shapely.box(middle, under, high, top)):
            left += [piece for piece in shapely.get_parts(part.intersection(half)) if piece.geom_type == "Polygon"]
    return found


def _zones(region: SearchRegion, flown: Any, window: Any) -> tuple[list[Any], list[Any]]:
    """Return the zones that vehicles must not enter, and the holes of the region to which no path comes too near."""
    import shapely

    zones = shapely.get_parts(region.no_go).tolist()
    if region.barriers:
        zones = [zone for zone in zones if not any(barrier.covers(zone) for barrier in region.barriers)] + list(region.barriers)
    solid = _solid_parts(shapely.union_all(zones), region.outline)
    zones = [_clipped(zone, window) for zone in solid if zone.intersects(window)]
    barred = shapely.union_all(zones) if zones else shapely.Polygon()
    holes = [hole for hole in region.holes if not barred.covers(hole.buffer(-TOUCH))]
    least = max(region.margin - ROUNDED, 0.0)
    free = [hole for hole in holes if not (hole.distance(flown) < least or flown.intersects(hole.buffer(-TOUCH)))]
    return zones, free


def _split(shapes: list[Any], outer: Any) -> tuple[list[Any], list[Any]]:
    """Return the shapes that overlap a polygon, and the other shapes."""
    found: tuple[list[Any], list[Any]] = ([], [])
    for shape in shapes:
        found[bool(shape.intersection(outer).buffer(-TOUCH).is_empty)].append(shape)
    return found
