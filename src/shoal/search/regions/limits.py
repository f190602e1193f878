"""Limits of region files: what is larger is refused in one sentence, before it is unfolded."""

from __future__ import annotations

import zipfile
import zlib

from shoal.core.errors import InvalidInputError

LARGEST_FILE = 20_000_000
"""Bytes of a region file, and of what a KMZ unfolds to."""

LARGEST_DATABASE = 2_000_000_000
"""Bytes of a GeoPackage, of which only the layer that is asked for is read."""

MOST_CORNERS = 200_000
"""Corners of all polygons of a file together."""

MOST_POLYGONS = 10_000
"""Polygons of a file, or rings of a table."""

MOST_PAIRS = 200_000
"""Pairs of rings of a table of which one lies around the other, or could."""

MOST_ELEMENTS = 300_000
"""Elements of an XML file."""

DEEPEST = 100
"""Levels of XML elements within each other."""


ARCHIVE_FAULTS = (
    zipfile.BadZipFile, zipfile.LargeZipFile, NotImplementedError, RuntimeError, EOFError, ValueError, zlib.error,
)  # fmt: skip
"""What a damaged archive raises while it is read."""


def check_count(count: int, most: int, *, where: str, what: str) -> None:
    """Refuse more than ``most`` things.

    Raises
    ------
    InvalidInputError
    """
    if count > most:
        raise InvalidInputError(f"{where}: expected at most {most} {what}, got {count}")
