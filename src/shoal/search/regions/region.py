"""Regions: areas to search with their holes, no-go zones and margins."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_integer, check_kind, check_text, fault_place
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.regions.border import Border
from shoal.search.regions.outline import FARTHEST, Points, check_plane_points, text_of
from shoal.search.regions.projection import LocalFrame

MOST_LAYERS = 1000
"""Maximum number of layers of a volume."""


TOUCH = 1e-6  # metres: tolerance for points inside the region
_HAIRLINE = 5e-5  # relative to the square root of an area, of which tracks have seen all else
_SLIVER = 1e-3  # metres: narrower parts are rounding, as no position is known so well


def _without_hairlines(shape: Any, whole: Any) -> Any:
    """Return the polygons of a part of an area without those that are narrower than what the rounding
    of tracks in files leaves between what they saw.
    """
    import shapely

    parts = shapely.get_parts(polygons_in(shape))
    width = _HAIRLINE * float(whole.area) ** 0.5
    return shapely.multipolygons(parts[~shapely.is_empty(shapely.buffer(parts, -width / 2))])


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
    looks : tuple of shapely Polygon or MultiPolygon
        What was seen along each of several earlier tracks. Robots may be there.
    again : bool
        Whether robots must see it again, because those who looked may have missed something.
        Otherwise, ``area`` does not contain it.
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
    looks: tuple[Any, ...] = ()
    again: bool = False

    def __post_init__(self) -> None:
        for name in ("free", "outline"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, self.area)
        if self.searched is not None:
            unsearched = _without_hairlines(self.area.difference(self.searched), self.area)
            if unsearched.is_empty:
                raise InvalidInputError(
                    f"region {self.name!r}: expected a part that was not searched yet, got tracks"
                    " that saw all of it"
                )
            object.__setattr__(self, "area", unsearched)

    @cached_property
    def searched(self) -> Any:
        """What robots need not see again, as one Shapely geometry; None if nothing was seen before,
        or if they must see it again.
        """
        import shapely

        return shapely.union_all(self.looks) if self.looks and not self.again else None

    @property
    def area_m2(self) -> float:
        """Size of the area that robots must see, in square metres."""
        return float(self.area.area)

    @property
    def unseen_m2(self) -> float:
        """Size of the area that robots cannot see while they keep the margin, in square metres."""
        wanted_area = (
            self.outline if self.searched is None else self.outline.difference(self.searched)
        )
        return max(0.0, float(wanted_area.area - self.area.area))

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
        """Whether robots may not be everywhere in the area, or elsewhere too: they keep a margin,
        avoid the exclusion polygons of a fence, or cross what was searched before.
        """
        return self.margin > 0 or bool(self.barriers) or self.searched is not None

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
    def for_paths(self) -> dict[Any, Any]:
        """Cache of what depends on where robots may be alone. A region of which robots see less
        shares it.
        """
        return {}

    @property
    def border(self) -> Border:
        """The border of `reach`.

        A segment that starts inside the region and does not meet the border of `reach` lies inside
        the region.
        """
        if "border" not in self.for_paths:
            self.for_paths["border"] = Border(self.reach)
        border: Border = self.for_paths["border"]
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

    check_text(name, what="name")
    if frame is not None:
        check_kind(frame, LocalFrame, what="frame")
    if no_go_zones is not None:
        check_integer(no_go_zones, what="no_go_zones", least=0)
    whole = _only_polygons(area, what=name)
    zones = (
        _only_polygons(no_go, what=f"{name}: no-go zones")
        if no_go is not None
        else shapely.Polygon()
    )
    free = whole if zones.is_empty else _without_slivers(polygons_in(whole.difference(zones)))
    if free.is_empty or not free.area > 0:
        actual = "an empty one" if zones.is_empty else "one that the no-go zones cover wholly"
        raise InvalidInputError(f"{name}: expected a region with an area to search, got {actual}")
    zone_count = len(shapely.get_parts(zones)) if no_go_zones is None else no_go_zones
    return SearchRegion(free, frame, zones, name, zone_count)


def _without_slivers(free: Any) -> Any:
    """Return an area without the parts that are mere rounding, as between a border of the region
    and a no-go zone that is drawn along it.
    """
    import shapely

    parts = shapely.get_parts(free)
    wide = shapely.area(parts) > _SLIVER * shapely.length(parts) / 2  # the mean width of a strip
    return free if wide.all() else polygons_in(shapely.union_all(parts[wide]))


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
        actual = text_of(points[int(np.argmin((np.abs(points) <= FARTHEST).all(axis=1)))])
        raise InvalidInputError(
            f"{what}: expected coordinates of at most {FARTHEST:g} m, got {actual}"
        )
    parts = shapely.get_parts(shapely.force_2d(shape))
    for index, part in enumerate(parts):
        if not part.is_valid:
            explanation = explain_validity(part)
            raise InvalidInputError(
                f"{what}: expected a valid polygon, got"
                f" {explanation.partition('[')[0].lower()}{fault_place(part)} in part"
                f" {index + 1}"
            )
    return (
        polygons_in(unite(parts))
        if len(parts) > 1
        else parts[0]
        if len(parts)
        else shapely.Polygon()
    )


def unite(polygons: Any) -> Any:
    """Return the union of valid Shapely polygons. Thousands that do not overlap are only put
    together.
    """
    import shapely

    together = shapely.multipolygons(polygons)
    return together if shapely.is_valid(together) else shapely.union_all(polygons)


def polygons_in(shape: Any) -> Any:
    """Return the polygons in a Shapely geometry, without lines, points, and polygons that are as
    small as rounding errors.
    """
    import shapely

    parts = [part for part in _flatten(shape) if part.geom_type == "Polygon" and part.area > 0]
    size = max(
        (float(np.ptp(np.reshape(part.bounds, (2, 2)), axis=0).max()) for part in parts),
        default=0.0,
    )
    substantial = [part for part in parts if part.area > 1e-15 * size * size]
    return substantial[0] if len(substantial) == 1 else shapely.MultiPolygon(substantial)


def _flatten(shape: Any) -> list[Any]:
    import shapely

    parts = shapely.get_parts(shape)
    return [
        leaf for part in parts for leaf in (_flatten(part) if hasattr(part, "geoms") else [part])
    ]
