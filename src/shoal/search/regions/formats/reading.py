"""What all formats of regions share: what is read, layers, and marks of zones."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import field
from typing import Any

import numpy as np

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.regions.outline import Points, RegionOutline, polygon_outlines

HIDDEN = ("use", "skip")
"""Possible meanings of a polygon that a KML file hides."""


@dataclass
class Reading:
    """How to read a region file. A reader adds the name of each choice that had an effect to
    ``effects``.

    Parameters
    ----------
    layer : str, optional
        Name of the layer of a GeoPackage, or the part of a plan of QGroundControl.
    hidden : "use" or "skip", optional
        Meaning of polygons that a KML file hides. By default, a reader refuses hidden polygons.
    closed_lines : bool
        Whether closed lines are polygons.
    effects : set of str
    """

    layer: str | None = None
    hidden: str | None = None
    closed_lines: bool = False
    effects: set[str] = field(default_factory=set)

    def is_polygon(self, points: Points) -> bool:
        """Return whether a line with the given vertices is a polygon, because it is closed and the
        user wants closed lines.
        """
        closed = self.closed_lines and len(points) > 3 and bool((points[0] == points[-1]).all())
        if closed:
            self.effects.add("closed_lines")
        return closed

    def check_effects(self, where: Iterable[str]) -> None:
        """Refuse choices without an effect on any of the files ``where``."""
        files = ", ".join(where)
        if self.closed_lines and "closed_lines" not in self.effects:
            raise InvalidInputError(
                f"--closed-lines: expected a file with a closed line, got none in {files}"
            )
        if self.hidden is not None and "hidden" not in self.effects:
            raise InvalidInputError(
                f"--hidden: expected a KML file with a hidden polygon, got none in {files}"
            )


def only_lines_text(kinds: Iterable[str], *, closed_lines: bool) -> str:
    """Return what a file without polygons contains, for error messages, with the option that reads
    closed lines as polygons.
    """
    text = "only " + " and ".join(sorted(kinds)) if kinds else "none"
    lines = any("Line" in kind for kind in kinds)
    return text + (
        "; --closed-lines reads closed lines as polygons" if lines and not closed_lines else ""
    )


def points_of(pairs: Iterable[tuple[float, float]]) -> Points:
    """Return pairs of numbers as an array; float64, shape (n, 2)."""
    return np.array([*pairs], dtype=np.float64).reshape(-1, 2)


_ZONE = r"(no[\W_]*(go|fly|entry)|nfz|exclusion|excluded?|keep[\W_]*out|restricted)([\W_]*(zone|area|polygon|region)s?)?"
_KEY = re.compile(rf"(is[\W_]*)?{_ZONE}", re.IGNORECASE)
_NAME = re.compile(rf"(?<![^\W_]){_ZONE}(?![^\W\d_])", re.IGNORECASE)
_NAMES = {
    "name",
    "title",
    "label",
    "id",
    "type",
    "kind",
    "class",
    "category",
    "zone",
    "zonetype",
    "areatype",
    "role",
    "purpose",
    "usage",
    "use",
    "status",
    "description",
    "desc",
    "comment",
}
_NO = {"", "0", "0.0", "false", "no", "n", "none", "null", "off"}


def can_mark(key: str) -> bool:
    """Return whether a property with the name ``key`` can mark a no-go zone.

    Examples
    --------
    >>> [can_mark(key) for key in ("noGo", "NO_FLY_ZONE", "exclusion", "Name", "zone_type", "height")]
    [True, True, True, True, True, False]
    """
    return _KEY.fullmatch(key.strip()) is not None or re.sub(r"[\W_]", "", key).lower() in _NAMES


def is_no_go(properties: Mapping[str, Any], *names: Any) -> bool:
    """Return whether a feature of a file is marked as a no-go zone.

    If a property such as ``no_go`` is false, the function ignores the names of the feature.

    Parameters
    ----------
    properties : mapping
        The properties of the feature by name.
    names
        Names of the feature besides those in ``properties``, such as its identifier. The function
        ignores names that are not texts.

    Examples
    --------
    >>> [is_no_go({key: value}) for key, value in (("no-go", True), ("noGo", 1), ("nofly", "yes"), ("type", "exclusion zone"))]
    [True, True, True, True]
    >>> is_no_go({}, "NFZ 3"), is_no_go({"no_go": 0}, "No-Go: pond"), is_no_go({}, "Airport no fly zone")
    (True, False, True)
    """
    marks = [
        value
        for key, value in properties.items()
        if value is not None and _KEY.fullmatch(key.strip())
    ]
    answers = [str(value).strip().lower() for value in marks]
    if answers:
        return any(value not in _NO for value in answers)
    texts = [
        (re.sub(r"[\W_]", "", key).lower(), value)
        for key, value in properties.items()
        if isinstance(value, str)
    ]
    kinds = [value for key, value in texts if key in _NAMES]
    return any(_NAME.match(value.strip()) for value in kinds) or any(
        _NAME.search(name)
        for name in (*names, *(value for key, value in texts if key == "name"))
        if isinstance(name, str)
    )


def names_no_go(name: Any) -> bool:
    """Return whether the name of a folder, a collection or a layer marks its content as no-go
    zones.

    Examples
    --------
    >>> names_no_go("No-go zones"), names_no_go("Search area and no-go zones")
    (True, False)
    """
    return isinstance(name, str) and _NAME.match(name.strip()) is not None


def layer_polygons(
    shapes: Iterable[tuple[Any, Mapping[str, Any]]],
    where: str,
    reading: Reading,
    *,
    no_go: bool = False,
) -> tuple[RegionOutline, ...]:
    """Return the polygons in the features of a layer.

    Parameters
    ----------
    shapes : iterable of (geometry, mapping)
        The features as pairs: a Shapely geometry or None, and a mapping of properties by name.
    where : str
        Name of the file or of the layer in error messages.
    reading : Reading
    no_go : bool
        Whether all polygons are no-go zones, regardless of their properties.

    Raises
    ------
    InvalidInputError
        If no feature has a polygon.
    """
    outlines: list[RegionOutline] = []
    kinds: set[str] = set()
    for number, (shape, properties) in enumerate(shapes, start=1):
        if shape is not None and not shape.is_empty:
            kinds.add(shape.geom_type)
            lines = reading.closed_lines and "LineString" in shape.geom_type
            areas = _closed_lines(shape, reading) if lines else shape
            outlines += polygon_outlines(
                areas, f"{where}: feature {number}", no_go=no_go or is_no_go(properties)
            )
    if not outlines:
        actual = only_lines_text(kinds, closed_lines=reading.closed_lines)
        raise InvalidInputError(f"{where}: expected a Polygon or MultiPolygon, got {actual}")
    return tuple(outlines)


def _closed_lines(shape: Any, reading: Reading) -> Any:
    """Return the closed lines of a Shapely geometry as polygons."""
    import shapely

    lines = [shapely.get_coordinates(line) for line in shapely.get_parts(shape)]
    return shapely.GeometryCollection(
        [shapely.Polygon(points) for points in lines if reading.is_polygon(points)]
    )
