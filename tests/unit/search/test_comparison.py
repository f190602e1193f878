"""Plans side by side: shoal search --compare."""

import json

import numpy as np
import pytest

from shoal.cli import run
from shoal.search import SearchProblem, compare_plans, plan_search
from shoal.search.allocation.allocate import ALLOCATORS
from shoal.search.planning.comparison import ways_of
from shoal.search.tours import TOURS


def test_each_tour_with_each_allocation_from_the_same_starts():
    problem = SearchProblem(
        "ring:60x40", robots=3, footprint=12, angle="auto", vehicle="multirotor"
    )
    found = compare_plans(problem, seed=1)
    assert {(one.plan.tour.name, one.plan.allocation.allocator) for one in found} == {
        (tour, allocation) for tour in TOURS for allocation in ALLOCATORS
    }
    assert all((one.plan.places == found[0].plan.places).all() for one in found)
    assert [one.price for one in found] == sorted(one.price for one in found)
    for one in found:
        lengths = [float(np.hypot(*np.diff(way, axis=0).T).sum()) for _, way in ways_of(one.plan)]
        assert one.length == pytest.approx(sum(lengths))
        assert one.seconds == one.plan.planned_seconds
        assert 1 / 3 <= one.evenness <= 1 + 1e-9
        for robot, way in ways_of(one.plan):  # out and home
            np.testing.assert_allclose(way[[0, -1]], one.plan.places[[robot, robot]], atol=1e-6)
    # what the planner takes is none of the worse ones
    fixed = problem.replaced(starts=[tuple(place) for place in found[0].plan.places.tolist()])
    chosen = plan_search(fixed.at_place(problem.place), seed=1)
    assert chosen.planned_seconds <= 1.05 * found[0].seconds


def test_without_a_vehicle_only_the_search_counts_and_a_named_tour_is_the_only_one():
    found = compare_plans(SearchProblem("square:80", robots=2, tour="comb", passes=2), seed=3)
    assert {one.plan.tour.name for one in found} == {"comb"}
    assert found[0].seconds <= min(one.seconds for one in found) * 1.2
    one = compare_plans(SearchProblem("square:80", tour="strips", allocation="loop"), seed=3)
    assert len(one) == 1


def test_the_command_prints_and_draws(tmp_path, capsys):
    given = ["search", "rectangle:90x60", "--robots", "2", "--compare", "--tour", "strips"]
    assert run([*given, "--json", "--out", str(tmp_path / "found")]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert len(printed["compared"]) == len(tuple(ALLOCATORS))
    assert set(printed["compared"][0]) == {
        "tour",
        "allocation",
        "angle_degrees",
        "time_s",
        "turns",
        "length_m",
        "evenness",
        "refusal",
    }
    names = sorted(path.name for path in (tmp_path / "found").iterdir())
    assert names == ["comparison.png", "summary.json"]
    assert run(given) == 0
    shown = capsys.readouterr().out
    assert "evenness" in shown
    assert "either-end" in shown


@pytest.mark.parametrize(
    "more", [["--missions", "m"], ["--film", "a.html"], ["--live", "5"], ["--format", "kml"]]
)
def test_a_comparison_flies_nothing(more, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(["search", "square:50", "--compare", *more]) == 2
    assert f"--compare: expected no {more[0]}" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
