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

from shoal.core.checks import as_path
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, MissingExtraError
from shoal.views.kernels.planes import WORD, convert_changes

SUFFIXES = (".gif", ".mp4", ".html")
LONGEST = {".gif": 400, ".mp4": 1800}  # frames
OnFrame = Callable[[int, int], None]
"""Function that is called with the number of finished frames and the total number of frames."""
Frame = NDArray[np.uint8]
At = TypeVar("At")
_SAMPLES = 6  # number of frames from which the palette of a GIF is computed
_KEPT = 32  # number of most frequent colours that are kept exactly
# of the frames' bytes: those of the standard for television
_COLOURS = [
    *("-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709"),
    *("-color_range", "tv"),
]
# Few changes a frame need no frames between others, nor motion between pixels: a fifth less time
# than the preset alone, at as much likeness. Looking ahead makes files a quarter smaller.
_FAST = [
    *("-preset", "superfast", "-bf", "0"),
    *("-x264-params", "subme=0:rc-lookahead=10:mbtree=1"),
]
# minimum difference of two palette colours, because Pillow rounds colours down to multiples of 4
_APART = 9


def check_film(path: str | os.PathLike[str]) -> Path:
    """Check the suffix of a film's path, and return the path."""
    target = as_path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise InvalidInputError(
            f"{target}: expected a film ({' '.join(SUFFIXES)}), got the suffix {target.suffix!r}"
        )
    return target


def report_frames(frames: Iterator[Frame], total: int, on_frame: OnFrame | None) -> Iterator[Frame]:
    """Yield the frames of a film, and call ``on_frame`` after each frame to report the progress."""
    for number, frame in enumerate(frames, start=1):
        yield frame
        if on_frame is not None:
            on_frame(number, total)


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
    quality : int
        Constant rate factor (CRF) of H.264; smaller values give a better quality.
    palette : bytes, optional
        Colours of a GIF as red, green and blue bytes. If ``palette`` is None, the encoder computes
        the colours from a few frames.
    """

    frames: Callable[[Sequence[At]], Iterator[Frame]]
    moments: Sequence[At]
    rate: float
    quality: int
    palette: bytes | None = None


def encode_film(path: Path, clip: Clip[Any], *, gif: bool, on_frame: OnFrame | None) -> None:
    """Write a film as GIF, or as MP4 with H.264."""
    frames, moments = (
        report_frames(clip.frames(clip.moments), len(clip.moments), on_frame),
        clip.moments,
    )
    if gif:
        palette = clip.palette
        if palette is None:
            sample = [
                moments[k]
                for k in np.unique(np.linspace(0, len(moments) - 1, _SAMPLES).astype(int))
            ]
            palette = palette_of(list(clip.frames(sample)))
        write_gif(path, frames, clip.rate, palette=palette)
    else:
        write_mp4(path, frames, clip.rate, quality=clip.quality)


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
    sample = np.repeat(colours[order], 1 + np.log2(counts[order]).astype(np.int64))
    entries = (
        Pillow.fromarray(_unpack(sample)[None])
        .quantize(256, method=Pillow.Quantize.MEDIANCUT)
        .getpalette()
        or []
    )
    palette = np.zeros((0, 3), np.int64)
    for colour in np.concatenate(
        [_unpack(colours[order[:_KEPT]]), np.array(entries, np.uint8).reshape(-1, 3)]
    ).astype(np.int64):
        if len(palette) < 255 and (
            not len(palette) or np.abs(palette - colour).max(axis=1).min() >= _APART
        ):
            palette = np.vstack([palette, colour])
    return palette.astype(np.uint8).tobytes()


def _unpack(colours: NDArray[np.uint32]) -> NDArray[np.uint8]:
    return np.stack([colours >> 16, colours >> 8 & 255, colours & 255], axis=-1).astype(np.uint8)


def write_gif(path: Path, frames: Iterator[Frame], rate: float, *, palette: bytes) -> None:
    """Write uint8 frames of shape (H, W, 3) as a GIF."""
    from PIL import Image as Pillow

    colours = Pillow.new("P", (1, 1))
    colours.putpalette(palette)

    images = (
        Pillow.fromarray(frame).quantize(palette=colours, dither=Pillow.Dither.NONE)
        for frame in frames
    )
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


class VideoPlanes:
    """The picture of a video, converted from RGB where it changes.

    The planes are those of the standard BT.709 for television: a brightness from 16 to 235, and two
    differences of colour from 16 to 240.

    Parameters
    ----------
    height, width : int
        Size of the pictures in pixels; both even.
    """

    def __init__(self, height: int, width: int) -> None:
        self._shape = height, width, 3
        self._last = np.zeros(-(-3 * height * width // WORD) * WORD, np.uint8)
        pixels = height * width
        self.data: NDArray[np.uint8] = np.empty(pixels + pixels // 2, np.uint8)
        """The planes one after another, as an encoder reads them; uint8."""
        luma, blue, red = np.split(self.data, [pixels, pixels + pixels // 4])
        # what a black picture is, which is what the last one is at first
        luma[...], blue[...], red[...] = 16, 128, 128
        half = height // 2, width // 2
        self._planes = luma.reshape(height, width), blue.reshape(half), red.reshape(half)

    def show(self, picture: NDArray[np.uint8]) -> None:
        """Convert a picture; uint8, shape (height, width, 3)."""
        picture = np.ascontiguousarray(picture)
        if picture.shape != self._shape:
            raise ValueError(f"expected a picture of shape {self._shape}, got {picture.shape}")
        count = picture.size // WORD
        words, last = (
            flat[: WORD * count].view(np.uint64) for flat in (picture.reshape(-1), self._last)
        )
        convert_changes(picture, words, last, *self._planes)


def write_mp4(path: Path, frames: Iterator[Frame], rate: float, *, quality: int) -> None:
    """Write frames as H.264 with a separate ffmpeg process, with the constant rate factor
    ``quality``. A frame with an odd number of rows or columns gets one more, which video requires.

    The function raises an error if the exit code of ffmpeg shows a failure.
    """
    first = next(frames)
    rim = [(0, side % 2) for side in first.shape[:2]]
    height, width = (side + side % 2 for side in first.shape[:2])
    odd, planes = (height, width) != first.shape[:2], VideoPlanes(height, width)
    # fmt: off
    command = [
        _encoder(), "-y", "-v", "error",
        "-f", "rawvideo", "-pix_fmt", "yuv420p", "-s", f"{width}x{height}", *_COLOURS,
        "-r", str(Fraction(rate).limit_denominator()), "-i", "-",
        "-an", "-vcodec", "libx264", *_COLOURS,
        "-crf", str(quality), *_FAST, "-movflags", "+faststart", "-threads", "2", f"file:{path}",
    ]
    # fmt: on
    with (
        tempfile.TemporaryFile() as log,
        subprocess.Popen(command, stdin=subprocess.PIPE, stderr=log) as encoder,
    ):
        assert encoder.stdin is not None
        try:
            # the encoder has ended: its exit code gives the reason
            with (
                suppress(BrokenPipeError),
                encoder.stdin,
            ):
                for frame in chain([first], frames):
                    planes.show(np.pad(frame, (*rim, (0, 0)), mode="edge") if odd else frame)
                    encoder.stdin.write(planes.data.data)
        except BaseException:
            encoder.kill()
            raise
        failed = encoder.wait() != 0
        log.seek(0)
        words = log.read().decode(errors="replace").splitlines()
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
