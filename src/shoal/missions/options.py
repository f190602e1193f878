"""The options of missions: how they are planned and written, and how they are checked."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from shoal.core.checks import check_number, check_text, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.problem import Problem, option, option_of
from shoal.missions.formats import FORMATS
from shoal.missions.mission import CAPS
from shoal.search.flight.flight import ENDINGS, FRAMES, TERRAIN_ERROR
from shoal.search.flight.separation import DELAY, HORIZONTAL, VERTICAL, Separation
from shoal.search.flight.terrain import Terrain, open_terrain
from shoal.search.flight.vehicle import Vehicle, vehicle_of
from shoal.search.problem import READING, SearchProblem
from shoal.search.problem.fields import check_path
from shoal.search.regions.builder import open_region
from shoal.search.regions.coverage import TURNING, UNSEEN_BY_IMAGES
from shoal.search.regions.margin import with_margin
from shoal.search.regions.region import SearchRegion


def _parse_names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _check_names(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list | tuple):
        raise InvalidInputError(f"format: expected names such as plan, gpx, got {shortened(value)}")
    return tuple(check_text(name, what="format") for name in value)


def parse_separation(text: str) -> tuple[float, ...]:
    """Parse a separation in metres from the command line: HORIZONTAL or HORIZONTAL,VERTICAL."""
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if not 1 <= len(numbers) <= 2:
        raise InvalidInputError(
            f"--separation: expected HORIZONTAL or HORIZONTAL,VERTICAL in metres, got {text[:40]!r}"
        )
    return tuple(numbers)


def check_separation(value: Any) -> tuple[float, ...] | Separation:
    """Check and return a horizontal and a vertical separation in metres, or (0,) if the horizontal
    separation is 0. A `Separation`, which also has a delay, stays as it is.
    """
    if isinstance(value, Separation):
        return value
    value = value.tolist() if isinstance(value, np.ndarray) else value
    distances = value if isinstance(value, list | tuple) else (value,)
    if not 1 <= len(distances) <= 2:
        raise InvalidInputError(
            "separation: expected a horizontal and a vertical distance in metres, got"
            f" {shortened(value)}"
        )
    horizontal = check_number(distances[0], what="separation", least=0)
    if not horizontal:
        return (0.0,)
    return horizontal, (
        check_number(distances[1], what="separation, vertically", least=0.1)
        if len(distances) > 1
        else VERTICAL
    )


@dataclass(frozen=True, eq=False)
class MissionOptions(Problem):
    """Settings for mission files: the options of ``shoal search`` that have an effect only with
    ``--missions``.

    Examples
    --------
    >>> MissionOptions(separation=20).required_separation
    Separation(horizontal=20.0, vertical=5.0, delay=10.0)
    """

    part: ClassVar[str] = "missions"
    headings: ClassVar = {"format": "Missions"}

    format: tuple[str, ...] = option(
        (),
        help=(
            "File formats of the missions: {names} or MODULE:ATTRIBUTE. Default: all formats that"
            " can describe the region."
        ),
        metavar="NAME,...",
        names=FORMATS,
        parse=_parse_names,
        check=_check_names,
    )
    autopilot: str = option("px4", help="Autopilot that flies the missions.", choices=tuple(CAPS))
    altitude_frame: str = option(
        "home", help="Reference of the vehicle's altitude in mission files.", choices=FRAMES
    )
    terrain: str | None = option(
        None, help="Terrain heights: a GeoTIFF file or an ESRI ASCII grid.", metavar="FILE"
    )
    terrain_error: float = option(
        TERRAIN_ERROR,
        help="Maximum error of the height above ground, at waypoints and between waypoints.",
        unit="m",
        least=0.01,
        metavar="METRES",
    )
    separation: tuple[float, ...] | Separation = option(
        (HORIZONTAL, VERTICAL),
        help=(
            "Horizontal and vertical separation. Vehicles in flight keep the horizontal distance or"
            " the vertical distance; 0 means no separation."
        ),
        metavar="HORIZONTAL[,VERTICAL]",
        parse=parse_separation,
        check=check_separation,
    )
    delay_tolerance: float = option(
        DELAY,
        help=(
            "Maximum unplanned delay of each vehicle, independent of other vehicles. The separation"
            " holds despite such delays."
        ),
        unit="s",
        least=0,
        metavar="SECONDS",
    )
    airspace: float | None = option(
        None,
        help=(
            "Distance by which turns of fixed wings may leave the area inside --margin. Default: as"
            " far as necessary; the report states the distance."
        ),
        unit="m",
        least=0,
        metavar="METRES",
    )
    ending: str | None = option(
        None,
        help=(
            "End of each mission: return (by the autopilot), land (fixed wings on a straight"
            " approach) or loiter (stay in the air). Default with a separation or --rally: multirotors"
            " land; fixed wings loiter, or land if --land is given or one flies several sorties; rovers"
            " return, or with --rally hold at home."
        ),
        choices=ENDINGS,
    )
    rally: str | None = option(
        None,
        help="CSV or GeoJSON file of rally points, where vehicles may land in an emergency.",
        metavar="FILE",
    )
    cap: int | None = option(
        None, help="Maximum number of mission items that the autopilot can store.", least=1
    )

    def check_together(self) -> None:
        """Refuse options without effect."""
        _check_effects(self)

    @property
    def required_separation(self) -> Separation | None:
        """The separation of vehicles in flight, or None if the planner does not keep vehicles
        apart.
        """
        return _separation_of(self)

    @property
    def fenced(self) -> bool:
        """Whether a file of the chosen formats contains a fence, or has one beside it."""
        return any(FORMATS.get(name).fence != "none" for name in self.format or FORMATS)

    def check_for(self, problem: SearchProblem) -> None:
        """Refuse options that are impossible for the missions of a given search. The method opens
        the region of the search.
        """
        parts, kind = len(problem.place.parts), problem.chosen_vehicle.kind
        if kind == "rover" and parts > 1:
            raise InvalidInputError(
                f"vehicle: expected a flying vehicle for a region of {parts} parts, because a rover"
                " stays in its part, got a rover; search each part separately"
            )
        if self.airspace is not None and kind != "fixed-wing":
            raise InvalidInputError(
                f"airspace: expected a fixed wing together with it, got a {kind}"
            )
        if self.altitude_frame != "home" and kind == "rover":
            raise InvalidInputError(
                "altitude_frame: expected home for a rover, which has no altitude, got"
                f" {self.altitude_frame}"
            )
        if self.altitude_frame == "ground" and self.terrain is None:
            raise InvalidInputError(
                "altitude_frame: expected home or sea without a terrain file, got ground"
            )
        if self.rally is not None and not (self.fenced and problem.place.frame):
            raise InvalidInputError(
                "rally: expected missions in degrees in the format plan or wpl, which hold rally"
                " points, got none"
            )
        if self.rally is not None and self.altitude_frame == "sea" and self.terrain is None:
            raise InvalidInputError(
                "rally: expected a terrain file with altitudes above the sea, because the heights of"
                " rally points count from home, got none"
            )


def _check_effects(options: MissionOptions | CheckOptions) -> None:
    """Refuse options without effect."""
    if "terrain_error" in options.given and options.terrain is None:
        raise InvalidInputError(
            "terrain_error: expected a terrain file together with it, got none and"
            f" {options.terrain_error:g}"
        )
    if "delay_tolerance" in options.given and _separation_of(options) is None:
        raise InvalidInputError(
            "delay_tolerance: expected a separation above 0 together with it, got 0 and"
            f" {options.delay_tolerance:g}"
        )


def _separation_of(options: MissionOptions | CheckOptions) -> Separation | None:
    if isinstance(options.separation, Separation):
        return options.separation
    horizontal, vertical = (*options.separation, VERTICAL)[:2]
    return Separation(horizontal, vertical, options.delay_tolerance) if horizontal else None


def _check_facing(value: Any) -> float | str | None:
    if isinstance(value, str) and value != TURNING:
        raise InvalidInputError(
            f"angle: expected {TURNING} or a number of degrees, got {shortened(value)}"
        )
    return (
        value if isinstance(value, str) else check_number(value, what="angle", least=-360, most=360)
    )


def _check_terrain(value: Any) -> str | Terrain:
    return value if isinstance(value, Terrain) else check_path(value, "terrain", "a file")


@dataclass(frozen=True, eq=False)
class CheckOptions(Problem):
    """Everything that a check of missions compares them with: the options of ``shoal missions
    check``.

    In Python, the region may also be a `SearchRegion`, the separation a `Separation`, and the
    terrain a `Terrain`.

    Examples
    --------
    >>> CheckOptions("square:100", vehicle="multirotor,detector_width=8").sides
    8.0
    """

    part: ClassVar[str] = "missions check"

    region: Any = option_of(SearchProblem, "region")
    footprint: float | tuple[float, ...] | None = option_of(
        SearchProblem,
        "footprint",
        help=(
            "Side of the square that a robot sees around each point of its path, or one side for"
            " each robot, separated by commas. Default: the view of --vehicle's camera or detector;"
            " without either, coverage is not measured."
        ),
    )
    angle: float | str | None = option(
        None,
        help=(
            "Angle of the footprints, counter-clockwise from east, or turning for footprints that"
            " turn with their vehicles. Default: as the missions were planned, or the direction of"
            " most legs."
        ),
        unit="degrees",
        metavar="DEGREES|turning",
        parse=lambda text: text if text == TURNING else float(text),
        check=_check_facing,
    )
    least: float = option(
        1 - UNSEEN_BY_IMAGES,
        help="Minimum share of the region that the vehicles must see.",
        least=0,
        most=1,
    )
    format: str | None = option(
        None,
        help=(
            f"Format of the checked files: {', '.join(FORMATS)}. Default: the first of these"
            " formats in the folder."
        ),
    )
    no_go: tuple[Any, ...] = option_of(SearchProblem, "no_go")
    layer: str | None = option_of(SearchProblem, "layer")
    inner: str | None = option_of(SearchProblem, "inner")
    hidden: str | None = option_of(SearchProblem, "hidden")
    closed_lines: bool = option_of(SearchProblem, "closed_lines")
    margin: float = option(
        0.0,
        help="Distance that all paths must keep from the border of the region and no-go zones.",
        unit="m",
        least=0,
        metavar="METRES",
    )
    cap: int | None = option_of(
        MissionOptions,
        "cap",
        help=(
            "Maximum number of mission items that the autopilot can store. Default:"
            f" {CAPS['px4']} for PX4, {CAPS['ardupilot']} for ArduPilot."
        ),
    )
    autopilot: str | None = option_of(
        MissionOptions, "autopilot", default=None, help="Required autopilot of the missions."
    )
    separation: tuple[float, ...] | Separation = option_of(MissionOptions, "separation")
    delay_tolerance: float = option_of(MissionOptions, "delay_tolerance")
    vehicle: Vehicle | str | None = option_of(
        SearchProblem,
        "vehicle",
        help=(
            "Vehicle whose climbs and turns are used for the nearest approach, and whose camera is"
            " used for coverage. Default: the speed in the file for all motion."
        ),
    )
    airspace: float | None = option_of(
        MissionOptions,
        "airspace",
        help=(
            "Distance by which turns of fixed wings may leave the area inside --margin. Default: no"
            " limit, but a warning."
        ),
    )
    fence_distance: float | None = option(
        None,
        help=(
            "Distance that all paths and rally points must keep from the fence, inside it and"
            " outside its exclusion polygons. Default: paths must only stay inside the fence."
        ),
        unit="m",
        least=0,
        metavar="METRES",
    )
    terrain: str | Terrain | None = option(
        None,
        help=(
            "Terrain heights: a GeoTIFF file or an ESRI ASCII grid. With --terrain, the check"
            " measures heights above ground on all paths."
        ),
        metavar="FILE",
        check=_check_terrain,
        parse=str,
    )
    terrain_error: float = option_of(
        MissionOptions,
        "terrain_error",
        help="Maximum error of the height above ground, for missions with altitudes above ground.",
    )
    bands: tuple[float, ...] | None = option_of(
        SearchProblem,
        "bands",
        help=(
            "Altitudes from each of which the vehicles must see the whole region. Default for a"
            " box: the layers of the box."
        ),
    )

    def check_together(self) -> None:
        """Refuse options without effect."""
        _check_effects(self)
        if isinstance(self.region, SearchRegion):
            for name in ("no_go", *READING):
                if name in self.given:
                    raise InvalidInputError(
                        f"{name}: expected a name or a file as the region together with it, got an"
                        " opened region"
                    )
        for name in ("least", "angle", "bands"):
            if name in self.given and getattr(self, name) is not None and self.sides is None:
                raise InvalidInputError(
                    f"{name}: expected a footprint, or a vehicle with a camera or detector, because"
                    f" without them coverage is not measured, got {getattr(self, name)}"
                )

    @property
    def sides(self) -> float | tuple[float, ...] | None:
        """Side of the footprint in metres, for all robots or for each; None if coverage is not
        measured.
        """
        vehicle = self.chosen_vehicle
        return self.footprint or (None if vehicle is None else vehicle.row_spacing)

    @property
    def chosen_vehicle(self) -> Vehicle | None:
        """The vehicle, or None if the speeds in the files count."""
        return None if self.vehicle is None else vehicle_of(self.vehicle)

    @property
    def required_separation(self) -> Separation | None:
        """The separation that vehicles in flight must keep, or None if the check compares no
        vehicles.
        """
        return _separation_of(self)

    def open_place(self) -> SearchRegion:
        """Open the region, with its no-go zones and its margin."""
        region = self.region
        if not isinstance(region, SearchRegion):
            reading = {name: getattr(self, name) for name in READING}
            region = open_region(region, no_go=list(self.no_go) or None, **reading)
        return with_margin(region, self.margin)

    def open_terrain(self) -> Terrain | None:
        """Open the terrain, or return None without one."""
        terrain = self.terrain
        return terrain if terrain is None or isinstance(terrain, Terrain) else open_terrain(terrain)
