"""Answers for the studio's page Search: plans, missions, simulations, drawn regions, and the map
projection.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_points, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, ShoalError
from shoal.core.files import atomic
from shoal.missions.mission_set import MissionSet
from shoal.search.flight.timing import turns_of
from shoal.search.planning.plan import SearchPlan, end_of
from shoal.search.problem import SearchProblem
from shoal.search.regions.builder import build_region
from shoal.search.regions.outline import RegionOutline, RegionOutlines, Ring
from shoal.search.regions.projection import LocalFrame
from shoal.search.regions.region import SearchRegion
from shoal.studio.folder import Folder
from shoal.studio.forms import checked_problem, checked_seed, mission_options
from shoal.studio.searching import planned_search
from shoal.studio.words import fault_of

MOST_DRAWN = 200_000
"""Maximum total number of corners in the paths that a page draws."""

_STRAIGHT = 1 - 1e-9  # cosine of the largest angle that does not count as a turn

Points = NDArray[np.float64]

# of the polynomials of `earth`, and radius in metres within which they are fitted
_DEGREE = 4
_REACH = 20_000.0


def plan(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the plan that the page shows, simulates and writes: the region, the tour, the path
    and time of each robot, and a report of the missions.

    All coordinates are metres from ``about["frame"]``. Without missions, ``refused`` says why.
    """
    problem, options = placed_problem(folder, about), mission_options(about, folder)
    region = problem.place
    canvas = _Canvas(region.frame, frame_of(about.get("frame")))
    answer = _region(region, canvas)
    try:
        found = planned_search(problem, options, seed=checked_seed(about))
    except ShoalError as error:
        return answer | {"problem": fault_of(error, about)}
    made, problem = found.plan, found.problem
    answer |= _region(made.grid.region, canvas)
    allocation = made.allocation
    robots = [_robot(made, robot, canvas) for robot in range(problem.robots)]
    corners = sum(len(path.corners) for _, path in robots)
    drawn = corners <= MOST_DRAWN
    return answer | {
        "problem": None,
        "chosen": {
            "tour": made.tour.name,
            "allocation": allocation.allocator,
            "angle": f"{made.row_angle:.4g}",
            "margin": f"{made.grid.region.margin:.4g}",
            "cross_track": f"{problem.cross_track or 0.0:.4g}",
            "footprint": f"{np.min(problem.view):.4g}",
        },
        "cells": made.grid.n_cells,
        "cell": made.grid.size,
        "angle": made.row_angle,
        "layers": made.altitudes,
        "tour": made.tour.name,
        "allocation": allocation.allocator,
        "compared": len(made.compared),
        "vehicle": made.vehicle.preset if made.flies else None,
        "missions": None if found.missions is None else _missions(found.missions, canvas),
        "refused": None if found.refusal is None else str(found.refusal),
        "makespan": made.planned_seconds,
        "bound": made.least_seconds,
        "drawn": drawn,
        "robots": [
            robot_answer | {"way": path.pieces(canvas) if drawn else []}
            for robot_answer, path in robots
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
        answer: list[Any] = np.round(given, 3).tolist()
        return answer


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


class _Path:
    """The corners of a path, and the altitude layer of each corner."""

    def __init__(self, points: Points, altitudes: list[float]) -> None:
        steps = np.diff(points, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        self.length = float(lengths.sum())
        moved = lengths > 0
        points = points[np.concatenate([[True], moved])[: len(points)]]
        steps = steps[moved] / lengths[moved, None]
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


def _robot(plan: SearchPlan, robot: int, canvas: _Canvas) -> tuple[dict[str, Any], _Path]:
    stops = plan.stops(robot)
    points = plan.route(robot, stops).points if len(stops) else np.zeros((0, 2))
    path = _Path(points, plan.altitudes)
    return {
        "place": canvas.points(plan.places[robot])[0],
        "seconds": end_of(plan.sorties[robot])
        if plan.flies
        else plan.seconds(float(plan.allocation.times[robot])),
        "stops": len(stops),
        "length": path.length,
        "turns": int(turns_of(points).sum()) if len(stops) else 0,
    }, path


def _missions(missions: MissionSet, canvas: _Canvas) -> dict[str, Any]:
    """Return the report of missions: the sorties, their heights and start times, and the nearest
    approach of two vehicles.
    """
    answer = missions.report()
    if missions.approach is not None:
        answer["nearest_approach"]["place"] = canvas.points(missions.approach.place[:2])[0]
    for start, mission in zip(answer["starts"], missions.missions, strict=True):
        start |= {"length_m": mission.length, "items": mission.n_items}
    return answer


def simulate(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Simulate a search, and return the data of the search for the player, without
    writing a file.
    """
    from shoal.views.search.page import page_data

    problem = placed_problem(folder, about)
    if problem.live is not None:
        raise InvalidInputError(
            "live: expected a simulated search in a preview, got a live search: run it as a job"
        )
    seed = checked_seed(about)
    episode = planned_search(problem, mission_options(about, folder), seed=seed).run(seed=seed)
    return {
        "data": page_data(episode),
        "sentence": episode.sentence,
        "seen": episode.coverage.covered_fraction,
        "takeovers": episode.trace.takeovers,
        "lost": episode.trace.lost,
        "sent": episode.trace.sent,
        "makespan": episode.makespan,
    }


def outlines(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the region of a page as a drawing, whose corners can be moved."""
    return drawing_in(placed_problem(folder, about).place, frame_of(about.get("frame")))


def draw(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Write a drawn region to a new file. Return the name of the new region file."""
    drawing = drawing_of(about.get("drawing"), unite=about["problem"].get("inner") is None)
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
        solution = np.linalg.lstsq(columns, wanted, rcond=None)[0]
        return [[i, j, *map(float, pair)] for (i, j), pair in zip(powers, solution, strict=True)]

    return {
        "frame": [frame.longitude, frame.latitude],
        "reach": _REACH,
        "degrees": fitted(scaled, away),
        "metres": fitted(away, scaled),
    }


# ---- regions that a user draws ----

MOST_RINGS = 1000
DIGITS = 9  # of degrees: a tenth of a millimetre


@dataclass(frozen=True, eq=False)
class Drawing:
    """A region that the user has drawn: polygons with holes, and no-go zones.

    Parameters
    ----------
    parts, holes, zones : tuple of ndarray of float64, shape (n, 2)
        Corners of the polygons to search (``parts``), of their holes and of the no-go zones
        (``zones``). The corners are longitude and latitude in degrees if the drawing has a frame,
        and metres if ``frame`` is None.
    frame : LocalFrame or None
        Local frame of the drawing, which converts degrees to metres. ``frame`` is None for a
        drawing without a position on Earth.
    """

    parts: tuple[Points, ...]
    holes: tuple[Points, ...]
    zones: tuple[Points, ...]
    frame: LocalFrame | None

    def outlines(self) -> list[list[Points]]:
        """Return each polygon with its holes: those that lie in it. The first one has those that
        lie in none, too, so that the checks of a region say so.
        """
        import shapely

        found = [[part] for part in self.parts]
        shells = [shapely.Polygon(part) for part in self.parts if len(part) > 2]
        for hole in self.holes:
            middle = shapely.points(hole.mean(axis=0))
            apart = [shell.distance(middle) for shell in shells]
            found[int(np.argmin(apart)) if len(shells) == len(found) else 0].append(hole)
        return found

    def placed(self, problem: SearchProblem) -> SearchProblem:
        """Return a copy of the problem whose region is the drawn region.

        A drawing without polygons adds its no-go zones to the region of the problem.
        """
        if not self.parts:
            return problem.replaced(no_go=(*problem.no_go, *self.zones))
        found = [
            RegionOutline(
                Ring(part, f"drawn part {k}"),
                tuple(Ring(hole, f"a drawn hole of part {k}") for hole in holes),
            )
            for k, (part, *holes) in enumerate(self.outlines(), start=1)
        ]
        found += [
            RegionOutline(Ring(zone, f"drawn zone {k}"), no_go=True)
            for k, zone in enumerate(self.zones, start=1)
        ]
        outlines = RegionOutlines(
            tuple(found), "the drawing", geographic=self.frame is not None, closed=False
        )
        region = build_region(outlines, list(problem.no_go), name="drawing", inner=problem.inner)
        return problem.at_place(problem.with_own_margin(region))

    def write(self, folder: Folder, stem: str) -> str:
        """Write the drawn polygons and no-go zones to a new GeoJSON file (CSV for a drawing in
        metres), and return its name.
        """
        suffix = ".csv" if self.frame is None else ".geojson"
        name = folder.new_name(stem, suffix)
        with atomic(folder.path(name)) as temporary:
            temporary.write_text(
                self._table() if self.frame is None else self._features(), encoding="utf-8"
            )
        return name

    def _table(self) -> str:
        rows = ["x_m,y_m,ring"]
        # a ring in another one is its hole
        for what, rings in (("search", self.parts), ("hole", self.holes), ("no-go", self.zones)):
            rows += [
                f"{x!r},{y!r},{what} {k}"
                for k, ring in enumerate(rings, start=1)
                for x, y in ring.tolist()
            ]
        return "\n".join(rows) + "\n"

    def _features(self) -> str:
        features = [
            {
                "type": "Feature",
                "properties": {
                    "name": f"{'no-go zone' if no_go else 'search'} {k}",
                    "no_go": no_go,
                },
                "geometry": {
                    "type": "Polygon",
                    "coordinates": [[*ring.tolist(), ring[0].tolist()] for ring in rings],
                },
            }
            for no_go, outlines in ((False, self.outlines()), (True, [[z] for z in self.zones]))
            for k, rings in enumerate(outlines, start=1)
        ]
        return (
            json.dumps(
                {"type": "FeatureCollection", "features": features}, indent=1, allow_nan=False
            )
            + "\n"
        )


def frame_of(data: Any) -> LocalFrame | None:
    """Return the local frame around a longitude and latitude in degrees, or None if ``data`` is
    None.
    """
    if data is None:
        return None
    if not isinstance(data, list) or len(data) != 2:
        raise InvalidInputError(
            f"place on Earth: expected longitude and latitude, got {shortened(data)}"
        )
    return LocalFrame(*data)


def drawing_of(data: Any, *, unite: bool = True) -> Drawing | None:
    """Return the drawing that the data of a page describe, or None for an empty drawing.

    With ``unite``, polygons of which one lies in another are one polygon: all are drawn to be
    searched.
    """
    if data is None:
        return None
    if not isinstance(data, dict):
        raise InvalidInputError(f"drawing: expected parts and zones, got {shortened(data)}")
    if unknown := data.keys() - {"parts", "holes", "zones", "frame"}:
        raise InvalidInputError(
            f"drawing: expected parts, holes, zones and frame, got {shortened(min(unknown))}"
        )
    frame = frame_of(data.get("frame"))
    rings: dict[str, tuple[Points, ...]] = {}
    for name in ("parts", "holes", "zones"):
        given = data.get(name, [])
        if not isinstance(given, list) or len(given) > MOST_RINGS:
            raise InvalidInputError(
                f"drawing: {name}: expected at most {MOST_RINGS} lists of points, got"
                f" {shortened(given)}"
            )
        points = [
            np.round(check_points(one, what=f"drawing: {name}", dimensions=2), 3) for one in given
        ]
        rings[name] = tuple(
            one if frame is None else np.round(frame.to_degrees(one), DIGITS) for one in points
        )
    if not rings["parts"] and not rings["zones"]:
        return None
    parts, holes = _united(rings["parts"]) if unite else (rings["parts"], ())
    return Drawing(parts, (*rings["holes"], *holes), rings["zones"], frame)


def _united(parts: tuple[Points, ...]) -> tuple[tuple[Points, ...], tuple[Points, ...]]:
    """Return the outlines and the holes of polygons together, if one of them lies mostly in another
    one, and otherwise the polygons as they are.
    """
    import shapely

    if len(parts) < 2 or any(len(part) < 3 for part in parts):
        return parts, ()
    polygons = shapely.polygons([shapely.linearrings(part) for part in parts])
    if not shapely.is_valid(polygons).all():
        return parts, ()  # the checks of a region say what is wrong
    first, second = shapely.STRtree(polygons).query(polygons, predicate="intersects")
    smaller = np.minimum(shapely.area(polygons[first]), shapely.area(polygons[second]))
    shared = shapely.area(shapely.intersection(polygons[first], polygons[second]))
    if not ((first != second) & (shared > smaller / 2)).any():
        return parts, ()
    rings = [
        [np.round(shapely.get_coordinates(ring)[:-1], DIGITS) for ring in shapely.get_rings(part)]
        for part in shapely.get_parts(shapely.union_all(polygons))
    ]
    return tuple(shell for shell, *_ in rings), tuple(hole for _, *own in rings for hole in own)


def drawing_in(region: SearchRegion, frame: LocalFrame | None = None) -> dict[str, Any]:
    """Return a region as the drawing of a page: what `drawing_of` reads, in metres from ``frame``,
    by default that of the region. A zone in a polygon, which is a hole of the polygon too, is a
    zone.

    Polygons that a fence adds to the zones are not drawn: missions add them again.
    """
    import shapely

    from shoal.views.drawing.canvas import rings_of

    if region.height:
        raise InvalidInputError(
            "region: expected a region that a page can draw, got one with a height"
        )

    def shows(shape: Any) -> bool:
        return bool(shape.area > _LEAST)

    outlines = [rings for rings in rings_of(region.outline) if shows(shapely.Polygon(rings[0]))]
    holes = [hole for _, *own in outlines for hole in own]
    drawn = {
        "parts": [shell for shell, *_ in outlines],
        "holes": [
            hole for hole in holes if shows(shapely.difference(shapely.Polygon(hole), region.no_go))
        ],
        "zones": [rings[0] for rings in rings_of(region.no_go)],
    }
    canvas = _Canvas(region.frame, frame)
    return {
        "frame": canvas.shown and [canvas.shown.longitude, canvas.shown.latitude],
        **{kind: [canvas.points(ring[:-1]) for ring in rings] for kind, rings in drawn.items()},
    }


_LEAST = 0.01  # square metres: a smaller polygon is what rounding left of another one


def placed_problem(folder: Folder, about: dict[str, Any]) -> SearchProblem:
    """Return the search problem that a page describes. If the user has drawn a region, the problem
    contains the drawn region.
    """
    # a page that says what inner polygons mean is taken at its word
    drawing = drawing_of(about.get("drawing"), unite=about["problem"].get("inner") is None)
    given = about["problem"] | (
        {"region": "drawing"} if drawing is not None and drawing.parts else {}
    )
    problem = checked_problem(given, folder, part="search")
    assert isinstance(problem, SearchProblem)
    return problem.opened() if drawing is None else drawing.placed(problem)
