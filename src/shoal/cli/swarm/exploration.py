"""shoal map, shoal cover, shoal gather: run a swarm. The command shoal replay also uses this module, to print and
write results.
"""

from __future__ import annotations

import statistics
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from shoal.cli import options
from shoal.cli.options import takes_problem
from shoal.cli.output import (
    check_outputs,
    duration_text,
    patience,
    print_json,
    print_table,
    progress,
    report_moves,
    say,
    write_films,
)
from shoal.core.checks import MOST_TRIALS, check_integer, shape_text
from shoal.core.episode import Status
from shoal.core.errors import InvalidInputError
from shoal.core.interruption import patient
from shoal.core.notices import quiet
from shoal.swarm.problem import NOISE_MEASURES, SwarmProblem

if TYPE_CHECKING:
    from shoal.swarm import SwarmEpisode
    from shoal.swarm.maps.imaging import Vessels

SIDES = ("layer", "row", "column")
INTERRUPTED = 130  # exit code after Ctrl-C
TOLD = 10.0  # seconds of planning from which the expected duration is said before the first move
MAP_EXAMPLE = "Example: shoal map vessels:1000 --particles 100 --seed 1"
GATHER_EXAMPLE = "Example: shoal gather vessels:300 --particles 20 --seed 1"
COVER_EXAMPLE = "Example: shoal cover maze:21x15 --particles 20 --subset 0.1"


@takes_problem(SwarmProblem, from_file=True, subset=None)
def map_(
    problem: SwarmProblem,
    trials: options.Trials = 1,
    seed: options.Seed = 0,
    workers: options.Workers = None,
    out: options.Out = None,
    film: options.Film = None,
    json_: options.Json = False,
) -> None:
    """Map an unknown space: find every free cell that the particles can reach, and the obstacles
    around the free cells.

    The exit code is 1 if a trial does not complete its task.
    """
    _play(problem, trials, seed, workers, out, film, json_)


@takes_problem(
    SwarmProblem, from_file=True, task="coverage", slip=0.0, misplace=0.0, miss=0.0, confidence=0.99
)
def cover(
    problem: SwarmProblem,
    trials: options.Trials = 1,
    seed: options.Seed = 0,
    workers: options.Workers = None,
    out: options.Out = None,
    film: options.Film = None,
    json_: options.Json = False,
) -> None:
    """Cover a known map: visit every free cell, or every cell of a random subset, with at least one
    particle.

    The exit code is 1 if a trial does not complete its task.
    """
    _play(problem, trials, seed, workers, out, film, json_)


@takes_problem(
    SwarmProblem,
    from_file=True,
    task="gathering",
    subset=None,
    target=None,
    slip=0.0,
    misplace=0.0,
    miss=0.0,
    confidence=0.99,
)
def gather(
    problem: SwarmProblem,
    trials: options.Trials = 1,
    seed: options.Seed = 0,
    workers: options.Workers = None,
    out: options.Out = None,
    film: options.Film = None,
    json_: options.Json = False,
) -> None:
    """Gather all particles on a known map: in one cell, which particles may share under the rule
    merge, or in a region.

    The exit code is 1 if a trial does not complete its task.
    """
    _play(problem, trials, seed, workers, out, film, json_)


def _play(
    problem: SwarmProblem,
    trials: int,
    seed: int,
    workers: int | None,
    out: Path | None,
    film: list[Path] | None,
    json_: bool,
) -> None:
    from shoal.lab import run_trials
    from shoal.swarm.policies import Offline
    from shoal.swarm.run import load_kernels

    check_outputs(out, film)
    with quiet():
        workspace = problem.place
    check_integer(trials, what="trials", least=1, most=MOST_TRIALS)
    if workers is not None and check_integer(workers, what="workers", least=1) > trials == 1:
        raise InvalidInputError(f"workers: expected several --trials beside it, got {workers}")
    warn_of_no_vessels(problem)
    problem.check_at_place()  # before kernels are compiled
    load_kernels(problem)
    whole = isinstance(problem.setup.policy, Offline)
    planned = (
        patience("computing the complete plan before the first move ...")
        if whole
        else nullcontext()
    )
    _tell_duration(problem, trials=trials, workers=workers, seed=seed, out=out)
    # after Ctrl-C, the results so far are written and printed before the process ends
    with patient():
        with planned, progress("trials", trials, shown=trials > 1) as advance:
            episodes = run_trials(
                problem,
                trials=trials,
                workers=workers,
                seed=seed,
                on_trial=advance,
                on_moves=report_moves(workspace.name) if trials == 1 else None,
                keep=True,
            )
        result = summary(episodes, seed=seed)
        interrupted = len(episodes) < trials or any(
            episode.status is Status.INTERRUPTED for episode in episodes
        )
        written = write_outputs(episodes, result, out, None if interrupted else film)
        if json_:
            print_json(result)
        else:
            print_trials(episodes, result, written)
        if interrupted:
            sys.stdout.flush()
            say(f"shoal: interrupted: {_kept_text(episodes, trials, out)}")
            raise typer.Exit(INTERRUPTED)
    if not all(episodes):
        raise typer.Exit(1)


def _kept_text(episodes: list[SwarmEpisode], trials: int, out: Path | None) -> str:
    """Return a text about the episodes that an interruption has left."""
    done = sum(episode.status is not Status.INTERRUPTED for episode in episodes)
    begun = f"{done} of {trials} trials ended" if trials > 1 else f"{episodes[0].moves} moves made"
    return (
        f"{begun}; {'--out DIR keeps the moves' if out is None else f'{out} has all moves so far'}"
    )


def _tell_duration(
    problem: SwarmProblem, *, trials: int, workers: int | None, seed: int, out: Path | None
) -> None:
    """Say before the first move what auto has chosen for a large map, and how long planning will
    take if it takes long.
    """
    from shoal.core.version import count_processors
    from shoal.swarm.policies.planners.beam_rollout import BeamRollout, planning_seconds
    from shoal.swarm.run import expected_duration

    policy, workspace = problem.setup.policy, problem.setup.workspace
    sizes = (workspace.shape, workspace.n_free, problem.particles)
    noisy = problem.noise is not None
    usual = BeamRollout()
    seconds = planning_seconds(usual, *sizes, noisy=noisy)
    if problem.setup.by_size and policy != usual:
        why = f"because best with its usual budget would take about {duration_text(seconds)}"
        say(f"shoal: notice: {workspace.name}: the policy auto chose {policy.name}, {why}")
    rounds = -(-trials // min(trials, workers or count_processors()))
    if (
        not isinstance(policy, BeamRollout)
        or rounds * planning_seconds(policy, *sizes, noisy=noisy) < TOLD
    ):
        return
    expected = expected_duration(problem, seed=seed)
    if expected is None or rounds * expected.seconds < TOLD:
        return
    each = f" in each of {trials} trials" if trials > 1 else ""
    kept = "" if out is not None else " if --out is given"
    say(
        f"shoal: notice: {workspace.name}: {policy.name} takes about"
        f" {duration_text(rounds * expected.seconds)}, for about {expected.moves:.0f} moves{each}"
        f" (Ctrl-C ends it and keeps the moves so far{kept}; a smaller --budget is faster)"
    )


def summary(episodes: list[SwarmEpisode], *, seed: int) -> dict[str, Any]:
    """Return the data that ``shoal map`` and ``shoal cover`` print as JSON.

    The data contain the values that all trials share, and lists with one entry for each trial.
    """
    reports = [episode.report() for episode in episodes]
    each = (
        "status",
        "moves",
        "scans",
        "cost",
        "distance",
        "distance_mm",
        "apparatus_seconds",
        *NOISE_MEASURES,
    )
    rates = ("false_free_rate", "false_obstacle_rate")
    left_out = (*each, *rates, "reason")
    result = {name: value for name, value in reports[0].items() if name not in left_out} | {
        "seed": seed,
        "trials": len(episodes),
    }
    result |= {name: [report[name] for report in reports] for name in each if name in reports[0]}
    result |= {
        name: statistics.fmean(report[name] for report in reports)
        for name in rates
        if name in reports[0]
    }
    result |= {
        name: None for name in ("distance_mm", "apparatus_seconds") if result[name][0] is None
    }
    moves = result["moves"]
    return result | {
        "mean": statistics.fmean(moves),
        "std": statistics.stdev(moves) if len(moves) > 1 else 0.0,
        "mean_cost": statistics.fmean(result["cost"]),
    }


def _noise_rows(episodes: list[SwarmEpisode], result: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the additional rows of the printed summary for episodes with noise."""
    if "noise" not in result:
        return []
    noise = result["noise"]
    mean = {
        name: statistics.fmean(result[name])
        for name in ("false_free", "false_obstacles", "undecided")
    }
    rates = ", ".join(f"{name} {rate:g}" for name, rate in noise.items())
    wrong = (
        f"{mean['false_free']:g} walls classified as free, {mean['false_obstacles']:g} free cells"
        " classified as walls"
    )
    wrong += f", {mean['undecided']:g} undecided"
    worst = f", at worst {100 * min(result['right']):.2f} %" if len(episodes) > 1 else ""
    return [
        ("noise", f"{rates}; confidence {result['confidence']:g}"),
        ("right", f"{100 * statistics.fmean(result['right']):.2f} % of the cells{worst}; {wrong}"),
    ]


def print_trials(
    episodes: list[SwarmEpisode],
    result: dict[str, Any],
    written: list[Path],
    *more: tuple[str, str],
) -> None:
    """Print a summary of the results of all trials."""
    title = f"{episodes[0].task} of {episodes[0].workspace.name}"
    print_table([*_rows(episodes, result), *more], title=title, written=written)


def _policy_text(episode: SwarmEpisode) -> str:
    """Return the name of an episode's policy. If the name ``best`` is an alias of the policy,
    return ``best (NAME)``.
    """
    from shoal.swarm.policies import POLICIES

    best: str = vars(POLICIES.get("best"))["kind"]
    return (
        f"best ({episode.policy})" if episode.policy.partition(":")[0] == best else episode.policy
    )


def _rows(episodes: list[SwarmEpisode], result: dict[str, Any]) -> list[tuple[str, str]]:
    first = episodes[0]
    rows = [
        (
            "map",
            (
                f"{first.workspace.name}, {shape_text(first.workspace.shape)},"
                f" {first.workspace.n_free} free cells"
            ),
        ),
        *cell_rows(first.workspace.spacing),
        ("particles", f"{first.particles}, {first.placement} placement, rule {first.rule}"),
        ("policy", _policy_text(first)),
    ]
    if len(episodes) == 1:
        done = int(first.trace.classified.sum())
        rows += [
            ("result", first.sentence),
            _done_row(first, done),
            *_ratio_rows(first),
            *_noise_rows(episodes, result),
            ("cost", _cost(first)),
            ("distance", _distance(first)),
            *_apparatus_rows(first.lengths_and_times),
            ("time", f"{first.seconds:.3f} s, {1e6 * first.seconds_per_move:.1f} µs per move"),
        ]
        return rows
    counts = {status: result["status"].count(status) for status in dict.fromkeys(result["status"])}
    rows += [
        (
            "moves",
            f"{result['mean']:.2f} ± {result['std']:.2f} (mean and sample standard deviation)",
        ),
        (
            "cost",
            (
                f"{result['mean_cost']:.2f}, with {statistics.fmean(result['scans']):.2f} scans"
                f" ({_prices(first)})"
            ),
        ),
        ("range", f"{min(result['moves'])} to {max(result['moves'])}"),
        ("status", ", ".join(f"{count} {status}" for status, count in counts.items())),
        *_noise_rows(episodes, result),
    ]
    if first.lengths_and_times["apparatus_seconds"] is not None:
        rows.append(
            (
                "apparatus",
                (
                    f"{statistics.fmean(result['apparatus_seconds']):.4g} s on average for moves"
                    " and scans"
                ),
            )
        )
    return rows


def cell_rows(spacing: tuple[float, ...] | None) -> list[tuple[str, str]]:
    """Return a row with the size of a cell, if it is known."""
    if spacing is None:
        return []
    sizes = spacing[:1] if len(set(spacing)) == 1 else spacing
    sides = "" if len(sizes) == 1 else f" ({', '.join(SIDES[-len(sizes) :])})"
    return [("cell", f"{' × '.join(f'{size:g}' for size in sizes)} mm{sides}")]


def _distance(episode: SwarmEpisode) -> str:
    length = episode.lengths_and_times["distance_mm"]
    return (
        f"{episode.distance} cells{'' if length is None else f' ({length:.6g} mm)'} travelled by"
        " all particles"
    )


def _apparatus_rows(quantities: dict[str, Any]) -> list[tuple[str, str]]:
    """Return a row with the time that the apparatus takes, if the time of a move or of a scan is
    given.
    """
    total, move, scan = (
        quantities[name] for name in ("apparatus_seconds", "move_seconds", "scan_seconds")
    )
    if total is None:
        return []
    parts = [
        f"{value:g} s per {what}"
        for what, value in (("move", move), ("scan", scan))
        if value is not None
    ]
    return [("apparatus", f"{total:.6g} s ({', '.join(parts)})")]


def _cost(episode: SwarmEpisode) -> str:
    return f"{episode.cost:g}: {episode.moves} moves and {episode.scans} scans ({_prices(episode)})"


def _prices(episode: SwarmEpisode) -> str:
    rule = episode.problem.scanning
    return f"{rule.move_cost:g} per move, {rule.scan_cost:g} per scan, scan-every {rule.every}"


def _ratio_rows(episode: SwarmEpisode) -> list[tuple[str, str]]:
    """Return a row with the competitive ratio of depth-first search with one particle (paper M,
    section III.B.1).
    """
    least = episode.workspace.n_free - 1
    if not episode.policy.startswith("depth-first") or episode.particles > 1 or least < 1:
        return []
    steps = episode.distance
    ratio = (
        f"{steps / least:.2f}: {steps} steps, of which any tour of the cells needs {least} (never"
        " above 2)"
    )
    return [("ratio", f"{ratio}; {episode.moves - steps} probes of walls")]


def _done_row(episode: SwarmEpisode, done: int) -> tuple[str, str]:
    """Return a row with the result in words: found free cells and walls, covered cells, or where
    the particles are.
    """
    if episode.task == "gathering":
        cells = episode.final()[0].cells
        if episode.targets is not None:
            inside, room = int(episode.targets[tuple(cells.T)].sum()), int(episode.targets.sum())
            size = "1 cell" if room == 1 else f"{room} cells"
            return ("gathered", f"{inside} of {len(cells)} particles, in a region of {size}")
        places = {tuple(cell) for cell in cells.tolist()}
        where = f"1 cell, {min(places)}" if len(places) == 1 else f"{len(places)} cells"
        return ("gathered", f"{len(cells)} particles in {where}")
    if episode.targets is not None:
        wanted = int(episode.targets.sum())
        return (
            "covered",
            (
                f"{wanted - episode.first_frontier + done} of {wanted} cells,"
                f" {wanted - episode.first_frontier} at the start"
            ),
        )
    _, belief = episode.final()
    free = len(belief.open)
    return (
        "found",
        (
            f"{free} free cells ({episode.particles} at the start) and {len(belief.obstacles)} wall"
            " cells around them"
        ),
    )


def write_outputs(
    episodes: list[SwarmEpisode], result: dict[str, Any], out: Path | None, film: list[Path] | None
) -> list[Path]:
    """Write the output files that --out and --film request, and return their paths."""
    written: list[Path] = []
    if out is not None:
        from shoal.core.files import write_json
        from shoal.views import figure, save_figure

        save_figure(figure(episodes[0]), out / "map.png")
        save_figure(figure(episodes, kind="frontier"), out / "frontier.png")
        written += [out / "map.png", out / "frontier.png", *overlay(episodes[0].problem, out)]
        # the run of a rig with noise, or one that was interrupted, is kept in its log
        kept = [one for one in episodes if one.observations is None and not one.placed]
        names = (
            ["episode.npz"]
            if len(episodes) == 1
            else [f"episodes/{e.trial:05d}.npz" for e in episodes]
        )
        _remove_earlier(out, {out / name for name in names[: len(kept)]})
        with progress("episodes", len(episodes), shown=len(episodes) > 100) as advance:
            for done, (episode, name) in enumerate(zip(kept, names, strict=False), start=1):
                episode.save(out / name)
                advance(done)
        if kept:
            written.append(out / names[0] if len(names) == 1 else out / "episodes")
        write_json(out / "summary.json", result)
        written.append(out / "summary.json")
    return written + write_films(episodes[0], film)


def warn_of_no_vessels(problem: SwarmProblem) -> None:
    """Print a warning if the map is a photograph that may show no vessels."""
    if problem.vessels and problem.place_is_file() and (warning := vessels_of(problem).warning):
        say(f"shoal: warning: {problem.map}: {warning}")


def vessels_of(problem: SwarmProblem) -> Vessels:
    """Return the vessels that Shoal finds in the photograph of a problem."""
    from shoal.swarm.maps.files import vessels_in

    names = ("low", "high", "bright", "thickest", "channel", "frame")
    return vessels_in(problem.map, **{name: getattr(problem, name) for name in names})


def overlay(problem: SwarmProblem, out: Path) -> list[Path]:
    """Write a picture of the photograph with the outline of its vessels, if the map is a
    photograph.
    """
    if not (problem.vessels and problem.place_is_file()):
        return []
    from shoal.swarm.maps.pictures import read_pixels
    from shoal.views.swarm.figures import overlay_picture, save_picture

    pixels = read_pixels(Path(problem.map), channel=problem.channel, frame=problem.frame)
    picture = overlay_picture(pixels, vessels_of(problem).mask)
    return [save_picture(picture, out / "overlay.png")]


def _remove_earlier(out: Path, names: set[Path]) -> None:
    """Remove the episodes of an earlier run from an output folder, other than those that the new run
    replaces, so that all files in the folder belong to the new run.
    """
    found = {out / "episode.npz", *(out / "episodes").glob("[0-9][0-9][0-9][0-9][0-9]*.npz")}
    for path in found - names:
        path.unlink(missing_ok=True)
