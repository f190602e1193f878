"""Cell locks prevent two robots of a live search from occupying one cell at the same time. The locks need no messages.

Each cell is a byte of an anonymous file. A robot that searches a cell holds the operating system's lock on the byte of this cell.
If a process ends for any reason, the operating system releases its lock.
"""

from __future__ import annotations

import fcntl


def enter(file: int, cell: int) -> bool:
    """Lock a cell if no other process holds it. Return whether the lock was obtained.

    Parameters
    ----------
    file : int
        Descriptor of the file that all robots share. A process must not close any other descriptor of this file, because closing it
        would release the locks of the process.
    cell : int
    """
    try:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, cell)
    except (BlockingIOError, PermissionError):  # the error for a lock held by another process differs between systems
        return False
    return True


def leave(file: int, cell: int) -> None:
    """Release the lock of a cell."""
    fcntl.lockf(file, fcntl.LOCK_UN, 1, cell)
