"""The options that commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Map = Annotated[
    str,
    typer.Argument(
        metavar="MAP",
        help="A generated map such as vessels:5000 (see 'shoal maps'), or a file: a picture, text, .map, .npy, .csv, NIfTI, a "
        "TIFF of several pages, or a folder of slices.",
        show_default=False,
    ),
]
Particles = Annotated[int, typer.Option("-n", "--particles", help="Number of particles.")]
PolicyName = Annotated[
    str,
    typer.Option(
        "--policy",
        help="best, beam-rollout, rollout, greedy-classify, closest-frontier, elect-particle, random-moves, depth-first, sweep, "
        "offline (coverages), manual:COMMANDS or MODULE:ATTRIBUTE; options follow a colon, as in closest-frontier:ties=row-major.",
    ),
]
Budget = Annotated[
    float | None,
    typer.Option(
        "--budget",
        help="Planners (best, rollout, offline): moves that may be imagined for each move sent, on average; best and rollout are "
        "given more for other than 1000 particles, up to ten times.",
        show_default=False,
    ),
]
TimePerMove = Annotated[
    float | None,
    typer.Option(
        "--time-per-move",
        metavar="MS",
        help="Planners: milliseconds for each move, on average, instead of a budget; the commands then depend on the machine.",
        show_default=False,
    ),
]
PlacementName = Annotated[
    str,
    typer.Option("--placement", help="uniform, flood-fill, region-fill, left-wall or MODULE:ATTRIBUTE."),
]
Rule = Annotated[str, typer.Option("--rule", help="Move rule: block, merge or tilt.")]
Trials = Annotated[int, typer.Option("--trials", help="How many times, each from another start.")]
Seed = Annotated[int, typer.Option("--seed", help="The same seed gives the same result, whatever the workers.")]
MaxMoves = Annotated[int, typer.Option("--max-moves", help="Stop an episode there, with status limit.")]
ScanEvery = Annotated[
    str,
    typer.Option(
        "--scan-every",
        metavar="RULE",
        help="Equal commands before each scan: a number, doubling, hyper (i^i) or adaptive (most cells for its price). With noise "
        "a number: so many commands of a plan, or fewer where it ends.",
    ),
]
ScanCost = Annotated[float, typer.Option("--scan-cost", help="Price of a scan, in any unit.")]
MoveCost = Annotated[float, typer.Option("--move-cost", help="Price of a move, in the same unit.")]
Workers = Annotated[
    int | None,
    typer.Option("--workers", help="Trials that run at once; default: one a processor.", show_default=False),
]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out",
        metavar="FOLDER",
        help="Write map.png, frontier.png, summary.json and the episodes into this folder.",
        show_default=False,
    ),
]
Film = Annotated[
    list[Path] | None,
    typer.Option(
        "--film",
        metavar="FILE",
        help="Write a film (of several trials the first): .gif, .mp4 or .html (the player). May be given again.",
        show_default=False,
    ),
]
Slip = Annotated[float, typer.Option("--slip", help="Probability that a particle does not move at a command, 0 to 0.5.")]
Misplace = Annotated[
    float,
    typer.Option("--misplace", help="Probability that one is seen in a neighbouring cell instead of its own, 0 to 0.5."),
]
Miss = Annotated[float, typer.Option("--miss", help="Probability that a particle is not seen in a scan, 0 to 0.5.")]
Confidence = Annotated[
    float, typer.Option("--confidence", help="With noise: the probability from which a cell counts as settled, above 0.75.")
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout, and nothing else there.")]
Vessels = Annotated[bool, typer.Option("--vessels", help="MAP is a photograph: segment its vessels (needs the extra 'imaging').")]
Width = Annotated[
    int | None,
    typer.Option("--width", help="With --vessels: larger side of the map, in cells.", show_default=False),
]
Threshold = Annotated[float, typer.Option("--threshold", help="Pictures: pixels at least this bright are free, 0 to 1.")]
Invert = Annotated[bool, typer.Option("--invert", help="Pictures: dark pixels are free.")]
Scale = Annotated[float, typer.Option("--scale", help="Pictures: cells a pixel, 0.5 halves both sides.")]
Level = Annotated[
    float | None, typer.Option("--level", help="Arrays, volumes: cells of at least this number are free.", show_default=False)
]
Label = Annotated[
    int | None, typer.Option("--label", help="Arrays, volumes: cells of exactly this number are free.", show_default=False)
]
LargestComponent = Annotated[
    bool, typer.Option("--largest-component", help="Keep only the largest connected part of the free space.")
]
