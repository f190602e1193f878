"""Regions: what is to be searched, and what of it flights have seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_number
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.regions.outline import FARTHEST, Points, check_plane_points, place_of, text_of
from shoal.search.regions.projection import LocalFrame

MOST_LAYERS = 1000
"""Maximum number of layers of a volume."""

TOUCH = 1e-6  # metres: tolerance for points inside the region


@dataclass(frozen=True, eq=False)
class SearchRegion:
    """A region to search, with its holes and no-go zones. The functions `open_region` and
    `region_of` create regions.

    Parameters
    ----------
    area : shapely Polygon or MultiPolygon
        The area that robots must see, as a valid geometry in metres with x east and y north. The
        area contains neither no-go zones nor places that robots cannot see while they keep the
        margin (`shoal.search.regions.margin`).
    frame : LocalFrame or None
        Local frame on Earth, or None for coordinates in metres without a position on Earth.
    no_go : shapely Polygon or MultiPolygon
        The no-go zones. In a region without no-go zones, the attribute ``no_go`` is an empty
        geometry.
    name : str
        Name of the region in error messages and reports.
    no_go_zones : int
        Number of no-go zones that the user gave, including zones that overlap each other or lie
        outside the region.
    margin : float
        Smallest allowed distance between robots and the border of the region, in metres.
    free : shapely Polygon or MultiPolygon, optional
        The area where robots may be. By default, robots may be everywhere in ``area``.
    outline : shapely Polygon or MultiPolygon, optional
        The whole region except its no-go zones, including places that robots cannot see. By
        default, the outline is equal to ``area``.
    height : float
        Height in metres of the volume above the region, or 0 for a plane region.
    bends : shapely Polygon or MultiPolygon, optional
        A shape inside ``free`` that has fewer corners than ``free``. Where possible, paths bend at
        the corners of ``bends``.
    barriers : tuple of shapely Polygon
        The exclusion polygons of a fence, which contain the no-go zones and holes of the region and
        have few corners. Robots may not enter them either. By default, the region has none.
    pointed : bool
        Whether ``free`` has few corners in place of arcs, because robots are fixed wings.
    """

    area: Any
    frame: LocalFrame | None
    no_go: Any
    name: str
    no_go_zones: int = 0
    margin: float = 0.0
    free: Any = None
    outline: Any = None
    height: float = 0.0
    bends: Any = None
    barriers: tuple[Any, ...] = ()
    pointed: bool = False

    def __post_init__(self) -> None:
        for name in ("free", "outline"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, self.area)

    @property
    def area_m2(self) -> float:
        """Size of the area that robots must see, in square metres."""
        return float(self.area.area)

    @property
    def unseen_m2(self) -> float:
        """Size of the area that robots cannot see while they keep the margin, in square metres."""
        return max(0.0, float(self.outline.area - self.area.area))

    @cached_property
    def scale_error(self) -> float:
        """Largest relative error of a length in the region's frame: 0 for a region without a
        position on Earth.
        """
        import shapely

        if self.frame is None:
            return 0.0
        return self.frame.scale_error(self.frame.to_degrees(shapely.get_coordinates(self.outline)))

    @cached_property
    def parts(self) -> tuple[Any, ...]:
        """The connected polygons of the area where robots may be, from the largest to
        the smallest.
        """
        import shapely

        pieces = shapely.get_parts(self.free)
        return tuple(sorted(pieces, key=lambda part: (-part.area, part.bounds)))

    @property
    def restricted(self) -> bool:
        """Whether robots may not be everywhere in the outline: they keep a margin, or avoid the
        exclusion polygons of a fence.
        """
        return self.margin > 0 or bool(self.barriers)

    @property
    def barred(self) -> Any:
        """All places that no robot may enter, inside or outside the outline, as one Shapely
        geometry: zones and barriers.
        """
        import shapely

        return shapely.union_all([self.no_go, *self.barriers]) if self.barriers else self.no_go

    @property
    def holes(self) -> tuple[Any, ...]:
        """The holes of the outline as Shapely polygons. A no-go zone inside the outline counts as a
        hole.
        """
        import shapely

        return tuple(
            shapely.Polygon(ring)
            for part in shapely.get_parts(self.outline)
            for ring in part.interiors
        )

    @cached_property
    def reach(self) -> Any:
        """The area where robots may be, grown by half of `TOUCH` because of rounding errors, as a
        prepared Shapely geometry.
        """
        import shapely

        grown = self.free.buffer(TOUCH / 2, join_style="mitre")
        shapely.prepare(grown)
        return grown

    @cached_property
    def border(self) -> Any:
        """The border of `reach` as a prepared Shapely geometry.

        A segment that starts inside the region and does not meet the border of `reach` lies inside
        the region.
        """
        import shapely

        border = shapely.boundary(self.reach)
        shapely.prepare(border)
        return border

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return, for each point, whether it lies inside ``free``, or outside by at most half of
        `TOUCH`; bool, shape (n,).
        """
        import shapely

        array = check_plane_points(points, what="points")
        return np.asarray(shapely.intersects_xy(self.reach, array[:, 0], array[:, 1]))

    def check_inside(self, points: ArrayLike, *, what: str = "start") -> Points:
        """Check that points in metres lie inside the region, and return them as an array; float64,
        shape (n, 2).

        The argument ``what`` is the name of the points in error messages.

        Raises
        ------
        InvalidInputError
            If a point lies outside the region. The error message gives the point's coordinates and
            its distance from the region.
        """
        array = check_plane_points(points, what=what)
        outside = ~self.contains(array)
        if outside.any():
            index = int(np.argmax(outside))
            degrees = ""
            if self.frame is not None and np.hypot(*array[index]) < 1e5:
                degrees = (
                    " (longitude and latitude"
                    f" {text_of(self.frame.to_degrees(array[index : index + 1])[0])})"
                )
            raise InvalidInputError(
                f"{what}: expected points inside the region {self.name!r}{self.margin_text}, got"
                f" {text_of(array[index])} m{degrees} at point {index + 1},"
                f" {self.outside_text(array[index])}"
            )
        return array

    def outside_text(self, point: ArrayLike) -> str:
        """Return how far a point (x, y) lies outside ``free``, and in which hole or no-go zone, for
        error messages.
        """
        import shapely

        away = float(shapely.distance(self.free, shapely.points(point)))
        hole = next((hole for hole in self.holes if hole.contains(shapely.points(point))), None)
        if hole is None:
            return f"{away:.3g} m outside"
        middle = shapely.get_coordinates(hole.representative_point())
        placed = middle if self.frame is None else self.frame.to_degrees(middle).round(6)
        return (
            f"{away:.3g} m inside the {'no-go zone' if hole.intersects(self.no_go) else 'hole'}"
            f" around {text_of(placed[0])}"
        )

    def layer_altitudes(self, footprint: float) -> tuple[float, ...]:
        """Return the altitudes of a volume's layers in metres, in ascending order, for layers at
        most ``footprint`` metres thick.

        Examples
        --------
        >>> from shoal.search import open_region
        >>> open_region("box:20x20x25").layer_altitudes(10.0)
        (4.166666666666667, 12.5, 20.833333333333336)
        """
        count = max(1, int(np.ceil(self.height / footprint * (1 - 1e-9))))
        if count > MOST_LAYERS:
            raise InvalidInputError(
                f"region {self.name!r}: expected at most {MOST_LAYERS} layers, a footprint of"
                f" {footprint:g} m thick, got {count}"
            )
        return tuple(self.height / count * (number + 0.5) for number in range(count))

    @property
    def margin_text(self) -> str:
        """The words " with a margin of ... m" for error messages, or an empty text if the margin is
        0.
        """
        return f" with a margin of {self.margin:g} m" if self.margin else ""

    def __repr__(self) -> str:
        holes = sum(len(part.interiors) for part in self.parts)
        zones = f", {self.no_go_zones} no-go zones" if self.no_go_zones else ""
        return (
            f"<SearchRegion {self.name!r}: {self.area_m2:.10g} m2, {len(self.parts)} parts, {holes}"
            f" holes{zones}>"
        )


def region_of(
    area: Any,
    *,
    frame: LocalFrame | None = None,
    no_go: Any = None,
    name: str = "region",
    no_go_zones: int | None = None,
) -> SearchRegion:
    """Create a region from a Shapely polygon in metres and from no-go zones.

    Parameters
    ----------
    area : shapely Polygon or MultiPolygon
        The polygon or polygons of the region. The function unites overlapping polygons.
    frame : LocalFrame, optional
        Local frame on Earth. By default, the region has no position on Earth.
    no_go : shapely Polygon or MultiPolygon, optional
        No-go zones in metres. No-go zones may overlap each other and extend beyond ``area``.
    name : str
        Name of the region in error messages and reports.
    no_go_zones : int, optional
        Number of no-go zones. By default, the function counts the polygons in ``no_go``.

    Raises
    ------
    InvalidInputError
        If a geometry is invalid or is not a polygon, or if the no-go zones leave no area.

    Examples
    --------
    >>> import shapely
    >>> region_of(shapely.box(0, 0, 20, 10), no_go=shapely.box(5, 5, 10, 8))
    <SearchRegion 'region': 185 m2, 1 parts, 1 holes, 1 no-go zones>
    """
    import shapely

    whole = _only_polygons(area, what=name)
    zones = (
        _only_polygons(no_go, what=f"{name}: no-go zones")
        if no_go is not None
        else shapely.Polygon()
    )
    free = whole if zones.is_empty else polygons_in(whole.difference(zones))
    if free.is_empty or not free.area > 0:
        got = "an empty one" if zones.is_empty else "one that the no-go zones cover wholly"
        raise InvalidInputError(f"{name}: expected a region with an area to search, got {got}")
    given = len(shapely.get_parts(zones)) if no_go_zones is None else no_go_zones
    return SearchRegion(free, frame, zones, name, given)


def _only_polygons(shape: Any, *, what: str) -> Any:
    """Check one or several Shapely polygons, and return their union as one valid shape."""
    import shapely
    from shapely.validation import explain_validity

    if not isinstance(shape, shapely.Polygon | shapely.MultiPolygon):
        raise InvalidInputError(
            f"{what}: expected a Shapely Polygon or MultiPolygon, got {type(shape).__name__}"
        )
    points = shapely.get_coordinates(shape)
    if not (np.abs(points) <= FARTHEST).all():
        got = text_of(points[int(np.argmin((np.abs(points) <= FARTHEST).all(axis=1)))])
        raise InvalidInputError(
            f"{what}: expected coordinates of at most {FARTHEST:g} m, got {got}"
        )
    parts = shapely.get_parts(shapely.force_2d(shape))
    for index, part in enumerate(parts):
        if not part.is_valid:
            said = explain_validity(part)
            raise InvalidInputError(
                f"{what}: expected a valid polygon, got"
                f" {said.partition('[')[0].lower()}{place_of(said)} in part {index + 1}"
            )
    return (
        polygons_in(shapely.union_all(parts))
        if len(parts) > 1
        else parts[0]
        if len(parts)
        else shapely.Polygon()
    )


def polygons_in(shape: Any) -> Any:
    """Return the polygons in a Shapely geometry, without lines, points, and polygons that are as
    small as rounding errors.
    """
    import shapely

    parts = [part for part in _flattened(shape) if part.geom_type == "Polygon" and part.area > 0]
    size = max(
        (float(np.ptp(np.reshape(part.bounds, (2, 2)), axis=0).max()) for part in parts),
        default=0.0,
    )
    kept = [part for part in parts if part.area > 1e-15 * size * size]
    return kept[0] if len(kept) == 1 else shapely.MultiPolygon(kept)


def _flattened(shape: Any) -> list[Any]:
    import shapely

    parts = shapely.get_parts(shape)
    return [
        piece
        for part in parts
        for piece in (_flattened(part) if hasattr(part, "geoms") else [part])
    ]


_FEW = 48  # maximum number of footprint shapes near a block; a block with more shapes is divided
_GRID = TOUCH / 10  # metres
# a block is divided only if it is larger than this fraction of a footprint; footprints mostly cover
# smaller blocks
_SMALLEST = 0.5


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
    """

    across: float
    along: float
    yaw: float | None = None

    def scaled(self, factor: float) -> Image:
        """Return an image of which both sides are multiplied by ``factor``."""
        return replace(self, across=self.across * factor, along=self.along * factor)

    def along_legs(self, starts: Points, ends: Points, side: float, angle: float) -> Any:
        """Return the area that the camera sees along each leg: the convex hull of the images at
        both ends of the leg.

        On a leg of length 0, a vehicle faces the direction ``angle``, in degrees counter-clockwise
        from the x axis.
        """
        import shapely

        legs = ends - starts
        lengths = np.hypot(*legs.T)
        facing = np.radians(angle if self.yaw is None else 90.0 - self.yaw)
        moving = lengths[:, None] > 0
        ahead = np.where(
            moving, legs / np.where(moving, lengths[:, None], 1.0), (np.cos(facing), np.sin(facing))
        )
        ahead = (
            ahead
            if self.yaw is None
            else np.broadcast_to((np.cos(facing), np.sin(facing)), legs.shape)
        )
        beside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
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

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> from shoal.search import open_region
    >>> seen = coverage_check(open_region("rectangle:40x20"), [[(5, 5), (35, 5)], [(5, 15), (25, 15)]], 10)
    >>> seen.covered_fraction, seen.uncovered_m2, seen.outside_m
    (0.875, 100.0, 0.0)
    """
    import shapely

    sides = check_footprints(footprint, len(routes), what="route")
    check_number(tolerance, what="tolerance", least=0)
    ways = [check_plane_points(route, what=f"route {k + 1}") for k, route in enumerate(routes)]
    starts, ends = _legs(ways)
    swept = []
    for side in np.unique(sides).tolist():
        legs = _once(*_legs([way for way, own in zip(ways, sides, strict=True) if own == side]))
        swept.append(
            footprints_along(*legs, side / 2, angle)
            if image is None
            else image.along_legs(*legs, side, angle)
        )
    uncovered = (
        _without(region.area, np.concatenate(swept), float(sides.min())) if swept else region.area
    )
    uncovered = _without_slivers(uncovered)
    left = float(uncovered.area)
    lengths = np.hypot(*(ends - starts).T)
    lines = shapely.linestrings(np.stack([starts, ends], axis=1))
    allowed = region.free.buffer(tolerance) if tolerance > 0 else region.free
    shapely.prepare(allowed)
    strays = lines[~shapely.covers(allowed, lines)]
    outside = float(shapely.length(shapely.difference(strays, allowed)).sum())
    return AreaCoverage(
        1 - left / region.area_m2,
        left,
        uncovered,
        outside,
        len(strays),
        float(lengths.sum()),
        region.area_m2,
    )


def together(coverages: Sequence[AreaCoverage]) -> AreaCoverage:
    """Return one coverage for several layers, with the sums of the areas, the lengths and the legs
    of all layers.

    Examples
    --------
    >>> from shoal.search import open_region
    >>> region = open_region("rectangle:20x10")
    >>> whole, half = (coverage_check(region, [way], 10) for way in ([(5, 5), (15, 5)], [(5, 5)]))
    >>> together([whole, half]).covered_fraction, together([whole, half]).uncovered_m2
    (0.75, 100.0)
    """
    if len(coverages) == 1:
        return coverages[0]
    import shapely

    area = sum(one.area_m2 for one in coverages)
    left, outside, length = (
        sum(getattr(one, name) for one in coverages)
        for name in ("uncovered_m2", "outside_m", "length_m")
    )
    legs = sum(one.legs_outside for one in coverages)
    uncovered = shapely.union_all([one.uncovered for one in coverages])
    return AreaCoverage(1 - left / area, left, uncovered, outside, legs, length, area)


def _legs(ways: list[Points]) -> tuple[Points, Points]:
    """Return the start and the end of each leg of all routes. The function merges consecutive
    collinear legs.
    """
    starts, ends = [np.zeros((0, 2))], [np.zeros((0, 2))]
    for way in ways:
        if len(way) == 0:
            continue
        bends = _bends(way)
        if len(bends) == 1:
            bends = np.repeat(bends, 2, axis=0)
        starts.append(bends[:-1])
        ends.append(bends[1:])
    return np.concatenate(starts), np.concatenate(ends)


def _bends(way: Points) -> Points:
    """Return a route without the points at which it is straight. Tiny bends count as straight,
    because files round coordinates.
    """
    import shapely

    if len(way) < 2 or np.all(way == way[0]):
        return way[:1]
    return np.asarray(
        shapely.get_coordinates(
            shapely.simplify(shapely.linestrings(way), _GRID / 10, preserve_topology=False)
        )
    )


def _once(starts: Points, ends: Points) -> tuple[Points, Points]:
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

    way = np.radians(angle + np.array([225.0, 315.0, 45.0, 135.0]))
    square = np.sqrt(2) * half * np.stack([np.cos(way), np.sin(way)], axis=1)
    if angle == 0:
        square = half * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    corners = np.concatenate([starts[:, None] + square, ends[:, None] + square], axis=1)
    return shapely.convex_hull(shapely.multipoints(corners))


def _without(area: Any, shapes: Any, footprint: float) -> Any:
    """Subtract shapes from an area, separately in each small block of the area. One large union of
    all shapes would be slow.
    """
    import shapely

    if len(shapes) == 0:
        return area
    tree = shapely.STRtree(shapes)
    left: list[Any] = []
    blocks = [area]
    while blocks:
        block = blocks.pop()
        if block.is_empty or block.area == 0:
            continue
        low_x, low_y, high_x, high_y = block.bounds
        box = shapely.box(low_x, low_y, high_x, high_y)
        near = tree.query(box, predicate="intersects")
        if len(near) and shapely.covers(shapes[near], box).any():
            continue
        if len(near) > _FEW and max(high_x - low_x, high_y - low_y) > _SMALLEST * footprint:
            blocks += _halves(block)
        else:
            # Without a grid, GEOS 3.13 would lose whole footprints if many footprints have almost
            # equal sides.
            seen = shapely.union_all(shapes[near], grid_size=_GRID)
            left.append(shapely.difference(block, seen, grid_size=_GRID))
    return shapely.union_all([shape for shape in left if shape.area > 0])


def _without_slivers(shape: Any) -> Any:
    """Remove parts narrower than `TOUCH` from a shape. Rounding errors leave narrow parts between
    footprints.
    """
    import shapely

    parts = shapely.get_parts(shape)
    wide = 2 * shapely.area(parts) > TOUCH * shapely.length(parts)
    return shape if wide.all() else shapely.union_all(parts[wide])


def _halves(block: Any) -> list[Any]:
    import shapely

    low, high = np.reshape(block.bounds, (2, 2))
    first, second, axis = high.copy(), low.copy(), int(high[0] - low[0] <= high[1] - low[1])
    first[axis] = second[axis] = (low[axis] + high[axis]) / 2
    boxes = [shapely.box(*low, *first), shapely.box(*second, *high)]
    # Cuts along a border leave lines, and the library GEOS cannot subtract from lines.
    return [polygons_in(half) for half in shapely.intersection(block, boxes)]


def check_footprints(
    footprint: ArrayLike, robots: int, *, what: str = "robot"
) -> NDArray[np.float64]:
    """Check one footprint for all robots, or one for each robot, in metres. Return each robot's
    footprint, shape (robots,).

    Raises
    ------
    InvalidInputError
    """
    try:
        given = np.asarray(footprint, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        given = np.full(1, np.nan)
    if (
        not given.size
        or not (np.isfinite(given) & (given > 0)).all()
        or isinstance(footprint, bool)
    ):
        raise InvalidInputError(
            f"footprint: expected a length above 0 in metres, got {footprint!r:.200}"
        )
    if given.shape not in ((), (robots,)):
        raise InvalidInputError(
            f"footprint: expected one length, or {robots}, one per {what}, got {np.size(given)}"
        )
    return np.broadcast_to(given, (robots,)).astype(np.float64)
