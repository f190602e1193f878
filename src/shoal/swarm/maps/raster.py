"""Pictures of workspaces and beliefs as arrays of pixels, and what notebooks show. No plotting library."""

from __future__ import annotations

import base64
import html
import io
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shoal.swarm.grid import belief as states

if TYPE_CHECKING:
    from shoal.swarm.episode import Episode
    from shoal.swarm.grid.belief import Belief
    from shoal.swarm.grid.state import SwarmState
    from shoal.swarm.maps.workspace import GridWorkspace

# Told apart with every common colour blindness, and in grey: particles vermilion, frontier sky blue.
PALETTE: dict[str, str] = {
    "unknown": "#8f96a1",
    "frontier": "#62c4f7",
    "free": "#ffffff",
    "obstacle": "#1b222c",
    "particle": "#d55e00",
}
_PARTICLE = 4
_WIDEST = 12  # a map more than so many times wider than tall is drawn in several strips


def _rgb(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


_COLOURS = np.array([_rgb(PALETTE[name]) for name in ("unknown", "frontier", "free", "obstacle", "particle")], dtype=np.uint8)


def workspace_raster(workspace: GridWorkspace) -> NDArray[np.uint8]:
    """Return a picture of a workspace, one pixel a cell; uint8, shape (H, W, 3). Layers of a 3-D one stand side by side."""
    codes = np.where(workspace.free, states.FREE, states.OBSTACLE)
    return _COLOURS[_flat(codes)]


def belief_raster(state: SwarmState, belief: Belief) -> NDArray[np.uint8]:
    """Return a picture of what is known and where the particles are, one pixel a cell, rim included; uint8, (H, W, 3)."""
    codes = belief.states
    codes[state.occupied.mask] = _PARTICLE
    return _COLOURS[_flat(codes)]


def _flat(codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    if codes.ndim == 2:
        return codes
    gap = np.full((codes.shape[1], 1), states.FREE, dtype=codes.dtype)  # white between layers
    return np.hstack([part for layer in codes for part in (layer, gap)][:-1])


def in_strips(raster: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Cut a very wide picture into strips, one below the other, as text is broken into lines.

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


def enlarged(raster: NDArray[np.uint8], *, side: int = 640) -> NDArray[np.uint8]:
    """Return the picture with whole pixels repeated (or, if it is too large, left out) so that it is about ``side`` wide."""
    sheet = in_strips(raster)
    largest = max(sheet.shape[:2])
    if largest > side:
        every = -(-largest // side)
        return sheet[::every, ::every]
    times = max(1, side // largest)
    return np.repeat(np.repeat(sheet, times, axis=0), times, axis=1)


def png_bytes(raster: NDArray[np.uint8], *, side: int = 640) -> bytes:
    """Return the picture as a PNG file, enlarged to about ``side`` pixels."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(enlarged(raster, side=side)).save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()


def episode_html(episode: Episode) -> str:
    """Return what a notebook shows of an episode: its last picture and a line of numbers."""
    picture = base64.b64encode(png_bytes(belief_raster(*episode.final()), side=480)).decode()
    name, policy = html.escape(episode.workspace.name), html.escape(episode.policy)
    return (
        f'<figure style="margin:0"><img alt="final map of {name}" src="data:image/png;base64,{picture}" '
        'style="image-rendering:pixelated;max-width:100%"/>'
        f"<figcaption><b>{name}</b>: {episode.task} by {policy}, {episode.n_particles} particles, rule {episode.rule}; "
        f"{html.escape(episode.sentence)}</figcaption></figure>"
    )
