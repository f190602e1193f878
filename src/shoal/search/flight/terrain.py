"""Terrain: heights of the ground under a flight, and the files that hold them."""

from __future__ import annotations

import os
import warnings
from functools import lru_cache
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_file, check_points, read_text, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.gdal import METADATA, NO_DATA, Notes, notes_beside, notes_inside
from shoal.core.geometry import partial_sums, step_lengths
from shoal.search.regions.outline import Points, text_of
from shoal.search.regions.projection import LocalFrame

Floats = NDArray[np.float64]

UNSAID = ""
_FINE = 8  # minimum number of samples per grid cell
_FINEST = 128
_MOST_SAMPLES = 20_000_000
_SHARE = 0.98  # fraction of the requested error that is used; the rest is for rounding in files


@dataclass(frozen=True, eq=False)
class Terrain:
    """Ground heights on a grid, with bilinear interpolation between the grid points.

    Parameters
    ----------
    heights : ndarray of float64, shape (rows, columns)
        Heights in metres above sea level, with rows from north to south. Missing heights are NaN.
    west, north : float
        Coordinates of the north-west grid point, in the coordinate reference system.
    steps : tuple of float
        Distance between neighbouring columns, and distance between neighbouring rows, as positive
        numbers.
    crs : str or None
        Coordinate reference system in PROJ notation, or None for metres without a position on
        Earth. With `UNSAID`, the coordinates are longitude and latitude for a region on Earth, and
        metres for any other region.
    name : str
        Name of the terrain in error messages.

    Examples
    --------
    >>> slope = Terrain(np.array([[0.0, 10.0], [0.0, 10.0]]), 0.0, 100.0, (100.0, 100.0), None)
    >>> slope.at([(25.0, 50.0), (100.0, 0.0)], None).tolist()
    [2.5, 10.0]
    """

    heights: Floats
    west: float
    north: float
    steps: tuple[float, float]
    crs: str | None
    name: str = "terrain"

    def at(self, points: ArrayLike, frame: LocalFrame | None) -> Floats:
        """Return the ground heights in metres at points given in metres of a local frame; float64,
        shape (n,).

        Raises
        ------
        InvalidInputError
            If a height is missing, or if the grid has a position on Earth and the points have none,
            or the reverse.
        """
        places = check_points(points, what="points", dimensions=2)
        return self._heights_at(self.grid_points(places, frame), places)

    def grid_points(self, points: Points, frame: LocalFrame | None) -> Points:
        """Convert points in metres of a local frame to fractional coordinates (column, row) of the
        grid.
        """
        if self.crs != UNSAID and (frame is None) != (self.crs is None):
            kinds = ("metres without a position on Earth", "a position on Earth")
            raise InvalidInputError(
                f"{self.name}: expected {kinds[frame is not None]}, as in the region, got"
                f" {kinds[self.crs is not None]}"
            )
        placed = points
        if frame is not None and self.crs is not None:
            placed = frame.to_degrees(points)
            transformer = _transformer(self.crs or "EPSG:4326")
            if transformer is not None:
                placed = np.stack(transformer.transform(placed[:, 0], placed[:, 1]), axis=1)
        return np.stack(
            [
                (placed[:, 0] - self.west) / self.steps[0],
                (self.north - placed[:, 1]) / self.steps[1],
            ],
            axis=1,
        )

    def _cells(self, places: Points) -> tuple[Any, Any]:
        """Return the column and the row of the grid cell that contains each point."""
        rows, columns = self.heights.shape
        cells = np.floor(np.where(np.isfinite(places), places, -1.0)).astype(np.int64)
        return np.clip(cells[:, 0], 0, max(columns - 2, 0)), np.clip(
            cells[:, 1], 0, max(rows - 2, 0)
        )

    def _heights_at(self, places: Points, points: Points) -> Floats:
        rows, columns = self.heights.shape
        column, row = self._cells(places)
        right, down = places[:, 0] - column, places[:, 1] - row
        near = 1e-9 * max(rows, columns)
        inside = (np.abs(places - (columns - 1) / 2)[:, 0] <= (columns - 1) / 2 + near) & (
            np.abs(places - (rows - 1) / 2)[:, 1] <= (rows - 1) / 2 + near
        )
        corners = [
            self.heights[np.minimum(row + j, rows - 1), np.minimum(column + i, columns - 1)]
            for j in (0, 1)
            for i in (0, 1)
        ]
        weights = [(1 - right) * (1 - down), right * (1 - down), (1 - right) * down, right * down]
        heights = sum(
            np.where(weight == 0, 0.0, weight * corner)
            for weight, corner in zip(weights, corners, strict=True)
        )
        lost = ~inside | ~np.isfinite(heights)
        if lost.any():
            place = text_of(points[int(np.argmax(lost))])
            raise InvalidInputError(
                f"{self.name}: expected heights of the ground under the whole path, got none at"
                f" {place}"
            )
        return np.asarray(heights, dtype=np.float64)

    def twist(self, places: Points) -> float:
        """Return the largest deviation from a plane, in metres, of the grid cells that contain the
        given points.

        The deviation of a grid cell is the vertical distance of one corner from the plane through
        the other three corners.
        """
        column, row = self._cells(places)
        next_cell = (
            np.minimum(column + 1, self.heights.shape[1] - 1),
            np.minimum(row + 1, self.heights.shape[0] - 1),
        )
        bends = (
            self.heights[row, column]
            - self.heights[row, next_cell[0]]
            - self.heights[next_cell[1], column]
            + self.heights[next_cell[1], next_cell[0]]
        )
        return float(np.nanmax(np.abs(bends), initial=0.0))


@lru_cache(maxsize=8)
def _transformer(crs: str) -> Any:
    """Return the transformation from longitude and latitude to a coordinate reference system, or
    None for WGS84 itself.
    """
    from pyproj import CRS, Transformer

    system = CRS.from_user_input(crs)
    wgs84 = CRS.from_epsg(4326)
    if system.equals(wgs84, ignore_axis_order=True):
        return None
    return Transformer.from_crs(wgs84, system, always_xy=True)


@dataclass(frozen=True, eq=False)
class Profile:
    """The height of the ground below a path, sampled so densely that the ground is almost straight
    between samples.

    Parameters
    ----------
    points : ndarray of float64, shape (n, 2)
        Sample positions along the path in metres, including the path's vertices.
    heights : ndarray of float64, shape (n,)
        Ground height of each sample in metres above sea level.
    vertices : ndarray of int64, shape (k,)
        Indices of the path's vertices among the samples.
    rough : float
        Maximum deviation of the ground from straight lines between samples, in metres.
    """

    points: Points
    heights: Floats
    vertices: NDArray[np.int64]
    rough: float


def ground_profile(
    terrain: Terrain, path: Points, frame: LocalFrame | None, *, error: float
) -> Profile:
    """Return ground heights below a path: at the path's vertices, at every crossed grid line, and
    at points in between.

    Parameters
    ----------
    terrain : Terrain
    path : ndarray of float64, shape (k, 2)
        Vertices of the path in metres.
    frame : LocalFrame or None
    error : float
        Allowed error of the height above ground, in metres. Between two samples, the ground
        deviates from a straight line by at most an eighth of ``error``, unless the terrain is too
        rough.
    """
    ends = terrain.grid_points(path, frame)
    spans = np.abs(np.diff(ends, axis=0)).max(axis=1, initial=0.0)
    fine = _FINE
    while True:
        counts = np.maximum(np.ceil(spans * fine), 1).astype(np.int64)
        if not np.isfinite(spans).all() or counts.sum() > _MOST_SAMPLES:
            raise InvalidInputError(
                f"{terrain.name}: expected a path over at most {_MOST_SAMPLES // fine} cells of the"
                f" grid, got {spans.sum():.3g}"
            )
        legs = np.repeat(np.arange(len(counts)), counts)
        shares = (np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[
            legs
        ]
        places = terrain.grid_points(_along(path, legs, shares), frame)
        rough = terrain.twist(places) / (4 * fine * fine)
        if rough <= error / 8 or fine >= _FINEST:
            break
        fine *= 2
    along = np.concatenate(
        [
            legs + shares,
            [float(len(counts))],
            _crossings(legs + shares, np.vstack([places, ends[-1:]])),
        ]
    )
    along = np.unique(along)
    legs = np.minimum(along.astype(np.int64), len(counts) - 1)
    points = _along(path, legs, along - legs)
    vertices = np.searchsorted(along, np.arange(len(path)))
    points[vertices] = path
    return Profile(points, terrain.at(points, frame), vertices, rough)


def _along(path: Points, legs: NDArray[np.int64], shares: Floats) -> Points:
    return np.asarray(path[legs] + shares[:, None] * (path[legs + 1] - path[legs]))


def _crossings(along: Floats, places: Points) -> Floats:
    """Return the positions along a path at which the path crosses a grid line between two samples.

    A position is the index of a leg plus the passed fraction of this leg. Between two samples, the
    path crosses at most one vertical and one horizontal grid line.
    """
    along = np.append(along, np.ceil(along[-1] + 1e-12))
    positions = []
    for axis in (0, 1):
        cell = np.floor(places[:, axis])
        crosses = np.flatnonzero(cell[:-1] != cell[1:])
        line = np.maximum(cell[:-1], cell[1:])[crosses]
        step = places[crosses + 1, axis] - places[crosses, axis]
        share = np.clip((line - places[crosses, axis]) / step, 0.0, 1.0)
        positions.append(along[crosses] + share * (along[crosses + 1] - along[crosses]))
    return np.concatenate(positions)


def limit_climbs(heights: Floats, climbs: Floats, sinks: Floats) -> Floats:
    """Return the lowest heights along a path that keep to limits of climb and descent, and are
    nowhere below given heights.

    Where the given heights rise or fall too steeply, the path climbs earlier, or descends later,
    than the given heights.

    Parameters
    ----------
    heights : ndarray of float64, shape (n,)
        Given height at each point of the path, in metres.
    climbs, sinks : ndarray of float64, shape (n - 1,)
        Largest climb and largest descent on each leg, in metres.

    Examples
    --------
    >>> limit_climbs(np.array([0.0, 0.0, 10.0, 0.0]), np.full(3, 6.0), np.full(3, 8.0)).tolist()
    [0.0, 4.0, 10.0, 2.0]
    """
    up, down = (partial_sums(most) for most in (climbs, sinks))
    raised = np.maximum.accumulate((heights - up)[::-1])[::-1] + up
    return np.asarray(np.maximum.accumulate(raised + down) - down)


def follow_terrain(profile: Profile, clearance: float, error: float) -> Floats:
    """Return a path with a nearly constant height above the ground. The function adds points
    between the path's vertices.

    Parameters
    ----------
    profile : Profile
    clearance : float
        Height above the ground in metres.
    error : float
        Maximum deviation of the height above ground from ``clearance``, in metres, also between
        waypoints.

    Returns
    -------
    ndarray of float64, shape (m, 3)
        Points of the path as metres east, metres north, and metres above sea level.

    Examples
    --------
    >>> hill = Profile(np.array([(0.0, 0.0), (50.0, 0.0), (100.0, 0.0)]), np.array([0.0, 20.0, 0.0]), np.array([0, 2]), 0.0)
    >>> follow_terrain(hill, 30.0, 2.0).tolist()
    [[0.0, 0.0, 30.0], [50.0, 0.0, 50.0], [100.0, 0.0, 30.0]]
    """
    heights = profile.heights + clearance
    most = max(_SHARE * error - profile.rough, 0.0)
    far = partial_sums(step_lengths(profile.points))
    chosen = np.zeros(len(far), dtype=np.bool_)
    chosen[profile.vertices] = True
    while True:
        indices = np.flatnonzero(chosen)
        away = np.abs(np.interp(far, far[indices], heights[indices]) - heights)
        begins = indices[:-1]
        worst = np.maximum.reduceat(away, begins) if len(begins) else np.zeros(0)
        wrong = np.flatnonzero(worst > most)
        if not len(wrong):
            return np.column_stack([profile.points[indices], heights[indices]])
        for stretch in wrong.tolist():
            begin, end = indices[stretch], indices[stretch + 1]
            chosen[begin + int(np.argmax(away[begin:end]))] = True


LARGEST_GRID = 40_000_000
"""Maximum number of heights in a terrain file. Shoal refuses a larger terrain file before it
decodes the heights.
"""

LARGEST_TERRAIN = 500_000_000
"""Maximum size of a terrain file in bytes."""

# TIFF tags
_SCALE, _TIEPOINT, _TRANSFORM, _KEYS = 33550, 33922, 34264, 34735
# GeoTIFF keys
_MODEL, _RASTER, _GEOGRAPHIC, _PROJECTED = 1024, 1025, 2048, 3072
_VERTICAL, _VERTICAL_UNIT = 4096, 4099
_OWN = 32767  # a system without an EPSG code
_METRE = 9001
_HEAD = ("ncols", "nrows", "cellsize")
_AT_ONCE = 2**20  # characters of text that are read at once
_SANE = 20_000.0  # metres: no point on Earth is higher or deeper
_METRES = ("", "m", "metre", "metres", "meter", "meters")  # names of the unit of heights


def open_grid(path: str | os.PathLike[str], *, what: str) -> Terrain:
    """Return the numbers of a grid in a file.

    Parameters
    ----------
    path : path
        A GeoTIFF (``.tif`` or ``.tiff``) whose coordinate reference system is an EPSG code, or an
        ESRI ASCII grid (``.asc``). A file with the same name and the suffix ``.prj`` gives the
        coordinate reference system of an ESRI ASCII grid. Without a ``.prj`` file, coordinates are
        longitude and latitude for a region on Earth, and metres for any other region.
    what : str
        What the numbers are, in error messages.

    Raises
    ------
    InvalidInputError
        If the file is missing, damaged or not supported.
    """
    return _open(path, what)[0]


def _open(path: str | os.PathLike[str], what: str) -> tuple[Terrain, str]:
    """Return the numbers of a grid in a file, and their unit or "" if it is not stated."""
    source = Path(path)
    readers = {".tif": _geotiff, ".tiff": _geotiff, ".asc": _ascii_grid}
    reader = readers.get(source.suffix.lower())
    if reader is None:
        raise InvalidInputError(
            f"{source}: expected {what} in a file .tif or .asc, got the suffix {source.suffix!r}"
        )
    check_file(source, what=f"file of {what}", most=LARGEST_TERRAIN)
    terrain, unit = reader(source)
    unit = _check_notes_beside(source, terrain.heights) or unit
    if min(terrain.heights.shape) < 2:
        rows, columns = terrain.heights.shape
        raise InvalidInputError(
            f"{source}: expected at least 2 rows and 2 columns of {what}, got {rows} and {columns}"
        )
    if not np.isfinite(terrain.heights).any():
        raise InvalidInputError(
            f"{source}: expected {what}, got a grid in which all numbers are missing"
        )
    return terrain, unit


def open_terrain(path: str | os.PathLike[str]) -> Terrain:
    """Return the terrain heights in a file, as `open_grid` reads it.

    Raises
    ------
    InvalidInputError
        If the file is missing, damaged or not supported, if a height is impossible, or if heights
        are not in metres.
    """
    source = Path(path)
    terrain, unit = _open(source, "heights")
    if unit.strip().lower() not in _METRES:
        raise InvalidInputError(
            f"{source}: expected heights in metres, got the unit {shortened(unit)}"
        )
    if np.nanmax(np.abs(terrain.heights)) > _SANE:
        worst = float(terrain.heights.ravel()[np.nanargmax(np.abs(terrain.heights))])
        raise InvalidInputError(
            f"{source}: expected heights of at most {_SANE:g} m, got {worst:g}; the file may lack a"
            " NODATA value"
        )
    return terrain


def _check_size(source: Path, rows: int, columns: int) -> None:
    if rows * columns > LARGEST_GRID:
        raise InvalidInputError(
            f"{source}: expected at most {LARGEST_GRID} heights, got {columns} x {rows}"
        )


def _check_system(source: Path, crs: str) -> tuple[str, str]:
    """Check that a coordinate reference system can be converted to longitude and latitude, and
    return its name, and the unit of its heights.
    """
    from pyproj import CRS
    from pyproj.exceptions import ProjError

    try:
        system = CRS.from_user_input(crs)
    except ProjError:
        raise InvalidInputError(
            f"{source}: expected a known coordinate reference system, got {shortened(crs)}"
        ) from None
    if not (system.is_geographic or system.is_projected):
        raise InvalidInputError(
            f"{source}: expected a geographic or projected coordinate reference system, got"
            f" {shortened(system.name)}"
        )
    return crs, _unit_of(system)


def _unit_of(system: Any) -> str:
    """Return the unit of the heights of a coordinate reference system, or "" if it has none, or
    metres.
    """
    for axis in (axis for part in system.sub_crs_list or [system] for axis in part.axis_info):
        if axis.direction == "down":
            return f"{axis.unit_name} of depth"
        if axis.direction == "up" and axis.unit_conversion_factor != 1:
            return str(axis.unit_name)
    return ""


def _vertical_unit(keys: dict[int, int]) -> str:
    """Return the unit of the heights of a GeoTIFF by its keys, or "" for metres, or if they say none."""
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    unit = keys.get(_VERTICAL_UNIT, _METRE)
    if unit != _METRE:
        return f"EPSG:{unit}"
    try:
        return _unit_of(CRS.from_epsg(keys[_VERTICAL]))
    except (KeyError, CRSError):  # old numbers of ellipsoids are no systems of heights
        return ""


def _check_notes_beside(source: Path, heights: Floats) -> str:
    """Refuse a grid whose numbers have another meaning by the file that GDAL writes beside it, and
    return the unit by that file.
    """
    bands, beside = notes_beside(source)
    if not bands:
        return ""
    notes = bands[0]
    known = np.isfinite(heights).sum()
    lost = notes.no_data and np.isfinite(_mask_no_data(heights.copy(), notes.no_data)).sum() < known
    if (notes.scale, notes.offset) != (1.0, 0.0) or lost:
        got = (
            f"the missing number {notes.no_data}"
            if lost
            else f"a scale of {notes.scale:g} and an offset of {notes.offset:g}"
        )
        raise InvalidInputError(
            f"{beside}: expected numbers whose meaning is in {source.name} itself, got {got}; write"
            " it with gdal_translate -unscale, or with -a_nodata"
        )
    return notes.unit


def _geotiff(source: Path) -> tuple[Terrain, str]:
    from PIL import Image

    limit = Image.MAX_IMAGE_PIXELS
    try:
        Image.MAX_IMAGE_PIXELS = None  # checked here, to raise an error of our own
        with warnings.catch_warnings(), Image.open(source, formats=("TIFF",)) as image:
            warnings.simplefilter("ignore")
            _check_size(source, image.height, image.width)
            # of TIFF pictures
            tags: dict[int, Any] = dict(image.tag_v2)  # type: ignore[attr-defined]
            if len(image.getbands()) != 1 or image.mode not in (
                "F",
                "I",
                "L",
                "I;16",
                "I;16B",
                "I;16L",
                "I;16S",
            ):
                raise InvalidInputError(
                    f"{source}: expected one band of heights, got {shortened(image.mode)}"
                )
            heights = np.array(image, dtype=np.float64)
    except InvalidInputError:
        raise
    except Exception as error:  # image decoders raise many kinds of exceptions
        raise InvalidInputError(
            f"{source}: expected a GeoTIFF, got one that cannot be read: {shortened(str(error))}"
        ) from None
    finally:
        Image.MAX_IMAGE_PIXELS = limit
    keys = _geo_keys(source, tags)
    west, north, steps = _placement(source, tags, points=keys.get(_RASTER) == 2)
    code = keys.get(_PROJECTED if keys.get(_MODEL) == 1 else _GEOGRAPHIC)
    if code is None or code == _OWN:
        raise InvalidInputError(
            f"{source}: expected the EPSG code of a coordinate reference system, got"
            f" {code or 'none'}"
        )
    notes = Notes()
    if METADATA in tags:
        notes = notes_inside(str(tags[METADATA]), str(source))[0]
    # the missing number is one of the file, before scale and offset
    heights = _mask_no_data(heights, str(tags.get(NO_DATA, "")).strip(" \x00"))
    if (notes.scale, notes.offset) != (1.0, 0.0):
        heights = heights * notes.scale + notes.offset
    system, unit = _check_system(source, f"EPSG:{code}")
    terrain = Terrain(heights, west, north, steps, system, str(source))
    return terrain, notes.unit or _vertical_unit(keys) or unit


def _geo_keys(source: Path, tags: dict[int, Any]) -> dict[int, int]:
    """Return the GeoTIFF keys with numeric values, as a mapping from key to value."""
    directory = tags.get(_KEYS)
    if not isinstance(directory, tuple) or len(directory) < 4 or len(directory) % 4:
        raise InvalidInputError(
            f"{source}: expected a GeoTIFF, got a TIFF without the keys of a GeoTIFF"
        )
    entries = [directory[at : at + 4] for at in range(4, len(directory), 4)]
    return {int(key): int(value) for key, where, _, value in entries if where == 0}


def _placement(
    source: Path, tags: dict[int, Any], *, points: bool
) -> tuple[float, float, tuple[float, float]]:
    """Return the coordinates of the north-west grid point of a GeoTIFF, and the distances between
    columns and between rows.

    If ``points`` is false, heights belong to the centres of grid cells, and the file gives the
    position of the grid's corner.
    """
    try:
        if _TRANSFORM in tags:
            matrix = [float(value) for value in tags[_TRANSFORM]]
            if matrix[1] or matrix[4]:
                raise InvalidInputError(
                    f"{source}: expected rows from west to east, got a grid that is turned"
                )
            x, y, across, down = matrix[3], matrix[7], matrix[0], -matrix[5]
        else:
            across, down = (float(value) for value in tags[_SCALE][:2])
            column, row, _, left, top, _ = (float(value) for value in tags[_TIEPOINT][:6])
            x, y = left - column * across, top + row * down
    except (KeyError, ValueError, IndexError, TypeError):
        raise InvalidInputError(
            f"{source}: expected the position of the grid (tags 33550 and 33922, or 34264), got"
            " none"
        ) from None
    if not (across > 0 and down > 0 and np.isfinite([x, y, across, down]).all()):
        raise InvalidInputError(
            f"{source}: expected cells with sides above 0, got {across:g} x {down:g}"
        )
    half = 0.0 if points else 0.5
    return x + half * across, y - half * down, (across, down)


def _mask_no_data(heights: Floats, no_data: str) -> Floats:
    """Return heights in which missing values are replaced by NaN."""
    try:
        missing = float(no_data)
    except ValueError:
        return heights
    if np.isfinite(missing):
        heights[np.abs(heights - missing) <= 1e-6 * abs(missing)] = np.nan
    return heights


def _ascii_grid(source: Path) -> tuple[Terrain, str]:
    try:
        with source.open(encoding="utf-8-sig") as file:
            head, line, number = _read_header(source, file)
            rows, columns = int(head["nrows"]), int(head["ncols"])
            _check_size(source, rows, columns)
            heights = _numbers(source, file, line, number, rows * columns).reshape(rows, columns)
    except UnicodeDecodeError as error:
        raise InvalidInputError(
            f"{source}: expected text in UTF-8, got byte 0x{error.object[error.start]:02x}"
        ) from None
    except OSError as error:
        raise InvalidInputError(f"{source}: cannot be read: {error.strerror or error}") from None
    corner = [
        next(
            (head[f"{axis}ll{kind}"] for kind in ("center", "corner") if f"{axis}ll{kind}" in head),
            None,
        )
        for axis in "xy"
    ]
    if corner[0] is None or corner[1] is None:
        raise InvalidInputError(
            f"{source}: expected xllcorner and yllcorner, or xllcenter and yllcenter, got none"
        )
    size = head["cellsize"]
    half = 0.0 if "xllcenter" in head else 0.5
    west, south = corner[0] + half * size, corner[1] + half * size
    heights = _mask_no_data(heights, str(head.get("nodata_value", -9999.0)))
    north = south + (rows - 1) * size
    system, unit = _system_beside(source)
    return Terrain(heights, west, north, (size, size), system, str(source)), unit


def _read_header(source: Path, file: TextIO) -> tuple[dict[str, float], str, int]:
    """Read the head of an ESRI ASCII grid. Return its fields, the first line after the head, and
    the number of this line.
    """
    head: dict[str, float] = {}
    number = 1
    while True:
        line = file.readline(_AT_ONCE)
        parts = line.split()
        if len(parts) != 2 or not parts[0][0].isalpha() or parts[0].lower() in head:
            break
        try:
            head[parts[0].lower()] = float(parts[1])
        except ValueError:
            raise InvalidInputError(
                f"{source}, line {number}: expected a number as {shortened(parts[0])}, got"
                f" {shortened(parts[1])}"
            ) from None
        number += 1
    for name in _HEAD:
        if not (head.get(name, 0.0) > 0 and np.isfinite(head[name])):
            raise InvalidInputError(
                f"{source}: expected {name} above 0 in the head of an ESRI ASCII grid, got"
                f" {head.get(name, 'none')}"
            )
    return head, line, number


def _numbers(source: Path, file: TextIO, text: str, number: int, count: int) -> Floats:
    """Read ``count`` numbers from a text, which begins in the line ``number``, and from the rest of
    a file, piece by piece.
    """
    values, filled = np.empty(count), 0
    while True:
        chunk = file.read(_AT_ONCE)
        text += chunk
        cut = len(text) if not chunk else max(text.rfind(blank) for blank in " \n\t") + 1
        words, text = text[:cut], text[cut:]
        try:
            numbers = np.array(words.split(), dtype=np.float64)
        except ValueError:
            number, line = _wrong_line(words, number)
            raise InvalidInputError(
                f"{source}, line {number}: expected numbers, got {shortened(line)}"
            ) from None
        if filled + len(numbers) > count:
            raise InvalidInputError(
                f"{source}: expected {count} heights, ncols times nrows, got more"
            )
        if len(text) > _AT_ONCE:
            raise InvalidInputError(
                f"{source}, line {number}: expected numbers, got {shortened(text[:60])}"
            )
        values[filled : filled + len(numbers)] = numbers
        filled, number = filled + len(numbers), number + words.count("\n")
        if not chunk:
            break
    if filled != count:
        raise InvalidInputError(
            f"{source}: expected {count} heights, ncols times nrows, got {filled}"
        )
    values[~np.isfinite(values)] = np.nan
    return values


def _wrong_line(text: str, number: int) -> tuple[int, str]:
    """Return the number and the text of the first line that holds anything but numbers; the text
    begins in the line ``number``.
    """
    for line in text.split("\n"):
        try:
            np.array(line.split(), dtype=np.float64)
        except ValueError:
            return number, line
        number += 1
    return number, text


def system_file(source: Path) -> Path | None:
    """Return the file that gives the coordinate reference system of an ESRI ASCII grid, or None."""
    beside = source.with_suffix(".prj")
    return beside if source.suffix.lower() == ".asc" and beside.is_file() else None


def _system_beside(source: Path) -> tuple[str, str]:
    """Return the coordinate reference system in the ``.prj`` file of an ESRI ASCII grid, or
    `UNSAID` without a ``.prj`` file, and the unit of its heights.
    """
    beside = system_file(source)
    if beside is None:
        return UNSAID, ""
    return _check_system(
        source, read_text(beside, what="coordinate reference system", most=100_000).strip()
    )
