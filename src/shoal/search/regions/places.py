"""Names of regions, and coordinates typed by users."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from shoal.core.errors import InvalidInputError, UnknownNameError
from shoal.search.regions.formats.features import read_positions, read_vertices
from shoal.search.regions.outline import (
    Points,
    RegionOutline,
    RegionOutlines,
    Ring,
    check_plane_points,
    text_of,
)
from shoal.search.regions.region import SearchRegion

_NUMBER = r"\s*[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?\s*"
_COORDINATES = re.compile(rf"{_NUMBER},{_NUMBER}(?:;{_NUMBER},{_NUMBER})*")


def places_of(value: str | ArrayLike, region: SearchRegion, robots: int, *, what: str) -> Points:
    """Return one point for each robot in metres, such as a launch point; float64, shape (robots,
    2).

    Parameters
    ----------
    value : str or array_like of float, shape (1, 2) or (robots, 2)
        One point in metres for all robots, one point in metres for each robot, or a text. The text
        holds points of the form ``x,y`` separated by semicolons, or the path of a CSV or GeoJSON
        file of points. Points in a text are in degrees for a region on Earth, and in metres for any
        other region. If a GeoJSON file contains a line, the function spaces the robots evenly along
        this line.
    region : SearchRegion
    robots : int
        Number of robots.
    what : str
        Name of the points in error messages.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> from shoal.search import open_region
    >>> places_of("0,-5;10,-5", open_region("square:20"), 2, what="launch").tolist()
    [[0.0, -5.0], [10.0, -5.0]]
    """
    if not isinstance(value, str):
        points, line = check_plane_points(value, what=what), False
    elif _COORDINATES.fullmatch(value):
        given = np.array([pair.split(",") for pair in value.split(";")], dtype=np.float64)
        points, line = _in_metres(given, region, what, degrees=None), False
    else:
        points, line = _read(Path(value), region, what)
    if line:
        import shapely

        way = shapely.linestrings(points)
        spaced = shapely.line_interpolate_point(
            way, (np.arange(robots) + 0.5) / robots, normalized=True
        )
        return np.asarray(shapely.get_coordinates(spaced))
    if len(points) not in (1, robots):
        raise InvalidInputError(
            f"{what}: expected one point for all, or {robots}, one per robot, got {len(points)}"
        )
    return np.array(np.broadcast_to(points, (robots, 2)))


def read_points(path: Path, region: SearchRegion, *, what: str, count: int | None = None) -> Points:
    """Return the points in a CSV or GeoJSON file, converted to metres; float64, shape (k, 2).

    Parameters
    ----------
    path : path
    region : SearchRegion
        The region whose local frame the result uses.
    what : str
        Name of the points in error messages.
    count : int, optional
        Number of points that the file must contain. By default, the file may contain any number of
        points.

    Raises
    ------
    InvalidInputError
        If the file is invalid, or if its longitudes and latitudes seem to be swapped. The error
        message names the file.
    """
    points, line = _read(path, region, what)
    if line:
        raise InvalidInputError(f"{path}: expected points, got a line")
    if count is not None and len(points) != count:
        raise InvalidInputError(
            f"{path}: expected {count} {what}, one per robot, got {len(points)}"
        )
    return points


def _read(path: Path, region: SearchRegion, what: str) -> tuple[Points, bool]:
    """Return the points in a file, converted to metres, and whether the points are the vertices of
    a line.
    """
    if path.suffix.lower() in (".geojson", ".json"):
        found, line = read_positions(path, what=f"file of {what}")
        return _in_metres(found, region, path, degrees=True), line
    rows, degrees = read_vertices(path, what=f"table of {what}")
    points = np.array([row[:2] for row in rows if row is not None]).reshape(-1, 2)
    return _in_metres(points, region, path, degrees=degrees), False


def _in_metres(points: Points, region: SearchRegion, where: Any, *, degrees: bool | None) -> Points:
    """Convert points to metres in the local frame of a region. If ``degrees`` is None, points are
    in the unit of the region.
    """
    if region.frame is None and degrees:
        raise InvalidInputError(
            f"{where}: expected metres, because the region {region.name!r} has no position on"
            " Earth, got degrees"
        )
    if region.frame is None or degrees is False:
        return points
    try:
        found = region.frame.to_metres(points)
    except InvalidInputError as error:
        _refuse_swapped(points, region, where, far=True)
        raise InvalidInputError(f"{where}: {error}") from None
    if not region.contains(found).all():
        _refuse_swapped(points, region, where, far=False)
    return found


def _refuse_swapped(points: Points, region: SearchRegion, where: Any, *, far: bool) -> None:
    """Refuse points outside a region if the user seems to have swapped longitude and latitude.

    If ``far`` is true, the given points are too far away for the local frame. The function then
    refuses points that are near the region after a swap of longitude and latitude. If ``far`` is
    false, the function refuses only points that are in the region after the swap.
    """
    assert region.frame is not None
    try:
        swapped = region.frame.to_metres(points[:, ::-1])
    except InvalidInputError:
        return
    inside = bool(region.contains(swapped).all())
    if far or inside:
        raise InvalidInputError(
            f"{where}: expected longitude first and then latitude, got {text_of(points[0])}, which"
            f" lies {'in' if inside else 'near'} the region if the two numbers are swapped"
        )


_CORNERS = 360  # corners of the polygon that approximates a circle

Shape = Callable[[str, list[float]], list[Points]]


def builtin_region(text: str) -> RegionOutlines:
    """Return the outline of a built-in region from its name with sizes, such as ``square:100``; see
    `shoal.search.open_region`.

    Raises
    ------
    InvalidInputError, UnknownNameError
    """
    name, _, option = text.partition(":")
    if name not in SHAPES:
        near = difflib.get_close_matches(name, SHAPES, n=1, cutoff=0.5)
        guess = f"did you mean {near[0]!r}? " if near else ""
        known = ", ".join(f"{known}:{form}" for known, (form, _) in SHAPES.items())
        raise UnknownNameError(f"unknown region {text[:80]!r}: {guess}(known: {known}, or a file)")
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
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


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
