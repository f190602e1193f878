"""shoal map, shoal cover, shoal replay: runs of the swarm part."""

from __future__ import annotations

import json
import statistics
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from shoal.cli import options
from shoal.cli.output import (
    check_outputs,
    check_seed,
    moves_told,
    no_linear_algebra,
    patience,
    print_json,
    print_table,
    progress,
    quiet,
    say,
    write_films,
)
from shoal.errors import InvalidInputError, ShoalError

if TYPE_CHECKING:
    from shoal.swarm import Episode, GridWorkspace

MAP_EXAMPLE = "Example: shoal map vessels:1000 --particles 100 --seed 1"
COVER_EXAMPLE = "Example: shoal cover maze:21x15 --particles 20 --subset 0.1"


def map_(
    map_name: options.Map,
    particles: options.Particles = 100,
    policy: options.PolicyName = "best",
    budget: options.Budget = None,
    time_per_move: options.TimePerMove = None,
    placement: options.PlacementName = "uniform",
    rule: options.Rule = "block",
    trials: options.Trials = 1,
    seed: options.Seed = 0,
    max_moves: options.MaxMoves = 1_000_000,
    scan_every: options.ScanEvery = "1",
    scan_cost: options.ScanCost = 10.0,
    move_cost: options.MoveCost = 1.0,
    slip: options.Slip = 0.0,
    misplace: options.Misplace = 0.0,
    miss: options.Miss = 0.0,
    confidence: options.Confidence = 0.99,
    workers: options.Workers = None,
    out: options.Out = None,
    film: options.Film = None,
    json_: options.Json = False,
    vessels: options.Vessels = False,
    width: options.Width = None,
    threshold: options.Threshold = 0.5,
    invert: options.Invert = False,
    scale: options.Scale = 1.0,
    level: options.Level = None,
    label: options.Label = None,
    largest_component: options.LargestComponent = False,
) -> None:
    """Map an unknown workspace: find every free cell that the particles can reach, and the walls around them.

    The policy best plans every move; with --scan-every, noise or rule tilt, for which it has no answer, the default is
    closest-frontier.
    """
    from shoal.swarm.maps.open import open_map

    with quiet():
        kinds: dict[str, Any] = {"threshold": threshold, "invert": invert, "scale": scale, "level": level, "label": label}
        workspace = open_map(map_name, vessels=vessels, width=width, **kinds)
    noise = noise_of(slip, misplace, miss, confidence)
    if policy == "best" and (scan_every != "1" or rule == "tilt" or noise) and budget is None and time_per_move is None:
        policy = "closest-frontier"
    policy = _thinking(policy, budget, time_per_move)
    problem: dict[str, Any] = {"task": "mapping", "particles": particles, "policy": policy, "placement": placement, "rule": rule}
    problem |= {"scan_every": scan_every, "scan_cost": scan_cost, "move_cost": move_cost}
    problem |= noise
    _play(workspace, problem, trials, seed, max_moves, workers, out, film, json_, largest_component)


def noise_of(slip: float, misplace: float, miss: float, confidence: float) -> dict[str, Any]:
    """Return the arguments of a run with noise, none if nothing goes wrong."""
    from shoal.swarm.noise.model import CONFIDENCE, Noise, bound_of

    bound_of(confidence)
    noise = Noise(slip, misplace, miss)
    if not noise and confidence != CONFIDENCE:
        raise InvalidInputError(f"confidence: expected it together with noise (slip, misplace, miss), got {confidence:g} alone")
    return {"noise": noise, "confidence": confidence} if noise else {}


def cover(
    map_name: options.Map,
    subset: Annotated[
        float | None,
        typer.Option("--subset", help="Cover a random share of the free cells only, above 0 to 1.", show_default=False),
    ] = None,
    particles: options.Particles = 100,
    policy: options.PolicyName = "closest-frontier",
    budget: options.Budget = None,
    time_per_move: options.TimePerMove = None,
    placement: options.PlacementName = "uniform",
    rule: options.Rule = "block",
    trials: options.Trials = 1,
    seed: options.Seed = 0,
    max_moves: options.MaxMoves = 1_000_000,
    scan_every: options.ScanEvery = "1",
    scan_cost: options.ScanCost = 10.0,
    move_cost: options.MoveCost = 1.0,
    workers: options.Workers = None,
    out: options.Out = None,
    film: options.Film = None,
    json_: options.Json = False,
    vessels: options.Vessels = False,
    width: options.Width = None,
    threshold: options.Threshold = 0.5,
    invert: options.Invert = False,
    scale: options.Scale = 1.0,
    level: options.Level = None,
    label: options.Label = None,
    largest_component: options.LargestComponent = False,
) -> None:
    """Cover a known workspace: let some particle stand in every free cell, or in each of a random subset of them."""
    from shoal.swarm import SubsetCoverage
    from shoal.swarm.maps.open import open_map

    task: Any = "coverage" if subset is None else SubsetCoverage(fraction=subset)
    with quiet():
        kinds: dict[str, Any] = {"threshold": threshold, "invert": invert, "scale": scale, "level": level, "label": label}
        workspace = open_map(map_name, vessels=vessels, width=width, **kinds)
    policy = _thinking(policy, budget, time_per_move)
    problem: dict[str, Any] = {"task": task, "particles": particles, "policy": policy, "placement": placement, "rule": rule}
    problem |= {"scan_every": scan_every, "scan_cost": scan_cost, "move_cost": move_cost}
    _play(workspace, problem, trials, seed, max_moves, workers, out, film, json_, largest_component)


def _thinking(policy: str, budget: float | None, time_per_move: float | None) -> str:
    """Return the policy with the options of --budget and --time-per-move."""
    from shoal.swarm.policies import make_policy

    given = {"budget": budget, "milliseconds": time_per_move}
    wanted = [f"{name}={value:.17g}" for name, value in given.items() if value is not None]
    if not wanted:
        return policy
    option = "--budget" if budget is not None else "--time-per-move"
    if len(wanted) > 1:
        raise InvalidInputError("expected --budget or --time-per-move, got both")
    if not hasattr(make_policy(policy), wanted[0].partition("=")[0]):
        able = "best, beam-rollout, rollout or offline" if budget is not None else "best, beam-rollout or rollout"
        raise InvalidInputError(f"{option}: expected a policy that plans ({able}), got {policy}")
    return policy + ("," if ":" in policy else ":") + wanted[0]


def _play(
    workspace: GridWorkspace,
    problem: dict[str, Any],
    trials: int,
    seed: int,
    max_moves: int,
    workers: int | None,
    out: Path | None,
    film: list[Path] | None,
    json_: bool,
    largest_component: bool,
) -> None:
    from shoal.lab import run_trials
    from shoal.swarm import planning
    from shoal.swarm.engine import load_kernels
    from shoal.swarm.grid.scans import ScanRule
    from shoal.swarm.policies import Compiled, Offline, PlannerPolicy, make_policy
    from shoal.swarm.policies.compiled import check_scanning

    check_outputs(out, film)
    rule = ScanRule.parse(problem["scan_every"], scan_cost=problem["scan_cost"], move_cost=problem["move_cost"])
    check_scanning(rule, make_policy(problem["policy"]), problem["rule"])  # before half a minute of compiling
    if largest_component:
        workspace = workspace.largest_component()
    chosen = make_policy(problem["policy"])
    if isinstance(chosen, Compiled):
        with patience("compiling kernels: once after an installation, half a minute ..."), no_linear_algebra():
            load_kernels()
    if isinstance(chosen, PlannerPolicy | Offline):
        with patience("compiling the planner: once after an installation, a minute ..."), no_linear_algebra():
            planning.load_kernels()
    planned = patience("making a whole plan before the first move ...") if isinstance(chosen, Offline) else nullcontext()
    with planned, progress("trials", trials, shown=trials > 1) as advance:
        episodes = run_trials(
            workspace,
            trials=trials,
            workers=workers,
            seed=seed,
            max_moves=max_moves,
            on_trial=advance,
            on_moves=moves_told(workspace.name) if trials == 1 else None,
            **problem,
        )
    result = summary(episodes, seed=seed)
    written = write_outputs(episodes, result, out, film)
    if json_:
        print_json(result)
        return
    print_table([*_rows(episodes, result), *(("written", str(path)) for path in written)], title=_title(episodes[0]))


def summary(episodes: list[Episode], *, seed: int) -> dict[str, Any]:
    """Return the JSON object of map and cover."""
    first = episodes[0]
    moves = [episode.moves for episode in episodes]
    return {
        "task": first.task,
        "policy": first.policy,
        "map": {
            "name": first.workspace.name,
            "shape": list(first.workspace.shape),
            "free_cells": first.workspace.n_free,
        },
        "particles": first.n_particles,
        "placement": first.placement,
        "rule": first.rule,
        "seed": seed,
        "trials": len(episodes),
        "moves": moves,
        "status": [episode.status for episode in episodes],
        "mean": statistics.fmean(moves),
        "std": statistics.stdev(moves) if len(moves) > 1 else 0.0,
        "scan_every": first.scanning.every,
        "scan_cost": first.scanning.scan_cost,
        "move_cost": first.scanning.move_cost,
        "scans": [episode.scans for episode in episodes],
        "cost": [episode.cost for episode in episodes],
        "mean_cost": statistics.fmean(episode.cost for episode in episodes),
    } | _noise_summary(episodes)


def _noise_summary(episodes: list[Episode]) -> dict[str, Any]:
    """Return what runs with noise say beyond the others: how right their maps are."""
    from shoal.swarm.noise import NoisyEpisode

    noisy = [episode for episode in episodes if isinstance(episode, NoisyEpisode)]
    if not noisy:
        return {}
    errors = [episode.errors for episode in noisy]
    counts = {name: [getattr(error, name) for error in errors] for name in ("right", "false_free", "false_obstacles", "undecided")}
    rates = {
        name: statistics.fmean(getattr(error, name) for error in errors) for name in ("false_free_rate", "false_obstacle_rate")
    }
    return {"noise": dict(vars(noisy[0].noise)), "confidence": noisy[0].confidence, **counts, **rates}


def _noise_rows(episodes: list[Episode], result: dict[str, Any]) -> list[tuple[str, str]]:
    """Return what runs with noise say to people beyond the others."""
    if "noise" not in result:
        return []
    noise, mean = result["noise"], {name: statistics.fmean(result[name]) for name in ("false_free", "false_obstacles", "undecided")}
    rates = ", ".join(f"{name} {rate:g}" for name, rate in noise.items())
    wrong = f"{mean['false_free']:g} walls taken for free, {mean['false_obstacles']:g} free cells for walls"
    wrong += f", {mean['undecided']:g} undecided"
    worst = f", at worst {100 * min(result['right']):.2f} %" if len(episodes) > 1 else ""
    return [
        ("noise", f"{rates}; confidence {result['confidence']:g}"),
        ("right", f"{100 * statistics.fmean(result['right']):.2f} % of the cells{worst}; {wrong}"),
    ]


def _title(first: Episode) -> str:
    return f"{first.task} of {first.workspace.name}"


def _rows(episodes: list[Episode], result: dict[str, Any]) -> list[tuple[str, str]]:
    first = episodes[0]
    size = "x".join(str(length) for length in first.workspace.shape)
    rows = [
        ("map", f"{first.workspace.name}, {size}, {first.workspace.n_free} free cells"),
        ("particles", f"{first.n_particles}, {first.placement} placement, rule {first.rule}"),
        ("policy", first.policy),
    ]
    if len(episodes) == 1:
        done = int(first.done.sum())
        rows += [
            ("result", first.sentence),
            _done_row(first, done),
            *_ratio_rows(first),
            *_noise_rows(episodes, result),
            ("cost", _cost(first)),
            ("distance", f"{first.distance} cells travelled by all particles"),
            ("time", f"{first.seconds:.3f} s, {1e6 * first.seconds_per_move:.1f} µs a move"),
        ]
        return rows
    counts = {status: result["status"].count(status) for status in dict.fromkeys(result["status"])}
    rows += [
        ("moves", f"{result['mean']:.2f} ± {result['std']:.2f} (mean and sample standard deviation)"),
        ("cost", f"{result['mean_cost']:.2f}, with {statistics.fmean(result['scans']):.2f} scans ({_prices(first)})"),
        ("range", f"{min(result['moves'])} to {max(result['moves'])}"),
        ("status", ", ".join(f"{count} {status}" for status, count in counts.items())),
        *_noise_rows(episodes, result),
    ]
    return rows


def _cost(episode: Episode) -> str:
    return f"{episode.cost:g}: {episode.moves} moves and {episode.scans} scans ({_prices(episode)})"


def _prices(episode: Episode) -> str:
    rule = episode.scanning
    return f"{rule.move_cost:g} a move, {rule.scan_cost:g} a scan, scan-every {rule.every}"


def _ratio_rows(episode: Episode) -> list[tuple[str, str]]:
    """Return the competitive ratio of depth-first search with one particle (paper M, section III.B.1)."""
    least = episode.workspace.n_free - 1
    if not episode.policy.startswith("depth-first") or episode.n_particles > 1 or least < 1:
        return []
    steps = episode.distance
    ratio = f"{steps / least:.2f}: {steps} steps, of which any tour of the cells needs {least} (never above 2)"
    return [("ratio", f"{ratio}; {episode.moves - steps} probes of walls")]


def _done_row(episode: Episode, done: int) -> tuple[str, str]:
    """Return what was done, in words: cells found free and walls found, or cells covered."""
    if episode.targets is not None:
        wanted = int(episode.targets.sum())
        return (
            "covered",
            f"{wanted - episode.first_frontier + done} of {wanted} cells, {wanted - episode.first_frontier} at the start",
        )
    _, belief = episode.final()
    free = len(belief.open)
    return "found", f"{free} free cells ({episode.n_particles} at the start) and {len(belief.obstacles)} wall cells around them"


def write_outputs(episodes: list[Episode], result: dict[str, Any], out: Path | None, film: list[Path] | None) -> list[Path]:
    """Write what --out and --film ask for; return the files."""
    written: list[Path] = []
    if out is not None:
        from shoal.files import atomic
        from shoal.swarm.noise import SeenEpisode
        from shoal.views import figure, save_figure

        save_figure(figure(episodes[0]), out / "map.png")
        save_figure(figure(episodes, kind="frontier"), out / "frontier.png")
        written += [out / "map.png", out / "frontier.png"]
        _remove_earlier(out)
        kept = [episode for episode in episodes if not isinstance(episode, SeenEpisode)]  # of a drive with noise its log is kept
        names = ["episode.npz"] if len(episodes) == 1 else [f"episodes/{e.trial:05d}.npz" for e in episodes]
        with progress("episodes", len(episodes), shown=len(episodes) > 100) as advance:
            for done, (episode, name) in enumerate(zip(kept, names, strict=False), start=1):
                episode.save(out / name)
                advance(done)
        if kept:
            written.append(out / names[0] if len(names) == 1 else out / "episodes")
        with atomic(out / "summary.json") as temporary:
            temporary.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
        written.append(out / "summary.json")
    return written + write_films(episodes[0], film)


def _remove_earlier(out: Path) -> None:
    """Remove the episodes of an earlier run from an output folder: with those of this one they would make no sense."""
    for path in (out / "episode.npz", *(out / "episodes").glob("[0-9][0-9][0-9][0-9][0-9]*.npz")):
        path.unlink(missing_ok=True)


def replay_swarm(episode_file: Path, seed: int | None, out: Path | None, film: list[Path] | None, json_: bool) -> None:
    """Replay a swarm episode: ``shoal replay EPISODE.npz``."""
    from shoal.swarm import Episode

    episode = Episode.load(episode_file)
    check_seed(episode_file, seed, episode.seed)
    try:
        verified = episode.verify()
    except ShoalError as error:  # an unknown task, or targets that cannot be reached
        raise InvalidInputError(f"{episode_file}: {error}") from None
    result = summary([episode], seed=episode.seed) | {
        "commands": episode.commands,
        "verified": verified.ok,
        "message": verified.message,
    }
    written = write_outputs([episode], result, out, film) if verified else []
    if json_:
        print_json(result)
    else:
        rows = [*_rows([episode], result), ("verified", f"{'yes' if verified else 'NO'}: {verified.message}")]
        print_table([*rows, *(("written", str(path)) for path in written)], title=_title(episode))
    if not verified:
        say(f"shoal: {episode_file}: {verified.message}")
        raise typer.Exit(1)
