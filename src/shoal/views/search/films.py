"""Frames for films of searches: moving robots, searched cells, failed robots and takeovers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import count_text
from shoal.search import SearchEpisode
from shoal.search.episode import duration_text
from shoal.views.drawing.canvas import Canvas, hole_in
from shoal.views.drawing.charts import INK, MUTED, bar_length
from shoal.views.drawing.encoding import LONGEST, Clip
from shoal.views.drawing.stage import Stage
from shoal.views.search.figures import cell_colours
from shoal.views.search.history import Activity, SearchHistory, robot_colour, sizes_text

RATE = {".gif": 10, ".mp4": 30}  # frames per second
HEIGHT = {".gif": 432, ".mp4": 720}
SECONDS = 24.0
_SHORTEST = 4.0
_REST = 1.2  # seconds for which the final picture is shown
_GROUND, _EDGE, _BAR = "#f1f3f5", "#39424e", "#dfe3e8"
_FLASH = 40  # duration of a takeover's growing rings as a fraction of the film: 1/40


def clip_of(episode: SearchEpisode, suffix: str, stage: Stage | None) -> Clip[Any]:
    """Return the film of a search, ready for encoding as GIF or H.264. With a stage, it is one for
    presentations.
    """
    if stage is not None:
        film = SearchFilm(episode, height=stage.height, width=stage.width)
        times = film.times(stage.rate, stage.frames_of(SECONDS + _REST))
        clip = Clip(film.frames, times, stage.rate, quality=20)
        return stage.with_card(clip, episode, film.title)
    film = SearchFilm(episode, height=HEIGHT[suffix])
    times = film.times(RATE[suffix], LONGEST[suffix])
    return Clip(film.frames, times, RATE[suffix], quality=22)


class SearchFilm:
    """The frames for a film of a search.

    Parameters
    ----------
    episode : SearchEpisode
    height : int
        Height of each frame in pixels.
    width : int, optional
        Width of each frame in pixels; by default, as the region needs.
    """

    def __init__(
        self, episode: SearchEpisode, *, height: int = 720, width: int | None = None
    ) -> None:
        self.history = SearchHistory(episode)
        left, right, bottom, top = self._sides = self.history.sides
        self._unit = unit = max(height / 720, 0.7)
        head, foot, side = 64 * unit, 92 * unit, 32 * unit
        across = float(np.clip((right - left) / (top - bottom), 0.9, 1.9))
        self.height = height
        self.width = width or 2 * round(((height - head - foot) * across + 2 * side) / 2)
        self._scale = min(
            (self.width - 2 * side) / (right - left), (height - head - foot) / (top - bottom)
        )
        self._corner = (
            (self.width - self._scale * (right - left)) / 2,
            head + (height - head - foot - self._scale * (top - bottom)) / 2,
        )
        self._canvas: Canvas = Canvas(self.width, self.height)
        self._label = self._pixels()
        self._rings = [[self._at(ring) for ring in part] for part in self.history.panels.parts]
        self._outlines = [
            list(self._at(self.history.outline(robot))) for robot in range(self.history.n_robots)
        ]

    @property
    def title(self) -> str:
        """Name of the region, without its end if it is long."""
        name = self.history.episode.plan.grid.region.name
        return name if len(name) < 30 else name[:29] + "…"

    def times(self, rate: float, longest: int) -> list[float]:
        """Return the times of the frames, in cell times (the time that a robot of speed 1 needs for
        one cell).

        The last frames repeat the final time, so that the film pauses at its end.
        """
        seconds = float(np.clip(self.history.end / 8, _SHORTEST, SECONDS))
        final_frames = round(_REST * rate)
        count = min(round(seconds * rate), longest - final_frames)
        return [
            *np.linspace(0, self.history.end, count).tolist(),
            *[self.history.end] * final_frames,
        ]

    def frames(self, times: Sequence[float]) -> Iterator[NDArray[np.uint8]]:
        """Yield the picture of the search at each time; uint8, shape (height, width, 3)."""
        self._draw_background()
        drawn = -1.0
        for time in times:
            if time < drawn or self.history.state_at(time) != self.history.state_at(drawn):
                self._draw_cells(time)
            drawn = time
            self._canvas.clear()
            self._draw_frame(time)
            yield self._canvas.frame()

    def _at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        left, _, _, top = self._sides
        return np.asarray((points - (left, top)) * (self._scale, -self._scale) + self._corner)

    def _pixels(self) -> NDArray[np.int64]:
        """Return the number of the cell at each pixel; int64, shape (height, width).

        For a pixel outside all cells, the value is the total number of cells.
        """
        panels, (left, _, _, top) = self.history.panels, self.history.extent
        corner = self._at(np.array([left, top]))
        rows, cols = (
            np.floor((np.arange(length) + 0.5 - first) / (self._scale * panels.step)).astype(
                np.int64
            )
            for length, first in ((self.height, corner[1]), (self.width, corner[0]))
        )
        number = self.history.raster(np.arange(self.history.n_cells), self.history.n_cells)
        padded = np.pad(number, 1, constant_values=self.history.n_cells)
        height, width = panels.shape
        return np.asarray(
            padded[np.clip(rows + 1, 0, height + 1)[:, None], np.clip(cols + 1, 0, width + 1)[None]]
        )

    def _draw_background(self) -> None:
        canvas, unit, episode = self._canvas, self._unit, self.history.episode
        canvas.area(
            [[(0, 0), (self.width, 0), (self.width, self.height), (0, self.height)]], "#ffffff"
        )
        width = canvas.text(
            (32 * unit, 38 * unit),
            self.title,
            INK,
            19 * unit,
            bold=True,
        )
        words = (
            f"{count_text(self.history.n_robots, 'robot')}, {self.history.n_cells:,} cells of"
            f" {sizes_text(episode.plan)}"
        )
        begin = (32 + 14) * unit + width
        used = begin + canvas.text((begin, 38 * unit), words, MUTED, 14 * unit)
        self._draw_scale_bar(used)
        self._plain = canvas.frame()
        self._draw_cells(-1.0)

    def _draw_scale_bar(self, used: float) -> None:
        """Draw a scale bar in the head of a frame, if there is room right of ``used`` pixels."""
        unit = self._unit
        length = bar_length(0.2 * (self._sides[1] - self._sides[0]))
        right = self.width - 32 * unit
        left = right - self._scale * length
        if left - 80 * unit < used:
            return
        label = f"{length / 1000:g} km" if length >= 1000 else f"{length:g} m"
        self._canvas.line([(left, 33 * unit), (right, 33 * unit)], INK, 2.2 * unit)
        self._canvas.text((left - 8 * unit, 38 * unit), label, INK, 14 * unit, align=1.0)

    def _draw_cells(self, time: float) -> None:
        """Draw the cells without their parts outside the region, and store the drawing as the
        background of the next frames.
        """
        colours = np.rint(
            255 * np.vstack([cell_colours(self.history, time), (1.0, 1.0, 1.0)])
        ).astype(np.uint8)
        canvas = self._canvas
        canvas.paint(
            np.where(
                (self._label < self.history.n_cells)[..., None], colours[self._label], self._plain
            )
        )
        for robot, activities in enumerate(self.history.activities):
            if any(activity.kind == "taken" and activity.begin <= time for activity in activities):
                canvas.lines(self._outlines[robot], robot_colour(robot), 2 * self._unit)
        frame = np.array(
            [
                (-9, -9),
                (self.width + 9, -9),
                (self.width + 9, self.height + 9),
                (-9, self.height + 9),
            ],
            dtype=float,
        )
        head = 56 * self._unit
        frame[:2, 1], frame[2:, 1] = head, self.height - 80 * self._unit
        canvas.area([frame, *(hole_in(frame, part[0]) for part in self._rings)], "#ffffff")
        for part in self._rings:
            for hole in part[1:]:
                canvas.area([hole], _GROUND)
            for ring in part:
                canvas.line(ring, _EDGE, 1.4 * self._unit, closed=True)
        for words, x, y in self.history.panels.labels:
            canvas.text(
                self._at(np.array([x, y])) - (0, 5 * self._unit), words, INK, 13 * self._unit
            )
        canvas.keep()

    def _draw_frame(self, time: float) -> None:
        canvas, unit, history = self._canvas, self._unit, self.history
        thick = float(np.clip(0.12 * self._scale * history.episode.plan.grid.size, 0.7, 2.6 * unit))
        now = [_current(activities, time) for activities in history.activities]
        for robot, trajectory in enumerate(history.trajectories):
            path = trajectory.until(time)
            if len(path) > 1:
                canvas.line(self._at(path), robot_colour(robot), thick, alpha=0.75)
        for finding in history.episode.findings:
            if history.first[0][finding.cell] <= time:
                self._draw_diamond(history.place_of(finding))
        for robot, activity in enumerate(now):
            self._draw_robot(robot, activity, time)
        self._draw_foot(time, now)

    def _draw_diamond(self, place: NDArray[np.float64]) -> None:
        size = 6.5 * self._unit
        corners = self._at(place) + size * np.array([(0, -1), (1, 0), (0, 1), (-1, 0)])
        self._canvas.area([corners], "#ffd54a", edge=INK, width=1.2 * self._unit)

    def _draw_robot(self, robot: int, activity: Activity, time: float) -> None:
        canvas, unit, colour = self._canvas, self._unit, robot_colour(robot)
        place = self._at(self.history.trajectories[robot].at(time))
        radius = (11 if self.history.n_robots <= 12 else 8.5) * unit
        if activity.kind == "dead":
            for width, shade in ((5.5 * unit, "#ffffff"), (2.6 * unit, INK)):
                for sign in (1, -1):
                    canvas.line(
                        place + 0.62 * radius * np.array([(-1, -sign), (1, sign)]), shade, width
                    )
            canvas.text(
                place + radius * np.array((0.9, 1.3)), str(robot + 1), INK, 11 * unit, bold=True
            )
            return
        if activity.kind == "taken":
            since = (time - activity.begin) / (self.history.end / _FLASH)
            if since < 1:
                canvas.disc(
                    place,
                    radius * (1.2 + 2.6 * since),
                    None,
                    edge=colour,
                    width=3 * unit,
                    alpha=1 - since,
                )
            canvas.disc(place, 1.38 * radius, None, edge=colour, width=2.2 * unit)
        idle = activity.kind in ("waiting", "complete", "listening", "paused")
        if idle and activity.kind != "listening" and self.history.circle:
            canvas.disc(
                place,
                self._scale * self.history.circle,
                None,
                edge=colour,
                width=1.2 * unit,
                alpha=0.7,
            )
        canvas.disc(
            place,
            radius,
            "#ffffff" if idle else colour,
            edge=colour if idle else "#ffffff",
            width=(2.4 if idle else 1.4) * unit,
        )
        size = 1.05 * radius
        canvas.text(
            place + np.array((0, 0.37 * size)),
            str(robot + 1),
            colour if idle else "#ffffff",
            size,
            bold=True,
            align=0.5,
        )

    def _draw_foot(self, time: float, now: list[Activity]) -> None:
        """Draw the foot of a frame: the clock, the searched fraction, and the number of robots in
        each activity.
        """
        canvas, unit, history = self._canvas, self._unit, self.history
        level, left, right = self.height - 26 * unit, 32 * unit, self.width - 32 * unit
        searched = history.searched(time)
        share = f"{100 * searched / history.n_cells:.0f} % searched"
        if 0 < history.n_cells - searched < 0.005 * history.n_cells:
            share = f"{history.n_cells - searched} cells left"
        width = canvas.text((left, level - 20 * unit), share, INK, 19 * unit, bold=True)
        clock = " of ".join(
            duration_text(float(history.episode.clock(moment))) for moment in (time, history.end)
        )
        if history.episode.plan.tour_cost.odds is not None:
            clock += f" · target found with {100 * history.success_at(time):.0f} %"
        canvas.text((left + width + 14 * unit, level - 20 * unit), clock, MUTED, 14 * unit)
        kinds = [activity.kind for activity in now]
        words = [
            f"{kinds.count(kind)} {name}"
            for kind, name in (
                ("dead", "dead"),
                ("taken", "taking over"),
                ("paused", "paused"),
                ("waiting", "waiting"),
            )
            if kind in kinds
        ]
        canvas.text((right, level - 20 * unit), " · ".join(words), MUTED, 14 * unit, align=1.0)
        canvas.line([(left, level), (right, level)], _BAR, 5 * unit)
        if searched:
            canvas.line(
                [(left, level), (left + (right - left) * searched / history.n_cells, level)],
                "#0072b2",
                5 * unit,
            )


def _current(activities: tuple[Activity, ...], time: float) -> Activity:
    """Return the activity of a robot at the time ``time``."""
    begun = [activity for activity in activities if activity.begin <= time]
    return begun[-1] if begun else Activity(0.0, inf, "listening")
