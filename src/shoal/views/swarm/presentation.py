"""Films of swarms for presentations: moves are interpolated, and a photograph lies under its map."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

import numpy as np
from matplotlib import get_data_path
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from shoal.core.checks import count_text
from shoal.core.errors import InvalidInputError
from shoal.swarm import SwarmEpisode
from shoal.swarm.maps.workspace import FREE, PALETTE
from shoal.views.drawing.canvas import Canvas
from shoal.views.drawing.charts import BLUE, INK, MUTED, bar_length
from shoal.views.drawing.encoding import Clip
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

_SECONDS = 4.0, 20.0  # the shortest and the longest film
_A_SECOND = 6.0  # moves, of short episodes
_REST = 1.2  # seconds for which the final map is shown
_HEAD, _FOOT, _SIDE = 110, 176, 60  # pixels around the map
_WHOLE = 8.0  # pixels a cell from which cells are a whole number of pixels wide
_SMALLEST = 9.0  # pixels: diameter of a particle
_SCALE_BAR = 600  # pixels at the right of the line that says the move
_LINE = "#dfe3e8"
_ARROWS = {"l": "\u2190", "r": "\u2192", "u": "\u2191", "d": "\u2193"}


def presentation_clip(episode: SwarmEpisode, stage: Stage) -> Clip[float]:
    """Return the film of a swarm on a plane map for presentations.

    Raises
    ------
    InvalidInputError
        If the map is a volume.
    """
    if episode.workspace.ndim == 3:
        raise InvalidInputError("size: expected none for the film of a volume, got " + stage.size)
    seconds = float(np.clip(episode.moves / _A_SECOND, *_SECONDS))
    moments = np.linspace(0, episode.moves, stage.frames_of(seconds)).tolist()
    moments += [float(episode.moves)] * round(_REST * stage.rate)
    film = PresentedSwarm(episode, stage)
    clip = Clip(film.frames, moments, stage.rate, quality=23)
    return stage.with_card(clip, episode, film.title)


class PresentedSwarm:
    """The frames for a film of a swarm on a plane map.

    Parameters
    ----------
    episode : SwarmEpisode
    stage : Stage
    """

    def __init__(self, episode: SwarmEpisode, stage: Stage) -> None:
        self._episode = episode
        self.width, self.height = stage.width, stage.height
        rows, columns = (side + 2 for side in episode.workspace.shape)  # with the rim
        available = self.width - 2 * _SIDE, self.height - _HEAD - _FOOT
        scale = min(available[0] / columns, available[1] / rows)
        self._scale = scale if scale < _WHOLE else float(int(scale))
        self._size = round(columns * self._scale), round(rows * self._scale)
        self._corner = (
            (self.width - self._size[0]) // 2,
            _HEAD + (available[1] - self._size[1]) // 2,
        )
        self.title = (
            f"{episode.task.capitalize()} of {Path(episode.workspace.name).name} with"
            f" {count_text(episode.particles, 'particle')}"
        )
        self._palette = palette_of_cells(episode)
        self._photograph = PhotographBelow.of(episode, self._size, self._scale)
        self._stamp = _stamp_of(max(self._scale, _SMALLEST))
        self._draw_background()

    def frames(self, moments: Sequence[float]) -> Iterator[NDArray[np.uint8]]:
        """Yield the picture of the swarm after each number of moves, which may be fractions; uint8,
        shape (height, width, 3). All pictures are the same array, drawn anew where it changes.
        """
        steps = self._steps()
        move, (codes, before) = 0, next(steps)
        after = next(steps, None)
        ground = self._ground(codes)
        frame = self._plain.copy()
        (left, top), (width, height) = self._corner, self._size
        inside = frame[top : top + height, left : left + width]
        for moment in moments:
            previous = move
            while after is not None and move < min(int(moment), self._episode.moves):
                move, (codes, before) = move + 1, after
                after = next(steps, None)
            if move != previous:
                ground = self._ground(codes)
            inside[...] = ground
            self._draw_particles(inside, self._between(before, after, move, moment - move))
            self._draw_foot(frame, moment)
            yield frame

    def _steps(self) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.int64]]]:
        """Yield the colours of all cells without particles, and the cells of particles, at the
        start and after each move.
        """
        for codes, (state, _) in zip(
            codes_by_move(self._episode), self._episode.frames(), strict=True
        ):
            codes[codes == self._palette.particle] = self._free
            yield codes, state.cells

    @property
    def _free(self) -> int:
        from shoal.swarm import noise

        return noise.FREE if self._episode.noisy else FREE

    def _between(
        self,
        before: NDArray[np.int64],
        after: tuple[NDArray[np.uint8], NDArray[np.int64]] | None,
        move: int,
        share: float,
    ) -> NDArray[np.float64]:
        """Return where particles are between two moves, in cells; float64, shape (n, 2).

        Particles move along a line, and none overtakes another: in each line, the first before the
        move is the first after it.
        """
        if after is None or share <= 0:
            return before.astype(np.float64)
        command = self._episode.commands[move]
        along = {"l": 1, "r": 1, "u": 0, "d": 0}[command]
        first, then = (
            cells[np.lexsort((cells[:, along], cells[:, 1 - along]))]
            for cells in (before, after[1])
        )
        if first.shape != then.shape or (first[:, 1 - along] != then[:, 1 - along]).any():
            return before.astype(np.float64)  # estimated, with noise
        smooth = share * share * (3.0 - 2.0 * share)
        return np.asarray(first + smooth * (then - first))

    def _ground(self, codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
        colours = self._palette.rgb[codes]
        method = Image.Resampling.NEAREST if self._scale >= 1 else Image.Resampling.BOX
        if self._photograph is not None:
            return self._photograph.under(colours, self._palette.solid[codes], method)
        return np.asarray(Image.fromarray(colours).resize(self._size, method))

    def _draw_particles(self, picture: NDArray[np.uint8], places: NDArray[np.float64]) -> None:
        stamp = self._stamp
        side = len(stamp)
        corners = np.rint((places + 1.5) * self._scale - side / 2).astype(np.int64)
        rows = np.clip(corners[:, 0, None] + np.arange(side), 0, picture.shape[0] - 1)[:, :, None]
        columns = np.clip(corners[:, 1, None] + np.arange(side), 0, picture.shape[1] - 1)[:, None]
        colour = np.array(rgb_of(PALETTE["particle"]), dtype=np.int32)
        below = picture[rows, columns]
        picture[rows, columns] = below + ((stamp[..., None] * (colour - below) + 128) >> 8)

    def _draw_background(self) -> None:
        canvas, episode = Canvas(self.width, self.height), self._episode
        size = min(34.0, 1.55 * (self.width - 2 * _SIDE) / len(self.title))
        canvas.text((_SIDE, 66), self.title, INK, size, bold=True)
        canvas.text((_SIDE, 98), episode.policy, MUTED, 22)
        left, level = float(_SIDE), self.height - 66.0
        for key, name in legend_of(episode).items():
            colour = legend_colour(episode, key)
            if key != "particle" and self._photograph is not None:
                colour = f"#{bytes(self._photograph.shade(rgb_of(colour), key in SOLID)).hex()}"
            middle = np.array([left + 11, level - 8])
            if key == "particle":
                canvas.disc(middle, 10, colour)
            else:
                square = middle + 10 * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
                canvas.area([square], colour, edge=MUTED, width=1.2)
            left += 62 + canvas.text((left + 32, level), name, INK, 22)
        self._draw_scale_bar(canvas)
        self._plain = canvas.frame().copy()
        self._plain[self.height - 33 : self.height - 26, _SIDE : self.width - _SIDE] = rgb_of(_LINE)

    def _draw_scale_bar(self, canvas: Canvas) -> None:
        spacing = self._episode.workspace.spacing
        size, unit = (1.0, "cells") if spacing is None else (spacing[1], "mm")
        a_pixel = size / self._scale
        length = bar_length(0.15 * self.width * a_pixel)
        if spacing is None:
            length = max(1.0, length)
        right, level = self.width - _SIDE, self.height - 122.0
        canvas.line([(right - length / a_pixel, level), (right, level)], INK, 4)
        words = f"{length:g} {unit if length != 1 or spacing else 'cell'}"
        canvas.text((right - length / a_pixel - 14, level + 8), words, INK, 22, align=1.0)

    def _draw_foot(self, frame: NDArray[np.uint8], moment: float) -> None:
        episode = self._episode
        move = min(int(moment) + (moment % 1 > 0), episode.moves)
        arrow = _ARROWS.get(episode.commands[move - 1], "") if move else ""
        note = f"   {episode.out_of_reach} out of reach" if episode.unreachable else ""
        words = f"move {move:,} of {episode.moves:,}  {arrow}{note}"
        top = self.height - 146  # above the letters
        # Pillow writes text that changes with each picture in a tenth of Matplotlib's time
        line = Image.fromarray(self._plain[top : self.height - 102, :-_SCALE_BAR])
        ImageDraw.Draw(line).text((_SIDE, 32), words, INK, _font(), anchor="ls")
        frame[top : self.height - 102, :-_SCALE_BAR] = np.asarray(line)
        left, right, level = _SIDE, self.width - _SIDE, self.height - 30
        position = left + round((right - left) * moment / max(1, episode.moves))
        frame[level - 3 : level + 4, left:position] = rgb_of(BLUE)


@cache
def _font() -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(f"{get_data_path()}/fonts/ttf/DejaVuSans-Bold.ttf", 28)


def _stamp_of(diameter: float) -> NDArray[np.int32]:
    """Return how much of each pixel a disc covers, in parts of 256; int32, shape (k, k)."""
    side, fine = max(2, round(diameter)), 8
    steps = (np.arange(side * fine) + 0.5) / fine - side / 2
    inside = np.hypot(*np.meshgrid(steps, steps)) <= 0.46 * side
    covered = inside.reshape(side, fine, side, fine).mean(axis=(1, 3))
    return np.asarray(np.rint(256 * covered), dtype=np.int32)
