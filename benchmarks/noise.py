"""Mapping with noise: how right, how many moves, how honest the stated confidence is; and that
every episode ends.

python -m benchmarks.noise                       200 trials of acceptance and the calibration plot (docs/images/noise.png)
python -m benchmarks.noise --scans 1 2 4         what fewer scans cost, ten trials each
python -m benchmarks.noise --policies            moves and wrong cells of best and of closest-frontier, ten paired trials each,
                                                 with few and with many particles
python -m benchmarks.noise --few 0.99 0.9999     wrong and never classified cells with few particles, 20 trials each
python -m benchmarks.noise --endings 20000       so many episodes of random maps, rates, confidences and policies
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter, defaultdict
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from tests.swarm_runs import run, run_trials

from shoal import GridWorkspace, open_map
from shoal.swarm import SwarmProblem
from shoal.swarm.episode import SwarmEpisode
from shoal.swarm.grid.board import Board
from shoal.swarm.maps.generators import generate
from shoal.swarm.noise import PRIOR, Noise, NoisyBelief
from shoal.swarm.policies import BeamRollout

MAP, PARTICLES = "vessels:5000", 1000
NOISE = Noise(slip=0.05, misplace=0.01)
HARD = Noise(slip=0.2, misplace=0.05, miss=0.1)
LEVELS = {
    "slight": Noise(slip=0.02),
    "usual": NOISE,
    "scans": Noise(misplace=0.05, miss=0.1),
    "hard": HARD,
    "harder": Noise(slip=0.3, misplace=0.075, miss=0.15),
    "worst": Noise(slip=0.4, misplace=0.1, miss=0.2),
    "extreme": Noise(slip=0.5, misplace=0.1, miss=0.3),
}
PLACES = {
    "few": (("vessels:100", 2), ("vessels:500", 5), ("maze:21x15", 5), ("cave:30x20", 3)),
    "many": (("vessels:100", 20), ("vessels:500", 50), ("maze:21x15", 50), ("cave:30x20", 30)),
}
IMAGE = Path(__file__).parents[1] / "docs" / "images" / "noise.png"


def measure(trials: int, image: Path) -> int:
    """Print rates and moves, draw the calibration; return how many promises are broken."""
    workspace = open_map(MAP)
    exact = np.mean(
        [episode.moves for episode in run_trials(workspace, trials=trials, particles=PARTICLES)]
    )
    print(f"{MAP}, {PARTICLES} particles, {trials} trials; without noise {exact:.1f} moves")
    curves, broken = {}, 0
    for noise in (NOISE, HARD):
        rows, pairs, moves = [], [], []
        for trial in range(trials):
            episode = run(workspace, particles=PARTICLES, noise=noise, trial=trial)
            errors = episode.errors
            rows.append(
                (
                    errors.right,
                    errors.false_free_rate,
                    errors.false_obstacle_rate,
                    episode.status == "complete",
                )
            )
            moves.append(episode.moves)
            pairs.append(stated_and_true(episode))
        right, false_free, false_obstacle, complete = np.array(rows).T
        stated, true = (np.concatenate(column) for column in zip(*pairs, strict=True))
        settled = (stated >= 0.99) | (stated <= 0.01)
        share = np.mean((stated > 0.5)[settled] == true[settled])
        text = f"slip {noise.slip:g}, misplace {noise.misplace:g}, miss {noise.miss:g}"
        print(
            f"{text}: {np.mean(moves):.1f} moves ({np.mean(moves) / exact:.2f} times), complete"
            f" {int(complete.sum())} of {trials}"
        )
        print(
            f"  right {100 * right.mean():.4f} % of the cells, at worst {100 * right.min():.3f} %"
        )
        print(
            f"  false free {false_free.mean():.2e} of the walls, false obstacles"
            f" {false_obstacle.mean():.2e} of the free cells"
        )
        print(
            f"  cells settled at 99 % in the middle of an episode: {100 * share:.3f} % right, of"
            f" {settled.sum()}"
        )
        curves[text] = stated, true
        broken += (noise is NOISE) * (
            int(right.min() < 0.995) + int(np.mean(moves) > 2.5 * exact)
        ) + int(share < 0.99)
    draw(curves, image)
    return broken


def fewer_scans(every: list[int], trials: int, particles: int) -> int:
    """Print moves, scans, cost and rates for scans after at most so many commands; return how many
    promises are broken.
    """
    workspace, broken = open_map(MAP), 0
    print(
        f"{MAP}, {particles} particles, slip {NOISE.slip:g}, misplace {NOISE.misplace:g}, {trials}"
        " trials, 10 a scan, 1 a move"
    )
    for step in every:
        episodes = [
            run(workspace, particles=particles, noise=NOISE, trial=trial, scan_every=step)
            for trial in range(trials)
        ]
        moves, scans, cost = (
            np.mean([getattr(e, name) for e in episodes]) for name in ("moves", "scans", "cost")
        )
        errors = [episode.errors for episode in episodes]
        right, worst = np.mean([e.right for e in errors]), min(e.right for e in errors)
        wrong = ", ".join(
            f"{sum(getattr(e, n) for e in errors)} {n}"
            for n in ("false_free", "false_obstacles", "undecided")
        )
        print(
            f"  scan-every {step}: {moves:.1f} moves, {scans:.1f} scans, cost {cost:.0f}; "
            f"{100 * right:.4f} % right, at worst {100 * worst:.3f} %; in all {wrong}"
        )
        broken += int(worst < 0.995)
    return broken


def compare_policies(trials: int, levels: list[str]) -> int:
    """Print, for each noise and for few and many particles, the moves and the wrong cells of two
    policies; return for how many of these auto takes the worse one.
    """
    worse = 0
    for level in levels:
        noise = LEVELS[level]
        for crowd, places in PLACES.items():
            logs = []
            shares: dict[str, list[float]] = {"closest-frontier": [], "best": []}
            told = {policy: Counter[str]() for policy in shares}
            for place, particles in places:
                moves: dict[str, list[int]] = {policy: [] for policy in shares}
                for trial in range(trials):
                    for policy, wrong in shares.items():
                        began = time.process_time()
                        episode = run(
                            place,
                            particles=particles,
                            noise=noise,
                            policy=policy,
                            trial=trial,
                            max_moves=20_000,
                        )
                        told[policy]["ms"] += int(1000 * (time.process_time() - began))
                        told[policy][str(episode.status)] += 1
                        moves[policy].append(episode.moves)
                        wrong.append(1 - episode.errors.right)
                ratios = np.log(moves["best"]) - np.log(moves["closest-frontier"])
                logs.extend(ratios)
                print(
                    f"  {level}, {place}, {particles} particles: closest-frontier"
                    f" {np.mean(moves['closest-frontier']):.0f}, best {np.mean(moves['best']):.0f}"
                    f" moves, ratio {ratio_text(ratios)}",
                    flush=True,
                )
            rates = f"slip {noise.slip:g}, misplace {noise.misplace:g}, miss {noise.miss:g}"
            print(
                f"{crowd} particles, {rates}: best / closest-frontier {ratio_text(np.array(logs))}"
            )
            for policy, wrong in shares.items():
                ends = ", ".join(
                    f"{count} {name}" for name, count in told[policy].items() if name != "ms"
                )
                print(
                    f"  {policy}: {100 * np.mean(wrong):.2f} % of the cells wrong or undecided, at"
                    f" worst {100 * max(wrong):.1f} %; {ends}; {told[policy]['ms'] / 1000:.0f} s",
                    flush=True,
                )
            chosen = SwarmProblem(places[0][0], particles=places[0][1], **vars(noise)).setup
            worse += int((np.mean(logs) < 0) != isinstance(chosen.policy, BeamRollout))
    return worse


def few_particles(confidences: list[float], trials: int, policy: str) -> int:
    """Print the wrong cells, the cells never classified and the moves with few particles, and the
    same without pushes of weak walls; return how many rows break a promise.
    """
    broken, moves = 0, defaultdict[str, list[float]](list)
    print(
        f"{policy}, {trials} trials a row; the shares are of the free cells and the walls of the"
        " episodes that are complete"
    )
    for confidence in confidences:
        for name in ("usual", "scans", "hard"):
            for place in ("vessels:300", "maze:21x15"):
                for counts in ((2, 3, 4, 5), (20,)):
                    given = place, counts, LEVELS[name], confidence, trials, policy
                    row = play_few(*given)
                    with patch.object(
                        NoisyBelief,
                        "weak_walls",
                        property(lambda belief: Board.empty(belief.layout)),
                    ):
                        without = play_few(*given)
                    print(
                        f"  {confidence:g}, {name}, {place}, {counts[0]} to {counts[-1]} particles:"
                        f" {row.complete} complete, {100 * row.wrong:.2f} % wrong,"
                        f" {100 * row.never:.2f} % never classified, {100 * row.worst:.1f} % in the"
                        f" worst trial, {row.moves:.0f} moves; without weak walls"
                        f" {100 * without.never:.2f} %, {without.moves:.0f} moves"
                        f" ({100 * (row.moves / without.moves - 1):.1f} %)",
                        flush=True,
                    )
                    moves[f"{name}, {place}, {counts}"].append(row.moves)
                    broken += int(row.wrong + row.never > 1 - confidence)
    for after in range(1, len(confidences)):
        ratios = [row[after] / row[0] for row in moves.values()]
        print(
            f"{confidences[after]:g}: {min(ratios):.2f} to {max(ratios):.2f} times the moves of"
            f" {confidences[0]:g}"
        )
    return broken


class Few(NamedTuple):
    """What a row of `few_particles` tells: shares of the cells of complete episodes, mean moves."""

    complete: int
    wrong: float
    never: float
    worst: float
    moves: float


def play_few(
    place: str,
    counts: tuple[int, ...],
    noise: Noise,
    confidence: float,
    trials: int,
    policy: str,
) -> Few:
    """Play the trials of a row, each on another map, with one count of particles after the other."""
    episodes = [
        run(
            f"{place}:{i}",
            particles=counts[i % len(counts)],
            noise=noise,
            policy=policy,
            trial=i,
            seed=7,
            confidence=confidence,
            max_moves=20_000,
        )
        for i in range(trials)
    ]
    errors = [episode.errors for episode in episodes if episode.status == "complete"]
    cells = max(1, sum(e.free + e.walls for e in errors))
    return Few(
        len(errors),
        sum(e.false_free + e.false_obstacles for e in errors) / cells,
        sum(e.undecided for e in errors) / cells,
        max((1 - e.right for e in errors), default=0.0),
        float(np.mean([episode.moves for episode in episodes])),
    )


def ratio_text(logs: NDArray[np.float64]) -> str:
    """Return the geometric mean of ratios with its 95 % interval (Student's t on the
    logarithms).
    """
    from scipy.stats import t

    spread = (
        t.ppf(0.975, len(logs) - 1) * logs.std(ddof=1) / np.sqrt(len(logs))
        if len(logs) > 1
        else np.nan
    )
    middle = logs.mean()
    return f"{np.exp(middle):.2f} ({np.exp(middle - spread):.2f} to {np.exp(middle + spread):.2f})"


def stated_and_true(episode: SwarmEpisode) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the probabilities of all cells that something is known of, after a third of the moves,
    and whether they are free.
    """
    from dataclasses import replace

    third = episode.moves // 3
    probability = replace(episode, trace=episode.trace.part(0, third)).probability
    assert probability is not None
    told = np.abs(logit(probability) - logit(PRIOR)) > 0.1
    return probability[told], np.pad(episode.workspace.free, 1)[told]


def draw(curves: dict[str, tuple[NDArray[np.float64], NDArray[np.bool_]]], image: Path) -> None:
    """Draw what is stated against what is true."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.6), layout="constrained", dpi=150)
    axes = figure.add_subplot()
    ticks = [0.001, 0.01, 0.1, 0.5, 0.9, 0.99, 0.999]
    edges = np.linspace(-8, 8, 17)
    axes.plot(
        logit(np.array([1e-4, 1 - 1e-4])),
        logit(np.array([1e-4, 1 - 1e-4])),
        color="#8f96a1",
        lw=1,
        label="honest",
    )
    for (name, (stated, true)), colour, mark in zip(
        curves.items(), ("#d55e00", "#0072b2"), "os", strict=True
    ):
        xs, ys, low, high = [], [], [], []
        place = np.digitize(logit(stated), edges)
        for i in range(len(edges) + 1):
            inside = place == i
            n, free = int(inside.sum()), int(true[inside].sum())
            if n < 20:
                continue
            # Agresti and Coull: an interval that is right for shares near 0 and 1, too
            centre = (free + 2) / (n + 4)
            spread = 2 * np.sqrt(centre * (1 - centre) / (n + 4))
            xs.append(logit(stated[inside].mean()))
            ys.append(logit(np.clip(free / n, 0.5 / n, 1 - 0.5 / n)))
            low.append(logit(np.clip(centre - spread, 0.2 / n, None)))
            high.append(logit(np.clip(centre + spread, None, 1 - 0.2 / n)))
        axes.vlines(xs, low, high, color=colour, lw=1.2)
        axes.plot(xs, ys, mark, color=colour, ms=5, label=name)
    axes.set(
        xlabel="stated probability that a cell is free", ylabel="share of such cells that are free"
    )
    axes.set_xticks(logit(np.array(ticks)), [f"{tick:g}" for tick in ticks])
    axes.set_yticks(logit(np.array(ticks)), [f"{tick:g}" for tick in ticks])
    axes.set_xlim(-8.5, 8.5)
    axes.set_ylim(-12, 12)
    axes.grid(color="#e3e6ea", lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=9, loc="upper left")
    axes.set_title(
        f"{MAP}, {PARTICLES} particles, after a third of the moves", loc="left", fontsize=11
    )
    figure.savefig(image)


def logit(share: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Return log-odds."""
    return np.log(share / (1 - np.asarray(share)))


def endings(count: int, first: int, *, mixed: bool = False) -> int:
    """Play random episodes with noise, of random scan rules if mixed; return how many did not end
    of themselves.
    """
    statuses: Counter[str] = Counter()
    began, longest = time.process_time(), 0
    for seed in range(first, first + count):
        rng = np.random.default_rng(seed)
        kind = rng.integers(4)
        if kind == 0:
            free = rng.random(
                tuple(rng.integers(1, 9, size=2 if rng.random() < 0.7 else 3))
            ) < rng.uniform(0.4, 1)
            free.flat[0] = True
        else:
            names = ("", "cave:14x10", "maze:11x9", "vessels:60")
            free = generate(f"{names[kind]}:{rng.integers(40)}")
        workspace = GridWorkspace(free)
        noise = Noise(*rng.uniform(0, rng.choice([0.02, 0.1, 0.5]), size=3))
        policy = "elect-particle" if rng.random() < 0.05 else "closest-frontier"
        confidence = float(rng.choice([0.8, 0.9, 0.99, 0.9999]))
        n, every = (
            int(rng.integers(1, workspace.n_free + 1)),
            int(rng.choice([1, 2, 4, 50])) if mixed else 1,
        )
        if policy == "elect-particle":
            every = 1  # it has to see its particle
        episode = run(
            workspace,
            particles=n,
            noise=noise,
            policy=policy,
            confidence=confidence,
            seed=seed,
            scan_every=every,
        )
        statuses[episode.status] += 1
        longest = max(longest, episode.moves)
        if (seed + 1) % 1000 == 0:
            print(
                f"{seed + 1}: {dict(statuses)}, longest {longest} moves,"
                f" {time.process_time() - began:.0f} s",
                flush=True,
            )
    print(
        f"{count} episodes: {dict(statuses)}, longest {longest} moves,"
        f" {time.process_time() - began:.0f} s"
    )
    return statuses["limit"]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, help="default 200, of --scans 10")
    parser.add_argument(
        "--scans",
        type=int,
        nargs="+",
        metavar="K",
        help="compare scans after at most so many commands instead",
    )
    parser.add_argument(
        "--policies", action="store_true", help="compare best with closest-frontier instead"
    )
    parser.add_argument(
        "--levels", nargs="+", choices=LEVELS, default=list(LEVELS), help="of --policies"
    )
    parser.add_argument(
        "--few",
        type=float,
        nargs="+",
        metavar="CONFIDENCE",
        help="measure 2 to 5 particles instead",
    )
    parser.add_argument("--policy", default="closest-frontier", help="of --few")
    parser.add_argument("--particles", type=int, default=PARTICLES, help="of --scans")
    parser.add_argument("--image", type=Path, default=IMAGE)
    parser.add_argument("--endings", type=int, help="play so many random episodes instead")
    parser.add_argument("--first", type=int, default=0, help="the first seed of these")
    parser.add_argument(
        "--mixed",
        action="store_true",
        help="of these each with a scan after at most 1, 2, 4 or 50 commands",
    )
    given = parser.parse_args()
    if given.endings:
        return int(endings(given.endings, given.first, mixed=given.mixed) > 0)
    if given.scans:
        return int(fewer_scans(given.scans, given.trials or 10, given.particles) > 0)
    if given.few:
        return int(few_particles(given.few, given.trials or 20, given.policy) > 0)
    if given.policies:
        return int(compare_policies(given.trials or 10, given.levels) > 0)
    return int(measure(given.trials or 200, given.image) > 0)


if __name__ == "__main__":
    sys.exit(main())
