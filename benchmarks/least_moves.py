"""python -m benchmarks.least_moves: how often the plan of the planner fewest-moves is proven to have
as few moves as possible.

Options: --problems N (a workspace), --seconds S (of the processor).
"""

from __future__ import annotations

import argparse
from collections import Counter
from time import process_time

import numpy as np

from shoal.steering import SteeringProblem
from shoal.steering.certificates.moves import MovePrograms, prove_more_moves
from shoal.steering.run import run

PLACES = ("triangle", "square", "pentagon", "hexagon", "octagon")


def _least(programs: MovePrograms, walls: int, most: int, end: float) -> int:
    """Return the least number of moves that is proven until a time."""
    for count in range(most):
        if prove_more_moves(programs, count, walls, lambda: process_time() >= end) is None:
            return count
    return most


def main() -> None:
    """Print a table of the differences between plans and bounds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=5)
    given = parser.parse_args()
    print("| workspace | problems | mean moves | proven | one less | mean time of the proofs |")
    for name in PLACES:
        moves, less, times = [], Counter[int](), []
        for seed in range(given.problems):
            problem = SteeringProblem(name, planner="fewest-moves")
            episode = run(problem, seed=seed)
            if not episode:
                continue
            start, goal = problem.endpoints(seed)
            corners = problem.place.vertices
            programs = MovePrograms(corners, start, goal, problem.tolerance)
            begun = process_time()
            least = _least(programs, len(corners), episode.moves, begun + given.seconds)
            times.append(process_time() - begun)
            moves.append(episode.moves)
            less[episode.moves - least] += 1
        print(
            f"| {name} | {len(moves)} | {np.mean(moves):.2f} | {less[0]} | {less[1]} |"
            f" {np.mean(times):.2f} s |",
            flush=True,
        )


if __name__ == "__main__":
    main()
