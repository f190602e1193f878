"""Outlines of workspaces from SVG drawings and paths; y is turned up."""

from __future__ import annotations

from typing import Any

import numpy as np

from shoal.errors import InvalidInputError
from shoal.steering.workspaces.convex import ConvexWorkspace, disk
from shoal.steering.workspaces.convex_geometry import Points

_CURVE = 48  # corners that stand for each curve of a path
_SHAPES = ("path", "polygon", "rect", "circle", "ellipse", "polyline")


def rings_of_path(text: str, *, where: str) -> list[Points]:
    """Return the closed lines that the ``d`` attribute of a path draws, curves as many short sides; each float64, shape (n, 2).

    Raises
    ------
    InvalidInputError
    """
    from fontTools.pens.recordingPen import RecordingPen
    from fontTools.svgLib.path import parse_path

    pen = RecordingPen()
    try:
        parse_path(text, pen)
    except Exception as error:  # a parser of somebody else's that raises what it likes
        raise _refused(error, "path", where) from None
    return _rings(pen.value, where=where)


def read_drawing(text: str, *, where: str) -> ConvexWorkspace | list[Points]:
    """Return the first shape of a drawing: a disk, or closed lines as `rings_of_path` does.

    Raises
    ------
    InvalidInputError
    """
    import xml.etree.ElementTree as Tree

    from fontTools.pens.recordingPen import RecordingPen
    from fontTools.svgLib.path import SVGPath

    if "<!DOCTYPE" in text.upper() and "<!ENTITY" in text.upper():
        raise InvalidInputError(f"{where}: expected an SVG drawing without entities")
    pen = RecordingPen()
    try:
        nodes = [(node.tag.rpartition("}")[2], node) for node in Tree.fromstring(text).iter()]
        first = next(((kind, node) for kind, node in nodes if kind in _SHAPES), None)
        if first is not None and first[0] == "circle" and not any("transform" in node.attrib for _, node in nodes):
            x, y, r = (float(first[1].get(name, "0")) for name in ("cx", "cy", "r"))
            return disk(r, center=(x, -y))
        SVGPath.fromstring(text.encode()).draw(pen)
    except InvalidInputError:
        raise
    except Exception as error:  # as above
        raise _refused(error, "drawing", where) from None
    return _rings(pen.value, where=where)


def _refused(error: Exception, what: str, where: str) -> InvalidInputError:
    why = str(error)[:120] or type(error).__name__
    return InvalidInputError(f"{where}: expected an SVG {what}, got something else: {why}")


def _rings(drawn: list[tuple[str, Any]], *, where: str) -> list[Points]:
    """Return the closed lines that a pen has drawn."""
    rings: list[list[tuple[float, float]]] = []
    for action, points in drawn:
        if action == "moveTo":
            rings.append([points[0]])
        elif action in ("lineTo", "curveTo", "qCurveTo"):
            rings[-1] += _bent(rings[-1][-1], points)
    found = [np.array(ring) * [1.0, -1.0] + 0.0 for ring in rings if len(ring) > 1]
    if not found:
        raise InvalidInputError(f"{where}: expected a closed path, got one without lines")
    return found


def _bent(start: tuple[float, float], points: tuple[tuple[float, float], ...]) -> list[tuple[float, float]]:
    """Return points along a straight line or a Bézier curve, without its start."""
    if len(points) == 1:
        return [points[0]]
    shares = (np.arange(1, _CURVE + 1) / _CURVE)[:, None]
    control = np.array([start, *points])[None].repeat(_CURVE, axis=0)
    while control.shape[1] > 1:  # de Casteljau
        control = control[:, :-1] + shares[:, :, None] * (control[:, 1:] - control[:, :-1])
    return [(float(x), float(y)) for x, y in control[:, 0]]
