"""The time of a rehearsal, which one process sets and the processes of all robots read."""

from __future__ import annotations

import ctypes
import mmap
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
                # one machine word, so that nobody reads half of a new time and half of an old one
                self._seconds: ctypes.c_double | None = ctypes.c_double.from_buffer(self._memory)
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
        return 0.0 if self._seconds is None else self._seconds.value

    def set(self, seconds: float) -> None:
        """Set the time."""
        if self._seconds is not None:
            self._seconds.value = seconds

    def close(self) -> None:
        """Let go of the file."""
        self._seconds = None  # the memory has no other user
        self._memory.close()
