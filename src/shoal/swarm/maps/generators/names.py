"""Names of generated maps: parse a name, check the numbers in the name, and generate the map."""

from __future__ import annotations

import math
import re

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.swarm.maps.generators.catalogue import GENERATORS, Generator


def is_spec(text: str) -> bool:
    """Return whether ``text`` names a generated map: whether the part before the first colon is the name of a generator.

    >>> is_spec("maze:61x41"), is_spec("maze"), is_spec("maze.png")
    (True, True, False)
    """
    return text.partition(":")[0] in GENERATORS


def generate(spec: str) -> NDArray[np.bool_]:
    """Return the generated map with the given name.

    Parameters
    ----------
    spec : str
        Name of the map: ``NAME:SIZE`` or ``NAME:SIZE:SEED``, such as ``vessels:5000:7``.

    Returns
    -------
    ndarray, bool, shape (H, W) or (D, H, W)
        The map: True at free cells, with row 0 at the top. The returned array is C-contiguous.

    Raises
    ------
    UnknownNameError
        Raised if no generator has the given name. The error message suggests the nearest name.
    InvalidInputError
        Raised if the size in the name is missing or invalid, or if the seed is invalid.

    Examples
    --------
    >>> generate("rectangle:2x3")
    array([[ True,  True,  True],
           [ True,  True,  True]])
    """
    if not isinstance(spec, str):
        raise InvalidInputError(f"expected a map name such as 'vessels:5000:7', got {type(spec).__name__}")
    name, *fields = spec.split(":")
    generator = GENERATORS.get(name)
    if len(fields) > 2:
        raise InvalidInputError(f"expected {generator.name}:{generator.size}{'[:SEED]' * generator.seeded}, got {_cut(spec)}")
    size = _size(fields[0] if fields else "", generator, spec)
    if len(fields) < 2:
        return np.ascontiguousarray(generator.function(*size))
    if not re.fullmatch("[0-9]{1,1000}", fields[1]):
        raise InvalidInputError(f"expected a seed that is an integer of at least 0, got {_cut(fields[1])} in {_cut(spec)}")
    seed = int(fields[1])
    if not generator.seeded:
        raise InvalidInputError(f"expected no seed, because nothing in a map of kind {name} is random, got {seed} in {_cut(spec)}")
    return np.ascontiguousarray(generator.function(*size, seed=seed))


def _size(text: str, generator: Generator, spec: str) -> tuple[int, ...]:
    """Return the numbers in the size of a map name, such as 50 and 100 for ``50x100``."""
    axes = generator.axes
    if not text:
        raise InvalidInputError(
            f"expected a size ({generator.size}) in the map name, got {_cut(spec)}: write for example {generator.example}"
        )
    parts = re.split("[xX]", text)
    if len(parts) != len(axes):
        raise InvalidInputError(
            f"expected a size of {len(axes)} number{'s' * (len(axes) > 1)} ({generator.size}), got {_cut(text)} "
            f"in {_cut(spec)}: write for example {generator.example}"
        )
    for part, axis in zip(parts, axes, strict=True):
        if not re.fullmatch("[+-]?[0-9]{1,1000}", part):
            raise InvalidInputError(f"expected a whole number of {axis.lower()}, got {_cut(part)} in {_cut(spec)}")
        if int(part) < 1:
            raise InvalidInputError(f"expected at least 1 for the {axis.lower()}, got {_cut(part)} in {_cut(spec)}")
    size = tuple(map(int, parts))
    cells = math.prod(size)
    if not generator.smallest <= cells <= generator.largest:
        raise InvalidInputError(
            f"expected from {generator.smallest} to {generator.largest} cells "
            f"for a map of kind {generator.name}, got {cells if cells < 10**15 else 'far more'} in {_cut(spec)}"
        )
    return size


def _cut(text: str) -> str:
    """Return a text in quotes, shortened for an error message."""
    return repr(text if len(text) <= 40 else text[:40] + "…")
