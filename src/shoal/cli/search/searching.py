"""shoal search: search a region with robots that have no coordinator."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from shoal.cli.options import Film, Json, Seed, takes_problem
from shoal.cli.output import (
    check_folder,
    check_outputs,
    import_matplotlib,
    patience,
    print_columns,
    print_json,
    say,
    write_episode,
)
from shoal.cli.search.texts import finding_text, print_search
from shoal.core.checks import count_text
from shoal.core.errors import InvalidInputError
from shoal.missions.options import MissionOptions
from shoal.search.problem import SearchProblem
from shoal.search.problem.network import Crash

if TYPE_CHECKING:
    from shoal.missions import MissionSet
    from shoal.robots.tasks import RobotLimits
    from shoal.search import SearchEpisode

SEARCH_EXAMPLE = (
    "Example: shoal search ring:100x70 --robots 6 --footprint 10 --loss 0.3 --faults crash:2@20"
    " --out found"
)


# fields of what happens during a search, which change no plan
_SIMULATED = (
    "loss",
    "network",
    "key",
    "packet",
    "faults",
    "crashes",
    "targets",
    "false_alarm",
    "simulate",
    "live",
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
    prepare: Annotated[
        Path | None,
        typer.Option(
            "--prepare",
            metavar="FOLDER",
            help=(
                "Folder for what robots in the field need: the signed task with its key for shoal"
                " robot, and the missions to fall back on, in the folder missions."
            ),
        ),
    ] = None,
    limits: Annotated[
        str | None,
        typer.Option(
            "--limits",
            metavar="NAME=VALUE,...",
            help=(
                "With --prepare: limits of the robots, such as battery=0.3,apart_s=20. The names are"
                " battery (fraction), autopilot_s, position_s, radio_s, apart_s (seconds),"
                " vertical_m and horizontal_m (metres)."
            ),
        ),
    ] = None,
    compare: Annotated[
        bool,
        typer.Option(
            "--compare",
            help=(
                "Plan along each tour and with each allocation, and in the patterns parallel track,"
                " creeping line, corridor, expanding square and sector, and print the time, turns,"
                " length and evenness of each plan, and what it searches, without a simulation; with"
                " --prior, also the expected time to find. With --out: comparison.png and"
                " summary.json."
            ),
        ),
    ] = False,
    seed: Seed = 0,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FOLDER",
            help=(
                "Folder for region.png, timeline.png, the episode, summary.json and visits.csv (the"
                " first search of each cell); with --compare, for comparison.png and summary.json."
            ),
        ),
    ] = None,
    film: Film = None,
    json_: Json = False,
) -> None:
    """Search a region with robots that have no coordinator.

    The robots divide a closed tour through all cells of the region among themselves. If a robot
    fails, the other robots search its part of the tour.

    Ctrl-C ends a long comparison of plans, and Shoal goes on with the best plan so far, except with
    --out, --prepare and --live. A second Ctrl-C ends the command.

    The exit code is 1 if the search was not completed.
    """
    from shoal.search.planning.choosing import stoppable_comparisons
    from shoal.search.run import run

    if compare:
        given = {"--missions": missions, "--prepare": prepare, "--limits": limits, "--film": film}
        _compare(problem, options, {k: v for k, v in given.items() if v}, seed, out, json_=json_)
        return
    fall_back = prepare is not None and problem.place.frame is not None
    if missions is None and not fall_back and options.given:
        name = next(name for name in options.declarations() if name in options.given)
        value = options.declarations()[name].text(getattr(options, name))
        raise InvalidInputError(
            f"{options.declarations()[name].flag}: expected --missions DIR together with it, or"
            f" --prepare FOLDER and a region with a place on Earth, got {value} alone"
        )
    if limits is not None and prepare is None:
        raise InvalidInputError(
            f"limits: expected --prepare FOLDER together with it, got {limits} alone"
        )
    bounds = _limits(limits)
    problem.check_at_place()
    check_outputs(out, film)
    if prepare is not None:
        check_folder(prepare)
    planned = None
    # Robots, and readers of an episode, make the plan of a problem again: it must be the same.
    waiting = problem.live is not None
    is_made_again = out is not None or prepare is not None or waiting
    stoppable = nullcontext() if is_made_again else stoppable_comparisons(say)
    live = patience("searching with one process per robot ...") if waiting else nullcontext()
    with stoppable, live:
        if missions is not None or fall_back:
            planned = _mission_set(problem, options, seed=seed)
        episode = run(problem, seed=seed) if planned is None else planned.run()
    written = [] if planned is None or missions is None else _write(planned, missions)
    if prepare is not None:
        written += _prepare(episode, planned if fall_back else None, prepare, bounds)
    finish(episode, written, out, film, json_=json_, missions=planned)


def _compare(
    problem: SearchProblem,
    options: MissionOptions,
    given: dict[str, Any],
    seed: int,
    out: Path | None,
    *,
    json_: bool,
) -> None:
    """Write and print a comparison of plans."""
    from shoal.core.files import write_json
    from shoal.search import compare_plans
    from shoal.search.episode import duration_text

    given = given | {
        problem.declarations()[name].flag: getattr(problem, name)
        for name in _SIMULATED
        if name in problem.given
    }
    if given or options.given:
        name = next(iter(given), None) or next(
            options.declarations()[name].flag
            for name in options.declarations()
            if name in options.given
        )
        raise InvalidInputError(
            f"--compare: expected no {name} together with it, because plans are compared without"
            f" a simulation or missions, got {name}"
        )
    if out is not None:
        check_folder(out)
    found = compare_plans(problem, seed=seed)
    result = {
        "region": problem.place.name,
        "robots": problem.robots,
        "compared": [one.report() for one in found],
        "seed": seed,
    }
    written = []
    if out is not None:
        from shoal.views.drawing.charts import save_figure
        from shoal.views.search.comparison import comparison_figure

        written = [out / "comparison.png", out / "summary.json"]
        save_figure(comparison_figure(found), written[0])
        write_json(written[1], result)
    if json_:
        print_json(result)
        return
    rows = [
        [
            *one.names,
            *([finding_text(one.expected_find, one.success)] if problem.prior else []),
            duration_text(one.seconds) + ("" if one.refusal is None else " (estimate)"),
            str(one.turns),
            f"{one.length:.0f} m",
            f"{100 * one.evenness:.0f} %",
            "all" if one.share == 1 else f"{100 * one.share:.1f} %",
        ]
        for one in found
    ]
    print_columns(
        ["tour", "allocation"],
        [
            *(["found after"] if problem.prior else []),
            "time",
            "turns",
            "length",
            "evenness",
            "searched",
        ],
        rows,
        title=f"plans of {count_text(problem.robots, 'robot')} in {problem.place.name}, the best first",
    )
    for path in written:
        say(f"written: {path}")


def finish(
    episode: SearchEpisode,
    written: list[Path],
    out: Path | None,
    film: list[Path] | None,
    *,
    json_: bool,
    missions: MissionSet | None = None,
) -> None:
    """Write and print the result of a search; exit with the code 1 if the search was
    not completed.
    """
    result = episode.report() | ({} if missions is None else {"missions": missions.report()})
    written = written + write_episode(episode, result, out, film)
    if json_:
        print_json(result)
    else:
        print_search(episode, result, written)
    if not episode:
        say("shoal: the search was not completed")
        raise typer.Exit(1)


def _mission_set(problem: SearchProblem, options: MissionOptions, *, seed: int) -> MissionSet:
    from shoal.missions import MissionSet

    return MissionSet.from_problem(problem, options, seed=seed)


def _limits(text: str | None) -> RobotLimits | None:
    if text is None:
        return None
    from shoal.robots.tasks import read_limits

    return read_limits(text)


def _prepare(
    episode: SearchEpisode, missions: MissionSet | None, folder: Path, limits: RobotLimits | None
) -> list[Path]:
    """Write the task of the robots, and the missions to fall back on if the region has a place on
    Earth.
    """
    from shoal.robots.tasks import MISSIONS, write_task

    written = write_task(episode, folder, limits)
    return written if missions is None else [*written, *_write(missions, folder / MISSIONS)]


def _write(missions: MissionSet, folder: Path) -> list[Path]:
    import_matplotlib()
    from shoal.views.search.missions import save_missions_map

    return [*missions.write(folder), *save_missions_map(missions, folder)]


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
    missions = _mission_set(problem, MissionOptions(format=("plan", "kml")), seed=seed)
    episode = missions.run()
    result = episode.report()
    written = _write(missions, out / "missions")
    written += write_episode(episode, result, out, [out / "search.html"])
    if json_:
        print_json(result | {"files": [str(path) for path in written]})
        return
    print_search(
        episode, result, [path for path in written if path.parent == out] + [out / "missions"]
    )
