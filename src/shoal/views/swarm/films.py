"""Frames for films of swarm episodes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache
from typing import Any

import numpy as np
from matplotlib import get_data_path
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from shoal.swarm import GridWorkspace, SwarmEpisode
from shoal.swarm.maps.workspace import PALETTE, in_strips
from shoal.views.drawing.charts import bar_length
from shoal.views.drawing.encoding import LONGEST, Clip
from shoal.views.drawing.stage import Stage
from shoal.views.swarm.colours import (
    SOLID,
    codes_by_move,
    legend_colour,
    legend_of,
    palette_of_cells,
    rgb_of,
)
from shoal.views.swarm.photograph import PhotographBelow
from shoal.views.swarm.presentation import presentation_clip
from shoal.views.swarm.volume import Fit, Slices, sheet

_SECONDS = 20.0
_FONT = f"{get_data_path()}/fonts/ttf/DejaVuSans.ttf"
ARROWS = dict(zip("lrud", "\u2190\u2192\u2191\u2193", strict=True))  # in and out have no arrows
# pixels: minimum side, and maximum side unless the map has more cells
SHORT_SIDE, LONG_SIDE = 720, 1920
CAPTION = 68  # pixels below the cells
TURNS = 2  # pixels of a volume in a film
VOLUME_SIDE = 720  # pixels of the rotating view


def clip_of(episode: SwarmEpisode, suffix: str, stage: Stage | None) -> Clip[Any]:
    """Return the film of a swarm episode, ready for encoding as GIF or H.264. The film of a long
    episode skips moves. With a stage, it is one for presentations.
    """
    if stage is not None:
        return presentation_clip(episode, stage)
    volume = episode.workspace.ndim == 3
    move_numbers = frame_moves(episode.moves, LONGEST[".gif" if volume else suffix])
    return Clip(
        frames=lambda moves: pictures_with_legend(
            episode, moves, film_frames(episode, np.asarray(moves))
        ),
        moments=move_numbers.tolist(),
        rate=float(np.clip(len(move_numbers) / _SECONDS, 4, 30 if suffix == ".gif" else 60)),
        quality=26,
        # shading of a volume, or a photograph: colours of the frames themselves
        palette=(
            None if volume or episode.problem.vessels else palette_of_cells(episode).rgb.tobytes()
        ),
    )


def frame_moves(moves: int, at_most: int) -> NDArray[np.int64]:
    """Return the numbers of moves after which a film has a frame: at most ``at_most`` numbers, from
    0 to ``moves``.

    Examples
    --------
    >>> frame_moves(10, 4).tolist()
    [0, 3, 7, 10]
    """
    return np.unique(
        np.linspace(0, moves, min(moves + 1, max(2, at_most))).round().astype(np.int64)
    )


def film_frames(episode: SwarmEpisode, moves: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
    """Yield the picture of an episode after each number of moves in ``moves``; uint8, shape (H, W,
    3).

    The picture of a 2-D map has one pixel for each cell. The picture of a 3-D map is a rotating
    view with a height of `VOLUME_SIDE` pixels, and slices on its right.
    """
    selection = set(moves.tolist())
    workspace = episode.workspace
    volume = (Slices.of(workspace), Fit.of(workspace)) if workspace.ndim == 3 else None
    palette = palette_of_cells(episode)
    for move, codes in enumerate(codes_by_move(episode)):
        if move in selection:
            if volume is not None:
                turn = 2 * np.pi * TURNS * move / max(1, episode.moves)
                picture = sheet(
                    codes,
                    volume[0],
                    azimuth=turn,
                    side=VOLUME_SIDE,
                    spacing=workspace.spacing,
                    palette=palette,
                    fit=volume[1],
                )
            else:
                picture = in_strips(palette.rgb[codes])
            yield (
                picture
                if episode.trace.scanned.all()
                else np.vstack([picture, scan_strip(episode.trace.scanned, move, picture.shape[1])])
            )


def pictures_with_legend(
    episode: SwarmEpisode, moves: Iterable[int], pictures: Iterable[NDArray[np.uint8]]
) -> Iterator[NDArray[np.uint8]]:
    """Yield enlarged pictures with a caption: the number of the move, the command as an arrow, and
    a legend of the colours.
    """
    blank: Image.Image | None = None
    below: PhotographBelow | None = None
    rows, columns = (side + 2 for side in episode.workspace.shape[-2:])
    for move, picture in zip(moves, pictures, strict=True):
        short, long = sorted(picture.shape[:2])
        times = max(1, min(-(-SHORT_SIDE // short), LONG_SIDE // long))
        height, width = (side * times for side in picture.shape[:2])
        if blank is None:
            if episode.workspace.ndim == 2 and picture.shape[1] == columns:  # not cut in strips
                below = PhotographBelow.of(episode, (width, rows * times), times)
            blank = _legend(episode, width + width % 2, height + height % 2 + CAPTION, below)
            _draw_scale_bar(blank, episode.workspace, times)
        sheet = blank.copy()
        sheet.paste(Image.fromarray(picture).resize((width, height), Image.Resampling.NEAREST))
        if below is not None:
            cells = picture[:rows]
            sheet.paste(Image.fromarray(below.under(cells, _hides(episode, cells))))
        command = episode.commands[move - 1] if move else ""
        arrow = "   " + ARROWS.get(command, {"i": "in", "o": "out"}.get(command, ""))
        note = f"   {episode.out_of_reach} are out of reach" if episode.unreachable else ""
        text = f"move {move} of {episode.moves}{arrow}{note}"
        ImageDraw.Draw(sheet).text(
            (10, sheet.height - CAPTION + 8), text, _colour("obstacle"), _font(sheet.width)
        )
        yield np.asarray(sheet)


def _hides(episode: SwarmEpisode, cells: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return for each cell of a picture whether its colour is one that hides a photograph."""
    palette = palette_of_cells(episode)
    packed, open_ = (
        colours.astype(np.int64) @ [1 << 16, 1 << 8, 1]
        for colours in (cells, palette.rgb[~palette.solid])
    )
    return ~np.isin(packed, open_)


def _legend(
    episode: SwarmEpisode, width: int, height: int, below: PhotographBelow | None
) -> Image.Image:
    """Return the picture of the colour legend, which is the footer of all frames."""
    sheet = Image.new("RGB", (width, height), _colour("free"))
    pen, font, top = ImageDraw.Draw(sheet), _font(width), height - CAPTION
    left, size = 10.0, font.size
    for key, name in legend_of(episode).items():
        colour = rgb_of(legend_colour(episode, key))
        if below is not None:
            colour = below.shade(colour, key in SOLID)
        pen.rectangle(
            (left, top + 41, left + 0.8 * size, top + 41 + 0.8 * size),
            colour,
            _colour("unknown"),
        )
        pen.text((left + 1.2 * size, top + 38), name, _colour("obstacle"), font)
        left += 2.4 * size + pen.textlength(name, font)
    return sheet


def _draw_scale_bar(sheet: Image.Image, workspace: GridWorkspace, times: int) -> None:
    """Draw a scale bar at the right of the caption, if the size of a cell is known.

    In a 2-D film, the side of a cell is ``times`` pixels.
    """
    if workspace.spacing is None:
        return
    volume = workspace.ndim == 3
    pixels = times * Fit.of(workspace).pixels_a_cell(VOLUME_SIDE) if volume else times
    size = (min(workspace.spacing) if volume else workspace.spacing[1]) / pixels
    length = bar_length(0.2 * sheet.width * size)
    pen = ImageDraw.Draw(sheet)
    font = _font(sheet.width)
    right = sheet.width - 10
    low = sheet.height - CAPTION + 20
    pen.line((right - length / size, low, right, low), _colour("obstacle"), width=3)
    pen.text(
        (right - length / size - 8, low), f"{length:g} mm", _colour("obstacle"), font, anchor="rm"
    )


@cache
def _font(width: int) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(_FONT, min(20.0, width / 38))


def scan_strip(scanned: NDArray[np.bool_], move: int, width: int) -> NDArray[np.uint8]:
    """Return a picture strip that shows the scans: one column of pixels for each move, and a black
    mark for each scan.

    The present move is in the middle of the strip, and a mark below the strip points at the middle.
    The picture above the strip shows the known state of each cell after the last scan. The strip is
    a uint8 array of shape (rows, width, 3), with colours of the film's palette.

    Examples
    --------
    >>> scan_strip(np.array([False, True]), move=1, width=5)[1, :, 0].tolist()  # white, start, move 1, move 2 scanned, white
    [255, 27, 143, 27, 255]
    """
    height = max(2, width // 40)
    strip = np.full((height + 2, width, 3), _colour("free"), dtype=np.uint8)
    tape = np.concatenate([[True], scanned])
    moves = np.arange(width) - width // 2 + move
    inside = (moves >= 0) & (moves < len(tape))
    strip[1 : height + 1, inside] = np.where(
        tape[moves[inside], None], _colour("obstacle"), _colour("unknown")
    )
    strip[height + 1 :, width // 2] = _colour("particle")
    return strip


def _colour(name: str) -> tuple[int, ...]:
    return rgb_of(PALETTE[name])
