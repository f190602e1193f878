"""Maps by name: ``line:5000``, ``rectangle:50x100``, ``htree:5000``, ``vessels:5000:7``, ``maze:61x41:3``, ``cave:120x80``.

A name is ``NAME:SIZE`` or ``NAME:SIZE:SEED``; the seed is 0 if it is not given. The same name gives the same map. Every map is
4-connected. More generators can be added to `GENERATORS`.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shoal.errors import InvalidInputError, UnknownNameError
from shoal.registry import Registry
from shoal.swarm.generators.cave import draw_cave
from shoal.swarm.generators.htree import draw_htree
from shoal.swarm.generators.maze import draw_maze
from shoal.swarm.generators.shapes import draw_line, draw_rectangle
from shoal.swarm.generators.sizes import MAX_CELLS, parse_seed, parse_size, shorten
from shoal.swarm.generators.vessels import draw_vessels

__all__ = ["GENERATORS", "MAX_CELLS", "Generator", "generate", "is_spec"]


@dataclass(frozen=True, kw_only=True)
class Generator:
    """A way to make maps of any size.

    Attributes
    ----------
    name : str
        The first part of the map name.
    summary : str
        What the map looks like, for people.
    axes : tuple of str
        What each number of the size counts.
    example : str
        A map name.
    function : callable
        Takes one integer for each axis, and ``seed=`` if the generator is seeded; returns ndarray, bool, shape (H, W).
    seeded : bool
        Whether a seed makes a difference; a map name with a seed is refused if not.
    smallest, largest : int
        Bounds on the product of the numbers of the size.
    """

    name: str
    summary: str
    axes: tuple[str, ...]
    example: str
    function: Callable[..., NDArray[np.bool_]]
    seeded: bool = True
    smallest: int = 1
    largest: int = MAX_CELLS

    @property
    def size(self) -> str:
        """The syntax of the size, such as ``ROWSxCOLUMNS``."""
        return "x".join(self.axes)


GENERATORS = Registry[Generator]("map generator")

for _generator in (
    Generator(
        name="line",
        summary="A straight corridor one cell wide.",
        axes=("CELLS",),
        example="line:5000",
        function=draw_line,
        seeded=False,
    ),
    Generator(
        name="rectangle",
        summary="An empty room.",
        axes=("ROWS", "COLUMNS"),
        example="rectangle:50x100",
        function=draw_rectangle,
        seeded=False,
    ),
    Generator(
        name="htree",
        summary="Bars that fork at right angles again and again: a tree of corridors one cell wide.",
        axes=("CELLS",),
        example="htree:5000",
        function=draw_htree,
        seeded=False,
    ),
    Generator(
        name="vessels",
        summary="A vascular network with forks, loops and dead ends, like the veins of a leaf.",
        axes=("CELLS",),
        example="vessels:5000:7",
        function=draw_vessels,
        smallest=30,
        largest=1_000_000,
    ),
    Generator(
        name="maze",
        summary="A perfect maze: one way between any two cells.",
        axes=("WIDTH", "HEIGHT"),
        example="maze:61x41:3",
        function=draw_maze,
    ),
    Generator(
        name="cave",
        summary="A cave with smooth, irregular walls.",
        axes=("WIDTH", "HEIGHT"),
        example="cave:120x80",
        function=draw_cave,
    ),
):
    GENERATORS.add(_generator.name, _generator)


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
    ndarray, bool, shape (H, W)
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
        raise InvalidInputError(
            f"expected {generator.name}:{generator.size}{'[:SEED]' * generator.seeded}, got {shorten(spec)}"
        )
    size = parse_size(fields[0] if fields else "", generator.axes, where=spec, example=generator.example)
    _check_bounds(generator, size, spec)
    if len(fields) < 2:
        return np.ascontiguousarray(generator.function(*size))
    seed = parse_seed(fields[1], where=spec)
    if not generator.seeded:
        raise InvalidInputError(
            f"expected no seed, as {generator.name} maps have no chance in them, got {seed} in {shorten(spec)}"
        )
    return np.ascontiguousarray(generator.function(*size, seed=seed))


def _named(name: str, spec: str) -> Generator:
    if name in GENERATORS:
        return GENERATORS.get(name)
    near = difflib.get_close_matches(name, GENERATORS, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise UnknownNameError(
        f"unknown map generator {shorten(name)} in {shorten(spec)}: {hint}(known: {', '.join(GENERATORS)})"
    )


def _check_bounds(generator: Generator, size: tuple[int, ...], spec: str) -> None:
    cells = int(np.prod([float(number) for number in size]))
    if not generator.smallest <= cells <= generator.largest:
        raise InvalidInputError(
            f"expected from {generator.smallest} to {generator.largest} cells for a map of kind {generator.name}, "
            f"got {cells} in {shorten(spec)}"
        )
