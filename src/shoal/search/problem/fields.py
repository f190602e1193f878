"""Parsing, checking and JSON output of the fields of a search."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from shoal.core.checks import FARTHEST, check_integer, check_number, check_points, check_text, read_polygon, shortened
from shoal.core.errors import InvalidInputError
from shoal.search.flight.vehicle import Vehicle, vehicle_of
from shoal.search.problem.faults import Fault, fault_text
from shoal.search.problem.network import network_of
from shoal.search.regions.projection import LocalFrame
from shoal.search.regions.region import SearchRegion, region_of

AUTO = "auto"


def check_region(value: Any) -> str | SearchRegion:
    """Return the name or path of a region, or a region object. A region written by `dump_region` is opened."""
    if isinstance(value, SearchRegion):
        return value
    if isinstance(value, dict):
        return _region_from(value)
    return check_path(value, "region", "a name, the path of a file or a SearchRegion")


def check_path(value: Any, what: str, expected: str) -> str:
    """Return a path or a name as text."""
    path = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if not isinstance(path, str) or not path:
        raise InvalidInputError(f"{what}: expected {expected}, got {shortened(value)}")
    return path


def _region_from(data: dict[str, Any]) -> SearchRegion:
    """Return the region that `dump_region` wrote."""
    data = {"no_go": "POLYGON EMPTY", "no_go_zones": 0, "height": 0.0} | data
    if set(data) != {"name", "area", "frame", "no_go", "no_go_zones", "height"}:
        raise InvalidInputError(f"region: expected name, area and frame, got {shortened(sorted(map(str, data)))}")
    frame = data["frame"]
    if frame is not None and (not isinstance(frame, list | tuple) or len(frame) != 2):
        raise InvalidInputError(f"region: frame: expected longitude and latitude, got {shortened(frame)}")
    area, no_go = (
        read_polygon(check_text(data[name], what=f"region: {name}"), where=f"region: {name}") for name in ("area", "no_go")
    )
    count = check_integer(data["no_go_zones"], what="region: no_go_zones", least=0)
    name, place = check_text(data["name"], what="region: name"), None if frame is None else LocalFrame(*frame)
    zones = SearchRegion(no_go, place, no_go, name) if no_go.is_empty else region_of(no_go, frame=place, name=name)
    height = check_number(data["height"], what="region: height", least=0)
    return replace(region_of(area, frame=place, name=name), no_go=zones.area, no_go_zones=count, height=height)


def dump_region(value: str | SearchRegion) -> Any:
    """Return a region for JSON: its name, or well-known text with its local frame."""
    if isinstance(value, str):
        return value
    import shapely

    frame = None if value.frame is None else [value.frame.longitude, value.frame.latitude]
    area, no_go = (shapely.to_wkt(shape, rounding_precision=-1) for shape in (value.outline, value.no_go))
    told = {"name": value.name, "area": area, "frame": frame, "no_go": no_go, "no_go_zones": value.no_go_zones}
    return told | ({"height": value.height} if value.height else {})


def check_no_go(value: Any) -> tuple[Any, ...]:
    """Return no-go zones as files, Shapely polygons or tuples of points."""
    alone = isinstance(value, str | os.PathLike) or hasattr(value, "geom_type")
    if not alone and not isinstance(value, Sequence | np.ndarray):
        raise InvalidInputError(f"no_go: expected zones, got {shortened(value)}")
    if not alone and len(value) and np.ndim(value[0]) == 1 and not isinstance(value[0], str | os.PathLike):
        alone = True  # the points of one zone
    return tuple(_check_zone(zone, k) for k, zone in enumerate([value] if alone else value, start=1))


def _check_zone(zone: Any, number: int) -> Any:
    what = f"no-go zone {number}"
    if hasattr(zone, "geom_type"):
        return zone
    if isinstance(zone, dict) and set(zone) == {"wkt"}:
        return read_polygon(check_text(zone["wkt"], what=what), where=what)
    if isinstance(zone, str | os.PathLike):
        return check_path(zone, what, "a file")
    try:
        return _points(zone, what)
    except InvalidInputError:
        expected = "a file, a Shapely polygon or points of shape (n, 2)"
        raise InvalidInputError(f"{what}: expected {expected}, got {shortened(zone)}") from None


def dump_no_go(value: tuple[Any, ...]) -> list[Any]:
    """Return no-go zones for JSON."""
    import shapely

    return [{"wkt": shapely.to_wkt(zone, rounding_precision=-1)} if hasattr(zone, "geom_type") else zone for zone in value]


def _points(value: Any, what: str) -> tuple[tuple[float, float], ...]:
    return tuple((x, y) for x, y in check_points(value, what=what, dimensions=2).tolist())


def parse_numbers(text: str) -> float | list[float]:
    """Return one number, or several numbers separated by commas, from a text of the command line."""
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        raise ValueError(f"expected numbers separated by commas, one per robot, got {text[:80]!r}") from None
    return numbers[0] if len(numbers) == 1 else numbers


def check_footprint(value: Any) -> float | tuple[float, ...]:
    """Return the side of the footprint: one for all robots, or one for each robot."""
    if isinstance(value, list | tuple | np.ndarray) and np.ndim(value):
        return check_positive(value, "footprint")
    return check_number(value, what="footprint", above=0, most=FARTHEST)


def check_bands(value: Any) -> tuple[float, ...]:
    """Return altitudes in increasing order."""
    found = tuple(sorted(check_positive(value, "bands", "altitudes above 0")))
    if not found or len({*found}) < len(found):
        raise InvalidInputError(f"bands: expected one altitude or more, each once, got {shortened(value)}")
    return found


def check_vehicle(value: Any) -> Vehicle:
    """Return the vehicle that a text, a mapping of fields or a `Vehicle` describes."""
    return vehicle_of(value)


def check_positive(value: Any, what: str, kind: str = "numbers above 0, one per robot") -> tuple[float, ...]:
    """Return positive numbers."""
    if isinstance(value, int | float | np.number):
        value = (value,)  # of one robot
    if not isinstance(value, list | tuple | np.ndarray):
        raise InvalidInputError(f"{what}: expected {kind}, got {shortened(value)}")
    return tuple(check_number(one, what=what, above=0, most=FARTHEST) for one in value)


def check_delays(value: Any) -> tuple[float, ...]:
    """Return delays in seconds, one per robot."""
    if isinstance(value, str) or not isinstance(value, Sequence | np.ndarray):
        raise InvalidInputError(f"delays: expected numbers, 0 or more, one per robot, got {shortened(value)}")
    return tuple(check_number(one, what="delays", least=0) for one in value)


def parse_angle(text: str) -> float | str:
    """Return the angle in a text of the command line, or "auto"."""
    return text if text == AUTO else float(text)


def check_angle(value: Any) -> float | str | None:
    """Return an angle in degrees from 0 to below 180, "auto", or None for the region's default."""
    if isinstance(value, str):
        if value != AUTO:
            raise InvalidInputError(f"angle: expected auto or a number of degrees, got {shortened(value)}")
        return value
    return check_number(value, what="angle", least=-360, most=360) % 180.0


def check_starts(value: Any) -> str | tuple[tuple[float, float], ...]:
    """Return the name of a layout, the path of a file, or points."""
    return check_path(value, "starts", "a layout or a file") if isinstance(value, str | os.PathLike) else _points(value, "starts")


def check_places(what: str) -> Callable[[Any], Any]:
    """Return a function that checks points given as text, as a file, or as an array in metres."""

    def check(value: Any) -> Any:
        return check_path(value, what, "points or a file") if isinstance(value, str | os.PathLike) else _points(value, what)

    return check


def parse_count_or_path(text: str) -> int | str:
    """Return the number or the path in a text of the command line."""
    return int(text) if text.lstrip("-").isdecimal() else text


def check_cells_at(what: str) -> Callable[[Any], Any]:
    """Return a function that checks a number of random cells, a CSV file of points, or an array of points."""

    def check(value: Any) -> Any:
        if isinstance(value, str | os.PathLike):
            return check_path(value, what, "a file")
        return check_integer(value, what=what, least=0) if np.ndim(value) == 0 else _points(value, what)

    return check


def check_network(value: Any) -> str:
    """Return the description of a network. Different texts that describe a perfect network give the same result."""
    text = check_text(value, what="network")
    return text if network_of(text).media else "perfect"


def dump_faults(value: tuple[Fault, ...]) -> list[str]:
    """Return faults for JSON."""
    return [fault_text(fault) for fault in value]
