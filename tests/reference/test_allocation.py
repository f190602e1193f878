"""Allocations against all that there are, on small tours."""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np
import pytest

from shoal.search import Arc, TourCost, allocate, make_tour
from shoal.search.allocation.allocate import work_time


def all_borders(n, m):
    """Yield the borders of all ways to cut a tour of n cells into m arcs, from any cell on; m + 1
    numbers.
    """
    for first in range(n):
        for inner in combinations_with_replacement(range(n + 1), m - 1):
            yield (first, *(first + cut for cut in inner), first + n)


def along(one, other, n):
    """Return the cells between two places on a tour, the shorter way round."""
    return min((one - other) % n, (other - one) % n)


def instances(seed, count):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        shape = [(2, 4), (2, 3), (2, 5), (4, 2)][rng.integers(4)]
        # every step is one cell, the closing one, too
        tour_cost = TourCost(make_tour("hilbert-rectangle", shape))
        m = int(rng.integers(1, 4))
        starts = np.sort(rng.integers(0, len(tour_cost), size=m))
        yield tour_cost, starts, m


def turned_to(borders, turn, m):
    """Return the arc of each robot if robot ``turn`` takes the first one."""
    return [(borders[(robot - turn) % m], borders[(robot - turn) % m + 1]) for robot in range(m)]


def test_stay_is_what_the_paper_says():
    for tour_cost, starts, m in instances(1, 60):
        n = len(tour_cost)
        gaps = [
            (starts[(k + 1) % m] - starts[k]) % n
            or (n if len(set(starts)) == 1 and k == m - 1 else 0)
            for k in range(m)
        ]
        assert allocate(tour_cost, starts, allocator="stay").makespan == max(gaps)


def test_individual_shift_is_the_best_of_all():
    for tour_cost, starts, m in instances(2, 40):
        n = len(tour_cost)
        best = np.inf
        for borders in all_borders(n, m):
            for turn in range(m):
                arcs = turned_to(borders, turn, m)
                times = [
                    along(start, low, n) + high - low if high > low else 0
                    for start, (low, high) in zip(starts, arcs, strict=True)
                ]
                best = min(best, max(times))
        found = allocate(tour_cost, starts, allocator="individual-shift")
        assert found.makespan <= best + 1e-6  # less where a straight way is shorter than the tour


@pytest.mark.parametrize(("allocator", "slack"), [("hop", 1.0), ("two-way", 2.0)])
def test_hop_and_two_way_come_near_the_best_of_all(allocator, slack):
    excess = []
    for tour_cost, starts, m in instances(3, 30):
        n, best = len(tour_cost), np.inf
        for borders in all_borders(n, m):
            for turn in range(m) if allocator == "hop" else (0,):
                worst = 0.0
                for start, (low, high) in zip(starts, turned_to(borders, turn, m), strict=True):
                    if high > low:
                        worst = max(worst, least(tour_cost, int(start), low, high, allocator))
                best = min(best, worst)
        found = allocate(tour_cost, starts, allocator=allocator)
        assert found.makespan >= best - 1e-9 or allocator == "two-way"
        excess.append(found.makespan - best)
    assert max(excess) <= slack
    assert np.mean(excess) <= 0.3 * slack


def least(tour_cost, start, low, high, allocator):
    """Return how soon a robot can have searched an arc: straight to its beginning, or both ways
    from inside.
    """
    n, place = len(tour_cost), tour_cost.points[start]
    works = [[Arc(low % n, high - low)]]
    at = start if low <= start else start + n
    if allocator == "two-way" and low < at < high:
        behind, ahead = at - low, high - at
        works.append([Arc(start, behind + 1, -1), Arc((start + 1) % n, ahead - 1)])
        works.append([Arc(start, ahead), Arc((start - 1) % n, behind, -1)])
    return min(work_time(tour_cost, [arc for arc in work if arc.count], place) for work in works)
