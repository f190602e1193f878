"""Creation of a region in metres from a name, from a file, or from polygons in Python."""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from shoal.core.checks import check_array, check_choice
from shoal.core.errors import InvalidInputError, UnknownNameError, errors_at
from shoal.core.geometry import unit_vectors
from shoal.search.regions.formats import read_outlines
from shoal.search.regions.formats.reading import HIDDEN, Reading
from shoal.search.regions.outline import (
    Points,
    RegionOutline,
    RegionOutlines,
    Ring,
    check_degrees,
    check_metres,
    check_overlaps,
    check_polygon,
    check_polygons,
    polygon_outlines,
    text_of,
)
from shoal.search.regions.projection import REACH, LocalFrame
from shoal.search.regions.region import SearchRegion, polygons_in, region_of, unite

INNER = ("no-go", "search")
"""Possible meanings of a polygon inside another polygon if the file does not mark the inner
polygon.
"""


_CORNERS = 360  # corners of the polygon that approximates a circle


def open_region(
    source: str | os.PathLike[str] | ArrayLike,
    *,
    holes: Any = None,
    geographic: bool = False,
    name: str | None = None,
    no_go: Any = None,
    layer: str | None = None,
    inner: str | None = None,
    hidden: str | None = None,
    closed_lines: bool = False,
) -> SearchRegion:
    """Return the region that a name, a file or polygons describe.

    Parameters
    ----------
    source : str, path, array_like or Shapely polygon
        The region as a name, the path of a file, an array of corners of shape (n, 2), a Shapely
        polygon, or a sequence of polygons. The regions ``square:SIDE``, ``rectangle:WIDTHxHEIGHT``
        and ``box:WIDTHxDEPTHxHEIGHT`` (a volume), with sizes in metres, have their lower left
        corner at the origin. The regions ``circle:RADIUS`` and ``ring:OUTERxINNER``, with radii in
        metres, are centred on the origin. Files are in degrees, or in a projection that the file
        names; files with the suffix ``.csv`` are in metres or degrees. The formats are listed in
        `shoal.search.regions.formats`.
    holes : optional
        Holes of polygons given in Python: the corners of one hole, or a sequence of holes. Each
        hole must lie in a polygon.
    geographic : bool
        Whether coordinates of polygons given in Python are longitude and latitude in degrees. If
        false, coordinates are in metres.
    name : str, optional
        Name of the region. By default, the region has the name of its source, or "polygon" for
        polygons given in Python.
    no_go : optional
        No-go zones in the unit of the region (degrees or metres): a region file, points of shape
        (n, 2), a Shapely polygon, or a sequence of zones. The file of the region itself may also
        contain no-go zones.
    layer : str, optional
        Name of the layer to read from a GeoPackage. A GeoPackage with several layers requires a
        layer name. For a plan of QGroundControl, "survey" or "fence".
    inner : "no-go" or "search", optional
        Meaning of a polygon that lies mostly inside another polygon and is not marked as a no-go
        zone. By default, the function refuses a file with an unmarked inner polygon.
    hidden : "use" or "skip", optional
        Meaning of the polygons that a KML file hides (visibility 0). By default, the function
        refuses a file with a hidden polygon.
    closed_lines : bool
        Whether closed lines in files are polygons.

    Returns
    -------
    SearchRegion
        The region, whose sides are straight in the local frame in metres, and therefore slightly
        bent in degrees.

    Raises
    ------
    InvalidInputError, UnknownNameError
        If the source is unknown or invalid. The error message names the place of the mistake.

    Examples
    --------
    >>> open_region("rectangle:200x100")
    <SearchRegion 'rectangle:200x100': 20000 m2, 1 parts, 0 holes>
    >>> open_region([(0, 0), (40, 0), (40, 30)], holes=[(30, 10), (35, 10), (35, 12)])
    <SearchRegion 'polygon': 595 m2, 1 parts, 1 holes>
    >>> open_region("square:100", no_go=[(20, 20), (40, 20), (40, 40)]).area_m2
    9800.0
    """
    extra = list_of(no_go)
    if inner is not None:
        check_choice(inner, what="--inner", choices=INNER)
    if hidden is not None:
        check_choice(hidden, what="--hidden", choices=HIDDEN)
    reading = Reading(layer=layer, hidden=hidden, closed_lines=closed_lines)
    if not isinstance(source, str | os.PathLike):
        _check_no_layer(layer, "polygons")
        drawn = _outlines_of(source, list_of(holes), geographic=geographic)
        return build_region(drawn, extra, name=name or "polygon", inner=inner, reading=reading)
    if holes is not None or geographic:
        raise InvalidInputError(
            f"region: expected polygons together with holes or geographic, got {source!r}, which"
            " contains these values"
        )
    text = os.fspath(source)
    if not isinstance(text, str):
        raise InvalidInputError(f"region: expected a name or the path of a file, got {source!r}")
    if is_builtin(text) and not os.path.exists(text):
        _check_no_layer(layer, f"the region {text!r}")
        outlines_of_name = builtin_region(text)
        return build_region(
            outlines_of_name, extra, name=name or text, inner=inner, reading=reading
        )
    outlines = read_outlines(text, reading)
    stem = os.path.splitext(os.path.basename(text))[0].encode("utf-8", "replace").decode()
    return build_region(outlines, extra, name=name or stem, inner=inner, reading=reading)


def _check_no_layer(layer: str | None, source: str) -> None:
    if layer is not None:
        raise InvalidInputError(
            f"--layer: expected a GeoPackage or a plan of QGroundControl, got {layer!r} with"
            f" {source}"
        )


def _outlines_of(source: Any, holes: Sequence[Any], *, geographic: bool) -> RegionOutlines:
    """Return polygons with holes from their corners, or from Shapely polygons."""
    import shapely

    several = list_of(source)
    parts = [
        outline
        for k, part in enumerate(several)
        for outline in _rings(part, f"polygon {k + 1}" if len(several) > 1 else "polygon")
    ]
    for k, hole in enumerate(holes):
        (ring,) = (outline.shell for outline in _rings(hole, f"hole {k + 1}"))
        inner = check_polygon(RegionOutline(ring), closed=False)
        around = [check_polygon(part, closed=False).covers(inner) for part in parts]
        if not any(around):
            raise InvalidInputError(
                f"hole {k + 1}: expected a hole inside a polygon, got a hole outside,"
                f" {shapely.to_wkt(inner)[:80]}"
            )
        part = parts[around.index(True)]
        parts[around.index(True)] = replace(part, holes=(*part.holes, ring))
    return RegionOutlines(tuple(parts), "region", geographic, closed=False)


def build_region(
    source: RegionOutlines,
    extra: Sequence[Any],
    *,
    name: str,
    inner: str | None = None,
    reading: Reading | None = None,
) -> SearchRegion:
    """Return the region that outlines describe. The area of the region does not contain its no-go
    zones.

    Parameters
    ----------
    source : RegionOutlines
        The outlines of the region. Some outlines may be marked as no-go zones.
    extra : sequence
        No-go zones besides those in ``source``, in the unit of the outlines: files, Shapely
        polygons, or points of shape (n, 2).
    name : str
        Name of the region.
    inner
        The argument ``inner`` of `open_region`.
    reading : Reading, optional
        How to read files of no-go zones. A choice without an effect on the region and the zones is
        refused.
    """
    import shapely

    searched = [outline for outline in source.outlines if not outline.no_go]
    if not searched:
        raise InvalidInputError(
            f"{source.where}: expected a polygon to search, got only no-go zones"
        )
    zones = [outline for outline in source.outlines if outline.no_go]
    reading = reading or Reading()
    beside = [
        outline
        for k, zone in enumerate(extra)
        for outline in _zone(zone, f"no-go zone {k + 1}", source, reading)
    ]
    reading.check_effects(
        [source.where, *(str(zone) for zone in extra if isinstance(zone, str | os.PathLike))]
    )
    frame: LocalFrame | None = None
    if source.geographic:
        for ring in (ring for outline in (*searched, *zones, *beside) for ring in outline.rings):
            check_degrees(ring)
        frame = _frame(searched, source.where)
    search_polygons = _polygons(searched, frame, closed=source.closed)
    zone_polygons = _polygons(zones, frame, closed=source.closed)
    zone_polygons += _polygons(beside, frame, closed=False)
    if frame is not None:  # all at once, because there may be thousands
        _check_reach(
            [
                ring
                for polygon_outline in (*searched, *zones, *beside)
                for ring in polygon_outline.rings
            ],
            frame,
        )
    zone_count = len(zone_polygons)
    different = _distinct(search_polygons)
    search_polygons, searched = (
        [search_polygons[k] for k in different],
        [searched[k] for k in different],
    )
    zone_polygons = [zone_polygons[k] for k in _distinct(zone_polygons)]
    check_overlaps([*search_polygons, *zone_polygons], source.where)
    inside = _inside_others(search_polygons, searched, refused=inner is None)
    if inner is not None and not inside:
        raise InvalidInputError(
            "--inner: expected a polygon without a mark inside another polygon, got none in"
            f" {source.where}"
        )
    if inner != "search":
        zone_polygons += [polygon for k, polygon in enumerate(search_polygons) if k in inside]
        zone_count += len(inside)
        search_polygons = [polygon for k, polygon in enumerate(search_polygons) if k not in inside]
    no_go = polygons_in(unite(zone_polygons)) if zone_polygons else None
    with errors_at(source.where):
        whole = polygons_in(shapely.union_all(search_polygons))
        region = region_of(whole, frame=frame, no_go=no_go, name=name, no_go_zones=zone_count)
        return replace(region, height=source.height)


def _distinct(polygons: list[Any]) -> list[int]:
    """Return the indices of the polygons, each without the polygons that are equal to it."""
    import shapely

    first: dict[bytes, int] = {}
    for k, text in enumerate(shapely.to_wkb(shapely.normalize(polygons)) if polygons else ()):
        first.setdefault(text, k)
    return list(first.values())


def _polygons(
    outlines: Sequence[RegionOutline], frame: LocalFrame | None, *, closed: bool
) -> list[Any]:
    """Return the valid Shapely polygons in metres that outlines describe."""
    import shapely

    if frame is None:
        for ring in (ring for outline in outlines for ring in outline.rings):
            check_metres(ring)
    polygons = check_polygons(outlines, closed=closed)
    if frame is None:
        return polygons
    flat = shapely.transform(np.array(polygons, dtype=object), frame.to_metres)
    # A vertex that lies on a side in degrees may lie slightly outside this side in metres.
    bent = ~shapely.is_valid(flat)
    flat[bent] = shapely.buffer(flat[bent], 0)
    return list(flat)


def _inside_others(
    polygons: list[Any], outlines: list[RegionOutline], *, refused: bool
) -> set[int]:
    """Return the indices of the polygons that lie mostly inside another polygon. A polygon is not
    inside an equal polygon.
    """
    import shapely

    inside: set[int] = set()
    for k, other in shapely.STRtree(polygons).query(polygons, predicate="intersects").T.tolist():
        polygon, around = polygons[k], polygons[other]
        if k == other or polygon.area > around.area or polygon.equals(around):
            continue
        if polygon.intersection(around).area > polygon.area / 2:
            inside.add(k)
            if refused:
                raise InvalidInputError(
                    f"{outlines[k].shell.where}: expected a mark that states whether this polygon,"
                    " which lies in another polygon, is a no-go zone or a part to search, got"
                    " none; choose with --inner no-go or --inner search"
                )
    return inside


def _frame(searched: list[RegionOutline], where: str) -> LocalFrame:
    points: Points = np.vstack([outline.shell.points for outline in searched])
    # the check of each ring reports coordinates that are not finite
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) == 0:
        raise InvalidInputError(f"{where}: expected a region with vertices, got an empty one")
    west, east = float(points[:, 0].min()), float(points[:, 0].max())
    if east - west > 180:
        raise InvalidInputError(
            f"{where}: expected a region that does not cross the 180° meridian, got longitudes from"
            f" {west:g} to {east:g}"
        )
    frame = LocalFrame.around(points)
    _check_reach([outline.shell for outline in searched], frame)
    return frame


def _check_reach(rings: list[Ring], frame: LocalFrame) -> None:
    from pyproj import Geod

    if not rings:
        return
    points = np.vstack([ring.points for ring in rings])
    origin = np.broadcast_to([frame.longitude, frame.latitude], points.shape)
    near = np.nan_to_num(Geod(ellps="WGS84").inv(*origin.T, *points.T)[2]) <= REACH
    if near.all():
        return
    middle = text_of([frame.longitude, frame.latitude])
    for ring, its in zip(
        rings, np.split(near, np.cumsum([len(ring.points) for ring in rings])[:-1]), strict=True
    ):
        ring.check_vertices(
            its,
            f"a region within {REACH / 1000:g} km of its middle {middle}",
            "; search each part separately",
        )


def _zone(zone: Any, what: str, source: RegionOutlines, reading: Reading) -> list[RegionOutline]:
    """Return the outlines of a no-go zone that the user gives in addition to the region, in the
    unit of the region.
    """
    if isinstance(zone, str | os.PathLike):
        read = read_outlines(zone, reading, zones=True)
        if read.geographic != source.geographic:
            units = ["metres", "degrees"]
            raise InvalidInputError(
                f"{read.where}: expected no-go zones in {units[source.geographic]}, as the region"
                f" has, got {units[read.geographic]}"
            )
        return list(read.outlines)
    return [replace(outline, no_go=True) for outline in _rings(zone, what, "a file, ")]


def _rings(polygon: Any, what: str, also: str = "") -> list[RegionOutline]:
    """Return the outlines of a Shapely geometry, or the outline of a polygon given by
    its corners.
    """
    if hasattr(polygon, "geom_type"):
        outlines = polygon_outlines(polygon, what)
        if not outlines:
            raise InvalidInputError(f"{what}: expected a polygon, got {polygon.geom_type}")
        return outlines
    expected = f"{what}: expected {also}a Shapely polygon or points of shape (n, 2)"
    points = check_array(polygon, expected=expected).astype(np.float64)
    if points.ndim != 2 or points.shape[1] != 2:
        raise InvalidInputError(f"{expected}, got {str(polygon)[:80]}")
    return [RegionOutline(Ring(points, what))]


def list_of(polygons: Any) -> list[Any]:
    """Return one or several polygons as a list. Each polygon is a file, a Shapely geometry or an
    array of points.
    """
    if polygons is None:
        return []
    alone = (
        isinstance(polygons, str | os.PathLike)
        or not isinstance(polygons, Sequence | np.ndarray)
        or getattr(polygons, "ndim", 1) == 0
    )
    if not alone:
        try:
            alone = np.asarray(polygons, dtype=np.float64).ndim == 2
        except (TypeError, ValueError, OverflowError):
            alone = False
    return [polygons] if alone else list(polygons)


Shape = Callable[[str, list[float]], list[Points]]


def builtin_region(text: str) -> RegionOutlines:
    """Return the outline of a built-in region from its name with sizes, such as ``square:100``; see
    `shoal.search.open_region`.
    """
    name, _, option = text.partition(":")
    if name not in SHAPES:
        near = difflib.get_close_matches(name, SHAPES, n=1, cutoff=0.5)
        guess = f"did you mean {near[0]!r}? " if near else ""
        shape_name = ", ".join(f"{shape_name}:{form}" for shape_name, (form, _) in SHAPES.items())
        raise UnknownNameError(
            f"unknown region {text[:80]!r}: {guess}(known: {shape_name}, or a file)"
        )
    form, shape = SHAPES[name]
    numbers = option.lower().removesuffix("m").split("x")
    expected = f"{name}:{form}"
    try:
        sizes = [float(part) for part in numbers]
    except ValueError:
        sizes = []
    if len(sizes) != form.count("x") + 1 or not all(0 < size <= 1e6 for size in sizes):
        raise InvalidInputError(
            f"region {text[:80]!r}: expected {expected} with lengths in metres, above 0 and at most"
            f" 1000000, got {option!r}"
        )
    rings = [
        Ring(np.vstack([points, points[:1]]), f"region {text!r}") for points in shape(text, sizes)
    ]
    height = sizes[2] if name == "box" else 0.0
    return RegionOutlines(
        (RegionOutline(rings[0], tuple(rings[1:])),),
        f"region {text!r}",
        geographic=False,
        height=height,
    )


def is_builtin(text: str) -> bool:
    """Return whether a text has the form of a built-in region's name, such as ``square:100``, and
    therefore names no file.
    """
    return re.fullmatch(r"\w+(:[\w.+-]*)?", text) is not None and not re.search(
        r"\.[A-Za-z]\w*$", text
    )


def _rectangle(width: float, height: float) -> list[Points]:
    return [np.array([(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)])]


def _circle(radius: float) -> Points:
    angles = 2 * np.pi * np.arange(_CORNERS) / _CORNERS
    return radius * unit_vectors(angles)


def _annulus(text: str, sizes: list[float]) -> list[Points]:
    if not sizes[1] < sizes[0]:
        raise InvalidInputError(
            f"region {text!r}: expected an inner radius below the outer one, {sizes[0]:g}, got"
            f" {sizes[1]:g}"
        )
    return [_circle(sizes[0]), _circle(sizes[1])]


SHAPES: dict[str, tuple[str, Shape]] = {
    "square": ("SIDE", lambda _, sizes: _rectangle(sizes[0], sizes[0])),
    "rectangle": ("WIDTHxHEIGHT", lambda _, sizes: _rectangle(*sizes)),
    "circle": ("RADIUS", lambda _, sizes: [_circle(sizes[0])]),
    "ring": ("OUTERxINNER", _annulus),
    "box": ("WIDTHxDEPTHxHEIGHT", lambda _, sizes: _rectangle(*sizes[:2])),
}
