"""The options that commands share and no problem declares."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Trials = Annotated[int, typer.Option("--trials", help="How many times, each from another start.")]
Seed = Annotated[int, typer.Option("--seed", help="The same seed gives the same result, whatever the workers.")]
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
Trust = Annotated[bool, typer.Option("--trust", help="Run code that a file names as MODULE:ATTRIBUTE. Know whose it is.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout, and nothing else there.")]
