"""Cell locks prevent two live robots from searching one cell at the same time. Robots need no messages for cell locks.

Each cell is a byte of an anonymous file. A robot that searches a cell holds the operating system's lock on the byte of this cell.
If the process of a robot ends for any reason, the operating system releases its lock.
"""

from __future__ import annotations

import fcntl


def enter(file: int, cell: int) -> bool:
    """Lock a cell if no other process holds its lock. Return whether this process now holds the lock.

    Parameters
    ----------
    file : int
        Descriptor of the file that all robots share. A process must not close any other descriptor of this file, because the
        operating system would then release all locks of the process.
    cell : int
        Tour index of the cell.
    """
    try:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, cell)
    except (BlockingIOError, PermissionError):  # the error for a lock held by another process differs between systems
        return False
    return True


def leave(file: int, cell: int) -> None:
    """Release the lock of a cell."""
    fcntl.lockf(file, fcntl.LOCK_UN, 1, cell)
