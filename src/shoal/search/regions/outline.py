"""Outlines of regions: limits of what is read, and checks."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_array, check_file, check_points, fault_place
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.geometry import segments_of, step_lengths

LARGEST_FILE = 20_000_000
"""Maximum size in bytes of a region file, and of each file unpacked from a zip archive."""

LARGEST_DATABASE = 2_000_000_000
"""Maximum size of a GeoPackage in bytes. A GeoPackage may be larger than other files, because Shoal
reads only some layers.
"""

MOST_CORNERS = 200_000
"""Maximum number of corners of all polygons in a file."""

MOST_POLYGONS = 10_000
"""Maximum number of polygons in a file, or of rings in a CSV file."""

MOST_PAIRS = 200_000
"""Maximum number of pairs of polygons that meet, and of pairs of rings with overlapping bounding
boxes in a CSV file.
"""

MOST_CROSSINGS = 2_000_000
"""Maximum number of pairs of sides of two polygons whose bounding boxes overlap, and which may
therefore cross.
"""

MOST_CONTACTS = 40_000_000
"""Maximum number of pairs of sides of one ring whose bounding boxes overlap."""

MOST_CUTS = 50_000
"""Maximum number of long sides of a region, times the length of its border in cells for each cell
of area.
"""

# exceptions that reading a damaged archive can raise
_FAULTS = (
    zipfile.BadZipFile,
    zipfile.LargeZipFile,
    NotImplementedError,
    RuntimeError,
    EOFError,
    ValueError,
    zlib.error,
)


@contextmanager
def open_zip(path: Path, *, what: str) -> Iterator[zipfile.ZipFile]:
    """Open a zip archive for reading. The argument ``what`` is the name of the archive in error
    messages.

    Raises
    ------
    InvalidInputError
        If the archive is missing, too large or damaged. For a damaged archive, the error may occur
        only when the caller reads a file from the archive.
    """
    check_file(path, what="region file", most=LARGEST_FILE)
    try:
        with zipfile.ZipFile(path) as archive:
            yield archive
    except InvalidInputError:
        raise
    except _FAULTS as error:
        raise InvalidInputError(
            f"{path}: expected a {what}, got a damaged one or another format: {str(error)[:80]}"
        ) from None


def check_count(count: int, most: int, *, where: str, what: str) -> None:
    """Refuse a file with more than ``most`` items. Error messages name the file ``where`` and the
    items ``what``.
    """
    if count > most:
        raise InvalidInputError(f"{where}: expected at most {most} {what}, got {count}")


Points = NDArray[np.float64]

_FLAT = 1e-12  # minimum area of a ring with an interior, divided by the squared size of the ring
_POLE = 89.9  # degrees of latitude: nearer to a pole, the direction of east varies within a region
_SMALL = 1000  # vertices of a ring that is checked together with others
_FEW = 100_000  # pairs of sides that need no count
# metres: for larger coordinates, a float64 cannot distinguish points that are a micrometre apart
FARTHEST = 1e9


@dataclass(frozen=True, eq=False)
class Ring:
    """A closed line: the outer border of a polygon, or the border of a hole in it.

    Parameters
    ----------
    points : ndarray of float64, shape (n, 2)
        Points of the ring as in the file: (x, y) in metres or (longitude, latitude) in degrees.
    where : str
        Name of the file, and place of the ring in the file, for error messages.
    lines : ndarray of int64, shape (n,), optional
        Line number of each vertex in the file.
    no_go : bool
        Whether the file marks the ring as a no-go zone.
    """

    points: Points
    where: str
    lines: NDArray[np.int64] | None = None
    no_go: bool = False

    def vertex(self, index: int) -> str:
        """Return a text for error messages with the place of a vertex in the file. The first vertex
        has the index 0.
        """
        return (
            f"{self.where}, vertex {index + 1}"
            if self.lines is None
            else f"{self.where}, line {self.lines[index]}"
        )

    def check_vertices(self, right: ArrayLike, expected: str, note: str = "") -> None:
        """Raise an error with the texts ``expected`` and ``note`` for the first vertex whose entry
        in ``right`` is false.
        """
        if not np.all(right):
            index = int(np.argmin(right))
            raise InvalidInputError(
                f"{self.vertex(index)}: expected {expected}, got"
                f" {text_of(self.points[index])}{note}"
            )


@dataclass(frozen=True, eq=False)
class RegionOutline:
    """A polygon of a region before the checks: its outer ring, its holes, and whether the polygon
    is a no-go zone.
    """

    shell: Ring
    holes: tuple[Ring, ...] = ()
    no_go: bool = False

    @property
    def rings(self) -> tuple[Ring, ...]:
        """The outer ring of the polygon, followed by its holes."""
        return self.shell, *self.holes


def text_of(point: ArrayLike) -> str:
    """Return the coordinates of a point as a text for error messages.

    Examples
    --------
    >>> text_of([1.5, -2.0])
    '(1.5, -2)'
    """
    return "(" + ", ".join(f"{value:.10g}" for value in np.asarray(point, dtype=np.float64)) + ")"


def check_plane_points(points: Any, *, what: str) -> Points:
    """Check that points are finite, and return them as a float64 array of shape (n, 2). The list of
    points may be empty.
    """
    array = check_array(points, expected=f"{what}: expected points of 2 numbers")
    return check_points(
        array.reshape(0, 2) if array.shape == (0,) else array, what=what, dimensions=2
    )


def check_ring(ring: Ring, *, closed: bool = True) -> Points:
    """Check a ring, and return its vertices; float64, shape (n, 2).

    The result has no equal neighbouring vertices, and repeats the first vertex at the end.

    Parameters
    ----------
    ring : Ring
    closed : bool
        Whether the first vertex of the given ring must also be its last vertex.

    Raises
    ------
    InvalidInputError
        If a coordinate is not finite, or if the ring is open but must be closed, has fewer than 3
        different vertices, lies along one line, or crosses itself.
    """
    points = ring.points
    ring.check_vertices(np.isfinite(points).all(axis=1), "finite coordinates")
    if len(points) == 0:
        raise InvalidInputError(f"{ring.where}: expected a ring of vertices, got an empty one")
    if closed and (points[0] != points[-1]).any():
        raise InvalidInputError(
            f"{ring.vertex(len(points) - 1)}: expected a closed ring, which ends where it begins,"
            f" at {text_of(points[0])}, got {text_of(points[-1])}"
        )
    different = len(set(map(tuple, points.tolist())))  # np.unique would import masked arrays
    if different < 3:
        raise InvalidInputError(
            f"{ring.where}: expected a ring of 3 different vertices or more, got {different}"
        )
    distinct = points[np.any(points != np.roll(points, 1, axis=0), axis=1)]
    _check_shape(distinct, ring)
    return np.vstack([distinct, distinct[:1]])


def _check_shape(corners: Points, ring: Ring) -> None:
    from shapely import MultiPoint, Polygon

    size = float(np.ptp(corners, axis=0).max())
    alone = Polygon(corners)
    # the work of the next checks grows with the number of sides that are near each other
    if len(corners) ** 2 > MOST_CONTACTS:
        sides = _sides(alone, [-np.inf, -np.inf, np.inf, np.inf])
        if _meeting_sides(sides, sides, most=MOST_CONTACTS) > MOST_CONTACTS:
            raise InvalidInputError(
                f"{ring.where}: expected at most {MOST_CONTACTS} pairs of sides whose bounding"
                f" boxes overlap, got more, with {len(corners)} vertices; simplify the ring"
            )
    flat = MultiPoint(corners).convex_hull.area <= _FLAT * size * size
    if flat or (alone.is_valid and alone.area <= _FLAT * size * size):
        raise InvalidInputError(
            f"{ring.where}: expected a ring with an area inside, got {len(corners)} vertices on one"
            f" line, from {text_of(corners.min(axis=0))} to {text_of(corners.max(axis=0))}"
        )
    if not alone.is_valid:
        raise InvalidInputError(
            f"{ring.where}: expected a ring that does not cross or touch itself, got one that does"
            f"{fault_place(alone)}"
        )


def check_polygon(outline: RegionOutline, *, closed: bool = True) -> Any:
    """Check an outline, and return it as a valid Shapely polygon.

    Raises
    ------
    InvalidInputError
        If `check_ring` refuses a ring, or if a hole lies outside the outer ring, crosses another
        ring, or shares a side with another ring.
    """
    from shapely import Polygon, prepare
    from shapely.validation import explain_validity

    corners = [check_ring(ring, closed=closed) for ring in outline.rings]
    shell = Polygon(corners[0])
    holes = [Polygon(ring) for ring in corners[1:]]
    prepare(shell)
    for ring, hole in zip(outline.holes, holes, strict=True):
        if shell.covers(hole):
            continue
        apart = hole.difference(shell).representative_point()
        how = (
            "one that crosses it"
            if shell.intersects(hole) and shell.intersection(hole).area > 0
            else "one outside"
        )
        raise InvalidInputError(
            f"{ring.where}: expected a hole inside its outline, got {how}, at"
            f" {text_of(apart.coords[0])}"
        )
    whole = Polygon(corners[0], corners[1:])
    if not whole.is_valid:
        why = (
            "holes that leave the inside in one piece"
            if "disconnected" in explain_validity(whole)
            else "holes apart from the outline and each other"
        )
        raise InvalidInputError(
            f"{outline.shell.where}: expected {why}, got others{fault_place(whole)}"
        )
    return whole


def check_polygons(outlines: Sequence[RegionOutline], *, closed: bool = True) -> list[Any]:
    """Check several outlines, and return them as valid Shapely polygons; see `check_polygon`.

    There may be thousands of small ones, as of buildings. All rings that have no fault are found at
    once.
    """
    import shapely

    polygons: list[Any] = [None] * len(outlines)
    small = [
        k
        for k, outline in enumerate(outlines)
        if not outline.holes and 3 <= len(outline.shell.points) <= _SMALL
    ]
    if small:
        rings = [outlines[k].shell.points for k in small]
        first = np.cumsum([0, *map(len, rings)])[:-1]
        points = np.concatenate(rings)
        of = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
        before = np.concatenate([points[:1], points[:-1]])
        before[first] = points[np.append(first[1:], len(points)) - 1]
        again = (points == before).all(axis=1)
        ends_at_begin = again[first]
        again[first] = False
        good = ~np.bincount(of[again], minlength=len(rings)).astype(np.bool_)
        good &= np.bincount(of[~np.isfinite(points).all(axis=1)], minlength=len(rings)) == 0
        good &= ends_at_begin | (not closed)
        good &= np.bincount(of) - ends_at_begin >= 3
        used = good[of]
        used[first[ends_at_begin]] = False  # it is the last vertex, too
        inner, counts = np.flatnonzero(used), np.bincount(of[used], minlength=len(rings))
        numbers = np.flatnonzero(counts)
        shapes = np.full(len(rings), None, dtype=object)
        if len(numbers):
            ends = np.cumsum(counts[numbers])
            corners = points[np.insert(inner, ends, inner[ends - counts[numbers]])]
            ring_of = np.repeat(np.arange(len(numbers)), counts[numbers] + 1)
            shapes[numbers] = shapely.polygons(shapely.linearrings(corners, indices=ring_of))
        low, high = np.split(shapely.bounds(shapes), 2, axis=1)
        size = (high - low).max(axis=1)
        good &= shapely.is_valid(shapes) & (shapely.area(shapes) > _FLAT * size * size)
        for k, shape, right in zip(small, shapes, good.tolist(), strict=True):
            polygons[k] = shape if right else None
    return [
        check_polygon(outline, closed=closed) if polygon is None else polygon
        for outline, polygon in zip(outlines, polygons, strict=True)
    ]


def check_overlaps(polygons: list[Any], where: str) -> None:
    """Refuse polygons of which too many meet, or that may cross each other at too many points,
    before they are united.

    The work of a union grows with the number of crossings: two combs of 1,500 teeth cross each
    other nine million times.
    """
    import shapely

    tree = shapely.STRtree(polygons)
    boxes, corners = (
        shapely.bounds(polygons).tolist(),
        shapely.get_num_coordinates(polygons).tolist(),
    )
    pairs = crossings = 0
    for k, polygon in enumerate(polygons):
        near = [
            other for other in tree.query(polygon, predicate="intersects").tolist() if other > k
        ]
        pairs += len(near)
        check_count(pairs, MOST_PAIRS, where=where, what="pairs of polygons that meet")
        for other in near:
            if corners[k] * corners[other] <= _FEW:
                continue
            crossings += _meeting_sides(
                _sides(polygon, boxes[other]), _sides(polygons[other], boxes[k])
            )
            if crossings > MOST_CROSSINGS:
                raise InvalidInputError(
                    f"{where}: expected polygons with at most {MOST_CROSSINGS} sides that may cross"
                    " each other, got more; simplify their borders"
                )


def check_spikes(area: Any, footprint: float, where: str) -> None:
    """Refuse an area that its border cuts into far more pieces than it has cells, before the area
    is divided into cells.

    The measure is the number of sides longer than a quarter of a cell, times the length of the
    border in cells for each cell of area. A smooth border has few such sides for its area, and a
    long corridor has many cells. A ring of 3,000 spikes of one kilometre around 0.3 km2 has 6,000
    sides and 860 cells of border for each cell of 50 m.
    """
    import shapely

    points, ring = shapely.get_coordinates(
        shapely.get_rings(shapely.get_parts(area)), return_index=True
    )
    lengths = step_lengths(points)[ring[1:] == ring[:-1]]
    sides = int((lengths > footprint / 4).sum())
    if sides * float(lengths.sum()) * footprint > MOST_CUTS * float(area.area):
        wide = 2 * float(area.area) / float(lengths.sum())
        raise InvalidInputError(
            f"{where}: expected a region that is wider than its footprint of {footprint:g} m in"
            f" most places, got {sides} sides and a mean width of {wide:.2g} m; simplify the"
            " border, or use a smaller footprint"
        )


def _sides(polygon: Any, box: list[float]) -> Any:
    """Return the sides of a polygon that may lie in a box (left, low, right, high), as Shapely
    lines.
    """
    import shapely

    points, ring = shapely.get_coordinates(shapely.get_rings(polygon), return_index=True)
    ends = segments_of(points)[ring[1:] == ring[:-1]]
    near = ((ends.max(axis=1) >= box[:2]) & (ends.min(axis=1) <= box[2:])).all(axis=1)
    return shapely.linestrings(ends[near])


def _meeting_sides(sides: Any, others: Any, *, most: int = MOST_CROSSINGS) -> int:
    """Return the number of pairs of sides whose bounding boxes overlap. The count ends as soon as
    it is above ``most``.
    """
    import shapely

    tree, count = shapely.STRtree(others), 0
    at_once = max(1, MOST_CROSSINGS // max(1, len(others)))
    for first in range(0, len(sides), at_once):
        count += tree.query(sides[first : first + at_once]).shape[1]
        if count > most:
            break
    return count


def check_metres(ring: Ring) -> None:
    """Refuse a ring with a coordinate above `FARTHEST` metres, because a float64 cannot store small
    fractions of such a coordinate.
    """
    # another check reports coordinates that are not numbers
    near = ~(np.abs(ring.points) > FARTHEST).any(axis=1)
    ring.check_vertices(near, f"coordinates of at most {FARTHEST:g} m")


def check_degrees(ring: Ring) -> None:
    """Refuse a ring that has an invalid longitude or latitude, comes near a pole, or crosses the
    180° meridian.
    """
    longitude, latitude = np.abs(ring.points).T
    swapped = (latitude > 90).any() and (longitude <= 90).all() and (latitude <= 180).all()
    note = (
        "; are the two swapped?"
        if swapped
        else "; is this in metres?"
        if (longitude > 360).any()
        else ""
    )
    right = ~((longitude > 180) | (latitude > 90))
    ring.check_vertices(right, "a longitude within ±180 and then a latitude within ±90", note)
    ring.check_vertices(
        ~(latitude > _POLE), f"a region away from the poles, within ±{_POLE} degrees of latitude"
    )
    jumps = np.abs(np.diff(ring.points[:, 0])) > 180
    if jumps.any():
        index = int(np.argmax(jumps))
        raise InvalidInputError(
            f"{ring.vertex(index + 1)}: expected a region that does not cross the 180° meridian, "
            f"got a step from {text_of(ring.points[index])} to {text_of(ring.points[index + 1])}"
        )


@dataclass(frozen=True, eq=False)
class RegionOutlines:
    """All polygons of a file or a built-in region.

    Parameters
    ----------
    outlines : tuple of RegionOutline
    where : str
        Path of the file, or name of the built-in region.
    geographic : bool
        Whether coordinates are longitude and latitude in degrees (WGS84). If false, coordinates are
        in metres.
    closed : bool
        Whether the format of the file requires that rings repeat their first vertex at the end.
    height : float
        Height of the volume above the polygons in metres, or 0 for a plane region.
    """

    outlines: tuple[RegionOutline, ...]
    where: str
    geographic: bool
    closed: bool = True
    height: float = 0.0


def polygon_outlines(shape: Any, where: str, *, no_go: bool = False) -> list[RegionOutline]:
    """Return the polygons in a Shapely geometry as outlines. The argument ``where`` is the
    geometry's name in error messages.
    """
    import shapely

    parts = [
        part
        for part in shapely.get_parts(shape)
        if part.geom_type == "Polygon" and not part.is_empty
    ]
    outlines = []
    for index, part in enumerate(parts):
        place = f"{where}, polygon {index + 1}" if len(parts) > 1 else where
        holes = tuple(
            Ring(shapely.get_coordinates(ring), f"{place}, hole {k + 1}")
            for k, ring in enumerate(part.interiors)
        )
        outlines.append(
            RegionOutline(Ring(shapely.get_coordinates(part.exterior), place), holes, no_go)
        )
    return outlines
