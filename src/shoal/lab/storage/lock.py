"""A lock that lets only one process run a sweep.

When the process with the lock ends or crashes, the operating system releases the lock.
"""

from __future__ import annotations

import errno
import fcntl
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from shoal.core.errors import InvalidInputError, OutputError
from shoal.core.interruption import half_written

_TRIES = 5
_PLAIN = os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK  # a link or a pipe may be an attack: nothing is written to it


def _lock_file(store: Path, name: str) -> Path:
    return store.with_name(f".{store.name}.{name}.lock")


@contextmanager
def locked(store: Path, name: str) -> Iterator[None]:
    """Hold the lock of a sweep inside the ``with`` block.

    Raises
    ------
    InvalidInputError
        Raised if another process holds the lock. The error message contains the process number of the lock's holder.
    OutputError
        Raised if the folder of the store is not writable.
    """
    path, tries = _lock_file(store, name), 0
    while True:
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | _PLAIN, 0o666)
        except OSError as error:
            why = "it is a symbolic link" if error.errno == errno.ELOOP else error.strerror or error
            raise OutputError(f"cannot write {path}: {why}") from None
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            holder = os.read(descriptor, 200).decode(errors="replace").strip() or "another process"
            os.close(descriptor)
            tries += 1
            if tries < _TRIES:  # the holder may be a process that only tests the lock
                time.sleep(0.02)
                continue
            raise InvalidInputError(
                f"{store}: expected a sweep that no process is running, got {name}, which {holder} is running; wait for its "
                "end, or watch it with "
                f"'shoal sweep status {store} --watch'"
            ) from None
        if _is_still(descriptor, path):
            break
        os.close(descriptor)  # its last holder removed the file between our two calls
    half_written.add(path)
    try:
        with suppress(OSError):  # on a full disk the lock still works, but it does not name its holder
            os.ftruncate(descriptor, 0)  # fails for anything but a plain file, and nothing is written
            os.write(descriptor, f"process {os.getpid()} on {socket.gethostname()} since {time.strftime('%F %T')}".encode())
        yield
    finally:
        path.unlink(missing_ok=True)
        half_written.discard(path)
        os.close(descriptor)


def _is_still(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.lstat())
    except FileNotFoundError:
        return False


def is_locked(store: Path, name: str) -> bool:
    """Return whether some process currently runs the sweep ``name`` of a store."""
    try:
        descriptor = os.open(_lock_file(store, name), os.O_RDONLY | _PLAIN)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(descriptor)
    return False
