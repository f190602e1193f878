"""The catalogue of map generators, with the name, size, example and function of each generator."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.registry import Registry
from shoal.swarm.maps.generators.cave import draw_cave
from shoal.swarm.maps.generators.htree import draw_htree
from shoal.swarm.maps.generators.maze import draw_maze
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
        Function with one integer argument for each number of the size, and the argument ``seed`` if ``seeded`` is true. The
        function returns the map as a bool ndarray of shape (H, W) or (D, H, W).
    seeded : bool
        Whether the generated map depends on a seed. If ``seeded`` is false, Shoal refuses a map name with a seed.
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
    """Return a straight corridor of shape (1, count). Source: paper M, figure 7, map "linear" with 5000 cells."""
    return np.ones((1, count), dtype=np.bool_)


def draw_rectangle(rows: int, columns: int) -> NDArray[np.bool_]:
    """Return a rectangle without obstacles. Source: paper M, figure 7, map "empty rectangle" with 50 rows and 100 columns."""
    return np.ones((rows, columns), dtype=np.bool_)


GENERATORS = Registry[Generator]("map generator", open_to_others=False)

for _generator in (
    Generator("line", "A straight corridor one cell wide.", ("CELLS",), "line:5000", draw_line, seeded=False),
    Generator("rectangle", "An empty room.", ("ROWS", "COLUMNS"), "rectangle:50x100", draw_rectangle, seeded=False),
    Generator(
        "htree", "A tree of corridors one cell wide, made of bars that fork at right angles.", ("CELLS",), "htree:5000", draw_htree,
        seeded=False,
    ),
    Generator(
        "vessels", "A vascular network with forks, loops and dead ends, like the veins of a leaf.", ("CELLS",), "vessels:5000:7",
        draw_vessels, slow=True, smallest=30, largest=1_000_000,
    ),
    Generator(
        "vessels3d", "A 3-D tree of vessels whose radii follow Murray's law.", ("CELLS",), "vessels3d:5000:7",
        draw_vessel_tree, slow=True, smallest=30, largest=5_000_000,
    ),
    Generator(
        "vessels3d-loops", "A 3-D network of vessels with loops: the tree with some twigs joined.", ("CELLS",),
        "vessels3d-loops:5000:7", draw_vessel_net, slow=True, smallest=60, largest=5_000_000,
    ),
    Generator("maze", "A perfect maze: exactly one path between any two cells.", ("WIDTH", "HEIGHT"), "maze:61x41:3", draw_maze),
    Generator("cave", "A cave with smooth, irregular walls.", ("WIDTH", "HEIGHT"), "cave:120x80", draw_cave),
):  # fmt: skip
    GENERATORS.add(_generator.name, _generator)
