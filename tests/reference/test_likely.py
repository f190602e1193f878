"""The order of a search with a prior against plain sums over its cells."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise, permutations

import numpy as np
import pytest
from tests.properties.search_scenarios import random_scenario

from shoal.search import TourCost, allocate, make_tour
from shoal.search.allocation.allocate import numbers_of
from shoal.search.allocation.likely import _UNLIKELY, _joined
from shoal.search.kernels import latency
from shoal.search.protocol.helping import Run, _best_run
from shoal.search.protocol.state import Brief, Robot


def searched_at(tour_cost, allocation, places, rates, way=None):
    """Return when each cell is searched, and when the last robot is done, in cells."""
    n, way = len(tour_cost), way or tour_cost.move_cost
    times, last = np.full(n, np.inf), 0.0
    for work, place, rate in zip(allocation.work, places, rates, strict=True):
        cells = numbers_of(work, n).tolist()
        if not cells:
            continue
        time = 1.0 + float(np.linalg.norm(tour_cost.points[cells[0]] - place))
        times[cells[0]] = min(times[cells[0]], time / rate)
        for here, cell in pairwise(cells):
            time += 1.0 + way(here, cell)
            times[cell] = min(times[cell], time / rate)
        last = max(last, time / rate)
    return times, last


def random_case(seed):
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(2, 9, size=2).tolist())
    tour = make_tour(
        str(rng.choice(["boustrophedon", "spanning-tree"])), np.ones(shape, dtype=bool)
    )
    n, m = len(tour), int(rng.integers(1, 4))
    odds = rng.exponential(size=n) ** 3
    tour_cost = TourCost(tour, turn_cost=float(rng.choice([0.0, 1.0])), odds=odds / odds.sum())
    starts, rates = rng.integers(0, n, size=m), rng.uniform(0.5, 2.0, size=m)
    return tour_cost, starts, rates


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("at_most", [1.0, 1.25])
def test_every_cell_once_in_time_and_no_later_on_average(seed, at_most):
    tour_cost, starts, rates = random_case(seed)
    tour_cost = replace(tour_cost, at_most=at_most)
    plain = allocate(replace(tour_cost, at_most=0.0), starts, rates=rates)
    ordered = allocate(tour_cost, starts, rates=rates)
    cells = np.concatenate([numbers_of(work, len(tour_cost)) for work in ordered.work])
    assert sorted(cells.tolist()) == list(range(len(tour_cost)))
    places = tour_cost.points[starts]
    before, last_before = searched_at(tour_cost, plain, places, rates)
    after, last = searched_at(tour_cost, ordered, places, rates)
    assert last <= at_most * last_before + 1e-6
    # cells of no probability count a little, too
    assert tour_cost.odds @ after <= tour_cost.odds @ before + 1e-2


@pytest.mark.parametrize("seed", range(6))
def test_small_searches_are_nearly_the_best_of_all_orders(seed):
    rng = np.random.default_rng([1, seed])
    tour = make_tour("boustrophedon", np.ones((2, 3), dtype=bool))
    odds = rng.exponential(size=6)
    tour_cost = TourCost(tour, odds=odds / odds.sum(), at_most=3.0)
    start = int(rng.integers(6))
    ordered = allocate(tour_cost, [start])
    found = tour_cost.odds @ searched_at(tour_cost, ordered, tour_cost.points[[start]], [1.0])[0]
    best = np.inf
    for order in permutations(range(6)):
        time = 1.0 + float(np.linalg.norm(tour_cost.points[order[0]] - tour_cost.points[start]))
        total = time * tour_cost.odds[order[0]]
        for here, cell in pairwise(order):
            time += 1.0 + tour_cost.move_cost(here, cell)
            total += time * tour_cost.odds[cell]
        best = min(best, total)
    assert best - 1e-9 <= found <= 1.05 * best


@pytest.mark.parametrize("seed", range(12))
def test_the_latency_of_an_order_is_the_sum_over_its_cells(seed, monkeypatch):
    found = []
    improve = latency.improve
    monkeypatch.setattr(latency, "improve", lambda *given: found.append(improve(*given)))
    tour_cost, starts, rates = random_case(seed)
    n = len(tour_cost)
    tour_cost = replace(tour_cost, at_most=1.5)
    ordered = allocate(tour_cost, starts, rates=rates)

    def step(here, cell):
        """Straight, or one step along the tour."""
        if abs(here - cell) in (1, n - 1):
            return tour_cost.move_cost(here, cell)
        straight = float(np.linalg.norm(tour_cost.points[here] - tour_cost.points[cell]))
        return max(straight - 1.0, 0.0) + tour_cost.turn_cost

    times, _ = searched_at(tour_cost, ordered, tour_cost.points[starts], rates, step)
    assert found == pytest.approx([(tour_cost.odds + _UNLIKELY / n) @ times], rel=1e-9)


def greedily_searched_at(tour_cost, starts, rates):
    """Return when each cell is searched if robots go on to the cell with the largest probability
    over the time that it takes and, if turns cost nothing, the cube of the way.
    """
    n, m = len(tour_cost), len(starts)
    points, weights = tour_cost.points, tour_cost.odds + _UNLIKELY / n
    times, ready, here = np.full(n, np.inf), np.zeros(m), [None] * m
    for _ in range(n):
        robot = int(np.argmin(ready / rates))
        left = np.flatnonzero(np.isinf(times))
        if here[robot] is None:
            ways = [1.0 + float(np.linalg.norm(points[k] - points[starts[robot]])) for k in left]
        else:
            ways = [1.0 + tour_cost.move_cost(here[robot], k) for k in left.tolist()]
        near = np.ones(len(left)) if tour_cost.turn_cost else np.array(ways)
        chosen = int(np.argmax(weights[left] / (ways * near**3)))
        here[robot] = int(left[chosen])
        ready[robot] += ways[chosen]
        times[here[robot]] = ready[robot] / rates[robot]
    return times


@pytest.mark.parametrize("seed", range(12))
def test_no_search_is_later_than_a_greedy_one(seed):
    tour_cost, starts, rates = random_case(seed)
    tour_cost = replace(tour_cost, at_most=5.0)
    ordered = allocate(tour_cost, starts, rates=rates)
    found, _ = searched_at(tour_cost, ordered, tour_cost.points[starts], rates)
    greedy = greedily_searched_at(tour_cost, starts, rates)
    assert tour_cost.odds @ found <= tour_cost.odds @ greedy + 1e-2


def test_blocks_of_a_long_tour_are_searched_whole_and_early_where_it_is_likely():
    tour = make_tour("boustrophedon", np.ones((60, 100), dtype=bool))
    points = tour.cells.astype(float)
    odds = np.exp(-((points - [50, 20]) ** 2).sum(axis=1) / 50)
    tour_cost = TourCost(tour, odds=odds / odds.sum())
    starts = [0, 3000]
    plain = allocate(replace(tour_cost, at_most=0.0), starts)
    ordered = allocate(tour_cost, starts)
    places, rates = tour_cost.points[starts], [1.0, 1.0]
    before, last = searched_at(tour_cost, plain, places, rates)
    after, longest = searched_at(tour_cost, ordered, places, rates)
    assert np.isfinite(after).all()
    assert tour_cost.odds @ after < 0.5 * (tour_cost.odds @ before)
    assert longest <= 1.25 * last + 1e-6


def test_runs_are_joined():
    assert _joined([(3, 1, 1), (2, 1, 1), (1, 2, -1), (5, 2, 1)], 8) == [(3, 4, -1), (5, 2, 1)]
    assert _joined([(7, 1, -1), (0, 2, 1)], 8) == [(7, 3, 1)]
    assert _joined([(0, 2, 1), (4, 2, -1)], 8) == [(0, 2, 1), (4, 2, -1)]


def test_scenarios_have_priors():
    assert any(random_scenario(seed).brief.tour_cost.odds is not None for seed in range(20))


def test_a_helper_begins_where_it_finds_the_target_most_probably():
    odds = np.full(40, 0.2 / 36)
    odds[30:34] = 0.2
    tour = make_tour("boustrophedon", np.ones((4, 10), dtype=bool))
    robot = Robot(1, Brief(TourCost(tour, odds=odds / odds.sum())), start=0)
    runs = [Run(2, 6, 1), Run(36, 8, -1), Run(20, 4, 1)]
    assert _best_run(robot, (1.0, 1.0), 0, runs) == (runs[1], 0)
    plain = Robot(1, Brief(TourCost(tour)), start=0)
    assert _best_run(plain, (1.0, 1.0), 0, runs) == (runs[2], 0)
