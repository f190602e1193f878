"""shoal missions: check mission files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from shoal.cli.options import Json, UnusedSeed, takes_problem
from shoal.cli.output import check_folder, import_matplotlib, print_json, print_table, say
from shoal.core.checks import count_text
from shoal.missions.diagnostics import group_mistakes
from shoal.missions.formats import formats_by_suffix
from shoal.missions.options import CheckOptions

if TYPE_CHECKING:
    from shoal.missions import Diagnostic, MissionCheck
    from shoal.search.flight.vehicle import Vehicle

CHECK_EXAMPLE = "Example: shoal missions check missions field.json --footprint 20"

_FLIGHTS = 12  # maximum number of printed flights
_MOMENT = 0.01  # seconds
_SHOWN = 3  # maximum number of diagnostics of one kind in one file

Folder = Annotated[
    Path,
    typer.Argument(
        metavar="DIR",
        help=f"Folder of mission files ({' '.join(formats_by_suffix())}).",
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


@takes_problem(CheckOptions)
def check(
    options: CheckOptions,
    folder: Folder,
    seed: UnusedSeed = 0,
    out: Out = None,
    json_: Json = False,
) -> None:
    """Check mission files: report mistakes, and measure the share of a region that the vehicles
    see.

    The check uses no code of Shoal's mission planner. The exit code is 1 in three cases: the files
    contain mistakes, the vehicles see less than --least of the region, or vehicles come too near to
    each other or to the ground.
    """
    from shoal.missions import MissionSet

    if out is not None:
        check_folder(out)
    result = MissionSet.read(folder).check(options)
    written = []
    if out is not None:
        import_matplotlib()
        from shoal.views.search.missions import save_missions_map

        written = [*result.write(out), *save_missions_map(result, out)]
    if json_:
        print_json(result.report())
    else:
        _print(result, written, options.chosen_vehicle)
    if result.faults:
        say(f"shoal: {' and '.join(result.faults)}")
        raise typer.Exit(1)


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
            (
                "seen",
                f"{100 * seen.covered_fraction:.6g} % with {_footprint(result)}",
            ),
            *(
                ("", f"{100 * one.covered_fraction:.6g} % at {up:.4g} m")
                for up, one in zip(result.bands, result.coverages, strict=False)
            ),
            ("not seen", area_text(seen.uncovered_m2)),
            ("outside", f"{seen.outside_m:.6g} m of {seen.length_m:.6g} m"),
        ]
        deviating = result.with_errors
        if deviating is not None and flown is not None:
            rows.append(
                (
                    "with errors",
                    (
                        f"{100 * deviating.covered_fraction:.6g} % seen, {deviating.outside_m:.6g} m outside,"
                        f" if positions are wrong by up to {flown.position_error or 0:g} m and corners"
                        f" are cut at {flown.acceptance_radius or 0:g} m"
                    ),
                )
            )
    rows += [("caution", text) for text in result.cautions]
    separation = result.options.required_separation
    if separation is not None:
        told = None if result.approach is None else result.approach.report(region.frame)
        nearest = approach_text(told, separation.horizontal, separation.vertical)
        if result.uncompared:
            some = result.uncompared[:_SHOWN]
            more = len(result.uncompared) - len(some)
            nearest += f"; not compared: {', '.join(some)}{f' and {more} more' * bool(more)}"
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
        len(group_mistakes(some))
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
        f"({near['x']:.10g}, {near['y']:.10g}) m"
        if "latitude" not in near
        else f"{near['latitude']:.6f}, {near['longitude']:.6f}"
    )
    sortie = (
        f" in sorties {' and '.join(map(str, near['sorties']))}" if max(near["sorties"]) > 1 else ""
    )
    height = (
        "heights are unknown on a return or above the terrain"
        if near["vertical_m"] is None
        else f"and {near['vertical_m']:.3g} m in height"
    )
    return (
        f"{near['horizontal_m']:.4g} m, {height}: robots {one} and {other} after"
        f" {near['time_s']:.0f} s{sortie} at {place}; required: {horizontal:g} m, or"
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
        share = ""
        if usable is not None:
            # more than the duration where a return may climb
            climbs = one["usable_fraction"] * usable > one["duration_s"] + _MOMENT
            share = (
                f", {'with a climb of its return ' * climbs}{100 * one['usable_fraction']:.3g} %"
            )
        of = (
            ""
            if usable is None or number
            else f" of the {usable / 60:.4g} min that the battery allows without its reserve"
        )
        rows.append(("flight", f"{one['mission']}: {one['duration_s'] / 60:.1f} min{share}{of}"))
    left = [one["duration_s"] / 60 for one in flights[_FLIGHTS:]]
    return rows + ([("", f"and {len(left)} more, of at most {max(left):.1f} min")] if left else [])


def _footprint(result: MissionCheck) -> str:
    """Return a text about what vehicles see at once: images of a camera, or footprints."""
    sides = result.options.sides
    if result.images is not None:
        return {
            "files": "the images of the missions",
            "vehicle": "the images of the vehicle; the files have no commands to its camera",
        }[result.images]
    if not isinstance(sides, tuple):
        return f"a footprint of {sides:g} m"
    return f"footprints of {', '.join(f'{side:g}' for side in sides)} m"


def _shown(diagnostics: tuple[Diagnostic, ...]) -> list[tuple[Diagnostic, str]]:
    """Return the lines to print, each together with its diagnostic.

    For each mission and kind of mistake, the lines contain the first few diagnostics and the number
    of further diagnostics.
    """
    alike = group_mistakes(diagnostics)
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
