"""Films of episodes: GIF, MP4, or the HTML player."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shoal.errors import InvalidInputError, OutputError
from shoal.files import atomic
from shoal.swarm import Episode
from shoal.swarm.display import belief_raster, in_strips

SUFFIXES = (".gif", ".mp4", ".html")
_LONGEST = {".gif": 400, ".mp4": 1800}  # frames; longer episodes show every k-th move
_SIDE = {".gif": 480, ".mp4": 960}
_SECONDS = 20.0
OnFrame = Callable[[int, int], None]
"""Called with (frames done, frames in all)."""


def check_film(path: str | os.PathLike[str]) -> Path:
    """Return the path of a film if its suffix is one that can be written.

    Raises
    ------
    InvalidInputError
    """
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise InvalidInputError(f"{target}: expected a film ({' '.join(SUFFIXES)}), got the suffix {target.suffix!r}")
    return target


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
        shown = shown_moves(episode.moves, _LONGEST[suffix])
        frames = _counted(film_frames(episode, shown, side=_SIDE[suffix]), len(shown), on_frame)
        rate = float(np.clip(len(shown) / _SECONDS, 4, 30 if suffix == ".gif" else 60))
        (_write_gif if suffix == ".gif" else _write_mp4)(temporary, frames, rate)


def shown_moves(moves: int, at_most: int) -> NDArray[np.int64]:
    """Return which positions (0 is the start) a film of at most so many frames shows: first and last always.

    Examples
    --------
    >>> shown_moves(10, 4).tolist()
    [0, 3, 7, 10]
    """
    return np.unique(np.linspace(0, moves, min(moves + 1, max(2, at_most))).round().astype(np.int64))


def film_frames(episode: Episode, shown: NDArray[np.int64], *, side: int) -> Iterator[NDArray[np.uint8]]:
    """Yield the picture after each move in ``shown``; uint8, shape (H, W, 3), both sides even."""
    wanted = set(shown.tolist())
    for move, (state, belief) in enumerate(episode.frames()):
        if move in wanted:
            yield _fitted(in_strips(belief_raster(state, belief)), side)


def _fitted(sheet: NDArray[np.uint8], side: int) -> NDArray[np.uint8]:
    """Enlarge by a whole factor, or shrink, to at most ``side``; pad to even sides as video needs."""
    largest = max(sheet.shape[:2])
    if largest > side:
        from PIL import Image

        size = (max(1, sheet.shape[1] * side // largest), max(1, sheet.shape[0] * side // largest))
        sheet = np.asarray(Image.fromarray(sheet).resize(size, Image.Resampling.BOX))
    else:
        sheet = np.repeat(np.repeat(sheet, side // largest, axis=0), side // largest, axis=1)
    odd = [(0, length % 2) for length in sheet.shape[:2]]
    return np.ascontiguousarray(np.pad(sheet, (*odd, (0, 0)), mode="edge"))


def _counted(frames: Iterator[NDArray[np.uint8]], total: int, on_frame: OnFrame | None) -> Iterator[NDArray[np.uint8]]:
    for done, frame in enumerate(frames, start=1):
        yield frame
        if on_frame is not None:
            on_frame(done, total)


def _write_gif(path: Path, frames: Iterator[NDArray[np.uint8]], rate: float) -> None:
    from PIL import Image

    images = (Image.fromarray(frame).quantize(16, dither=Image.Dither.NONE) for frame in frames)
    first = next(images)
    duration = max(20, round(1000 / rate / 10) * 10)  # the format counts hundredths of a second
    first.save(path, save_all=True, append_images=images, duration=duration, loop=0, optimize=False)


def _write_mp4(path: Path, frames: Iterator[NDArray[np.uint8]], rate: float) -> None:
    import imageio_ffmpeg

    first = next(frames)
    writer = imageio_ffmpeg.write_frames(
        str(path),
        (first.shape[1], first.shape[0]),
        fps=rate,
        codec="libx264",
        pix_fmt_out="yuv420p",
        macro_block_size=2,
        output_params=["-crf", "18", "-preset", "veryfast", "-movflags", "+faststart", "-threads", "2"],
        ffmpeg_log_level="error",
    )
    try:
        writer.send(None)
        writer.send(first)
        for frame in frames:
            writer.send(frame)
    except OSError as error:  # the encoder has gone: a full disk, most often
        raise OutputError(f"the film encoder stopped: {' '.join(str(error).split())[-200:]}") from None
    finally:
        writer.close()
    if path.stat().st_size == 0:
        raise OutputError("the film encoder wrote nothing: is the disk full?")
