"""Who searches what, measured beside the figures of the specification: python -m benchmarks.search
[--trials N] [--seed S]

T/T_UB: when the last robot is done, the way to its first cell included, as a share of the number of
cells. Then the share of the paper's Fig. 5, the price of turns, and how long plans take.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from shoal.search import SearchProblem, TourCost, allocate, make_tour, plan_search
from shoal.search.allocation.costs import expected_time, stay_share

ALLOCATORS = ("stay", "common-shift", "individual-shift", "two-way", "hop")
SPECIFIED = {  # spec/search.md, section 3
    (16, "random"): (0.177, 0.129, 0.113, 0.097, 0.077),
    (32, "random"): (0.183, 0.134, 0.116, 0.099, 0.064),
    (64, "random"): (0.188, 0.135, 0.118, 0.101, 0.057),
    (64, "clustered"): (0.958, None, None, 0.479, 0.062),
}
ROBOTS = 20
CLUSTER = 0.05  # of the side: the spread of clustered starts


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    print(
        f"T/T_UB of {ROBOTS} robots on a Moore tour, mean of {options.trials} starts (in brackets:"
        " as specified)"
    )
    print(f"{'':<20}" + "".join(f"{allocator:>20}" for allocator in ALLOCATORS) + f"{'bound':>8}")
    for side in (16, 32, 64):
        for layout in ("random", "clustered", "line"):
            table_row(side, layout, options.trials, options.seed)
    turns(options.trials, options.seed)
    figure_five()
    plans()


def starts_of(side: int, layout: str, rng: np.random.Generator) -> np.ndarray:
    """Return the cells in which robots start, (row, col)."""
    if layout == "random":
        return rng.integers(0, side, size=(ROBOTS, 2))
    if layout == "clustered":
        middle = rng.integers(0, side, size=2)
        return np.clip(
            np.round(middle + rng.normal(0, CLUSTER * side, size=(ROBOTS, 2))), 0, side - 1
        ).astype(int)
    return np.column_stack(
        [np.round(np.linspace(0, side - 1, ROBOTS)).astype(int), np.zeros(ROBOTS, dtype=int)]
    )


def share(
    tour_cost: TourCost, side: int, layout: str, allocator: str, trials: int, seed: int
) -> float:
    rng = np.random.default_rng(seed)
    rounds = 1 if layout == "line" else trials
    starts = [tour_cost.tour.position[tuple(starts_of(side, layout, rng).T)] for _ in range(rounds)]
    return float(
        np.mean([allocate(tour_cost, start, allocator=allocator).makespan for start in starts])
    ) / len(tour_cost)


def table_row(side: int, layout: str, trials: int, seed: int) -> None:
    tour_cost = TourCost(make_tour("moore", (side, side)))
    said = SPECIFIED.get((side, layout), (None,) * len(ALLOCATORS))
    words = ""
    for allocator, figure in zip(ALLOCATORS, said, strict=True):
        measured = share(tour_cost, side, layout, allocator, trials, seed)
        words += f"{measured:>12.3f} " + (f"({figure:.3f})" if figure else " " * 7)
    print(f"{side * side:>5} {layout:<14}{words}{1 / ROBOTS:>8.3f}", flush=True)


def turns(trials: int, seed: int) -> None:
    print("\nA turn costs one cell; 4096 cells, hop:", end=" ")
    for name, figure in (("comb", 0.061), ("hilbert", 0.097)):
        tour_cost = TourCost(make_tour(name, (64, 64)), turn_cost=1.0)
        print(
            f"{name} {share(tour_cost, 64, 'random', 'hop', trials, seed):.3f} ({figure})",
            end="  ",
            flush=True,
        )
    print()


def figure_five() -> None:
    sides = (64, 256, 1024, 4096)
    print(
        "\nT_E/T_UB of stay, 10,000 trials, and H/m of those that live; cells:  "
        + "".join(f"{cells:>14}    " for cells in sides)
    )
    began = time.perf_counter()
    for dead, robots in [
        (dead, robots) for dead in (0, 1, 5) for robots in (1, 2, 5, 10, 20, 50) if robots > dead
    ]:
        found = [expected_time(cells, robots, dead=dead, seed=robots) for cells in sides]
        words = "".join(f"{one.mean:>9.4f} ± {one.error:.4f}" for one in found)
        print(
            f"  m = {robots:>2}, {dead} dead on arrival:"
            f" {stay_share(robots, dead=dead):.4f}{'':>16}{words}"
        )
    print(f"  {time.perf_counter() - began:.1f} s in all")


def plans() -> None:
    print("\nTime of a plan")
    plan_search(SearchProblem("square:100", robots=4, footprint=10))
    for name, robots, starts in (
        ("square:32", 16, "line"),
        ("square:64", 20, "random"),
        ("square:1000", 1000, "random"),
    ):
        began = time.perf_counter()
        plan = plan_search(SearchProblem(name, robots=robots, footprint=1, starts=starts), seed=1)
        taken = time.perf_counter() - began
        found = plan.allocation
        print(
            f"  {len(plan.tour_cost):>7} cells, {robots:>4} robots, {starts:<6}"
            f" {1000 * taken:>9.1f} ms   makespan {found.makespan:.1f} cells,"
            f" {found.makespan * robots / len(plan.tour_cost):.3f} of the bound",
            flush=True,
        )


if __name__ == "__main__":
    main()
