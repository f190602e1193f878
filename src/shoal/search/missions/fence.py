"""Geofences for autopilots: an outline that vehicles must not leave, and zones that vehicles must not enter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from shoal.core.dataclass import dataclass
from shoal.core.notices import tell_once
from shoal.search.regions.outline_checks import Points
from shoal.search.regions.projection import LocalFrame
from shoal.search.regions.region import TOUCH, SearchRegion

ROOM = 15.0  # metres: distance of the fence from paths outside the region
CORNERS = {"ardupilot": 70, "px4": 64}
"""Maximum number of corners of a fence, over all its rings, that each autopilot stores.

ArduPilot's limit of 70 corners was tested on a Cube autopilot. The limit of 64 corners is PX4's maximum number of MAVLink items
in a fence.
"""

_FINEST, _STEPS = 0.1, 22  # metres: initial simplification of rings, and number of increases, up to 145 m


@dataclass(frozen=True, eq=False)
class Fence:
    """A geofence in the unit of a mission: degrees with longitude first, or metres.

    Parameters
    ----------
    inclusion : ndarray of float64, shape (k, 2)
        Ring that vehicles must not leave. The first corner of the ring is not repeated at the end.
    exclusions : tuple of ndarray of float64, each of shape (k, 2)
        Rings that vehicles must not enter.
    """

    inclusion: Points
    exclusions: tuple[Points, ...] = ()

    @property
    def rings(self) -> tuple[Points, ...]:
        """All rings of the fence: the inclusion ring, followed by the exclusion rings."""
        return (self.inclusion, *self.exclusions)

    def area(self, frame: LocalFrame | None) -> Any:
        """Return the area in which the fence allows vehicles, as a Shapely geometry in metres of a local frame."""
        import shapely

        placed = [ring if frame is None else frame.to_metres(ring) for ring in self.rings]
        inside, *zones = (shapely.make_valid(shapely.Polygon(ring)) for ring in placed)
        return inside.difference(shapely.union_all(zones))


def fence_of(region: SearchRegion, ways: Sequence[Points], *, most: int | None = None) -> Fence:
    """Return a fence around a region and the paths of all vehicles, in the unit of the region (degrees or metres).

    The fence contains the whole region, and a margin of `ROOM` metres around each path outside the region. No-go zones, and holes
    that no path crosses, become exclusion zones. The fence has a single outline, because autopilots interpret several outlines in
    different ways. If the region and the margins around paths are not connected, the outline is their convex hull.

    If the fence has too many corners, the function replaces the outline by a simpler outline that contains it. The function also
    simplifies exclusion zones, except where a path that avoids the zone would enter the simplified zone. If the simplified fence
    still has too many corners, Shoal prints a notice.

    Parameters
    ----------
    region : SearchRegion
    ways : sequence of ndarray of float64, each of shape (k, 2)
        Paths in metres, including launch and landing points.
    most : int, optional
        Maximum number of corners of all rings together that the autopilot stores.
    """
    import shapely

    lines = [shapely.linestrings(way) if len(way) > 1 else shapely.points(way[0]) for way in ways]
    filled = shapely.union_all([shapely.Polygon(part.exterior) for part in shapely.get_parts(region.outline)])
    outside = [line.difference(filled).buffer(ROOM, quad_segs=2) for line in lines if not filled.covers(line)]
    whole = shapely.union_all([filled, *outside])
    outer = whole if whole.geom_type == "Polygon" else whole.convex_hull
    barred = shapely.union_all([region.no_go, *_empty_holes(region, lines), *_empty_holes_of(outer, lines)])
    # Rounding errors of an intersection can leave parts that are thinner than a coordinate is exact; they bar nothing.
    zones = [part for part in shapely.get_parts(barred.intersection(outer)) if not part.buffer(-TOUCH).is_empty]
    rings = [shapely.get_coordinates(part.exterior)[:-1] for part in _thinned([outer, *zones], lines, most)]
    placed = [ring if region.frame is None else region.frame.to_degrees(ring) for ring in rings]
    return Fence(placed[0], tuple(placed[1:]))


def _thinned(shapes: list[Any], lines: list[Any], most: int | None) -> list[Any]:
    """Return simplified polygons that have at most ``most`` corners in total, if this is possible.

    Each simplified polygon contains the given polygon, because the function first grows a polygon by the tolerance of
    simplification.
    """
    import shapely

    if most is None or _corners(shapes) <= most:
        return shapes
    ways, thin = shapely.union_all(lines), shapes.copy()
    for step in range(_STEPS):
        by = _FINEST * 2.0 ** (step / 2)
        for k, shape in enumerate(shapes):
            wider = shape.buffer(by, join_style="mitre").simplify(by)
            free = not k or shape.intersects(ways) or not wider.intersects(ways)
            if free and wider.geom_type == "Polygon" and wider.is_valid and wider.covers(shape):
                thin[k] = min([thin[k], wider], key=lambda one: len(one.exterior.coords))
        if _corners(thin) <= most:
            return thin
    tell_once(
        f"fence: expected at most {most} corners, which the autopilot can store, got {_corners(thin)} in the simplest fence; "
        "leave out zones, or use an autopilot that stores more corners"
    )
    return thin


def _corners(shapes: list[Any]) -> int:
    return sum(len(shape.exterior.coords) - 1 for shape in shapes)


def _empty_holes(region: SearchRegion, lines: list[Any]) -> list[Any]:
    """Return the holes of a region that no vehicle's path crosses."""
    import shapely

    return [hole for part in shapely.get_parts(region.outline) for hole in _empty_holes_of(part, lines)]


def _empty_holes_of(polygon: Any, lines: list[Any]) -> list[Any]:
    import shapely

    holes = [shapely.Polygon(ring) for ring in polygon.interiors]
    return [hole for hole in holes if not any(line.crosses(hole) or line.within(hole) for line in lines)]
