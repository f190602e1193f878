"""Limits of region files. Larger files are refused with an error of one sentence before they are unpacked."""

from __future__ import annotations

import zipfile
import zlib

from shoal.core.errors import InvalidInputError

LARGEST_FILE = 20_000_000
"""Maximum size of a region file in bytes, and of a KMZ's unpacked content."""

LARGEST_DATABASE = 2_000_000_000
"""Maximum size of a GeoPackage in bytes. Only the requested layer of the file is read."""

MOST_CORNERS = 200_000
"""Maximum number of corners of all polygons in a file."""

MOST_POLYGONS = 10_000
"""Maximum number of polygons of a file, or of rings of a table."""

MOST_PAIRS = 200_000
"""Maximum number of pairs of rings of a table in which one ring lies, or may lie, around the other."""

MOST_ELEMENTS = 300_000
"""Maximum number of elements of an XML file."""

DEEPEST = 100
"""Maximum nesting depth of XML elements."""


ARCHIVE_FAULTS = (
    zipfile.BadZipFile, zipfile.LargeZipFile, NotImplementedError, RuntimeError, EOFError, ValueError, zlib.error,
)  # fmt: skip
"""Exceptions that can occur while a damaged archive is read."""


def check_count(count: int, most: int, *, where: str, what: str) -> None:
    """Refuse more than ``most`` items.

    Raises
    ------
    InvalidInputError
    """
    if count > most:
        raise InvalidInputError(f"{where}: expected at most {most} {what}, got {count}")
