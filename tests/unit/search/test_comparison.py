"""Plans side by side: shoal search --compare."""

import json

import numpy as np
import pytest

from shoal.cli import run
from shoal.search import SearchProblem, compare_plans, plan_search
from shoal.search.allocation.allocate import ALLOCATORS
from shoal.search.planning.comparison import routes_of
from shoal.search.planning.patterns import PATTERNS, pattern_plans
from shoal.search.problem import AUTO_TOURS
from shoal.search.tours import TOURS


def test_each_tour_with_each_allocation_from_the_same_starts():
    problem = SearchProblem(
        "ring:60x40", robots=3, footprint=12, angle="auto", vehicle="multirotor"
    )
    found = compare_plans(problem, seed=1)
    assert {one.names for one in found} == {
        (tour, allocation) for tour in TOURS for allocation in ALLOCATORS
    } | {(pattern, "pattern") for pattern in PATTERNS}
    assert all((one.plan.places == found[0].plan.places).all() for one in found)
    ranks = [(one.share < 1, one.price) for one in found]
    assert ranks == sorted(ranks)
    for one in found:
        lengths = [float(np.hypot(*np.diff(way, axis=0).T).sum()) for _, way in routes_of(one.plan)]
        assert one.length == pytest.approx(sum(lengths))
        assert one.seconds == one.plan.planned_seconds
        assert 1 / 3 <= one.evenness <= 1 + 1e-9
        for robot, way in routes_of(one.plan):  # out and home
            np.testing.assert_allclose(way[[0, -1]], one.plan.places[[robot, robot]], atol=1e-6)
    # the planner takes the best of the tours that it tries, from the same starts
    chosen = plan_search(problem, seed=1)
    np.testing.assert_array_equal(chosen.places, found[0].plan.places)
    best = next(one for one in found if one.pattern is None and one.names[0] in AUTO_TOURS)
    assert best.names == (chosen.tour.name, chosen.allocation.allocator)
    assert best.seconds == chosen.planned_seconds


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
        "pattern",
        "by_prior",
        "searched_fraction",
        "expected_find_s",
        "success",
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
    "more",
    [
        ["--missions", "m"],
        ["--film", "a.html"],
        ["--live", "5"],
        ["--format", "kml"],
        ["--faults", "crash:1@3"],
        ["--loss", "0.2"],
        ["--targets", "3"],
        ["--crashes", "1"],
        ["--network", "delay:2"],
        ["--simulate"],
    ],
)
def test_a_comparison_flies_nothing(more, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(["search", "square:50", "--compare", *more]) == 2
    assert f"--compare: expected no {more[0]}" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def paths_of(problem):
    """Return the rows and columns of each robot's cells in each pattern, in the order of the search."""
    found = {}
    for name, plan in pattern_plans(problem, 1):
        cells = plan.tour.cells.astype(int)
        work = plan.allocation.work
        found[name] = plan, [cells[plan.numbers(arcs)] for arcs in work]
        seen = np.concatenate([plan.numbers(arcs) for arcs in work])
        assert len(np.unique(seen)) == len(seen)
    return found


def test_patterns_are_those_that_crews_know(tmp_path):
    values = np.ones((8, 12))
    values[3, 6] = 9
    np.save(tmp_path / "likely.npy", values)
    found = paths_of(
        SearchProblem("rectangle:120x80", robots=1, prior=[str(tmp_path / "likely.npy")])
    )
    assert [*found] == [*PATTERNS]
    for name, (plan, (path,)) in found.items():
        steps = np.abs(np.diff(path, axis=0))
        assert (len(path) < 96) == (name == "sector")
        turns = (np.diff(np.diff(path, axis=0), axis=0) != 0).any(axis=1).sum()
        if name == "parallel-track":  # 8 rows of 12 cells, neighbour by neighbour
            assert (steps.sum(axis=1) == 1).all()
            assert turns == 14
        elif name == "creeping-line":
            assert (steps.sum(axis=1) == 1).all()
            assert turns == 22
        elif name == "corridor":  # whole rows, farther and farther out
            rows = path[::12, 0]
            assert (path[:, 0] == np.repeat(rows, 12)).all()
            assert (np.diff(np.abs(rows - 3.5)) >= 0).all()
        elif name == "expanding-square":
            likely = plan.tour.cells[np.argmax(plan.tour_cost.odds)]
            away = np.abs(path - likely).max(axis=1)
            assert (path[0] == likely).all()
            assert (np.maximum.accumulate(away) - away <= 1).all()
        else:
            likely = plan.tour.cells[np.argmax(plan.tour_cost.odds)]
            assert (path[0] == likely).all()
            near = np.abs(path - likely).max(axis=1) <= 1
            assert near.sum() == 9


def test_robots_share_a_pattern_by_their_speeds():
    found = paths_of(SearchProblem("ring:60x30", robots=3, rates=(1, 2, 1)))
    for name, (_, paths) in found.items():
        if name != "sector":
            counts = np.array([len(path) for path in paths])
            assert counts / counts.sum() == pytest.approx([0.25, 0.5, 0.25], abs=0.08)


def test_a_comparison_with_a_prior_is_by_the_expected_time_to_find(capsys):
    given = ["search", "square:100", "--robots", "2", "--compare", "--prior", "ring:80,80:0.9=30"]
    assert run([*given, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["compared"]
    assert told[0]["by_prior"]
    assert told[-1]["pattern"] == "sector"
    assert told[-1]["searched_fraction"] < 1
    assert 0 < told[-1]["success"] < 1
    whole = [one["expected_find_s"] for one in told[:-1]]
    assert whole == sorted(whole)
    assert all(one["success"] == pytest.approx(1) for one in told[:-1])
    assert run([*given, "--tour", "comb", "--allocation", "hop"]) == 0
    printed = capsys.readouterr().out
    assert "by the prior" in printed
    assert "parallel-track" not in printed
