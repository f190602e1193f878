"""Ways between the cells of a tour: what others have searched there never makes the
rest cost more.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shoal.search.allocation.costs import TourCost
from shoal.search.cells.distances import CellDistances
from shoal.search.tours import make_tour
from shoal.search.tours.masks import bitset_of

SHAPES = {
    "hilbert": (8, 8),
    "moore": (4, 4),
    "hilbert-rectangle": (1, 10),
    "comb": (5, 7),
    "spanning-tree": (6, 8),
}


def a_course(name, turn_cost, *, stepwise):
    tour = make_tour(name, SHAPES[name])
    return TourCost(tour, turn_cost=turn_cost, distances=CellDistances(tour) if stepwise else None)


@settings(max_examples=200, deadline=None)
@given(
    name=st.sampled_from(sorted(SHAPES)),
    turn_cost=st.sampled_from([0.0, 0.5, 1.0, 3.0]),
    stepwise=st.booleans(),
    fresh=st.booleans(),
    data=st.data(),
)
def test_a_jump_costs_no_more_than_searching_what_lies_between(
    name, turn_cost, stepwise, fresh, data
):
    tour_cost = a_course(name, turn_cost, stepwise=stepwise)
    n = len(tour_cost)
    here, count = (
        data.draw(st.integers(0, n - 1)),
        data.draw(st.integers(1, 4) | st.integers(1, n - 1)),
    )
    step = data.draw(st.sampled_from([1, -1])) if stepwise else 1
    stops = [(here + step * k) % n for k in range(count + 1)]
    each = sum(
        1.0 + tour_cost.move_cost(one, other, fresh=fresh and one == here)
        for one, other in pairwise(stops)
    )
    assert 1.0 + tour_cost.move_cost(here, stops[-1], fresh=fresh) <= each + 1e-9


@settings(max_examples=60, deadline=None)
@given(name=st.sampled_from(sorted(SHAPES)), turn_cost=st.sampled_from([0.0, 1.0]), data=st.data())
def test_the_cells_of_a_way_are_neighbours_none_is_closed_and_none_cheaper_is_missed(
    name, turn_cost, data
):
    tour_cost = a_course(name, turn_cost, stepwise=True)
    numbers = st.integers(0, len(tour_cost) - 1)
    here, cell, closed = (
        data.draw(numbers),
        data.draw(numbers),
        data.draw(st.sets(numbers, max_size=6)),
    )
    bits = bitset_of(closed - {here, cell})
    cost, through = (
        tour_cost.move_cost(here, cell, closed=bits),
        tour_cost.through(here, cell, closed=bits),
    )
    if here == cell:
        assert cost == 0
        assert through == ()
        return
    if cost == np.inf:
        assert through == ()
        return
    assert through[-1] == cell
    assert not bits & bitset_of(through)
    length = sum(tour_cost.length(one, other) for one, other in pairwise((here, *through)))
    # Each turn on the way is paid at most once, and one is paid for a way of its own.
    assert length - 1 - 1e-9 <= cost <= length - 1 + turn_cost * max(len(through), 1) + 1e-9


def test_cells_searched_on_a_straight_way_are_no_turn():
    tour = make_tour("hilbert-rectangle", (1, 10))
    tour_cost = TourCost(tour, turn_cost=1.0, distances=CellDistances(tour))
    assert tour_cost.move_cost(5, 8) == pytest.approx(2.0)
    assert tour_cost.through(5, 8) == (6, 7, 8)
