"""The timeline of a search: what each robot did, and when."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np

from shoal.search import SearchEpisode
from shoal.search.episode import duration_text
from shoal.views.drawing.charts import (
    INK,
    add_legend,
    dashes,
    draw_heading,
    marker,
    new_figure,
    plain_axes,
    text_size,
)
from shoal.views.search.history import Activity, SearchHistory, robot_colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


WAITING, LISTENING = "#d5dae0", "#eceff2"


def timeline_figure(episode: SearchEpisode) -> Figure:
    """Return a figure with the timeline of a search, with one row for each robot.

    If the problem names a vehicle, the unit of the time axis is minutes. Without a vehicle, the
    unit is the cell time: the time that a robot of speed 1 needs for one cell.

    A full colour means that the robot searched its own part. A hatched colour means that the robot
    searched the part of another robot; a number names the other robot. A grey bar means that the
    robot waited, a pale bar means that it listened, and a dotted bar means that it was paused. A
    cross means that the robot died. A dot means that the robot declared the search complete.
    """
    history = SearchHistory(episode)
    clock = _Clock(episode)
    end = clock.at(history.end)
    rows = history.n_robots
    pitch = float(np.clip(9.0 / rows, 0.2, 0.34))
    figure = new_figure(8.0, 1.35 + pitch * max(rows, 2), rows=True)
    axes = figure.add_subplot()
    for robot, activities in enumerate(history.activities):
        for activity in activities:
            placed = replace(activity, begin=clock.at(activity.begin), end=clock.at(activity.end))
            _draw_activity(axes, robot, placed, end, pitch)
    _draw_moments(axes, history, clock)
    axes.set(
        xlim=(0, 1.015 * end),
        ylim=(rows - 0.4, -0.6),
        xlabel=f"time, in {clock.unit}",
        ylabel="robot",
    )
    axes.set_yticks(
        range(rows),
        [str(robot + 1) for robot in range(rows)],
        fontsize=text_size(8 if pitch > 0.26 else 6.5),
    )
    plain_axes(axes)
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    draw_heading(figure, axes, f"{episode.plan.grid.region.name}: what each robot did")
    _draw_kinds(figure, history)
    return figure


class _Clock:
    """The time axis of a timeline: minutes if the problem of an episode names a vehicle, and
    otherwise cell times.
    """

    def __init__(self, episode: SearchEpisode) -> None:
        self.episode = episode
        self.unit = "cells" if episode.problem.vehicle is None else "minutes"

    def at(self, moment: float) -> float:
        """Return the position on the time axis of a moment in cell times."""
        return moment if self.unit == "cells" else float(self.episode.clock(moment)) / 60

    def text(self, moment: float) -> str:
        """Return a moment in cell times as text."""
        return (
            f"{moment:.4g}"
            if self.unit == "cells"
            else duration_text(float(self.episode.clock(moment)))
        )


def _draw_activity(axes: Axes, robot: int, activity: Activity, end: float, pitch: float) -> None:
    from matplotlib.colors import to_rgb

    colour, length = robot_colour(robot), activity.end - activity.begin
    span = (activity.begin, length)
    match activity.kind:
        case "own":
            axes.broken_barh([span], (robot - 0.32, 0.64), facecolors=colour, linewidth=0, zorder=2)
        case "taken":
            pale = tuple(1 - 0.3 * (1 - part) for part in to_rgb(colour))
            axes.broken_barh(
                [span],
                (robot - 0.32, 0.64),
                facecolors=[pale],
                edgecolors=colour,
                linewidth=0.9,
                hatch="/////",
                zorder=2.2,
            )
            if length > 0.028 * end:
                axes.text(
                    activity.begin + length / 2,
                    robot,
                    str(activity.other),
                    fontsize=text_size(7 if pitch > 0.26 else 5.5),
                    fontweight="bold",
                    color=INK,
                    ha="center",
                    va="center_baseline",
                    zorder=4,
                    bbox={
                        "facecolor": "white",
                        "edgecolor": "none",
                        "pad": 0.8,
                        "boxstyle": "round,pad=0.12",
                    },
                )
        case "waiting" | "listening":
            shade = WAITING if activity.kind == "waiting" else LISTENING
            axes.broken_barh(
                [span], (robot - 0.32, 0.64), facecolors=shade, linewidth=0, zorder=1.8
            )
        case "paused":
            axes.plot(
                [activity.begin, activity.end],
                [robot, robot],
                color=colour,
                lw=1.6,
                ls=(0, (1, 1.6)),
                zorder=2,
            )
        case "dead":
            axes.plot(
                activity.begin, robot, "x", color="white", ms=8, mew=4, zorder=5, clip_on=False
            )
            axes.plot(activity.begin, robot, "x", color=INK, ms=7, mew=2, zorder=5.1, clip_on=False)
        case _:
            axes.plot(
                activity.begin,
                robot,
                "o",
                mfc="white",
                mec=INK,
                mew=1.3,
                ms=5,
                zorder=5,
                clip_on=False,
            )


def _draw_moments(axes: Axes, history: SearchHistory, clock: _Clock) -> None:
    """Mark the time at which all cells were searched, and the time at which the last robot knew
    about the completion.
    """
    episode = history.episode
    marks: list[tuple[float, str, Any]] = []
    if episode.trace.covered_at < inf:
        marks.append(
            (
                episode.trace.covered_at,
                "all searched, all back" if clock.episode.plan.flies else "all searched",
                "solid",
            )
        )
    if episode.trace.declared:
        marks.append((max(episode.trace.declared.values()), "all who live know it", (0, (3, 2))))
    if len(marks) == 2 and abs(marks[0][0] - marks[1][0]) < 0.005 * history.end:
        marks = [(marks[1][0], f"all searched, {marks[1][1]}", "solid")]
    for row, (moment, words, style) in enumerate(reversed(marks)):
        axes.axvline(clock.at(moment), color=INK, lw=1.1, ls=style, zorder=3)
        axes.annotate(
            f"{words}: {clock.text(moment)}",
            (clock.at(moment), 1),
            xycoords=("data", "axes fraction"),
            xytext=(0, 4 + 11 * row),
            textcoords="offset points",
            fontsize=text_size(),
            color=INK,
            ha="right" if moment > 0.35 * history.end else "left",
        )


def _draw_kinds(figure: Figure, history: SearchHistory) -> None:
    from matplotlib.patches import Patch

    first = robot_colour(0)
    handles: Mapping[str, Any] = {
        "listening": Patch(facecolor=LISTENING, label="listening"),
        "own": Patch(facecolor=first, label="its own part"),
        "taken": Patch(facecolor="#b3d5e8", edgecolor=first, hatch="/////", label="another's part"),
        "waiting": Patch(facecolor=WAITING, label="waiting"),
        "paused": dashes("paused", color=first, lw=1.6, ls=(0, (1, 1.6))),
        "dead": marker("x", "died", color=INK, ms=7, mew=2),
        "complete": marker("o", "knows that all is searched", mfc="white", mec=INK, mew=1.3, ms=5),
    }
    kinds = {activity.kind for activities in history.activities for activity in activities}
    add_legend(
        figure, [handle for kind, handle in handles.items() if kind in kinds], 7, spacing=1.2
    )
