"""Plans of random problems, each replayed by a simulator of its own: python -m benchmarks.replays
[--problems N] [--seed S] [--errors SIZE,...]

The classes of workspaces and planners are those of tests/reference/test_clearance.py. Each solved
plan is replayed with five contact tolerances from 1e-9 to 1e-6 of the size, as it stands and in two
turned, scaled and shifted scenes; a wall holds what leads off it by less than 1e-9 of a move, and,
in other replays, only what leads off it by nothing at all. One row for each class and planner: how
many problems are solved, how many plans miss a goal in a replay (expected: 0), and the other
statuses. With --errors, also how many of the plans an error of the starts and all moves leads to
other walls: they end more than 1000 errors beyond the tolerance in one of 64 simulations. Of such
errors, no plan is said to stand more than 1e-12 of the size.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter

import numpy as np
from tests.reference.test_clearance import CLASSES, random_problem, worst_error
from tests.steering import steer


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=200, help="of each class")
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--only", default="", help="classes, separated by commas")
    parser.add_argument("--errors", default="", help="relative to the size, separated by commas")
    parser.add_argument("--planners", default="", help="planners, separated by commas")
    given = parser.parse_args()
    errors = [float(word) for word in given.errors.split(",") if word]
    solved = missed = 0
    for name in given.only.split(",") if given.only else CLASSES:
        for planner in [
            one
            for one in CLASSES[name][1]
            if not given.planners or one in given.planners.split(",")
        ]:
            rng = np.random.default_rng(given.seed)
            found: Counter[str] = Counter()
            begun = time.process_time()
            for _ in range(given.problems):
                problem = random_problem(rng, name)
                episode = steer(problem, planner=planner)
                found[str(episode.status)] += 1
                if episode.status == "solved":
                    for error in errors:
                        found[f"led astray by {error:g}:"] += is_led_astray(episode, error)
                if (
                    episode.status == "solved"
                    and worst_error(episode) > episode.problem.tolerance * 1.0001
                ):
                    found["missed"] += 1
                    points = [problem.start.tolist(), problem.goal.tolist()]
                    print(f"missed: {name}, {planner}: {points}", flush=True)
            solved, missed = solved + found["solved"], missed + found["missed"]
            rest = ", ".join(
                f"{status} {count}"
                for status, count in found.items()
                if status not in ("solved", "missed")
            )
            row = (
                f"{name}, {planner}: {given.problems} problems, solved {found['solved']}, missed"
                f" {found['missed']}"
            )
            print(
                f"{row}{', ' if rest else ''}{rest}, {time.process_time() - begun:.0f} CPU s",
                flush=True,
            )
    print(f"{solved} plans solved, {missed} missed a goal in a replay")


def is_led_astray(episode, error):
    """Whether an error of the starts and all moves, relative to the size, leads a plan elsewhere."""
    problem, start, moves = episode.problem, episode.states[0], episode.inputs
    size = error * problem.place.size
    signs = np.random.default_rng(0).choice(
        [-size, size], (64, len(start) + len(moves), start.shape[1])
    )
    ends = problem.world(seed=episode.seed).finals(
        start + signs[:, : len(start)], moves + signs[:, len(start) :]
    )
    away = np.linalg.norm(ends - episode.goal, axis=2).max(axis=1)
    return bool((away > problem.tolerance + 1000 * size).any())


if __name__ == "__main__":
    main()
