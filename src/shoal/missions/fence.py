"""Geofences for autopilots: an outline that vehicles must not leave, and zones that vehicles must
not enter.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.geometry import cross, unit_vectors
from shoal.core.notices import tell_once
from shoal.search.regions.margin import with_margin, without_margin
from shoal.search.regions.outline import Points
from shoal.search.regions.projection import DECIMALS, REACH, ROUNDED, LocalFrame
from shoal.search.regions.region import TOUCH, SearchRegion

ROOM = 15.0  # metres: distance of the fence from paths outside the region
CORNERS = {"ardupilot": 70, "px4": 64}
"""Maximum number of corners of a fence, over all its rings, that each autopilot stores.

ArduPilot's limit of 70 corners was tested on a Cube autopilot. The limit of 64 corners is PX4's
maximum number of MAVLink items in a fence.
"""

_LEAST_INCLUSION = 4  # corners that remain for the outline
_LEAST_KEPT = 0.9  # share of the free area that polygons with few corners may leave at least
# corners of a ring in place of a circle: within 0.2 mm of a circle of 1 m, and within 16 mm of one
# of 100 m
_CIRCLE = 180
_ANYWHERE = 4 * REACH  # metres: beyond all that a local frame can hold
_BEYOND = 100.0  # metres beyond the region and the launch points: there no zone matters
_MANY = 300  # corners above which a polygon is first simplified roughly
# metres: first tolerance of the rough simplification, and number of increases, each by a factor of
# √2
_FINEST, _STEPS = 0.01, 28
_HAIR = 1e-3  # metres: a grown corner may touch what it has to leave free
_TINY = 1e-6  # metres
_NEIGHBOURS = 6  # polygons with which a polygon may be merged


Clear = tuple[Any, float] | None
"""A Shapely geometry that a polygon must not touch, and the distance in metres that the polygon
keeps from it; None for nothing.
"""


def enclosing_polygons(
    shapes: Sequence[Any],
    most: int,
    *,
    clear: Sequence[Clear] = (),
    merge: Callable[[list[Any]], bool] | None = None,
) -> list[Any]:
    """Return polygons that contain the given polygons, and have at most ``most`` corners in total,
    if this is possible.

    The function removes one corner after another: it cuts off a corner that points inwards, or
    extends the two neighbours of a side until they meet. It always takes the removal that adds the
    smallest area.

    Parameters
    ----------
    shapes : sequence of Shapely Polygon
        Polygons without holes, in metres.
    most : int
    clear : sequence of (Shapely geometry, float) or None
        For each polygon, what the polygon must not come near to while it grows, and the distance in
        metres.
    merge : callable, optional
        Function that returns whether given polygons may be used. With this function, the convex
        hull of two neighbouring polygons may replace both, as a last resort. In this case, all
        entries of ``clear`` must be equal.

    Examples
    --------
    >>> import shapely
    >>> circle = shapely.Point(0, 0).buffer(10)
    >>> (square,) = enclosing_polygons([circle], 4)
    >>> len(square.exterior.coords) - 1, bool(square.covers(circle)), bool(square.area < 1.5 * circle.area)
    (4, True, True)
    """
    import shapely

    free: list[Clear] = list(clear) if len(clear) else [None] * len(shapes)
    shapely.prepare([kept_clear[0] for kept_clear in free if kept_clear is not None])
    rings = [
        _Ring(_widen(_coarsen(shape, kept_clear)), kept_clear)
        for shape, kept_clear in zip(shapes, free, strict=True)
    ]
    while sum(len(ring.points) for ring in rings) > most:
        best = min(rings, key=lambda ring: ring.least, default=None)
        if best is not None and best.least < inf:
            best.reduce()
        elif merge is None or not _merge_neighbours(rings, merge):
            break
    return [ring.shape for ring in rings]


def _widen(shape: Any) -> Any:
    """Return a polygon that is wider than a given one by more than its rounding errors, with the
    same number of corners.
    """
    wider = shape.buffer(_TINY, join_style="mitre", mitre_limit=10.0)
    return (
        wider
        if wider.geom_type == "Polygon"
        and corners_of([wider]) <= corners_of([shape])
        and wider.covers(shape)
        else shape
    )


def corners_of(shapes: Sequence[Any]) -> int:
    """Return the number of corners of polygons without holes."""
    return sum(len(shape.exterior.coords) - 1 for shape in shapes)


def _near(shape: Any, clear: Clear) -> bool:
    """Return whether a shape is too near to what it has to keep clear of, or touches it."""
    import shapely

    return clear is not None and bool(shapely.dwithin(clear[0], shape, max(clear[1] - _HAIR, 0.0)))


def _coarsen(shape: Any, clear: Clear) -> Any:
    """Return a polygon of at most a few hundred corners that contains a given polygon, or the given
    polygon.
    """
    if corners_of([shape]) <= _MANY:
        return shape
    best = shape
    for step in range(_STEPS):
        tolerance = _FINEST * 2.0 ** (step / 2)
        wider = shape.buffer(tolerance, join_style="mitre", mitre_limit=2.0).simplify(
            0.9 * tolerance
        )
        if wider.geom_type != "Polygon" or not wider.covers(shape) or _near(wider, clear):
            continue
        wider = type(shape)(wider.exterior)
        best = min(best, wider, key=lambda polygon: len(polygon.exterior.coords))
        if corners_of([best]) <= _MANY:
            break
    return best


class _Ring:
    """A polygon that loses its corners one after another."""

    def __init__(self, shape: Any, clear: Clear) -> None:
        import shapely

        self.clear = clear
        self._take(shapely.get_coordinates(shapely.orient_polygons(shape).exterior)[:-1])

    def _take(self, points: Points) -> None:
        import shapely

        self.points, self.shape = points, shapely.Polygon(points)
        removals = self._all_removals()
        self._next = next((one for one in removals if self._is_possible(*one[1:])), None)

    @property
    def least(self) -> float:
        """Area in square metres that the cheapest removal of a corner adds; infinity if no corner
        can be removed.
        """
        return self._next[0] if self._next else inf

    def reduce(self) -> None:
        """Remove a corner."""
        assert self._next is not None
        self._take(self._without_corner(*self._next[1:3]))

    def _all_removals(self) -> Iterator[tuple[float, int, Points | None, Points]]:
        """Yield the added area of each removal, its corner, the new corner or None, and the
        triangle that it adds, the smallest area first.
        """
        points = self.points
        count = len(points)
        if count <= 3:
            return
        # sides of a parallelogram never meet: a triangle at one of its corners
        triangles = [*self._triangles()] if count == 4 else []
        before, after, next_after = (np.roll(points, -shift, axis=0) for shift in (-1, 1, 2))
        turns = cross(points - before, after - points)  # above 0 at a corner that points outwards
        inwards = np.flatnonzero(turns <= 0)
        # the neighbours of each side, extended beyond it
        side_before, side_after = points - before, after - next_after
        across = cross(side_before, side_after)
        # Almost on one line or almost parallel, sides meet anywhere. No new corner is farther away
        # than the ring is long, even if a zone is then left out of the fence.
        farthest = np.hypot(*np.ptp(points, axis=0))
        with np.errstate(divide="ignore", invalid="ignore"):
            extensions = cross(after - points, side_after) / across
            back = cross(after - points, side_before) / across
            outwards = np.flatnonzero(
                (turns > 0)
                & (np.roll(turns, -1) > 0)
                & (extensions > 0)
                & (back > 0)
                & (extensions * np.hypot(*side_before.T) <= farthest)
                & (back * np.hypot(*side_after.T) <= farthest)
            )
        meetings = points[outwards] + extensions[outwards, None] * side_before[outwards]
        # cross(e s, t - e s) = e cross(s, t): the differences of large numbers would be rounded
        added = extensions[outwards] * turns[outwards] / 2
        areas = [*(area for area, *_ in triangles), *(-turns[inwards] / 2), *added]
        first = len(triangles) + len(inwards)
        for number in np.argsort(areas, kind="stable").tolist():
            if number < len(triangles):
                yield triangles[number]
            elif number < first:
                k = int(inwards[number - len(triangles)])
                triangle = np.array([before[k], points[k], after[k]])
                yield float(areas[number]), k, None, triangle
            else:
                k, meeting = int(outwards[number - first]), meetings[number - first]
                triangle = np.array([points[k], meeting, after[k]])
                yield float(areas[number]), k, meeting, triangle

    def _triangles(self) -> Iterator[tuple[float, int, Points | None, Points]]:
        """Yield the triangles that have two sides of a quadrilateral, and a third side through its
        opposite corner.
        """
        for corner in range(4):
            vertex, after, opposite, before = np.roll(self.points, -corner, axis=0)
            first_side, second_side, diagonal = after - vertex, before - vertex, opposite - vertex
            area = float(cross(first_side, second_side))
            if area <= 0:
                continue
            # In the basis of the two sides, the third side is the line of all points with the
            # coordinate sum of the corner.
            total = float(cross(diagonal, second_side) + cross(first_side, diagonal)) / area
            ring = np.array([vertex, vertex + total * first_side, vertex + total * second_side])
            yield area * total**2 / 2 - float(self.shape.area), -1, ring, ring

    def _without_corner(self, corner: int, meeting: Points | None) -> Points:
        """Return the ring without a corner, with a new corner in place of a corner and the next
        one, or another ring.
        """
        if corner < 0:
            return np.asarray(meeting)
        points = self.points.copy()
        if meeting is None:
            return np.delete(points, corner, axis=0)
        points[corner] = meeting
        return np.delete(points, (corner + 1) % len(points), axis=0)

    def _is_possible(self, corner: int, meeting: Points | None, triangle: Points) -> bool:
        import shapely

        if self.clear is not None:
            added = shapely.Polygon(triangle)
            if added.area > 0 and _near(added.buffer(-_HAIR), self.clear):
                return False
        reduced = shapely.Polygon(self._without_corner(corner, meeting))
        return bool(
            reduced.is_valid
            and reduced.area > 0
            and reduced.buffer(_HAIR).covers(self.shape)
            # a path along a side that the triangle covers would lie inside
            and (self.clear is None or not _near(reduced.buffer(-_HAIR), self.clear))
        )


def _merge_neighbours(rings: list[_Ring], accept: Callable[[list[Any]], bool]) -> bool:
    """Replace the two rings whose convex hull adds the least area by this hull; return whether a
    pair could be merged.
    """
    import shapely

    if len(rings) < 2:
        return False
    shapes = np.array([ring.shape for ring in rings], dtype=object)
    middles = shapely.get_coordinates(shapely.centroid(shapes))
    candidates: list[tuple[float, int, int]] = []
    for k in range(len(rings)):
        distances = np.hypot(*(middles - middles[k]).T)
        for second in np.argsort(distances)[1 : 1 + _NEIGHBOURS].tolist():
            hull = shapely.union(shapes[k], shapes[second]).convex_hull
            heapq.heappush(
                candidates, (hull.area - shapes[k].area - shapes[second].area, k, second)
            )
    while candidates:
        _, first, second = heapq.heappop(candidates)
        hull = shapely.union(shapes[first], shapes[second]).convex_hull
        clear = rings[first].clear  # all polygons that may be merged keep clear of the same things
        others = [shape for k, shape in enumerate(shapes) if k not in (first, second)]
        if not _near(hull.buffer(-_HAIR), clear) and accept([hull, *others]):
            for index in sorted((first, second), reverse=True):
                del rings[index]
            rings.append(_Ring(hull, clear))
            return True
    return False


@dataclass(frozen=True, eq=False)
class Fence:
    """A geofence in the unit of a mission: degrees with longitude first, or metres.

    Parameters
    ----------
    inclusion : ndarray of float64, shape (k, 2)
        Ring that vehicles must not leave. The first corner of the ring is not repeated at the end.
        A ring without corners is no limit: such a fence has only exclusion rings.
    exclusions : tuple of ndarray of float64, each of shape (k, 2)
        Rings that vehicles must not enter.
    more : tuple of ndarray of float64, each of shape (k, 2)
        More inclusion rings, in files of other programs. Autopilots interpret several inclusion
        rings differently: ArduPilot needs vehicles inside all of them, PX4 inside any. Shoal takes
        what all of them have in common, or their union if that is nothing.
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
        """Return the area in which the fence allows vehicles, as a Shapely geometry in metres of a
        local frame.
        """
        import shapely

        inside = self.common(frame)
        inside = shapely.union_all(_shapes(self.outlines, frame)) if inside.is_empty else inside
        return inside.difference(shapely.union_all(_shapes(self.exclusions, frame)))

    def common(self, frame: LocalFrame | None) -> Any:
        """Return the area that all inclusion rings have in common, as in `area`."""
        import shapely

        if not self.outlines:
            return shapely.box(-_ANYWHERE, -_ANYWHERE, _ANYWHERE, _ANYWHERE)
        return shapely.intersection_all(_shapes(self.outlines, frame))

    def clearances(self, paths: Sequence[Points], frame: LocalFrame | None) -> NDArray[np.float64]:
        """Return the distance in metres of each path from the nearest border of the fence; float64,
        shape (k,).

        The distance of a path that leaves the fence or enters an exclusion zone is negative: the
        length of the path in there, but at least the distance by which it is in there.

        Parameters
        ----------
        paths : sequence of ndarray of float64, each of shape (n, 2)
            Paths in metres of the local frame; a path of one point is a point.
        frame : LocalFrame or None
        """
        import shapely

        area = self.area(frame)
        border = area.boundary
        allowed = area.buffer(ROUNDED / 2)  # a path along a side is rounded apart from the side
        shapely.prepare([allowed, border])
        lines = np.array(
            [
                shapely.linestrings(path) if len(path) > 1 else shapely.points(path[0])
                for path in paths
            ],
            dtype=object,
        )
        distances = np.asarray(shapely.distance(border, lines))
        for index in np.flatnonzero(~shapely.covers(allowed, lines)).tolist():
            beyond = shapely.difference(lines[index], area)
            ends = shapely.points(shapely.get_coordinates(beyond))
            distances[index] = -max(
                float(beyond.length), float(shapely.distance(area, ends).max(initial=0.0))
            )
        return distances


def circle_ring(place: tuple[float, float], radius: float, *, inclusion: bool) -> Points:
    """Return a ring in degrees for a circle of a fence with a radius in metres: inside an inclusion
    circle, else around it.
    """
    angles = np.linspace(0.0, 2 * np.pi, _CIRCLE, endpoint=False)
    reach = min(radius, REACH) / (1.0 if inclusion else float(np.cos(np.pi / _CIRCLE)))
    return LocalFrame(*place).to_degrees(reach * unit_vectors(angles))


def region_with_barriers(
    region: SearchRegion, most: int, *, places: Points, wing: bool = False
) -> SearchRegion:
    """Return a region whose no-go zones are polygons that an autopilot can store, so that a search
    keeps clear of these polygons.

    Paths that avoid only the no-go zones themselves can leave no room for a polygon with few
    corners. If the no-go zones and the outline have at most ``most`` corners, or if the polygons
    would take too much of it, the region stays as it is.

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

    launch_points = shapely.multipoints(places)
    closed_holes = [
        hole for hole in (() if wing else region.holes) if not hole.intersects(launch_points)
    ]
    window = _window(shapely.union_all([region.outline, launch_points]))
    zones = [
        _clip(zone, window)
        for zone in _solid_parts(shapely.union_all([region.no_go, *closed_holes]), region.outline)
        if zone.intersects(window)
    ]
    inclusion = corners_of(_solid_parts(_fill_holes(region).convex_hull)) + _LEAST_INCLUSION
    budget = most - min(inclusion, max(_LEAST_INCLUSION, most // 4))
    if not zones or corners_of(zones) <= budget:
        return region
    clear = (launch_points, region.margin + ROUNDED) if len(places) else None
    plain = without_margin(region)

    def undivided(polygons: list[Any]) -> bool:
        free = plain.outline.difference(shapely.union_all(polygons)).buffer(
            -region.margin, quad_segs=2
        )
        largest = max(shapely.area(shapely.get_parts(free)).tolist(), default=0.0)
        return largest > _LEAST_KEPT * float(region.parts[0].area)

    barriers = enclosing_polygons(zones, budget, clear=[clear] * len(zones), merge=undivided)
    if corners_of(barriers) > budget:
        return region
    try:
        barred_region = with_margin(plain, region.margin, barriers=barriers, pointed=wing)
    except InvalidInputError:
        return region
    kept_parts = barred_region.parts[: len(region.parts)]
    if len(kept_parts) < len(barred_region.parts):  # pockets between polygons that were merged
        free = shapely.union_all(kept_parts)
        if free.area < _LEAST_KEPT * region.free.area:
            return region
        tell_once(
            f"fence: {region.free.area - free.area:.3g} m² between no-go zones cannot be entered,"
            f" because the autopilot stores at most {most} corners"
        )
        barred_region = replace(barred_region, free=free, bends=None)
    return barred_region


def fence_of(region: SearchRegion, paths: Sequence[Points], *, most: int | None = None) -> Fence:
    """Return a fence around a region and the paths of all vehicles, in the unit of the region
    (degrees or metres).

    The fence contains the whole region, and a margin of `ROOM` metres around each path outside the
    region. No-go zones, and holes to which no path comes nearer than the region's margin, become
    exclusion zones. The fence has a single outline, because autopilots interpret several outlines
    in different ways. If the region and the margins around paths are not connected, the outline is
    their convex hull.

    If the fence has too many corners, the function replaces its polygons by simpler polygons that
    contain them. An exclusion zone grows only where it comes no nearer to any path than its nearest
    path was before. If the fence still has too many corners, the smallest holes and no-go zones are
    left out, and Shoal prints a notice.

    Parameters
    ----------
    region : SearchRegion
    paths : sequence of ndarray of float64, each of shape (k, 2)
        Paths in metres, including launch and landing points.
    most : int, optional
        Maximum number of corners of all rings together that the autopilot stores.
    """
    import shapely

    legs = np.concatenate([_legs(path) for path in paths] or [np.zeros(0, dtype=object)])
    flown = shapely.geometrycollections(legs)
    filled = _fill_holes(region)
    shapely.prepare([flown, filled])
    outside = legs[~shapely.covers(filled, legs)]
    strips = [shapely.difference(outside, filled)]
    strips[0] = shapely.buffer(strips[0], ROOM, quad_segs=2)
    if region.margin:  # between the border and the margin, vehicles start and land
        free = region.free.buffer(ROUNDED)
        shapely.prepare(free)
        near = shapely.difference(legs[~shapely.covers(free, legs)], free)
        strips.append(
            shapely.buffer(shapely.intersection(near, filled), region.margin, quad_segs=2)
        )
    covered = shapely.union_all([filled, *np.concatenate(strips)])
    # a notch has fewer corners as an exclusion zone
    covered = covered.union(region.no_go.intersection(covered.convex_hull))
    outer = (
        shapely.Polygon(covered.exterior) if covered.geom_type == "Polygon" else covered.convex_hull
    )
    zones, holes = _zones(region, flown, _window(outer))
    zones, beyond = _split_by_overlap(zones, outer)
    holes, _ = _split_by_overlap(holes, outer)
    simple = _simplify(outer, [*zones, *holes], beyond, flown, most)
    if most is not None and corners_of(simple) > most and beyond:
        simple = _simplify(outer, [*zones, *beyond, *holes], [], flown, most)
    if most is not None and corners_of(simple) > most:
        simple = _keep_largest(outer, [*zones, *beyond], holes, flown, most)
    (outline, *_), *others = (
        _round_rings(part, region.frame, whole=not number) for number, part in enumerate(simple)
    )
    return Fence(outline, tuple(ring for rings in others for ring in rings))


def _round_rings(shape: Any, frame: LocalFrame | None, *, whole: bool) -> list[Points]:
    """Return the rounded rings of a polygon without holes for a mission file, which neither touch
    nor cross themselves.

    Rounding can make two corners equal, and lays thin parts of a polygon onto themselves: these
    parts have no area and are left out. If a polygon falls into several parts, each of them is a
    ring. With ``whole``, the polygon is widened until it is one part.
    """
    import shapely

    rings: list[Points] = []
    for width in (0.0, ROUNDED, 10 * ROUNDED):
        grown_by = shape.buffer(width, join_style="mitre") if width else shape
        ring = shapely.get_coordinates(grown_by.exterior)[:-1]
        if frame is None:
            repaired = shapely.make_valid(shapely.Polygon(ring), method="structure")
        else:
            corners = shapely.Polygon(np.round(frame.to_degrees(ring), DECIMALS))
            if corners.is_valid:
                return [shapely.get_coordinates(corners.exterior)[:-1]]
            repaired = shapely.set_precision(
                shapely.make_valid(corners, method="structure"), 10.0**-DECIMALS
            )
        parts = sorted(
            (piece for piece in shapely.get_parts(repaired) if piece.geom_type == "Polygon"),
            key=lambda piece: -piece.area,
        )
        part_rings = [shapely.get_coordinates(part.exterior)[:-1] for part in parts]
        if frame is not None:
            part_rings = [np.round(piece, DECIMALS) for piece in part_rings]
        rings = rings or part_rings
        if len(part_rings) == 1 or (part_rings and not whole):
            return part_rings
    return rings


def _keep_largest(
    outer: Any, zones: list[Any], holes: list[Any], flown: Any, most: int
) -> list[Any]:
    """Return the outline and the largest zones of a fence, as many as have room, and print how many
    are left out.
    """
    ranked = [
        *sorted(zones, key=lambda zone: -zone.area),
        *sorted(holes, key=lambda hole: -hole.area),
    ]
    count = len(ranked)
    simple = _simplify(outer, ranked, [], flown, most)
    while count and (over := corners_of(simple) - most) > 0:
        while count and over > 0:
            over -= corners_of([simple[count]])
            count -= 1
        simple = _simplify(outer, ranked[:count], [], flown, most)
    omitted = ranked[count:]
    nearest = min(
        (float(zone.distance(flown)) for zone in omitted if not flown.is_empty), default=0.0
    )
    tell_once(
        f"fence: {len(omitted)} of {len(ranked)} no-go zones and holes are no exclusion polygons,"
        f" because the autopilot stores at most {most} corners; all paths keep at least {nearest:.3g}"
        " m from them"
    )
    return simple


def _simplify(
    outer: Any, zones: list[Any], beyond: list[Any], flown: Any, most: int | None
) -> list[Any]:
    """Return the outline and the zones of a fence, with at most ``most`` corners if this is
    possible.

    The outline does not grow into the zones ``beyond`` it.
    """
    import shapely

    shapes = [outer, *zones]
    if most is None or corners_of(shapes) <= most:
        return shapes
    clear: list[Clear] = [(shapely.union_all(beyond), 0.0) if beyond else None]
    clear += [
        None if flown.is_empty else (flown, max(float(flown.distance(zone)) - ROUNDED, 0.0))
        for zone in zones
    ]
    return enclosing_polygons(shapes, most, clear=clear)


def _shapes(rings: Sequence[Points], frame: LocalFrame | None) -> list[Any]:
    """Return rings as Shapely polygons in metres of a local frame."""
    import shapely

    placed = [ring if frame is None else frame.to_metres(ring) for ring in rings]
    return [shapely.make_valid(shapely.Polygon(ring)) for ring in placed]


def _legs(path: Points) -> NDArray[Any]:
    """Return the legs of a path as Shapely lines, or its only point."""
    import shapely

    return np.asarray(
        shapely.points(path[:1])
        if len(path) == 1
        else shapely.linestrings(np.stack([path[:-1], path[1:]], axis=1))
    )


def _fill_holes(region: SearchRegion) -> Any:
    """Return the outline of a region without its holes."""
    import shapely

    return shapely.union_all(
        [shapely.Polygon(part.exterior) for part in shapely.get_parts(region.outline)]
    )


def _window(shape: Any) -> Any:
    """Return the rectangle around a shape, outside of which no zone matters."""
    import shapely

    return shapely.box(*shape.bounds).buffer(_BEYOND, join_style="mitre")


def _clip(zone: Any, window: Any) -> Any:
    """Return the part of a zone inside a window, if this part is a polygon with fewer corners than
    the zone.
    """
    part = zone.intersection(window)
    return part if part.geom_type == "Polygon" and corners_of([part]) < corners_of([zone]) else zone


def _solid_parts(shape: Any, ground: Any = None) -> list[Any]:
    """Return polygons without holes that fill a shape: its holes too, except where they hold
    ``ground``.

    Rounding errors of a union can leave parts that are thinner than a coordinate is exact; they bar
    nothing.
    """
    import shapely

    solids, pending = [], [part for part in shapely.get_parts(shape) if part.geom_type == "Polygon"]
    while pending:
        part = pending.pop()
        if part.buffer(-TOUCH).is_empty:
            continue
        holes = [shapely.Polygon(ring) for ring in part.interiors]
        enclosing = next(
            (
                hole
                for hole in holes
                if ground is not None and hole.buffer(-TOUCH).intersects(ground)
            ),
            None,
        )
        if enclosing is None:
            solids.append(shapely.Polygon(part.exterior))
            continue
        # a ring around ground becomes two polygons, cut through the middle of the ground
        low, under, high, top = part.bounds
        middle = enclosing.centroid.x
        for half in (shapely.box(low, under, middle, top), shapely.box(middle, under, high, top)):
            pending += [
                piece
                for piece in shapely.get_parts(part.intersection(half))
                if piece.geom_type == "Polygon"
            ]
    return solids


def _zones(region: SearchRegion, flown: Any, window: Any) -> tuple[list[Any], list[Any]]:
    """Return the zones that vehicles must not enter, and the holes of the region to which no path
    comes too near.
    """
    import shapely

    zones = shapely.get_parts(region.no_go).tolist()
    if region.barriers:
        zones = [
            zone for zone in zones if not any(barrier.covers(zone) for barrier in region.barriers)
        ] + list(region.barriers)
    solid = _solid_parts(shapely.union_all(zones), region.outline)
    zones = [_clip(zone, window) for zone in solid if zone.intersects(window)]
    barred = shapely.union_all(zones) if zones else shapely.Polygon()
    holes = [hole for hole in region.holes if not barred.covers(hole.buffer(-TOUCH))]
    least = max(region.margin - ROUNDED, 0.0)
    free = [
        hole
        for hole in holes
        if not (hole.distance(flown) < least or flown.intersects(hole.buffer(-TOUCH)))
    ]
    return zones, free


def _split_by_overlap(shapes: list[Any], outer: Any) -> tuple[list[Any], list[Any]]:
    """Return the shapes that overlap a polygon, and the other shapes."""
    groups: tuple[list[Any], list[Any]] = ([], [])
    for shape in shapes:
        groups[bool(shape.intersection(outer).buffer(-TOUCH).is_empty)].append(shape)
    return groups
