"""Points and regions in CSV files."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from shoal.core.checks import count_text, read_text, shortened
from shoal.core.errors import InvalidInputError
from shoal.search.regions.formats.reading import (
    Reading,
    names_no_go,
)
from shoal.search.regions.outline import (
    LARGEST_FILE,
    MOST_CORNERS,
    MOST_PAIRS,
    MOST_POLYGONS,
    RegionOutline,
    RegionOutlines,
    Ring,
    check_count,
    check_metres,
    check_ring,
    text_of,
)

_HEADINGS: dict[
    str, tuple[int, bool | None]
] = {  # the coordinate in a column, and whether it is in degrees (None if unknown)
    **dict.fromkeys(("x", "east", "easting"), (0, None)),
    **dict.fromkeys(("y", "north", "northing"), (1, None)),
    **dict.fromkeys(("x_m", "x[m]", "x (m)"), (0, False)),
    **dict.fromkeys(("y_m", "y[m]", "y (m)"), (1, False)),
    **dict.fromkeys(("longitude", "lon", "lng", "long", "x_deg"), (0, True)),
    **dict.fromkeys(("latitude", "lat", "y_deg"), (1, True)),
}
_LABELS = ("ring", "part", "polygon", "zone", "name", "robot")
_WIDEST_IN_DEGREES = 2.0  # coordinates in degrees with a wider range cannot be a region


class Vertex(NamedTuple):
    """A point in a CSV file: x and y, or longitude and latitude; its label, which names its
    polygon or its robot; and its line number.
    """

    x: float
    y: float
    label: str | None
    line: int


def read_table(path: Path, reading: Reading) -> RegionOutlines:
    """Return the polygons in a CSV file, in degrees if the heading names longitude and latitude,
    and in metres otherwise.

    Raises
    ------
    InvalidInputError
        If a line of the file is invalid, or if the coordinates look like degrees but no heading
        names their unit.
    """
    rows, degrees, _ = read_vertices(path, what="region file", columns="x,y or x,y,ring in metres")
    rings = _rings(rows, path)
    if not rings:
        raise InvalidInputError(f"{path}: expected vertices, one x,y a line, got none")
    check_count(len(rings), MOST_POLYGONS, where=str(path), what="rings")
    check_count(
        sum(len(ring.points) for ring in rings), MOST_CORNERS, where=str(path), what="corners"
    )
    points = np.concatenate([ring.points for ring in rings])
    if degrees is None and _like_degrees(points):
        wide, high = np.ptp(points, axis=0)
        raise InvalidInputError(
            f"{path}: expected x,y in metres, got {wide:.3g} by {high:.3g} around"
            f" {text_of(points[0])}, which look like degrees; name the columns longitude,latitude"
            " or x_m,y_m"
        )
    return RegionOutlines(
        _nest_rings(rings, metres=not degrees), str(path), geographic=bool(degrees), closed=False
    )


def read_vertices(
    path: Path, *, what: str, columns: str = "two numbers, x,y"
) -> tuple[list[Vertex | None], bool | None, str]:
    """Return the points in a CSV file, whether their coordinates are in degrees, and the heading of
    the column of labels.

    One or more blank lines between points give None instead of a point. If no heading of the file
    names the unit of the coordinates, the second result is None. Without a column of labels, the
    third result is an empty text.

    Parameters
    ----------
    path : path
    what : str
        Name of the file in error messages.
    columns : str
        Description of the expected columns in error messages.

    Raises
    ------
    InvalidInputError
        If a line of the file is invalid. The error message names the line.
    """
    rows: list[Vertex | None] = []
    order, label, degrees, labels = [0, 1], 2, None, ""
    wide: int | None = None
    count = 0
    for number, line in enumerate(
        read_text(path, what=what, most=LARGEST_FILE).splitlines(), start=1
    ):
        if line.lstrip().startswith("#"):
            continue
        if not line.strip(" ,;\t"):
            if rows and rows[-1] is not None:
                rows.append(None)
            continue
        try:
            words = [
                word.strip()
                for word in next(csv.reader([line], delimiter="," if "," in line else ";"))
            ]
        except csv.Error as error:
            raise InvalidInputError(
                f"{path}: line {number}: expected {columns}, got something else: {error}"
            ) from None
        if wide is None and (named := _heading_columns(words)) is not None:
            order, label, degrees, wide = *named, len(words)
            labels = words[label].lower() if label < wide else ""
            continue
        if len(words) not in (2, 3) if wide is None else len(words) != wide:
            expected = columns if wide is None else f"{wide} columns, as the heading has"
            raise InvalidInputError(
                f"{path}: line {number}: expected {expected}, got"
                f" {shortened(line.strip())} ({count_text(len(words), 'column')})"
            )
        try:
            x, y = (float(words[column]) for column in order)
        except ValueError:
            actual = ",".join(words[:2])[:60]
            raise InvalidInputError(
                f"{path}: line {number}: expected two numbers, x,y in metres, got {actual!r}"
            ) from None
        rows.append(Vertex(x, y, words[label] if label < len(words) else None, number))
        count += 1
        check_count(count, MOST_CORNERS, where=str(path), what="points")
    return rows, degrees, labels


def _heading_columns(words: list[str]) -> tuple[list[int], int, bool | None] | None:
    """Return the columns that a heading names for x, y and the label, and whether x and y are in
    degrees.

    If the line is not a heading, the result is None.
    """
    axes = [
        (_HEADINGS[word.lower()], column)
        for column, word in enumerate(words)
        if word.lower() in _HEADINGS
    ]
    if sorted(axis for (axis, _), _ in axes) != [0, 1]:
        return None
    order = [column for _, column in sorted(axes)]
    label_columns = [column for column, word in enumerate(words) if word.lower() in _LABELS]
    return order, label_columns[0] if label_columns else len(words), axes[0][0][1]


def _like_degrees(points: Any) -> bool:
    """Return whether coordinates look like degrees: they are in the range of degrees, near each
    other, with many decimals.
    """
    within = any((np.abs(points) <= most).all() for most in ([180, 90], [90, 180]))
    many_decimals = (
        np.abs(points * 1000 - np.round(points * 1000)) > 1e-6 if within else np.zeros(1)
    )
    return bool(
        within and (np.ptp(points, axis=0) < _WIDEST_IN_DEGREES).all() and many_decimals.any()
    )


def _rings(rows: list[Vertex | None], path: Path) -> list[Ring]:
    """Group the points of a CSV file into rings, which keep the line number of each vertex."""
    groups: list[list[Vertex]] = [[]]
    label: str | None = None
    for row in rows:
        if row is None or row.label != label:
            groups.append([])
        if row is not None:
            label = row.label
            groups[-1].append(row)
    return [
        Ring(
            np.array([row[:2] for row in group]),
            f"{path}: ring {k + 1} (from line {group[0].line})",
            np.array([row.line for row in group]),
            no_go=names_no_go(group[0].label),
        )
        for k, group in enumerate(group for group in groups if group)
    ]


def _pairs(shapes: list[Any], *, where: str) -> Iterator[tuple[int, int, bool, bool]]:
    """Yield, for overlapping polygons i and j: the indices i and j, whether j covers i, and whether
    i covers j.
    """
    import shapely

    tree, every = shapely.STRtree(shapes), np.array(shapes)
    shapely.prepare(every)
    count = 0
    for k in range(len(shapes)):
        near = np.sort(tree.query(shapes[k]))
        count += len(near) - 1
        check_count(count, MOST_PAIRS, where=where, what="pairs of rings in or around each other")
        near = near[
            (near != k)
            & shapely.intersects(every[k], every[near])
            & ~shapely.touches(every[k], every[near])
        ]
        inside, around = (
            shapely.covers(every[near], every[k]),
            shapely.covers(every[k], every[near]),
        )
        yield from zip(
            [k] * len(near), near.tolist(), inside.tolist(), around.tolist(), strict=True
        )


def _nest_rings(rings: list[Ring], *, metres: bool) -> tuple[RegionOutline, ...]:
    """Return outlines with their holes. A ring inside an odd number of rings is a hole in the
    smallest ring around it.
    """
    import shapely

    for ring in rings if metres else ():
        check_metres(ring)
    zones = tuple(RegionOutline(ring, no_go=True) for ring in rings if ring.no_go)
    rings = [ring for ring in rings if not ring.no_go]
    shapes: list[Any] = [shapely.Polygon(check_ring(ring, closed=False)) for ring in rings]
    within: list[list[int]] = [[] for _ in rings]
    for k, other, inside, around in _pairs(shapes, where=rings[0].where if rings else ""):
        if inside and not (k > other and around):
            within[k].append(other)
        elif not around:
            where = shapely.intersection(
                shapes[k].boundary, shapes[other].boundary
            ).representative_point()
            raise InvalidInputError(
                f"{rings[max(k, other)].where}: expected rings that do not cross, got one that"
                f" crosses ring {min(k, other) + 1} at {text_of(where.coords[0])}"
            )
    holes: dict[int, list[Ring]] = {k: [] for k, outer in enumerate(within) if len(outer) % 2 == 0}
    for k, outer in enumerate(within):
        if len(outer) % 2:
            holes[min(outer, key=lambda j: shapes[j].area)].append(rings[k])
    return (*(RegionOutline(rings[k], tuple(inner)) for k, inner in holes.items()), *zones)
