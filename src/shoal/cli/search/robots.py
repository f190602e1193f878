"""shoal missions upload, start and watch: missions on board of vehicles that speak MAVLink."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from shoal.cli.options import Json
from shoal.cli.output import print_columns, print_json, say
from shoal.core.errors import InvalidInputError
from shoal.core.interruption import patient

if TYPE_CHECKING:
    from shoal.robots.onboard import Cargo, Seat
    from shoal.robots.starting import Launch
    from shoal.robots.uploading import Delivery

UPLOAD_EXAMPLE = (
    "Example: shoal missions upload missions --connect udpin:0.0.0.0:14550 --systems 1=1,2=2"
)

START_EXAMPLE = (
    "Example: shoal missions start missions --connect udpin:0.0.0.0:14550 --systems 1=1,2=2"
    " --at 14:30 --arm"
)
WATCH_EXAMPLE = (
    "Example: shoal missions watch missions --connect udpin:0.0.0.0:14550 --systems 1=1,2=2"
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
    json_: Json = False,
) -> None:
    """Upload missions, fences and rally points to vehicles, and read back what is on board.

    The command sends to a vehicle its mission, its fence and its rally points, which replace what
    is on board; without a fence or rally points in the files, those on board are cleared. Then it
    reads everything back and compares it field by field. If there is a difference, it restores what
    was on board before, or clears it. It never arms a vehicle, and sends nothing to an armed one.
    The exit code is 0 only if everything on board of every vehicle equals the files.
    """
    from shoal.robots.uploading import PLANNED, new_delivery, stations, upload_missions

    pairs, links = _pairs(folder, systems, connect, robots, sortie)
    if dry_run:
        deliveries = [new_delivery(cargo, seat, PLANNED) for cargo, seat in pairs]
    else:
        with patient(), stations(links) as heard_by:
            deliveries = upload_missions(pairs, heard_by, on_event=say)
    _report(deliveries, json_=json_)


def robot_numbers(text: str | None) -> list[int]:
    """Return the robots of the option ``--robots``; none stands for all."""
    if text is None:
        return []
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isdecimal() and len(part) < 7 and int(part) > 0 for part in parts):
        raise InvalidInputError(f"robots: expected numbers of robots such as 1,3, got {text!r}")
    return [int(part) for part in parts]


def _report(deliveries: list[Delivery], *, json_: bool) -> None:
    """Print what became of each upload; exit with 1 if a vehicle does not have what it should."""
    wrong = [one for one in deliveries if one.status not in ("equal", "dry-run")]
    for one in deliveries:
        for note in one.notes:
            say(f"shoal: robot {one.robot}: {note}")
    for one in wrong:
        say(f"shoal: {one.sentence}")
    if json_:
        print_json({"robots": [one.report() for one in deliveries]})
    else:
        print_columns(
            ["robot", "system"],
            ["mission", "fence", "rally", "different", "status"],
            [_row(vars(one)) for one in deliveries],
            title="items on board",
        )
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
        str,
        typer.Option(
            "--at",
            metavar="TIME",
            help=(
                "Common start time: a time of today such as 14:30 or 14:30:00 on the clock of this"
                " computer, or +SECONDS after the checks."
            ),
        ),
    ] = "+0",
    delay_tolerance: Annotated[
        float,
        typer.Option(
            "--delay-tolerance",
            help="Seconds by which a start may be late. A later vehicle does not start.",
        ),
    ] = 10.0,
    lowest_battery: Annotated[
        int,
        typer.Option(
            "--lowest-battery", min=0, max=100, help="Battery that each vehicle needs, in percent."
        ),
    ] = 30,
    json_: Json = False,
) -> None:
    """Check that each vehicle has its mission on board and can be armed, and with --arm start each
    at its time.

    The command reads back what is on board of each vehicle and compares it with the files. It checks
    the kind of vehicle, the arming checks that the vehicle reports, and its battery. Only with
    --arm, and only if all vehicles are ready, it waits for the common start time, and arms and
    starts each vehicle at its own start time in missions.json. The exit code is 0 if all vehicles
    are ready or, with --arm, have started.
    """
    from shoal.core.checks import check_number
    from shoal.robots.starting import Fleet, check_fleet, start_missions
    from shoal.robots.uploading import stations

    check_number(delay_tolerance, what="delay-tolerance", above=0)
    waiting = _seconds_until(at)
    pairs, links = _pairs(folder, systems, connect, robots, sortie)
    with patient(), stations(links) as heard_by:
        fleet = Fleet(pairs, heard_by)
        ready = check_fleet(fleet, lowest_battery=lowest_battery)
        if arm and ready:
            left = waiting()
            if left < 0:
                raise InvalidInputError(
                    f"at: expected a time after the checks, got {at}, which was {-left:.0f} s ago"
                )
            say(f"all vehicles are ready; the common start is in {left:.0f} s")
            start_missions(fleet, begin=fleet.now() + left, tolerance=delay_tolerance, on_event=say)
        elif arm:
            say("shoal: no vehicle was armed, because not all are ready")
        launches = [*fleet.launches.values()]
    wrong = [one for one in launches if one.status != ("started" if arm else "ready")]
    for one in wrong:
        if one.faults:
            say(f"shoal: {one.sentence}")
    if json_:
        print_json({"armed": bool(arm and ready), "robots": [one.report() for one in launches]})
    else:
        _print_launches(launches, "starts")
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
    json_: Json = False,
) -> None:
    """Watch vehicles fly their missions: mode, progress, battery and breaches of the fence.

    The command sends heartbeats and nothing else. It ends when all vehicles have flown and are
    disarmed, after --seconds, or after Ctrl-C. The exit code is 1 if a vehicle is not heard or has
    breached its fence.
    """
    from shoal.core.checks import check_number
    from shoal.robots.starting import Fleet, watch_fleet
    from shoal.robots.uploading import stations

    check_number(every, what="every", above=0)
    if seconds is not None:
        check_number(seconds, what="seconds", above=0)
    pairs, links = _pairs(folder, systems, connect, robots, sortie)
    with patient(), stations(links) as heard_by:
        fleet = Fleet(pairs, heard_by)

        def tell(launches: list[Launch]) -> None:
            for one in launches:
                if one.robot in fleet.found:
                    total = len(fleet.cargos[one.robot].mission.waypoints)
                    say(f"robot {one.robot}: {telemetry_text(one)}; {total} waypoints")

        watch_fleet(fleet, seconds=seconds, every=every, on_report=tell)
        launches = [*fleet.launches.values()]
    lost = [one for one in launches if one.faults]
    for one in lost:
        say(f"shoal: {one.sentence}")
    breached = [one for one in launches if one.telemetry.breaches]
    for one in breached:
        say(f"shoal: robot {one.robot} (system {one.system}): it has breached its fence")
    if json_:
        names = ("robot", "system", "faults")
        print_json(
            {
                "robots": [
                    {name: vars(one)[name] for name in names} | vars(one.telemetry)
                    for one in launches
                ]
            }
        )
    else:
        _print_launches(launches, "vehicles")
    if lost or breached:
        raise typer.Exit(1)


def telemetry_text(launch: Launch) -> str:
    """Return what a vehicle has told of itself as text."""
    told = launch.telemetry
    parts = [f"{'armed' if told.armed else 'disarmed'} in {told.mode}"]
    parts += [f"item {told.item}"] if told.item is not None else []
    parts += [f"battery {told.battery} %"] if told.battery is not None else []
    parts += [f"{told.height:.0f} m above home"] if told.height is not None else []
    parts += [f"{told.breaches} breaches of the fence"] if told.breaches else []
    parts += [f"not heard for {told.heard_s:.0f} s"] if told.heard_s > _SILENT else []
    return ", ".join(parts)


_SILENT = 3.0  # seconds


def _print_launches(launches: list[Launch], title: str) -> None:
    print_columns(
        ["robot", "system"],
        ["start", "status", "vehicle"],
        [
            [str(one.robot), str(one.system), f"{one.start:g} s", one.status, telemetry_text(one)]
            for one in launches
        ],
        title=title,
    )


def _pairs(
    folder: Path, systems: str, connect: list[str] | None, robots: str | None, sortie: int
) -> tuple[list[tuple[Cargo, Seat]], list[str]]:
    """Return each robot's cargo with its vehicle, and the links, all checked."""
    from shoal.robots.mavlink import check_link, dialect
    from shoal.robots.onboard import pair, read_cargos, read_seats
    from shoal.robots.uploading import links_of

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
