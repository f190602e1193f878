"""Paper H, Fig. 5: the time of robots that stay where they are, against theory, an exact count and
the allocation itself.
"""

from __future__ import annotations

from math import comb

import numpy as np
import pytest

from shoal.core.errors import InvalidInputError
from shoal.search import TourCost, allocate, make_tour
from shoal.search.allocation.costs import expected_time, stay_share

TRIALS = 4000
SURE = 4.5  # standard errors: one such test in 150,000 would fail by chance


@pytest.mark.parametrize("cells", [64, 256, 1024, 4096])
@pytest.mark.parametrize(
    ("robots", "dead"),
    [(1, 0), (2, 0), (5, 0), (10, 0), (20, 0), (50, 0), (10, 5), (20, 1), (50, 30)],
)
def test_share_of_the_harmonic_number(cells, robots, dead):
    found, theory = (
        expected_time(cells, robots, dead=dead, trials=TRIALS, seed=cells + robots),
        stay_share(robots, dead=dead),
    )
    assert abs(found.mean - theory) <= 0.01 * theory + SURE * found.error
    assert found.error < 0.012 * theory


def test_within_two_percent_with_ten_thousand_trials():
    for cells in (64, 256, 1024, 4096):
        for robots, dead in ((1, 0), (2, 0), (5, 0), (10, 0), (20, 0), (50, 0), (20, 5), (50, 5)):
            assert expected_time(cells, robots, dead=dead, seed=7).mean == pytest.approx(
                stay_share(robots, dead=dead), rel=0.02
            )


def test_specified_values():
    assert [round(stay_share(m), 3) for m in (1, 10, 20, 50)] == [1.0, 0.293, 0.18, 0.09]
    assert stay_share(20) < 0.20  # "less than 20 % with 20 robots"


def exact_share(cells: int, robots: int) -> float:
    """The mean of the longest stretch in whole cells, counted: how many circles of d occupied cells
    have no stretch above g.
    """

    def fitting(
        d: int, g: int
    ) -> int:  # ways to write the number of cells as d stretches from 1 to g
        return sum(
            (-1) ** j * comb(d, j) * comb(cells - j * g - 1, d - 1)
            for j in range(d + 1)
            if cells - j * g - 1 >= d - 1
        )

    occupied = np.zeros(cells + 1)  # the chance of d different cells
    occupied[0] = 1.0
    for _ in range(robots):
        d = np.arange(cells + 1)
        occupied = occupied * d / cells + np.concatenate(
            [[0.0], (occupied * (cells - d) / cells)[:-1]]
        )
    mean = 0.0
    for g in range(cells):
        below = (
            sum(
                occupied[d] * fitting(d, g) / comb(cells - 1, d - 1)
                for d in range(1, min(cells, robots) + 1)
            )
            if g
            else 0.0
        )
        mean += 1.0 - below
    return mean / cells


@pytest.mark.parametrize(
    ("cells", "robots"), [(1, 1), (1, 5), (2, 3), (9, 4), (64, 5), (64, 50), (16, 80)]
)
def test_exact_count_in_whole_cells(cells, robots):
    found = expected_time(cells, robots, trials=TRIALS, seed=1)
    assert abs(found.mean - exact_share(cells, robots)) <= SURE * found.error + 1e-12


def test_whole_cells_are_hardly_slower():
    assert exact_share(64, 50) / stay_share(50) == pytest.approx(1.0057, abs=1e-4)


def test_it_is_the_time_of_the_allocation():
    tour_cost, rng = TourCost(make_tour("moore", (16, 16))), np.random.default_rng(5)
    times = [
        allocate(tour_cost, rng.integers(256, size=12), allocator="stay").makespan
        for _ in range(200)
    ]
    same = np.random.default_rng(5)
    again = [same.integers(256, size=12) for _ in range(200)]
    longest = [max(np.diff(np.append(np.sort(row), row.min() + 256))) for row in again]
    assert times == longest
    found = expected_time(256, 12, trials=TRIALS)
    assert abs(np.mean(times) / 256 - found.mean) < SURE * np.hypot(
        found.error, np.std(times) / 256 / 200**0.5
    )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"robots": 0}, "robots: expected a whole number, 1 or more, got 0"),
        ({"robots": 3, "dead": 3}, "dead: expected a whole number from 0 to 2, got 3"),
        ({"robots": 3, "trials": 1}, "trials: expected a whole number, 2 or more, got 1"),
        ({"robots": 3, "cells": 0}, "cells: expected a whole number, 1 or more, got 0"),
    ],
)
def test_bad_input(options, words):
    with pytest.raises(InvalidInputError, match=words):
        expected_time(**{"cells": 64, **options})
