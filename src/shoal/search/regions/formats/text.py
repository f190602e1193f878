"""Files of text: their size, their encoding, JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from shoal.errors import InvalidInputError

_LARGEST_FILE = 200_000_000  # bytes


def check_file(path: Path, *, what: str = "region") -> None:
    """Refuse what is no file, or by its size alone cannot be what is wanted.

    Raises
    ------
    InvalidInputError, OSError
    """
    if not path.is_file():
        raise InvalidInputError(f"{path}: expected a {what} file, got {'a folder' if path.is_dir() else 'no such file'}")
    size = path.stat().st_size
    if size == 0:
        raise InvalidInputError(f"{path}: expected a {what}, got an empty file")
    if size > _LARGEST_FILE:
        raise InvalidInputError(f"{path}: expected a file of at most {_LARGEST_FILE} bytes, got {size}")


def read_text(path: Path) -> str:
    """Return the text of a file in UTF-8.

    Raises
    ------
    InvalidInputError, OSError
    """
    raw = path.read_bytes()
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise InvalidInputError(f"{path}: expected text in UTF-8, got byte 0x{raw[error.start]:02x} in line {line}") from None
    if "\0" in text:
        line = text[: text.index("\0")].count("\n") + 1
        raise InvalidInputError(f"{path}: expected text, got a zero byte in line {line}")
    return text


def read_json(path: Path) -> Any:
    """Return what a JSON file says.

    Raises
    ------
    InvalidInputError, OSError
        With line and column.
    """
    try:
        return json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise InvalidInputError(
            f"{path}: expected JSON, got something else in line {error.lineno}, column {error.colno}: {error.msg.lower()}"
        ) from None
    except (RecursionError, ValueError) as error:
        if isinstance(error, InvalidInputError):
            raise
        why = "is nested too deeply" if isinstance(error, RecursionError) else "has a number of too many digits"
        raise InvalidInputError(f"{path}: expected GeoJSON, got JSON that {why}") from None


def is_true(value: Any) -> bool:
    """Tell whether an attribute of a feature says yes.

    Examples
    --------
    >>> [is_true(value) for value in (True, 1, "yes", " TRUE ", False, 0, "0", "", None)]
    [True, True, True, True, False, False, False, False, False]
    """
    return str(value).strip().lower() in {"true", "1", "1.0", "yes"}
