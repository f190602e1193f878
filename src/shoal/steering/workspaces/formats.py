"""Workspaces by name, from files of polygons, and from SVG drawings."""

from __future__ import annotations

import json
import os
import re
import xml.etree.ElementTree as Tree
from collections.abc import Callable
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from shoal.core.checks import (
    as_path,
    check_choice,
    check_vertices,
    parse_json,
    read_polygon,
    read_text,
    shortened,
    suggestion,
)
from shoal.core.errors import InvalidInputError, UnknownNameError, errors_at
from shoal.steering.workspaces.convex import (
    ConvexWorkspace,
    InwardCornerError,
    Points,
    cylinder,
    disk,
    polygon,
    prism,
    regular_polygon,
    signed_area,
)
from shoal.steering.workspaces.region import Region, region

LARGEST_DRAWING = 2_000_000  # characters
DEEPEST, MOST_ELEMENTS, MOST_CORNERS = 100, 20_000, 20_000
# in paths: a corner needs two numbers at most, and strokes without an area need some more
MOST_NUMBERS = 8 * MOST_CORNERS

_NUMBER = re.compile(r"[0-9]+\.?[0-9]*|\.[0-9]+")

_CURVE = 48  # number of corners that approximate each curve
_ROUND = 1e-9  # relative to a radius: an ellipse with a smaller deviation is a circle
# attributes that change the display but not the shape
_FRAME = ("width", "height", "viewBox", "preserveAspectRatio", "x", "y")


def rings_of_path(text: str, *, where: str) -> list[Points]:
    """Return the closed lines of an SVG path's ``d`` attribute, with 48 short sides for each curve;
    each float64, shape (n, 2).
    """
    from svgelements import Path

    _check_size(text, where)
    try:
        _check_numbers(text, where)
        rings = _rings([Path(text)], where)
    except InvalidInputError:
        raise
    except Exception as error:  # a third-party parser that may raise any exception
        raise _refusal(error, "path", where, text) from None
    return _check_rings(rings, where)


def read_drawing(text: str, *, where: str) -> ConvexWorkspace | list[Points]:
    """Return a disk if an SVG drawing shows only one circle, and otherwise its closed lines, sorted
    by decreasing area.

    The function reads paths (with lines, curves and arcs), polygons, polylines, rectangles, circles
    and ellipses. It also reads groups, transforms and repeated elements (``use``), and skips
    elements that are not displayed. The returned lines have the units of the drawing and a y axis
    that points upwards.
    """
    from svgelements import SVG, Circle, Ellipse, Shape

    _check_size(text, where)
    if "<!ENTITY" in text.upper():
        raise InvalidInputError(f"{where}: expected an SVG drawing without entities, got an entity")
    try:
        root = Tree.fromstring(text)
        if (name := root.tag.rpartition("}")[2]) != "svg":
            raise InvalidInputError(
                f"{where}: expected an SVG drawing, got XML with the outermost element {name[:40]}"
            )
        _check_elements(root, where)
        for name in _FRAME:
            root.attrib.pop(name, None)
        shapes = [
            element
            for element in SVG.parse(BytesIO(Tree.tostring(root))).elements()
            if isinstance(element, Shape)
        ]
        if len(shapes) == 1 and isinstance(shapes[0], Circle | Ellipse):
            radii, center = (
                sorted((abs(float(shapes[0].rx)), abs(float(shapes[0].ry)))),
                shapes[0].implicit_center,
            )
            if (
                np.isfinite(radii).all()
                and radii[1] - radii[0] <= _ROUND * radii[1]
                and shapes[0].transform.is_identity()
            ):
                return disk(radii[1], center=(float(center.x), -float(center.y)))
        rings = _rings(shapes, where)
    except InvalidInputError:
        raise
    except Exception as error:  # as above
        raise _refusal(error, "drawing", where, text) from None
    return sorted(_check_rings(rings, where), key=lambda ring: -abs(signed_area(ring)))


def _check_size(text: str, where: str) -> None:
    if len(text) > LARGEST_DRAWING:
        raise InvalidInputError(
            f"{where}: expected an SVG of at most {LARGEST_DRAWING} characters, got {len(text)}"
        )


def _check_elements(root: Tree.Element, where: str) -> None:
    """Raise an error if a drawing is nested too deeply, or too large after the expansion of all
    repeated elements.
    """
    _check_numbers(
        " ".join(node.attrib.get(name, "") for node in root.iter() for name in ("d", "points")),
        where,
    )
    level, depth = [root], 0
    names: dict[str, Tree.Element] = {}
    while level:
        depth += 1
        if depth > DEEPEST:
            raise InvalidInputError(
                f"{where}: expected an SVG drawing of at most {DEEPEST} levels, got more"
            )
        names |= {node.attrib["id"]: node for node in level if "id" in node.attrib}
        level = [child for node in level for child in node]
    sizes: dict[Tree.Element, float] = {}

    def size(node: Tree.Element) -> float:
        if node in sizes:
            return sizes[node]
        sizes[node] = np.inf  # an element that uses itself would never end
        used = next(
            (value for name, value in node.attrib.items() if name.rpartition("}")[2] == "href"), ""
        )
        target = names.get(used[1:]) if node.tag.rpartition("}")[2] == "use" else None
        sizes[node] = (
            1 + sum(size(child) for child in node) + (size(target) if target is not None else 0)
        )
        return sizes[node]

    if size(root) > MOST_ELEMENTS:
        raise InvalidInputError(
            f"{where}: expected an SVG drawing of at most {MOST_ELEMENTS} elements, including"
            " repeated elements, got more"
        )


def _check_numbers(text: str, where: str) -> None:
    """Raise an error if paths have more numbers than the largest number of corners can need, before
    the paths are parsed.
    """
    count = sum(1 for _ in islice(_NUMBER.finditer(text), MOST_NUMBERS + 1))
    if count > MOST_NUMBERS:
        raise InvalidInputError(
            f"{where}: expected an SVG of at most {MOST_CORNERS} corners, got more than"
            f" {MOST_NUMBERS} numbers"
        )


def _refusal(error: Exception, what: str, where: str, text: str) -> InvalidInputError:
    # of the parsers, only that of XML says what is wrong, and where
    is_xml = isinstance(error, Tree.ParseError)
    actual = f"something else: {error}" if is_xml else shortened(text.strip()[:60])
    return InvalidInputError(f"{where}: expected an SVG {what}, got {actual}")


def _rings(shapes: list[Any], where: str) -> list[Points]:
    """Return the closed lines of SVG shapes that have three or more points.

    The number of corners is checked before the points of each segment are computed, which takes
    most of the time.
    """
    from svgelements import Close, Line, Move, Path

    closed: list[Points] = []
    count = 0
    for shape in shapes:
        rings: list[list[Points]] = []
        for segment in Path(shape).segments():
            more = 1 if isinstance(segment, Move | Line | Close) else _CURVE
            if count + sum(map(len, rings[-1:])) + more > MOST_CORNERS:
                raise InvalidInputError(
                    f"{where}: expected an SVG of at most {MOST_CORNERS} corners, got more"
                )
            if isinstance(segment, Move):
                count += sum(len(ring) for ring in rings[-1:] if len(ring) > 2)
                rings.append([_points(segment.end)])
            elif isinstance(segment, Line | Close):
                if segment.end is not None:
                    rings[-1].append(_points(segment.end))
            else:
                rings[-1] += [_points(segment.point(k / _CURVE)) for k in range(1, _CURVE + 1)]
        count += sum(len(ring) for ring in rings[-1:] if len(ring) > 2)
        closed += [np.array(ring) for ring in rings if len(ring) > 2]
    return closed


def _points(point: Any) -> Points:
    return np.array([float(point.x), -float(point.y)]) + 0.0


def _check_rings(rings: list[Points], where: str) -> list[Points]:
    if not rings:
        raise InvalidInputError(f"{where}: expected a closed path, got a path without lines")
    if not all(np.isfinite(ring).all() and np.abs(ring).max() < 1e15 for ring in rings):
        raise InvalidInputError(
            f"{where}: expected an SVG with finite numbers below 1e15, got larger numbers"
        )
    return rings


Workspace = ConvexWorkspace | Region

REGULAR = {"triangle": 3, "pentagon": 5, "hexagon": 6, "heptagon": 7, "octagon": 8}
LARGEST_FILE = 10_000_000  # bytes
SUFFIXES = (".json", ".geojson", ".wkt", ".svg")

# For each JSON type of workspace: its required fields and its optional fields.
_TYPES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "polygon": (("vertices",), ()),
    "regular": (("sides",), ("radius",)),
    "disk": (("radius",), ("center",)),
    "prism": (("base", "height"), ("open_ends",)),
    "cylinder": (("radius", "height"), ("open_ends",)),
    "region": (("outline",), ("obstacles",)),
    "wkt": (("text",), ()),
    "svg": (("text",), ()),
}
_MAKERS: dict[str, Callable[..., Workspace]] = {
    "polygon": polygon,
    "regular": regular_polygon,
    "disk": disk,
    "cylinder": cylinder,
}
_GEOJSON = ("Polygon", "MultiPolygon", "Feature", "FeatureCollection", "GeometryCollection")


def open_workspace(source: str | os.PathLike[str] | dict[str, Any]) -> Workspace:
    """Return the workspace that a name, a file, a well-known text (WKT) or a JSON description
    defines.

    Parameters
    ----------
    source : str, path or dict
        A workspace name, the path of a workspace file, a well-known text such as ``POLYGON ((0 0,
        ...))``, or a dict as in a problem file, such as ``{"type": "polygon", "vertices": [...]}``.
        The name ``square`` means a square with the side 1 and one corner at the origin. The names
        ``triangle``, ``pentagon``, ``hexagon``, ``heptagon``, ``octagon`` and ``regular:SIDES``
        mean regular polygons around the origin, with corners on a circle of radius 0.5. The name
        ``disk`` means a disk of radius 0.5, and ``disk:RADIUS`` means a disk of the given radius.
        The suffix of a workspace file is ``.json`` (a problem file or GeoJSON), ``.geojson``,
        ``.wkt`` or ``.svg``. In an SVG drawing, the largest closed line is the outline of the
        workspace, and the other closed lines are obstacles. A workspace from an SVG drawing has the
        units of the drawing and a y axis that points upwards.

    Returns
    -------
    ConvexWorkspace or Region
        The workspace, which is a `Region` if the source has obstacles or the type "region", or if a
        drawing, WKT or GeoJSON bends inward.

    Raises
    ------
    UnknownNameError, InvalidInputError
        If ``source`` is unknown or invalid. For a file, the error message gives the location in the
        file.

    Examples
    --------
    >>> open_workspace("hexagon")
    <ConvexWorkspace polygon, 6 corners>
    >>> open_workspace("POLYGON ((0 0, 2 0, 2 1, 0 0))")
    <ConvexWorkspace polygon, 3 corners>
    >>> sorted(open_workspace({"type": "svg", "text": "M 0 0 h 2 v 1 z"}).vertices.tolist())
    [[0.0, 0.0], [2.0, -1.0], [2.0, 0.0]]
    """
    if isinstance(source, dict):
        return workspace_of(source, where="workspace")
    as_path(source, what="workspace")
    return _open_named(os.fspath(source), of_problem=True)


def _open_named(text: str, *, of_problem: bool) -> Workspace:
    if re.match(r"\s*(multi)?polygon\b", text, flags=re.IGNORECASE):
        return _from_geometry(read_polygon(text, where="workspace"), where="workspace")
    if Path(text).suffix.lower() in SUFFIXES or os.path.exists(text):
        return _read_workspace(Path(text), of_problem=of_problem)
    return _named(text)


def workspace_of(data: Any, *, where: str) -> Workspace:
    """Return the workspace that the parsed JSON or GeoJSON ``data`` describes."""
    if not isinstance(data, dict) or "type" not in data:
        raise InvalidInputError(f"{where}: expected an object with a type, got {shortened(data)}")
    kind = data["type"]
    if kind in _GEOJSON:
        return _from_geojson(data, where=where)
    check_choice(kind, what=f"{where}: type", choices=_TYPES)
    needed, more = _TYPES[kind]
    for name in data:
        if name not in ("type", *needed, *more):
            fields_of_type = ", ".join((*needed, *(f"{allowed} (optional)" for allowed in more)))
            near = suggestion(name, (*needed, *more))
            raise InvalidInputError(
                f"{where}: expected the fields of a {kind}, which are {fields_of_type}, got"
                f" {shortened(name)}{near}"
            )
    for name in needed:
        if name not in data:
            raise InvalidInputError(f"{where}: {name}: expected this field of a {kind}, got none")
    if "text" in needed and not isinstance(data["text"], str):
        raise InvalidInputError(f"{where}: text: expected a text, got {shortened(data['text'])}")
    if kind == "wkt":
        return _from_geometry(read_polygon(data["text"], where=where), where=where)
    if kind == "svg":
        return _from_svg(data["text"], where=where)
    fields = {name: value for name, value in data.items() if name != "type"}
    try:
        return _build(kind, fields, where)
    except InvalidInputError as error:
        message = str(error)
        raise InvalidInputError(
            message if message.startswith(where) else f"{where}: {message}"
        ) from None


def _build(kind: str, fields: dict[str, Any], where: str) -> Workspace:
    if kind in _MAKERS:
        return _MAKERS[kind](**fields)
    if kind == "region":
        obstacles = fields.get("obstacles", [])
        if not isinstance(obstacles, list):
            raise InvalidInputError(
                f"obstacles: expected a list of outlines, got {shortened(obstacles)}"
            )
        return region(fields["outline"], obstacles)
    base = workspace_of(fields.pop("base"), where=f"{where}: base")
    if not isinstance(base, ConvexWorkspace) or base.round:
        raise InvalidInputError(f"base: expected a polygon, got {base!r}")
    return prism(base, **fields)


def describe(workspace: Workspace) -> dict[str, Any]:
    """Return a JSON description from which `workspace_of` creates the same workspace.

    Examples
    --------
    >>> describe(disk(0.5))
    {'type': 'disk', 'center': [0.0, 0.0], 'radius': 0.5}
    """
    if isinstance(workspace, Region):
        obstacles = [obstacle.tolist() for obstacle in workspace.obstacles]
        return {"type": "region", "outline": workspace.outline.tolist(), "obstacles": obstacles}
    if workspace.kind == "disk":
        return {"type": "disk", "center": workspace.center.tolist(), "radius": workspace.radius}
    flat: dict[str, Any] = {"type": "polygon", "vertices": workspace.vertices.tolist()}
    if workspace.kind == "polygon":
        return flat
    ends = {"open_ends": True} if workspace.open_ends else {}
    if workspace.kind == "cylinder":
        return {"type": "cylinder", "radius": workspace.radius, "height": workspace.height} | ends
    return {"type": "prism", "base": flat, "height": workspace.height} | ends


def _named(text: str) -> Workspace:
    name, _, option = text.partition(":")
    try:
        if name == "square" and not option:
            return polygon([(0, 0), (1, 0), (1, 1), (0, 1)])
        if name in REGULAR and not option:
            return regular_polygon(REGULAR[name])
        if name == "regular":
            return regular_polygon(int(option))
        if name == "disk":
            return disk(float(option) if option else 0.5)
    except ValueError as error:
        if isinstance(error, InvalidInputError):
            raise
        raise InvalidInputError(
            f"workspace {text!r}: expected a number after the colon, got {option!r}"
        ) from None
    names = ("square", *REGULAR, "regular:SIDES", "disk", "disk:RADIUS")
    raise UnknownNameError(
        f"unknown workspace {text[:80]!r}: expected {', '.join(names)}, a file or POLYGON ((...))"
    )


def _read_workspace(source: Path, *, of_problem: bool) -> Workspace:
    """Return the workspace that a workspace file or, with ``of_problem``, a problem file contains."""
    suffix, where = source.suffix.lower(), str(source)
    if suffix not in SUFFIXES:
        raise InvalidInputError(
            f"{source}: expected a workspace file ({', '.join(SUFFIXES)}), got the suffix"
            f" {source.suffix!r}"
        )
    text = read_text(source, what="workspace file", most=LARGEST_FILE)
    if suffix == ".wkt":
        return _from_geometry(read_polygon(text, where=where), where=where)
    if suffix == ".svg":
        return _from_svg(text, where=where)
    data = parse_json(text, where=where)
    if of_problem and isinstance(data, dict) and "workspace" in data:
        data = data["workspace"]
        if isinstance(data, str):
            with errors_at(f"{where}: workspace"):
                return _open_named(data, of_problem=False)
    return workspace_of(data, where=where)


def _from_svg(text: str, *, where: str) -> Workspace:
    """Return the workspace that an SVG drawing, or the ``d`` attribute of an SVG path,
    describes.
    """
    if not text.lstrip("\ufeff \t\r\n").startswith("<"):
        return _from_rings(rings_of_path(text, where=where), where=where)
    drawn = read_drawing(text, where=where)
    return drawn if isinstance(drawn, ConvexWorkspace) else _from_rings(drawn, where=where)


def _from_geojson(data: Any, *, where: str) -> Workspace:
    import shapely

    while isinstance(data, dict) and data.get("type") in ("Feature", "FeatureCollection"):
        key = "geometry" if data["type"] == "Feature" else "features"
        inner = data.get(key)
        if key == "features" and isinstance(inner, list):
            if len(inner) != 1:
                raise InvalidInputError(
                    f"{where}: expected a collection of one feature, got {len(inner)}"
                )
            inner = inner[0]
        data = inner
    try:
        with np.errstate(all="ignore"):  # numbers that are too large are refused below
            geometry = shapely.from_geojson(json.dumps(data))
    except (shapely.errors.GEOSException, TypeError, ValueError):
        rings = data.get("coordinates") if isinstance(data, dict) else None
        if isinstance(rings, list) and data.get("type") == "MultiPolygon" and len(rings) == 1:
            rings = rings[0]
        for number, ring in enumerate(rings if isinstance(rings, list) else (), start=1):
            check_vertices(ring, where, number)
        raise InvalidInputError(
            f"{where}: expected a GeoJSON polygon, got {shortened(data)}"
        ) from None
    return _from_geometry(geometry, where=where)


def _from_geometry(geometry: Any, *, where: str) -> Workspace:
    if geometry is not None and geometry.geom_type == "MultiPolygon" and len(geometry.geoms) == 1:
        geometry = geometry.geoms[0]
    if geometry is None or geometry.geom_type != "Polygon" or geometry.is_empty:
        actual = (
            "nothing"
            if geometry is None
            else "an empty one"
            if geometry.is_empty
            else f"a {geometry.geom_type}"
        )
        raise InvalidInputError(f"{where}: expected one polygon, got {actual}")
    return _from_rings(
        [np.asarray(ring.coords)[:, :2] for ring in (geometry.exterior, *geometry.interiors)],
        where=where,
    )


def _from_rings(rings: list[Any], *, where: str) -> Workspace:
    """Return a workspace from closed lines: the first line is the outline, and the other lines are
    obstacles.
    """
    with errors_at(where):
        try:
            return region(rings[0], rings[1:]) if len(rings) > 1 else polygon(rings[0])
        except InwardCornerError:
            return region(rings[0])
