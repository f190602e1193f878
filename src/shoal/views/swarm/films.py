"""Films of episodes: GIF, MP4, or the HTML player."""

from __future__ import annotations

import os
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from shoal.files import atomic
from shoal.swarm import Episode
from shoal.swarm.maps.raster import PALETTE, in_strips
from shoal.views.drawing.encoding import LONGEST, SIDE, OnFrame, check_film, counted, palette_of, write_gif, write_mp4
from shoal.views.swarm.cell_colours import codes_by_move, ink_of
from shoal.views.swarm.volume import Fit, Slices, sheet, sheet_width

_SECONDS = 20.0
TURNS = 2  # of a volume in a film
VOLUME_SIDE = {".gif": 440, ".mp4": 670}  # pixels of the view that turns
VOLUME_FRAMES = 400  # of a film of one


def write_film(episode: Episode, path: str | os.PathLike[str], *, on_frame: OnFrame | None = None) -> None:
    """Write a film of an episode; the suffix says which kind.

    Parameters
    ----------
    episode : Episode
    path : path
        ``.gif``, ``.mp4`` (H.264) or ``.html`` (the player).
    on_frame : callable, optional
        Told the progress.

    Raises
    ------
    InvalidInputError
        For another suffix.
    OutputError
        If it cannot be written; nothing is left behind.
    """
    target = check_film(path)
    suffix = target.suffix.lower()
    with atomic(target) as temporary:
        if suffix == ".html":
            from shoal.views.swarm.page import player_page

            temporary.write_text(player_page(episode), encoding="utf-8")
            return
        longest = LONGEST[suffix] if episode.workspace.ndim == 2 else VOLUME_FRAMES
        shown = shown_moves(episode.moves, longest)  # of longer episodes every k-th
        side = SIDE[suffix] if episode.workspace.ndim == 2 else VOLUME_SIDE[suffix]
        frames = counted(film_frames(episode, shown, side=side), len(shown), on_frame)
        rate = float(np.clip(len(shown) / _SECONDS, 4, 30 if suffix == ".gif" else 60))
        if suffix == ".gif":
            write_gif(temporary, frames, rate, palette=_palette(episode), side=_film_side(episode, side))
        else:
            write_mp4(temporary, frames, rate, side=_film_side(episode, side))


def _film_side(episode: Episode, side: int) -> int:
    """Return the longer side of a film: that of a 3-D workspace is drawn as large as it is shown."""
    workspace = episode.workspace
    return side if workspace.ndim == 2 else sheet_width(tuple(n + 2 for n in workspace.shape), side, workspace.spacing)


def _palette(episode: Episode) -> bytes:
    """Return the colours of a GIF; those of a 3-D workspace come in shades."""
    if episode.workspace.ndim == 2:
        return ink_of(episode).colours.tobytes()
    middle = film_frames(episode, np.unique([0, episode.moves // 2, episode.moves]), side=VOLUME_SIDE[".gif"])
    return palette_of(list(middle))


def shown_moves(moves: int, at_most: int) -> NDArray[np.int64]:
    """Return which positions (0 is the start) a film of at most so many frames shows: first and last always.

    Examples
    --------
    >>> shown_moves(10, 4).tolist()
    [0, 3, 7, 10]
    """
    return np.unique(np.linspace(0, moves, min(moves + 1, max(2, at_most))).round().astype(np.int64))


def film_frames(episode: Episode, shown: NDArray[np.int64], *, side: int = VOLUME_SIDE[".gif"]) -> Iterator[NDArray[np.uint8]]:
    """Yield the picture after each move in ``shown``; uint8, shape (H, W, 3).

    In 2-D it has one pixel a cell; in 3-D it is a view that turns, with ``side`` pixels, and slices.
    """
    wanted = set(shown.tolist())
    workspace = episode.workspace
    volume = (Slices.of(workspace), Fit.of(workspace)) if workspace.ndim == 3 else None
    ink = ink_of(episode)
    for move, codes in enumerate(codes_by_move(episode)):
        if move in wanted:
            if volume is not None:
                turn = 2 * np.pi * TURNS * move / max(1, episode.moves)
                picture = sheet(codes, volume[0], azimuth=turn, side=side, spacing=workspace.spacing, ink=ink, fit=volume[1])
            else:
                picture = in_strips(ink.colours[codes])
            yield picture if episode.scanned.all() else np.vstack([picture, scan_strip(episode.scanned, move, picture.shape[1])])


def scan_strip(scanned: NDArray[np.bool_], move: int, width: int) -> NDArray[np.uint8]:
    """Return a strip for the foot of a picture: a tape with one column a move and a black mark for each scan.

    The present move is in the middle, with a mark below. The picture above shows what the last scan up to there has told. uint8,
    shape (rows, width, 3), in colours of the palette.

    Examples
    --------
    >>> scan_strip(np.array([False, True]), move=1, width=5)[1, :, 0].tolist()  # white, start, move 1, move 2 scanned, white
    [255, 27, 143, 27, 255]
    """
    height = max(2, width // 40)
    strip = np.full((height + 2, width, 3), _colour("free"), dtype=np.uint8)
    tape = np.concatenate([[True], scanned])
    shown = np.arange(width) - width // 2 + move
    inside = (shown >= 0) & (shown < len(tape))
    strip[1 : height + 1, inside] = np.where(tape[shown[inside], None], _colour("obstacle"), _colour("unknown"))
    strip[height + 1 :, width // 2] = _colour("particle")
    return strip


def _colour(name: str) -> tuple[int, ...]:
    return tuple(bytes.fromhex(PALETTE[name][1:]))
