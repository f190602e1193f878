"""Limits on the sizes of region files, and on the numbers of polygons and corners in them."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from shoal.core.checks import check_file
from shoal.core.errors import InvalidInputError

LARGEST_FILE = 20_000_000
"""Maximum size in bytes of a region file, and of each file unpacked from a zip archive."""

LARGEST_DATABASE = 2_000_000_000
"""Maximum size of a GeoPackage in bytes. A GeoPackage may be larger than other files, because Shoal reads only some layers."""

MOST_CORNERS = 200_000
"""Maximum number of corners of all polygons in a file."""

MOST_POLYGONS = 10_000
"""Maximum number of polygons in a file, or of rings in a CSV file."""

MOST_PAIRS = 200_000
"""Maximum number of pairs of polygons that meet, and of pairs of rings with overlapping bounding boxes in a CSV file."""

MOST_CROSSINGS = 2_000_000
"""Maximum number of pairs of sides of two polygons whose bounding boxes overlap, and which may therefore cross."""

MOST_CONTACTS = 40_000_000
"""Maximum number of pairs of sides of one ring whose bounding boxes overlap."""

MOST_CUTS = 50_000
"""Maximum number of long sides of a region, times the length of its border in cells for each cell of area."""

MOST_ELEMENTS = 300_000
"""Maximum number of elements in a KML file."""

DEEPEST = 100
"""Maximum nesting depth of the elements in a KML file."""

# exceptions that reading a damaged archive can raise
_FAULTS = (zipfile.BadZipFile, zipfile.LargeZipFile, NotImplementedError, RuntimeError, EOFError, ValueError, zlib.error)


@contextmanager
def opened_zip(path: Path, *, what: str) -> Iterator[zipfile.ZipFile]:
    """Open a zip archive for reading. The argument ``what`` is the name of the archive in error messages.

    Raises
    ------
    InvalidInputError
        If the archive is missing, too large or damaged. For a damaged archive, the error may occur only when the caller reads a
        file from the archive.
    """
    check_file(path, what="region file", most=LARGEST_FILE)
    try:
        with zipfile.ZipFile(path) as archive:
            yield archive
    except InvalidInputError:
        raise
    except _FAULTS as error:
        raise InvalidInputError(f"{path}: expected a {what}, got a damaged one or another format: {str(error)[:80]}") from None


def check_count(count: int, most: int, *, where: str, what: str) -> None:
    """Refuse a file with more than ``most`` items. Error messages name the file ``where`` and the items ``what``.

    Raises
    ------
    InvalidInputError
    """
    if count > most:
        raise InvalidInputError(f"{where}: expected at most {most} {what}, got {count}")
