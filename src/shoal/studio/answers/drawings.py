"""Regions that a user draws: polygons and no-go zones, in metres or with a position on Earth."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_points, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.files import atomic
from shoal.search.problem import SearchProblem
from shoal.search.regions.builder import build_region
from shoal.search.regions.outline import RegionOutline, RegionOutlines, Ring
from shoal.search.regions.projection import LocalFrame
from shoal.studio.answers.shared import opened
from shoal.studio.folder import Folder
from shoal.studio.forms import checked_problem

MOST_RINGS = 1000
DIGITS = 9  # of degrees: a tenth of a millimetre

Points = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Drawing:
    """A region that the user has drawn: polygons and no-go zones.

    Parameters
    ----------
    parts, zones : tuple of ndarray of float64, shape (n, 2)
        Corners of the polygons to search (``parts``) and of the no-go zones (``zones``). The
        corners are longitude and latitude in degrees if the drawing has a frame, and metres if
        ``frame`` is None.
    frame : LocalFrame or None
        Local frame of the drawing, which converts degrees to metres. ``frame`` is None for a
        drawing without a position on Earth.
    """

    parts: tuple[Points, ...]
    zones: tuple[Points, ...]
    frame: LocalFrame | None

    def placed(self, problem: SearchProblem) -> SearchProblem:
        """Return a copy of the problem whose region is the drawn region.

        A drawing without polygons adds its no-go zones to the region of the problem.
        """
        if not self.parts:
            return problem.replaced(no_go=(*problem.no_go, *self.zones))
        rings = [(part, False, f"drawn part {k}") for k, part in enumerate(self.parts, start=1)]
        rings += [(zone, True, f"drawn zone {k}") for k, zone in enumerate(self.zones, start=1)]
        found = tuple(
            RegionOutline(Ring(points, where), no_go=no_go) for points, no_go, where in rings
        )
        outlines = RegionOutlines(
            found, "the drawing", geographic=self.frame is not None, closed=False
        )
        region = build_region(outlines, list(problem.no_go), name="drawing", inner=problem.inner)
        return problem.at_place(problem.kept_margin(region))

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
        for what, rings in (("search", self.parts), ("no-go", self.zones)):
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
                    "coordinates": [[*ring.tolist(), ring[0].tolist()]],
                },
            }
            for no_go, rings in ((False, self.parts), (True, self.zones))
            for k, ring in enumerate(rings, start=1)
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

    Raises
    ------
    InvalidInputError
    """
    if data is None:
        return None
    if not isinstance(data, list) or len(data) != 2:
        raise InvalidInputError(
            f"place on Earth: expected longitude and latitude, got {shortened(data)}"
        )
    return LocalFrame(*data)


def drawing_of(data: Any) -> Drawing | None:
    """Return the drawing that the data of a page describe, or None for an empty drawing.

    Raises
    ------
    InvalidInputError
    """
    if data is None:
        return None
    if not isinstance(data, dict):
        raise InvalidInputError(f"drawing: expected parts and zones, got {shortened(data)}")
    frame = frame_of(data.get("frame"))
    rings: dict[str, tuple[Points, ...]] = {}
    for name in ("parts", "zones"):
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
    return (
        Drawing(rings["parts"], rings["zones"], frame) if rings["parts"] or rings["zones"] else None
    )


def placed_problem(folder: Folder, about: dict[str, Any]) -> SearchProblem:
    """Return the search problem that a page describes. If the user has drawn a region, the problem
    contains the drawn region.

    Raises
    ------
    InvalidInputError, UnknownNameError
    """
    drawing = drawing_of(about.get("drawing"))
    given = about["problem"] | (
        {"region": "drawing"} if drawing is not None and drawing.parts else {}
    )
    problem = checked_problem(given, folder, part="search")
    assert isinstance(problem, SearchProblem)
    return problem.at_place(opened(problem)) if drawing is None else drawing.placed(problem)
