"""Robots whose footprints differ: what each sees, where it stops, and that all is seen whoever
dies.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
from tests.properties.search_invariants import Checker, InvariantError
from tests.properties.search_scenarios import random_scenario
from tests.search_episodes import planned, search

from shoal.cli import run
from shoal.missions import check_missions
from shoal.search import SearchEpisode, TourCost, cells_of, coverage_check, make_tour, open_region
from shoal.search.allocation.viewpoints import gain_of, select_viewpoints
from shoal.search.cells.footprint import MaskFootprint, RegionFootprint, cell_side, widths_of
from shoal.search.problem.network import Crash, Liar
from shoal.search.simulation.world import SearchWorld
from shoal.search.tours.masks import at_least, bitset_of

TEAM = [2.0, 2.0, 6.0]


def test_a_robot_that_claims_what_it_does_not_see_is_found(monkeypatch):
    """Planted: the robot tells of all cells around, but in truth it sees only the one in which it
    stands.
    """
    true = SearchWorld._do_sense

    def sense(world, vehicle, cell):
        with monkeypatch.context() as patch:
            patch.setattr(
                type(world.scenario), "visible_cells", lambda scenario, number, one: 1 << one
            )
            true(world, vehicle, cell)

    monkeypatch.setattr(SearchWorld, "_do_sense", sense)
    scenario = next(
        one for one in (random_scenario(seed, wide=True) for seed in range(20)) if 3 in one.widths
    )
    world = SearchWorld(scenario, check=Checker(scenario))
    with pytest.raises(InvariantError, match="has searched what it has not"):
        world.run(until=1000)


def test_what_is_behind_a_wall_is_not_seen():
    walled = open_region("rectangle:50x50", no_go=[[(19, 0), (21, 0), (21, 45), (19, 45)]])
    plan = planned(walled, robots=1, footprint=10)
    footprint = RegionFootprint(plan.grid, plan.tour)
    middle, beyond = (int(plan.tour.position[3, col]) for col in (1, 2))
    seen = footprint.visible_cells(middle, 3).tolist()
    assert middle in seen
    assert beyond not in seen
    assert len(seen) == 6
    open_tour = make_tour("comb", (6, 6))
    assert len(MaskFootprint(open_tour).visible_cells(int(open_tour.position[3, 3]), 3)) == 9


def test_in_a_ring_the_cells_on_a_curved_border_are_seen_from_beside():
    grid = cells_of(open_region("ring:30x20"), 2)
    tour = make_tour("spanning-tree", grid.mask)
    footprint = RegionFootprint(grid, tour)
    assert np.mean([len(footprint.visible_cells(cell, 3)) for cell in range(len(tour))]) > 7


@pytest.mark.parametrize("region", ["ring:40x25", "rectangle:80x46"])
@pytest.mark.parametrize("tour", ["spanning-tree", "hilbert-rectangle"])
def test_from_where_robots_stop_everything_is_seen(region, tour):
    """The independent check, with each robot's own footprint, and only from its stops: nothing on
    the way counts.
    """
    plan = planned(region, robots=3, footprint=TEAM, tour=tour, seed=2)
    index = plan.grid.ordinals(plan.tour.cells)
    places, sides = [], []
    for robot, side in enumerate(TEAM):
        for stop in index[plan.stops(robot)]:
            own = plan.grid.viewpoints[
                plan.grid.viewpoint_starts[stop] : plan.grid.viewpoint_starts[stop + 1]
            ]
            places += [[point] for point in own]
            sides += [side] * len(own)
    assert coverage_check(plan.grid.region, places, sides).covered_fraction > 0.9999999
    # it is the wide footprint that does it
    assert coverage_check(plan.grid.region, places, 2.0).covered_fraction < 0.8


def test_a_wide_footprint_saves_time():
    times = {
        side: search("rectangle:80x46", robots=3, footprint=[2, 2, side], seed=1).trace.covered_at
        for side in (2, 6)
    }
    assert times[6] < 0.85 * times[2]


@pytest.mark.parametrize("dead", [1, 3])
def test_whoever_dies_another_footprint_takes_over(dead, tmp_path):
    episode = search(
        "rectangle:60x40",
        robots=3,
        footprint=TEAM,
        seed=1,
        loss=0.3,
        faults=[Crash(dead, 40.0)],
        targets=4,
    )
    assert episode
    assert episode.trace.takeovers
    assert episode.coverage.covered_fraction == pytest.approx(1)
    assert len(episode.findings) == 4
    episode.save(tmp_path / "episode.json")
    again = SearchEpisode.load(tmp_path / "episode.json")
    assert again.verify()
    assert again.plan.footprints.tolist() == TEAM
    routes = again.report()["routes"]
    assert routes[2]["footprint_m"] == 6
    assert routes[2]["cells"] > 2 * routes[2]["stops"]


def test_each_cell_is_seen_by_two_and_one_that_lies_is_outvoted():
    episode = search(
        "rectangle:40x30",
        robots=4,
        footprint=[2, 2, 6, 6],
        seed=3,
        multiplicity=2,
        faults=[Liar(3)],
    )
    assert episode
    seen = [
        bitset_of(int(cell) for cells in robot for cell in cells) for robot in episode.visible_cells
    ]
    everything = episode.scenario.brief.everything
    assert at_least(seen, 2) == everything
    assert at_least([seen[robot] for robot in (0, 1, 3)], 1) == everything


def test_sizes_of_cells_and_widths():
    assert cell_side([5.0, 5.0], [1.0, 2.0]) == 5.0
    assert cell_side([2.0, 6.0], [1.0, 1.0]) == 2.0
    assert cell_side([2.0, 4.0], [1.0, 1.0]) == pytest.approx(4 / 3)
    assert cell_side([2.0] * 9 + [4.0], [1.0] * 10) == 2.0  # not for the sake of one
    assert widths_of([1.0, 3.0, 4.9, 5.0, 1e6], 1.0).tolist() == [1, 3, 3, 5, 99]


@pytest.mark.parametrize("tour", ["comb", "spanning-tree", "hilbert-rectangle"])
def test_gains(tour):
    tour_cost = TourCost(make_tour(tour, (24, 24)))
    assert 1.7 < gain_of(tour_cost, 3) < 3
    assert 2.5 < gain_of(tour_cost, 5) < 5
    stops, cost = select_viewpoints(tour_cost, 5, np.arange(200))
    assert set(range(200)) <= {
        int(cell) for stop in stops for cell in tour_cost.visible_cells(int(stop), 5)
    }
    assert cost < 120


def test_missions_are_checked_with_each_robots_own_footprint(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    arguments = [
        "rectangle:60x40",
        "--robots",
        "3",
        "--footprint",
        "2,2,6",
        "--missions",
        "missions",
        "--format",
        "csv",
    ]
    assert run(["search", *arguments, "--json"]) == 0
    check = ["missions", "check", "missions", "rectangle:60x40", "--json", "--footprint"]
    capsys.readouterr()
    assert run([*check, "2,2,6"]) == 0
    assert json.loads(capsys.readouterr().out)["footprint_m"] == [2, 2, 6]
    assert run([*check, "2"]) == 1
    assert run([*check, "2,2"]) == 2
    assert (
        "robot-03.csv: expected a robot from 1 to 2, the number of footprints, got robot 3"
        in capsys.readouterr().err
    )
    assert check_missions(
        "missions", open_region("rectangle:60x40"), TEAM
    ).coverage.covered_fraction == pytest.approx(1)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--footprint 2,6", "footprint: expected one length, or 3, one per robot, got 2"),
        (
            "--footprint 2,2,x",
            "--footprint: expected numbers separated by commas, one per robot, got '2,2,x'",
        ),
        ("--footprint 2,2,0", "footprint: expected a number, above 0 and at most 1e+100, got 0.0"),
        (
            "--footprint 2,2,nan",
            "footprint: expected a number, above 0 and at most 1e+100, got nan",
        ),
    ],
)
def test_bad_footprints(words, said, capsys):
    assert run(["search", "square:100", "--robots", "3", *words.split()]) == 2
    assert said in capsys.readouterr().err
