"""Notices from running functions of Shoal to the user. The command line interface prints notices on
stderr.
"""

from __future__ import annotations

from collections.abc import Callable

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
