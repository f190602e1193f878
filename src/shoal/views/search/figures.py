"""Figures of a search: the routes of the robots in the search region."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_number, count_text
from shoal.core.geometry import left_of, segments_of
from shoal.search import SearchEpisode
from shoal.search.episode import duration_text
from shoal.search.regions.region import SearchRegion
from shoal.search.simulation.trace import Finding
from shoal.views.drawing.canvas import hole_in, path_of_rings, rings_of
from shoal.views.drawing.charts import (
    INK,
    MUTED,
    add_legend,
    bare_axes,
    dashes,
    draw_heading,
    draw_scale_bar,
    marker,
    new_figure,
    set_facts,
    settle_layout,
    text_size,
)
from shoal.views.search.history import SearchHistory, robot_colour, sizes_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
from shoal.views.search.success import success_figure
from shoal.views.search.timeline import timeline_figure

NOT_SEEN = "#d81b1b"
OBSTACLE = "#5b6470"
HEAT = "#e08a00"
_WARM = 0.75  # opacity of the colour of heat in the likeliest cells
_OUTSIDE, _EDGE, _LINES = "#eef0f3", "#39424e", "#e1e5ea"
_OWN, _TAKEN = 0.16, 0.36  # opacity of a robot's colour in its cells
_GRID = 3000  # number of cells up to which cell borders are drawn
_NAMED = 24  # number of findings up to which their confidences are written
_ARROWS = 14  # maximum number of arrows on a route


def routes_figure(episode: SearchEpisode, *, seconds: float | None = None) -> Figure:
    """Return a figure of a search: the region, and the path of each robot in the colour of the
    robot.

    A square with a number marks the start of a robot, or with ``seconds``, the place where it is at
    this time. A cross marks the place where a robot failed.
    A diamond marks a finding with its confidence. Each cell has the colour of the robot that
    searched the cell first. Cells that a robot searched in another robot's part are darker and have
    an outline. The path of a robot is thicker in another robot's part. Paths to distant cells are
    thin and dashed. Areas that no robot has seen in the whole search are red.

    Parameters
    ----------
    episode : SearchEpisode
    seconds : float, optional
        Time since the start of the search, in seconds, at which the figure shows it. By default,
        the figure shows the whole search.

    Raises
    ------
    InvalidInputError
        If ``seconds`` is negative or beyond the last event of the search.
    """
    history = SearchHistory(episode)
    time = inf if seconds is None else _time_at(history, seconds)
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
    _draw_ground(axes, history, time)
    for robot in range(history.n_robots):
        if time < inf:
            path = history.trajectories[robot].until(time)
            thick = float(np.clip(0.16 * side, 0.45, 1.9))
            axes.plot(*path.T, color=robot_colour(robot), lw=thick, zorder=3)
        else:
            _draw_route(axes, history, robot, side)
    if time == inf:
        _draw_not_seen(axes, history)
    _draw_findings(axes, history, time)
    axes.set(xlim=(left, right), ylim=(bottom, top))
    if history.panels.labels:
        axes.set(xticks=[], yticks=[])
    across, up = _axis_labels(history)
    axes.set_xlabel(across, color=MUTED, fontsize=text_size())
    axes.set_ylabel(up, color=MUTED, fontsize=text_size())
    bare_axes(axes)
    set_facts(axes, _summary(history, time, seconds), pad=17 if history.panels.labels else None)
    draw_heading(
        figure, axes, f"{episode.plan.grid.region.name}, {count_text(history.n_robots, 'robot')}"
    )
    _draw_legend(figure, history, time)
    # Fixes the positions of the axes, so that the numbers can be moved apart. The summary moves
    # with the axes, so that the layout leaves its place below the heading free only the second
    # time.
    settle_layout(figure, rounds=2)
    _draw_robots(axes, history, time)
    draw_scale_bar(figure, axes, north=history.north)
    return figure


def _time_at(history: SearchHistory, seconds: float) -> float:
    """Return the time of the drawing, in cell times, at a number of seconds since the start."""
    start, unit_end, end = (
        float(second) for second in history.episode.clock([0.0, 1.0, history.end])
    )
    moment = check_number(seconds, what="seconds", least=0.0, most=end)
    return max(0.0, (moment - start) / (unit_end - start))


def _axis_labels(history: SearchHistory) -> tuple[str, str]:
    """Return the labels of the x and the y axis. For panels without axes, the labels only make
    space for the scale bar.
    """
    return ("\n\n", "") if history.panels.labels else ("metres", "")


def _summary(history: SearchHistory, time: float, seconds: float | None) -> str:
    episode = history.episode
    cells = episode.plan.grid.n_cells
    if seconds is not None:
        progress = f"{history.searched(time)} of {count_text(cells, 'cell')} searched"
        return f"{progress} after {duration_text(seconds)}"
    when = (
        "not searched wholly"
        if episode.makespan is None
        else f"searched after {duration_text(episode.makespan)}"
    )
    over = f", {episode.trace.takeovers} taken over" if episode.trace.takeovers else ""
    return f"{count_text(cells, 'cell')} of {sizes_text(episode.plan)}, {when}{over}"


def _draw_ground(axes: Axes, history: SearchHistory, time: float) -> None:
    """Draw each cell in the colour of the robot that has searched it by a given time, and then the
    border and the holes of the region.
    """
    from matplotlib.collections import LineCollection
    from matplotlib.colors import to_rgb
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    left, right, bottom, top = history.extent
    picture = history.raster(cell_colours(history, time), 1.0)
    axes.imshow(picture, extent=(left, right, bottom, top), interpolation="nearest", zorder=0)
    if history.n_cells <= _GRID:
        axes.add_collection(
            LineCollection(history.panels.borders, colors=[_LINES], linewidths=0.4, zorder=0.5)
        )
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
                    Path(ring, closed=True),
                    facecolor="none",
                    edgecolor=_EDGE,
                    lw=1.2,
                    zorder=1.2,
                    clip_on=False,  # half of its width lies beyond the axes
                )
            )
    for words, x, y in history.panels.labels:
        _label(axes, words, (x, y), (0, 3), size=8)


def _even_odd(rings: Sequence[NDArray[np.float64]]) -> Any:
    """Return a path that contains the points inside an odd number of closed lines. The first line
    must enclose all other lines.
    """
    frame, *holes = rings
    return path_of_rings([frame, *(hole_in(frame, hole) for hole in holes)])


def cell_colours(history: SearchHistory, time: float = inf) -> NDArray[np.float64]:
    """Return the RGB colour of each cell at a given time, in the order of the tour; float64, shape
    (n, 3).

    An unsearched cell is white, and a discovered obstacle has the colour `OBSTACLE`. With a prior,
    cells have the colour `HEAT` where the target is likely and not found yet.
    """
    from matplotlib.colors import to_rgb

    times, by = history.first
    palette = np.array(
        [(1.0, 1.0, 1.0), *(to_rgb(robot_colour(robot)) for robot in range(history.n_robots))]
    )
    part = np.where(history.taken_over, _TAKEN, _OWN) * ((times <= time) & (by > 0))
    colours = 1.0 - _WARM * history.heat(time)[:, None] * (1.0 - np.array(to_rgb(HEAT)))
    colours -= part[:, None] * (colours - palette[by])
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
        points = history.trajectories[robot].points  # it failed before it had searched a cell
        if len(points) > 1:
            axes.plot(*points.T, color=colour, lw=0.8, ls=(0, (3, 1.8)), zorder=3)
        return
    located = history.routes.of(robot)
    points = history.on_picture(located)
    pieces = segments_of(points)
    ends = history.routes.stop_ends(robot)
    cell = np.clip(np.searchsorted(ends, np.arange(1, len(route.points))) - 1, 0, None)
    is_foreign = (history.foreign_owners(robot) > 0)[np.minimum(cell, len(ends) - 2)]
    # climbs lead from panel to panel
    far = route.long_legs(size) | (np.diff(located[:, 2:], axis=0) != 0).any(axis=1)
    thick = float(np.clip(0.16 * side, 0.45, 1.9))
    for chosen, width, style, alpha in (
        (far, 0.55 * thick, (0, (3, 1.8)), 0.75),
        (~far & ~is_foreign, thick, "solid", 1.0),
        (~far & is_foreign, 1.7 * thick, "solid", 1.0),
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


def _draw_findings(axes: Axes, history: SearchHistory, time: float) -> None:
    searched, _ = history.first
    findings = [finding for finding in history.episode.findings if searched[finding.cell] <= time]
    for finding in findings:
        place = history.place_of(finding)
        axes.plot(*place, "D", mfc="#ffd54a", mec=INK, mew=1.1, ms=6.5, zorder=6)
        if len(findings) <= _NAMED and _shared_confidence(history.episode.findings) is None:
            _label(axes, _percent(finding), place, (6, 5))


def _percent(finding: Finding) -> str:
    return f"{100 * finding.confidence:.3g} %"


def _shared_confidence(findings: Sequence[Finding]) -> str | None:
    """Return how sure findings are, if all are equally sure; the legend then says it once."""
    confidences = {_percent(finding) for finding in findings}
    return confidences.pop() if len(confidences) == 1 else None


def _label(
    axes: Axes, words: str, place: Any, offset: tuple[float, float], *, size: float = 7
) -> None:
    from matplotlib.patheffects import withStroke

    axes.annotate(
        words,
        (float(place[0]), float(place[1])),
        xytext=offset,
        textcoords="offset points",
        fontsize=text_size(size),
        color=INK,
        zorder=8,
        path_effects=[withStroke(linewidth=2, foreground="white")],
    )


def _draw_robots(axes: Axes, history: SearchHistory, time: float) -> None:
    """Draw the starts of the robots, or where they are at a given time; and the places where robots
    have failed.

    If several starts are close together, the function moves their numbers apart and connects each
    number with its start by a line. Numbers beyond the axes, where the edge of the figure could cut
    them, are moved to the edge of the axes.
    """
    places = (
        np.array([trajectory.at(time) for trajectory in history.trajectories])
        if time < inf
        else history.on_picture(history.episode.plan.places)
    )
    points_a_pixel = 72 / axes.figure.dpi
    on_paper = axes.transData.transform(places) * points_a_pixel
    small = history.n_robots > 12
    side, font = (9.5, 5.8) if small else (11.0, 7.0)
    moved = spread_out(on_paper, 1.12 * side, axes.bbox.get_points() * points_a_pixel)
    for robot, (place, place_on_paper, label_on_paper) in enumerate(
        zip(places, on_paper, moved, strict=True)
    ):
        colour = robot_colour(robot)
        label = axes.transData.inverted().transform(label_on_paper / points_a_pixel)
        if np.hypot(*(label_on_paper - place_on_paper)) > 1:
            axes.plot(*np.stack([place, label]).T, color=colour, lw=0.9, zorder=6.2)
            axes.plot(*place, "s", color=colour, ms=3, zorder=6.2)
        axes.plot(*label, "s", mfc=colour, mec="white", mew=0.9, ms=side, zorder=6.5, clip_on=False)
        x, y = (float(part) for part in label)
        axes.text(
            x,
            y,
            str(robot + 1),
            color="white",
            fontsize=text_size(font),
            fontweight="bold",
            ha="center",
            va="center_baseline",
            zorder=7,
        )
    for robot in range(history.n_robots):
        if (death := history.death(robot)) <= min(time, history.end):
            place = history.trajectories[robot].at(death)
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
        offsets = moved[:, None] - moved[None]
        apart = np.hypot(offsets[..., 0], offsets[..., 1])
        np.fill_diagonal(apart, inf)
        push = np.clip(least - apart, 0, None)
        if not (push > 0.01).any():
            break
        moved = np.clip(
            moved + 0.5 * ((push / np.maximum(apart, 1e-9))[..., None] * offsets).sum(axis=1), *box
        )
    return np.asarray(np.clip(moved, *box))


def _not_seen(history: SearchHistory) -> Any:
    """Return the areas of all layers that no robot has seen, in drawing coordinates. The areas
    exclude obstacles.
    """
    import shapely

    panels, episode = history.panels, history.episode
    missed = shapely.union_all(
        [
            panels.shape_of(coverage.uncovered, layer)
            for layer, coverage in enumerate(episode.coverages)
        ]
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


def _draw_legend(figure: Figure, history: SearchHistory, time: float) -> None:
    from matplotlib.patches import Patch

    episode, whole = history.episode, time == inf
    handles: list[Any] = [marker("s", "start" if whole else "robot", color=MUTED, ms=8)]
    if any(history.death(robot) <= min(time, history.end) for robot in range(history.n_robots)):
        handles.append(marker("x", "died", color=INK, ms=7, mew=2))
    searched, _ = history.first
    if (history.taken_over & (searched <= time)).any():
        handles.append(
            Patch(facecolor="#c9ced6", edgecolor=MUTED, lw=1.5, label="searched for another robot")
        )
    if any(searched[finding.cell] <= time for finding in episode.findings):
        sure = _shared_confidence(episode.findings)
        label = "finding, and how sure" if sure is None else f"finding, {sure} sure"
        handles.append(marker("D", label, mfc="#ffd54a", mec=INK, ms=6))
    if any(moment <= time for moment in history.obstacles.values()):
        handles.append(Patch(facecolor=OBSTACLE, label="obstacle, found on the way"))
    if whole and (
        history.panels.labels
        or any(route.long_legs(history.panels.largest).any() for route in episode.routes)
    ):
        path_label = "way to a cell farther off" + (
            " or another layer" if history.panels.labels else ""
        )
        handles.append(dashes(path_label, ls=(0, (3, 1.8))))
    if holes := _holes_text(episode.plan.grid.region):
        handles.append(Patch(facecolor=_OUTSIDE, edgecolor=_EDGE, lw=1.0, label=holes))
    missed_area = _not_seen(history).area if whole else 0.0
    if missed_area > 1e-6 * episode.plan.grid.region.area_m2:
        handles.append(
            Patch(facecolor=NOT_SEEN, alpha=0.55, label=f"not seen: {missed_area:.4g} m²")
        )
    add_legend(figure, handles, 3 if len(handles) > 4 or figure.get_figwidth() < 6 else 4)


FIGURES = {"routes": routes_figure, "timeline": timeline_figure, "success": success_figure}
