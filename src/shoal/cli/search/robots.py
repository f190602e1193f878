"""shoal missions upload, start, watch and flown: missions on vehicles that speak MAVLink."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import IO, TYPE_CHECKING, Annotated, Any

import typer

from shoal.cli.options import Json, UnusedSeed
from shoal.cli.output import check_folder, print_columns, print_json, print_table, say
from shoal.core.errors import InvalidInputError
from shoal.core.interruption import patient

if TYPE_CHECKING:
    from shoal.missions.options import CheckOptions
    from shoal.robots.mavlink import LinkLimits, Station
    from shoal.robots.onboard import Cargo, Seat
    from shoal.robots.starting import Launch
    from shoal.robots.uploading import Delivery

UPLOAD_EXAMPLE = (
    "Example: shoal missions upload missions --connect udpin:0.0.0.0:14550 --systems 1=1,2=2"
    " --dry-run"
)

START_EXAMPLE = (
    "Example: shoal missions start missions --connect udpin:0.0.0.0:14550 --systems 1=1,2=2"
    " --at 14:30 --arm"
)
WATCH_EXAMPLE = (
    "Example: shoal missions watch missions --connect udpin:0.0.0.0:14550 --systems 1=1,2=2"
)

FLOWN_EXAMPLE = (
    "Example: shoal missions flown missions 1=first.bin 2=second.ulg --region field.json"
    " --footprint 20 --out flown"
)

Folder = Annotated[
    Path, typer.Argument(metavar="DIR", help="Folder of mission files (.plan or .waypoints).")
]
Connect = Annotated[
    list[str] | None,
    typer.Option(
        "--connect",
        metavar="LINK",
        help=(
            "Link to the vehicles: udpin:HOST:PORT (wait for them), udpout:HOST:PORT (speak first),"
            " tcp:HOST:PORT or serial:DEVICE[@BAUD] (57600 baud by default). The option can be"
            " repeated."
        ),
    ),
]
Systems = Annotated[
    str,
    typer.Option(
        "--systems",
        metavar="ROBOT=SYSTEM,...",
        help=(
            "MAVLink system id of each robot's vehicle, such as 1=1,2=7, or a file with one"
            " ROBOT=SYSTEM per line. ROBOT=SYSTEM@LINK also names the link."
        ),
    ),
]
Robots = Annotated[
    str | None,
    typer.Option(
        "--robots", metavar="ROBOTS", help="Only these robots, such as 1,3. Default: all robots."
    ),
]
Report = Annotated[
    Path | None,
    typer.Option("--out", metavar="FOLDER", help="Folder for the report as upload.json."),
]
Flights = Annotated[
    Path | None,
    typer.Option(
        "--out",
        metavar="FOLDER",
        help=(
            "Folder for the report as a JSON file, and for flight.tlog, a new flight log of all"
            " vehicles for shoal missions flown and other programs."
        ),
    ),
]
FLIGHT_LOG = "flight.tlog"
Sortie = Annotated[int, typer.Option("--sortie", help="Number of the robots' sortie.", min=1)]


def upload(
    folder: Folder,
    systems: Systems,
    connect: Connect = None,
    robots: Robots = None,
    sortie: Sortie = 1,
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run",
            help="Check the files, the systems and the links, and send nothing: no link is opened.",
        ),
    ] = False,
    out: Report = None,
    seed: UnusedSeed = 0,
    json_: Json = False,
) -> None:
    """Upload missions, fences and rally points to vehicles, and read back what is on board.

    The command sends to a vehicle its mission, its fence and its rally points, which replace what
    is on board; without a fence or rally points in the files, those on board are cleared. Then it
    reads everything back and compares it field by field. If there is a difference, it restores what
    was on board before, or clears it. It never arms a vehicle, and sends nothing to an armed one.
    The exit code is 0 only if everything on board of every vehicle equals the files.
    """
    from shoal.robots.uploading import PLANNED, new_delivery, open_stations, upload_missions

    if out is not None:
        check_folder(out)
    pairs, links = _pairs(folder, systems, connect, robots, sortie)
    if dry_run:
        deliveries = [new_delivery(cargo, seat, PLANNED) for cargo, seat in pairs]
    else:
        with patient(), open_stations(links) as stations:
            deliveries = upload_missions(pairs, stations, on_event=say)
    _report(deliveries, out, json_=json_)


def robot_numbers(text: str | None) -> list[int]:
    """Return the robots of the option ``--robots``; none stands for all."""
    if text is None:
        return []
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isdecimal() and len(part) < 7 and int(part) > 0 for part in parts):
        raise InvalidInputError(f"robots: expected numbers of robots such as 1,3, got {text!r}")
    return [int(part) for part in parts]


def _report(deliveries: list[Delivery], out: Path | None, *, json_: bool) -> None:
    """Print what became of each upload; exit with 1 if a vehicle does not have what it should."""
    wrong = [one for one in deliveries if one.status not in ("equal", "dry-run")]
    for one in deliveries:
        for note in one.notes:
            say(f"shoal: robot {one.robot}: {note}")
    for one in wrong:
        say(f"shoal: {one.sentence}")
    report = {"robots": [one.report() for one in deliveries]}
    written = _write(report, out, "upload")
    if json_:
        print_json(report)
    else:
        print_columns(
            ["robot", "system"],
            ["mission", "fence", "rally", "different", "status"],
            [_row(vars(one)) for one in deliveries],
            title="items on board",
        )
        for path in written:
            print(f"written  {path}")
    if wrong:
        raise typer.Exit(1)


def _row(delivery: dict[str, Any]) -> list[str]:
    names = ("robot", "system", "mission", "fence", "rally", "different", "status")
    return ["-" if delivery[name] is None else str(delivery[name]) for name in names]


def start(
    folder: Folder,
    systems: Systems,
    connect: Connect = None,
    robots: Robots = None,
    sortie: Sortie = 1,
    arm: Annotated[
        bool,
        typer.Option(
            "--arm", help="Arm the vehicles and start their missions. Without it, only check."
        ),
    ] = False,
    at: Annotated[
        str | None,
        typer.Option(
            "--at",
            metavar="TIME",
            help=(
                "Common start time: a time of today such as 14:30 or 14:30:00 on the clock of this"
                " computer, or +SECONDS after the checks. Default: +0."
            ),
        ),
    ] = None,
    delay_tolerance: Annotated[
        float | None,
        typer.Option(
            "--delay-tolerance",
            help=(
                "Seconds by which a start may be late. A later vehicle does not start. Default: 10."
            ),
        ),
    ] = None,
    lowest_battery: Annotated[
        int,
        typer.Option(
            "--lowest-battery", min=0, max=100, help="Battery that each vehicle needs, in percent."
        ),
    ] = 30,
    watch_: Annotated[
        bool,
        typer.Option("--watch", help="After the starts, watch until all vehicles are back."),
    ] = False,
    out: Flights = None,
    seed: UnusedSeed = 0,
    json_: Json = False,
) -> None:
    """Check that each vehicle has its mission on board and can be armed, and with --arm start each
    at its time.

    The command reads back what is on board of each vehicle and compares it with the files. It checks
    the kind of vehicle, the arming checks that the vehicle reports, and its battery. Only with
    --arm, and only if all vehicles are ready, it waits for the common start time, and arms and
    starts each vehicle at its own start time in missions.json. The exit code is 0 if all vehicles
    are ready or, with --arm, have started. Ctrl-C ends the command, and no flight.
    """
    from shoal.core.checks import check_number
    from shoal.robots.starting import Fleet, check_fleet, start_missions, watch_fleet

    for name, value in (("at", at), ("delay-tolerance", delay_tolerance), ("watch", watch_)):
        if value and not arm:
            raise InvalidInputError(f"{name}: expected --arm together with it, got none")
    tolerance = 10.0 if delay_tolerance is None else delay_tolerance
    check_number(tolerance, what="delay-tolerance", above=0)
    waiting = _seconds_until("+0" if at is None else at)
    pairs, links = _pairs(folder, systems, connect, robots, sortie)
    with _logged_stations(links, out) as stations:
        fleet = Fleet(pairs, stations)
        ready = check_fleet(fleet, lowest_battery=lowest_battery)
        if arm and ready:
            left = waiting()
            if left < 0:
                raise InvalidInputError(
                    f"at: expected a time after the checks, got {at}, which was {-left:.0f} s ago"
                )
            say(f"all vehicles are ready; the common start is in {left:.0f} s")
            start_missions(fleet, begin=fleet.now() + left, tolerance=tolerance, on_event=say)
            started = [one.robot for one in fleet.launches.values() if one.status == "started"]
            if watch_ and started:
                watch_fleet(fleet, of=started, on_report=_say_telemetry)
        elif arm:
            say("shoal: no vehicle was armed, because not all are ready")
        launches = [*fleet.launches.values()]
    wrong = [one for one in launches if one.status != ("started" if arm else "ready")]
    for one in wrong:
        if one.faults:
            say(f"shoal: {one.sentence}")
    wrong += _breached(launches)
    report = {"armed": bool(arm and ready), "robots": [one.report() for one in launches]}
    written = _write(report, out, "start")
    if json_:
        print_json(report)
    else:
        rows = [
            (f"robot {one.robot}", f"{one.status}, start {one.start:g} s; {telemetry_text(one)}")
            for one in launches
        ]
        print_table(rows, title="starts", written=written)
    if wrong:
        raise typer.Exit(1)


def watch(
    folder: Folder,
    systems: Systems,
    connect: Connect = None,
    robots: Robots = None,
    sortie: Sortie = 1,
    seconds: Annotated[
        float | None,
        typer.Option("--seconds", help="How long to watch at most. Default: until all are back."),
    ] = None,
    every: Annotated[
        float, typer.Option("--every", help="Seconds between two reports.", show_default=True)
    ] = 5.0,
    out: Flights = None,
    seed: UnusedSeed = 0,
    json_: Json = False,
) -> None:
    """Watch vehicles fly their missions: mode, progress, battery and breaches of the fence.

    The command sends heartbeats and nothing else. It ends when all vehicles have flown and are
    disarmed, after --seconds, or after Ctrl-C. The exit code is 1 if a vehicle is not heard or has
    breached its fence.
    """
    from shoal.core.checks import check_number
    from shoal.robots.mavlink import LinkLimits
    from shoal.robots.starting import Fleet, watch_fleet

    check_number(every, what="every", above=0)
    if seconds is not None:
        check_number(seconds, what="seconds", above=0)
    pairs, links = _pairs(folder, systems, connect, robots, sortie)
    limits = LinkLimits()
    if seconds is not None:  # finding the vehicles is a part of the watch
        limits = replace(
            limits,
            find_within=min(seconds, limits.find_within),
            settle=min(seconds, limits.settle),
        )
    with _logged_stations(links, out, limits) as stations:
        begin = stations[0].now()
        fleet = Fleet(pairs, stations)
        left = None if seconds is None else max(0.0, begin + seconds - fleet.now())
        watch_fleet(fleet, seconds=left, every=every, on_report=_say_telemetry)
        launches = [*fleet.launches.values()]
    lost = [one for one in launches if one.faults]
    for one in lost:
        say(f"shoal: {one.sentence}")
    breached = _breached(launches)
    names = ("robot", "system", "faults")
    report = {
        "robots": [
            {name: vars(one)[name] for name in names} | vars(one.telemetry) for one in launches
        ]
    }
    written = _write(report, out, "watch")
    if json_:
        print_json(report)
    else:
        rows = [(f"robot {one.robot}", telemetry_text(one)) for one in launches]
        print_table(rows, title="vehicles", written=written)
    if lost or breached:
        raise typer.Exit(1)


@contextmanager
def _logged_stations(
    links: list[str], out: Path | None, limits: LinkLimits | None = None
) -> Iterator[list[Station]]:
    """Open stations on links, and a log of what they hear in the folder ``out``."""
    from shoal.robots.uploading import open_stations

    log = None
    if out is not None:
        log = check_folder(out) / FLIGHT_LOG
        if log.exists():
            raise InvalidInputError(f"out: expected a folder without {FLIGHT_LOG}, got {out}")
    with (
        patient(),
        open_stations(links, limits) as stations,
        nullcontext() if log is None else _new_file(log) as file,
    ):
        for station in stations:
            station.log = file
        yield stations


def _new_file(path: Path) -> IO[bytes]:
    path.parent.mkdir(parents=True, exist_ok=True)
    return path.open("xb")


def _write(report: dict[str, Any], out: Path | None, name: str) -> list[Path]:
    """Write a report into a folder, if there is one, and return the written files."""
    if out is None:
        return []
    from shoal.core.files import write_json

    write_json(out / f"{name}.json", report)
    log = out / FLIGHT_LOG
    return [out / f"{name}.json", *([log] if name != "upload" else [])]


def _breached(launches: list[Launch]) -> list[Launch]:
    """Return the vehicles that have breached their fence, and say so."""
    breached = [one for one in launches if one.telemetry.breaches]
    for one in breached:
        say(f"shoal: robot {one.robot} (system {one.system}): it has breached its fence")
    return breached


def _say_telemetry(launches: list[Launch]) -> None:
    for one in launches:
        say(f"robot {one.robot}: {telemetry_text(one)}")


def telemetry_text(launch: Launch) -> str:
    """Return what a vehicle has told of itself as text."""
    told = launch.telemetry
    parts = [f"{'armed' if told.armed else 'disarmed'} in {told.mode}"]
    parts += [f"item {told.item} of {launch.items}"] if told.item is not None else []
    parts += [f"battery {told.battery} %"] if told.battery is not None else []
    parts += [f"{told.height:.0f} m above home"] if told.height is not None else []
    parts += [f"{told.breaches} breaches of the fence"] if told.breaches else []
    parts += [f"not heard for {told.heard_s:.0f} s"] if told.heard_s > _SILENT else []
    return ", ".join(parts)


_SILENT = 3.0  # seconds


def _pairs(
    folder: Path, systems: str, connect: list[str] | None, robots: str | None, sortie: int
) -> tuple[list[tuple[Cargo, Seat]], list[str]]:
    """Return each robot's cargo with its vehicle, and the links, all checked."""
    from shoal.robots.mavlink import check_link
    from shoal.robots.onboard import pair, read_cargos, read_seats
    from shoal.robots.uploading import links_of
    from shoal.search.regions.formats.flight_logs import dialect

    dialect()
    seats = read_seats(systems)
    pairs = pair(read_cargos(folder, sortie=sortie), seats, robots=robot_numbers(robots))
    links = links_of(connect or [], seats)
    for link in links:
        check_link(link)
    return pairs, links


def _seconds_until(text: str) -> Callable[[], float]:
    """Return a function that tells how many seconds are left to the time ``text``."""
    if re.fullmatch(r"\+[0-9]{1,6}(\.[0-9]{1,6})?", text):
        return lambda: float(text)
    found = re.fullmatch("([01]?[0-9]|2[0-3]):([0-5][0-9])(?::([0-5][0-9]))?", text)
    if found is None:
        raise InvalidInputError(f"at: expected HH:MM, HH:MM:SS or +SECONDS, got {text!r}")
    hour, minute, second = (int(part or 0) for part in found.groups())
    moment = datetime.now().replace(hour=hour, minute=minute, second=second, microsecond=0)

    def left() -> float:
        return (moment - datetime.now()).total_seconds()

    return left


_OF_CHECK = ("region", "footprint", "vehicle", "angle", "margin", "no_go", "separation", "least")


def flown(
    folder: Folder,
    logs: Annotated[
        list[str],
        typer.Argument(
            metavar="LOG...",
            help=(
                "Flight logs: .tlog (MAVLink), .bin (ArduPilot) or .ulg (PX4), as FILE or"
                " ROBOT=FILE."
            ),
        ),
    ],
    systems: Annotated[
        str | None,
        typer.Option(
            "--systems",
            metavar="ROBOT=SYSTEM,...",
            help="MAVLink system id of each robot's vehicle, for a .tlog with several vehicles.",
        ),
    ] = None,
    sortie: Sortie = 1,
    region: Annotated[
        str | None,
        typer.Option(
            "--region",
            metavar="REGION",
            help="Region that was searched. Without it, the seen area is not measured.",
        ),
    ] = None,
    footprint: Annotated[
        str | None,
        typer.Option(
            "--footprint",
            metavar="METRES",
            help="Side of the square that a robot sees, or one side for each robot.",
        ),
    ] = None,
    vehicle: Annotated[
        str | None,
        typer.Option(
            "--vehicle", metavar="VEHICLE", help="Vehicle whose camera or detector gives the view."
        ),
    ] = None,
    angle: Annotated[
        float | None,
        typer.Option(
            "--angle",
            metavar="DEGREES",
            help=(
                "Angle of the footprints. Default: the angle for which the missions were planned."
            ),
        ),
    ] = None,
    margin: Annotated[
        float | None,
        typer.Option(
            "--margin", metavar="METRES", help="Distance that paths keep from the border."
        ),
    ] = None,
    no_go: Annotated[
        list[str] | None,
        typer.Option("--no-go", metavar="FILE", help="No-go zones, beside those of the region."),
    ] = None,
    separation: Annotated[
        str | None,
        typer.Option(
            "--separation",
            metavar="METRES,METRES",
            help="Horizontal and vertical separation that vehicles had to keep.",
        ),
    ] = None,
    least: Annotated[
        float | None,
        typer.Option(
            "--least",
            help="Minimum share of the region that the vehicles must have seen. Default: 0.999.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FOLDER",
            help="Folder for flown.json and, if some of the region was not seen, rest.geojson.",
        ),
    ] = None,
    seed: UnusedSeed = 0,
    json_: Json = False,
) -> None:
    """Compare flight logs with their missions: what was flown and seen, and what is left.

    A vehicle sees while it follows the search of its mission. With --out, the rest of the region
    becomes the file rest.geojson, a region for a new search (with --transit, if it has several
    parts). The exit code is 1 if less than --least of the region was seen, or if vehicles came
    nearer to each other than --separation, or may have, because the logs have gaps.
    """
    from shoal.core.files import write_json
    from shoal.missions.files import open_sheets
    from shoal.robots.flown import assign_tracks, check_flown
    from shoal.robots.onboard import read_cargos, read_seats
    from shoal.search.regions.formats.flight_logs import read_tracks

    if out is not None:
        check_folder(out)
    given = dict(
        zip(
            _OF_CHECK,
            (region, footprint, vehicle, angle, margin, no_go, separation, least),
            strict=True,
        )
    )
    options = _check_options(
        {name: value for name, value in given.items() if value not in (None, [])}
    )
    missions = {robot: one.mission for robot, one in read_cargos(folder, sortie=sortie).items()}
    seats = {} if systems is None else read_seats(systems)
    found = []
    for text in logs:
        named = re.fullmatch("([1-9][0-9]{0,5})=(.+)", text, re.DOTALL)
        tracks = read_tracks(text if named is None else named[2])
        found.append((None if named is None else int(named[1]), tracks))
    pairs = assign_tracks(missions, found, {seat.system: robot for robot, seat in seats.items()})
    angles = [sheet.footprint_angle for sheet in open_sheets(folder)]
    result = check_flown(pairs, options, angle=angles[0])
    report, written = result.report(), []
    if out is not None:
        written.append(out / "flown.json")
        write_json(written[0], report)
        rest = out / "rest.geojson"
        if result.write_uncovered(rest):
            written.append(rest)
    for note in report["notes"]:
        say(f"shoal: {note}")
    if json_:
        print_json(report)
    else:
        print_table(_flown_rows(report), title="flown", written=written)
    faults = _flown_faults(report, options)
    if result.unmeasured and separation is not None:
        faults.append("the separation is not known for the whole flights")
    if faults:
        say(f"shoal: {' and '.join(faults)}")
        raise typer.Exit(1)


def _check_options(given: dict[str, Any]) -> CheckOptions | None:
    """Return the options of a check from what was given, or None without a region."""
    from shoal.cli.options import parsed
    from shoal.missions.options import CheckOptions

    if "region" not in given:
        for name, value in given.items():
            raise InvalidInputError(
                f"{name.replace('_', '-')}: expected --region together with it, got {value!r} alone"
            )
        return None
    known = CheckOptions.declarations()
    return CheckOptions(**{name: parsed(known[name], value) for name, value in given.items()})


def _flown_faults(report: dict[str, Any], options: CheckOptions | None) -> list[str]:
    faults = []
    seen, near = report["covered_fraction"], report["nearest_approach"]
    if options is not None and seen is not None and seen < options.least:
        faults.append(
            f"{100 * seen:.5g} % of the region was seen, less than {100 * options.least:g} %"
        )
    apart = None if options is None else options.required_separation
    if near is not None and apart is not None and near["horizontal_m"] < apart.horizontal:
        one, other = near["robots"]
        faults.append(f"robots {one} and {other} came within {near['horizontal_m']:.3g} m")
    return faults


def _flown_rows(report: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the rows of the summary of what was flown."""
    rows = [
        (
            f"robot {one['robot']}",
            (
                f"{one['duration_s'] / 60:.1f} min and {one['length_m']:.0f} m of"
                f" {one['planned_length_m']:.0f} m; {one['searched_m']:.0f} m of"
                f" {one['planned_search_m']:.0f} m of its search, at most"
                f" {one['farthest_m']:.1f} m beside it"
            ),
        )
        for one in report["robots"]
    ]
    if report["covered_fraction"] is not None:
        rows.append(("seen", f"{100 * report['covered_fraction']:.6g} % of {report['region']}"))
        rows.append(
            (
                "not seen",
                f"{report['uncovered_m2']:.4g} m², of which {report['rest_m2']:.4g} m² are in parts"
                " large enough for a new search",
            )
        )
    near = report["nearest_approach"]
    if near is not None:
        rows.append(
            (
                "nearest",
                (
                    f"{near['horizontal_m']:.3g} m, and {near['vertical_m']:.3g} m in height:"
                    f" robots {near['robots'][0]} and {near['robots'][1]} after"
                    f" {near['time_s']:.0f} s"
                ),
            )
        )
    if report["without_positions_s"]:
        rows.append(
            ("not compared", f"{report['without_positions_s']:.3g} s of flight without positions")
        )
    return rows
