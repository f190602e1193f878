"""Functions that read workspace outlines from SVG drawings and paths, in the drawing's units, with the y axis upwards."""

from __future__ import annotations

import re
import xml.etree.ElementTree as Tree
from io import BytesIO
from itertools import islice
from typing import Any

import numpy as np

from shoal.core.errors import InvalidInputError
from shoal.steering.workspaces.convex import ConvexWorkspace, disk
from shoal.steering.workspaces.convex_geometry import Points, signed_area

LARGEST_DRAWING = 2_000_000  # characters
DEEPEST, MOST_ELEMENTS, MOST_CORNERS = 100, 20_000, 20_000
MOST_NUMBERS = 8 * MOST_CORNERS  # in paths: a corner needs two numbers at most, and strokes without an area need some more

_NUMBER = re.compile(r"[0-9]+\.?[0-9]*|\.[0-9]+")

_CURVE = 48  # number of corners that approximate each curve
_ROUND = 1e-9  # relative to a radius: an ellipse with a smaller deviation is a circle
_FRAME = ("width", "height", "viewBox", "preserveAspectRatio", "x", "y")  # attributes that change the display but not the shape


def rings_of_path(text: str, *, where: str) -> list[Points]:
    """Return the closed lines of an SVG path's ``d`` attribute, with 48 short sides for each curve; each float64, shape (n, 2).

    Raises
    ------
    InvalidInputError
    """
    from svgelements import Path

    _check_size(text, where)
    try:
        _check_numbers(text, where)
        found = _rings([Path(text)], where)
    except InvalidInputError:
        raise
    except Exception as error:  # a third-party parser that may raise any exception
        raise _refused(error, "path", where) from None
    return _checked(found, where)


def read_drawing(text: str, *, where: str) -> ConvexWorkspace | list[Points]:
    """Return a disk if an SVG drawing shows only one circle, and otherwise its closed lines, sorted by decreasing area.

    The function reads paths (with lines, curves and arcs), polygons, polylines, rectangles, circles and ellipses. It also reads
    groups, transforms and repeated elements (``use``), and skips elements that are not displayed. The returned lines have the units
    of the drawing and a y axis that points upwards.

    Raises
    ------
    InvalidInputError
    """
    from svgelements import SVG, Circle, Ellipse, Shape

    _check_size(text, where)
    if "<!ENTITY" in text.upper():
        raise InvalidInputError(f"{where}: expected an SVG drawing without entities, got an entity")
    try:
        root = Tree.fromstring(text)
        _check_elements(root, where)
        for name in _FRAME:
            root.attrib.pop(name, None)
        shapes = [one for one in SVG.parse(BytesIO(Tree.tostring(root))).elements() if isinstance(one, Shape)]
        if len(shapes) == 1 and isinstance(shapes[0], Circle | Ellipse):
            radii, center = sorted((abs(float(shapes[0].rx)), abs(float(shapes[0].ry)))), shapes[0].implicit_center
            if np.isfinite(radii).all() and radii[1] - radii[0] <= _ROUND * radii[1] and shapes[0].transform.is_identity():
                return disk(radii[1], center=(float(center.x), -float(center.y)))
        found = _rings(shapes, where)
    except InvalidInputError:
        raise
    except Exception as error:  # as above
        raise _refused(error, "drawing", where) from None
    return sorted(_checked(found, where), key=lambda ring: -abs(signed_area(ring)))


def _check_size(text: str, where: str) -> None:
    if len(text) > LARGEST_DRAWING:
        raise InvalidInputError(f"{where}: expected an SVG of at most {LARGEST_DRAWING} characters, got {len(text)}")


def _check_elements(root: Tree.Element, where: str) -> None:
    """Raise an error if a drawing is nested too deeply, or too large after the expansion of all repeated elements."""
    _check_numbers(" ".join(node.attrib.get(name, "") for node in root.iter() for name in ("d", "points")), where)
    level, depth = [root], 0
    names: dict[str, Tree.Element] = {}
    while level:
        depth += 1
        if depth > DEEPEST:
            raise InvalidInputError(f"{where}: expected an SVG drawing of at most {DEEPEST} levels, got more")
        names |= {node.attrib["id"]: node for node in level if "id" in node.attrib}
        level = [child for node in level for child in node]
    sizes: dict[Tree.Element, float] = {}

    def size(node: Tree.Element) -> float:
        if node in sizes:
            return sizes[node]
        sizes[node] = np.inf  # an element that uses itself would never end
        used = next((value for name, value in node.attrib.items() if name.rpartition("}")[2] == "href"), "")
        target = names.get(used[1:]) if node.tag.rpartition("}")[2] == "use" else None
        sizes[node] = 1 + sum(size(child) for child in node) + (size(target) if target is not None else 0)
        return sizes[node]

    if size(root) > MOST_ELEMENTS:
        raise InvalidInputError(
            f"{where}: expected an SVG drawing of at most {MOST_ELEMENTS} elements, including repeated elements, got more"
        )


def _check_numbers(text: str, where: str) -> None:
    """Raise an error if paths have more numbers than the largest number of corners can need, before the paths are parsed."""
    count = sum(1 for _ in islice(_NUMBER.finditer(text), MOST_NUMBERS + 1))
    if count > MOST_NUMBERS:
        raise InvalidInputError(f"{where}: expected an SVG of at most {MOST_CORNERS} corners, got more than {MOST_NUMBERS} numbers")


def _refused(error: Exception, what: str, where: str) -> InvalidInputError:
    why = " ".join(str(error).split())[:120] or type(error).__name__
    return InvalidInputError(f"{where}: expected an SVG {what}, got something else: {why}")


def _rings(shapes: list[Any], where: str) -> list[Points]:
    """Return the closed lines of SVG shapes that have three or more points.

    The number of corners is checked before the points of each segment are computed, which takes most of the time.
    """
    from svgelements import Close, Line, Move, Path

    done: list[Points] = []
    count = 0
    for shape in shapes:
        rings: list[list[Points]] = []
        for segment in Path(shape).segments():
            more = 1 if isinstance(segment, Move | Line | Close) else _CURVE
            if count + sum(map(len, rings[-1:])) + more > MOST_CORNERS:
                raise InvalidInputError(f"{where}: expected an SVG of at most {MOST_CORNERS} corners, got more")
            if isinstance(segment, Move):
                count += sum(len(ring) for ring in rings[-1:] if len(ring) > 2)
                rings.append([_points(segment.end)])
            elif isinstance(segment, Line | Close):
                if segment.end is not None:
                    rings[-1].append(_points(segment.end))
            else:
                rings[-1] += [_points(segment.point(k / _CURVE)) for k in range(1, _CURVE + 1)]
        count += sum(len(ring) for ring in rings[-1:] if len(ring) > 2)
        done += [np.array(ring) for ring in rings if len(ring) > 2]
    return done


def _points(point: Any) -> Points:
    return np.array([float(point.x), -float(point.y)]) + 0.0


def _checked(rings: list[Points], where: str) -> list[Points]:
    if not rings:
        raise InvalidInputError(f"{where}: expected a closed path, got a path without lines")
    if not all(np.isfinite(ring).all() and np.abs(ring).max() < 1e15 for ring in rings):
        raise InvalidInputError(f"{where}: expected an SVG with finite numbers below 1e15, got larger numbers")
    return rings
