"""The map of missions: launch and rally points, no-go zones, fence, nearest approach, and the path
of each robot in its colour.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from shoal.core.checks import count_text
from shoal.core.geometry import unit_vectors
from shoal.missions.approach import MissionApproach
from shoal.missions.mission import Mission
from shoal.missions.rules import inside_of, search_slice
from shoal.search.episode import duration_text, starts_text
from shoal.search.regions.region import SearchRegion
from shoal.views.drawing.canvas import path_of_rings, rings_of
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
    save_figure,
    settle_layout,
)
from shoal.views.search.history import ROBOTS, robot_colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from shoal.missions import MissionCheck, MissionSet

_LAND, _HOLE, _ZONE, _FENCE, _NEAR = "#f4f6ee", "#dfe3e8", "#d81b1b", "#39424e", "#000000"
_BESIDE = 11.0  # points: distance of a label from its launch point
_FREE = 16.0  # points: places at this distance do not disturb a label
_PAD = 0.04  # relative to the longer side
_LONG = 0.02  # relative to all paths: level stretches whose altitude has its own colour


MAP = "map.png"


def save_missions_map(source: MissionSet | MissionCheck, folder: Path) -> list[Path]:
    """Write the map of a mission set, or of a check, into a folder as ``map.png``. Return the
    written files: none, if no mission can be drawn.
    """
    if not source.missions or source.region is None:
        return []
    figure = missions_figure(source.missions, source.region, source.approach)
    save_figure(figure, folder / MAP)
    return [folder / MAP]


def missions_figure(
    missions: Sequence[Mission], region: SearchRegion, approach: MissionApproach | None = None
) -> Figure:
    """Return a figure with the map of missions, in which each robot has the same colour as in the
    figure of the search.

    The legend names the colour and the altitudes of each robot, unless there are more robots than
    colours.

    A triangle marks a launch point, a square marks a landing point, and a cross in a ring marks a
    rally point. Hatched red areas are no-go zones, and the dotted line is the fence. Grey areas are
    holes of the region. A black ring marks the nearest approach of two vehicles.

    Parameters
    ----------
    missions : sequence of Mission
        The missions to draw, with coordinates in degrees if the region is in degrees.
    region : SearchRegion
    approach : MissionApproach, optional
    """
    paths = [mission.path_in(region.frame) for mission in missions]
    circles = [mission.circle_in(region.frame) for mission in missions]
    fence = next((mission.fence for mission in missions if mission.fence is not None), None)
    rings = (
        []
        if fence is None
        else [
            ring if region.frame is None else region.frame.to_metres(ring)
            for ring in fence.outlines
        ]
    )
    low, high = np.reshape(region.outline.bounds, (2, 2))
    every = np.vstack([low, high, *(path[:, :2] for path in paths), *rings, *circles])
    low, high = every.min(axis=0), every.max(axis=0)
    pad = _PAD * float((high - low).max())
    (left, bottom), (right, top) = low - pad, high + pad
    ratio = (top - bottom) / (right - left)
    width = 7.4 if ratio < 1.2 else max(4.8, 8.6 / ratio)
    figure = new_figure(width, float(np.clip((width - 0.6) * ratio, 1.6, 8.8)) + 1.65)
    axes = figure.add_subplot()
    _draw_region(axes, region)
    for ring in rings:
        axes.plot(*np.vstack([ring, ring[:1]]).T, color=_FENCE, lw=1.0, ls=(0, (1, 2)), zorder=1.5)
    levels = _main_levels(missions, paths)
    _draw_paths(axes, missions, paths, circles, levels, region)
    if approach is not None:
        _draw_approach(axes, approach)
    axes.set(xlim=(left, right), ylim=(bottom, top))
    # the empty line leaves room for the scale bar above the legend
    axes.set_xlabel("metres\n", color=MUTED, fontsize=8)
    bare_axes(axes)
    axes.set_anchor("N")
    axes.set_title(
        _summary(missions, approach), fontsize=9, color=MUTED, loc="left", parse_math=False
    )
    draw_heading(figure, axes, f"{region.name}: missions")
    _draw_legend(figure, missions, region, levels, approach)
    settle_layout(figure)
    _draw_places(axes, missions, region)
    draw_scale_bar(figure, axes, north=None if region.frame is None else 0.0)
    return figure


def _summary(missions: Sequence[Mission], approach: MissionApproach | None) -> str:
    robots = len({mission.robot for mission in missions})
    starts = starts_text(mission.start or 0.0 for mission in missions if mission.sortie == 1)
    sorties = f", {len(missions)} sorties" if len(missions) > robots else ""
    last = max((mission.start or 0.0 for mission in missions if mission.sortie > 1), default=0.0)
    last_sortie = f", last sortie at {duration_text(last)}" if last else ""
    return (
        f"{count_text(robots, 'vehicle')}{sorties}, {starts}{last_sortie}{_approach_text(approach)}"
    )


def _approach_text(approach: MissionApproach | None) -> str:
    if approach is None:
        return ""
    first, second = approach.robots
    return (
        f"\nnearest approach {approach.horizontal:.3g} m: robots {first} and {second} after"
        f" {duration_text(approach.time)}"
    )


def _draw_region(axes: Axes, region: SearchRegion) -> None:
    import shapely
    from matplotlib.patches import PathPatch

    for shape, look in (
        (region.outline, {"facecolor": _LAND, "edgecolor": INK, "lw": 1.2, "zorder": 1}),
        (
            shapely.MultiPolygon(_holes(region)),
            {"facecolor": _HOLE, "edgecolor": INK, "lw": 1.2, "zorder": 1.1},
        ),
        (
            region.no_go,
            {"facecolor": "none", "edgecolor": _ZONE, "lw": 1.0, "hatch": "////", "zorder": 1.4},
        ),
    ):
        for part in rings_of(shape):
            axes.add_patch(PathPatch(path_of_rings(part), **look))


def _holes(region: SearchRegion) -> list[Any]:
    """Return the holes of a region, without its no-go zones."""
    return [hole for hole in region.holes if not hole.intersects(region.no_go)]


def _main_levels(missions: Sequence[Mission], paths: Sequence[Any]) -> list[Any]:
    """Return the altitudes of each mission's waypoints, in metres.

    An altitude at which vehicles fly only short stretches is replaced by the nearest altitude of a
    long stretch.
    """
    levels = [np.round(mission.levels, 1) for mission in missions]
    legs = [
        np.hypot(*np.diff(path[2 : 2 + len(ups), :2], axis=0).T)
        for path, ups in zip(paths, levels, strict=True)
    ]
    flat = [
        np.where(np.diff(ups) == 0, lengths, 0.0) for ups, lengths in zip(levels, legs, strict=True)
    ]
    altitudes, where = np.unique(np.concatenate([ups[1:] for ups in levels]), return_inverse=True)
    along = np.bincount(where, weights=np.concatenate(flat), minlength=len(altitudes))
    main = altitudes[along >= _LONG * max(sum(lengths.sum() for lengths in legs), 1e-9)]
    main = main if len(main) else np.unique(np.round([mission.altitude for mission in missions], 1))
    return [main[np.abs(ups[:, None] - main).argmin(axis=1)] for ups in levels]


def _draw_paths(
    axes: Axes,
    missions: Sequence[Mission],
    paths: Sequence[Any],
    circles: Sequence[Any],
    levels: Sequence[Any],
    region: SearchRegion,
) -> None:
    """Draw the path of each mission: solid in the search itself, and dashed from home to the search
    and from the search to the end.

    Dashed circles show where vehicles loiter.
    """
    heights = sorted({*np.concatenate(levels).tolist()})
    for mission, path, circle, ups in zip(missions, paths, circles, levels, strict=True):
        colour = robot_colour(mission.robot - 1)
        searched = _search_section(mission, path, region)
        # both from home, so that equal dashes coincide
        for beside in path[: 3 + searched.start], path[: searched.stop : -1]:
            axes.plot(*beside[:, :2].T, color=colour, lw=0.9, ls=(0, (3, 2)), zorder=2.5)
        axes.plot(*circle.T, color=colour, lw=1.1, ls=(0, (5, 1.5)), zorder=2.6)
        level = ups[searched]
        borders = [0, *(np.flatnonzero(np.diff(level)) + 1).tolist(), len(level)]
        for begin, end in pairwise(borders):
            stretch, rank = path[2 + searched.start :][begin:end, :2], heights.index(level[end - 1])
            # lower paths are wider, to be visible below higher ones
            under = len(heights) - 1 - rank if np.ptp(level) else 0
            look: dict[str, Any] = {
                "color": colour,
                "lw": 1.3 + 1.6 * under,
                "zorder": 3 - 0.01 * under,
            }
            axes.plot(*stretch.T, solid_joinstyle="round", **look)


def _search_section(mission: Mission, path: Any, region: SearchRegion) -> slice:
    """Return the slice of a mission's waypoints that belong to the search.

    If a mission file does not mark these waypoints, the function derives them from the border of
    the region, as in `search_slice`.
    """
    if mission.waypoints_out is not None:
        return mission.searched
    count = len(mission.waypoints)
    over = np.vstack([path[:1], path[2 : 2 + count], path[-1:]])[:, :2]
    section = search_slice(inside_of(region, over), mission.kind)
    # a first waypoint above home
    first = section.start + int(section.start == 0 and np.allclose(over[1], over[0], atol=0.01))
    return slice(min(first, section.stop - 1), section.stop)


def _draw_places(axes: Axes, missions: Sequence[Mission], region: SearchRegion) -> None:
    """Draw each launch, landing and rally point once, and beside each launch point the numbers of
    its robots.
    """
    placed = np.array if region.frame is None else region.frame.to_metres
    starts: dict[tuple[float, float], list[int]] = {}
    for mission in missions:
        starts.setdefault(mission.home, []).append(mission.robot)
    homes = placed([*starts])
    offsets = label_offsets(axes.transData.transform(homes) * 72 / axes.figure.dpi)
    for place, offset, robots in zip(homes, offsets, starts.values(), strict=True):
        axes.plot(*place, "^", mfc=INK, mec="white", ms=9, zorder=6)
        axes.annotate(
            _numbers(sorted({*robots})),
            place,
            xytext=offset,
            textcoords="offset points",
            fontsize=7.5,
            zorder=7,
            ha="center",
            va="center",
            color=robot_colour(robots[0] - 1) if len({*robots}) == 1 else INK,
            fontweight="bold",
            bbox={"boxstyle": "round,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.8},
        )
    for end in {mission.end for mission in missions} - {*starts}:
        axes.plot(*placed([end])[0], "s", mfc=INK, mec="white", ms=7, zorder=6)
    for point in {point[:2] for mission in missions for point in mission.rally}:
        place = placed([point])[0]
        axes.plot(*place, "o", mfc="white", mec=INK, mew=1.2, ms=9, zorder=6)
        axes.plot(*place, "+", color=INK, ms=6, mew=1.2, zorder=6.1)


def label_offsets(places: Any) -> list[tuple[float, float]]:
    """Return the offset of each place's label from the place, in points (1/72 inch).

    The function chooses the direction in which the label is farthest from the nearest other place
    or label. Of equally good directions, the function prefers down, and then up.
    """
    angles = np.radians([270, 90, 180, 0, 225, 315, 135, 45])
    around = _BESIDE * unit_vectors(angles)
    points, offsets = places, []
    for number, place in enumerate(places):
        neighbours = np.delete(points, number, axis=0)
        apart = np.hypot(*np.moveaxis((place + around)[:, None] - neighbours, -1, 0)).min(
            axis=1, initial=_FREE
        )
        offsets.append(tuple(around[int(np.argmax(np.round(apart, 1)))].tolist()))
        points = np.vstack([points, place + offsets[-1]])
    return offsets


def _numbers(robots: list[int]) -> str:
    """Return the numbers of robots as a short text, such as 1-4, 6."""
    runs: list[list[int]] = []
    for robot in robots:
        if runs and robot == runs[-1][-1] + 1:
            runs[-1].append(robot)
        else:
            runs.append([robot])
    return ", ".join(
        str(run[0]) if len(run) == 1 else f"{run[0]}\N{EN DASH}{run[-1]}" for run in runs
    )


def _draw_approach(axes: Axes, approach: MissionApproach) -> None:
    axes.plot(
        *(float(part) for part in approach.place[:2]),
        "o",
        mfc="none",
        mec=_NEAR,
        mew=1.8,
        ms=13,
        zorder=8,
    )


def _heights_by_robot(missions: Sequence[Mission], levels: Sequence[Any]) -> list[tuple[int, str]]:
    """Return each robot's number and its range of altitudes as text. For more robots than colours,
    the list is empty.
    """
    heights: dict[int, set[float]] = {}
    for mission, ups in zip(missions, levels, strict=True):
        heights.setdefault(mission.robot, set()).update(ups.tolist())
    if len(heights) > len(ROBOTS):
        return []
    return [
        (robot, f"{' to '.join(f'{up:g}' for up in sorted({min(ups), max(ups)}))} m")
        for robot, ups in sorted(heights.items())
    ]


def _draw_legend(
    figure: Figure,
    missions: Sequence[Mission],
    region: SearchRegion,
    levels: Sequence[Any],
    approach: MissionApproach | None,
) -> None:
    from matplotlib.patches import Patch

    handles: list[Any] = [
        dashes(f"robot {robot} at {heights}", color=robot_colour(robot - 1), lw=2, ls="solid")
        for robot, heights in _heights_by_robot(missions, levels)
    ]
    handles += [dashes("out and home"), marker("^", "launch", color=INK, ms=7)]
    if any(mission.end != mission.home for mission in missions):
        handles.append(marker("s", "landing", color=INK, ms=6))
    if any(mission.loiter for mission in missions):
        look: dict[str, Any] = {"lw": 1.1, "ls": (0, (5, 1.5)), "marker": "o", "mfc": "none"}
        handles.append(dashes("loiter circle", **look, mew=1.1, ms=9))
    if any(mission.rally for mission in missions):
        handles.append(marker("o", "rally point", mfc="white", mec=INK, ms=7))
    if not region.no_go.is_empty:
        handles.append(Patch(facecolor="none", edgecolor=_ZONE, hatch="////", label="no-go zone"))
    if _holes(region):
        handles.append(Patch(facecolor=_HOLE, edgecolor=INK, label="hole"))
    if any(mission.fence is not None for mission in missions):
        handles.append(dashes("fence", color=_FENCE, ls=(0, (1, 2))))
    if approach is not None:
        handles.append(marker("o", "nearest approach", mfc="none", mec=_NEAR, mew=1.6, ms=9))
    add_legend(figure, handles, 4 if figure.get_figwidth() > 6 else 2)
