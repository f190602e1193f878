"""shoal missions: check mission files."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from shoal.cli import options
from shoal.cli.options import help_of, parsed
from shoal.cli.output import check_folder, print_json, print_table, say
from shoal.core.checks import check_number, count_text
from shoal.core.errors import InvalidInputError
from shoal.search.flight.vehicle import vehicle_of
from shoal.search.problem import SearchProblem
from shoal.search.problem.mission_options import MissionOptions, parse_separation

if TYPE_CHECKING:
    from shoal.missions import Diagnostic, MissionCheck
    from shoal.search.flight.separation import Separation
    from shoal.search.flight.vehicle import Vehicle

CHECK_EXAMPLE = "Example: shoal missions check missions field.json --footprint 20"

_FLIGHTS = 12  # maximum number of printed flights
_SHOWN = 3  # maximum number of diagnostics of one kind in one file

Folder = Annotated[
    Path,
    typer.Argument(
        metavar="DIR", help="Folder of mission files (.plan .waypoints .geojson .kml .gpx .csv)."
    ),
]
_FIELDS = SearchProblem.declarations()
Region = Annotated[str, typer.Argument(metavar="REGION", help=help_of(_FIELDS["region"]))]
NoGo = Annotated[
    list[str] | None, typer.Option("--no-go", metavar="FILE", help=help_of(_FIELDS["no_go"]))
]
Layer = Annotated[str | None, typer.Option("--layer", help=help_of(_FIELDS["layer"]))]
Inner = Annotated[str | None, typer.Option("--inner", help=help_of(_FIELDS["inner"]))]
Hidden = Annotated[str | None, typer.Option("--hidden", help=help_of(_FIELDS["hidden"]))]
ClosedLines = Annotated[bool, typer.Option("--closed-lines", help=help_of(_FIELDS["closed_lines"]))]
Margin = Annotated[
    float, typer.Option("--margin", metavar="METRES", help=help_of(_FIELDS["margin"]))
]
Footprint = Annotated[
    str | None,
    typer.Option(
        "--footprint",
        metavar="METRES",
        help=(
            "Side of the square that a robot sees around each point of its path, or one side for"
            " each robot, separated by commas. Default: the view of --vehicle's camera or detector;"
            " without either, coverage is not measured."
        ),
    ),
]
Angle = Annotated[
    float | None,
    typer.Option(
        "--angle",
        metavar="DEGREES",
        help=(
            "Angle of the footprints, counter-clockwise from east. Default: the direction of most"
            " legs."
        ),
    ),
]
LEAST = 0.999
Least = Annotated[
    float | None,
    typer.Option(
        "--least",
        show_default=str(LEAST),
        help="Minimum share of the region that the vehicles must see, from 0 to 1.",
    ),
]
Format = Annotated[
    str | None,
    typer.Option(
        "--format",
        help=(
            "Format of the checked files: plan, wpl, geojson, kml, gpx or csv. Default: the first"
            " of these formats in the folder."
        ),
    ),
]
Cap = Annotated[
    int | None,
    typer.Option(
        "--cap",
        help=(
            "Maximum number of mission items that the autopilot can store. Default: 2000 for PX4,"
            " 700 for ArduPilot."
        ),
    ),
]
Autopilot = Annotated[
    str | None,
    typer.Option("--autopilot", help="Required autopilot of the missions: px4 or ardupilot."),
]
_KEPT = MissionOptions.declarations()
SEPARATION, DELAY = (
    _KEPT["separation"].text(_KEPT["separation"].default),
    _KEPT["delay_tolerance"].default,
)
Separated = Annotated[
    str,
    typer.Option(
        "--separation",
        metavar=_KEPT["separation"].option.metavar,
        help=help_of(_KEPT["separation"]),
    ),
]
Late = Annotated[
    float | None,
    typer.Option(
        "--delay-tolerance",
        metavar="SECONDS",
        show_default=str(DELAY),
        help=help_of(_KEPT["delay_tolerance"]),
    ),
]
FlownBy = Annotated[
    str | None,
    typer.Option(
        "--vehicle",
        metavar="NAME|FILE[,FIELD=VALUE...]",
        help=(
            "Vehicle whose climbs and turns are used for the nearest approach, and whose camera is"
            " used for coverage. Default: the speed in the file for all motion."
        ),
    ),
]
Airspace = Annotated[
    float | None,
    typer.Option(
        "--airspace",
        metavar=_KEPT["airspace"].option.metavar,
        help=(
            "Distance by which turns of fixed wings may leave the area inside --margin. Default: no"
            " limit, but a warning."
        ),
    ),
]
FenceDistance = Annotated[
    float | None,
    typer.Option(
        "--fence-distance",
        metavar="METRES",
        help=(
            "Distance that all paths and rally points must keep from the fence, inside it and"
            " outside its exclusion polygons. Default: paths must only stay inside the fence."
        ),
    ),
]
OverTerrain = Annotated[
    Path | None,
    typer.Option(
        "--terrain",
        metavar=_KEPT["terrain"].option.metavar,
        help=(
            "Terrain heights: a GeoTIFF file or an ESRI ASCII grid. With --terrain, the check"
            " measures heights above ground on all paths."
        ),
    ),
]
HeightError = Annotated[
    float | None,
    typer.Option(
        "--terrain-error",
        show_default=str(_KEPT["terrain_error"].default),
        metavar=_KEPT["terrain_error"].option.metavar,
        help=(
            "Maximum error of the height above ground, in metres, for missions with altitudes above"
            " ground."
        ),
    ),
]
Bands = Annotated[
    str | None,
    typer.Option(
        "--bands",
        metavar=_FIELDS["bands"].option.metavar,
        help=(
            "Altitudes from each of which the vehicles must see the whole region. Default for a"
            " box: the layers of the box."
        ),
    ),
]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out",
        metavar="FOLDER",
        help=(
            "Folder for check.json and map.png, and for uncovered.geojson if coverage is measured:"
            " with --footprint, or with a --vehicle that has a camera or detector."
        ),
    ),
]


def check(
    folder: Folder,
    region: Region,
    footprint: Footprint = None,
    angle: Angle = None,
    least: Least = None,
    format_: Format = None,
    no_go: NoGo = None,
    layer: Layer = None,
    inner: Inner = None,
    hidden: Hidden = None,
    closed_lines: ClosedLines = False,
    margin: Margin = 0.0,
    cap: Cap = None,
    autopilot: Autopilot = None,
    separation: Separated = SEPARATION,
    delay_tolerance: Late = None,
    vehicle: FlownBy = None,
    airspace: Airspace = None,
    fence_distance: FenceDistance = None,
    terrain: OverTerrain = None,
    terrain_error: HeightError = None,
    bands: Bands = None,
    seed: options.UnusedSeed = 0,
    out: Out = None,
    json_: options.Json = False,
) -> None:
    """Check mission files: report mistakes, and measure the share of a region that the vehicles
    see.

    The check uses no code of Shoal's mission planner. The exit code is 1 in three cases: the files
    contain mistakes, the vehicles see less than --least of the region, or vehicles come too near to
    each other or to the ground.
    """
    from shoal.missions import check_missions
    from shoal.search import open_region
    from shoal.search.flight.terrain import open_terrain
    from shoal.search.regions.margin import with_margin

    if least is not None:
        check_number(least, what="--least", least=0, most=1)
    if terrain_error is not None:
        check_number(terrain_error, what="--terrain-error", least=0.01)
        if terrain is None:
            raise InvalidInputError(
                f"--terrain-error: expected --terrain together with it, got {terrain_error:g} alone"
            )
    if out is not None:
        check_folder(out)
    sides = None if footprint is None else parsed(_FIELDS["footprint"], footprint)
    searched = open_region(
        region,
        no_go=no_go or None,
        layer=layer,
        inner=inner,
        hidden=hidden,
        closed_lines=closed_lines,
    )
    late: dict[str, Any] = {} if delay_tolerance is None else {"delay_tolerance": delay_tolerance}
    kept = MissionOptions(separation=parse_separation(separation), **late).kept_apart
    flown = None if vehicle is None else vehicle_of(vehicle)
    if sides is None and flown is not None:
        sides = flown.row_spacing
    if sides is None:
        for option, value in (("--least", least), ("--angle", angle), ("--bands", bands)):
            if value is not None:
                raise InvalidInputError(
                    f"{option}: expected --footprint, or a --vehicle with a camera or detector,"
                    f" because without them coverage is not measured, got {value}"
                )
    searched = with_margin(searched, check_number(margin, what="--margin", least=0))
    result = check_missions(
        folder,
        searched,
        sides,
        angle=angle,
        format=format_,
        cap=cap,
        autopilot=autopilot,
        separation=kept,
        vehicle=flown,
        bands=None if bands is None else parsed(_FIELDS["bands"], bands),
        airspace=None if airspace is None else check_number(airspace, what="--airspace", least=0),
        terrain=None if terrain is None else open_terrain(terrain),
        fence_distance=(
            None
            if fence_distance is None
            else check_number(fence_distance, what="--fence-distance", least=0)
        ),
    )
    written = []
    if out is not None:
        from shoal.views.search.mission_folder import write_check

        written = write_check(result, out)
    if json_:
        print_json(result.report())
    else:
        _print(result, written, flown)
    faults = _faults(
        result,
        kept,
        least=LEAST if least is None else least,
        terrain_error=terrain_error or _KEPT["terrain_error"].default,
    )
    if faults:
        say(f"shoal: {' and '.join(faults)}")
        raise typer.Exit(1)


def _faults(
    result: MissionCheck, kept: Separation | None, *, least: float, terrain_error: float
) -> list[str]:
    """Return the reasons why missions fail the check, one clause for each reason."""
    from shoal.missions.rules import ROUNDING

    near, low = result.approach, result.clearance
    faults = (
        [f"{count_text(len(distinct(result.errors)), 'mistake')} in the mission files"]
        if result.errors
        else []
    )
    if result.coverage is not None and result.coverage.covered_fraction < least:
        faults.append(
            f"{100 * result.coverage.covered_fraction:.5g} % of the region is seen, less than"
            f" {100 * least:g} %"
        )
    if kept is not None and near is not None and near.horizontal < kept.horizontal - ROUNDING:
        faults.append(
            f"robots {near.robots[0]} and {near.robots[1]} come within {near.horizontal:.3g} m"
        )
    if low is not None and low.lowest <= 0:
        faults.append(f"{low.missions[0]} meets the ground")
    if low is not None and low.error > terrain_error:
        faults.append(
            f"heights above ground differ from the altitudes asked for by up to {low.error:.3g} m"
        )
    return faults


def _print(result: MissionCheck, written: list[Path], flown: Vehicle | None) -> None:
    seen = result.coverage
    region = result.region
    rows = [
        ("region", f"{region.name}, {region.area_m2:.6g} m²{zones_text(region.no_go_zones)}"),
        ("format", result.format),
    ]
    rows += [
        (
            "flown",
            (
                f"{count_text(len(result.files), 'mission')},"
                f" {count_text(result.n_waypoints, 'waypoint')}"
            ),
        )
    ]
    if seen is None:
        rows.append(("coverage", "not measured: give --footprint, or a --vehicle with a camera"))
    else:
        rows += [
            ("seen", f"{100 * seen.covered_fraction:.6g} % with {_footprint(result.footprint)}"),
            *(
                ("", f"{100 * one.covered_fraction:.6g} % at {up:.4g} m")
                for up, one in zip(result.bands, result.coverages, strict=False)
            ),
            ("not seen", area_text(seen.uncovered_m2)),
            ("outside", f"{seen.outside_m:.6g} m of {seen.length_m:.6g} m"),
        ]
    if result.separation is not None:
        told = None if result.approach is None else result.approach.report(region.frame)
        nearest = approach_text(told, result.separation.horizontal, result.separation.vertical)
        rows.append(
            (
                "nearest",
                (
                    nearest
                    if flown is not None
                    else (
                        f"{nearest}; by the speeds in the files, give --vehicle for climbs and"
                        " turns"
                    )
                ),
            )
        )
    if flown is not None:
        rows += flights_rows(
            result.flights, None if flown.endurance is None else flown.usable_seconds
        )
    if result.clearance is not None:
        low = result.clearance
        rows.append(
            (
                "above ground",
                (
                    f"{low.lowest:.4g} m ({low.missions[0]}) to {low.highest:.4g} m"
                    f" ({low.missions[1]})"
                ),
            )
        )
    errors, warnings = (
        len(distinct(some))
        for some in (result.errors, tuple({*result.diagnostics} - {*result.errors}))
    )
    rows.append(("mistakes", f"{errors}, and {count_text(warnings, 'warning')}"))
    rows += [(diagnostic.severity, text) for diagnostic, text in _shown(result.diagnostics)]
    print_table(rows, title="mission check", written=written)


def area_text(area: float) -> str:
    """Return an area as text. An area below one square millimetre counts as zero."""
    return f"{area:.3g} m²" if area >= 1e-6 else "0 m²"


def zones_text(count: int) -> str:
    """Return the number of no-go zones as text, to append to the description of a region. For no
    zones, the text is empty.
    """
    return f", {count} no-go zone{'s' * (count > 1)}" if count else ""


def margin_text(margin: float, unseen: float) -> str:
    """Return a text with the area that vehicles cannot see because of the margin, to append to a
    region's description.
    """
    return f"; {area_text(unseen)} cannot be seen with the margin of {margin:g} m" if margin else ""


def approach_text(near: dict[str, Any] | None, horizontal: float, vertical: float) -> str:
    """Return the nearest approach of two vehicles as text."""
    if near is None:
        return f"no two vehicles in flight are nearer than {vertical:g} m in height"
    one, other = near["robots"]
    place = (
        f"({near['x']:.6g}, {near['y']:.6g}) m"
        if "latitude" not in near
        else f"{near['latitude']:.6f}, {near['longitude']:.6f}"
    )
    sortie = (
        f" in sorties {' and '.join(map(str, near['sorties']))}" if max(near["sorties"]) > 1 else ""
    )
    return (
        f"{near['horizontal_m']:.4g} m, and {near['vertical_m']:.3g} m in height: robots {one} and"
        f" {other} after {near['time_s']:.0f} s{sortie} at {place}; required: {horizontal:g} m, or"
        f" {vertical:g} m in height"
    )


def flights_rows(flights: Sequence[dict[str, Any]], usable: float | None) -> list[tuple[str, str]]:
    """Return the rows of a summary with the duration of each mission and its share of the usable
    time.

    Examples
    --------
    >>> flights_rows([{"mission": "robot-01", "duration_s": 630.0, "usable_fraction": 0.5}], 1260.0)
    [('flight', 'robot-01: 10.5 min, 50 % of the 21 min that the battery allows without its reserve')]
    """
    rows = []
    for number, one in enumerate(flights[:_FLIGHTS]):
        share = "" if usable is None else f", {100 * one['usable_fraction']:.3g} %"
        of = (
            ""
            if usable is None or number
            else f" of the {usable / 60:.4g} min that the battery allows without its reserve"
        )
        rows.append(("flight", f"{one['mission']}: {one['duration_s'] / 60:.1f} min{share}{of}"))
    left = [one["duration_s"] / 60 for one in flights[_FLIGHTS:]]
    return rows + ([("", f"and {len(left)} more, of at most {max(left):.1f} min")] if left else [])


def _footprint(sides: float | tuple[float, ...] | None) -> str:
    if not isinstance(sides, tuple):
        return f"a footprint of {sides:g} m"
    return f"footprints of {', '.join(f'{side:g}' for side in sides)} m"


def _shown(diagnostics: tuple[Diagnostic, ...]) -> list[tuple[Diagnostic, str]]:
    """Return the lines to print, each together with its diagnostic.

    For each mission and kind of mistake, the lines contain the first few diagnostics and the number
    of further diagnostics.
    """
    alike = distinct(diagnostics)
    totals = Counter((Path(same[0].file).stem, same[0].rule) for same in alike)
    so_far: Counter[tuple[str, str]] = Counter()
    lines = []
    for same in alike:
        first = same[0]
        key = Path(first.file).stem, first.rule
        so_far[key] += 1
        others = ", ".join(
            dict.fromkeys(Path(one.file).suffix for one in same if one.file != first.file)
        )
        place = f"{first.file}{', ' * bool(first.place)}{first.place}{f' (also {others})' if others else ''}"
        if so_far[key] <= _SHOWN:
            lines.append((first, f"{place}: {first.sentence}"))
        elif so_far[key] == _SHOWN + 1:
            lines.append((first, f"{first.file}: {totals[key] - _SHOWN} more like it"))
    return lines


def distinct(diagnostics: tuple[Diagnostic, ...]) -> list[list[Diagnostic]]:
    """Return the diagnostics in groups, one group for each mistake in a mission.

    A mission may have several files, one for each file format. A group contains one diagnostic from
    each file that has the mistake. If a file has several diagnostics with the same rule and
    sentence, the k-th of these diagnostics from each file form one group.
    """
    found: dict[tuple[str, str, str, int], list[Diagnostic]] = {}
    so_far: Counter[tuple[str, str, str]] = Counter()
    for one in diagnostics:
        sentence = re.sub(
            r"\d+\.\d+", lambda number: f"{float(number[0]):.6f}", one.sentence
        )  # formats round differently
        so_far[one.file, one.rule, sentence] += 1
        found.setdefault(
            (Path(one.file).stem, one.rule, sentence, so_far[one.file, one.rule, sentence]), []
        ).append(one)
    return list(found.values())
