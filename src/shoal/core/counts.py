"""Numbers of things as texts."""

from __future__ import annotations


def count_text(count: int, word: str) -> str:
    """Return a number and the word for the counted things as a text; the word gets an "s" unless the number is 1.

    Examples
    --------
    >>> count_text(1, "robot"), count_text(1200, "cell")
    ('1 robot', '1,200 cells')
    """
    return f"{count:,} {word}{'s' * (count != 1)}"
