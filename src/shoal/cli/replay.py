"""shoal replay: verify an episode of swarm, steering or search, and draw or film the episode."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from shoal.cli import options
from shoal.cli.output import check_outputs, check_seed, print_json, say, write_episode, write_films
from shoal.core.errors import InvalidInputError, ShoalError
from shoal.parts import load
from shoal.swarm import SwarmEpisode

EXAMPLE = "Example: shoal replay result/episode.npz --film result/film.html"


def replay(
    episode_file: Annotated[
        Path,
        typer.Argument(
            metavar="EPISODE",
            help=(
                "Episode file: .npz from map, cover or gather, .json from steer or search, or"
                " .jsonl from drive."
            ),
        ),
    ],
    seed: Annotated[
        int | None,
        typer.Option(
            "--seed", help="Seed of the episode. Shoal refuses an episode with another seed."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FOLDER",
            help="Folder for the figures, summary.json and the episode.",
        ),
    ] = None,
    film: options.Film = None,
    size: Annotated[
        str | None,
        typer.Option(
            "--size",
            help=(
                "Size of films for presentations: wide (1920 x 1080) or square (1080 x 1080). They"
                " have a title, moves between cells and a card at their end."
            ),
        ),
    ] = None,
    rate: Annotated[
        int | None,
        typer.Option(
            "--rate", help="With --size: frames per second of .mp4 films, 30 or 60. Default: 30."
        ),
    ] = None,
    trust: options.Trust = False,
    json_: options.Json = False,
) -> None:
    """Replay and verify an episode file, and draw or film it. The exit code is 1 if the replay
    differs from the stored episode.
    """
    check_outputs(out, film)
    _check_size(film, size, rate)
    if episode_file.suffix.lower() == ".jsonl":
        from shoal.cli.swarm.driving import replay_drive

        if size is not None:
            raise InvalidInputError(f"--size: expected none for a drive, got {size}")
        replay_drive(episode_file, seed, out, film, json_, trust=trust)
        return
    episode = load(episode_file, trust=trust)
    check_seed(episode_file, seed, episode.seed)
    if isinstance(episode, SwarmEpisode) and any(
        path.suffix.lower() == ".html" for path in film or ()
    ):
        from shoal.views.swarm.page import check_page

        check_page(episode)  # before a replay, which may take minutes
    report, write, show = _functions_of(episode)
    try:
        verified = episode.verify()
    except ShoalError as error:  # an unknown task, or targets that cannot be reached
        raise InvalidInputError(f"{episode_file}: {error}") from None
    result = report() | {"verified": verified.ok, "message": verified.message}
    written = (
        [
            *write(result, out, None if size else film),
            *(write_films(episode, film, size=size, rate=rate) if size else []),
        ]
        if verified
        else []
    )
    if json_:
        print_json(result)
    else:
        show(result, written, ("verified", f"{'yes' if verified else 'NO'}: {verified.message}"))
    if not verified:
        say(f"shoal: {episode_file}: {verified.message}")
        raise typer.Exit(1)


def _check_size(films: list[Path] | None, size: str | None, rate: int | None) -> None:
    """Raise an error if options of films have no effect, before anything is written."""
    if size is None and rate is None:
        return
    from shoal.views.drawing.stage import stage_of

    if not films:
        name, value = ("--size", size) if size is not None else ("--rate", rate)
        raise InvalidInputError(f"{name}: expected a film beside it (--film), got {value} alone")
    for path in films:
        stage_of(path.suffix.lower(), size, rate)


def _functions_of(
    episode: Any,
) -> tuple[Callable[..., dict[str, Any]], Callable[..., list[Path]], Callable[..., None]]:
    """Return three functions of an episode: one returns its result as a dict, one writes output
    files, one prints the result.
    """
    if episode.part == "search":
        from shoal.cli.search.texts import print_search

        return episode.report, partial(write_episode, episode), partial(print_search, episode)
    if episode.part == "steering":
        from shoal.cli.steering import print_plan

        return episode.report, partial(write_episode, episode), partial(print_plan, episode)
    from shoal.cli.swarm.exploration import print_trials, summary, write_outputs

    def report() -> dict[str, Any]:
        return summary([episode], seed=episode.seed) | {"commands": episode.commands}

    return report, partial(write_outputs, [episode]), partial(print_trials, [episode])
