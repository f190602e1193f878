"""SearchProblem: everything that defines a search but its seed: region, robots, what may go wrong, what there is to find."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from shoal.checks import check_integer, check_number, check_points, check_text, shortened
from shoal.errors import InvalidInputError
from shoal.problem import Problem, option
from shoal.search.regions.builder import open_region
from shoal.search.regions.projection import LocalFrame
from shoal.search.regions.region import SearchRegion, region_of
from shoal.search.simulation.faults import Fault, check_faults, fault_text
from shoal.search.simulation.network import network_of

AUTO_TOUR, AUTO_ALLOCATION = "spanning-tree", "hop"
"""What ``auto`` chooses: the tour that exists in every region, and the allocation with the least makespan."""

LIVE_FAULTS = ("crash",)


def _check_region(value: Any) -> str | SearchRegion:
    if isinstance(value, SearchRegion):
        return value
    if isinstance(value, dict):
        return _region_from(value)
    return _check_path(value, "region", "a name, the path of a file or a SearchRegion")


def _check_path(value: Any, what: str, expected: str) -> str:
    path = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if not isinstance(path, str) or not path:
        raise InvalidInputError(f"{what}: expected {expected}, got {shortened(value)}")
    return path


def _region_from(data: dict[str, Any]) -> SearchRegion:
    """Return the region that `_dump_region` wrote."""
    if set(data) != {"name", "area", "frame"}:
        raise InvalidInputError(f"region: expected name, area and frame, got {shortened(sorted(data))}")
    frame = data["frame"]
    if frame is not None and (not isinstance(frame, list | tuple) or len(frame) != 2):
        raise InvalidInputError(f"region: frame: expected longitude and latitude, got {shortened(frame)}")
    area = _polygon_from(check_text(data["area"], what="region: area"), "region")
    return region_of(area, frame=None if frame is None else LocalFrame(*frame), name=check_text(data["name"], what="region: name"))


def _polygon_from(text: str, what: str) -> Any:
    import shapely

    try:
        return shapely.from_wkt(text)
    except shapely.errors.ShapelyError:
        raise InvalidInputError(f"{what}: expected well-known text of a polygon, got something else") from None


def _dump_region(value: str | SearchRegion) -> Any:
    if isinstance(value, str):
        return value
    import shapely

    frame = None if value.frame is None else [value.frame.longitude, value.frame.latitude]
    return {"name": value.name, "area": shapely.to_wkt(value.area, rounding_precision=-1), "frame": frame}


def _check_no_go(value: Any) -> tuple[Any, ...]:
    """Return zones as files, Shapely polygons, and points as tuples."""
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
        return _polygon_from(check_text(zone["wkt"], what=what), what)
    if isinstance(zone, str | os.PathLike):
        return _check_path(zone, what, "a file")
    try:
        return _points(zone, what)
    except InvalidInputError:
        expected = "a file, a Shapely polygon or points of shape (n, 2)"
        raise InvalidInputError(f"{what}: expected {expected}, got {shortened(zone)}") from None


def _dump_no_go(value: tuple[Any, ...]) -> list[Any]:
    import shapely

    return [{"wkt": shapely.to_wkt(zone, rounding_precision=-1)} if hasattr(zone, "geom_type") else zone for zone in value]


def _points(value: Any, what: str) -> tuple[tuple[float, float], ...]:
    return tuple((x, y) for x, y in check_points(value, what=what, dimensions=2).tolist())


def _parse_numbers(text: str) -> float | list[float]:
    """Return the number that a text of the command line says, or several with commas between."""
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        raise ValueError(f"expected numbers separated by commas, one a robot, got {text[:80]!r}") from None
    return numbers[0] if len(numbers) == 1 else numbers


def _check_footprint(value: Any) -> float | tuple[float, ...]:
    if isinstance(value, list | tuple | np.ndarray) and np.ndim(value):
        return _positive(value, "footprint")
    return check_number(value, what="footprint", above=0)


def _positive(value: Any, what: str) -> tuple[float, ...]:
    if isinstance(value, int | float | np.number):
        value = (value,)  # of one robot
    if not isinstance(value, list | tuple | np.ndarray):
        raise InvalidInputError(f"{what}: expected numbers above 0, one a robot, got {shortened(value)}")
    return tuple(check_number(one, what=what, above=0) for one in value)


def _check_starts(value: Any) -> str | tuple[tuple[float, float], ...]:
    return _check_path(value, "starts", "a layout or a file") if isinstance(value, str | os.PathLike) else _points(value, "starts")


def _parse_count_or_path(text: str) -> int | str:
    return int(text) if text.lstrip("-").isdecimal() else text


def _cells_at(what: str) -> Callable[[Any], Any]:
    """Return the check of a number of random cells, a CSV file of points, or the points themselves."""

    def check(value: Any) -> Any:
        if isinstance(value, str | os.PathLike):
            return _check_path(value, what, "a file")
        return check_integer(value, what=what, least=0) if np.ndim(value) == 0 else _points(value, what)

    return check


def _check_network(value: Any) -> str:
    text = check_text(value, what="network")
    return text if network_of(text).media else "perfect"


def _dump_faults(value: tuple[Fault, ...]) -> list[str]:
    return [fault_text(fault) for fault in value]


@dataclass(frozen=True, eq=False)
class SearchProblem(Problem):
    """Robots without a coordinator search a region.

    The fields are the options of ``shoal search``, the fields of sweeps, and those of problem files. In Python a region may also be
    a `SearchRegion`; starts, targets and obstacles may be arrays of points in metres.

    Raises
    ------
    InvalidInputError
        For a value that is not of its field's kind, and for fields that do not go together.

    Notes
    -----
    Source: paper H; docs/concepts/search.md.

    Examples
    --------
    >>> problem = SearchProblem("square:100", robots=4, loss=0.3, faults="crash:2@30")
    >>> problem.canonical()
    '{"faults":["crash:2@30"],"kind":"search","loss":0.3,"region":"square:100"}'
    >>> problem.place
    <SearchRegion 'square:100': 10000 m2, 1 parts, 0 holes>
    """

    part: ClassVar[str] = "search"
    measures: ClassVar[tuple[str, ...]] = (
        "status", "cells", "makespan", "share", "planned", "lower_bound", "sent", "lost", "takeovers",
    )  # fmt: skip

    region: Any = option(
        help="square:SIDE, rectangle:WxH, circle:RADIUS or ring:OUTERxINNER in metres, or a file: .geojson, .json, .kml, .gpkg, "
        ".shp or .csv (metres).",
        argument=True, metavar="REGION", check=_check_region, dump=_dump_region,
    )  # fmt: skip
    robots: int = option(4, help="How many there are.", least=1)
    footprint: float | tuple[float, ...] = option(
        10.0, help="Side of the square that a robot sees; where they differ, one a robot: 2,2,6.", unit="m", metavar="METRES",
        parse=_parse_numbers, check=_check_footprint,
    )  # fmt: skip
    starts: str | tuple[tuple[float, float], ...] = option(
        "random", help="random, clustered, line, or a CSV file of points, one a robot: x and y in metres, or longitude and "
        "latitude for a region on the earth.", check=_check_starts,
    )  # fmt: skip
    tour: str = option(
        "auto", help="spanning-tree, comb, hilbert-rectangle, hilbert, moore, open-hilbert or MODULE:ATTRIBUTE; auto is "
        "spanning-tree, which exists in every region.",
    )  # fmt: skip
    allocation: str = option(
        "auto", help="Who searches which part of the tour: hop, two-way, individual-shift, common-shift, stay or MODULE:ATTRIBUTE; "
        "auto is hop, the quickest.",
    )  # fmt: skip
    no_go: tuple[Any, ...] = option(
        (), help="Zones to keep out of, in the units of REGION. May be given again.", metavar="FILE", repeated=True, parse=list,
        check=_check_no_go, dump=_dump_no_go,
    )  # fmt: skip
    layer: str | None = option(None, help="Which layer of a GeoPackage; needed if it has several.")
    across_zones: bool = option(False, help="Accept a region on both sides of a border between UTM zones.")
    turn_cost: float = option(0.0, help="What a turn costs, in cells.", least=0)
    speed: float = option(1.0, help="Of a robot.", unit="m/s", above=0)
    rates: tuple[float, ...] | None = option(
        None, help="Speeds of the robots, as multiples of --speed.", metavar="R,R,...",
        parse=_parse_numbers, check=lambda value: _positive(value, "rates"),
    )  # fmt: skip
    energy: float | None = option(
        None, help="What a robot can go before it must be back at its start; by default without end.", unit="m", above=0
    )
    recharge: float = option(0.0, help="How long recharging takes there.", unit="s", least=0)
    multiplicity: int = option(1, help="How many different robots must search each cell.", least=1)
    transit: bool = option(False, help="Robots fly: they may cross what lies between the parts of a region.")
    loss: float = option(0.0, help="Probability that a message is lost.", least=0, most=1)
    network: str = option(
        "perfect",
        help="perfect, loss:P, bursts:WORSEN:MEND, range:CELLS, partition:SINCE:UNTIL, delay:MEAN, duplicates:P, corruption:P.",
        metavar="MODEL,...", check=_check_network,
    )  # fmt: skip
    faults: tuple[Fault, ...] = option(
        (), help="Robot faults: crash:R@TIME, pause:R@TIME:UNTIL, slow:R@TIME:FACTOR, battery:R:ENERGY, "
        "wrong-position:R:CELLS, liar:R, for robot R, counted from 1; times, and the energy, are those of so many cells. May be "
        "given again.", metavar="FAULT,...", repeated=True, parse=list, check=check_faults, dump=_dump_faults,
    )  # fmt: skip
    crashes: int = option(0, help="How many random robots crash at random times, which the seed draws.", least=0)
    targets: Any = option(
        0, help="Things to find: a number in random cells, or a CSV file of points.", metavar="N|FILE",
        parse=_parse_count_or_path, check=_cells_at("targets"),
    )  # fmt: skip
    detection: float = option(1.0, help="Probability that a robot finds what is in a cell.", least=0, most=1)
    false_alarm: float = option(0.0, help="Probability that it finds what is not there.", least=0, most=1)
    obstacles: Any = option(
        0, help="Cells that cannot be entered, as robots find out on the way: a number of random ones, or a CSV file of points. "
        "With any, robots go from cell to cell.", metavar="N|FILE", parse=_parse_count_or_path, check=_cells_at("obstacles"),
    )  # fmt: skip
    simulate: bool | None = option(
        None, help="Simulate robots and messages; by default if cells times robots are a million or less."
    )
    live: float | None = option(
        None, help="One process a robot over real UDP instead of a simulation, so many cells a second; a crash kills the process.",
        unit="cells/s", metavar="RATE", above=0,
    )  # fmt: skip

    def check_together(self) -> None:
        """Refuse fields that do not go together; nothing is opened yet."""
        for name in ("footprint", "rates", "starts"):
            value = getattr(self, name)
            if isinstance(value, tuple) and len(value) != self.robots:
                what = {"footprint": "one length, or {}, one a robot", "rates": "{} speeds, one a robot"}.get(
                    name, "{} points, one a robot"
                )
                raise InvalidInputError(f"{name}: expected {what.format(self.robots)}, got {len(value)}")
        for fault in self.faults:
            if fault.robot > self.robots:
                raise InvalidInputError(f"faults: expected a robot from 1 to {self.robots}, got {fault_text(fault)}")
        if self.crashes > self.robots:
            raise InvalidInputError(f"crashes: expected at most {self.robots}, one a robot, got {self.crashes}")
        if isinstance(self.region, SearchRegion) and (self.no_go or self.layer is not None or self.across_zones):
            raise InvalidInputError("region: expected a name or a file together with no_go, layer or across_zones, got an open one")
        if self.live is not None:
            if self.network != "perfect":
                raise InvalidInputError(f"live: expected no network but a share of lost messages, got {self.network!r}")
            if any(not fault_text(fault).startswith(LIVE_FAULTS) for fault in self.faults):
                raise InvalidInputError("live: expected no fault but crashes")

    @property
    def chosen_tour(self) -> str:
        """The tour that was asked for, or what ``auto`` stands for."""
        return AUTO_TOUR if self.tour == "auto" else self.tour

    @property
    def chosen_allocation(self) -> str:
        """The allocation that was asked for, or what ``auto`` stands for."""
        return AUTO_ALLOCATION if self.allocation == "auto" else self.allocation

    @property
    def stepwise(self) -> bool:
        """Whether robots go from cell to cell, as they must where they may come upon obstacles."""
        return self.obstacles not in (0, ())

    def open_place(self) -> SearchRegion:
        """Open the region."""
        if isinstance(self.region, SearchRegion):
            return self.region
        return open_region(self.region, no_go=list(self.no_go) or None, layer=self.layer, across_zones=self.across_zones)

    def place_key(self) -> str | None:
        """Return the region's name with what is cut out of it; None for one that has been opened already."""
        if isinstance(self.region, SearchRegion):
            return None
        kept = ("region", "no_go", "layer", "across_zones")
        return self.canonical(without=("kind", *(name for name in self.declarations() if name not in kept)))

    def place_is_file(self) -> bool:
        """Tell whether the region, or a zone to keep out of, is a file."""
        return any(isinstance(name, str) and os.path.exists(name) for name in (self.region, *self.no_go))

    def place_digest(self) -> bytes:
        """Return the outline."""
        return bytes(self.place.area.wkb)

    def check_at_place(self) -> None:
        """Refuse a region of several parts for robots that stay inside.

        Raises
        ------
        InvalidInputError
        """
        region: SearchRegion = self.place
        if len(region.parts) > 1 and not self.transit:
            raise InvalidInputError(
                f"region {region.name!r}: expected one part, as robots stay inside, got {len(region.parts)}; allow transit for "
                "robots that may cross what lies between, or search each part by itself"
            )
        if len(region.parts) > 1 and self.stepwise:
            raise InvalidInputError(f"obstacles: expected a region of one part, as robots go round them, got {len(region.parts)}")
