"""Commands and move rules. A command is a letter that moves all particles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.core.registry import Registry

LETTERS = "lurdio"
"""The command letters for left, up, right and down. In 3-D, two more letters mean in (towards layer 0) and out."""

RULES: Registry[str] = Registry("move rule", open_to_others=False)
RULES.add("block", "a particle stays if the next cell is an obstacle or holds a particle that stays")
RULES.add("merge", "particles may share a cell; only obstacles stop them")
RULES.add("tilt", "one command slides every particle until it is stopped")

_CODES = {letter: code for code, letter in enumerate(LETTERS)}


def letters_of(ndim: int) -> str:
    """Return the command letters of a 2-D ("lurd") or 3-D ("lurdio") workspace."""
    return LETTERS[: 2 * ndim]


def offsets_of(shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Return how much one step in each direction changes the flat array index of a cell, in the order of `letters_of`.

    Examples
    --------
    >>> offsets_of((5, 7)).tolist()
    [-1, -7, 1, 7]
    """
    row = shape[-1]
    layer = row * shape[-2]
    return np.array([-1, -row, 1, row, -layer, layer][: 2 * len(shape)], dtype=np.int64)


def encode(commands: str, *, ndim: int = 2) -> NDArray[np.int8]:
    """Convert a text of command letters into an array of codes 0 to 5.

    Parameters
    ----------
    commands : str
        Command letters from ``lurd`` (2-D) or ``lurdio`` (3-D).
    ndim : int
        Number of dimensions of the workspace: 2 or 3.

    Returns
    -------
    ndarray of int8, shape (len(commands),)

    Raises
    ------
    InvalidInputError
        Raised if a letter is not a command. The error message contains the position of the wrong letter.

    Examples
    --------
    >>> encode("llurr").tolist()
    [0, 0, 1, 2, 2]
    """
    known = letters_of(ndim)
    for position, letter in enumerate(commands):
        if letter not in known:
            raise InvalidInputError(
                f"expected commands out of {known!r} for a {ndim}-D workspace, got {letter!r} at position {position + 1}"
            )
    return np.array([_CODES[letter] for letter in commands], dtype=np.int8)


def decode(codes: NDArray[np.int8]) -> str:
    """Convert an array of codes 0 to 5 into a text of command letters. The function `encode` is the inverse of `decode`.

    Examples
    --------
    >>> decode(encode("llurr"))
    'llurr'
    """
    table = np.frombuffer(LETTERS.encode(), dtype=np.uint8)
    return table[np.asarray(codes, dtype=np.intp)].tobytes().decode()
