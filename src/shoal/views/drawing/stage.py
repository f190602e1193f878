"""Films for presentations: their sizes, and the card at their end."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from textwrap import wrap
from typing import Any

import numpy as np

from shoal.core.checks import check_choice
from shoal.core.dataclass import dataclass
from shoal.core.episode import Episode
from shoal.core.errors import InvalidInputError
from shoal.views.drawing.canvas import Canvas
from shoal.views.drawing.charts import BLUE, INK, MUTED
from shoal.views.drawing.encoding import Clip, Frame

SIZES = {"wide": (1920, 1080), "square": (1080, 1080)}
"""Width and height in pixels of films for presentations, by name."""

RATES = (30, 60)
"""Frames per second of films for presentations."""

_GIF_RATE = 10  # frames per second
_CARD = 2.5  # seconds for which the end card is shown


@dataclass(frozen=True)
class Stage:
    """What a film for presentations looks like.

    Parameters
    ----------
    size : str
        One of `SIZES`.
    rate : int
        Frames per second.
    """

    size: str
    rate: int

    @property
    def width(self) -> int:
        """Width of the film in pixels."""
        return SIZES[self.size][0]

    @property
    def height(self) -> int:
        """Height of the film in pixels."""
        return SIZES[self.size][1]

    def frames_of(self, seconds: float, longest: int = 3600) -> int:
        """Return the number of frames of a time in seconds, from 2 to ``longest``."""
        return max(2, min(round(seconds * self.rate), longest))

    def with_card(self, clip: Clip[Any], episode: Episode, title: str) -> Clip[Any]:
        """Return a clip that ends with a card, which says in one sentence what happened."""
        card = end_card(self, episode, title)
        return append_still(clip, card, round(_CARD * self.rate))


def stage_of(suffix: str, size: str | None, rate: int | None) -> Stage | None:
    """Return what a film looks like if it is for presentations, or None.

    Raises
    ------
    InvalidInputError
        If ``size`` is unknown, or if ``size`` or ``rate`` has no effect.
    """
    if size is None:
        if rate is not None:
            raise InvalidInputError(f"rate: expected a size beside it, got {rate} alone")
        return None
    check_choice(size, what="size", choices=SIZES)
    if suffix == ".html":
        raise InvalidInputError(f"size: expected none for the player (.html), got {size}")
    if suffix == ".gif":
        if rate is not None:
            raise InvalidInputError(f"rate: expected none for a .gif film, got {rate}")
        return Stage(size, _GIF_RATE)
    if rate not in (None, *RATES):
        raise InvalidInputError(f"rate: expected 30 or 60 frames per second, got {rate}")
    return Stage(size, rate or RATES[0])


def append_still(clip: Clip[Any], picture: Frame, count: int) -> Clip[Any]:
    """Return a clip that shows a picture in ``count`` further frames at its end."""
    draw_frames: Callable[[Sequence[Any]], Iterator[Frame]] = clip.frames

    def frames(moments: Sequence[Any]) -> Iterator[Frame]:
        yield from draw_frames([moment for moment in moments if moment is not None])
        for moment in moments:
            if moment is None:
                yield picture

    return Clip(frames, [*clip.moments, *[None] * count], clip.rate, clip.quality, clip.palette)


def end_card(stage: Stage, episode: Episode, title: str) -> Frame:
    """Return the last picture of a film: its title, the sentence of the episode, and how to repeat
    it; uint8, shape (height, width, 3).
    """
    canvas = Canvas(stage.width, stage.height)
    left, unit = 0.09 * stage.width, stage.height / 1080
    lines = wrap(episode.sentence[:1].upper() + episode.sentence[1:] + ".", stage.width // 27)
    level = stage.height / 2 - (58 * len(lines) + 120) / 2 * unit
    canvas.line([(left, level - 40 * unit), (left + 90 * unit, level - 40 * unit)], BLUE, 8 * unit)
    canvas.text((left, level + 30 * unit), title, MUTED, 30 * unit)
    for k, line in enumerate(lines):
        canvas.text((left, level + (104 + 58 * k) * unit), line, INK, 40 * unit, bold=True)
    seed = "" if episode.seed is None else f"seed {episode.seed} · "
    words = f"{seed}Shoal {episode.versions['shoal']}"
    canvas.text((left, level + (124 + 58 * len(lines)) * unit), words, MUTED, 26 * unit)
    return np.asarray(canvas.frame())
