"""SearchProblem: all settings of a search except its seed: region, robots, faults, targets and
obstacles.
"""

from __future__ import annotations

import os
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from shoal.core.checks import shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.notices import tell_once
from shoal.core.problem import Problem, option
from shoal.search.flight.vehicle import Vehicle, image_of, vehicle_of
from shoal.search.problem.fields import (
    AUTO,
    check_angle,
    check_bands,
    check_footprint,
    check_network,
    check_no_go,
    check_number_list,
    check_path,
    check_places,
    check_region,
    check_tracks,
    dump_no_go,
    dump_region,
    parse_angle,
    parse_count_or_path,
    parse_numbers,
)
from shoal.search.problem.lateral import LateralRange, check_lateral_range, lateral_range
from shoal.search.problem.network import Fault, check_faults, fault_text
from shoal.search.problem.prior import (
    Prior,
    check_drift,
    check_priors,
    is_tracks,
    open_prior,
    parse_drift,
)
from shoal.search.regions.builder import INNER, open_region
from shoal.search.regions.coverage import UNSEEN, UNSEEN_BY_IMAGES, Image
from shoal.search.regions.formats.reading import HIDDEN
from shoal.search.regions.margin import sag_of, with_default_margin, with_margin, without_margin
from shoal.search.regions.outline import check_spikes
from shoal.search.regions.places import places_of, read_line, read_points, swept_area
from shoal.search.regions.projection import ROUNDED
from shoal.search.regions.region import SearchRegion
from shoal.search.tours import TOURS

AUTO_TOUR = "spanning-tree"
"""The tour that ``auto`` means for a single pass if Shoal does not compare tours. This tour is the
shortest in every region.
"""

AUTO_TOURS = ("boustrophedon", "strips", "headland", "spanning-tree")
"""The tours that ``auto`` compares if the problem names a vehicle or what it prefers, or if the
planner chooses the angle of the rows.
"""

TWO_WAY_TOURS = ("strips", "headland")
"""Tours of long straight rows that run in two directions."""

TURN_PRICES = {"time": 0.85, "rows": 3.0}
"""What a turn costs at least, in cells, in comparisons of plans, by what is preferred."""

LIKELY, SHORTER, TOUR = "likely", "shorter", "tour"
"""Orders of a search with a prior. The last one is that without it."""

ORDERS = {LIKELY: 1.0, SHORTER: 0.5, TOUR: 0.0}
"""The share that each order may take of the time that ``at_most`` allows beyond the plan without the
prior.
"""

CENTRE = "centre"
"""What ``along`` is for the middle of a long region."""

FOOTPRINT = 10.0
"""Default side of a robot's footprint in metres."""

MOST_ROBOTS = 1000
"""Maximum number of robots in a search. An allocation needs memory for each pair of robots."""

READING = ("layer", "inner", "hidden", "closed_lines")
"""Fields that decide how files of regions and no-go zones are read."""

LIVE_FAULTS = ("crash", "slow")


def allocations() -> tuple[str, ...]:
    """Return the names of all allocators, the one that is most often the fastest first."""
    from shoal.search.allocation.allocate import ALLOCATORS  # brings kernels

    return tuple(ALLOCATORS)[::-1]


@dataclass(frozen=True, eq=False)
class SearchProblem(Problem):
    """A search of a region by robots that have no coordinator.

    The options of ``shoal search`` and the fields of sweeps and problem files have the same names
    as the fields of this class. In Python, the region may also be a `SearchRegion`, and starts,
    targets and obstacles may also be arrays of points in metres.

    Raises
    ------
    InvalidInputError
        If a field has the wrong type or is out of range, or if two fields contradict each other.

    Notes
    -----
    The sources are paper H and docs/concepts/search.md.

    Examples
    --------
    >>> problem = SearchProblem("square:100", robots=4, loss=0.3, faults="crash:2@30")
    >>> problem.canonical()
    '{"faults":["crash:2@30"],"kind":"search","loss":0.3,"region":"square:100"}'
    >>> problem.place
    <SearchRegion 'square:100': 10000 m2, 1 parts, 0 holes>
    """

    part: ClassVar[str] = "search"
    headings: ClassVar = {
        "robots": "Robots",
        "tour": "Tour",
        "no_go": "Region",
        "vehicle": "Vehicle",
        "multiplicity": "Robots",
        "transit": "Vehicle",
        "loss": "Radio and faults",
        "targets": "Targets and obstacles",
        "simulate": "Simulation",
    }
    measures = (
        "status",
        "cells",
        "makespan",
        "share",
        "expected_find",
        "planned",
        "lower_bound",
        "sent",
        "lost",
        "takeovers",
    )

    region: Any = option(
        help=(
            "Region: square:SIDE, rectangle:WxH, circle:RADIUS, ring:OUTERxINNER or box:WxDxH (a"
            " volume) in metres, or a file: .geojson, .json, .kml, .gpkg, .kmz, .shp, .zip (a"
            " Shapefile), .plan (QGroundControl), .poly, .fen, .waypoints or .txt (Mission Planner)"
            " or .csv (metres)."
        ),
        argument=True,
        metavar="REGION",
        check=check_region,
        dump=dump_region,
    )
    robots: int = option(4, help="Number of robots.", least=1, most=MOST_ROBOTS)
    footprint: float | tuple[float, ...] | None = option(
        None,
        help=(
            "Side of the square that a robot sees: one number for all robots, or one number for"
            " each robot, such as 2,2,6; by default the view of the vehicle's camera or detector,"
            " or 10."
        ),
        unit="m",
        metavar="METRES",
        parse=parse_numbers,
        check=check_footprint,
    )
    overlap: float | None = option(
        None,
        help=(
            "Share of the footprint by which neighbouring rows overlap, as a reserve for corners that"
            " vehicles cut and errors of their positions: robots fly as if they saw a footprint that"
            " is narrower by this share. Default: 0, or the side overlap of the vehicle's camera."
        ),
        least=0,
        most=0.95,
    )
    cross_track: float | None = option(
        None,
        help=(
            "Reserve for errors of positions and cut corners: distance from their paths at which"
            " robots still see the whole region. Where footprints do not overlap as much already,"
            " rows are narrower by twice this distance. Default: with missions, the root of the sum"
            " of the squares of the vehicle's position error and acceptance radius, but at most a"
            " quarter of the footprint; otherwise 0."
        ),
        unit="m",
        least=0,
        metavar="METRES",
    )
    bands: tuple[float, ...] | None = option(
        None,
        help=(
            "Altitudes at which robots search the whole region, along one tour; by default the"
            " vehicle's altitude, or in a box, the middles of equal layers that are at most one"
            " footprint thick."
        ),
        unit="m",
        metavar="H,H,...",
        parse=parse_numbers,
        check=check_bands,
    )
    passes: int = option(
        1,
        help=(
            "Number of times that robots search the whole region. In every second pass, rows are"
            " rotated by 90 degrees."
        ),
        least=1,
        most=100,
    )
    starts: str | tuple[tuple[float, float], ...] = option(
        "random",
        help=(
            "Start points of the robots: random, clustered, line, or a CSV file with a point for"
            " each robot (x and y in metres; longitude and latitude for a region on Earth)."
        ),
        check=check_places("starts", "a layout or a file"),
    )
    launch: str | tuple[tuple[float, float], ...] | None = option(
        None,
        help=(
            "Launch points inside or outside the region, in place of --starts: one x,y for all"
            " robots, or one for each robot, separated by semicolons (metres; longitude,latitude"
            " for a region on Earth). The value of --launch may be a CSV or GeoJSON file of points,"
            " or of a line such as a road, along which robots start at equal distances."
        ),
        metavar="POINTS|FILE",
        check=check_places("launch", "points or a file"),
    )
    land: str | tuple[tuple[float, float], ...] | None = option(
        None,
        help="Landing points, in the same form as --launch; by default the launch points.",
        metavar="POINTS|FILE",
        check=check_places("land", "points or a file"),
    )
    stay_inside: bool = option(
        False,
        help=(
            "Paths to and from points outside the region cross its edge at the nearest place, and"
            " stay inside the region otherwise: those of launch and landing points."
        ),
    )
    delays: tuple[float, ...] | None = option(
        None,
        help=(
            "Delay of each robot's start; by default 0, or with missions, the delays that keep"
            " robots apart."
        ),
        unit="s",
        metavar="S,S,...",
        parse=parse_numbers,
        check=lambda value: check_number_list(
            value, "delays", "numbers, 0 or more, one per robot", least=0
        ),
    )
    tour: str = option(
        "auto",
        help=(
            f"Tour: {', '.join(TOURS)} or MODULE:ATTRIBUTE. With several passes, auto means"
            " boustrophedon. With a vehicle or --prefer, or if Shoal chooses the angle of the rows,"
            " auto means the best of boustrophedon, spanning-tree and, without a given angle, strips"
            " and headland. In any other search, auto means spanning-tree."
        ),
        names=tuple(TOURS),
    )
    prefer: str | None = option(
        None,
        help=(
            "What counts between plans: time (each turn adds the time for 0.85 cells, or its own if"
            " it takes longer), or rows (each turn adds the time for 3 cells): long straight rows"
            " in few pieces. Default: rows for a vehicle with a camera, else time."
        ),
        choices=tuple(TURN_PRICES),
    )
    allocation: str = option(
        "auto",
        help=(
            "Rule that divides the tour among the robots: {names} or MODULE:ATTRIBUTE. auto means"
            " the fastest rule. In large searches, auto means hop: if the number of cells times the"
            " number of robots exceeds 100,000, or 10,000 with footprints wider than a cell."
        ),
        names=allocations,
    )
    angle: float | str | None = option(
        None,
        help=(
            "Angle of the rows, along which most of the tour runs, counter-clockwise from east; by"
            " default auto for regions on Earth, else 0. With auto, Shoal takes the angle and shift"
            " of the rows for which one robot needs the least time."
        ),
        unit="degrees",
        metavar="DEGREES|auto",
        parse=parse_angle,
        check=check_angle,
    )
    along: str | tuple[tuple[float, float], ...] | None = option(
        None,
        help=(
            "Line that the rows follow, such as a road, a river or a power line, in place of --angle:"
            " a GeoJSON, GPX, WKT or CSV file, a text LINESTRING (x y, ...), or centre, for the"
            " middle of a long region. Where the region is at most as wide as the footprint, there"
            " is one row. Footprints turn with the robots."
        ),
        metavar="FILE|WKT|centre",
        check=check_places("along", "a line or centre"),
    )
    no_go: tuple[Any, ...] = option(
        (),
        help="File of no-go zones, in the same units as REGION (the option can be repeated).",
        metavar="FILE",
        repeated=True,
        parse=list,
        check=check_no_go,
        dump=dump_no_go,
    )
    searched: tuple[Any, ...] = option(
        (),
        help=(
            "File of a track that was flown before, such as after a battery stop or a crash: a CSV or"
            " GeoJSON file of points or of a line, in the same units as REGION, a GPX track or a"
            " flight log (.tlog, .bin, .ulg); the option can be repeated. What a robot's footprint"
            " saw along the track is not searched again. With --prior, it becomes less likely, and"
            " with a --detection below 1, robots look there again."
        ),
        metavar="FILE",
        repeated=True,
        parse=list,
        check=check_tracks,
    )
    margin: float | None = option(
        None,
        help=(
            "Distance that all paths keep from the border of the region and from no-go zones."
            " Default: with missions or no-go zones, the sum of the vehicle's position error, its"
            " acceptance radius and the rounding of coordinates, or less where the region is too"
            " narrow; otherwise 0."
        ),
        unit="m",
        least=0,
    )
    layer: str | None = option(
        None,
        help=(
            "Name of a layer of a GeoPackage file, required if the file has several layers; survey"
            " or fence for a plan of QGroundControl, required if the plan has both."
        ),
    )
    inner: str | None = option(
        None,
        help=(
            "Meaning of an unmarked polygon inside another polygon. By default, Shoal refuses a"
            " file with an unmarked inner polygon."
        ),
        choices=INNER,
    )
    hidden: str | None = option(
        None,
        help=(
            "Meaning of the polygons that a KML file hides (visibility 0). By default, Shoal"
            " refuses a file with a hidden polygon."
        ),
        choices=HIDDEN,
    )
    closed_lines: bool = option(False, help="Read closed lines in files as polygons.")
    vehicle: Vehicle | str | None = option(
        None,
        help=(
            "Vehicle: multirotor, fixed-wing, rover, ideal (1 m/s, turns take no time, no battery"
            " limit) or a .toml or .json file; by default ideal, or with missions, multirotor."
            " Changed fields may follow the name: rover,cruise_speed=2."
        ),
        metavar="NAME|FILE[,FIELD=VALUE...]",
        check=vehicle_of,
        dump=Vehicle.to_dict,
    )
    rates: tuple[float, ...] | None = option(
        None,
        help="Speed of each robot, divided by the vehicle's speed.",
        metavar="R,R,...",
        parse=parse_numbers,
        check=lambda value: check_number_list(
            value, "rates", "numbers above 0, one per robot", above=0
        ),
    )
    multiplicity: int = option(
        1, help="Number of different robots that must search each cell.", least=1
    )
    transit: bool = option(
        False, help="Robots fly, and may cross the ground between the separate parts of a region."
    )
    loss: float = option(
        0.0, help="Probability that the radio network loses a message.", least=0, most=1
    )
    network: str = option(
        "perfect",
        help=(
            "Radio network: perfect, loss:P, bursts:WORSEN:MEND, range:CELLS,"
            " partition:SINCE:UNTIL, delay:MEAN, duplicates:P, corruption:P, replays:P, forgeries:P"
            " (with --key)."
        ),
        metavar="MODEL,...",
        check=check_network,
    )
    key: str | None = option(
        None,
        help=(
            "File with the key that signs messages: 16 bytes or more, readable by its owner only."
            " With a key, robots refuse unsigned and repeated messages."
        ),
        metavar="FILE",
        check=lambda value: check_path(value, "key", "the path of a file"),
    )
    packet: int | None = option(
        None,
        help=(
            "Maximum length of a message. A robot divides a longer message into several messages,"
            " each of which can be read alone."
        ),
        unit="bytes",
        least=64,
        most=65_507,
    )
    faults: tuple[Fault, ...] = option(
        (),
        help=(
            "Robot faults: crash:R@TIME, pause:R@TIME:UNTIL, slow:R@TIME:FACTOR, battery:R:ENERGY,"
            " wrong-position:R:CELLS, liar:R (the option can be repeated). R is the number of a"
            " robot, counted from 1. TIME, UNTIL and ENERGY are in units of the time for one cell."
        ),
        metavar="FAULT,...",
        repeated=True,
        parse=list,
        check=check_faults,
        dump=lambda value: [fault_text(fault) for fault in value],
    )
    crashes: int = option(
        0,
        help=(
            "Number of robots that crash at random times. The seed determines which robots crash,"
            " and when."
        ),
        least=0,
    )
    targets: Any = option(
        0,
        help=(
            "Targets that robots must find: a number of random cells (by --prior, if it is given), or"
            " a CSV file of points."
        ),
        metavar="N|FILE",
        parse=parse_count_or_path,
        check=check_places("targets", "a file", count=True),
    )
    prior: tuple[Any, ...] = option(
        (),
        help=(
            "Where a target is how likely: a file of numbers (.npy over the bounding box of the"
            " region, row 0 in the north, .tif or .asc), a .geojson file of polygons with a property"
            " probability or of points with spread_m, or ring:X,Y:SHARE=METRES,... around a last"
            " known point (the option can be repeated; 2*FILE gives a part twice the weight); or a"
            " .nc file of tracks of particles, as OpenDrift writes it. Robots search likely cells"
            " early, and still search everything."
        ),
        metavar="FILE|RING",
        repeated=True,
        parse=list,
        check=check_priors,
    )
    elsewhere: float = option(
        0.0,
        help="With --prior: probability that is the same everywhere in the region.",
        least=0,
        below=1,
    )
    at_most: float = option(
        1.25,
        help=(
            "With --prior: longest time of the plan, divided by the time of the plan without a prior."
        ),
        least=1,
    )
    order: str = option(
        AUTO,
        help=(
            "With --prior: order in which robots search: likely (likely cells early, within"
            " --at-most), shorter (the same, with half of the time that --at-most allows beyond the"
            " plan without a prior), or tour (as without a prior)."
            " auto means likely or, of missions whose vehicles wait for each other, the order that"
            " finds the target earliest."
        ),
        choices=(AUTO, *ORDERS),
    )
    drift: tuple[float, float, float] | None = option(
        None,
        help=(
            "With --prior: velocity of a target that moves, to the east and to the north, and the"
            " standard deviation of the velocity along each axis."
        ),
        unit="m/s",
        metavar="VX,VY[:SPREAD]",
        parse=parse_drift,
        check=check_drift,
    )
    detection: float = option(
        1.0,
        help=(
            "Probability that a robot detects a target when it searches the cell of the target. With"
            " --prior, robots search likely cells again where a search may miss the target."
        ),
        least=0,
        most=1,
    )
    lateral_range: str | None = option(
        None,
        help=(
            "In place of --detection: probability that a robot detects a target beside its path, by"
            " the distance in metres, such as 0=0.9,10=0.7,25=0; and after @, the speed in metres per"
            " second for which it holds."
        ),
        metavar="METRES=P,...[@SPEED]",
        check=check_lateral_range,
    )
    false_alarm: float = option(
        0.0,
        help="Probability that a robot reports a target in a cell without a target.",
        least=0,
        most=1,
    )
    obstacles: Any = option(
        0,
        help=(
            "Obstacles that no map shows: a number of random cells, or a CSV file of points. With"
            " unknown obstacles, robots move from cell to cell and discover the obstacles on the"
            " way."
        ),
        metavar="N|FILE",
        parse=parse_count_or_path,
        check=check_places("obstacles", "a file", count=True),
    )
    simulate: bool | None = option(
        None,
        help=(
            "Simulate robots and messages; by default yes, unless there are more than 125 robots,"
            " or the number of cells times the number of robots exceeds a million."
        ),
    )
    live: float | None = option(
        None,
        help=(
            "Speed of a search with one process for each robot and real UDP messages, in place of a"
            " simulation. If a robot crashes, Shoal kills the process of the robot."
        ),
        unit="cells/s",
        metavar="RATE",
        above=0,
    )

    def check_together(self) -> None:
        """Refuse fields that contradict each other, without opening any file."""
        of_robots = {
            "footprint": "one length, or {}",
            "rates": "{} speeds",
            "starts": "{} points",
            "delays": "{} times",
        }
        for name, form in of_robots.items():
            value = getattr(self, name)
            if isinstance(value, tuple) and len(value) != self.robots:
                raise InvalidInputError(
                    f"{name}: expected {form.format(self.robots)}, one per robot, got {len(value)}"
                )
        for fault in self.faults:
            if fault.robot > self.robots:
                raise InvalidInputError(
                    f"faults: expected a robot from 1 to {self.robots}, got {fault_text(fault)}"
                )
        if self.multiplicity > self.robots:
            raise InvalidInputError(
                f"multiplicity: expected at most {self.robots}, the number of robots, got"
                f" {self.multiplicity}"
            )
        if (self.bands or self._volume) and self._base_vehicle.kind == "rover":
            raise InvalidInputError(
                "vehicle: expected a flying vehicle for bands or a box, got a rover"
            )
        if self.stay_inside and self.launch is None and self.land is None:
            raise InvalidInputError(
                "stay_inside: expected launch or landing points outside the region, got none"
            )
        if (
            self.prefer is not None
            and self.tour not in (AUTO, "boustrophedon", *TWO_WAY_TOURS)
            and isinstance(self.angle, float)
            and self.vehicle is None
        ):
            raise InvalidInputError(
                "prefer: expected plans to choose between (a tour of rows or auto, the angle auto, or"
                f" a vehicle), got the tour {self.tour} at {self.angle:g} degrees"
            )
        if self.along is not None:
            self._check_along()
        if self.launch is not None and "starts" in self.given:
            raise InvalidInputError(
                "starts: expected no starts together with launch points, got"
                f" {shortened(self.starts)}"
            )
        for name in ("detection", "lateral_range"):
            is_given = name in self.given and getattr(self, name) is not None
            if is_given and not self.given & {"targets", "false_alarm", "prior"}:
                raise InvalidInputError(
                    f"{name}: expected targets or a prior of one, which robots detect, got none and a"
                    f" {name.replace('_', ' ')} of {getattr(self, name)}"
                )
        if self.lateral_range is not None:
            self._check_lateral_range()
        for name in ("elsewhere", "at_most", "order", "drift"):
            if name in self.given and not self.prior and getattr(self, name) is not None:
                raise InvalidInputError(
                    f"{name}: expected a prior together with it, got"
                    f" {shortened(getattr(self, name))} alone"
                )
        self._check_motion()
        if self.crashes > self.robots:
            raise InvalidInputError(
                f"crashes: expected at most {self.robots}, one per robot, got {self.crashes}"
            )
        if isinstance(self.region, SearchRegion) and (
            self.no_go or any(getattr(self, name) not in (None, False) for name in READING)
        ):
            raise InvalidInputError(
                "region: expected a name or a file together with no_go, layer, inner, hidden or"
                " closed_lines, got an opened region"
            )
        if self.live is not None:
            if "simulate" in self.given and self.simulate is not None:
                raise InvalidInputError(
                    "simulate: expected no choice for a live search, which is no simulation, got"
                    f" {self.simulate}"
                )
            if self.network != "perfect":
                raise InvalidInputError(
                    "live: expected no network, because a live search has only loss, got"
                    f" {self.network!r}"
                )
            if any(not fault_text(fault).startswith(LIVE_FAULTS) for fault in self.faults):
                raise InvalidInputError(
                    "live: expected only crashes and slow robots as faults, got other faults"
                )

    def _check_motion(self) -> None:
        """Refuse what contradicts a target that moves."""
        tracks = any(map(is_tracks, self.prior))
        if tracks and (len(self.prior) > 1 or self.elsewhere or self.drift is not None):
            raise InvalidInputError(
                "prior: expected tracks of particles alone, without other parts, elsewhere or drift,"
                f" got {shortened(self.prior)}"
            )
        if self.moves and not (isinstance(self.targets, int) and self.targets == 0):
            raise InvalidInputError(
                "targets: expected none together with a target that moves, because targets of a"
                f" simulation stand still, got {shortened(self.targets)}"
            )
        if self.moves and (self._volume or len(self.bands or ()) > 1):
            raise InvalidInputError(
                "prior: expected one altitude for a target that moves, got several"
            )

    @property
    def longest_order(self) -> float:
        """Longest time of the order by the prior, divided by the time of the plan without it."""
        share = ORDERS[LIKELY if self.order == AUTO else self.order]
        return 1.0 + share * (self.at_most - 1.0)

    @property
    def moves(self) -> bool:
        """Whether the target of the prior moves."""
        return self.drift is not None or any(map(is_tracks, self.prior))

    def _check_along(self) -> None:
        """Refuse what contradicts rows along a line."""
        if self.angle is not None:
            raise InvalidInputError(
                f"along: expected no angle together with a line, got {shortened(self.angle)}"
            )
        if self.passes > 1 or len(self.bands or ()) > 1 or self._volume:
            raise InvalidInputError(
                "along: expected one altitude and one pass, got"
                f" {'a volume' if self._volume else f'{self.passes} passes' if self.passes > 1 else f'{len(self.bands or ())} bands'}"
            )

    @property
    def line(self) -> Any:
        """The line that rows follow, in metres; float64, shape (k, 2); or None."""
        if self.along is None:
            return None
        if self.along == CENTRE:
            from shoal.search.cells.lanes import center_line

            return center_line(self.place, float(np.min(self.chosen_footprint)))
        return read_line(self.along, self.place, what="along")

    @property
    def chosen_angle(self) -> float | None:
        """Angle of the rows of cells in degrees, or None if the planner chooses the angle (by
        default, for a region on Earth).
        """
        if self.angle is None:
            return None if self.place.frame is not None else 0.0
        return None if isinstance(self.angle, str) else self.angle

    def tours_to_compare(self, turn_cost: float) -> tuple[str, ...]:
        """Return the names of the tours that the planner compares if a turn costs ``turn_cost``
        cells.
        """
        if self.tour != AUTO:
            return (self.tour,)
        if self.passes > 1 or self.along is not None:
            return AUTO_TOURS[:1]
        compares = turn_cost or self.chosen_angle is None or self.prefer or self.vehicle is not None
        if not compares:
            return (AUTO_TOUR,)
        # a given angle is that of the rows
        along = isinstance(self.angle, float)
        return tuple(name for name in AUTO_TOURS if not along or name not in TWO_WAY_TOURS)

    def turn_price(self, turn_cost: float) -> float:
        """Return what a turn costs in comparisons of plans, in cells, if it takes the time for
        ``turn_cost`` cells.
        """
        chosen = self.prefer or ("time" if self.image is None else "rows")
        return max(turn_cost, TURN_PRICES[chosen])

    @property
    def allocations_to_compare(self) -> tuple[str, ...]:
        """Names of the allocators that the planner compares. The allocator that is most often the
        fastest comes first.
        """
        if self.allocation != AUTO:
            return (self.allocation,)
        if self.footprint is None or np.ptp(self.footprint) == 0:
            return allocations()
        # Wide footprints see cells of their neighbours' arcs: then neighbours that begin at far
        # ends need longer than planned.
        return tuple(name for name in allocations() if name not in ("either-end", "loop"))

    @property
    def _volume(self) -> bool:
        return (
            self.region.startswith("box:")
            if isinstance(self.region, str)
            else self.region.height > 0
        )

    @cached_property
    def altitudes(self) -> tuple[float, ...]:
        """Altitudes of the search in metres, ascending: the bands, the layers of a volume, or the
        vehicle's altitude.
        """
        if self.bands is not None:
            return self.bands
        if not self._volume:
            return (self._base_vehicle.height,)
        place: SearchRegion = self.place
        # rows keep a reserve, layers none
        side = self._row_distance(self.vehicle_at(0.0), reserved=False)
        return place.layer_altitudes(float(np.min(side)))

    @property
    def _base_vehicle(self) -> Vehicle:
        vehicle = vehicle_of("ideal" if self.vehicle is None else self.vehicle)
        if self.overlap is None or vehicle.image_size is None or self.footprint is not None:
            return vehicle
        return vehicle.replaced(side_overlap=self.overlap)

    @cached_property
    def chosen_vehicle(self) -> Vehicle:
        """The vehicle of the robots at the lowest altitude of the search. By default, robots have
        the ideal vehicle.
        """
        vehicle = self._base_vehicle
        if self.bands is None and not self._volume:
            return vehicle
        speeds = {
            name: getattr(vehicle, name) or vehicle.cruise for name in ("climb_speed", "sink_speed")
        }
        return vehicle.replaced(altitude=self.altitudes[0], **speeds)

    def vehicle_at(self, altitude: float) -> Vehicle:
        """Return the vehicle with its altitude changed to ``altitude``. In a volume, the vehicle
        keeps its own altitude.
        """
        return (
            self._base_vehicle if self._volume else self._base_vehicle.replaced(altitude=altitude)
        )

    def footprint_at(self, altitude: float) -> float | tuple[float, ...]:
        """Return the side of the footprint at an altitude, in metres.

        By default, the footprint is the view of the vehicle's camera or detector, or 10 m without a
        camera or detector. The footprint is narrower by the overlap of the rows.
        """
        return self._row_distance(self.vehicle_at(altitude))

    def _row_distance(
        self, vehicle: Vehicle, *, reserved: bool = True
    ) -> float | tuple[float, ...]:
        """Return the distance of rows in metres, one or one for each robot: the side of the footprint
        less its overlap, or less twice the reserve if that is more.
        """
        side: Any
        if self.footprint is None and vehicle.image_size is not None:
            side = vehicle.image_size[0]
            narrower = np.asarray(vehicle.row_spacing)  # without the overlap already
        else:
            side = self.footprint or vehicle.row_spacing or FOOTPRINT
            narrower = np.asarray(side) * (1.0 - (self.overlap or 0.0))
        if self.cross_track and reserved:
            least = np.asarray(side) - 2 * self.cross_track
            if (least <= 0).any():
                raise InvalidInputError(
                    "cross_track: expected less than half of the footprint,"
                    f" {float(np.min(side)) / 2:.4g} m, got {self.cross_track:g}"
                )
            narrower = np.minimum(narrower, least)
        return tuple(narrower.tolist()) if narrower.ndim else float(narrower)

    @property
    def chosen_footprint(self) -> float | tuple[float, ...]:
        """Side of the footprint in metres: the given side, or the side that the vehicle sees from
        the lowest altitude.
        """
        return self.footprint_at(self.altitudes[0])

    @property
    def image(self) -> Image | None:
        """The image of the vehicle's camera, or None without a camera, or with a given
        footprint. Along a line, a footprint is an image too: it turns with its robot.
        """
        vehicle = self.chosen_vehicle
        image = image_of(vehicle) if self.footprint is None else None
        if image is not None and vehicle.row_spacing:
            image = image.scaled(vehicle.row_spacing / float(np.min(self.chosen_footprint)))
        return Image(1.0, 1.0) if image is None and self.along is not None else image

    @property
    def most_unseen(self) -> float:
        """Share of the region that a complete search may leave unseen."""
        camera = self.footprint is None and self.chosen_vehicle.image_size is not None
        return UNSEEN_BY_IMAGES if camera else UNSEEN

    @property
    def view(self) -> float | tuple[float, ...]:
        """Side of what a robot sees from the lowest altitude, in metres, without a reserve: with a
        camera, the distance of its rows, of which `image` is a multiple.
        """
        return self.footprint or self.chosen_vehicle.row_spacing or FOOTPRINT

    @property
    def _whole_view(self) -> float | tuple[float, ...]:
        """Side of what a robot sees from the lowest altitude, in metres, without reserve and overlap."""
        size = self.chosen_vehicle.image_size
        return size[0] if self.footprint is None and size is not None else self.view

    @property
    def row_reserve(self) -> float:
        """Distance in metres from its path at which a robot still sees its part of the region."""
        return float(np.min(np.asarray(self._whole_view) - np.asarray(self.chosen_footprint))) / 2

    @property
    def default_cross_track(self) -> float:
        """The reserve of rows in missions, in metres; see the field ``cross_track``."""
        vehicle = self.chosen_vehicle
        reserve, most = vehicle.cross_track, float(np.min(self._whole_view)) / 4
        if reserve > most:
            tell_once(
                f"cross_track: {most:.3g} m in place of {reserve:.3g} m, because robots see only"
                f" {4 * most:.4g} m: with larger errors of their positions, gaps between rows remain"
            )
        return round(min(reserve, most), 3)

    @property
    def curve(self) -> LateralRange | None:
        """The lateral range curve, or None without one."""
        return None if self.lateral_range is None else lateral_range(self.lateral_range)

    @cached_property
    def chosen_detection(self) -> float:
        """Probability that one search of a cell detects a target in it: the given one, or the mean
        of the lateral range curve over a row of cells. What a robot sees of other rows beside its
        own does not count.
        """
        curve = self.curve
        if curve is None:
            return self.detection
        return curve.detection(float(np.min(self.chosen_footprint)), self._passing_speed)

    @property
    def _passing_speed(self) -> float:
        """Speed in metres per second at which robots pass targets."""
        return self.chosen_vehicle.cruise * (self.rates or (1.0,))[0]

    def lateral_report(self) -> dict[str, float] | None:
        """Return what the lateral range curve means for the search, or None without one."""
        curve = self.curve
        if curve is None:
            return None
        return {
            "detection": self.chosen_detection,
            "sweep_width_m": curve.sweep_width(self._passing_speed),
            "row_distance_m": float(np.min(self.chosen_footprint)),
        }

    def _check_lateral_range(self) -> None:
        """Refuse a lateral range curve where one number does not hold for all searches of cells."""
        if "detection" in self.given:
            raise InvalidInputError(
                "lateral_range: expected either a lateral range or a detection, got both"
            )
        sides = np.atleast_1d(np.asarray(self.footprint or 1.0)).tolist()
        rates = list(self.rates or (1.0,))
        if len(self.altitudes) > 1 or len({*sides}) > 1 or len({*rates}) > 1:
            raise InvalidInputError(
                "lateral_range: expected one altitude, and equal footprints and speeds of all robots,"
                f" got {len(self.altitudes)} altitudes, footprints of {shortened(sides)} m and"
                f" relative speeds of {shortened(rates)}"
            )
        curve, wind = self.curve, self.chosen_vehicle.wind
        if curve is not None and curve.speed is not None and wind:
            raise InvalidInputError(
                "lateral_range: expected no wind with a curve of one speed, because speeds over"
                f" ground, and so the detection, differ with the direction, got @{curve.speed:g} and a"
                f" wind_speed of {wind:g} m/s; a curve without @SPEED holds at all speeds"
            )

    @property
    def stepwise(self) -> bool:
        """Whether robots move only from a cell to a neighbouring cell, because the region has
        unknown obstacles.
        """
        return self.obstacles not in (0, ())

    def open_prior(self) -> Prior | None:
        """Open the prior of the problem, or return None for a problem without a prior."""
        if not self.prior:
            return None
        return replace(
            open_prior(self.prior, self.elsewhere, self.place), detection=self.chosen_detection
        )

    def open_place(self) -> SearchRegion:
        """Open the region of the problem, with its no-go zones and its margin."""
        if isinstance(self.region, SearchRegion):
            return self.with_own_margin(self._without_searched(self.region))
        reading = {name: getattr(self, name) for name in READING}
        whole = open_region(self.region, no_go=list(self.no_go) or None, **reading)
        return self.with_own_margin(self._without_searched(whole))

    def _without_searched(self, region: SearchRegion) -> SearchRegion:
        """Return a region without what was seen along the given tracks; with a prior and a
        detection below 1, robots look there again.
        """
        if not self.searched:
            return region
        vehicle = self._base_vehicle
        side = float(np.min(self.footprint or vehicle.row_spacing or FOOTPRINT))
        # from another altitude, a camera sees another width
        by_camera = self.footprint is None and vehicle.image_size is not None
        areas = [
            swept_area(
                track,
                region,
                side,
                flies=vehicle.kind != "rover",
                altitude=vehicle.height if by_camera else None,
            )
            for track in self.searched
        ]
        for track, area in zip(self.searched, areas, strict=True):
            if not area.intersects(region.area):
                raise InvalidInputError(
                    "searched: expected tracks that see some of the region, got none of it by"
                    f" {shortened(track)}"
                )
        again = bool(self.prior) and self.chosen_detection < 1
        return replace(region, looks=(*region.looks, *areas), again=again)

    def with_own_margin(self, region: SearchRegion, *, fenced: bool = False) -> SearchRegion:
        """Return a region with the problem's margin, or with the default margin if the problem has
        none.

        The default margin is 0 in a region without no-go zones, unless the vehicles are ``fenced``:
        have a geofence.
        """
        vehicle = self._base_vehicle
        if self.margin is not None:
            plain = without_margin(region) if fenced else region
            return with_margin(
                plain, self.margin, barriers=plain.barriers, pointed=vehicle.radius > 0
            )
        if region.margin or (region.no_go.is_empty and not fenced):
            return region
        default = vehicle.clearance + (ROUNDED if vehicle.clearance or fenced else 0.0)
        if fenced and default:
            default = round(default + max(0.0, sag_of(region) - ROUNDED / 2), 3)
        inner, outer = self.fixed_places(region)
        return with_default_margin(
            region,
            default,
            footprint=float(np.min(self.footprint or vehicle.row_spacing or FOOTPRINT)),
            least=self.least_margin,
            inner=inner,
            outer=outer,
            divided=self.transit,
            pointed=vehicle.radius > 0,
        )

    @property
    def least_margin(self) -> float:
        """The smallest margin in metres with which the errors of their positions do not bring vehicles
        out of the region or into a no-go zone.
        """
        return (self._base_vehicle.position_error or 0.0) + ROUNDED

    def fixed_places(self, region: SearchRegion) -> tuple[Any, Any]:
        """Return the points where robots start inside the region, and the launch and landing
        points, in metres.
        """
        named_values = [
            (getattr(self, name), name)
            for name in ("launch", "land")
            if getattr(self, name) is not None
        ]
        places = [places_of(value, region, self.robots, what=name) for value, name in named_values]
        outer = np.concatenate([np.zeros((0, 2)), *places])
        inner = np.zeros((0, 2))
        if not isinstance(self.starts, str):
            inner = np.asarray(self.starts, dtype=np.float64)
        elif os.path.isfile(self.starts) and self.launch is None:
            inner = read_points(Path(self.starts), region, what="starts", count=self.robots)
        # it cannot leave the region between the border and the margin
        if self._base_vehicle.kind == "rover":
            inner = np.concatenate([inner, outer[region.contains(outer)]])
        return inner, outer

    def place_key(self) -> str | None:
        """Return a text with the fields that define the region, or None if the region is a
        `SearchRegion`.
        """
        if isinstance(self.region, SearchRegion):
            return None
        names: tuple[str, ...] = ("region", "no_go", "margin", *READING)
        if self.searched:
            names += ("searched", "footprint", "vehicle", "prior", "detection", "lateral_range")
            names += ("overlap", "cross_track") if self.lateral_range else ()
        # the default margin depends on the vehicle, on what it sees, and on the known places
        if self.margin is None and self._base_vehicle.clearance:
            names += (
                "vehicle",
                "footprint",
                "overlap",
                "cross_track",
                "robots",
                "starts",
                "launch",
                "land",
            )
        return self.canonical(
            without=("kind", *(name for name in self.declarations() if name not in names))
        )

    def place_files(self) -> tuple[str, ...]:
        """Return the files of the region and of the no-go zones."""
        names = (self.region, *self.no_go, *self.searched)
        return tuple(name for name in names if isinstance(name, str) and os.path.exists(name))

    def place_digest(self) -> bytes:
        """Return the area of the region as bytes in the format well-known binary."""
        return bytes(self.place.area.wkb)

    def check_at_place(self) -> None:
        """Refuse a region of several parts if robots must stay inside it, and refuse altitudes
        above the top of a volume.
        """
        region: SearchRegion = self.place
        check_spikes(region.area, float(np.min(self.chosen_footprint)), f"region {region.name!r}")
        if region.height and self.altitudes[-1] > region.height:
            raise InvalidInputError(
                f"bands: expected altitudes up to {region.height:g} m, the top of the box, got"
                f" {self.altitudes[-1]:g} m"
            )
        if self.stay_inside and all(
            region.contains(places).all() for places in self.fixed_places(region)
        ):
            raise InvalidInputError(
                "stay_inside: expected launch or landing points outside the region, got all of them"
                " inside"
            )
        if len(region.parts) > 1 and not self.transit:
            raise InvalidInputError(
                f"region {region.name!r}{region.margin_text}: expected one part, because robots"
                f" stay inside, got {len(region.parts)}; use --transit if robots may cross the"
                " space between parts, or search each part separately"
            )
        if len(region.parts) > 1 and self.stepwise:
            raise InvalidInputError(
                "obstacles: expected a region of one part, because robots go round obstacles, got"
                f" {len(region.parts)} parts"
            )
