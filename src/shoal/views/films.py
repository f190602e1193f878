"""Films of episodes: GIF, MP4, or the HTML player."""

from __future__ import annotations

import os
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from shoal.files import atomic
from shoal.swarm import Episode
from shoal.swarm.display import PALETTE, belief_raster, in_strips
from shoal.views.encoding import LONGEST, SIDE, OnFrame, check_film, counted, palette_of, write_gif, write_mp4
from shoal.views.volume import Slices, codes_of, sheet

_SECONDS = 20.0
TURNS = 2  # of a volume in a film
VOLUME_SIDE = 560  # pixels of the view that turns
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
            from shoal.views.player.page import player_page

            temporary.write_text(player_page(episode), encoding="utf-8")
            return
        longest = LONGEST[suffix] if episode.workspace.ndim == 2 else VOLUME_FRAMES
        shown = shown_moves(episode.moves, longest)  # of longer episodes every k-th
        frames = counted(film_frames(episode, shown), len(shown), on_frame)
        rate = float(np.clip(len(shown) / _SECONDS, 4, 30 if suffix == ".gif" else 60))
        if suffix == ".gif":
            write_gif(temporary, frames, rate, palette=_palette(episode), side=SIDE[suffix])
        else:
            write_mp4(temporary, frames, rate, side=SIDE[suffix])


def _palette(episode: Episode) -> bytes:
    """Return the colours of a GIF; those of a 3-D workspace come in shades."""
    if episode.workspace.ndim == 2:
        return bytes.fromhex("".join(colour[1:] for colour in PALETTE.values()))
    middle = film_frames(episode, np.unique([0, episode.moves // 2, episode.moves]))
    return palette_of(list(middle))


def shown_moves(moves: int, at_most: int) -> NDArray[np.int64]:
    """Return which positions (0 is the start) a film of at most so many frames shows: first and last always.

    Examples
    --------
    >>> shown_moves(10, 4).tolist()
    [0, 3, 7, 10]
    """
    return np.unique(np.linspace(0, moves, min(moves + 1, max(2, at_most))).round().astype(np.int64))


def film_frames(episode: Episode, shown: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
    """Yield the picture after each move in ``shown``, one pixel a cell (3-D: a view that turns, and slices); uint8, (H, W, 3)."""
    wanted = set(shown.tolist())
    slices = Slices.of(episode.workspace) if episode.workspace.ndim == 3 else None
    for move, (state, belief) in enumerate(episode.frames()):
        if move in wanted:
            if slices is not None:
                turn = 2 * np.pi * TURNS * move / max(1, episode.moves)
                codes = codes_of(state, belief)
                picture = sheet(codes, slices, azimuth=turn, side=VOLUME_SIDE, spacing=episode.workspace.spacing)
            else:
                picture = in_strips(belief_raster(state, belief))
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
