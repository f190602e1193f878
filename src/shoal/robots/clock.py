"""The time of a rehearsal, which one process sets and the processes of all robots read."""

from __future__ import annotations

import mmap
import struct
from pathlib import Path

from shoal.core.errors import InvalidInputError

_SIZE = 8  # bytes of a number


class SharedClock:
    """Seconds in a file that several processes have in their memory.

    Parameters
    ----------
    path : Path
        A file that `create` has made.

    Raises
    ------
    InvalidInputError
        If the file is no clock.
    """

    def __init__(self, path: Path) -> None:
        try:
            with path.open("r+b") as file:
                self._memory = mmap.mmap(file.fileno(), _SIZE)
        except (OSError, ValueError) as error:
            raise InvalidInputError(
                f"clock: expected the clock of a rehearsal, got {path}: {error}"
            ) from None

    @classmethod
    def create(cls, path: Path) -> SharedClock:
        """Make the file of a clock that begins at 0."""
        path.write_bytes(bytes(_SIZE))
        return cls(path)

    def now(self) -> float:
        """Return the time in seconds."""
        return float(struct.unpack_from("<d", self._memory)[0])

    def set(self, seconds: float) -> None:
        """Set the time."""
        struct.pack_into("<d", self._memory, 0, seconds)

    def close(self) -> None:
        """Let go of the file."""
        self._memory.close()
