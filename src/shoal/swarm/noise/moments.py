"""What there is to see of an episode with noise at one moment: where particles are, and what the belief holds of each cell."""

from __future__ import annotations

from math import log

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.swarm.noise.belief import NoisyBelief
from shoal.swarm.noise.model import PRIOR, bound_of

LEVELS = 8
"""Shades between a cell of which nothing is known and one that is classified, on either side."""

OBSTACLE, UNKNOWN, FREE = 0, LEVELS, 2 * LEVELS  # looks: the shades from classified as obstacle to classified as free,
FRONTIER = 2 * LEVELS + 1  # ... the same of frontier cells, from here on,
FALSE_FREE = 2 * FRONTIER  # ... an obstacle classified as free,
FALSE_OBSTACLE = FALSE_FREE + 1  # ... and a free cell classified as obstacle
LOOKS = FALSE_OBSTACLE + 1


@dataclass(frozen=True)
class Moment:
    """One moment of an episode with noise; both arrays have the shape of the workspace with one cell of rim.

    Parameters
    ----------
    particles : ndarray of bool
        Where particles are; of a rig, of which that is not known, where the last scan has shown them.
    looks : ndarray of uint8
        A shade from ``OBSTACLE`` (classified as that) over ``UNKNOWN`` to ``FREE``, even in log-odds; ``FRONTIER`` is added for
        frontier cells; ``FALSE_FREE`` or ``FALSE_OBSTACLE`` if a cell is classified wrongly, as far as that is known.
    """

    particles: NDArray[np.bool_]
    looks: NDArray[np.uint8]


def looks_of(belief: NoisyBelief, truth: NDArray[np.bool_] | None) -> NDArray[np.uint8]:
    """Return the looks of a belief; ``truth`` says which cells are free, rim included, if that is known.

    Examples
    --------
    >>> from shoal.swarm.grid.board import Board, GridLayout
    >>> from shoal.swarm.noise.model import Noise
    >>> belief = NoisyBelief((1, 3), Board.of_cells(GridLayout((1, 3)), [(0, 0)]), Noise(slip=0.05))
    >>> looks_of(belief, None)[1].tolist()  # the particle stands between two frontier cells
    [25, 16, 25, 8, 8]
    """
    bound, start = bound_of(belief.confidence), log(PRIOR / (1 - PRIOR))
    gained = belief.logit - start
    share = np.where(gained >= 0, gained / (bound - start), gained / (bound + start))
    inner = LEVELS - 1  # of cells that are not classified
    looks = (UNKNOWN + np.clip(np.rint(share * LEVELS), -inner, inner)).astype(np.uint8)
    known = belief.belief
    free, obstacles = known.open.mask, known.obstacles.mask
    looks[free], looks[obstacles] = FREE, OBSTACLE
    looks[known.frontier.mask] += FRONTIER
    if truth is not None:
        looks[free & ~truth] = FALSE_FREE
        looks[obstacles & truth] = FALSE_OBSTACLE
    return np.asarray(looks)
