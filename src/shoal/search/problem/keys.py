"""Key files: a key is a secret that all robots of a search share. Robots sign their messages with the key."""

from __future__ import annotations

import os
import stat

from shoal.core.errors import InvalidInputError

_SHORTEST, _LONGEST = 16, 4096  # bytes


def read_key(path: str) -> bytes:
    """Read a key from a file. The function removes line ends before and after the key.

    Raises
    ------
    InvalidInputError
        If ``path`` is not a file of 16 to 4096 bytes that only its owner can read and write.
    """
    try:
        with open(path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)) as file:
            kind = os.fstat(file.fileno())
            if not stat.S_ISREG(kind.st_mode):
                raise InvalidInputError(f"{path}: expected a file with a key, got a folder or another kind of file")
            if os.name == "posix" and kind.st_mode & 0o077:
                mode = stat.S_IMODE(kind.st_mode)
                raise InvalidInputError(f"{path}: expected a key that only its owner can read (chmod 600), got mode {mode:o}")
            key = file.read(_LONGEST + 3).strip(b"\r\n")
    except OSError as error:
        raise InvalidInputError(f"{path}: expected a readable file with a key, got the error: {error.strerror}") from None
    if not _SHORTEST <= len(key) <= _LONGEST:
        size = f"{len(key)} bytes" if len(key) <= _LONGEST else "more"
        raise InvalidInputError(f"{path}: expected a key of {_SHORTEST} to {_LONGEST} bytes, got {size}")
    return key
