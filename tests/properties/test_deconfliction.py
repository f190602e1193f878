"""Random plans keep their separation in a slow simulation of their missions alone, whatever each
vehicle is late by.
"""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.deconfliction import least_distance, random_problem
from tests.soak import often

from shoal.missions.deconfliction import plan_missions
from shoal.search.flight.separation import Separation
from shoal.search.planning.plan import plan_search


@pytest.mark.parametrize("number", range(often(6, 10)))
def test_random_plans_keep_their_separation(number):
    """A thousand of up to 12 vehicles: python -m benchmarks.deconfliction 1000."""
    rng = np.random.default_rng([7, number])
    problem = random_problem(rng)
    while problem.robots > 5:
        problem = random_problem(rng)
    separation = Separation(12.0, 4.0, 8.0) if number % 2 else Separation()
    missions = plan_missions(plan_search(problem, seed=number), separation=separation)
    for late in (0.0, 1.0, *rng.random((3, len(missions)))):
        waits = separation.delay * late * rng.integers(0, 2, len(missions))
        assert least_distance(missions, waits, separation.vertical) > separation.horizontal - 0.02
