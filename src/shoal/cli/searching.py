"""shoal search: robots without a coordinator sweep a region."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from shoal.cli import options
from shoal.cli.output import check_folder, check_outputs, check_seed, patience, print_json, print_table, progress, say
from shoal.errors import InvalidInputError

if TYPE_CHECKING:
    from shoal.search import SearchEpisode
    from shoal.search.missions import Mission

SEARCH_EXAMPLE = "Example: shoal search ring:200x150 --robots 6 --footprint 10 --loss 0.3 --kill 2@20 --out found"
COMPILING = "compiling kernels: once after an installation, half a minute ..."
VEHICLES = ("px4", "ardupilot")
_ROWS = 12

Region = Annotated[
    str,
    typer.Argument(
        metavar="REGION",
        help="square:SIDE, rectangle:WxH, circle:RADIUS or ring:OUTERxINNER in metres, or a file: .geojson, .json, .kml, .gpkg, "
        ".shp or .csv (metres).",
        show_default=False,
    ),
]


def search(
    region: Region,
    robots: Annotated[int, typer.Option("--robots", help="How many there are.", show_default=False)],
    footprint: Annotated[
        float, typer.Option("--footprint", help="Side of the square that a robot sees, metres.", show_default=False)
    ],
    starts: Annotated[
        str, typer.Option("--starts", help="random, clustered, line, or a CSV file of points, one a robot.")
    ] = "random",
    tour: Annotated[
        str,
        typer.Option("--tour", help="spanning-tree, comb, hilbert-rectangle, hilbert, moore, open-hilbert or MODULE:ATTRIBUTE."),
    ] = "spanning-tree",
    allocation: Annotated[
        str, typer.Option("--allocation", help="hop, two-way, individual-shift, common-shift, stay or MODULE:ATTRIBUTE.")
    ] = "hop",
    no_go: Annotated[
        list[Path] | None, typer.Option("--no-go", help="A file of zones to keep out of. May be given again.", show_default=False)
    ] = None,
    turn_cost: Annotated[float, typer.Option("--turn-cost", help="What a turn costs, in cells.")] = 0.0,
    speed: Annotated[float, typer.Option("--speed", help="Metres a second.")] = 1.0,
    rates: Annotated[
        str, typer.Option("--rates", metavar="R,R,...", help="Speeds of the robots, as multiples of --speed.", show_default=False)
    ] = "",
    energy: Annotated[
        float, typer.Option("--energy", help="Metres that a robot can go before it must be back at its start.")
    ] = inf,
    recharge: Annotated[float, typer.Option("--recharge", help="Seconds that it stays there.")] = 0.0,
    fold: Annotated[int, typer.Option("--fold", help="How many different robots must search each cell.")] = 1,
    transit: Annotated[
        bool, typer.Option("--transit", help="Robots fly: they may cross what lies between the parts of a region.")
    ] = False,
    loss: Annotated[float, typer.Option("--loss", help="Share of messages that are lost.")] = 0.0,
    network: Annotated[
        str,
        typer.Option(
            "--network",
            metavar="MODEL,...",
            help="perfect, loss:P, bursts:WORSEN:MEND, range:CELLS, partition:SINCE:UNTIL, delay:MEAN, duplicates:P, corruption:P.",
        ),
    ] = "perfect",
    kill: Annotated[
        list[str] | None,
        typer.Option(
            "--kill",
            metavar="ROBOT@TIME",
            help="The robot dies then: robots from 1 on, time as that of so many cells. May be given again.",
            show_default=False,
        ),
    ] = None,
    targets: Annotated[int, typer.Option("--targets", help="How many things to find there are, in random cells.")] = 0,
    detection: Annotated[float, typer.Option("--detection", help="Probability that a robot finds what is in a cell.")] = 1.0,
    false_alarm: Annotated[float, typer.Option("--false-alarm", help="Probability that it finds what is not there.")] = 0.0,
    obstacles: Annotated[
        str,
        typer.Option(
            "--obstacles",
            metavar="N|FILE",
            help="Cells that cannot be entered, as robots find out on the way: a number of random ones, or a CSV file of points.",
        ),
    ] = "0",
    missions: Annotated[
        Path | None, typer.Option("--missions", metavar="DIR", help="Write a mission for each robot there.", show_default=False)
    ] = None,
    format_: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="NAME,...",
            help="Formats of the missions: plan, wpl, geojson, kml, gpx, csv; default: all that can say where the region is.",
            show_default=False,
        ),
    ] = "",
    vehicle: Annotated[str, typer.Option("--vehicle", help="px4 or ardupilot.")] = "px4",
    kind: Annotated[str, typer.Option("--kind", help="multirotor or rover.")] = "multirotor",
    altitude: Annotated[
        float | None, typer.Option("--altitude", help="Metres above the start; 30 for a multirotor.", show_default=False)
    ] = None,
    cap: Annotated[int | None, typer.Option("--cap", help="Mission items that the vehicle stores.", show_default=False)] = None,
    simulate: Annotated[
        bool | None,
        typer.Option(
            "--simulate/--no-simulate",
            help="Simulate robots and messages; default: if cells times robots are a million or less.",
            show_default=False,
        ),
    ] = None,
    live: Annotated[
        bool, typer.Option("--live", help="One process a robot over real UDP instead of a simulation; --kill kills the process.")
    ] = False,
    live_speed: Annotated[float, typer.Option("--live-speed", help="Cells a second of a live robot.")] = 20.0,
    seed: options.Seed = 0,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FOLDER",
            help="Write region.png, timeline.png, the episode and summary.json there.",
            show_default=False,
        ),
    ] = None,
    film: Annotated[
        list[Path] | None,
        typer.Option(
            "--film",
            metavar="FILE",
            help="Write a film of the search: .gif, .mp4 or .html (the player). May be given again.",
            show_default=False,
        ),
    ] = None,
    json_: options.Json = False,
) -> None:
    """Search a region with robots that have no coordinator: they share a closed tour, and who lives takes over from who dies.

    Exit code 1 if the search was not completed.
    """
    from shoal.search import open_region
    from shoal.search import search as run
    from shoal.search.faults import crashes_of

    area = open_region(region, no_go=list(no_go) if no_go else None)
    faults = crashes_of(kill or [], robots=robots)
    check_outputs(out, film)
    with patience("searching with one process a robot ..." if live else COMPILING):
        episode = run(
            area,
            robots=robots,
            footprint=footprint,
            starts=starts,
            tour=tour,
            allocation=allocation,
            turn_cost=turn_cost,
            rates=parse_rates(rates),
            transit=transit,
            loss=loss,
            network="" if network == "perfect" else network,
            faults=faults,
            fold=fold,
            energy=energy,
            recharge=recharge,
            targets=targets,
            obstacles=int(obstacles) if obstacles.lstrip("-").isdecimal() else obstacles,
            detection=detection,
            false_alarm=false_alarm,
            speed=speed,
            simulate=simulate,
            live=live_speed if live else None,
            seed=seed,
        )
        result = episode.report()
    written = [] if missions is None else _write_missions(episode, missions, format_, vehicle, kind, altitude, cap)
    written += write_outputs(episode, result, out, film)
    if json_:
        print_json(result)
    else:
        print_search(episode, result, written)
    if not episode:
        say("shoal: the search was not completed")
        raise typer.Exit(1)


def parse_rates(text: str) -> list[float] | None:
    """Return the numbers of ``--rates``.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> parse_rates("1,1.5")
    [1.0, 1.5]
    """
    if not text.strip():
        return None
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise InvalidInputError(f"--rates: expected numbers separated by commas, one a robot, got {text[:80]!r}") from None


def _write_missions(
    episode: SearchEpisode, folder: Path, formats: str, vehicle: str, kind: str, altitude: float | None, cap: int | None
) -> list[Path]:
    """Write the missions of the plan: what each robot does if nothing goes wrong."""
    from shoal.search.missions import missions_of, write_missions

    plan = episode.plan
    found: list[Mission] = []
    energy = episode.scenario.brief.energy * plan.grid.size
    for robot, sweeps in enumerate(plan.allocation.sweeps):
        numbers = plan.numbers(sweeps)
        if not len(numbers):
            continue  # in reserve
        found += missions_of(
            plan.route(robot, numbers).points,
            plan.grid.region.frame,
            robot=robot + 1,
            home=plan.places[robot],
            kind=_one_of("--kind", kind, ("multirotor", "rover")),
            vehicle=_one_of("--vehicle", vehicle, VEHICLES),
            altitude=altitude,
            speed=episode.speed * float(plan.rates[robot]),
            cap=cap,
            max_length=None if energy == inf else energy,
            ways=plan.paths.leg,
        )
    names = [name.strip() for name in formats.split(",") if name.strip()]
    return write_missions(found, folder, formats=names or None)


def _one_of(option: str, given: str, known: tuple[str, ...]) -> Any:
    if given not in known:
        raise InvalidInputError(f"{option}: expected {' or '.join(known)}, got {given[:40]!r}")
    return given


def write_outputs(episode: SearchEpisode, result: dict[str, Any], out: Path | None, film: list[Path] | None) -> list[Path]:
    """Write what --out and --film ask for; return the files."""
    written: list[Path] = []
    if out is not None:
        from shoal.files import atomic
        from shoal.views.figures import save_figure
        from shoal.views.search import search_figure, timeline_figure

        save_figure(search_figure(episode), out / "region.png")
        save_figure(timeline_figure(episode), out / "timeline.png")
        episode.save(out / "episode.json")
        with atomic(out / "summary.json") as temporary:
            temporary.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
        written += [out / name for name in ("region.png", "timeline.png", "episode.json", "summary.json")]
    if film:
        from shoal.views.search_films import write_search_film

        for path in film:
            with progress(f"film {path.name}", 100, shown=path.suffix.lower() != ".html") as tell:
                write_search_film(episode, path, on_frame=partial(_percent, tell))
            written.append(path)
    return written


def _percent(tell: Callable[[int], None], done: int, total: int) -> None:
    tell(100 * done // max(total, 1))


def print_search(episode: SearchEpisode, result: dict[str, Any], written: list[Path], *more: tuple[str, str]) -> None:
    """Print the figures of a search for people."""
    region = result["region"]
    made = result["makespan_cells"]
    length = (
        "not all was searched"
        if made is None
        else (
            f"{made:.6g} cells, {result['makespan_s']:.6g} s; planned {result['planned_cells']:.6g}, "
            f"at least {result['lower_bound_cells']:.6g}"
        )
    )
    rows = [
        ("region", f"{region['cells']} cells of {region['cell_m']:.4g} m, {region['area_m2']:.6g} m²"),
        ("complete", "yes" if result["complete"] else "no"),
        ("time", length),
        ("covered", f"{100 * result['covered_fraction']:.4f} %, {result['uncovered_m2']:.3g} m² not seen"),
        ("messages", f"{result['messages']['sent']} sent, {result['messages']['lost']} lost; {result['takeovers']} takeovers"),
    ]
    for route in result["routes"][:_ROWS]:
        told = f"{route['status']}: {route['cells']} cells, {route['length_m']:.5g} m, {route['turns']} turns"
        rows.append((f"robot {route['robot']}", told))
    if len(result["routes"]) > _ROWS:
        rows.append(("", f"and {len(result['routes']) - _ROWS} more"))
    rows += [
        ("found", f"at ({finding['x']:.6g}, {finding['y']:.6g}), sure to {100 * finding['confidence']:.1f} %")
        for finding in result["findings"][:_ROWS]
    ]
    rows += [*more, *(("written", str(path)) for path in written)]
    print_table(rows, title=f"{result['allocation']} along {result['tour']}")


def replay_search(episode_file: Path, seed: int | None, out: Path | None, film: list[Path] | None, json_: bool) -> None:
    """Replay a search: ``shoal replay EPISODE.json``."""
    from shoal.search import SearchEpisode

    with patience(COMPILING):
        episode = SearchEpisode.load(episode_file)
        check_seed(episode_file, seed, episode.seed)
        verified = episode.verify()
        message = (
            "planned and played again, all robots do what the episode says"
            if verified
            else "planned and played again, robots do not do what the episode says"
        )
        result = episode.report() | {"verified": verified, "message": message}
    written = write_outputs(episode, result, out, film) if verified else []
    if json_:
        print_json(result)
    else:
        print_search(episode, result, written, ("verified", f"{'yes' if verified else 'NO'}: {message}"))
    if not verified:
        say(f"shoal: {episode_file}: {message}")
        raise typer.Exit(1)


def demo_search(out: Path, *, seed: int, json_: bool) -> None:
    """Search a marsh around a lake with 12 robots, three of which die: ``shoal demo search``."""
    from shoal.search import open_region
    from shoal.search import search as run
    from shoal.search.faults import Crash

    check_folder(out)
    marsh = open_region(Path(__file__).parent / "data" / "marsh.geojson")
    with patience(COMPILING):
        episode = run(
            marsh,
            robots=12,
            footprint=20.0,
            loss=0.3,
            faults=[Crash(3, 40.0), Crash(7, 90.0), Crash(8, 90.0)],
            targets=8,
            turn_cost=0.5,
            speed=5.0,
            seed=seed,
        )
        result = episode.report()
    written = _write_missions(episode, out / "missions", "plan,kml", "px4", "multirotor", None, None)
    written += write_outputs(episode, result, out, [out / "search.html"])
    if json_:
        print_json(result | {"files": [str(path) for path in written]})
        return
    print_search(episode, result, [path for path in written if path.parent == out] + [out / "missions"])
