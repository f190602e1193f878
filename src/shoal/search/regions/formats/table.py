"""CSV: vertices in metres."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

from shoal.checks import read_text
from shoal.errors import InvalidInputError
from shoal.search.regions.outline_checks import RegionOutline, RegionOutlines, Ring, check_metres, check_ring, text_of

_MOST_RINGS = 10_000


def read_table(path: Path) -> RegionOutlines:
    """Return the polygons in a CSV file, in metres.

    Raises
    ------
    InvalidInputError
        With the line.
    """
    rings = _rings(path)
    if not rings:
        raise InvalidInputError(f"{path}: expected vertices, one x,y a line, got none")
    if len(rings) > _MOST_RINGS:
        raise InvalidInputError(f"{path}: expected at most {_MOST_RINGS} rings, got {len(rings)}")
    return RegionOutlines(_nested(rings), str(path), geographic=False, closed=False)


def _rings(path: Path) -> list[Ring]:
    """Return the rings of a file: vertices with their lines."""
    groups: list[list[tuple[float, float, int]]] = [[]]
    label: str | None = None
    began = False
    for number, line in enumerate(read_text(path, what="region file").splitlines(), start=1):
        if line.lstrip().startswith("#"):
            continue
        if not line.strip(" ,\t"):
            groups.append([])
            continue
        columns = [column.strip() for column in next(csv.reader([line]))]
        if not began and _is_heading(columns):
            began = True
            continue
        began = True
        x, y, of = _vertex(columns, path, number)
        if of != label:
            label = of
            groups.append([])
        groups[-1].append((x, y, number))
    kept = [group for group in groups if group]
    return [
        Ring(
            np.array([vertex[:2] for vertex in group]),
            f"{path}: ring {k + 1} (from line {group[0][2]})",
            np.array([vertex[2] for vertex in group]),
        )
        for k, group in enumerate(kept)
    ]


def _is_heading(columns: list[str]) -> bool:
    return len(columns) in (2, 3) and [column.lower() for column in columns] in (["x", "y"], ["x", "y", "ring"])


def _vertex(columns: list[str], path: Path, line: int) -> tuple[float, float, str | None]:
    if len(columns) not in (2, 3):
        hint = "; use commas between columns" if len(columns) == 1 and ";" in columns[0] else ""
        raise InvalidInputError(f"{path}: line {line}: expected x,y or x,y,ring in metres, got {len(columns)} columns{hint}")
    try:
        return float(columns[0]), float(columns[1]), columns[2] if len(columns) == 3 else None
    except ValueError:
        raise InvalidInputError(
            f"{path}: line {line}: expected two numbers, x,y in metres, got {','.join(columns[:2])[:60]!r}"
        ) from None


def _nested(rings: list[Ring]) -> tuple[RegionOutline, ...]:
    """Tell outlines from holes: a ring inside an odd number of others is a hole of the smallest of them."""
    import shapely

    for ring in rings:
        check_metres(ring)
    shapes: list[Any] = [shapely.Polygon(check_ring(ring, closed=False)) for ring in rings]
    tree = shapely.STRtree(shapes)
    within: list[list[int]] = [[] for _ in rings]
    for k, other in tree.query(shapes, predicate="intersects").T.tolist():
        if k == other or shapes[k].touches(shapes[other]):
            continue
        if shapes[other].covers(shapes[k]) and not (k > other and shapes[k].equals(shapes[other])):
            within[k].append(other)
        elif not shapes[k].covers(shapes[other]):
            where = shapely.intersection(shapes[k].boundary, shapes[other].boundary).representative_point()
            raise InvalidInputError(
                f"{rings[max(k, other)].where}: expected rings that do not cross, got one that crosses "
                f"ring {min(k, other) + 1} at {text_of(where.coords[0])}"
            )
    holes: dict[int, list[Ring]] = {k: [] for k, outer in enumerate(within) if len(outer) % 2 == 0}
    for k, outer in enumerate(within):
        if len(outer) % 2:
            holes[min(outer, key=lambda j: shapes[j].area)].append(rings[k])
    return tuple(RegionOutline(rings[k], tuple(inner)) for k, inner in holes.items())
