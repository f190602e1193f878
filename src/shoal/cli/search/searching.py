"""shoal search: robots without a coordinator sweep a region."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from shoal.checks import check_choice, check_number
from shoal.cli import options
from shoal.cli.options import takes_problem
from shoal.cli.output import check_folder, check_outputs, check_seed, patience, print_json, say, write_films
from shoal.cli.search.missions import (
    DELAY,
    MAP,
    SEPARATION,
    Late,
    Separated,
    parse_separation,
)
from shoal.cli.search.texts import print_search
from shoal.errors import InvalidInputError
from shoal.search.flight.staggering import Separation
from shoal.search.problem import SearchProblem
from shoal.search.problem.faults import Crash

if TYPE_CHECKING:
    from shoal.search import SearchEpisode
    from shoal.search.missions import Mission
    from shoal.search.missions.deconfliction import MissionApproach

SEARCH_EXAMPLE = "Example: shoal search ring:200x150 --robots 6 --footprint 10 --loss 0.3 --faults crash:2@20 --out found"

_Terrain = Annotated[
    Path | None,
    typer.Option("--terrain", metavar="FILE", help="Heights of the ground: GeoTIFF or ESRI ASCII grid.", show_default=False),
]
_TerrainError = Annotated[
    float,
    typer.Option(
        "--terrain-error", metavar="METRES", help="By how much the height above ground may differ, between waypoints, too."
    ),
]
_Rally = Annotated[
    Path | None,
    typer.Option(
        "--rally", metavar="FILE", help="Points where vehicles may come down in need: CSV or GeoJSON.", show_default=False
    ),
]


@takes_problem(SearchProblem, from_file=True)
def search(
    problem: SearchProblem,
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
    autopilot: Annotated[str, typer.Option("--autopilot", help="Of the missions: px4 or ardupilot.")] = "px4",
    altitude_frame: Annotated[
        str, typer.Option("--altitude-frame", help="What the vehicle's altitude counts from in missions: home, sea or ground.")
    ] = "home",
    terrain: _Terrain = None,
    terrain_error: _TerrainError = 2.0,
    separation: Separated = SEPARATION,
    delay_tolerance: Late = DELAY,
    rally: _Rally = None,
    cap: Annotated[int | None, typer.Option("--cap", help="Mission items that the autopilot stores.", show_default=False)] = None,
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
    from shoal.search.run import run

    problem.check_at_place()
    if missions is not None and problem.vehicle is None:
        problem = problem.replaced(vehicle="multirotor").at_place(problem.place)
    ground: dict[str, Any] = {"altitude_frame": altitude_frame, "terrain": terrain, "terrain_error": terrain_error}
    ground |= {"separation": parse_separation(separation, delay_tolerance), "rally": rally}
    writer = None if missions is None else MissionWriter(missions, problem, format_, autopilot, cap, **ground)
    check_outputs(out, film)
    with nullcontext() if problem.live is None else patience("searching with one process a robot ..."):
        episode = run(problem, seed=seed)
    finish(episode, [] if writer is None else writer.write(episode), out, film, json_=json_, writer=writer)


def finish(
    episode: SearchEpisode,
    written: list[Path],
    out: Path | None,
    film: list[Path] | None,
    *,
    json_: bool,
    writer: MissionWriter | None = None,
) -> None:
    """Write and print what came of a search; exit code 1 if it was not completed."""
    result = episode.report() | ({} if writer is None else {"missions": writer.report(episode)})
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
        At once, before anything is searched, if an option is not right, or for a rover that would have to leave the region.
    """

    def __init__(
        self,
        folder: Path,
        problem: SearchProblem,
        formats: str,
        autopilot: str = "px4",
        cap: int | None = None,
        *,
        altitude_frame: str = "home",
        terrain: Path | None = None,
        terrain_error: float = 2.0,
        separation: Separation | None = None,
        rally: Path | None = None,
    ) -> None:
        from shoal.search.flight.flight import FRAMES
        from shoal.search.flight.terrain_files import open_terrain
        from shoal.search.missions import CAPS, FORMATS

        self.folder, self.separation, self.rally = folder, separation, rally
        self.missions: tuple[Mission, ...] = ()
        self.approach: MissionApproach | None = None
        self.formats = [name.strip() for name in formats.split(",") if name.strip()]
        for name in self.formats:
            FORMATS.get(name)
        parts, kind = len(problem.place.parts), problem.chosen_vehicle.kind
        if kind == "rover" and parts > 1:
            raise InvalidInputError(
                f"--vehicle: expected one that flies for a region of {parts} parts, between which nothing else gets, got a rover; "
                "search each part by itself"
            )
        check_choice(altitude_frame, what="--altitude-frame", choices=FRAMES)
        if altitude_frame == "ground" and terrain is None and kind != "rover":
            raise InvalidInputError("--altitude-frame: expected home or sea without --terrain, got ground")
        self.options: dict[str, Any] = {
            "autopilot": check_choice(autopilot, what="--autopilot", choices=CAPS),
            "cap": cap,
            "altitude_frame": altitude_frame,
            "terrain": None if terrain is None else open_terrain(terrain),
            "terrain_error": check_number(terrain_error, what="--terrain-error", least=0.01),
        }

    def write(self, episode: SearchEpisode) -> list[Path]:
        """Write them; return the files."""
        from shoal.search.missions import write_missions
        from shoal.search.missions.deconfliction import missions_approach, plan_missions
        from shoal.search.regions.places import read_points

        region = episode.plan.grid.region
        rally = None if self.rally is None else read_points(self.rally, region, what="rally points")
        self.missions = plan_missions(episode.plan, separation=self.separation, rally=rally, **self.options)
        if self.separation is not None:
            vehicle = episode.plan.vehicle
            self.approach = missions_approach(self.missions, self.separation, region.frame, vehicle=vehicle)
        from shoal.views.drawing.charts import save_figure
        from shoal.views.search.missions import missions_figure

        written = write_missions(self.missions, self.folder, formats=self.formats or None)
        save_figure(missions_figure(self.missions, region, self.approach), self.folder / MAP)
        return [*written, self.folder / MAP]

    def report(self, episode: SearchEpisode) -> dict[str, Any]:
        """Return what was written for JSON."""
        kept, near = self.separation, self.approach
        frame = episode.plan.grid.region.frame
        return {
            "sorties": len(self.missions),
            "separation_m": None if kept is None else [kept.horizontal, kept.vertical],
            "delay_tolerance_s": None if kept is None else kept.delay,
            "nearest_approach": None if near is None else near.report(frame),
            "starts": [
                {"robot": one.robot, "sortie": one.sortie, "delay_s": one.delay, "altitude_m": one.altitude}
                for one in self.missions
            ],
        }


def write_outputs(episode: SearchEpisode, result: dict[str, Any], out: Path | None, film: list[Path] | None) -> list[Path]:
    """Write what --out and --film ask for; return the files."""
    written: list[Path] = []
    if out is not None:
        from shoal.files import write_json
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
    """Search a marsh around a lake with 12 robots, three of which die: ``shoal demo search``."""
    from shoal.search.run import run

    check_folder(out)
    problem = SearchProblem(
        Path(__file__).parents[1] / "data" / "marsh.geojson",
        robots=12,
        footprint=20.0,
        loss=0.3,
        faults=(Crash(3, 40.0), Crash(7, 90.0), Crash(8, 90.0)),
        targets=8,
        vehicle="multirotor",
    )
    episode = run(problem, seed=seed)
    result = episode.report()
    written = MissionWriter(out / "missions", problem, "plan,kml", separation=Separation()).write(episode)
    written += write_outputs(episode, result, out, [out / "search.html"])
    if json_:
        print_json(result | {"files": [str(path) for path in written]})
        return
    print_search(episode, result, [path for path in written if path.parent == out] + [out / "missions"])
