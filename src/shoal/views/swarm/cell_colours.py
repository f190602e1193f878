"""Colours of cells in pictures of episodes: five colours without noise, and a scale from obstacle to free with noise."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.swarm import Belief, SwarmEpisode, SwarmState
from shoal.swarm.maps.raster import PALETTE
from shoal.swarm.noise import moments

WRONG_FREE, WRONG_OBSTACLE = "#d63aa8", "#86126a"
"""Colours of wrongly classified cells: an obstacle as free, and a free cell as obstacle.

For all common kinds of colour blindness, they differ from the colour of particles.
"""

FRONTIER_TINT = 0.65
"""With noise: weight of the frontier colour in the colour of a frontier cell."""


@dataclass(frozen=True)
class CellPalette:
    """The colours of cell codes.

    Parameters
    ----------
    rgb : ndarray of uint8, shape (n, 3)
        The colours by code; the last is the colour of a particle.
    solid : ndarray of bool, shape (n,)
        Which codes are drawn in a 3-D view. Unknown cells and obstacles are not drawn, because they would hide all other cells.
    """

    rgb: NDArray[np.uint8]
    solid: NDArray[np.bool_]

    @property
    def particle(self) -> int:
        """The code of a particle."""
        return len(self.rgb) - 1


def _colour(text: str) -> NDArray[np.float64]:
    return np.array(tuple(bytes.fromhex(text[1:])), dtype=np.float64)


def _noisy() -> CellPalette:
    obstacle, unknown, free, frontier = (_colour(PALETTE[name]) for name in ("obstacle", "unknown", "free", "frontier"))
    shares = np.linspace(-1, 1, 2 * moments.LEVELS + 1)[:, None]
    shades = np.where(shares < 0, unknown + shares * (unknown - obstacle), unknown + shares * (free - unknown))
    others = [_colour(text) for text in (WRONG_FREE, WRONG_OBSTACLE, PALETTE["particle"])]
    colours = np.vstack([shades, FRONTIER_TINT * frontier + (1 - FRONTIER_TINT) * shades, others])
    solid = np.zeros(len(colours), dtype=np.bool_)
    solid[[moments.FREE, *range(moments.FRONTIER, len(colours))]] = True
    return CellPalette(colours.round().astype(np.uint8), solid)


_NAMES = ("unknown", "frontier", "free", "obstacle", "particle")
PLAIN = CellPalette(
    np.array([_colour(PALETTE[name]) for name in _NAMES], dtype=np.uint8), np.array([False, True, True, False, True])
)
NOISY = _noisy()


def palette_of_cells(episode: SwarmEpisode) -> CellPalette:
    """Return the colours for an episode."""
    return NOISY if episode.noisy else PLAIN


def codes_of(state: SwarmState, belief: Belief) -> NDArray[np.uint8]:
    """Return the colour code (an index of `PLAIN`) of each cell in an episode without noise; uint8, with a rim of one cell."""
    codes = belief.states
    codes[state.occupied.mask] = PLAIN.particle
    return codes


def codes_by_move(episode: SwarmEpisode) -> Iterator[NDArray[np.uint8]]:
    """Yield the colour code of each cell at the start and after each move; uint8, with the rim."""
    if episode.noisy:
        for moment in episode.moments():
            yield np.where(moment.particles, np.uint8(NOISY.particle), moment.looks)
    else:
        for state, belief in episode.frames():
            yield codes_of(state, belief)


def codes_after(episode: SwarmEpisode, moves: int) -> NDArray[np.uint8]:
    """Return the colour code of each cell after ``moves`` moves; uint8, with the rim."""
    if moves == episode.moves and palette_of_cells(episode) is PLAIN:
        return codes_of(*episode.final())  # the whole replay in compiled code
    return next(codes for i, codes in enumerate(codes_by_move(episode)) if i == moves)
