"""Points that users type or give as files, such as launch points."""

from __future__ import annotations

import os
import re
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import is_wkt, read_linestring, read_text, shortened
from shoal.core.errors import InvalidInputError
from shoal.search.regions.formats.flight_logs import GAP, LOGS, interruptions, search_lines
from shoal.search.regions.formats.geodata import read_positions
from shoal.search.regions.formats.kml import read_gpx_line, read_gpx_tracks
from shoal.search.regions.formats.tables import Vertex, read_vertices
from shoal.search.regions.outline import (
    LARGEST_FILE,
    Points,
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

    Examples
    --------
    >>> from shoal.search import open_region
    >>> places_of("0,-5;10,-5", open_region("square:20"), 2, what="launch").tolist()
    [[0.0, -5.0], [10.0, -5.0]]
    """
    if not isinstance(value, str):
        points, line = check_plane_points(value, what=what), False
    elif _COORDINATES.fullmatch(value):
        coordinates = np.array([pair.split(",") for pair in value.split(";")], dtype=np.float64)
        points, line = _in_metres(coordinates, region, what, degrees=None), False
    else:
        _refuse_text(value, what, points=True)
        points, line = _read(Path(value), region, what)
    if line:
        import shapely

        linestring = shapely.linestrings(points)
        spaced = shapely.line_interpolate_point(
            linestring, (np.arange(robots) + 0.5) / robots, normalized=True
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
            f"{path}: expected {count} {_content(what)}, one per robot, got {len(points)}"
        )
    return points


def read_line(value: str | ArrayLike, region: SearchRegion, *, what: str) -> Points:
    """Return the vertices of a line in metres, such as the middle of a road; float64, shape (k, 2).

    Parameters
    ----------
    value : str or array_like of float, shape (k, 2)
        Points in metres, a text ``LINESTRING (x y, ...)``, or the path of a file: GeoJSON with one
        line, GPX with one track or route, a WKT or a CSV file. Texts and files of WKT are in
        degrees for a region on Earth, and in metres for any other region.
    region : SearchRegion
        The region whose local frame the result uses.
    what : str
        Name of the line in error messages.

    Examples
    --------
    >>> from shoal.search import open_region
    >>> read_line("LINESTRING (0 5, 20 5)", open_region("square:20"), what="along").tolist()
    [[0.0, 5.0], [20.0, 5.0]]
    """
    if not isinstance(value, str):
        points = check_plane_points(value, what=what)
    elif is_wkt(value):
        points = _in_metres(_wkt_line(value, what), region, what, degrees=None)
    else:
        path = Path(value)
        kind = path.suffix.lower()
        if kind == ".wkt":
            text = read_text(path, what=f"file of {_content(what)}", most=LARGEST_FILE)
            points = _in_metres(_wkt_line(text, value), region, value, degrees=None)
        elif kind == ".gpx":
            points = _in_metres(read_gpx_line(path), region, value, degrees=True)
        else:
            points = _read(path, region, what)[0]
    if len(points) < 2 or not np.ptp(points, axis=0).any():
        raise InvalidInputError(f"{what}: expected a line of two points or more, got {len(points)}")
    return points


def _wkt_line(text: str, where: str) -> Points:
    import shapely

    line = read_linestring(text, where=where)
    if line.geom_type != "LineString" or line.is_empty:
        kind = "an empty one" if line.is_empty else f"a {line.geom_type}"
        raise InvalidInputError(f"{where}: expected a LINESTRING, got {kind}")
    return check_plane_points(shapely.get_coordinates(line), what=where)


_SIMPLER = (
    0.01  # of a footprint: from each leg of a simplified track, points lie at most this far away
)
_RARE = 10.0  # times the usual time between two positions, after which a GPX track is interrupted
_GAP = 1e-3  # metres: narrower gaps between what two legs saw are rounding errors


def swept_area(
    track: str | ArrayLike,
    region: SearchRegion,
    side: float,
    *,
    flies: bool = True,
    altitude: float | None = None,
) -> Any:
    """Return what a vehicle saw along a track that it flew: the squares of the given side along each
    leg, as a Shapely geometry in metres.

    Parameters
    ----------
    track : str or array_like of float, shape (k, 2)
        Points in metres, or the path of a file: a CSV or GeoJSON file of points or of a line, the
        tracks of a GPX file, or a flight log (``.tlog``, ``.bin`` or ``.ulg``), which counts while
        its vehicle is high enough. Blank lines and other labels of a CSV file, segments and long
        gaps of GPX, gaps of a log, and positions that no vehicle reaches in time interrupt the
        track.
    region : SearchRegion
        The region whose local frame the result uses.
    side : float
        Side of the square in metres. The square is parallel to the leg.
    flies : bool
        Whether the vehicle flies. All of a rover's log counts, whatever heights it says.
    altitude : float, optional
        Altitude in metres above home from which a vehicle sees the squares. A log counts from 0.8
        times this altitude on, by default from 0.8 times the height above which it has half of its
        way.

    Examples
    --------
    >>> from shoal.search import open_region
    >>> swept_area([(10.0, 10.0), (50.0, 10.0)], open_region("square:100"), 20.0).area
    1200.0
    """
    import shapely

    lines = (
        _track_lines(Path(track), region, flies=flies, altitude=altitude)
        if isinstance(track, str)
        else [check_plane_points(track, what="searched")]
    )
    longest = max(map(len, lines), default=0)
    if longest < 2:
        raise InvalidInputError(f"searched: expected a track of two points or more, got {longest}")
    pairs = []
    for points in lines:
        check_plane_points(
            points, what=f"searched: {track}" if isinstance(track, str) else "searched"
        )
        if len(points) > 1:
            line = shapely.simplify(shapely.linestrings(points), _SIMPLER * side)
            vertices = shapely.get_coordinates(line)
            pairs.append(np.stack([vertices[:-1], vertices[1:]], axis=1))
    legs = shapely.linestrings(np.concatenate(pairs))
    legs = legs[shapely.length(legs) > 0]
    if not len(legs):
        raise InvalidInputError("searched: expected a track that moves, got one place")
    strip = shapely.union_all(shapely.buffer(legs, side / 2, cap_style="square"))
    return strip.buffer(_GAP, join_style="mitre").buffer(-_GAP, join_style="mitre")


def _track_lines(
    path: Path, region: SearchRegion, *, flies: bool, altitude: float | None
) -> list[Points]:
    """Return the uninterrupted parts of a track in a file, in metres."""
    _refuse_text(str(path), "searched")
    kind = path.suffix.lower()
    if kind == ".gpx":
        segments = read_gpx_tracks(path)
        if not segments:
            raise InvalidInputError(f"{path}: expected a track that was flown, got none")
        lines = [part for points, times in segments for part in _uninterrupted(points, times)]
    elif kind in LOGS:
        lines = search_lines(path, flies=flies, altitude=altitude)
    elif kind in (".geojson", ".json"):
        return [_read(path, region, "searched")[0]]
    else:
        rows, degrees, labels = read_vertices(path, what=f"table of {_content('searched')}")
        heading = read_text(
            path, what=f"table of {_content('searched')}", most=LARGEST_FILE
        ).partition("\n")[0]
        if {"command", "sortie"} <= {*heading.lower().split(",")}:
            raise InvalidInputError(f"{path}: expected a track that was flown, got a mission")
        named = labels not in ("", "name")  # a name may be that of a point
        groups = groupby(rows, lambda row: row and (row.label or "") * named)
        tables = [
            np.array([row[:2] for row in group if row])
            for label, group in groups
            if label is not None
        ]
        return [_in_metres(table, region, path, degrees=degrees) for table in tables]
    return [_in_metres(line, region, path, degrees=True) for line in lines if len(line)]


def _uninterrupted(points: Points, times: NDArray[np.float64] | None) -> list[Points]:
    """Return the parts of a segment of a GPX track between its interruptions, if its times are
    known.
    """
    if times is None or len(points) < 2:
        return [points]
    usual = float(np.median(np.abs(np.diff(times))))
    # recorders leave out positions on straight lines, and write whole seconds
    return np.split(points, interruptions(times, points, gap=max(GAP, _RARE * usual), exact=1.0))


_CONTENTS = {
    "launch": "launch points",
    "land": "landing points",
    "starts": "start positions",
    "along": "the points of a line",
    "searched": "the points of a track",
}


def _content(what: str) -> str:
    """Return what the file of a field contains, for messages: names of fields are no nouns there."""
    return _CONTENTS.get(what, what)


def points_inside(source: str | ArrayLike, region: SearchRegion, *, what: str) -> Points:
    """Return points inside a region in metres, which are given as an array in metres or as the path
    of a file; float64, shape (k, 2).

    Raises
    ------
    InvalidInputError
        If the file is invalid, or if a point lies outside the region.
    """
    if isinstance(source, str):
        return region.check_inside(read_points(Path(source), region, what=what), what=source)
    return region.check_inside(source, what=what)


def _read(path: Path, region: SearchRegion, what: str) -> tuple[Points, bool]:
    """Return the points in a file, converted to metres, and whether the points are the vertices of
    a line.
    """
    _refuse_text(str(path), what)
    if path.suffix.lower() in (".geojson", ".json"):
        positions, line, geographic = read_positions(path, what=f"file of {_content(what)}")
        return _in_metres(positions, region, path, degrees=geographic), line
    rows, degrees, labels = read_vertices(path, what=f"table of {_content(what)}")
    vertices = [row for row in rows if row is not None]
    if labels == "robot":
        vertices = _by_robot(vertices, path)
    points = np.array([vertex[:2] for vertex in vertices]).reshape(-1, 2)
    return _in_metres(points, region, path, degrees=degrees), False


def _refuse_text(value: str, what: str, *, points: bool = False) -> None:
    """Refuse a well-known text in place of a file or, with ``points``, of points. Of points, also
    say which one is wrong.
    """
    if os.path.exists(value):
        return
    if is_wkt(value):
        raise InvalidInputError(
            f"{what}: expected a file of {_content(what)}"
            f"{', or points such as 0,-5;10,-5' if points else ''}, got {shortened(value)}"
        )
    if points and set(value) <= set("0123456789+-.eE,; \t"):
        for number, point in enumerate(value.split(";"), start=1):
            if not _COORDINATES.fullmatch(point):
                raise InvalidInputError(
                    f"{what}, point {number}: expected two numbers, x,y, got {shortened(point)}"
                )


def _by_robot(vertices: list[Vertex], path: Path) -> list[Vertex]:
    """Return the points of robots 1, 2, ... in the order of the robots."""
    found = {vertex.label: vertex for vertex in vertices}
    expected = [str(number) for number in range(1, len(vertices) + 1)]
    for vertex in vertices:
        if vertex.label not in expected or found[vertex.label] is not vertex:
            raise InvalidInputError(
                f"{path}: line {vertex.line}: expected the numbers 1 to {len(vertices)} in the"
                f" column robot, each of them once, got {vertex.label!r}"
            )
    return [found[number] for number in expected]


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
        places = region.frame.to_metres(points)
    except InvalidInputError as error:
        _refuse_swapped(points, region, where, far=True)
        raise InvalidInputError(f"{where}: {error}") from None
    if not region.contains(places).all():
        _refuse_swapped(points, region, where, far=False)
    return places


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
