"""Answers for the studio's page Search: plans, missions, simulations, drawn regions, and the map
projection.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError, ShoalError
from shoal.search.flight.timing import turns_of
from shoal.search.planning.plan import SearchPlan, end_of, plan_search
from shoal.search.problem import SearchProblem
from shoal.search.problem.mission_options import MissionOptions
from shoal.search.regions.projection import LocalFrame
from shoal.search.regions.region import SearchRegion
from shoal.studio.answers.drawings import drawing_of, frame_of, placed_problem
from shoal.studio.folder import Folder
from shoal.studio.forms import checked_fields, checked_seed

MOST_DRAWN = 200_000
"""Maximum total number of corners in the paths that a page draws."""

_STRAIGHT = 1 - 1e-9  # cosine of the largest angle that does not count as a turn

Points = NDArray[np.float64]

_DEGREE, _REACH = (
    4,
    20_000.0,
)  # of the polynomials of `earth`, and radius in metres within which they are fitted


def plan(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return a plan: the region, the tour, and the path and time of each robot.

    All coordinates are metres from ``about["frame"]``.
    """
    problem = placed_problem(folder, about)
    region = problem.place
    canvas = _Canvas(region.frame, frame_of(about.get("frame")))
    told = _region(region, canvas)
    try:
        made = plan_search(problem, seed=checked_seed(about))
    except ShoalError as error:
        return told | {"problem": str(error)}
    allocation = made.allocation
    tour, robots = (
        _Way(_tour(made), made.altitudes),
        [_robot(made, robot, canvas) for robot in range(problem.robots)],
    )
    corners = len(tour.corners) + sum(len(way.corners) for _, way in robots)
    drawn = corners <= MOST_DRAWN
    return told | {
        "problem": None,
        "cells": made.grid.n_cells,
        "cell": made.grid.size,
        "angle": made.row_angle,
        "layers": made.altitudes,
        "tour": made.tour.name,
        "allocation": allocation.allocator,
        "compared": len(made.compared),
        "vehicle": made.vehicle.kind,
        "makespan": made.planned_seconds,
        "bound": made.seconds(allocation.lower_bound),
        "drawn": drawn,
        "closed": tour.pieces(canvas) if drawn else [],
        "robots": [
            told_robot | {"way": way.pieces(canvas) if drawn else []} for told_robot, way in robots
        ],
    }


class _Canvas:
    """The coordinates in which a page draws: metres in the region's own local frame, or in the
    frame around another position.
    """

    def __init__(self, own: LocalFrame | None, shown: LocalFrame | None) -> None:
        self.own, self.shown = own, own if shown is None or own is None else shown

    def points(self, metres: Any) -> list[Any]:
        """Convert points from metres in the region's frame to the page's coordinates, and round to
        a millimetre.
        """
        given = np.asarray(metres, dtype=np.float64).reshape(-1, 2)
        if (
            self.own is not None
            and self.shown is not None
            and self.shown != self.own
            and len(given)
        ):
            given = self.shown.to_metres(self.own.to_degrees(given))
        told: list[Any] = np.round(given, 3).tolist()
        return told


def _region(region: SearchRegion, canvas: _Canvas) -> dict[str, Any]:
    from shoal.views.drawing.canvas import rings_of

    def polygons(shape: Any) -> list[Any]:
        return [[canvas.points(ring) for ring in rings] for rings in rings_of(shape)]

    return {
        "name": region.name,
        "frame": None if canvas.shown is None else [canvas.shown.longitude, canvas.shown.latitude],
        "area": region.area_m2,
        "unseen": region.unseen_m2,
        "zones": region.no_go_zones,
        "outline": polygons(region.outline),
        "no_go": polygons(region.no_go),
        "free": polygons(region.free) if region.margin else [],
    }


def _tour(plan: SearchPlan) -> Points:
    cells = plan.tour.cells
    return plan.paths.route(np.concatenate([cells, cells[:1]])).points


class _Way:
    """The corners of a path, and the altitude layer of each corner."""

    def __init__(self, points: Points, altitudes: list[float]) -> None:
        steps = np.diff(points, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        self.length = float(lengths.sum())
        moved = lengths > 0
        points, steps = (
            points[np.concatenate([[True], moved])[: len(points)]],
            steps[moved] / lengths[moved, None],
        )
        turned = np.ones(len(points), dtype=np.bool_)
        turned[1:-1] = np.sum(steps[1:] * steps[:-1], axis=1) < _STRAIGHT
        self.corners = points[turned]
        heights = self.corners[:, 2:3] if len(altitudes) > 1 else np.zeros((len(self.corners), 1))
        self.layers = np.abs(heights - np.asarray(altitudes)).argmin(axis=1)

    def pieces(self, canvas: _Canvas) -> list[dict[str, Any]]:
        """Divide the path into pieces that each lie in one altitude layer, and return
        the pieces.
        """
        cuts = np.flatnonzero(np.diff(self.layers)) + 1
        found = zip(np.split(self.corners, cuts), np.split(self.layers, cuts), strict=True)
        return [
            {"layer": int(layer[0]), "points": canvas.points(part[:, :2])}
            for part, layer in found
            if len(part) > 1
        ]


def _robot(plan: SearchPlan, robot: int, canvas: _Canvas) -> tuple[dict[str, Any], _Way]:
    stops = plan.stops(robot)
    points = plan.route(robot, stops).points if len(stops) else np.zeros((0, 2))
    way = _Way(points, plan.altitudes)
    return {
        "place": canvas.points(plan.places[robot])[0],
        "seconds": end_of(plan.sorties[robot])
        if plan.flies
        else plan.seconds(float(plan.allocation.times[robot])),
        "stops": len(stops),
        "length": way.length,
        "turns": int(turns_of(points).sum()) if len(stops) else 0,
    }, way


def missions(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the missions of a plan: the sorties, their heights and start delays, and the nearest
    approach of two vehicles.
    """
    from shoal.views.search.mission_folder import MissionFolder

    problem = flown(placed_problem(folder, about))
    made = MissionFolder(
        Path(), problem, checked_fields(MissionOptions, about.get("missions") or {}, folder)
    )
    plan = made.planned(seed=checked_seed(about))
    told = made.report(plan)
    if made.approach is not None:
        canvas = _Canvas(plan.grid.region.frame, frame_of(about.get("frame")))
        told["nearest_approach"]["place"] = canvas.points(made.approach.place[:2])[0]
    for start, mission in zip(told["starts"], made.missions, strict=True):
        start |= {"length_m": mission.length, "items": mission.n_items}
    return told


def flown(problem: SearchProblem) -> SearchProblem:
    """Return the problem with a vehicle, because missions need one. The default is a multirotor, as
    in ``shoal search``.
    """
    return (
        problem
        if problem.vehicle is not None
        else problem.replaced(vehicle="multirotor").at_place(problem.place)
    )


def simulate(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Simulate a search, and return the data of the search for the player, without
    writing a file.
    """
    from shoal.search.run import run
    from shoal.views.search.page import page_data

    problem = placed_problem(folder, about)
    if problem.live is not None:
        raise InvalidInputError(
            "live: expected a simulated search in a preview, got a live search: run it as a job"
        )
    episode = run(problem, seed=checked_seed(about))
    return {
        "data": page_data(episode),
        "sentence": episode.sentence,
        "seen": episode.coverage.covered_fraction,
        "takeovers": episode.trace.takeovers,
        "lost": episode.trace.lost,
        "sent": episode.trace.sent,
        "makespan": episode.makespan,
    }


def draw(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Write a drawn region to a new file. Return the name of the new region file."""
    drawing = drawing_of(about.get("drawing"))
    if drawing is None:
        raise InvalidInputError("drawing: expected a region or zones, got nothing")
    drawing.placed(placed_problem(folder, about))  # reports invalid drawings immediately
    return {"file": drawing.write(folder, "drawn-region" if drawing.parts else "drawn-zones")}


def earth(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return polynomials that convert metres to degrees and back near a position, as lists of (i,
    j, coefficient, coefficient).

    An entry contains the exponents i and j, and the coefficients of x**i * y**j in two polynomials:
    the first polynomial gives the longitude or the metres to the east, and the second polynomial
    gives the latitude or the metres to the north. The variables x and y are metres divided by
    ``reach``, or degrees from the position. The polynomials differ from the map projection by at
    most 0.1 mm within 30 km of the position, and by at most 2 cm within 100 km.
    """
    frame = frame_of(about.get("frame"))
    if frame is None:
        raise InvalidInputError("place on Earth: expected longitude and latitude, got none")
    steps = np.linspace(-1.0, 1.0, 13)
    scaled = np.array([(x, y) for x in steps for y in steps])
    away = frame.to_degrees(scaled * _REACH) - (frame.longitude, frame.latitude)
    powers = [(i, j) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]

    def fitted(given: Points, wanted: Points) -> list[list[float]]:
        columns = np.stack([given[:, 0] ** i * given[:, 1] ** j for i, j in powers], axis=1)
        found = np.linalg.lstsq(columns, wanted, rcond=None)[0]
        return [[i, j, *map(float, pair)] for (i, j), pair in zip(powers, found, strict=True)]

    return {
        "frame": [frame.longitude, frame.latitude],
        "reach": _REACH,
        "degrees": fitted(scaled, away),
        "metres": fitted(away, scaled),
    }
