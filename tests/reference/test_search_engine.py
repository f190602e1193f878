"""The compiled search protocol against the plain one, event by event and message by message."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest
from tests.properties import search_scenarios
from tests.properties.search_invariants import check_outcome
from tests.properties.search_scenarios import random_scenario
from tests.soak import often
from tests.without_compiler import printed

from shoal.search import TourCost, make_tour
from shoal.search.problem.network import network_of
from shoal.search.protocol.messages import Beacon
from shoal.search.protocol.state import Brief
from shoal.search.simulation import compiled
from shoal.search.simulation.compiled import STATES, CompiledSearches, can_compile
from shoal.search.simulation.scenario import Scenario
from shoal.search.simulation.world import SearchWorld
from shoal.search.tours.masks import members

SEARCHES = 120


def horizon(scenario):
    return 60 * scenario.brief.tour_cost.whole * scenario.brief.multiplicity + 1000


def compiled_scenarios(numbers, largest=5, robots=6):
    """Yield random scenarios, all of which compiled code simulates."""
    before = search_scenarios._LARGEST, search_scenarios._MOST_ROBOTS
    search_scenarios._LARGEST, search_scenarios._MOST_ROBOTS = largest, robots
    try:
        for number in numbers:
            scenario = random_scenario(number)
            assert can_compile(scenario)
            yield scenario
    finally:
        search_scenarios._LARGEST, search_scenarios._MOST_ROBOTS = before


def assert_equal_outcomes(scenario):
    """Check that both forms make the same moves at the same times, to the last bit."""
    plain = SearchWorld(scenario).run(until=horizon(scenario))
    searches = CompiledSearches([scenario])
    searches.run(0, horizon(scenario))
    outcome = searches.outcome(0)
    for i, vehicle in enumerate(plain.vehicles.values()):
        cells, times = outcome.cells[i].tolist(), outcome.times[i].tolist()
        assert list(zip(times, cells, strict=True)) == vehicle.visits, scenario.seed
        assert list(outcome.states[i]) == vehicle.states, scenario.seed
        assert outcome.found[i] == dict(vehicle.robot.found), scenario.seed
        robot = searches.worlds.robots[0, i]
        assert (robot.travelled, robot.waited) == (vehicle.travelled, vehicle.waited)
        assert list(outcome.obstructed[i]) == vehicle.obstructed, scenario.seed
        if scenario.brief.tour_cost.stepwise:
            assert list(outcome.detours[i]) == vehicle.detours, scenario.seed
    assert outcome.declared == plain.declared, scenario.seed
    assert (outcome.sent, outcome.lost) == (plain.air.sent, plain.air.lost), scenario.seed
    assert outcome.takeovers == plain.takeovers, scenario.seed
    assert outcome.covered_at == plain.covered_at, scenario.seed
    return outcome


def test_random_searches_are_equal():
    outcomes = [assert_equal_outcomes(each) for each in compiled_scenarios(range(SEARCHES))]
    assert sum(outcome.takeovers for outcome in outcomes) > 10
    assert sum(len(found) for outcome in outcomes for found in outcome.obstructed) > 30
    assert sum(outcome.lost for outcome in outcomes) > 1000


@pytest.mark.parametrize("number", [2118, 2312])
def test_robots_that_depart_late_do_not_wait_forever_for_cells_that_some_cannot_reach(number):
    scenario = random_scenario(number)
    outcome = assert_equal_outcomes(scenario)
    assert scenario.brief.delays
    assert scenario.brief.tour_cost.stepwise
    assert outcome.declared
    check_outcome(scenario, SearchWorld(scenario).run(until=horizon(scenario)))


def test_searches_are_equal_without_room_for_distances(monkeypatch):
    monkeypatch.setattr(compiled, "_SETS", 2)
    monkeypatch.setattr(compiled, "_ROWS", 3)
    for scenario in compiled_scenarios(range(200, 240)):
        if scenario.obstacles:
            assert_equal_outcomes(scenario)


@pytest.mark.parametrize("loss", [0.3, 0.0][: often(1, 2)])
def test_so_many_robots_that_beacons_are_bounded_are_equal(loss):
    tour_cost = TourCost(make_tour("hilbert-rectangle", (14, 14)))
    starts = tuple(np.random.default_rng(3).integers(0, 196, 70).tolist())
    network = network_of(loss=loss)
    outcome = assert_equal_outcomes(Scenario(Brief(tour_cost), starts, network=network, seed=3))
    assert outcome.covered_at < inf


# Event by event


class Both:
    """Both forms of a search, which play the same event at the same time."""

    def __init__(self, scenario):
        self.plain, self.searches = SearchWorld(scenario), CompiledSearches([scenario])
        self.beacons, self.messages = [], []
        self.plain.air.messages = self._heard(self.plain.air.messages)

    def _heard(self, messages):
        def told(sender, beacon, time):
            self.beacons.append(beacon)
            return messages(sender, beacon, time)

        return told

    def step(self):
        """Play all events of the next moment, and return whether there was one."""
        if not self.plain._queue:
            return False
        until = self.plain._queue[0][0]
        self.plain.run(until=until)
        while self.searches.worlds.times[0, 0] <= until and self.searches.worlds.control[0].queued:
            before = self.searches.worlds.control[0].slots
            self.searches.run(0, until, most=1)
            self._note(before)
        return True

    def _note(self, before):
        """Note the message that the last event sent, which holds the place freed last."""
        w = self.searches.worlds
        robots = w.robots[0]
        sent = int(robots["count"].sum())
        if sent > len(self.messages):
            assert sent == len(self.messages) + 1
            self.messages.append(int(w.control[0].last))


def believed(both, i):
    """Return what a robot of the compiled search believes, as sets by the number of a robot."""
    w = both.searches.worlds
    searched = {}
    for fact in range(64 * int(w.control[0].words)):
        if int(w.known[0, i, fact >> 6]) >> (fact & 63) & 1:
            other = int(w.owner[0, fact >> 6]) + 1
            searched[other] = searched.get(other, 0) | 1 << int(w.cells[0, fact])
    return searched


def cells_of(words):
    """Return the members of a bitset of words."""
    return {64 * k + bit for k in range(len(words)) for bit in members(int(words[k]))}


def believed_obstacles(both, i):
    """Return the obstacles that a robot of the compiled search knows, each with its finder."""
    w = both.searches.worlds
    return {
        (int(w.closer[0, closing]) + 1, int(w.shut[0, closing]))
        for closing in cells_of(w.closed[0, i])
    }


def beacon_of(both, slot):
    """Return a message of the compiled search as a set of facts."""
    w, message = both.searches.worlds, both.searches.worlds.messages[0, slot]
    searched, found = {}, {}
    for k in range(int(message.words)):
        word, bits = int(w.word[0, slot, k]), int(w.bits[0, slot, k])
        other = int(w.owner[0, word]) + 1
        for bit in range(64):
            if bits >> bit & 1:
                searched[other] = searched.get(other, 0) | 1 << int(w.cells[0, 64 * word + bit])
    for k in range(int(message.findings)):
        word, bits = int(w.finding_word[0, slot, k]), int(w.finding_bits[0, slot, k])
        for bit in range(64):
            if bits >> bit & 1:
                cell = int(w.place[0, 64 * word + bit])
                found[cell] = found.get(cell, 0) | 2 << int(w.finder[0, 64 * word + bit])
    beats = {
        (int(other) + 1, int(count), STATES[state], int(place), float(lag))
        for (other, count, state, place), lag in zip(
            w.beats[0, slot, : int(message.heartbeats)],
            w.lags[0, slot, : int(message.heartbeats)],
            strict=True,
        )
    }
    closed = {}
    for k in range(int(message.closings)):
        word, bits = int(w.closing_word[0, slot, k]), int(w.closing_bits[0, slot, k])
        for bit in range(64):
            if bits >> bit & 1:
                other = int(w.closer[0, 64 * word + bit]) + 1
                closed[other] = closed.get(other, 0) | 1 << int(w.shut[0, 64 * word + bit])
    return int(message.sender) + 1, beats, searched, found, closed


def plain_beacon(beacon: Beacon):
    beats = {(h.robot, h.count, h.status, h.place, h.lag) for h in beacon.heartbeats}
    return beacon.sender, beats, dict(beacon.searched), dict(beacon.found), dict(beacon.closed)


def assert_equal_robots(both):
    w = both.searches.worlds
    for i, vehicle in enumerate(both.plain.vehicles.values()):
        plain, robot = vehicle.robot, w.robots[0, i]
        pairs = (
            (STATES[robot.status], plain.status),
            (robot.cell, plain.cell),
            (bool(robot.fresh), plain.fresh),
            (robot.target, {None: -2}.get(plain.target, plain.target)),
            (robot.count, plain.count),
            (robot.next_beat, plain.next_beat),
            (robot.deadline, plain.deadline),
            (robot.left, plain.left),
            (robot.lag, plain.lag),
            ((robot.lost, robot.received), (plain.lost, plain.received)),
            (robot.window, plain.window),
            (robot.place, vehicle.place),
            (robot.energy, vehicle.energy),
            (bool(robot.alive), vehicle.alive),
        )
        for mine, theirs in pairs:
            assert mine == theirs, (both.plain.scenario.seed, both.plain.time, i + 1, pairs)
        assert believed(both, i) == {k: bits for k, bits in plain.searched.items() if bits}
        closed = {(k, cell) for k, bits in plain.closed.items() for cell in members(bits)}
        assert believed_obstacles(both, i) == closed
        if plain.brief.tour_cost.stepwise:
            assert cells_of(w.passed[0, i]) == set(members(plain.passed))
            assert tuple(w.path[0, i, : robot.through].tolist()) == plain.through
        for other, peer in plain.peers.items():
            known, heartbeat = w.peers[0, i, other - 1], peer.heartbeat
            assert int(w.counts[0, i, other - 1]) == heartbeat.count
            assert (STATES[known.status], known.place) == (heartbeat.status, heartbeat.place)
            assert (known.lag, known.heard, known.since) == (
                heartbeat.lag,
                peer.heard,
                peer.since,
            )
            marks = (known.then, known.lag_then), (known.later, known.lag_later)
            assert marks == peer.marks


def test_all_robots_and_all_messages_are_equal_at_every_moment():
    messages = 0
    for scenario in compiled_scenarios(range(1000, 1000 + often(8, 16)), largest=4, robots=5):
        both = Both(scenario)
        while both.plain.time < horizon(scenario) and both.step():
            assert_equal_robots(both)
            assert len(both.beacons) == len(both.messages)
            if both.beacons:  # the place of a message is free for others as soon as all heard it
                newest = plain_beacon(both.beacons[-1])
                assert beacon_of(both, both.messages[-1]) == newest, scenario.seed
                messages += 1
    assert messages > 1000


SCRIPT = """
import numpy as np
np.seterr(over="ignore")  # words wrap around
from tests.reference.test_search_engine import assert_equal_outcomes, compiled_scenarios
for scenario in compiled_scenarios(range(8), largest=4, robots=5):
    assert_equal_outcomes(scenario)
print("equal")
"""


def test_without_the_compiler_searches_are_equal():
    assert printed(SCRIPT) == "equal\n"
