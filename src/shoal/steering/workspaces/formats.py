"""Workspaces by name and from JSON, GeoJSON, WKT and SVG."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, TypeAdapter, ValidationError

from shoal.errors import InvalidInputError, UnknownNameError
from shoal.steering.workspaces.convex import ConvexWorkspace, cylinder, disk, polygon, prism, regular_polygon
from shoal.steering.workspaces.convex_geometry import Points
from shoal.steering.workspaces.region import Region, region

Workspace = ConvexWorkspace | Region

REGULAR = {"triangle": 3, "pentagon": 5, "hexagon": 6, "heptagon": 7, "octagon": 8}
LARGEST_FILE = 10_000_000  # bytes
_CURVE = 48  # corners that stand for each curve of an SVG path

Pair = tuple[FiniteFloat, FiniteFloat]
Outline = Annotated[list[Pair], Field(max_length=100_000)]


class _Form(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class PolygonForm(_Form):
    """A polygon in a JSON file."""

    type: Literal["polygon"]
    vertices: Outline


class RegularForm(_Form):
    """A regular polygon in a JSON file."""

    type: Literal["regular"]
    sides: int
    radius: FiniteFloat = 0.5


class DiskForm(_Form):
    """A disk in a JSON file."""

    type: Literal["disk"]
    center: Pair = (0.0, 0.0)
    radius: FiniteFloat


class PrismForm(_Form):
    """A right prism in a JSON file."""

    type: Literal["prism"]
    base: PolygonForm | RegularForm
    height: FiniteFloat
    open_ends: bool = False


class CylinderForm(_Form):
    """A cylinder in a JSON file."""

    type: Literal["cylinder"]
    radius: FiniteFloat
    height: FiniteFloat
    open_ends: bool = False


class RegionForm(_Form):
    """A region with obstacles in a JSON file."""

    type: Literal["region"]
    outline: Outline
    obstacles: list[Outline] = []


class TextForm(_Form):
    """Well-known text or an SVG path in a JSON file."""

    type: Literal["wkt", "svg"]
    text: str


Form = Annotated[
    PolygonForm | RegularForm | DiskForm | PrismForm | CylinderForm | RegionForm | TextForm, Field(discriminator="type")
]
_FORM: TypeAdapter[Any] = TypeAdapter(Form)


def open_workspace(source: str | os.PathLike[str] | dict[str, Any]) -> Workspace:
    """Return a workspace by name, from a file, from well-known text or from what JSON says of it.

    Parameters
    ----------
    source : str, path or dict
        A name: ``square`` (side 1, from the origin), ``triangle``, ``pentagon``, ``hexagon``, ``heptagon``, ``octagon`` or
        ``regular:SIDES`` (around the origin, corners on a circle of radius 0.5), ``disk`` (radius 0.5) or ``disk:RADIUS``.
        A file: ``.json`` (as in a problem file, or GeoJSON), ``.geojson``, ``.wkt``, ``.svg`` (its first shape; y is turned up).
        Text: ``POLYGON ((0 0, ...))``. Or the dict of a problem file: ``{"type": "polygon", "vertices": [...]}`` and others.

    Returns
    -------
    ConvexWorkspace or Region
        A region if the source has obstacles or says so.

    Raises
    ------
    UnknownNameError, InvalidInputError
        In one sentence, with the place in the file.

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
    text = os.fspath(source)
    if re.match(r"\s*(multi)?polygon\b", text, flags=re.IGNORECASE):
        return _from_wkt(text, where="workspace")
    path = Path(text)
    if path.suffix.lower() in _READERS or path.exists():
        return read_workspace(path)
    return _named(text)


def read_workspace(path: str | os.PathLike[str]) -> Workspace:
    """Return the workspace in a file; see `open_workspace`.

    Raises
    ------
    InvalidInputError
    """
    source = Path(path)
    suffix = source.suffix.lower()
    if suffix not in _READERS:
        raise InvalidInputError(f"{source}: expected a workspace file ({', '.join(_READERS)}), got the suffix {source.suffix!r}")
    return _READERS[suffix](read_text(source), where=str(source))


def read_text(path: Path) -> str:
    """Return the text of a file of modest size.

    Raises
    ------
    InvalidInputError
    """
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise InvalidInputError(f"{path}: expected at most {LARGEST_FILE} bytes, got {path.stat().st_size}")
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InvalidInputError(f"{path}: expected text in UTF-8, got another byte at {error.start}") from None
    except OSError as error:
        raise InvalidInputError(f"cannot read {path}: {error.strerror or error}") from None


def read_json(text: str, *, where: str) -> Any:
    """Return what a JSON text says.

    Raises
    ------
    InvalidInputError
        With line and column.
    """
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise InvalidInputError(
            f"{where}: expected JSON, got something else at line {error.lineno}, column {error.colno}: {error.msg}"
        ) from None
    except RecursionError:
        raise InvalidInputError(f"{where}: expected JSON, got one that is nested too deeply") from None


def said(error: ValidationError, *, where: str) -> str:
    """Return in one sentence what is wrong with data that does not fit a schema."""
    first = error.errors()[0]
    place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in first["loc"]).lstrip(".")
    got = "" if first["type"] in ("missing", "union_tag_not_found") else f", got {str(first['input'])[:80]!r}"
    return f"{where}: {place + ': ' if place else ''}{first['msg'][:1].lower()}{first['msg'][1:]}{got}"


def workspace_of(data: Any, *, where: str) -> Workspace:
    """Return the workspace that parsed JSON describes, GeoJSON included.

    Raises
    ------
    InvalidInputError
    """
    if isinstance(data, dict) and data.get("type") in (
        "Polygon",
        "MultiPolygon",
        "Feature",
        "FeatureCollection",
        "GeometryCollection",
    ):
        return _from_geojson(data, where=where)
    try:
        form = _FORM.validate_python(data)
    except ValidationError as error:
        raise InvalidInputError(said(error, where=where)) from None
    if isinstance(form, TextForm):
        return (_from_wkt if form.type == "wkt" else _from_path)(form.text, where=where)
    try:
        return _built(form)
    except InvalidInputError as error:
        raise InvalidInputError(f"{where}: {error}") from None


def _built(form: Any) -> Workspace:
    if isinstance(form, PolygonForm):
        return polygon(form.vertices)
    if isinstance(form, RegularForm):
        return regular_polygon(form.sides, radius=form.radius)
    if isinstance(form, DiskForm):
        return disk(form.radius, center=form.center)
    if isinstance(form, CylinderForm):
        return cylinder(form.radius, form.height, open_ends=form.open_ends)
    if isinstance(form, RegionForm):
        return region(form.outline, form.obstacles)
    base = _built(form.base)
    assert isinstance(base, ConvexWorkspace)
    return prism(base, form.height, open_ends=form.open_ends)


def describe(workspace: Workspace) -> dict[str, Any]:
    """Return what `workspace_of` makes the same workspace of.

    Examples
    --------
    >>> describe(disk(0.5))
    {'type': 'disk', 'center': [0.0, 0.0], 'radius': 0.5}
    """
    if isinstance(workspace, Region):
        return {
            "type": "region",
            "outline": workspace.outline.tolist(),
            "obstacles": [part.tolist() for part in workspace.obstacles],
        }
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
        raise InvalidInputError(f"workspace {text!r}: expected a number after the colon, got {option!r}") from None
    names = ("square", *REGULAR, "regular:SIDES", "disk", "disk:RADIUS")
    raise UnknownNameError(f"unknown workspace {text[:80]!r}: expected {', '.join(names)}, a file or POLYGON ((...))")


def _from_json(text: str, *, where: str) -> Workspace:
    data = read_json(text, where=where)
    if isinstance(data, dict) and "workspace" in data:
        data = data["workspace"]
    return workspace_of(data, where=where)


def _from_geojson(data: Any, *, where: str) -> Workspace:
    import shapely

    while isinstance(data, dict) and data.get("type") in ("Feature", "FeatureCollection"):
        key = "geometry" if data["type"] == "Feature" else "features"
        inner = data.get(key)
        if key == "features" and isinstance(inner, list):
            if len(inner) != 1:
                raise InvalidInputError(f"{where}: expected a collection of one feature, got {len(inner)}")
            inner = inner[0]
        data = inner
    try:
        geometry = shapely.from_geojson(json.dumps(data))
    except (shapely.errors.GEOSException, TypeError, ValueError) as error:
        raise InvalidInputError(f"{where}: expected a GeoJSON polygon, got something else: {str(error).strip()[:120]}") from None
    return _from_shape(geometry, where=where)


def _from_wkt(text: str, *, where: str) -> Workspace:
    import shapely

    try:
        geometry = shapely.from_wkt(text.strip())
    except (shapely.errors.GEOSException, TypeError) as error:
        raise InvalidInputError(
            f"{where}: expected well-known text of a polygon, got something else: {str(error).strip()[:120]}"
        ) from None
    return _from_shape(geometry, where=where)


def _from_shape(geometry: Any, *, where: str) -> Workspace:
    if geometry is not None and geometry.geom_type == "MultiPolygon" and len(geometry.geoms) == 1:
        geometry = geometry.geoms[0]
    if geometry is None or geometry.geom_type != "Polygon" or geometry.is_empty:
        raise InvalidInputError(f"{where}: expected one polygon, got {'nothing' if geometry is None else geometry.geom_type}")
    outline = np.asarray(geometry.exterior.coords)[:, :2]
    holes = [np.asarray(ring.coords)[:, :2] for ring in geometry.interiors]
    return _polygon_or_region(outline, holes, where=where)


def _polygon_or_region(outline: Points, holes: list[Points], *, where: str) -> Workspace:
    try:
        return region(outline, holes) if holes else polygon(outline)
    except InvalidInputError as error:
        raise InvalidInputError(f"{where}: {error}") from None


def _from_path(text: str, *, where: str) -> Workspace:
    """Read the d attribute of an SVG path; y is turned up."""
    from fontTools.pens.recordingPen import RecordingPen
    from fontTools.svgLib.path import parse_path

    pen = RecordingPen()
    try:
        parse_path(text, pen)
    except Exception as error:  # a parser of somebody else's that raises what it likes
        raise InvalidInputError(
            f"{where}: expected an SVG path, got something else: {str(error)[:120] or type(error).__name__}"
        ) from None
    return _from_pen(pen.value, where=where)


def _from_svg(text: str, *, where: str) -> Workspace:
    """Read the first shape of an SVG drawing."""
    import xml.etree.ElementTree as Tree

    from fontTools.pens.recordingPen import RecordingPen
    from fontTools.svgLib.path import SVGPath

    pen = RecordingPen()
    try:
        if "<!DOCTYPE" in text.upper() and "<!ENTITY" in text.upper():
            raise InvalidInputError(f"{where}: expected an SVG drawing without entities")
        tree = Tree.fromstring(text)
        circles = [node for node in tree.iter() if node.tag.rpartition("}")[2] == "circle"]
        shapes = [
            node
            for node in tree.iter()
            if node.tag.rpartition("}")[2] in ("path", "polygon", "rect", "circle", "ellipse", "polyline")
        ]
        if circles and shapes[0] is circles[0] and not any("transform" in node.attrib for node in tree.iter()):
            x, y, r = (float(circles[0].get(name, "0")) for name in ("cx", "cy", "r"))
            return disk(r, center=(x, -y))
        SVGPath.fromstring(text.encode()).draw(pen)
    except InvalidInputError:
        raise
    except Exception as error:  # as above
        raise InvalidInputError(
            f"{where}: expected an SVG drawing, got something else: {str(error)[:120] or type(error).__name__}"
        ) from None
    return _from_pen(pen.value, where=where)


def _from_pen(drawn: list[tuple[str, Any]], *, where: str) -> Workspace:
    """Return the polygon that a pen has drawn, curves as many short sides; further closed lines are obstacles."""
    rings: list[list[tuple[float, float]]] = []
    for action, points in drawn:
        if action == "moveTo":
            rings.append([points[0]])
        elif action in ("lineTo", "curveTo", "qCurveTo"):
            rings[-1] += _bent(rings[-1][-1], points)
    outlines = [np.array(ring) * [1.0, -1.0] + 0.0 for ring in rings if len(ring) > 1]
    if not outlines:
        raise InvalidInputError(f"{where}: expected a closed path, got one without lines")
    return _polygon_or_region(outlines[0], outlines[1:], where=where)


def _bent(start: tuple[float, float], points: tuple[tuple[float, float], ...]) -> list[tuple[float, float]]:
    """Return points along a straight line or a Bézier curve, without its start."""
    if len(points) == 1:
        return [points[0]]
    shares = (np.arange(1, _CURVE + 1) / _CURVE)[:, None]
    control = np.array([start, *points])[None].repeat(_CURVE, axis=0)
    while control.shape[1] > 1:  # de Casteljau
        control = control[:, :-1] + shares[:, :, None] * (control[:, 1:] - control[:, :-1])
    return [(float(x), float(y)) for x, y in control[:, 0]]


_READERS = {".json": _from_json, ".geojson": _from_json, ".wkt": _from_wkt, ".svg": _from_svg}
