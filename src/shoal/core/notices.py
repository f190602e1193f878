"""Notices from running functions of Shoal to the user. The command line interface prints notices on
stderr.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from shoal.core.interruption import error_streams

listeners: list[Callable[[str], None]] = []
_told: set[str] = set()


def tell_once(text: str) -> None:
    """Send a notice of one sentence to every listener, unless the text is empty or this process has
    already sent it.
    """
    if listeners and text and text not in _told:
        _told.add(text)
        for listener in listeners:
            listener(text)


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress the output of C libraries on stderr inside the ``with`` block.

    The C library libtiff, for example, prints a line on stderr for each fault of a picture. Notices
    of Shoal would be lost, too; they wait until the block ends.
    """
    try:
        kept = os.dup(2)
    except OSError:  # closed: there is nothing to protect
        yield
        return
    paused = list(listeners)
    waiting: list[str] = []
    if paused:
        listeners[:] = [waiting.append]
    with open(os.devnull, "w") as nowhere:
        error_streams.append(kept)
        os.dup2(nowhere.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        error_streams.remove(kept)
        os.close(kept)
        listeners[:] = paused
        for text in waiting:
            for listener in paused:
                listener(text)
