"""Robots that help slow and dead ones: how soon a search ends then, and that nothing changes where
all are well.
"""

from __future__ import annotations

import pytest
from tests.properties.search_invariants import Checker, check_outcome
from tests.search_episodes import search

from shoal.search import TourCost, make_tour
from shoal.search.problem.network import Crash, Pause, Slow, network_of
from shoal.search.protocol import robot as helping
from shoal.search.protocol import state as inference
from shoal.search.protocol.state import Brief
from shoal.search.simulation.scenario import Scenario
from shoal.search.simulation.world import SearchWorld

STARTS = (5, 74, 131, 212, 260, 330)


def ring_time(*faults, loss=0.0, robots=6):
    """Return when all is searched in a ring of 384 cells."""
    mask = [[not (5 <= row < 15 and 5 <= column < 17) for column in range(22)] for row in range(20)]
    brief = Brief(TourCost(make_tour("hilbert-rectangle", mask)))
    starts = tuple(start % len(brief.tour_cost) for start in STARTS[:robots])
    scenario = Scenario(brief, starts, network=network_of(loss=loss), faults=faults, seed=1)
    outcome = SearchWorld(scenario, check=Checker(scenario)).run(until=1e5)
    check_outcome(scenario, outcome)
    return outcome.covered_at


@pytest.fixture(scope="module")
def healthy():
    return ring_time()


@pytest.mark.parametrize("loss", [0.0, 0.3])
@pytest.mark.parametrize(
    ("faults", "most"),
    [
        ([Slow(2, 5.0)], 1.55),
        ([Slow(2, 50.0)], 1.8),
        ([Slow(2, 10.0, 30.0)], 1.5),
        ([Slow(2, 10.0, 60.0)], 1.6),  # late: it has nearly done its part
        ([Slow(2, 5.0), Slow(3, 5.0)], 1.9),
        ([Slow(2, 5.0), Crash(3, 20.0)], 1.9),
        ([Pause(2, 15.0, 70.0)], 1.55),
        ([Crash(2, 15.0)], 1.6),
    ],
)
def test_a_slow_robot_loses_what_it_would_do_too_late(faults, most, loss, healthy):
    assert ring_time(*faults, loss=loss) <= most * healthy


def test_a_slow_robot_that_has_far_to_go_to_its_part_is_helped_there():
    """Others do not leave to it what it comes to so late: with parts in two directions its way
    there may be as long as a part.
    """
    well, slow = (
        search("ring:200x150", robots=6, footprint=10, allocation="two-way", faults=faults, seed=3)
        for faults in ((), "slow:2@0:5")
    )
    assert slow.trace.covered_at <= 1.5 * well.trace.covered_at


def test_the_last_robot_alive_ends_however_slow_it_is(healthy):
    crashes = [Crash(number, 10.0) for number in range(2, 7)]
    assert ring_time(Slow(1, 5.0), *crashes) < 5.2 * 400


@pytest.mark.parametrize("loss", [0.0, 0.4, 0.8])
def test_nobody_helps_where_all_are_well(loss, monkeypatch):
    """Who is well is never late: without that rule the search is the same."""
    options = {"robots": 5, "footprint": 10, "loss": loss, "rates": [1, 2, 1, 0.5, 1], "seed": 2}
    with_rule = search("ring:80x50", **options)
    monkeypatch.setattr(inference, "is_late", lambda robot, number, time: False)
    monkeypatch.setattr(helping, "is_late", lambda robot, number, time: False)
    assert with_rule.trace.difference(search("ring:80x50", **options).trace) == ""
