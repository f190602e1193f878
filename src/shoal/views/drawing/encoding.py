"""Encoding of pictures and films, and the window that shows an episode while it runs."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from fractions import Fraction
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, MissingExtraError

SUFFIXES = (".gif", ".mp4", ".html")
LONGEST = {".gif": 400, ".mp4": 1800}  # frames
OnFrame = Callable[[int, int], None]
"""Function that is called with the number of finished frames and the total number of frames."""
Frame = NDArray[np.uint8]
At = TypeVar("At")
_SAMPLES = 6  # number of frames from which the palette of a GIF is computed
_KEPT = 32  # number of most frequent colours that are kept exactly
# minimum difference of two palette colours, because Pillow rounds colours down to multiples of 4
_APART = 9


def check_film(path: str | os.PathLike[str]) -> Path:
    """Check the suffix of a film's path, and return the path."""
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise InvalidInputError(
            f"{target}: expected a film ({' '.join(SUFFIXES)}), got the suffix {target.suffix!r}"
        )
    return target


def film_size(height: int, width: int, side: int | None) -> tuple[int, int]:
    """Return (width, height) of a film of ``height`` × ``width`` cells, such that its longer side
    has at most ``side`` pixels.

    Width and height are even, as video requires. If ``side`` permits, a cell is a whole number of
    pixels wide. If ``side`` is None, a cell is one pixel.

    Examples
    --------
    >>> film_size(155, 160, 960), film_size(5000, 4000, 960)
    ((960, 930), (768, 960))
    """
    largest = max(height, width)
    side = largest if side is None else side
    factor = side // largest if largest <= side else side / largest
    columns, rows = (max(2, round(length * factor / 2) * 2) for length in (width, height))
    return columns, rows


def counted(frames: Iterator[Frame], total: int, on_frame: OnFrame | None) -> Iterator[Frame]:
    """Yield the frames of a film, and call ``on_frame`` after each frame to report the progress."""
    for done, frame in enumerate(frames, start=1):
        yield frame
        if on_frame is not None:
            on_frame(done, total)


@dataclass(frozen=True, eq=False)
class Clip(Generic[At]):
    """A film before encoding: its frames, frame rate and size.

    Parameters
    ----------
    frames : callable
        Function that yields a picture for each given moment; each picture is uint8 of shape
        (height, width, 3).
    moments : sequence
        The moments that the film shows, one for each frame.
    rate : float
        Number of frames per second.
    side : int or None
        Length of the film's longer side in pixels, to which smaller pictures are enlarged. If
        ``side`` is None, the film has the size of the pictures.
    quality : int
        Constant rate factor (CRF) of H.264; smaller values give a better quality.
    palette : bytes, optional
        Colours of a GIF as red, green and blue bytes. If ``palette`` is None, the encoder computes
        the colours from a few frames.
    """

    frames: Callable[[Sequence[At]], Iterator[Frame]]
    moments: Sequence[At]
    rate: float
    side: int | None
    quality: int
    palette: bytes | None = None


def encode_film(path: Path, clip: Clip[Any], *, gif: bool, on_frame: OnFrame | None) -> None:
    """Write a film as GIF, or as MP4 with H.264."""
    frames, moments = counted(clip.frames(clip.moments), len(clip.moments), on_frame), clip.moments
    if gif:
        palette = clip.palette
        if palette is None:
            sample = [
                moments[k]
                for k in np.unique(np.linspace(0, len(moments) - 1, _SAMPLES).astype(int))
            ]
            palette = palette_of(list(clip.frames(sample)))
        write_gif(path, frames, clip.rate, palette=palette, side=clip.side)
    else:
        write_mp4(path, frames, clip.rate, side=clip.side, quality=clip.quality)


def palette_of(frames: list[Frame]) -> bytes:
    """Return up to 255 colours for a GIF of the given frames, as bytes of red, green and blue.

    The palette contains the exact values of the most frequent colours of the frames. The colour that
    is left stands for pixels that do not change.
    """
    from PIL import Image as Pillow

    packed = np.concatenate([frame.reshape(-1, 3) for frame in frames]).astype(
        np.uint32
    ) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
    colours, counts = np.unique(packed, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    # Soft edges have many colours of few pixels each. To keep them visible, the weight of a colour
    # grows slowly with its area.
    rest = np.repeat(colours[order], 1 + np.log2(counts[order]).astype(np.int64))
    found = (
        Pillow.fromarray(_unpacked(rest)[None])
        .quantize(256, method=Pillow.Quantize.MEDIANCUT)
        .getpalette()
        or []
    )
    chosen = np.zeros((0, 3), np.int64)
    for colour in np.concatenate(
        [_unpacked(colours[order[:_KEPT]]), np.array(found, np.uint8).reshape(-1, 3)]
    ).astype(np.int64):
        if len(chosen) < 255 and (
            not len(chosen) or np.abs(chosen - colour).max(axis=1).min() >= _APART
        ):
            chosen = np.vstack([chosen, colour])
    return chosen.astype(np.uint8).tobytes()


def _unpacked(colours: NDArray[np.uint32]) -> NDArray[np.uint8]:
    return np.stack([colours >> 16, colours >> 8 & 255, colours & 255], axis=-1).astype(np.uint8)


def write_gif(
    path: Path, frames: Iterator[Frame], rate: float, *, palette: bytes, side: int | None
) -> None:
    """Write uint8 frames of shape (H, W, 3) as a GIF.

    The function enlarges small frames to about ``side`` pixels, without interpolation.
    """
    from PIL import Image as Pillow

    colours = Pillow.new("P", (1, 1))
    colours.putpalette(palette)

    def shown(frame: Frame) -> Pillow.Image:
        image = Pillow.fromarray(frame).quantize(palette=colours, dither=Pillow.Dither.NONE)
        return image.resize(film_size(image.height, image.width, side), Pillow.Resampling.NEAREST)

    images = (shown(frame) for frame in frames)
    first = next(images)
    duration = max(20, round(1000 / rate / 10) * 10)  # the format counts hundredths of a second
    with path.open("wb") as file:  # Pillow would leave the file open after an interruption
        first.save(
            file,
            format="GIF",
            save_all=True,
            append_images=images,
            duration=duration,
            loop=0,
            optimize=True,  # pixels that do not change are transparent, which saves most of the size
            disposal=1,
        )


def write_mp4(
    path: Path, frames: Iterator[Frame], rate: float, *, side: int | None, quality: int
) -> None:
    """Write frames as H.264 with a separate ffmpeg process, with the constant rate factor
    ``quality``.

    The function raises an error if the exit code of ffmpeg shows a failure.
    """
    first = next(frames)
    width, height = film_size(first.shape[0], first.shape[1], side)
    flags = "neighbor" if width >= first.shape[1] else "area"
    # fmt: off
    command = [
        _encoder(), "-y", "-v", "error",
        "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{first.shape[1]}x{first.shape[0]}",
        "-r", str(Fraction(rate).limit_denominator()), "-i", "-",
        "-an", "-vcodec", "libx264", "-pix_fmt", "yuv420p", "-vf", f"scale={width}:{height}:flags={flags}",
        "-crf", str(quality), "-preset", "superfast", "-movflags", "+faststart", "-threads", "2", f"file:{path}",
    ]
    # fmt: on
    with (
        tempfile.TemporaryFile() as said,
        subprocess.Popen(command, stdin=subprocess.PIPE, stderr=said) as encoder,
    ):
        assert encoder.stdin is not None
        try:
            # the encoder has ended: its exit code gives the reason
            with (
                suppress(BrokenPipeError),
                encoder.stdin,
            ):
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
        raise OSError(f"the film encoder stopped: {why}")  # atomic() adds the name of the file


def _encoder() -> str:
    """Return the path of the program ffmpeg."""
    import shutil

    from imageio_ffmpeg import get_ffmpeg_exe

    try:
        program: str = get_ffmpeg_exe()
    except RuntimeError as error:
        raise MissingExtraError(f"films as .mp4 need ffmpeg: {error}") from None
    if shutil.which(program) is None:
        raise MissingExtraError(
            f"films as .mp4 need ffmpeg: expected a program, got {program!r} (IMAGEIO_FFMPEG_EXE)"
        )
    return program


class LiveWindow:
    """A window that shows one picture. On a machine without a display, the class shows nothing and
    raises no error.
    """

    def __init__(self, title: str) -> None:
        import matplotlib.pyplot as plt  # slow to import, and pictures need it not

        self._plt, self._figure = plt, plt.figure()
        if self._figure.canvas.manager is not None:
            self._figure.canvas.manager.set_window_title(title)
        self._axes = self._figure.add_axes((0, 0, 1, 1))

    def show(self, picture: NDArray[np.uint8], *, pause: float) -> None:
        """Show a uint8 picture of shape (height, width, 3) in the window, and wait for ``pause``
        seconds.
        """
        self._axes.clear()
        self._axes.set_axis_off()
        self._axes.imshow(picture)
        if self._figure.canvas.required_interactive_framework is not None:  # a display exists
            self._plt.pause(pause)

    def close(self) -> None:
        """Close the window."""
        self._plt.close(self._figure)


class NotebookFigure(Figure):
    """A matplotlib figure that displays itself in a notebook."""

    def _repr_png_(self) -> bytes:
        return encode_figure(self)


def encode_figure(figure: Figure) -> bytes:
    """Return a figure as PNG bytes, with a size that suits notebooks."""
    picture = BytesIO()
    figure.savefig(picture, format="png", dpi=110)
    return picture.getvalue()
