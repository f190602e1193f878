"""Data for pictures of an episode with noise: at one moment, the cells of the particles and the belief about each cell."""

from __future__ import annotations

from math import log

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.swarm.noise.belief import NoisyBelief
from shoal.swarm.noise.model import PRIOR, bound_of

LEVELS = 8
"""Number of shades between an unknown cell and a classified cell."""

OBSTACLE, UNKNOWN, FREE = 0, LEVELS, 2 * LEVELS  # values of looks: shades from classified obstacle to classified free,
FRONTIER = 2 * LEVELS + 1  # the same shades for frontier cells start here,
FALSE_FREE = 2 * FRONTIER  # an obstacle wrongly classified as free,
FALSE_OBSTACLE = FALSE_FREE + 1  # a free cell wrongly classified as obstacle
LOOKS = FALSE_OBSTACLE + 1


@dataclass(frozen=True)
class Moment:
    """One moment of an episode with noise. The arrays ``particles`` and ``looks`` cover the workspace and a rim of one cell.

    Parameters
    ----------
    particles : ndarray of bool
        Mask that is True for each cell with a particle. For a rig, the mask is True for each cell in which the last scan showed a
        particle.
    looks : ndarray of uint8
        The shade of each cell. A classified obstacle has the shade ``OBSTACLE``, an unknown cell has the shade ``UNKNOWN``, and a
        classified free cell has the shade ``FREE``. Between these three shades, the shade is linear in the log-odds that the cell
        is free. The constant ``FRONTIER`` is added to the shade of every frontier cell. If the true map is known, wrongly
        classified cells have the shade ``FALSE_FREE`` or ``FALSE_OBSTACLE``.
    """

    particles: NDArray[np.bool_]
    looks: NDArray[np.uint8]


def looks_of(belief: NoisyBelief, truth: NDArray[np.bool_] | None) -> NDArray[np.uint8]:
    """Return the shade of each cell in a picture of a belief. The class `Moment` explains the shades.

    ``truth`` is the true mask of the free cells, with a rim of one cell. If the true map is unknown, ``truth`` is None.

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
    inner = LEVELS - 1  # shades of unclassified cells
    looks = (UNKNOWN + np.clip(np.rint(share * LEVELS), -inner, inner)).astype(np.uint8)
    known = belief.belief
    free, obstacles = known.open.mask, known.obstacles.mask
    looks[free], looks[obstacles] = FREE, OBSTACLE
    looks[known.frontier.mask] += FRONTIER
    if truth is not None:
        looks[free & ~truth] = FALSE_FREE
        looks[obstacles & truth] = FALSE_OBSTACLE
    return np.asarray(looks)
