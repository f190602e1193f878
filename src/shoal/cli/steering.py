"""shoal steer, shoal reach: two particles, one shared input, walls that hold."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from shoal.cli import options
from shoal.cli.output import check_folder, check_outputs, check_seed, patience, print_json, print_table, progress, say
from shoal.errors import InvalidInputError, ShoalError

if TYPE_CHECKING:
    from shoal.steering import SteeringEpisode

STEER_EXAMPLE = "Example: shoal steer problem.json --planner shortest --out plan"
REACH_EXAMPLE = 'Example: shoal reach hexagon --start "-0.1,0 0.1,0.1" --moves 6'
COMPILING = "compiling kernels: once after an installation, a minute ..."
NOISES = ("execution", "measurement", "gain")

_Problem = Annotated[
    Path,
    typer.Argument(
        metavar="PROBLEM.json",
        help='{"workspace": {"type": "polygon", "vertices": [[x, y], ...]}, "start": [[x, y], [x, y]], "goal": [[x, y], [x, y]]}; '
        'other workspaces: disk, prism, cylinder, region, GeoJSON, a name or a file; optional: "tolerance", "interchangeable".',
        show_default=False,
    ),
]
_Noise = Annotated[
    str,
    typer.Option(
        "--noise",
        metavar="KIND=VALUE,...",
        help="execution=S and measurement=S are standard deviations, gain=V is how much the response varies over the workspace.",
    ),
]
_Out = Annotated[
    Path | None,
    typer.Option("--out", metavar="FOLDER", help="Write figures, JSON and the episode into this folder.", show_default=False),
]


def steer(
    problem: _Problem,
    planner: Annotated[
        str, typer.Option("--planner", help="shortest, greedy, fewest-moves, robust, sampling or MODULE:ATTRIBUTE.")
    ] = "shortest",
    noise: _Noise = "",
    friction: Annotated[float, typer.Option("--friction", help="Coefficient of friction of the walls.")] = float("inf"),
    radius: Annotated[float, typer.Option("--particle-radius", help="Radius of the particles.")] = 0.0,
    max_moves: Annotated[int, typer.Option("--max-moves", help="Longer plans are of no use.")] = 100,
    seed: options.Seed = 0,
    out: _Out = None,
    film: Annotated[
        list[Path] | None,
        typer.Option(
            "--film",
            metavar="FILE",
            help="Write a film of the plan: .gif, .mp4 or .html (the player). May be given again.",
            show_default=False,
        ),
    ] = None,
    json_: options.Json = False,
) -> None:
    """Bring two particles to two goals with one shared input, by walls that hold what is pushed into them.

    Exit code 1 if the problem was not solved; the status says why.
    """
    from shoal.steering import Disturbance, SteeringProblem
    from shoal.steering import steer as run

    asked = SteeringProblem.load(problem)
    disturbance = Disturbance(friction=friction, radius=radius, **parse_noise(noise))
    check_outputs(out, film)
    with patience(COMPILING):
        episode = run(asked, planner=planner, disturbance=disturbance, seed=seed, max_moves=max_moves)
    written = _write_plan(episode, episode.report(), out, film)
    if json_:
        print_json(episode.report())
    else:
        print_plan(episode, written)
    if not episode:
        say(f"shoal: {episode.status}: {episode.reason}")
        raise typer.Exit(1)


def parse_noise(text: str) -> dict[str, float]:
    """Return the options of `Disturbance` that ``--noise`` gives.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> parse_noise("execution=0.001,gain=0.2")
    {'execution': 0.001, 'gain': 0.2}
    """
    found: dict[str, float] = {}
    for part in filter(None, (piece.strip() for piece in text.split(","))):
        name, _, value = part.partition("=")
        try:
            if name not in NOISES or name in found:
                raise ValueError
            found[name] = float(value)
        except ValueError:
            raise InvalidInputError(
                "--noise: expected execution=S, measurement=S and gain=V, each at most once and separated by commas, "
                f"got {part[:80]!r}"
            ) from None
    return found


def print_plan(episode: SteeringEpisode, written: list[Path], *more: tuple[str, str]) -> None:
    """Print the moves and figures of a plan for people."""
    bound = "none known" if episode.lower_bound is None else f"{episode.lower_bound:.6g}"
    shown = [", ".join(f"{number:+.6g}" for number in move) for move in episode.moves[:24]]
    rows = [
        ("status", episode.status),
        *((f"move {number}", text) for number, text in enumerate(shown, start=1)),
        *([("", f"and {episode.n_moves - 24} more")] if episode.n_moves > 24 else []),
        ("length", f"{episode.path_length:.6g} in {episode.n_moves} moves; lower bound {bound}"),
        ("error", f"{episode.error:.3g}, tolerance {episode.problem.tolerance:g}"),
        ("time", f"{episode.seconds:.3f} s"),
        *more,
        *(("written", str(path)) for path in written),
    ]
    print_table(rows, title=f"{episode.planner} in a {episode.problem.workspace.kind}")


def _write_plan(episode: SteeringEpisode, result: dict[str, Any], out: Path | None, film: list[Path] | None) -> list[Path]:
    """Write what --out and --film ask for; return the files."""
    written: list[Path] = []
    if out is not None:
        from shoal.files import atomic
        from shoal.views.drawing.charts import save_figure
        from shoal.views.steering.figures import plan_figure

        save_figure(plan_figure(episode), out / "plan.png")
        episode.save(out / "episode.json")
        with atomic(out / "summary.json") as temporary:
            temporary.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
        written += [out / name for name in ("plan.png", "episode.json", "summary.json")]
    for path in film or []:
        write_film(episode, path)
        written.append(path)
    return written


def write_film(episode: SteeringEpisode, path: Path) -> None:
    """Write one film, with a bar."""
    from shoal.views.steering.films import write_steering_film

    frames = 1000  # of the bar: how many the film has is known only once it is being written
    with progress(f"film {path.name}", frames, shown=path.suffix.lower() != ".html") as advance:
        write_steering_film(episode, path, on_frame=lambda done, total: advance(frames * done // total))


def replay_steering(episode_file: Path, seed: int | None, out: Path | None, film: list[Path] | None, json_: bool) -> None:
    """Replay a steering episode: ``shoal replay EPISODE.json``."""
    from shoal.steering import SteeringEpisode

    episode = SteeringEpisode.load(episode_file)
    check_seed(episode_file, seed, episode.seed)
    try:
        with patience(COMPILING):
            verified = bool(episode.verify())
            message = "played again, all particles go where the episode says" if verified else _why_not(episode)
    except ShoalError as error:  # particles that do not fit where the episode puts them
        raise InvalidInputError(f"{episode_file}: {error}") from None
    result = episode.report() | {"verified": verified, "message": message}
    written = _write_plan(episode, result, out, film) if verified else []
    if json_:
        print_json(result)
    else:
        print_plan(episode, written, ("verified", f"{'yes' if verified else 'NO'}: {message}"))
    if not verified:
        say(f"shoal: {episode_file}: {message}")
        raise typer.Exit(1)


def _why_not(episode: SteeringEpisode) -> str:
    """Return in what an episode that is not what it says differs from its moves played again."""
    import numpy as np

    states = episode.disturbance.replay(episode.problem, episode.moves, seed=episode.seed)
    away = np.linalg.norm(states - episode.states, axis=2)
    if away.max() <= 1e-9 * episode.problem.workspace.size:
        return f"it says solved, and a particle ends {episode.error:.3g} from its goal, tolerance {episode.problem.tolerance:g}"
    move = int(np.argmax(away.max(axis=1) > 1e-9 * episode.problem.workspace.size))
    particle = int(np.argmax(away[move]))
    return f"after move {move} particle {particle + 1} is {away[move, particle]:.3g} from where the episode says"


def reach(
    workspace: Annotated[
        str,
        typer.Argument(
            metavar="WORKSPACE",
            help="square, triangle, pentagon, hexagon, heptagon, octagon, regular:SIDES, disk, disk:RADIUS, a file (.json, "
            ".geojson, .wkt, .svg) or POLYGON ((...)).",
            show_default=False,
        ),
    ],
    start: Annotated[str, typer.Option("--start", metavar="'X,Y X,Y'", help="Where the particles are.", show_default=False)],
    moves: Annotated[int, typer.Option("--moves", help="Even: 2, 4, ...")] = 6,
    seed: Annotated[int, typer.Option("--seed", help="Not used: nothing here is random.")] = 0,
    out: _Out = None,
    json_: options.Json = False,
) -> None:
    """Which differences of two particles 2, 4, ... moves can make, and what share of all differences that is."""
    from shoal.steering import ConvexWorkspace, disk_reach, open_workspace, polygon_reach

    room = open_workspace(workspace)
    if not isinstance(room, ConvexWorkspace) or room.dimensions == 3:
        raise InvalidInputError(f"workspace: expected a convex polygon or a disk, got a {room.kind}")
    points = room.check_inside(parse_points(start), what="--start")
    delta = points[1] - points[0]
    if out is not None:
        check_folder(out)
    with patience(COMPILING):
        if room.round:
            sets: Any = disk_reach(float((delta @ delta) ** 0.5), moves=moves, radius=room.radius)
        else:
            sets = polygon_reach(room, delta, moves=moves)
        fractions = [one.fraction() for one in sets]
    result = {
        "workspace": room.kind,
        "start": points.tolist(),
        "delta": delta.tolist(),
        "moves": [one.moves for one in sets],
        "fractions": fractions,
    }
    written = []
    if out is not None:
        from shoal.files import atomic
        from shoal.views.drawing.charts import save_figure
        from shoal.views.steering.figures import reach_figure

        save_figure(reach_figure(sets), out / "reach.png")
        with atomic(out / "summary.json") as temporary:
            temporary.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
        written = [out / "reach.png", out / "summary.json"]
    if json_:
        print_json(result)
        return
    rows = [(f"{one.moves} moves", f"{100 * share:.2f} %") for one, share in zip(sets, fractions, strict=True)]
    rows += [("written", str(path)) for path in written]
    print_table(rows, title=f"differences reached from ({delta[0]:.6g}, {delta[1]:.6g}) in a {room.kind}")


def parse_points(text: str) -> list[list[float]]:
    """Return the two points of ``--start``.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> parse_points("0.1,0.2 0.3,0.4")
    [[0.1, 0.2], [0.3, 0.4]]
    """
    try:
        numbers = [float(word) for word in re.split(r"[\s,;]+", text.strip(" ()[]"))]
        if len(numbers) != 4:
            raise ValueError
    except ValueError:
        raise InvalidInputError(f"--start: expected two points, as in '0.1,0.2 0.3,0.4', got {text[:80]!r}") from None
    return [numbers[:2], numbers[2:]]


def demo_steer(out: Path, *, seed: int, json_: bool) -> None:
    """Plan and draw five problems: ``shoal demo steer``."""
    import numpy as np

    from shoal.steering import Disturbance, SteeringProblem, disk, open_workspace, prism, steer
    from shoal.views.drawing.charts import save_figure
    from shoal.views.steering.figures import plan_figure

    check_folder(out)
    square, hexagon = open_workspace("square"), open_workspace("hexagon")
    tall = prism(open_workspace("heptagon"), 0.8)  # type: ignore[arg-type]  # a name is never a region's
    cases = [
        ("square", square, [(0.2, 0.3), (0.5, 0.35)], [(0.8, 0.2), (0.3, 0.75)], 1e-6, "shortest"),
        ("hexagon", hexagon, [(-0.1, 0.0), (0.1, 0.1)], [(0.3, 0.1), (-0.2, -0.3)], 1e-6, "fewest-moves"),
        ("disk", disk(0.5), [(0.2, 0.2), (-0.1, -0.1)], [(-0.35, 0.2), (0.35, -0.25)], 1e-6, "greedy"),
        ("prism", tall, [(0.1, 0.2, 0.3), (0.0, 0.1, 0.6)], [(-0.2, 0.1, 0.7), (0.1, -0.1, 0.2)], 1e-6, "shortest"),
        ("noise", square, [(0.2, 0.3), (0.5, 0.35)], [(0.8, 0.2), (0.3, 0.75)], 0.01, "robust"),
    ]
    results: dict[str, Any] = {}
    rows, files = [], []
    with patience(COMPILING):
        for name, workspace, start, goal, tolerance, planner in cases:
            problem = SteeringProblem(workspace, np.array(start), np.array(goal), tolerance)
            noise = Disturbance(execution=1e-3, measurement=1e-3, gain=0.2) if name == "noise" else Disturbance()
            episode = steer(problem, planner=planner, disturbance=noise, seed=seed)
            save_figure(plan_figure(episode), out / f"{name}.png")
            episode.save(out / f"{name}.json")
            files += [out / f"{name}.png", out / f"{name}.json"]
            if name in ("square", "prism"):
                write_film(episode, out / f"{name}.html")
                files.append(out / f"{name}.html")
            results[name] = episode.report()
            rows.append((name, f"{planner}: {episode.sentence}"))
    if json_:
        print_json({"problems": results, "seed": seed, "files": [str(path) for path in files]})
        return
    print_table([*rows, *(("written", str(path)) for path in files)], title="Two particles, one shared input")
