"""Figures of a search: the routes of the robots in the search region."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import count_text
from shoal.core.geometry import left_of, segments_of
from shoal.search import SearchEpisode, Tour
from shoal.search.episode import duration_text
from shoal.search.regions.region import SearchRegion
from shoal.views.drawing.canvas import hole_in, path_of_rings, rings_of
from shoal.views.drawing.charts import (
    INK,
    MUTED,
    bare_axes,
    draw_scale_bar,
    new_figure,
    plain_axes,
    set_title,
)
from shoal.views.search.history import Activity, SearchHistory, robot_colour, sizes_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure


WAITING, LISTENING = "#d5dae0", "#eceff2"


def draw_heading(figure: Figure, axes: Axes, words: str) -> None:
    """Write the heading ``words`` above a whole figure, beginning at the left edge of the axes."""
    from matplotlib.transforms import blended_transform_factory

    edge = blended_transform_factory(axes.transAxes, figure.transFigure)
    figure.suptitle(
        words,
        fontsize=11,
        color=INK,
        x=0.0,
        ha="left",
        fontweight="bold",
        parse_math=False,
        transform=edge,
    )


def marker(shape: str, label: str, **look: Any) -> Any:
    """Return a marker for a legend; ``look`` holds arguments of a `matplotlib.lines.Line2D`."""
    from matplotlib.lines import Line2D

    return Line2D([], [], ls="", marker=shape, label=label, **look)


def dashes(label: str, **look: Any) -> Any:
    """Return a dashed line for a legend."""
    from matplotlib.lines import Line2D

    usual: dict[str, Any] = {"color": MUTED, "lw": 1.0, "ls": (0, (3, 2))}
    return Line2D([], [], label=label, **usual | look)


def add_legend(figure: Figure, handles: Sequence[Any], ncols: int, *, spacing: float = 1.4) -> None:
    """Write a legend below a figure."""
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=ncols,
        frameon=False,
        fontsize=8,
        labelcolor=INK,
        handletextpad=0.5,
        columnspacing=spacing,
    )


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
    figure = new_figure(8.0, 1.35 + pitch * max(rows, 2))
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
        range(rows), [str(robot + 1) for robot in range(rows)], fontsize=8 if pitch > 0.26 else 6.5
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
                    fontsize=7 if pitch > 0.26 else 5.5,
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
            fontsize=8,
            color=INK,
            ha="right" if moment > 0.35 * history.end else "left",
        )


def _draw_kinds(figure: Figure, history: SearchHistory) -> None:
    from matplotlib.patches import Patch

    first = robot_colour(0)
    known: Mapping[str, Any] = {
        "listening": Patch(facecolor=LISTENING, label="listening"),
        "own": Patch(facecolor=first, label="its own part"),
        "taken": Patch(facecolor="#b3d5e8", edgecolor=first, hatch="/////", label="another's part"),
        "waiting": Patch(facecolor=WAITING, label="waiting"),
        "paused": dashes("paused", color=first, lw=1.6, ls=(0, (1, 1.6))),
        "dead": marker("x", "died", color=INK, ms=7, mew=2),
        "complete": marker("o", "knows that all is searched", mfc="white", mec=INK, mew=1.3, ms=5),
    }
    kinds = {activity.kind for activities in history.activities for activity in activities}
    add_legend(figure, [handle for kind, handle in known.items() if kind in kinds], 7, spacing=1.2)


NOT_SEEN = "#d81b1b"
OBSTACLE = "#5b6470"
_OUTSIDE, _EDGE, _LINES = "#eef0f3", "#39424e", "#e1e5ea"
_OWN, _TAKEN = 0.16, 0.36  # opacity of a robot's colour in its cells
_GRID = 3000  # number of cells up to which cell borders are drawn
_NAMED = 24  # number of findings up to which their confidences are written
_ARROWS = 14  # maximum number of arrows on a route


def routes_figure(episode: SearchEpisode) -> Figure:
    """Return a figure of a search: the region, and the path of each robot in the colour of the
    robot.

    A square with a number marks the start of a robot. A cross marks the place where a robot failed.
    A diamond marks a finding with its confidence. Each cell has the colour of the robot that
    searched the cell first. Cells that a robot searched in another robot's part are darker and have
    an outline. The path of a robot is thicker in another robot's part. Paths to distant cells are
    thin and dashed. Areas that no robot has seen are red.
    """
    history = SearchHistory(episode)
    left, right, bottom, top = history.sides
    ratio = (top - bottom) / (right - left)
    width = 7.2 if ratio < 1.2 else max(4.6, 8.4 / ratio)
    figure = new_figure(
        width,
        float(np.clip((width - 0.6) * ratio, 1.2, 8.6)) + (1.9 if history.panels.labels else 1.3),
    )
    axes = figure.add_subplot()
    side = (
        72
        * 0.9
        * min(width / (right - left), figure.get_figheight() / (top - bottom))
        * episode.plan.grid.size
    )
    _draw_ground(axes, history)
    for robot in range(history.n_robots):
        _draw_route(axes, history, robot, side)
    _draw_not_seen(axes, history)
    _draw_findings(axes, history)
    axes.set(xlim=(left, right), ylim=(bottom, top))
    if history.panels.labels:
        axes.set(xticks=[], yticks=[])
    across, up = _axis_labels(history)
    axes.set_xlabel(across, color=MUTED, fontsize=8)
    axes.set_ylabel(up, color=MUTED, fontsize=8)
    bare_axes(axes)
    axes.set_title(
        _summary(episode),
        fontsize=9,
        color=MUTED,
        loc="left",
        parse_math=False,
        pad=17 if history.panels.labels else None,
    )
    draw_heading(
        figure, axes, f"{episode.plan.grid.region.name}, {count_text(history.n_robots, 'robot')}"
    )
    _draw_legend(figure, history)
    # Fixes the positions of the axes, so that the numbers can be moved apart. The summary moves
    # with the axes, so that the layout leaves its place below the heading free only the second
    # time.
    for _ in range(2):
        figure.draw_without_rendering()
    figure.set_layout_engine("none")
    _draw_robots(axes, history)
    draw_scale_bar(figure, axes, north=history.north)
    return figure


def _axis_labels(history: SearchHistory) -> tuple[str, str]:
    """Return the labels of the x and the y axis. For panels without axes, the labels only make
    space for the scale bar.
    """
    panels, plan = history.panels, history.episode.plan
    if panels.labels:
        return "\n\n", ""
    if panels.angle == 0:
        return "metres", ""
    along, across = "metres along the rows", "metres across the rows"
    return (along, across) if plan.tour.runs_along_rows else (across, along)


def _summary(episode: SearchEpisode) -> str:
    cells = episode.plan.grid.n_cells
    when = (
        "not searched wholly"
        if episode.makespan is None
        else f"searched after {duration_text(episode.makespan)}"
    )
    over = f", {episode.trace.takeovers} taken over" if episode.trace.takeovers else ""
    return f"{count_text(cells, 'cell')} of {sizes_text(episode.plan)}, {when}{over}"


def _draw_ground(axes: Axes, history: SearchHistory) -> None:
    """Draw each cell in the colour of the robot that searched it, and then the border and the holes
    of the region.
    """
    from matplotlib.collections import LineCollection
    from matplotlib.colors import to_rgb
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    left, right, bottom, top = history.extent
    picture = history.raster(cell_colours(history), 1.0)
    axes.imshow(picture, extent=(left, right, bottom, top), interpolation="nearest", zorder=0)
    size = history.panels.step
    if history.n_cells <= _GRID and history.panels.alike:
        height, width = history.panels.shape
        lines = [[(x, bottom), (x, top)] for x in left + size * np.arange(1, width)]
        lines += [[(left, y), (right, y)] for y in bottom + size * np.arange(1, height)]
        axes.add_collection(LineCollection(lines, colors=[_LINES], linewidths=0.4, zorder=0.5))
    left, right, bottom, top = history.sides
    pad = 0.02 * max(right - left, top - bottom)
    frame = np.array(
        [
            (left - pad, bottom - pad),
            (right + pad, bottom - pad),
            (right + pad, top + pad),
            (left - pad, top + pad),
        ]
    )
    rings = [ring for part in history.panels.parts for ring in part]
    axes.add_patch(PathPatch(_even_odd([frame, *rings]), facecolor="white", lw=0, zorder=0.8))
    for part in history.panels.parts:
        for hole in part[1:]:
            axes.fill(*hole.T, facecolor=to_rgb(_OUTSIDE), lw=0, zorder=0.9)
        for ring in part:
            axes.add_patch(
                PathPatch(
                    Path(ring, closed=True), facecolor="none", edgecolor=_EDGE, lw=1.2, zorder=1.2
                )
            )
    for words, x, y in history.panels.labels:
        _label(axes, words, (x, y), (0, 3), fontsize=8)


def _even_odd(rings: Sequence[NDArray[np.float64]]) -> Any:
    """Return a path that contains the points inside an odd number of closed lines. The first line
    must enclose all other lines.
    """
    frame, *rest = rings
    return path_of_rings([frame, *(hole_in(frame, one) for one in rest)])


def cell_colours(history: SearchHistory, time: float = inf) -> NDArray[np.float64]:
    """Return the RGB colour of each cell at a given time, in the order of the tour; float64, shape
    (n, 3).

    An unsearched cell is white, and a discovered obstacle has the colour `OBSTACLE`.
    """
    from matplotlib.colors import to_rgb

    times, by = history.first
    palette = np.array(
        [(1.0, 1.0, 1.0), *(to_rgb(robot_colour(robot)) for robot in range(history.n_robots))]
    )
    part = np.where(history.taken, _TAKEN, _OWN) * ((times <= time) & (by > 0))
    colours = 1.0 - part[:, None] * (1.0 - palette[by])
    colours[[cell for cell, moment in history.obstacles.items() if moment <= time]] = to_rgb(
        OBSTACLE
    )
    return np.asarray(colours)


def _draw_route(axes: Axes, history: SearchHistory, robot: int, side: float) -> None:
    """Draw the path of a robot; ``side`` is the side of a cell in points (1/72 inch)."""
    from matplotlib.collections import LineCollection

    episode, colour = history.episode, robot_colour(robot)
    route, size = episode.routes[robot], history.panels.largest
    outline = history.outline(robot)
    if len(outline):
        axes.add_collection(
            LineCollection(
                list(outline), colors=[colour], linewidths=1.5, capstyle="round", zorder=0.7
            )
        )
    if len(route.points) < 2:
        way = history.trajectories[robot].points  # it failed before it had searched a cell
        if len(way) > 1:
            axes.plot(*way.T, color=colour, lw=0.8, ls=(0, (3, 1.8)), zorder=3)
        return
    located = history.ways.of(robot)
    way = history.on_picture(located)
    pieces = segments_of(way)
    ends = history.ways.stop_ends(robot)
    cell = np.clip(np.searchsorted(ends, np.arange(1, len(route.points))) - 1, 0, None)
    taken = (history.others(robot) > 0)[np.minimum(cell, len(ends) - 2)]
    # climbs lead from panel to panel
    far = route.long_legs(size) | (np.diff(located[:, 2:], axis=0) != 0).any(axis=1)
    thick = float(np.clip(0.16 * side, 0.45, 1.9))
    for chosen, width, style, alpha in (
        (far, 0.55 * thick, (0, (3, 1.8)), 0.75),
        (~far & ~taken, thick, "solid", 1.0),
        (~far & taken, 1.7 * thick, "solid", 1.0),
    ):
        lines = LineCollection(
            list(pieces[chosen]),
            colors=[colour],
            linewidths=width,
            linestyles=[style],
            alpha=alpha,
            capstyle="butt",
            zorder=3,
        )
        axes.add_collection(lines)
    _draw_arrows(axes, pieces[~far], colour, float(np.clip(0.3 * side, 2.2, 4.8)) * size / side)


def _draw_arrows(axes: Axes, pieces: NDArray[np.float64], colour: str, size: float) -> None:
    """Draw arrowheads at regular distances on a path."""
    from matplotlib.collections import PolyCollection

    lengths = np.hypot(*(pieces[:, 1] - pieces[:, 0]).T)
    far = np.cumsum(lengths)
    good = np.flatnonzero(lengths > 1e-9)
    if not len(good):
        return
    count = int(np.clip(far[-1] / (14 * size), 1, _ARROWS))
    chosen = good[
        np.minimum(
            np.searchsorted(far[good], (np.arange(count) + 0.5) * far[-1] / count), len(good) - 1
        )
    ]
    along = (pieces[chosen, 1] - pieces[chosen, 0]) / lengths[chosen, None]
    across = left_of(along)
    middle = pieces[chosen].mean(axis=1)
    heads = np.stack(
        [
            middle + size * along,
            middle - 0.7 * size * along + 0.75 * size * across,
            middle - 0.7 * size * along - 0.75 * size * across,
        ],
        axis=1,
    )
    axes.add_collection(
        PolyCollection(
            list(heads), facecolors=[colour], edgecolors="white", linewidths=0.3, zorder=3.5
        )
    )


def _draw_not_seen(axes: Axes, history: SearchHistory) -> None:
    for rings in rings_of(_not_seen(history)):
        from matplotlib.patches import PathPatch

        axes.add_patch(
            PathPatch(
                _even_odd(rings),
                facecolor=NOT_SEEN,
                alpha=0.55,
                edgecolor=NOT_SEEN,
                lw=0.8,
                zorder=2.5,
            )
        )


def _draw_findings(axes: Axes, history: SearchHistory) -> None:
    findings = history.episode.findings
    for finding in findings:
        place = history.place_of(finding)
        axes.plot(*place, "D", mfc="#ffd54a", mec=INK, mew=1.1, ms=6.5, zorder=6)
        if len(findings) <= _NAMED:
            _label(axes, f"{100 * finding.confidence:.3g} %", place, (6, 5))


def _label(
    axes: Axes, words: str, place: Any, offset: tuple[float, float], *, fontsize: float = 7
) -> None:
    from matplotlib.patheffects import withStroke

    axes.annotate(
        words,
        (float(place[0]), float(place[1])),
        xytext=offset,
        textcoords="offset points",
        fontsize=fontsize,
        color=INK,
        zorder=8,
        path_effects=[withStroke(linewidth=2, foreground="white")],
    )


def _draw_robots(axes: Axes, history: SearchHistory) -> None:
    """Draw the starts of the robots, and the places where robots failed.

    If several starts are close together, the function moves their numbers apart and connects each
    number with its start by a line. Numbers beyond the axes, where the edge of the figure could cut
    them, are moved to the edge of the axes.
    """
    places = history.on_picture(history.episode.plan.places)
    points_a_pixel = 72 / axes.figure.dpi
    on_paper = axes.transData.transform(places) * points_a_pixel
    small = history.n_robots > 12
    side, font = (9.5, 5.8) if small else (11.0, 7.0)
    moved = spread_out(on_paper, 1.12 * side, axes.bbox.get_points() * points_a_pixel)
    for robot, (place, here, there) in enumerate(zip(places, on_paper, moved, strict=True)):
        colour = robot_colour(robot)
        label = axes.transData.inverted().transform(there / points_a_pixel)
        if np.hypot(*(there - here)) > 1:
            axes.plot(*np.stack([place, label]).T, color=colour, lw=0.9, zorder=6.2)
            axes.plot(*place, "s", color=colour, ms=3, zorder=6.2)
        axes.plot(*label, "s", mfc=colour, mec="white", mew=0.9, ms=side, zorder=6.5, clip_on=False)
        x, y = (float(part) for part in label)
        axes.text(
            x,
            y,
            str(robot + 1),
            color="white",
            fontsize=font,
            fontweight="bold",
            ha="center",
            va="center_baseline",
            zorder=7,
        )
    for robot in range(history.n_robots):
        if history.death(robot) < inf:
            place = history.trajectories[robot].at(history.death(robot))
            axes.plot(*place, "x", color="white", ms=10, mew=4.6, zorder=7.2)
            axes.plot(*place, "x", color=INK, ms=9, mew=2.2, zorder=7.3)
            _label(axes, str(robot + 1), place, (5.5, -9))


def spread_out(
    places: NDArray[np.float64], least: float, box: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Move points apart until all distances between two points are about ``least`` or more;
    float64, shape (n, 2).

    The points stay inside a box, which is given by its lower left and upper right corner.

    Examples
    --------
    >>> apart = spread_out(np.zeros((2, 2)), 10.0, np.array([(0.0, 0.0), (50.0, 20.0)]))
    >>> bool(np.hypot(*(apart[1] - apart[0])) > 9.9), bool((apart >= 0).all())
    (True, True)
    """
    moved = places + 1e-3 * np.stack(
        [np.cos(2.4 * np.arange(len(places))), np.sin(2.4 * np.arange(len(places)))], axis=1
    )
    for _ in range(300):
        ways = moved[:, None] - moved[None]
        apart = np.hypot(ways[..., 0], ways[..., 1])
        np.fill_diagonal(apart, inf)
        push = np.clip(least - apart, 0, None)
        if not (push > 0.01).any():
            break
        moved = np.clip(
            moved + 0.5 * ((push / np.maximum(apart, 1e-9))[..., None] * ways).sum(axis=1), *box
        )
    return np.asarray(np.clip(moved, *box))


def _not_seen(history: SearchHistory) -> Any:
    """Return the areas of all layers that no robot has seen, in drawing coordinates. The areas
    exclude obstacles.
    """
    import shapely

    panels, episode = history.panels, history.episode
    missed = shapely.union_all(
        [panels.shape_of(seen.uncovered, layer) for layer, seen in enumerate(episode.coverages)]
    )
    if not episode.obstacles:
        return missed
    left, _, _, top = history.extent
    rows, cols = np.nonzero(np.isin(panels.numbers, [*episode.obstacles]))
    x, y = left + cols * panels.step, top - rows * panels.step
    return missed - shapely.union_all(shapely.box(x, y - panels.step, x + panels.step, y))


def _holes_text(region: SearchRegion) -> str:
    """Return the kinds of holes in a region as text (hole, no-go zone, or both). For a region
    without holes, the text is empty.
    """
    barred = {bool(hole.intersects(region.no_go)) for hole in region.holes}
    return " or ".join(
        name for name, is_zone in (("hole", False), ("no-go zone", True)) if is_zone in barred
    )


def _draw_legend(figure: Figure, history: SearchHistory) -> None:
    from matplotlib.patches import Patch

    episode = history.episode
    handles: list[Any] = [marker("s", "start", color=MUTED, ms=8)]
    if any(history.death(robot) < inf for robot in range(history.n_robots)):
        handles.append(marker("x", "died", color=INK, ms=7, mew=2))
    if history.taken.any():
        handles.append(
            Patch(facecolor="#c9ced6", edgecolor=MUTED, lw=1.5, label="searched for another robot")
        )
    if episode.findings:
        handles.append(marker("D", "finding, and how sure", mfc="#ffd54a", mec=INK, ms=6))
    if episode.obstacles:
        handles.append(Patch(facecolor=OBSTACLE, label="obstacle, found on the way"))
    if history.panels.labels or any(
        route.long_legs(history.panels.largest).any() for route in episode.routes
    ):
        what = "way to a cell farther off" + (" or another layer" if history.panels.labels else "")
        handles.append(dashes(what, ls=(0, (3, 1.8))))
    if holes := _holes_text(episode.plan.grid.region):
        handles.append(Patch(facecolor=_OUTSIDE, edgecolor=_EDGE, lw=1.0, label=holes))
    left = _not_seen(history).area
    if left > 1e-6 * episode.plan.grid.region.area_m2:
        handles.append(Patch(facecolor=NOT_SEEN, alpha=0.55, label=f"not seen: {left:.4g} m²"))
    add_legend(figure, handles, 3 if len(handles) > 4 or figure.get_figwidth() < 6 else 4)


FIGURES = {"routes": routes_figure, "timeline": timeline_figure}


_BRIGHTEST = 0.93
"""Upper limit of the colour map viridis, whose last yellow is too pale for a thin line on white."""
_TOUR_LINES = 40_000
"""Maximum number of cells for drawing lines.

Larger tours are drawn as a picture of visiting times, because lines would merge into areas.
"""
_GROUND, _OUTSIDE_TOUR = "#ffffff", "#e3e6ea"


def tour_figure(tour: Tour) -> Figure:
    """Return a figure of a tour, coloured from dark at the first cell to bright at the last cell.

    A ring marks the first cell of the tour, and a square marks the last cell. Grid positions
    without a cell are grey. The closing edge (from the last cell to the first) is dashed, and steps
    across gaps are thin lines. For a tour of more than 40,000 cells, the figure is a picture in
    which the colour of a cell shows its position in the tour. A 3-D tour appears in perspective,
    seen from above.
    """
    metrics = tour.metrics()
    sides = " × ".join(str(side) for side in reversed(tour.shape))
    turns = f"{metrics.turns_per_cell:.2f} turns a cell, length {metrics.length:.7g}"
    title = f"{tour.name}, {sides}: {turns}"
    if len(tour.shape) == 3:
        figure = new_figure(6.4, 6.2)
        _draw_space(figure.add_subplot(projection="3d"), tour)
        figure.suptitle(title, fontsize=11, color=INK, x=0.03, ha="left", fontweight="bold")
        return figure
    height, width = tour.shape
    inches = float(np.clip(6.4 * height / width, 1.2, 8.6))
    figure = new_figure(6.4 if inches < 8.6 else max(4.2, 8.6 * width / height), inches + 0.55)
    axes = figure.add_subplot()
    if len(tour) > _TOUR_LINES:
        _draw_picture(axes, tour)
    else:
        _draw_lines(axes, tour, 72 * min(6.0 / width, inches / height))
    axes.set_axis_off()
    set_title(axes, title if figure.get_figwidth() > 6 else f"{tour.name}, {sides}")
    return figure


def _course() -> Colormap:
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    return ListedColormap(colormaps["viridis"](np.linspace(0, _BRIGHTEST, 256))).with_extremes(
        bad=_OUTSIDE_TOUR
    )


def _draw_lines(axes: Axes, tour: Tour, points: float) -> None:
    """Draw the path of a tour as lines; ``points`` is the side of a cell in points (1/72 inch)."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import ListedColormap

    height, width = tour.shape
    ground = ListedColormap([_OUTSIDE_TOUR, _GROUND])
    axes.imshow(tour.position >= 0, cmap=ground, vmin=0, vmax=1, interpolation="nearest", zorder=0)
    axes.plot(
        [-0.5, width - 0.5, width - 0.5, -0.5, -0.5],
        [-0.5, -0.5, height - 0.5, height - 0.5, -0.5],
        color=_OUTSIDE_TOUR,
        lw=1,
        zorder=1,
    )
    way = tour.cells[:, ::-1].astype(float)
    pieces, thin = _pieces(tour, way)
    thick = float(np.clip(0.22 * points, 0.6, 3.2))
    lines = LineCollection(
        list(pieces),
        cmap=_course(),
        array=np.arange(len(pieces)),
        linewidths=np.where(thin, 0.4 * thick, thick),
        capstyle="round",
        zorder=2,
    )
    axes.add_collection(lines)
    size = float(np.clip(0.55 * points, 4, 11))
    if tour.closed and len(tour) > 2:
        axes.plot(
            *way[[-1, 0]].T, "--", color=INK, lw=max(0.9, 0.5 * thick), dashes=(2.2, 1.6), zorder=3
        )
    axes.plot(*way[-1], "s", mfc="white", mec=INK, mew=1.3, ms=0.8 * size, zorder=4)
    axes.plot(*way[0], "o", mfc="white", mec=INK, mew=1.6, ms=size, zorder=4)
    axes.set_xlim(-0.8, width - 0.2)
    axes.set_ylim(height - 0.2, -0.8)


def _pieces(tour: Tour, way: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the steps from the first to the last cell of a tour, shape (N - 1, 2, dimensions), and
    a mask of steps across gaps.
    """
    return segments_of(way), tour.steps[: len(way) - 1] > 1.5


def _draw_picture(axes: Axes, tour: Tour) -> None:
    visited = np.ma.masked_less(tour.position, 0)
    interpolation = "nearest" if max(tour.shape) < 900 else "antialiased"
    image = axes.imshow(visited, cmap=_course(), interpolation=interpolation)
    bar = image.axes.figure.colorbar(image, ax=axes, shrink=0.7, pad=0.02)
    bar.outline.set_visible(False)
    bar.ax.tick_params(colors=MUTED, labelsize=8)
    bar.set_label("visited as number", color=MUTED, fontsize=9)


def _draw_space(axes: Any, tour: Tour) -> None:
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    layers, height, width = tour.shape
    way = tour.cells[:, ::-1].astype(float)
    way[:, 1] = height - 1 - way[:, 1]
    pieces, thin = _pieces(tour, way)
    thick = float(np.clip(28 / max(tour.shape), 0.3, 3.0))
    if len(pieces):  # matplotlib refuses an empty list of lines in 3-D
        axes.add_collection3d(
            Line3DCollection(
                list(pieces),
                cmap=_course(),
                array=np.arange(len(pieces)),
                linewidths=np.where(thin, 0.4 * thick, thick),
                capstyle="round",
            )
        )
    if tour.closed and len(tour) > 2:
        axes.plot(*way[[-1, 0]].T, "--", color=INK, lw=1.2)
    axes.plot(*way[-1], "s", mfc="white", mec=INK, mew=1.2, ms=6)
    axes.plot(*way[0], "o", mfc="white", mec=INK, mew=1.5, ms=7)
    axes.set(xlim=(-0.5, width - 0.5), ylim=(-0.5, height - 0.5), zlim=(-0.5, layers - 0.5))
    axes.set_box_aspect((width, height, layers), zoom=1.15)
    axes.view_init(elev=24, azim=-62)
    axes.set_axis_off()
