"""Frames for films of steering episodes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import pi, sin
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.dataclass import dataclass
from shoal.core.geometry import left_of, unit_vectors
from shoal.steering import ConvexWorkspace, Region, SteeringEpisode
from shoal.views.drawing.canvas import Canvas
from shoal.views.drawing.charts import INK, MUTED
from shoal.views.drawing.encoding import LONGEST, Clip
from shoal.views.drawing.stage import Stage
from shoal.views.steering.figures import colour_of, outlines_of
from shoal.views.steering.trajectories import (
    Camera,
    FilmMoment,
    FilmSchedule,
    Frame3D,
    MoveTrajectory,
    camera_for,
    delta_outline,
    has_delta,
    picture_extent,
    project_to_floor,
    trajectories_of,
    two_move_rings,
)

FLOOR, OBSTACLE, REACHED, FAINT = "#f4f6f8", "#d6d9de", "#cfe3f5", "#b9c0c9"
_ARC = 0.2  # radians of a round wall on both sides of a contact that are drawn as holding
_OLD = 0.3  # opacity of the paths of earlier moves
_SQUARE = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])


@dataclass(frozen=True)
class Box:
    """A rectangle on the canvas of a frame, in pixels."""

    left: float
    top: float
    width: float
    height: float


class PlaneView:
    """A mapping of points in the plane to pixels, which centres an outline in a box and makes the
    outline as large as possible.
    """

    def __init__(self, outline: NDArray[np.float64], box: Box) -> None:
        low, high = outline.min(axis=0), outline.max(axis=0)
        self.scale = float(min(box.width / (high[0] - low[0]), box.height / (high[1] - low[1])))
        self._middle = (low + high) / 2
        self._center = np.array([box.left + box.width / 2, box.top + box.height / 2])

    def at(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the pixel coordinates of points, with x to the right and y downwards; shape (...,
        2).
        """
        return np.asarray(
            self._center
            + (np.asarray(points)[..., :2] - self._middle) * self.scale * np.array([1, -1])
        )


def wall_shape(
    workspace: ConvexWorkspace | Region, wall: int, contact: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the shape that marks a wall that holds a particle: a line in 2-D, a face in 3-D, or a
    part of a round wall.
    """
    if isinstance(workspace, Region):
        return np.asarray(workspace.edges[wall].reshape(2, 2))
    sides = len(workspace.vertices)
    if wall == len(workspace.normals):
        angle = np.arctan2(*(contact[:2] - workspace.center)[::-1])
        turns = np.linspace(angle - _ARC, angle + _ARC, 15)
        line = workspace.center + workspace.radius * unit_vectors(turns)
    elif wall < sides:
        line = workspace.vertices[[wall, (wall + 1) % sides]]
    else:
        frame = Frame3D.of(workspace)
        return frame.floor if wall == sides else frame.ceiling
    if workspace.dimensions == 2:
        return np.asarray(line)
    low, high = (
        np.column_stack([line, np.full(len(line), level)]) for level in (0.0, workspace.height)
    )
    return np.concatenate([low, high[::-1]])


class Panel:
    """Base class of the panels of a frame; line widths and text sizes are multiples of ``unit``
    pixels.
    """

    def __init__(
        self,
        episode: SteeringEpisode,
        trajectories: list[MoveTrajectory],
        canvas: Canvas,
        box: Box,
        unit: float,
    ) -> None:
        self._episode = episode
        self._trajectories = trajectories
        self._canvas = canvas
        self._unit = unit
        self._prepare(box)

    def _prepare(self, box: Box) -> None:
        """Compute the data that all frames of the film share, for a panel inside ``box``."""

    def draw_background(self) -> None:
        """Draw the parts of the panel that are the same in all frames."""

    def draw(self, moment: FilmMoment, turn: float) -> None:
        """Draw the moving parts of the panel at a moment of the film, seen by a camera with the
        azimuth ``turn`` in radians.
        """


class PlanePanel(Panel):
    """The panel with the plane workspace, seen from above."""

    def _prepare(self, box: Box) -> None:
        outlines = outlines_of(self._episode.problem.place)
        self._view = PlaneView(outlines[0], box)
        self._radius = max(
            self._episode.problem.particle_radius * self._view.scale, 9.5 * self._unit
        )
        self._outlines = [self._view.at(outline) for outline in outlines]

    def draw_background(self) -> None:
        """Draw the parts of the panel that are the same in all frames: walls, starts and goals."""
        canvas, unit = self._canvas, self._unit
        for k, ring in enumerate(self._outlines):
            canvas.area([ring], OBSTACLE if k else FLOOR, edge=INK, width=2 * unit)
        square = 0.8 * self._radius * _SQUARE
        for particle, (start, goal) in enumerate(
            zip(self._episode.states[0], self._episode.goal, strict=True)
        ):
            colour = colour_of(particle)
            canvas.area([self._view.at(start) + square], colour, alpha=0.25)
            canvas.line(self._view.at(start) + square, colour, 1.5 * unit, closed=True)
            canvas.disc(
                self._view.at(goal), 1.32 * self._radius, "#ffffff", edge=colour, width=2.6 * unit
            )

    def draw(self, moment: FilmMoment, _turn: float) -> None:
        """Draw the moving parts of the panel at a moment of the film."""
        canvas, unit = self._canvas, self._unit
        workspace = self._episode.problem.place
        positions = points_at(self._episode, self._trajectories, moment)
        if self._trajectories:
            for particle, wall in self._trajectories[moment.move].holders(moment.share):
                line = self._view.at(wall_shape(workspace, wall, positions[particle]))
                canvas.line(line, colour_of(particle), 7 * unit)
        draw_trails(canvas, self._trajectories, moment, self._view.at, unit)
        for particle, place in enumerate(self._view.at(positions)):
            draw_particle(canvas, place, self._radius, particle, unit)


class SpacePanel(Panel):
    """The panel with the 3-D workspace, seen by a camera that turns around the workspace."""

    def _prepare(self, box: Box) -> None:
        workspace = self._episode.problem.place
        assert isinstance(workspace, ConvexWorkspace)
        self._workspace, self._frame = workspace, Frame3D.of(workspace)
        right, up, down = picture_extent(workspace, self._episode.states)
        self._scale = min(box.width / (2 * right), box.height / (up + down))
        self._center = np.array(
            [box.left + box.width / 2, box.top + (box.height + (up - down) * self._scale) / 2]
        )

    def draw(self, moment: FilmMoment, turn: float) -> None:
        """Draw all parts of the panel from back to front, seen by a camera with the azimuth
        ``turn`` in radians.
        """
        self._camera = camera_for(self._workspace, self._episode.states, azimuth=turn)
        canvas, unit = self._canvas, self._unit
        positions = points_at(self._episode, self._trajectories, moment)
        behind, front = self._frame.edges(self._camera.eye)
        canvas.area([self._at(self._frame.floor)], FLOOR)
        canvas.lines(list(self._at(np.array(behind))), FAINT, 1.3 * unit)
        if self._trajectories:
            for particle, wall in self._trajectories[moment.move].holders(moment.share):
                shape = self._at(wall_shape(self._workspace, wall, positions[particle]))
                canvas.area([shape], colour_of(particle), alpha=0.16)
                canvas.line(shape, colour_of(particle), 1.6 * unit, closed=True, alpha=0.55)
        self._draw_shadows(positions, moment)
        self._draw_ends()
        draw_trails(canvas, self._trajectories, moment, self._at, unit)
        places, sizes = self._at(positions), 10.5 * unit * self._camera.project(positions)[:, 2]
        for particle in np.argsort(sizes):  # the nearest last
            draw_particle(canvas, places[particle], sizes[particle], int(particle), unit)
        canvas.lines(list(self._at(np.array(front))), INK, 1.6 * unit, alpha=0.75)

    def _at(self, points: ArrayLike) -> NDArray[np.float64]:
        projected = self._camera.project(points)
        return np.asarray(self._center + self._scale * projected[..., :2] * np.array([1, -1]))

    def _draw_shadows(self, positions: NDArray[np.float64], moment: FilmMoment) -> None:
        """Draw the vertical projections of paths and particles on the floor, and a line from each
        particle down to the floor.
        """
        unit = self._unit
        draw_trails(
            self._canvas,
            self._trajectories,
            moment,
            lambda points: self._at(project_to_floor(points)),
            unit,
            shadow=True,
        )
        for particle, point in enumerate(positions):
            self._canvas.area([self._floor_ring(point, 10 * unit)], "#2b3038", alpha=0.22)
            self._canvas.line(
                self._at([project_to_floor(point), point]),
                colour_of(particle),
                1.3 * unit,
                alpha=0.8,
                dashes=(3 * unit, 3 * unit),
            )

    def _floor_ring(self, point: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
        """Return the pixel coordinates of a circle on the floor below ``point``, with the radius
        ``radius`` in pixels.
        """
        angles = 2 * np.pi * np.arange(24) / 24
        return self._at(
            project_to_floor(point)
            + radius / self._scale * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
        )

    def _draw_ends(self) -> None:
        """Draw the starts and the goals, and for each goal a vertical line to a ring on
        the floor.
        """
        canvas, unit = self._canvas, self._unit
        for particle, (start, goal) in enumerate(
            zip(self._episode.states[0], self._episode.goal, strict=True)
        ):
            colour = colour_of(particle)
            canvas.line(
                self._floor_ring(goal, 7 * unit), colour, 1.2 * unit, closed=True, alpha=0.6
            )
            canvas.line(self._at([project_to_floor(goal), goal]), colour, 1.1 * unit, alpha=0.35)
            of_start, of_goal = (
                float(larger) for larger in self._camera.project([start, goal])[:, 2]
            )
            canvas.disc(self._at(goal), 13 * unit * of_goal, None, edge=colour, width=2.4 * unit)
            square = self._at(start) + 7 * unit * of_start * _SQUARE
            canvas.area([square], colour, alpha=0.25)
            canvas.line(square, colour, 1.4 * unit, closed=True)


class DeltaPanel(Panel):
    """The panel with the Δ configuration space: the path and the goal of the difference Δ, and what
    two moves can reach.
    """

    def _prepare(self, box: Box) -> None:
        outline = outlines_of(delta_outline(self._episode))[0]
        self._view = PlaneView(outline, box)
        self._outline = self._view.at(outline)
        self._rings = [
            [self._view.at(ring) for ring in rings] for rings in two_move_rings(self._episode)
        ]

    def draw_background(self) -> None:
        """Draw the area and the outline of the Δ configuration space (all position differences)."""
        self._canvas.area([self._outline], FLOOR, edge=INK, width=2 * self._unit)

    def draw(self, moment: FilmMoment, _turn: float) -> None:
        """Draw the moving parts of the panel at a moment of the film."""
        canvas, unit, view = self._canvas, self._unit, self._view
        canvas.area(self._rings[moment.move] if self._rings else [], REACHED)
        canvas.line(self._outline, INK, 2 * unit, closed=True)
        zero = view.at(np.zeros(2))
        for across in (np.array([6, 0]), np.array([0, 6])):
            canvas.line([zero - across * unit, zero + across * unit], MUTED, 1.2 * unit)
        start, goal = (
            view.at(points[1] - points[0])
            for points in (self._episode.states[0], self._episode.goal)
        )
        canvas.line(start + 7 * unit * _SQUARE, INK, 1.5 * unit, closed=True)
        canvas.disc(goal, 11.5 * unit, "#ffffff", edge=INK, width=2.4 * unit)
        for k, trajectory in enumerate(self._trajectories[: moment.move + 1]):
            points = trajectory.points if k < moment.move else trajectory.until(moment.share)
            canvas.line(
                view.at(points[:, 1] - points[:, 0]),
                INK,
                2 * unit,
                alpha=_OLD if k < moment.move else 0.9,
            )
        positions = points_at(self._episode, self._trajectories, moment)
        canvas.disc(
            view.at(positions[1] - positions[0]), 7 * unit, INK, edge="#ffffff", width=1.5 * unit
        )


def points_at(
    episode: SteeringEpisode, trajectories: list[MoveTrajectory], moment: FilmMoment
) -> NDArray[np.float64]:
    """Return the positions of all particles at a moment of the film."""
    return (
        trajectories[moment.move].at(moment.share)
        if trajectories
        else np.asarray(episode.states[0])
    )


def draw_trails(
    canvas: Canvas,
    trajectories: list[MoveTrajectory],
    moment: FilmMoment,
    at: Any,
    unit: float,
    *,
    shadow: bool = False,
) -> None:
    """Draw the paths of all particles in colours, or in grey if ``shadow`` is true. Earlier moves
    are paler.
    """
    for k, trajectory in enumerate(trajectories[: moment.move + 1]):
        old = k < moment.move
        paths = trajectory.points if old else trajectory.until(moment.share)
        for particle in range(paths.shape[1]):
            path = at(paths[:, particle])
            if np.abs(path - path[0]).max() < 0.5:
                continue
            colour = "#2b3038" if shadow else colour_of(particle)
            alpha = (0.5 * _OLD if old else 0.3) if shadow else (_OLD if old else 0.95)
            canvas.line(path, colour, (2 if shadow else 2.6) * unit, alpha=alpha)


def draw_particle(
    canvas: Canvas, place: NDArray[np.float64], radius: float, particle: int, unit: float
) -> None:
    """Draw a particle as a disc with its number."""
    canvas.disc(place, radius, colour_of(particle), edge="#ffffff", width=1.6 * unit)
    size = min(max(12 * unit, 0.9 * radius), 24 * unit)
    canvas.text(
        place + np.array([0, 0.37 * size]), str(particle + 1), "#ffffff", size, bold=True, align=0.5
    )


RATE = {".gif": 20, ".mp4": 30}  # frames per second
HEIGHT = {".gif": 432, ".mp4": 720}
_TURN = 0.5  # radians by which the camera turns to both sides in a film
_LINE, _BAR = "#dfe3e8", "#0072b2"


def clip_of(episode: SteeringEpisode, suffix: str, stage: Stage | None) -> Clip[Any]:
    """Return the film of a steering episode, ready for encoding as GIF or H.264. With a stage, it is
    one for presentations.
    """
    trajectories = trajectories_of(episode)
    schedule = FilmSchedule(trajectories, size=episode.problem.place.size)
    if stage is not None:
        film = SteeringFilm(episode, trajectories, height=stage.height, width=stage.width)
        moments, _ = schedule.moments(stage.rate, stage.frames_of(60.0))
        clip = Clip(film.frames, moments, stage.rate, quality=20)
        return stage.with_card(clip, episode, film.title)
    moments, rate = schedule.moments(RATE[suffix], LONGEST[suffix])
    film = SteeringFilm(episode, trajectories, height=HEIGHT[suffix])
    return Clip(film.frames, moments, rate, quality=20)


class SteeringFilm:
    """The frames for a film of a steering episode.

    Parameters
    ----------
    episode : SteeringEpisode
    trajectories : list of MoveTrajectory
        The motion within each move, from `trajectories_of`.
    height : int
        Height of each frame in pixels.
    width : int, optional
        Width of each frame in pixels; by default, as the panels need.
    """

    def __init__(
        self,
        episode: SteeringEpisode,
        trajectories: list[MoveTrajectory],
        *,
        height: int = 720,
        width: int | None = None,
    ) -> None:
        self._episode, self._trajectories = episode, trajectories
        pair, space = has_delta(episode), episode.problem.place.dimensions == 3
        self.height = height
        self.width = width or 2 * round(height * (16 / 9 if pair else 4 / 3) / 2)
        self.title = f"{episode.planner} in a {episode.problem.place.kind}"
        self._unit = unit = max(height / 720, 0.72)  # texts and lines of small films stay readable
        self._canvas: Canvas = Canvas(self.width, self.height)
        top, foot, side = 86 * unit, 124 * unit, 40 * unit
        area = Box(side, top, self.width - 2 * side, height - top - foot)
        if pair:
            half = (area.width - side) / 2
            boxes = [
                Box(side, top, half, area.height),
                Box(2 * side + half, top, half, area.height),
            ]
        else:
            boxes = [area]
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
        shaded = episode.problem.friction == np.inf
        wide = self.width > 1.5 * self.height  # has room for more words
        delta = "Δ configuration space" + (
            "; shaded: what two moves can make of Δ" if shaded and wide else ""
        )
        names = ["workspace", delta] if len(middles) > 1 else [""]
        width = canvas.text((40 * unit, 38 * unit), self.title, INK, 19 * unit, bold=True)
        if len(middles) == 1:
            canvas.text(
                (40 * unit + width + 16 * unit, 38 * unit), episode.status, MUTED, 15 * unit
            )
        for middle, name in zip(middles, names, strict=True):
            canvas.text((middle, 66 * unit), name, MUTED, 14 * unit, align=0.5)

    def _draw_foot(self, moment: FilmMoment, turn: float) -> None:
        """Draw the foot of a frame: the present move as an arrow, the status text, and the progress
        of the plan.
        """
        canvas, unit, trajectories = self._canvas, self._unit, self._trajectories
        middle = np.array([76 * unit, self.height - 66 * unit])
        self._draw_command(middle, 38 * unit, moment, turn)
        left, right = 136 * unit, self.width - 40 * unit
        length = sum(trajectory.length for trajectory in trajectories[: moment.move]) + (
            trajectories[moment.move].length * moment.share if trajectories else 0.0
        )
        total = self._episode.length
        last = moment.move == len(trajectories) - 1 and moment.share == 1
        if not trajectories:
            words = f"no moves: {self._episode.status}"
        elif last:
            words = f"{self._episode.status} after {len(trajectories)} moves · length {total:.2f}"
        else:
            words = (
                f"move {moment.move + 1} of {len(trajectories)} · length"
                f" {_short(trajectories[moment.move].length)}"
            )
        canvas.text((left, self.height - 74 * unit), words, INK, 19 * unit, bold=True)
        canvas.text(
            (left, self.height - 49 * unit), f"{length:.2f} of {total:.2f} in all", MUTED, 14 * unit
        )
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
                canvas.line(
                    [(first, level), (first + share * (final - first), level)], _BAR, 5 * unit
                )

    def _draw_command(
        self, middle: NDArray[np.float64], radius: float, moment: FilmMoment, turn: float
    ) -> None:
        """Draw a dial whose arrow shows the present move.

        The length of the arrow is relative to the longest move of the episode. For a 3-D episode,
        the dial appears in perspective.
        """
        canvas, unit = self._canvas, self._unit
        canvas.disc(middle, radius, "#ffffff", edge="#cfd5dc", width=1.6 * unit)
        if not self._trajectories:
            return
        trajectory = self._trajectories[moment.move]
        longest = max(trajectory.length for trajectory in self._trajectories)
        if trajectory.length == 0:
            return
        sent = trajectory.sent * (0.35 + 0.6 * trajectory.length / longest) / trajectory.length
        if len(sent) == 3:
            camera = Camera(np.zeros(3), 1.0, azimuth=turn)
            angles = 2 * pi * np.arange(40) / 40
            dial = camera.project(
                np.stack([0.9 * np.cos(angles), 0.9 * np.sin(angles), 0 * angles], axis=1)
            )[:, :2]
            canvas.area([middle + radius * 0.95 * dial * np.array([1, -1])], "#eef1f4")
            tip, below = (
                camera.project(point)[:2] * 0.9 for point in (sent, sent * np.array([1, 1, 0]))
            )
            canvas.line(
                [middle + radius * end * np.array([1, -1]) for end in (tip, below)],
                MUTED,
                1.2 * unit,
                dashes=(2 * unit, 2 * unit),
            )
        else:
            tip = sent
        draw_arrow(
            canvas,
            middle,
            middle + radius * tip * np.array([1, -1]),
            3.4 * unit,
            centred=len(sent) == 2,
        )


def _short(length: float) -> str:
    return f"{length:.2f}" if length >= 0.1 or length == 0 else f"{length:.2g}"


def draw_arrow(
    canvas: Canvas,
    tail: NDArray[np.float64],
    tip: NDArray[np.float64],
    width: float,
    *,
    centred: bool,
) -> None:
    """Draw an arrow from ``tail`` to ``tip``, or with its midpoint at ``tail`` if ``centred`` is
    true.
    """
    if centred:
        half = (tip - tail) * 0.9
        tail, tip = tail - half, tail + half
    long = float(np.linalg.norm(tip - tail))
    if long < 1:
        return
    along = (tip - tail) / long
    across = left_of(along)
    head = min(4.2 * width, long)
    foot = tip - head * along
    canvas.line([tail, foot + 0.3 * head * along], INK, width)
    canvas.area([[tip, foot + 0.52 * head * across, foot - 0.52 * head * across]], INK)
