"""The region to search: a polygon or several, with holes, in metres."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.regions.outline_checks import FARTHEST, Points, check_plane_points, place_of, text_of
from shoal.search.regions.projection import LocalFrame

MOST_LAYERS = 1000
"""Of a volume."""

TOUCH = 1e-6  # metres: who is nearer to the region than this is in it


@dataclass(frozen=True, eq=False)
class SearchRegion:
    """A region to search: its area, holes and no-go zones. Made by `open_region` and `region_of`.

    Parameters
    ----------
    area : shapely Polygon or MultiPolygon
        What is to be seen. Valid, x east and y north in metres; no-go zones are taken out of it already, and what cannot be seen
        with a margin (`shoal.search.regions.margin`). Its border belongs to it.
    frame : LocalFrame or None
        Where on Earth the metres are; None for plain metres.
    no_go : shapely Polygon or MultiPolygon
        The zones that were taken out; empty if there are none.
    name : str
    no_go_zones : int
        How many zones were given, some of which may overlap or lie outside.
    margin : float
        How far robots keep from the border, metres.
    free : shapely Polygon or MultiPolygon, optional
        Where robots may be; the area if not given.
    outline : shapely Polygon or MultiPolygon, optional
        The whole region, seen or not, less no-go zones; the area if not given.
    height : float
        How high the volume is whose ground the region is, metres; 0 for a plane.
    bends : shapely Polygon or MultiPolygon, optional
        A shape of fewer corners inside of ``free``, at which ways bend where they can.
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

    def __post_init__(self) -> None:
        for name in ("free", "outline"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, self.area)

    @property
    def area_m2(self) -> float:
        """Square metres to be searched."""
        return float(self.area.area)

    @property
    def unseen_m2(self) -> float:
        """Square metres of the region that no robot sees that keeps the margin."""
        return max(0.0, float(self.outline.area - self.area.area))

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Least x, least y, largest x, largest y, in metres."""
        left, low, right, high = self.area.bounds
        return float(left), float(low), float(right), float(high)

    @cached_property
    def parts(self) -> tuple[Any, ...]:
        """The polygons in which robots may be: none comes from one to another inside. Largest first."""
        import shapely

        pieces = shapely.get_parts(self.free)
        return tuple(sorted(pieces, key=lambda part: (-part.area, part.bounds)))

    @cached_property
    def reach(self) -> Any:
        """Where robots may be, grown by half of `TOUCH` against rounding, prepared: points and lines are tested against it."""
        import shapely

        grown = self.free.buffer(TOUCH / 2, join_style="mitre")
        shapely.prepare(grown)
        return grown

    @cached_property
    def border(self) -> Any:
        """The border of `reach`, prepared: a segment from inside that does not meet it stays inside."""
        import shapely

        border = shapely.boundary(self.reach)
        shapely.prepare(border)
        return border

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Tell for each point whether it lies inside or on the border, within `TOUCH`; bool, shape (n,)."""
        import shapely

        array = check_plane_points(points, what="points")
        return np.asarray(shapely.intersects_xy(self.reach, array[:, 0], array[:, 1]))

    def check_inside(self, points: ArrayLike, *, what: str = "start") -> Points:
        """Return points as float64, shape (n, 2).

        Raises
        ------
        InvalidInputError
            If one lies outside the region, with its coordinates and how far it is.
        """
        array = check_plane_points(points, what=what)
        outside = ~self.contains(array)
        if outside.any():
            import shapely

            index = int(np.argmax(outside))
            away = float(shapely.distance(self.free, shapely.points(array[index])))
            degrees = ""
            if self.frame is not None and np.hypot(*array[index]) < 1e5:
                degrees = f" (longitude and latitude {text_of(self.frame.to_degrees(array[index : index + 1])[0])})"
            raise InvalidInputError(
                f"{what}: expected points inside the region {self.name!r}{self.margin_text}, got {text_of(array[index])} m"
                f"{degrees} at point {index + 1}, {away:.3g} m outside"
            )
        return array

    def layer_altitudes(self, footprint: float) -> tuple[float, ...]:
        """Return the middles of the layers, no thicker than a footprint, into which a volume is cut; metres, rising.

        Examples
        --------
        >>> from shoal.search import open_region
        >>> open_region("box:20x20x25").layer_altitudes(10.0)
        (4.166666666666667, 12.5, 20.833333333333336)
        """
        count = max(1, int(np.ceil(self.height / footprint * (1 - 1e-9))))
        if count > MOST_LAYERS:
            raise InvalidInputError(
                f"region {self.name!r}: expected at most {MOST_LAYERS} layers, a footprint of {footprint:g} m thick, got {count}"
            )
        return tuple(self.height / count * (number + 0.5) for number in range(count))

    @property
    def margin_text(self) -> str:
        """The margin, as a sentence about the region goes on; nothing without one."""
        return f" with a margin of {self.margin:g} m" if self.margin else ""

    def __repr__(self) -> str:
        holes = sum(len(part.interiors) for part in self.parts)
        zones = f", {self.no_go_zones} no-go zones" if self.no_go_zones else ""
        return f"<SearchRegion {self.name!r}: {self.area_m2:.10g} m2, {len(self.parts)} parts, {holes} holes{zones}>"


def region_of(
    area: Any, *, frame: LocalFrame | None = None, no_go: Any = None, name: str = "region", no_go_zones: int | None = None
) -> SearchRegion:
    """Return the region of a Shapely polygon in metres, without its no-go zones.

    Parameters
    ----------
    area : shapely Polygon or MultiPolygon
        Parts that overlap are taken together.
    frame : LocalFrame, optional
        Where on Earth it is.
    no_go : shapely Polygon or MultiPolygon, optional
        In the same metres; zones may overlap each other and reach outside.
    name : str
    no_go_zones : int, optional
        How many zones there are; by default the parts of ``no_go``.

    Raises
    ------
    InvalidInputError
        If there is no polygon, it is not valid, or nothing is left of it.

    Examples
    --------
    >>> import shapely
    >>> region_of(shapely.box(0, 0, 20, 10), no_go=shapely.box(5, 5, 10, 8))
    <SearchRegion 'region': 185 m2, 1 parts, 1 holes, 1 no-go zones>
    """
    import shapely

    whole = _only_polygons(area, what=name)
    zones = _only_polygons(no_go, what=f"{name}: no-go zones") if no_go is not None else shapely.Polygon()
    free = whole if zones.is_empty else polygons_in(whole.difference(zones))
    if free.is_empty or not free.area > 0:
        got = "an empty one" if zones.is_empty else "one that the no-go zones cover wholly"
        raise InvalidInputError(f"{name}: expected a region with an area to search, got {got}")
    given = len(shapely.get_parts(zones)) if no_go_zones is None else no_go_zones
    return SearchRegion(free, frame, zones, name, given)


def _only_polygons(shape: Any, *, what: str) -> Any:
    """Return a Shapely polygon or several as one valid shape with no overlaps."""
    import shapely
    from shapely.validation import explain_validity

    if not isinstance(shape, shapely.Polygon | shapely.MultiPolygon):
        raise InvalidInputError(f"{what}: expected a Shapely Polygon or MultiPolygon, got {type(shape).__name__}")
    points = shapely.get_coordinates(shape)
    if not (np.abs(points) <= FARTHEST).all():
        got = text_of(points[int(np.argmin((np.abs(points) <= FARTHEST).all(axis=1)))])
        raise InvalidInputError(f"{what}: expected coordinates of at most {FARTHEST:g} m, got {got}")
    parts = shapely.get_parts(shapely.force_2d(shape))
    for index, part in enumerate(parts):
        if not part.is_valid:
            said = explain_validity(part)
            raise InvalidInputError(
                f"{what}: expected a valid polygon, got {said.partition('[')[0].lower()}{place_of(said)} in part {index + 1}"
            )
    return polygons_in(shapely.union_all(parts)) if len(parts) > 1 else parts[0] if len(parts) else shapely.Polygon()


def polygons_in(shape: Any) -> Any:
    """Return a shape without the lines and points that an overlay may leave in it, and without parts below rounding."""
    import shapely

    parts = [part for part in _flattened(shape) if part.geom_type == "Polygon" and part.area > 0]
    size = max((float(np.ptp(np.reshape(part.bounds, (2, 2)), axis=0).max()) for part in parts), default=0.0)
    kept = [part for part in parts if part.area > 1e-15 * size * size]
    return kept[0] if len(kept) == 1 else shapely.MultiPolygon(kept)


def _flattened(shape: Any) -> list[Any]:
    import shapely

    parts = shapely.get_parts(shape)
    return [piece for part in parts for piece in (_flattened(part) if hasattr(part, "geoms") else [part])]
