"""Notices to the user from a running function of the library.

The command line interface prints these notices on stderr.
"""

from __future__ import annotations

from collections.abc import Callable

listeners: list[Callable[[str], None]] = []
_told: set[str] = set()


def tell_once(text: str) -> None:
    """Send a sentence to every listener. Each sentence is sent only once per process."""
    if listeners and text not in _told:
        _told.add(text)
        for listener in listeners:
            listener(text)
