"""shoal search: search a region with robots that have no coordinator."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from shoal.cli.options import Film, Json, Seed, takes_problem
from shoal.cli.output import check_folder, check_outputs, patience, print_json, say, write_episode
from shoal.cli.search.texts import print_search
from shoal.core.errors import InvalidInputError
from shoal.search.problem import SearchProblem
from shoal.search.problem.mission_options import MissionOptions
from shoal.search.problem.network import Crash

if TYPE_CHECKING:
    from shoal.search import SearchEpisode
    from shoal.views.search.mission_folder import MissionFolder

SEARCH_EXAMPLE = (
    "Example: shoal search ring:100x70 --robots 6 --footprint 10 --loss 0.3 --faults crash:2@20"
    " --out found"
)


@takes_problem(SearchProblem, from_file=True, options=MissionOptions)
def search(
    problem: SearchProblem,
    options: MissionOptions,
    missions: Annotated[
        Path | None,
        typer.Option(
            "--missions",
            metavar="DIR",
            help=(
                "Folder for the mission files, one file for each robot and sortie (flight between"
                " two charges)."
            ),
        ),
    ] = None,
    seed: Seed = 0,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FOLDER",
            help="Folder for region.png, timeline.png, the episode and summary.json.",
        ),
    ] = None,
    film: Film = None,
    json_: Json = False,
) -> None:
    """Search a region with robots that have no coordinator.

    The robots divide a closed tour through all cells of the region among themselves. If a robot
    fails, the other robots search its part of the tour.

    The exit code is 1 if the search was not completed.
    """
    from shoal.search.run import run

    if missions is None and options.given:
        name = next(name for name in options.declarations() if name in options.given)
        value = options.declarations()[name].text(getattr(options, name))
        raise InvalidInputError(
            f"{options.declarations()[name].flag}: expected --missions DIR together with it, got"
            f" {value} alone"
        )
    problem.check_at_place()
    if missions is not None and problem.vehicle is None:
        problem = problem.replaced(vehicle="multirotor").at_place(problem.place)
    writer = None if missions is None else _mission_folder(missions, problem, options)
    check_outputs(out, film)
    with (
        nullcontext()
        if problem.live is None
        else patience("searching with one process per robot ...")
    ):
        episode = run(problem, seed=seed) if writer is None else writer.run(seed=seed)
    finish(
        episode,
        [] if writer is None else writer.write(episode.plan),
        out,
        film,
        json_=json_,
        writer=writer,
    )


def finish(
    episode: SearchEpisode,
    written: list[Path],
    out: Path | None,
    film: list[Path] | None,
    *,
    json_: bool,
    writer: MissionFolder | None = None,
) -> None:
    """Write and print the result of a search; exit with the code 1 if the search was
    not completed.
    """
    result = episode.report() | (
        {} if writer is None else {"missions": writer.report(episode.plan)}
    )
    written = written + write_episode(episode, result, out, film)
    if json_:
        print_json(result)
    else:
        print_search(episode, result, written)
    if not episode:
        say("shoal: the search was not completed")
        raise typer.Exit(1)


def _mission_folder(folder: Path, problem: SearchProblem, options: MissionOptions) -> MissionFolder:
    from shoal.views.search.mission_folder import MissionFolder

    return MissionFolder(folder, problem, options)


def demo_search(out: Path, *, seed: int, json_: bool) -> None:
    """Search a marsh around a lake with 12 robots, three of which fail: ``shoal demo search``."""
    check_folder(out)
    problem = SearchProblem(
        Path(__file__).parents[1] / "demo" / "marsh.geojson",
        robots=12,
        footprint=20.0,
        loss=0.3,
        faults=(Crash(3, 40.0), Crash(7, 90.0), Crash(8, 90.0)),
        targets=8,
        vehicle="multirotor",
    )
    writer = _mission_folder(out / "missions", problem, MissionOptions(format=("plan", "kml")))
    episode = writer.run(seed=seed)
    result = episode.report()
    written = writer.write(episode.plan)
    written += write_episode(episode, result, out, [out / "search.html"])
    if json_:
        print_json(result | {"files": [str(path) for path in written]})
        return
    print_search(
        episode, result, [path for path in written if path.parent == out] + [out / "missions"]
    )
