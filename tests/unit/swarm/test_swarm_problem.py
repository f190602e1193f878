"""SwarmProblem: what it takes, what it refuses, and that a file holds all of it."""

import json
import pickle
from dataclasses import dataclass

import numpy as np
import pytest

from shoal.core.errors import InvalidInputError, UnknownNameError
from shoal.swarm import Coverage, GridWorkspace, SubsetCoverage, SwarmProblem
from shoal.swarm.policies import ClosestFrontier


class Outsider:
    """A policy of a third party."""

    name = "outsider"

    def decide(self, view, memory, rng):
        return "l", None


@dataclass(frozen=True)
class Weighed(Outsider):
    weight: float = 1.0


FAVOURITE = Weighed(3.0)


def my_placement(workspace, n, rng):
    return workspace.cells[:n]


GIVEN = [
    {},
    {"task": "coverage", "subset": 0.2, "particles": 3},
    {
        "task": SubsetCoverage(0.3),
        "policy": ClosestFrontier(ties="row-major"),
        "placement": my_placement,
    },
    {"task": Coverage()},
    {"policy": Outsider()},
    {"policy": FAVOURITE},
    {"policy": "elsewhere:Policy"},
    {"start": np.array([[0, 1], [0, 3]]), "rule": "merge", "max_moves": np.int64(7)},
    {"scan_every": "4", "scan_cost": 3, "move_cost": 0},
    {"scan_every": "adaptive"},
    {"slip": 0.1, "confidence": 0.9},
    {"policy": "best", "budget": 1000},
    {"largest_component": True, "level": 0.5, "width": None},
]


@pytest.mark.parametrize("given", GIVEN, ids=range(len(GIVEN)))
@pytest.mark.parametrize(
    "place",
    [
        "line:9",
        GridWorkspace([[1, 1, 0], [0, 1, 1]], name="stairs", spacing=(1, 2)),
        np.ones((2, 3, 4)),
    ],
    ids=["name", "workspace", "array"],
)
def test_a_problem_survives_a_file(given, place):
    problem = SwarmProblem(place, **given)
    again = SwarmProblem.from_dict(json.loads(json.dumps(problem.to_dict())))
    assert again == problem
    assert again.canonical() == problem.canonical()
    assert pickle.loads(pickle.dumps(problem)) == problem
    assert SwarmProblem.from_dict(json.loads(json.dumps(problem.to_dict(defaults=True)))) == problem


def test_a_path_is_a_map(tmp_path):
    path = tmp_path / "small.txt"
    path.write_text(".#\n..\n")
    problem = SwarmProblem(path, particles=1)
    assert problem.place_is_file()
    assert not SwarmProblem("line:9").place_is_file()
    assert str(problem.place) == ".#\n.."
    assert problem.place_digest() == SwarmProblem([[1, 0], [1, 1]]).place_digest()
    assert problem.at_place(GridWorkspace([[1]])).place.n_free == 1


def test_places_have_keys():
    assert (
        SwarmProblem("line:9").place_key()
        == SwarmProblem("line:9", particles=3, task="coverage").place_key()
    )
    assert (
        SwarmProblem("line:9").place_key()
        != SwarmProblem("line:9", largest_component=True).place_key()
    )
    assert SwarmProblem([[1]]).place_key() is None


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"particles": 0}, "particles: expected a whole number from 1 to 268435456, got 0"),
        (
            {"particles": 5, "start": [(0, 1)]},
            "particles: expected 1, the number of start cells, got 5",
        ),
        ({"start": [(0, 1), (0,)]}, "start: expected cells of 2 or 3 whole numbers each"),
        ({"start": [(0, 0.5)]}, "start: expected cells of 2 or 3 whole numbers each"),
        (
            {"subset": 0.2},
            "subset: expected the task coverage together with a subset, got the task mapping",
        ),
        ({"task": "coverage", "subset": 1.5}, "subset: expected a number, above 0"),
        ({"budget": 1, "time_per_move": 1}, "expected a budget or a time per move, got both"),
        ({"confidence": 0.9}, "confidence: expected a confidence only together with noise"),
        ({"slip": 0.1, "rule": "merge"}, "noise: expected rule block, got merge"),
        ({"slip": 0.1, "task": "coverage"}, "noise: expected the task mapping, got coverage"),
        (
            {"slip": 0.1, "scan_every": "hyper"},
            "noise: expected scan-every as a number of commands",
        ),
        ({"slip": 0.6}, "slip: expected a number from 0 to 0.5, got 0.6"),
        ({"scan_every": "sometimes"}, "scan-every: expected 1 to"),
        ({"scan_cost": 0, "move_cost": 0}, "expected a price above 0 for a scan or a move"),
        (
            {"policy": 3},
            "policy: expected a name, or an object with a name and a method decide, got 3",
        ),
        ({"placement": 3}, "placement: expected a name, or a function"),
        ({"rule": "blok"}, "did you mean 'block'?"),
        ({"map": {"rows": ["..", "x."]}}, "map: expected rows of . and #, got 'x.'"),
    ],
)
def test_what_does_not_fit_is_refused_in_a_sentence(given, words):
    with pytest.raises(
        InvalidInputError, match=words.replace("(", r"\(").replace("?", r"\?")
    ) as caught:
        SwarmProblem(**{"map": "line:9"} | given)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "given", [{"policy": "closest-fronteir"}, {"task": "maping"}, {"placement": "unifrom"}]
)
def test_unknown_names_are_refused_with_the_nearest(given):
    with pytest.raises(UnknownNameError, match="did you mean"):
        SwarmProblem("line:9", **given)


@pytest.mark.parametrize(
    ("given", "chosen"),
    [
        ({}, "beam-rollout"),
        ({"budget": 50.0}, "beam-rollout:budget=50.0"),
        ({"time_per_move": 2.0}, "beam-rollout:milliseconds=2.0"),
        ({"rule": "merge"}, "beam-rollout"),
        ({"rule": "tilt"}, "closest-frontier"),
        ({"scan_every": 2}, "closest-frontier"),
        ({"slip": 0.1}, "beam-rollout"),
        ({"task": "coverage"}, "closest-frontier"),
        ({"task": "coverage", "subset": 0.5}, "closest-frontier"),
        ({"policy": "offline", "task": "coverage", "budget": 99.0}, "offline:budget=99"),
    ],
)
def test_auto_chooses_what_can_do_the_task(given, chosen):
    problem = SwarmProblem("line:9", particles=2, **given)
    problem.check_at_place()
    assert problem.chosen_policy.name == chosen


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (
            {"policy": "best", "rule": "tilt"},
            "policy beam-rollout: expected rule block or merge, got tilt",
        ),
        ({"policy": "best", "scan_every": 2}, "scan-every: expected 1 for policy beam-rollout"),
        ({"scan_every": 2, "budget": 10.0}, "scan-every: expected 1 for policy beam-rollout"),
        ({"task": "coverage", "budget": 10.0}, "budget: expected a planner"),
        (
            {"policy": "closest-frontier", "time_per_move": 10.0},
            "time-per-move: expected a planner",
        ),
        (
            {"policy": "random-moves", "scan_every": "adaptive"},
            "expected a number, or the policy closest-frontier for adaptive",
        ),
        ({"particles": 10}, "particles: expected 1 to 9"),
        ({"start": [(0, 9)]}, "start: expected cells inside"),
    ],
)
def test_what_cannot_be_done_is_refused_at_the_place(given, words):
    problem = SwarmProblem("line:9", **{"particles": 1} | given)
    with pytest.raises(InvalidInputError, match=words.replace("(", r"\(")):
        problem.check_at_place()


def test_beginnings_of_equal_problems_are_equal():
    explicit = {
        name: declared.default
        for name, declared in SwarmProblem.declarations().items()
        if not declared.required
    }
    assert SwarmProblem("line:9", **explicit).canonical() == '{"kind":"swarm","map":"line:9"}'
    assert SwarmProblem("line:9", scan_every="1") == SwarmProblem("line:9")
    assert hash(SwarmProblem("line:9")) == hash(SwarmProblem("line:9", rule="block"))
