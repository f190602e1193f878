"""Colours of cells in figures and films of swarms: the palettes, the legend, and the code of each
cell at each moment of an episode.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.swarm import Belief, SwarmEpisode, SwarmState, noise
from shoal.swarm.maps.workspace import COLOURS, FREE, FRONTIER, PALETTE

LEGEND = ("particle", "frontier", "free", "obstacle", "unknown")
"""Names of the colours in the order of the legend."""
SOLID = frozenset({"particle", "frontier", "free"})
"""Names of the colours that hide more of a photograph under the map (`CellPalette.solid`)."""


def legend_of(episode: SwarmEpisode) -> dict[str, str]:
    """Return the words of the legend for each colour that pictures of an episode contain."""
    names = {name: name for name in LEGEND}
    if episode.task == "gathering":
        del names["unknown"]
        if episode.targets is None:
            del names["frontier"]
            return names
        return names | {"frontier": "region"}
    return names if episode.targets is None else names | {"frontier": "not covered yet"}


WRONG_FREE, WRONG_OBSTACLE = "#d63aa8", "#86126a"
"""Colours of wrongly classified cells: an obstacle that counts as free, and a free cell that counts
as an obstacle.

With any common kind of colour blindness, a viewer can distinguish both colours from the colour of
particles.
"""

FRONTIER_TINT = 0.65
"""With noise: weight of the frontier colour in the colour of a frontier cell."""


@dataclass(frozen=True)
class CellPalette:
    """The colour for each colour code of a cell.

    Parameters
    ----------
    rgb : ndarray of uint8, shape (n, 3)
        Row k is the RGB colour for the code k; the last row is the colour of particles.
    solid : ndarray of bool, shape (n,)
        For each code, whether a 3-D view shows cells with the code. A 3-D view omits unknown cells
        and obstacles, because they would hide all other cells.
    """

    rgb: NDArray[np.uint8]
    solid: NDArray[np.bool_]

    @property
    def particle(self) -> int:
        """The colour code of a cell with a particle."""
        return len(self.rgb) - 1


def rgb_of(text: str) -> tuple[int, ...]:
    """Return red, green and blue, from 0 to 255, of a colour as the web writes it."""
    return tuple(bytes.fromhex(text[1:]))


def _shade(text: str) -> NDArray[np.float64]:
    return np.array(rgb_of(text), dtype=np.float64)


def _noisy(free_colour: str) -> CellPalette:
    obstacle, unknown, frontier = (
        _shade(PALETTE[name]) for name in ("obstacle", "unknown", "frontier")
    )
    free = _shade(free_colour)
    shares = np.linspace(-1, 1, 2 * noise.LEVELS + 1)[:, None]
    shades = np.where(
        shares < 0, unknown + shares * (unknown - obstacle), unknown + shares * (free - unknown)
    )
    overlays = [_shade(text) for text in (WRONG_FREE, WRONG_OBSTACLE, PALETTE["particle"])]
    colours = np.vstack([shades, FRONTIER_TINT * frontier + (1 - FRONTIER_TINT) * shades, overlays])
    solid = np.zeros(len(colours), dtype=np.bool_)
    solid[[noise.FREE, *range(noise.FRONTIER, len(colours))]] = True
    return CellPalette(colours.round().astype(np.uint8), solid)


def _plain(free_colour: str) -> CellPalette:
    colours = COLOURS.copy()
    colours[FREE] = rgb_of(free_colour)
    return CellPalette(colours, np.array([False, True, True, False, True]))


VOLUME_FREE = "#f2dfae"
"""The colour of free cells of a volume. Its rotated view shades cells by their distance, where
white would turn into the grey of unknown cells, and stands on white.
"""

PLAIN, NOISY = _plain(PALETTE["free"]), _noisy(PALETTE["free"])
VOLUME, NOISY_VOLUME = _plain(VOLUME_FREE), _noisy(VOLUME_FREE)


def palette_of_cells(episode: SwarmEpisode) -> CellPalette:
    """Return the palette for an episode: with or without noise, of a plane map or of a volume."""
    if episode.workspace.ndim == 3:
        return NOISY_VOLUME if episode.noisy else VOLUME
    return NOISY if episode.noisy else PLAIN


def legend_colour(episode: SwarmEpisode, name: str) -> str:
    """Return the colour beside a name of the legend of an episode."""
    if name == "frontier" and episode.noisy:  # of the shade of cells about which nothing is known
        shade = FRONTIER_TINT * _shade(PALETTE[name]) + (1 - FRONTIER_TINT) * _shade(
            PALETTE["unknown"]
        )
        return f"#{shade.round().astype(np.uint8).tobytes().hex()}"
    return VOLUME_FREE if name == "free" and episode.workspace.ndim == 3 else PALETTE[name]


def codes_of(state: SwarmState, belief: Belief) -> NDArray[np.uint8]:
    """Return the colour code of each cell in an episode without noise; uint8, with a rim of one
    cell around the map.
    """
    codes = belief.states
    codes[state.occupied.mask] = PLAIN.particle
    return codes


def codes_by_move(episode: SwarmEpisode) -> Iterator[NDArray[np.uint8]]:
    """Yield the colour codes of all cells at the start and after each move; uint8, with a rim of
    one cell around the map.
    """
    if episode.noisy:
        palette = palette_of_cells(episode)
        for moment in episode.moments():
            yield np.where(moment.particles, np.uint8(palette.particle), moment.looks)
    else:
        for state, belief in episode.frames():
            yield _with_region(episode, codes_of(state, belief))


def codes_after(episode: SwarmEpisode, moves: int) -> NDArray[np.uint8]:
    """Return the colour codes of all cells after ``moves`` moves; uint8, with a rim of one cell
    around the map.
    """
    if moves == episode.moves and not episode.noisy:
        # the whole replay in compiled code
        return _with_region(episode, codes_of(*episode.final()))
    return next(codes for i, codes in enumerate(codes_by_move(episode)) if i == moves)


def _with_region(episode: SwarmEpisode, codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the codes with the empty cells of a gathering's region in the colour of frontiers."""
    if episode.targets is not None and episode.task == "gathering":
        codes[np.pad(episode.targets, 1) & (codes != PLAIN.particle)] = FRONTIER
    return codes
