"""Tracks that were flown before and a prior: --searched TRACK lowers what is likely by Bayes."""

import json

import numpy as np
import pytest

import shoal
from shoal.cli import run as command
from shoal.core.errors import InvalidInputError
from shoal.search import SearchProblem, plan_search
from shoal.search.run import run

WEST = [(25.0, 0.0), (25.0, 100.0)]  # with a footprint of 50 m, the west half
FIELD = {"region": "square:100", "robots": 1, "footprint": 50, "elsewhere": 0.2}


def quarters(tmp_path, *rows):
    file = tmp_path / "quarters.npy"
    np.save(file, np.array(rows, dtype=float))
    return str(file)


def test_what_was_seen_surely_is_neither_likely_nor_searched(tmp_path):
    prior = quarters(tmp_path, (3, 1), (2, 2))
    plan = plan_search(SearchProblem(**FIELD, prior=[prior], searched=[WEST]), seed=1)
    assert len(plan.tour) == 2
    north = plan.positions([0, 1])[:, 1] > 50
    # of .8, an eighth in the north-east and two in the south-east; of .2, a quarter each
    left = np.where(north, 0.8 / 8 + 0.05, 0.8 * 2 / 8 + 0.05)
    np.testing.assert_allclose(plan.tour_cost.odds, left / left.sum())
    assert plan.prior_before == pytest.approx(1 - left.sum())
    assert plan.prior_inside == pytest.approx(1.0)


def test_with_a_detection_below_1_robots_look_again_where_it_is_still_likely(tmp_path):
    """Each track counts: twice over the west half, the target was missed with .2 squared."""
    prior = quarters(tmp_path, (3, 1), (2, 2))
    given = {**FIELD, "elsewhere": 0.0, "prior": [prior], "detection": 0.8, "at_most": 1.0}
    for looks in (1, 2):
        plan = plan_search(SearchProblem(**given, searched=[WEST] * looks), seed=1)
        assert len(plan.tour) == 4
        places = plan.positions(np.arange(4))
        weights = np.array([3, 1, 2, 2])[2 * (places[:, 1] < 50) + (places[:, 0] > 50)] / 8
        left = np.where(places[:, 0] < 50, 0.2**looks, 1.0) * weights
        np.testing.assert_allclose(plan.tour_cost.odds, left / left.sum())
        assert plan.prior_before == pytest.approx(5 / 8 * (1 - 0.2**looks))


def test_the_probability_of_the_region_is_by_bayes_too():
    """Half of the target is in the square. A track along its border sees as much on both sides, and
    another one only what is inside."""
    problem = SearchProblem(
        "square:100", robots=1, footprint=10, prior=["ring:100,50:0.999=30"], detection=0.5
    )
    assert plan_search(problem, seed=1).prior_inside == pytest.approx(0.5, abs=0.02)
    border, inner = ([(x, 0.0), (x, 100.0)] for x in (100.0, 85.0))
    plan = plan_search(problem.replaced(searched=[border]), seed=1)
    assert plan.prior_before > 0.05
    assert plan.prior_inside == pytest.approx(0.5, abs=0.02)
    plan = plan_search(problem.replaced(searched=[inner]), seed=1)
    missed = 1 - plan.prior_before
    assert plan.prior_inside == pytest.approx((0.5 - plan.prior_before) / missed, abs=0.02)
    assert plan.prior_inside < 0.49


def test_an_episode_and_its_report_hold_the_looks(tmp_path, capsys):
    prior, track = quarters(tmp_path, (3, 1), (2, 2)), tmp_path / "flown.gpx"
    table = tmp_path / "flown.csv"
    table.write_text("x,y\n25,0\n25,40\n\n25,60\n25,100\n")  # interrupted for 20 m
    given = ["search", "square:100", "--robots", "2", "--footprint", "10", "--prior", prior]
    given += [
        "--searched",
        str(table),
        "--detection",
        "0.5",
        "--json",
        "--out",
        str(tmp_path / "out"),
    ]
    assert command(given) == 0
    told = json.loads(capsys.readouterr().out)["prior"]
    # squares of 10 m along 40 m and a half at each end
    north, south = 10 * 50 * 3 / 8 / 2500, 10 * 50 * 2 / 8 / 2500
    assert told["before"] == pytest.approx(0.5 * (north + south) * 45 / 50, rel=0.05)
    loaded = shoal.load(tmp_path / "out" / "episode.json")
    assert loaded.problem.searched == ()
    assert loaded.problem.place.again
    assert loaded.plan.prior_before == pytest.approx(told["before"])
    assert loaded.verify()
    track.write_text("<gpx><trk><trkseg><trkpt lat='1' lon='2'/></trkseg></trk></gpx>")
    assert command([*given[:8], "--searched", str(track)]) == 2
    assert "expected metres" in capsys.readouterr().err


def test_tracks_that_saw_every_likely_place_are_refused(tmp_path):
    problem = SearchProblem(**FIELD, prior=[quarters(tmp_path, (1, 0), (1, 0))], searched=[WEST])
    with pytest.raises(InvalidInputError, match="leave some probability"):
        plan_search(problem.replaced(elsewhere=0.0), seed=1)
    assert run(problem, seed=1).plan.prior_inside == pytest.approx(1.0)
