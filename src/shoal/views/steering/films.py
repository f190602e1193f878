"""Frames for films of steering episodes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import pi, sin

import numpy as np
from numpy.typing import NDArray

from shoal.steering import SteeringEpisode
from shoal.views.drawing.canvas import Canvas
from shoal.views.drawing.charts import INK, MUTED
from shoal.views.drawing.encoding import LONGEST, Clip
from shoal.views.steering.camera import Camera
from shoal.views.steering.panels import Box, DeltaPanel, Panel, PlanePanel, SpacePanel
from shoal.views.steering.trajectories import FilmMoment, FilmSchedule, MoveTrajectory, has_delta, trajectories_of

RATE = {".gif": 20, ".mp4": 30}  # frames per second
HEIGHT = {".gif": 432, ".mp4": 720}
_TURN = 0.5  # radians by which the camera turns to both sides in a film
_LINE, _BAR = "#dfe3e8", "#0072b2"


def clip_of(episode: SteeringEpisode, suffix: str) -> Clip[FilmMoment]:
    """Return the film of a steering episode, ready for encoding as GIF or H.264."""
    trajectories = trajectories_of(episode)
    moments, rate = FilmSchedule(trajectories, size=episode.problem.place.size).moments(RATE[suffix], LONGEST[suffix])
    film = SteeringFilm(episode, trajectories, height=HEIGHT[suffix])
    return Clip(film.frames, moments, rate, max(film.width, film.height), quality=20)


class SteeringFilm:
    """The frames for a film of a steering episode.

    Parameters
    ----------
    episode : SteeringEpisode
    trajectories : list of MoveTrajectory
        The motion within each move, from `trajectories_of`.
    height : int
        Height of each frame in pixels.
    """

    def __init__(self, episode: SteeringEpisode, trajectories: list[MoveTrajectory], *, height: int = 720) -> None:
        self._episode, self._trajectories = episode, trajectories
        pair, space = has_delta(episode), episode.problem.place.dimensions == 3
        self.height, self.width = height, 2 * round(height * (16 / 9 if pair else 4 / 3) / 2)
        self._unit = unit = max(height / 720, 0.72)  # texts and lines of small films stay readable
        self._canvas: Canvas = Canvas(self.width, self.height)
        top, foot, side = 86 * unit, 124 * unit, 40 * unit
        room = Box(side, top, self.width - 2 * side, height - top - foot)
        if pair:
            half = (room.width - side) / 2
            boxes = [Box(side, top, half, room.height), Box(2 * side + half, top, half, room.height)]
        else:
            boxes = [room]
        view = SpacePanel if space else PlanePanel
        self._panels: list[Panel] = [view(episode, trajectories, self._canvas, boxes[0], unit)]
        if pair:
            self._panels.append(DeltaPanel(episode, trajectories, self._canvas, boxes[1], unit))
        self._draw_head([box.left + box.width / 2 for box in boxes])
        for panel in self._panels:
            panel.draw_background()
        self._canvas.keep()

    def frames(self, moments: Sequence[FilmMoment]) -> Iterator[NDArray[np.uint8]]:
        """Yield the picture of the episode at each moment; uint8, shape (height, width, 3)."""
        for number, moment in enumerate(moments):
            self._canvas.clear()
            turn = -pi / 3 + _TURN * sin(2 * pi * number / max(1, len(moments) - 1))
            for panel in self._panels:
                panel.draw(moment, turn)
            self._draw_foot(moment, turn)
            yield self._canvas.frame()

    def _draw_head(self, middles: list[float]) -> None:
        canvas, unit, episode = self._canvas, self._unit, self._episode
        title = f"{episode.planner} in a {episode.problem.place.kind}"
        shaded = episode.problem.friction == np.inf
        delta = "Δ configuration space" + ("; shaded: what two moves can make of Δ" if shaded else "")
        names = ["workspace", delta] if len(middles) > 1 else [""]
        width = canvas.text((40 * unit, 38 * unit), title, INK, 19 * unit, bold=True)
        if len(middles) == 1:
            canvas.text((40 * unit + width + 16 * unit, 38 * unit), episode.status, MUTED, 15 * unit)
        for middle, name in zip(middles, names, strict=True):
            canvas.text((middle, 66 * unit), name, MUTED, 14 * unit, align=0.5)

    def _draw_foot(self, moment: FilmMoment, turn: float) -> None:
        """Draw the foot of a frame: the present move as an arrow, the status text, and the progress of the plan."""
        canvas, unit, trajectories = self._canvas, self._unit, self._trajectories
        middle = np.array([76 * unit, self.height - 66 * unit])
        self._draw_command(middle, 38 * unit, moment, turn)
        left, right = 136 * unit, self.width - 40 * unit
        done = sum(trajectory.length for trajectory in trajectories[: moment.move]) + (
            trajectories[moment.move].length * moment.share if trajectories else 0.0
        )
        total = self._episode.length
        last = moment.move == len(trajectories) - 1 and moment.share == 1
        if not trajectories:
            words = f"no moves: {self._episode.status}"
        elif last:
            words = f"{self._episode.status} after {len(trajectories)} moves · length {total:.2f}"
        else:
            words = f"move {moment.move + 1} of {len(trajectories)} · length {_short(trajectories[moment.move].length)}"
        canvas.text((left, self.height - 74 * unit), words, INK, 19 * unit, bold=True)
        canvas.text((left, self.height - 49 * unit), f"{done:.2f} of {total:.2f} in all", MUTED, 14 * unit)
        level = self.height - 30 * unit
        gap = (9 if len(trajectories) < 30 else 6.5) * unit  # the ends of the segments are round
        at = 0.0
        for k, trajectory in enumerate(trajectories):
            first = left + (right - left) * at / max(total, 1e-300)
            at += trajectory.length
            final = max(first, left + (right - left) * at / max(total, 1e-300) - gap)
            canvas.line([(first, level), (final, level)], _LINE, 5 * unit)
            share = 1.0 if k < moment.move else moment.share if k == moment.move else 0.0
            if share > 0:
                canvas.line([(first, level), (first + share * (final - first), level)], _BAR, 5 * unit)

    def _draw_command(self, middle: NDArray[np.float64], radius: float, moment: FilmMoment, turn: float) -> None:
        """Draw a dial whose arrow shows the present move.

        The length of the arrow is relative to the longest move of the episode. For a 3-D episode, the dial appears in perspective.
        """
        canvas, unit = self._canvas, self._unit
        canvas.disc(middle, radius, "#ffffff", edge="#cfd5dc", width=1.6 * unit)
        if not self._trajectories:
            return
        trajectory = self._trajectories[moment.move]
        longest = max(one.length for one in self._trajectories)
        if trajectory.length == 0:
            return
        sent = trajectory.sent * (0.35 + 0.6 * trajectory.length / longest) / trajectory.length
        if len(sent) == 3:
            camera = Camera(np.zeros(3), 1.0, azimuth=turn)
            angles = 2 * pi * np.arange(40) / 40
            seen = camera.project(np.stack([0.9 * np.cos(angles), 0.9 * np.sin(angles), 0 * angles], axis=1))[:, :2]
            canvas.area([middle + radius * 0.95 * seen * np.array([1, -1])], "#eef1f4")
            tip, below = (camera.project(point)[:2] * 0.9 for point in (sent, sent * np.array([1, 1, 0])))
            canvas.line(
                [middle + radius * end * np.array([1, -1]) for end in (tip, below)],
                MUTED, 1.2 * unit, dashes=(2 * unit, 2 * unit),
            )  # fmt: skip
        else:
            tip = sent
        draw_arrow(canvas, middle, middle + radius * tip * np.array([1, -1]), 3.4 * unit, centred=len(sent) == 2)


def _short(length: float) -> str:
    return f"{length:.2f}" if length >= 0.1 or length == 0 else f"{length:.2g}"


def draw_arrow(canvas: Canvas, tail: NDArray[np.float64], tip: NDArray[np.float64], width: float, *, centred: bool) -> None:
    """Draw an arrow from ``tail`` to ``tip``, or with its midpoint at ``tail`` if ``centred`` is true."""
    if centred:
        half = (tip - tail) * 0.9
        tail, tip = tail - half, tail + half
    long = float(np.linalg.norm(tip - tail))
    if long < 1:
        return
    along = (tip - tail) / long
    across = np.array([-along[1], along[0]])
    head = min(4.2 * width, long)
    foot = tip - head * along
    canvas.line([tail, foot + 0.3 * head * along], INK, width)
    canvas.area([[tip, foot + 0.52 * head * across, foot - 0.52 * head * across]], INK)
