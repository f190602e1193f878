"""python -m benchmarks.swarm_bounds: lower bounds of the swarm against optima and brute force on
small maps, and against plans of the planner offline on a larger map.

Each small case is a map with one to four particles, under each move rule, and with each task:
mapping, coverage, coverage of a random subset, one target, and gathering. The maps are random ones
of at most --cells free cells, or with --connected, connected ones of exactly --cells free cells. The
program stops with an error if a bound is above the optimum, or if the optimum is not that of a
breadth-first search in plain Python, which is tried up to --brute-force states.

Options: --tasks TASK,TASK, --maps N, --cells N, --connected, --brute-force N, --seed S, --trials N (of offline),
--map MAP, --particles N.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections import Counter
from typing import Any

import numpy as np
from tests.reference import bounds as plain
from tests.reference import gathering as plain_gathering
from tests.reference.small import connected_cases, small_cases
from tests.swarm_runs import run

from shoal.core.errors import InvalidInputError
from shoal.swarm import GridWorkspace
from shoal.swarm.theory.bounds import lower_bound, optimum

RULES = ("block", "merge", "tilt")
TASKS = ("coverage", "subset coverage", "target", "mapping", "gathering")


def main() -> None:
    """Print the mean ratio of the optimum to the bound, and which bounds were the largest."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", default=",".join(TASKS))
    parser.add_argument("--maps", type=int, default=200)
    parser.add_argument("--cells", type=int, default=12, help="most free cells of a small map")
    parser.add_argument(
        "--connected", action="store_true", help="connected maps of exactly --cells free cells"
    )
    parser.add_argument(
        "--brute-force", type=int, default=0, metavar="N", help="most states of brute force"
    )
    parser.add_argument("--seed", type=int, default=44)
    parser.add_argument("--trials", type=int, default=8, help="plans of offline")
    parser.add_argument("--map", default="vessels:1000")
    parser.add_argument("--particles", type=int, default=100)
    given = parser.parse_args()
    check_small_maps(given)
    compare_with_plans(given)


def cases_of(given: argparse.Namespace) -> list[tuple[GridWorkspace, np.ndarray]]:
    """Return the small maps with the cells of their particles."""
    if given.connected:
        return list(connected_cases(given.maps, given.cells, given.seed))
    cases: list[tuple[GridWorkspace, np.ndarray]] = []
    for workspace, start in small_cases(100 * given.maps, given.seed):
        if len(cases) == given.maps:
            break
        if 2 <= workspace.n_free <= given.cells:
            cases.append((workspace, start))
    return cases


def task_of(task: str, rule: str, workspace: GridWorkspace, n: int, seed: int) -> dict[str, Any]:
    """Return the arguments of a task with random targets."""
    rng = np.random.default_rng(seed)
    targets = None
    if task == "subset coverage":
        targets = workspace.free & (rng.random(workspace.shape) < 0.4)
    elif task == "target" or (task == "gathering" and (rule != "merge" or seed % 2)):
        least, most = (1, 1) if task == "target" else (1 if rule == "merge" else n, 5)
        size = int(rng.integers(least, max(least, min(most, workspace.n_free)) + 1))
        targets = np.zeros(workspace.shape, dtype=np.bool_)
        targets[tuple(rng.permutation(workspace.cells)[:size].T)] = True
    name = task if task in ("mapping", "gathering") else "coverage"
    return {"task": name, "targets": targets}


def by_brute_force(
    workspace: GridWorkspace, start: np.ndarray, rule: str, case: dict[str, Any], most: int
) -> int | None:
    """Return the fewest commands, or None if there are none or the search has too many states."""
    if case["task"] == "gathering":
        targets = case["targets"]
        region = None if targets is None else set(map(tuple, np.argwhere(targets).tolist()))
        return plain_gathering.fewest_moves(workspace.free, start, region, rule, most)
    return plain.fewest_moves(workspace.free, start, rule=rule, most_states=most, **case)


def check_small_maps(given: argparse.Namespace) -> None:
    """Compare bounds with optima, and print a line for each task and move rule."""
    cases = cases_of(given)
    for task in given.tasks.split(","):
        for rule in RULES:
            ratios, names, count = [], Counter[str](), Counter[str]()
            seconds = slowest = 0.0
            for seed, (workspace, start) in enumerate(cases):
                case = task_of(task, rule, workspace, len(start), seed)
                bound = fewest = None
                began = time.process_time()
                try:
                    fewest = optimum(workspace, start, rule=rule, **case).moves
                except InvalidInputError as error:
                    count["large"] += "at most" in str(error)
                    count["impossible"] += "can complete" in str(error)
                    if not any(words in str(error) for words in ("at most", "can complete")):
                        raise
                spent = time.process_time() - began
                seconds, slowest = seconds + spent, max(slowest, spent)
                if fewest is not None:
                    bound = lower_bound(workspace, start, rule=rule, **case)
                if given.brute_force:
                    brute = by_brute_force(workspace, start, rule, case, given.brute_force)
                    count["compared"] += brute is not None
                    if brute is not None and (bound is None or not bound.moves <= fewest == brute):
                        raise SystemExit(
                            f"{task}, {rule}: {bound}, optimum {fewest}, by brute force {brute},"
                            f" {workspace}, {start.tolist()}"
                        )
                if bound and fewest:
                    if bound.moves > fewest:
                        raise SystemExit(
                            f"{task}, {rule}: {bound} above {fewest}, {workspace}, {start.tolist()}"
                        )
                    count["equal"] += bound.moves == fewest
                    ratios.append(fewest / bound.moves)
                    names[bound.name] += 1
            mean = statistics.fmean(ratios) if ratios else float("nan")
            print(
                f"{task:<16} {rule:<6} {len(ratios)} cases, {count['impossible']} impossible,"
                f" {count['large']} with too many states; {count['compared']} compared with brute"
                f" force; optimum / bound {mean:.3f}, equal in {count['equal']}; {seconds:.1f} s"
                f" (slowest {slowest:.2f} s); {dict(names)}",
                flush=True,
            )


def compare_with_plans(given: argparse.Namespace) -> None:
    """Print the ratio of the plans of offline to the bounds."""
    ratios = []
    for trial in range(given.trials):
        episode = run(
            given.map, particles=given.particles, task="coverage", policy="offline", trial=trial
        )
        bound = lower_bound(episode.workspace, episode.start)
        ratios.append(episode.moves / bound.moves)
        print(f"{episode.moves} moves, {bound}: {ratios[-1]:.2f} times", flush=True)
    if ratios:
        print(f"{given.map}, {given.particles} particles: {statistics.fmean(ratios):.2f} times")


if __name__ == "__main__":
    main()
