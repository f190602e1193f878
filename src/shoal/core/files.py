"""Files that Shoal writes: output files appear whole or not at all, and files of caches carry a
checksum.
"""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shoal.core.errors import InvalidInputError, OutputError
from shoal.core.interruption import half_written

if TYPE_CHECKING:
    from hashlib import blake2b


def check_suffix(path: str | os.PathLike[str], *suffixes: str) -> Path:
    """Return the path of an output file. Refuse a path whose suffix is not one of ``suffixes``."""
    from shoal.core.checks import as_path

    target = as_path(path)
    if target.suffix not in suffixes:
        known = ", ".join(suffixes[:-1]) + " or " * (len(suffixes) > 1) + suffixes[-1]
        raise InvalidInputError(f"{target}: expected the suffix {known}, got {target.suffix!r}")
    return target


_inputs: set[Path] = set()  # of the commands that run, resolved


@contextmanager
def keep_inputs(paths: Iterable[str | os.PathLike[str]]) -> Iterator[None]:
    """Let no write inside the ``with`` block replace one of some files by other content."""
    kept = {Path(path).resolve() for path in paths} - _inputs
    _inputs.update(kept)
    try:
        yield
    finally:
        _inputs.difference_update(kept)


def _is_input(path: Path) -> bool:
    return bool(_inputs) and path.resolve() in _inputs


@contextmanager
def atomic(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield the path of a temporary file in the folder of ``path``, with the same suffix as
    ``path``.

    If the ``with`` block succeeds, the temporary file is renamed to ``path``. If the ``with`` block
    fails, the temporary file is removed.

    Raises
    ------
    OutputError
        Raised if the folder is not writable, if the disk is full, or if ``path`` is an input (see
        `keep_inputs`) and its content would change. A failed write leaves no partial file.
    """
    import secrets  # slow to import

    from shoal.core.checks import describe_missing_file

    target = Path(path)
    temporary: Path | None = None
    try:
        there = describe_missing_file(target)
        if there not in ("", "no such file"):  # the file would replace it
            raise OutputError(f"cannot write {target}: it is {there}")
        target.parent.mkdir(parents=True, exist_ok=True)
        # The name is noted before the file exists, so an interruption at any moment removes the
        # file.
        temporary = target.parent / f".{target.stem[:40]}-{secrets.token_hex(6)}{target.suffix}"
        half_written.add(temporary)
        temporary.touch(mode=0o600, exist_ok=False)
        yield temporary
        if _is_input(target) and target.read_bytes() != temporary.read_bytes():
            raise OutputError(f"cannot write {target}: it is an input of the command")
        temporary.chmod(_mode(target))
        temporary.replace(target)
        half_written.discard(temporary)
        temporary = None
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"cannot write {target}: {error.strerror or error}") from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
            half_written.discard(temporary)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a UTF-8 text file. A failed write leaves no partial file."""
    with atomic(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: str | os.PathLike[str], value: Any, *, indent: int | None = 1) -> None:
    """Write a JSON file in ASCII. A failed write leaves no partial file."""
    write_text(path, json.dumps(value, indent=indent, allow_nan=False) + "\n")


def as_json(value: Any) -> Any:
    """Return a value as JSON data: infinities and NaN become None, and NumPy's numbers and arrays
    become Python's.

    Examples
    --------
    >>> as_json({"mean": float("nan"), "ends": (1, 2.5)})
    {'mean': None, 'ends': [1, 2.5]}
    """
    if isinstance(value, Mapping):
        return {str(name): as_json(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [as_json(one) for one in value]
    if hasattr(value, "tolist"):  # of NumPy, which this module does not import
        return as_json(value.tolist())
    return None if isinstance(value, float) and not isfinite(value) else value


def digest(content: bytes = b"", *, size: int) -> blake2b:
    """Return a hash object of this many bytes, which has read the content.

    The import of `hashlib` brings OpenSSL, so that `import shoal` and help do without it.
    """
    import hashlib

    return hashlib.blake2b(content, digest_size=size)


_CHECKSUM = 32  # bytes


def with_checksum(content: bytes) -> bytes:
    """Return the content of a cache file, with a checksum before it."""
    return digest(content, size=_CHECKSUM).digest() + content


def without_checksum(stored: bytes) -> bytes:
    """Return the content of a cache file that `with_checksum` made.

    A cache holds machine code and results: a file in which even one bit has changed must not be
    used.

    Raises
    ------
    ValueError
        If the content does not have the checksum before it.

    Examples
    --------
    >>> stored = with_checksum(b"code")
    >>> without_checksum(stored)
    b'code'
    >>> without_checksum(stored[:-1] + b"d")
    Traceback (most recent call last):
    ...
    ValueError: damaged
    """
    content = stored[_CHECKSUM:]
    if with_checksum(content) != stored:
        raise ValueError("damaged")
    return content


def users_cache() -> Path:
    """Return the folder of Shoal's cache for the current user: ``$XDG_CACHE_HOME/shoal`` or
    ``~/.cache/shoal``.
    """
    return (
        Path(os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache"))
        / "shoal"
    )


def _mode(path: Path) -> int:
    """Return the permissions of the existing file at ``path``. If no file exists, return the user's
    default permissions.
    """
    try:
        return stat.S_IMODE(path.stat().st_mode)
    except FileNotFoundError:
        return 0o666 & ~_umask()


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
