"""Pictures of 3-D workspaces: a view that turns, and slices along the three axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from shoal.swarm import Belief, GridWorkspace, SwarmState
from shoal.swarm import belief as states
from shoal.swarm.display import PALETTE

ELEVATION = 0.35  # radians above the middle from which is looked
FARTHEST = 0.45  # brightness of what is farthest away
BACKGROUND = "obstacle"
FINEST = 4  # pixels of a cell, before the picture is enlarged
GAP = 8  # pixels between the parts of a sheet
PARTICLE = 4
_NAMES = ("unknown", "frontier", "free", "obstacle", "particle")
_COLOURS = np.array([tuple(bytes.fromhex(PALETTE[name][1:])) for name in _NAMES], dtype=np.uint8)
_SHOWN = np.array([False, True, True, False, True])  # nothing would be seen behind unknown cells and obstacles


@dataclass(frozen=True)
class Slices:
    """Where a volume is cut: the layer, row and column with most free cells."""

    layer: int
    row: int
    column: int

    @classmethod
    def of(cls, workspace: GridWorkspace) -> Slices:
        """Return the cuts for a workspace."""
        counts = [np.count_nonzero(workspace.free, axis=tuple({0, 1, 2} - {axis})) for axis in range(3)]
        return cls(*(int(np.argmax(count)) for count in counts))


def codes_of(state: SwarmState, belief: Belief) -> NDArray[np.uint8]:
    """Return what each cell looks like, an index into the palette; uint8, with one cell of rim on each side."""
    codes = belief.states
    codes[state.occupied.mask] = PARTICLE
    return codes


def workspace_codes(workspace: GridWorkspace) -> NDArray[np.uint8]:
    """Return the same of a workspace of which everything is known."""
    return np.pad(np.where(workspace.free, states.FREE, states.OBSTACLE).astype(np.uint8), 1, constant_values=states.OBSTACLE)


def turned_view(
    codes: NDArray[np.uint8], *, azimuth: float, side: int, spacing: tuple[float, ...] | None = None, elevation: float = ELEVATION
) -> NDArray[np.uint8]:
    """Return known-free cells, frontier and particles as seen from a turning place; uint8, shape (side, side, 3).

    Parameters
    ----------
    codes : ndarray of uint8, shape (D + 2, H + 2, W + 2)
        As of `codes_of`.
    azimuth : float
        Radians; 0 looks at layer 0, with row 0 on top.
    side : int
        Pixels.
    spacing : tuple of float, optional
        Size of a cell along each axis; only their ratio matters.
    elevation : float
        Radians above the middle from which is looked.
    """
    sizes = np.array(spacing or (1.0, 1.0, 1.0)) / min(spacing or (1.0,))
    background = _COLOURS[_NAMES.index(BACKGROUND)]
    cells = _surface(codes)
    if not len(cells):
        return np.full((side, side, 3), background, dtype=np.uint8)
    extent = np.array(codes.shape) * sizes
    wide = float(np.hypot(extent[0], extent[2]))  # whichever way it is turned
    tall = float(extent[1]) * np.cos(elevation) + wide * np.sin(elevation)
    coarse = max(1, int(0.96 * side / max(wide, tall) * float(sizes.max()) / FINEST))  # large cells need no fine picture
    small = -(-side // coarse)
    picture = np.full((small, small, 3), background, dtype=np.uint8)
    scale = 0.96 * small / max(wide, tall)
    z, y, x = ((cells + 0.5) * sizes - extent / 2).T * scale
    across, away = x * np.cos(azimuth) + z * np.sin(azimuth), z * np.cos(azimuth) - x * np.sin(azimuth)
    down, depth = y * np.cos(elevation) - away * np.sin(elevation), away * np.cos(elevation) + y * np.sin(elevation)
    order = np.argsort(-depth, kind="stable")  # the nearest last, over all others
    nearness = 1 - (depth - depth.min()) / max(1e-9, float(np.ptp(depth)))
    shade = (FARTHEST + (1 - FARTHEST) * nearness)[:, None]
    colours = (_COLOURS[codes[tuple(cells.T)]] * shade).astype(np.uint8)[order]
    size = max(1, int(np.ceil(scale * float(sizes.max()))))
    left, top = (np.floor(place[order] + small / 2 - size / 2).astype(np.int64) for place in (across, down))
    _splat(picture, left, top, depth[order], colours, size)
    return picture.repeat(coarse, axis=0).repeat(coarse, axis=1)[:side, :side]


def _surface(codes: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Return the cells that are drawn and have a neighbour that is not, or lie in the rim; int64, shape (n, 3)."""
    shown = np.pad(_SHOWN[codes], 1).ravel()
    flat = np.flatnonzero(shown)
    hidden = np.ones(len(flat), dtype=np.bool_)
    shape = tuple(side + 2 for side in codes.shape)
    for step in (1, shape[2], shape[1] * shape[2]):
        hidden &= shown[flat - step] & shown[flat + step]
    return np.stack(np.unravel_index(flat[~hidden], shape), axis=1) - 1


def _splat(
    picture: NDArray[np.uint8],
    left: NDArray[np.int64],
    top: NDArray[np.int64],
    depth: NDArray[np.float64],
    colours: NDArray[np.uint8],
    size: int,
) -> None:
    """Draw squares, far ones first; a square's pixels yield to nearer squares."""
    side = len(picture)
    near = np.full((side, side), np.inf)
    for dx in range(size):
        for dy in range(size):
            x, y = left + dx, top + dy
            inside = (x >= 0) & (x < side) & (y >= 0) & (y < side)
            inside[inside] = depth[inside] < near[y[inside], x[inside]]
            near[y[inside], x[inside]] = depth[inside]
            picture[y[inside], x[inside]] = colours[inside]


def slice_pictures(codes: NDArray[np.uint8], slices: Slices) -> list[NDArray[np.uint8]]:
    """Return the three slices, one pixel a cell, rim included: from the front, from above, from the right."""
    front = codes[slices.layer + 1]
    above = codes[::-1, slices.row + 1]  # what is in front is below
    right = codes[:, :, slices.column + 1].T
    return [_COLOURS[cut] for cut in (front, above, right)]


def sheet(
    codes: NDArray[np.uint8], slices: Slices, *, azimuth: float, side: int, spacing: tuple[float, ...] | None = None
) -> NDArray[np.uint8]:
    """Return a picture of the turned view with the slices in a column on its right; uint8, shape (side, about 1.4 side, 3)."""
    sizes = spacing or (1.0, 1.0, 1.0)
    lengths = [(sizes[1], sizes[2]), (sizes[0], sizes[2]), (sizes[1], sizes[0])]
    pictures = slice_pictures(codes, slices)
    room = (side - 2 * GAP) // 3, round(0.42 * side)
    whole = np.full((side, side + GAP + room[1], 3), 255, dtype=np.uint8)
    whole[:, :side] = turned_view(codes, azimuth=azimuth, side=side, spacing=spacing)
    for number, (picture, (tall, wide)) in enumerate(zip(pictures, lengths, strict=True)):
        scale = min(room[0] / (picture.shape[0] * tall), room[1] / (picture.shape[1] * wide))
        height, width = max(1, int(picture.shape[0] * tall * scale)), max(1, int(picture.shape[1] * wide * scale))
        method = Image.Resampling.NEAREST if height >= picture.shape[0] else Image.Resampling.BOX
        drawn = np.asarray(Image.fromarray(picture).resize((width, height), method))
        top, left = number * (room[0] + GAP) + (room[0] - height) // 2, side + GAP + (room[1] - width) // 2
        whole[top : top + height, left : left + width] = drawn
    return whole
