"""The folder of a studio: no path that a browser names leads out of it, and nothing is decoded that is too large."""

from __future__ import annotations

import os
import warnings
from collections.abc import AsyncIterator, Mapping
from pathlib import Path
from typing import Any

from shoal.core.checks import shortened
from shoal.core.errors import InvalidInputError
from shoal.core.files import atomic

MOST_PIXELS = 50_000_000
"""Pixels of a picture that the studio opens; the command opens larger ones."""

PAPERS = "papers"
"""Where the figures of the papers are reproduced."""

MOST_LISTED = 2000
SHAPEFILE = (".shp", ".shx", ".dbf", ".prj", ".cpg")
"""A Shapefile is several files of one name."""

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
KINDS = {
    "map": (*PICTURES, ".txt", ".map", ".npy", ".csv", ".nii", ".nii.gz"),
    "episode": (".npz", ".episode.json"),
    "missions": (".missions.zip",),
    "region": (".geojson", ".kml", ".kmz", ".gpkg", ".zip", ".shp"),
    "part": SHAPEFILE[1:],
    "terrain": (".asc",),
    "workspace": (".svg", ".wkt", ".geojson"),
    "sweep": (".toml",),
    "store": (".sqlite",),
    "film": (".mp4", ".gif", ".html"),
    "problem": (".json",),
}
_TAKEN = tuple({suffix for suffixes in KINDS.values() for suffix in suffixes})


class Folder:
    """A folder, and the names in it.

    Parameters
    ----------
    root : path

    Examples
    --------
    >>> Folder(".").path("../secret")
    Traceback (most recent call last):
    ...
    shoal.core.errors.InvalidInputError: file: expected a name inside the folder, got '../secret'
    """

    def __init__(self, root: str | os.PathLike[str]) -> None:
        self.root = Path(root).resolve()

    def path(self, name: str) -> Path:
        """Return the path of a name, which may not be there yet.

        Raises
        ------
        InvalidInputError
            If it is outside of the folder, also by a link, or hidden.
        """
        parts = Path(name).parts
        bad = not name or "\0" in name or "\\" in name or len(name) > 500 or Path(name).is_absolute()
        if bad or any(part.startswith(".") for part in parts):
            raise InvalidInputError(f"file: expected a name inside the folder, got {shortened(name)}")
        found = self.root.joinpath(*parts)
        try:
            inside = found.resolve().is_relative_to(self.root)
        except (OSError, RuntimeError):  # links in a circle, or a name that no file can have
            inside = False
        if not inside:
            raise InvalidInputError(f"file: expected a name inside the folder, got {shortened(name)}")
        return found

    def check_fields(self, data: Mapping[str, Any]) -> None:
        """Refuse fields of a problem that name files outside of the folder, or pictures that are too large.

        Raises
        ------
        InvalidInputError
        """
        for value in data.values():
            texts = [
                text for text in (value if isinstance(value, list) else [value]) if isinstance(text, str) and len(text) <= 4096
            ]
            for text in {*texts, *(text.partition(",")[0] for text in texts)}:  # a vehicle's file has fields after it
                path = Path(text)
                if path.is_absolute() or text.startswith("~") or ".." in path.parts or "\0" in text:
                    raise InvalidInputError(f"file: expected a name inside the folder, got {shortened(text)}")
                if "/" in text or (text and os.path.lexists(self.root / path)):
                    check_pixels(self.path(text))

    def files(self) -> list[dict[str, Any]]:
        """Return what there is: name, kind, bytes and time of each file, the newest first."""
        found: list[dict[str, Any]] = []
        for where, folders, names in os.walk(self.root):
            folders[:] = [name for name in folders if name[0] != "."]
            for name in names:
                path = Path(where, name)
                told = purpose_of(name)
                if told is None or name[0] == ".":
                    continue
                try:
                    if path.resolve().is_relative_to(self.root):
                        about = path.stat()
                        inside = path.relative_to(self.root).as_posix()
                        inside.encode()
                        found.append({"name": inside, "kind": told, "bytes": about.st_size, "time": about.st_mtime})
                except (OSError, RuntimeError, UnicodeEncodeError):
                    continue
            if len(found) > MOST_LISTED:
                break
        return sorted(found, key=lambda one: -float(one["time"]))[:MOST_LISTED]

    def new_name(self, stem: str, suffix: str) -> str:
        """Return a name that is free: the stem, or the stem with a number."""
        plain = "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in stem).strip("-")[:60] or "file"
        family = SHAPEFILE if suffix == ".shp" else (suffix,)  # a part that lies there already is not taken for one of another's
        number, free = 1, plain
        while any(os.path.lexists(self.root / (free + one)) for one in family):
            number += 1
            free = f"{plain}-{number}"
        return free + suffix

    async def take(self, name: str, pieces: AsyncIterator[bytes]) -> str:
        """Write a file that a browser brings, whole or not at all, under its own name or one with a number; return the name.

        Raises
        ------
        InvalidInputError
            For a name that is no file of Shoal's, or a picture that is too large.
        OutputError
        """
        plain = Path(name.replace("\\", "/")).name
        suffix = next((one for one in sorted(_TAKEN, key=len, reverse=True) if plain.lower().endswith(one)), None)
        if suffix is None:
            raise InvalidInputError(f"file: expected one of {' '.join(sorted(_TAKEN))}, got {shortened(plain)}")
        target = self.path(self.new_name(plain[: -len(suffix)], suffix))
        with atomic(target) as temporary:
            with temporary.open("wb") as file:
                async for piece in pieces:
                    file.write(piece)
            check_pixels(temporary)
        return target.name


def purpose_of(name: str) -> str | None:
    """Return what a file is for, by its name; None if for nothing here."""
    return next((kind for kind, suffixes in KINDS.items() if name.lower().endswith(suffixes)), None)


def check_pixels(path: Path) -> None:
    """Refuse a picture of more than `MOST_PIXELS`; only its header is read.

    Raises
    ------
    InvalidInputError
    """
    if path.suffix.lower() not in PICTURES or not path.is_file():
        return
    from PIL import Image, UnidentifiedImageError

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a picture that Pillow calls a bomb: we say it ourselves
        limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            with Image.open(path, formats=("PNG", "TIFF", "BMP", "JPEG")) as image:
                width, height = image.size
        except (UnidentifiedImageError, OSError, SyntaxError, ValueError):
            raise InvalidInputError(
                f"{path.name}: expected a PNG, TIFF, BMP or JPEG picture, got a damaged or other file"
            ) from None
        finally:
            Image.MAX_IMAGE_PIXELS = limit
    if width * height > MOST_PIXELS:
        raise InvalidInputError(
            f"{path.name}: expected a picture of at most {MOST_PIXELS // 10**6} megapixels, got {width} x {height}"
        )
