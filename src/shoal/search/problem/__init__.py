"""SearchProblem: everything that defines a search but its seed: region, robots, what may go wrong, what there is to find."""

from __future__ import annotations

import os
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from shoal.dataclass import dataclass
from shoal.errors import InvalidInputError
from shoal.problem import Problem, option
from shoal.search.flight.vehicle import Vehicle, vehicle_of
from shoal.search.problem.faults import Fault, check_faults, fault_text
from shoal.search.problem.fields import (
    AUTO,
    check_angle,
    check_bands,
    check_cells_at,
    check_delays,
    check_footprint,
    check_network,
    check_no_go,
    check_path,
    check_places,
    check_positive,
    check_region,
    check_starts,
    check_vehicle,
    dump_faults,
    dump_no_go,
    dump_region,
    parse_angle,
    parse_count_or_path,
    parse_numbers,
)
from shoal.search.regions.builder import INNER, open_region
from shoal.search.regions.margin import with_margin
from shoal.search.regions.region import SearchRegion

AUTO_TOUR = "spanning-tree"
"""What ``auto`` is where nothing is compared: the tour with the shortest way in every region."""

AUTO_TOURS = ("boustrophedon", "spanning-tree")
"""What ``auto`` chooses from where turns count, or the angle is chosen."""

FOOTPRINT = 10.0
"""Metres: the side of what a robot sees of which nothing is said."""

MOST_ROBOTS = 1000
"""Robots of a search: sharing a tour takes memory for each pair of them."""

LIVE_FAULTS = ("crash", "slow")

TOURS = ("spanning-tree", "boustrophedon", "comb", "hilbert-rectangle", "hilbert", "moore", "open-hilbert")
ALLOCATIONS = ("hop", "two-way", "individual-shift", "common-shift", "stay")


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
        help="square:SIDE, rectangle:WxH, circle:RADIUS, ring:OUTERxINNER or box:WxDxH, a volume, in metres, or a file: .geojson, "
        ".json, .kml, .gpkg, .kmz, .shp, .zip (a Shapefile) or .csv (metres).",
        argument=True, metavar="REGION", check=check_region, dump=dump_region,
    )  # fmt: skip
    robots: int = option(4, help="How many there are.", least=1, most=MOST_ROBOTS)
    footprint: float | tuple[float, ...] | None = option(
        None, help="Side of the square that a robot sees; where they differ, one a robot: 2,2,6. By default what the vehicle's "
        "camera or detector sees, or 10.", unit="m", metavar="METRES", parse=parse_numbers, check=check_footprint,
    )  # fmt: skip
    bands: tuple[float, ...] | None = option(
        None, help="Altitudes at which all is searched, one tour through all of them. By default the vehicle's; of a box those of "
        "as many layers as footprints are needed from the ground to the top.", unit="m", metavar="H,H,...", parse=parse_numbers,
        check=check_bands,
    )  # fmt: skip
    passes: int = option(
        1, help="How often all is searched, by any robots. Rows of every other pass are turned by 90 degrees.", least=1, most=100
    )
    starts: str | tuple[tuple[float, float], ...] = option(
        "random", help="random, clustered, line, or a CSV file of points, one a robot: x and y in metres, or longitude and "
        "latitude for a region on the earth.", check=check_starts,
    )  # fmt: skip
    launch: str | tuple[tuple[float, float], ...] | None = option(
        None, help="Where robots set out, anywhere, instead of --starts: x,y in metres, or longitude,latitude for a region on the "
        "earth, one for all or with semicolons one a robot; or a CSV or GeoJSON file of points or of a line, a road, along which "
        "they space themselves.", metavar="POINTS|FILE", check=check_places("launch"),
    )  # fmt: skip
    land: str | tuple[tuple[float, float], ...] | None = option(
        None,
        help="Where missions end, as --launch; by default where they begin.",
        metavar="POINTS|FILE",
        check=check_places("land"),
    )
    delays: tuple[float, ...] | None = option(
        None, help="How long after the first each robot sets out; those that keep missions apart if these are written.", unit="s",
        metavar="S,S,...", parse=parse_numbers, check=check_delays,
    )  # fmt: skip
    tour: str = option(
        "auto", help=f"{', '.join(TOURS)} or MODULE:ATTRIBUTE; auto is spanning-tree, or where turns take time or the angle is "
        "chosen the sooner one of boustrophedon and spanning-tree.", names=TOURS,
    )  # fmt: skip
    allocation: str = option(
        "auto", help=f"Who searches which part of the tour: {', '.join(ALLOCATIONS)} or MODULE:ATTRIBUTE; "
        "auto is the one that is done first, flights home to recharge included; hop for more than 100,000 cells times robots.",
        names=ALLOCATIONS,
    )  # fmt: skip
    angle: float | str | None = option(
        None, help="Of the rows of cells, counter-clockwise from east. auto takes the angle, the shift of the rows and, where "
        "--tour is auto, the tour that is soonest once round, turns included; where turns cost "
        "nothing, one counts as a cell. By default auto for a region on the earth, else 0.", unit="degrees",
        metavar="DEGREES|auto", parse=parse_angle, check=check_angle,
    )  # fmt: skip
    no_go: tuple[Any, ...] = option(
        (), help="Zones to keep out of, in the units of REGION. May be given again.", metavar="FILE", repeated=True, parse=list,
        check=check_no_go, dump=dump_no_go,
    )  # fmt: skip
    margin: float = option(
        0.0, help="How far robots keep from the border of the region and from no-go zones, on all of their ways in it.", unit="m",
        least=0,
    )  # fmt: skip
    layer: str | None = option(None, help="Which layer of a GeoPackage; needed if it has several.")
    inner: str | None = option(
        None, help="What a polygon is that lies in another one and is not marked as a no-go zone: no-go or search. A file with "
        "one is refused if this is not said.", choices=INNER,
    )  # fmt: skip
    across_zones: bool = option(False, help="Accept a region on both sides of a border between UTM zones.")
    vehicle: Vehicle | str | None = option(
        None, help="What searches: multirotor, fixed-wing, rover, ideal (1 m/s, turns that take no time, no battery), or a file "
        ".toml or .json, and what differs from it: rover,cruise_speed=2. By default ideal, with missions multirotor.",
        metavar="NAME|FILE[,FIELD=VALUE...]", check=check_vehicle, dump=Vehicle.to_dict,
    )  # fmt: skip
    rates: tuple[float, ...] | None = option(
        None, help="Speeds of the robots, as multiples of the vehicle's.", metavar="R,R,...",
        parse=parse_numbers, check=lambda value: check_positive(value, "rates"),
    )  # fmt: skip
    multiplicity: int = option(1, help="How many different robots must search each cell.", least=1)
    transit: bool = option(False, help="Robots fly: they may cross what lies between the parts of a region.")
    loss: float = option(0.0, help="Probability that a message is lost.", least=0, most=1)
    network: str = option(
        "perfect",
        help="perfect, loss:P, bursts:WORSEN:MEND, range:CELLS, partition:SINCE:UNTIL, delay:MEAN, duplicates:P, corruption:P, "
        "replays:P, forgeries:P (with --key).",
        metavar="MODEL,...", check=check_network,
    )  # fmt: skip
    key: str | None = option(
        None, help="File with the secret by which robots sign their messages, at least 16 bytes that only its owner can read; "
        "messages that are not signed so, and those that were heard before, are refused.", metavar="FILE",
        check=lambda value: check_path(value, "key", "the path of a file"),
    )  # fmt: skip
    packet: int | None = option(
        None, help="How long a message may be; longer ones go in several, each of use without the others.", unit="bytes", least=64,
        most=65_507,
    )  # fmt: skip
    faults: tuple[Fault, ...] = option(
        (), help="Robot faults: crash:R@TIME, pause:R@TIME:UNTIL, slow:R@TIME:FACTOR, battery:R:ENERGY, "
        "wrong-position:R:CELLS, liar:R, for robot R, counted from 1; times, and the energy, are those of so many cells. May be "
        "given again.", metavar="FAULT,...", repeated=True, parse=list, check=check_faults, dump=dump_faults,
    )  # fmt: skip
    crashes: int = option(0, help="How many random robots crash at random times, which the seed draws.", least=0)
    targets: Any = option(
        0, help="Things to find: a number in random cells, or a CSV file of points.", metavar="N|FILE",
        parse=parse_count_or_path, check=check_cells_at("targets"),
    )  # fmt: skip
    detection: float = option(1.0, help="Probability that a robot finds what is in a cell.", least=0, most=1)
    false_alarm: float = option(0.0, help="Probability that it finds what is not there.", least=0, most=1)
    obstacles: Any = option(
        0, help="Cells that cannot be entered, as robots find out on the way: a number of random ones, or a CSV file of points. "
        "With any, robots go from cell to cell.", metavar="N|FILE", parse=parse_count_or_path, check=check_cells_at("obstacles"),
    )  # fmt: skip
    simulate: bool | None = option(
        None, help="Simulate robots and messages; by default if cells times robots are a million or less, and robots 126 or less."
    )
    live: float | None = option(
        None, help="One process a robot over real UDP instead of a simulation, so many cells a second; a crash kills the process.",
        unit="cells/s", metavar="RATE", above=0,
    )  # fmt: skip

    def check_together(self) -> None:
        """Refuse fields that do not go together; nothing is opened yet."""
        for name in ("footprint", "rates", "starts", "delays"):
            value = getattr(self, name)
            if isinstance(value, tuple) and len(value) != self.robots:
                what = {"footprint": "one length, or {}", "rates": "{} speeds", "delays": "{} times"}.get(
                    name, "{} points"
                ) + ", one a robot"
                raise InvalidInputError(f"{name}: expected {what.format(self.robots)}, got {len(value)}")
        for fault in self.faults:
            if fault.robot > self.robots:
                raise InvalidInputError(f"faults: expected a robot from 1 to {self.robots}, got {fault_text(fault)}")
        if self.multiplicity > self.robots:
            raise InvalidInputError(f"multiplicity: expected at most {self.robots}, as there are robots, got {self.multiplicity}")
        if (self.bands or self._volume) and self._asked_vehicle.kind == "rover":
            raise InvalidInputError("vehicle: expected one that flies for bands or a box, got a rover")
        if self.has_layers and self.stepwise:
            raise InvalidInputError("obstacles: expected none where several layers or passes are searched, got some")
        if self.crashes > self.robots:
            raise InvalidInputError(f"crashes: expected at most {self.robots}, one a robot, got {self.crashes}")
        if isinstance(self.region, SearchRegion) and (
            self.no_go or self.layer is not None or self.inner is not None or self.across_zones
        ):
            raise InvalidInputError(
                "region: expected a name or a file together with no_go, layer, inner or across_zones, got an open one"
            )
        if self.live is not None:
            if self.network != "perfect":
                raise InvalidInputError(f"live: expected no network but a share of lost messages, got {self.network!r}")
            if any(not fault_text(fault).startswith(LIVE_FAULTS) for fault in self.faults):
                raise InvalidInputError("live: expected no faults but crashes and slow robots")

    @property
    def chosen_angle(self) -> float | None:
        """The angle of the rows, degrees; None if it is to be chosen, as it is for a region on the earth unless one is given."""
        if self.angle is None:
            return None if self.place.frame is not None else 0.0
        return None if isinstance(self.angle, str) else self.angle

    def tours_to_compare(self, turn_cost: float) -> tuple[str, ...]:
        """Return the tours of which the soonest is taken, where a turn costs so many cells; of several passes one along rows."""
        if self.tour != AUTO:
            return (self.tour,)
        if self.passes > 1:
            return AUTO_TOURS[:1]
        return AUTO_TOURS if turn_cost or self.chosen_angle is None else (AUTO_TOUR,)

    @property
    def allocations_to_compare(self) -> tuple[str, ...]:
        """The allocations of which the soonest is taken, the one first that is it most often."""
        return ALLOCATIONS if self.allocation == AUTO else (self.allocation,)

    @property
    def has_layers(self) -> bool:
        """Whether something may be searched in several layers."""
        return self.passes > 1 or len(self.bands or ()) > 1 or self._volume

    @property
    def _volume(self) -> bool:
        region = self.region
        return region.startswith("box:") if isinstance(region, str) else region.height > 0

    @cached_property
    def altitudes(self) -> tuple[float, ...]:
        """The altitudes at which all is searched, rising, metres: as asked for, the middles of a volume's layers, the vehicle's."""
        if self.bands is not None:
            return self.bands
        if not self._volume:
            return (self._asked_vehicle.height,)
        place: SearchRegion = self.place
        return place.layer_altitudes(float(np.min(self.footprint_at(0.0))))

    @property
    def _asked_vehicle(self) -> Vehicle:
        return vehicle_of("ideal" if self.vehicle is None else self.vehicle)

    @cached_property
    def chosen_vehicle(self) -> Vehicle:
        """The vehicle that was asked for, or the ideal one, at the lowest altitude; if it is ideal it climbs as it cruises."""
        asked = self._asked_vehicle
        if self.bands is None and not self._volume:
            return asked
        speeds = {name: getattr(asked, name) or asked.cruise for name in ("climb_speed", "sink_speed")}
        return asked.replaced(altitude=self.altitudes[0], **speeds)

    def footprint_at(self, altitude: float) -> float | tuple[float, ...]:
        """Return the footprint that was asked for, or what the vehicle sees from an altitude; metres. In a volume it is all one."""
        vehicle = self._asked_vehicle
        seeing = vehicle if self._volume else vehicle.replaced(altitude=altitude)
        return self.footprint or seeing.row_spacing or FOOTPRINT

    @property
    def chosen_footprint(self) -> float | tuple[float, ...]:
        """The footprint that was asked for, or what the vehicle sees; of several altitudes from the lowest; metres."""
        return self.footprint_at(self.altitudes[0])

    @property
    def stepwise(self) -> bool:
        """Whether robots go from cell to cell, as they must where they may come upon obstacles."""
        return self.obstacles not in (0, ())

    def open_place(self) -> SearchRegion:
        """Open the region."""
        if isinstance(self.region, SearchRegion):
            return with_margin(self.region, self.margin)
        whole = open_region(
            self.region, no_go=list(self.no_go) or None, layer=self.layer, inner=self.inner, across_zones=self.across_zones
        )
        return with_margin(whole, self.margin)

    def place_key(self) -> str | None:
        """Return the region's name with what is cut out of it; None for one that has been opened already."""
        if isinstance(self.region, SearchRegion):
            return None
        kept = ("region", "no_go", "margin", "layer", "inner", "across_zones")
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
        if region.height and self.altitudes[-1] > region.height:
            raise InvalidInputError(f"bands: expected altitudes up to {region.height:g} m, the top, got {self.altitudes[-1]:g}")
        if len(region.parts) > 1 and not self.transit:
            raise InvalidInputError(
                f"region {region.name!r}{region.margin_text}: expected one part, as robots stay inside, got {len(region.parts)}; "
                "allow transit for robots that may cross what lies between, or search each part by itself"
            )
        if len(region.parts) > 1 and self.stepwise:
            raise InvalidInputError(f"obstacles: expected a region of one part, as robots go round them, got {len(region.parts)}")
