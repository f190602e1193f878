"""python -m benchmarks.certificates: gaps of certificates by class of problems, and whether a bound
is above any plan of any planner.

Options: --problems N (a class), --seconds S, --seed K, --only CLASS, --figure FILE.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from shoal.steering import SteeringProblem, certify, check_certificate, polygon
from shoal.steering.run import run
from shoal.steering.workspaces.convex import hull

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
LIMITS = (1e-3, 0.01, 0.05, 0.25, np.inf)


def _irregular(rng: Generator) -> Any:
    while True:
        corners = hull(rng.normal(size=(12, 2)))
        if 5 <= len(corners) <= 8:
            return polygon(corners)


def _in_corners(rng: Generator) -> dict[str, Any]:
    """Return starts and goals within 0.1 of corners of the square."""
    corners = rng.integers(0, 2, size=(2, 2, 2))
    places = np.abs(corners - rng.uniform(0.005, 0.1, size=(2, 2, 2)))
    return {"workspace": polygon(SQUARE), "start": places[0], "goal": places[1]}


CLASSES: dict[str, Callable[[Generator], dict[str, Any]]] = {
    "square": lambda rng: {"workspace": "square"},
    "regular": lambda rng: {"workspace": f"regular:{rng.integers(3, 9)}"},
    "irregular": lambda rng: {"workspace": _irregular(rng)},
    "thin triangle": lambda rng: {
        "workspace": polygon([(0, 0), (1, 0), (rng.uniform(0, 1), rng.uniform(0.03, 0.2))])
    },
    "corners": _in_corners,
    "interchangeable": lambda rng: {"workspace": "square", "interchangeable": True},
    "60-gon": lambda rng: {"workspace": "regular:60"},
    "disk": lambda rng: {"workspace": "disk"},
}


def gaps_of(name: str, given: argparse.Namespace) -> list[float]:
    """Return the gaps of the problems of one class, and check each certificate and bound."""
    gaps = []
    for number in range(given.problems):
        rng = np.random.default_rng([given.seed, number, list(CLASSES).index(name)])
        fields = CLASSES[name](rng)
        seed = int(rng.integers(1 << 30))
        episode = run(SteeringProblem(**fields), seed=seed)
        if not episode:
            continue
        found = certify(episode, seconds=given.seconds)
        assert found.proof is None or check_certificate(found.proof)
        for planner in ("greedy", "fewest-moves"):
            other = run(SteeringProblem(**fields, planner=planner), seed=seed)
            assert not other or other.length >= found.lower_bound, (name, number, planner)
        if episode.length > found.episode.length * 1.001:
            print(f"{name} {number}: {episode.length:.6f} became {found.episode.length:.6f}")
        assert found.gap is not None
        gaps.append(found.gap)
    return gaps


def main() -> None:
    """Print the shares of gaps below some limits, and draw them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=tuple(CLASSES))
    parser.add_argument("--figure", type=Path)
    given = parser.parse_args()
    names = [given.only] if given.only else list(CLASSES)
    gaps = {}
    print(f"{'class':<16} problems  <=.1 %  <=1 %  <=5 %  mean gap  largest")
    for name in names:
        gaps[name] = np.array(gaps_of(name, given))
        shares = "".join(f"{100 * np.mean(gaps[name] <= limit):6.0f} %" for limit in LIMITS[:3])
        print(
            f"{name:<16} {len(gaps[name]):8d} {shares} {100 * gaps[name].mean():7.2f} %"
            f" {100 * gaps[name].max():7.1f} %",
            flush=True,
        )
    if given.figure is not None:
        _draw(gaps, given.figure)


def _draw(gaps: dict[str, Any], path: Path) -> None:
    from matplotlib.figure import Figure

    from shoal.views import save_figure

    figure = Figure(figsize=(8, 3.2), layout="constrained")
    axes = figure.add_subplot()
    names = list(gaps)[::-1]
    left = np.zeros(len(names))
    low = 0.0
    for limit, shade in zip(
        LIMITS, ("#1a7f37", "#7bc47f", "#f2c94c", "#f2994a", "#c0392b"), strict=True
    ):
        share = np.array(
            [100 * np.mean((gaps[name] > low) & (gaps[name] <= limit)) for name in names]
        )
        if low == 0:
            share = np.array([100 * np.mean(gaps[name] <= limit) for name in names])
        label = f"at most {100 * limit:g} %" if np.isfinite(limit) else "more"
        axes.barh(names, share, left=left, color=shade, label=label)
        left, low = left + share, limit
    axes.set_xlabel("share of problems, %")
    axes.set_xlim(0, 100)
    axes.legend(title="gap", loc="center left", bbox_to_anchor=(1, 0.5))
    save_figure(figure, path)


if __name__ == "__main__":
    main()
