"""Functions that parse, check and write the fields of a `SearchProblem`."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from dataclasses import replace
from math import inf
from typing import Any

import numpy as np

from shoal.core.checks import (
    FARTHEST,
    check_bool,
    check_integer,
    check_number,
    check_points,
    check_text,
    read_polygon,
    shortened,
)
from shoal.core.errors import InvalidInputError
from shoal.search.problem.network import network_of
from shoal.search.regions.builder import list_of
from shoal.search.regions.projection import LocalFrame
from shoal.search.regions.region import SearchRegion, region_of

AUTO = "auto"


def check_region(value: Any) -> str | SearchRegion:
    """Check and return the region of a search: a name, the path of a file, or a `SearchRegion`.

    If the value is a mapping from `dump_region`, the function turns it back into a `SearchRegion`.
    """
    if isinstance(value, SearchRegion):
        return value
    if isinstance(value, dict):
        return _region_from(value)
    return check_path(value, "region", "a name, the path of a file or a SearchRegion")


def check_path(value: Any, what: str, expected: str) -> str:
    """Return a path or a name as a text. Error messages contain the field name ``what`` and the
    correct form ``expected``.
    """
    path = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if not isinstance(path, str) or not path:
        raise InvalidInputError(f"{what}: expected {expected}, got {shortened(value)}")
    return path


def _region_from(data: dict[str, Any]) -> SearchRegion:
    """Return the `SearchRegion` from which `dump_region` made the mapping ``data``."""
    data = {"no_go": "POLYGON EMPTY", "no_go_zones": 0, "height": 0.0, "barriers": []} | data
    looks, again = data.pop("looks", []), data.pop("again", False)
    if set(data) != {"name", "area", "frame", "no_go", "no_go_zones", "height", "barriers"}:
        raise InvalidInputError(
            f"region: expected name, area and frame, got {shortened(sorted(map(str, data)))}"
        )
    frame = data["frame"]
    if frame is not None and (not isinstance(frame, list | tuple) or len(frame) != 2):
        raise InvalidInputError(
            f"region: frame: expected longitude and latitude, got {shortened(frame)}"
        )
    area, no_go = (
        read_polygon(check_text(data[name], what=f"region: {name}"), where=f"region: {name}")
        for name in ("area", "no_go")
    )
    count = check_integer(data["no_go_zones"], what="region: no_go_zones", least=0)
    name, place = (
        check_text(data["name"], what="region: name"),
        None if frame is None else LocalFrame(*frame),
    )
    zones = (
        SearchRegion(no_go, place, no_go, name)
        if no_go.is_empty
        else region_of(no_go, frame=place, name=name)
    )
    height = check_number(data["height"], what="region: height", least=0)
    barriers = tuple(
        read_polygon(check_text(text, what="region: barriers"), where="region: barriers")
        for text in list_of(data["barriers"])
    )
    region = region_of(area, frame=place, name=name)
    look_shapes = tuple(
        read_polygon(check_text(text, what="region: looks"), where="region: looks")
        for text in list_of(looks)
    )
    return replace(
        region,
        no_go=zones.area,
        no_go_zones=count,
        height=height,
        barriers=barriers,
        looks=look_shapes,
        again=check_bool(again, what="region: again"),
    )


def dump_region(value: str | SearchRegion) -> Any:
    """Return a region in a form for JSON: a name or path unchanged, and a `SearchRegion` as a
    mapping with its shape and frame.
    """
    if isinstance(value, str):
        return value
    import shapely

    frame = None if value.frame is None else [value.frame.longitude, value.frame.latitude]
    area, no_go = (
        shapely.to_wkt(shape, rounding_precision=-1) for shape in (value.outline, value.no_go)
    )
    data = {
        "name": value.name,
        "area": area,
        "frame": frame,
        "no_go": no_go,
        "no_go_zones": value.no_go_zones,
    }
    if value.barriers:
        data["barriers"] = [
            shapely.to_wkt(shape, rounding_precision=-1) for shape in value.barriers
        ]
    if value.looks:
        data["looks"] = [shapely.to_wkt(shape, rounding_precision=-1) for shape in value.looks]
        data["again"] = value.again
    return data | ({"height": value.height} if value.height else {})


def check_no_go(value: Any) -> tuple[Any, ...]:
    """Check no-go zones, and return each zone as a file name, a Shapely polygon or a tuple of
    points.
    """
    return tuple(_check_zone(zone, k) for k, zone in enumerate(list_of(value), start=1))


def _check_zone(zone: Any, number: int) -> Any:
    label = f"no-go zone {number}"
    if hasattr(zone, "geom_type"):
        return zone
    if isinstance(zone, dict) and set(zone) == {"wkt"}:
        return read_polygon(check_text(zone["wkt"], what=label), where=label)
    if isinstance(zone, str | os.PathLike):
        return check_path(zone, label, "a file")
    try:
        return _points(zone, label)
    except InvalidInputError:
        expected = "a file, a Shapely polygon or points of shape (n, 2)"
        raise InvalidInputError(f"{label}: expected {expected}, got {shortened(zone)}") from None


def check_tracks(value: Any) -> tuple[Any, ...]:
    """Check tracks that were flown before, and return each as a file name or a tuple of points."""
    return tuple(
        check_path(track, "searched", "a file")
        if isinstance(track, str | os.PathLike)
        else _points(track, "searched")
        for track in list_of(value)
    )


def dump_no_go(value: tuple[Any, ...]) -> list[Any]:
    """Return no-go zones in a form for JSON, with Shapely polygons as well-known text."""
    import shapely

    return [
        {"wkt": shapely.to_wkt(zone, rounding_precision=-1)} if hasattr(zone, "geom_type") else zone
        for zone in value
    ]


def _points(value: Any, what: str) -> tuple[tuple[float, float], ...]:
    return tuple((x, y) for x, y in check_points(value, what=what, dimensions=2).tolist())


def parse_numbers(text: str) -> float | list[float]:
    """Parse comma-separated numbers from the command line. The function returns a single number as
    a float, not as a list.
    """
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        raise ValueError(
            f"expected numbers separated by commas, one per robot, got {text[:80]!r}"
        ) from None
    return numbers[0] if len(numbers) == 1 else numbers


def check_footprint(value: Any) -> float | tuple[float, ...]:
    """Check and return the side of the footprint in metres: one number for all robots, or one
    number for each robot.
    """
    if isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim):
        return check_number_list(value, "footprint", "lengths above 0, one per robot", above=0)
    return check_number(value, what="footprint", above=0, most=FARTHEST)


def check_bands(value: Any) -> tuple[float, ...]:
    """Return altitudes in metres, sorted from the lowest to the highest. The function refuses equal
    altitudes.
    """
    altitudes = tuple(sorted(check_number_list(value, "bands", "altitudes above 0", above=0)))
    if not altitudes or len({*altitudes}) < len(altitudes):
        raise InvalidInputError(
            f"bands: expected one altitude or more, each once, got {shortened(value)}"
        )
    return altitudes


def check_number_list(
    value: Any, what: str, kind: str, *, least: float = -inf, above: float = -inf
) -> tuple[float, ...]:
    """Check one or several numbers, and return them as a tuple.

    Parameters
    ----------
    value
        A number, or a list, tuple or array of numbers.
    what : str
        Name of the field in error messages.
    kind : str
        Description of the expected numbers in error messages.
    least, above : float
        Limits of the numbers. Each number must be at least ``least`` and more than ``above``.
    """
    if isinstance(value, int | float | np.number):
        value = (value,)  # a single number, for one robot
    if not isinstance(value, list | tuple) and not getattr(value, "ndim", 0):
        raise InvalidInputError(f"{what}: expected {kind}, got {shortened(value)}")
    return tuple(
        check_number(number, what=what, least=least, above=above, most=FARTHEST) for number in value
    )


def parse_angle(text: str) -> float | str:
    """Parse an angle in degrees, or the word "auto", from the command line."""
    return text if text == AUTO else float(text)


def check_angle(value: Any) -> float | str | None:
    """Return an angle in degrees reduced to the range from 0 to below 180. The function returns the
    word "auto" unchanged.
    """
    if isinstance(value, str):
        if value != AUTO:
            raise InvalidInputError(
                f"angle: expected auto or a number of degrees, got {shortened(value)}"
            )
        return value
    return check_number(value, what="angle", least=-360, most=360) % 180.0


def check_places(what: str, expected: str, *, count: bool = False) -> Callable[[Any], Any]:
    """Return a function that checks a field whose value is a text or an array of points in metres.

    Parameters
    ----------
    what : str
        Name of the field in error messages.
    expected : str
        Description of a correct text in error messages, such as "a file".
    count : bool
        Whether the field may also be a whole number: the number of random points.
    """

    def check(value: Any) -> Any:
        if isinstance(value, str | os.PathLike):
            return check_path(value, what, expected)
        is_single = not isinstance(value, list | tuple) and np.ndim(value) == 0
        return (
            check_integer(value, what=what, least=0)
            if count and is_single
            else _points(value, what)
        )

    return check


def parse_count_or_path(text: str) -> int | str:
    """Parse a whole number or a path from the command line. The function returns a path
    as a text.
    """
    return int(text) if text.lstrip("-").isdecimal() else text


def check_network(value: Any) -> str:
    """Check a text that describes a network, and return the text. A text without models becomes
    "perfect".
    """
    text = check_text(value, what="network")
    return text if network_of(text).media else "perfect"


_SHORTEST, _LONGEST = 16, 4096  # bytes


def read_key(path: str) -> bytes:
    """Read a key from a file. The function removes line ends before and after the key.

    Raises
    ------
    InvalidInputError
        If ``path`` is not a file of 16 to 4096 bytes that only its owner can read and write.
    """
    try:
        with open(
            path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)
        ) as file:
            kind = os.fstat(file.fileno())
            if not stat.S_ISREG(kind.st_mode):
                raise InvalidInputError(
                    f"{path}: expected a file with a key, got a folder or another kind of file"
                )
            if os.name == "posix" and kind.st_mode & 0o077:
                mode = stat.S_IMODE(kind.st_mode)
                raise InvalidInputError(
                    f"{path}: expected a key that only its owner can read (chmod 600), got mode"
                    f" {mode:o}"
                )
            key = file.read(_LONGEST + 3).strip(b"\r\n")
    except OSError as error:
        raise InvalidInputError(
            f"{path}: expected a readable file with a key, got the error: {error.strerror}"
        ) from None
    if not _SHORTEST <= len(key) <= _LONGEST:
        size = f"{len(key)} bytes" if len(key) <= _LONGEST else "more"
        raise InvalidInputError(
            f"{path}: expected a key of {_SHORTEST} to {_LONGEST} bytes, got {size}"
        )
    return key
