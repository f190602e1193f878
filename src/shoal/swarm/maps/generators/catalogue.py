"""The catalogue of generated maps: their names, sizes and seeds, and a cache on disk."""

from __future__ import annotations

import hashlib
import io
import math
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, OutputError
from shoal.core.files import atomic, users_cache, with_checksum, without_checksum
from shoal.core.registry import Registry
from shoal.swarm.maps.generators.mazes import draw_cave, draw_htree, draw_maze
from shoal.swarm.maps.generators.vessels import draw_vessels
from shoal.swarm.maps.generators.vessels3d import draw_vessel_net, draw_vessel_tree
from shoal.swarm.maps.reading import MAX_CELLS


@dataclass(frozen=True)
class Generator:
    """A map generator, which can make maps of many sizes.

    Attributes
    ----------
    name : str
        Name of the generator, which is the first part of a map name.
    summary : str
        Description of the appearance of the generated maps.
    axes : tuple of str
        Names of the numbers in the size of a map name, such as ("ROWS", "COLUMNS").
    example : str
        An example of the name of a generated map.
    function : callable
        Function with one integer argument for each number of the size, and the argument ``seed`` if
        ``seeded`` is true. The function returns the map as a bool ndarray of shape (H, W) or (D, H,
        W).
    seeded : bool
        Whether the generated map depends on a seed. If ``seeded`` is false, Shoal refuses a map
        name with a seed.
    smallest, largest : int
        Smallest and largest product of the numbers in the size of a map name.
    slow : bool
        Whether the generator is so slow that Shoal caches its maps on disk.
    """

    name: str
    summary: str
    axes: tuple[str, ...]
    example: str
    function: Callable[..., NDArray[np.bool_]]
    seeded: bool = True
    smallest: int = 1
    largest: int = MAX_CELLS
    slow: bool = False

    @property
    def size(self) -> str:
        """The syntax of the size in a map name, such as ``ROWSxCOLUMNS``."""
        return "x".join(self.axes)


def draw_line(count: int) -> NDArray[np.bool_]:
    """Return a straight corridor of shape (1, count). Source: paper M, figure 7, map "linear" with
    5000 cells.
    """
    return np.ones((1, count), dtype=np.bool_)


def draw_rectangle(rows: int, columns: int) -> NDArray[np.bool_]:
    """Return a rectangle without obstacles. Source: paper M, figure 7, map "empty rectangle" with
    50 rows and 100 columns.
    """
    return np.ones((rows, columns), dtype=np.bool_)


GENERATORS = Registry[Generator]("map generator", open_to_others=False)

for _generator in (
    Generator(
        "line",
        "A straight corridor one cell wide.",
        ("CELLS",),
        "line:5000",
        draw_line,
        seeded=False,
    ),
    Generator(
        "rectangle",
        "An empty room.",
        ("ROWS", "COLUMNS"),
        "rectangle:50x100",
        draw_rectangle,
        seeded=False,
    ),
    Generator(
        "htree",
        "A tree of corridors one cell wide, made of bars that fork at right angles.",
        ("CELLS",),
        "htree:5000",
        draw_htree,
        seeded=False,
    ),
    Generator(
        "vessels",
        "A vascular network with forks, loops and dead ends, like the veins of a leaf.",
        ("CELLS",),
        "vessels:5000:7",
        draw_vessels,
        slow=True,
        smallest=30,
        largest=1_000_000,
    ),
    Generator(
        "vessels3d",
        "A 3-D tree of vessels whose radii follow Murray's law.",
        ("CELLS",),
        "vessels3d:5000:7",
        draw_vessel_tree,
        slow=True,
        smallest=30,
        largest=5_000_000,
    ),
    Generator(
        "vessels3d-loops",
        "A 3-D network of vessels with loops: the tree with some twigs joined.",
        ("CELLS",),
        "vessels3d-loops:5000:7",
        draw_vessel_net,
        slow=True,
        smallest=60,
        largest=5_000_000,
    ),
    Generator(
        "maze",
        "A perfect maze: exactly one path between any two cells.",
        ("WIDTH", "HEIGHT"),
        "maze:61x41:3",
        draw_maze,
    ),
    Generator(
        "cave",
        "A cave with smooth, irregular walls.",
        ("WIDTH", "HEIGHT"),
        "cave:120x80",
        draw_cave,
    ),
):
    GENERATORS.add(_generator.name, _generator)


def is_spec(text: str) -> bool:
    """Return whether ``text`` names a generated map: whether the part before the first colon is the
    name of a generator.

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
        raise InvalidInputError(
            f"expected a map name such as 'vessels:5000:7', got {type(spec).__name__}"
        )
    name, *fields = spec.split(":")
    generator = GENERATORS.get(name)
    if len(fields) > 2:
        raise InvalidInputError(
            f"expected {generator.name}:{generator.size}{'[:SEED]' * generator.seeded}, got"
            f" {_cut(spec)}"
        )
    size = _size(fields[0] if fields else "", generator, spec)
    if len(fields) < 2:
        return np.ascontiguousarray(generator.function(*size))
    if not re.fullmatch("[0-9]{1,1000}", fields[1]):
        raise InvalidInputError(
            f"expected a seed that is an integer of at least 0, got {_cut(fields[1])} in"
            f" {_cut(spec)}"
        )
    seed = int(fields[1])
    if not generator.seeded:
        raise InvalidInputError(
            f"expected no seed, because nothing in a map of kind {name} is random, got {seed} in"
            f" {_cut(spec)}"
        )
    return np.ascontiguousarray(generator.function(*size, seed=seed))


def _size(text: str, generator: Generator, spec: str) -> tuple[int, ...]:
    """Return the numbers in the size of a map name, such as 50 and 100 for ``50x100``."""
    axes = generator.axes
    if not text:
        raise InvalidInputError(
            f"expected a size ({generator.size}) in the map name, got {_cut(spec)}: write for"
            f" example {generator.example}"
        )
    parts = re.split("[xX]", text)
    if len(parts) != len(axes):
        raise InvalidInputError(
            f"expected a size of {len(axes)} number{'s' * (len(axes) > 1)} ({generator.size}), got"
            f" {_cut(text)} in {_cut(spec)}: write for example {generator.example}"
        )
    for digits, axis in zip(parts, axes, strict=True):
        if not re.fullmatch("[+-]?[0-9]{1,1000}", digits):
            raise InvalidInputError(
                f"expected a whole number of {axis.lower()}, got {_cut(digits)} in {_cut(spec)}"
            )
        if int(digits) < 1:
            raise InvalidInputError(
                f"expected at least 1 for the {axis.lower()}, got {_cut(digits)} in {_cut(spec)}"
            )
    size = tuple(map(int, parts))
    cells = math.prod(size)
    if not generator.smallest <= cells <= generator.largest:
        raise InvalidInputError(
            f"expected from {generator.smallest} to {generator.largest} cells for a map of kind"
            f" {generator.name}, got {cells if cells < 10**15 else 'far more'} in {_cut(spec)}"
        )
    return size


def _cut(text: str) -> str:
    """Return a text in quotes, shortened for an error message."""
    return repr(text if len(text) <= 40 else text[:40] + "…")


def generate_cached(spec: str) -> NDArray[np.bool_]:
    """Return the generated map with the given name. Read the map from the user's cache folder, or
    generate and store it.

    Shoal caches the maps of slow generators, in a folder inside the folder that
    `shoal.core.files.users_cache` returns. A cached map from another version of the generators is
    ignored. If the cache folder is read-only, Shoal generates every map anew.
    """
    name = spec.partition(":")[0]
    if name not in GENERATORS or not GENERATORS.get(name).slow:
        return generate(spec)
    path = (
        users_cache()
        / f"maps-{_fingerprint()}"
        / f"{hashlib.sha256(spec.encode()).hexdigest()[:16]}.map"
    )
    try:
        return np.ascontiguousarray(
            np.load(io.BytesIO(without_checksum(path.read_bytes())), allow_pickle=False)
        )
    except (OSError, ValueError):
        pass  # missing or damaged: generate the map again
    free = generate(spec)
    try:
        with atomic(path) as temporary:
            content = io.BytesIO()
            np.save(content, free)
            temporary.write_bytes(with_checksum(content.getvalue()))
    except OutputError:
        pass
    return free


@cache
def _fingerprint() -> str:
    """Return a digest of the source code of the map generators. A change of the code may change the
    generated maps.
    """
    digest = hashlib.sha256(np.__version__.encode())
    for file in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]
