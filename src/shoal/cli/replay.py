"""shoal replay: verify an episode of any part, and draw or film it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from shoal.cli import options
from shoal.cli.output import check_outputs

EXAMPLE = "Example: shoal replay result/episode.npz --film result/film.html"


def replay(
    episode_file: Annotated[
        Path,
        typer.Argument(
            metavar="EPISODE",
            help="Episode file: .npz of map and cover, .json of steer and search, or .jsonl of drive.",
        ),
    ],
    seed: Annotated[
        int | None,
        typer.Option("--seed", help="Refuse the episode unless it was played with this seed."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FOLDER",
            help="Write figures, summary.json and the episode into this folder.",
        ),
    ] = None,
    film: options.Film = None,
    trust: options.Trust = False,
    json_: options.Json = False,
) -> None:
    """Replay an episode file, verify it, and draw or film it. The exit code is 1 if the replay differs from the stored episode."""
    check_outputs(out, film)
    if is_search(episode_file):
        from shoal.cli.search.searching import replay_search

        replay_search(episode_file, seed, out, film, json_, trust=trust)
    elif episode_file.suffix.lower() == ".jsonl":
        from shoal.cli.swarm.driving import replay_drive

        replay_drive(episode_file, seed, out, film, json_, trust=trust)
    elif episode_file.suffix.lower() == ".json":
        from shoal.cli.steering import replay_steering

        replay_steering(episode_file, seed, out, film, json_, trust=trust)
    else:
        from shoal.cli.swarm.exploration import replay_swarm

        replay_swarm(episode_file, seed, out, film, json_, trust=trust)


def is_search(path: Path) -> bool:
    """Return whether the beginning of a file identifies a search episode."""
    if path.suffix.lower() != ".json" or not path.is_file():
        return False
    with path.open("rb") as file:
        return b'"kind": "search"' in file.read(200)
