"""Allocation, tour, networks, faults, the robot, and whole searches."""

from __future__ import annotations

import json
from math import inf

import numpy as np
import pytest
import shapely
from numpy.testing import assert_array_equal
from tests.properties.search_invariants import Checker, check_outcome
from tests.search_episodes import planned, search

from shoal.core.errors import InvalidInputError, UnknownNameError
from shoal.search import Arc, SearchEpisode, TourCost, allocate, make_tour, open_region
from shoal.search.allocation.allocate import cost_of_all
from shoal.search.cells.distances import CellDistances
from shoal.search.problem.network import (
    Battery,
    Crash,
    Liar,
    Pause,
    RadioNetwork,
    Slow,
    WrongPosition,
    check_faults,
    network_of,
)
from shoal.search.protocol.messages import Beacon, Heartbeat
from shoal.search.protocol.robot import advance
from shoal.search.protocol.state import (
    Begin,
    Blocked,
    Brief,
    Declare,
    Go,
    Heard,
    Robot,
    Send,
    Sensed,
    Wake,
    WakeAt,
)
from shoal.search.simulation.live.supervisor import takeovers_of
from shoal.search.simulation.scenario import Scenario
from shoal.search.simulation.trace import RobotLog
from shoal.search.simulation.world import SearchWorld
from shoal.search.tours.masks import arc_bits, at_least, members, next_in, rotate_bits, runs

ALLOCATORS = ("stay", "common-shift", "individual-shift", "two-way", "hop")


def searched(allocation, n):
    seen = np.zeros(n, dtype=int)
    for arcs in allocation.arcs:
        for arc in arcs:
            seen[(arc.first + arc.step * np.arange(arc.count)) % n] += 1
    return seen


@pytest.mark.parametrize("allocator", ALLOCATORS)
@pytest.mark.parametrize("layout", ["random", "clustered", "line", "one cell", "unequal"])
def test_every_cell_is_allotted_once(allocator, layout):
    rng = np.random.default_rng(3)
    for _ in range(8):
        shape = tuple(int(side) for side in rng.integers(1, 14, size=2))
        tour_cost = TourCost(
            make_tour("hilbert-rectangle", shape), turn_cost=float(rng.choice([0, 1]))
        )
        n, m = len(tour_cost), int(rng.integers(1, 25))
        if layout == "random" or layout == "unequal":
            starts = rng.integers(0, n, size=m)
        elif layout == "clustered":
            starts = (rng.integers(n) + rng.integers(0, 5, size=m)) % n
        elif layout == "line":
            starts = tour_cost.tour.position[np.arange(m) % shape[0], 0]
        else:
            starts = np.full(m, rng.integers(n))
        rates = rng.uniform(0.3, 3, size=m) if layout == "unequal" else None
        found = allocate(tour_cost, starts, allocator=allocator, rates=rates)
        assert_array_equal(searched(found, n), 1)
        assert found.makespan >= n / (m if rates is None else rates.sum()) - 1e-9


def test_allocations_get_better():
    tour_cost = TourCost(make_tour("moore", (32, 32)))
    rng = np.random.default_rng(5)
    means = {allocator: [] for allocator in ALLOCATORS}
    for _ in range(30):
        starts = rng.integers(0, 1024, size=20)
        for allocator in ALLOCATORS:
            means[allocator].append(
                allocate(tour_cost, starts, allocator=allocator).makespan / 1024
            )
    mean = {allocator: np.mean(values) for allocator, values in means.items()}
    assert mean["hop"] < mean["two-way"] < mean["individual-shift"] < mean["stay"]
    assert mean["common-shift"] < mean["stay"]
    assert mean["hop"] < 0.064 + 0.003  # the specification's


@pytest.mark.parametrize("allocator", ALLOCATORS)
def test_more_robots_than_cells(allocator):
    rng = np.random.default_rng(22)
    for _ in range(60):
        tour_cost = TourCost(
            make_tour("hilbert-rectangle", (int(rng.integers(1, 4)), int(rng.integers(1, 5))))
        )
        n, m = len(tour_cost), int(rng.integers(1, 40))
        starts = (rng.integers(n) + rng.integers(0, 3, size=m)) % n
        found = allocate(tour_cost, starts, allocator=allocator)
        assert_array_equal(searched(found, n), 1)
        assert found.makespan >= n / m


def test_leaving_a_cell_out_never_costs_more():
    """The bound of the protocol rests on that: what others have searched makes the rest
    no longer.
    """
    rng = np.random.default_rng(23)
    for number in range(60):
        tour = make_tour(("comb", "hilbert", "spanning-tree")[number % 3], (5, 4))
        tour_cost = TourCost(tour, turn_cost=float(rng.choice([0, 0.5, 2])))
        wanted, here, fresh = (
            int(rng.integers(1, 1 << 20)),
            int(rng.integers(20)),
            bool(rng.integers(2)),
        )
        whole = cost_of_all(tour_cost, wanted, here, fresh)
        for cell in members(wanted):
            assert cost_of_all(tour_cost, wanted & ~(1 << cell), here, fresh) <= whole + 1e-9


def test_stay_is_the_largest_gap():
    tour_cost = TourCost(make_tour("moore", (8, 8)))
    found = allocate(tour_cost, [3, 10, 50], allocator="stay")
    assert found.times.tolist() == [7, 40, 17]
    assert found.arcs[1] == (Arc(10, 40),)
    double = allocate(tour_cost, [10, 10, 50], allocator="stay")
    assert [len(arcs) for arcs in double.arcs] == [0, 1, 1]  # of two in a cell one is in reserve


def test_faster_robots_search_more():
    tour_cost = TourCost(make_tour("moore", (16, 16)))
    found = allocate(tour_cost, [0, 64, 128, 192], allocator="hop", rates=[1, 1, 1, 3])
    counts = [sum(arc.count for arc in arcs) for arcs in found.arcs]
    assert counts[3] > 2 * max(counts[:3])
    assert 256 / 6 <= found.makespan < 1.35 * 256 / 6


def test_turns_cost():
    straight, bent = (
        TourCost(make_tour("comb", (8, 8))),
        TourCost(make_tour("comb", (8, 8)), turn_cost=1.0),
    )
    assert straight.whole == 64
    assert bent.whole == 64 + bent.turns.sum()
    assert bent.turns.sum() == make_tour("comb", (8, 8)).metrics().turns


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda c: allocate(c, []), "starts: expected one or more numbers"),
        (lambda c: allocate(c, [16]), "starts: expected one or more numbers of cells from 0 to 15"),
        (lambda c: allocate(c, [1.5]), "starts"),
        (lambda c: allocate(c, [1], rates=[0]), "rates: expected 1 speeds above 0"),
        (lambda c: allocate(c, [1, 2], places=[[0, 0]]), "places: expected 2 points of 2 numbers"),
        (lambda c: TourCost(c.tour, turn_cost=-1), "turn cost"),
        (lambda c: TourCost(c.tour, np.zeros((3, 2))), "points: expected finite numbers of shape"),
        (lambda c: Scenario(Brief(c), ()), "starts: expected one or more cells"),
        (lambda c: Scenario(Brief(c), (0,), (0.0,)), "rates: expected 1 speeds"),
        (
            lambda c: Scenario(Brief(c), (0,), faults=(Crash(2, 1.0),)),
            "fault: expected a robot from 1 to 1",
        ),
        (lambda c: network_of("loud:3"), "network: expected perfect or some of"),
        (lambda c: network_of("loss:2"), "network"),
        (lambda c: network_of("bursts:0.5"), "network"),
        (lambda c: network_of(loss=1.5), "loss: expected a probability"),
        (
            lambda c: search("square:100", robots=2, faults="crash:3@1"),
            "faults: expected a robot from 1 to 2",
        ),
        (
            lambda c: check_faults(["crash:1@x"]),
            "faults: expected crash:ROBOT@TIME, got 'crash:1@x'",
        ),
        (
            lambda c: planned("square:100", robots=0, footprint=10),
            "robots: expected a whole number",
        ),
        (
            lambda c: planned("square:40", robots=10_000, footprint=8),
            "robots: expected a whole number from 1 to 1000, got 10000",
        ),
        (
            lambda c: planned("square:40", robots=1, footprint=1e308),
            r"footprint: expected a number, above 0 and at most 1e\+100",
        ),
        (
            lambda c: search("square:40", robots=127, footprint=8, loss=0.1),
            "expected a simulation, .* got 25 cells and 127 robots",
        ),
        (
            lambda c: planned("square:100", robots=2, footprint=10, starts=[(0, 0)]),
            "starts: expected 2 points",
        ),
        (lambda c: planned("square:100", robots=1, footprint=10, starts=[(999, 0)]), "starts"),
        (
            lambda c: planned("square:100", robots=1, footprint=10, starts="no.csv"),
            "no.csv: expected a table of start positions",
        ),
        (
            lambda c: search("square:100", robots=1, footprint=10, multiplicity=0),
            "multiplicity: expected a whole number, 1 or more",
        ),
        (
            lambda c: search("square:100", robots=1, vehicle="ideal,cruise_speed=-1"),
            "cruise_speed: expected a number, above 0",
        ),
        (
            lambda c: search("square:100", robots=1, footprint=10, detection=2),
            "detection: expected a number from 0 to 1",
        ),
        (
            lambda c: search("square:100", robots=1, footprint=10, targets=1000),
            "targets: expected a number from 0 to 100",
        ),
        (
            lambda c: search("square:100", robots=1, footprint=10, loss=0.5, simulate=False),
            "loss or a network: expected a sim",
        ),
    ],
)
def test_bad_input_is_refused_in_a_sentence(call, words):
    with pytest.raises(InvalidInputError, match=words) as caught:
        call(TourCost(make_tour("moore", (4, 4))))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("field", "suffix", "expected"),
    [
        ("launch", ".csv", "a table of launch points"),
        ("launch", ".geojson", "a file of launch points"),
        ("land", ".csv", "a table of landing points"),
        ("starts", ".geojson", "a file of start positions"),
        ("along", ".csv", "a table of the points of a line"),
        ("along", ".wkt", "a file of the points of a line"),
        ("searched", ".csv", "a table of the points of a track"),
        ("searched", ".gpx", "a GPX file with a line or a track"),
        ("targets", ".csv", "a table of targets"),
    ],
)
def test_a_missing_file_is_told_by_what_it_contains(field, suffix, expected):
    with pytest.raises(InvalidInputError, match=f"no{suffix}: expected {expected}, got no such"):
        search("square:100", robots=2, footprint=10, **{field: f"no{suffix}"})


def test_unknown_names_are_refused():
    with pytest.raises(UnknownNameError, match="hop"):
        allocate(TourCost(make_tour("moore", (4, 4))), [0], allocator="hopp")


def test_bits_against_sets():
    rng = np.random.default_rng(8)
    for _ in range(200):
        n = int(rng.integers(1, 90))
        cells = set(rng.integers(0, n, size=rng.integers(0, n + 1)).tolist())
        bits, first = sum(1 << cell for cell in cells), int(rng.integers(n))
        count = int(rng.integers(0, n + 1))
        assert set(members(bits)) == cells
        assert set(members(arc_bits(first, count, n))) == {(first + k) % n for k in range(count)}
        order = [(first + k) % n for k in range(n)]
        assert next_in(bits, first, n) == next((cell for cell in order if cell in cells), None)
        stretches = list(runs(bits, first, n))
        assert [(start + k) % n for start, length in stretches for k in range(length)] == [
            c for c in order if c in cells
        ]
        assert set(members(rotate_bits(bits, first, n))) == {(cell - first) % n for cell in cells}
        sets = [int(rng.integers(0, 1 << min(n, 60))) for _ in range(4)]
        for k in (1, 2, 3):
            assert set(members(at_least(sets, k))) == {
                c for c in range(n) if sum(one >> c & 1 for one in sets) >= k
            }
        for arc in (Arc(first, max(count, 1)), Arc(first, max(count, 1), -1)):
            way = [(first + arc.step * k) % n for k in range(arc.count)]
            assert arc.next_of(bits, n) == next((cell for cell in way if cell in cells), None)


def test_a_robot_alone_searches_everything_in_the_time_of_one_round():
    tour_cost = TourCost(make_tour("moore", (8, 8)))
    outcome = SearchWorld(Scenario(Brief(tour_cost), (5,))).run()
    assert outcome.covered_at == 65.0  # one for listening
    assert outcome.declared == {1: 65.0}


def test_a_step_of_the_robot_does_not_change_its_state():
    robot = Robot(1, Brief(TourCost(make_tour("moore", (4, 4)))), start=2)
    before = dict(robot.__dict__)
    for event in (
        Begin(0.0),
        Heard(0.0, Beacon(2, (Heartbeat(2, 1, 9, 1.0, "listening"),), ((2, 1),))),
        Wake(1.0),
    ):
        advance(robot, event)
        assert robot.__dict__ == before


def test_a_robot_takes_over_from_a_silent_one():
    tour_cost = TourCost(make_tour("moore", (4, 4)))
    robot, _ = advance(Robot(1, Brief(tour_cost, "stay"), start=0), Begin(0.0))
    robot, _ = advance(robot, Heard(0.5, Beacon(2, (Heartbeat(2, 1, 2, 1.0, "listening"),), ())))
    robot, actions = advance(robot, Wake(1.0))
    assert Go(0) in actions
    robot, actions = advance(robot, Sensed(2.0, 0))
    robot, actions = advance(robot, Sensed(3.0, 1))
    assert Go(2) in actions  # it has heard of no progress: waiting would cost more than a round
    assert any(isinstance(action, WakeAt) for action in actions)


def test_a_blocked_robot_goes_elsewhere_and_comes_back():
    tour_cost = TourCost(make_tour("moore", (2, 2)))
    robot, _ = advance(Robot(1, Brief(tour_cost), start=0), Begin(0.0))
    robot, actions = advance(robot, Wake(1.0))
    assert actions[0] == Go(0)
    robot, actions = advance(robot, Blocked(3.0, 0))
    order = []
    time = 3.0
    while not any(isinstance(action, Declare) for action in actions):
        go = next(action for action in actions if isinstance(action, Go))
        order.append(go.cell)
        time += 1.0
        robot, actions = advance(robot, Sensed(time, go.cell))
    assert order == [1, 2, 3, 0]
    assert any(isinstance(action, Send) for action in actions)


def test_a_search_from_plan_to_file(tmp_path):
    faults = [
        Crash(2, 20.0),
        Pause(3, 5, 40),
        Slow(4, 1.5),
        Battery(5, 60.0),
        WrongPosition(6, 3),
        Liar(1),
    ]
    episode = search(
        "ring:120x80",
        robots=7,
        footprint=10,
        loss=0.3,
        faults=faults,
        targets=5,
        multiplicity=2,
        seed=3,
        network="delay:0.5",
    )
    assert episode
    assert episode.coverage.covered_fraction == pytest.approx(1.0)
    assert episode.coverage.outside_m == 0
    report = episode.report()
    assert json.loads(json.dumps(report)) == report
    assert report["routes"][1]["status"] == "dead"
    told = {(finding["x"], finding["y"]) for finding in report["findings"]}
    assert {
        tuple((episode.plan.tour_cost.points[cell] * 10).tolist())
        for cell in episode.scenario.targets
    } <= told
    path = tmp_path / "episode.json"
    episode.save(path)
    again = SearchEpisode.load(path)
    assert again.verify()
    assert again.report() | {"seconds": 0} == report | {"seconds": 0}
    data = json.loads(path.read_text())
    data["trace"]["robots"][0]["cells"][0] += 1
    path.write_text(json.dumps(data))
    assert not SearchEpisode.load(path).verify()
    for damage in ('{"format": 1}', "{", ""):
        path.write_text(damage)
        with pytest.raises(InvalidInputError, match="episode"):
            SearchEpisode.load(path)


def test_findings_weigh_who_has_seen_what():
    episode = search(
        "square:100",
        robots=3,
        footprint=10,
        targets=3,
        multiplicity=3,
        detection=0.7,
        false_alarm=0.02,
        seed=1,
    )
    assert episode
    for finding in episode.findings:
        assert set(finding.found_by) | set(finding.missed_by) == {1, 2, 3}
    sure = {len(finding.found_by): finding.confidence for finding in episode.findings}
    assert all(sure[many] > sure[few] for many in sure for few in sure if many > few)


def test_robots_with_little_energy_come_home_in_between():
    episode = search(
        "circle:60",
        robots=3,
        footprint=10,
        vehicle=f"ideal,endurance={250 / 60},reserve=0,recharge={20 / 60}",
        seed=2,
    )
    assert episode
    for robot, route in enumerate(episode.routes):
        assert len(episode.trace.robots[robot].cells)
        assert route.length > 0
    assert episode.trace.covered_at > episode.plan.allocation.makespan


def test_parts_of_a_region_need_robots_that_fly():
    from shapely import box, union_all

    from shoal.search import region_of

    region = region_of(union_all([box(0, 0, 50, 50), box(100, 0, 150, 50)]))
    with pytest.raises(InvalidInputError, match="expected one part"):
        planned(region, robots=2, footprint=10)
    episode = search(region, robots=2, footprint=10, transit=True, seed=1)
    assert episode
    assert episode.coverage.covered_fraction == pytest.approx(1.0)


def test_starts_from_a_file(tmp_path):
    table = tmp_path / "starts.csv"
    table.write_text("x,y\n20,20\n 20 , 80\n")
    plan = planned("square:100", robots=2, footprint=10, starts=table)
    assert plan.places.tolist() == [[20, 20], [20, 80]]
    table.write_text("x,y\n1,2\n3\n")
    with pytest.raises(
        InvalidInputError,
        match=r"starts.csv: line 3: expected 2 columns, as the heading has, got '3' \(1 column\)$",
    ):
        planned("square:100", robots=2, footprint=10, starts=table)


def test_a_plan_without_a_simulation():
    plan = planned("square:300", robots=5, footprint=10, seed=4, vehicle="ideal,turn_time=5")
    one = search(
        "square:300", robots=5, footprint=10, seed=4, vehicle="ideal,turn_time=5", simulate=False
    )
    assert not one.simulated
    assert one.trace.covered_at == plan.allocation.makespan
    ends = [float(log.times[-1]) for log in one.trace.robots]
    assert ends == pytest.approx(plan.allocation.times.tolist())
    assert one.coverage.covered_fraction == pytest.approx(1.0)


def test_nothing_is_lost_on_a_perfect_network():
    tour_cost = TourCost(make_tour("moore", (8, 8)))
    outcome = SearchWorld(Scenario(Brief(tour_cost), (0, 20, 40), network=RadioNetwork())).run()
    assert outcome.air.lost == 0
    assert outcome.takeovers == 0
    assert outcome.covered_at < inf


def corridor(obstacles, *, starts=(0,), multiplicity=1, **more):
    """Return a scenario in which robots go from cell to cell: rows of 5, a comb tour, (row, col) as
    numbers on it.
    """
    tour = make_tour("comb", (4, 5))
    tour_cost = TourCost(tour, distances=CellDistances(tour))
    cells = tuple(int(tour.position[cell]) for cell in obstacles)
    return tour, Scenario(
        Brief(tour_cost, multiplicity=multiplicity), starts, obstacles=cells, **more
    )


def test_an_obstacle_is_met_told_and_gone_round():
    _, scenario = corridor([(1, 2), (2, 2)], starts=(0, 9))
    world = SearchWorld(scenario, check=Checker(scenario))
    outcome = world.run(until=1e4)
    check_outcome(scenario, outcome)
    assert outcome.covered == scenario.brief.everything & ~scenario.blocked
    assert set(outcome.declared) == {1, 2}
    for vehicle in outcome.vehicles.values():
        assert {cell for _, cell in vehicle.obstructed} <= set(scenario.obstacles)
        # each knows both
        assert at_least(list(vehicle.robot.closed.values()), 1) == scenario.blocked
    met = [cell for vehicle in outcome.vehicles.values() for _, cell in vehicle.obstructed]
    assert sorted(set(met)) == sorted(scenario.obstacles)


def test_what_is_walled_in_is_left_out_and_not_declared_searched():
    _, scenario = corridor([(0, 3), (1, 3), (1, 4)], starts=(0,))
    outcome = SearchWorld(scenario, check=Checker(scenario)).run(until=1e4)
    walled = scenario.brief.everything & ~scenario.blocked & ~scenario.reach(1)
    assert walled.bit_count() == 1
    assert outcome.covered == scenario.reach(1)
    assert 1 in outcome.declared


def test_nobody_cuts_the_corner_of_an_obstacle():
    tour, scenario = corridor([(1, 1), (2, 2)], starts=(0,))
    distances = scenario.brief.tour_cost.distances
    here, cell = int(tour.position[1, 2]), int(tour.position[2, 1])
    assert scenario.obstacle_on(here, (cell,)) == (int(tour.position[1, 1]), 0)
    assert distances.length(here, cell) == pytest.approx(2**0.5)
    assert distances.length(here, cell, scenario.blocked) > 2


def test_a_robot_with_little_energy_comes_home_round_obstacles():
    tour = make_tour("comb", (4, 5))
    brief = Brief(TourCost(tour, distances=CellDistances(tour)), energy=24.0, recharge=2.0)
    scenario = Scenario(brief, (0,), obstacles=(int(tour.position[1, 2]), int(tour.position[2, 2])))
    outcome = SearchWorld(scenario, check=Checker(scenario)).run(until=1e4)
    check_outcome(scenario, outcome)
    assert outcome.vehicles[1].alive
    assert outcome.vehicles[1].travelled > 24.0  # it has recharged
    assert outcome.covered_at < inf


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"obstacles": (0,)}, "no obstacle at the start of a robot"),
        ({"obstacles": (99,)}, "expected cells from 0 to 19"),
        ({"obstacles": (3,), "faults": (WrongPosition(1, 2),)}, "no wrong positions"),
    ],
)
def test_bad_obstacles(more, message):
    tour = make_tour("comb", (4, 5))
    with pytest.raises(InvalidInputError, match=message):
        Scenario(Brief(TourCost(tour, distances=CellDistances(tour))), (0,), **more)
    with pytest.raises(InvalidInputError, match="paths from cell to cell"):
        Scenario(Brief(TourCost(tour)), (0,), obstacles=(3,))


def test_a_search_with_obstacles_is_saved_and_verified(tmp_path):
    points = tmp_path / "obstacles.csv"
    points.write_text("x,y\n25,35\n35,35\n35,45\n")
    episode = search("square:100", robots=3, footprint=10, obstacles=points, seed=4, loss=0.3)
    assert episode
    assert len(episode.obstacles) == 3
    assert 0 < episode.coverage.uncovered_m2 <= 300
    assert episode.coverage.outside_m == 0
    inside = shapely.union_all([shapely.box(20, 30, 30, 40), shapely.box(30, 30, 40, 50)]).buffer(
        -1e-6
    )
    assert not any(
        shapely.LineString(route.points).intersects(inside)
        for route in episode.routes
        if len(route.points) > 1
    )
    episode.save(tmp_path / "e.json")
    assert SearchEpisode.load(tmp_path / "e.json").verify()
    with pytest.raises(InvalidInputError, match="no obstacle at the start of a robot"):
        search("square:20", robots=1, footprint=10, obstacles=4)


@pytest.mark.parametrize("seed", [4, 7])
def test_no_way_home_leads_through_obstacles(seed):
    """With these seeds a robot has come across a corner, and knew no way back through the cells
    that it had been in.
    """
    episode = search(
        "square:100",
        robots=3,
        footprint=10,
        loss=0.3,
        seed=seed,
        vehicle=f"ideal,endurance={260 / 60},reserve=0",
        obstacles=6,
    )
    rows, cols = episode.plan.tour.cells[[*episode.scenario.obstacles]].T
    inside = shapely.union_all(
        shapely.box(10 * cols, 90 - 10 * rows, 10 * cols + 10, 100 - 10 * rows)
    ).buffer(-1e-6)
    assert episode
    assert not any(shapely.LineString(route.points).intersects(inside) for route in episode.routes)


def test_a_scenario_can_be_simulated_again():
    """Bursts once kept their bad links from one simulation to the next."""
    brief = Brief(TourCost(make_tour("moore", (4, 4))))
    scenario = Scenario(brief, (0, 5), network=network_of("bursts:0.5:0.1"), seed=3)
    worlds = [SearchWorld(scenario) for _ in range(2)]
    for world in worlds:
        world.run()
    assert 0 < worlds[0].air.lost == worlds[1].air.lost
    assert worlds[0].air.sent == worlds[1].air.sent


def test_parts_are_shared_by_the_ways_that_robots_go():
    yard = open_region("rectangle:200x100", no_go=[[(99, 0), (101, 0), (101, 90), (99, 90)]])
    plan = planned(yard, robots=6, footprint=10, allocation="hop", starts="clustered", seed=1)
    straight = TourCost(
        plan.tour,
        plan.tour_cost.points,
        steps=plan.tour_cost.steps,
        distances=plan.tour_cost.distances,
    )
    found = {}
    for tour_cost in (plan.tour_cost, straight):
        given = allocate(tour_cost, plan.starts, places=plan.places / 10)
        found[tour_cost] = max(
            plan.route(robot, plan.numbers(arcs)[:1]).length / 10
            + tour_cost.search_cost(arcs[0].first, arcs[0].count)
            for robot, arcs in enumerate(given.arcs)
            if arcs
        )
    # what is planned is what it takes
    assert found[plan.tour_cost] == pytest.approx(plan.allocation.makespan, rel=0.02)
    assert found[plan.tour_cost] < 0.98 * found[straight]


def test_two_robots_share_the_part_of_a_dead_one():
    tour = make_tour("moore", (8, 8))
    scenario = Scenario(Brief(TourCost(tour), "stay"), (0, 20, 21), faults=(Crash(1, 0.0),))
    outcome = SearchWorld(scenario, check=Checker(scenario)).run(until=1e4)
    check_outcome(scenario, outcome)
    whose = {
        number: {cell for _, cell in vehicle.visits} for number, vehicle in outcome.vehicles.items()
    }
    assert len(whose[2] & set(range(20))) > 4  # from behind
    assert len(whose[3] & set(range(20))) > 4


def test_ways_round_a_hole_are_as_long_as_those_that_robots_take():
    plan = planned("ring:200x150", robots=2, footprint=10)
    rng = np.random.default_rng(5)
    for here, cell in rng.integers(0, len(plan.tour_cost), size=(25, 2)).tolist():
        ends = plan.tour_cost.points[[here, cell]] * plan.grid.size
        exact = plan.paths.legs(ends).length / plan.grid.size
        # the path that is flown is a little longer than the shortest, for fewer bends
        assert exact - 0.85 <= plan.tour_cost.length(here, cell) <= 1.06 * exact + 1e-9


def test_takeovers_of_live_robots_are_counted_from_what_they_searched():
    tour = make_tour("moore", (4, 4))
    scenario = Scenario(Brief(TourCost(tour), "stay"), (0, 4, 10))
    rows = (
        [(1.0, 0), (2.0, 1)],
        [(1.0, k) for k in range(4, 10)],
        [(1.0, k) for k in range(10, 16)] + [(9.0, 2), (10.0, 3), (11.0, 4)],
    )
    dead = ((3.0, "dead"),)
    logs = [
        RobotLog(
            np.array([cell for _, cell in row]),
            np.array([time for time, _ in row]),
            dead if k == 0 else (),
            (),
        )
        for k, row in enumerate(rows)
    ]
    assert takeovers_of(scenario, logs) == 1  # cells 2 and 3 at one go; cell 4 was a live robot's


def test_time_and_bound_of_a_search_in_two_passes_are_those_of_both():
    """A multiplicity of 2 once had the time, the bound and the completeness of one pass."""
    once, twice = (
        search("square:100", robots=4, footprint=10, starts="line", multiplicity=k) for k in (1, 2)
    )
    assert twice.metrics["lower_bound"] == 2 * once.metrics["lower_bound"] == 500.0
    assert twice.makespan >= twice.metrics["lower_bound"]
    assert twice.metrics["planned"] > 1.8 * once.metrics["planned"]
    assert twice.status == "complete"
    assert "by 2 robots" in twice.reason
    counts = np.bincount(
        np.concatenate([np.unique(log.cells) for log in twice.trace.robots]), minlength=100
    )
    assert (counts >= 2).all()
    planned = np.bincount(
        np.concatenate([np.unique(twice.plan.stops(robot)) for robot in range(4)]), minlength=100
    )
    assert (planned == 2).all()
    assert twice.verify()


def test_a_pass_that_is_missed_is_not_complete():
    episode = search("square:60", robots=2, footprint=10, multiplicity=2, faults=["crash:2@3"])
    assert episode.status == "incomplete"
    assert episode.makespan is None
    assert (
        "of 36 cells that robots can reach were searched by fewer than 2 robots" in episode.reason
    )
    with pytest.raises(
        InvalidInputError, match="multiplicity: expected at most 2, the number of robots, got 3"
    ):
        search("square:60", robots=2, multiplicity=3)


@pytest.mark.parametrize(
    ("region", "given"),
    [
        ("square:100", {"footprint": 60, "vehicle": "rover"}),
        ("square:12", {"footprint": 25, "vehicle": "rover"}),
        ("square:12", {"footprint": 25, "vehicle": "fixed-wing"}),
        ("square:30", {"footprint": (10, 30), "robots": 2}),
        ("square:33", {"footprint": 10, "vehicle": "multirotor,wind_speed=3", "robots": 2}),
        ("box:25x25x20", {"footprint": 20}),
        ("square:40", {"footprint": 30, "vehicle": "rover", "multiplicity": 2, "robots": 2}),
    ],
)
def test_no_plan_takes_less_than_the_bound(region, given):
    """The bound was once a time for each cell, also for cells that lie closer or need no path."""
    report = search(region, seed=1, **({"robots": 1} | given)).report()
    assert 0 <= report["lower_bound_s"] <= report["planned_s"] + 1e-9
    assert report["lower_bound_s"] <= report["makespan_s"] + 1e-9
    assert 0 <= report["lower_bound_cells"] <= report["planned_cells"] + 1e-9


@pytest.mark.parametrize("region", ["square:60", "square:25", "ring:50x40"])
@pytest.mark.parametrize("vehicle", [None, "rover"])
def test_the_bound_holds_for_other_angles_and_tours(region, vehicle):
    plans = [
        planned(region, robots=1, footprint=10, vehicle=vehicle, angle=angle, tour=tour)
        for angle in (0, 30, 45)
        for tour in ("comb", "spanning-tree")
    ]
    assert max(plan.least_seconds for plan in plans) <= min(plan.planned_seconds for plan in plans)
    assert min(plan.least_seconds for plan in plans) > 0
