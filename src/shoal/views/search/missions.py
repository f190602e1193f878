"""The map of missions: launch and rally points, no-go zones, fence, nearest approach, and all paths in colours by altitude."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from shoal.search.missions.approach import MissionApproach
from shoal.search.missions.mission import Mission
from shoal.search.regions.region import SearchRegion
from shoal.views.drawing.charts import INK, MUTED, bare_axes, new_figure
from shoal.views.drawing.polygon_paths import path_of_rings, rings_of
from shoal.views.drawing.scale_bar import draw_scale_bar
from shoal.views.search.panels import count_text
from shoal.views.search.timeline import draw_heading

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LAYERS = ("#1f5fa8", "#d9822b", "#2a8c5a", "#8d4fb0", "#c23b58", "#6f6a1e", "#1b8a96", "#7a4a2a")
_LAND, _ZONE, _FENCE, _NEAR = "#f4f6ee", "#d81b1b", "#39424e", "#000000"
_SHADES = 0.45  # maximum difference in brightness between the robots of one layer
_PAD = 0.04  # relative to the longer side
_LONG = 0.02  # relative to all paths: level stretches whose altitude has its own colour


def missions_figure(missions: Sequence[Mission], region: SearchRegion, approach: MissionApproach | None = None) -> Figure:
    """Return a figure with the map of missions, with one colour for each altitude and one lightness for each robot.

    A triangle marks a launch point, a square marks a landing point, and a cross in a ring marks a rally point. Hatched red areas
    are no-go zones, and the dotted line is the fence. A black ring marks the nearest approach of two vehicles.

    Parameters
    ----------
    missions : sequence of Mission
        The missions to draw, with coordinates in degrees if the region is in degrees.
    region : SearchRegion
    approach : MissionApproach, optional
    """
    ways = [mission.way_in(region.frame) for mission in missions]
    circles = [mission.circle_in(region.frame) for mission in missions]
    fence = next((mission.fence for mission in missions if mission.fence is not None), None)
    rings = [] if fence is None else [ring if region.frame is None else region.frame.to_metres(ring) for ring in fence.rings[:1]]
    low, high = np.reshape(region.outline.bounds, (2, 2))
    every = np.vstack([low, high, *(way[:, :2] for way in ways), *rings, *circles])
    low, high = every.min(axis=0), every.max(axis=0)
    pad = _PAD * float((high - low).max())
    (left, bottom), (right, top) = low - pad, high + pad
    ratio = (top - bottom) / (right - left)
    width = 7.4 if ratio < 1.2 else max(4.8, 8.6 / ratio)
    figure = new_figure(width, float(np.clip((width - 0.6) * ratio, 1.6, 8.8)) + 1.5)
    axes = figure.add_subplot()
    _draw_region(axes, region)
    for ring in rings:
        axes.plot(*np.vstack([ring, ring[:1]]).T, color=_FENCE, lw=1.0, ls=(0, (1, 2)), zorder=1.5)
    levels = _main_levels(missions, ways)
    heights = sorted({*np.concatenate(levels).tolist()})
    _draw_ways(axes, missions, ways, circles, levels)
    _draw_places(axes, missions, region)
    if approach is not None:
        _draw_approach(axes, approach, right)
    axes.set(xlim=(left, right), ylim=(bottom, top))
    axes.set_xlabel("metres", color=MUTED, fontsize=8)
    bare_axes(axes)
    axes.set_title(_summary(missions), fontsize=9, color=MUTED, loc="left", parse_math=False)
    draw_heading(figure, f"{region.name}: missions")
    _draw_legend(figure, missions, region, heights, approach)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    draw_scale_bar(figure, axes, north=None if region.frame is None else 0.0)
    return figure


def _summary(missions: Sequence[Mission]) -> str:
    robots, waits = len({mission.robot for mission in missions}), max((mission.delay for mission in missions), default=0.0)
    sorties = f", {len(missions)} sorties" if len(missions) > robots else ""
    return f"{count_text(robots, 'vehicle')}{sorties}, starts within {waits:.0f} s"


def _draw_region(axes: Axes, region: SearchRegion) -> None:
    from matplotlib.patches import PathPatch

    for shape, look in (
        (region.outline, {"facecolor": _LAND, "edgecolor": INK, "lw": 1.2, "zorder": 1}),
        (region.no_go, {"facecolor": "none", "edgecolor": _ZONE, "lw": 1.0, "hatch": "////", "zorder": 1.4}),
    ):
        for part in rings_of(shape):
            axes.add_patch(PathPatch(path_of_rings(part), **look))


def _main_levels(missions: Sequence[Mission], ways: Sequence[Any]) -> list[Any]:
    """Return the altitude of each waypoint, but replace altitudes of short stretches by the nearest altitude of a long stretch."""
    levels = [np.round(mission.levels, 1) for mission in missions]
    legs = [np.hypot(*np.diff(way[2 : 2 + len(ups), :2], axis=0).T) for way, ups in zip(ways, levels, strict=True)]
    flat = [np.where(np.diff(ups) == 0, lengths, 0.0) for ups, lengths in zip(levels, legs, strict=True)]
    known, where = np.unique(np.concatenate([ups[1:] for ups in levels]), return_inverse=True)
    along = np.bincount(where, weights=np.concatenate(flat), minlength=len(known))
    main = known[along >= _LONG * max(sum(lengths.sum() for lengths in legs), 1e-9)]
    main = main if len(main) else np.unique(np.round([mission.altitude for mission in missions], 1))
    return [main[np.abs(ups[:, None] - main).argmin(axis=1)] for ups in levels]


def _draw_ways(axes: Axes, missions: Sequence[Mission], ways: Sequence[Any], circles: Sequence[Any], levels: Sequence[Any]) -> None:
    """Draw the mission paths: solid between waypoints, dashed from home and to the landing point, with circles for loitering."""
    heights = sorted({*np.concatenate(levels).tolist()})
    flying = {height: sorted({one.robot for one, ups in zip(missions, levels, strict=True) if height in ups}) for height in heights}
    for mission, way, circle, ups in zip(missions, ways, circles, levels, strict=True):
        looks = [_shade(_colour(heights, up), flying[up].index(mission.robot) / max(len(flying[up]) - 1, 1)) for up in ups.tolist()]
        axes.plot(*way[:3, :2].T, color=looks[0], lw=0.9, ls=(0, (3, 2)), zorder=2.5)
        axes.plot(*way[-3:, :2].T, color=looks[-1], lw=0.9, ls=(0, (3, 2)), zorder=2.5)
        axes.plot(*circle.T, color=looks[-1], lw=1.1, ls=(0, (5, 1.5)), zorder=2.6)
        first = int(np.allclose(way[2, :2], way[0, :2], atol=0.01))  # a first waypoint above home does not belong to the search
        borders = [first, *(np.flatnonzero(np.diff(ups[first:])) + 1 + first).tolist(), len(ups)]
        for begin, end in pairwise(borders):
            stretch, rank = way[2 + begin : 2 + end, :2], heights.index(ups[end - 1])
            under = len(heights) - 1 - rank if np.ptp(ups) else 0  # lower paths are wider, to be visible below higher ones
            look: dict[str, Any] = {"color": looks[end - 1], "lw": 1.3 + 1.6 * under, "zorder": 3 - 0.01 * under}
            axes.plot(*stretch.T, solid_joinstyle="round", **look)


def _colour(heights: list[float], height: float) -> str:
    return _LAYERS[heights.index(height) % len(_LAYERS)]


def _shade(colour: str, share: float) -> tuple[float, ...]:
    from matplotlib.colors import to_rgb

    return tuple(part + _SHADES * share * (1.0 - part) for part in to_rgb(colour))


def _draw_places(axes: Axes, missions: Sequence[Mission], region: SearchRegion) -> None:
    """Draw each launch, landing and rally point once, and beside each launch point the numbers of its robots."""
    placed = np.array if region.frame is None else region.frame.to_metres
    starts: dict[tuple[float, float], list[int]] = {}
    for mission in missions:
        starts.setdefault(mission.home, []).append(mission.robot)
    for home, robots in starts.items():
        place = placed([home])[0]
        axes.plot(*place, "^", mfc=INK, mec="white", ms=9, zorder=6)
        axes.annotate(
            _numbers(sorted({*robots})), place, xytext=(7, -9), textcoords="offset points", fontsize=7.5, color=INK, zorder=7,
            bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.8},
        )  # fmt: skip
    for end in {mission.end for mission in missions} - {*starts}:
        axes.plot(*placed([end])[0], "s", mfc=INK, mec="white", ms=7, zorder=6)
    for point in {point for mission in missions for point in mission.rally}:
        place = placed([point])[0]
        axes.plot(*place, "o", mfc="white", mec=INK, mew=1.2, ms=9, zorder=6)
        axes.plot(*place, "+", color=INK, ms=6, mew=1.2, zorder=6.1)


def _numbers(robots: list[int]) -> str:
    """Return the numbers of robots as a short text, such as 1-4, 6."""
    runs: list[list[int]] = []
    for robot in robots:
        if runs and robot == runs[-1][-1] + 1:
            runs[-1].append(robot)
        else:
            runs.append([robot])
    return ", ".join(str(run[0]) if len(run) == 1 else f"{run[0]}\N{EN DASH}{run[-1]}" for run in runs)


def _draw_approach(axes: Axes, approach: MissionApproach, right: float) -> None:
    x, y = (float(part) for part in approach.place[:2])
    axes.plot(x, y, "o", mfc="none", mec=_NEAR, mew=1.8, ms=13, zorder=8)
    left_half = x < 0.5 * (sum(axes.get_xlim()) if right == x else right + axes.dataLim.x0)
    one, other = approach.robots
    axes.annotate(
        f"{approach.horizontal:.3g} m, robots {one} and {other}, {approach.time:.0f} s", (x, y),
        xytext=(10 if left_half else -10, 11), textcoords="offset points", fontsize=7.5, color=_NEAR, zorder=9,
        ha="left" if left_half else "right", bbox={"boxstyle": "round,pad=0.2", "fc": "white", "ec": _NEAR, "lw": 0.6},
    )  # fmt: skip


def _draw_legend(
    figure: Figure, missions: Sequence[Mission], region: SearchRegion, heights: list[float], approach: MissionApproach | None
) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [Line2D([], [], color=_colour(heights, height), lw=2, label=f"at {height:g} m") for height in heights]
    handles.append(Line2D([], [], color=MUTED, lw=1.0, ls=(0, (3, 2)), label="out and home"))
    handles.append(Line2D([], [], ls="", marker="^", color=INK, ms=7, label="launch"))
    if any(mission.end != mission.home for mission in missions):
        handles.append(Line2D([], [], ls="", marker="s", color=INK, ms=6, label="landing"))
    if any(mission.loiter for mission in missions):
        handles.append(
            Line2D([], [], color=MUTED, lw=1.1, ls=(0, (5, 1.5)), marker="o", mfc="none", mew=1.1, ms=9, label="loiter circle")
        )
    if any(mission.rally for mission in missions):
        handles.append(Line2D([], [], ls="", marker="o", mfc="white", mec=INK, ms=7, label="rally point"))
    if not region.no_go.is_empty:
        handles.append(Patch(facecolor="none", edgecolor=_ZONE, hatch="////", label="no-go zone"))
    if any(mission.fence is not None for mission in missions):
        handles.append(Line2D([], [], color=_FENCE, lw=1.0, ls=(0, (1, 2)), label="fence"))
    if approach is not None:
        handles.append(Line2D([], [], ls="", marker="o", mfc="none", mec=_NEAR, mew=1.6, ms=9, label="nearest approach"))
    figure.legend(
        handles=handles, loc="outside lower center", ncols=5 if figure.get_figwidth() > 6 else 3, frameon=False, fontsize=8,
        labelcolor=INK, handletextpad=0.5, columnspacing=1.4,
    )  # fmt: skip
