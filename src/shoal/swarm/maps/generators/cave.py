"""Cave maps: a cellular automaton smooths random cells, and the largest connected part becomes the map."""

from __future__ import annotations

import numpy as np

from shoal.swarm.maps.generators.components import Mask, largest_part

FIRST_SHARE = 0.5  # initial fraction of free cells; increased until the cave is large enough
WANTED_SHARE = 0.38  # minimum fraction of the picture that the cave fills
ROUNDS = 5  # smoothing steps; small pictures get fewer, otherwise their caves would vanish


def draw_cave(width: int, height: int, *, seed: int = 0) -> Mask:
    """Return a map of a cave with smooth walls.

    Parameters
    ----------
    width, height : int
        Size of the map in cells.
    seed : int
        Seed of the random numbers. Equal sizes and equal seeds give equal maps.

    Returns
    -------
    ndarray, bool, shape (height, width)
        True at free cells. The free cells are 4-connected and fill more than a third of the map.
    """
    rng = np.random.default_rng([seed, height, width])
    rounds = min(ROUNDS, min(width, height) // 4)
    share = FIRST_SHARE
    while True:
        free = rng.random((height, width)) < share
        for _ in range(rounds):
            free = _smooth(free)
        cave = largest_part(free)
        if np.count_nonzero(cave) >= WANTED_SHARE * cave.size or share >= 1:
            return cave
        share += 0.02


def _smooth(free: Mask) -> Mask:
    """Replace each cell by the majority of the 3 x 3 cells around it. Cells outside the map count as walls."""
    count = np.pad(free, 1).astype(np.int8)
    count = count[:-2] + count[1:-1] + count[2:]
    count = count[:, :-2] + count[:, 1:-1] + count[:, 2:]
    return np.asarray(count >= 5)
