"""shoal search: robots without a coordinator sweep a region."""

from __future__ import annotations

import json
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from shoal.cli import options
from shoal.cli import search_options as given
from shoal.cli.output import (
    check_folder,
    check_outputs,
    check_seed,
    patience,
    print_json,
    print_table,
    say,
    write_films,
)
from shoal.errors import InvalidInputError

if TYPE_CHECKING:
    from shoal.search import SearchEpisode
    from shoal.search.missions import Mission

SEARCH_EXAMPLE = "Example: shoal search ring:200x150 --robots 6 --footprint 10 --loss 0.3 --kill 2@20 --out found"
COMPILING = "compiling kernels: once after an installation, half a minute ..."
VEHICLES = ("px4", "ardupilot")
_ROWS = 12


def search(
    region: given.Region,
    robots: given.Robots,
    footprint: given.Footprint,
    starts: given.Starts = "random",
    tour: given.TourName = "spanning-tree",
    allocation: given.AllocationName = "hop",
    no_go: given.NoGo = None,
    turn_cost: given.TurnCost = 0.0,
    speed: given.Speed = 1.0,
    rates: given.Rates = "",
    energy: given.Energy = inf,
    recharge: given.Recharge = 0.0,
    fold: given.Fold = 1,
    transit: given.Transit = False,
    loss: given.Loss = 0.0,
    network: given.NetworkName = "perfect",
    kill: given.Kill = None,
    targets: given.Targets = 0,
    detection: given.Detection = 1.0,
    false_alarm: given.FalseAlarm = 0.0,
    obstacles: given.Obstacles = "0",
    missions: given.Missions = None,
    format_: given.Formats = "",
    vehicle: given.Vehicle = "px4",
    kind: given.Kind = "multirotor",
    altitude: given.Altitude = None,
    cap: given.Cap = None,
    simulate: given.Simulate = None,
    live: given.Live = False,
    live_speed: given.LiveSpeed = 20.0,
    seed: options.Seed = 0,
    out: given.Out = None,
    film: given.Film = None,
    json_: options.Json = False,
) -> None:
    """Search a region with robots that have no coordinator: they share a closed tour, and who lives takes over from who dies.

    Exit code 1 if the search was not completed.
    """
    from shoal.search import open_region
    from shoal.search import search as run
    from shoal.search.simulation.faults import crashes_of

    area = open_region(region, no_go=list(no_go) if no_go else None)
    faults = crashes_of(kill or [], robots=robots)
    writer = None if missions is None else MissionWriter(missions, format_, vehicle, kind, altitude, cap)
    check_outputs(out, film)
    with patience("searching with one process a robot ..." if live else COMPILING):
        episode = run(
            area, robots=robots, footprint=given.parse_footprint(footprint), starts=starts, tour=tour, allocation=allocation,
            turn_cost=turn_cost, rates=given.parse_numbers("--rates", rates), transit=transit, loss=loss,
            network="" if network == "perfect" else network, faults=faults, fold=fold, energy=energy, recharge=recharge,
            targets=targets, detection=detection, false_alarm=false_alarm, speed=speed,
            obstacles=int(obstacles) if obstacles.lstrip("-").isdecimal() else obstacles,
            simulate=simulate, live=live_speed if live else None, seed=seed,
        )  # fmt: skip
    finish(episode, [] if writer is None else writer.write(episode), out, film, json_=json_)


def finish(episode: SearchEpisode, written: list[Path], out: Path | None, film: list[Path] | None, *, json_: bool) -> None:
    """Write and print what came of a search; exit code 1 if it was not completed."""
    result = episode.report()
    written = written + write_outputs(episode, result, out, film)
    if json_:
        print_json(result)
    else:
        print_search(episode, result, written)
    if not episode:
        say("shoal: the search was not completed")
        raise typer.Exit(1)


class MissionWriter:
    """Writes the missions of a plan: what each robot does if nothing goes wrong.

    Raises
    ------
    InvalidInputError, UnknownNameError
        At once, before anything is searched, if an option is not right.
    """

    def __init__(
        self, folder: Path, formats: str, vehicle: str, kind: str, altitude: float | None = None, cap: int | None = None
    ) -> None:
        from shoal.search.missions.files import FORMATS

        self.folder = folder
        self.formats = [name.strip() for name in formats.split(",") if name.strip()]
        for name in self.formats:
            FORMATS.get(name)
        self.vehicle = _one_of("--vehicle", vehicle, VEHICLES)
        self.kind = _one_of("--kind", kind, ("multirotor", "rover"))
        self.altitude, self.cap = altitude, cap

    def write(self, episode: SearchEpisode) -> list[Path]:
        """Write them; return the files."""
        from shoal.search.missions import missions_of, write_missions

        plan = episode.plan
        found: list[Mission] = []
        energy = episode.scenario.brief.energy * plan.grid.size
        for robot in range(len(plan.places)):
            stops = plan.stops(robot)
            if not len(stops):
                continue  # in reserve
            found += missions_of(
                plan.route(robot, stops).points,
                plan.grid.region.frame,
                robot=robot + 1,
                home=plan.places[robot],
                kind=self.kind,
                vehicle=self.vehicle,
                altitude=self.altitude,
                speed=episode.speed * float(plan.rates[robot]),
                cap=self.cap,
                max_length=None if energy == inf else energy,
                ways=plan.paths.leg,
            )
        return write_missions(found, self.folder, formats=self.formats or None)


def _one_of(option: str, word: str, known: tuple[str, ...]) -> Any:
    if word not in known:
        raise InvalidInputError(f"{option}: expected {' or '.join(known)}, got {word[:40]!r}")
    return word


def write_outputs(episode: SearchEpisode, result: dict[str, Any], out: Path | None, film: list[Path] | None) -> list[Path]:
    """Write what --out and --film ask for; return the files."""
    written: list[Path] = []
    if out is not None:
        from shoal.files import atomic
        from shoal.views import figure, save_figure

        save_figure(figure(episode), out / "region.png")
        save_figure(figure(episode, kind="timeline"), out / "timeline.png")
        episode.save(out / "episode.json")
        with atomic(out / "summary.json") as temporary:
            temporary.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
        written += [out / name for name in ("region.png", "timeline.png", "episode.json", "summary.json")]
    return written + write_films(episode, film)


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
        stops = "" if route["stops"] == route["cells"] else f" from {route['stops']} stops with {route['footprint_m']:g} m"
        told = f"{route['status']}: {route['cells']} cells{stops}, {route['length_m']:.5g} m, {route['turns']} turns"
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
        message = _verdict(verified, live=episode.live is not None)
        result = episode.report() | {"verified": verified, "message": message}
    written = write_outputs(episode, result, out, film) if verified else []
    if json_:
        print_json(result)
    else:
        print_search(episode, result, written, ("verified", f"{'yes' if verified else 'NO'}: {message}"))
    if not verified:
        say(f"shoal: {episode_file}: {message}")
        raise typer.Exit(1)


def _verdict(verified: bool, *, live: bool) -> str:
    if live:  # what processes did cannot be played again
        return f"a live search, which {'is' if verified else 'is not'} at one with itself: what was searched, and when"
    return f"planned and played again, {'all robots do' if verified else 'robots do not do'} what the episode says"


def demo_search(out: Path, *, seed: int, json_: bool) -> None:
    """Search a marsh around a lake with 12 robots, three of which die: ``shoal demo search``."""
    from shoal.search import open_region
    from shoal.search import search as run
    from shoal.search.simulation.faults import Crash

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
    written = MissionWriter(out / "missions", "plan,kml", "px4", "multirotor").write(episode)
    written += write_outputs(episode, result, out, [out / "search.html"])
    if json_:
        print_json(result | {"files": [str(path) for path in written]})
        return
    print_search(episode, result, [path for path in written if path.parent == out] + [out / "missions"])
