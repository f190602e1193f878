"""The options of 'shoal search' and of the commands around it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from shoal.errors import InvalidInputError

Region = Annotated[
    str,
    typer.Argument(
        metavar="REGION",
        help="square:SIDE, rectangle:WxH, circle:RADIUS or ring:OUTERxINNER in metres, or a file: .geojson, .json, .kml, .gpkg, "
        ".shp or .csv (metres).",
        show_default=False,
    ),
]
Robots = Annotated[int, typer.Option("--robots", help="How many there are.", show_default=False)]
Footprint = Annotated[
    str,
    typer.Option(
        "--footprint",
        metavar="METRES",
        help="Side of the square that a robot sees; where they differ, one a robot: 2,2,6.",
        show_default=False,
    ),
]
Starts = Annotated[str, typer.Option("--starts", help="random, clustered, line, or a CSV file of points, one a robot.")]
TourName = Annotated[
    str,
    typer.Option("--tour", help="spanning-tree, comb, hilbert-rectangle, hilbert, moore, open-hilbert or MODULE:ATTRIBUTE."),
]
AllocationName = Annotated[
    str, typer.Option("--allocation", help="hop, two-way, individual-shift, common-shift, stay or MODULE:ATTRIBUTE.")
]
NoGo = Annotated[
    list[Path] | None,
    typer.Option(
        "--no-go", metavar="FILE", help="Zones to keep out of, in the units of REGION. May be given again.", show_default=False
    ),
]
TurnCost = Annotated[float, typer.Option("--turn-cost", help="What a turn costs, in cells.")]
Speed = Annotated[float, typer.Option("--speed", help="Metres a second.")]
Rates = Annotated[
    str, typer.Option("--rates", metavar="R,R,...", help="Speeds of the robots, as multiples of --speed.", show_default=False)
]
Energy = Annotated[float, typer.Option("--energy", help="Metres that a robot can go before it must be back at its start.")]
Recharge = Annotated[float, typer.Option("--recharge", help="Seconds that it stays there.")]
Fold = Annotated[int, typer.Option("--fold", help="How many different robots must search each cell.")]
Transit = Annotated[bool, typer.Option("--transit", help="Robots fly: they may cross what lies between the parts of a region.")]
Loss = Annotated[float, typer.Option("--loss", help="Share of messages that are lost.")]
NetworkName = Annotated[
    str,
    typer.Option(
        "--network",
        metavar="MODEL,...",
        help="perfect, loss:P, bursts:WORSEN:MEND, range:CELLS, partition:SINCE:UNTIL, delay:MEAN, duplicates:P, corruption:P.",
    ),
]
Kill = Annotated[
    list[str] | None,
    typer.Option(
        "--kill",
        metavar="ROBOT@TIME",
        help="The robot dies then: robots from 1 on, time as that of so many cells. May be given again.",
        show_default=False,
    ),
]
Targets = Annotated[int, typer.Option("--targets", help="How many things to find there are, in random cells.")]
Detection = Annotated[float, typer.Option("--detection", help="Probability that a robot finds what is in a cell.")]
FalseAlarm = Annotated[float, typer.Option("--false-alarm", help="Probability that it finds what is not there.")]
Obstacles = Annotated[
    str,
    typer.Option(
        "--obstacles",
        metavar="N|FILE",
        help="Cells that cannot be entered, as robots find out on the way: a number of random ones, or a CSV file of points.",
    ),
]
Missions = Annotated[
    Path | None, typer.Option("--missions", metavar="DIR", help="Write a mission for each robot there.", show_default=False)
]
Formats = Annotated[
    str,
    typer.Option(
        "--format",
        metavar="NAME,...",
        help="Formats of the missions: plan, wpl, geojson, kml, gpx, csv; default: all that can say where the region is.",
        show_default=False,
    ),
]
Vehicle = Annotated[str, typer.Option("--vehicle", help="px4 or ardupilot.")]
Kind = Annotated[str, typer.Option("--kind", help="multirotor or rover.")]
Altitude = Annotated[
    float | None, typer.Option("--altitude", help="Metres above the start; 30 for a multirotor.", show_default=False)
]
Cap = Annotated[int | None, typer.Option("--cap", help="Mission items that the vehicle stores.", show_default=False)]
Simulate = Annotated[
    bool | None,
    typer.Option(
        "--simulate/--no-simulate",
        help="Simulate robots and messages; default: if cells times robots are a million or less.",
        show_default=False,
    ),
]
Live = Annotated[
    bool, typer.Option("--live", help="One process a robot over real UDP instead of a simulation; --kill kills the process.")
]
LiveSpeed = Annotated[float, typer.Option("--live-speed", help="Cells a second of a live robot.")]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out", metavar="FOLDER", help="Write region.png, timeline.png, the episode and summary.json there.", show_default=False
    ),
]
Film = Annotated[
    list[Path] | None,
    typer.Option(
        "--film",
        metavar="FILE",
        help="Write a film of the search: .gif, .mp4 or .html (the player). May be given again.",
        show_default=False,
    ),
]


def parse_numbers(option: str, text: str) -> list[float] | None:
    """Return the numbers of an option, None if it is empty.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> parse_numbers("--rates", "1,1.5")
    [1.0, 1.5]
    """
    if not text.strip():
        return None
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise InvalidInputError(f"{option}: expected numbers separated by commas, one a robot, got {text[:80]!r}") from None


def parse_footprint(text: str) -> float | list[float]:
    """Return what ``--footprint`` says: a length for all robots, or one for each.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> parse_footprint("10"), parse_footprint("2,2,6")
    (10.0, [2.0, 2.0, 6.0])
    """
    found = parse_numbers("--footprint", text)
    if found is None:
        raise InvalidInputError("--footprint: expected metres, got nothing")
    return found[0] if len(found) == 1 else found
