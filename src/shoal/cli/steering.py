"""shoal steer, shoal reach: steer particles with one shared input, with the help of walls."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from shoal.cli import options
from shoal.cli.options import takes_problem
from shoal.cli.output import (
    check_folder,
    check_outputs,
    print_json,
    print_table,
    say,
    write_episode,
    write_films,
)
from shoal.core.errors import InvalidInputError
from shoal.steering.problem import SteeringProblem

if TYPE_CHECKING:
    from shoal.steering import Certificate, SteeringEpisode

STEER_EXAMPLE = "Example: shoal steer problem.json --planner shortest --out plan"
REACH_EXAMPLE = 'Example: shoal reach hexagon --start "-0.1,0 0.1,0.1" --moves 6'

_Out = Annotated[
    Path | None,
    typer.Option(
        "--out", metavar="FOLDER", help="Folder for the figures, the JSON result and the episode."
    ),
]


@takes_problem(SteeringProblem, from_file=True)
def steer(
    problem: SteeringProblem,
    ctx: typer.Context,
    seed: options.Seed = 0,
    out: _Out = None,
    film: options.Film = None,
    certify: Annotated[
        float | None,
        typer.Option(
            "--certify",
            metavar="SECONDS",
            help=(
                "Search for at most this time for a proof of how much shorter a plan could be, and"
                " for shorter plans. For two points in a polygon, a disk, a prism or a region with"
                " obstacles, --out also writes the proof, certificate.json, and the search needs"
                ' the extra "certify".'
            ),
        ),
    ] = None,
    check: Annotated[
        Path | None,
        typer.Option(
            "--check",
            metavar="CERTIFICATE",
            help=(
                "Do not plan: check in exact arithmetic that this certificate proves its bound for"
                " the problem. The exit code is 1 if it does not."
            ),
        ),
    ] = None,
    json_: options.Json = False,
) -> None:
    """Bring two or more particles to their goals with one shared input, using walls that hold
    particles.

    A problem file contains a JSON object with the fields "workspace", "start" and "goal", and may
    contain any option as a field. The field "workspace" is a name, a file, or an object as
    described in docs/concepts/steering.md. The fields "start" and "goal" are lists of points.
    Options on the command line replace the fields of the problem file. The exit code is 1 if the
    problem was not solved; the status gives the reason.
    """
    from shoal.steering.certificates import check_certifiable
    from shoal.steering.run import run

    problem.check_at_place()
    if check is not None:
        for name in ("planner", "time", "max_moves", "certify", "out", "film"):
            if options.is_given(ctx, name):
                raise InvalidInputError(
                    f"--check: expected no --{name.replace('_', '-')}, because nothing is planned"
                )
        _check(problem, seed, check, json_=json_)
        return
    check_outputs(out, film)
    if certify is None:
        episode = run(problem, seed=seed)
        result, more = episode.report(), []
    else:
        check_certifiable(problem, certify)
        certificate = _certified(run(problem, seed=seed), certify)
        episode, result = certificate.episode, certificate.report()
        more = [("certificate", certificate.sentence)]
        if out is not None and certificate.proof is not None:
            result["certificate"] = str(out / "certificate.json")
    written = write_episode(episode, result, out, film)
    if out is not None and certify is not None and result["certificate"] is not None:
        from shoal.core.files import write_json

        write_json(out / "certificate.json", certificate.proof)
        written.append(out / "certificate.json")
    if json_:
        print_json(result)
    else:
        print_plan(episode, result, written, *more)
    if not episode:
        say(f"shoal: {episode.sentence}")
        raise typer.Exit(1)


def _certified(episode: SteeringEpisode, seconds: float) -> Certificate:
    """Search for a certificate, and show how the bound rises."""
    from shoal.cli.output import progress
    from shoal.steering import certify

    with progress("certificate", max(1, round(seconds)), shown=seconds > 5) as advance:
        return certify(episode, seconds=seconds, progress=lambda passed, _: advance(round(passed)))


def _check(problem: SteeringProblem, seed: int, path: Path, *, json_: bool) -> None:
    from shoal.core.checks import parse_json, read_text
    from shoal.steering.certificates import check_certificate_of

    certificate = parse_json(read_text(path, what="certificate", most=2**31), where=str(path))
    verification = check_certificate_of(problem, certificate, seed=seed)
    if json_:
        print_json({"valid": verification.ok, "message": verification.message})
    else:
        print_table(
            [("valid", "yes" if verification else "no"), ("check", verification.message)],
            title=str(path),
        )
    if not verification:
        say(f"shoal: {verification.message}")
        raise typer.Exit(1)


def print_plan(
    episode: SteeringEpisode, result: dict[str, Any], written: list[Path], *more: tuple[str, str]
) -> None:
    """Print the moves and the metrics of a steering plan."""
    bound = "none known" if episode.lower_bound is None else f"{episode.lower_bound:.6g}"
    shown = [", ".join(f"{number:+.12g}" for number in move) for move in episode.inputs[:24]]
    rows = [
        ("status", str(episode.status)),
        *((f"move {number}", text) for number, text in enumerate(shown, start=1)),
        *([("", f"and {episode.moves - 24} more")] if episode.moves > 24 else []),
        ("length", f"{episode.length:.6g} in {episode.moves} moves; lower bound {bound}"),
        ("error", f"{episode.error:.3g}, tolerance {episode.problem.tolerance:g}"),
        (
            "condition",
            (
                f"{episode.condition:.3g}{', sensitive: it holds only in exact arithmetic' if episode.sensitive else ''}"
            ),
        ),
        *_shares(result),
        ("time", f"{episode.seconds:.3f} s"),
        *more,
    ]
    print_table(rows, title=f"{episode.planner} in a {episode.problem.place.kind}", written=written)


def _shares(result: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the rows about plans with stated errors."""
    rows = []
    if result.get("holding_share") is not None:
        rows.append(
            ("holds", f"{100 * result['holding_share']:.1f} % of 1000 simulations with errors")
        )
    if result.get("unreachable_share") is not None:
        rows.append(
            (
                "unreachable",
                f"{100 * result['unreachable_share']:.1f} % of 200 random goals, provably",
            )
        )
    return rows


@takes_problem(SteeringProblem, only=("workspace", "start"))
def reach(
    problem: SteeringProblem,
    moves: Annotated[
        int, typer.Option("--moves", help="Number of moves, an even number: 2, 4, ...")
    ] = 6,
    seed: Annotated[int, typer.Option("--seed", help="Seed that determines a random start.")] = 0,
    out: _Out = None,
    json_: options.Json = False,
) -> None:
    """Compute the fraction of all possible position differences that two particles can reach in 2,
    4, ... moves.
    """
    from shoal.steering import ConvexWorkspace, disk_reach, polygon_reach

    workspace = problem.place
    if not isinstance(workspace, ConvexWorkspace) or workspace.dimensions == 3:
        raise InvalidInputError(
            f"workspace: expected a convex polygon or a disk, got a {workspace.kind}"
        )
    points = workspace.check_inside(problem.endpoints(seed)[0], what="--start")
    if len(points) != 2:
        raise InvalidInputError(f"--start: expected two points, got {len(points)}")
    delta = points[1] - points[0]
    if out is not None:
        check_folder(out)
    if workspace.round:
        sets: Any = disk_reach(float((delta @ delta) ** 0.5), moves=moves, radius=workspace.radius)
    else:
        sets = polygon_reach(workspace, delta, moves=moves)
    fractions = [one.fraction() for one in sets]
    result = {
        "workspace": workspace.kind,
        "start": points.tolist(),
        "delta": delta.tolist(),
        "moves": [one.moves for one in sets],
        "fractions": fractions,
    }
    written = []
    if out is not None:
        from shoal.core.files import write_json
        from shoal.views.drawing.charts import save_figure
        from shoal.views.steering.figures import reach_figure

        save_figure(reach_figure(sets), out / "reach.png")
        write_json(out / "summary.json", result)
        written = [out / "reach.png", out / "summary.json"]
    if json_:
        print_json(result)
        return
    rows = [
        (f"{one.moves} moves", f"{100 * share:.2f} %")
        for one, share in zip(sets, fractions, strict=True)
    ]
    print_table(
        rows,
        title=f"differences reached from ({delta[0]:.6g}, {delta[1]:.6g}) in a {workspace.kind}",
        written=written,
    )


def demo_steer(out: Path, *, seed: int, json_: bool) -> None:
    """Plan and draw five steering problems: ``shoal demo steer``."""
    from shoal.steering import open_workspace, prism
    from shoal.steering.run import run
    from shoal.views import figure, save_figure

    check_folder(out)
    # a name is never a region's
    tall = prism(open_workspace("heptagon"), 0.8)  # type: ignore[arg-type]
    cases = [
        (
            "square",
            "square",
            [(0.2, 0.3), (0.5, 0.35)],
            [(0.8, 0.2), (0.3, 0.75)],
            1e-6,
            "shortest",
        ),
        (
            "hexagon",
            "hexagon",
            [(-0.1, 0.0), (0.1, 0.1)],
            [(0.3, 0.1), (-0.2, -0.3)],
            1e-6,
            "fewest-moves",
        ),
        ("disk", "disk", [(0.2, 0.2), (-0.1, -0.1)], [(-0.35, 0.2), (0.35, -0.25)], 1e-6, "greedy"),
        (
            "prism",
            tall,
            [(0.1, 0.2, 0.3), (0.0, 0.1, 0.6)],
            [(-0.2, 0.1, 0.7), (0.1, -0.1, 0.2)],
            1e-6,
            "shortest",
        ),
        ("noise", "square", [(0.2, 0.3), (0.5, 0.35)], [(0.8, 0.2), (0.3, 0.75)], 0.01, "robust"),
    ]
    results: dict[str, Any] = {}
    rows, files = [], []
    for name, workspace, start, goal, tolerance, planner in cases:
        noise: dict[str, Any] = (
            {"execution": 1e-3, "measurement": 1e-3, "gain": 0.2} if name == "noise" else {}
        )
        problem = SteeringProblem(workspace, start, goal, tolerance, planner=planner, **noise)
        episode = run(problem, seed=seed)
        save_figure(figure(episode), out / f"{name}.png")
        episode.save(out / f"{name}.json")
        files += [out / f"{name}.png", out / f"{name}.json"]
        if name in ("square", "prism"):
            files += write_films(episode, [out / f"{name}.html"])
        results[name] = episode.report()
        rows.append((name, f"{planner}: {episode.sentence}"))
    if json_:
        print_json({"problems": results, "seed": seed, "files": [str(path) for path in files]})
        return
    print_table(rows, title="Two particles, one shared input", written=files)
