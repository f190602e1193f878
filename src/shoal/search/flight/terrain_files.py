"""Readers of files with terrain heights: GeoTIFF and ESRI ASCII grids."""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from shoal.core.checks import check_file, read_text, shortened
from shoal.core.errors import InvalidInputError
from shoal.search.flight.terrain import UNSAID, Floats, Terrain

LARGEST_GRID = 40_000_000
"""Maximum number of heights in a terrain file. Shoal refuses a larger terrain file before it decodes the heights."""

LARGEST_TERRAIN = 500_000_000
"""Maximum size of a terrain file in bytes."""

_SCALE, _TIEPOINT, _TRANSFORM, _KEYS, _NO_DATA = 33550, 33922, 34264, 34735, 42113  # TIFF tags
_MODEL, _RASTER, _GEOGRAPHIC, _PROJECTED, _VERTICAL_UNIT = 1024, 1025, 2048, 3072, 4099  # GeoTIFF keys
_OWN = 32767  # a system without an EPSG code
_METRE = 9001
_HEAD = ("ncols", "nrows", "cellsize")
_AT_ONCE = 2**20  # characters of text that are read at once
_SANE = 20_000.0  # metres: no point on Earth is higher or deeper


def open_terrain(path: str | os.PathLike[str]) -> Terrain:
    """Return the terrain heights in a file.

    Parameters
    ----------
    path : path
        A GeoTIFF (``.tif`` or ``.tiff``) whose coordinate reference system is an EPSG code, or an ESRI ASCII grid (``.asc``). A
        file with the same name and the suffix ``.prj`` gives the coordinate reference system of an ESRI ASCII grid. Without a
        ``.prj`` file, coordinates are longitude and latitude for a region on Earth, and metres for any other region.

    Raises
    ------
    InvalidInputError
        If the file is missing, damaged or not supported.
    """
    source = Path(path)
    readers = {".tif": _geotiff, ".tiff": _geotiff, ".asc": _ascii_grid}
    reader = readers.get(source.suffix.lower())
    if reader is None:
        raise InvalidInputError(f"{source}: expected heights in a file .tif or .asc, got the suffix {source.suffix!r}")
    check_file(source, what="file of heights", most=LARGEST_TERRAIN)
    terrain = reader(source)
    if min(terrain.heights.shape) < 2:
        rows, columns = terrain.heights.shape
        raise InvalidInputError(f"{source}: expected at least 2 rows and 2 columns of heights, got {rows} and {columns}")
    if not np.isfinite(terrain.heights).any():
        raise InvalidInputError(f"{source}: expected heights, got a grid in which all heights are missing")
    if np.nanmax(np.abs(terrain.heights)) > _SANE:
        worst = float(terrain.heights.ravel()[np.nanargmax(np.abs(terrain.heights))])
        raise InvalidInputError(
            f"{source}: expected heights of at most {_SANE:g} m, got {worst:g}; the file may lack a NODATA value"
        )
    return terrain


def _check_size(source: Path, rows: int, columns: int) -> None:
    if rows * columns > LARGEST_GRID:
        raise InvalidInputError(f"{source}: expected at most {LARGEST_GRID} heights, got {columns} x {rows}")


def _check_system(source: Path, crs: str) -> str:
    """Check that a coordinate reference system can be converted to longitude and latitude, and return its name."""
    from pyproj import CRS
    from pyproj.exceptions import ProjError

    try:
        system = CRS.from_user_input(crs)
    except ProjError:
        raise InvalidInputError(f"{source}: expected a known coordinate reference system, got {shortened(crs)}") from None
    if not (system.is_geographic or system.is_projected):
        raise InvalidInputError(
            f"{source}: expected a geographic or projected coordinate reference system, got {shortened(system.name)}"
        )
    return crs


def _geotiff(source: Path) -> Terrain:
    from PIL import Image

    limit = Image.MAX_IMAGE_PIXELS
    try:
        Image.MAX_IMAGE_PIXELS = None  # checked here, to raise an error of our own
        with warnings.catch_warnings(), Image.open(source, formats=("TIFF",)) as image:
            warnings.simplefilter("ignore")
            _check_size(source, image.height, image.width)
            tags: dict[int, Any] = dict(image.tag_v2)  # type: ignore[attr-defined]  # of TIFF pictures
            if len(image.getbands()) != 1 or image.mode not in ("F", "I", "L", "I;16", "I;16B", "I;16L", "I;16S"):
                raise InvalidInputError(f"{source}: expected one band of heights, got {shortened(image.mode)}")
            heights = np.array(image, dtype=np.float64)
    except InvalidInputError:
        raise
    except Exception as error:  # image decoders raise many kinds of exceptions
        raise InvalidInputError(f"{source}: expected a GeoTIFF, got one that cannot be read: {shortened(str(error))}") from None
    finally:
        Image.MAX_IMAGE_PIXELS = limit
    keys = _geo_keys(source, tags)
    west, north, steps = _placement(source, tags, points=keys.get(_RASTER) == 2)
    if keys.get(_VERTICAL_UNIT, _METRE) != _METRE:
        raise InvalidInputError(f"{source}: expected heights in metres, got the unit EPSG:{keys[_VERTICAL_UNIT]}")
    code = keys.get(_PROJECTED if keys.get(_MODEL) == 1 else _GEOGRAPHIC)
    if code is None or code == _OWN:
        raise InvalidInputError(f"{source}: expected the EPSG code of a coordinate reference system, got {code or 'none'}")
    said = str(tags.get(_NO_DATA, "")).strip(" \x00")
    return Terrain(_without(heights, said), west, north, steps, _check_system(source, f"EPSG:{code}"), str(source))


def _geo_keys(source: Path, tags: dict[int, Any]) -> dict[int, int]:
    """Return the GeoTIFF keys with numeric values, as a mapping from key to value."""
    directory = tags.get(_KEYS)
    if not isinstance(directory, tuple) or len(directory) < 4 or len(directory) % 4:
        raise InvalidInputError(f"{source}: expected a GeoTIFF, got a TIFF without the keys of a GeoTIFF")
    entries = [directory[at : at + 4] for at in range(4, len(directory), 4)]
    return {int(key): int(value) for key, where, _, value in entries if where == 0}


def _placement(source: Path, tags: dict[int, Any], *, points: bool) -> tuple[float, float, tuple[float, float]]:
    """Return the coordinates of the north-west grid point of a GeoTIFF, and the distances between columns and between rows.

    If ``points`` is false, heights belong to the centres of grid cells, and the file gives the position of the grid's corner.
    """
    try:
        if _TRANSFORM in tags:
            matrix = [float(value) for value in tags[_TRANSFORM]]
            if matrix[1] or matrix[4]:
                raise InvalidInputError(f"{source}: expected rows from west to east, got a grid that is turned")
            x, y, across, down = matrix[3], matrix[7], matrix[0], -matrix[5]
        else:
            across, down = (float(value) for value in tags[_SCALE][:2])
            column, row, _, left, top, _ = (float(value) for value in tags[_TIEPOINT][:6])
            x, y = left - column * across, top + row * down
    except (KeyError, ValueError, IndexError, TypeError):
        raise InvalidInputError(f"{source}: expected the position of the grid (tags 33550 and 33922, or 34264), got none") from None
    if not (across > 0 and down > 0 and np.isfinite([x, y, across, down]).all()):
        raise InvalidInputError(f"{source}: expected cells with sides above 0, got {across:g} x {down:g}")
    half = 0.0 if points else 0.5
    return x + half * across, y - half * down, (across, down)


def _without(heights: Floats, no_data: str) -> Floats:
    """Return heights in which missing values are replaced by NaN."""
    try:
        missing = float(no_data)
    except ValueError:
        return heights
    if np.isfinite(missing):
        heights[np.abs(heights - missing) <= 1e-6 * abs(missing)] = np.nan
    return heights


def _ascii_grid(source: Path) -> Terrain:
    try:
        with source.open(encoding="utf-8-sig") as file:
            head, line, number = _head(source, file)
            rows, columns = int(head["nrows"]), int(head["ncols"])
            _check_size(source, rows, columns)
            heights = _numbers(source, file, line, number, rows * columns).reshape(rows, columns)
    except UnicodeDecodeError as error:
        raise InvalidInputError(f"{source}: expected text in UTF-8, got byte 0x{error.object[error.start]:02x}") from None
    except OSError as error:
        raise InvalidInputError(f"{source}: cannot be read: {error.strerror or error}") from None
    corner = [next((head[f"{axis}ll{kind}"] for kind in ("center", "corner") if f"{axis}ll{kind}" in head), None) for axis in "xy"]
    if corner[0] is None or corner[1] is None:
        raise InvalidInputError(f"{source}: expected xllcorner and yllcorner, or xllcenter and yllcenter, got none")
    size = head["cellsize"]
    half = 0.0 if "xllcenter" in head else 0.5
    west, south = corner[0] + half * size, corner[1] + half * size
    heights = _without(heights, str(head.get("nodata_value", -9999.0)))
    north = south + (rows - 1) * size
    return Terrain(heights, west, north, (size, size), _system_beside(source), str(source))


def _head(source: Path, file: TextIO) -> tuple[dict[str, float], str, int]:
    """Read the head of an ESRI ASCII grid. Return its fields, the first line after the head, and the number of this line."""
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
                f"{source}, line {number}: expected a number as {shortened(parts[0])}, got {shortened(parts[1])}"
            ) from None
        number += 1
    for name in _HEAD:
        if not (head.get(name, 0.0) > 0 and np.isfinite(head[name])):
            raise InvalidInputError(
                f"{source}: expected {name} above 0 in the head of an ESRI ASCII grid, got {head.get(name, 'none')}"
            )
    return head, line, number


def _numbers(source: Path, file: TextIO, text: str, number: int, count: int) -> Floats:
    """Read ``count`` numbers from a text, which begins in the line ``number``, and from the rest of a file, piece by piece."""
    found, filled = np.empty(count), 0
    while True:
        piece = file.read(_AT_ONCE)
        text += piece
        cut = len(text) if not piece else max(text.rfind(blank) for blank in " \n\t") + 1
        words, text = text[:cut], text[cut:]
        try:
            numbers = np.array(words.split(), dtype=np.float64)
        except ValueError:
            number, line = _wrong_line(words, number)
            raise InvalidInputError(f"{source}, line {number}: expected numbers, got {shortened(line)}") from None
        if filled + len(numbers) > count:
            raise InvalidInputError(f"{source}: expected {count} heights, ncols times nrows, got more")
        if len(text) > _AT_ONCE:
            raise InvalidInputError(f"{source}, line {number}: expected numbers, got {shortened(text[:60])}")
        found[filled : filled + len(numbers)] = numbers
        filled, number = filled + len(numbers), number + words.count("\n")
        if not piece:
            break
    if filled != count:
        raise InvalidInputError(f"{source}: expected {count} heights, ncols times nrows, got {filled}")
    found[~np.isfinite(found)] = np.nan
    return found


def _wrong_line(text: str, number: int) -> tuple[int, str]:
    """Return the number and the text of the first line that holds anything but numbers; the text begins in the line ``number``."""
    for line in text.split("\n"):
        try:
            np.array(line.split(), dtype=np.float64)
        except ValueError:
            return number, line
        number += 1
    return number, text


def _system_beside(source: Path) -> str:
    """Return the coordinate reference system in the ``.prj`` file of an ESRI ASCII grid, or `UNSAID` without a ``.prj`` file."""
    beside = source.with_suffix(".prj")
    if not beside.is_file():
        return UNSAID
    return _check_system(source, read_text(beside, what="coordinate reference system", most=100_000).strip())
