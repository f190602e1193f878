"""Who is where: what a body on the ground is to the others, without any of them talking about it.

Each cell is a byte of a file without a name, and a robot that searches the cell holds the operating system's lock on that byte. So
two robots are never in one cell, and the system itself frees the cell of a process that dies, however it dies.
"""

from __future__ import annotations

import fcntl


def enter(file: int, cell: int) -> bool:
    """Go into a cell if no other process is in there; tell whether that was so.

    Parameters
    ----------
    file : int
        Descriptor of the file that all robots share. A process must close no other descriptor of it: it would lose its locks.
    cell : int
    """
    try:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, cell)
    except (BlockingIOError, PermissionError):  # systems differ in what they call a lock that another one holds
        return False
    return True


def leave(file: int, cell: int) -> None:
    """Go out of a cell."""
    fcntl.lockf(file, fcntl.LOCK_UN, 1, cell)
