"""Numbers of things and sizes of maps as texts."""

from __future__ import annotations

from collections.abc import Sequence

MOST_TRIALS = 1_000_000_000
"""Maximum number of trials of a run and of a sweep."""


def count_text(count: int, word: str) -> str:
    """Return a number and the word for the counted things as a text; the word gets an "s" unless the number is 1.

    Examples
    --------
    >>> count_text(1, "robot"), count_text(1200, "cell")
    ('1 robot', '1,200 cells')
    """
    return f"{count:,} {word}{'s' * (count != 1)}"


def shape_text(shape: Sequence[int]) -> str:
    """Return the shape of a map in cells as a text that names each side; a map in three dimensions also has layers.

    Examples
    --------
    >>> shape_text((36, 60)), shape_text((5, 1, 1200))
    ('36 rows × 60 columns', '5 layers × 1 row × 1,200 columns')
    """
    words = ("layer", "row", "column")[3 - len(shape) :]
    return " × ".join(count_text(int(count), word) for count, word in zip(shape, words, strict=True))
