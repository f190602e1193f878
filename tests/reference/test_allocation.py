"""Allocations against all that there are, on small tours."""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np
import pytest

from shoal.search import Course, Sweep, allocate, make_tour
from shoal.search.allocation.allocate import work_time


def all_borders(n, m):
    """Yield the borders of all ways to cut a tour of n cells into m arcs, from any cell on; m + 1 numbers."""
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
        course = Course(make_tour("hilbert-rectangle", shape))  # every step is one cell, the closing one, too
        m = int(rng.integers(1, 4))
        starts = np.sort(rng.integers(0, len(course), size=m))
        yield course, starts, m


def turned_to(borders, turn, m):
    """Return the arc of each robot if robot ``turn`` takes the first one."""
    return [(borders[(robot - turn) % m], borders[(robot - turn) % m + 1]) for robot in range(m)]


def test_stay_is_what_the_paper_says():
    for course, starts, m in instances(1, 60):
        n = len(course)
        gaps = [(starts[(k + 1) % m] - starts[k]) % n or (n if len(set(starts)) == 1 and k == m - 1 else 0) for k in range(m)]
        assert allocate(course, starts, method="stay").makespan == max(gaps)


def test_individual_shift_is_the_best_of_all():
    for course, starts, m in instances(2, 40):
        n = len(course)
        best = np.inf
        for borders in all_borders(n, m):
            for turn in range(m):
                arcs = turned_to(borders, turn, m)
                times = [
                    along(start, low, n) + high - low if high > low else 0 for start, (low, high) in zip(starts, arcs, strict=True)
                ]
                best = min(best, max(times))
        found = allocate(course, starts, method="individual-shift")
        assert found.makespan <= best + 1e-6  # less where a straight way is shorter than the tour


@pytest.mark.parametrize(("method", "slack"), [("hop", 1.0), ("two-way", 2.0)])
def test_hop_and_two_way_come_near_the_best_of_all(method, slack):
    excess = []
    for course, starts, m in instances(3, 30):
        n, best = len(course), np.inf
        for borders in all_borders(n, m):
            for turn in range(m) if method == "hop" else (0,):
                worst = 0.0
                for start, (low, high) in zip(starts, turned_to(borders, turn, m), strict=True):
                    if high > low:
                        worst = max(worst, least(course, int(start), low, high, method))
                best = min(best, worst)
        found = allocate(course, starts, method=method)
        assert found.makespan >= best - 1e-9 or method == "two-way"
        excess.append(found.makespan - best)
    assert max(excess) <= slack
    assert np.mean(excess) <= 0.3 * slack


def least(course, start, low, high, method):
    """Return how soon a robot can have searched an arc: straight to its beginning, or both ways from inside."""
    n, place = len(course), course.points[start]
    works = [[Sweep(low % n, high - low)]]
    at = start if low <= start else start + n
    if method == "two-way" and low < at < high:
        behind, ahead = at - low, high - at
        works.append([Sweep(start, behind + 1, -1), Sweep((start + 1) % n, ahead - 1)])
        works.append([Sweep(start, ahead), Sweep((start - 1) % n, behind, -1)])
    return min(work_time(course, [sweep for sweep in work if sweep.count], place) for work in works)
