"""Reading the numbers of a map name: sizes such as ``5000`` and ``50x100``, and seeds."""

from __future__ import annotations

import re

from shoal.errors import InvalidInputError

MAX_CELLS = 2**28  # a quarter of a gigabyte as a boolean array


def parse_size(text: str, axes: tuple[str, ...], *, where: str, example: str) -> tuple[int, ...]:
    """Return the numbers of a size.

    Parameters
    ----------
    text : str
        One number for each axis, joined by ``x``.
    axes : tuple of str
        What each number counts, for error messages.
    where, example : str
        The whole map name, and a good one.

    Raises
    ------
    InvalidInputError
        If a number is missing, not a whole number, or below 1.
    """
    syntax = "x".join(axes)
    if not text:
        raise InvalidInputError(f"expected a size ({syntax}) in the map name, got {shorten(where)}: write for example {example}")
    parts = re.split("[xX]", text)
    if len(parts) != len(axes):
        raise InvalidInputError(
            f"expected a size of {len(axes)} number{'s' * (len(axes) > 1)} ({syntax}), got {shorten(text)} "
            f"in {shorten(where)}: write for example {example}"
        )
    return tuple(_positive(part, axis, where) for part, axis in zip(parts, axes, strict=True))


def parse_seed(text: str, *, where: str) -> int:
    """Return the seed.

    Raises
    ------
    InvalidInputError
        If it is not a whole number of at least 0.
    """
    if not re.fullmatch("[0-9]{1,1000}", text):
        raise InvalidInputError(f"expected a seed that is an integer of at least 0, got {shorten(text)} in {shorten(where)}")
    return int(text)


def shorten(text: str) -> str:
    """Return the text quoted, cut if it is too long for a sentence.

    >>> shorten("9" * 100)
    "'9999999999999999999999999999999999999999…'"
    """
    return repr(text if len(text) <= 40 else text[:40] + "…")


def _positive(text: str, axis: str, where: str) -> int:
    if not re.fullmatch("[+-]?[0-9]{1,1000}", text):
        raise InvalidInputError(f"expected a whole number of {axis.lower()}, got {shorten(text)} in {shorten(where)}")
    if int(text) < 1:
        raise InvalidInputError(f"expected at least 1 for the {axis.lower()}, got {shorten(text)} in {shorten(where)}")
    return int(text)
