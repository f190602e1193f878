"""Fences: the outline that an autopilot does not let vehicles leave, and the zones that it does not let them enter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from shoal.dataclass import dataclass
from shoal.search.regions.outline_checks import Points
from shoal.search.regions.projection import LocalFrame
from shoal.search.regions.region import SearchRegion

ROOM = 15.0  # metres that the fence leaves around ways outside of the region


@dataclass(frozen=True, eq=False)
class Fence:
    """Polygons in the units of a mission: degrees, longitude first, or metres.

    Parameters
    ----------
    inclusion : ndarray of float64, shape (k, 2)
        The ring that vehicles stay in; its first corner is not repeated.
    exclusions : tuple of ndarray of float64, each of shape (k, 2)
        Rings that they stay out of.
    """

    inclusion: Points
    exclusions: tuple[Points, ...] = ()

    @property
    def rings(self) -> tuple[Points, ...]:
        """All rings, that which vehicles stay in first."""
        return (self.inclusion, *self.exclusions)

    def area(self, frame: LocalFrame | None) -> Any:
        """Return where vehicles may be, a Shapely geometry in the metres of a frame."""
        import shapely

        placed = [ring if frame is None else frame.to_metres(ring) for ring in self.rings]
        inside, *zones = (shapely.make_valid(shapely.Polygon(ring)) for ring in placed)
        return inside.difference(shapely.union_all(zones))


def fence_of(region: SearchRegion, ways: Sequence[Points]) -> Fence:
    """Return the fence of a region and of the ways of all vehicles, metres; in degrees if the region is.

    Around the whole region and, outside of it, `ROOM` around each way; no-go zones and holes without ways are taken out. Autopilots
    differ in what several outlines mean together: there is one, if need be the hull of all.

    Parameters
    ----------
    region : SearchRegion
    ways : sequence of ndarray of float64, each of shape (k, 2)
        Metres, with launch and landing points.
    """
    import shapely

    lines = [shapely.linestrings(way) if len(way) > 1 else shapely.points(way[0]) for way in ways]
    filled = shapely.union_all([shapely.Polygon(part.exterior) for part in shapely.get_parts(region.outline)])
    outside = [line.difference(filled).buffer(ROOM, quad_segs=2) for line in lines if not filled.covers(line)]
    whole = shapely.union_all([filled, *outside])
    outer = whole if whole.geom_type == "Polygon" else whole.convex_hull
    barred = shapely.union_all([region.no_go, *_empty_holes(region, lines), *_empty_holes_of(outer, lines)])
    zones = [part for part in shapely.get_parts(barred.intersection(outer)) if part.geom_type == "Polygon" and part.area > 0]
    rings = [shapely.get_coordinates(part.exterior)[:-1] for part in (outer, *zones)]
    placed = [ring if region.frame is None else region.frame.to_degrees(ring) for ring in rings]
    return Fence(placed[0], tuple(placed[1:]))


def _empty_holes(region: SearchRegion, lines: list[Any]) -> list[Any]:
    """Return the holes of a region through which no way leads."""
    import shapely

    return [hole for part in shapely.get_parts(region.outline) for hole in _empty_holes_of(part, lines)]


def _empty_holes_of(polygon: Any, lines: list[Any]) -> list[Any]:
    import shapely

    holes = [shapely.Polygon(ring) for ring in polygon.interiors]
    return [hole for hole in holes if not any(line.crosses(hole) or line.within(hole) for line in lines)]
