"""How many moves fill the Δ configuration space of polygons: python -m benchmarks.filling [--starts
N] [--seed S]

The paper: four moves for a triangle that is regular or acute, six for an obtuse one and up to eight
sides, eight below 14 sides.
"""

from __future__ import annotations

import argparse
from collections import Counter

import numpy as np

from shoal.papers.steering.figures import polygon_fractions
from shoal.steering import ConvexWorkspace, polygon, regular_polygon


def shapes() -> dict[str, ConvexWorkspace]:
    irregular = {
        "acute triangle": polygon([(0, 0), (1, 0), (0.4, 0.8)]),
        "obtuse triangle": polygon([(0, 0), (1, 0), (0.3, 0.25)]),
    }
    return {
        **irregular,
        **{f"{sides} sides": regular_polygon(sides) for sides in (3, 4, 5, 6, 7, 8, 9)},
    }


def start(rng: np.random.Generator, space: ConvexWorkspace) -> np.ndarray:
    """Return the difference of two points of the workspace, each uniform."""
    low, high = space.vertices.min(axis=0), space.vertices.max(axis=0)
    points: list[np.ndarray] = []
    while len(points) < 2:
        point = low + (high - low) * rng.random(2)
        if space.depth(point) > 0:
            points.append(point)
    return points[1] - points[0]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--starts", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    for name, space in shapes().items():
        rng = np.random.default_rng(arguments.seed)
        fillings = [
            polygon_fractions(space, start(rng, space), moves=8) for _ in range(arguments.starts)
        ]
        missing = 100 * (1 - np.array([filling.fractions for filling in fillings]))
        needed = sorted(Counter(filling.moves or 10 for filling in fillings).items())
        starts = ", ".join(f"{'more' if moves > 8 else moves}: {count}" for moves, count in needed)
        worst = ", ".join(
            f"{moves}: {value:.2f} %"
            for moves, value in zip((4, 6, 8), missing.max(axis=0)[1:], strict=True)
        )
        print(
            f"{name:16s} moves to fill: {starts:24s} most that is missing after {worst}", flush=True
        )


if __name__ == "__main__":
    main()
