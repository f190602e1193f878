"""The options of planners on the command line."""

from __future__ import annotations

import json

import pytest

from shoal.cli import run

CAVE = ["map", "cave:14x10", "-n", "6", "--json"]


def policy_of(capsys, *options):
    assert run([*CAVE, *options]) == ("--max-moves" in options)
    return json.loads(capsys.readouterr().out)["policy"]


def test_best_is_the_default_of_map(capsys):
    assert policy_of(capsys) == "beam-rollout"
    assert policy_of(capsys, "--budget", "50") == "beam-rollout:budget=50.0"
    assert policy_of(capsys, "--time-per-move", "1") == "beam-rollout:milliseconds=1.0"
    assert (
        policy_of(capsys, "--policy", "beam-rollout", "--budget", "50")
        == "beam-rollout:budget=50.0"
    )


def test_the_default_policy_has_the_name_that_help_and_pages_use(capsys):
    for options, expected in (
        ((), "best (beam-rollout)"),
        (("--policy", "greedy-classify"), "greedy-classify"),
    ):
        assert run([*CAVE[:-1], *options]) == 0
        assert [
            line.split(maxsplit=1)[1].strip()
            for line in capsys.readouterr().out.splitlines()
            if line.startswith("policy")
        ] == [expected]


def test_closest_frontier_where_planners_have_no_answer(capsys):
    assert policy_of(capsys, "--scan-every", "3") == "closest-frontier"
    assert policy_of(capsys, "--rule", "tilt", "--max-moves", "50") == "closest-frontier"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--policy", "closest-frontier", "--budget", "50"], "budget: expected a planner"),
        (["--policy", "sweep", "--time-per-move", "1"], "time-per-move: expected a planner"),
        (
            ["--budget", "50", "--time-per-move", "1"],
            "expected a budget or a time per move, got both",
        ),
        (["--budget", "0"], "budget: expected a number, above 0"),
        (["--budget", "50", "--scan-every", "3"], "scan-every: expected 1 for policy beam-rollout"),
    ],
)
def test_options_that_do_not_fit(options, message, capsys):
    assert run([*CAVE, *options]) == 2
    assert message in capsys.readouterr().err
