"""Plans for known maps."""

from __future__ import annotations

import json

import numpy as np
import pytest
from tests.reference.small import small_cases
from tests.swarm_runs import run

from shoal import open_map
from shoal.cli import run as command
from shoal.core.errors import InvalidInputError
from shoal.swarm import GridWorkspace
from shoal.swarm.policies.planners import offline
from shoal.swarm.policies.planners.offline import plan_coverage
from shoal.swarm.theory.bounds import optimum


def covered(workspace, start, plan, rule="block"):
    """Return the cells that somebody has stood in, by the world step by step."""
    played = run(workspace, task="coverage", start=start, policy=f"manual:{plan}", rule=rule)
    seen = np.zeros_like(workspace.free)
    for state, _ in played.frames():
        seen |= state.occupied.inner
    return seen


@pytest.mark.parametrize("rule", ["block", "merge"])
@pytest.mark.parametrize("name", ["cave:20x15", "vessels3d:60"])
def test_a_plan_covers_all(name, rule):
    workspace = open_map(name)
    start = run(workspace, particles=8).start
    plan = plan_coverage(workspace, start, rule=rule, budget=200)
    assert covered(workspace, start, plan, rule)[workspace.free].all()
    assert not covered(workspace, start, plan[:-1], rule)[workspace.free].all()


def test_a_plan_covers_the_targets():
    workspace = open_map("cave:20x15")
    start = run(workspace, particles=12).start
    targets = workspace.free & (np.arange(workspace.shape[1]) % 3 == 0)
    plan = plan_coverage(workspace, start, targets=targets, budget=200)
    assert covered(workspace, start, plan)[targets].all()
    assert len(plan_coverage(workspace, start, targets=targets, budget=200, attempts=3)) <= len(
        plan
    )


def test_annealing_makes_plans_shorter_and_never_longer(monkeypatch):
    workspace = open_map("maze:21x15")
    starts = [run(workspace, particles=6, trial=trial).start for trial in range(4)]
    annealed = [len(plan_coverage(workspace, start, budget=2000)) for start in starts]
    monkeypatch.setattr(offline, "PIECES", 1)
    monkeypatch.setattr(
        offline.anneal, "anneal", lambda planner, course, length, fewest, *rest: (length, fewest, 0)
    )
    first = [len(plan_coverage(workspace, start, budget=2000)) for start in starts]
    assert all(one <= other for one, other in zip(annealed, first, strict=True))
    assert sum(annealed) < sum(first)


def test_plans_of_small_maps_are_nearly_optimal():
    excess = []
    for workspace, start in small_cases(40, seed=5):
        plan, fewest = plan_coverage(workspace, start, budget=100), optimum(workspace, start).moves
        assert len(plan) >= fewest
        excess.append(len(plan) / fewest - 1 if fewest else 0.0)
    assert np.mean(excess) < 0.01


def test_nothing_to_do():
    assert plan_coverage(GridWorkspace([[1, 1]]), [(0, 0), (0, 1)]) == ""


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: plan_coverage(open_map("line:4"), [(0, 0)], attempts=0),
            "attempts: expected a whole number, 1 or more, got 0",
        ),
        (
            lambda: plan_coverage(open_map("line:4"), [(0, 0)], rule="tilt"),
            "policy offline: expected rule block or merge, got tilt",
        ),
        (
            lambda: plan_coverage(GridWorkspace([[1, 0, 1]]), [(0, 0)]),
            "expected a particle in every connected part",
        ),
        (
            lambda: run(open_map("line:4"), particles=1, policy="offline"),
            "expected a task whose map is known",
        ),
        (
            lambda: run(
                open_map("line:4"), particles=1, policy="offline:budget=0", task="coverage"
            ),
            "budget: expected simulated",
        ),
    ],
)
def test_what_is_refused(call, message):
    with pytest.raises(InvalidInputError, match=message):
        call()


def test_the_policy_sends_the_plan(capsys):
    assert (
        command(
            [
                "cover",
                "cave:14x10",
                "-n",
                "6",
                "--policy",
                "offline",
                "--budget",
                "100",
                "--seed",
                "2",
                "--json",
            ]
        )
        == 0
    )
    said = json.loads(capsys.readouterr().out)
    assert said["policy"] == "offline:budget=100"
    assert said["status"] == ["complete"]
    episode = run(
        open_map("cave:14x10"), particles=6, policy="offline:budget=100", seed=2, task="coverage"
    )
    assert [episode.moves] == said["moves"]
    assert episode.verify()
