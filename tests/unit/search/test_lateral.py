"""Lateral range curves: detection by distance and speed, in plans and in what they state."""

from __future__ import annotations

import json

import numpy as np
import pytest

from shoal.cli import run as command
from shoal.core.errors import InvalidInputError
from shoal.search import SearchProblem
from shoal.search.problem.lateral import lateral_range
from shoal.search.run import run

CURVE = "0=0.9,6=0.7,15=0.1,20=0@4"


@pytest.mark.parametrize("text", [CURVE, "0=1,10=0", "0=0.2,5=0.9,8=0.9", "0=1,0.5=1"])
@pytest.mark.parametrize("speed", [1.0, 4.0, 11.0])
@pytest.mark.parametrize("spacing", [0.7, 12.0, 16.0, 40.0, 90.0])
def test_the_mean_is_that_of_many_targets(text, speed, spacing):
    curve = lateral_range(text)
    beside = (np.arange(200_000) + 0.5) / 200_000 * spacing / 2
    assert curve.detection(spacing, speed) == pytest.approx(
        curve.at(beside, speed).mean(), abs=1e-5
    )
    everywhere = (np.arange(200_000) + 0.5) / 200_000 * 100 - 50
    assert curve.sweep_width(speed) == pytest.approx(
        100 * curve.at(everywhere, speed).mean(), abs=2e-3
    )


def test_slower_passages_see_more_and_the_curve_holds_at_its_own_speed():
    curve = lateral_range(CURVE)
    assert curve.at([0.0, 6.0, 10.5, 25.0], 4.0) == pytest.approx([0.9, 0.7, 0.4, 0.0])
    # at half of the speed as much as in two passages
    assert curve.at([0.0, 6.0], 2.0) == pytest.approx([1 - 0.1**2, 1 - 0.3**2])
    assert curve.detection(12, 2) > curve.detection(12, 4) > curve.detection(12, 8)
    assert lateral_range("0=0.9,9=0").detection(12, 2) == lateral_range("0=0.9,9=0").detection(
        12, 8
    )


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "METRES=P"),
        ("0=0.9", "two or more increasing distances"),
        ("1=0.9,2=0", "begin with 0"),
        ("0=0.9,5=0.5,5=0", "increasing"),
        ("0=1.2,5=0", "from 0 to 1"),
        ("0=0,5=0", "not all 0"),
        ("0=0.9,5=0@0", "a speed above 0"),
        ("0=0.9,5=0@1e999", "a speed above 0"),
        ("0=0.9,1e999=0", "increasing"),
        ("0=0.9,-5=0", "METRES=P"),
        ("0=nan,5=0", "METRES=P"),
    ],
)
def test_what_is_no_curve_is_refused(text, told):
    with pytest.raises(InvalidInputError, match=told):
        lateral_range(text)


@pytest.mark.parametrize(
    ("fields", "told"),
    [
        ({"targets": 2, "detection": 0.5}, "either a lateral range or a detection"),
        ({}, "expected targets or a prior"),
        ({"targets": 2, "footprint": (10.0, 20.0), "robots": 2}, "equal footprints"),
        ({"targets": 2, "rates": (1.0, 2.0), "robots": 2}, "equal footprints and speeds"),
        ({"targets": 2, "vehicle": "fixed-wing,wind_speed=8,wind_from=270"}, "expected no wind"),
        ({"targets": 2, "vehicle": "multirotor,wind_speed=2"}, "got @4 and a wind_speed of 2 m/s"),
    ],
)
def test_a_curve_that_has_no_one_detection_is_refused(fields, told):
    with pytest.raises(InvalidInputError, match=told):
        SearchProblem("square:100", **{"lateral_range": CURVE, **fields})


def test_a_curve_without_a_speed_holds_in_wind_too():
    vehicle = "fixed-wing,wind_speed=8,wind_from=270"
    curve, _, _ = CURVE.partition("@")
    problem = SearchProblem("square:400", targets=2, vehicle=vehicle, lateral_range=curve)
    share = lateral_range(curve).detection(problem.chosen_footprint, 8)
    assert problem.chosen_detection == pytest.approx(share)


def test_a_curve_is_a_detection_in_plans_simulations_and_numbers():
    given = {"robots": 2, "footprint": 16, "prior": ["ring:30,60:0.5=15,0.95=40"], "at_most": 1.4}
    given |= {"vehicle": "multirotor,cruise_speed=5"}
    by_curve = SearchProblem("square:120", lateral_range=CURVE, **given)
    share = lateral_range(CURVE).detection(16, 5)
    assert by_curve.chosen_detection == pytest.approx(share)
    one, other = (
        run(problem, seed=1)
        for problem in (by_curve, SearchProblem("square:120", detection=share, **given))
    )
    assert one.expected_find == pytest.approx(other.expected_find)
    assert one.scenario.detection == other.scenario.detection == pytest.approx(share)
    report = one.report()
    assert report["lateral_range"]["detection"] == pytest.approx(share)
    assert report["prior"]["success"] == pytest.approx(other.report()["prior"]["success"])
    assert other.report()["lateral_range"] is None
    assert SearchProblem.from_dict(by_curve.to_dict()).chosen_detection == by_curve.chosen_detection


def test_the_command_tells_the_sweep_width(capsys):
    words = ["search", "square:100", "--robots", "2", "--footprint", "20", "--targets", "3"]
    words += ["--lateral-range", "0=1,10=0"]
    assert command([*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["lateral_range"]
    assert told == pytest.approx({"detection": 0.5, "sweep_width_m": 10.0, "row_distance_m": 20.0})
    assert command(words) == 0
    assert "50 % for one passage of a row" in " ".join(capsys.readouterr().out.split())
    assert command([*words[:-1], "0=2,5=0"]) == 2
    assert "probabilities from 0 to 1" in capsys.readouterr().err
