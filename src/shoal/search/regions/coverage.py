"""Coverage: what flights along given routes see of a region, and where the routes leave it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_array, check_kind, check_list, check_number
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.geometry import left_of, unit_vectors
from shoal.search.regions.boxes import clip_to_boxes, uncovered
from shoal.search.regions.outline import Points, check_plane_points
from shoal.search.regions.region import TOUCH, SearchRegion

UNSEEN = 1e-5
"""Share of a region that a complete search may leave unseen."""

UNSEEN_BY_IMAGES = 1e-3
"""The same for a camera, whose images lie slanted at bends: as in the check of missions."""

_FEW = 128  # maximum number of rectangles near a block; a block with more of them is divided
TURNING = "turning"
"""In place of the angle of footprints: they turn with their vehicles."""

_GRID = TOUCH / 10  # metres
# a block is divided only if it is larger than this fraction of a footprint; footprints mostly cover
# smaller blocks
_SMALLEST = 0.5
_SLANTED = np.sin(np.radians(0.5))  # images turned by more against a leg lie slanted


@dataclass(frozen=True)
class Image:
    """The image of a camera on the ground, as multiples of the side of the footprint that rows of
    cells use.

    Parameters
    ----------
    across, along : float
        Width across the path and length along the path.
    yaw : float, optional
        Heading that the vehicle keeps, in degrees clockwise from north. By default, the vehicle
        faces its direction of motion.
    spacing : float, optional
        Distance between images on a leg. The last image is at the end of the leg, and the first
        one this distance behind its beginning, where the vehicle still faces another way. By
        default, the camera sees without interruption.
    """

    across: float
    along: float
    yaw: float | None = None
    spacing: float | None = None

    def scaled(self, factor: float) -> Image:
        """Return an image of which all lengths are multiplied by ``factor``."""
        spacing = None if self.spacing is None else self.spacing * factor
        return replace(
            self, across=self.across * factor, along=self.along * factor, spacing=spacing
        )

    def of_legs(
        self, starts: Points, ends: Points, opening: NDArray[np.bool_], side: float, angle: float
    ) -> Any:
        """Return the areas that the camera sees on legs; those in ``opening`` begin a route."""
        if self.spacing is None:
            return self.along_legs(*_distinct_legs(starts, ends), side, angle)
        gap, legs = self.spacing * side, ends - starts
        lengths = np.hypot(*legs.T)
        first = np.where(opening, 0.0, np.minimum(gap, lengths))
        ahead = legs / np.where(lengths > 0, lengths, 1.0)[:, None]
        begins, last = starts + first[:, None] * ahead, ends
        if self.yaw is not None:
            kept = np.radians(90.0 - self.yaw)
            along = np.abs(ahead @ (np.cos(kept), np.sin(kept)))
            slanted = np.minimum(along, np.sqrt(1 - np.minimum(along, 1.0) ** 2)) > _SLANTED
            # what images that lie slanted see is no strip
            count = (
                np.where(slanted, np.ceil((lengths - first) / gap - 1e-9), 0).astype(np.int64) + 1
            )
            number = np.repeat(np.arange(len(legs)), count)
            step = np.arange(len(number)) - np.repeat(np.cumsum(count) - count, count)
            begins = begins[number] + (step * gap)[:, None] * ahead[number]
            ending = step == count[number] - 1
            begins = np.where((ending & slanted[number])[:, None], ends[number], begins)
            last = np.where(slanted[number][:, None], begins, ends[number])
        places = np.unique(
            np.hstack([begins, last, ahead if self.yaw is None else 0 * begins]), axis=0
        )
        return self.along_legs(places[:, :2], places[:, 2:4], side, angle, places[:, 4:])

    def along_legs(
        self,
        starts: Points,
        ends: Points,
        side: float,
        angle: float,
        directions: Points | None = None,
    ) -> Any:
        """Return the area that the camera sees along each leg: the convex hull of the images at
        both ends of the leg.

        A vehicle faces its direction in ``directions``, or by default along the leg; on a leg of
        length 0, it faces the direction ``angle``, in degrees counter-clockwise from the x axis.
        """
        import shapely

        legs = ends - starts
        lengths = np.hypot(*legs.T)
        facing = np.radians(angle if self.yaw is None else 90.0 - self.yaw)
        if directions is None:
            directions = legs / np.where(lengths > 0, lengths, 1.0)[:, None]
        moving = np.asarray(directions.any(axis=1))[:, None]
        ahead = np.where(moving, directions, (np.cos(facing), np.sin(facing)))
        ahead = (
            ahead
            if self.yaw is None
            else np.broadcast_to((np.cos(facing), np.sin(facing)), legs.shape)
        )
        beside = left_of(ahead)
        offsets = [
            side / 2 * (front * self.along * ahead + left * self.across * beside)
            for front in (-1, 1)
            for left in (-1, 1)
        ]
        corners = np.stack([end + offset for end in (starts, ends) for offset in offsets], axis=1)
        return shapely.convex_hull(shapely.multipoints(corners))


@dataclass(frozen=True, eq=False)
class AreaCoverage:
    """The part of a region that vehicles see on their routes, and how far the routes leave the
    region.

    Parameters
    ----------
    covered_fraction : float
        Fraction of the region's area that vehicles see, from 0 to 1. Gaps narrower than 1
        micrometre count as seen.
    uncovered_m2 : float
        Size of the area that no vehicle sees, in square metres.
    uncovered : shapely Polygon, MultiPolygon or GeometryCollection
        The area that no vehicle sees, in the local frame of the region in metres.
    outside_m : float
        Total length of the route sections that lie outside `SearchRegion.free` by more than the
        tolerance, in metres.
    legs_outside : int
        Number of legs that leave `SearchRegion.free` by more than the tolerance. A route of one
        point counts as one leg.
    length_m : float
        Total length of all legs of all routes in metres.
    area_m2 : float
        Area of the region in square metres.
    """

    covered_fraction: float
    uncovered_m2: float
    uncovered: Any
    outside_m: float
    legs_outside: int
    length_m: float
    area_m2: float


def coverage_check(
    region: SearchRegion,
    routes: Sequence[ArrayLike],
    footprint: ArrayLike,
    *,
    tolerance: float = TOUCH,
    angle: float = 0.0,
    image: Image | None = None,
    views: Any = None,
) -> AreaCoverage:
    """Measure the area that vehicles on given routes see, and the legs that leave the region.

    At each moment, a vehicle sees the square of side ``footprint`` around its position or, with
    ``image``, the image of its camera.

    Parameters
    ----------
    region : SearchRegion
    routes : sequence of array_like of float, each of shape (k, 2)
        One route for each vehicle: points in metres, connected by straight legs. A route of one
        point is a stationary vehicle.
    footprint : float, or array_like of float
        Side of the footprint in metres: one number for all routes, or one number for each route.
    tolerance : float
        Distance in metres by which a leg may leave the region, because files contain rounded
        coordinates.
    angle : float
        Angle of the footprint's sides in degrees, counter-clockwise from the x axis.
    image : Image, optional
        Image of a camera, which turns with the vehicle. It replaces the square.
    views : ndarray of shapely Polygon, optional
        All that the vehicles see, in metres, in place of footprints along the routes.

    Examples
    --------
    >>> from shoal.search import open_region
    >>> coverage = coverage_check(open_region("rectangle:40x20"), [[(5, 5), (35, 5)], [(5, 15), (25, 15)]], 10)
    >>> coverage.covered_fraction, coverage.uncovered_m2, coverage.outside_m
    (0.875, 100.0, 0.0)
    """
    import shapely

    check_kind(region, SearchRegion, what="region")
    routes = check_list(routes, what="routes")
    if image is not None:
        check_kind(image, Image, what="image")
    sides = check_footprints(footprint, len(routes), what="route")
    check_number(tolerance, what="tolerance", least=0)
    check_number(angle, what="angle", least=-360, most=360)
    paths = [check_plane_points(route, what=f"route {k + 1}") for k, route in enumerate(routes)]
    starts, ends, _ = _legs(paths)
    swept, squares = [], [np.zeros((0, 4))]
    # in the frame of the footprints, where most of what they cover are upright rectangles
    turn = unit_vectors(np.radians(np.array([-angle, 90.0 - angle])))
    if views is not None:
        swept.append(_rotate(views, -angle))
    for side in np.unique(sides).tolist() if views is None else ():
        begins, stops, opening = _legs(
            [path for path, own in zip(paths, sides, strict=True) if own == side]
        )
        if image is None:
            begins, stops = (end @ turn for end in _distinct_legs(begins, stops))
            swept.append(footprints_along(begins, stops, side / 2, 0.0))
            places = np.unique(np.concatenate([begins, stops]), axis=0)
            squares.append(np.hstack([places - side / 2, places + side / 2]))
        else:
            swept.append(_rotate(image.of_legs(begins, stops, opening, side, angle), -angle))
    uncovered = region.area
    if swept:
        area, shapes = _rotate(region.area, -angle), np.concatenate(swept)
        unseen_part = _subtract(area, shapes, np.concatenate(squares), float(np.min(footprint)))
        uncovered = _rotate(unseen_part, angle)
    uncovered = _remove_slivers(uncovered)
    uncovered_m2 = float(uncovered.area)
    lengths = np.hypot(*(ends - starts).T)
    lines = shapely.linestrings(np.stack([starts, ends], axis=1))
    allowed = region.free.buffer(tolerance) if tolerance > 0 else region.free
    shapely.prepare(allowed)
    strays = lines[~shapely.covers(allowed, lines)]
    outside = float(shapely.length(shapely.difference(strays, allowed)).sum())
    return AreaCoverage(
        1 - uncovered_m2 / region.area_m2,
        uncovered_m2,
        uncovered,
        outside,
        len(strays),
        float(lengths.sum()),
        region.area_m2,
    )


def combine_coverages(coverages: Sequence[AreaCoverage]) -> AreaCoverage:
    """Return one coverage for several layers, with the sums of the areas, the lengths and the legs
    of all layers.

    Examples
    --------
    >>> from shoal.search import open_region
    >>> region = open_region("rectangle:20x10")
    >>> whole, half = (coverage_check(region, [route], 10) for route in ([(5, 5), (15, 5)], [(5, 5)]))
    >>> combine_coverages([whole, half]).covered_fraction, combine_coverages([whole, half]).uncovered_m2
    (0.75, 100.0)
    """
    if len(coverages) == 1:
        return coverages[0]
    import shapely

    area = sum(coverage.area_m2 for coverage in coverages)
    uncovered_m2, outside, length = (
        sum(getattr(coverage, name) for coverage in coverages)
        for name in ("uncovered_m2", "outside_m", "length_m")
    )
    legs = sum(coverage.legs_outside for coverage in coverages)
    uncovered = shapely.union_all([coverage.uncovered for coverage in coverages])
    return AreaCoverage(
        1 - uncovered_m2 / area, uncovered_m2, uncovered, outside, legs, length, area
    )


def _legs(paths: list[Points]) -> tuple[Points, Points, NDArray[np.bool_]]:
    """Return the start and the end of each leg of all routes, and whether it begins a route. The
    function merges consecutive collinear legs.
    """
    starts, ends, opening = [np.zeros((0, 2))], [np.zeros((0, 2))], [np.zeros(0, dtype=np.bool_)]
    for path in paths:
        if len(path) == 0:
            continue
        bends = _bends(path)
        if len(bends) == 1:
            bends = np.repeat(bends, 2, axis=0)
        starts.append(bends[:-1])
        ends.append(bends[1:])
        opening.append(np.arange(len(bends) - 1) == 0)
    return np.concatenate(starts), np.concatenate(ends), np.concatenate(opening)


def _bends(path: Points) -> Points:
    """Return a route without the points at which it is straight. Tiny bends count as straight,
    because files round coordinates.
    """
    import shapely

    if len(path) < 2 or np.all(path == path[0]):
        return path[:1]
    return np.asarray(
        shapely.get_coordinates(
            shapely.simplify(shapely.linestrings(path), _GRID / 10, preserve_topology=False)
        )
    )


def _distinct_legs(starts: Points, ends: Points) -> tuple[Points, Points]:
    """Return the legs without repetitions. A leg in the opposite direction counts as a
    repetition.
    """
    back = (starts[:, 0] > ends[:, 0]) | (
        (starts[:, 0] == ends[:, 0]) & (starts[:, 1] > ends[:, 1])
    )
    legs = np.where(back[:, None], np.hstack([ends, starts]), np.hstack([starts, ends]))
    once = np.unique(legs, axis=0)
    return once[:, :2], once[:, 2:]


def footprints_along(starts: Points, ends: Points, half: float, angle: float) -> Any:
    """Return the area that a footprint covers along each leg: the convex hull of the squares at
    both ends of the leg.

    Parameters
    ----------
    starts, ends : ndarray of float64, shape (n, 2)
        Start and end of each leg in metres.
    half : float
        Half of the footprint's side in metres.
    angle : float
        Angle of the footprint's sides in degrees, counter-clockwise from the x axis.
    """
    import shapely

    directions = np.radians(angle + np.array([225.0, 315.0, 45.0, 135.0]))
    square = np.sqrt(2) * half * unit_vectors(directions)
    if angle == 0:
        square = half * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    corners = np.concatenate([starts[:, None] + square, ends[:, None] + square], axis=1)
    return shapely.convex_hull(shapely.multipoints(corners))


def _subtract(area: Any, shapes: Any, squares: NDArray[np.float64], footprint: float) -> Any:
    """Subtract shapes from an area, separately in each small block of the area. One large union of
    all shapes would be slow.

    The array ``squares`` contains the bounds of squares that the shapes contain. Where upright
    rectangles cover all, nothing is computed with polygons.
    """
    import shapely

    if len(shapes) == 0:
        return area
    bounds = shapely.bounds(shapes)
    sizes = bounds[:, 2:] - bounds[:, :2]
    # apart from what rounding leans a side
    upright = sizes.prod(axis=1) - shapely.area(shapes) <= _GRID * sizes.sum(axis=1)
    rectangles = np.concatenate([bounds[upright], squares])
    fields, of = _uncovered_boxes(rectangles, np.array(area.bounds), footprint)
    parts = shapely.box(*fields.T)
    tree = shapely.STRtree(shapes)
    shapely.prepare(area)
    partial = shapely.intersects(area, parts)
    partial[tree.query(parts, predicate="covered_by")[0]] = False
    blocks = np.split(fields[partial], np.flatnonzero(np.diff(of[partial])) + 1)
    bounds = np.array([_bounds(block) for block in blocks if len(block)]).reshape(-1, 4)
    remainders = []
    for part in clip_to_boxes(area, bounds[:, :2], bounds[:, 2:]):
        # Without a grid, GEOS 3.13 would lose whole footprints if many footprints have almost equal
        # sides.
        seen_part = shapely.union_all(shapes[tree.query(part)], grid_size=_GRID)
        remainders.append(shapely.difference(part, seen_part, grid_size=_GRID))
    return shapely.union_all([shape for shape in remainders if shape.area > 0])


def _bounds(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the bounds of several boxes together, wider by the gaps that rectangles may leave."""
    low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
    return np.concatenate([low - 2 * _GRID, high + 2 * _GRID])


def _uncovered_boxes(
    rectangles: NDArray[np.float64], bounds: NDArray[np.float64], footprint: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the boxes that rectangles leave of a box, and the number of the block in which each of
    them lies, in increasing order.
    """
    fields: list[NDArray[np.float64]] = []
    blocks = [(bounds, np.arange(len(rectangles)))]
    while blocks:
        block, among = blocks.pop()
        low, high = block[:2], block[2:]
        near = among[((rectangles[among, :2] <= high) & (rectangles[among, 2:] >= low)).all(axis=1)]
        axis = int(np.argmax(high - low))
        if len(near) <= _FEW or high[axis] - low[axis] <= _SMALLEST * footprint:
            fields.append(uncovered(rectangles[near], block, _GRID))
            continue
        halves = block.copy(), block.copy()
        halves[0][2 + axis] = halves[1][axis] = (low[axis] + high[axis]) / 2
        blocks += [(half, near) for half in halves]
    return np.concatenate(fields), np.repeat(
        np.arange(len(fields)), [len(boxes) for boxes in fields]
    )


def _rotate(shapes: Any, angle: float) -> Any:
    """Rotate a Shapely geometry, or an array of geometries, about the origin, by an angle in
    degrees counter-clockwise.
    """
    import shapely

    if angle == 0:
        return shapes
    turn = unit_vectors(np.radians(np.array([angle, angle + 90.0])))
    return shapely.transform(shapes, lambda points: points @ turn)


def _remove_slivers(shape: Any) -> Any:
    """Remove parts narrower than `TOUCH` from a shape. Rounding errors leave narrow parts between
    footprints.
    """
    import shapely

    parts = shapely.get_parts(shape)
    wide = 2 * shapely.area(parts) > TOUCH * shapely.length(parts)
    return shape if wide.all() else shapely.union_all(parts[wide])


def check_footprints(
    footprint: ArrayLike, robots: int, *, what: str = "robot"
) -> NDArray[np.float64]:
    """Check one footprint for all robots, or one for each robot, in metres. Return each robot's
    footprint, shape (robots,).
    """
    expected = "footprint: expected a length above 0 in metres"
    sides = check_array(footprint, expected=expected)
    if not sides.size or not (np.isfinite(sides) & (sides > 0)).all() or sides.dtype.kind == "b":
        raise InvalidInputError(f"{expected}, got {footprint!r:.200}")
    if sides.shape not in ((), (robots,)):
        raise InvalidInputError(
            f"footprint: expected one length, or {robots}, one per {what}, got {np.size(sides)}"
        )
    return np.broadcast_to(sides, (robots,)).astype(np.float64)
