"""shoal missions upload: bring missions on board of vehicles that speak MAVLink."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from shoal.cli.options import Json
from shoal.cli.output import print_columns, print_json, say
from shoal.core.errors import InvalidInputError
from shoal.core.interruption import patient

if TYPE_CHECKING:
    from shoal.robots.uploading import Delivery

UPLOAD_EXAMPLE = (
    "Example: shoal missions upload missions --connect udpin:0.0.0.0:14550 --systems 1=1,2=2"
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
    from shoal.robots.mavlink import check_link, dialect
    from shoal.robots.onboard import pair, read_cargos, read_seats
    from shoal.robots.uploading import PLANNED, links_of, new_delivery, stations, upload_missions

    dialect()
    seats = read_seats(systems)
    pairs = pair(read_cargos(folder, sortie=sortie), seats, robots=robot_numbers(robots))
    links = links_of(connect or [], seats)
    for link in links:
        check_link(link)
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
