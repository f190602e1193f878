"""Films of episodes: GIF, MP4, or the HTML player."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from fractions import Fraction
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shoal.errors import InvalidInputError, MissingExtraError
from shoal.files import atomic
from shoal.swarm import Episode
from shoal.swarm.display import PALETTE, belief_raster, in_strips

if TYPE_CHECKING:
    from PIL.Image import Image

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
        frames = _counted(film_frames(episode, shown), len(shown), on_frame)
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


def film_frames(episode: Episode, shown: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
    """Yield the picture after each move in ``shown``, one pixel a cell; uint8, shape (H, W, 3)."""
    wanted = set(shown.tolist())
    for move, (state, belief) in enumerate(episode.frames()):
        if move in wanted:
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


def film_size(height: int, width: int, side: int) -> tuple[int, int]:
    """Return (width, height) of a film of pictures of that size: whole pixels a cell if it can be, even sides as video needs.

    Examples
    --------
    >>> film_size(155, 160, 960), film_size(5000, 4000, 960)
    ((960, 930), (768, 960))
    """
    largest = max(height, width)
    factor = side // largest if largest <= side else side / largest
    return tuple(max(2, round(length * factor / 2) * 2) for length in (width, height))  # type: ignore[return-value]


def _counted(frames: Iterator[NDArray[np.uint8]], total: int, on_frame: OnFrame | None) -> Iterator[NDArray[np.uint8]]:
    for done, frame in enumerate(frames, start=1):
        yield frame
        if on_frame is not None:
            on_frame(done, total)


def _write_gif(path: Path, frames: Iterator[NDArray[np.uint8]], rate: float) -> None:
    from PIL import Image as Pillow

    palette = Pillow.new("P", (1, 1))
    palette.putpalette(bytes.fromhex("".join(colour[1:] for colour in PALETTE.values())))
    images = (_shown(Pillow.fromarray(frame).quantize(palette=palette, dither=Pillow.Dither.NONE)) for frame in frames)
    first = next(images)
    duration = max(20, round(1000 / rate / 10) * 10)  # the format counts hundredths of a second
    with path.open("wb") as file:  # Pillow would leave it open when it is interrupted
        first.save(file, format="GIF", save_all=True, append_images=images, duration=duration, loop=0, optimize=False, disposal=1)


def _shown(image: Image) -> Image:
    """Return a small picture enlarged for a GIF; colours stay as they are, as no pixel is mixed from two."""
    from PIL import Image as Pillow

    return image.resize(film_size(image.height, image.width, _SIDE[".gif"]), Pillow.Resampling.NEAREST)


def _write_mp4(path: Path, frames: Iterator[NDArray[np.uint8]], rate: float) -> None:
    """Encode with our own ffmpeg process: what it says and how it ended tell whether the film is whole."""
    first = next(frames)
    width, height = film_size(first.shape[0], first.shape[1], _SIDE[".mp4"])
    flags = "neighbor" if width >= first.shape[1] else "area"
    # fmt: off
    command = [
        _encoder(), "-y", "-v", "error",
        "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{first.shape[1]}x{first.shape[0]}",
        "-r", str(Fraction(rate).limit_denominator()), "-i", "-",
        "-an", "-vcodec", "libx264", "-pix_fmt", "yuv420p", "-vf", f"scale={width}:{height}:flags={flags}",
        "-crf", "26", "-preset", "superfast", "-movflags", "+faststart", "-threads", "2", f"file:{path}",
    ]
    # fmt: on
    with tempfile.TemporaryFile() as said, subprocess.Popen(command, stdin=subprocess.PIPE, stderr=said) as encoder:
        assert encoder.stdin is not None
        try:
            with suppress(BrokenPipeError), encoder.stdin:  # the encoder has gone: its exit code says so
                for frame in chain([first], frames):
                    encoder.stdin.write(frame.tobytes())
        except BaseException:
            encoder.kill()
            raise
        failed = encoder.wait() != 0
        said.seek(0)
        words = said.read().decode(errors="replace").splitlines()
    if failed:
        why = words[0].rpartition(": ")[2] if words else f"exit code {encoder.returncode}"
        raise OSError(f"the film encoder stopped: {why}")  # atomic() adds which file


def _encoder() -> str:
    """Return the path of ffmpeg."""
    import shutil

    from imageio_ffmpeg import get_ffmpeg_exe

    try:
        program: str = get_ffmpeg_exe()
    except RuntimeError as error:
        raise MissingExtraError(f"films as .mp4 need ffmpeg: {error}") from None
    if shutil.which(program) is None:
        raise MissingExtraError(f"films as .mp4 need ffmpeg: expected a program, got {program!r} (IMAGEIO_FFMPEG_EXE)")
    return program
