"""Random searches: every network, every fault, all invariants after every event; and bugs, planted,
that they find.

The number of searches is 200 in regions of up to 5 x 5 cells with up to 6 robots, as most of the
time goes to the few largest scenarios. With the environment variable SHOAL_SOAK it is that number,
with up to 7 x 7 cells and 16 robots.
"""

from __future__ import annotations

import os
from dataclasses import replace
from math import inf

import pytest
from tests.properties import search_scenarios
from tests.properties.search_invariants import Checker, InvariantError, check_outcome
from tests.properties.search_scenarios import random_scenario

from shoal.search.problem.network import Crash, Liar, Pause
from shoal.search.protocol import messages as envelope
from shoal.search.protocol import robot as robots
from shoal.search.simulation import world as worlds
from shoal.search.simulation.world import SearchWorld

SEARCHES = int(os.environ.get("SHOAL_SOAK", "200"))
LARGEST, MOST_ROBOTS = (7, 16) if "SHOAL_SOAK" in os.environ else (5, 6)
CHUNKS = 4


@pytest.fixture(autouse=True)
def sizes(monkeypatch):
    monkeypatch.setattr(search_scenarios, "_LARGEST", LARGEST)
    monkeypatch.setattr(search_scenarios, "_MOST_ROBOTS", MOST_ROBOTS)


def play(seed, *, wide=False):
    scenario = random_scenario(seed, wide=wide)
    world = SearchWorld(scenario, check=Checker(scenario))
    outcome = world.run(
        until=60 * scenario.brief.tour_cost.whole * scenario.brief.multiplicity + 1000
    )
    check_outcome(scenario, outcome)
    return scenario, outcome


@pytest.mark.parametrize("chunk", range(CHUNKS))
def test_random_searches_hold_all_invariants(chunk):
    for seed in range(chunk, SEARCHES, CHUNKS):
        play(seed)


def test_larger_searches_hold_all_invariants(monkeypatch):
    monkeypatch.setattr(search_scenarios, "_LARGEST", 10)
    monkeypatch.setattr(search_scenarios, "_MOST_ROBOTS", 30)
    for seed in range(SEARCHES // 25):
        play(seed)


def test_random_searches_with_wide_footprints_hold_all_invariants():
    widths = {width for seed in range(SEARCHES // 25) for width in play(seed, wide=True)[0].widths}
    assert widths == {1, 3, 5}


def test_scenarios_are_of_all_kinds():
    scenarios = [random_scenario(seed) for seed in range(300)]
    kinds = {type(fault).__name__ for scenario in scenarios for fault in scenario.faults}
    media = {medium.kind for scenario in scenarios for medium in scenario.network.media}
    assert kinds == {"Crash", "Pause", "Slow", "Battery", "WrongPosition", "Liar"}
    assert media == {
        "loss",
        "bursts",
        "range",
        "partition",
        "delay",
        "duplicates",
        "corruption",
        "replays",
        "forgeries",
    }
    assert {scenario.packet for scenario in scenarios if scenario.signed} == {0, 64, 100, 1200}
    assert {len(scenario.starts) for scenario in scenarios} >= {1, 2, 5, 6}
    assert any(not scenario.network.media for scenario in scenarios)
    assert any(scenario.brief.energy < inf for scenario in scenarios)
    assert {scenario.brief.multiplicity for scenario in scenarios} == {1, 2, 3}


def test_the_same_seed_gives_the_same_trace():
    for seed in range(12):
        worlds = [SearchWorld(random_scenario(seed)).run(until=2000) for _ in range(2)]
        one, other = (
            [trace_of(world), world.air.sent, world.air.lost, world.declared, world.takeovers]
            for world in worlds
        )
        assert one == other
        assert any(visits for visits, *_ in one[0])


def trace_of(world):
    return [
        (robot.visits, robot.detours, robot.obstructed, robot.states, robot.travelled, robot.waited)
        for robot in world.vehicles.values()
    ]


def found_within(searches):
    """Return whether an invariant breaks in one of so many searches; what it says must hold the
    seed.
    """
    for seed in range(searches):
        try:
            play(seed)
        except InvariantError as error:
            return f"seed {seed}" in str(error)
    return False


def test_no_planted_bug_no_finding():
    assert not found_within(60)


def test_bug_1_done_when_the_own_part_is_done(monkeypatch):
    true = robots.settled_cells
    monkeypatch.setattr(
        robots,
        "settled_cells",
        lambda robot, time: (
            robot.brief.everything
            if robot.parts[robot.own].bits & ~robot.mine == 0
            else true(robot, time)
        ),
    )
    assert found_within(60)


def test_bug_2_a_silent_robot_counts_as_done(monkeypatch):
    true = robots.receive

    def heard(robot, beacon, time):
        after = true(robot, beacon, time)
        claimed = {
            part.robot: part.bits
            for part in robot.parts
            if part.robot in after.peers and part.robot != robot.number
        }
        return after.replaced(searched={**after.searched, **claimed})

    monkeypatch.setattr(robots, "receive", heard)
    assert found_within(60)


def test_bug_3_no_right_of_way(monkeypatch):
    def enter(world, vehicle, cell):
        vehicle.searching = vehicle.place = cell
        world._post(world.time + 1.0 / world._rate(vehicle), vehicle.robot.number, "sense", cell)

    monkeypatch.setattr(SearchWorld, "_do_enter", enter)
    assert found_within(60)


def test_bug_4_nobody_takes_over(monkeypatch):
    monkeypatch.setattr(
        robots, "_cell_of_others", lambda robot, wanted, own, mine, time: (None, inf)
    )
    assert found_within(60)


def test_bug_5_an_empty_battery_goes_on(monkeypatch):
    def spend(world, vehicle, cost):
        vehicle.energy -= cost
        return True

    monkeypatch.setattr(SearchWorld, "_spend", spend)
    assert found_within(200)


def test_bug_6_waits_for_ever_for_a_live_robot(monkeypatch):
    monkeypatch.setattr(
        robots, "cost_of_all", lambda tour_cost, wanted, here, fresh, closed=0: -inf
    )
    assert found_within(200)


def test_bug_7_signatures_are_not_checked(monkeypatch):
    monkeypatch.setattr(envelope, "_seal", lambda key, message: bytes(8))
    assert found_within(400)


def test_bug_8_a_beacon_tells_what_is_on_the_way(monkeypatch):
    true = robots.with_beacon

    def with_beacon(robot, time):
        robot, beacon = true(robot, time)
        place = beacon.heartbeats[0].place
        return robot, replace(beacon, searched=(*beacon.searched, (robot.number, 1 << place)))

    monkeypatch.setattr(robots, "with_beacon", with_beacon)
    assert found_within(60)


def test_liars_are_outvoted():
    """With fold 2 and one liar all is searched by an honest robot before anybody declares; with
    fold 1 the liar is believed.
    """
    believed = 0
    for seed in range(16):
        scenario = random_scenario(seed)
        if len(scenario.starts) < 3:
            continue
        brief = robots.Brief(scenario.brief.tour_cost, scenario.brief.allocator, multiplicity=2)
        lying = worlds.Scenario(brief, scenario.starts, faults=(Liar(1),), seed=seed)
        world = SearchWorld(lying, check=Checker(lying))
        check_outcome(lying, world.run(until=1e5))
        single = worlds.Scenario(
            robots.Brief(brief.tour_cost, brief.allocator),
            scenario.starts,
            faults=(Liar(1),),
            seed=seed,
        )
        outcome = SearchWorld(single).run(until=1e5)
        believed += any(when < outcome.covered_at for when in outcome.declared.values())
    assert believed > 2


def test_who_declares_is_right_and_complete():
    scenario, outcome = play(1)
    for number, when in outcome.declared.items():
        assert when >= outcome.covered_at or any(
            isinstance(fault, Liar) for fault in scenario.faults
        )
        assert outcome.vehicles[number].robot.status == "complete"


def test_crashes_and_pauses_do_what_they_say():
    scenario = random_scenario(2)
    faulty = worlds.Scenario(
        robots.Brief(scenario.brief.tour_cost),
        (0, 0, 0),
        faults=(Crash(1, 3.0), Pause(2, 2.0, 30.0)),
        seed=1,
    )
    outcome = SearchWorld(faulty).run(until=1e4)
    assert outcome.vehicles[1].states[-1] == (3.0, "dead")
    assert all(when <= 3.0 for when, _ in outcome.vehicles[1].visits)
    assert not any(2.0 < when < 30.0 for when, _ in outcome.vehicles[2].visits)
    assert outcome.covered_at < inf
