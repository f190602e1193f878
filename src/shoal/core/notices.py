"""What the library tells people while it works, if somebody listens: commands do, and print it on stderr."""

from __future__ import annotations

from collections.abc import Callable

listeners: list[Callable[[str], None]] = []
_told: set[str] = set()


def tell_once(text: str) -> None:
    """Tell every listener a sentence, the first time in this process that anybody listens to it."""
    if listeners and text not in _told:
        _told.add(text)
        for listener in listeners:
            listener(text)
