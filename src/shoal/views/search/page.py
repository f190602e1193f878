"""The data of a search for the player page."""

from __future__ import annotations

from base64 import b64encode
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import count_text
from shoal.core.errors import InvalidInputError
from shoal.search import SearchEpisode
from shoal.search.problem.target import Ground
from shoal.search.simulation.trace import Finding
from shoal.views.player import render
from shoal.views.search.history import RobotTrajectory, SearchHistory, sizes_text

LARGEST = 300_000
"""Maximum number of visits of cells that a page plays smoothly."""
_STEPS = 65_535  # steps of positions across the picture


def player_page(episode: SearchEpisode) -> str:
    """Return the HTML page that plays a search.

    Raises
    ------
    InvalidInputError
        If the data of the search are too large for a browser.
    """
    return render("search", page_data(episode))


def page_data(episode: SearchEpisode) -> dict[str, object]:
    """Return the data of a search for the player page, as JSON data with arrays as base64 texts of
    little-endian numbers.

    Returns
    -------
    dict
        ``title``, ``tour``, ``allocation`` and ``version`` are texts; ``seed``, ``takeovers`` and
        ``cells`` are integers; ``cellTime`` is a number of seconds. ``end`` is the time of the last
        event, in cell times. ``covered`` is the time at which the search became complete, in cell
        times, or None for an incomplete search.

        The drawing consists of rows of squares, usually one square for each cell. ``box`` holds the
        left, bottom, right and top edge of all squares together, in metres. ``shape`` holds the
        numbers of rows and columns of squares. ``size`` is the side of a square in metres.
        ``cellSize`` is a text with the sides of the cells. ``labels`` holds [text, x, y] for the
        label above each layer, if the drawing has several layers. The list ``parts`` contains the
        polygons of the region. A polygon is a list of closed lines.

        ``first`` holds the time of the first search of each searched square (float32, increasing).
        ``searched`` holds the times of the first searches of all cells, if the squares of the
        drawing are smaller than cells. For each searched square, ``by`` (uint16) holds the index of
        the searching robot, and ``where`` (uint32) holds the number row * columns + column. For
        each searched square, ``taken_over`` (uint8) states whether the square lies in the part of a
        robot other than the searching robot.

        ``robots`` holds the data of each robot. For each robot, ``times`` (float32) and ``places``
        (uint16) are the times and the corners of its path. The numbers in ``places`` are x and y in
        turn, in 65,535ths of the drawing's width and height from the lower left corner. For each
        robot, ``visits`` (float32) holds the time at which it first saw each cell that it searched.
        For each robot, ``activities`` is a list of [begin, end, kind, other], the fields of
        `shoal.views.search.history.Activity`. For each robot, ``outline`` (uint16) holds the border
        of the cells that it took over, as segments column, row, column, row. For each robot,
        ``liar`` states whether it has the fault liar.

        ``obstacles`` is a list of [row * columns + column, time of discovery] for all obstacles
        that the robots found. ``findings`` is a list of [x, y, time of the first discovery,
        confidence]. With a prior, ``heat`` (uint8, for each square) states how likely a target that
        does not move is there before the search. The looks at it change it: ``cooled`` holds times
        (float32, increasing), squares (uint32) and their new heat (uint8). ``success`` holds times
        (float32) and the probability that the target is found until then (float32).
        ``north`` is the direction of north in degrees clockwise from up, or null.
        ``circle`` is the radius, in metres, of the circles in which a fixed-wing aircraft waits, or
        0 for other vehicles.

    Raises
    ------
    InvalidInputError
        If the data of the search are too large for a browser.
    """
    history, plan = SearchHistory(episode), episode.plan
    visits = sum(len(history.seen_at(robot)) for robot in range(history.n_robots))
    if visits > LARGEST:
        raise InvalidInputError(
            f"the HTML player: expected at most {LARGEST} visits of cells, got {visits} (use .gif"
            " or .mp4)"
        )
    times, by = history.first
    order = np.argsort(times, kind="stable")[: int(np.count_nonzero(times < inf))]
    rank = np.full(history.n_cells, history.n_cells)
    rank[order] = np.arange(len(order))
    squares = history.raster(rank, history.n_cells).ravel()  # several per cell if layers differ
    where = np.argsort(squares, kind="stable")[: int(np.count_nonzero(squares < history.n_cells))]
    order = order[squares[where]]
    count = history.n_robots
    return {
        "title": f"{plan.grid.region.name}, {count_text(count, 'robot')}",
        "tour": plan.tour.name,
        "allocation": plan.allocation.allocator,
        "version": episode.versions["shoal"],
        "seed": episode.seed,
        "takeovers": episode.trace.takeovers,
        "cells": history.n_cells,
        "cellTime": float(episode.clock(1.0) - episode.clock(0.0)),
        "climb": float(episode.clock(0.0)),
        "end": history.end,
        "covered": episode.trace.covered_at if episode.trace.covered_at < inf else None,
        "box": _box(history.extent),
        "view": _box(history.sides),
        "shape": list(history.panels.shape),
        "size": history.panels.step,
        "cellSize": sizes_text(plan),
        "labels": [list(label) for label in history.panels.labels],
        "parts": [[np.round(ring, 3).tolist() for ring in rings] for rings in history.panels.parts],
        "first": _text(times[order], "<f4"),
        "searched": (
            None if history.panels.alike else _text(np.sort(times[np.isfinite(times)]), "<f4")
        ),
        "by": _text(by[order] - 1, "<u2"),
        "where": _text(where, "<u4"),
        "taken": _text(history.taken_over[order], "<u1"),
        "robots": [_robot(history, robot) for robot in range(count)],
        "obstacles": [
            [int(square), moment]
            for cell, moment in history.obstacles.items()
            for square in np.flatnonzero(history.panels.numbers.ravel() == cell)
        ],
        "findings": [
            [
                *history.place_of(finding).tolist(),
                _discovery_time(history, finding),
                finding.confidence,
            ]
            for finding in episode.findings
        ],
        "heat": _heat(history),
        "cooled": [
            _text(column, kind)
            for column, kind in zip(_heat_changes(history), ("<f4", "<u4", "<u1"), strict=True)
        ],
        "success": [_text(column, "<f4") for column in history.success],
        "north": history.north,
        "circle": history.circle,
    }


def _heat(history: SearchHistory) -> str | None:
    """Return how likely the target is in each square of the drawing, as a text of bytes; None
    without a prior, and for a target that moves.
    """
    if not isinstance(history.episode.plan.ground, Ground):
        return None
    return _text(np.rint(255 * history.raster(history.heat(-inf), 0.0)).ravel(), "<u1")


def _heat_changes(history: SearchHistory) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Return how looks change the heat of a target that does not move: times, squares of the
    drawing, and their heat from then on, up to 255.
    """
    if not isinstance(history.episode.plan.ground, Ground):
        return np.zeros(0), np.zeros(0), np.zeros(0)
    times, cells, heat = history.cooling
    # the squares of each cell, one cell after the other
    numbers = history.panels.numbers.ravel()
    squares = np.argsort(numbers, kind="stable")
    low, high = (np.searchsorted(numbers[squares], cells, side) for side in ("left", "right"))
    counts = high - low
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return (
        np.repeat(times, counts),
        squares[np.repeat(low, counts) + within],
        np.rint(255 * np.repeat(heat, counts)),
    )


def _box(sides: tuple[float, float, float, float]) -> list[float]:
    left, right, bottom, top = sides
    return [left, bottom, right, top]


def _discovery_time(history: SearchHistory, finding: Finding) -> float:
    """Return the time at which a robot first found something in the cell of ``finding``.

    An earlier search of the cell by a robot that found nothing does not count.
    """
    logs, cells_of_stops = history.logs, history.episode.visible_cells
    moments = [
        float(moment)
        for robot in finding.found_by
        for cells, moment in zip(cells_of_stops[robot - 1], logs[robot - 1].times, strict=True)
        if finding.cell in cells
    ]
    return min([history.end, *moments])


def _robot(history: SearchHistory, robot: int) -> dict[str, Any]:
    left, right, bottom, top = history.sides
    trajectory = simplify(history.trajectories[robot], 1e-4 * history.episode.plan.grid.size)
    places = np.rint((trajectory.points - (left, bottom)) / (right - left, top - bottom) * _STEPS)
    corner = history.extent[0], history.extent[3]
    sides = (history.outline(robot) - corner) / (history.panels.step, -history.panels.step)
    return {
        "times": _text(trajectory.times, "<f4"),
        "places": _text(np.clip(places, 0, _STEPS), "<u2"),
        "visits": _text(history.seen_at(robot), "<f4"),
        "activities": [
            [activity.begin, activity.end, activity.kind, activity.other]
            for activity in history.activities[robot]
        ],
        "outline": _text(np.rint(sides).reshape(-1), "<u2"),
        "liar": robot + 1 in history.liars,
    }


def simplify(trajectory: RobotTrajectory, tolerance: float) -> RobotTrajectory:
    """Return a trajectory without the points that linear interpolation reproduces within
    ``tolerance`` metres.
    """
    times, points = trajectory.times, trajectory.points
    if len(times) < 3:
        return trajectory
    spans = np.maximum(times[2:] - times[:-2], 1e-12)
    guess = points[:-2] + ((times[1:-1] - times[:-2]) / spans)[:, None] * (points[2:] - points[:-2])
    essential = np.concatenate(
        [[True], np.abs(guess - points[1:-1]).max(axis=1) > tolerance, [True]]
    )
    return RobotTrajectory(times[essential], points[essential])


def _text(values: NDArray[Any], kind: str) -> str:
    return b64encode(np.ascontiguousarray(values).astype(kind).tobytes()).decode("ascii")
