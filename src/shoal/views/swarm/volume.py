"""Pictures of 3-D maps of cells: a rotated view, and one slice along each of the three axes."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from shoal.core.dataclass import dataclass
from shoal.swarm import GridWorkspace
from shoal.swarm.maps.workspace import FREE, OBSTACLE, PALETTE, png_bytes
from shoal.views.drawing.canvas import Canvas
from shoal.views.swarm.colours import VOLUME, CellPalette

CORNER = 0.6  # azimuth in radians of a picture that does not rotate
ELEVATION = 0.35  # elevation of the view in radians
FARTHEST = 0.6  # brightness of the farthest cells
THROUGH = 0.45  # visibility of a hidden particle through its vessel's wall
BACKGROUND = (255, 255, 255)
FINEST = 4  # pixels per cell, before the picture is enlarged
GAP = 8  # pixels between the parts of a sheet
# relative to the side of a sheet: width of its slices, and of their names
NARROWEST, WIDEST = 0.31, 0.42
LEAST_LINE = 13  # pixels per line of text


@dataclass(frozen=True)
class Slices:
    """The three slices of a 3-D map that pictures show: the layer, the row and the column with the
    most free cells.
    """

    layer: int
    row: int
    column: int

    @property
    def names(self) -> tuple[str, str, str]:
        """Which slices these are, and from where they are seen."""
        return (
            f"layer {self.layer}, front",
            f"row {self.row}, above",
            f"column {self.column}, right",
        )

    @classmethod
    def of(cls, workspace: GridWorkspace) -> Slices:
        """Return, for each axis of a workspace, the slice that contains the most free cells."""
        counts = [
            np.count_nonzero(workspace.free, axis=tuple({0, 1, 2} - {axis})) for axis in range(3)
        ]
        return cls(*(int(np.argmax(count)) for count in counts))


@dataclass(frozen=True)
class Fit:
    """The extent of a rotated view of a 3-D map, large enough to show all drawn cells from every
    direction.

    Parameters
    ----------
    centre : tuple of float
        Centre of rotation (layer, row, column), measured from the corner of the rim in units of the
        smallest side of a cell.
    wide, tall : float
        Required width and height of the view, in units of the smallest side of a cell.
    middle : float
        Distance of the picture's centre below the centre of rotation, in units of the smallest side
        of a cell.
    """

    centre: tuple[float, float, float]
    wide: float
    tall: float
    middle: float

    @classmethod
    def of(cls, workspace: GridWorkspace, elevation: float = ELEVATION) -> Fit:
        """Return an extent large enough to show all free cells of a 3-D map, and the walls around
        these cells.
        """
        sizes = _sizes(workspace.spacing)
        margin = 1.5 * float(sizes.max())
        places = (workspace.cells + 1.5) * sizes  # the rim contains the first cell
        z, y, x = ((places.min(axis=0) + places.max(axis=0)) / 2).tolist()
        away = np.hypot(places[:, 0] - z, places[:, 2] - x)
        height = (places[:, 1] - y) * np.cos(elevation)
        top = float((height - away * np.sin(elevation)).min())
        bottom = float((height + away * np.sin(elevation)).max())
        return cls(
            (z, y, x),
            2 * (float(away.max()) + margin),
            bottom - top + 2 * margin,
            (top + bottom) / 2,
        )

    def pixels_a_cell(self, side: int) -> float:
        """Return the length of a cell's shortest side, in pixels, in a rotated view with a side of
        ``side`` pixels.
        """
        return 0.96 * side / max(self.wide, self.tall)


def _sizes(spacing: tuple[float, ...] | None) -> NDArray[np.float64]:
    """Return the size of a cell along each axis, scaled so that the smallest size is 1."""
    return np.array(spacing or (1.0, 1.0, 1.0)) / min(spacing or (1.0,))


def rotated_view(
    codes: NDArray[np.uint8],
    *,
    azimuth: float,
    side: int,
    spacing: tuple[float, ...] | None = None,
    elevation: float = ELEVATION,
    palette: CellPalette = VOLUME,
    fit: Fit,
) -> NDArray[np.uint8]:
    """Return a rotated view of the known free cells, the frontier cells and the particles; uint8,
    shape (side, side, 3).

    Parameters
    ----------
    codes : ndarray of uint8, shape (D + 2, H + 2, W + 2)
        Colour codes of all cells, as from `shoal.views.swarm.volume.codes_by_move`.
    azimuth : float
        Azimuth of the view in radians. The azimuth 0 looks at layer 0, with row 0 on top.
    side : int
        Width and height of the picture in pixels.
    spacing : tuple of float, optional
        Size of a cell along each axis, in any unit, because only the ratios matter.
    elevation : float
        Elevation of the camera in radians.
    palette : CellPalette
        The colour of each colour code.
    fit : Fit
        The extent of the view.
    """
    sizes = _sizes(spacing)
    background, cells = BACKGROUND, _surface(codes, palette)
    if not len(cells):
        return np.full((side, side, 3), background, dtype=np.uint8)
    largest = max(fit.wide, fit.tall)
    # large cells need no high resolution
    coarse = max(1, int(0.96 * side / largest * float(sizes.max()) / FINEST))
    small = -(-side // coarse)
    picture = np.full((small, small, 3), background, dtype=np.uint8)
    scale = 0.96 * small / largest
    size = max(1, int(np.ceil(scale * float(sizes.max()))))

    def project(
        cells: NDArray[np.int64],
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        z, y, x = ((cells + 0.5) * sizes - np.array(fit.centre)).T * scale
        across = x * np.cos(azimuth) + z * np.sin(azimuth)
        away = z * np.cos(azimuth) - x * np.sin(azimuth)
        down = y * np.cos(elevation) - away * np.sin(elevation) - fit.middle * scale
        left, top = (
            np.floor(place + small / 2 - size / 2).astype(np.int64) for place in (across, down)
        )
        return left, top, away * np.cos(elevation) + y * np.sin(elevation)

    left, top, depth = project(cells)
    order = np.argsort(-depth, kind="stable")  # the nearest last, over all others
    nearness = 1 - (depth - depth.min()) / max(1e-9, float(np.ptp(depth)))
    shade = (FARTHEST + (1 - FARTHEST) * nearness)[:, None]
    colours = (palette.rgb[codes[tuple(cells.T)]] * shade).astype(np.uint8)
    _splat(picture, left[order], top[order], depth[order], colours[order], size)
    # Particles inside a wide vessel are visible through its wall.
    particles = np.argwhere(codes == palette.particle)
    through, colour = picture.copy(), palette.rgb[palette.particle]
    _splat(through, *project(particles), np.broadcast_to(colour, (len(particles), 3)), size)
    covered = (through == colour).all(axis=2) & (picture != colour).any(axis=2)
    mixed = THROUGH * colour + (1 - THROUGH) * picture[covered]
    picture[covered] = mixed.astype(np.uint8)
    return picture.repeat(coarse, axis=0).repeat(coarse, axis=1)[:side, :side]


def _surface(codes: NDArray[np.uint8], palette: CellPalette) -> NDArray[np.int64]:
    """Return the drawn cells that lie in the rim or beside a cell that is not drawn; int64, shape
    (n, 3).
    """
    solid = np.pad(palette.solid[codes], 1).ravel()
    flat = np.flatnonzero(solid)
    hidden = np.ones(len(flat), dtype=np.bool_)
    shape = tuple(side + 2 for side in codes.shape)
    for step in (1, shape[2], shape[1] * shape[2]):
        hidden &= solid[flat - step] & solid[flat + step]
    return np.stack(np.unravel_index(flat[~hidden], shape), axis=1) - 1


def _splat(
    picture: NDArray[np.uint8],
    left: NDArray[np.int64],
    top: NDArray[np.int64],
    depth: NDArray[np.float64],
    colours: NDArray[np.uint8],
    size: int,
) -> None:
    """Draw squares in the order from far to near, so that near squares cover far squares."""
    side = len(picture)
    near = np.full((side, side), np.inf)
    for dx in range(size):
        for dy in range(size):
            x, y = left + dx, top + dy
            inside = (x >= 0) & (x < side) & (y >= 0) & (y < side)
            inside[inside] = depth[inside] < near[y[inside], x[inside]]
            near[y[inside], x[inside]] = depth[inside]
            picture[y[inside], x[inside]] = colours[inside]


def slice_pictures(
    codes: NDArray[np.uint8], slices: Slices, palette: CellPalette = VOLUME
) -> list[NDArray[np.uint8]]:
    """Return pictures of the three slices, seen from the front, from above and from the right.

    Each picture has one pixel for each cell, including the rim.
    """
    front = codes[slices.layer + 1]
    above = codes[::-1, slices.row + 1]  # the front is at the bottom
    right = codes[:, :, slices.column + 1].T
    return [palette.rgb[plane] for plane in (front, above, right)]


def sheet_width(shape: tuple[int, ...], side: int, spacing: tuple[float, ...] | None = None) -> int:
    """Return the width, in pixels, of the picture that `sheet` makes from colour codes of the given
    shape.
    """
    return side + GAP + _slice_box(shape, side, spacing)[1]


def _slice_box(
    shape: tuple[int, ...], side: int, spacing: tuple[float, ...] | None, line: int | None = None
) -> tuple[int, int, int]:
    """Return the maximum height of a slice, the maximum width of a slice, and the height of a
    slice's name, all in pixels.
    """
    line = max(LEAST_LINE, side // 30) if line is None else line
    high = (side - 2 * GAP) // 3 - line
    deep, tall, wide = (length * size for length, size in zip(shape, _sizes(spacing), strict=True))
    widest = max(wide / tall, wide / deep, deep / tall) * high
    return high, round(float(np.clip(widest, NARROWEST * side, WIDEST * side))), line


def sheet(
    codes: NDArray[np.uint8],
    slices: Slices,
    *,
    azimuth: float,
    side: int,
    spacing: tuple[float, ...] | None = None,
    palette: CellPalette = VOLUME,
    fit: Fit,
    unnamed: int | None = None,
) -> NDArray[np.uint8]:
    """Return a picture: the rotated view on the left, the slices on the right with their names, or
    with ``unnamed`` rows of pixels for each name; uint8, shape (side, about 1.4 side, 3).
    """
    sizes = spacing or (1.0, 1.0, 1.0)
    lengths = [(sizes[1], sizes[2]), (sizes[0], sizes[2]), (sizes[1], sizes[0])]
    *box, line = _slice_box(codes.shape, side, spacing, unnamed)
    page = np.full((side, side + GAP + box[1], 3), 255, dtype=np.uint8)
    page[:, :side] = rotated_view(
        codes, azimuth=azimuth, side=side, spacing=spacing, palette=palette, fit=fit
    )
    for number, (picture, (tall, wide), name) in enumerate(
        zip(slice_pictures(codes, slices, palette), lengths, slices.names, strict=True)
    ):
        scale = min(box[0] / (picture.shape[0] * tall), box[1] / (picture.shape[1] * wide))
        height = max(1, int(picture.shape[0] * tall * scale))
        width = max(1, int(picture.shape[1] * wide * scale))
        method = Image.Resampling.NEAREST if height >= picture.shape[0] else Image.Resampling.BOX
        slice_picture = np.asarray(Image.fromarray(picture).resize((width, height), method))
        top, left = number * (box[0] + line + GAP), side + GAP
        if unnamed is None:
            page[top : top + line, left:] = _written(name, box[1], line)
        page[top + line : top + line + height, left : left + width] = slice_picture
    return page


def caption_boxes(
    shape: tuple[int, ...], side: int, spacing: tuple[float, ...] | None, unnamed: int
) -> tuple[list[tuple[int, int]], int]:
    """Return where `sheet` leaves ``unnamed`` rows for the names of the three slices: their left
    lower corners (x, y), and their width, in pixels.
    """
    *box, line = _slice_box(shape, side, spacing, unnamed)
    corners = [(side + GAP, number * (box[0] + line + GAP) + line) for number in range(3)]
    return corners, box[1]


def notebook_picture(workspace: GridWorkspace, *, side: int = 640) -> bytes:
    """Return the picture of `sheet` for a completely known 3-D workspace, as the bytes of a PNG file."""
    codes = np.pad(
        np.where(workspace.free, FREE, OBSTACLE).astype(np.uint8),
        1,
        constant_values=OBSTACLE,
    )
    fit = Fit.of(workspace)
    view = sheet(
        codes, Slices.of(workspace), azimuth=CORNER, side=side, spacing=workspace.spacing, fit=fit
    )
    return png_bytes(view, side=max(view.shape))


@lru_cache(maxsize=16)
def _written(words: str, width: int, height: int) -> NDArray[np.uint8]:
    """Return a picture with one line of dark text on white; uint8, shape (height, width, 3)."""
    canvas, size = Canvas(width, height), 0.74 * height
    wide = canvas.text((0, 0.72 * height), words, PALETTE["obstacle"], size)
    if wide > width:
        canvas = Canvas(width, height)
        canvas.text((0, 0.72 * height), words, PALETTE["obstacle"], size * (width - 1) / wide)
    return canvas.frame()
