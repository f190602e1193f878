"""shoal search: search a region with robots that have no coordinator."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from shoal.cli.options import Json, Seed, takes_problem
from shoal.cli.output import check_folder, check_outputs, check_seed, patience, print_json, say, write_films
from shoal.cli.search.texts import print_search
from shoal.search.problem import SearchProblem
from shoal.search.problem.faults import Crash
from shoal.search.problem.mission_options import MissionOptions

if TYPE_CHECKING:
    from shoal.search import SearchEpisode
    from shoal.views.search.mission_folder import MissionFolder

SEARCH_EXAMPLE = "Example: shoal search ring:100x70 --robots 6 --footprint 10 --loss 0.3 --faults crash:2@20 --out found"


@takes_problem(SearchProblem, from_file=True, options=MissionOptions)
def search(
    problem: SearchProblem,
    options: MissionOptions,
    missions: Annotated[
        Path | None,
        typer.Option("--missions", metavar="DIR", help="Folder for the missions, one for each robot and sortie."),
    ] = None,
    seed: Seed = 0,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FOLDER",
            help="Write region.png, timeline.png, the episode and summary.json into this folder.",
        ),
    ] = None,
    film: Annotated[
        list[Path] | None,
        typer.Option(
            "--film",
            metavar="FILE",
            help="Write a film of the search: .gif, .mp4 or .html (the player). The option can be repeated.",
        ),
    ] = None,
    json_: Json = False,
) -> None:
    """Search a region with robots that have no coordinator.

    The robots divide a closed tour through all cells among themselves. Live robots take over the parts of dead robots.

    The exit code is 1 if the search was not completed.
    """
    from shoal.search.run import run

    problem.check_at_place()
    if missions is not None and problem.vehicle is None:
        problem = problem.replaced(vehicle="multirotor").at_place(problem.place)
    writer = None if missions is None else _mission_folder(missions, problem, options)
    check_outputs(out, film)
    with nullcontext() if problem.live is None else patience("searching with one process per robot ..."):
        episode = run(problem, seed=seed) if writer is None else writer.run(problem, seed=seed)
    finish(episode, [] if writer is None else writer.write(episode.plan), out, film, json_=json_, writer=writer)


def finish(
    episode: SearchEpisode,
    written: list[Path],
    out: Path | None,
    film: list[Path] | None,
    *,
    json_: bool,
    writer: MissionFolder | None = None,
) -> None:
    """Write and print the result of a search. The exit code is 1 if the search was not completed."""
    result = episode.report() | ({} if writer is None else {"missions": writer.report(episode.plan)})
    written = written + write_outputs(episode, result, out, film)
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


def write_outputs(episode: SearchEpisode, result: dict[str, Any], out: Path | None, film: list[Path] | None) -> list[Path]:
    """Write the outputs that --out and --film request. Return the files."""
    written: list[Path] = []
    if out is not None:
        from shoal.core.files import write_json
        from shoal.views import figure, save_figure

        save_figure(figure(episode), out / "region.png")
        save_figure(figure(episode, kind="timeline"), out / "timeline.png")
        episode.save(out / "episode.json")
        write_json(out / "summary.json", result)
        written += [out / name for name in ("region.png", "timeline.png", "episode.json", "summary.json")]
    return written + write_films(episode, film)


def replay_search(
    episode_file: Path, seed: int | None, out: Path | None, film: list[Path] | None, json_: bool, *, trust: bool
) -> None:
    """Replay a search: ``shoal replay EPISODE.json``."""
    from shoal.search import SearchEpisode

    episode = SearchEpisode.load(episode_file, trust=trust)
    check_seed(episode_file, seed, episode.seed)
    verified = episode.verify()
    result = episode.report() | {"verified": verified.ok, "message": verified.message}
    written = write_outputs(episode, result, out, film) if verified else []
    if json_:
        print_json(result)
    else:
        print_search(episode, result, written, ("verified", f"{'yes' if verified else 'NO'}: {verified.message}"))
    if not verified:
        say(f"shoal: {episode_file}: {verified.message}")
        raise typer.Exit(1)


def demo_search(out: Path, *, seed: int, json_: bool) -> None:
    """Search a marsh around a lake with 12 robots, of which three fail: ``shoal demo search``."""
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
    episode = writer.run(problem, seed=seed)
    result = episode.report()
    written = writer.write(episode.plan)
    written += write_outputs(episode, result, out, [out / "search.html"])
    if json_:
        print_json(result | {"files": [str(path) for path in written]})
        return
    print_search(episode, result, [path for path in written if path.parent == out] + [out / "missions"])
