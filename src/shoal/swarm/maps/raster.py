"""Pictures of cells as pixel arrays, without a plotting library."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray

UNKNOWN, FRONTIER, FREE, OBSTACLE, PARTICLE = range(5)
"""Codes for the content of a cell: the states that `Belief.states` returns, and the code of a free cell with a particle."""

# The colours differ for all common kinds of colour blindness and in greyscale: particles vermilion, frontier sky blue.
PALETTE: dict[str, str] = {
    "unknown": "#8f96a1",
    "frontier": "#62c4f7",
    "free": "#ffffff",
    "obstacle": "#1b222c",
    "particle": "#d55e00",
}
_COLOURS = np.array([tuple(bytes.fromhex(colour[1:])) for colour in PALETTE.values()], dtype=np.uint8)
MOST_LINES = 200  # a map with more rows, counted over all layers, is not printed as rows of text
_WIDEST = 12  # maps with a larger ratio of width to height are drawn in several strips


def raster_of(codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture of cells with one pixel per cell. The layers of a 3-D map stand side by side in the picture.

    Parameters
    ----------
    codes : ndarray of uint8, shape (H, W) or (D, H, W)
        Code of each cell: UNKNOWN, FRONTIER, FREE, OBSTACLE or PARTICLE.

    Returns
    -------
    ndarray of uint8, shape (H, W, 3)
    """
    if codes.ndim == 3:
        gap = np.full((codes.shape[1], 1), FREE, dtype=codes.dtype)  # white columns between layers
        codes = np.hstack([part for layer in codes for part in (layer, gap)][:-1])
    return _COLOURS[codes]


def text_rows(cells: NDArray[np.bool_], letters: str) -> str:
    """Return cells as rows of text. The first letter in ``letters`` stands for True cells, and the second letter for False cells.

    In 3-D, an empty line separates two layers of cells.

    Examples
    --------
    >>> text_rows(np.array([[True, False]]), ".#")
    '.#'
    """
    layers = np.where(cells, letters[0], letters[1]).reshape(-1, *cells.shape[-2:])
    return "\n\n".join("\n".join("".join(row) for row in layer) for layer in layers)


def in_strips(raster: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Cut a very wide picture into strips, and stack the strips like lines of text.

    Examples
    --------
    >>> in_strips(np.zeros((3, 5002, 3), np.uint8)).shape
    (111, 179, 3)
    """
    height, width = raster.shape[:2]
    if width <= _WIDEST * height:
        return raster
    strip = round(float(np.sqrt(1.6 * width * (height + 1))))
    count = -(-width // strip)
    sheet = np.full((count * (height + 1) - 1, strip, 3), 255, dtype=np.uint8)
    for i in range(count):
        part = raster[:, i * strip : (i + 1) * strip]
        sheet[i * (height + 1) : i * (height + 1) + height, : part.shape[1]] = part
    return sheet


def png_bytes(raster: NDArray[np.uint8], *, side: int = 640) -> bytes:
    """Return a picture as the bytes of a PNG file with sides of at most ``side`` pixels.

    A larger picture loses rows and columns at regular intervals. A smaller picture is enlarged by a whole-number factor.
    """
    from PIL import Image

    sheet = in_strips(raster)
    largest = max(sheet.shape[:2])
    every, times = max(1, -(-largest // side)), max(1, side // largest)
    sheet = np.repeat(np.repeat(sheet[::every, ::every], times, axis=0), times, axis=1)
    buffer = io.BytesIO()
    Image.fromarray(sheet).save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()
