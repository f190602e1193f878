"""Map tiles of the user's own below the plan view: a folder z/x/y.png, or a PMTiles file.

Tiles are pictures in the usual squares of the Web Mercator projection. At zoom z, the Earth has 2**z
columns and rows of them, from the west and from the north.
"""

from __future__ import annotations

import base64
import gzip
import html
import io
import os
import re
from collections.abc import Callable
from functools import lru_cache
from math import atan, degrees, pi, sinh
from pathlib import Path
from typing import Any, TypeVar

from shoal.core.checks import check_integer, shortened
from shoal.core.errors import InvalidInputError, describe_error
from shoal.studio.folder import (
    LARGEST_ZOOM,
    TILES,
    Folder,
    is_zoom_folder,
    numbered_folders,
)

Answer = TypeVar("Answer")
NO_TILE = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAQAAAC1HAwCAAAAC0lEQVR42mNgYAAAAAMAASsJTYQAAAAASUVORK5CYII="
)
"""A transparent picture, which a browser gets where there is no tile."""

LARGEST_PIECE = 4 * 2**20
"""Maximum size in bytes of a directory, the metadata or a tile of a PMTiles file, unfolded. The
library unfolds without a limit, and needs some hundred bytes of memory for each entry of a directory.
"""

_NORTH = "tilemapresource.xml"  # beside tiles whose rows are counted from the south


def tiles(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return what a page needs to know of tiles: the smallest and the largest zoom, the
    ``bounds`` as degrees west, south, east and north, and whom to name.
    """
    name = str(about["file"])
    path = folder.path(name)
    if path.is_file():
        return _read(path, _Archive.described)
    return _describe_folder(path, name)


def tile(folder: Folder, name: str, zoom: int, column: int, row: int) -> tuple[bytes, str]:
    """Return a tile as a picture and its media type; where there is none, `NO_TILE`.

    Raises
    ------
    InvalidInputError
        Raised for a name that is neither a folder nor a PMTiles file with pictures.
    """
    path = folder.path(name)
    check_integer(zoom, what="zoom", least=0, most=LARGEST_ZOOM)
    if path.is_file():
        return _read(path, lambda archive: archive.tile(zoom, column, row))
    if not path.is_dir():
        raise InvalidInputError(f"tiles: expected a folder or PMTiles file, got {shortened(name)}")
    if (path / _NORTH).is_file():
        row = 2**zoom - 1 - row
    for suffix, kind in TILES.items():
        file = folder.path(f"{name}/{zoom}/{column}/{row}{suffix}")
        if file.is_file():
            return file.read_bytes(), kind
    return NO_TILE, "image/png"


def _describe_folder(path: Path, name: str) -> dict[str, Any]:
    zooms = (
        [zoom for zoom in numbered_folders(path) if is_zoom_folder(path / str(zoom))]
        if path.is_dir()
        else []
    )
    if not zooms:
        raise InvalidInputError(
            f"tiles: expected a folder of z/x/y.png or a PMTiles file, got {shortened(name)}"
        )
    zoom = zooms[-1]
    columns = numbered_folders(path / str(zoom))
    rows = [
        int(stem)
        for column in columns
        for entry in os.scandir(path / str(zoom) / str(column))
        if (stem := os.path.splitext(entry.name)[0]).isdecimal()
    ]
    low, high = min(rows), max(rows)
    if (path / _NORTH).is_file():
        low, high = 2**zoom - 1 - high, 2**zoom - 1 - low
    west, north = _corner(zoom, columns[0], low)
    east, south = _corner(zoom, columns[-1] + 1, high + 1)
    return {"zooms": [zooms[0], zoom], "bounds": [west, south, east, north], "attribution": ""}


def _corner(zoom: int, column: int, row: int) -> tuple[float, float]:
    """Return the longitude and latitude of the north-western corner of a tile in degrees."""
    return 360 * column / 2**zoom - 180, degrees(atan(sinh(pi * (1 - 2 * row / 2**zoom))))


class _Archive:
    """A PMTiles file."""

    def __init__(self, path: Path) -> None:
        from pmtiles.reader import MmapSource, Reader
        from pmtiles.tile import Compression, TileType

        kinds = {
            TileType.PNG: "image/png",
            TileType.JPEG: "image/jpeg",
            TileType.WEBP: "image/webp",
        }
        with path.open("rb") as file:
            read = MmapSource(file)

        def read_piece(offset: int, length: int) -> bytes:
            piece: bytes = read(offset, length)
            _check_size(piece, path)
            return piece

        self.reader = Reader(read_piece)
        self.header = self.reader.header()
        if self.header["tile_compression"] not in (Compression.NONE, Compression.UNKNOWN):
            raise InvalidInputError(
                f"{shortened(path.name)}: expected pictures without another compression"
            )
        if self.header["tile_type"] not in kinds:
            raise InvalidInputError(
                f"{shortened(path.name)}: expected tiles that are pictures (PNG, JPEG or WebP),"
                f" got {self.header['tile_type'].name} tiles"
            )
        self.kind = kinds[self.header["tile_type"]]

    def described(self) -> dict[str, Any]:
        header = self.header
        bounds = [header[f"{one}_e7"] / 1e7 for one in ("min_lon", "min_lat", "max_lon", "max_lat")]
        told = self.reader.metadata().get("attribution", "")
        words = html.unescape(re.sub(r"<[^>]*>", "", told if isinstance(told, str) else ""))
        zooms = [header["min_zoom"], min(header["max_zoom"], LARGEST_ZOOM)]
        return {"zooms": zooms, "bounds": bounds, "attribution": words[:200]}

    def tile(self, zoom: int, column: int, row: int) -> tuple[bytes, str]:
        inside = 0 <= column < 2**zoom and 0 <= row < 2**zoom
        data = self.reader.get(zoom, column, row) if inside else None
        if data is None:
            return NO_TILE, "image/png"
        return data, self.kind


def _check_size(piece: bytes, path: Path) -> None:
    """Refuse a piece of a PMTiles file (a directory, the metadata or a tile) that is too large, or
    that its library would unfold to too many bytes.
    """
    size = len(piece)
    if size <= LARGEST_PIECE and piece[:2] == b"\x1f\x8b":
        with gzip.open(io.BytesIO(piece)) as folded:
            size = len(folded.read(LARGEST_PIECE + 1))
    if size > LARGEST_PIECE:
        raise InvalidInputError(
            f"{shortened(path.name)}: expected directories and tiles of at most {LARGEST_PIECE}"
            " bytes, got more"
        )


def _read(path: Path, work: Callable[[_Archive], Answer]) -> Answer:
    """Return what ``work`` reads from a PMTiles file, which is opened again if it has changed."""
    about = path.stat()
    try:
        return work(_opened(path, about.st_mtime_ns, about.st_size))
    except InvalidInputError:
        raise
    except Exception as error:  # whatever a damaged file makes its library raise
        raise InvalidInputError(
            f"{shortened(path.name)}: expected a PMTiles file of version 3, got one that cannot be"
            f" read: {describe_error(error, most=100)}"
        ) from None


@lru_cache(maxsize=4)
def _opened(path: Path, _changed: int, _size: int) -> _Archive:
    return _Archive(path)
