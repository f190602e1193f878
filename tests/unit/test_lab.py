"""Trials: the same result for any number of workers, whatever finishes first."""

from __future__ import annotations

import numpy as np
import pytest
from tests.swarm_runs import run, run_trials

from shoal import InvalidInputError, open_map
from shoal.lab import Store, Sweep, run_sweep

PROBLEMS = [
    {"policy": "closest-frontier"},
    {"policy": "elect-particle", "placement": "flood-fill"},
    {"policy": "random-moves", "max_moves": 2000, "placement": "region-fill"},
    {"task": "subset-coverage", "rule": "merge"},
]


@pytest.mark.parametrize("problem", PROBLEMS, ids=lambda p: " ".join(map(str, p.values())))
def test_same_for_any_workers(problem):
    workspace = open_map("cave:30x20")
    one, three, eight = (
        run_trials(workspace, trials=12, workers=workers, seed=4, particles=25, **problem)
        for workers in (1, 3, 8)
    )
    for a, b, c in zip(one, three, eight, strict=True):
        assert a.commands == b.commands == c.commands
        np.testing.assert_array_equal(a.start, b.start)
    assert [e.trial for e in one] == list(range(12))
    assert len({e.commands for e in one}) > 1  # trials differ
    single = run(workspace, particles=25, seed=4, trial=7, **problem)
    assert single.commands == one[7].commands


def test_python_policies_run_in_processes():
    workspace = open_map("maze:9x7")
    problem = {"policy": "tests.unit.swarm.test_policies:ThirdParty", "particles": 3}
    one, two = (run_trials(workspace, trials=3, workers=workers, **problem) for workers in (1, 2))
    assert [e.commands for e in one] == [e.commands for e in two]


def test_progress_is_told():
    told = []
    run_trials(open_map("line:20"), trials=5, workers=2, particles=20, on_trial=told.append)
    assert told == [1, 2, 3, 4, 5]


def test_an_error_in_a_trial_is_raised():
    with pytest.raises(InvalidInputError, match="particles"):
        run_trials(open_map("line:20"), trials=5, particles=21)


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ({"trials": 0}, "trials"),
        ({"trials": 2, "workers": 0}, "workers"),
        ({"trials": 2.5}, "trials"),
        ({"trials": 1, "particles": 2.5}, "particles"),
    ],
)
def test_bad_numbers(numbers, words):
    with pytest.raises(InvalidInputError, match=words):
        run_trials(open_map("line:20"), **{"particles": 2} | numbers)


def test_a_local_policy_runs_alone_and_is_refused_in_processes():
    """A class that no other process can import: one worker plays it here, several say
    what to do.
    """
    local = type(
        "Local",
        (),
        {
            "name": "local",
            "decide": lambda self, view, memory, rng: ("lurd"[rng.integers(4)], None),
        },
    )()
    workspace = open_map("line:6")
    assert len(run_trials(workspace, trials=3, workers=1, policy=local, particles=3)) == 3
    with pytest.raises(InvalidInputError, match="other processes can import"):
        run_trials(workspace, trials=3, workers=2, policy=local, particles=3)


def test_only_some_points_of_a_sweep_run(tmp_path):
    sweep = Sweep("a", {"kind": "line", "cells": 9}, {"particles": [1, 2]}, trials=3)
    path = tmp_path / "a.sqlite"
    status = run_sweep(sweep, path, workers=0, only={"particles": (2,)})
    assert (status.done, status.total) == (3, 6)
    with Store(path) as store:
        assert {row[0] for row in store.rows("a")} == {2}
    assert run_sweep(sweep, path, workers=0).done == 6
    with pytest.raises(InvalidInputError, match="workers: expected a whole number, 0 or more"):
        run_sweep(sweep, path, workers=-1)  # although nothing is left to do
