"""The film of a drive in the pictures of its camera, with what was found drawn over them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from shoal.swarm import SwarmEpisode
    from shoal.swarm.grid.board import Board

RATE, QUALITY = 8.0, 23  # frames a second, and constant rate factor of H.264
WALL, FRONTIER, PARTICLE = (30, 60, 200, 110), (240, 200, 0, 90), (220, 30, 30, 255)
RING = 0.35  # radius of the ring around an observed particle, in cells
CORNERS = np.array([[-0.5, -0.5], [-0.5, 0.5], [0.5, 0.5], [0.5, -0.5]])
ToPixels = Callable[[Any], NDArray[np.float64]]


def write_camera_film(
    pictures: Path,
    path: Path,
    episode: SwarmEpisode,
    scans: dict[int, list[list[int]]],
    to_pixels: ToPixels,
) -> Path:
    """Write a film (MP4) of the pictures that a drive has kept, one for each scan.

    Walls that were found are blue, frontier cells are yellow, and a red ring surrounds each
    observed particle.

    Parameters
    ----------
    pictures : path
        Folder of the pictures, whose names are the numbers of moves.
    path : path
    episode : SwarmEpisode
    scans : dict
        The observed cells by number of moves.
    to_pixels : callable
        Maps cells (row, column), shape (n, 2), to pixels (x, y).

    Raises
    ------
    MissingExtraError, OutputError
    """
    from shoal.core.files import atomic
    from shoal.views.drawing.encoding import Clip, encode_film

    kept = {int(file.stem): file for file in pictures.glob("[0-9]*.jpg")}
    moves = [move for move in sorted(kept) if move in scans and move <= episode.moves]

    def frames(shown: Sequence[int]) -> Iterator[NDArray[np.uint8]]:
        wanted = set(shown)
        for move, (_, belief) in enumerate(episode.frames()):
            if move in wanted:
                layers = [(belief.obstacles, WALL), (belief.frontier, FRONTIER)]
                yield _drawn(kept[move], layers, scans[move], to_pixels)

    with atomic(path) as temporary:
        clip = Clip(frames, moves, RATE, QUALITY)
        encode_film(temporary, clip, gif=False, on_frame=None)
    return path


def _drawn(
    file: Path,
    layers: Sequence[tuple[Board, tuple[int, ...]]],
    particles: list[list[int]],
    to_pixels: ToPixels,
) -> NDArray[np.uint8]:
    """Return a picture with cells and rings drawn over it."""
    from PIL import Image, ImageDraw

    with Image.open(file) as opened:
        picture = opened.convert("RGBA")
    over = Image.new("RGBA", picture.size)
    draw = ImageDraw.Draw(over)
    for board, colour in layers:
        cells = np.argwhere(board.mask) - 1  # the mask has a rim
        for corners in to_pixels((cells[:, None] + CORNERS).reshape(-1, 2)).reshape(-1, 4, 2):
            draw.polygon([tuple(corner) for corner in corners.tolist()], fill=colour)
    turn = np.linspace(0, 2 * np.pi, 17)
    circle = RING * np.column_stack([np.cos(turn), np.sin(turn)])
    for cell in particles:
        ring = to_pixels(np.array(cell) + circle)
        draw.line([tuple(point) for point in ring.tolist()], fill=PARTICLE, width=2)
    return np.asarray(Image.alpha_composite(picture, over).convert("RGB"))
