"""Maps by name: ``line:5000``, ``htree:5000``, ``vessels:5000:7``, ``maze:61x41:3``, ….

A name is ``NAME:SIZE`` or ``NAME:SIZE:SEED``; the seed is 0 if it is not given. The same name gives the same
map. Every map is 4-connected. More generators can be added to `GENERATORS`.
"""

from __future__ import annotations

import difflib
import math

import numpy as np
from numpy.typing import NDArray

from shoal.errors import InvalidInputError, UnknownNameError
from shoal.swarm.maps.generators.catalogue import GENERATORS, Generator
from shoal.swarm.maps.generators.sizes import parse_seed, parse_size, shorten

__all__ = ["GENERATORS", "Generator", "generate", "is_spec"]


def is_spec(text: str) -> bool:
    """Tell whether ``text`` is meant as a map name: what stands before the first colon names a generator.

    >>> is_spec("maze:61x41"), is_spec("maze"), is_spec("maze.png")
    (True, True, False)
    """
    return text.partition(":")[0] in GENERATORS


def generate(spec: str) -> NDArray[np.bool_]:
    """Return the map with the given name.

    Parameters
    ----------
    spec : str
        ``NAME:SIZE`` or ``NAME:SIZE:SEED``, such as ``vessels:5000:7``.

    Returns
    -------
    ndarray, bool, shape (H, W) or (D, H, W)
        C-contiguous, True where free, row 0 on top.

    Raises
    ------
    UnknownNameError
        If no generator has that name; the message suggests the nearest one.
    InvalidInputError
        If the size or the seed is missing or does not fit.

    Examples
    --------
    >>> generate("rectangle:2x3")
    array([[ True,  True,  True],
           [ True,  True,  True]])
    """
    if not isinstance(spec, str):
        raise InvalidInputError(f"expected a map name such as 'vessels:5000:7', got {type(spec).__name__}")
    name, *fields = spec.split(":")
    generator = _named(name, spec)
    if len(fields) > 2:
        raise InvalidInputError(f"expected {generator.name}:{generator.size}{'[:SEED]' * generator.seeded}, got {shorten(spec)}")
    size = parse_size(fields[0] if fields else "", generator.axes, where=spec, example=generator.example)
    _check_bounds(generator, size, spec)
    if len(fields) < 2:
        return np.ascontiguousarray(generator.function(*size))
    seed = parse_seed(fields[1], where=spec)
    if not generator.seeded:
        raise InvalidInputError(f"expected no seed, as nothing in a map of kind {name} is random, got {seed} in {shorten(spec)}")
    return np.ascontiguousarray(generator.function(*size, seed=seed))


def _named(name: str, spec: str) -> Generator:
    if name in GENERATORS:
        return GENERATORS.get(name)
    near = difflib.get_close_matches(name, GENERATORS, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise UnknownNameError(f"unknown map generator {shorten(name)} in {shorten(spec)}: {hint}(known: {', '.join(GENERATORS)})")


def _check_bounds(generator: Generator, size: tuple[int, ...], spec: str) -> None:
    cells = math.prod(size)
    if not generator.smallest <= cells <= generator.largest:
        raise InvalidInputError(
            f"expected from {generator.smallest} to {generator.largest} cells "
            f"for a map of kind {generator.name}, got {cells if cells < 10**15 else 'far more'} in {shorten(spec)}"
        )
